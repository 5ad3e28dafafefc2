# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Records in memory as compiled kernels read them: read, written, copied and reset."""

from __future__ import annotations

import copy
from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np
import pytest

from rpo_core.kernels.arrays import contracted
from rpo_core.kernels.records import Packed, fields_of, rows_of


class Place(NamedTuple):
    x: float
    y: float


class Event(NamedTuple):
    tick: int
    size: float


@dataclass(slots=True)
class Inner:
    number: int
    ticks: list[int]
    places: list[Place]
    two: Annotated[list[Place], 2]


@dataclass(slots=True)
class Outer:
    value: float
    three: Annotated[list[float], 3]
    rows: list[list[float]]
    inner: Inner
    others: list[Inner]
    events: list[Event]


def inner():
    return Inner(3, [1, 2], [Place(1.0, 2.0)], [Place(0.0, 1.0), Place(3.0, 4.0)])


@pytest.fixture
def packed():
    return Packed(Outer(1.0, [1.0, 2.0, 3.0], [[1.0, 2.0]], inner(), [inner(), inner()], []))


def write(packed):
    packed.value, packed.three[1] = 5.0, 7.0
    packed.inner.number, packed.inner.ticks = 8, [1, 2, 3, 4]
    packed.inner.places[0].x, packed.inner.two[1].y = 9.0, 6.0
    packed.others[1].number, packed.rows = 77, [[3.0, 4.0], [5.0, 6.0]]
    packed.events = [*rows_of(packed.events, Event), Event(2, 0.5)]


def read(packed):
    part = packed.inner
    return (
        packed.value, packed.three.tolist(), packed.rows.tolist(), part.number,
        part.ticks.tolist(), part.places[0].x, part.two[1].y, packed.others[1].number,
        rows_of(packed.events, Event),
    )  # fmt: skip


BEGUN = (1.0, [1.0, 2.0, 3.0], [[1.0, 2.0]], 3, [1, 2], 1.0, 4.0, 3, [])
WRITTEN = (
    5.0, [1.0, 7.0, 3.0], [[3.0, 4.0], [5.0, 6.0]], 8, [1, 2, 3, 4], 9.0, 6.0, 77, [Event(2, 0.5)],
)  # fmt: skip


def test_what_is_written_is_read_and_reset(packed):
    assert read(packed) == BEGUN
    for _ in range(2):
        write(packed)
        assert read(packed) == WRITTEN
        packed.reset()
        assert read(packed) == BEGUN


def test_a_copy_has_arrays_of_its_own(packed):
    write(packed)
    other = copy.deepcopy(packed)
    packed.reset()
    assert (read(packed), read(other)) == (BEGUN, WRITTEN)
    write(packed)
    other.reset()
    assert (read(packed), read(other)) == (WRITTEN, BEGUN)


def test_an_array_that_grows_again_and_again_is_kept_once(packed):
    kept = len(packed._arrays)
    for count in range(1, 100):
        packed.inner.ticks = list(range(count))
    assert len(packed._arrays) <= kept + 1
    np.testing.assert_array_equal(packed.inner.ticks, np.arange(99))


@pytest.mark.parametrize('name', ['numbers', 'reset'])
def test_a_field_has_no_name_that_packed_records_have(name):
    record = type('Wrong', (), {'__annotations__': {name: 'float'}})
    with pytest.raises(TypeError, match=f'field `{name}` of Wrong needs another name'):
        fields_of(record)


def test_a_sum_over_an_axis_of_no_length_is_zero_whatever_lies_in_memory():
    foreign = np.full(100, np.nan)
    empty = np.lib.stride_tricks.as_strided(foreign, (5, 0, 2), np.zeros((5, 0, 2)).strides)
    np.testing.assert_array_equal(contracted('kji,j->ki', empty, foreign[:0]), np.zeros((5, 2)))
