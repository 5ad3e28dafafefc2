# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Proofs: laws and tubes that hold what flies, invariant sets, claims, refusals, resuming."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from invoking import invoke
from landing import rest_at_landing
from proofs import BOX, COARSE, problem_of

from rpo.proof import cells, check, enclosure, flights, folder, proving, slew, tube
from rpo.proof.cells import Prover
from rpo.proof.claims import ranges_of, values_of
from rpo.proof.folder import Folder
from rpo.proof.invariant import invariant_set_of, motion_inside
from rpo.proof.problem import GROUPS, MOST_CELLS, Problem, Settings
from rpo.proof.surface import rounding
from rpo.proof.tube import InvariantSet
from rpo_core.chain.flight import fly
from rpo_core.control.controller import load_controller, load_fuzzy
from rpo_core.control.fuzzy import MembershipFunctions, RuleTable
from rpo_core.files import find
from rpo_core.files.validation import InputError
from rpo_core.navigation.sensors import Navigation
from rpo_core.scenario.scenario import load, load_scenario
from rpo_core.world.disturbance import Disturbance

SHIPPED = ('allround', 'paper_ga', 'handmade')
NOWHERE = InvariantSet(0.0, 0.06, 0.0)
"""No tube is in it, so each flies on to the end."""


@pytest.fixture(
    scope='module',
    params=[
        'allround',
        *(pytest.param(x, marks=pytest.mark.slow) for x in ('paper_ga', 'handmade')),
    ],
)
def surface(request):
    controller = load_fuzzy(request.param)
    return controller, enclosure.table_of(controller, 0.5, COARSE)


def test_the_force_follows_the_law_on_its_strip(surface):
    """The kernel, at corners, edges and random points of strips of all sizes and places."""
    controller, table = surface
    rng = np.random.default_rng(3)
    for _ in range(300):
        r, v = rng.uniform(-80.0, 80.0), rng.uniform(-1.4, 1.4)
        if rng.random() < 0.5:
            r, v = 0.01 * r, 0.01 * v
        size = 10.0 ** rng.uniform(-6.0, 0.5)
        tilt, half = rng.uniform(-0.2, 0.05), 0.05 * size * rng.random()
        law = enclosure.law_of(table, r - size, r + size, v, tilt, half)
        shares = np.vstack(
            [rng.uniform(-1.0, 1.0, (20, 2)), [[a, b] for a in (-1, 0, 1) for b in (-1, 1)]]
        )
        for a, b in shares:
            at, fast = r + size * a, v + tilt * size * a + half * b
            force = controller.force_n([at] * 3, [fast] * 3)[0]
            assert abs(force - law.k_r * at - law.k_v * fast - law.k_0) <= law.rho


def test_the_slack_holds_what_a_rounded_error_changes(surface):
    """An error is at most 1 and is rounded twice at least; the surface is as steep as its table."""
    controller, table = surface
    along = np.abs(np.diff(table.u, axis=0) / np.diff(table.e)[:, None]).max()
    across = np.abs(np.diff(table.u, axis=1) / np.diff(table.w)).max()
    more = table.slack - rounding(controller.system)
    assert more >= 2 * 2.0**-53 * (along + across)


@pytest.mark.parametrize('name', ['allround', pytest.param('paper_ga', marks=pytest.mark.slow)])
def test_tubes_hold_the_flights_of_their_cells(name):
    """States, forces and slew of every tick: corners and random starts, with a velocity."""
    problem = problem_of(name, half=(40.0, 40.0, 40.0, 0.05, 0.05, 0.05))
    rng = np.random.default_rng(5)
    for group, centre, half in (
        ('planar', (35.0, -22.0, 0.03, -0.04), (0.4, 0.4, 0.01, 0.01)),
        ('planar', (0.3, 0.1, 0.0, 0.0), (0.3, 0.3, 0.0, 0.0)),
        ('vertical', (38.0, -0.03), (0.5, 0.02)),
    ):
        prover = Prover(problem, group, NOWHERE)
        cell = cells.Cell(centre, half)
        last, _ = prover.fly(cell)
        chosen = list(GROUPS[group])
        axes = [i for i in chosen if i < 3]
        for number in range(12):
            share = (
                np.sign(rng.uniform(-1, 1, len(half)))
                if number < 6
                else rng.uniform(-1, 1, len(half))
            )
            start = np.zeros(6)
            start[chosen] = np.array(centre) + np.array(half) * share
            flight = fly(flights.vary(problem, rng, start), problem.controller)
            end = min(last, len(flight.states) - 1)
            states, t = flight.states[: end + 1, chosen], prover.trace
            assert (t.low[: end + 1] <= states).all() and (states <= t.high[: end + 1]).all()
            forces = flight.forces_n[:end, axes]
            assert (t.force_low[:end] <= forces).all() and (forces <= t.force_high[:end]).all()
            slew = np.abs(np.diff(forces, axis=0)) / problem.scenario.dt_s
            assert (slew <= t.slew[: end - 1]).all()


