# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The loop of a plant, and when a tick passes.

After all answers (lockstep), or by the wall clock (free running).
"""

from __future__ import annotations

import time
from abc import abstractmethod
from collections.abc import Mapping
from functools import partial
from typing import Any

from std_srvs.srv import SetBool, Trigger

from rpo_core.scenario.scenario import Scenario
from rpo_core.wire import interfaces
from rpo_core.wire.statuses import PAUSED, RUNNING, WAITING
from rpo_ros import health
from rpo_ros.heartbeat import Timeout, Watch
from rpo_ros.running import FlightNode
from rpo_sim.loop_health import Pace
from rpo_sim.plant import Force, FreeRunningPlant, LockstepPlant

DEFAULT_FREE_RUNNING_FACTOR = 1.0


class Loop(FlightNode):
    """The loop of a plant, as its pacing sees it, and the services of std_srvs that steer it.

    `PlantNode` has `send` for the current state, `advance` to pass the current tick, `go_on` after
    a pause, `reset` and `abort` to end the run, and `report` to publish run_status.

    tick : the current one
    waits_for_recorder : whether a tick in lockstep must wait for the recorder
    phase : WAITING, RUNNING, FINISHED or ABORTED
    paused : only requested ticks pass
    steps : requested ticks that have not passed
    watch : the signs of life of the other nodes
    progress_s, sent_s : monotonic times of the last tick, of the last state sent
    """

    watch: Watch

    def __init__(self, name: str, overrides: Mapping[str, Any] | None = None) -> None:
        super().__init__(name, overrides)
        self.phase = WAITING
        self.paused = False
        self.steps = 0
        self.progress_s = self.sent_s = time.monotonic()
        for service in ('pause', 'step', 'reset', 'abort'):
            kind = SetBool if service == 'pause' else Trigger
            self.create_service(kind, f'~/{service}', partial(self._serve, service))

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


class Pacing:
    """One way to pass the ticks of a run.

    The plant node calls `begin` at the start of the flight, after a pause, after a change of speed.
    """

    plant: LockstepPlant | FreeRunningPlant

    def __init__(self, loop: Loop, scenario: Scenario) -> None:
        self.loop = loop
        self._dt_s = scenario.dt_s
        self._timer: Any = None

    def _time(self, factor: float) -> None:
        """Call `on_pace` once a tick of wall time; never if the factor is 0."""
        self.stop()
        if factor > 0.0:
            self._timer = self.loop.every(self._dt_s / factor, self.on_pace)

    def stop(self) -> None:
        """Release the timer."""
        if self._timer is not None:
            self.loop.destroy_timer(self._timer)
            self._timer = None

    def on_answer(self) -> None:
        """React to an accepted answer; by default hold it for the end of the tick."""

    @abstractmethod
    def on_pace(self) -> None:
        """React to the end of a tick of wall time."""

    def watch(self, now_s: float) -> None:
        """Check the peers during the run; by default none can be lost."""

    def applied(self) -> dict[str, Force]:
        """Return the forces, by topic, that act in the current tick; none if all answers act."""
        return {}


class LockstepPacing(Pacing):
    """A tick passes when every peer has answered, but not faster than the pace."""

    def __init__(self, loop: Loop, scenario: Scenario, expected: list[str]) -> None:
        super().__init__(loop, scenario)
        self.plant = LockstepPlant(scenario, expected)
        self.resends = 0
        self._timeout = Timeout()
        self._overdue = False

    def begin(self) -> None:
        """Set the pace, and go on."""
        self._time(self.loop.values['real_time_factor'])
        self._timeout.broken()
        self.on_answer()

    def on_answer(self) -> None:
        """Pass the tick if all answers are in and it is time."""
        if self.plant.missing or not self.loop.moving or self.loop.waits_for_recorder:
            return
        if self._overdue or self._timer is None or self.loop.steps:
            self._pass()

    def on_pace(self) -> None:
        """Pass the tick, or note that it is overdue."""
        if self.loop.moving:
            self._overdue = bool(self.plant.missing) or self.loop.waits_for_recorder
            if not self._overdue:
                self._pass()

    def _pass(self) -> None:
        self._overdue = False
        self._timeout.broken()
        self.loop.advance()

    def watch(self, now_s: float) -> None:
        """Send the state again after a while; detect a lost peer."""
        silent_s = self._timeout.look()
        if not self.plant.missing:
            self.on_answer()  # it may have waited for the recorder
            return
        values = self.loop.values
        if min(silent_s, now_s - self.loop.progress_s) > values['peer_timeout_s']:
            self._lose_peers()
        elif now_s - self.loop.sent_s > values['resend_after_s']:
            self.resends += 1
            self.loop.send()

    def _lose_peers(self) -> None:
        lost = ', '.join(self.plant.missing)
        reason = f'no answer to tick {self.plant.tick} from {lost}'
        if self.loop.watch.silent:
            reason += f'; silent: {", ".join(self.loop.watch.silent)}'
        if self.loop.values['on_peer_timeout'] == 'abort':
            self.loop.abort(reason)
            return
        dropped = ' '.join(self.plant.drop_missing())
        self.loop.get_logger().warning(f'{reason}: coasting')
        self.loop.report(health.WARN, 'running', f'coasting without {lost}', dropped=dropped)
        self._pass()

    def figures(self) -> dict[str, Any]:
        """Return the number of states sent again."""
        return {'resends': self.resends}


class FreeRunningPacing(Pacing):
    """A tick passes by the wall clock, with the forces that are there."""

    def __init__(self, loop: Loop, scenario: Scenario, expected: list[str]) -> None:
        super().__init__(loop, scenario)
        self.plant = FreeRunningPlant(scenario, expected, loop.values['stale_after_ticks'])
        self.pace = Pace()
        self._stale: tuple[str, ...] = ()

    def begin(self) -> None:
        """Set the pace from now."""
        factor = self.loop.values['real_time_factor'] or DEFAULT_FREE_RUNNING_FACTOR
        self.pace.restart(time.monotonic_ns(), self._dt_s / factor)
        self._time(factor)

    def on_pace(self) -> None:
        """Pass the ticks that are due."""
        if not self.loop.moving:
            return
        for _ in range(self.pace.due(time.monotonic_ns())):
            self._report_stale()
            self.loop.advance()
            if not self.loop.moving:
                return

    def _report_stale(self) -> None:
        stale = self.plant.stale
        if stale == self._stale or self.plant.finished:
            return
        self._stale = stale
        tick = self.plant.tick
        if stale:
            reason = f'no force for tick {tick} from {", ".join(stale)}: zero'
            self.loop.get_logger().warning(reason, throttle_duration_sec=1.0)
            self.loop.report(health.WARN, 'running', reason)
        else:
            self.loop.get_logger().info('forces are back', throttle_duration_sec=1.0)
            self.loop.report(health.OK, 'running', f'forces are back at tick {tick}')

    def applied(self) -> dict[str, Force]:
        """Return the forces that act in the current tick."""
        return {interfaces.applied(name): self.plant.applied(name) for name in self.plant.expected}

    def figures(self) -> dict[str, Any]:
        """Return overruns, stalls, ticks with an old or no force, lateness of the ticks."""
        return {
            'overruns': self.pace.overruns,
            'stalls': self.pace.stalls,
            'held_ticks': self.plant.held_ticks,
            'stale_ticks': self.plant.stale_ticks,
            **self.pace.lateness.figures('tick_lateness'),
        }
