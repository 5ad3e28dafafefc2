# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The tick of many flights side by side: kernels one after the other, in the order of their places.

A flight is made of parts. A part has a table of numbers that stay, a memory, and one or more
kernels, each with its place in the tick. A kernel `(w, m, t, tick)` reads and writes rows of the
scratch w (`rpo.engine.lanes`), its memory m and its table t, all flat arrays of floats.
So each kernel is compiled once, by itself, whatever it flies with; `_fly` calls it by its address.

What a section of a scenario adds to the tick is registered (`register`), by one module of
`rpo.engine.parts` each, or by a module of the user.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rpo.engine.calls import Call, call, rows_of
from rpo.engine.lanes import (
    BODY_R,
    BODY_V,
    PAIRED_LANES,
    ROWS,
    RUNS,
    SEEN_R,
    SEEN_V,
    STRIDE,
    R,
    V,
    compiled,
)
from rpo_core.kernels.arithmetic import State
from rpo_core.kernels.arrays import Floats
from rpo_core.kernels.vectors import aligned
from rpo_core.scenario.scenario import Scenario
from rpo_core.stage import Place

# Places in a tick, beside those of the chain.
ADDED = Place.CONTROLLER + 1
"""What is added to the command of a controller."""
COMMANDED = Place.CONTROLLER + 3
"""The command is whole."""
PASSED = Place.ASSURANCE + 1
"""The command has passed runtime assurance. The last tick of a flight ends here."""
LIMITED = Place.THRUSTERS - 2
"""The command that the thrusters take: saturated, delayed."""
COUNTED = Place.THRUSTERS - 1
SHIFTED = Place.DYNAMICS + 1
"""The state is moved by what turning adds to the force."""
MOVED = Place.DYNAMICS + 2
"""The state is that of the next tick."""


class Part(NamedTuple):
    """What a stage adds to the tick.

    name : by which `fly` returns its memory
    steps : places, each with its kernel
    table : numbers that no kernel changes; threads share them
    memory : numbers that kernels may change, as they are before tick 0
    """

    name: str
    steps: tuple[tuple[int, Any], ...]
    table: Floats
    memory: Floats = np.zeros(0)

    def __reduce__(self) -> tuple[Any, ...]:
        """Kernels go to other processes by their names: a copy would be compiled anew."""
        names = [(place, kernel.__module__, kernel.__name__) for place, kernel in self.steps]
        return _part, (self.name, names, self.table, self.memory)


def _part(name: str, names: list[tuple[int, str, str]], table: Floats, memory: Floats) -> Part:
    steps = ((place, getattr(import_module(module), name)) for place, module, name in names)
    return Part(name, tuple(steps), table, memory)


class Runs(NamedTuple):
    """Runs that fly side by side.

    planar : (P, 4) starts x, y, vx, vy [m, m/s]; vertical : (Q, 2) starts z, vz
    parts : all but the controller
    """

    planar: Floats
    vertical: Floats
    parts: tuple[Part, ...] = ()

    @property
    def lanes(self) -> int:
        """Lanes that they take."""
        return 2 * len(self.planar) + len(self.vertical)

    @property
    def judged_rows(self) -> tuple[int, int]:
        """Rows with the positions and velocities that are judged: as a turning target sees them."""
        turning = any(part.name == 'target' for part in self.parts)
        return (BODY_R, BODY_V) if turning else (R, V)

    @property
    def is_seen(self) -> bool:
        """Whether the controller reads rows SEEN; otherwise the true state."""
        places = [place for part in self.parts for place, _ in part.steps]
        return any(Place.SENSOR <= place < Place.CONTROLLER for place in places)


def table_of(*values: Any) -> Floats:
    """Return numbers and arrays one after the other, flat."""
    return np.concatenate([np.ravel(np.asarray(value, np.float64)) for value in values])


@compiled
def _fly(rows, last, ticks, w):  # type: ignore[no-untyped-def]
    """Pass all ticks; of the last one, the first `last` rows."""
    for tick in range(ticks + 1):
        for i in range(last if tick == ticks else len(rows)):
            call(rows[i], w, tick)


def place(w: Floats, runs: Runs) -> None:
    """Put runs at their starts in an empty scratch."""
    p = len(runs.planar)
    w[:] = 0.0
    for row, column in ((R, 0), (R + p, 1), (V, 2), (V + p, 3)):
        w[row : row + p] = runs.planar[:, column]
    for row, column in ((R, 0), (V, 1)):
        w[row + 2 * p : row + 2 * p + len(runs.vertical)] = runs.vertical[:, column]


def fresh(parts: Sequence[Part]) -> list[Part]:
    """Return parts with memories of their own, as they are before tick 0."""
    return [part._replace(memory=aligned(part.memory)) for part in parts]