def test_no_tick_from_a_strip_changes_the_force_faster_than_its_bound():
    """Of a double integrator, so that the next state is known without the prover."""
    table = problem_of('allround', half=(100.0, 100.0, 100.0, 0.0, 0.0, 0.0)).table
    stage, rng, ratios = load_controller('allround').stage(0.1), np.random.default_rng(5), []

    def forces_n(place, speed):
        states = [(x, 0.0, 0.0, y, 0.0, 0.0) for x, y in zip(place, speed, strict=True)]
        return np.array([stage.step(0, state)[0][0] for state in states])

    drift = slew.Drift(0.0, -1e-3, 1e-3, 0.1, 0.1)  # of 10 kg
    for i, j in rng.permutation(np.argwhere(table.division >= 0))[:60]:
        r = -rng.uniform(*table.e[i : i + 2]) * table.position_m
        v = -rng.uniform(*table.w[j : j + 2]) * table.velocity_m_s
        half_m, half = rng.choice([1e-3, 0.05, 0.3]), rng.choice([1e-5, 1e-3, 4e-3])
        strip = slew.Strip(r, v, half_m, rng.uniform(-0.02, 0.02), half)
        place = r + rng.uniform(-half_m, half_m, 20)
        speed = v + strip.tilt * (place - r) + rng.uniform(-half, half, 20)
        before_n = forces_n(place, speed)
        after = speed + 0.1 * (rng.choice([-1e-3, 1e-3], 20) + before_n / 10.0)
        after_n = forces_n(place + 0.05 * (speed + after), after)
        bound = slew.slew_of(table, drift, strip, -0.5, 0.5, 0.0)
        ratios.append(np.abs(after_n - before_n).max() / 0.1 / bound)
    assert 0.8 < max(ratios) <= 1.0


@pytest.mark.parametrize('name', rest_at_landing(SHIPPED))
def test_no_flight_leaves_the_invariant_set(name):
    """From its corners, where a flight would leave first."""
    problem = problem_of(name)
    rest = invariant_set_of(problem, 0.5, None)
    assert rest is not None
    for signs in np.ndindex(2, 2, 2, 2, 2, 2):
        a, b = (1.0 - 2.0 * np.array(signs)).reshape(2, 3)
        position = rest.radius_m * a
        start = np.concatenate([position, -rest.rate * position + rest.speed_m_s * b])
        start *= 1.0 - 1e-9
        flight = fly(flights.vary(problem, np.random.default_rng(1), start), problem.controller)
        r, v = flight.states[:300, :3], flight.states[:300, 3:]
        assert np.abs(r).max() <= rest.radius_m
        assert np.abs(v + rest.rate * r).max() <= rest.speed_m_s


@pytest.mark.every_landing
def test_there_is_no_invariant_set_without_damping():
    """Rules that ignore the velocity: an oscillator, which never comes to rest."""
    default = load_fuzzy('allround')
    rows = tuple(default.system.rules.words[2] for _ in range(5))
    undamped = replace(default, system=replace(default.system, rules=RuleTable(rows)))
    settings = replace(problem_of('allround').settings, coarseness=8.0)
    problem = Problem.of(undamped, load('paper_training').base, settings)
    assert invariant_set_of(problem, 0.5, None) is None


@pytest.mark.slow
def test_a_proof_is_checked_and_an_interrupted_one_has_the_same_bytes(sound, tmp_path):
    """A table that somebody changed meanwhile is never read as true: it is made anew."""
    summary = sound.summary()
    assert {claim['verdict'] for claim in summary['claims'].values()} == {'proven'}
    assert 'for ever' in summary['claims']['hold_error_per_axis_m']['statement']
    assert check.check(sound, check.Sample(starts=2, ticks=4, surface=5)).faults == []
    second = Folder.create(tmp_path / 'second', problem_of('allround', half=BOX))

    def stop(what, done, total):
        if what == 'planar cells':
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        proving.prove(second, 1, stop, probes=20)
    assert not second.finished and list((second.path / 'parts').glob('vertical*'))
    forged = {name: 0.0 * values for name, values in sound.table().items()}
    folder.write_arrays(second.path / 'table.npz', forged)
    proving.prove(Folder.open(second.path), 2, lambda *_: None, probes=20)
    for name in ('planar.npz', 'vertical.npz', 'summary.yaml', 'table.npz'):
        assert (sound.path / name).read_bytes() == (second.path / name).read_bytes()


