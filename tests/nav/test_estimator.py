# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The estimator against filterpy, and against what sensors may do."""

from __future__ import annotations

import numpy as np
import pytest
from filterpy.kalman import predict, update
from hypothesis import given, settings
from hypothesis import strategies as st
from nav_scenarios import LIDAR, PD, TUMBLE, TUMBLING, attitude_scenario, make
from scipy.spatial.transform import Rotation

from rpo_core.attitude.target import motion_of
from rpo_core.chain.flight import fly
from rpo_core.kernels import jit
from rpo_core.navigation import estimator
from rpo_core.navigation.estimator import Estimator, EstimatorStage, gate
from rpo_core.navigation.sensors import Sensors, across
from rpo_core.wire.interfaces import NAVIGATION_COVARIANCE
from rpo_core.world import cw

POSITION = {
    'kind': 'relative_position',
    'noise_floor_m': 0.05,
    'velocity_floor_m_s': 0.002,
}  # linear, with a constant R: filterpy's filter


class Oracle:
    """The filter of a scenario by filterpy's matrices: each measurement is taken at its tick.

    accepted, rejected, restarts : how many of the measurements that can come no more
    """

    def __init__(self, flown, first):
        own, sensors = flown.section(Estimator), flown.section(Sensors)
        self.own, self.flown, self.units, self.port_m = own, flown, sensors.units, sensors.port_m
        n, mass = own.states, own.mass_kg or flown.mass_kg
        motion, push = cw.matrices(cw.discretise(flown.mean_motion_rad_s, mass, flown.dt_s))
        self.f, self.b = np.eye(n), np.vstack([push, np.zeros((n - 6, 3))])
        self.f[:6] = np.hstack([motion, push])[:, :n]
        self.push, self.mass = self.b @ self.b.T / flown.dt_s, mass
        self.walk = np.diag([0.0] * 6 + [own.disturbance_walk_n_s0_5**2 * flown.dt_s] * 3)[:n, :n]
        self.x = np.array([*first, 0.0, 0.0, 0.0])[:n]
        self.p = self.spread(own.velocity_sigma_m_s)
        self.target = motion_of(flown.target.known, flown) if flown.target else None
        self.accepted = self.rejected = self.restarts = self.in_a_row = self.newest = 0

    def spread(self, velocity):
        own = self.own
        sigmas = [own.position_sigma_m] * 3 + [velocity] * 3 + [own.disturbance_sigma_n] * 3
        return np.diag(np.square(sigmas[: len(self.x)]))

    def port(self, tick):
        """Return from where the chaser is measured: the port of the target as it is known."""
        if self.target is None:
            return np.zeros(3)
        return Rotation.from_quat(self.target.attitude(tick)[:4]).apply(self.port_m)

    def model(self, unit, x, message, port):
        """Return what of a message is a measurement, its matrix and its covariance."""
        m, distance = np.array(message[:6]), np.linalg.norm(x[:3] - port)
        u = (x[:3] - port) / distance
        rows, floor, scale = [u, *across(*u.tolist())], unit.noise_floor_m, self.own.noise_scale
        side = unit.noise_share if unit.kind == 'relative_position' else unit.bearing_noise_rad
        sigmas = [max(floor, share * distance) for share in (unit.noise_share, side, side)]
        if unit.kind == 'bearing':
            rows, sigmas, m = rows[1:], sigmas[1:], distance * m
        h = np.hstack([rows, np.zeros((len(rows), len(x) - 3))])
        z = np.array(rows) @ (m[:3] + port)
        if unit.velocity_floor_m_s > 0.0:
            h, z = np.vstack([h, np.eye(3, len(x), 3)]), np.array([*z, *m[3:]])
            sigmas += [max(unit.velocity_floor_m_s, unit.velocity_share_1_s * distance)] * 3
        return z, h, np.diag(np.square(scale * np.array(sigmas)))

    def trouble(self, tick):
        """Return what the filter says at a tick; of the only restart there is, at tick 20."""
        silent = tick - max(unit.latency_ticks for unit in self.units) - self.newest
        if self.restarts:
            return 'the estimator diverged: it was restarted 1 times, the last time at tick 20'
        if silent > 10 * max(unit.period_ticks for unit in self.units):
            return f'the estimator is coasting: no measurement was taken for {silent} ticks'
        return ''

    def tick(self, tick, x, p, commands, came, last):
        """Return state and covariance at a tick; last : whether all of it has come."""
        own = self.own
        if tick > 0:
            u = np.clip(commands[tick], -0.5, 0.5)
            density = (own.acceleration_noise_m_s1_5 * self.mass) ** 2
            density += own.thrust_noise_s0_5**2 * (u @ u)
            x, p = predict(x, p, self.f, self.push * density + self.walk, u, self.b)
        for i, unit in enumerate(self.units):
            message = came.get((tick, i))
            if message is None:
                continue
            z, h, r = self.model(unit, x, message, self.port(tick))
            found = update(x, p, z, r, h, return_all=True)
            taken = found[2] @ np.linalg.solve(found[4], found[2]) <= gate(len(z), own.gate_sigmas)
            if taken or own.gate_sigmas == 0.0:
                x, p = found[:2]
            if last:
                self.accepted, self.rejected = self.accepted + taken, self.rejected + (not taken)
                self.in_a_row = 0 if taken else self.in_a_row + 1
                self.newest = tick if taken else self.newest
                if self.in_a_row == own.restart_after > 0:
                    self.restarts, self.in_a_row = self.restarts + 1, 0
                    x, p = x.copy(), self.spread(own.restart_velocity_sigma_m_s)
                    x[6:] = 0.0
                    x[:3] = x[:3] if unit.kind == 'bearing' else message[:3]
                    x[3:6] = message[3:6] if unit.velocity_floor_m_s > 0.0 else x[3:6]
        return x, p


