# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The checker of proofs finds errors that are planted; tubes hold their flights."""

from __future__ import annotations

import copy
from dataclasses import replace
from fractions import Fraction
from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest
from landing import rest_at_landing
from scipy.interpolate import RegularGridInterpolator

from rpo.proof import cells, check, check_sets, tube
from rpo.proof.cells import Prover
from rpo.proof.check import WrittenSummary, recompute
from rpo.proof.check_sets import ExactStrip, exact, law_holds, output
from rpo.proof.enclosure import Law
from rpo.proof.problem import GROUPS
from rpo_core.world.disturbance import Disturbance, Harmonic

KINDS = ('row', 'boxes', 'cell', 'gap', 'claim', 'law', 'rounding', 'set', 'boxed', 'rest', 'table')


class Bench:
    """A sound proof, and its parts as the checker takes them."""

    def __init__(self, folder):
        self.folder, self.problem = folder, folder.problem
        self.summary = folder.summary()
        self.groups = {group: folder.cells(group) for group in GROUPS}
        self.written = WrittenSummary.of(folder)
        self.rest = self.written.omega

    def prover(self, group):
        above = self.groups['vertical'].tail if group == 'planar' else None
        return Prover(self.problem, group, self.rest, above)

    def tick(self, rng):
        """Return a prover, a tick of a tube before and after, and after small ones are boxed."""
        prover = self.prover('planar')
        found = self.groups['planar']
        k = int(rng.integers(len(found.values)))
        z, m = prover.start(cells.Cell(tuple(found.centre[k]), tuple(found.half[k])))
        kept, number = m, 0
        boxing = False
        last = int(rng.integers(20, 120))
        while number < last or not boxing:
            before, after, m = check_sets.stepped(self.problem, prover.motion, number, z, m)
            m = tube.tidy(number, z, kept, m)
            boxing = m < after.g.shape[1]
            number += 1
        tidied = replace(after, g=z.g[:, :m].copy(), d=z.d.copy())
        return prover, before, after, tidied, kept

    def finds(self, kind, rng):
        """Plant an error of a kind; return whether the checker says anything."""
        return any(getattr(self, kind)(rng))

    def _rows(self, rng, change):
        group = ('planar', 'vertical')[int(rng.integers(2))]
        found = copy.deepcopy(self.groups[group])
        change(found, int(rng.integers(len(found.values))))
        every = check.Sample(starts=0, ticks=0)
        return check.tube_faults(self.prover(group), found, rng, every, lambda *_: None)

    def row(self, rng):
        def change(found, k):
            known = np.flatnonzero(np.isfinite(found.values[k]) & (found.values[k] > 0.0))
            found.values[k, int(rng.choice(known[known >= 3]))] *= 1.0 - 1e-9

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
        written = replace(self.written, document=summary)
        return recompute(self.problem, self.groups, written, written.flown).faults

    def law(self, rng):
        """A number of a law that is wrong: the kernel's force contradicts it in the set."""
        while True:
            _, before, _, _, _ = self.tick(rng)
            axis, wrong = int(rng.integers(2)), before.laws.copy()
            column = int(rng.integers(4))
            wrong[axis, column] *= 1.0 + rng.uniform(-0.6, -0.1)
            xi = rng.choice([-1.0, 1.0], (before.g.shape[1], 500))
            r, v = (before.c[i] + before.g[i] @ xi for i in (axis, 2 + axis))
            force = [
                self.problem.controller.force_n([a] * 3, [b] * 3)[0]
                for a, b in zip(r, v, strict=True)
            ]
            k_r, k_v, k_0, rho = wrong[axis, :4]
            if (np.abs(force - k_r * r - k_v * v - k_0) > rho).any():
                return check_sets.law_faults(self.problem, replace(before, laws=wrong), 'planted')

    def rounding(self, rng):
        """Nothing is widened for rounding."""
        prover, before, after, _, _ = self.tick(rng)
        wrong = replace(after, d=before.d.copy() * 0.0)
        return check_sets.step_faults(prover.motion, before, wrong, 'planted')

    def set(self, rng):
        """A number of the next set is off by a millionth of a millimetre."""
        prover, before, after, _, _ = self.tick(rng)
        g, c = after.g.copy(), after.c.copy()
        row = int(rng.integers(4))
        if rng.random() < 0.5:
            g[row, int(rng.integers(g.shape[1]))] += 1e-9
        else:
            c[row] -= 1e-9
        return check_sets.step_faults(prover.motion, before, replace(after, g=g, c=c), 'planted')

    def boxed(self, rng):
        """The box of small generators is a little too small."""
        _, _, after, tidied, kept = self.tick(rng)
        g = tidied.g.copy()
        g[:, -4:] *= 1.0 - 1e-9
        return check_sets.tidy_faults(after, replace(tidied, g=g), kept, 'planted')

    def rest_set(self, rng):
        share = rng.uniform(0.01, 0.1)
        return check.invariant_faults(self.problem, self.rest._replace(speed_m_s=share * 1e-3))

    def table(self, rng):
        arrays = self.folder.table()
        values = arrays[str(rng.choice(['u', 'bend', 'slopes', 'part_range', 'part_slopes']))]
        values.flat[int(rng.integers(values.size))] += 1e-9
        return check_sets.table_faults(self.problem, arrays)


