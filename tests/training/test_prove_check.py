# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The checker of proofs finds errors that are planted; tubes hold very many flights."""

from __future__ import annotations

import copy
from dataclasses import replace

import numpy as np
import pytest
from proofs import problem_of, small_proof

from rpo_training.proof import cells, check, flights, tube
from rpo_training.proof.claims import nowhere
from rpo_training.proof.problem import GROUPS

KINDS = ('row', 'boxes', 'cell', 'gap', 'claim', 'law', 'rounding', 'set', 'boxed', 'rest', 'table')


class Bench:
    """A sound proof, and its parts as the checker takes them."""

    def __init__(self, folder):
        self.folder, self.problem = folder, folder.problem
        self.summary = folder.summary()
        self.groups = {group: folder.cells(group) for group in GROUPS}
        self.rest = check.rest_of_summary(self.summary)

    def prover(self, group):
        above = self.groups['vertical'].tail if group == 'planar' else None
        return cells.Prover(self.problem, group, self.rest, above)

    def tick(self, rng):
        """Return a prover, a tick of a tube before and after, and after small ones are boxed."""
        prover = self.prover('planar')
        found = self.groups['planar']
        k = int(rng.integers(len(found.values)))
        c, g, d, m = prover.start(cells.Cell(tuple(found.centre[k]), tuple(found.half[k])))
        kept, number = m, 0
        boxing = False
        last = int(rng.integers(20, 120))
        while number < last or not boxing:
            before, after, m = check.stepped(self.problem, prover.motion, number, c, g, d, m)
            m = tube.tidy(number, g, d, kept, m)
            boxing = m < after.g.shape[1]
            number += 1
        tidied = replace(after, g=g[:, :m].copy(), d=d.copy())
        return prover, before, after, tidied, kept

    def faults(self, kind, rng):
        """Plant an error of a kind; return what the checker says."""
        return list(getattr(self, kind)(rng))

    def _rows(self, rng, change):
        group = ('planar', 'vertical')[int(rng.integers(2))]
        found = copy.deepcopy(self.groups[group])
        change(found, int(rng.integers(len(found.values))))
        every = check.Sample(starts=0, ticks=0)
        return check.tube_faults(self.prover(group), found, rng, every, lambda *_: None)

    def row(self, rng):
        def change(found, k):
            found.values[k, int(rng.integers(3, len(cells.VALUES) - 2))] *= 1.0 - 1e-9

        return self._rows(rng, change)

    def boxes(self, rng):
        def change(found, k):
            moment = int(rng.integers(found.boxes.shape[1]))
            found.boxes[k, moment, 1] -= 1e-9

        return self._rows(rng, change)

    def cell(self, rng):
        def change(found, k):
            found.centre[k] += 1e-6

        return self._rows(rng, change)

    def gap(self, rng):
        group = ('planar', 'vertical')[int(rng.integers(2))]
        found = copy.deepcopy(self.groups[group])
        found.half[int(rng.integers(len(found.half))), 0] *= 1.0 - 10.0 ** -rng.uniform(2.0, 9.0)
        return check.cover_faults(self.problem, group, found)

    def claim(self, rng):
        summary = copy.deepcopy(self.summary)
        key = sorted(summary['claims'])[int(rng.integers(len(summary['claims'])))]
        summary['claims'][key]['bound'] *= 1.0 - 10.0 ** -rng.uniform(1.0, 9.0)
        return check.claim_faults(self.problem, self.groups, summary)

    def law(self, rng):
        """A slope that is wrong by 5 % of the stiffest, or a residual of half the size."""
        _, before, _, _, _ = self.tick(rng)
        axis, column = int(rng.integers(2)), (0, 1, 2, 3)[int(rng.integers(4))]
        wrong = before.laws.copy()
        if column == 3:
            wrong[axis, 3] *= 0.5
        else:
            wrong[axis, column] += (0.02, 0.3, 0.01)[column] * rng.choice([-1.0, 1.0])
        return check.law_faults(self.problem, replace(before, laws=wrong), 'planted')

    def rounding(self, rng):
        """Nothing is widened for rounding."""
        prover, before, after, _, _ = self.tick(rng)
        wrong = replace(after, d=before.d.copy() * 0.0)
        return check.step_faults(prover.motion, before, wrong, 'planted')

    def set(self, rng):
        """A number of the next set is off by a millionth of a millimetre."""
        prover, before, after, _, _ = self.tick(rng)
        g, c = after.g.copy(), after.c.copy()
        row = int(rng.integers(4))
        if rng.random() < 0.5:
            g[row, int(rng.integers(g.shape[1]))] += 1e-9
        else:
            c[row] -= 1e-9
        return check.step_faults(prover.motion, before, replace(after, g=g, c=c), 'planted')

    def boxed(self, rng):
        """The box of small generators is a little too small."""
        _, _, after, tidied, kept = self.tick(rng)
        g = tidied.g.copy()
        g[:, -4:] *= 1.0 - 1e-9
        return check.tidy_faults(after, replace(tidied, g=g), kept, 'planted')

    def rest_set(self, rng):
        share = rng.uniform(0.01, 0.1)
        return check.rest_faults(self.problem, self.rest._replace(speed_m_s=share * 1e-3))

    def table(self, rng):
        table = self.problem.table
        name = ('u', 'bend', 'slopes')[int(rng.integers(3))]
        values = getattr(table, name).copy()
        values.flat[int(rng.integers(values.size))] += 1e-9
        wrong = table._replace(**{name: values})
        return check.surface_faults(self.problem, wrong, rng, 0)


