# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What nodes say of a run in a DiagnosticStatus: a contract and a strict reader for each topic.

Anybody may publish on a topic. A reader takes a status as a whole, or raises an InputError that
names the wrong field: no node acts on a part of it. The contracts, in `statuses.yaml`, say what
each field means; `docs/nodes/protocol.md` is written from them (`docs/hooks/node_pages.py`).
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, ClassVar, NamedTuple, TypeVar, cast

from rpo_core import files
from rpo_core.files.validation import InputError, choice, printable, quoted, shown, text
from rpo_core.wire import interfaces
from rpo_core.wire.cdr import Status

WAITING, RUNNING, PAUSED = 'waiting', 'running', 'paused'
FINISHED, ABORTED = 'finished', 'aborted'
ENDED = (FINISHED, ABORTED)

REFUSED = 'refused'
"""State in `stage_status` of a node that takes no part in the run of the plant."""

RECORDER_WAITS, READY, CLOSED, FAILED = 'waiting', 'ready', 'closed', 'failed'
"""What a recorder says of itself."""

MOST_CHARACTERS = 4000
"""Of one text of a status; only a manifest holds more, which are files."""
MOST_IN_ALL = 10_000
"""Of all its texts together."""

_TICK = re.compile('0|[1-9][0-9]{0,17}')
_NUMBER = re.compile(r'-?([0-9]+(\.[0-9]*)?(e[+-]?[0-9]+)?|inf)|nan')


def tick_of(values: Mapping[str, str]) -> int | None:
    """Return the tick that a status tells of; None if it tells of none."""
    number = values.get('tick', '')
    return int(number) if _TICK.fullmatch(number) else None


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
    for name, line in texts:
        if len(line) > MOST_CHARACTERS or len(name) > MOST_CHARACTERS:
            raise InputError(
                f'{shown(name)} must have at most {MOST_CHARACTERS} characters; got {len(line)}'
            )
    total = sum(len(name) + len(line) for name, line in texts)
    if total > MOST_IN_ALL:
        raise InputError(
            f'the texts of a status must have at most {MOST_IN_ALL} characters; got {total}'
        )
    return once(status.values)


def _tick(name: str, said: str) -> int:
    if not _TICK.fullmatch(said):
        raise InputError(f'`{name}` must be a whole number >= 0; got {shown(said)}')
    return int(said)


def _number(name: str, said: str) -> float:
    """Return a number, which may be infinite or NaN: a margin without a limit, a bad command."""
    if len(said) > 40 or not _NUMBER.fullmatch(said):
        raise InputError(f'{quoted(name)} must be a number; got {shown(said)}')
    return float(said)


def _figure(name: str, said: str) -> float:
    if not 0.0 <= _number(name, said) < math.inf:
        raise InputError(f'{quoted(name)} must be a finite number >= 0; got {shown(said)}')
    return float(said)


def _names(name: str, said: str) -> tuple[str, ...]:
    known = [row.name for row in interfaces.rows()]
    return tuple(choice(name, word, known) for word in said.split())


class Kind(NamedTuple):
    """What the text of a value must be: for the page, and as a function of its key and the text."""

    words: str
    read: Callable[[str, str], Any]


KINDS = {
    'tick': Kind('whole number >= 0', _tick),
    'number': Kind('number, inf or nan', _number),
    'figure': Kind('finite number >= 0', _figure),
    'names': Kind('names of topics, with spaces', _names),
    'text': Kind('one line', text),
    'text_or_none': Kind('one line, may be empty', lambda name, said: said and text(name, said)),
    'reason': Kind('text, may be empty', lambda _, said: printable(said)),
    'file': Kind('text', lambda _, said: said),
}
"""Word in `statuses.yaml` -> kind; a list there holds the words that are allowed."""


def _kind(written: str | list[str]) -> Kind:
    if isinstance(written, str):
        return KINDS[written]
    return Kind(
        ', '.join(f'`{w}`' for w in written), lambda name, said: choice(name, said, written)
    )


class Key(NamedTuple):
    """A value of a status.

    name : its key; 'file.<name>' stands for all that begin with 'file.'
    kind, unit, meaning : of the value
    needed : whether a status without it is refused
    """

    name: str
    kind: Kind
    meaning: str
    unit: str = ''
    needed: bool = True


@dataclass(frozen=True)
class Contract:
    """What a status of a topic holds: the table that the nodes validate with.

    sender, when : who publishes it, and when
    peer : what whoever hears it does, or must do
    keys : its values; `reason` of a phase or state is its `message`
    fields : name, message or hardware_id of the status -> what it must be, where it is fixed
    level : for people
    """

    sender: str
    when: str
    peer: str
    keys: tuple[Key, ...]
    fields: Mapping[str, tuple[str, ...]]
    level: str

    def read(self, status: Status, most: bool = True) -> dict[str, Any]:
        """Return the values by key, each as its kind reads it; raises InputError.

        most : whether the length of texts is limited
        """
        values = _values(status) if most else once(status.values)
        for name, allowed in self.fields.items():
            choice(name, getattr(status, name), allowed)
        read: dict[str, Any] = {}
        for key in self.keys:
            if key.name in values:
                read[key.name] = key.kind.read(key.name, values[key.name])
            elif key.needed:
                raise InputError(f'`{key.name}` is missing')
        return read


Said = TypeVar('Said', bound='Reader')


