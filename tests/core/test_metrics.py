# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Metrics of a flight, against tiny flights worked out by hand and plain loops over a real one."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from rpo_core.chain.flight import Flight
from rpo_core.judge import metrics
from rpo_core.judge.metrics import Metrics
from rpo_core.thrusters.thrusters import Thrusters
from rpo_core.world.disturbance import Disturbance


def flight(paper_test, states, forces, dt_s=1.0, disturbance=None, **changes):
    """Return a made-up flight of len(states) - 1 ticks."""
    disturbance = disturbance or Disturbance()
    ticks = len(states) - 1
    scenario = replace(
        paper_test, dt_s=dt_s, duration_s=dt_s * ticks, disturbance=disturbance, **changes
    )
    states, forces = np.array(states, float), np.array(forces, float)
    return Flight(scenario, states, forces, scenario.disturbances_n)


@pytest.fixture
def tiny(paper_test):
    """Three steps of 2 s; the last command is answered and not flown."""
    states = [
        (3, 4, 0, 0, 0, 1),
        (0, 0, -2, 2, 1, 2),
        (1, 2, 2, 0, -3, 4),
        (0, -6, 8, 6, -2, 3),
    ]
    forces = [(0.1, 0, 0), (0.3, -0.4, 0), (0, -0.9, 0.2), (9, 9, 9)]
    return flight(paper_test, states, forces, dt_s=2.0)


def test_energy_counts_what_the_thrusters_gave(tiny):
    # 0.01, then 0.09 + 0.16, then 0.25 (0.9 saturated at 0.5) + 0.04; each for 2 s
    assert metrics.of_flight(tiny).energy_n2s == pytest.approx(2 * (0.01 + 0.25 + 0.29), abs=1e-15)


def test_slew_is_between_commands_flown(tiny):
    # 0.2 in x and 0.4 in y, then 0.3, 0.1 and 0.2; over 2 s; neither the first nor the last counts
    assert metrics.of_flight(tiny).slew_per_axis_n_s == pytest.approx(0.4 / 2, abs=1e-15)
    one = replace(tiny, scenario=replace(tiny.scenario, duration_s=2.0), states=tiny.states[:2])
    one = replace(one, forces_n=tiny.forces_n[:2])
    assert metrics.of_flight(one).slew_per_axis_n_s == 0.0  # the step from rest alone


def test_arrival_means_are_of_norms_and_leave_the_start_out(tiny):
    figures = metrics.of_flight(tiny)  # 30 s is longer than the flight
    assert figures.mean_error_norm_m == pytest.approx((2 + 3 + 10) / 3, abs=1e-15)
    assert figures.mean_speed_norm_m_s == pytest.approx((3 + 5 + 7) / 3, abs=1e-15)


def test_windows_hold_their_seconds(paper_test):
    states = [(tick, 0, 0, 0, -tick / 100, 0) for tick in range(101)]
    forces = [(0, 0, -0.004 * tick) for tick in range(101)]
    long = flight(paper_test, states, forces)
    assert metrics.window_ticks(long.scenario, 30.0) == 30
    assert metrics.window_ticks(long.scenario, 0.2) == 1
    assert metrics.window_ticks(long.scenario, 1e6) == 100
    figures = metrics.of_flight(long)
    assert figures.mean_error_norm_m == sum(range(71, 101)) / 30
    assert figures.mean_speed_norm_m_s == pytest.approx(sum(range(71, 101)) / 3000, abs=1e-15)
    assert metrics.window(long, 10.0) == (100.0, 1.0, pytest.approx(0.396))
    falling = flight(paper_test, states[::-1], forces[::-1])
    # states 91 .. 100 hold 9 .. 0; forces 90 .. 99 hold 0.004 x (10 .. 1)
    assert metrics.window(falling, 10.0) == (9.0, 0.09, pytest.approx(0.04))


@pytest.mark.parametrize(
    ('figures', 'conditions', 'penalty'),
    [
        (Metrics(3.0, 0.05, 0.1, 0.5), (True, True, True), 0),
        (Metrics(3.0, 0.0500001, 0.1, 0.5), (False, True, True), 100),
        (Metrics(3.0, 0.05, 0.1000001, 0.5), (True, False, True), 100),
        (Metrics(3.0, 0.05, 0.1, 0.5000001), (True, True, False), 100),
        (Metrics(3.0, 1.0, 1.0, 1.0), (False, False, False), 300),
        (Metrics(3.0, math.nan, 0.0, 0.0), (False, True, True), 100),
    ],
)
def test_fitness_is_energy_and_penalties(figures, conditions, penalty):
    assert figures.conditions == conditions
    assert figures.fitness == 3.0 + penalty


def test_the_papers_training_example_can_be_computed(paper_test):
    states = np.zeros((101, 6))
    states[51:, 3:] = [0.003, 0.004, 0.012]
    states[:51, 3:] = 9.0
    forces = np.zeros((101, 3))
    forces[50:, 1] = 0.02
    made = flight(paper_test, states, forces)
    row = metrics.row_of(made, metrics.windows_of(made.scenario, tail_s=50.0))
    assert row[metrics.ARRIVAL_SPEED] == pytest.approx(0.013, abs=1e-15)
    assert row[metrics.SLEW] == 0.02


def test_a_delay_of_the_thrusters_moves_the_first_command_and_is_no_slew(paper_test):
    forces = [(0.3, 0, 0), (0.1, 0, 0), (0.1, 0, 0), (0, 0, 0), (0, 0, 0)]
    prompt = flight(paper_test, np.zeros((5, 6)), forces)
    late = replace(prompt, scenario=prompt.scenario.equipped(Thrusters(delay_ticks=1)))
    assert late.saturated_forces_n[:, 0].tolist() == [0.0, 0.3, 0.1, 0.1]
    for made in (prompt, late):
        assert metrics.of_flight(made).slew_per_axis_n_s == pytest.approx(0.2, abs=1e-15)


def test_closing_speed_duty_and_time_to_goal(tiny):
    # -r.v / |r|: 0, then 4 / 2, -2 / 3, -36 / 10
    closing = metrics.closing_speeds_m_s(tiny)
    assert closing.tolist() == pytest.approx([0.0, 2.0, -2 / 3, -3.6], abs=1e-15)
    duty = next(f for f in metrics.others_of(tiny) if 'duty' in f.statement)
    assert duty.value == pytest.approx((0.1 + 0.7 + 0.5 + 0.2) / 9 / 0.5)
    assert metrics.arrival_time_s(tiny) is None
    still = replace(tiny, states=np.zeros((4, 6)))
    assert metrics.closing_speeds_m_s(still).tolist() == [0.0] * 4
    assert metrics.arrival_time_s(still) == 0.0
    shown = {figure.statement: figure for figure in metrics.others_of(tiny)}
    assert shown['time to goal, within 0.5 m per axis'].value == math.inf
    assert shown['range rate, at the end'].value == pytest.approx(3.6, abs=1e-15)
    assert shown['position error per axis, at the end'].value == 8.0
    assert shown['position error (norm), at the end'].value == 10.0
