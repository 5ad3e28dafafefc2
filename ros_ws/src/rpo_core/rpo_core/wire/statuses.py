# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What nodes say of a run in a DiagnosticStatus: a strict reader for each topic.

Anybody may publish on a topic. A reader takes a status as a whole, or raises an InputError that
names the wrong field: no node acts on a part of it.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import ClassVar, Protocol

from rpo_core.files.validation import InputError, choice, printable, quoted, shown, text
from rpo_core.wire import interfaces
from rpo_core.wire.cdr import Status

WAITING, RUNNING, PAUSED = 'waiting', 'running', 'paused'
FINISHED, ABORTED = 'finished', 'aborted'
ENDED = (FINISHED, ABORTED)

LEVELS = {WAITING: (0,), RUNNING: (0, 1), PAUSED: (0,), FINISHED: (0,), ABORTED: (1, 2)}
"""Phase of a run -> levels of the `run_status` that says so."""

REFUSED = 'refused'
"""State in `stage_status` of a node that takes no part in the run of the plant."""

RECORDER_WAITS, READY, CLOSED, FAILED = 'waiting', 'ready', 'closed', 'failed'
"""What a recorder says of itself."""

MOST_CHARACTERS = 4000
"""Of one text of a status; only a manifest holds more, which are files."""
MOST_IN_ALL = 10_000
"""Of all its texts together."""

_RUN_FIGURES = ('time_s', 'energy_n2s', 'distance_m', 'speed_m_s', 'saturated_ticks')
_MODES = ('open', 'approach', 'contact')
_TICK = re.compile('0|[1-9][0-9]{0,17}')
_NUMBER = re.compile(r'-?([0-9]+(\.[0-9]*)?(e[+-]?[0-9]+)?|inf)|nan')


def tick_of(values: Mapping[str, str]) -> int | None:
    """Return the tick that a status tells of; None if it tells of none."""
    found = values.get('tick', '')
    return int(found) if _TICK.fullmatch(found) else None


def once(pairs: Iterable[tuple[str, str]]) -> dict[str, str]:
    """Return values by key; raises InputError for a key that comes twice."""
    values: dict[str, str] = {}
    for key, value in pairs:
        if key in values:
            raise InputError(f'{shown(key)} must come once; it comes twice')
        values[key] = value
    return values


def _values(status: Status) -> dict[str, str]:
    """Return values by key; raises InputError for a key that comes twice, or for a long text.

    A log holds whole statuses: a reader refuses a chunk that grows a thousandfold.
    """
    texts = [(name, getattr(status, name)) for name in ('name', 'message', 'hardware_id')]
    texts += status.values
    for name, found in texts:
        if len(found) > MOST_CHARACTERS or len(name) > MOST_CHARACTERS:
            raise InputError(
                f'{shown(name)} must have at most {MOST_CHARACTERS} characters; got {len(found)}'
            )
    total = sum(len(name) + len(found) for name, found in texts)
    if total > MOST_IN_ALL:
        raise InputError(
            f'the texts of a status must have at most {MOST_IN_ALL} characters; got {total}'
        )
    return once(status.values)


def _given(values: Mapping[str, str], name: str) -> str:
    if name not in values:
        raise InputError(f'`{name}` is missing')
    return values[name]


def _tick(values: Mapping[str, str], name: str = 'tick') -> int:
    found = _given(values, name)
    if not _TICK.fullmatch(found):
        raise InputError(f'`{name}` must be a whole number >= 0; got {shown(found)}')
    return int(found)


def _number(values: Mapping[str, str], name: str) -> float:
    """Return a number, which may be infinite or NaN: a margin without a limit, a bad command."""
    found = _given(values, name)
    if len(found) > 40 or not _NUMBER.fullmatch(found):
        raise InputError(f'{quoted(name)} must be a number; got {shown(found)}')
    return float(found)


