# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""True dynamics: SciPy's DOP853, Yamanaka and Ankersen, conserved quantities, known drifts."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from scipy.integrate import DOP853

from rpo_core.chain.chain import Chain
from rpo_core.chain.flight import OpenLoop, fly
from rpo_core.kernels.jit import as_table
from rpo_core.scenario import scenario
from rpo_core.stage import Place
from rpo_core.wire.interfaces import RELATIVE_STATE, THRUST_FORCE
from rpo_core.world import dynamics
from rpo_core.world.dynamics import Drag, Dynamics, environment_of, target_start

# Target and chaser in inertial axes, by DOP853: nothing of our orbit kernels.

TOLERANCE = 1e-13


def gravity(position, body, oblate):
    """Return the acceleration (3,) of a body whose pole is the z axis; J2 as textbooks print it."""
    x, y, z = position
    r = math.sqrt(position @ position)
    found = -body.mu_m3_s2 / r**3 * position
    if oblate:
        k = 1.5 * body.j2 * body.mu_m3_s2 * body.equator_m**2 / r**5
        s = 5.0 * z * z / (r * r)
        found = found - k * np.array([x * (1.0 - s), y * (1.0 - s), z * (3.0 - s)])
    return found


def drag(position, velocity, air, coefficient, reference_m):
    """Return the acceleration (3,) by an atmosphere that turns about the z axis."""
    if air is None:
        return np.zeros(3)
    wind = velocity - np.cross([0.0, 0.0, air.atmosphere_rate_rad_s], position)
    density = air.density_kg_m3
    if air.scale_height_m is not None:
        height = math.sqrt(position @ position) - reference_m
        density *= math.exp(-height / air.scale_height_m)
    return -0.5 * density * math.sqrt(wind @ wind) / coefficient * wind


def kepler_start(scenario):
    """Return the target's inertial state (6,), by rotation matrices."""
    d, mu = scenario.dynamics, scenario.body.mu_m3_s2
    nu, argument, tilt = (
        math.radians(a or 0.0)
        for a in (d.true_anomaly_deg, d.argument_of_periapsis_deg, d.inclination_deg)
    )
    p = scenario.orbit_radius_m * (1.0 - d.eccentricity**2)
    r = p / (1.0 + d.eccentricity * math.cos(nu))
    position = r * np.array([math.cos(nu), math.sin(nu), 0.0])
    velocity = math.sqrt(mu / p) * np.array([-math.sin(nu), d.eccentricity + math.cos(nu), 0.0])
    about_z = np.array(
        [
            [math.cos(argument), -math.sin(argument), 0.0],
            [math.sin(argument), math.cos(argument), 0.0],
            [0.0, 0.0, 1.0],
        ]
    )
    about_x = np.array(
        [
            [1.0, 0.0, 0.0],
            [0.0, math.cos(tilt), -math.sin(tilt)],
            [0.0, math.sin(tilt), math.cos(tilt)],
        ]
    )
    turn = about_x @ about_z
    return np.concatenate([turn @ position, turn @ velocity])


class Inertial:
    """The motion of both spacecraft: (target's position, velocity, chaser's less the target's)."""

    def __init__(self, scenario):
        self.scenario, self.d = scenario, scenario.dynamics

    def target_pull(self, position, velocity):
        air = self.d.drag
        coefficient = air.target_ballistic_coefficient_kg_m2 if air else 1.0
        found = gravity(position, self.scenario.body, self.d.j2)
        return found + drag(position, velocity, air, coefficient, self.scenario.orbit_radius_m)

    def chaser_pull(self, position, velocity):
        air = self.d.drag
        coefficient = air.chaser_ballistic_coefficient_kg_m2 if air else 1.0
        found = gravity(position, self.scenario.body, self.d.j2)
        return found + drag(position, velocity, air, coefficient, self.scenario.orbit_radius_m)

    def frame(self, target):
        """Return the axes of LVLH as columns (3, 3), and its rate (3,), inertial."""
        r, v = target[:3], target[3:]
        h = np.cross(r, v)
        x, z = r / np.linalg.norm(r), h / np.linalg.norm(h)
        normal = self.target_pull(r, v) @ z
        rate = h / (r @ r) + (np.linalg.norm(r) / np.linalg.norm(h)) * normal * x
        return np.column_stack([x, np.cross(z, x), z]), rate

    def to_inertial(self, target, state):
        axes, rate = self.frame(target)
        r = axes @ state[:3]
        return np.concatenate([r, axes @ state[3:] + np.cross(rate, r)])

    def to_lvlh(self, target, relative):
        axes, rate = self.frame(target)
        r = relative[:3]
        return np.concatenate([axes.T @ r, axes.T @ (relative[3:] - np.cross(rate, r))])

    def rate(self, _t_s, y, force):
        """Return the derivative of the motion (12,) under a force (3,) in the axes of LVLH."""
        r, v, d, u = y.reshape(4, 3)
        pulled = self.target_pull(r, v)
        push = self.frame(y[:6])[0] @ force / self.scenario.mass_kg if force.any() else 0.0
        return np.concatenate([v, pulled, u, self.chaser_pull(r + d, v + u) - pulled + push])

    def drift(self, forces=((0.0, 0.0, 0.0),), each_s=None):
        """Return the last state (6,), target LVLH, under forces (n, 3), each held for `each_s`."""
        each_s = each_s or self.scenario.duration_s
        target = kepler_start(self.scenario)
        y = np.concatenate([target, self.to_inertial(target, np.array(self.scenario.start))])
        for number, force in enumerate(forces):
            rate = partial(self.rate, force=np.array(force))
            solver = DOP853(
                rate, number * each_s, y, (number + 1) * each_s, rtol=TOLERANCE, atol=1e-12
            )
            while solver.status == 'running':
                solver.step()
            y = solver.y
        return self.to_lvlh(y[:6], y[6:])


