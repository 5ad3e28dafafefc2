# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Node `plant`: flies the chaser, in lockstep with whoever answers its states or free running."""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping
from functools import partial
from typing import Any

from geometry_msgs.msg import WrenchStamped

from rpo_core import files, scenario
from rpo_ros import conversions, health, names, qos
from rpo_ros.parameters import declare
from rpo_ros.running import FlightNode, run_node
from rpo_sim.free_running import FreeRunningPlant
from rpo_sim.lockstep import LockstepPlant
from rpo_sim.loop_health import LoopHealth
from rpo_sim.pacing import FreeRunningPacing, LockstepPacing
from rpo_sim.plant import ACCEPTED
from rpo_sim.plant_parameters import FREE_RUNNING, LOCKSTEP, PARAMETERS
from rpo_sim.publications import Publications
from rpo_sim.recorder_watch import RecorderWatch
from rpo_sim.simulator_control import SimulatorControl

EXIT_ABORTED = 3

_LOOK_S = 0.05
_SAY_S = 5.0
_ENDED = ('finished', 'aborted')
_LAST_WORD_S = 5.0
"""Longest wait for the recorder to close its log after the end of a run."""
_INTERRUPTED_S = 0.2
_APPLIED = {
    names.CONTROL_FORCE: names.APPLIED_FORCE,
    names.DISTURBANCE_FORCE: names.APPLIED_DISTURBANCE,
}