def _figure(values: Mapping[str, str], name: str) -> float:
    found = _number(values, name)
    if not 0.0 <= found < math.inf:
        raise InputError(f'{quoted(name)} must be a finite number >= 0; got {shown(values[name])}')
    return found


class Reader(Protocol):
    """What one kind of status says; `topic` carries it."""

    topic: ClassVar[str]

    @classmethod
    def of(cls, status: Status) -> Reader:
        """Return what a status says; raises InputError."""


@dataclass(frozen=True)
class RunStatus:
    """What a plant says of its run.

    phase : one of LEVELS; ended: whether the run has
    tick : of the run
    reason : of the phase
    dropped : signals that the plant goes on without, from `tick` on
    resumed : whether it continues after a pause
    """

    topic: ClassVar[str] = interfaces.RUN_STATUS
    phase: str
    tick: int
    reason: str
    dropped: tuple[str, ...] = ()
    resumed: bool = False

    @property
    def ended(self) -> bool:
        """Whether the run has ended."""
        return self.phase in ENDED

    @classmethod
    def of(cls, status: Status) -> RunStatus:
        """Return what a status says; raises InputError."""
        values = _values(status)
        phase = choice('phase', _given(values, 'phase'), LEVELS)
        if status.level not in LEVELS[phase]:
            levels = ' or '.join(map(str, LEVELS[phase]))
            raise InputError(f'the level of `{phase}` must be {levels}; got {status.level}')
        for field, wanted in (('name', 'run'), ('hardware_id', 'none')):
            choice(field, getattr(status, field), [wanted])
        if 'resumed' in values:
            choice('resumed', values['resumed'], ['true'])
        dropped = values.get('dropped', '').split()
        for name in dropped:
            choice('dropped', name, [row.name for row in interfaces.rows()])
        known = ('phase', 'tick', 'resumed', 'dropped')
        for name in (name for name in values if name not in known):
            # At the end, free running adds figures of its own.
            if name not in _RUN_FIGURES and phase not in ENDED:
                raise InputError(f'{shown(name)} is not a known value')
            _figure(values, name)
        reason, resumed = printable(status.message), 'resumed' in values
        return cls(phase, _tick(values), reason, tuple(dropped), resumed)


@dataclass(frozen=True)
class StageStatus:
    """What a node says of a stage.

    node : name of the node
    state : of the stage, from `tick` on: active, inactive, REFUSED, a command that it got, what it
        decided
    """

    topic: ClassVar[str] = interfaces.STAGE_STATUS
    node: str
    stage: str
    state: str
    tick: int
    reason: str

    @classmethod
    def of(cls, status: Status) -> StageStatus:
        """Return what a status says; raises InputError."""
        values = _values(status)
        stage, state = (text(name, _given(values, name)) for name in ('stage', 'state'))
        node = text('name', status.name)
        return cls(node, stage, state, _tick(values), printable(_given(values, 'reason')))


@dataclass(frozen=True)
class GuidanceStatus:
    """A phase of the plan, from `tick` on."""

    topic: ClassVar[str] = interfaces.GUIDANCE_STATUS
    phase: str
    tick: int
    reason: str

    @classmethod
    def of(cls, status: Status) -> GuidanceStatus:
        """Return what a status says; raises InputError."""
        values = _values(status)
        phase = text('phase', _given(values, 'phase'))
        return cls(phase, _tick(values), printable(_given(values, 'reason')))


@dataclass(frozen=True)
class AssuranceStatus:
    """An intervention of runtime assurance, from `tick` on.

    mode : open, approach or contact
    constraint : for which the command is changed; '' where the command passes
    margin_m, margin_m_s : that the command as it came would leave
    """

    topic: ClassVar[str] = 'assurance_status'
    mode: str
    constraint: str
    tick: int
    margin_m: float
    margin_m_s: float

    @classmethod
    def of(cls, status: Status) -> AssuranceStatus:
        """Return what a status says; raises InputError."""
        values = _values(status)
        for name in (f'{moment}_n.{axis}' for moment in ('before', 'after') for axis in 'xyz'):
            _number(values, name)
        constraint = _given(values, 'constraint')
        return cls(
            choice('mode', _given(values, 'mode'), _MODES),
            text('constraint', constraint) if constraint else '',
            _tick(values),
            _number(values, 'margin_m'),
            _number(values, 'margin_m_s'),
        )


