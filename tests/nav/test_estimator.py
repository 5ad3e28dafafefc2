# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The estimator against filterpy, against its own covariance, and against what sensors may do."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter
from flown import lines
from hypothesis import given, settings
from hypothesis import strategies as st
from kept import assert_kept
from nav_scenarios import LIDAR, PD, make, unmodelled

from rpo_core.chain.chain import Chain
from rpo_core.chain.flight import fly
from rpo_core.world import cw
from rpo_kernels import jit
from rpo_nav.estimator import Estimator, EstimatorStage, gate
from rpo_nav.filter_kernels import (
    ACCEPTED,
    COMMANDS,
    FULL,
    IN_A_ROW,
    LAST_RESET,
    PROCESS_NOISE,
    RESETS,
    SENSORS,
    SQUARE,
    START,
    TESTED,
    X,
    step_covariance,
    step_state,
    update,
)
from rpo_nav.sensor_kernels import COLUMNS

POSITION = {
    'kind': 'relative_position',
    'noise_floor_m': 0.05,
    'velocity_floor_m_s': 0.002,
}  # linear, with a constant R: filterpy's filter


def oracle(flown, start, spread):
    """Return filterpy's filter of a scenario."""
    settings = flown.section(Estimator)
    motion, push = cw.matrices(flown.step)
    filter_ = KalmanFilter(6, 6, 3)
    filter_.F, filter_.B, filter_.H = motion, push, np.eye(6)
    density = settings.acceleration_noise_m_s1_5 * flown.mass_kg
    filter_.Q = push @ push.T * density**2 / flown.dt_s
    filter_.R = np.diag([0.05**2] * 3 + [0.002**2] * 3)
    filter_.x, filter_.P = np.array(start).reshape(6, 1), np.diag(np.square(spread))
    return filter_


@pytest.mark.parametrize('latency', [0, 3])
def test_it_is_the_filter_of_filterpy(latency):
    flown = make([{**POSITION, 'latency_ticks': latency}], ticks=400)
    stage = EstimatorStage(flown.section(Estimator), flown)
    other = oracle(flown, stage.filter[START : START + 6], [1.0] * 3 + [0.01] * 3)
    flight = fly(flown, PD, unmodelled(flown, 5))
    before = [np.zeros((3, 1)), *flight.forces_n.clip(-0.5, 0.5)[:, :, None]]
    worst = 0.0
    for tick in range(flown.ticks + 1):
        measured = flight.signals['measurement'][tick]
        stage.step(tick, tuple(before[tick].ravel()), tuple(measured))
        taken = tick - latency
        if taken >= 0:
            if taken > 0:
                other.predict(u=before[taken])
            other.update(measured[:6].reshape(6, 1))
            x, p = other.x, other.P
            for later in range(taken + 1, tick + 1):  # on to the present, without measurements
                x = other.F @ x + other.B @ before[later]
                p = other.F @ p @ other.F.T + other.Q
            worst = max(worst, np.abs(x.ravel() - np.array(stage.memory[X : X + 6])).max())
            worst = max(worst, np.abs(p - stage.covariance).max())
            estimated = flight.signals['navigation_state'][tick]
            assert np.array_equal(estimated, np.array(stage.memory[X : X + 6]))
    assert worst < 1e-9


def test_sensors_of_different_latency_are_each_taken_at_their_tick():
    """One filter gets both at once; the other gets one of them three ticks later."""
    late = {**POSITION, 'velocity_floor_m_s': 0.0, 'latency_ticks': 3}
    both = [fly(make([late, {**LIDAR, 'latency_ticks': n}]), PD) for n in (0, 3)]
    quick, slow = (f.signals['navigation_covariance'][50:] for f in both)
    assert (quick[:, [0, 4, 8]] < slow[:, [0, 4, 8]]).all()
    errors = [f.signals['navigation_state'] - f.states for f in both]
    sigmas = np.sqrt(quick[:, [0, 4, 8]])
    assert np.abs(errors[0][50:, :3] / sigmas).max() < 5.0


