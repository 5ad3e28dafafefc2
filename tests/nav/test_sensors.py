# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What sensors measure, against their definitions in arrays; all of it a function of the tick.

Random numbers are those of `rpo_core.kernels.noise`, which has tests of its own.
"""

from __future__ import annotations

import numpy as np
import pytest
from nav_scenarios import LIDAR, TUMBLE, attitude_scenario, make
from scipy.spatial.transform import Rotation

from rpo_core.attitude.target import motion_of
from rpo_core.kernels.noise import normal_pair, philox
from rpo_core.navigation.attitude_sensors import AttitudeSensors, AttitudeSensorsStage
from rpo_core.navigation.sensors import (
    Navigation,
    NavigationStage,
    Sensor,
    Sensors,
    SensorsStage,
    across,
    sight,
)
from rpo_core.wire import interfaces

FAR = (60.0, -80.0, 0.0, 0.1, 0.2, 0.3)
DT = 0.1


def test_a_navigation_of_no_errors_says_the_true_state_and_cannot_be_changed():
    assert NavigationStage(Navigation()).step(7, FAR) == (FAR,)
    assert hash(Navigation()) == hash(Navigation())


def words_of(ticks, block, stream, key):
    """Return random words (n, 4) of ticks, and the normals (n, 4) that they make."""
    words = np.array([philox(t, block, stream, 0, *key) for t in range(ticks)])
    return words, np.array(
        [normal_pair(*row[:2]) + normal_pair(*row[2:]) for row in words.tolist()]
    )


def late(rows, came, nothing, latency, ticks):
    """Return what arrives at ticks: rows that came, of those that were stepped; else nothing."""
    taken = np.array(ticks) - latency
    there = [t >= 0 and t in ticks and bool(came[t]) for t in taken]
    return np.where(np.array(there)[:, None], rows[taken], nothing)


def due(ticks, unit):
    """Return at which ticks a sensor measures, by its period and outages."""
    t = np.round(np.arange(ticks) * DT, 6)
    dark = [(t >= begin) & (t < end) for begin, end in unit.outages_s]
    return (np.arange(ticks) % unit.period_ticks == 0) & ~np.any([np.zeros(ticks), *dark], axis=0)


def measured_by(unit, states, key, stream=1):
    """Return the messages (n, 24) that a sensor makes of true states (n, 6), and which it makes."""
    n, position = len(states), unit.kind == 'relative_position'
    words, normals = zip(*(words_of(n, block, stream, key) for block in range(4)), strict=True)
    walk = unit.bias_walk_m_s0_5 * np.sqrt(DT) * normals[3][:, :3].cumsum(axis=0)
    true = states[:, :3] + unit.bias_m + walk
    distance = np.linalg.norm(true, axis=1)[:, None]
    u = true / distance
    ahead = np.array(unit.boresight) / np.linalg.norm(unit.boresight)
    came = due(n, unit) & (np.arccos(np.clip(-u @ ahead, -1.0, 1.0)) <= unit.field_of_view_rad)
    came &= words[1][:, 2] >= unit.dropout_share * 2**32
    aside = unit.noise_share if position else unit.bearing_noise_rad

    def sigmas(range_m):
        along = np.maximum(unit.noise_floor_m, unit.noise_share * range_m)
        return along, np.maximum(unit.noise_floor_m, aside * range_m)

    (along, cross), sides = sigmas(distance), np.array([across(*row) for row in u.tolist()])
    off = along * u * normals[0][:, :1] + cross * sides[:, 0] * normals[0][:, 1:2]
    seen = (1.0 + unit.scale_error) * true + off + cross * sides[:, 1] * normals[0][:, 2:3]
    far = (words[1][:, 3] < unit.outlier_share * 2**32)[:, None]
    seen = seen + far * unit.outlier_size_m * normals[2][:, :3]
    found = np.zeros((n, 24))
    found[:, 15] = -1.0
    reach = np.linalg.norm(seen, axis=1)[:, None]
    u, (along, cross) = seen / reach, sigmas(reach)
    if unit.kind == 'bearing':
        seen, along, cross = u, 0.0 * along, aside + 0.0 * cross
    found[:, :3] = seen
    outer = u[:, :, None] * u[:, None]
    spread = along[:, None] ** 2 * outer + cross[:, None] ** 2 * (np.eye(3) - outer)
    found[:, 6:15] = spread.reshape(n, 9)
    if unit.velocity_floor_m_s > 0.0:
        draws = np.hstack([normals[0][:, 3:], normals[1][:, :2]])
        floor, share = unit.velocity_floor_m_s, unit.velocity_share_1_s
        sigma, claimed = (np.maximum(floor, share * r) for r in (distance, reach))
        found[:, 3:6] = states[:, 3:] + unit.velocity_bias_m_s + sigma * draws
        found[:, 15:] = claimed**2 * np.eye(3).ravel()
    return found, came


NOTHING = [0.0] * 6 + [-1.0] + [0.0] * 8 + [-1.0] + [0.0] * 8
UNITS = [
    {**LIDAR, 'noise_floor_m': 0.02, 'bearing_noise_rad': 0.003, 'dropout_share': 0.25,
     'period_ticks': 3, 'latency_ticks': 4},
    {'kind': 'relative_position', 'noise_share': 0.01, 'velocity_floor_m_s': 1e-4,
     'velocity_share_1_s': 1e-4, 'velocity_bias_m_s': [0.1, 0.2, -0.3]},
    {'kind': 'bearing', 'bearing_noise_rad': 0.001, 'latency_ticks': 1},
    {**LIDAR, 'bias_m': [0.1, 0.2, -0.3], 'scale_error': 0.01, 'bias_walk_m_s0_5': 0.5,
     'outlier_share': 0.1, 'outlier_size_m': 50.0,
     'outages_s': [[1.0, 2.0], [2.5, 3.01], [20.1, 99.0]]},
    {**LIDAR, 'boresight': [3.0, 4.0, 12.0], 'field_of_view_rad': 1.2, 'period_ticks': 2},
]  # fmt: skip
BESIDE = {**LIDAR, 'bias_walk_m_s0_5': 0.1, 'outlier_share': 0.1, 'outlier_size_m': 9.0}
EVERY, SOME = range(300), [t for t in range(300) if t >= 10 and t % 50 < 43]


@pytest.mark.parametrize('unit', UNITS, ids=range(len(UNITS)))
@pytest.mark.parametrize('ticks', [EVERY, SOME], ids=['every tick', 'some left out'])
def test_what_a_sensor_measures_is_what_its_definition_says(unit, ticks):
    """From 0.1 to 300 m on all sides, with a second sensor beside it."""
    rng = np.random.default_rng(3)
    places = rng.normal(size=(300, 3)) * 10.0 ** rng.uniform(-1.0, 2.0, (300, 1))
    states = np.hstack([places, rng.normal(size=(300, 3))])
    flown = make([unit, BESIDE], estimator=None)
    stage = SensorsStage(flown.section(Sensors), flown)
    assert stage.memory_ticks == unit.get('latency_ticks', 0)
    found = np.array([stage.step(tick, tuple(states[tick].tolist())) for tick in ticks])
    for i, sensor in enumerate(flown.section(Sensors).units):
        rows, came = measured_by(sensor, states, (7, 1), stream=i + 1)
        expected = late(rows, came, NOTHING, sensor.latency_ticks, ticks)
        np.testing.assert_allclose(found[:, i], expected, rtol=1e-9, atol=1e-9)
    assert np.count_nonzero(found[:, 0, 6] >= 0.0) > 20
    assert found.shape[2] == len(interfaces.row_of('measurement_2').columns)


@pytest.mark.parametrize('kind', ['range_bearing', 'bearing'])
@pytest.mark.parametrize('looks_at', ['centre', 'port'])
def test_what_turns_with_the_chaser_measures_in_its_axes(kind, looks_at):
    """And from the port, where the attitude of the target puts that."""
    unit = {
        'kind': kind, 'bearing_noise_rad': 0.01, 'bias_m': [0.1, -0.2, 0.3], 'latency_ticks': 2,
        'boresight': [0.0, 0.6, 0.8], 'field_of_view_rad': 1.2, 'body_fixed': True,
        'looks_at': looks_at,
    }  # fmt: skip
    flown = attitude_scenario(
        attitude_sensors=None, attitude_estimator=None, target=TUMBLE,
        zones={'port_m': [0.3, 1.2, -0.5]}, sensors={'units': [unit], 'noise_key': [7, 1]},
    )  # fmt: skip
    settings, motion = flown.section(Sensors), motion_of(flown.target, flown)
    places, stage = np.random.default_rng(3).normal(size=(300, 3)), SensorsStage(settings, flown)
    turned, port = Rotation.random(300, random_state=5), np.zeros((300, 3))
    if looks_at == 'port':
        axes = Rotation.from_quat([motion.attitude(tick)[:4] for tick in EVERY])
        port = axes.apply(settings.port_m)
    states, attitudes = np.hstack([places, 0.1 * places]), turned.as_quat()
    pairs = zip(states.tolist(), attitudes.tolist(), strict=True)
    found = np.array([stage.step(t, tuple(r), (*q, *FAR[3:]))[0] for t, (r, q) in enumerate(pairs)])
    seen = np.hstack([turned.inv().apply(places - port), np.zeros((300, 3))])
    rows, came = measured_by(settings.units[0], seen, (7, 1))
    np.testing.assert_allclose(found, late(rows, came, NOTHING, 2, EVERY), rtol=1e-9, atol=1e-9)
    assert 20 < np.count_nonzero(found[:, 6] >= 0.0) < 280


def test_the_port_is_in_its_place_in_each_block_of_ticks():
    """Also far ahead, where a node may begin, and after a reset."""
    unit = {'kind': 'range_bearing', 'noise_floor_m': 1e-9, 'looks_at': 'port'}
    flown = make([unit], estimator=None, target=TUMBLE, zones={'port_m': [0.3, 1.2, -0.5]})
    stage, motion = SensorsStage(flown.section(Sensors), flown), motion_of(flown.target, flown)
    for tick in (0, 1, 511, 512, 5000, 90_000, 0):
        if tick == 0:
            stage.reset()
        port = Rotation.from_quat(motion.attitude(tick)[:4]).apply([0.3, 1.2, -0.5])
        found = stage.step(tick, FAR)[0]
        np.testing.assert_allclose(found[:3], FAR[:3] - port, rtol=0.0, atol=1e-7)


def test_a_key_that_is_not_given_is_zero():
    assert Sensors((Sensor(**LIDAR),)) == Sensors((Sensor(**LIDAR),), (0, 0))


def test_the_frame_of_the_line_of_sight_is_right_handed():
    rng = np.random.default_rng(3)
    rows = [*rng.normal(size=(200, 3)), *np.eye(3), *-np.eye(3)]
    for u in (row / np.linalg.norm(row) for row in rows):
        first, second = map(np.array, across(*u.tolist()))
        frame = np.column_stack([u, first, second])
        assert np.allclose(frame.T @ frame, np.eye(3))
        assert np.allclose(np.cross(u, first), second)


def test_a_point_without_a_direction():
    """At the sensor it is y; where the distance overflows, no number, and nothing raises."""
    _, *near = sight(0.0, 1e-320, 0.0)
    distance, *far = sight(1e200, -1e200, 1e200)
    assert near == [0.0, 1.0, 0.0]
    assert np.isinf(distance)
    assert np.isnan(across(*far)).all()


STARS = [
    {'period_ticks': 3, 'latency_ticks': 4, 'outages_s': [[0.9, 2.1], [2.5, 3.01]]},
    {'light': [-2.0, 0.0, 0.0], 'light_deg': 50.0, 'boresight': [0.0, 0.0, 3.0]},
]


@pytest.mark.parametrize('star', STARS, ids=['late', 'blinded'])
@pytest.mark.parametrize('ticks', [EVERY, SOME], ids=['every tick', 'some left out'])
def test_what_a_star_tracker_and_a_gyro_measure_is_what_their_definition_says(star, ticks):
    """By SciPy's rotations; white noise, and biases that walk from tick 1 on."""
    rng, flown = np.random.default_rng(4), attitude_scenario(star, {'bias_walk_rad_s1_5': 1e-4})
    sensors = flown.section(AttitudeSensors)
    tracker, gyro, stage = sensors.star_tracker, sensors.gyro, AttitudeSensorsStage(sensors, flown)
    turned, rates = Rotation.random(300, random_state=5), rng.normal(size=(300, 3)) * 0.02
    axes = np.array(tracker.axes)
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-15)
    np.testing.assert_allclose(axes[0] * np.linalg.norm(tracker.boresight), tracker.boresight)
    stars, white, steps = (words_of(300, 0, stream, (7, 2))[1][:, :3] for stream in range(129, 132))
    steps[0] = 0.0
    drift = gyro.bias_walk_rad_s1_5 * np.sqrt(DT) * steps.cumsum(axis=0)
    seen = rates + gyro.bias_rad_s + drift + gyro.noise_rad_s0_5 / np.sqrt(DT) * white
    half = 0.5 * (np.radians([60.0, 10.0, 10.0]) / 3600.0 * stars) @ axes
    rest = np.sqrt(1.0 - (half**2).sum(axis=1))
    rows = (turned * Rotation.from_quat(np.column_stack([half, rest]))).as_quat(canonical=True)
    light = np.array(tracker.light) / np.linalg.norm(tracker.light)
    glare = np.degrees(np.arccos(np.clip(turned.apply(axes[0]) @ light, -1.0, 1.0)))
    came = due(300, tracker) & (glare > tracker.light_deg)
    attitudes = np.hstack([turned.as_quat(), rates])
    for _ in range(2):  # of a new flight nothing is left
        found = np.array([stage.step(tick, tuple(attitudes[tick].tolist()))[0] for tick in ticks])
        expected = late(rows, came, np.zeros(4), tracker.latency_ticks, ticks)
        np.testing.assert_allclose(found[:, :4], expected, atol=1e-12)
        np.testing.assert_allclose(found[:, 4:], seen[ticks], atol=1e-15)
        stage.reset()
    assert 20 < np.count_nonzero(found[:, :4].any(axis=1)) < 280
