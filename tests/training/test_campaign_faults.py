# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Message faults in campaigns: bits, the free-running plant, effects, refusals."""

import numpy as np
import pytest
from campaign_documents import write_campaign
from typer.testing import CliRunner

from rpo_cli.cli import app
from rpo_core.files.validation import InputError
from rpo_montecarlo.campaign import config, faults, run_batch, sampling, single, sweep
from rpo_montecarlo.engine.parts import link
from rpo_ros.names import CONTROL_FORCE, DISTURBANCE_FORCE
from rpo_sim.free_running import FreeRunningPlant

LOSSY = {
    'state_loss': 0.3,
    'state_delay': 0.2,
    'force_loss': 0.2,
    'force_delay': 0.3,
    'late_by_ticks': 3,
    'stale_after_ticks': 5,
}


def columns_of(campaign, count=40):
    return run_batch.fly_runs(campaign, 0, count)


def test_a_run_alone_has_the_bits_of_the_campaign(tmp_path):
    campaign = config.load(write_campaign(tmp_path, faults=LOSSY))
    columns = columns_of(campaign)
    for number in (0, 7, 39):
        flight = single.fly_run(campaign, number)
        final = [columns[name][number] for name in run_batch.FINAL]
        np.testing.assert_array_equal(final, flight.states[-1])
        energy = (flight.saturated_forces_n**2).sum() * 0.1
        assert columns['energy_n2s'][number] == pytest.approx(energy, rel=1e-12)


def test_it_is_what_the_free_running_plant_does(tmp_path):
    """The node's own plant, fed by hand with what comes when."""
    campaign = config.load(write_campaign(tmp_path, faults=LOSSY, dispersions={}))
    scenario, controller = single.scenario_of(campaign, 3), campaign.controller
    key = sampling.draw(campaign, 3, 1).keys[0].tolist()
    fates = [
        link.lateness(tick, *key, campaign.config.faults.fates) for tick in range(scenario.ticks)
    ]
    plant = FreeRunningPlant(scenario, [CONTROL_FORCE, 'd'], stale_after_ticks=5)
    answers, stale = {}, 0
    for tick in range(scenario.ticks):
        answers[tick] = controller.force_n(plant.state[:3], plant.state[3:])
        for answered in range(tick + 1):
            if fates[answered] >= 0 and answered + fates[answered] == tick:
                plant.answer(CONTROL_FORCE, scenario.stamp_ns(answered), answers[answered])
        stale += CONTROL_FORCE in plant.stale
        push = scenario.disturbance.force_n(tick * 0.1)
        plant.fly({CONTROL_FORCE: plant.applied(CONTROL_FORCE), DISTURBANCE_FORCE: push})
    assert set(fates) == {-1, 0, 3, 6}  # lost, in time, one message late, both
    assert stale > 0
    assert plant.state == tuple(single.fly_run(campaign, 3).states[-1])


@pytest.mark.parametrize('name', faults.SHARES)
def test_every_fault_changes_the_flight_by_its_share(name, tmp_path):
    campaign = config.load(write_campaign(tmp_path, dispersions={}, faults={name: 0.4}))
    plain = config.load(write_campaign(tmp_path, dispersions={}))
    moved = columns_of(campaign)['final_x_m'] != columns_of(plain)['final_x_m']
    assert moved.all()
    fates = campaign.config.faults.fates
    late = np.array([link.lateness(t, 5, 6, fates) for t in range(5000)])
    hit = (late == link.LOST) if name.endswith('loss') else (late == faults.LATE_BY_TICKS)
    assert hit.mean() == pytest.approx(0.4, abs=0.03)
    assert (late[~hit] == 0).all()


def test_without_a_hit_nothing_changes(tmp_path):
    """Shares so small that no message is hit; the noise of navigation keeps its own words."""
    campaign = config.load(write_campaign(tmp_path, faults={'force_loss': 1e-9}))
    plain = config.load(write_campaign(tmp_path))
    for name, values in columns_of(plain).items():
        np.testing.assert_array_equal(columns_of(campaign)[name], values)


def test_when_all_is_lost_it_drifts(tmp_path):
    campaign = config.load(write_campaign(tmp_path, faults={'state_loss': 1.0}, runs=5))
    assert (columns_of(campaign, 5)['energy_n2s'] == 0.0).all()


@pytest.mark.parametrize(
    ('section', 'said'),
    [
        ({}, 'it has no effect'),
        ({'state_loss': 0.0}, 'it has no effect'),
        ({'state_loss': 0.1, 'force_repeat': 0.1}, '`force_repeat` has no effect'),
        ({'state_loss': 0.1, 'late_by_ticks': 2}, '`late_by_ticks` has no effect'),
        ({'state_los': 0.1}, 'did you mean `state_loss`'),
        ({'state_loss': 1.1}, '`state_loss` must be a finite number'),
        ({'force_delay': 0.1, 'late_by_ticks': 0}, '`late_by_ticks` must be a whole number'),
        ({'force_loss': 0.1, 'stale_after_ticks': -1}, '`stale_after_ticks` must be a whole'),
    ],
)
def test_bad_sections_are_one_sentence(section, said, tmp_path):
    path = write_campaign(tmp_path, faults=section)
    with pytest.raises(InputError) as caught:
        config.load(path)
    assert 'faults' in str(caught.value) and said in str(caught.value)


def test_a_run_with_faults_is_no_scenario(tmp_path):
    path = write_campaign(tmp_path, faults=LOSSY)
    arguments = ['campaign', str(path), '--run', '3', '--export', str(tmp_path / 'x.yaml')]
    result = CliRunner().invoke(app, arguments, env={'COLUMNS': '300'})
    assert result.exit_code == 2
    assert 'message faults' in result.output.splitlines()[-1]
    assert not (tmp_path / 'x.yaml').exists()


@pytest.mark.slow
def test_the_sweep_finds_where_it_no_longer_docks(tmp_path):
    plain = columns_of(config.load(write_campaign(tmp_path, dispersions={})), 1)
    drift = columns_of(
        config.load(write_campaign(tmp_path, dispersions={}, faults={'state_loss': 1.0})), 1
    )
    limit = float(plain['mean_error_norm_m'][0] + drift['mean_error_norm_m'][0]) / 2
    success = {'mean_error_norm_m': limit}
    path = write_campaign(tmp_path, dispersions={}, success=success, runs=20)
    campaign = config.load(path)
    found = sweep.Sweep(campaign, 20)
    rows = found.rows('lost')
    assert [row.percent for row in rows] == list(range(0, 101, 10))
    assert rows[0].alone.kept == 20 and rows[-1].alone.kept == 0
    edge = found.edge('lost', rows)
    assert edge.all_up_to < edge.none_from
    for percent, kept in ((edge.all_up_to, 20), (edge.none_from, 0)):
        share = percent / 100
        lossy = {'state_loss': share, 'force_loss': share}
        again = config.load(
            write_campaign(tmp_path, dispersions={}, success=success, runs=20, faults=lossy)
        )
        assert (columns_of(again, 20)['mean_error_norm_m'] <= limit).sum() == kept


@pytest.mark.slow
def test_the_command_prints_both_tables(tmp_path):
    path = write_campaign(tmp_path, runs=2)
    result = CliRunner().invoke(app, ['campaign', str(path), '--faults'], env={'COLUMNS': '300'})
    assert result.exit_code == 0, result.output
    assert '\n      90 ' in result.output
    for kind in ('lost', 'late'):
        assert f'undispersed, messages {kind}: all succeed up to' in result.output