def steps_of(parts: Sequence[Part]) -> list[tuple[int, Call]]:
    """Return the kernels of a tick in their order: place, and what `rows_of` takes."""
    steps = [
        (place, (kernel, part.memory, part.table)) for part in parts for place, kernel in part.steps
    ]
    return sorted(steps, key=lambda step: step[0])


def fly(runs: Runs, more: Sequence[Part], ticks: int, w: Floats) -> dict[str, Floats]:
    """Fly runs through so many ticks; return name of part -> its memory after the flight.

    more : parts whose memory is written itself; of those of `runs`, copies are
    w : scratch (`lanes.make_scratch`)
    """
    place(w, runs)
    parts = [*fresh(runs.parts), *more]
    steps = steps_of(parts)
    rows = rows_of([step for _, step in steps])
    _fly(rows, sum(place <= PASSED for place, _ in steps), ticks, w)
    return {part.name: part.memory for part in parts}


@dataclass(frozen=True)
class Batch:
    """Up to 40 runs that fly side by side, as parts are made of them.

    base : the scenario of which they are variations
    starts : (n, 6); drawn : name -> (n,), nothing where runs differ in their start alone
    keys : (n, 2) of random numbers
    dispersed : name -> spread of all that is dispersed
    faults : of messages (`parts.link.Fates`); None: none
    make : returns the scenarios of the runs
    parts : those that are made so far
    """

    base: Scenario
    starts: Floats
    make: Callable[[], list[Scenario]]
    drawn: Mapping[str, Floats]
    keys: NDArray[np.int64]
    dispersed: Mapping[str, tuple[float, ...]]
    faults: Any = None
    parts: list[Part] = field(default_factory=list)

    def columns(self, *names: str) -> Floats:
        """Return what was drawn (names, 40); 0 where nothing was, and in lanes without a run."""
        found = np.zeros((len(names), RUNS))
        for row, name in zip(found, names, strict=True):
            row[: len(self.starts)] = self.drawn.get(name, 0.0)
        return found

    @property
    def key_rows(self) -> Floats:
        """Keys (2, 40); 0 in lanes without a run."""
        found = np.zeros((2, RUNS))
        found[:, : len(self.keys)] = self.keys.T
        return found

    @cached_property
    def scenarios(self) -> list[Scenario]:
        """Every run as a scenario."""
        return self.make()

    @cached_property
    def seen(self) -> list[State]:
        """First state (6,) that guidance and assurance of each run see."""
        w = np.zeros(ROWS * STRIDE)
        for row, columns in ((R, slice(3)), (V, slice(3, 6))):
            w[row : row + PAIRED_LANES].reshape(3, RUNS)[:, : len(self.starts)] = self.starts.T[
                columns
            ]
        w[SEEN_R : SEEN_R + PAIRED_LANES] = w[R : R + PAIRED_LANES]
        w[SEEN_V : SEEN_V + PAIRED_LANES] = w[V : V + PAIRED_LANES]
        for place, (kernel, memory, table) in steps_of(fresh(self.parts)):
            if place < Place.GUIDANCE:
                kernel(w, memory, table, 0)
        lanes = [[row + RUNS * axis for row in (SEEN_R, SEEN_V) for axis in range(3)]]
        states = w[np.arange(len(self.starts))[:, None] + lanes]
        return [tuple(state) for state in states.tolist()]

    def lanes(self, values: Sequence[Any]) -> Floats:
        """Return tables with 40 lanes as their last axis; lanes without a run are the first's."""
        given = [np.asarray(value, np.float64) for value in values]
        return np.stack([*given, *([given[0]] * (RUNS - len(given)))], axis=-1)


class Kind(NamedTuple):
    """How the engine flies a section of scenarios, or something else that all flights have.

    section : its name; '' if it is none
    make : from a batch to its part; None where it has none
    refuse : why it cannot fly a scenario; '' if it can
    sees : whether `make` reads `Batch.seen`, and comes after the others
    """

    section: str
    make: Callable[[Batch], Part | None]
    refuse: Callable[[Scenario], str] = lambda scenario: ''
    sees: bool = False


def parts_of(batch: Batch, kinds: Sequence[Kind]) -> tuple[Part, ...]:
    """Return the parts of a batch."""
    for kind in sorted(kinds, key=lambda kind: kind.sees):
        part = kind.make(batch)
        if part is not None:
            batch.parts.append(part)
    return tuple(batch.parts)


KINDS: list[Kind] = []
"""All that is registered."""


def register(kind: Kind) -> None:
    """Let campaigns fly a section side by side."""
    KINDS.append(kind)
