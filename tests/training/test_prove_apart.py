# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Axes that are proven alone: cells of a disturbance and of mass; the checker looks at them too.

Everything is looked at in a proof of 24 s, whose strips are covered anew every 6 s, and at each
landing in one of 140 s with the stages and parts of every proof.
"""

from __future__ import annotations

import copy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from kept import assert_kept, digits
from landing import rest_at_landing
from proofs import COARSE

from rpo.proof import cells, check, check_sets, flights, per_axis, proving
from rpo.proof.cells import Prover
from rpo.proof.claims import empty_set
from rpo.proof.flights import context_of
from rpo.proof.folder import Folder
from rpo.proof.problem import PER_AXIS, Problem, Settings
from rpo.proof.slew import Strip
from rpo.reports.proof import report_of
from rpo.training.config import load_start
from rpo_core.chain.flight import fly
from rpo_core.scenario.requirements import Requirements
from rpo_core.scenario.scenario import load_scenario

EXPECTED = Path(__file__).parent / 'expected'

CASES = st.integers(0, 2**32 - 1).map(np.random.default_rng)


def strips_of(rng):
    """Return some strips in the plane, near each other and of any tilt, or thin."""
    count = int(rng.integers(1, 9))
    r, v = rng.uniform(-3.0, 3.0, count), rng.uniform(-0.3, 0.3, count)
    half_m, half = rng.choice([0.0, 0.01, 1.0, 3.0], count), rng.choice([0.0, 0.001, 0.1], count)
    rows = zip(r, v, half_m, rng.uniform(-0.2, 0.2, count), half, strict=True)
    return [Strip(*map(float, row)) for row in rows]


@given(CASES)
@settings(max_examples=10, deadline=None)
def test_strips_are_covered_and_halved(rng):
    """All of them, in rational numbers; points of them, however they are drawn."""
    strips, size = strips_of(rng), (float(rng.uniform(0.05, 2.0)), float(rng.uniform(0.005, 0.2)))
    made = per_axis.cover(strips, size)
    room = 1.0 + 1e-9
    assert all(one.half_m <= size[0] * room + 1e-12 for one in made)
    assert all(one.half <= size[1] * room + 1e-12 for one in made)
    for one in strips:
        assert check_sets.is_covered(one, made)
        assert check_sets.is_covered(one, per_axis.halves(one))
        a, b = rng.uniform(-1.0, 1.0, (2, 20))
        r = one.r + a * one.half_m
        v = one.v + one.tilt * a * one.half_m + b * one.half
        inside = [
            (np.abs(r - s.r) <= s.half_m) & (np.abs(v - s.v - s.tilt * (r - s.r)) <= s.half)
            for s in made
        ]
        assert np.any(inside, axis=0).all()


@given(CASES)
@settings(max_examples=10, deadline=None)
def test_a_gap_in_the_cover_is_found(rng):
    """A strip is left out, or a little narrower, where no other one is."""
    start = Strip(1.0, 0.1, 2.0, float(rng.uniform(-0.2, 0.2)), 0.1)
    made = per_axis.cover([start], (0.3, 0.02))
    k = int(rng.integers(len(made)))
    assert check_sets.is_covered(start, made)
    assert not check_sets.is_covered(start, made[:k] + made[k + 1 :])
    narrow = made[k]._replace(half_m=made[k].half_m * 0.999)
    assert not check_sets.is_covered(start, [*made[:k], narrow, *made[k + 1 :]])
    low = made[k]._replace(half=made[k].half * 0.999)
    assert not check_sets.is_covered(start, [*made[:k], low, *made[k + 1 :]])


SHORT = {'duration_s': 24.0, 'requirements': Requirements(
    hold_from_s=20.0, hold_error_per_axis_m=3.6, mean_error_norm_m=6.0, mean_window_s=3.0,
    slew_per_axis_n_s=0.2,
)}  # fmt: skip
LONG = {'duration_s': 140.0, 'requirements': None}


def paper_like(wanted, controller='allround', **options):
    """The paper's disturbance, at any phase and with a mass that differs, near the target."""
    place = (2.0, 3.0, -2.0)
    base = replace(load_scenario('paper_test'), initial_position_m=place, **wanted)
    chosen = {'disturbance_share': 0.6, 'mass_share': 0.05, 'cell_m_s': 0.02, **options}
    made = Settings(
        centre=base.start,
        half=(0.4, 0.4, 0.4, 0.02, 0.02, 0.02),
        axes_apart=True,
        coarseness=COARSE,
        **chosen,
    )
    return Problem.of(load_start(controller), base, made)


