# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Node `plant`: simulates the chaser, in lockstep with its peers or free running."""

from __future__ import annotations

import time
import uuid
from collections.abc import Mapping
from functools import partial
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.duration import Duration
from std_srvs.srv import SetBool, Trigger

from rpo_core import files
from rpo_core.chain.chain import Signals, signals_of
from rpo_core.files.validation import InputError
from rpo_core.scenario import scenario
from rpo_core.stage import Signal
from rpo_core.wire import interfaces
from rpo_core.wire.statuses import ABORTED, ENDED, FINISHED, GONE, PAUSED, RUNNING, WAITING
from rpo_ros import health, qos
from rpo_ros.heartbeat import Pulse, Timeout, Watch
from rpo_ros.plant_scenario import FREE_RUNNING, LOCKSTEP
from rpo_ros.running import FlightNode
from rpo_ros.signals import Outlet, listen, to_status
from rpo_sim.loop_health import LoopHealth
from rpo_sim.pacing import FreeRunningPacing, LockstepPacing
from rpo_sim.peers import PublisherCheck, Refusals, unfilled_roles
from rpo_sim.plant import ACCEPTED, ZERO, FreeRunningPlant, LockstepPlant, NotFiniteError, topics_of
from rpo_sim.recorder_watch import RecorderWatch

EXIT_MISSED, EXIT_ABORTED = 1, 3

_LOOK_S = 0.05
_LOG_S = 4.0
"""Between two lines of what it waits for, or of how far it is."""
_ROLES_S = 30.0
"""Wait after which it says once which roles nobody fills."""
_LAST_WORD_S = 15.0
"""Longest wait, after the end of a run, until a recorder that lives has closed its log."""
_INTERRUPTED = Duration(nanoseconds=200_000_000)
"""Longest wait until all subscribers have the last run_status."""


