# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The limits of the problem, each against another way to find it and the mission's figures."""

from __future__ import annotations

import re
import sys
from dataclasses import replace

import numpy as np
import pytest
from invoking import invoke, refused
from landing import rest_at_landing
from scipy.optimize import minimize

from rpo.analysis import optimal
from rpo.analysis.optimal import least_energy
from rpo.training.fitting import training_set
from rpo_core.chain.flight import flights_of
from rpo_core.control.controller import load_controller
from rpo_core.files.validation import InputError
from rpo_core.judge import metrics
from rpo_core.scenario.requirements import (
    MAX_ARRIVAL_DISTANCE_M,
    MAX_ARRIVAL_SPEED_M_S,
    MAX_SLEW_N_S,
)
from rpo_core.scenario.scenario import load_scenario, load_set
from rpo_core.world import cw
from rpo_core.world.starts import Grid

TRAINING = load_set('paper_training')
STARTS = np.hstack([TRAINING.initial_positions_m, np.zeros((216, 3))])


def from_start(*position: float, **changes: float):
    return replace(TRAINING.base, initial_position_m=position, **changes)


@pytest.mark.parametrize(('name', 'least'), [('paper_test', 0.242), ('paper_test_phase', 0.287)])
def test_least_energy_is_that_of_its_flight_which_ends_at_rest(name, least):
    """Under the disturbance of the paper, moving at the start; from rest it is the mission's."""
    test = load_scenario(name)
    (energy,) = optimal.least_energy(test, np.array([test.start]))
    assert energy == pytest.approx(least, abs=5e-4)
    scenario = replace(test, initial_velocity_m_s=(0.1, -0.2, 0.3))
    flight = optimal.to_rest(scenario)
    assert np.abs(flight.states[-1]).max() < 1e-8
    (energy,) = optimal.least_energy(scenario, np.array([scenario.start]))
    assert metrics.of_flight(flight).energy_n2s == pytest.approx(energy, rel=1e-9)


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


@pytest.mark.every_landing
@pytest.mark.parametrize(
    'position', [(100.0, 100.0, 100.0), pytest.param((-5.0, 50.0, 5.0), marks=pytest.mark.slow)]
)
def test_the_constrained_flight_meets_every_condition_between_the_bounds(position):
    scenario = from_start(*position)
    flight = optimal.constrained(scenario)
    figures = metrics.of_flight(flight)
    assert figures.mean_speed_norm_m_s <= MAX_ARRIVAL_SPEED_M_S * (1 + 1e-6)
    assert figures.mean_error_norm_m <= MAX_ARRIVAL_DISTANCE_M * (1 + 1e-6)
    assert figures.slew_per_axis_n_s <= MAX_SLEW_N_S * (1 + 1e-6)
    assert np.abs(flight.forces_n).max() <= scenario.max_force_n * (1 + 1e-6)
    # To rest early and coast meets the arrival conditions, but ends with a jump of the force: where
    # the slew is free, the optimum must be at least as good.
    coasting = metrics.of_flight(optimal.to_rest(scenario, coast_s=30.0))
    assert coasting.conditions == (True, False, True)
    free = optimal.Program(scenario, replace(optimal.Conditions.of(scenario), slew=10.0))
    assert free.solve(scenario.start) <= min(coasting.energy_n2s, figures.energy_n2s * (1 + 1e-6))


