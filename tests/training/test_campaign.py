# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Campaigns: the bits of the core, dispersions that act, statistics."""

from concurrent.futures import CancelledError
from dataclasses import replace

import numpy as np
import pytest
from campaign_documents import EVERYTHING
from scipy import stats

from rpo.montecarlo import config, in_python, run_batch, sampling, statistics
from rpo.montecarlo.variations import thrust_matrix
from rpo_core.control.controller import load_controller
from rpo_core.control.controller_file import ControllerStage
from rpo_core.kernels.jit import COMPILED
from rpo_core.thrusters.thrusters import rotation


def all_columns(campaign):
    results = [
        run_batch.fly_unit(campaign, u) for u in range(run_batch.units(campaign.config.runs))
    ]
    return dict(zip(run_batch.COLUMNS, np.hstack(results), strict=True))


# A controller in Python.


class Lagged(ControllerStage):
    """The force of the tick before."""

    name, provenance, memory_ticks = 'lagged', (), 1

    def stage(self, dt_s):
        self.inner = load_controller('pd').stage(dt_s)
        return self

    def reset(self):
        self.last = (0.0, 0.0, 0.0)

    def step(self, tick, *inputs):
        force, (self.last,) = self.last, self.inner.step(tick, *inputs)
        return (force,)


def test_a_controller_in_python_has_the_same_columns_and_says_so(loaded):
    campaign = loaded(controller='pd')
    python = replace(campaign, controller=Lagged())
    columns = run_batch.fly_runs(python, 0, 3)
    assert list(columns) == list(run_batch.fly_runs(campaign, 0, 1))
    assert columns['final_x_m'][2] == run_batch.fly_run(python, 2).states[-1, 0]
    assert in_python.sentence(campaign) == ''
    said = in_python.sentence(python)
    assert said.startswith('stage `') and ' in Python, about ' in said if COMPILED else not said


def test_a_unit_stops_between_two_runs(loaded):
    left = iter([False, False, True])
    with pytest.raises(CancelledError):
        run_batch.fly_unit(loaded(), 0, lambda: next(left))
    assert not list(left)


# Dispersions.


@pytest.mark.parametrize('name', EVERYTHING)
@pytest.mark.parametrize('sampling_name', config.SAMPLINGS)
def test_every_dispersion_changes_the_flight(name, sampling_name, loaded):
    one = {'dispersions': {name: EVERYTHING[name]}, 'runs': 20, 'sampling': sampling_name}
    dispersed = all_columns(loaded(**one))
    nominal = all_columns(loaded(dispersions={}, runs=20))
    moved = dispersed['final_x_m'] != nominal['final_x_m']
    if name == 'delay_ticks':  # nothing happens to a run without delay
        np.testing.assert_array_equal(moved, dispersed['delay_ticks'] > 0)
        assert moved.any()
    else:
        assert moved.all()
        assert len(np.unique(dispersed['final_x_m'])) == 20


def test_the_effects_are_those_of_physics(loaded):
    campaign = loaded()
    runs = sampling.draw(campaign, 0, 90)
    for i in range(5):
        about = np.array([runs.column(f'misalignment_{axis}_rad')[i] for axis in 'xyz'])
        matrix = np.array(rotation(about))
        np.testing.assert_allclose(matrix @ matrix.T, np.eye(3), atol=1e-15)
        np.testing.assert_allclose(matrix @ about, about)
    quarter = np.array(rotation((0.0, 0.0, np.pi / 2)))  # about z: x goes to y
    np.testing.assert_allclose(quarter @ [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], atol=1e-15)
    values = dict.fromkeys(runs.names, 0.0) | {'thrust_share_x': 0.1}
    matrix = np.array(thrust_matrix(values | {'misalignment_z_rad': np.pi / 2}))
    np.testing.assert_allclose(matrix @ [1.0, 0.0, 0.0], [0.0, 1.1, 0.0], atol=1e-15)
    flown = run_batch.scenario_of(campaign, 0)
    assert flown.step.vxfx == pytest.approx(0.1 / runs.column('mass_kg')[0], rel=1e-5)


def test_draws_have_the_distributions_that_were_asked_for(loaded):
    campaign = loaded(runs=2000)
    p = dict(zip(sampling.PARAMETERS, sampling.draw(campaign, 0, 2000).parameters.T, strict=True))
    scenario = campaign.scenario
    x = (p['initial_x_m'] - scenario.initial_position_m[0]) / 5.0
    assert stats.kstest(x, 'uniform', (-1.0, 2.0)).pvalue > 0.01
    mass = (p['mass_kg'] / scenario.mass_kg - 1.0) / 0.03
    assert stats.kstest(mass, stats.truncnorm(-3.0, 3.0).cdf).pvalue > 0.01
    assert np.abs(mass).max() <= 3.0
    assert np.bincount(p['delay_ticks'].astype(int)).tolist() == [500] * 4  # a stratified choice
    # Every block of 1000 is a Latin hypercube: one value in each of 1000 strata.
    for block in (x[:1000], x[1000:]):
        strata = np.floor((block + 1.0) / 2.0 * 1000.0)
        assert sorted(strata) == list(range(1000))


# Statistics.


def test_a_figure_that_is_not_a_number_is_no_success(loaded):
    settings = loaded().config
    kept = statistics.successes(settings, {'hold_error_per_axis_m': np.array([1.0, np.nan, 61.0])})
    assert kept.tolist() == [True, False, False]


def test_quantiles_are_those_of_the_values_also_where_some_are_infinite():
    values = np.arange(1001.0)
    found = statistics.spread('x', 'm', values[::-1].copy())
    assert found.quantiles == (500.0, 950.0, 990.0)
    assert (found.worst, found.worst_run, found.mean) == (1000.0, 0, 500.0)
    values[-40:] = np.inf  # 4 % never arrive: half and 95 % of the runs did, 99 % did not
    assert statistics.spread('x', 's', values).quantiles == (500.0, 950.0, np.inf)
    few = np.array([1.0, 2.0, np.inf])
    assert statistics.spread('x', 's', few).quantiles == (2.0, np.inf, np.inf)