def consistency(runs, ticks, **changes):
    """Return NEES (runs, ticks + 1) and whitened innovations, flat, of flights with true noise."""
    nees, innovations = np.empty((runs, ticks + 1)), []
    for key in range(runs):
        flown = make(key=key, ticks=ticks, **changes)
        chain = Chain.of(flown, PD, unmodelled(flown, key))
        stage = next(link.stage for link in chain.links if link.stage.name == 'estimator')
        signals = {'relative_state': flown.start}
        for tick in range(ticks + 1):
            true = np.array(signals['relative_state'])
            chain.step(tick, signals)
            error = np.array(stage.memory[X : X + 6]) - true
            nees[key, tick] = error @ np.linalg.solve(stage.covariance[:6, :6], error)
            innovations += [found for found in stage.innovations if found]
    return nees, np.array(innovations)


@pytest.mark.parametrize(
    'sensor',
    [
        {},
        {'dropout_share': 0.1, 'latency_ticks': 3},
        {'kind': 'relative_position', 'noise_share': 0.005, 'bearing_noise_rad': 0.0},
    ],
    ids=['lidar', 'late', 'position'],
)  # fmt: skip
def test_errors_are_as_large_as_it_says(sensor):
    """Mean NEES of 6, mean NIS of 3, white innovations; bounds of 4 sigma for so few runs."""
    runs, ticks = 40, 150
    nees, innovations = consistency(runs, ticks, units=[{**LIDAR, **sensor}])
    at = nees[:, 10::20]  # some ticks; neighbours are correlated
    assert abs(nees[:, -1].mean() - 6.0) < 4.0 * np.sqrt(12.0 / runs)
    assert abs(at.mean() - 6.0) < 4.0 * np.sqrt(12.0 / runs)
    nis = np.square(innovations).sum(axis=1)
    assert abs(nis.mean() - 3.0) < 4.0 * np.sqrt(6.0 / len(nis))
    for axis in innovations.T:
        correlation = (axis[1:] * axis[:-1]).mean()
        assert abs(correlation) < 4.0 / np.sqrt(len(axis))


def test_a_wrong_noise_is_seen_in_nees():
    """The test above can fail: a filter that takes the sensors for twice as good."""
    nees, _ = consistency(8, 100, estimator={'noise_scale': 0.5})
    assert nees[:, -1].mean() > 9.0


@pytest.mark.parametrize(
    'unit', [LIDAR, {**POSITION, 'noise_share': 0.01, 'velocity_share_1_s': 0.001}]
)
def test_the_filter_takes_every_noise_of_a_sensor_for_so_many_times_as_large(unit):
    """Noise of position and velocity, floor and share, and of a bearing; nothing else."""
    rows = []
    for scale in (1.0, 3.0):
        made = make([unit], estimator={'noise_scale': scale})
        table = np.array(EstimatorStage(made.section(Estimator), made).filter)
        rows.append(table[SENSORS : SENSORS + COLUMNS])
    assert (rows[0][:5] > 0.0).sum() == (3 if unit is LIDAR else 5)
    np.testing.assert_allclose(rows[1], [*(3.0 * rows[0][:5]), *rows[0][5:]], rtol=1e-15)


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
    told, memory = np.zeros(SENSORS), np.zeros(COMMANDS)
    told[PROCESS_NOISE : PROCESS_NOISE + SQUARE] = noise.ravel()
    p = memory[X + 9 : X + 9 + SQUARE].reshape(9, 9)
    p[:n, :n] = np.diag(sigmas**2)
    f, m = jit.as_table(told), jit.as_table(memory)

    @jit.kernel
    def many(count, f, m, n, step):
        for _ in range(count):
            step_state(m, n, (0.0, 0.0, 0.0), step)
            step_covariance(m, step, f, 1.0)
            update(m, 0, (1.0, 0.0, 0.0), 0.0, 1e-8)
            update(m, 0, (0.0, 0.6, 0.8), 0.0, 1e-8)
            update(m, 0, (0.0, -0.8, 0.6), 0.0, 1e-8)

    for _ in range(10):
        many(34_000 if jit.COMPILED else 100, f, m, n, step)
        found = np.array(m[X + 9 : X + 9 + SQUARE]).reshape(9, 9)[:n, :n]
        assert np.array_equal(found, found.T)
        scale = np.sqrt(np.diag(found))
        assert np.linalg.eigvalsh(found / np.outer(scale, scale)).min() > 1e-6


