# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The plant without ROS: integer ticks, exact steps, and which answers it takes in each mode."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from rpo_core.chain.chain import Chain, Signals, start_of
from rpo_core.judge import metrics
from rpo_core.judge.contact import caught_at
from rpo_core.kernels import arithmetic
from rpo_core.kernels.arithmetic import norm
from rpo_core.scenario.scenario import Scenario
from rpo_core.stage import Place, Signal
from rpo_core.wire import interfaces
from rpo_core.world.zones import zones_of

Force = tuple[float, ...]
"""Force [N], target LVLH; in the axes of a chaser that turns, then with the torque [N m]."""

ZERO: Force = (0.0, 0.0, 0.0)

ACCEPTED = 'accepted'
LATE, EARLY, REPEATED = 'late', 'early', 'repeated'
FOREIGN, DROPPED = 'foreign_stamp', 'dropped_peer'
"""Why an answer is ignored: it is for a past tick, a future tick, an answered tick; its stamp is of
no tick; the run goes on without its peer."""


class NotFiniteError(ArithmeticError):
    """A step made a state that is not finite; the message says from which signal."""


PLACES = (
    Place.UNLOADING,
    Place.LINK,
    Place.THRUSTERS,
    Place.TARGET,
    Place.ATTITUDE,
    Place.DYNAMICS,
)
"""Stages that the plant runs."""


def topics_of(scenario: Scenario) -> tuple[list[str], list[str]]:
    """Return the inputs and the output topics of a plant, without the true state."""
    chain = Chain.of(scenario).part(*PLACES)
    inputs, outputs = (
        [n for n in names if n not in interfaces.NEXT and interfaces.row_of(n).type]
        for names in (chain.inputs, chain.outputs)
    )
    return inputs, outputs


