# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Hostile messages as CDR, and which of them a node must obey, whoever sends them.

The bytes are made here and not by the middleware, because text that is no UTF-8, a false length or
half a message cannot be made from a message object.

ROS 2 without SROS2 knows no sender. A finite force in the right frame with the stamp of the present
tick is an answer, `deactivate` is an order of an operator, a `run_status` that says `finished` ends
a run. The bench sends everything but these valid acts of the moment. The rules follow from the
table of interfaces and from the tables of parameters, not from the nodes.
"""

from __future__ import annotations

import math
import re
import struct
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from importlib import import_module
from random import Random
from typing import Any

from rpo_core import files
from rpo_core.files import scenario as scenarios
from rpo_core.files.scenario import Scenario
from rpo_core.files.validation import InputError
from rpo_core.wire import cdr, interfaces, statuses
from rpo_core.wire.cdr import CdrError
from rpo_core.wire.interfaces import Interface
from rpo_ros.parameter_rows import ParameterRow

NUMBERS: dict[str, tuple[str, tuple[Any, ...]]] = {
    'boolean': ('B', (0, 1, 2, 255)),
    'octet': ('B', (0, 1, 3, 255)),
    'uint8': ('B', (0, 1, 4, 9, 10, 99, 255)),
    'int8': ('b', (0, -1, 127, -128)),
    'uint16': ('H', (0, 1, 65535)),
    'int16': ('h', (0, -1, 32767, -32768)),
    'uint32': ('I', (0, 1, 999_999_999, 1_000_000_000, 4_294_967_295)),
    'int32': ('i', (0, 1, -1, 2_147_483_647, -2_147_483_648)),
    'uint64': ('Q', (0, 1, 2**53 + 1, 2**64 - 1)),
    'int64': ('q', (0, 1, -1, 2**31, 2**63 - 1, -(2**63))),
    'float': ('f', (0.0, -1.0, 3e38, 1e-45, math.nan, math.inf)),
    'double': (
        'd',
        (0.0, -0.0, 1.5, -1e-3, 5e-324, 2.2e-308, 1e308, -1e308, math.nan, math.inf, -math.inf),
    ),
}
"""Type of a field -> its code in `struct`, hostile values."""

_WORDS = (
    '', ' ', '0', '-1', '1e400', 'nan', '12x', '٣', '9' * 5000, 'true', '~', '[', '{', '@x',
    '[draft] one', 'a: b', '2026-02-30', '!!python/object:x', '&a [*a, *a]', '- ' * 300,
    '[/bold]', '\x1b[2J\x1b]0;x\x07', 'two\nlines\r', '\x00', 'a\x00b', '\u202e', '\ud800',
    '../../etc/passwd', '/dev/zero', '/', '//', '~/x', '${HOME}', '%s%n', 'x' * 200_000,
)  # fmt: skip
_OURS = (
    'target_lvlh', 'chaser', 'running', 'waiting', 'finished', 'aborted', 'paused', 'ready',
    'closed', 'active', 'inactive', 'refused', 'plant', 'controller', 'disturbance', 'phase',
    'tick', 'role', 'stage', 'state', 'reason', 'dropped', 'resumed', 'file.scenario.yaml',
)  # fmt: skip
ANY_TEXTS = (
    *(word.encode('utf-8', 'surrogatepass') for word in _WORDS),
    *(b'\xff\xfe', b'\xc3', b'\xed\xa0\x80', b'\xf8\x88\x80\x80\x80' * 40),
)
TEXTS = (*ANY_TEXTS, *(word.encode() for word in _OURS))
"""Texts, some of them no UTF-8; words of our messages in the wrong places."""

MOST_BYTES = 400_000
"""Nothing more is spoilt in a message of this size: two long texts, or some lists."""

COUNTS = (0, 1, 2, 7, 300)
_LENGTH = struct.Struct('<I')
_FALSE_LENGTHS = (0, 1, 0x7FFF_FFFF, 0x8000_0000, 0xFFFF_FFFF, 0x0FFF_FFFF, 70_000)

Leaf = tuple[str, Any]


@cache
def class_of(name: str, room: str = 'msg') -> Any:
    """Return the class of a type such as 'std_msgs/Header' or 'std_srvs/srv/SetBool'."""
    package, *middle, kind = name.split('/')
    return getattr(import_module(f'{package}.{(middle or [room])[0]}'), kind)


@cache
def fields_of(kind: type) -> tuple[tuple[str, str], ...]:
    """Return name and type of each field."""
    found: dict[str, str] = kind.get_fields_and_field_types()  # type: ignore[attr-defined]
    return tuple(found.items())


class Encoder:
    """Encodes a message object as CDR; a share of its leaves becomes hostile, or one of them.

    share : of the leaves (numbers, texts, lengths of lists) that are replaced
    texts : to choose from
    only : number of the one leaf that is replaced, instead of a share
    leaves : how many it has met
    """

    def __init__(
        self,
        rng: Random,
        share: float,
        texts: Sequence[bytes] = TEXTS,
        only: int | None = None,
    ) -> None:
        self._rng, self._share, self._texts, self._only = rng, share, texts, only
        self._buffer = bytearray(cdr.HEADER)
        self.leaves = 0

    def encode(self, message: Any) -> bytes:
        """Return the bytes of a message."""
        self._message(message)
        if len(self._buffer) == len(cdr.HEADER):
            self._buffer.append(0)  # what ROS 2 puts into an empty message
        return bytes(self._buffer)

    def _spoilt(self) -> bool:
        self.leaves += 1
        if self._only is not None:
            return self.leaves == self._only
        return self._rng.random() < self._share and len(self._buffer) < MOST_BYTES

    def _message(self, message: Any) -> None:
        for name, kind in fields_of(type(message)):
            self._value(kind, getattr(message, name))

    def _value(self, kind: str, value: Any) -> None:
        if kind.endswith(']'):
            kind = kind.partition('[')[0]
            for item in value:
                self._value(kind, item)
        elif kind.startswith('sequence<'):
            self._sequence(kind[len('sequence<') : -1].partition(',')[0], value)
        elif kind.startswith('string'):
            self._text(value)
        elif kind in NUMBERS:
            self._number(kind, value)
        else:
            self._message(value)

    def _sequence(self, kind: str, values: Any) -> None:
        items = list(values)
        if self._spoilt():
            empty = items[:1] or [_empty(kind)]
            items = empty * self._rng.choice(COUNTS)
        self._align(4)
        self._buffer += _LENGTH.pack(len(items))
        for item in items:
            self._value(kind, item)

    def _text(self, value: str) -> None:
        data = self._rng.choice(self._texts) if self._spoilt() else value.encode('utf-8', 'replace')
        self._align(4)
        self._buffer += _LENGTH.pack(len(data) + 1) + data + b'\x00'

    def _number(self, kind: str, value: Any) -> None:
        code, hostile = NUMBERS[kind]
        if isinstance(value, bytes):
            value = value[0]
        if self._spoilt():
            value = self._rng.choice(hostile)
        layout = struct.Struct(f'<{code}')
        self._align(layout.size)
        self._buffer += layout.pack(value)

    def _align(self, size: int) -> None:
        self._buffer += bytes(-(len(self._buffer) - 4) % size)


def _empty(kind: str) -> Any:
    if kind.startswith('string'):
        return ''
    return 0 if kind in NUMBERS else class_of(kind)()


def _flipped(data: bytes, rng: Random) -> bytes:
    spoilt = bytearray(data or b'\x00')
    for _ in range(rng.randint(1, 8)):
        spoilt[rng.randrange(len(spoilt))] ^= 1 << rng.randrange(8)
    return bytes(spoilt)


def _false_length(data: bytes, rng: Random) -> bytes:
    """Return a message with another number in the place of a length, or of anything else."""
    places = range(4, len(data) - 3, 4)
    if not places:
        return data
    place = rng.choice(places)
    return data[:place] + _LENGTH.pack(rng.choice(_FALSE_LENGTHS)) + data[place + 4 :]


BYTES: dict[str, Callable[[bytes, Random], bytes]] = {
    'flipped bits': _flipped,
    'false length': _false_length,
    'cut': lambda data, rng: data[: rng.randrange(len(data) + 1)],
    'too long': lambda data, rng: data + rng.randbytes(rng.choice((1, 3, 4, 2000))),
    'no CDR': lambda data, rng: rng.randbytes(rng.choice((0, 1, 4, 12, 700, 5000))),
    'other header': lambda data, rng: rng.randbytes(2) + data[2:],
    'big endian': lambda data, rng: b'\x00\x00' + data[2:],
}
"""Kind -> spoils the bytes of a message."""

SHARES = {'few fields': 0.05, 'some fields': 0.3, 'all fields': 1.0}
"""Kind -> share of the fields that become hostile."""

ONE_FIELD = 'one field'
KINDS = (ONE_FIELD, *SHARES, *BYTES)


def spoilt(message: Any, kind: str, rng: Random) -> bytes:
    """Return a message as CDR, spoilt in one of `KINDS`."""
    if kind == ONE_FIELD:
        whole = Encoder(rng, 0.0)
        whole.encode(message)
        return Encoder(rng, 0.0, only=rng.randint(1, max(whole.leaves, 1))).encode(message)
    if kind in SHARES:
        return Encoder(rng, SHARES[kind]).encode(message)
    return BYTES[kind](Encoder(rng, 0.0).encode(message), rng)


_NODES = ('fuzzy_controller', 'guidance', 'assurance', 'navigation', 'disturbance_injector')
_STAGES = ('controller', 'guidance', 'assurance', 'estimator', 'sensors', 'disturbance')
_STATES = (
    'active', 'inactive', 'refused', 'without_command', 'go', 'hold', 'retreat', 'abort', 'armed',
    'holding', 'resumed',
)  # fmt: skip
_PHASES = ('hold_60', 'to_20', 'docked', 'aborting', 'drifting')
_WRONG = (
    'soon', '', ' ', '-1', '-0', '1.5', '1e3', '+5', ' 5', '5 ', '0x10', '1_000', '٣', '²', 'nan',
    'inf', '-inf', 'None', 'true', '9' * 5000, 'x' * 200_000, 'flying', 'control_force_raw',
    'two words', '\x1b[2J', 'a\x00b', '[', '\n',
)  # fmt: skip
_SAID = {
    'stage': _STAGES, 'stages': _STAGES, 'state': _STATES, 'phase': _PHASES, 'reason': ('so',),
    'role': ('plant', 'controller', 'disturbance'), 'constraint': ('', 'keep_out'),
    'recorder': ('0' * 32,), 'run': ('0' * 32,),
}  # fmt: skip
"""Key of a status -> texts that it may have, where its kind does not say which."""


STATUS_KINDS = ('value', 'value', 'value', 'key', 'missing', 'twice', 'more', 'head')


def made(topic: str, rng: Random, tick: int) -> cdr.Status:
    """Return a whole status of a topic of `statuses.READERS`, as its contract says."""
    contract = statuses.READERS[topic].contract
    values = {
        key.name: _value(key, rng, tick)
        for key in contract.keys
        if '<' not in key.name and (key.needed or rng.random() < 0.5)
    }
    if topic == interfaces.PLANT_TICK:
        for name in (interfaces.RELATIVE_STATE, interfaces.CONTROL_FORCE):
            columns = interfaces.row_of(name).columns
            values[name] = ' '.join(repr(rng.random()) for _ in columns)
    if topic == interfaces.NODE_MANIFEST:
        text = files.read_text(files.find('scenario', rng.choice(('quick', 'docking'))))
        if values['role'] == 'plant':  # a whole one is an act: another plant flies
            text = text[: len(text) // 2]
        values |= {'parameter.mode': 'lockstep', 'file.scenario.yaml': text}
    level = rng.choice(statuses.LEVELS.get(values.get('phase', ''), (0,)))
    usual = {'name': _NODES, 'message': ('so',), 'hardware_id': ('none',), **contract.fields}
    head = (rng.choice(usual[field]) for field in ('name', 'message', 'hardware_id'))
    return cdr.Status(level, *head, tuple(values.items()))


def _value(key: statuses.Key, rng: Random, tick: int) -> str:
    """Return a text that a key may have."""
    words = re.findall('`(.+?)`', key.kind.words)
    if key.kind is statuses.TICK:
        return str(tick)
    if key.kind in (statuses.NUMBER, statuses.FIGURE):
        return repr(rng.random())
    if key.kind is statuses.NAMES:
        words = [row.name for row in interfaces.rows()]
    return rng.choice(words or _SAID[key.name])


def one_wrong(topic: str, genuine: bytes, rng: Random, tick: int) -> bytes:
    """Return a status of a topic of `statuses.READERS` with one wrong field, as CDR.

    genuine : the last one heard, b'' if there is none
    """
    whole = made(topic, rng, tick)
    if genuine and rng.random() < 0.5:
        whole = cdr.decode_status(genuine)
    return cdr.encode_status(*spoilt_status(whole, rng.choice(STATUS_KINDS), rng))


def spoilt_status(whole: cdr.Status, how: str, rng: Random) -> cdr.Status:
    """Return a status with one field changed, in one of `STATUS_KINDS`; perhaps whole."""
    values = list(whole.values)
    if how == 'head' or not values:
        field = rng.choice(('level', 'name', 'message', 'hardware_id'))
        wrong = rng.choice((3, 255)) if field == 'level' else rng.choice(_WRONG)
        return whole._replace(**{field: wrong})
    at = rng.randrange(len(values))
    key, value = values[at]
    if how == 'value':
        values[at] = key, rng.choice(_WRONG)
    elif how == 'key':
        values[at] = rng.choice((f'{key}s', key.upper(), key[:-1])), value
    elif how == 'missing':
        del values[at]
    elif how == 'twice':
        values.insert(rng.randrange(len(values) + 1), (key, rng.choice((value, *_WRONG))))
    else:
        values.append((rng.choice(('note', 'parameter', *_WRONG)), rng.choice(_WRONG)))
    return whole._replace(values=tuple(values))


FAR_TICKS = 200
"""A message for a tick so far ahead comes long before its tick: it is no answer."""

_ROLES = ('controller', 'disturbance')
_FROM_ACTIVE = {'deactivate': 4, 'shutdown': 7}
"""Transitions of the lifecycle that are possible in `active`."""
_LABELS = ('unconfigured', 'inactive', 'active', 'finalized')
"""States of the lifecycle, in the health of a controller."""

ALWAYS = (
    'reset', 'abort', 'go', 'hold', 'retreat', 'drift', 'resume', 'arm', 'inhibit',
)  # fmt: skip
"""Services without a field, of the plant, of guidance and of assurance: each call is an order."""


def row_for(topic: str, type_name: str) -> Interface | None:
    """Return the row of a topic, else one of its type; None if the table has neither."""
    rows = interfaces.rows()
    return interfaces.find(topic) or next((row for row in rows if row.type == type_name), None)


def is_act(row: Interface, data: bytes, tick: int, scenario: Scenario) -> bool:
    """Return whether a message is a valid act while the flight is at `tick` or a little later.

    One that lacks up to three bytes arrives with zeros: the middleware sends words of four.
    """
    data += bytes(-len(data) % 4)
    try:
        if row.columns:
            stamp_ns, values, right_frame = row.layout.decode(data)
            finite = all(map(math.isfinite, values))
            return right_frame and finite and _is_due(scenario, stamp_ns, tick)
        if row.type == interfaces.ARRAY_TYPE:
            return _array_acts(row, data, tick, scenario)
        return row.type == interfaces.STATUS_TYPE and _status_acts(row, cdr.decode_status(data))
    except CdrError:
        return False


def _is_due(scenario: Scenario, stamp_ns: int, tick: int) -> bool:
    found = scenario.tick_of(stamp_ns)  # an estimator reads the command of the tick before
    return found is not None and tick - 1 <= found < tick + FAR_TICKS


def _array_acts(row: Interface, data: bytes, tick: int, scenario: Scenario) -> bool:
    stamp_ns, found = cdr.decode_array(data)
    if row.name == interfaces.DECISION:
        return _is_due(scenario, stamp_ns, tick)
    return any(dict(status.values).get('state') in _LABELS for status in found)


def _status_acts(row: Interface, status: cdr.Status) -> bool:
    """Return whether a status is whole; in flight, a refusal is none of the moment."""
    try:
        said = statuses.READERS[row.name].of(status) if row.name in statuses.READERS else None
        if isinstance(said, statuses.StageStatus):
            return said.state != statuses.REFUSED
        if isinstance(said, statuses.Manifest) and said.role == 'plant':
            text = said.values.get('file.scenario.yaml', '')
            files.loads(text, scenarios.parse, 'scenario')
        elif isinstance(said, statuses.Manifest):
            return said.role in _ROLES
    except InputError:
        return False
    return True


def is_order(service: str, request: Any, rows: Mapping[str, ParameterRow]) -> bool:
    """Return whether a call is a valid order.

    rows : name -> row of the node's parameters
    """
    name = service.rpartition('/')[2]
    if name == 'pause':
        return bool(request.data)
    if name == 'change_state':
        asked = request.transition
        if asked.label:
            return asked.label in _FROM_ACTIVE
        return asked.id in _FROM_ACTIVE.values()
    if name.startswith('set_parameters'):
        return any(_is_set(parameter, rows) for parameter in request.parameters)
    return False


def _is_set(parameter: Any, rows: Mapping[str, ParameterRow]) -> bool:
    """Return whether a parameter that may change in flight is set to a value that it may have."""
    from rclpy.parameter import parameter_value_to_python

    row = rows.get(parameter.name)
    if row is None or not row.changeable:
        return False
    try:
        row.check(parameter_value_to_python(parameter.value))
    except (InputError, RuntimeError):  # a type that is none
        return False
    return True