BASE = replace(
    scenario.load_scenario('approach'),
    initial_position_m=(100.0, 100.0, -100.0),  # 173 m
    initial_velocity_m_s=(0.1, -0.2, 0.05),
)
AIR = Drag(
    density_kg_m3=2e-11,
    target_ballistic_coefficient_kg_m2=150.0,
    chaser_ballistic_coefficient_kg_m2=110.0,
    scale_height_m=5e4,
    atmosphere_rate_rad_s=7.292e-5,
)
PLACE = {'inclination_deg': 51.6, 'argument_of_periapsis_deg': 30.0, 'true_anomaly_deg': 50.0}
WORLDS = {
    'circular': {},
    'elliptic': {'eccentricity': 0.02},
    'j2': {'j2': True},
    'drag': {'drag': AIR},
    'all': {'eccentricity': 0.02, 'j2': True, 'drag': AIR},
}
REST = OpenLoop(np.zeros((1, 3)))


def true(base=BASE, **options):
    """Return a scenario with true gravity."""
    return base.equipped(Dynamics(kind='two_body', **{**PLACE, **options}))


@pytest.mark.parametrize(
    'duration_s', [400.0, pytest.param(10861.6, marks=pytest.mark.every_landing)]
)
@pytest.mark.parametrize('options', WORLDS.values(), ids=WORLDS)
def test_a_drift_is_that_of_dop853(options, duration_s):
    """From 173 m, at a tolerance of 1e-13; after two orbits less is asked of the position."""
    base = replace(BASE, duration_s=duration_s)
    flown = true(base, **options)
    error = fly(flown, REST).states[-1] - Inertial(flown).drift()
    assert np.linalg.norm(error[:3]) < (1e-8 if duration_s == 400.0 else 1e-6)
    assert np.linalg.norm(error[3:]) < (1e-10 if duration_s == 400.0 else 1e-9)
    plain = fly(base, REST).states[-1] - fly(flown, REST).states[-1]
    assert np.linalg.norm(plain[:3]) > 1e-4  # the oracle would see what is missing


def test_forces_turn_with_the_frame():
    flown = true(replace(BASE, duration_s=200.0), **WORLDS['all'])
    rng = np.random.default_rng(5)
    forces = rng.uniform(-0.5, 0.5, (20, 3))
    flight = fly(flown, OpenLoop(np.repeat(forces, 100, axis=0)))
    error = flight.states[-1] - Inertial(flown).drift(forces, 10.0)
    assert np.linalg.norm(error[:3]) < 1e-8 and np.linalg.norm(error[3:]) < 1e-10


def test_drag_slows_a_chaser_of_half_its_mass_twice_as_much():
    """As a chaser of half the ballistic coefficient, bit for bit."""
    flown = true(**WORLDS['all'])
    heavy = environment_of(flown.dynamics, flown)
    light = heavy._replace(chaser=2.0 * heavy.chaser)
    row = as_table(dynamics.orbit_row(target_start(flown.dynamics, flown), heavy))
    still = (flown.start, (0.0, 0.0, 0.0))
    after = dynamics.relative_rate(*still, 2.0, row, heavy)
    assert after == dynamics.relative_rate(*still, 1.0, row, light)
    assert after != dynamics.relative_rate(*still, 1.0, row, heavy)