SCALED = {**POSITION, 'noise_share': 0.01, 'velocity_share_1_s': 0.001}
CAMERA = {'kind': 'bearing', 'bearing_noise_rad': 5e-4}
TURNING = {'attitude': TUMBLING, 'attitude_control': {'controller': 'attitude_pd'}}
PORT = {
    **TURNING,
    'target': {**TUMBLE, 'known_error_deg': [3.0, -2.0, 4.0]},
    'zones': {'port_m': [0.3, 1.2, -0.5]},
}
FIXED = {'body_fixed': True}
AT_PORT = {'looks_at': 'port', **FIXED}
OUTLYING = {**LIDAR, 'outlier_share': 0.3, 'outlier_size_m': 1.0, 'dropout_share': 0.1}
CASES = {
    'prompt': ([POSITION], {}),
    'late': ([{**SCALED, 'latency_ticks': 3}], {'noise_scale': 3.0}),
    'of two latencies': ([{**LIDAR, 'latency_ticks': 3}, {**POSITION, 'period_ticks': 3}], {}),
    'outlying': ([{**OUTLYING, 'latency_ticks': 2}], {'gate_sigmas': 4.0, 'noise_scale': 1.5}),
    'diverged': (
        [{**LIDAR, 'bias_m': [30.0, 0.0, 0.0], 'latency_ticks': 1}], {'disturbance_sigma_n': 0.01}
    ),
    'disturbed': ([LIDAR], {'disturbance_sigma_n': 0.01, 'disturbance_walk_n_s0_5': 1e-3}),
    'of other thrust': (
        [{**LIDAR, 'outages_s': [[3.0, 9.0]], 'period_ticks': 2, 'latency_ticks': 1}],
        {'mass_kg': 11.0, 'thrust_noise_s0_5': 0.05}
    ),
    'a camera': ([CAMERA], {'position_sigma_m': 3.0}),
    'turning': ([{**LIDAR, **FIXED, 'latency_ticks': 3, 'period_ticks': 2}], {}, TURNING),
    'a turning camera': ([{**CAMERA, **FIXED, 'latency_ticks': 2}], {}, TURNING),
    'at a port': ([{**LIDAR, **AT_PORT}, {**CAMERA, **AT_PORT, 'latency_ticks': 1}], {}, PORT),
}  # fmt: skip