class Plant:
    """The chaser at an integer tick, its energy so far, and the ignored answers.

    scenario : of the run
    expected : topics of the answers to each state
    chain : the stages that the plant runs
    stamp_ns : stamp of the current state
    """

    def __init__(self, scenario: Scenario, expected: Sequence[str]) -> None:
        self.scenario = scenario
        self.expected = tuple(expected)
        self.tick = 0
        self._squares = [0.0, 0.0, 0.0]  # of the saturated commands, per axis [N^2]
        self.saturated_ticks = 0
        self.ignored: Counter[str] = Counter()
        self.chain = Chain.of(scenario).part(*PLACES)
        self.chain.reset()
        self.inputs = tuple(name for name in self.chain.inputs if name not in interfaces.NEXT)
        self._parts = []  # of each input the topic that carries it, and the place of its numbers
        for name in self.inputs:
            topic = interfaces.row_of(name).rides
            first = len(interfaces.row_of(topic).columns) if topic else 0
            self._parts.append((name, topic or name, first))
        self.signals: Signals = start_of(scenario)
        self.stamp_ns = scenario.stamp_ns(0)
        self._zones = [zones for zones in zones_of(scenario) if zones.keep_out_m]
        self._depths_m: dict[str, float] = {}
        self._docked, most_m = False, getattr(scenario.requirements, 'contact_range_m', None)
        port_m = norm(*scenario.goal_position_m) + (most_m or 0.0)
        self._near_m = max([port_m, *(zones.keep_out_m for zones in self._zones)])
        self._unseen: list[tuple[int, tuple[Signal, ...]]] = [(0, (self.state,))]

    @property
    def state(self) -> Signal:
        """True state (x, y, z, vx, vy, vz) [m, m/s], target LVLH."""
        return self.signals[interfaces.RELATIVE_STATE]

    @property
    def openings(self) -> int | None:
        """How often a valve has opened; None where thrusters do not fire in pulses."""
        fires = getattr(self.scenario.thrusters, 'fires', False)
        return self.thrusters.spent()[2] if fires else None

    @property
    def thrusters(self) -> Any:
        """The stage of the thrusters."""
        return next(link.stage for link in self.chain.links if link.place is Place.THRUSTERS)

    def ignore(self, kind: str) -> str:
        """Count an ignored answer; return its kind."""
        self.ignored[kind] += 1
        return kind

    def fly(self, answers: Mapping[str, Force]) -> None:
        """Step to the next tick with the answers by topic; a missing answer is zero force.

        Raises NotFiniteError, and stays at its tick, if the next state is not finite.
        """
        signals = self.signals
        truth = {name: signals[name] for name in interfaces.NEXT if name in signals}
        before = signals[interfaces.RELATIVE_STATE]
        self._take(signals, answers)
        self.chain.step(self.tick, signals)
        # With its norms: 1e300 m is finite, but no controller can answer it.
        state = signals[interfaces.RELATIVE_STATE]
        turned = sum(signals.get(interfaces.CHASER_ATTITUDE, ()))
        if not math.isfinite(norm(*state[:3]) + norm(*state[3:]) + turned):
            signals.update(truth)
            raise NotFiniteError(self._why_not_finite(signals))
        x, y, z = signals[interfaces.SATURATED_FORCE]
        self.saturated_ticks += signals[interfaces.SATURATED_FORCE] != signals[interfaces.DUE_FORCE]
        self._squares = [
            metrics.with_square(total, force)
            for total, force in zip(self._squares, (x, y, z), strict=True)
        ]
        self.tick += 1
        self.stamp_ns = self.scenario.stamp_ns(self.tick)
        self._unseen.append((self.tick - 1, (before, state)))

    def _take(self, signals: Signals, answers: Mapping[str, Force]) -> None:
        """Put the answers, by topic, among the signals; what did not come is zero."""
        for name, topic, first in self._parts:
            signals[name] = answers.get(topic, ())[first : first + 3] or ZERO

    @property
    def depths_m(self) -> dict[str, float]:
        """Zone -> how deep the chaser has been in it so far, before it docked, if it was.

        It is computed when it is read: the state is sent by then, and no node waits for it.
        """
        for first, states in self._unseen:
            self._look_for_zones(first, states)
        self._unseen.clear()
        return self._depths_m

    def _look_for_zones(self, tick: int, states: tuple[Signal, ...]) -> None:
        """Look how deep in a zone a chaser is in states from a tick on; not once docked."""
        if self._docked or not self._zones:
            return
        # Most states are too far to look closely, also as a target sees them that turns 0.1 rad.
        first, last = states[0], states[-1]
        moved_m = 2.0 * math.dist(first[:3], last[:3])
        moved_m += (norm(*first[3:]) + norm(*last[3:])) * self.scenario.dt_s
        sure_m = 0.7 * min(norm(*first[:3]), norm(*last[:3])) - moved_m
        if sure_m > self._near_m:
            return
        seen = self.scenario.seen(np.array(states), tick)
        errors, required = seen[-1:] - self.scenario.goal_state, self.scenario.requirements
        self._docked = caught_at(errors, required, self.scenario.goal_position_m) is not None
        for zones in self._zones:
            depth_m = zones.deepest_m(seen, self.scenario.dt_s)
            if depth_m > self._depths_m.get(zones.keep_out, 0.0):
                self._depths_m[zones.keep_out] = depth_m

    @property
    def entered(self) -> str:
        """Which keep-out zones the chaser has been in so far, and how deep; '' if in none."""
        return ', '.join(f'{depth:.3g} m inside {zone}' for zone, depth in self.depths_m.items())

    def _why_not_finite(self, signals: Signals) -> str:
        """Return in one sentence which signal is largest in the step to the next tick."""
        names = (interfaces.RELATIVE_STATE, *self.inputs)
        cause = max(names, key=lambda name: max(map(abs, signals[name])))
        numbers = ', '.join(f'{value:g}' for value in signals[cause])
        return (
            f'the state of tick {self.tick + 1} would not be finite, because of {cause} '
            f'({numbers}) at tick {self.tick}'
        )

    def last_signals(self, answers: Mapping[str, Force]) -> Signals:
        """Return the signals of the last tick, whose answers change no state."""
        signals = dict(self.signals)
        self._take(signals, answers)
        self.chain.step(self.tick, signals)
        return signals

    def ending(self) -> str:
        """Return how far from the goal, how fast and with which energy the run ends so far."""
        seen = self.scenario.seen(np.array([self.state]), self.tick)[0]
        error = self.scenario.from_goal(seen.tolist())
        where = 'target' if self.scenario.goal is None else 'goal'
        return (
            f'{norm(*error[:3]):.3g} m from the {where} and '
            f'{norm(*error[3:]):.3g} m/s (norms), J = {self.figures()["energy_n2s"]:.4g} N²s'
        )

    def figures(self) -> dict[str, float | int]:
        """Return the metrics of the run so far, simulated values."""
        return metrics.run_figures(
            self.scenario, self.tick, self.state, self._squares, self.saturated_ticks
        )