def test_long_ticks_have_several_steps():
    flown = true(replace(BASE, dt_s=100.0), eccentricity=0.02)
    error = fly(flown, REST).states[-1] - Inertial(flown).drift()
    assert np.linalg.norm(error[:3]) < 1e-7


def test_on_a_circle_linear_gravity_is_clohessy_and_wiltshire():
    linear = fly(BASE.equipped(Dynamics(kind='linear_elliptic')), REST)
    plain = fly(BASE, REST)
    np.testing.assert_allclose(linear.states[:, :3], plain.states[:, :3], rtol=0, atol=1e-10)
    np.testing.assert_allclose(linear.states[:, 3:], plain.states[:, 3:], rtol=0, atol=1e-13)
    named = fly(BASE.equipped(Dynamics(kind='clohessy_wiltshire')), REST)
    assert named.states.tobytes() == plain.states.tobytes()


def yamanaka_ankersen(flown, t_s):
    """Return the state (6,) of free drift: JGCD 25 (1), 2002, x here is their -z, y their x.

    In their scaled variables, r~ = rho r with the true anomaly as time, the solution is closed
    but for an integral that grows with time, J = k^2 t.
    """
    d, mu = flown.dynamics, flown.body.mu_m3_s2
    e, nu = d.eccentricity, math.radians(d.true_anomaly_deg)
    a = flown.orbit_radius_m
    h = math.sqrt(mu * a * (1.0 - e * e))
    k2 = h / (a * (1.0 - e * e)) ** 2  # k^2 = h / p^2
    n = math.sqrt(mu / a**3)

    def eccentric(nu):
        return 2.0 * math.atan(math.sqrt((1.0 - e) / (1.0 + e)) * math.tan(nu / 2.0))

    mean = eccentric(nu) - e * math.sin(eccentric(nu)) + n * t_s
    big = mean
    for _ in range(50):
        big -= (big - e * math.sin(big) - mean) / (1.0 - e * math.cos(big))
    later = 2.0 * math.atan(math.sqrt((1.0 + e) / (1.0 - e)) * math.tan(big / 2.0))

    def scaled(nu, r, v):
        rho = 1.0 + e * math.cos(nu)
        return rho * r, -e * math.sin(nu) * r + v / (k2 * rho)

    def unscaled(nu, r, v):
        rho = 1.0 + e * math.cos(nu)
        return r / rho, k2 * (e * math.sin(nu) * r + rho * v)

    def basis(nu, t):
        """Columns: solutions (x, z, x', z') of the motion in the plane, their x along V-bar."""
        rho = 1.0 + e * math.cos(nu)
        s, c = rho * math.sin(nu), rho * math.cos(nu)
        s1 = math.cos(nu) + e * math.cos(2.0 * nu)
        c1 = -(math.sin(nu) + e * math.sin(2.0 * nu))
        j = k2 * t
        return np.array(
            [
                [1.0, -c * (1.0 + 1.0 / rho), s * (1.0 + 1.0 / rho), 3.0 * rho**2 * j],
                [0.0, s, c, 2.0 - 3.0 * e * s * j],
                [0.0, 2.0 * s, 2.0 * c - e, 3.0 * (1.0 - 2.0 * e * s * j)],
                [0.0, s1, c1, -3.0 * e * (s1 * j + s / rho**2)],
            ]
        )

    x, y, z, vx, vy, vz = flown.start
    along, up = scaled(nu, y, vy), scaled(nu, -x, -vx)
    weights = np.linalg.solve(basis(nu, 0.0), [along[0], up[0], along[1], up[1]])
    y1, x1, vy1, vx1 = basis(later, t_s) @ weights
    across, turned = scaled(nu, z, vz), later - nu
    z1 = across[0] * math.cos(turned) + across[1] * math.sin(turned)
    vz1 = -across[0] * math.sin(turned) + across[1] * math.cos(turned)
    (x1, vx1), (y1, vy1), (z1, vz1) = (
        unscaled(later, *pair) for pair in ((-x1, -vx1), (y1, vy1), (z1, vz1))
    )
    return np.array([x1, y1, z1, vx1, vy1, vz1])


@pytest.mark.parametrize('eccentricity', [0.001, 0.1, 0.6])
def test_linear_motion_about_an_ellipse_is_that_of_yamanaka_and_ankersen(eccentricity):
    high = replace(BASE, orbit_radius_m=1.7e7)
    flown = high.equipped(
        Dynamics(kind='linear_elliptic', eccentricity=eccentricity, true_anomaly_deg=40.0)
    )
    error = fly(flown, REST).states[-1] - yamanaka_ankersen(flown, flown.duration_s)
    assert np.linalg.norm(error[:3]) < 1e-8 and np.linalg.norm(error[3:]) < 1e-10