def test_the_thrust_adds_noise_by_its_size():
    """Against Van Loan's noise of a force that is held for a tick; a gate that opens at once."""
    share, quiet = 0.05, 1e-5
    flown = make(
        [{**LIDAR, 'outages_s': [[0.05, 20.0]]}],
        estimator={'thrust_noise_s0_5': share, 'acceleration_noise_m_s1_5': quiet},
    )
    stage = EstimatorStage(flown.section(Estimator), flown)
    f, b = cw.matrices(cw.discretise(flown.mean_motion_rad_s, 10.0, 0.1))
    stage.step(0, (0.0,) * 3, *[(0.0,) * 6 + (-1.0,) + (0.0,) * 17])
    p, rng = stage.covariance, np.random.default_rng(2)
    for tick in range(1, 60):
        force = rng.uniform(-0.8, 0.8, 3)
        taken = np.clip(force, -0.5, 0.5)
        stage.step(tick, tuple(force), *[(0.0,) * 6 + (-1.0,) + (0.0,) * 17])
        density = (quiet * 10.0) ** 2 + share**2 * (taken @ taken)
        p = f @ p @ f.T + b @ b.T * density / 0.1
    np.testing.assert_allclose(stage.covariance, p, rtol=1e-9, atol=1e-18)


def test_the_gate_is_the_chi_square_quantile():
    from scipy.stats import chi2, norm

    for numbers in (2, 3, 6):
        for sigmas in (3.0, 4.0, 5.0):
            exact = chi2.isf(norm.sf(sigmas), numbers)
            assert gate(numbers, sigmas) == pytest.approx(exact, rel=0.12)


def test_outliers_are_rejected():
    outliers = {**LIDAR, 'outlier_share': 0.05, 'outlier_size_m': 20.0}
    with_gate, without = (
        fly(make([outliers], estimator={'gate_sigmas': gate}), PD) for gate in (4.0, 0.0)
    )
    errors = [
        np.linalg.norm((f.signals['navigation_state'] - f.states)[100:, :3], axis=1).max()
        for f in (with_gate, without)
    ]
    assert errors[0] < 0.3
    assert errors[1] > 2.0 * errors[0]


def test_it_coasts_through_an_outage_and_knows_it():
    flight = fly(make([{**LIDAR, 'outages_s': [[10.0, 20.0]]}], ticks=400), PD)
    sigma = np.sqrt(flight.signals['navigation_covariance'][:, [0, 4, 8]])
    assert (sigma[199] > sigma[99]).all()
    assert (sigma[260] < sigma[199]).all()
    error = np.abs(flight.signals['navigation_state'] - flight.states)[:, :3]
    assert (error < 5.0 * sigma).all()


def test_it_restarts_when_it_has_diverged():
    """It believes a start of 1 m; the sensor says 30 m away. It says so."""
    flown = make([{**LIDAR, 'bias_m': [30.0, 0.0, 0.0]}], ticks=300)
    stage = EstimatorStage(flown.section(Estimator), flown)
    assert stage.trouble() == ''
    flight = fly(flown, PD)
    for tick in range(flown.ticks + 1):
        before = flight.forces_n[tick - 1] if tick else np.zeros(3)
        stage.step(tick, tuple(before), tuple(flight.signals['measurement'][tick]))
    assert stage.memory[RESETS] == 1
    assert stage.memory[LAST_RESET] == 19
    assert stage.memory[IN_A_ROW] == 0
    assert 'restarted 1 times' in stage.trouble()
    error = flight.signals['navigation_state'] - flight.states
    assert np.abs(error[-1, :3] - [30.0, 0.0, 0.0]).max() < 1.0


def test_it_estimates_a_constant_disturbance():
    flown = make(
        ticks=2000,
        disturbance={'constant_n': [0.002, -0.001, 0.003], 'harmonics': []},
        estimator={'disturbance_sigma_n': 0.01},
    )
    flight = fly(flown, PD)
    found = flight.signals['estimated_disturbance']
    assert np.abs(found[-1] - [0.002, -0.001, 0.003]).max() < 5e-4