@pytest.fixture(
    scope='module',
    autouse=True,
    params=['short', pytest.param('long', marks=pytest.mark.every_landing)],
)
def problem(request):
    """Strips near the target do not become long; here others cover them all the same."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(per_axis, 'LONG', 0.0)
        if request.param == 'short':
            patch.setattr(per_axis, 'STAGE_S', 6.0)
            patch.setattr(per_axis, 'SETTLE_S', 6.0)
            patch.setattr(cells, 'PARTS', 2)
            yield paper_like(SHORT, 'robust', cell_m=0.3)
        else:
            yield paper_like(LONG)


@pytest.fixture(scope='module')
def folder(tmp_path_factory, problem):
    made = Folder.create(tmp_path_factory.mktemp('apart') / 'proof', problem)
    proving.prove(made, 1, lambda *_: None, probes=20)
    return made


@pytest.fixture(scope='module')
def groups(folder):
    return {group: folder.cells(group) for group in PER_AXIS}


def prover_of(folder, groups, group):
    before = {name: groups[name] for name in list(PER_AXIS)[: list(PER_AXIS).index(group)]}
    around = context_of(folder.problem, group, before)
    return Prover(folder.problem, group, empty_set(folder.problem), *around)


def test_it_is_proven_and_checked(folder, groups):
    claims = folder.summary()['claims']
    assert {claim['verdict'] for claim in claims.values()} == {'proven'}
    assert 'for ever' not in next(iter(claims.values()))['statement']
    assert any(len(found.values) > 1 for found in groups.values())
    sections = {section.title: section for section in report_of(folder.path).sections}
    assert list(sections) == ['Claims', 'Margins', 'Files']
    assert [block.name for block in sections['Margins'].blocks] == ['reach']
    assert check.check(folder, check.Sample(starts=1, ticks=2, surface=1, flights=20)).faults == []


def lines_of_tubes(folder, groups):
    """Yield a line for each strip of a cell of each axis, with sums of what its tube was."""
    for group, found in groups.items():
        prover, k = prover_of(folder, groups, group), len(found.values) - 1
        cell = cells.Cell(tuple(found.centre[k]), tuple(found.half[k]))
        for stage in prover.stages(cell):
            for one in stage.moved:
                sums = [np.abs(values).sum() for values in one.trace]
                yield f'{group} {stage.first} strip {digits(one.strip)} end {digits(one.end)}'
                yield f'{group} {stage.first} trace {digits(sums)}'
        prover.fly(cell)
        yield f'{group} weights {digits(prover.weights(cell))}'


def test_strips_are_those_of_the_list(folder, groups):
    """The checker finds what is not true; a bound that is wider than it must be, only this list."""
    path = EXPECTED / f'proof_per_axis_{folder.problem.scenario.duration_s:.0f}_s.txt'
    assert_kept(path, lines_of_tubes(folder, groups))


def test_an_estimate_of_all_first_cells_is_the_proof(folder, groups):
    """Its bounds and flights are those of the proof; none is halved here."""
    problem, summary = folder.problem, folder.summary()
    found = proving.estimate(problem, 1000, lambda *_: None)
    count = len(cells.roots(problem, 'x'))
    assert (found.cells, found.sampled, found.tubes) == (count, count, count)
    assert {key: claim['bound'] for key, claim in summary['claims'].items()} == found.bounds
    assert set(found.open_cells.values()) == {0} and found.flown.keys() == found.bounds.keys()
    assert found.never_inside == count and 0.0 < found.hours < 1.0
    few = proving.estimate(problem, 2, lambda *_: None)
    assert (few.cells, few.sampled, few.tubes) == (count, 2, 2)
    assert all(bound <= found.bounds[key] for key, bound in few.bounds.items())


@pytest.mark.parametrize('mass_share', rest_at_landing([0.05, 0.0]))
def test_a_known_disturbance_is_proven_and_checked(tmp_path, problem, mass_share):
    """Without unknown constants there is one cell of each axis; the mass alone has some."""
    known = replace(problem.settings, disturbance_share=0.0, mass_share=mass_share)
    problem = replace(problem, settings=known)
    made = Folder.create(tmp_path / 'proof', problem)
    proving.prove(made, 1, lambda *_: None, probes=10)
    assert {claim['verdict'] for claim in made.summary()['claims'].values()} == {'proven'}
    assert len(made.cells('y').values) == (1 if mass_share == 0.0 else cells.PARTS)
    assert check.check(made, check.Sample(starts=1, ticks=2, surface=1, flights=10)).faults == []


def test_a_flight_of_everything_at_once_is_in_some_cell_of_each_axis(folder, groups):
    """Drawn without the prover's help: where it starts, each axis has a tube that holds it."""
    problem, rng = folder.problem, np.random.default_rng(4)
    for _ in range(2):
        point = {
            g: np.array([rng.uniform(*r) for r in per_axis.ranges(problem, g)]) for g in PER_AXIS
        }
        for unknown in point.values():
            unknown[-1] = point['x'][-1]  # one mass for all axes
            unknown[-3:-1] *= 0.7
        scenario = problem.scenario
        for group, unknown in point.items():
            scenario = per_axis.scenario_in(problem, group, unknown, scenario)
        start = np.array(problem.settings.centre) + rng.uniform(-1, 1, 6) * problem.settings.half
        flight = fly(scenario.starting_at(start.tolist()), problem.controller)
        for group, chosen in PER_AXIS.items():
            prover, found = prover_of(folder, groups, group), groups[group]
            at = np.concatenate([start[list(chosen)], point[group]])
            (k, *_) = np.flatnonzero((np.abs(found.centre - at) <= found.half).all(axis=1))
            prover.fly(cells.Cell(tuple(found.centre[k]), tuple(found.half[k])))
            states = flight.states[:, list(chosen)]
            assert (prover.trace.low <= states).all() and (states <= prover.trace.high).all()


