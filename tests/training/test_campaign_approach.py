# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Campaigns with starts in a shell, and with plans and runtime assurance side by side."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from rpo_core.files.validation import InputError
from rpo_montecarlo.campaign import config, run_batch
from rpo_montecarlo.campaign.quantities import Dispersion, dispersion
from rpo_montecarlo.campaign.run_batch import fly_runs
from rpo_montecarlo.campaign.sampling import draw


@pytest.fixture(scope='module', params=['latin_hypercube', 'random'])
def drawn(request):
    campaign = config.load(config.find('docking'), sampling=request.param)
    return draw(campaign, 0, 4000)


@pytest.mark.parametrize(('columns', 'least', 'most'), [((0, 3), 50.0, 200.0), ((3, 6), 0.0, 0.1)])
def test_directions_and_lengths_in_a_shell_are_equally_likely(drawn, columns, least, most):
    vectors = drawn.starts[:, slice(*columns)]
    length = np.linalg.norm(vectors, axis=1)
    assert length.min() >= least and length.max() <= most
    assert stats.kstest(length, 'uniform', (least, most - least)).pvalue > 0.001
    ahead = vectors / length[:, None]
    for axis in range(3):  # a component of a random direction is uniform, about any axis
        assert stats.kstest(ahead[:, axis], 'uniform', (-1.0, 2.0)).pvalue > 0.001
    skew = ahead @ np.array([1.0, -2.0, 2.0]) / 3.0
    assert stats.kstest(skew, 'uniform', (-1.0, 2.0)).pvalue > 0.001
    assert abs(stats.spearmanr(length, ahead[:, 2]).statistic) < 0.06


def test_a_run_is_drawn_alone_as_among_others_and_others_keep_their_draws():
    campaign = config.load(config.find('docking'))
    some = draw(campaign, 1234, 3)
    np.testing.assert_array_equal(draw(campaign, 1236, 1).parameters[0], some.parameters[2])
    spreads = dict(campaign.config.dispersions)
    spreads['initial_position_m'] = Dispersion('shell', (60.0, 70.0))
    other = replace(campaign, config=replace(campaign.config, dispersions=spreads))
    np.testing.assert_array_equal(draw(other, 1234, 3).parameters[:, 3:], some.parameters[:, 3:])


@pytest.mark.parametrize(
    ('value', 'said'),
    [
        ({'shell': 50.0}, 'must be a list, the smallest and the largest length in m'),
        ({'shell': [60.0, 50.0]}, '`dispersions.initial_position_m.shell[1]` must be'),
        ({'shell': [-1.0, 50.0]}, '`dispersions.initial_position_m.shell[0]` must be'),
    ],
)
def test_a_bad_shell_is_one_sentence(value, said):
    with pytest.raises(InputError, match='shell') as refused:
        dispersion('initial_position_m', value)
    assert said in str(refused.value)


def test_plans_and_assurance_fly_side_by_side_with_the_bits_of_the_chain(monkeypatch):
    """The runs are delayed by 2, 1 and 0 ticks; assurance changes commands."""
    campaign = config.load(config.find('docking'), ['assurance.speed={speed_m_s: 0.3}'])
    first = 5
    assert len(set(draw(campaign, first, 3).column('delay_ticks'))) > 1
    side_by_side = fly_runs(campaign, first, 3)
    free = fly_runs(config.load(config.find('docking')), first, 3)
    assert (free['energy_n2s'] != side_by_side['energy_n2s']).all(), 'assurance had to act'
    monkeypatch.setattr(run_batch, 'why_not', lambda *_: 'a test')
    for name, values in fly_runs(campaign, first, 3).items():
        np.testing.assert_array_equal(values, side_by_side[name], name)


def test_docking_from_anywhere():
    """Forty of the ten thousand runs of `rpo campaign docking`."""
    campaign = config.load(config.find('docking'))
    columns = fly_runs(campaign, 400, 40)
    for name in campaign.config.success:
        values, limit = campaign.config.limit(name, columns)
        assert (values <= limit).all(), name