@pytest.mark.parametrize('goal', [[0.0, 0.0, 0.0], [0.0, -10.0, 0.0]])
def test_a_controller_that_compensates_holds_closer(goal):
    """A PD controller rests where its force balances the push: push / gain, here 0.7 m and more."""
    push = [0.02, -0.01, 0.015]
    errors = []
    for compensate in (False, True):
        flown = make(
            ticks=4000,
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


def test_a_camera_alone_finds_the_distance_while_the_chaser_manoeuvres():
    camera = {'kind': 'bearing', 'bearing_noise_rad': 0.0005}
    flown = make([camera], ticks=600, estimator={'position_sigma_m': 3.0})
    flight = fly(flown, PD)
    error = np.linalg.norm((flight.signals['navigation_state'] - flight.states)[:, :3], axis=1)
    assert error[-1] < 0.5 * error[0]


@settings(max_examples=15)
@given(
    st.lists(
        st.tuples(*[st.floats(-1e5, 1e5)] * 6, st.sampled_from([-1.0, 1.0])),
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


def test_it_may_begin_at_any_tick_and_says_when_it_coasts():
    """It coasts where nothing was taken for ten periods of the slowest sensor."""
    flown = make([{**LIDAR, 'period_ticks': 2, 'latency_ticks': 1}])
    seen = (*flown.initial_position_m, 0.0, 0.0, 0.0, 1.0, *[0.0] * 8, -1.0, *[0.0] * 8)
    stages = {origin: EstimatorStage(flown.section(Estimator), flown) for origin in (0, 1001)}
    for tick in range(100):
        message = seen if tick % 2 and tick <= 51 else NOTHING
        first, later = (s.step(at + tick, (0.1, 0.0, 0.0), message) for at, s in stages.items())
        assert first == later
        silent = max(0, tick - 51)  # the newest one taken is of tick 50
        coasting = f'the estimator is coasting: no measurement was taken for {silent} ticks'
        said = {stage.trouble() for stage in stages.values()}
        assert said == {coasting if silent > 20 else ''}


def test_each_measurement_is_counted_once():
    """Those that are taken anew in each tick until the late ones have come, too."""
    flown = make([{**LIDAR, 'latency_ticks': 3}, LIDAR], ticks=50)
    flight, stage = fly(flown, PD), EstimatorStage(flown.section(Estimator), flown)
    for tick in range(flown.ticks + 1):
        before = flight.forces_n[tick - 1] if tick else np.zeros(3)
        rows = (tuple(flight.signals[name][tick]) for name in ('measurement', 'measurement_2'))
        stage.step(tick, tuple(before), *rows)
    assert stage.memory[ACCEPTED] + stage.rejected == 2 * (51 - 3)


def test_without_the_covariance_the_state_has_the_same_bits():
    """A campaign asks for the state alone where nobody reads how sure it is."""
    late = {**LIDAR, 'latency_ticks': 2, 'period_ticks': 3}
    flown = make([late, {**POSITION, 'period_ticks': 5}])
    flight = fly(flown, PD)
    stage = EstimatorStage(flown.section(Estimator), flown)
    stage.filter[FULL] = 0.0
    for tick in range(flown.ticks + 1):
        before = flight.forces_n[tick - 1] if tick else np.zeros(3)
        rows = (tuple(flight.signals[name][tick]) for name in ('measurement', 'measurement_2'))
        state = stage.step(tick, tuple(before), *rows)[0]
        assert np.array_equal(state, flight.signals['navigation_state'][tick])


def test_the_gate_decides_at_its_own_value():
    """A first measurement is taken if its NIS is within the gate, and not if it is just beyond."""
    unit = {'kind': 'relative_position', 'noise_floor_m': 0.5}
    flown = make([unit], estimator={'gate_sigmas': 4.0, 'position_sigma_m': 1e-4})
    found = []
    for off in np.linspace(0.0, 5.0, 101):
        stage = EstimatorStage(flown.section(Estimator), flown)
        x, y, z = flown.initial_position_m
        stage.step(0, (0.0, 0.0, 0.0), (x + off, y, z, 0.0, 0.0, 0.0, 0.0))
        numbers, nis = stage.memory[TESTED : TESTED + 2]
        assert numbers == 3
        assert stage.memory[IN_A_ROW] == (nis > gate(3, 4.0))
        found.append(nis / gate(3, 4.0))
    assert any(0.8 < share < 1.0 for share in found) and any(1.0 < share < 1.3 for share in found)


def test_shipped_flights_are_those_of_the_list():
    assert_kept(Path(__file__).with_name('flights.txt'), lines('nav'))