@pytest.mark.parametrize('case', CASES)
def test_it_is_the_filter_of_filterpy(case):
    """Another one that begins at a later tick is equal, and one that leaves out its covariance."""
    units, fields, *sections = CASES[case]
    flown = make(units, estimator=fields, ticks=200, **dict(*sections))
    turns = flown.section(Sensors).turn
    stage, later, short = (EstimatorStage(flown.section(Estimator), flown) for _ in range(3))
    short.take_unread([NAVIGATION_COVARIANCE])
    oracle, flight = (
        Oracle(flown, stage.p.start[:6]),
        fly(flown, PD),
    )
    latencies, names = [unit.latency_ticks for unit in oracle.units], flown.section(Sensors).signals
    newest, (x, p), came = max(latencies), (oracle.x, oracle.p), {}
    before = [(0.0,) * 3, *map(tuple, flight.forces_n.tolist())]
    for tick in range(flown.ticks + 1):
        rows = [tuple(flight.signals[name][tick]) for name in names]
        given = before[tick], *rows, *([flight.signals['chaser_attitude'][tick]] if turns else [])
        found = stage.step(tick, *given)
        assert flown.target or later.step(1001 + tick, *given) == found
        assert short.step(tick, *given)[0] == found[0]
        assert np.array_equal(found[0], flight.signals['navigation_state'][tick])
        for i, (latency, row) in enumerate(zip(latencies, rows, strict=True)):
            if row[6] >= 0.0 and turns:
                turned = Rotation.from_quat(flight.signals['chaser_attitude'][tick - latency, :4])
                row = (*turned.apply(row[:3]), *row[3:])
            came |= {(tick - latency, i): row} if row[6] >= 0.0 else {}
        if tick >= newest:
            x, p = oracle.tick(tick - newest, x, p, before, came, True)
        y, q = x, p
        for ahead in range(max(tick - newest + 1, 0), tick + 1):
            y, q = oracle.tick(ahead, y, q, before, came, False)
        scale = np.sqrt(q.diagonal())
        np.testing.assert_allclose([*found[0], *sum(found[2:], ())] / scale, y / scale, atol=1e-7)
        square = np.outer(scale, scale)
        np.testing.assert_allclose(stage.covariance / square, q / square, atol=1e-7)
        assert stage.trouble() == oracle.trouble(tick)
    counts = stage.m.counts.accepted, stage.rejected, stage.restarts
    assert counts == (oracle.accepted, oracle.rejected, oracle.restarts)
    assert (oracle.rejected > 0) == (case in ('outlying', 'diverged'))


@pytest.mark.parametrize('n', [6, 9])
def test_the_covariance_is_positive_over_a_million_updates(n):
    """From 1e6 m to a sensor of 1e-4 m: twenty decades of variance, four more than a double has.

    So it may be negative in the first updates; it is judged after 100 ticks, and later.
    """
    step = cw.discretise(1.16e-3, 10.0, 0.1)
    sigmas = np.array([1e6] * 3 + [1e3] * 3 + [1.0] * (n - 6))
    noise = np.zeros((9, 9))
    noise[3:6, 3:6] = np.eye(3) * 1e-14
    noise[6:, 6:] = np.eye(3) * 1e-16
    p = np.zeros((9, 9))
    p[:n, :n] = np.diag(sigmas**2)
    x, ph, gain = (jit.as_table(np.zeros(9)) for _ in range(3))
    p, noise = jit.as_table(p), jit.as_table(noise)

    @jit.kernel
    def many(count, x, p, ph, gain, noise, n, step):
        for _ in range(count):
            estimator.step_state(x, n, (0.0, 0.0, 0.0), step)
            estimator.step_covariance(p, step, noise, 1.0)
            estimator.joseph(x, p, 9, ph, gain, 0, (1.0, 0.0, 0.0), 0.0, 1e-8)
            estimator.joseph(x, p, 9, ph, gain, 0, (0.0, 0.6, 0.8), 0.0, 1e-8)
            estimator.joseph(x, p, 9, ph, gain, 0, (0.0, -0.8, 0.6), 0.0, 1e-8)

    for _ in range(10):
        many(34_000 if jit.COMPILED else 100, x, p, ph, gain, noise, n, step)
        found = np.array(p)[:n, :n]
        assert np.array_equal(found, found.T)
        scale = np.sqrt(np.diag(found))
        assert np.linalg.eigvalsh(found / np.outer(scale, scale)).min() > 1e-6


def test_the_gate_is_the_chi_square_quantile():
    from scipy.stats import chi2, norm

    for numbers in (2, 3, 6):
        for sigmas in (3.0, 4.0, 5.0):
            exact = chi2.isf(norm.sf(sigmas), numbers)
            assert gate(numbers, sigmas) == pytest.approx(exact, rel=0.12)


@pytest.mark.parametrize('goal', [[0.0, 0.0, 0.0], [0.0, -10.0, 0.0]])
def test_a_controller_that_compensates_holds_closer(goal):
    """A PD controller rests where its force balances the push: push / gain, here 0.7 m and more."""
    push = [0.02, -0.01, 0.015]
    errors = []
    for compensate in (False, True):
        flown = make(
            ticks=3000,
            goal_position_m=goal,
            disturbance={'constant_n': push, 'harmonics': []},
            estimator={'disturbance_sigma_n': 0.03, 'compensate': compensate},
        )
        flight = fly(flown, PD)
        errors.append(np.abs(flight.errors[-500:, :3].mean(axis=0)))
        found = flight.signals['estimated_disturbance'] if compensate else 0.0
        seen = flight.signals['navigation_state'] - np.array(flown.goal_state)
        holding = (0.0, 0.0, 0.0) if flown.goal is None else flown.goal.force_n
        law = -PD.position_gain_n_m * seen[:, :3] - PD.velocity_gain_n_s_m * seen[:, 3:]
        expected = law + holding - found
        np.testing.assert_allclose(flight.forces_n[500:], expected[500:], rtol=1e-9, atol=1e-12)
    assert (errors[0] > 0.5).all()
    assert (errors[1] < 0.1 * errors[0]).all()