@pytest.fixture(scope='module')
def bench(sound):
    return Bench(sound)


def test_a_sound_tick_has_no_faults(bench):
    for seed in range(2):
        prover, before, after, tidied, kept = bench.tick(np.random.default_rng(seed))
        assert not list(check_sets.law_faults(bench.problem, before, ''))
        assert not list(check_sets.step_faults(prover.motion, before, after, ''))
        assert not list(check_sets.tidy_faults(after, tidied, kept, ''))
    assert not list(check.invariant_faults(bench.problem, bench.rest))


@pytest.mark.parametrize('kind', rest_at_landing(KINDS, quick=8))
@pytest.mark.parametrize('count', [1, pytest.param(10, marks=pytest.mark.slow)])
def test_planted_errors_are_found(bench, kind, count):
    found = 'rest_set' if kind == 'rest' else kind
    assert all(bench.finds(found, np.random.default_rng(seed)) for seed in range(count))


def test_planted_errors_of_the_surface_are_found(bench):
    """Each array of the table in turn, a little wrong everywhere."""
    table, rng = bench.problem.table, np.random.default_rng(1)
    assert not list(check_sets.surface_faults(bench.problem, rng, 1))
    inward = 0.1 * np.array([1.0, -1.0, 1.0, -1.0])
    for wrong, said in (
        ({'u': table.u + 1e-6}, 'the value at'),
        ({'bend': 0.0 * table.bend - 1e-9}, 'the bend at'),
        ({'slopes': table.slopes[..., [1, 0, 3, 2]] + inward}, 'a slope at'),
        ({'part_range': table.part_range[..., ::-1] + inward[:2]}, 'the range of a part'),
        ({'part_slopes': table.part_slopes[..., [1, 0, 3, 2]] + inward}, 'a slope of a part'),
    ):
        problem = replace(bench.problem)
        problem.__dict__['table'] = table._replace(**wrong)
        found = list(check_sets.surface_faults(problem, rng, 2))
        assert found and all(said in one for one in found)


