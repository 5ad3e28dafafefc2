# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Records in memory as compiled kernels read them: read, written, copied and reset."""

from __future__ import annotations

import copy
from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np
import pytest

from rpo_core.assurance.shaping import Shaping
from rpo_core.kernels.arrays import contracted
from rpo_core.kernels.records import (
    address_of,
    begin_again,
    copied,
    fields_of,
    move_together,
    rows_of,
    values_of,
)
from rpo_core.kernels.records import packed as in_memory


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
    grid: list[list[Place]]


def inner():
    return Inner(3, [1, 2], [Place(1.0, 2.0)], [Place(0.0, 1.0), Place(3.0, 4.0)])


def outer():
    grid = [[Place(float(i), float(j)) for j in range(3)] for i in range(2)]
    return Outer(1.0, [1.0, 2.0, 3.0], [[1.0, 2.0]], inner(), [inner(), inner()], [], grid)


@pytest.fixture
def packed():
    return in_memory(outer())


def write(packed):
    packed.value, packed.three[1] = 5.0, 7.0
    packed.inner.number, packed.inner.ticks = 8, [1, 2, 3, 4]
    packed.inner.places[0].x, packed.inner.two[1].y = 9.0, 6.0
    packed.others[0].ticks, packed.grid[1][2].y = [5], 8.0
    packed.others[1].number, packed.rows = 77, [[3.0, 4.0], [5.0, 6.0]]
    packed.events = [*rows_of(packed.events, Event), Event(2, 0.5)]


def read(packed):
    part = packed.inner
    return (
        packed.value, packed.three.tolist(), packed.rows.tolist(), part.number,
        part.ticks.tolist(), part.places[0].x, part.two[1].y, packed.others[1].number,
        rows_of(packed.events, Event), packed.others[0].ticks.tolist(), packed.grid[1][-1].y,
    )  # fmt: skip


BEGUN = (1.0, [1.0, 2.0, 3.0], [[1.0, 2.0]], 3, [1, 2], 1.0, 4.0, 3, [], [1, 2], 2.0)
WRITTEN = (
    5.0, [1.0, 7.0, 3.0], [[3.0, 4.0], [5.0, 6.0]], 8, [1, 2, 3, 4], 9.0, 6.0, 77, [Event(2, 0.5)],
    [5], 8.0,
)  # fmt: skip


def test_what_is_written_is_read_and_reset(packed):
    assert read(packed) == BEGUN
    for _ in range(2):
        write(packed)
        assert read(packed) == WRITTEN
        begin_again(packed, None)
        assert read(packed) == BEGUN


def test_a_copy_has_arrays_of_its_own(packed):
    write(packed)
    other = copy.deepcopy(packed)
    begin_again(packed, None)
    assert (read(packed), read(other)) == (BEGUN, WRITTEN)
    write(packed)
    begin_again(other, None)
    assert (read(packed), read(other)) == (WRITTEN, BEGUN)


def test_an_array_that_grows_again_and_again_is_kept_once(packed):
    for count in range(1, 100):
        packed.inner.ticks = list(range(count))
    assert len(packed._place[1].later) == 1
    np.testing.assert_array_equal(packed.inner.ticks, np.arange(99))


def test_a_field_begins_with_a_letter():
    record = type('Wrong', (), {'__annotations__': {'_place': 'float'}})
    with pytest.raises(TypeError, match='field `_place` of Wrong must begin with a letter'):
        fields_of(record)


def test_a_record_begins_again_without_what_was_written():
    record, begun = outer(), outer()
    before = record, copied(record)
    record.value, record.three[1], record.others[0].ticks[0] = 5.0, 7.0, 9
    record.inner.ticks.append(3)
    begin_again(record, begun)
    assert record == begun == before[1] and record is before[0]
    record.grid[0].clear()
    assert begun == before[1]


def test_records_stand_together_with_what_was_written(packed):
    other = in_memory(outer())
    write(packed)
    move_together([other, packed])
    assert address_of(packed) - address_of(other) == 8 * len(other._place[1].words)
    assert (read(other), read(packed)) == (BEGUN, WRITTEN)
    begin_again(packed, None)
    write(other)
    assert (read(other), read(packed)) == (WRITTEN, BEGUN)


def test_checked_settings_are_a_record():
    settings = Shaping(slew_n_s=0.4)
    assert vars(values_of(in_memory(settings))) == {'slew_n_s': 0.4, 'dead_zone_n': 0.0}


def test_a_sum_over_an_axis_of_no_length_is_zero_whatever_lies_in_memory():
    foreign = np.full(100, np.nan)
    empty = np.lib.stride_tricks.as_strided(foreign, (5, 0, 2), np.zeros((5, 0, 2)).strides)
    np.testing.assert_array_equal(contracted('kji,j->ki', empty, foreign[:0]), np.zeros((5, 2)))
