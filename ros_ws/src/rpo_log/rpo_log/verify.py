# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Proof that a flight happened as logged: all of it computed anew and compared, bit for bit.

From the scenario and the controller that the log carries:

- start: the first state is the scenario's;
- control law: every force follows from the recorded state, or what navigation made of it;
- disturbance: every disturbance follows from the scenario;
- dynamics: every state follows from the state, the force and the disturbance before it;
- whole run: the flight is flown again from its start, without looking at the log; not in free
  running, where the wall clock had its part: there, each force flown is one that was commanded;
- the rest: attitude, torque, covariances, frames, and the figures in run_status.

The first difference ends it. Logs of any length are verified in bounded memory.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rpo_core import cdr
from rpo_core.chain import DynamicsStage
from rpo_core.navigation import NavigationStage
from rpo_core.thrusters import ThrustersStage
from rpo_log import topics
from rpo_log.aligned_ticks import AlignedTicks, DelayLine, HeldForces, held_ticks
from rpo_log.completeness import Completeness
from rpo_log.decode import Block
from rpo_log.difference import (
    DISTURBANCE,
    DYNAMICS,
    FLOWN,
    LAW,
    NAVIGATION,
    REST,
    START,
    Difference,
    odd_difference,
)
from rpo_log.errors import ExitCode, Kind, LogError
from rpo_log.reader import controller_of, scenario_of
from rpo_log.stream import RunReader

FIGURE_TOLERANCE = 1e-9
"""Relative, for the figures in run_status: sums and norms, written as text, flown by nobody."""

_STATE_FIELDS = tuple(cdr.ODOMETRY_FIELDS[cdr.POSITION] + cdr.ODOMETRY_FIELDS[cdr.VELOCITY])
_FORCE_FIELDS = cdr.WRENCH_FIELDS[:3]


@dataclass(frozen=True)
class Verification:
    """The outcome of `verify`.

    ticks : ticks in the log
    free_running : the plant kept the wall clock: which force it flew depended on when it came
    difference : the first one; None if all that is there is as computed
    gaps : why the log does not show a whole flight; empty if it does
    """

    path: Path
    ticks: int
    difference: Difference | None
    gaps: tuple[str, ...]
    free_running: bool = False

    @property
    def exit_code(self) -> ExitCode:
        """OK, DIFFERENT, or INCOMPLETE."""
        if self.difference is not None:
            return ExitCode.DIFFERENT
        return ExitCode.INCOMPLETE if self.gaps else ExitCode.OK

    def sentence(self) -> str:
        """Return one line for people."""
        if self.difference is not None:
            return f'{self.path}: NOT as computed: {self.difference.sentence()}'
        if self.gaps:
            return f'{self.path}: as computed as far as it goes, but {"; ".join(self.gaps)}'
        said = f'{self.path}: verified, {self.ticks} ticks bit for bit'
        if self.free_running:
            said += (
                '; a free-running flight: each state follows from the force flown, and each force '
                'flown is one that had been commanded, or none. When forces came cannot be computed'
            )
        return said


