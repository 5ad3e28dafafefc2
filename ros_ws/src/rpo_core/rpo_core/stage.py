# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A stage of a flight, the places of the chain, and the stages that a scenario file may name.

A stage is a function of its inputs so far: deterministic, with memory if it needs any, without ROS.
Randomness is a function of (tick, key). `rpo_core.chain.chain` puts stages in a row and flies them.

A section of a scenario file adds a stage. To add a section, write a class and one line (`register`)
in a module of your own (`rpo_core.plugins`).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property
from itertools import accumulate, chain, pairwise
from typing import Any, TypeGuard

import numpy as np
from numpy.typing import NDArray

from rpo_core import plugins
from rpo_core.files.validation import InputError
from rpo_core.kernels import calls
from rpo_core.kernels.jit import COMPILED, as_table
from rpo_core.kernels.records import NOTHING, begin_again, copied, move_together, prepared
from rpo_core.wire.interfaces import (
    ATTITUDE,
    COMMAND,
    DISTURBANCE,
    PREVIOUS_COMMAND,
    STATE,
    THRUST,
    row_of,
    rows_so_far,
)

Signal = tuple[float, ...]
"""The numbers of a signal at one tick; `rpo_core.wire.interfaces` says which."""

_CARRIED = (STATE, COMMAND, THRUST, DISTURBANCE, ATTITUDE, PREVIOUS_COMMAND)

ZERO = (0.0, 0.0, 0.0)
"""No force."""

WITHOUT_COMMAND = 'without_command'
"""What a stage gets (`take_event`), and `stage_status` says, of a tick at which an input did not
come in time; it took zero for it."""


class Place(IntEnum):
    """Where in the chain a stage stands; stages of one place follow in the order of the file."""

    ATTITUDE_SENSOR = 4
    ATTITUDE_ESTIMATOR = 6
    SENSOR = 10
    ESTIMATOR = 20
    GUIDANCE = 30
    POINTING = 35
    CONTROLLER = 40
    SHAPING = 45
    ASSURANCE = 50
    DISTURBANCE = 60
    STEERING = 64
    UNLOADING = 66
    LINK = 70
    THRUSTERS = 80
    TARGET = 85
    ATTITUDE = 88
    DYNAMICS = 90


def width_of(name: str) -> int:
    """Return how many numbers a signal has, or those that carry what is named."""
    if name in _CARRIED:
        carried = COMMAND if name == PREVIOUS_COMMAND else name
        name = next(row.name for row in rows_so_far() if row.carries == carried)
    row = row_of(name)
    return len(row.columns) or row.numbers


def places_of(names: Iterable[str]) -> list[slice]:
    """Return where each signal stands of some that follow each other."""
    return [slice(i, j) for i, j in pairwise(accumulate(map(width_of, names), initial=0))]


