# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Benchmarks of others: their published figures come back, and our stack keeps what they ask."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import expm
from typer.testing import CliRunner

from rpo_cli.cli import app
from rpo_core.chain.flight import Flight, fly
from rpo_core.control.controller import load_controller
from rpo_core.files.scenario import load_scenario
from tools import peers

FOLDER = Path(__file__).parents[2] / 'offline_training' / 'examples' / 'benchmarks'
ARCH = load_scenario(FOLDER / 'arch_rendezvous.yaml')
VBAR = load_scenario(FOLDER / 'vbar_approach.yaml')


def test_the_pd_of_vbar_has_its_published_figures():
    """The package says of 0.3.1: captured, 2.41 m/s, about 620 s (steps of 10 s)."""
    flight = fly(replace(peers.alone(VBAR), duration_s=1000.0), peers.vbar_pd(VBAR))
    found = peers.approach(flight, VBAR.goal_position_m)
    assert found.delta_v_m_s == pytest.approx(2.41, abs=0.01)
    assert 610.0 <= found.captured_s <= 620.0


def test_the_regulator_of_arch_is_the_loop_of_its_matrices():
    """Continuous feedback by the matrix exponential, beside ours that holds forces for a second."""
    n, m = ARCH.mean_motion_rad_s, ARCH.mass_kg
    a = np.array([[0, 0, 1, 0], [0, 0, 0, 1], [3 * n * n, 0, 0, 2 * n], [0, 0, -2 * n, 0]])
    k = np.array([[-28.8287, 0.1005, -1449.9754, 0.0046], [-0.087, -33.2562, 0.00462, -1451.5013]])
    k = k * [1, 1, 60, 60] / 3600.0 / m
    exact = expm((a + np.vstack([np.zeros((2, 4)), k])) * 3000.0) @ [-900.0, -400.0, 0.0, 0.0]
    flight = fly(replace(peers.alone(ARCH), duration_s=3000.0), peers.arch_lqr())
    np.testing.assert_allclose(flight.states[-1, [0, 1]], exact[:2], rtol=2e-3)


def test_our_stack_keeps_the_constraints_of_arch():
    scenario = peers.arch_starts(ARCH, 0, 1)[0]
    found = peers.rendezvous(fly(scenario, peers.fitted(load_controller('allround'), scenario)))
    assert found.cone_deg < 30.0 and found.speed_m_s <= 3.3 / 60.0
    assert found.clear == len(peers.ABORTS_S) and found.nearest_m > 0.15
    assert found.end_m < 0.2


def test_what_breaks_the_constraints_of_arch_is_seen():
    """A chaser that comes along V-bar, outside the cone and too fast, and stays at the target."""
    t = np.arange(12001.0)
    states = np.zeros((12001, 6))
    states[:, 1], states[:, 4] = -600.0 + 0.06 * t, 0.06
    states[8000:] = [0.0, -0.12, 0.0, 0.0, 0.0, 0.0]
    still = Flight(ARCH, states, np.zeros((12001, 3)), np.zeros((12001, 3)))
    found = peers.rendezvous(still)
    assert found.cone_deg > 80.0 and found.speed_m_s == pytest.approx(0.06)
    assert found.clear == (peers.ABORTS_S < 8000.0).sum()
    assert found.delta_v_m_s == 0.0


@pytest.mark.every_landing
def test_the_command_prints_both_beside_each_other():
    files = [str(FOLDER / f'{name}.yaml') for name in ('arch_rendezvous', 'vbar_approach')]
    done = CliRunner().invoke(
        app, ['safety', 'peers', files[1], '--starts', '2'], env={'COLUMNS': '200'}
    )
    assert done.exit_code == 0, done.output
    lines = [line for line in done.stdout.splitlines() if 'from ahead' in line]
    assert [line.split()[-1] for line in lines] == ['met', 'broken']
    assert math.isfinite(float(lines[0].split()[-2]))
