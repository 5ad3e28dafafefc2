# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Node `plant`: flies the chaser in lockstep with whoever answers its states."""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping
from functools import partial
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import WrenchStamped
from nav_msgs.msg import Odometry
from rclpy.clock import Clock as RosClock
from rclpy.clock import ClockType
from rclpy.duration import Duration
from rosgraph_msgs.msg import Clock

from rpo_core import files, scenario
from rpo_ros import conversions, health, names, qos
from rpo_ros.parameters import Row, declare
from rpo_ros.running import FlightNode, run_node
from rpo_sim.lockstep import ACCEPTED, LockstepPlant

EXIT_ABORTED = 3

PARAMETERS = (
    Row('scenario', 'approach', 'shipped scenario, or path of a scenario file',
        example='paper_test'),
    Row('on_peer_timeout', 'abort', 'when a peer stops answering: end the run or fly on without it',
        choices=('abort', 'coast')),
    Row('real_time_factor', 0.0, 'simulated seconds per second; 0: as fast as it goes',
        most=1e6, wall=True),
    Row('resend_after_s', 0.25, 'wall time without an answer before a state is sent again', 's',
        least=1e-3, wall=True),
    Row('peer_timeout_s', 10.0, 'wall time without an answer before a peer is lost', 's',
        least=1e-2, wall=True),
    Row('start_timeout_s', 0.0, 'wall time to wait for peers before tick 0; 0: for ever', 's',
        wall=True),
    Row('wait_for_recorder', False, 'insist on a recorder before tick 0; one in sight is waited '
        'for anyway', wall=True),
    Row('publish_clock', True, 'publish /clock'),
)  # fmt: skip

_LOOK_S = 0.05
_SAY_S = 5.0
_ENDED = ('finished', 'aborted')
_LAST_WORD_S = 5.0
"""Longest wait for the recorder to close its log after the end of a run."""
_INTERRUPTED = Duration(seconds=0, nanoseconds=200_000_000)


