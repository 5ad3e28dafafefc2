# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The topics that the plant publishes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.duration import Duration
from rosgraph_msgs.msg import Clock

from rpo_core.chain.chain import Signals
from rpo_core.wire import cdr, interfaces
from rpo_core.wire.interfaces import REMEMBERED_TICKS
from rpo_core.wire.statuses import numbers_text
from rpo_ros import conversions, health, names, qos
from rpo_ros.running import FlightNode
from rpo_ros.signals import Outlet
from rpo_sim.plant import ZERO, Force, Plant


class Publications:
    """The topics of the plant: /clock, states, run_status, outputs of its stages and pacing.

    made : the outputs of stages and pacing that are topics
    """

    def __init__(self, node: FlightNode, clock: bool, made: Sequence[str]) -> None:
        self._state = Outlet(node, interfaces.RELATIVE_STATE)
        self._status = node.create_publisher(DiagnosticStatus, interfaces.RUN_STATUS, qos.LATCHED)
        self._clock = node.create_publisher(Clock, names.CLOCK, qos.CLOCK) if clock else None
        self._made = {name: Outlet(node, name) for name in made}

    def state(self, stamp_ns: int, signals: Signals) -> None:
        """Publish the time of a state on /clock, and then the state: it is in nobody's future."""
        if self._clock is not None:
            self._clock.handle.publish_raw(cdr.encode_clock(stamp_ns))  # as an Outlet does
        self._state.publish_of(stamp_ns, signals)

    def made(self, stamp_ns: int, signals: Signals) -> Signals:
        """Publish those of some signals that are outputs of the plant; return what they say."""
        found = [name for name in self._made if name in signals]
        for name in found:
            self._made[name].publish_of(stamp_ns, signals)
        return {name: self._made[name].numbers_of(signals) for name in found}

    def before_flight(self, stamp_ns: int) -> None:
        """Publish the outputs once with a stamp before the first, to connect a recorder."""
        self.made(stamp_ns, dict.fromkeys(self._made, ZERO))

    def status(self, level: bytes, reason: str, values: Mapping[str, Any]) -> None:
        """Publish run_status."""
        self._status.publish(conversions.to_status(level, 'run', reason, values.items()))

    def last_words(self, most_s: float) -> None:
        """Wait until all subscribers have the last run_status."""
        self._status.wait_for_all_acked(Duration(seconds=0, nanoseconds=round(most_s * 1e9)))


class TickReports:
    """What the plant published and took at a tick: on `plant_tick`, from where a recorder asks.

    A tick is reported when no answer to its state can act any more. A flight without a question
    publishes nothing.

    run : id of the plant
    peers : topics of the answers
    """

    def __init__(self, node: FlightNode, run: str, peers: Sequence[str]) -> None:
        self._run, self._peers = run, tuple(peers)
        profile = qos.of(interfaces.row_of(interfaces.PLANT_TICK).qos)
        self._publisher = node.create_publisher(DiagnosticStatus, interfaces.PLANT_TICK, profile)
        self.forget()

    def forget(self) -> None:
        """Begin a new run, of which nobody has asked yet."""
        self._known: dict[int, tuple[Signals, dict[str, Force]]] = {}
        self._asked: int | None = None
        self._settled = 0

    def passed(self, plant: Plant, tick: int, published: Signals) -> None:
        """Remember what was published at a tick; the answers may still come."""
        self._known[tick] = published, plant.taken[tick]
        self._known.pop(tick - REMEMBERED_TICKS, None)
        self._settle(tick - plant.settled_after_ticks)

    def end(self, plant: Plant) -> None:
        """Report the ticks up to the last one of the run."""
        self._known.setdefault(plant.tick, (plant.truth, plant.taken[plant.tick]))
        self._settle(plant.tick)

    def ask(self, first: int) -> None:
        """Report the ticks from one on, as far as they are remembered and not reported yet."""
        before = self._settled if self._asked is None else min(self._asked, self._settled)
        self._asked = first if self._asked is None else min(self._asked, first)
        for tick in range(max(first, before - REMEMBERED_TICKS), before):
            self._publish(tick)

    def _settle(self, last: int) -> None:
        for tick in range(self._settled, last + 1):
            if self._asked is not None and tick >= self._asked:
                self._publish(tick)
        self._settled = max(self._settled, last + 1)

    def _publish(self, tick: int) -> None:
        if tick not in self._known:
            return
        published, taken = self._known[tick]
        values: dict[str, object] = {'run': self._run, 'tick': tick}
        for name, numbers in (*published.items(), *((n, taken.get(n, ())) for n in self._peers)):
            values[name] = numbers_text(interfaces.row_of(name).spoken(numbers))
        status = conversions.to_status(health.OK, 'plant', 'tick', values.items())
        self._publisher.publish(status)