def test_j2_turns_the_node_at_its_secular_rate():
    """-3/2 J2 (Re / p)^2 n cos i: about -5 degrees a day at 51.6 degrees."""
    flown = true(replace(BASE, orbit_radius_m=6.778e6), true_anomaly_deg=0.0, j2=True)
    settings, n = flown.dynamics, flown.mean_motion_rad_s
    target, world = target_start(settings, flown), environment_of(settings, flown)
    orbits, steps = 15, 1500
    for _ in range(orbits * steps):
        rate = dynamics.target_rate(target, world)
        target = dynamics.target_step(target, rate, 2.0 * math.pi / n / steps, world)
    hx, hy, _ = np.cross(target[:3], target[3:])
    turned = math.atan2(hx, -hy)
    shape = (flown.body.equator_m / flown.orbit_radius_m) ** 2
    rate = -1.5 * flown.body.j2 * shape * n * math.cos(math.radians(51.6))
    assert turned == pytest.approx(rate * orbits * 2.0 * math.pi / n, rel=0.01)
    assert math.degrees(turned) < -4.0


def test_the_target_starts_where_kepler_puts_it():
    high = replace(BASE, orbit_radius_m=1e7)
    flown = true(high, eccentricity=0.3, inclination_deg=63.4, true_anomaly_deg=200.0)
    np.testing.assert_allclose(target_start(flown.dynamics, flown), kepler_start(flown), rtol=1e-14)


def test_our_exponential_is_right():
    values = np.concatenate([np.linspace(-60.0, 60.0, 4001), [-699.9, 699.9, 0.0, 1e-300]])
    mine = np.array([dynamics.exponential(float(x)) for x in values])
    np.testing.assert_allclose(mine, np.exp(values), rtol=3e-15)
    assert dynamics.exponential(-1e9) == 0.0 and dynamics.exponential(0.0) == 1.0


def test_a_tick_is_a_function_of_its_number_and_inputs():
    """Any order of the ticks, over blocks of the orbit, gives the same bits, as verify needs."""
    flown = true(replace(BASE, duration_s=900.0), **WORLDS['all'])
    flight = fly(flown, REST)
    stage = Chain.of(flown).part(Place.DYNAMICS).links[0].stage
    zero = np.zeros(3)
    for tick in (8999, 0, 5000, 2047, 2048, 1):
        (after,) = stage.step(tick, tuple(flight.states[tick]), tuple(zero), tuple(zero))
        assert np.array(after).tobytes() == flight.states[tick + 1].tobytes()
    ticks, calm = np.arange(9000), np.zeros((9000, 3))
    (after,) = stage.steps(ticks, flight.states[:-1], calm, calm)
    assert after.tobytes() == flight.states[1:].tobytes()
    assert {RELATIVE_STATE, THRUST_FORCE} <= set(Chain.of(flown).outputs)


def rows_of(flown):
    """Return the target's orbit, two rows a tick of one step."""
    world, target = environment_of(flown.dynamics, flown), target_start(flown.dynamics, flown)
    rate, rows = dynamics.target_rate(target, world), [dynamics.orbit_row(target, world)]
    for _ in range(flown.ticks):
        after = dynamics.target_step(target, rate, flown.dt_s, world)
        rate_after = dynamics.target_rate(after, world)
        half = dynamics.middle(target, rate, after, rate_after, flown.dt_s)
        rows += [dynamics.orbit_row(half, world), dynamics.orbit_row(after, world)]
        target, rate = after, rate_after
    return np.array(rows)


def test_the_target_keeps_its_energy_and_its_momentum_about_the_pole():
    flown = true(replace(BASE, dt_s=1.0, duration_s=6000.0), eccentricity=0.02, j2=True)
    radius, _, rate, out, across, _, _, pole_z = rows_of(flown).T[:8]
    body = flown.body
    # sin of latitude is the pole's component along x
    latitude = rows_of(flown)[:, 5]
    oblate = body.j2 * (body.equator_m / radius) ** 2 * (1.5 * latitude**2 - 0.5)
    energy = 0.5 * (out**2 + across**2) - body.mu_m3_s2 / radius * (1.0 - oblate)
    momentum = radius * across * pole_z
    np.testing.assert_allclose(energy / energy[0], 1.0, rtol=0, atol=1e-12)
    np.testing.assert_allclose(momentum / momentum[0], 1.0, rtol=0, atol=1e-12)
    np.testing.assert_allclose(rate, across / radius, rtol=1e-15)
    assert np.ptp(radius * across) / radius[0] / across[0] > 1e-4  # the plane does move
