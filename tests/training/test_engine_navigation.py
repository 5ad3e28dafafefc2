# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Sensors and filters in lanes have the bits of the kernels, also where no flight goes."""

from __future__ import annotations

from dataclasses import replace
from math import pi

import numpy as np
import pytest

from rpo_core.files import scenario
from rpo_core.wire.interfaces import ALIGNED
from rpo_montecarlo.engine import lanes
from rpo_montecarlo.engine.parts import estimation
from rpo_montecarlo.engine.tick import Batch, Draw
from rpo_nav.estimator import Estimator, filter_of, memory_of
from rpo_nav.filter_kernels import FULL, HEADING, RESETS, X, estimate
from rpo_nav.sensor_kernels import sense
from rpo_nav.sensors import Sensing, Sensor, Sensors

PLAIN = replace(scenario.load_scenario('approach'), duration_s=8.0)
LIDAR = Sensor(
    'range_bearing', 0.02, 0.01, 0.002, latency_ticks=2, dropout_share=0.2, outlier_share=0.1,
    outlier_size_m=50.0, bias_m=(0.1, 0.0, -0.2), bias_walk_m_s0_5=0.01, scale_error=0.01,
)  # fmt: skip
CAMERA = Sensor('bearing', bearing_noise_rad=0.003, period_ticks=3, field_of_view_rad=1.2)
RADIO = Sensor(
    'relative_position', 0.05, 0.01, velocity_floor_m_s=0.003, velocity_share_1_s=1e-4,
    latency_ticks=5, period_ticks=2, outages_s=((2.0, 4.0),),
)  # fmt: skip
CASES = {
    'lidar, 9 states': ((LIDAR,), Estimator(disturbance_sigma_n=0.01, restart_after=3)),
    'lidar, 6 states': ((LIDAR,), Estimator(restart_after=2, restart_velocity_sigma_m_s=0.1)),
    'three of different latency': (
        (LIDAR, CAMERA, RADIO),
        Estimator(disturbance_sigma_n=0.01, disturbance_walk_n_s0_5=1e-3, delay_ticks=2),
    ),
    'a camera without a gate': (
        (replace(CAMERA, field_of_view_rad=pi),),
        Estimator(gate_sigmas=0.0),
    ),
}


def runs(units, settings, count):
    """Return scenarios that differ in start, mass and key."""
    base = PLAIN.equipped(Sensors(units), settings)
    return [
        replace(base, mass_kg=10.0 + i, initial_position_m=(5.0, 40.0 + i, -20.0)).equipped(
            Sensors(units, (i, 9))
        )
        for i in range(count)
    ]


def lost(truth, tick, run):
    """Return the true state of a run, of which nothing is finite for a while."""
    return truth * 1e200 if run == 3 and 20 <= tick < 23 else truth


@pytest.mark.parametrize('case', CASES)
def test_lanes_have_the_bits_of_the_kernels(case):
    flown = runs(*CASES[case], count=40)
    starts, keys = np.array([s.start for s in flown]), np.zeros((40, 2))
    part = estimation.estimators_of(Batch(flown[0], starts, flown.copy, {}, keys, {}))
    m, t = part.memory.copy(), part.table
    sensing = [Sensing(s.section(Sensors), s) for s in flown]
    filters = [filter_of(s.section(Estimator), s.section(Sensors), s) for s in flown]
    memories = [memory_of(f) for f in filters]
    for f in filters:
        f[FULL] = 0.0
    w, rng = lanes.make_scratch(), np.random.default_rng(1)
    command, trouble, attitude = np.zeros((40, 3)), set(), np.zeros(HEADING)
    for tick in range(PLAIN.ticks + 1):
        truth = np.array([s.start for s in flown]) * (1.0 - 0.01 * tick)
        truth = np.array([lost(row, tick, run) for run, row in enumerate(truth)])
        for axis in range(3):
            rows = slice(axis * 40, axis * 40 + 40)
            w[lanes.R :][rows], w[lanes.V :][rows] = truth[:, axis], truth[:, 3 + axis]
        estimation.navigate(w, m, t, tick)
        for run, (s, f, own) in enumerate(zip(sensing, filters, memories, strict=True)):
            state = tuple(truth[run].tolist())
            sense(tick, state, ALIGNED[:4], s.table, s.memory)
            estimate(tick, tuple(command[run].tolist()), s.memory, attitude, f, own)
            found = [w[row + axis * 40 + run] for row in (lanes.SEEN_R, lanes.SEEN_V)
                     for axis in range(3)]  # fmt: skip
            assert found == list(own[X : X + 6]), (tick, run)
            trouble.add(own[RESETS] > 0)
        command = rng.uniform(-0.7, 0.7, (40, 3))
        for axis in range(3):
            w[lanes.FORCE + axis * 40 :][:40] = command[:, axis]
        estimation.remember(w, m, t, tick)
    assert trouble == {False, True}


def test_a_run_of_which_nothing_is_drawn_has_the_sensors_of_the_scenario():
    sensors, estimator = Sensors((LIDAR, RADIO)), Estimator(noise_scale=1.5)
    varied = estimation.vary_sensors(PLAIN.equipped(sensors, estimator), Draw({}, {}, (3, 4)))
    assert varied[0] == replace(sensors, noise_key=(3, 4)) and varied[1].noise_scale == 1.5
