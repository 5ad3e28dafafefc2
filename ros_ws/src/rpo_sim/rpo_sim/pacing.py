# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""When a tick of a plant passes: after all answers (lockstep), or by the wall clock."""

from __future__ import annotations

import time
from abc import abstractmethod
from typing import Any

from rpo_core.scenario.scenario import Scenario
from rpo_core.wire import interfaces
from rpo_ros import health
from rpo_ros.heartbeat import Timeout
from rpo_sim.loop_health import Pace
from rpo_sim.plant import Force, FreeRunningPlant, LockstepPlant


class Pacing:
    """One way to pass the ticks of a run.

    The plant node calls `begin` at the start of the flight, after a pause, after a change of speed.

    loop : the node; `send` publishes the current state, `advance` passes the current tick
    """

    plant: LockstepPlant | FreeRunningPlant

    def __init__(self, loop: Any, scenario: Scenario) -> None:
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

    def __init__(self, loop: Any, scenario: Scenario, expected: list[str]) -> None:
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

    def __init__(self, loop: Any, scenario: Scenario, expected: list[str]) -> None:
        super().__init__(loop, scenario)
        self.plant = FreeRunningPlant(scenario, expected, loop.values['stale_after_ticks'])
        self.pace = Pace()
        self._stale: tuple[str, ...] = ()

    def begin(self) -> None:
        """Set the pace from now."""
        factor = self.loop.values['real_time_factor'] or 1.0
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
