# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The proof of docs/safety.md, by machine: lemmas and theorem at the corners of what may happen.

The world steps with the exact matrices of SciPy, not with the kernels of the filter.
"""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from core_oracles import exact_step
from landing import rest_at_landing

from rpo_core.assurance import filters, kernels
from rpo_core.assurance.assumed import largest_n
from rpo_core.assurance.assurance import AssuranceStage
from rpo_core.assurance.guard import errors_of, guard_of
from rpo_core.assurance.kernels import APPROACH, OPEN, approach_margins
from rpo_core.assurance.settings import Assurance, Passage
from rpo_core.attitude.attitude_kernels import LVLH
from rpo_core.scenario import scenario
from rpo_core.thrusters.thrusters import Thrusters
from rpo_core.world.disturbance import Disturbance, Harmonic

PAPER = scenario.load_scenario('paper_test')
ZONE = 10.0
BOUNDS = {'thrust_error': 0.05, 'disturbance_n': 0.05}
NAVIGATION = {'position_error_m': 0.1, 'velocity_error_m_s': 0.004}
CORRIDOR = Passage('+y', 10.0, 1.0, 20.0)
CORNERS = [
    np.array(corner) / np.linalg.norm(corner)
    for corner in itertools.product((-1, 0, 1), repeat=3)
    if any(corner)
]


MOMENTS = [
    exact_step(PAPER.mean_motion_rad_s, PAPER.mass_kg, PAPER.dt_s * part / 8)
    for part in range(1, 9)
]


def test_a_tick_of_the_needed_deceleration_keeps_the_stopping_distance():
    """Lemma 1: the authority is enough, the path stays clear, and one can still stop after it."""
    random = np.random.default_rng(1)
    for _ in range(4000):
        authority, dt_s = 10.0 ** random.uniform(-3, 0), 10.0 ** random.uniform(-2, 0.5)
        speed = random.uniform(-1, 3) * authority * dt_s * 10.0 ** random.uniform(-1, 2)
        edge = max(speed, 0.0) ** 2 / (2 * authority)
        gap = edge + random.choice([0.0, random.exponential(0.3)]) * (authority * dt_s**2 + edge)
        need = kernels.needed_deceleration(gap, speed, authority, dt_s)
        assert need <= authority * (1 + 1e-9)
        times = np.linspace(0.0, dt_s, 33)
        for more in (0.0, 0.1 * authority):
            path = gap - speed * times + 0.5 * (need + more) * times**2
            after = max(speed - (need + more) * dt_s, 0.0)
            tolerance = 1e-9 * (abs(speed) * dt_s + gap + 1e-9)
            assert path.min() >= -tolerance
            assert path[-1] - after**2 / (2 * authority) >= -tolerance


def test_less_than_the_needed_deceleration_is_too_little():
    need = kernels.needed_deceleration(1.0, 0.3, 0.05, 0.1)
    after = 0.3 - (need - 1e-3) * 0.1
    assert 1.0 - 0.05 * (0.3 + after) < after**2 / (2 * 0.05)


def states_at_the_edge(guard, errors):
    """Return true states of the OPEN set with one of its constraints, or both, tight."""
    random = np.random.default_rng(2)
    for clear, corner, turn in itertools.product(
        (0.0, 1e-3, 0.1, 2.0, 30.0, 150.0), CORNERS, range(4)
    ):
        r = (guard.keep_out_m + clear) * corner
        across = np.cross(corner, random.normal(size=3))
        across /= np.linalg.norm(across)
        top = kernels.speed_limit(np.linalg.norm(r), guard) * (1 - 1e-9)
        stop = np.sqrt(2 * clear * kernels.authority(np.linalg.norm(r), guard)) * (1 - 1e-9)
        closing = (min(stop, top), min(stop, top), 0.0, -top)[turn]
        lateral = np.sqrt(max(top**2 - closing**2, 0.0)) * (turn != 0)
        v = -closing * corner + lateral * across
        state = np.concatenate([r, v])
        if turn == 3:  # receding, as fast as is allowed, and a little across
            state[3:] = 0.9 * top * corner + 0.4 * top * across
        assert min(kernels.open_margins(tuple(state), 0.0, 0.0, guard)) >= -1e-12
        yield state


def worst_cases(state, errors, number):
    """Return what the chaser sees, what pushes, and how the thrust errs, at their bounds."""
    random = np.random.default_rng(number)
    e = state[:3] / np.linalg.norm(state[:3])
    directions = [e, -e, *random.permutation(CORNERS)[:2]]
    for u, w in itertools.product(directions[:3], directions[:2]):
        seen = state + np.concatenate(
            [errors.position_m * u, errors.velocity_m_s * directions[random.integers(4)]]
        )
        yield seen, errors.disturbance_n * -w, random.choice([-1.0, 1.0])


def step_of(state, command_n, push_n, sign, errors):
    """Return the states at eight moments of a tick."""
    exerted = command_n * (1.0 + sign * errors.thrust)
    return np.array([a @ state + b @ (exerted + push_n) for a, b in MOMENTS])


def broken(settings, assumed, hostile):
    """Return how many steps from the edge of the set leave it, or cross the zone."""
    guard = guard_of(assumed, PAPER)
    errors = errors_of(settings, PAPER)
    left = 0
    for number, state in enumerate(states_at_the_edge(guard, errors)):
        for seen, push, sign in worst_cases(state, errors, number):
            command = hostile(seen)
            *force, _, _, _, _ = filters.assure(
                tuple(seen), command, (0.0,) * 3, OPEN, 0, LVLH, LVLH, PAPER.step, guard, guard
            )
            assert max(map(abs, force)) <= guard.limit_n
            path = step_of(state, np.array(force), push, sign, errors)
            inside = np.linalg.norm(path[:, :3], axis=1).min() < ZONE
            left += inside or kernels.open_margins(tuple(path[-1]), 0.0, 0.0, guard)[0] < 0.0
            speed = np.linalg.norm(path[-1, 3:])
            if not errors.velocity_m_s:
                left += speed > kernels.speed_limit(np.linalg.norm(path[-1, :3]), guard)
    return left


def towards(seen):
    """Full thrust at the target."""
    return tuple(-2.0 * seen[:3] / np.linalg.norm(seen[:3]))


def faster(seen):
    """Full thrust along the velocity."""
    return tuple(2.0 * seen[3:] / (np.linalg.norm(seen[3:]) + 1e-9))


@pytest.mark.parametrize('hostile', [towards, faster])
@pytest.mark.parametrize('name', ['least_change', 'simplex'])
@pytest.mark.parametrize('errors', rest_at_landing([{**BOUNDS, **NAVIGATION}, {}, BOUNDS]), ids=len)
def test_no_step_from_the_edge_leaves_the_set(hostile, name, errors):
    """The theorem, and the path between the ticks, at corners of states, errors and forces."""
    settings = Assurance(filter=name, keep_out_m=ZONE, **errors)
    assert broken(settings, settings, hostile) == 0


@pytest.mark.parametrize('speed', ['paper', 'sqrt', 'afrl'])
def test_the_speed_limit_never_falls_faster_than_the_thrusters_brake(speed):
    """Lemma 3: half the square of the limit falls by at most `slowing_m_s2` per metre."""
    guard = guard_of(Assurance(speed=speed, keep_out_m=ZONE), PAPER)
    ranges = np.concatenate([np.linspace(0.0, 2.0, 2001), np.linspace(2.0, 600.0, 5001)[1:]])
    limits = np.array([kernels.speed_limit(r, guard) for r in ranges])
    slopes = np.diff(0.5 * limits**2) / np.diff(ranges)
    assert slopes.max() <= guard.slowing_m_s2 * (1 + 1e-6)
    assert slopes.min() >= 0.0
    own = guard.speed_m_s + guard.speed_1_s * ranges
    own += np.sqrt(2 * guard.deceleration_m_s2 * ranges)
    assert (limits <= own + 1e-12).all()


def test_gravity_takes_at_most_n2_of_a_range():
    """Lemma 2: with what the lateral speed adds, -n^2 rho is below every radial acceleration."""
    n = PAPER.mean_motion_rad_s
    random = np.random.default_rng(3)
    r, v = random.normal(size=(2, 100_000, 3)) * [[[50.0]], [[0.3]]]
    # At the scale of n rho, where gravity and Coriolis weigh as much as what lateral speed adds.
    v[::2] = random.normal(size=(50_000, 3)) * n * 100.0
    rho = np.linalg.norm(r, axis=1)
    pull = np.stack(
        [3 * n * n * r[:, 0] + 2 * n * v[:, 1], -2 * n * v[:, 0], -n * n * r[:, 2]], axis=1
    )
    radial = (r * v).sum(axis=1) / rho
    second = ((v**2).sum(axis=1) - radial**2) / rho + (r * pull).sum(axis=1) / rho
    assert (second / (n * n * rho)).min() >= -1.0 - 1e-9
    assert (second / (n * n * rho)).min() < -0.99  # there is no better one


def closest(scenario):
    """Return how near a chaser comes whose thrusters are 5 ticks late; it may just stop."""
    settings = Assurance(keep_out_m=ZONE, disturbance_n=0.05)
    stage, errors = AssuranceStage(settings, scenario), errors_of(settings, scenario)
    state, line, nearest = np.array([0.0, 60.0, 0.0, 0.0, 0.0, 0.0]), [np.zeros(3)] * 5, np.inf
    for tick in range(1500):
        (force,) = stage.step(tick, tuple(state.tolist()), (0.0, -0.5, 0.0))
        line.append(np.array(force))
        path = step_of(state, line.pop(0), np.array([0.0, -0.05, 0.0]), 0.0, errors)
        nearest = min(nearest, np.linalg.norm(path[:, :3], axis=1).min())
        state = path[-1]
    return nearest


def test_commands_on_their_way_are_counted():
    assert ZONE <= closest(PAPER.equipped(Thrusters(delay_ticks=5))) < ZONE + 0.05
    assert closest(PAPER) < ZONE, 'a delay that is not counted leads into the zone'


def states_in_the_corridor(guard):
    """Return states of the APPROACH set, near its walls, fast, or both."""
    random = np.random.default_rng(4)
    found = []
    while len(found) < 300:
        d = 8.0 * random.uniform() ** 2 + 0.01
        half = guard.width_m + guard.slope * d
        p, q = half * random.uniform(-1, 1, 2)
        along = -random.uniform(0, 1) * np.sqrt(0.01 + 2 * guard.wall_m_s2 * d)
        v = [0.05 * random.normal(), along, 0.05 * random.normal()]
        state = np.array([q, guard.port_m + d, p, *v])
        if min(approach_margins(tuple(state), 0.0, 0.0, guard)) >= 0.0:
            found.append(state)
    return found


@pytest.mark.parametrize('name', ['least_change', 'simplex'])
@pytest.mark.parametrize('errors', [BOUNDS, {**BOUNDS, 'position_error_m': 0.01}], ids=len)
def test_no_step_in_the_corridor_leaves_its_walls(name, errors):
    """Lemma 4: walls and speeds of the corridor, or the way out of it, at corners."""
    settings = Assurance(filter=name, keep_out_m=ZONE, corridor=CORRIDOR, **errors)
    guard, bounds = guard_of(settings, PAPER), errors_of(settings, PAPER)
    for number, state in enumerate(states_in_the_corridor(guard)):
        for corner, (seen, push, sign) in zip(
            CORNERS[number % 13 :], worst_cases(state, bounds, number), strict=False
        ):
            given = tuple(seen), tuple(0.5 * corner), (0.0,) * 3, APPROACH
            *force, mode, _, _, _ = filters.assure(*given, 0, LVLH, LVLH, PAPER.step, guard, guard)
            if mode == kernels.CONTACT:
                continue
            path = step_of(state, np.array(force), push, sign, bounds)
            after = tuple(path[-1])
            walls, slower = approach_margins(after, 0.0, 0.0, guard)
            assert walls >= 0.0 or kernels.open_margins(after, 0.0, 0.0, guard)[0] >= 0.0
            assert slower >= -1e-3 * bool(errors.get('position_error_m')) or walls < 0.0
            for x, y, z, *_ in path:
                half = CORRIDOR.width_m + guard.slope * max(y - CORRIDOR.port_m, 0.0)
                assert max(abs(x), abs(z)) <= half or np.hypot(np.hypot(x, y), z) >= ZONE


def test_the_bound_of_a_disturbance_is_the_largest_one_of_any_time():
    waves = Harmonic('x', 'sin', 0.02, 0.1), Harmonic('z', 'sin', -0.04, 0.1)
    push = Disturbance((0.01, 0.0, -0.03), waves[:1]), Disturbance((0.01, 0.0, -0.03), waves)
    most = [np.linalg.norm(some.over(range(2000), 500_000_000), axis=1).max() for some in push]
    assert largest_n(push[0]) == pytest.approx(most[0], rel=1e-3)
    assert most[1] <= largest_n(push[1]) == pytest.approx(np.hypot(0.03, 0.07))


def test_the_guard_is_what_the_proof_says():
    """The constants of the paper's test, recomputed by hand from docs/safety.md."""
    n2 = PAPER.mean_motion_rad_s**2
    settings = Assurance(keep_out_m=ZONE, position_error_m=0.2, disturbance_n=0.05)
    guard = guard_of(settings, PAPER)
    plain = guard_of(replace(settings, position_error_m=0.0), PAPER)
    assert plain.authority_m_s2 == pytest.approx((0.475 - 0.05) / 10.0, abs=5e-4)
    assert guard.authority_m_s2 < plain.authority_m_s2
    assert guard.tide_1_s2 == n2
    assert guard.slowing_m_s2 == pytest.approx(0.9 * ((0.475 - 0.05) / 10.0 - 1500.0 * n2))
    assert 0.0 < guard.keep_out_m - ZONE < 1e-3