def test_a_slope_is_looked_at_where_the_other_error_is_saturated(bench):
    """Beyond the scale of an error its own slope is none; that of the other one is."""
    table, rng = bench.problem.table, np.random.default_rng(1)
    problem = replace(bench.problem)
    problem.__dict__['table'] = table._replace(slopes=table.slopes + 9.0)
    for i, j in ((0, len(table.w) // 2), (len(table.e) // 2, 0)):
        said = list(check_sets._surface_cell(problem, problem.table, i, j, rng))
        assert said and all('a slope at' in one for one in said)


def test_a_law_holds_as_far_as_slopes_and_pieces_of_its_cells_say(bench):
    """In four cells: by their slopes where the pieces are bent, and the other way round.

    Either side of a slope is farther from the law in turn; the pieces are those of SciPy.
    """
    controller, table, rng = bench.problem.controller, bench.problem.table, np.random.default_rng(2)
    position, velocity, force = controller.scales
    edges, pieces = (table.e, table.w), RegularGridInterpolator((table.e, table.w), table.u)
    bent = table._replace(bend=np.ones_like(table.bend))
    steep = table._replace(
        bend=0.0 * table.bend + 1e-4, slopes=1e3 * np.sign([-1, 1, -1, 1]) + 0.0 * table.slopes
    )
    slack = 1e-6
    for number in range(24):
        i, j = (int(rng.choice(np.flatnonzero(np.abs(one) < 0.7)[2:-3])) for one in edges)
        half_e, half_w = (
            0.4 * np.diff(x[k : k + 3]).min() for x, k in zip(edges, (i, j), strict=True)
        )
        tilt = 0.0
        if number % 2:
            tilt, half_e = -2.0, min(half_e, half_w / 8.0)
        e, w = table.e[i + 1] + 0.1 * half_e, table.w[j + 1] + 0.1 * half_w
        r, v = half_e * position, half_w * velocity
        g = exact([[r, 0.0], [tilt * half_e * velocity, v]])
        strip = ExactStrip(exact([-e * position, -w * velocity]), g, exact([0.0, 0.0]), 0)
        slopes = table.slopes[i : i + 2, j : j + 2].reshape(-1, 4)
        least, most = slopes.min(axis=0)[[0, 2]], slopes.max(axis=0)[[1, 3]]
        law = least + rng.choice([0.2, 0.8], 2) * (most - least)
        u = float(output(controller, exact(e), exact(w), exact(table.limit)))
        level = u - law @ (e, w) + rng.choice([-1e-3, 1e-3])
        far = np.maximum(most - law, law - least)
        need = 1e-3 + slack + (far[0] + abs(tilt) * far[1]) * half_e + far[1] * half_w
        found = [(bent, need)]
        if tilt == 0.0:
            ends = (
                [e - half_e, table.e[i + 1], e + half_e],
                [w - half_w, table.w[j + 1], w + half_w],
            )
            points = np.array(list(product(*ends)))
            found.append(
                (steep, np.abs(pieces(points) - points @ law - level).max() + 1e-4 + slack)
            )
        for made, need in found:
            for share, holds in ((1.0 + 1e-9, True), (1.0 - 1e-9, False)):
                k_r, k_v = -law * force / (position, velocity)
                said = Law(k_r, k_v, level * force, need * share * force)
                assert law_holds(controller, made, said, strip, Fraction(slack)) is holds


def test_tubes_hold_the_flights_of_the_proof(bench):
    rng = np.random.default_rng(7)
    for group, found in bench.groups.items():
        assert not list(check.flight_faults(bench.prover(group), found, rng, 50, lambda *_: None))


def test_flights_of_a_larger_cell_leave_the_tube(bench):
    """A tube of half the cell: the checker notices that flights of the whole cell leave it."""
    prover, found = bench.prover('planar'), bench.groups['planar']
    fly = prover.fly
    prover.fly = lambda cell: fly(cell._replace(half=tuple(0.5 * h for h in cell.half)))
    rng = np.random.default_rng(7)
    assert list(check.flight_faults(prover, found, rng, 10, lambda *_: None))


@pytest.mark.parametrize(('limit', 'held'), [(0.045, True), (0.05, False)])
def test_a_command_beyond_the_thrusters_is_what_they_exert(limit, held):
    """A tube has forces of at most 0.045 N, the flight commands 0.2 N."""
    scenario = SimpleNamespace(dt_s=0.1, max_force_n=limit)
    problem = SimpleNamespace(groups={'vertical': (2, 5)}, scenario=scenario)
    flight = SimpleNamespace(states=np.zeros((4, 6)), forces_n=np.full((4, 3), 0.2))
    laws = np.zeros((3, 1, 6))
    laws[:, :, 5] = 1.0
    tube = SimpleNamespace(
        force_low=np.full((3, 1), -0.045), force_high=np.full((3, 1), 0.045),
        slew=np.ones((3, 1)), low=-np.ones((4, 2)), high=np.ones((4, 2)), laws=laws,
    )  # fmt: skip
    prover = SimpleNamespace(problem=problem, group='vertical')
    assert check._in_some(prover, flight, [(0, 3, [tube])]) is held


@pytest.mark.parametrize('constant_n', [-0.015, 0.015, -0.0151, 0.0151])
def test_a_disturbance_of_the_other_sign_is_judged_by_its_size(constant_n):
    """Harmonics have any phase, so each of both signs; a constant is judged alike."""
    harmonic = Harmonic('x', 'cos', 0.01, 0.004)
    proven = Disturbance((0.01, 0.0, 0.0), (harmonic,))
    flown = Disturbance((constant_n, 0.0, 0.0), (replace(harmonic, amplitude_n=-0.01),))
    assert check._is_within(flown, proven, 1.5) == (abs(constant_n) <= 0.015)
    assert not check._is_within(flown, proven, 0.0) and check._is_within(proven, proven, 0.0)