class LockstepPlant(Plant):
    """The plant in lockstep: state k waits for the answers with stamp k, then steps.

    answers : those to the current state, by topic
    """

    def __init__(self, scenario: Scenario, expected: Sequence[str]) -> None:
        super().__init__(scenario, expected)
        self.answers: dict[str, Force] = {}

    @property
    def missing(self) -> list[str]:
        """The missing answers to the current state."""
        return [name for name in self.expected if name not in self.answers]

    @property
    def finished(self) -> bool:
        """Whether the last state has been reached and answered."""
        return self.tick == self.scenario.ticks and not self.missing

    def answer(self, name: str, stamp_ns: int, force_n: Force) -> str:
        """Take an answer; return ACCEPTED or why it is ignored (counted in `ignored`).

        The force must be finite; `signals.listen` checks it.
        """
        if name not in self.expected:
            return self.ignore(DROPPED)
        if stamp_ns == self.stamp_ns:
            if name in self.answers:
                return self.ignore(REPEATED)
            self.answers[name] = force_n
            return ACCEPTED
        tick = self.scenario.tick_of(stamp_ns)
        return self.ignore(FOREIGN if tick is None else LATE if tick < self.tick else EARLY)

    def drop_missing(self) -> list[str]:
        """Go on without the missing peers, whose force is zero from now on; return them."""
        dropped = self.missing
        self.expected = tuple(name for name in self.expected if name not in dropped)
        return dropped

    def advance(self) -> None:
        """Step to the next tick; all answers must be there and the run not finished."""
        self.fly(self.answers)
        self.answers = {}


class FreeRunningPlant(Plant):
    """The plant in free running: it waits for no peer, and holds the newest force of each.

    A tick ends when the next one is due. Its force is the newest that has come by then: the answer
    to its own state, of age 0, or an older one. So a lost or late answer counts in whole ticks, a
    latency within the tick changes nothing, and without faults the flight equals that of lockstep.

    stale_after_ticks : an older force counts as zero
    """

    def __init__(self, scenario: Scenario, expected: Sequence[str], stale_after_ticks: int) -> None:
        super().__init__(scenario, expected)
        self.stale_after_ticks = stale_after_ticks
        self.held_ticks = 0
        self.stale_ticks = 0
        self._held: dict[str, tuple[int, Force]] = {}

    @property
    def missing(self) -> list[str]:
        """The peers that have never answered."""
        return [name for name in self.expected if name not in self._held]

    @property
    def finished(self) -> bool:
        """Whether the last state has been reached."""
        return self.tick == self.scenario.ticks

    def answer(self, name: str, stamp_ns: int, force_n: Force) -> str:
        """Take an answer; return ACCEPTED or why it is ignored (counted in `ignored`).

        Only an answer to a newer state replaces the one before. The force must be finite.
        """
        tick = self.scenario.tick_of(stamp_ns)
        if tick is None:
            return self.ignore(FOREIGN)
        if tick > self.tick:
            return self.ignore(EARLY)
        newest = self._held[name][0] if name in self._held else -1
        if tick <= newest:
            return self.ignore(REPEATED if tick == newest else LATE)
        self._held[name] = (tick, force_n)
        return ACCEPTED

    @property
    def stale(self) -> tuple[str, ...]:
        """The peers whose force is too old to act."""
        return tuple(name for name in self.expected if self._is_stale(name))

    def _is_stale(self, name: str) -> bool:
        return name not in self._held or self.tick - self._held[name][0] > self.stale_after_ticks

    def applied(self, name: str) -> Force:
        """Return the force of a peer that acts in the current tick, and the torque in it if any."""
        row = interfaces.row_of(name)
        if name not in self.expected or self._is_stale(name):
            return ZERO + ZERO if row.rider else ZERO
        force = self._held[name][1]
        if row.carries != interfaces.COMMAND:
            return force
        limit_n = float(self.scenario.max_force_n)
        return (*(arithmetic.saturate(component, limit_n) for component in force[:3]), *force[3:])

    def advance(self) -> None:
        """Step to the next tick with the forces held; the run must not be finished."""
        self.stale_ticks += bool(self.stale)
        self.held_ticks += any(self.tick > tick for tick, _ in self._held.values())
        self.fly(self.answers)

    @property
    def answers(self) -> dict[str, Force]:
        """The forces held, by topic, without the stale ones."""
        return {name: self._held[name][1] for name in self.expected if not self._is_stale(name)}
