# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Numbers with names, for kernels: the settings `p` and the memory `m` of a stage.

A record is a slotted dataclass, or a named tuple, whose fields are

    float, int                          one number
    Annotated[list[float], 9, 9]        as many as it says, of float, int or another record
    list[float], list[list[float]]      any number; also list[int], list[Other]
    Other                               the numbers of another record

Interpreted, a kernel reads the object itself, with nested lists. Compiled, it reads the same fields
of a block of memory (`Packed`): fields one after the other, as in a C struct; where the length is
not fixed, what numba keeps of an array (its address and its shape). So kernels index `a[i][j]`, and
take no slices.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import chain
from math import prod
from struct import Struct
from types import SimpleNamespace
from typing import Annotated, Any, NamedTuple, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

from rpo_core.kernels.jit import COMPILED


class Field(NamedTuple):
    """A field of a record.

    base : float, int or the class of another record
    shape : () for one; None in the place of a length that is not fixed
    is_fixed : whether its numbers stand in the record itself
    """

    name: str
    base: Any
    shape: tuple[int | None, ...]
    is_fixed: bool


@cache
def fields_of(record: Any) -> tuple[Field, ...]:
    """Return the fields of a record; TypeError where one is none of the allowed."""
    for name in record.__annotations__:
        if name in ('record', 'numbers') or hasattr(Packed, name):
            raise TypeError(
                f'field `{name}` of {record.__name__} needs another name: `Packed` has it'
            )
    return tuple(
        _field(record, name, hint)
        for name, hint in get_type_hints(record, include_extras=True).items()
    )


def _field(record: type[Any], name: str, hint: Any) -> Field:
    sizes: tuple[int | None, ...] | None = None
    if get_origin(hint) is Annotated:
        hint, *given = get_args(hint)
        sizes = tuple(given)
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
    return Field(name, hint, shape, None not in shape)


@cache
def layout(record: Any) -> Any:
    """Return a record as NumPy has it: the fields one after the other, aligned as in C."""
    formats: list[Any] = []
    for field in fields_of(record):
        if field.is_fixed:
            formats.append((field.name, _base(field.base), field.shape))
        else:
            formats.append((field.name, np.int64, (5 + 2 * len(field.shape),)))
    return np.dtype(formats, align=True)


def _base(base: Any) -> Any:
    if base in (float, int):
        return np.dtype(np.float64 if base is float else np.int64)
    return layout(base)


