# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The lower bound of a plan, against paths that are known and searches for one below it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from invoking import invoke
from scipy.optimize import minimize, nnls
from scipy.spatial.transform import Rotation

from rpo_attitude.target import Target, motion_of
from rpo_core.files.scenario import load_scenario
from rpo_core.world import cw
from rpo_guidance.plan import Guidance
from rpo_judge.evaluation import plan_bound
from rpo_judge.evaluation.plan_bound import Bridge, HalfSpaces, KeepOut, best_path, lower_bound

N_RAD_S, DT_S = cw.mean_motion(6_678_000.0), 10.0
STEP = cw.discretise(N_RAD_S, 10.0, DT_S)
PORT, AXIS, SLOPE = np.array([0.0, 1.0, 0.0]), np.array([0.0, 1.0, 0.0]), np.tan(np.radians(15.0))
SMALL = KeepOut(5.0, PORT, AXIS, SLOPE)
END = np.array([0.0, 1.0, 0.0, 0.0, -0.1, 0.0])


def rows_of_all(length):
    """Return the states at all ticks as drift matrices and rows of forces, by matrix powers."""
    a, b = cw.matrices(STEP)
    powers = [np.linalg.matrix_power(a, k) for k in range(length + 1)]
    rows = np.zeros((length + 1, 6, length, 3))
    for tick in range(1, length + 1):
        for k in range(tick):
            rows[tick, :, k] = powers[tick - 1 - k] @ b
    return np.array(powers), rows.reshape(length + 1, 6, 3 * length)


def cheapest(start, zone, length, entry, forces):
    """Return the least energy that SLSQP finds, in the cone from an entry on; inf if none."""
    powers, rows = rows_of_all(length)
    drift, unit = powers @ start, np.array([1.0] * 3 + [30.0] * 3)
    out, inside = slice(1, entry), slice(entry, length)

    def states(f):
        return drift + rows @ f

    def depth(f):
        path = states(f)[:, :3]
        offset = path[inside] - zone.port_m
        along = offset @ zone.axis
        across = (offset**2).sum(axis=1) - along**2
        sphere = (path[out] ** 2).sum(axis=1) / zone.radius_m - zone.radius_m
        return np.concatenate([sphere, along, (zone.slope * along) ** 2 - across])

    found = minimize(
        lambda f: (f @ f) * DT_S,
        forces,
        jac=lambda f: 2.0 * f * DT_S,
        constraints=[
            {
                'type': 'eq',
                'fun': lambda f: (states(f)[-1] - END) * unit,
                'jac': lambda f: rows[-1] * unit[:, None],
            },
            {'type': 'ineq', 'fun': depth},
        ],
        options={'maxiter': 200, 'ftol': 1e-9},
    )
    ends = np.abs((states(found.x)[-1] - END) * unit).max() < 1e-4
    return found.fun if ends and depth(found.x).min() > -1e-3 else np.inf


def refuters(start, zone, length, entries, tries, rng):
    """Return the least energies found from random forces, each moment of entry in turn."""
    return [
        cheapest(start, zone, length, entry, rng.normal(size=3 * length) * 0.05)
        for entry in entries
        for _ in range(tries)
    ]


def test_without_half_spaces_it_is_the_least_norm_and_forces_lead_to_the_end():
    start = np.array([-3.0, -20.0, 4.0, 0.02, 0.0, -0.03])
    bridge = Bridge(start, END, STEP, DT_S, 23, 3)
    powers, rows = rows_of_all(23)
    forces = np.linalg.lstsq(rows[-1], END - powers[-1] @ start, rcond=None)[0]
    assert bridge.free == pytest.approx((forces @ forces) * DT_S, rel=1e-9)
    spaces = HalfSpaces(np.array([2]), np.array([[0.0, 0.0, 1.0]]), np.array([-50.0]))
    energy, multipliers = bridge.least(spaces)
    assert energy == pytest.approx(bridge.free, rel=1e-12) and not multipliers.any()
    np.testing.assert_allclose(bridge.forces(spaces, multipliers).ravel(), forces, atol=1e-9)
    flown = bridge.flown(forces.reshape(-1, 3))
    np.testing.assert_allclose(flown[-1], END, atol=1e-8)
    np.testing.assert_allclose(flown[bridge.ticks, :3], bridge.path, atol=1e-8)