class PlantNode(FlightNode):
    """Publishes state k, lets tick k pass as its mode says, goes on.

    phase : waiting, running, finished or aborted
    progress_s, sent_s : monotonic times of the last tick, of the last state sent
    """

    def __init__(self, overrides: Mapping[str, Any] | None = None) -> None:
        super().__init__('plant', overrides)
        self.values = declare(self, PARAMETERS)
        path = files.find('scenario', self.values['scenario'])
        self.scenario = scenario.load_scenario(path)
        self._peers = [names.CONTROL_FORCE]
        if not self.scenario.disturbance.is_zero:
            self._peers.append(names.DISTURBANCE_FORCE)
        self._connect()
        self.control = SimulatorControl(self)
        self._manifest(files.read_text(path))
        self._begin_run()
        self.every(min(_LOOK_S, self.values['resend_after_s']), self._look)
        health.publish_health(self, self._health)

    def _connect(self) -> None:
        """Make publishers and subscriptions; in free running it is said what is flown."""
        free = self.values['mode'] == FREE_RUNNING
        applied = [_APPLIED[topic] for topic in self._peers] if free else []
        self.topics = Publications(self, self.values['publish_clock'], applied)
        for topic in self._peers:
            on_answer = partial(self._on_answer, topic)
            self.create_subscription(WrenchStamped, topic, on_answer, qos.IN_LOOP)
        self.recorder = RecorderWatch(self, self.values['wait_for_recorder'])

    def _manifest(self, text: str) -> None:
        shaping = {row.name: self.values[row.name] for row in PARAMETERS if not row.wall}
        shaping['scenario'] = self.scenario.name
        health.publish_manifest(self, 'plant', shaping, {'scenario.yaml': text})

    def _begin_run(self) -> None:
        """Wait at tick 0 of a new run."""
        make = LockstepPacing if self.values['mode'] == LOCKSTEP else FreeRunningPacing
        self.pacing: LockstepPacing | FreeRunningPacing = make(self, self.scenario, self._peers)
        self.control.release()
        self.loop = LoopHealth(self.pacing)
        self.recorder.forget()
        self._again, self._unrecorded, self._said_s = False, False, 0.0
        self._begun = self.sent_s = self.progress_s = time.monotonic()
        self.report(health.OK, 'waiting', 'waiting for peers')

    @property
    def plant(self) -> LockstepPlant | FreeRunningPlant:
        """The flight itself."""
        return self.pacing.plant

    @property
    def stepping(self) -> bool:
        """Whether single ticks were asked for."""
        return self.control.steps > 0

    @property
    def moving(self) -> bool:
        """Whether ticks may pass."""
        return self.phase == 'running' and (not self.control.paused or self.stepping)

    def _on_answer(self, topic: str, message: WrenchStamped) -> None:
        force = conversions.from_wrench(message)
        fault = conversions.fault_of(message, force)
        if fault:
            self.plant.ignore(fault)
            return
        stamp_ns = conversions.from_stamp(message.header.stamp)
        if self.plant.answer(topic, stamp_ns, force) != ACCEPTED:
            return
        if topic == names.CONTROL_FORCE:
            self.loop.commanded(self.scenario.tick_of(stamp_ns))
        self.pacing.on_answer()

    def advance(self) -> None:
        """Pass the present tick."""
        self.topics.applied(self.plant.stamp_ns, self.pacing.applied())
        if self.plant.finished:
            self._end('finished', 'reached the last tick')
            return
        self.plant.advance()
        self.progress_s = time.monotonic()
        self.send()
        self.loop.sent(self.plant.tick, self.sent_s)
        if self.control.passed():
            self.say_paused()

    def send(self) -> None:
        """Publish the present state."""
        self.sent_s = time.monotonic()
        self.topics.state(self.plant.stamp_ns, self.plant.state)

    def _look(self) -> None:
        """Wall-clock watch: starts the run, looks after the peers, leaves at the end."""
        now_s = time.monotonic()
        if self.phase == 'waiting':
            self._wait(now_s)
        elif self.phase in _ENDED:
            if self.recorder.done or now_s - self.progress_s > _LAST_WORD_S:
                self._leave()
        else:
            if self.moving:
                self.pacing.watch(now_s)
            if self.recorder.look() and not self._unrecorded:
                self._unrecorded = True
                self.get_logger().warning('the recorder is gone: flying on unrecorded')
                self.report(health.WARN, 'running', 'the recorder is gone')

    def _leave(self) -> None:
        self.done = not self._again
        if self._again:
            self._begin_run()

    def _wait(self, now_s: float) -> None:
        """Send state 0 until it is answered and a recorder is ready: then all are connected."""
        absent = [topic for topic in self._peers if not self.count_publishers(topic)]
        if not absent:
            self.send()
            self.topics.before_flight(self.scenario.stamp_ns(-1))
        awaited = self.plant.missing + ['the recorder'] * self.recorder.awaited
        if not awaited:
            self.progress_s = now_s
            self.report(health.OK, 'running', 'flying')
            self.get_logger().info(f'flying {self.scenario.name}')
            self.advance()
            self.pacing.begin()
        elif 0.0 < self.values['start_timeout_s'] < now_s - self._begun:
            self.abort(f'no answer in time from {", ".join(awaited)}')
        elif now_s - self._said_s > _SAY_S:
            self._said_s = now_s
            self.get_logger().info(f'waiting for {", ".join(awaited)}')

    def abort(self, reason: str) -> None:
        """End the run before its time, with an exit code that says so."""
        self.exit_code = EXIT_ABORTED
        self._end('aborted', reason, health.ERROR)

    def _end(self, phase: str, reason: str, level: bytes = health.OK) -> None:
        self.pacing.stop()
        self.report(level, phase, reason)
        self.progress_s = time.monotonic()
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

    def reset(self) -> None:
        """End the run and begin another at tick 0; a recorder closes the log of the first."""
        self._again = True
        self._end('aborted', 'reset', health.WARN)

    def go_on(self) -> None:
        """Go on after a pause, for good or for some ticks; the pause was nobody's silence."""
        self.progress_s = time.monotonic()
        self.pacing.begin()

    def resume(self) -> None:
        """End a pause."""
        self.report(health.OK, 'running', 'flying', resumed='true')
        self.go_on()

    def say_paused(self) -> None:
        """Say that no tick passes."""
        self.report(health.OK, 'paused', 'paused')

    def changed(self, applied: Mapping[str, Any]) -> None:
        """Take up a new speed."""
        if 'real_time_factor' in applied and self.phase == 'running':
            self.pacing.begin()

    def report(self, level: bytes, phase: str, reason: str, **more: str) -> None:
        """Publish run_status; in lockstep simulated facts only, so that two runs say the same.

        'paused' is said, but the run goes on: such a status is not part of its log.
        """
        if phase != 'paused':
            self.phase = phase
        values = {'phase': phase, **self.plant.figures(), **more}
        if phase in _ENDED and self.values['mode'] == FREE_RUNNING:
            values |= self.loop.wall_figures()
        self.topics.status(level, reason, values)

    def _health(self) -> health.Health:
        return self.loop.status('paused' if self.control.paused else self.phase, self._unrecorded)

    def interrupt(self, reason: str) -> None:
        """Say that the run was interrupted, and let the recorder close its log."""
        self._again = False
        if self.phase not in _ENDED:
            self._end('aborted', f'interrupted by {reason}', health.WARN)
            self.topics.last_words(_INTERRUPTED_S)


def main() -> int:
    """Entry point of `ros2 run rpo_sim plant`."""
    return run_node('ros2 run rpo_sim plant', PlantNode, __doc__, PARAMETERS)


if __name__ == '__main__':
    sys.exit(main())