class _Verifier:
    """Computes the blocks of a log anew; keeps what one hands to the next."""

    def __init__(self, reader: RunReader) -> None:
        self.scenario = scenario_of(reader)
        self.controller = controller_of(reader)
        self.topics = {topic.role: topic for topic in reader.topics}
        self.disturbed = topics.DISTURBANCE in self.topics
        for role, what, needed in (
            (topics.DISTURBANCE, 'a disturbance', not self.scenario.disturbance.is_zero),
            (topics.NAVIGATION, 'errors of navigation', self.scenario.navigation is not None),
        ):
            if needed and role not in self.topics:
                said = f'has no topic {role}, but its scenario has {what}'
                raise LogError(Kind.MISSING_TOPIC, reader.path, said)
        self.free = topics.free_running(reader.topics)
        ticks = held_ticks(reader) if self.free else 0
        self.commands = HeldForces(ticks, float(self.scenario.max_force_n))
        self.pushes = HeldForces(ticks, math.inf)
        thrusters = self.scenario.thrusters
        self.line = DelayLine(thrusters.delay_ticks if thrusters else 0)
        self.limit = float(self.scenario.max_force_n)
        self.rows: AlignedTicks | None = None
        self.spent = np.zeros((1, 2))  # before each of the rows: energy [N^2 s], saturated ticks

    def first_difference(self, block: Block) -> Difference | None:
        """Return the first difference in a block, None if there is none."""
        found: list[Difference | None] = [
            odd_difference(odd, self.scenario.stamp_ns(odd.tick)) for odd in block.odd
        ]
        if len(block.ticks):
            self.rows = rows = AlignedTicks(block, self.rows, self.disturbed, self.free)
            flown = self.line.flown(rows.ticks, rows.flown)
            self._account(flown)
            found += self._compare(rows, flown)
            found += self._held(rows) if self.free else []
        found += [self._status(tick, status) for tick, status in block.statuses]
        order = {name: index for index, name in enumerate(topics.ORDER)}
        return min(
            (d for d in found if d is not None),
            default=None,
            key=lambda d: (d.tick, order[topics.role_of(d.topic) or topics.STATUS]),
        )

    def _compare(
        self, rows: AlignedTicks, flown: NDArray[np.float64]
    ) -> Iterator[Difference | None]:
        """Compare each message with those that it follows from."""
        seen = rows.states
        if self.scenario.navigation is not None:
            (seen,) = NavigationStage(self.scenario.navigation).steps(rows.ticks, rows.states)
        laws, following = self._laws(rows.ticks, seen), self._following(rows, flown)
        times = np.array([self.scenario.time_s(int(tick)) for tick in rows.ticks])
        disturbances = self.scenario.disturbance.over(times)
        start = np.array([tuple(map(float, self.scenario.start))])
        if rows.ticks[0] == 0:
            yield self._first(
                START, topics.STATE, rows.ticks[:1], rows.states[:1], start, rows.has_state[:1]
            )
        pushed = rows.has_state & rows.has_push & np.isfinite(flown).all(axis=1)
        follows = pushed[:-1] & rows.has_state[1:] & (np.diff(rows.ticks) == 1)
        yield self._first(
            DYNAMICS, topics.STATE, rows.ticks[1:], rows.states[1:], following[:-1], follows
        )
        both = rows.has_state & rows.has_navigation
        yield self._first(NAVIGATION, topics.NAVIGATION, rows.ticks, rows.navigation, seen, both)
        yield self._first(
            LAW, topics.FORCE, rows.ticks, rows.forces, laws, rows.has_state & rows.has_force
        )
        yield self._first(
            DISTURBANCE,
            topics.DISTURBANCE,
            rows.ticks,
            rows.disturbances,
            disturbances,
            rows.has_disturbance,
        )

    def _laws(self, ticks: NDArray[np.int64], seen: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the command (n, 3) that answers each state (n, 6)."""
        laws = np.full((len(seen), 3), np.nan)
        there = np.isfinite(seen).all(axis=1)
        stage = self.controller.stage(self.scenario.dt_s)
        (laws[there],) = stage.steps(ticks[there], seen[there])
        return laws

    def _following(self, rows: AlignedTicks, flown: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the state (n, 6) after each tick, by its state and the command flown (n, 3)."""
        settings = self.scenario.thrusters
        instant = None if settings is None else replace(settings, delay_ticks=0)
        *_, thrust = ThrustersStage(instant, self.limit).steps(rows.ticks, flown)
        dynamics = DynamicsStage(self.scenario)
        return dynamics.steps(rows.ticks, rows.states, thrust, rows.pushes)[0]

    def _held(self, rows: AlignedTicks) -> Iterator[Difference | None]:
        """Compare the forces flown with those commanded not long before, as far as they are known.

        Zero is always one: the plant cuts off what is too old.
        """
        computed, known = self.commands.held(rows.ticks, rows.forces, rows.flown)
        where = known & rows.has_flown
        yield self._first(FLOWN, topics.APPLIED, rows.ticks, rows.flown, computed, where)
        if self.disturbed:
            computed, known = self.pushes.held(rows.ticks, rows.disturbances, rows.pushes)
            where = known & rows.has_push
            role = topics.APPLIED_DISTURBANCE
            yield self._first(FLOWN, role, rows.ticks, rows.pushes, computed, where)

    def _account(self, flown: NDArray[np.float64]) -> None:
        """Sum up what the thrusters were told before each row; NaN from where a force lacks."""
        applied = np.clip(flown, -self.limit, self.limit)
        known = np.isfinite(flown).all(axis=1)
        saturated = np.where(known, (applied != flown).any(axis=1), np.nan)
        each = np.column_stack([(applied**2).sum(axis=1) * self.scenario.dt_s, saturated])
        # a block begins with the last row of the one before, so its first sum is known
        self.spent = np.cumsum(np.concatenate([self.spent[-1:], each[:-1]]), axis=0)

    def _first(
        self,
        check: str,
        role: str,
        ticks: NDArray[np.int64],
        logged: NDArray[np.float64],
        computed: NDArray[np.float64],
        where: NDArray[np.bool_],
    ) -> Difference | None:
        """Return the first of `where` whose bits differ."""
        logged, computed = np.ascontiguousarray(logged), np.ascontiguousarray(computed)
        unequal = (logged.view(np.uint64) != computed.view(np.uint64)) & where[:, None]
        if not unequal.any():
            return None
        row, column = divmod(int(unequal.argmax()), unequal.shape[1])
        fields = _STATE_FIELDS if role in topics.STATES else _FORCE_FIELDS
        return Difference(
            int(ticks[row]),
            self.topics[role].name,
            fields[column],
            float(logged[row, column]),
            float(computed[row, column]),
            check,
        )

    def _status(self, tick: int, status: cdr.Status) -> Difference | None:
        """Compare the figures of a run_status with the flight."""
        name = self.topics[topics.STATUS].name
        values = dict(status.values)
        for field, computed in self._figures(tick).items():
            logged = values.get(field, repr(computed))
            if not _same_figure(logged, computed):
                return Difference(tick, name, field, logged, repr(computed), REST)
        return None

    def _figures(self, tick: int) -> dict[str, float]:
        figures: dict[str, float] = {'tick': tick, 'time_s': self.scenario.time_s(tick)}
        if self.rows is not None and tick in self.rows.ticks:
            row = int(np.searchsorted(self.rows.ticks, tick))
            if not np.isnan(self.spent[row]).any():
                figures['energy_n2s'], figures['saturated_ticks'] = self.spent[row].tolist()
            if self.free:  # what was flown is saturated already
                figures.pop('saturated_ticks', None)
            if self.rows.has_state[row]:
                state = self.rows.states[row].tolist()
                figures['distance_m'] = math.hypot(*state[:3])
                figures['speed_m_s'] = math.hypot(*state[3:])
        return figures


def _same_figure(logged: str, computed: float) -> bool:
    try:
        return math.isclose(float(logged), computed, rel_tol=FIGURE_TOLERANCE)
    except ValueError:
        return False


def verify(path: str | Path) -> Verification:
    """Compute the flight of a run folder or .mcap file anew and compare; raises LogError."""
    reader = RunReader(path)
    verifier, completeness = _Verifier(reader), Completeness(reader)
    for block in reader.blocks():
        completeness.add(block)
        difference = verifier.first_difference(block)
        if difference is not None:
            return Verification(reader.path, completeness.last + 1, difference, (), verifier.free)
    gaps = completeness.gaps(reader.damage)
    return Verification(reader.path, completeness.last + 1, None, gaps, verifier.free)