@pytest.mark.parametrize('turns', [False, True])
@pytest.mark.parametrize('seed', range(4))
def test_within_half_spaces_it_is_the_optimum_of_slsqp(seed, turns):
    """Half-spaces are in axes that turn from tick to tick; SLSQP has them in LVLH."""
    rng = np.random.default_rng(seed)
    turned = Rotation.random(13, random_state=seed).as_matrix() if turns else None
    start = np.array([*rng.uniform(-20.0, 20.0, 3), *rng.uniform(-0.1, 0.1, 3)])
    bridge = Bridge(start, END, STEP, DT_S, 12, 1, turned)
    when, normals = rng.integers(0, len(bridge.ticks), 6), rng.normal(size=(6, 3))
    least = (bridge.path[when] * normals).sum(axis=1) + rng.uniform(-1.0, 2.0, 6)
    spaces = HalfSpaces(when, normals, least)
    energy, multipliers = bridge.least(spaces)
    powers, rows = rows_of_all(12)
    if turned is not None:
        normals = np.einsum('mab,mb->ma', turned[bridge.ticks[when]], normals)
    of_all = np.einsum('mi,mik->mk', normals, rows[bridge.ticks[when], :3])
    room = least - np.einsum('mi,mi->m', normals, (powers @ start)[bridge.ticks[when], :3])
    best = minimize(
        lambda f: (f @ f) * DT_S,
        np.zeros(36),
        jac=lambda f: 2.0 * f * DT_S,
        constraints=[
            {'type': 'eq', 'fun': lambda f: (rows[-1] @ f + powers[-1] @ start - END) * 10.0},
            {'type': 'ineq', 'fun': lambda f: of_all @ f - room},
        ],
        options={'maxiter': 300, 'ftol': 1e-12},
    )
    assert best.success and energy == pytest.approx(best.fun, rel=1e-5)
    forces = bridge.forces(spaces, multipliers)
    assert bridge.energy(forces) == pytest.approx(energy, rel=1e-6)
    flown = bridge.seen(bridge.flown(forces))[bridge.ticks]
    np.testing.assert_allclose(bridge.path_of(spaces, multipliers), flown, atol=1e-6)
    assert (of_all @ forces.ravel() - room).min() > -1e-6


def test_half_spaces_that_contradict_each_other_have_no_path():
    """Their bound grows without limit, and its multipliers stay finite."""
    bridge = Bridge(np.array([0.0, -20.0, 0.0, 0.0, 0.0, 0.0]), END, STEP, DT_S, 12, 1)
    normals = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])
    energy, multipliers = bridge.least(HalfSpaces(np.array([5, 5]), normals, np.array([1.0, 1.0])))
    assert energy > 1e6 and np.isfinite(multipliers).all()


def test_whatever_the_multipliers_are_their_value_is_a_bound(monkeypatch):
    """The number needs no trust in the solver: random multipliers never give more."""
    rng = np.random.default_rng(2)
    bridge = Bridge(np.array([0.0, -20.0, 0.0, 0.0, 0.0, 0.0]), END, STEP, DT_S, 12, 1)
    normals = rng.normal(size=(5, 3))
    spaces = HalfSpaces(np.arange(2, 7), normals, (bridge.path[2:7] * normals).sum(axis=1) + 1.0)
    right, multipliers = bridge.least(spaces)
    assert right > 1.5 * bridge.free
    for _ in range(200):
        wrong = multipliers * rng.uniform(0.0, 2.0, 5)
        scaled = wrong / multipliers.clip(1e-300)
        true = nnls

        def other(a, b, maxiter, scaled=scaled, true=true):
            return true(a, b, maxiter=maxiter)[0] * scaled, 0.0

        monkeypatch.setattr('rpo_judge.evaluation.plan_bound.nnls', other)
        assert bridge.least(spaces)[0] <= right * (1.0 + 1e-12)


STARTS = pytest.mark.parametrize(
    'start', [(0.0, -15.0, 2.0, 0.0, 0.0, 0.0), (9.0, -2.0, 0.0, 0.0, 0.02, 0.0)]
)


