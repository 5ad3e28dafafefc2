# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A fuzzy controller on the way of least energy: from the starts of a set, and dispersed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rpo_core.chain.flight import fly
from rpo_core.control.controller import load_controller
from rpo_core.files.scenario import load_set
from rpo_core.files.starts import Cube
from rpo_core.files.validation import InputError
from rpo_core.judge import metrics
from rpo_judge.evaluation.optimal import least_energy
from rpo_montecarlo.campaign import config
from rpo_montecarlo.campaign.run_batch import fly_runs
from rpo_montecarlo.engine.flights import flights_of
from rpo_training.fitting import training_set

STARTS = load_set('least_energy_starts')
CORNERS = replace(STARTS, starts=Cube((-100.0, 100.0)))


def test_flights_of_a_set_with_a_plan_have_the_bits_of_the_chain():
    controller = load_controller('allround')
    short = replace(CORNERS, base=replace(CORNERS.base, duration_s=190.0))
    flown = list(flights_of(controller, short))
    assert len(flown) == 8
    alone = fly(short.scenarios()[5], controller)
    np.testing.assert_array_equal(flown[5].states, alone.states)
    np.testing.assert_array_equal(flown[5].forces_n, alone.forces_n)


@pytest.mark.parametrize('controller', ['allround', 'trained'])
def test_the_farthest_starts_keep_the_conditions_near_the_least_energy(controller):
    """What is least needs no condition, and 200 s; the plan is at rest after 182 s."""
    flown = [metrics.of_flight(f) for f in flights_of(load_controller(controller), CORNERS)]
    assert all(all(found.conditions) for found in flown)
    states = np.array([scenario.start for scenario in CORNERS.scenarios()])
    least = least_energy(CORNERS.base, states)
    ratio = np.array([found.energy_n2s for found in flown]) / least
    assert (ratio > 1.0).all() and ratio.max() < 1.5


def test_the_dispersed_test_of_the_paper():
    """Forty of the ten thousand runs of `rpo campaign least_energy`."""
    columns = fly_runs(config.load(config.find('least_energy')), 600, 40)
    assert columns['hold_error_per_axis_m'].max() <= 0.5
    assert columns['hold_speed_per_axis_m_s'].max() <= 0.01


def test_a_search_refuses_starts_with_a_plan():
    with pytest.raises(InputError, match='a search flies to the goal; the flights of least_energy'):
        training_set('least_energy_starts')
