# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Numbers with names, for kernels: the settings `p` and the memory `m` of a stage.

A record is a slotted dataclass, or a named tuple, whose fields are

    float, int                          one number
    Annotated[list[float], 9, 9]        as many as it says, of float, int or another record
    list[float], list[list[float]]      any number; also list[int], list[Other]
    Other                               the numbers of another record

Interpreted, a kernel reads the object itself, with nested lists. Compiled, it reads the same fields
of a block of memory (`Packed`): fields one after the other, as in a C struct, each number a word of
8 bytes; where the length is not fixed, what numba keeps of an array (its address and its shape). So
kernels index `a[i][j]`, and take no slices.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from ctypes import addressof, c_char
from dataclasses import dataclass
from functools import cache
from itertools import chain
from math import prod
from operator import attrgetter
from struct import Struct
from types import SimpleNamespace
from typing import Annotated, Any, ClassVar, NamedTuple, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

from rpo_core.kernels.arrays import Ints
from rpo_core.kernels.jit import COMPILED


class Field(NamedTuple):
    """A field of a record.

    base : float, int or the class of another record
    shape : () for one; None in the place of a length that is not fixed
    """

    name: str
    base: Any
    shape: tuple[int | None, ...]

    @property
    def is_fixed(self) -> bool:
        """Whether its numbers stand in the record itself."""
        return None not in self.shape

    @property
    def format(self) -> str:
        """Its words in the record, as `struct` has them."""
        if not self.is_fixed:
            return 'q' * (5 + 2 * len(self.shape))
        return format_of(self.base) * prod(size or 0 for size in self.shape)


@cache
def fields_of(record: Any) -> tuple[Field, ...]:
    """Return the fields of a record; TypeError where one is none of the allowed."""
    for name in record.__annotations__:
        if name.startswith('_'):
            raise TypeError(f'field `{name}` of {record.__name__} must begin with a letter')
    return tuple(
        _field(record, name, hint)
        for name, hint in get_type_hints(record, include_extras=True).items()
        if get_origin(hint) is not ClassVar
    )


def _field(record: type[Any], name: str, hint: Any) -> Field:
    sizes: tuple[int | None, ...] | None = None
    if get_origin(hint) is Annotated:  # with sizes, or the check of a setting
        hint, *given = get_args(hint)
        sizes = tuple(given) if isinstance(given[0], int) else None
    depth = 0
    if get_origin(hint) is tuple:  # of as many numbers
        sizes, hint = (len(get_args(hint)),), list[get_args(hint)[0]]  # type: ignore[misc]
    while get_origin(hint) is list:
        (hint,), depth = get_args(hint), depth + 1
    shape = (None,) * depth if sizes is None else sizes
    if len(shape) != depth or not isinstance(hint, type) or (None in shape and depth > 2):
        raise TypeError(
            f'field `{name}` of {record.__name__} must be float, int, a record or lists of them, '
            f'with a size for each list; got {hint!r}, sizes {sizes}'
        )
    return Field(name, hint, shape)


@cache
def format_of(base: Any) -> str:
    """Return the words of a number or a record: d for a float, q for an int or an address."""
    if base in (float, int):
        return 'd' if base is float else 'q'
    return ''.join(field.format for field in fields_of(base))


@cache
def places_of(record: Any) -> dict[str, tuple[Field, int]]:
    """Return each field of a record, and the word where it begins."""
    begins = np.cumsum([0, *(len(field.format) for field in fields_of(record))]).tolist()
    return {f.name: (f, begin) for f, begin in zip(fields_of(record), begins, strict=False)}


@cache
def _struct(base: Any, count: int = 1) -> Struct:
    return Struct('=' + count * format_of(base))