@pytest.mark.every_landing
@STARTS
def test_no_random_path_out_of_the_zones_is_below_the_bound(start):
    """Random forces on top of those of the best path found, which keep its end."""
    rng, length = np.random.default_rng(11), 12
    bridge = Bridge(np.array(start), END, STEP, DT_S, length, 1)
    lower = lower_bound(bridge, SMALL)
    best = best_path(bridge, SMALL, lower.path, np.inf)
    powers, rows = rows_of_all(length)
    clear = []
    for _ in range(5000):
        forces = best.forces.ravel() + rng.normal(size=36) * 10.0 ** rng.uniform(-6.0, -1.0)
        missing = END - powers[-1] @ start - rows[-1] @ forces
        forces += rows[-1].T @ np.linalg.solve(rows[-1] @ rows[-1].T, missing)
        path = (powers @ start + rows @ forces)[1:-1, :3]
        if SMALL.depth_m(path).max() <= 0.0:
            clear.append((forces @ forces) * DT_S)
    assert len(clear) > 300 and lower.energy <= min(clear) < 1.2 * lower.energy


@pytest.mark.slow
@pytest.mark.timeout(900)
@STARTS
def test_no_path_is_found_below_the_bound(start):
    """Of few ticks, all of which the bound looks at; SLSQP begins at random forces.

    A bound of one moment of entry alone would be above some of these paths.
    """
    rng, length = np.random.default_rng(7), 12
    bridge = Bridge(np.array(start), END, STEP, DT_S, length, 1)
    lower = lower_bound(bridge, SMALL)
    entries = {e: min(refuters(np.array(start), SMALL, length, (e,), 2, rng)) for e in range(6, 12)}
    found = [entries[entry] for entry in range(7, 12)]
    assert min(entries[6], entries[11]) > 1.03 * min(found)
    assert bridge.free < 0.9 * lower.energy
    assert min(found) >= lower.energy * (1.0 - 1e-4)
    assert min(found) <= 1.05 * lower.energy  # SLSQP looks at ticks as the bound does
    assert lower.closed and SMALL.depth_m(lower.path).max() < 0.2


