# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A stage with memory is recomputed where its memory is known, and nowhere else."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from rpo_core.control import controller
from rpo_core.scenario import scenario
from rpo_core.stage import Stage
from rpo_core.wire import interfaces
from rpo_log.verify.recomputation import Controllers, Recomputation


class Sum(Stage):
    """Adds up its last inputs: all, or that of the tick and so many before it."""

    name = 'controller'
    inputs = (interfaces.STATE,)
    outputs = (interfaces.CONTROL_FORCE,)

    def __init__(self, memory_ticks):
        self.memory_ticks = memory_ticks

    def reset(self):
        self.seen = []

    def step(self, tick, *inputs):
        self.seen.append(inputs[0][0])
        count = None if self.memory_ticks is None else self.memory_ticks + 1
        return ((sum(self.seen[-count:] if count else self.seen), 0.0, 0.0),)


class Estimator(Sum):
    """Passes on a state, and no covariance of it, while it is switched off."""

    outputs = (interfaces.NAVIGATION_STATE, interfaces.NAVIGATION_COVARIANCE)


def run(memory_ticks, ticks, missing=(), off=(), began=(), block=4096):
    """Return what is known of a stage whose input is 1 at each tick: tick -> output."""
    found, known = Recomputation(Sum(memory_ticks)), {}
    for begin in range(0, len(ticks), block):
        part = np.array(ticks[begin : begin + block])
        values = np.ones((len(part), 3))
        values[np.isin(part, missing)] = np.nan
        (made,), sure = found.run(part, [values], ~np.isin(part, off), np.isin(part, began))
        known |= {int(t): float(m[0]) for t, m, s in zip(part, made, sure, strict=True) if s}
    return known, found


FULL = {k: k + 1.0 for k in range(10)}
ENDLESS = {**FULL, 4: 0.0, 5: 0.0} | {k: k - 5.0 for k in range(6, 10)}
LOST, HOLE = dict(missing=(4,)), dict(ticks=[0, 1, 2, 3, 5, 6, 7, 8, 9])


@pytest.mark.parametrize(
    ('memory', 'flight', 'known', 'gaps'),
    [
        (None, {}, FULL, (0, -1)),
        (2, {}, {k: min(k + 1.0, 3.0) for k in range(10)}, (0, -1)),
        *((2, gap, {0: 1.0, 1: 2.0} | dict.fromkeys((2, 3, 7, 8, 9), 3.0), (2, 5))
          for gap in (LOST, HOLE)),
        (None, LOST, {k: FULL[k] for k in range(4)}, (5, 5)),
        (0, LOST, dict.fromkeys((0, 1, 2, 3, 5, 6, 7, 8, 9), 1.0), (0, -1)),
        (2, dict(ticks=range(5, 10)), {7: 3.0, 8: 3.0, 9: 3.0}, (2, 5)),
        (None, dict(off=(4, 5)), ENDLESS, (0, -1)),
        (None, dict(began=[4]), {k: k + 1.0 if k < 4 else k - 3.0 for k in range(10)}, (0, -1)),
    ],
    ids=['all', 'window', 'lost, window', 'hole, window', 'lost, endless', 'lost, no memory',
         'late', 'switched off', 'began in flight'],
)  # fmt: skip
@pytest.mark.parametrize('block', [4096, 3, 1])
def test_it_is_known_where_its_memory_is_full(memory, flight, known, gaps, block):
    values, found = run(memory, **{'ticks': range(10), **flight}, block=block)
    assert values == known
    assert (found.gaps, found.first_gap) == gaps


def test_switched_off_what_it_passes_on_is_known_where_all_of_it_was_there():
    ticks, states = np.arange(4), np.ones((4, 6))
    states[1], states[2, 5] = np.nan, np.nan
    off = np.zeros(4, dtype=bool)
    (made, none), known = Recomputation(Estimator(None)).run(ticks, [states], off, off)
    assert known.tolist() == [True, False, False, True]
    assert (made[known] == 1.0).all() and not none[known].any()


def test_a_command_is_of_the_controller_that_made_the_one_before_where_two_would_make_it():
    """Ticks made by: the first; the second; both; the first; none; the first, switched off."""
    flown = scenario.load_scenario('paper_test')
    first, second = (controller.load_controller(name) for name in ('handmade', 'lqr'))
    attached = {'controller-1.yaml': controller.dumps(second).encode(), 'other.yaml': b''}
    reader = SimpleNamespace(path='a.mcap', attachments=attached)
    made = np.array([[0, 1, 2, 3, 4.0, 5], [0, 9, 2, 3, 9, 5], [9, 1, 2, 9, 9, 9]])[:, :, None]
    ticks = np.arange(6)
    found = Controllers(reader, flown, first)
    found.find()
    commands = [(made[1], ticks != 1), (made[2], ticks < 4)]
    best, known = found.merged(made[0], ticks < 5, commands)
    assert best[:, 0].tolist() == [0, 1, 2, 3, 9, 5] and known.all()
    assert found.shares == tuple(
        f'{name} ({file}) at 2 ticks'
        for name, file in ((first.name, 'controller.yaml'), (second.name, 'controller-1.yaml'))
    )
