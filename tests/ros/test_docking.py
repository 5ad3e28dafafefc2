# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Guidance and runtime assurance as nodes of their own: a run of the campaign `docking` docks."""

from __future__ import annotations

import numpy as np
import pytest

from rpo_core.scenario import dumps
from rpo_core.verdicts import verdicts
from rpo_log.read.run_log import flight_of, read_run
from rpo_log.verify import verify
from rpo_training.campaign import config
from rpo_training.campaign.single import fly_run, scenario_of
from tools.node_processes import node_processes

RUN = 4


@pytest.mark.slow
@pytest.mark.timeout(240)
def test_the_whole_chain_docks_as_separate_nodes_and_verifies(ros_env, tmp_path):
    """Noise and bias of navigation, thrusters late, weak and crooked, a mass that nobody knows."""
    campaign = config.load(config.find('docking'))
    path = tmp_path / 'run.yaml'
    path.write_text(dumps(scenario_of(campaign, RUN)))
    with node_processes(ros_env, tmp_path) as ros:
        others = [
            ros.node('rpo_nav', 'navigation'),
            ros.node('rpo_guidance', 'guidance'),
            ros.node('rpo_ctrl', 'fuzzy_controller', controller='allround'),
            ros.node('rpo_safety', 'assurance'),
        ]
        recorder = ros.node('rpo_log', 'recorder', output=str(tmp_path / 'run'))
        plant = ros.node('rpo_sim', 'plant', scenario=str(path), wait_for_recorder='true')
        for node in (plant, recorder):
            assert node.wait(180.0) == 0, node.output
        for node in others:
            assert node.stop() == 0, node.output
    flown = read_run(tmp_path / 'run')
    assert flown.complete, flown.gaps
    expected = fly_run(campaign, RUN)
    np.testing.assert_array_equal(flown.states, expected.states)
    for name in ('reference_state', 'assured_force'):
        np.testing.assert_array_equal(flown.values[name], expected.signals[name])
    judged = verdicts(flight_of(flown))
    assert len(judged) == 3 and all(v.holds for v in judged), judged
    verified = verify(tmp_path / 'run')
    assert verified.exit_code == 0, verified.sentence()