@pytest.mark.every_landing
def test_a_refuted_claim_has_a_flight_that_simulate_repeats(tmp_path):
    """Of two claims, the only ones listed; no flight keeps the limit of the second."""
    base, asked = load('paper_training').base, ('hold_error_per_axis_m', 'slew_per_axis_n_s')
    strict = replace(base, requirements=replace(base.requirements, slew_per_axis_n_s=0.04))
    settings = replace(problem_of('allround', half=BOX).settings, claims=asked)
    problem = Problem.of(load_controller('allround'), strict, settings)
    folder = Folder.create(tmp_path / 'proof', problem)
    outcome = proving.prove(folder, 1, lambda *_: None, probes=20)
    assert [c.key for c in outcome.claims if c.verdict == 'refuted'] == ['slew_per_axis_n_s']
    assert all(folder.cells(group).column('depth').min() == 0 for group in GROUPS)
    claims = Folder.open(folder.path).summary()['claims']
    assert claims['hold_error_per_axis_m']['limit'] == 0.5
    assert [claims[key]['verdict'] for key in asked] == ['proven', 'refuted'] and len(claims) == 2
    path = folder.path / 'counterexample_slew_per_axis_n_s.yaml'
    run = invoke('simulate', path, '--controller', 'allround')
    assert 'MISSED' in run.output
    assert check.check(folder, check.Sample(starts=1, ticks=1, surface=1)).faults == []
    with pytest.raises(InputError, match='`claim` must be one of'):
        Problem.of(load_controller('allround'), base, replace(settings, claims=('x',)))


def test_what_the_theory_does_not_know_is_refused():
    base, settings = load('paper_training').base, problem_of('allround').settings
    with pytest.raises(InputError, match='of kind lqr'):
        Problem.of(load_controller('lqr'), base, settings)
    noisy = base.equipped(Navigation(position_noise_m=0.1))
    with pytest.raises(InputError, match='`navigation`'):
        Problem.of(load_controller('allround'), noisy, settings)
    away = replace(base, goal_position_m=(0.0, 10.0, 0.0))
    with pytest.raises(InputError, match='goal_position_m'):
        Problem.of(load_controller('allround'), away, settings)
    with pytest.raises(InputError, match='`centre` must be 6 numbers'):
        replace(settings, centre=(0.0,) * 5)
    default = load_fuzzy('allround')
    part = replace(default.system.position, sp_left=default.system.position.sp_centre)
    jumping = replace(default, system=replace(default.system, position=part))
    with pytest.raises(InputError, match=r'vertical edge at 0\.1792'):
        enclosure.table_of(jumping, 0.5, COARSE)


def test_a_known_disturbance_is_part_of_the_tube():
    """The paper's test, whose disturbance is known: its flight is in the tube of a small cell."""
    base = replace(load_scenario('paper_test'), duration_s=60.0, requirements=None)
    start = base.start
    settings = Settings(centre=start, half=(0.2, 0.2, 0.2, 0.0, 0.0, 0.0), coarseness=COARSE)
    problem = Problem.of(load_controller('allround'), base, settings)
    flight = fly(base, problem.controller)
    for group, chosen in GROUPS.items():
        prover = Prover(problem, group, NOWHERE)
        centre = tuple(start[i] for i in chosen)
        last, _ = prover.fly(cells.Cell(centre, tuple(settings.half[i] for i in chosen)))
        assert last == base.ticks
        states = flight.states[:, list(chosen)]
        assert (prover.trace.low <= states).all() and (states <= prover.trace.high).all()


@pytest.mark.parametrize('group', ['planar', 'vertical'])
def test_an_invariant_set_stands_the_whole_disturbance_at_any_tick(group):
    pushed = load_scenario('paper_test')
    problem = replace(problem_of('allround'), scenario=pushed)
    inside = motion_inside(problem, group)
    assert inside.any_n >= abs(pushed.disturbances_n).max() > 0.01
    assert not inside.constant.any() and not inside.carried.any()