class PlantNode(FlightNode):
    """Publishes state k, passes tick k as its mode requires, continues with k + 1.

    phase : WAITING, RUNNING, FINISHED or ABORTED
    paused : only requested ticks pass
    steps : requested ticks that have not passed
    watch : the signs of life of the other nodes
    progress_s, sent_s : monotonic times of the last tick, of the last state sent
    """

    package = 'rpo_sim'

    def __init__(self, overrides: Mapping[str, Any] | None = None) -> None:
        super().__init__('plant', overrides)
        self.phase = WAITING
        for service in ('pause', 'step', 'reset', 'abort'):
            kind = SetBool if service == 'pause' else Trigger
            self.create_service(kind, f'~/{service}', partial(self._serve, service))
        path = files.find('scenario', self.values['scenario'])
        self.scenario = scenario.load_scenario(path)
        self.run_id = uuid.uuid4().hex
        self._peers, self._own = topics_of(self.scenario)
        self._connect()
        self._manifest(scenario.text_for_logs(files.read_text(path), self.scenario))
        self._begin_run()
        self.refuse_change(self.values)
        self.every(min(_LOOK_S, self.values['resend_after_s']), self._look)
        health.publish_health(self, self._health)

    def _connect(self) -> None:
        """Make publishers and subscriptions; in free running also of the forces that act."""
        free = self.values['mode'] == FREE_RUNNING
        applied = [interfaces.applied(name) for name in self._peers] if free else []
        self._state = Outlet(self, interfaces.RELATIVE_STATE)
        self._made = {name: Outlet(self, name) for name in (*applied, *self._own)}
        self._status = self.create_publisher(DiagnosticStatus, interfaces.RUN_STATUS, qos.LATCHED)
        self._clock_out = Outlet(self, interfaces.CLOCK) if self.values['publish_clock'] else None
        self._publisher_check = PublisherCheck(self, [*signals_of(self.scenario), *applied])
        for name in self._peers:
            listen(self, name, partial(self._on_answer, name), self._ignore, with_rider=True)
        self.watch = Watch(self, lambda: self.phase not in (WAITING, *ENDED))
        self._pulse = Pulse(self, lambda: ['plant'])
        self._refusals = Refusals(self, self.scenario)
        fitted = self.scenario.thrusters is not None and self.scenario.thrusters.table is not None
        latched = (DiagnosticStatus, interfaces.STAGE_STATUS, qos.LATCHED)
        self._switched = self.create_publisher(*latched) if fitted else None
        self.recorder = RecorderWatch(
            self, self.values['wait_for_recorder'], self.run_id, self._on_progress
        )

    def _manifest(self, text: str) -> None:
        shaping = {row.name: self.values[row.name] for row in self.rows if not row.wall}
        shaping['scenario'] = self.scenario.name
        self._latched = health.Manifest(self, 'plant', self.run_id)
        self._latched.publish(shaping, {'scenario.yaml': text})

    def _begin_run(self) -> None:
        """Wait at tick 0 of a new run."""
        make = LockstepPacing if self.values['mode'] == LOCKSTEP else FreeRunningPacing
        self.pacing: LockstepPacing | FreeRunningPacing = make(self, self.scenario, self._peers)
        self.paused, self.steps = False, 0
        self.loop = LoopHealth(self.pacing.plant, self.pacing.figures)
        self.recorder.forget()
        self._again, self._unrecorded, self._logged_s = False, False, 0.0
        self._zones_entered = 0
        self._complete = False  # whether all was there at the last look
        self._roles_said = False
        self._start_timeout: Timeout | None = None
        self.sent_s = self.progress_s = time.monotonic()
        self.report(health.OK, WAITING, 'waiting for peers')

    @property
    def plant(self) -> LockstepPlant | FreeRunningPlant:
        """The flight itself."""
        return self.pacing.plant

    @property
    def tick(self) -> int:
        """The current tick."""
        return self.plant.tick

    @property
    def waits_for_recorder(self) -> bool:
        """Whether the recorder must catch up first."""
        return self.recorder.behind(self.tick)

    def _on_progress(self) -> None:
        """Go on if the tick waited for the recorder."""
        if self.phase == RUNNING:
            self.pacing.on_answer()

    def pause(self, wanted: bool) -> None:
        """Pause a run, or go on; what it does already changes nothing."""
        if wanted == self.paused:
            return
        self.paused, self.steps = wanted, 0
        if wanted:
            self.report(health.OK, PAUSED, PAUSED)
        else:
            self.report(health.OK, RUNNING, 'flying', resumed='true')
            self.go_on()

    def step(self, ticks: int) -> None:
        """Let so many more ticks pass of a run that is paused."""
        fresh = not self.steps
        self.steps += ticks
        if fresh and ticks:
            self.go_on()

    def _serve(self, service: str, request: Any, response: Any) -> Any:
        """Answer a call at once; `run_status` reports when the request is done."""
        refusal, done, at_tick = '', '', f'at tick {self.tick}'
        if self.phase != RUNNING and (service, self.phase) != ('abort', WAITING):
            refusal = f'no run in progress: {self.phase}'
        elif service == 'pause':
            done = f'{PAUSED if request.data else RUNNING} {at_tick}'
            self.pause(request.data)
        elif service == 'reset':
            done = f'reset {at_tick}'
            self.reset()
        elif service == 'abort':
            done = f'aborted {at_tick}'
            self.abort('abort requested')
        elif self.paused:
            done = f'{self.values["step_ticks"]} ticks from tick {self.tick}'
            self.step(self.values['step_ticks'])
        else:
            refusal = 'not paused: pause first'
        response.success, response.message = not refusal, refusal or done
        return response

    @property
    def moving(self) -> bool:
        """Whether ticks may pass."""
        return self.phase == RUNNING and (not self.paused or self.steps > 0)

    def _ignore(self, reason: str) -> None:
        self.plant.ignore(reason)

    def _on_answer(self, name: str, stamp_ns: int, force: Signal) -> None:
        plant = self.pacing.plant
        if plant.answer(name, stamp_ns, force) != ACCEPTED:
            return
        if interfaces.row_of(name).carries == interfaces.COMMAND:
            self.loop.commanded(self.scenario.tick_of(stamp_ns), time.monotonic())
        self.pacing.on_answer()

    def _heed_refusals(self) -> None:
        """Abort before tick 0 when a node of this flight takes no part; later, warn."""
        for reason in self._refusals.weighed():
            if self.phase == WAITING:
                self.abort(reason)
            elif self.phase not in ENDED:
                self.complain(f'{reason}; the flight goes on')

    def advance(self) -> None:
        """Pass the current tick."""
        plant, stamp_ns = self.pacing.plant, self.plant.stamp_ns
        applied = self.pacing.applied()
        if plant.finished:
            self._publish_made(stamp_ns, {**plant.last_signals(plant.answers), **applied})
            self._end(FINISHED, '; '.join(filter(None, ('reached the last tick', plant.entered))))
            return
        try:
            plant.advance()
        except NotFiniteError as error:
            self.abort(str(error))
            return
        self.progress_s = time.monotonic()
        self.send()
        self._judge_zones()
        self._publish_made(stamp_ns, {**plant.signals, **applied} if applied else plant.signals)
        self.loop.sent(plant.tick, self.sent_s)
        if self.steps:
            self.steps -= 1
        if self.paused and not self.steps:
            self.report(health.OK, PAUSED, PAUSED)

    def _judge_zones(self) -> None:
        """Say so when the chaser has come into a keep-out zone in which it was not before."""
        plant = self.pacing.plant
        if len(plant.depths_m) > self._zones_entered:
            self._zones_entered = len(plant.depths_m)
            self.report(health.WARN, RUNNING, plant.entered)
            self.get_logger().error(f'at tick {plant.tick}: {plant.entered}')

    def send(self) -> None:
        """Publish the time of the current state on /clock, then the state: in nobody's future."""
        self.sent_s = time.monotonic()
        plant = self.pacing.plant
        if self._clock_out is not None:
            self._clock_out.publish(plant.stamp_ns, ())
        self._state.publish_of(plant.stamp_ns, plant.signals)

    def _publish_made(self, stamp_ns: int, signals: Signals) -> None:
        """Publish those of some signals that are outputs of stages and pacing."""
        for name, outlet in self._made.items():
            if name in signals:
                outlet.publish_of(stamp_ns, signals)

    def _look(self) -> None:
        """Check by wall time: start the run, check the peers, leave at the end."""
        now_s = time.monotonic()
        self._publisher_check.look()
        self._heed_refusals()
        if self.phase == WAITING:
            if not self._refusals.in_doubt:
                self._wait(now_s)
        elif self.phase in ENDED:
            if self.recorder.done or now_s - self.progress_s > _LAST_WORD_S:
                self._leave()
        else:
            if self.moving:
                self.pacing.watch(now_s)
                self._say_how_far(now_s)
            if self.recorder.lost and not self._unrecorded:
                self._unrecorded = True
                self.get_logger().warning('the recorder is gone: the run goes on, unrecorded')
                self.report(health.WARN, RUNNING, 'the recorder is gone')

    def _say_how_far(self, now_s: float) -> None:
        if now_s - self._logged_s > _LOG_S and self.phase == RUNNING:
            self._logged_s = now_s
            dt_s, duration_s = self.scenario.dt_s, self.scenario.duration_s
            self.get_logger().info(f'at {self.tick * dt_s:.1f} s of {duration_s:g} s')

    def _leave(self) -> None:
        self.done = not self._again
        if self._again:
            self._begin_run()

    def _wait(self, now_s: float) -> None:
        """Send state 0 until all peers have answered and a recorder is ready: all are connected.

        The time-out begins here, not before: other nodes of the process are made after the plant.
        """
        self._start_timeout = self._start_timeout or Timeout()
        waited_s = self._start_timeout.look()
        where = {name: self.resolve_topic_name(name) for name in self._peers}
        absent = [name for name, topic in where.items() if not self.count_publishers(topic)]
        self._latched.repeat()  # so that nodes get the scenario quickly
        if not absent:
            self.send()
            # With a stamp before the first: it connects a recorder.
            self._publish_made(self.scenario.stamp_ns(-1), dict.fromkeys(self._made, ZERO))
        awaited = self.plant.missing + ['the recorder'] * self.recorder.awaited()
        complete, self._complete = self._complete, not awaited
        out_of_time = awaited and 0.0 < self.values['start_timeout_s'] < waited_s
        if awaited and not self._roles_said and (out_of_time or waited_s > _ROLES_S):
            self._roles_said = True
            for role in unfilled_roles(self, self.scenario, self.values['wait_for_recorder']):
                self.get_logger().warning(role)
        if self.recorder.failure:
            self.abort(f'the recorder failed: {self.recorder.failure}')
        elif complete and not awaited:  # a look later: a node that refuses has said so by now
            self.progress_s = self._logged_s = now_s
            self.report(health.OK, RUNNING, 'flying')
            self.get_logger().info(f'flying {self.scenario.name}')
            self._switch()
            self.advance()
            self.pacing.begin()
        elif out_of_time:
            self.abort(f'no answer in time from {", ".join(awaited)}')
        elif awaited and now_s - self._logged_s > _LOG_S:
            self._logged_s = now_s
            self.get_logger().info(f'waiting for {", ".join(awaited)}')

    def abort(self, reason: str) -> None:
        """End the run early, with the exit code of an abort."""
        self.exit_code = EXIT_ABORTED
        self._end(ABORTED, reason, health.ERROR)

    def _end(self, phase: str, reason: str, level: bytes = health.OK) -> None:
        self.pacing.stop()
        self._publisher_check.look()  # a flight may be over before the next look
        self.report(level, phase, reason)
        self.progress_s = time.monotonic()
        if phase == ABORTED:
            text = f'aborted at tick {self.tick}: {reason}'
            log = self.get_logger()
            log.error(text) if level == health.ERROR else log.info(text)
            return
        time_s = self.plant.scenario.time_s(self.tick)
        self.get_logger().info(f'finished at {time_s:g} s: {self.plant.ending()}')
        if self.plant.entered:
            self.exit_code = EXIT_MISSED
            self.get_logger().error(f'MISSED: {self.plant.entered}')

    def close(self) -> None:
        """Say that it ends."""
        self._pulse.beat(GONE)

    def reset(self) -> None:
        """End the run and start another at tick 0; the recorder closes the log of the first."""
        self._again = True
        self._end(ABORTED, 'reset', health.WARN)

    def go_on(self) -> None:
        """Continue after a pause, for good or for some ticks; the pause times out no peer."""
        self.progress_s = time.monotonic()
        self.pacing.begin()

    def changed(self, applied: Mapping[str, Any]) -> None:
        """Change the speed, or switch a thruster."""
        if 'real_time_factor' in applied and self.phase == RUNNING:
            self.pacing.begin()
        if 'thruster' in applied and self.phase == RUNNING:
            self._switch()

    def refuse_change(self, wanted: Mapping[str, Any]) -> None:
        """Refuse to switch a thruster that is not there."""
        reason = self.plant.thrusters.refusal(wanted['thruster']) if wanted.get('thruster') else ''
        if reason:
            raise InputError(f'`thruster`: {reason}')

    def _switch(self) -> None:
        """Switch a thruster as the parameter says, from the current tick on; say so."""
        state = self.values['thruster']
        if state and self._switched is not None:
            self.plant.thrusters.take_event(self.tick, state)
            values = [('stage', 'thrusters'), ('state', state), ('tick', self.tick)]
            values.append(('reason', 'parameter `thruster`'))
            self._switched.publish(to_status(health.WARN, 'plant', state, values))

    def report(self, level: bytes, phase: str, reason: str, **more: str) -> None:
        """Publish run_status; in lockstep only simulated values, so that two runs publish the same.

        PAUSED is published, but it is no phase of the run and not part of its log.
        """
        if phase != PAUSED:
            self.phase = phase
        values = {'phase': phase, **self.plant.figures(), **more}
        if phase in ENDED and self.values['mode'] == FREE_RUNNING:
            values |= self.loop.wall_figures()
        self._status.publish(to_status(level, 'run', reason, values.items()))

    def _health(self) -> health.Health:
        phase = PAUSED if self.paused else self.phase
        doubled = self._publisher_check.doubled
        return self.loop.status(phase, self._unrecorded, ', '.join(self.watch.silent), doubled)

    def interrupt(self, reason: str) -> None:
        """Publish that the run was interrupted, and let the recorder close its log."""
        self._again = False
        if self.phase not in ENDED:
            self._end(ABORTED, f'interrupted by {reason}', health.WARN)
            self._status.wait_for_all_acked(_INTERRUPTED)


main = PlantNode.main
