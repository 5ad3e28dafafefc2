# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Node `fault_injector`: drops, delays, repeats, reorders or corrupts messages between two topics.

Remap the sender to `from_topic`; then all its messages pass through this node:
  ros2 run rpo_ctrl fuzzy_controller --ros-args -r control_force:=control_force_raw
"""

from __future__ import annotations

import copy
import math
import time
from collections.abc import Mapping
from typing import Any

from geometry_msgs.msg import WrenchStamped
from nav_msgs.msg import Odometry
from rclpy.time import Time

from rpo_core.files.validation import InputError
from rpo_core.scenario.scenario import Scenario
from rpo_core.wire import interfaces
from rpo_core.world import link
from rpo_ros import health, qos
from rpo_ros.plant_scenario import PlantScenario
from rpo_ros.running import EXIT_BAD_INPUT, FlightNode

ANY, AUTO, STATE, FORCE = 'any', 'auto', 'state', 'force'
LAST_TICK = 1_000_000_000
"""Values of its parameters; the last one stands for the end of the flight."""

_CLOCK_S = 0.002
"""Resolution of delays by wall time."""

_WRONG_STAMP_NS = 1_000_000_000
"""Error of a wrong stamp."""


def message_type(kind: str, topics: tuple[str, str]) -> type[Odometry] | type[WrenchStamped]:
    """Return the message type of the topics; raises InputError if it is unknown."""
    if kind == AUTO:
        states = [interfaces.RELATIVE_STATE in topic for topic in topics]
        forces = [
            interfaces.CONTROL_FORCE in topic or interfaces.DISTURBANCE_FORCE in topic
            for topic in topics
        ]
        if any(states) == any(forces):
            raise InputError(
                f'`message` must be {STATE} or {FORCE}: the names of the topics do not show which; '
                f'got {AUTO} for {topics[0]} and {topics[1]}'
            )
        kind = STATE if any(states) else FORCE
    return Odometry if kind == STATE else WrenchStamped


def corrupted(message: Odometry | WrenchStamped, corruption: str) -> Odometry | WrenchStamped:
    """Return a corrupted copy of a message; the message itself if `corruption` is ''."""
    if not corruption:
        return message
    faulty = copy.deepcopy(message)
    first = faulty.pose.pose.position if isinstance(faulty, Odometry) else faulty.wrench.force
    if corruption == link.NAN:
        first.x = math.nan
    elif corruption == link.INFINITY:
        first.x = math.inf
    elif corruption == link.WRONG_FRAME:
        faulty.header.frame_id = interfaces.CHASER_FRAME
    else:
        stamp_ns = max(0, Time.from_msg(message.header.stamp).nanoseconds - _WRONG_STAMP_NS)
        faulty.header.stamp = Time(nanoseconds=stamp_ns).to_msg()
    return faulty


class FaultInjectorNode(FlightNode):
    """Injects random faults between two topics; the same seed gives the same faults."""

    package = 'rpo_sim'

    def __init__(self, overrides: Mapping[str, Any] | None = None) -> None:
        super().__init__('fault_injector', overrides)
        values = self.values
        source, sink = (
            self.resolve_topic_name(values[name]) for name in ('from_topic', 'to_topic')
        )
        if source == sink:
            raise InputError(f'`to_topic` must differ from `from_topic`; got {sink} for both')
        kind = message_type(values['message'], (source, sink))
        corruption = values['corruption']
        self.link: link.SeededLink[Odometry | WrenchStamped] = link.SeededLink(
            link.FaultRates(**{name: values[name] for name in link.KINDS}),
            values['seed'],
            values['delay_messages'],
            link.CORRUPTIONS if corruption == ANY else (corruption,),
            values['delay_s'],
        )
        last = math.inf if values['to_tick'] == LAST_TICK else values['to_tick']
        self._schedule = link.Schedule(values['from_tick'], last)
        self._scenario: Scenario | None = None
        PlantScenario(self, values['scenario'], self._take, self._refuse, bare=True).begin()
        self._out = self.create_publisher(kind, sink, qos.LOCKSTEP)
        self.create_subscription(kind, source, self._on_message, qos.LOCKSTEP)
        if values['delay_s'] > 0.0:
            self.every(_CLOCK_S, self._on_clock)
        health.publish_health(self, self._health)
        self.get_logger().info(f'faults between {source} and {sink}')

    def _take(self, scenario: Scenario) -> None:
        self._scenario = scenario

    def _refuse(self, reason: str) -> None:
        self.get_logger().error(reason)
        self.exit_code, self.done = EXIT_BAD_INPUT, True

    def _on_message(self, message: Odometry | WrenchStamped) -> None:
        stamp_ns = Time.from_msg(message.header.stamp).nanoseconds
        tick = self._scenario.tick_of(stamp_ns) if self._scenario is not None else None
        faulty = self._schedule.covers(tick)
        self._pass_on(self.link.take(message, faulty, time.monotonic()))

    def _on_clock(self) -> None:
        self._pass_on(self.link.due(time.monotonic()))

    def _pass_on(self, messages: list[tuple[Odometry | WrenchStamped, str]]) -> None:
        for out, corruption in messages:
            self._out.publish(corrupted(out, corruption))

    def _health(self) -> health.Health:
        return health.OK, 'injecting faults', {**self.link.counts, 'held': self.link.held}

    def close(self) -> None:
        """Log the number of faults."""
        done = ', '.join(f'{kind} {count}' for kind, count in self.link.counts.items())
        self.get_logger().info(f'faults injected: {done or "no message arrived"}')


main = FaultInjectorNode.main