def test_what_is_held_is_judged_on_either_side_of_the_target():
    """Without requirements the error is held from the end on; it is the greatest of any axis."""
    base = replace(load('paper_training').base, requirements=None, duration_s=2.0)
    problem = replace(problem_of('allround'), scenario=base)
    flight = fly(replace(base, initial_position_m=(1.0, -9.0, 2.0)), problem.controller)
    found = values_of(problem, flight)
    assert found == {'hold_error_per_axis_m': abs(flight.states[-1, 1])}


@pytest.mark.every_landing
def test_the_energy_of_flights_is_in_its_range(sound):
    """Of each flight, and the mean of many starts, to within what their number lets expect."""
    ranges, problem = sound.summary()['ranges'], sound.problem
    energies = []
    for start in flights.random_starts(problem, 300, 5):
        flight = fly(flights.vary(problem, np.random.default_rng(1), start), problem.controller)
        energies.append(float((flight.forces_n[:-1] ** 2).sum()) * problem.scenario.dt_s)
    low, high = ranges['energy_n2s']['low'], ranges['energy_n2s']['high']
    assert low <= min(energies) and max(energies) <= high
    mean, off = np.mean(energies[8:]), 4.0 * np.std(energies[8:]) / 292**0.5
    assert ranges['mean_energy_n2s']['low'] - off <= mean <= ranges['mean_energy_n2s']['high'] + off


def test_what_follows_of_the_cells_is_the_same_in_any_order():
    """The checker compares it bit by bit; sums of BLAS depend on the number of threads."""
    rng, n = np.random.default_rng(3), 3001
    values = rng.uniform(0.1, 9.0, (n, len(cells.VALUES)))
    half = rng.uniform(0.1, 1.0, (n, 4))
    rest = np.zeros((n, 1, 2, 4)), np.zeros((1, 2, 1)), np.zeros((2, 0, 4))
    problem = problem_of('allround')
    plain, turned = (
        {'planar': cells.CellBounds(half, half[order], values[order], *rest)}
        for order in (np.arange(n), rng.permutation(n))
    )
    found = ranges_of(problem, plain)
    assert found == ranges_of(problem, turned)
    low, high = (values[:, cells.VALUES.index(f'energy_{end}_n2s')] for end in ('low', 'high'))
    assert (found['energy_n2s'].low, found['energy_n2s'].high) == (low.min(), high.max())


@pytest.mark.parametrize(('more', 'inside'), [(0.0, False), (1e-12, True)])
def test_a_set_on_the_very_rim_is_not_inside(more, inside):
    omega, speed = InvariantSet(1.0, 0.1, 0.3 * (1.0 + more)), np.array([0.0, 0.3])
    rim = tube.Zonotope(np.zeros(2), speed[:, None], np.zeros(2))
    found = tube.is_inside(omega, rim, 1, -speed, speed)
    assert found == inside


def test_the_box_of_a_set_is_rounded_outwards():
    """In exact numbers; a sum of floats alone is too small in half of the draws."""
    random = np.random.default_rng(5)
    for _ in range(50):
        c, d = random.normal(size=2), np.abs(random.normal(size=2)) * 1e-3
        g = random.normal(size=(2, 40)) * random.choice([1.0, 1e-8], 40)
        low, high = np.zeros(2), np.zeros(2)
        tube.box_of(tube.Zonotope(c, g, d), 40, low, high)
        for i in range(2):
            radius = Fraction(d[i]) + sum(abs(Fraction(x)) for x in g[i])
            assert Fraction(low[i]) <= Fraction(c[i]) - radius
            assert Fraction(high[i]) >= Fraction(c[i]) + radius
            assert high[i] - low[i] < float(2 * radius) * (1.0 + 1e-9) + 1e-12


def test_half_of_the_box_is_enough_where_all_is_odd():
    plain = problem_of('allround')
    pushed = replace(plain.scenario, disturbance=Disturbance((0.0, 0.001, 0.0)))
    settings = plain.settings
    even = replace(plain.controller.system, rules=RuleTable((('SP',) * 5,) * 5))
    assert plain.odd
    assert not replace(plain, scenario=pushed).odd
    assert replace(plain, scenario=pushed, settings=replace(settings, disturbance_share=0.5)).odd
    assert not replace(plain, settings=replace(settings, axes_apart=True)).odd
    assert not replace(plain, settings=replace(settings, centre=(1.0, *(0.0,) * 5))).odd
    uneven = replace(plain, controller=replace(plain.controller, system=even))
    assert not uneven.odd
    whole, half = (len(cells.roots(problem, 'planar')) for problem in (uneven, plain))
    assert whole == 2 * half