@pytest.mark.parametrize('sign', [-1.0, 1.0])
def test_the_slew_of_strips_holds_flights_of_any_disturbance_and_mass(folder, groups, sign):
    """From the ends of a cell whose force and mass are far from the middle ones."""
    problem = folder.problem
    required = Requirements(hold_from_s=90.0, hold_error_per_axis_m=0.5, slew_per_axis_n_s=0.3)
    base = replace(problem.scenario, requirements=problem.scenario.requirements or required)
    wider = replace(problem.settings, disturbance_share=1.5, mass_share=0.09)
    problem = Problem.of(problem.controller, base, wider)
    prover = Prover(problem, 'y', empty_set(problem), *context_of(problem, 'y', groups))
    roots, rng = cells.roots(problem, 'y'), np.random.default_rng(3)
    far = [sign * 0.75, sign * 0.25, sign * 0.75]
    cell = min(roots, key=lambda c: float(np.abs(np.array(c.centre[2:5]) - far).sum()))
    tubes = check._tubes(prover, cell)
    assert all(np.isfinite(one.slew).all() for *_, some in tubes for one in some)
    for _ in range(6):
        start = np.array(base.start) + rng.choice([-1.0, 1.0], 6) * problem.settings.half
        unknown = np.array(cell.centre) + np.array(cell.half) * rng.choice([-1.0, 1.0], 6)
        drawn = flights.vary(problem, rng, start)
        drawn = per_axis.scenario_in(problem, 'y', unknown[2:], drawn)
        assert check._in_some(prover, fly(drawn, problem.controller), tubes)


def test_a_tube_outside_the_corridor_gives_nothing(folder, groups, monkeypatch):
    """What is known of y follows from the corridor of x; a tube of x that leaves it is open."""
    prover = prover_of(folder, groups, 'x')
    cell = cells.roots(folder.problem, 'x')[0]
    narrow = prover.other_axis.corridor.copy()
    narrow[1, 200:] = narrow[0, 200:]
    prover.other_axis = prover.other_axis._replace(corridor=narrow)
    row = prover.values(cell)[0]
    assert row[cells.VALUES.index('last_s')] < 20.0
    assert np.isinf(row[cells.VALUES.index('hold_error_m')])
    monkeypatch.setattr(cells, 'WIDEST', (1.0, 0.0))  # no stage lasts, so nothing has left it
    assert prover.fly(cell) == (0, -1)


