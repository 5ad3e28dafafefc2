# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A run of a campaign, flown again by the real nodes: the campaign's bits."""

import re
import shlex

import numpy as np
import pytest
from campaign_documents import write_campaign
from typer.testing import CliRunner

from rpo_cli.cli import app
from rpo_core.judge import metrics
from rpo_log.verify import verify
from rpo_mcap.read.run_log import flight_of, read_run
from rpo_montecarlo.campaign import config
from rpo_montecarlo.campaign.run_batch import FINAL, fly_runs
from tools.node_processes import node_processes

RUN = 7
CONTROLLER = 'handmade'


def one_process(ros, arguments, folder):
    node = ros.node(*arguments, '--output', str(folder / 'run'), '--no-report')
    assert node.wait() == 0, node.output


def five_processes(ros, arguments, folder):
    scenario = arguments[arguments.index('--scenario') + 1]
    others = [
        ros.node('rpo_ctrl', 'fuzzy_controller', controller=CONTROLLER),
        ros.node('rpo_sim', 'disturbance_injector'),
        ros.node('rpo_sim', 'navigation'),
    ]
    recorder = ros.node('rpo_log', 'recorder', output=str(folder / 'run'))
    plant = ros.node('rpo_sim', 'plant', scenario=scenario, wait_for_recorder='true')
    for node in (plant, recorder):
        assert node.wait() == 0, node.output
    for node in others:
        assert node.stop() == 0, node.output


@pytest.mark.parametrize('way', [one_process, pytest.param(five_processes, marks=pytest.mark.slow)])
def test_a_run_through_the_nodes_has_the_bits_of_the_campaign(way, ros_env, tmp_path):
    path = write_campaign(tmp_path)
    wanted = [str(tmp_path / name) for name in ('run.csv', 'run_7.yaml')]
    command = ['campaign', str(path), '--run', str(RUN), '--csv', wanted[0], '--export', wanted[1]]
    result = CliRunner().invoke(app, command, env={'COLUMNS': '300'})
    assert result.exit_code == 0, result.output
    ros2, run, *arguments = shlex.split(
        re.search(r'^ros2 run .*final_approach.*', result.output, re.M).group()
    )
    assert (ros2, run) == ('ros2', 'run')
    with node_processes(ros_env, tmp_path) as ros:
        way(ros, arguments, tmp_path)
    flown = read_run(tmp_path / 'run')
    assert flown.complete, flown.gaps
    expected = np.loadtxt(wanted[0], delimiter=',', skiprows=1)
    np.testing.assert_array_equal(flown.states, expected[:, 1:7])
    np.testing.assert_array_equal(flown.forces_n, expected[:, 7:10])
    np.testing.assert_array_equal(flown.disturbances_n, expected[:, 10:])
    columns = fly_runs(config.load(path), RUN, 1)
    row = metrics.row_of(flight_of(flown))
    assert columns['slew_per_axis_n_s'] == row[metrics.SLEW], (
        'one flight has one slew, however late it begins'
    )
    assert [columns[name][0] for name in FINAL] == flown.states[-1].tolist()
    assert columns['delay_ticks'] > 0  # so that all of it takes part
    difference = flown.values['navigation_state'] - flown.states
    assert np.abs(difference).max() > 1e-3  # the controller saw something else, and it is logged
    verified = verify(tmp_path / 'run')
    assert verified.exit_code == 0, verified.sentence()