_TEXTS = {
    'PROGRESS_TICKS': interfaces.PROGRESS_TICKS,
    'MOST_AHEAD_TICKS': interfaces.MOST_AHEAD_TICKS,
}
"""Numbers in the texts of the contracts."""

_WRITTEN = files.parse_yaml(Path(__file__).with_suffix('.yaml').read_text(encoding='utf-8'))

LEVELS = {phase: tuple(found) for phase, found in _WRITTEN[interfaces.RUN_STATUS]['levels'].items()}
"""Phase of a run -> levels of the `run_status` that says so."""


def _contract(topic: str) -> Contract:
    """Return the contract of a topic as the file has it."""
    written = _WRITTEN[topic]
    keys = tuple(
        Key(name, **{**key, 'kind': _kind(key['kind'])}) for name, key in written['keys'].items()
    )
    said = {name: written[name].format_map(_TEXTS) for name in ('sender', 'when', 'peer')}
    fixed = {name: tuple(allowed) for name, allowed in written.get('fields', {}).items()}
    level = written.get('level', '0')
    if 'levels' in written:
        level = ', '.join(
            f'`{phase}` {" or ".join(map(str, found))}' for phase, found in LEVELS.items()
        )
    return Contract(keys=keys, fields=fixed, level=level, **said)


class Reader:
    """What one kind of status says; `topic` carries it, `contract` is that of the topic."""

    topic: ClassVar[str]
    contract: ClassVar[Contract]

    def __init_subclass__(cls) -> None:
        cls.contract = _contract(cls.topic)

    @classmethod
    def of(cls: type[Said], status: Status) -> Said:
        """Return what a status says: its `node`, what it `says`, its values; raises InputError."""
        found, kind = cls.contract.read(status), cast(Any, cls)
        names = [f.name for f in fields(kind)]
        if 'node' in names:
            found['node'] = text('name', status.name)
        if 'says' in names:
            found['says'] = status.message
        return cast(Said, kind(**{name: found[name] for name in names if name in found}))


@dataclass(frozen=True)
class RunStatus(Reader):
    """What a plant says of its run; the message is the reason of the phase."""

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

    @property
    def logged(self) -> bool:
        """Whether a log holds it: not that the run waits, pauses or goes on."""
        return self.phase in (RUNNING, *ENDED) and not self.resumed

    @classmethod
    def of(cls, status: Status) -> RunStatus:
        """Return what a status says; raises InputError."""
        values = cls.contract.read(status)
        phase = values['phase']
        if status.level not in LEVELS[phase]:
            levels = ' or '.join(map(str, LEVELS[phase]))
            raise InputError(f'the level of `{phase}` must be {levels}; got {status.level}')
        names = {key.name for key in cls.contract.keys}
        for name, value in status.values:
            if name not in names:
                if phase not in ENDED:  # at the end, free running adds figures of its own
                    raise InputError(f'{shown(name)} is not a known value')
                _figure(name, value)
        reason, dropped = printable(status.message), values.get('dropped', ())
        return cls(phase, values['tick'], reason, dropped, 'resumed' in values)


@dataclass(frozen=True)
class StageStatus(Reader):
    """What a node says of a stage, from `tick` on."""

    topic: ClassVar[str] = interfaces.STAGE_STATUS
    node: str
    stage: str
    state: str
    tick: int
    reason: str


@dataclass(frozen=True)
class GuidanceStatus(Reader):
    """A phase of the plan, from `tick` on."""

    topic: ClassVar[str] = interfaces.GUIDANCE_STATUS
    phase: str
    tick: int
    reason: str


@dataclass(frozen=True)
class AssuranceStatus(Reader):
    """An intervention of runtime assurance, from `tick` on."""

    topic: ClassVar[str] = 'assurance_status'
    mode: str
    constraint: str
    tick: int
    margin_m: float
    margin_m_s: float


@dataclass(frozen=True)
class RecorderStatus(Reader):
    """What a recorder says of itself; `says` is the message."""

    topic: ClassVar[str] = interfaces.RECORDER_STATUS
    says: str
    recorder: str
    run: str
    reason: str
    next_tick: int | None = None


_OF_MANIFEST = ('parameter.', 'file.', 'publishes.', 'hears.')


@dataclass(frozen=True)
class Manifest(Reader):
    """Files and parameters of a node: `values`, by key."""

    topic: ClassVar[str] = interfaces.NODE_MANIFEST
    node: str
    role: str
    run: str
    values: Mapping[str, str]

    @classmethod
    def of(cls, status: Status) -> Manifest:
        """Return what a status says; raises InputError."""
        read = cls.contract.read(status, most=False)
        values = dict(status.values)
        for key in values:
            if key not in read and not key.startswith(_OF_MANIFEST):
                raise InputError(f'{shown(key)} is none of {", ".join(_OF_MANIFEST)}')
        return cls(text('name', status.name), read['role'], read.get('run', ''), values)


ALIVE, GONE = 'alive', 'gone'
"""What a node says of itself: GONE as it ends in order."""


@dataclass(frozen=True)
class Heartbeat(Reader):
    """Sign of life of a node; `says` is the message."""

    topic: ClassVar[str] = interfaces.HEARTBEAT
    node: str
    stages: str
    says: str


READERS: Mapping[str, type[Reader]] = {
    kind.topic: kind
    for kind in (
        RunStatus, StageStatus, GuidanceStatus, AssuranceStatus, RecorderStatus, Manifest,
        Heartbeat,
    )
}  # fmt: skip
"""Name of a topic -> its reader."""