@pytest.mark.parametrize('group', PER_AXIS)
def test_the_motion_of_cells_is_what_is_flown(folder, groups, group):
    """At its corners, where the rounding of the sinusoids is largest."""
    prover, found = prover_of(folder, groups, group), groups[group]
    ticks = folder.problem.scenario.ticks
    for k in range(0, len(found.half), 9):
        cell = cells.Cell(tuple(found.centre[k].tolist()), tuple(found.half[k].tolist()))
        for tick in range(0, ticks, ticks // 7):
            motion = prover.motion_of(cell)
            assert not list(check_sets.motion_faults(prover, cell, motion, tick, ''))


def test_strips_that_begin_or_end_elsewhere_are_found(folder, groups):
    """The set of a strip, and the strip that holds its set at the end of a stage."""
    prover, found = prover_of(folder, groups, 'y'), groups['y']
    k = int(np.flatnonzero(found.column('last_s') > 0.0)[0])
    cell = cells.Cell(tuple(found.centre[k]), tuple(found.half[k]))
    first, second, *_ = list(prover.stages(cell))
    merged = round(per_axis.STAGE_S / folder.problem.scenario.dt_s)
    assert (first.last, second.first) == (merged, merged)
    one, motion = first.moved[0], prover.motion_of(cell)
    z, m = per_axis.set_of(one.strip, motion.carried.shape[1])
    assert not list(check_sets.start_faults(one.strip, z, m, ''))
    for wrong in (
        one.strip._replace(r=one.strip.r + 1e-12),
        one.strip._replace(half=one.strip.half * (1.0 + 1e-12)),
        one.strip._replace(tilt=one.strip.tilt + 1e-9),
    ):
        assert list(check_sets.start_faults(wrong, z, m, ''))
    numbers = range(first.first, first.last)
    moving = check_sets.set_faults(folder.problem, motion, (z, m), numbers, set(), '')
    with pytest.raises(StopIteration) as stopped:
        next(moving)
    m = stopped.value.value
    assert not list(check_sets.end_faults(one.end, z, m, ''))
    for wrong in (
        one.end._replace(half_m=one.end.half_m * 0.999),
        one.end._replace(half=one.end.half * 0.999),
        one.end._replace(v=one.end.v + 1e-6),
    ):
        assert list(check_sets.end_faults(wrong, z, m, ''))


def test_planted_errors_are_found(folder, groups):
    """A narrower reach, an empty cell that is none, other forces, masses and pushes."""
    prover, rng = prover_of(folder, groups, 'x'), np.random.default_rng(1)
    found = copy.deepcopy(groups['x'])
    found.reach[1] -= 1e-9
    every = check.Sample(starts=1, ticks=0)
    assert list(check.tube_faults(prover, found, rng, every, lambda *_: None))
    k = int(np.flatnonzero(found.column('last_s') > 0.0)[0])
    found.values[k, cells.VALUES.index('last_s')] = -0.1
    assert list(check_sets.empty_faults(folder.problem, 'x', found))
    cell = cells.Cell(tuple(found.centre[k]), tuple(found.half[k]))
    motion = prover.motion_of(cell)
    assert not list(check_sets.motion_faults(prover, cell, motion, 50, ''))
    for wrong in (
        motion._replace(constant=motion.constant + 1e-9),
        motion._replace(carried=motion.carried * 0.999),
        motion._replace(mass=motion.mass * 0.999),
        motion._replace(b=motion.b * (1.0 + 1e-9)),
        motion._replace(coupling=motion.coupling + 1e-3),
        motion._replace(coupling_half=motion.coupling_half * 0.9),
    ):
        assert list(check_sets.motion_faults(prover, cell, wrong, 50, ''))
    before, after, _ = check_sets.stepped(folder.problem, motion, 50, *prover.start(cell))
    assert not list(check_sets.step_faults(motion, before, after, ''))
    still = motion._replace(coupling=0.0 * motion.coupling)
    assert list(check_sets.step_faults(still, before, after, ''))