class _Packing:
    """Records that become words: the arrays first to which others point.

    links : places of addresses, which are counted from the first word on
    """

    def __init__(self) -> None:
        self.data = bytearray()
        self.links: list[int] = []

    def records(self, record: Any, rows: Sequence[Any]) -> int:
        """Add records; return the place of the first."""
        words: list[Any] = []
        links: list[int] = []
        for row in rows:
            self._row(record, row, words, links)
        first = len(self.data) // 8
        self.data += _struct(record, len(rows)).pack(*words)
        self.links += [first + place for place in links]
        return first

    def _row(self, record: Any, row: Any, words: list[Any], links: list[int]) -> None:
        if _is_plain(record):
            words.extend(row if isinstance(row, tuple) else _numbers(record)(row))
            return
        for name, base, shape in fields_of(record):
            values = getattr(row, name)
            if not shape and base in (float, int):
                words.append(values)
            elif None in shape:
                links.append(len(words) + 4)
                words.extend(self.array(base, len(shape), values))
            else:
                for _ in shape[1:]:
                    values = chain.from_iterable(values)
                if base in (float, int):
                    words.extend(values)
                else:
                    for value in values if shape else (values,):
                        self._row(base, value, words, links)

    def array(self, base: Any, depth: int, values: Any) -> list[int]:
        """Add an array; return what numba keeps of it, with its place [bytes] as its address."""
        if base in (float, int) or (depth == 1 and _is_table(base, values)):
            numbers = np.array(values, np.int64 if base is int else np.float64)
            shape = numbers.shape[:depth] if numbers.size else (0,) * depth
            place = len(self.data) // 8
            self.data += numbers.tobytes()
        else:
            shape = (len(values), *(len(values[0]) if len(values) else 0 for _ in range(1, depth)))
            place = self.records(base, values if depth == 1 else list(chain(*values)))
        size = 8 * len(format_of(base))
        strides = (size * prod(shape[i:]) for i in range(1, depth + 1))
        return [0, 0, prod(shape), size, 8 * place, *shape, *strides]


@cache
def _is_plain(record: Any) -> bool:
    """Return whether all fields of a record are numbers."""
    return all(field.shape == () and field.base in (float, int) for field in fields_of(record))


@cache
def _numbers(record: Any) -> Any:
    """Return what gives the numbers of an object whose fields are numbers."""
    names = places_of(record)
    return attrgetter(*names) if len(names) > 1 else lambda row: [getattr(row, *names)]


def _is_table(record: Any, values: Any) -> bool:
    """Return whether some records are rows of floats: tuples, or an array."""
    is_row = len(values) > 0 and isinstance(values[0], (tuple, np.ndarray))
    return is_row and _is_plain(record) and 'q' not in format_of(record)


def _address(words: Ints) -> int:
    return addressof(c_char.from_buffer(words.data))  # the fastest way


def _moved(words: Ints, links: list[int]) -> int:
    """Return the address of words, from which addresses among them then count."""
    address = _address(words)
    for place in links:
        words[place] += address
    return address


