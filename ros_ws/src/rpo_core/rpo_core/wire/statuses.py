# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What nodes say of a run in a DiagnosticStatus: a contract and a strict reader for each topic.

Anybody may publish on a topic. A reader takes a status as a whole, or raises an InputError that
names the wrong field: no node acts on a part of it. A contract says what each field means;
`docs/nodes/protocol.md` is written from the contracts (`tools/node_pages.py`).
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, fields
from typing import Any, ClassVar, NamedTuple, TypeVar, cast

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


def _tick(name: str, found: str) -> int:
    if not _TICK.fullmatch(found):
        raise InputError(f'`{name}` must be a whole number >= 0; got {shown(found)}')
    return int(found)


def _number(name: str, found: str) -> float:
    """Return a number, which may be infinite or NaN: a margin without a limit, a bad command."""
    if len(found) > 40 or not _NUMBER.fullmatch(found):
        raise InputError(f'{quoted(name)} must be a number; got {shown(found)}')
    return float(found)


def _figure(name: str, found: str) -> float:
    if not 0.0 <= _number(name, found) < math.inf:
        raise InputError(f'{quoted(name)} must be a finite number >= 0; got {shown(found)}')
    return float(found)


def _names(name: str, found: str) -> tuple[str, ...]:
    known = [row.name for row in interfaces.rows()]
    return tuple(choice(name, word, known) for word in found.split())


class Kind(NamedTuple):
    """What the text of a value must be: for the page, and as a function of its key and the text."""

    words: str
    read: Callable[[str, str], Any]


def _one_of(*words: str) -> Kind:
    return Kind(', '.join(f'`{w}`' for w in words), lambda name, found: choice(name, found, words))


TICK, NUMBER = Kind('whole number >= 0', _tick), Kind('number, inf or nan', _number)
FIGURE, NAMES = Kind('finite number >= 0', _figure), Kind('names of topics, with spaces', _names)
TEXT = Kind('one line', text)
TEXT_OR_NONE = Kind('one line, may be empty', lambda name, found: found and text(name, found))
REASON = Kind('text, may be empty', lambda _, found: printable(found))
FILE = Kind('text', lambda _, found: found)