class Stage:
    """One stage of a flight.

    name : as verify, nodes and pages name it
    inputs : names of signals, or what a signal carries (STATE, COMMAND, THRUST, DISTURBANCE,
        ATTITUDE of `rpo_core.wire.interfaces`): then the last signal before this stage that carries
        it; or PREVIOUS_COMMAND
    outputs : names of signals, each a row of `rpo_core.wire.interfaces`
    may_miss : those of `inputs` without which it goes on; see `goes_without`
    decides : states that `stage_status` says of its decisions; see `decided`
    memory_ticks : how many earlier ticks the outputs depend on; None: all
    counts_ticks : whether the outputs depend on the number of the tick
    """

    name: str = ''
    inputs: tuple[str, ...] = ()
    outputs: tuple[str, ...] = ()
    may_miss: tuple[str, ...] = ()
    decides: tuple[str, ...] = ()
    memory_ticks: int | None = 0
    counts_ticks: bool = True

    def reset(self) -> None:
        """Forget all earlier ticks: a flight begins."""

    def take_unread(self, signals: Collection[str]) -> None:
        """Learn what nobody reads or keeps of the signals of a flight: it need not be computed."""

    def take_event(self, tick: int, state: str) -> None:
        """Take a state of the stage that a log tells of, from a tick on (`stage_status`)."""

    def goes_without(self, tick: int) -> bool:
        """Return whether it steps at a tick without what it may miss; it gets zeros for that."""
        return False

    def decided(self) -> list[tuple[int, str]]:
        """Return what `stage_status` says of its decisions so far: tick and state of each."""
        return []

    def step(self, tick: int, *inputs: Signal) -> tuple[Signal, ...]:
        """Return the outputs of a tick; ticks come in order, but some may be missing."""
        raise NotImplementedError

    def passes_on(self) -> tuple[int | Signal, ...]:
        """Return what each output is while the stage is switched off.

        The place of the input whose numbers it then has, or its numbers; zeros where they end. By
        default it is the input that carries the same, and zero without one.
        """
        carried = [name if name in _CARRIED else row_of(name).carries for name in self.inputs]
        made = [row_of(name).carries for name in self.outputs]
        return tuple(carried.index(c) if c and c in carried else () for c in made)

    def off(self, *inputs: Signal) -> tuple[Signal, ...]:
        """Return the outputs of a tick as if the stage were not in the chain."""
        outputs = []
        for name, source in zip(self.outputs, self.passes_on(), strict=True):
            width = width_of(name)
            values = inputs[source] if isinstance(source, int) else source
            outputs.append((*values[:width], *(0.0,) * (width - len(values))))
        return tuple(outputs)

    def spent(self) -> tuple[float, float, int] | None:
        """Return delta-v [m/s], propellant [kg], openings of valves so far; None: not counted."""
        return None

    def trouble(self) -> str:
        """Return what is wrong with it now, for /diagnostics; '' if nothing is."""
        return ''

    def steps(
        self, ticks: NDArray[np.int64], *inputs: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], ...]:
        """Return the outputs (n, width) of ticks (n,) one after the other; the same bits.

        A stage without memory may do it faster than tick by tick.
        """
        rows = zip(*(values.tolist() for values in inputs), strict=True) if inputs else ()
        every = rows if inputs else ((),) * len(ticks)
        made = [self.step(t, *map(tuple, r)) for t, r in zip(ticks.tolist(), every, strict=True)]
        return tuple(
            np.array([outputs[i] for outputs in made], dtype=np.float64).reshape(len(ticks), -1)
            for i in range(len(self.outputs))
        )


class KernelStage(Stage):
    """A stage whose tick is a kernel, `step(tick, u, p, m, y)` (`rpo_core.kernels.calls`).

    kernel : of the class; inputs and outputs follow each other in u and y
    p, m : settings and memory, as kernels of this process read them
    """

    kernel: Any

    def __init__(self, p: Any, m0: Any = NOTHING) -> None:
        self._m0 = m0
        self.p: Any = prepared(p)
        self.m: Any = prepared(m0) if COMPILED else copied(m0)
        self._row: tuple[Any, Any, Any] | None = None

    def reset(self) -> None:
        """Forget all earlier ticks: the memory is that before tick 0."""
        begin_again(self.m, self._m0)

    def __getstate__(self) -> dict[str, Any]:
        """Return what a copy is made of; it has a memory of its own."""
        return {**self.__dict__, '_row': None}

    def take_settings(self, p: Any) -> None:
        """Fly with other settings of the same class, as kernels read them, from now on."""
        self.p, self._row = p, None

    def answer(self, tick: int, u: Sequence[float]) -> None:
        """Write into p and m what a kernel needs that returned ASK."""
        raise NotImplementedError

    def answer_ahead(self, ticks: int, u: Sequence[float]) -> None:
        """Write into p and m what the kernel needs in a flight: for C, where nobody answers.

        ticks : of the flight; u : what the stage reads at tick 0

        Raises InputError if that follows from the flight.
        """
        if self.asks:
            raise InputError('it plans in flight')

    @property
    def asks(self) -> bool:
        """Whether its kernel may return ASK."""
        return type(self).answer is not KernelStage.answer

    @property
    def row(self) -> tuple[Any, Any, Any]:
        """The kernel, its settings and its memory as `calls.call` takes them."""
        if self._row is None:
            self._row = calls.row_of(type(self).kernel, self.p, self.m)
        return self._row

    def step(self, tick: int, *inputs: Signal) -> tuple[Signal, ...]:
        """Return the outputs of a tick."""
        places, (step, p, m) = self._places, self.row
        u: Any = list(chain.from_iterable(inputs))
        y: Any = [0.0] * places[-1].stop
        if COMPILED:
            u, y = np.array(u, np.float64), np.zeros(len(y))
        while calls.call_once(step, p, m, tick, u, y):
            self.answer(tick, u)
        made = tuple(y.tolist() if COMPILED else y)
        return (made,) if len(places) == 1 else tuple([made[place] for place in places])

    def steps(
        self, ticks: NDArray[np.int64], *inputs: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], ...]:
        """Return the outputs (n, width) of ticks (n,) one after the other."""
        count, size = len(ticks), self._places[-1].stop
        columns = [values.reshape(count, -1) for values in (*inputs, np.empty((count, 0)))]
        read = as_table(np.hstack(columns))
        made, numbers, done = as_table(np.empty((count, size))), as_table(ticks, np.int64), 0
        while (done := calls.run_stage(*self.row, done, numbers, read, made)) < count:
            self.answer(int(ticks[done]), read[done])
        flat = np.asarray(made).reshape(count, size)
        return tuple(flat[:, place] for place in self._places)

    @cached_property
    def _places(self) -> list[slice]:
        """Where each output stands in y."""
        return places_of(self.outputs)


