# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Guidance and runtime assurance in one chain: around, in by the corridor, contact, docked."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from references import assert_bits_of_the_stage

from rpo_core.chain.flight import fly
from rpo_core.control.controller import load_controller
from rpo_core.guidance.guidance import DOCKED, Guidance, GuidanceStage, Leg, nominal
from rpo_core.judge import contact, metrics
from rpo_core.judge.verdicts import verdicts
from rpo_core.scenario.requirements import Requirements
from rpo_core.scenario.scenario import load_scenario
from rpo_log.show import report


@pytest.fixture(scope='module')
def docking():
    return load_scenario('docking')


@pytest.fixture(scope='module')
def flight(docking):
    return fly(docking, load_controller('allround'))


def test_docks_within_every_requirement_and_assurance_lets_every_command_pass(flight):
    judged = verdicts(flight)
    assert len(judged) == 5 and all(v.holds for v in judged), judged
    np.testing.assert_array_equal(flight.signals['assured_force'], flight.forces_n)


def test_no_force_acts_once_it_has_docked(flight, docking):
    beyond = np.flatnonzero(flight.positions_m[:, 1] <= 1.0)
    first = beyond[np.linalg.norm(flight.errors[beyond, :3], axis=1) < 0.3][0]
    assert first == pytest.approx(600.0 / docking.dt_s, abs=5)
    assert not flight.forces_n[first:].any() and flight.forces_n[first - 1].any()


@pytest.mark.parametrize('required', [True, False])
def test_the_table_says_when_it_docks_and_nothing_of_what_comes_after(flight, required):
    """With the requirements on contact, and by guidance alone; it drifts on for 8 s."""
    if not required:
        limits = Requirements(slew_per_axis_n_s=2.0)
        flight = replace(flight, scenario=replace(flight.scenario, requirements=limits))
    docked = np.flatnonzero(flight.positions_m[:, 1] > 1.0)[-1] + 1
    shown = {figure.statement: figure.value for figure in metrics.others_of(flight)}
    assert shown['time to contact'] == docked * flight.scenario.dt_s
    assert shown['speed (norm), at contact'] == pytest.approx(0.075, abs=1e-4)
    assert shown['position error (norm), at contact'] < 1e-3
    assert not [name for name in shown if 'at the end' in name or 'time to goal' in name]
    assert shown['largest closing speed'] < 0.5
    rows = report.rows(flight)
    said = [row for row in rows['requirements of docking'] if row[3] == 'NOT judged']
    assert [row[0] for row in said] == ([] if required else ['arrival', 'contact', 'end state'])
    away = flight.states + np.array([0.0, 2.0, 0.0, 0.0, 0.0, 0.0])
    assert contact.docked_at(replace(flight, states=away)) is None


def test_a_chaser_that_is_late_finds_the_reference_moving_on(docking):
    """It goes on past the port, so that a late chaser does not touch too slowly; then it waits."""
    stage = GuidanceStage(docking.section(Guidance), docking)
    behind = docking.start
    rows = [stage.step(tick, behind)[0] for tick in range(docking.ticks + 1)]
    assert DOCKED not in [change.phase for change in stage.changes]
    y = np.array(rows)[:, 1]
    assert y[6000] == 1.0 and y[6010] == pytest.approx(1.0 - 0.075)
    assert y[-1] == pytest.approx(1.0 - 0.3, abs=0.0075) and rows[-1][3:] == (0.0, 0.0, 0.0)
    assert nominal(docking.section(Guidance), docking).changes[-1].phase == DOCKED


LEGS = (
    Leg(name='a', kind='fly_around', to_m=(0.0, 60.0, 0.0), speed_m_s=0.6),
    Leg(name='b', kind='straight', to_m=(0.0, 40.0, 0.0), speed_m_s=0.2, end_speed_m_s=0.1),
    Leg(name='c', kind='transfer', to_m=(0.0, 30.0, 0.0), duration_s=61.7),
)


@pytest.mark.parametrize('legs', [LEGS, LEGS[:2], LEGS[2:], None])
@pytest.mark.parametrize('past_m', [0.0, 0.3])
def test_the_table_of_a_plan_has_the_bits_of_the_stage(docking, legs, past_m):
    settings = replace(docking.section(Guidance), past_port_m=past_m)
    settings = settings if legs is None else replace(settings, legs=legs)
    assert_bits_of_the_stage(settings, replace(docking, duration_s=900.0))


@pytest.mark.parametrize(
    ('start', 'most'),
    [
        ((25.2, -61.83, 6.19, 0.0, -0.01, -0.04), 0.21),  # 2.29 N²s on the side of the free path
        ((30.31, -50.09, 8.24, -0.04, -0.05, -0.06), 0.19),  # 0.33
        ((54.25, -22.34, 13.2, -0.02, -0.02, -0.09), 0.13),  # 0.20
    ],
)
def test_a_dear_transfer_is_planned_on_other_sides_too(docking, start, most):
    stage = GuidanceStage(docking.section(Guidance), docking)
    rows = stage.rows(start, docking.ticks)
    energy = (rows[:6000, 6:] ** 2).sum() * docking.dt_s
    assert energy <= most
    distance = np.linalg.norm(rows[:, :3], axis=1)
    outside = np.hypot(rows[:, 0], rows[:, 2]) > np.tan(np.radians(10.0)) * (rows[:, 1] - 1.0)
    assert distance[:6000][outside[:6000]].min() > 10.0


@pytest.mark.parametrize('position', [(0.2, 6.3, -5.0), (0.2, -5.4, 1.7), (4.6, -1.3, 0.7)])
def test_from_inside_the_sphere_it_comes_no_nearer_until_the_corridor(docking, position):
    stage = GuidanceStage(docking.section(Guidance), docking)
    stage.step(0, (*position, 0.01, -0.02, 0.0))
    transfer = stage._flown.transfer
    path = transfer.states[:, :3]
    outside = np.hypot(path[:, 0], path[:, 2]) > np.tan(np.radians(10.0)) * (path[:, 1] - 1.0)
    assert np.linalg.norm(path[outside][1:-1], axis=1).min() > np.linalg.norm(position) - 0.1
    assert transfer.violated_m < 0.01
    assert stage._flown.ticks < 1.5 * stage.settings.legs[0].duration_s / docking.dt_s


def test_guidance_that_is_told_a_wrong_mass_plans_with_it(docking):
    settings = docking.section(Guidance)
    light = replace(docking, mass_kg=8.0)
    told = GuidanceStage(replace(settings, mass_kg=10.0), light).rows(docking.start, 100)
    np.testing.assert_array_equal(told, GuidanceStage(settings, docking).rows(docking.start, 100))
    own = GuidanceStage(settings, light).rows(docking.start, 100)
    np.testing.assert_allclose(own[0, 6:] / told[0, 6:], 0.8, rtol=1e-3)


@pytest.mark.every_landing
def test_the_passive_approach_is_protected_until_it_commits():
    """From no moment beyond 20 m a silence of the thrusters leads into the sphere in two orbits."""
    from rpo.analysis.assurance import silence

    scenario = load_scenario('passive_approach')
    found = silence(scenario, load_controller('allround'), 10.0, 20.0, 2.0, (-1.8e-6, 0.0))
    assert found.unprotected == 0
    straight = load_scenario('docking')
    assert silence(straight, load_controller('allround'), 10.0, 20.0, 2.0, (0.0, 0.0)).share > 0.05