class Packed:
    """Records of one class in memory, as compiled kernels read them.

    numbers : (n,) of `layout`

    A field of the first record is read and written as that of the object is (`packed.lost = 1`): a
    number; an array, whose items can be written; another record.
    """

    def __init__(self, values: Any, number: int = 1) -> None:
        self.record = class_of(values)
        self._arrays: list[NDArray[Any]] = []  # the record holds their addresses
        self._bases: list[Any] = []
        self._begun: list[NDArray[Any]] = []
        room = np.zeros(number * layout(self.record).itemsize // 8, np.int64)
        self.numbers = room.view(layout(self.record))
        self._pack(self.numbers, self.record, [values])
        if number > 1:
            rows = room.reshape(number, -1)
            rows[1:] = rows[0]
        self._begun = [_words(array).copy() for array in (self.numbers, *self._arrays)]

    def address(self, index: int = 0) -> int:
        """Return the address of a record."""
        return int(self.numbers.ctypes.data) + index * self.numbers.itemsize

    def reset(self) -> None:
        """Write again what it began with."""
        del self._arrays[len(self._begun) - 1 :], self._bases[len(self._begun) - 1 :]
        for array, begun in zip((self.numbers, *self._arrays), self._begun, strict=True):
            _words(array)[...] = begun

    def values(self) -> Any:
        """Return the first record as an object with lists."""
        return self._values(self.record, self.numbers[0])

    def _values(self, record: Any, place: Any) -> Any:
        values = {}
        for field in fields_of(record):
            array = np.asarray(place[field.name])
            array = array if field.is_fixed else self._at(array)
            values[field.name] = self._list(field.base, array)
        return SimpleNamespace(**values)

    def _list(self, base: Any, array: Any) -> Any:
        if base in (float, int):
            return array.tolist()
        if array.ndim:
            return [self._list(base, np.asarray(part)) for part in array]
        return self._values(base, array)

    def put(self, name: str, values: Any) -> None:
        """Write a field anew, of any length."""
        field = _field_of(self.record, name)
        if not field.is_fixed:
            link = self.numbers[0][name]
            array = self._array(field, values)
            if link[4] and tuple(link[5 : 5 + array.ndim]) == array.shape:
                self._at(link)[...] = array
                return
            if link[4]:
                self._release(link[4])
            self.numbers[name][0] = self._kept(field, array)
            return
        numbers: list[float] = []
        self._add(field, values, numbers)
        place = layout(self.record).fields[name][1]
        _packer(_format(field)).pack_into(self.numbers[:1].data, place, *numbers)

    def __getattr__(self, name: str) -> Any:
        """Return a field of the first record."""
        if name.startswith('_') or name not in (self.numbers.dtype.names or ()):
            raise AttributeError(name)
        field, value = _field_of(self.record, name), self.numbers[0][name]
        if not field.is_fixed:
            value = self._at(value)
        elif field.shape == ():
            return value.item() if field.base in (float, int) else self._part(field)
        return value if field.base in (float, int) else value.view(np.recarray)

    def __setattr__(self, name: str, value: Any) -> None:
        """Write a field of the first record."""
        if 'numbers' in self.__dict__ and name in (self.numbers.dtype.names or ()):
            self.put(name, value)
        else:
            object.__setattr__(self, name, value)

    def __deepcopy__(self, memo: Any) -> Packed:
        """Return a copy with arrays of its own."""
        other = object.__new__(Packed)
        other.__dict__ |= self.__dict__
        other._bases, other._begun = list(self._bases), [array.copy() for array in self._begun]
        other._move(np.copy)
        return other

    def _move(self, copied: Callable[[Any], Any]) -> None:
        """Take other memory, for copies of the numbers and of all arrays."""
        former = [array.ctypes.data for array in self._arrays]
        self.numbers, self._arrays = copied(self.numbers), list(map(copied, self._arrays))
        places = dict(zip(former, (array.ctypes.data for array in self._arrays), strict=True))
        bases = self.record, *self._bases
        for arrays in ((self.numbers, *self._arrays), self._begun):
            for array, base in zip(arrays, bases, strict=False):
                for link in _links(array, base):
                    link[4] = places[link[4]]

    def _at(self, link: Any) -> NDArray[Any]:
        """Return the array that a field points to."""
        return next(a for a in self._arrays if a.ctypes.data == link[4])

    def _part(self, field: Field) -> Packed:
        """Return a record that is a field; it has the same memory."""
        part = object.__new__(Packed)
        part.record, part.numbers = field.base, self.numbers[field.name]
        part._arrays, part._bases, part._begun = self._arrays, self._bases, self._begun
        return part

    def _pack(self, array: NDArray[Any], record: Any, values: Any) -> None:
        """Write records into an array of such."""
        packer = _packer(_formats(record))
        for i, value in enumerate(values):
            numbers: list[float] = []
            for field in fields_of(record):
                self._add(field, getattr(value, field.name), numbers)
            packer.pack_into(array.data, i * packer.size, *numbers)

    def _add(self, field: Field, values: Any, numbers: list[float]) -> None:
        """Add the numbers of a field, which may be an array that is kept, to those of a record."""
        base, shape = field.base, field.shape
        if not field.is_fixed:
            numbers += self._kept(field, self._array(field, values))
        elif base in (float, int):
            if shape == ():
                numbers.append(base(values))
                return
            flat = _flat(values, len(shape))
            numbers += flat if base is float else map(int, flat)
        else:
            for value in values if shape else (values,):
                if isinstance(value, tuple) and _are_floats(base):
                    numbers += value
                    continue
                for inner in fields_of(base):
                    self._add(inner, getattr(value, inner.name), numbers)

    def _kept(self, field: Field, array: NDArray[Any]) -> tuple[int, ...]:
        """Keep an array; return what points to it."""
        self._arrays.append(array)
        self._bases.append(field.base)
        shape = *array.shape, *array.strides
        return (0, 0, array.size, array.itemsize, array.ctypes.data, *shape)

    def _release(self, address: int) -> None:
        """Forget an array that `put` made, and nobody else has."""
        for i in range(max(len(self._begun) - 1, 0), len(self._arrays)):
            if self._arrays[i].ctypes.data == address:
                del self._arrays[i], self._bases[i]
                break

    def _array(self, field: Field, values: Any) -> NDArray[Any]:
        if field.base in (float, int):
            array = np.array(values, _base(field.base), order='C')
            return array if array.size else array.reshape((0,) * len(field.shape))
        if len(values) and isinstance(values[0], (tuple, np.ndarray)) and _are_floats(field.base):
            return np.array(values, np.float64).view(layout(field.base)).ravel()
        array = np.zeros(len(values), layout(field.base))
        self._pack(array, field.base, values)
        return array


def move_together(records: Sequence[Packed]) -> None:
    """Let records stand one after the other in memory: a loop over them is faster."""
    arrays = [array for record in records for array in (record.numbers, *record._arrays)]
    room, end = np.empty(sum(array.nbytes for array in arrays) // 8), 0

    def copied(array: NDArray[Any]) -> NDArray[Any]:
        nonlocal end
        first, end = end, end + array.nbytes // 8
        copy = room[first:end].view(array.dtype).reshape(array.shape)
        copy[...] = array
        return copy

    for record in records:
        record._move(copied)


def _field_of(record: Any, name: str) -> Field:
    return next(field for field in fields_of(record) if field.name == name)


def _words(array: NDArray[Any]) -> NDArray[np.int64]:
    """Return the same memory by eight bytes: NumPy copies records field by field."""
    return array.view(np.int64)


def _flat(values: Any, depth: int) -> Any:
    """Return nested lists of numbers, or an array, as one row."""
    if isinstance(values, np.ndarray):
        return values.ravel().tolist()
    for _ in range(depth - 1):
        values = chain.from_iterable(values)
    return values


@cache
def _formats(record: Any) -> str:
    """Return a record as `struct` has it: eight bytes a number."""
    return ''.join(map(_format, fields_of(record)))


@cache
def _format(field: Field) -> str:
    if not field.is_fixed:
        return f'{5 + 2 * len(field.shape)}q'
    count = prod(size for size in field.shape if size is not None)
    if field.base in (float, int):
        return f'{count}{"d" if field.base is float else "q"}'
    return count * _formats(field.base)


@cache
def _packer(formats: str) -> Struct:
    return Struct(f'={formats}')


@cache
def _are_floats(record: Any) -> bool:
    """Return whether a record is a row of floats."""
    return all(field.base is float and field.shape == () for field in fields_of(record))


def _links(array: NDArray[Any], record: Any) -> Iterator[Any]:
    """Yield the addresses and shapes of arrays that records hold, to be written."""
    if record not in (float, int) and array.dtype == np.int64:
        array = array.view(layout(record))
    for field in fields_of(record) if record not in (float, int) else ():
        if not field.is_fixed:
            yield from array[field.name].reshape(-1, 5 + 2 * len(field.shape))
        elif field.base not in (float, int):
            yield from _links(array[field.name], field.base)


def rows_of(values: Any, record: Any) -> list[Any]:
    """Return an array of named tuples in a memory as a list of them."""
    return list(values) if isinstance(values, list) else [record(*v) for v in values.tolist()]


def as_rows(table: NDArray[np.float64], record: Any) -> Any:
    """Return a table (n, numbers) as a field takes it that is a list of named tuples of floats."""
    return table if COMPILED else [record(*row) for row in table.tolist()]


@dataclass(slots=True)
class Nothing:
    """The memory of a kernel that has none."""

    unused: int = 0


def prepared(values: Any) -> Any:
    """Return a record as kernels of this process read it: itself, or packed."""
    return Packed(values) if COMPILED else values


def values_of(record: Any) -> Any:
    """Return a record, packed or not, as an object with lists."""
    return record.values() if isinstance(record, Packed) else record


def class_of(record: Any) -> Any:
    """Return the class of a record, packed or not."""
    return record.record if isinstance(record, Packed) else type(record)