@pytest.fixture(scope='module')
def few_ticks():
    """The search for bound and best path looks at fewer ticks, and is quick."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(plan_bound, 'BOUND_TICKS', 30)
        patch.setattr(plan_bound, 'PATH_TICKS', 60)
        yield


@pytest.fixture(scope='module')
def around(few_ticks):
    scenario = load_scenario('around')
    settings = scenario.section(Guidance)
    return scenario, settings, plan_bound.bound(settings, scenario)[1]


def outside_m(positions, half_angle_deg):
    """Return how far points lie outside the cone of the port, across its axis."""
    across = np.hypot(positions[:, 0], positions[:, 2])
    return across - np.tan(np.radians(half_angle_deg)) * (positions[:, 1] - 1.0)


def test_the_best_path_around_is_out_of_the_zones_and_the_bound_is_below_it(around):
    """Once it was 0.324 N^2 s, with the moment of entry of the plan."""
    scenario, _, found = around
    path = found.positions_m
    assert len(path) == 6001
    inside = np.linalg.norm(path[:-1], axis=1) < 10.0
    assert inside.any() and (outside_m(path[:-1][inside], 10.0) <= 0.0).all()
    # its force, from three positions of a tick each: second differences, and relative motion
    velocity = (path[2:] - path[:-2]) / 0.2
    x, z = path[1:-1, 0], path[1:-1, 2]
    n = scenario.mean_motion_rad_s
    pull = np.column_stack([3.0 * n * n * x + 2.0 * n * velocity[:, 1], -2.0 * n * velocity[:, 0],
                            -n * n * z])  # fmt: skip
    force = 10.0 * ((path[2:] - 2.0 * path[1:-1] + path[:-2]) / 0.01 - pull)
    assert (force**2).sum() * 0.1 == pytest.approx(found.best, rel=2e-3)
    assert np.abs(force).max() < scenario.max_force_n
    assert 0.94 * found.best < found.lower <= found.best < 0.206 < found.plan and found.closed


@pytest.fixture(scope='module')
def tumbling(few_ticks):
    scenario = load_scenario('tumbling_port')
    return scenario, plan_bound.bound(scenario.section(Guidance), scenario)[1]


def test_the_best_path_to_a_port_that_tumbles_is_in_its_corridor_and_the_bound_is_below(tumbling):
    scenario, found = tumbling
    path = found.positions_m
    inside = np.linalg.norm(path[:-1], axis=1) < 10.0
    assert inside.any() and (outside_m(path[:-1][inside], 10.0) <= 0.0).all()
    assert 0.95 * found.best < found.lower <= found.best < found.plan < 1.3 * found.best
    # in LVLH by the quaternions of the target; its force from three positions of a tick each
    q = [motion_of(scenario.target, scenario).attitude(k)[:4] for k in range(len(path))]
    x, y, z = Rotation.from_quat(q).apply(path).T
    n, dt = scenario.mean_motion_rad_s, scenario.dt_s
    (vx, vy), (ax, ay, az) = (
        [(r[2:] - r[:-2]) / (2.0 * dt) for r in (x, y)],
        [(r[2:] - 2.0 * r[1:-1] + r[:-2]) / dt**2 for r in (x, y, z)],
    )
    x, z = x[1:-1], z[1:-1]
    force = 10.0 * np.array(
        [ax - 3.0 * n * n * x - 2.0 * n * vy, ay + 2.0 * n * vx, az + n * n * z]
    )
    assert (force**2).sum() * dt == pytest.approx(found.best, rel=5e-3)


@pytest.mark.every_landing
def test_a_search_that_ends_early_has_a_bound_and_says_so(around, monkeypatch):
    monkeypatch.setattr('rpo_judge.evaluation.plan_bound.SETS', 40)
    scenario, settings, found = around
    _, early = plan_bound.bound(settings, scenario)
    assert not early.closed and 0.1 < early.lower < found.lower
    printed = invoke('plan', 'around')
    assert 'The search for this bound ended early' in ' '.join(printed.output.split())


def test_the_plan_around_is_near_the_best_with_its_margins(around):
    scenario, settings, found = around
    assert found.plan < 1.25 * found.best
    _, with_margins = plan_bound.bound(settings, scenario, margins=True)
    assert with_margins.plan == found.plan and with_margins.lower > found.lower
    assert with_margins.lower < with_margins.best and found.plan < 1.05 * with_margins.best
    assert np.linalg.norm(with_margins.positions_m, axis=1)[:4000].min() >= 13.0


def test_without_zones_the_bound_is_the_free_optimum():
    scenario = load_scenario('least_energy')
    _, found = plan_bound.bound(scenario.section(Guidance), scenario)
    assert found.lower == pytest.approx(found.best, rel=2e-6) and found.lower < found.best
    assert found.best < found.plan < 1.05 * found.best


def test_guidance_that_is_told_a_wrong_mass_needs_the_energy_of_the_true_one(around):
    """Also beside a target that keeps its attitude: it has the bound of a scenario without."""
    scenario, settings, found = around
    heavy = replace(scenario, mass_kg=11.0).equipped(Target(kind='fixed'))
    _, other = plan_bound.bound(replace(settings, mass_kg=10.0), heavy)
    assert other.plan == pytest.approx(1.21 * found.plan, rel=1e-9)
    assert other.lower == pytest.approx(1.21 * found.lower, rel=1e-3)


@pytest.mark.slow
def test_the_command_prints_both(monkeypatch):
    monkeypatch.setattr(plan_bound, 'BOUND_TICKS', 60)
    monkeypatch.setattr(plan_bound, 'PATH_TICKS', 150)
    printed = invoke('plan', 'around')
    assert printed.exit_code == 0
    said = ' '.join(printed.output.split())
    assert 'never come within 10 m of the target but in the cone of 10.0 degrees' in said
    assert 'the best found needs 0.2041: the plan 1.22' in said
    assert 'none needs less than 0.1988' in said


@pytest.mark.slow
@pytest.mark.timeout(1200)
def test_from_anywhere_the_bound_is_below_the_best_path_and_both_below_the_plan(few_ticks):
    scenario, rng = load_scenario('docking'), np.random.default_rng(5)
    settings = scenario.section(Guidance)
    shares = []
    for _ in range(20):
        direction = rng.normal(size=3)
        position = direction / np.linalg.norm(direction) * rng.uniform(50.0, 200.0)
        chosen = replace(
            scenario,
            initial_position_m=tuple(position.tolist()),
            initial_velocity_m_s=tuple(rng.uniform(-0.05, 0.05, 3).tolist()),
        )
        _, found = plan_bound.bound(settings, chosen)
        assert found.lower <= found.best <= found.plan
        shares.append((found.best / found.lower, found.plan / found.best))
    assert np.max(shares, axis=0)[0] < 1.12 and np.median(shares, axis=0)[1] < 1.3