class PlantNode(FlightNode):
    """Publishes state k, waits for the forces that carry its stamp, steps, goes on."""

    def __init__(self, overrides: Mapping[str, Any] | None = None) -> None:
        super().__init__('plant', overrides)
        self.values = declare(self, PARAMETERS)
        path = files.find('scenario', self.values['scenario'])
        flown = scenario.load_scenario(path)
        answers = [names.CONTROL_FORCE]
        if not flown.disturbance.is_zero:
            answers.append(names.DISTURBANCE_FORCE)
        self.plant = LockstepPlant(flown, answers)
        self.phase = 'waiting'
        self.resends = 0
        self._recorder = ''
        self._overdue = False
        self._begun = self._sent = self._progress = time.monotonic()
        self._said = 0.0
        self._connect()
        shaping = {row.name: self.values[row.name] for row in PARAMETERS if not row.wall}
        shaping['scenario'] = flown.name
        health.publish_manifest(self, 'plant', shaping, {'scenario.yaml': files.read_text(path)})
        health.publish_health(self, self._health)
        self._report(health.OK, 'waiting', 'waiting for peers')

    def _connect(self) -> None:
        self._state = self.create_publisher(Odometry, names.RELATIVE_STATE, qos.LOCKSTEP)
        self._status = self.create_publisher(DiagnosticStatus, names.RUN_STATUS, qos.LATCHED)
        self._clock = None
        if self.values['publish_clock']:
            self._clock = self.create_publisher(Clock, names.CLOCK, qos.CLOCK)
        for topic in self.plant.expected:
            self.create_subscription(
                WrenchStamped, topic, partial(self._on_answer, topic), qos.LOCKSTEP
            )
        self.create_subscription(
            DiagnosticStatus, names.RECORDER_STATUS, self._on_recorder, qos.LATCHED
        )
        steady = RosClock(clock_type=ClockType.STEADY_TIME)
        look_s = min(_LOOK_S, self.values['resend_after_s'])
        self.create_timer(look_s, self._look, clock=steady)
        factor = self.values['real_time_factor']
        self._paced = factor > 0.0
        if self._paced:
            self.create_timer(self.plant.scenario.dt_s / factor, self._on_pace, clock=steady)

    def _on_answer(self, topic: str, message: WrenchStamped) -> None:
        force = conversions.from_wrench(message)
        fault = conversions.fault_of(message, force)
        if fault:
            self.plant.ignore(fault)
            return
        stamp_ns = conversions.from_stamp(message.header.stamp)
        if self.plant.answer(topic, stamp_ns, force) != ACCEPTED or self.plant.missing:
            return
        if self.phase == 'running' and (self._overdue or not self._paced):
            self._advance()

    def _on_recorder(self, message: DiagnosticStatus) -> None:
        self._recorder = message.message

    def _on_pace(self) -> None:
        if self.phase != 'running':
            return
        self._overdue = bool(self.plant.missing)
        if not self._overdue:
            self._advance()

    def _advance(self) -> None:
        if self.plant.finished:
            self._end('finished', 'reached the last tick')
            return
        self._overdue = False
        self.plant.advance()
        self._progress = time.monotonic()
        self._send()

    def _send(self) -> None:
        stamp_ns = self.plant.stamp_ns
        if self._clock is not None:
            self._clock.publish(conversions.to_clock(stamp_ns))
        self._state.publish(conversions.to_odometry(stamp_ns, self.plant.state))
        self._sent = time.monotonic()

    def _look(self) -> None:
        """Wall-clock watch: starts the run, sends a state again, notices a lost peer."""
        now = time.monotonic()
        if self.phase == 'waiting':
            self._wait(now)
        elif self.phase in _ENDED:
            recorded = self._recorder in ('', 'closed')
            self.done = recorded or now - self._progress > _LAST_WORD_S
        elif self.plant.missing:
            if now - self._progress > self.values['peer_timeout_s']:
                self._lose_peers()
            elif now - self._sent > self.values['resend_after_s']:
                self.resends += 1
                self._send()

    def _wait(self, now: float) -> None:
        """Send state 0 until it is answered and a recorder is ready: then all are connected."""
        absent = [topic for topic in self.plant.expected if not self.count_publishers(topic)]
        if not absent:
            self._send()
        recorder = self.values['wait_for_recorder'] or self.count_publishers(names.RECORDER_STATUS)
        awaited = self.plant.missing + ['the recorder'] * bool(
            recorder and self._recorder != 'ready'
        )
        if not awaited:
            self.phase = 'running'
            self._progress = now
            self._report(health.OK, 'running', 'flying')
            self.get_logger().info(f'flying {self.plant.scenario.name}')
            self._advance()
        elif 0.0 < self.values['start_timeout_s'] < now - self._begun:
            self._abort(f'no answer in time from {", ".join(awaited)}')
        elif now - self._said > _SAY_S:
            self._said = now
            self.get_logger().info(f'waiting for {", ".join(awaited)}')

    def _lose_peers(self) -> None:
        lost = ', '.join(self.plant.missing)
        if self.values['on_peer_timeout'] == 'abort':
            self._abort(f'no answer to tick {self.plant.tick} from {lost}')
            return
        self.plant.drop_missing()
        self.get_logger().warning(f'no answer to tick {self.plant.tick} from {lost}: coasting')
        self._report(health.WARN, 'running', f'coasting without {lost}')
        self._advance()

    def _abort(self, reason: str) -> None:
        self.exit_code = EXIT_ABORTED
        self._end('aborted', reason, health.ERROR)

    def _end(self, phase: str, reason: str, level: bytes = health.OK) -> None:
        self._report(level, phase, reason)
        self._progress = time.monotonic()
        if phase == 'aborted':
            said = f'aborted at tick {self.plant.tick}: {reason}'
            log = self.get_logger()
            log.error(said) if level == health.ERROR else log.info(said)
            return
        figures = self.plant.figures()
        self.get_logger().info(
            f'finished at {figures["time_s"]:g} s: {figures["distance_m"]:.3g} m, '
            f'{figures["speed_m_s"]:.3g} m/s, J = {figures["energy_n2s"]:.4g} N^2 s'
        )

    def _report(self, level: bytes, phase: str, reason: str) -> None:
        """Publish run_status: simulated facts only, so that two runs say the same."""
        self.phase = phase
        values = [('phase', phase), *self.plant.figures().items()]
        self._status.publish(conversions.to_status(level, 'run', reason, values))

    def _health(self) -> health.Health:
        plant = self.plant
        level = health.WARN if plant.ignored or self.resends else health.OK
        ignored = {f'ignored_{kind}': count for kind, count in sorted(plant.ignored.items())}
        return level, self.phase, {'tick': plant.tick, 'resends': self.resends, **ignored}

    def interrupt(self, reason: str) -> None:
        """Say that the run was interrupted, and let the recorder close its log."""
        if self.phase not in _ENDED:
            self._end('aborted', f'interrupted by {reason}', health.WARN)
            self._status.wait_for_all_acked(_INTERRUPTED)


def main() -> int:
    """Entry point of `ros2 run rpo_sim plant`."""
    return run_node('ros2 run rpo_sim plant', PlantNode, __doc__, PARAMETERS)


if __name__ == '__main__':
    sys.exit(main())