def has_kernel(stage: Stage) -> TypeGuard[KernelStage]:
    """Return whether a stage flies by its kernel: it has one, and no `step` of its own."""
    return isinstance(stage, KernelStage) and type(stage).step is KernelStage.step


def stand_together(stages: Sequence[Stage]) -> None:
    """Let the settings of stages stand one after the other in memory, and their memories too."""
    kernels = [stage for stage in stages if has_kernel(stage)] if COMPILED else []
    for stage in kernels:
        stage._row = None
    move_together([stage.p for stage in kernels])
    move_together([stage.m for stage in kernels])


@dataclass(frozen=True, eq=False)
class Section:
    """A section of a scenario file that adds a stage.

    name : of the section
    settings : frozen dataclass that holds and checks the section's fields. A method `zones` returns
        what views draw about the target (`rpo_core.world.zones`), of a scenario; `of_zones` the
        fields that a mapping of the section takes from section `zones`, of both
    place : of the stage
    make : from the settings and the scenario to the stage
    check : raises InputError where the settings and the scenario do not go together
    needs : another section that the scenario must have, and what that is to this one
    rehearse : the same by a trial, which takes a moment; of scenario files only, as they are read.
        Of the scenario of a plant, only the node of that place does it
    names_files : whether its settings may name a file, whose content is then part of a log
    always : whether a scenario without the section has the stage too; then it is made of None
    """

    name: str
    settings: type[Any]
    place: Place
    make: Callable[[Any, Any], Stage]
    check: Callable[[Any, Any], None] | None = None
    needs: tuple[str, str] | None = None
    rehearse: Callable[[Any, Any], None] | None = None
    names_files: bool = False
    always: bool = False


_SECTIONS: dict[str, Section] = {}
_OF_SETTINGS: dict[type[Any], Section] = {}


def register(section: Section) -> Section:
    """Let scenario files have a section; raises InputError if there is one of that name."""
    if section.name in _SECTIONS:
        raise InputError(f'section `{section.name}` must be registered once; it is there already')
    _SECTIONS[section.name] = section
    return section


def sections() -> dict[str, Section]:
    """Return name -> section of all that scenario files may have; loads the plug-ins first."""
    plugins.load()
    return _SECTIONS


def section_of(settings: Any) -> Section:
    """Return the section that some settings belong to; raises InputError."""
    kind = type(settings)
    found = _OF_SETTINGS.get(kind)
    if found is not None and _SECTIONS.get(found.name) is found:  # it was not registered anew
        return found
    for section in sections().values():
        if kind is section.settings:
            _OF_SETTINGS[kind] = section
            return section
    raise InputError(f'section must be registered; got settings of {type(settings).__name__}')