def test_a_proof_is_about_a_single_flight(sound):
    texts = (sound.texts[0], find('scenario', 'paper_training').read_text(), sound.texts[2])
    with pytest.raises(InputError, match='must be a single flight; it is a set'):
        Problem.of_texts(texts)


def test_a_box_has_no_more_cells_than_memory():
    """As many along each axis: per axis they are squared, else the plane has the fourth power."""
    along = 1.01 * MOST_CELLS**0.25
    half = (along, along, 0.0, along, along, 0.0)
    assert Settings(half, half, axes_apart=True, cell_m=1.0, cell_m_s=1.0).half == half
    assert Settings(half, (0.0, 0.0, 1e6, 0.0, 0.0, 0.0), cell_m=1e6 / MOST_CELLS)
    with pytest.raises(InputError, match=f'at most {MOST_CELLS} cells .* it is of 1.04e\\+07'):
        Settings(half, half, cell_m=1.0, cell_m_s=1.0)


def test_an_invariant_set_is_within_the_speed_that_is_asked_for():
    """The largest set is taken where its fastest state is slower, else a smaller one."""
    problem = problem_of('robust')
    largest = invariant_set_of(problem, 0.5, None)
    fast = largest.rate * largest.radius_m + largest.speed_m_s
    assert invariant_set_of(problem, 0.5, 1.001 * fast / 0.98) == largest
    slower = invariant_set_of(problem, 0.5, 0.999 * fast / 0.98)
    assert slower.rate * slower.radius_m + slower.speed_m_s < 0.999 * fast


def test_the_edges_of_the_grid_ascend_where_a_step_ends_at_a_breakpoint():
    """From 0.25 on cells are 1/64 wide, so the last one ends at 0.5 by itself."""
    functions = MembershipFunctions(0.5, 0.25, 0.5, 0.75, 0.5)
    found = enclosure.edges(functions, COARSE)
    assert (np.diff(found) > 0.0).all() and (found == -found[::-1]).all()
    assert {0.0, 0.25, 0.5, 0.75, 1.0} <= set(found.tolist())
    assert np.diff(found)[1:-1].max() == 1 / 64


def test_what_is_kept_of_a_tube_is_rounded_outward():
    """By more than sums of its ticks are rounded: a checker adds them up in another order."""
    problem = problem_of('allround', half=BOX)
    prover, judged = Prover(problem, 'planar', NOWHERE), problem.scenario.ticks - 1
    kept = prover.values(cells.Cell((1.0, 0.5, 0.0, 0.0), (0.5, 0.25, 0.0, 0.0)))[0]
    found, t = dict(zip(cells.VALUES, kept, strict=True)), prover.trace
    low, high = t.force_low[: judged + 1], t.force_high[: judged + 1]
    commands, least = np.maximum(-low, high), np.maximum(np.maximum(low, -high), 0.0)
    dt_s, out = problem.scenario.dt_s, 1.0 + 5e-13
    assert found['force_n'] > commands.max() * out
    assert found['slew_n_s'] > t.slew[:judged].max() * out
    assert found['speed_m_s'] > np.maximum(-t.low, t.high)[: judged + 2, 2:].max() * out
    assert found['energy_high_n2s'] > (commands**2).sum() * dt_s * out
    assert 0.0 < found['energy_low_n2s'] < (least**2).sum() * dt_s / out


def test_rounding_of_a_cell_leaves_no_gap():
    problem = problem_of('allround', half=(0.7, 0.7, 0.7, 0.03, 0.03, 0.03))
    for group in GROUPS:
        some = cells.roots(problem, group)
        halved = [half for cell in some[1:] for half in cells.halves(cell, cells.widths(cell))]
        found = cells.CellBounds(
            np.array([c.centre for c in (some[0], *halved)]),
            np.array([c.half for c in (some[0], *halved)]),
            *4 * [np.empty((0, 0))],
        )
        assert not list(check.cover_faults(problem, group, found))
        fewer = replace(found, centre=found.centre[:-1], half=found.half[:-1])
        assert list(check.cover_faults(problem, group, fewer))