@pytest.mark.parametrize('x, y, z', rest_at_landing([(-5.0, 50.0, 5.0), (50.0, 5.0, -5.0)]))
def test_duality_proves_the_constrained_optimum(x, y, z):
    """A lower bound of J for every flight, in closed form, meets the J of the flight found.

    For unit vectors u_k, w_k: mean |v_k| >= mean u_k.v_k, mean |r_k| >= mean w_k.r_k. Both are
    linear in the forces, so the least J under the two looser conditions (and no others) is a
    Lagrange dual of two multipliers, c' Q^-1 c / 4. The unit vectors are those of the flight, which
    must not rest within the window.
    """
    scenario = from_start(x, y, z)
    flight = optimal.constrained(scenario)
    a, b = cw.matrices(scenario.step)
    weights = np.zeros((2, 2001, 6))
    for row, columns in enumerate((slice(3, 6), slice(0, 3))):
        chosen = flight.states[-300:, columns]
        weights[row, -300:, columns] = chosen / np.linalg.norm(chosen, axis=1)[:, None] / 300
    slope, adjoint = np.empty((2, 2000, 3)), np.zeros((2, 6))
    for k in range(2000, 0, -1):
        adjoint = adjoint + weights[:, k]
        slope[:, k - 1] = adjoint @ b
        adjoint = adjoint @ a
    c = adjoint @ scenario.start - [0.05, 0.5]  # by how much free drift misses
    q = np.einsum('ikj,lkj->il', slope, slope) / (4.0 * scenario.dt_s)
    assert (np.linalg.solve(q, c) >= 0.0).all()  # multipliers
    bound = 0.25 * c @ np.linalg.solve(q, c)
    energy = metrics.of_flight(flight).energy_n2s
    assert bound <= energy * (1 + 1e-6)
    assert bound == pytest.approx(energy, rel=1e-5)


@pytest.mark.slow
def test_least_constrained_energy_is_the_missions():
    assert optimal.least_constrained(TRAINING.base, STARTS).mean() == pytest.approx(2.41, rel=0.01)


@pytest.mark.slow
def test_an_infeasible_optimum_names_what_would_have_to_give():
    scenario = from_start(100.0, 100.0, 100.0, duration_s=90.0)
    message = r'no flight of 90 s .* force .* N instead of 0.5'
    with pytest.raises(InputError, match=message) as raised:
        optimal.constrained(scenario)
    ways = re.findall(r'(\w+) (\S+) \S+ instead of', str(raised.value))
    needed = {name: float(limit) for name, limit in ways}
    assert needed['arrival_distance'] > MAX_ARRIVAL_DISTANCE_M
    # What it names is enough, and not by much.
    base = optimal.Conditions.of(scenario)
    for name, limit in needed.items():
        for share, feasible in ((1.1, True), (0.9, False)):
            conditions = replace(base, **{name: share * limit})
            found = optimal.Program(scenario, conditions).solve(scenario.start)
            assert (found is not None) == feasible, name


def test_without_the_solver_it_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, 'cvxpy', None)
    with pytest.raises(InputError, match='make setup LAYERS=campaign'):
        optimal.constrained(TRAINING.base)
    assert optimal.least_energy(TRAINING.base, STARTS).mean() > 0.0


def test_the_command():
    found = invoke('optimal', '--start', '20,20,20', '--duration', 80)
    start = from_start(20.0, 20.0, 20.0, duration_s=80.0)
    least = optimal.least_energy(start, np.array([start.start]))[0]
    assert found.exit_code == 0 and f'{least:.4f}' in found.output, found.output
    assert 'no flight of 20 s' in refused('optimal', '--start', '100,100,100', '--duration', 20)


# A fuzzy controller on the way of least energy: from the starts of a set, and dispersed.

FARTHEST = load_set('least_energy_starts')
CORNERS = replace(FARTHEST, starts=Grid.cube((-100.0, 100.0)))


@pytest.mark.parametrize('controller', ['allround', 'paper_ga'])
def test_the_farthest_starts_keep_the_conditions_near_the_least_energy(controller):
    """What is least needs no condition, and 200 s; the plan is at rest after 182 s."""
    flown = [metrics.of_flight(f) for f in flights_of(load_controller(controller), CORNERS)]
    assert all(all(found.conditions) for found in flown)
    states = np.array([scenario.start for scenario in CORNERS.scenarios()])
    least = least_energy(CORNERS.base, states)
    ratio = np.array([found.energy_n2s for found in flown]) / least
    assert (ratio > 1.0).all() and ratio.max() < 1.5


def test_a_search_refuses_starts_with_a_plan():
    with pytest.raises(InputError, match='a search flies to the goal; the flights of least_energy'):
        training_set('least_energy_starts')
