# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The limits of the problem, each against another way to find it and the mission's figures."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize
from typer.testing import CliRunner

from rpo_core import metrics
from rpo_core.scenario import load_scenario, load_set
from rpo_core.validation import InputError
from rpo_training import optimal
from rpo_training.cli import app

TRAINING = load_set('paper_training')
STARTS = np.hstack([TRAINING.initial_positions_m, np.zeros((216, 3))])


def from_start(*position: float, **changes: float):
    return replace(TRAINING.base, initial_position_m=position, **changes)


def test_least_energy_is_the_missions():
    energies = optimal.least_energy(TRAINING.base, STARTS)
    assert energies.mean() == pytest.approx(1.901, abs=5e-4)
    assert energies[-1] == pytest.approx(4.545, abs=5e-4)
    axes = optimal.least_energy(TRAINING.base, np.eye(6)[:3] * 100.0)
    assert axes == pytest.approx([1.560, 1.511, 1.484], abs=5e-4)
    coasting = optimal.least_energy(TRAINING.base, STARTS, coast_s=30.0)
    assert coasting.mean() == pytest.approx(3.086, abs=5e-4)


def test_least_energy_is_that_of_its_flight_which_ends_at_rest():
    for name in ('paper_test', 'paper_test_phase'):  # with a disturbance
        scenario = replace(load_scenario(name), initial_velocity_m_s=(0.1, -0.2, 0.3))
        flight = optimal.to_rest(scenario)
        assert np.abs(flight.states[-1]).max() < 1e-8
        energy = optimal.least_energy(scenario, np.array([scenario.start]))[0]
        assert metrics.assess(flight).energy_n2s == pytest.approx(energy, rel=1e-9)


def test_least_energy_under_the_papers_disturbance():
    for name, energy in (('paper_test', 0.242), ('paper_test_phase', 0.287)):
        scenario = load_scenario(name)
        found = optimal.least_energy(scenario, np.array([scenario.start]))
        assert found[0] == pytest.approx(energy, abs=5e-4)


def test_no_other_force_history_to_rest_is_cheaper():
    """A general-purpose solver, which knows nothing of Gramians, ends at the same forces."""
    scenario = from_start(10.0, -5.0, 3.0, duration_s=20.0, dt_s=2.0)
    reach, _, drift = optimal.gramian(scenario, scenario.ticks)
    ending = np.hstack(list(reach))
    miss = drift @ np.array(scenario.start)
    best = minimize(
        lambda f: f @ f,
        np.zeros(30),
        jac=lambda f: 2 * f,
        constraints={'type': 'eq', 'fun': lambda f: ending @ f + miss, 'jac': lambda f: ending},
        options={'ftol': 1e-14, 'maxiter': 500},
    )
    assert best.success
    forces = optimal.to_rest(scenario).forces_n[:-1]
    assert best.x.reshape(10, 3) == pytest.approx(forces, abs=1e-6)


def test_a_coasting_flight_rests_from_its_arrival_on():
    flight = optimal.to_rest(from_start(100.0, 100.0, 100.0), coast_s=30.0)
    assert np.abs(flight.states[1700:]).max() < 1e-8
    figures = metrics.assess(flight)
    assert figures.arrival_distance_m < 1e-8
    assert figures.energy_n2s == pytest.approx(
        optimal.least_energy(TRAINING.base, STARTS[-1:], coast_s=30.0)[0], rel=1e-9
    )


@pytest.mark.parametrize('position', [(100.0, 100.0, 100.0), (-5.0, 50.0, 5.0)])
def test_the_constrained_flight_meets_every_condition_between_the_bounds(position):
    scenario = from_start(*position)
    flight = optimal.constrained(scenario)
    figures = metrics.assess(flight)
    assert figures.arrival_speed_m_s <= metrics.MAX_ARRIVAL_SPEED_M_S * (1 + 1e-6)
    assert figures.arrival_distance_m <= metrics.MAX_ARRIVAL_DISTANCE_M * (1 + 1e-6)
    assert figures.slew_n_s <= metrics.MAX_SLEW_N_S * (1 + 1e-6)
    assert np.abs(flight.forces_n).max() <= scenario.max_force_n * (1 + 1e-6)
    # The constrained set holds every flight that rests at the origin 30 s before the end; both
    # flights are judged here by the core's metrics, not by the solver.
    coasting = metrics.assess(optimal.to_rest(scenario, coast_s=30.0))
    assert all(coasting.conditions)
    assert figures.energy_n2s < coasting.energy_n2s


def test_conditions_that_do_not_bind_cost_nothing():
    """With arrival made strict and the rest lifted, the convex program ends at the Gramian's."""
    scenario = from_start(50.0, -100.0, 5.0, duration_s=60.0, max_force_n=10.0)
    strict = optimal.Conditions(10.0, slew=100.0, arrival_speed=10.0, arrival_distance=1e-6)
    free = metrics.assess(optimal.constrained(scenario, strict)).energy_n2s
    # Position held over the last 30 s: at rest from 30 s on.
    expected = optimal.least_energy(scenario, np.array([scenario.start]), coast_s=30.0)[0]
    assert free == pytest.approx(expected, rel=1e-2)


def test_the_optimum_does_not_know_planar_and_vertical_signs():
    starts = np.array([[50.0, -5.0, 100.0, 0.1, 0, 0], [-50.0, 5.0, -100.0, -0.1, 0, 0]])
    both = optimal.least_constrained(TRAINING.base, starts)
    program = optimal.Program(TRAINING.base)
    assert both == pytest.approx([program.solve(start) for start in starts], rel=1e-6)


@pytest.mark.slow
def test_least_constrained_energy_is_the_missions():
    assert optimal.least_constrained(TRAINING.base, STARTS).mean() == pytest.approx(2.41, abs=5e-3)


def test_an_infeasible_optimum_names_what_would_have_to_give():
    scenario = from_start(100.0, 100.0, 100.0, duration_s=50.0)
    with pytest.raises(optimal.InfeasibleError, match=r'no flight of 50 s .* force .* N instead'):
        optimal.constrained(scenario)
    try:
        optimal.constrained(scenario)
    except optimal.InfeasibleError as error:
        needed = error.needed
    assert needed['arrival_distance'] > metrics.MAX_ARRIVAL_DISTANCE_M
    # What it names is enough, and not by much.
    base = optimal.Conditions.of(scenario)
    for name, limit in needed.items():
        optimal.constrained(scenario, replace(base, **{name: limit * 1.01}))
        with pytest.raises(optimal.InfeasibleError):
            optimal.constrained(scenario, replace(base, **{name: limit * 0.99}))


def test_a_condition_must_be_positive():
    with pytest.raises(InputError, match=r'`conditions.slew` must be .* > 0 N/s; got -1'):
        optimal.Conditions(0.5, slew=-1.0)


@pytest.mark.parametrize(
    ('arguments', 'code', 'said'),
    [
        (['--start', '100,100,100'], 0, '4.545'),
        (['--start', '100,100,100', '--duration', '50'], 2, 'no flight of 50 s'),
        (['--start', '100,100'], 2, '`--start` must be'),
        (['--start', '100,100,up'], 2, '`--start` must be'),
        (['--start', '1,2,3', '--duration', '0.1'], 2, 'at least 2 ticks'),
    ],
)
def test_the_command(arguments, code, said):
    result = CliRunner().invoke(app, ['optimal', *arguments])
    assert result.exit_code == code, result.output
    assert said in ' '.join(result.output.split())