@pytest.fixture(scope='module')
def bench(tmp_path_factory):
    return Bench(small_proof(tmp_path_factory.mktemp('proof') / 'proof'))


def planted(bench, count):
    """Plant errors of all kinds in turn; return those that were not found."""
    missed = []
    for number in range(count):
        kind = KINDS[number % len(KINDS)]
        rng = np.random.default_rng(number)
        if not bench.faults('rest_set' if kind == 'rest' else kind, rng):
            missed.append((number, kind))
    return missed


def test_a_sound_tick_has_no_faults(bench):
    for seed in range(3):
        prover, before, after, tidied, kept = bench.tick(np.random.default_rng(seed))
        assert not list(check.law_faults(bench.problem, before, ''))
        assert not list(check.step_faults(prover.motion, before, after, ''))
        assert not list(check.tidy_faults(after, tidied, kept, ''))
    assert not list(check.rest_faults(bench.problem, bench.rest))


def test_planted_errors_are_found(bench):
    assert planted(bench, 2 * len(KINDS)) == []


@pytest.mark.slow
def test_a_hundred_planted_errors_are_found(bench):
    assert planted(bench, 100) == []


@pytest.mark.slow
def test_tubes_hold_ten_thousand_flights():
    """From random starts of random cells of the box of 40 m; states of every tick."""
    problem = problem_of('robust', half=(40.0, 40.0, 40.0, 0.0, 0.0, 0.0))
    rng, flown = np.random.default_rng(7), 0
    zeros = np.zeros((problem.scenario.ticks + 1, 3))
    states, forces = np.zeros((len(zeros), 6)), np.zeros_like(zeros)
    for group, chosen in GROUPS.items():
        prover = cells.Prover(problem, group, nowhere(problem))
        some = cells.roots(problem, group)
        for k in rng.permutation(len(some))[:25].tolist():
            last, _ = prover.fly(some[k])
            end = min(last, problem.scenario.ticks) + 1
            for _ in range(200):
                states[0] = 0.0
                share = rng.uniform(-1.0, 1.0, len(chosen))
                states[0, list(chosen)] = np.array(some[k].centre) + np.array(some[k].half) * share
                flights.fly(
                    problem.controller.scales,
                    problem.controller.system.tables,
                    problem.scenario.max_force_n,
                    problem.scenario.step,
                    zeros,
                    states,
                    forces,
                )
                seen = states[:end, list(chosen)]
                assert (prover.trace.low[:end] <= seen).all()
                assert (seen <= prover.trace.high[:end]).all()
                flown += 1
    assert flown == 10_000