class _Block:
    """A record in memory with its arrays, and arrays that were written later.

    begun : the words with which it began
    links : places of addresses among them
    later : address -> what has the array there: where that begins, and its words
    """

    __slots__ = ('address', 'begun', 'later', 'links', 'words')

    def __init__(self, begun: Ints, links: list[int]) -> None:
        self.links, self.words, self.address = links, begun, _moved(begun, links)
        self.begun = begun.copy()
        self.later: dict[int, tuple[int, Ints]] = {}

    def from_zero(self) -> Ints:
        """Return the words with which it began, addresses counted from the first one."""
        begun = self.begun.copy()
        for place in self.links:
            begun[place] -= self.address
        return begun

    def move(self, room: Ints) -> None:
        """Take other memory for the words."""
        last, address = self.address, _address(room)
        room[:] = self.words
        for words in (room, self.begun):
            for place in self.links:
                if 0 <= words[place] - last < words.nbytes:  # else it was written later
                    words[place] += address - last
        self.words, self.address = room, address

    def array(self, link: list[int]) -> tuple[Any, int, Any]:
        """Return where an array is that numba keeps: words, place in them, shape."""
        count, address, shape = link[2], link[4], tuple(link[5 : (5 + len(link)) // 2])
        blocks = (self.address, self.words), *self.later.values()
        return next(
            (words, (address - begin) // 8 if count else 0, shape)
            for begin, words in blocks
            if not count or 0 <= address - begin < words.nbytes
        )

    def put(self, link: Ints, base: Any, values: Any) -> None:
        """Write an array to which a field points, in its place if it has the same shape."""
        packing, old = _Packing(), link.tolist()
        new = packing.array(base, (len(old) - 5) // 2, values)
        words: Ints = np.frombuffer(packing.data or bytearray(8), np.int64)
        if new[5:] == old[5:] and not packing.links:
            target, place, _ = self.array(old)
            size = len(packing.data) // 8
            target[place : place + size] = words[:size]
            return
        self.later.pop(old[4], None)
        begin = _moved(words, packing.links)
        new[4] += begin
        link[:] = new
        self.later[new[4]] = begin, words


class Packed:
    """A record in memory, as compiled kernels read it.

    A field is read and written as that of the object is (`packed.lost = 1`): a number; an array,
    whose items can be written; another record; a sequence of records.
    """

    __slots__ = ('_place',)
    _place: tuple[Any, _Block, Ints, int, dict[str, tuple[Field, int]]]

    def __init__(self, record: Any, block: _Block, words: Ints, first: int) -> None:
        object.__setattr__(self, '_place', (record, block, words, first, places_of(record)))

    def _field(self, name: str) -> tuple[Any, Any, _Block, Any, int]:
        """Return base and shape of a field, and where it is."""
        _, block, words, first, places = self._place
        if name not in places:
            raise AttributeError(f'no field `{name}`')
        (_, base, shape), place = places[name]
        return base, shape, block, words, first + place

    def __getattr__(self, name: str) -> Any:
        """Return a field."""
        if name == '_place':
            raise AttributeError(name)
        base, shape, block, words, first = self._field(name)
        if None in shape:
            words, first, shape = block.array(words[first : first + 5 + 2 * len(shape)].tolist())
        if base not in (float, int):
            return _part(base, block, words, first, shape)
        if shape == ():
            return _struct(base).unpack_from(words, 8 * first)[0]
        numbers = words if base is int else words.view(np.float64)
        return numbers[first : first + prod(shape)].reshape(shape)

    def __setattr__(self, name: str, value: Any) -> None:
        """Write a field."""
        base, shape, block, words, first = self._field(name)
        if shape == () and base in (float, int):
            _struct(base).pack_into(words, 8 * first, value)
        elif None in shape:
            block.put(words[first : first + 5 + 2 * len(shape)], base, value)
        elif base in (float, int):
            getattr(self, name)[...] = value
        else:
            _write(getattr(self, name), value)

    def __reduce__(self) -> Any:
        """Return what makes a copy, here or in another process, with arrays of its own."""
        record, block, _, first, _ = self._place
        return _again, (record, block.from_zero(), block.links, first, values_of(self))


class Rows(Sequence[Any]):
    """Records one after the other in memory."""

    def __init__(self, *place: Any) -> None:
        self._place = place

    def __len__(self) -> int:
        return int(self._place[-1][0])

    def __getitem__(self, index: Any) -> Any:
        record, block, words, first, (count, *shape) = self._place
        if not -count <= index < count:
            raise IndexError(index)
        size = len(format_of(record)) * prod(shape)
        return _part(record, block, words, first + index % count * size, tuple(shape))

    def tuples(self) -> Iterator[tuple[Any, ...]]:
        """Yield the numbers of each record."""
        record, _, words, first, shape = self._place
        size = len(format_of(record)) * prod(shape)
        return _struct(record).iter_unpack(words[first : first + size])


def _part(record: Any, block: _Block, words: Ints, first: int, shape: Any) -> Packed | Rows:
    place = record, block, words, first
    return Rows(*place, shape) if shape else Packed(*place)


def _values(part: Any) -> Any:
    """Return a field of a packed record as an object has it."""
    if isinstance(part, Packed):
        return values_of(part)
    if isinstance(part, Rows):
        return [_values(row) for row in part]
    return part.tolist() if isinstance(part, np.ndarray) else part


def _write(part: Packed | Rows, values: Any) -> None:
    """Write all fields of a record, or of some."""
    if isinstance(part, Rows):
        for row, value in zip(part, values, strict=True):
            _write(row, value)
        return
    for name in places_of(class_of(part)):
        setattr(part, name, getattr(values, name))


def _again(record: Any, begun: Ints, links: list[int], first: int, values: Any = None) -> Packed:
    """Return a record in memory that began with some words, and has other values now, if any."""
    block = _Block(begun, links)
    made = Packed(record, block, block.words, first)
    if values is not None:
        _write(made, values)
    return made


def packed(values: Any) -> Packed:
    """Return a record in memory."""
    record: Any = type(values)
    packing = _Packing()
    first = packing.records(record, [values])
    return _again(record, np.frombuffer(packing.data, np.int64), packing.links, first)


def move_together(records: Sequence[Packed]) -> None:
    """Let records stand one after the other in memory: a loop over them is faster."""
    blocks = [record._place[1] for record in records]
    room, end = np.empty(sum(len(block.words) for block in blocks), np.int64), 0
    for record, block in zip(records, blocks, strict=True):
        begin, end = end, end + len(block.words)
        block.move(room[begin:end])
        of, _, _, first, _ = record._place
        record.__init__(of, block, block.words, first)  # type: ignore[misc]


def copied(values: Any) -> Any:
    """Return a record, or lists of records and numbers, with lists of its own."""
    if isinstance(values, list):
        is_flat = not values or isinstance(values[0], (float, int))
        return values[:] if is_flat else [copied(value) for value in values]
    if isinstance(values, (float, int)) or not hasattr(values, '__annotations__'):
        return values
    record: Any = type(values)
    return record(*(copied(getattr(values, name)) for name in places_of(record)))


def begin_again(record: Any, begun: Any) -> None:
    """Write the fields of a record into another one, packed or not."""
    if isinstance(record, Packed):
        block = record._place[1]
        block.words[:] = block.begun
        block.later.clear()
        return
    for name in places_of(class_of(begun)):
        setattr(record, name, copied(getattr(begun, name)))


def rows_of(values: Any, record: Any) -> list[Any]:
    """Return an array of named tuples in a memory as a list of them."""
    return list(values) if isinstance(values, list) else [record(*v) for v in values.tuples()]


def as_rows(table: NDArray[np.float64], record: Any) -> Any:
    """Return a table (n, numbers) as a field takes it that is a list of named tuples of floats."""
    return table if COMPILED else [record(*row) for row in table.tolist()]


@dataclass(slots=True)
class Nothing:
    """The memory of a kernel that has none."""

    unused: int = 0


def prepared(values: Any) -> Any:
    """Return a record as kernels of this process read it: itself, or packed.

    Of one that is packed already it is a copy, which takes a fraction of the time.
    """
    if isinstance(values, Packed):
        record, block, _, first, _ = values._place
        return _again(record, block.from_zero(), block.links, first)
    return packed(values) if COMPILED else values


NOTHING = prepared(Nothing())
"""That memory."""


def values_of(record: Any) -> Any:
    """Return a record, packed or not, as an object with lists."""
    if not isinstance(record, Packed):
        return record
    names = places_of(class_of(record))
    return SimpleNamespace(**{name: _values(getattr(record, name)) for name in names})


def class_of(record: Any) -> Any:
    """Return the class of a record, packed or not."""
    return record._place[0] if isinstance(record, Packed) else type(record)


def address_of(record: Packed) -> int:
    """Return the address of a record in memory that is part of no other."""
    _, block, _, first, _ = record._place
    return block.address + 8 * first