@settings(max_examples=15)
@given(
    st.lists(
        st.tuples(
            *[st.floats(-1e5, 1e5) | st.floats(allow_nan=False, allow_infinity=False)] * 6,
            st.sampled_from([-1.0, 1.0]),
        ),
        min_size=1, max_size=30,
    ),
    st.floats(-1e300, 1e300),
)  # fmt: skip
def test_its_state_is_always_finite(measured, force):
    """Whatever is measured, whatever is commanded."""
    flown = make([POSITION], estimator={'restart_after': 3, 'disturbance_sigma_n': 1.0})
    stage = EstimatorStage(flown.section(Estimator), flown)
    for tick, row in enumerate(measured):
        message = (*row[:6], row[6], *[0.0] * 8, row[6], *[0.0] * 8)
        found = stage.step(tick, (force, 0.0, -force), message)
        assert all(np.isfinite(values).all() for values in found)
    for tick in range(len(measured), len(measured) + 8):  # so often that it starts there
        stage.step(tick, (0.0,) * 3, (1e300, 0.0, 0.0, *message[3:6], 1.0, *message[7:]))
    stage.m.x[1] = np.inf  # as after an overflow
    assert np.isfinite(np.concatenate(stage.step(tick + 1, (0.0,) * 3, NOTHING))).all()


NOTHING = (0.0,) * 6 + (-1.0,) + (0.0,) * 8 + (-1.0,) + (0.0,) * 8


def test_of_missing_ticks_the_command_is_held():
    """A free-running node may miss ticks; the estimate goes on as if none was measured there."""
    flown = make([{**LIDAR, 'latency_ticks': 2}])
    stage, other = (EstimatorStage(flown.section(Estimator), flown) for _ in range(2))
    for tick in range(20):
        whole = stage.step(tick, (0.1, 0.0, 0.0) if tick else (0.0,) * 3, NOTHING)
        if tick in (0, 19):
            gapped = other.step(tick, (0.1, 0.0, 0.0) if tick else (0.0,) * 3, NOTHING)
    assert whole == gapped


# A camera that turns with the chaser.

LOOKING = {**LIDAR, 'body_fixed': True}
TURNED = Rotation.from_euler('xyz', [20.0, -30.0, 50.0], degrees=True)


def covariance_after_one(spread):
    """Return the filter's covariance after one measurement, and its start, 1 m of each axis."""
    flown = attitude_scenario(
        sensors={'units': [LOOKING]}, estimator={'position_sigma_m': 1.0, 'gate_sigmas': 0.0}
    )
    stage = EstimatorStage(flown.section(Estimator), flown)
    assert stage.inputs[2:] == ('attitude', 'attitude_covariance')
    at = np.array(stage.p.start[:3])
    seen = (*TURNED.inv().apply(at), 0.0, 0.0, 0.0, *[0.0] * 18)
    turned = (*TURNED.as_quat(canonical=True), 0.0, 0.0, 0.0)
    stage.step(0, (0.0,) * 3, seen, turned, tuple(np.ravel(spread)))
    return stage.covariance[:3, :3], at


def noise_of(at, spread):
    """Return the covariance of a measurement: noise of the camera, and r x e of the attitude."""
    distance, turn = np.linalg.norm(at), TURNED.as_matrix()
    u, x = at / distance, np.cross(np.eye(3), at)  # rows: e_i x r
    own = np.outer(u, u) * (0.01 * distance) ** 2
    own += (np.eye(3) - np.outer(u, u)) * max(0.01, 0.002 * distance) ** 2
    return own + x.T @ turn @ spread @ turn.T @ x


def test_what_is_unsure_of_the_attitude_widens_the_measurement():
    """Of alike angles it is the Kalman filter of matrices; of others never smaller than that."""
    alike = np.eye(3) * 0.01**2
    found, at = covariance_after_one(alike)
    expected = np.linalg.inv(np.eye(3) + np.linalg.inv(noise_of(at, alike)))
    np.testing.assert_allclose(found, expected, atol=1e-9)
    rng = np.random.default_rng(5)
    for _ in range(10):
        root = rng.normal(size=(3, 3)) * 0.01
        found, at = covariance_after_one(root @ root.T)
        least = np.linalg.inv(np.eye(3) + np.linalg.inv(noise_of(at, root @ root.T)))
        assert np.linalg.eigvalsh(found - least).min() > -1e-9
        assert np.trace(found) < 2.0 * np.trace(least)