class Key(NamedTuple):
    """A value of a status.

    name : its key; 'file.<name>' stands for all that begin with 'file.', '<topic>' for any other
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
    fields: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    level: str = '0'

    def read(self, status: Status, most: bool = True) -> dict[str, Any]:
        """Return the values by key, each as its kind reads it; raises InputError.

        most : whether the length of texts is limited
        """
        values = _values(status) if most else once(status.values)
        for name, allowed in self.fields.items():
            choice(name, getattr(status, name), allowed)
        found: dict[str, Any] = {}
        for key in self.keys:
            if key.name in values:
                found[key.name] = key.kind.read(key.name, values[key.name])
            elif key.needed:
                raise InputError(f'`{key.name}` is missing')
        return found


Said = TypeVar('Said', bound='Reader')


class Reader:
    """What one kind of status says; `topic` carries it."""

    topic: ClassVar[str]
    contract: ClassVar[Contract]

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


_PHASES = _one_of(*LEVELS)
_ANY_TICK = Key('tick', TICK, 'first tick that it holds for')


@dataclass(frozen=True)
class RunStatus(Reader):
    """What a plant says of its run; the message is the reason of the phase."""

    topic: ClassVar[str] = interfaces.RUN_STATUS
    contract: ClassVar[Contract] = Contract(
        'the plant',
        'as each phase begins, and when a peer is lost or comes back, the chaser enters a keep-out '
        'zone, or the recorder is gone. The message is the reason',
        'the recorder begins its log with `running`, at tick 0 or later, and closes it after '
        '`finished` or `aborted`. It takes a status whose distance and speed are those of the '
        'state of its tick, and no other. Nodes begin a new run after a new `waiting`',
        (
            Key('phase', _PHASES, 'of the run; `paused` is in no log'),
            Key('tick', TICK, 'that the plant is at; `finished`: the last one'),
            Key('time_s', FIGURE, 'since tick 0', 's', False),
            Key('distance_m', FIGURE, 'to the target; the recorder needs it', 'm', False),
            Key('speed_m_s', FIGURE, 'relative to the target; the recorder needs it', 'm/s', False),
            Key('energy_n2s', FIGURE, 'sum of the squared forces that the thrusters took, per '
                'axis, times the tick', 'N² s', False),
            Key('saturated_ticks', FIGURE, 'ticks with a saturated command', '', False),
            Key('dropped', NAMES, 'the plant goes on without these, from `tick` on', '', False),
            Key('resumed', _one_of('true'), 'it goes on after a pause', '', False),
        ),
        {'name': ('run',), 'hardware_id': ('none',)},
        ', '.join(f'`{phase}` {" or ".join(map(str, found))}' for phase, found in LEVELS.items()),
    )  # fmt: skip
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
        found = cls.contract.read(status)
        phase = found['phase']
        if status.level not in LEVELS[phase]:
            levels = ' or '.join(map(str, LEVELS[phase]))
            raise InputError(f'the level of `{phase}` must be {levels}; got {status.level}')
        known = {key.name for key in cls.contract.keys}
        for name, value in status.values:
            if name not in known:
                if phase not in ENDED:  # at the end, free running adds figures of its own
                    raise InputError(f'{shown(name)} is not a known value')
                _figure(name, value)
        reason, dropped = printable(status.message), found.get('dropped', ())
        return cls(phase, found['tick'], reason, dropped, 'resumed' in found)


@dataclass(frozen=True)
class StageStatus(Reader):
    """What a node says of a stage, from `tick` on."""

    topic: ClassVar[str] = interfaces.STAGE_STATUS
    contract: ClassVar[Contract] = Contract(
        'a node of the chain; its name is that of the node',
        'before the answer to the first tick that it holds for',
        'the recorder logs it, if a node of that name is there. Verify recomputes what follows '
        f'from it. Of a node that says `{REFUSED}` before tick 0, the plant aborts the run',
        (
            Key('stage', TEXT, 'of the chain'),
            Key('state', TEXT, f'`active`, `inactive`, `without_command`, `{REFUSED}`, a command '
                'or a decision of the stage'),
            _ANY_TICK,
            Key('reason', REASON, 'for people'),
        ),
        level='0 `active`, 1 else',
    )  # fmt: skip
    node: str
    stage: str
    state: str
    tick: int
    reason: str


@dataclass(frozen=True)
class GuidanceStatus(Reader):
    """A phase of the plan, from `tick` on."""

    topic: ClassVar[str] = interfaces.GUIDANCE_STATUS
    contract: ClassVar[Contract] = Contract(
        'guidance',
        'as a phase of the plan begins',
        'views show it; no node of the loop needs it',
        (
            Key('phase', TEXT, 'of the plan'),
            _ANY_TICK,
            Key('reason', REASON, 'for people'),
        ),
    )
    phase: str
    tick: int
    reason: str


@dataclass(frozen=True)
class AssuranceStatus(Reader):
    """An intervention of runtime assurance, from `tick` on."""

    topic: ClassVar[str] = 'assurance_status'
    contract: ClassVar[Contract] = Contract(
        'assurance',
        'as an intervention begins or ends, and when its constraint changes',
        'views show it; no node of the loop needs it',
        (
            Key('mode', _one_of('open', 'approach', 'contact'), 'of the zones'),
            Key('constraint', TEXT_OR_NONE, 'for which the command is changed; empty: it passes'),
            _ANY_TICK,
            Key('margin_m', NUMBER, 'that the command as it came would leave', 'm'),
            Key('margin_m_s', NUMBER, 'the same of the speed', 'm/s'),
            *(
                Key(f'{moment}_n.{axis}', NUMBER, f'command {moment} assurance', 'N')
                for moment in ('before', 'after')
                for axis in 'xyz'
            ),
        ),
        level='1 while it changes commands, else 0',
    )
    mode: str
    constraint: str
    tick: int
    margin_m: float
    margin_m_s: float


@dataclass(frozen=True)
class RecorderStatus(Reader):
    """What a recorder says of itself; `says` is the message."""

    topic: ClassVar[str] = interfaces.RECORDER_STATUS
    contract: ClassVar[Contract] = Contract(
        'the recorder',
        f'once a second of wall time, at each change, and every {interfaces.PROGRESS_TICKS} ticks. '
        f'The message is its state: `{RECORDER_WAITS}`, `{READY}`, `{CLOSED}` or `{FAILED}`',
        f'a plant that sees a recorder waits until it is `{READY}` before it passes tick 0, and in '
        f'lockstep is never more than {interfaces.MOST_AHEAD_TICKS} ticks ahead of `next_tick`; '
        f'after its last `run_status` it stays until `{CLOSED}`. From `asks_from` on it publishes '
        f'`{interfaces.PLANT_TICK}`; a plant that does not leaves messages that differ '
        'unexplained, and waits once for 6 s',
        (
            Key('recorder', TEXT, 'id of the recorder'),
            Key('run', TEXT_OR_NONE, 'of the plant that it records, from its manifest'),
            Key('reason', REASON, 'why it failed'),
            Key('next_tick', TICK, 'first tick that its log does not have yet', '', False),
            Key('asks_from', TICK, 'first tick of which the plant shall report', '', False),
        ),
        {'message': (RECORDER_WAITS, READY, CLOSED, FAILED)},
        '0; 2 with a reason',
    )
    says: str
    recorder: str
    run: str
    reason: str
    next_tick: int | None = None
    asks_from: int | None = None


@dataclass(frozen=True)
class PlantTick(Reader):
    """What a plant published and took at a tick: `taken`, by signal."""

    topic: ClassVar[str] = interfaces.PLANT_TICK
    contract: ClassVar[Contract] = Contract(
        'the plant',
        'when no answer to the state of a tick can act any more; only if a recorder asks',
        'the recorder logs, of messages that differ, the one that the plant published or took',
        (
            Key('run', TEXT, 'id of the plant, from its manifest'),
            Key('tick', TICK, 'that it tells of'),
            Key('<topic>', NUMBER, 'numbers of the message, with spaces, each by `repr` so that '
                'no bit is lost; empty: the plant took none', '', False),
        ),
    )  # fmt: skip
    run: str
    tick: int
    taken: Mapping[str, str]

    @classmethod
    def of(cls, status: Status) -> PlantTick:
        """Return what a status says; raises InputError."""
        found = cls.contract.read(status)
        taken = {name: value for name, value in status.values if name not in found}
        for name, value in taken.items():
            if name not in interfaces.table():
                raise InputError(f'{shown(name)} is no signal')
            row, numbers = interfaces.row_of(name), value.split()
            if numbers and len(numbers) not in row.widths:
                widths = ' or '.join(map(str, row.widths))
                raise InputError(f'{quoted(name)} must have {widths} numbers; got {value!r}')
            for number in numbers:
                _number(name, number)
        return cls(**found, taken=taken)


def numbers_text(values: Iterable[float]) -> str:
    """Return numbers as a text from which the same bits follow."""
    return ' '.join(repr(float(value)) for value in values)


_OF_MANIFEST = ('parameter.', 'file.', 'publishes.', 'hears.')


@dataclass(frozen=True)
class Manifest(Reader):
    """Files and parameters of a node: `values`, by key."""

    topic: ClassVar[str] = interfaces.NODE_MANIFEST
    contract: ClassVar[Contract] = Contract(
        'the plant, and each node with files or parameters that shape the flight; its name is that '
        'of the node',
        'once a second of wall time, and at each change',
        'nodes take the scenario from the manifest of the plant, and the recorder waits for it. It '
        'attaches all files and parameters to the log. A controller without a file sends its role '
        'alone: for one that sends none, the recorder waits 5 s',
        (
            Key('role', TEXT, '`plant`, `controller`, `disturbance`, or another'),
            Key('run', TEXT_OR_NONE, 'id of the plant, new for each start; of a plant', '', False),
            Key('parameter.<name>', FILE, 'a parameter as YAML. Of a plant `parameter.mode`: '
                '`lockstep` or `free_running`; `parameter.publish_clock` is `True` if it publishes '
                '`/clock`', '', False),
            Key('publishes.<topic>', TEXT, 'where the node publishes it, absolute. It is recorded '
                'where the plant has it, else where it is published', '', False),
            Key('hears.<topic>', TEXT, 'where the node listens to it, absolute', '', False),
            Key('file.<name>', FILE, 'the text of a file: `file.scenario.yaml` of a plant, '
                '`file.controller.yaml` of a controller', '', False),
        ),
    )  # fmt: skip
    node: str
    role: str
    run: str
    values: Mapping[str, str]

    @classmethod
    def of(cls, status: Status) -> Manifest:
        """Return what a status says; raises InputError."""
        found = cls.contract.read(status, most=False)
        values = dict(status.values)
        for key in values:
            if key not in found and not key.startswith(_OF_MANIFEST):
                raise InputError(f'{shown(key)} is none of {", ".join(_OF_MANIFEST)}')
        return cls(text('name', status.name), found['role'], found.get('run', ''), values)


ALIVE, GONE = 'alive', 'gone'
"""What a node says of itself: GONE as it ends in order."""


@dataclass(frozen=True)
class Heartbeat(Reader):
    """Sign of life of a node; `says` is the message."""

    topic: ClassVar[str] = interfaces.HEARTBEAT
    contract: ClassVar[Contract] = Contract(
        'the plant, and each node that runs stages of the scenario; its name is that of the node',
        f'five times a second of wall time: `{ALIVE}`; as it ends in order: `{GONE}`',
        'plant and recorder warn within a second, on their log, of a node that was heard and is '
        'not any more; `/diagnostics` of the plant and the reason of an abort name it too. A node '
        'that never sent one is not missed',
        (Key('stages', TEXT, 'that the node runs'),),
        {'message': (ALIVE, GONE)},
    )
    node: str
    stages: str
    says: str


READERS: Mapping[str, type[Reader]] = {
    kind.topic: kind
    for kind in (
        RunStatus, StageStatus, GuidanceStatus, AssuranceStatus, RecorderStatus, PlantTick,
        Manifest, Heartbeat,
    )
}  # fmt: skip
"""Name of a topic -> its reader."""
