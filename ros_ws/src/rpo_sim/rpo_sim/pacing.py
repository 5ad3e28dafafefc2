# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""How the plant gets from tick to tick: when all have answered, or when the wall clock says so."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Any

from rpo_core.scenario import Scenario
from rpo_ros import health, names
from rpo_ros.timeout import Timeout
from rpo_sim.free_running import FreeRunningPlant
from rpo_sim.lockstep import LockstepPlant
from rpo_sim.plant import Force
from rpo_sim.timing import Pace

if TYPE_CHECKING:
    from rclpy.timer import Timer

    from rpo_sim.plant_node import PlantNode

DEFAULT_FREE_RUNNING_FACTOR = 1.0


class Pacing(ABC):
    """One way to pass the ticks of a run.

    The node calls `begin` at the start of the flight, after a pause and when the speed has changed.
    """

    plant: LockstepPlant | FreeRunningPlant

    def __init__(self, node: PlantNode) -> None:
        self.node = node
        self._timer: Timer | None = None

    def _time(self, factor: float) -> None:
        """Call `on_pace` once a tick of wall time; never if the factor is 0."""
        self.stop()
        if factor > 0.0:
            self._timer = self.node.every(self.node.scenario.dt_s / factor, self.on_pace)

    def stop(self) -> None:
        """Release the timer."""
        if self._timer is not None:
            self.node.destroy_timer(self._timer)
            self._timer = None

    @abstractmethod
    def begin(self) -> None:
        """Set the pace, and go on."""

    @abstractmethod
    def on_answer(self) -> None:
        """React to an answer that was accepted while the run flies."""

    @abstractmethod
    def on_pace(self) -> None:
        """React to the end of a tick of wall time."""

    @abstractmethod
    def watch(self, now_s: float) -> None:
        """Look after the peers while the run flies."""

    @abstractmethod
    def applied(self) -> dict[str, Force]:
        """Return the forces, by topic, that act in the present tick, if that needs to be said."""

    @abstractmethod
    def figures(self) -> dict[str, Any]:
        """Return counts of the loop that depend on the wall clock."""


class LockstepPacing(Pacing):
    """A tick passes when every peer has answered, and not before the pace allows."""

    def __init__(self, node: PlantNode, flown: Scenario, expected: list[str]) -> None:
        super().__init__(node)
        self.plant = LockstepPlant(flown, expected)
        self.resends = 0
        self._timeout = Timeout()
        self._overdue = False

    def begin(self) -> None:
        """Set the pace, and go on."""
        self._time(self.node.values['real_time_factor'])
        self._timeout.broken()
        self.on_answer()

    def on_answer(self) -> None:
        """Pass the tick if all answers are in and it is time."""
        if self.plant.missing or not self.node.moving:
            return
        if self._overdue or self._timer is None or self.node.stepping:
            self._pass()

    def on_pace(self) -> None:
        """Pass the tick, or note that it is overdue."""
        if self.node.moving:
            self._overdue = bool(self.plant.missing)
            if not self._overdue:
                self._pass()

    def _pass(self) -> None:
        self._overdue = False
        self._timeout.broken()
        self.node.advance()

    def watch(self, now_s: float) -> None:
        """Send the state again; notice a lost peer."""
        silent_s = self._timeout.look()
        if not self.plant.missing:
            return
        values = self.node.values
        if min(silent_s, now_s - self.node.progress_s) > values['peer_timeout_s']:
            self._lose_peers()
        elif now_s - self.node.sent_s > values['resend_after_s']:
            self.resends += 1
            self.node.send()

    def _lose_peers(self) -> None:
        lost = ', '.join(self.plant.missing)
        said = f'no answer to tick {self.plant.tick} from {lost}'
        if self.node.values['on_peer_timeout'] == 'abort':
            self.node.abort(said)
            return
        self.plant.drop_missing()
        self.node.get_logger().warning(f'{said}: coasting')
        self.node.report(health.WARN, 'running', f'coasting without {lost}')
        self._pass()

    def applied(self) -> dict[str, Force]:
        """Return nothing: the answers say it."""
        return {}

    def figures(self) -> dict[str, Any]:
        """Return the number of states sent again."""
        return {'resends': self.resends}


class FreeRunningPacing(Pacing):
    """A tick passes when the wall clock says so, with the forces that are there."""

    def __init__(self, node: PlantNode, flown: Scenario, expected: list[str]) -> None:
        super().__init__(node)
        self.plant = FreeRunningPlant(flown, expected, node.values['stale_after_ticks'])
        self.pace = Pace()
        self._stale: tuple[str, ...] = ()

    def begin(self) -> None:
        """Set the pace from now."""
        factor = self.node.values['real_time_factor'] or DEFAULT_FREE_RUNNING_FACTOR
        self.pace.restart(time.monotonic_ns(), self.node.scenario.dt_s / factor)
        self._time(factor)

    def on_answer(self) -> None:
        """Do nothing: the force is held for the end of the tick."""

    def on_pace(self) -> None:
        """Pass the ticks that are due."""
        if not self.node.moving:
            return
        for _ in range(self.pace.due(time.monotonic_ns())):
            self._say_stale()
            self.node.advance()
            if not self.node.moving:
                return

    def _say_stale(self) -> None:
        stale = self.plant.stale
        if stale == self._stale or self.plant.finished:
            return
        self._stale = stale
        tick = self.plant.tick
        if stale:
            said = f'no force for tick {tick} from {", ".join(stale)}: zero'
            self.node.get_logger().warning(said, throttle_duration_sec=1.0)
            self.node.report(health.WARN, 'running', said)
        else:
            self.node.get_logger().info('forces are back', throttle_duration_sec=1.0)
            self.node.report(health.OK, 'running', f'forces are back at tick {tick}')

    def watch(self, now_s: float) -> None:
        """Do nothing: a silent peer is a stale force."""

    def applied(self) -> dict[str, Force]:
        """Return what is flown in the present tick."""
        forces = {names.APPLIED_FORCE: self.plant.applied(names.CONTROL_FORCE)}
        if names.DISTURBANCE_FORCE in self.plant.expected:
            disturbance = self.plant.applied(names.DISTURBANCE_FORCE)
            forces[names.APPLIED_DISTURBANCE] = disturbance
        return forces

    def figures(self) -> dict[str, Any]:
        """Return overruns, stalls, ticks flown with old or no force, lateness of the ticks."""
        return {
            'overruns': self.pace.overruns,
            'stalls': self.pace.stalls,
            'held_ticks': self.plant.held_ticks,
            'stale_ticks': self.plant.stale_ticks,
            **self.pace.lateness.figures('tick_lateness'),
        }