@dataclass(frozen=True)
class RecorderStatus:
    """What a recorder says of itself.

    says : RECORDER_WAITS, READY, CLOSED or FAILED
    recorder : id of the recorder
    run : id of the plant that it records; '' while it records none
    next_tick : up to which its log is complete; None before it has one
    asks_from : first tick of which the plant shall report what it published and took; None: of none
    """

    topic: ClassVar[str] = interfaces.RECORDER_STATUS
    says: str
    recorder: str
    run: str
    reason: str
    next_tick: int | None = None
    asks_from: int | None = None

    @classmethod
    def of(cls, status: Status) -> RecorderStatus:
        """Return what a status says; raises InputError."""
        values = _values(status)
        says = choice('message', status.message, (RECORDER_WAITS, READY, CLOSED, FAILED))
        run = _given(values, 'run')
        return cls(
            says,
            text('recorder', _given(values, 'recorder')),
            text('run', run) if run else '',
            printable(_given(values, 'reason')),
            *(_tick(values, n) if n in values else None for n in ('next_tick', 'asks_from')),
        )


@dataclass(frozen=True)
class PlantTick:
    """What a plant published and took at a tick.

    run : id of the plant
    taken : signal -> its numbers, as `numbers_text` writes them; '' for an answer that it did not
        take
    """

    topic: ClassVar[str] = interfaces.PLANT_TICK
    run: str
    tick: int
    taken: Mapping[str, str]

    @classmethod
    def of(cls, status: Status) -> PlantTick:
        """Return what a status says; raises InputError."""
        values = _values(status)
        run, tick = text('run', _given(values, 'run')), _tick(values)
        taken = {name: found for name, found in values.items() if name not in ('run', 'tick')}
        for name, found in taken.items():
            if name not in interfaces.table():
                raise InputError(f'{shown(name)} is no signal')
            columns = interfaces.row_of(name).columns
            numbers = found.split()
            if numbers and len(numbers) != len(columns):
                raise InputError(f'{quoted(name)} must have {len(columns)} numbers; got {found!r}')
            for number in numbers:
                _number({name: number}, name)
        return cls(run, tick, taken)


def numbers_text(values: Iterable[float]) -> str:
    """Return numbers as a text from which the same bits follow."""
    return ' '.join(repr(float(value)) for value in values)


@dataclass(frozen=True)
class Manifest:
    """Files and parameters of a node.

    node : name of the node
    role : plant, controller, disturbance, or another
    run : id of a plant
    values : role, run, `parameter.<name>`, `file.<name>`
    """

    topic: ClassVar[str] = interfaces.NODE_MANIFEST
    node: str
    role: str
    run: str
    values: Mapping[str, str]

    @classmethod
    def of(cls, status: Status) -> Manifest:
        """Return what a status says; raises InputError."""
        values = once(status.values)
        role, run = text('role', _given(values, 'role')), values.get('run', '')
        for key in values:
            if key not in ('role', 'run') and not key.startswith(('parameter.', 'file.')):
                raise InputError(f'{shown(key)} is no `parameter.` and no `file.`')
        node = text('name', status.name)
        return cls(node, role, text('run', run) if run else '', values)


READERS: Mapping[str, type[Reader]] = {
    kind.topic: kind
    for kind in (
        RunStatus, StageStatus, GuidanceStatus, AssuranceStatus, RecorderStatus, PlantTick,
        Manifest,
    )
}  # fmt: skip
"""Name of a topic -> its reader."""
