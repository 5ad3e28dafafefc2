# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""One scenario in a run: the plant says it, the others take it, a node of another one refuses."""

import pytest

from rpo_log.read.run_log import read_run
from rpo_log.verify import verify
from tools.node_processes import node_processes


@pytest.fixture
def ros(ros_env, tmp_path):
    with node_processes(ros_env, tmp_path) as started:
        yield started


def test_only_the_plant_is_told_what_to_fly(ros):
    """Navigation, controller and injector start first and know nothing of the scenario."""
    output = ros.folder / 'run'
    peers = [
        ros.node('rpo_sim', 'disturbance_injector'),
        ros.node('rpo_ctrl', 'rival_controller', controller='mpc'),
        ros.node('rpo_log', 'recorder', output=str(output)),
    ]
    plant = ros.node('rpo_sim', 'plant', scenario='quick', wait_for_recorder='true')
    assert plant.wait() == 0, plant.output
    assert peers[-1].wait() == 0, peers[-1].output
    assert 'disturbing as in quick' in peers[0].output
    assert verify(output).exit_code == 0
    assert dict(read_run(output).statuses[-1][1].values)['phase'] == 'finished'


@pytest.mark.parametrize('node', ['disturbance_injector', 'fuzzy_controller'])
def test_a_node_of_another_scenario_refuses_and_nothing_flies(ros, node):
    package = 'rpo_ctrl' if node == 'fuzzy_controller' else 'rpo_sim'
    plant = ros.node('rpo_sim', 'plant', scenario='approach')
    started = ros.node(package, node, scenario='paper_test')
    assert started.wait() == 2
    said = '`scenario` must be the one of the plant, approach; got paper_test'
    assert started.output.count(said) == 1 and 'Traceback' not in started.output
    assert plant.wait() == 3, plant.output
    assert said in plant.output and 'flying' not in plant.output


def test_the_same_name_with_another_content_is_told_apart(ros):
    changed = ros.folder / 'approach.yaml'
    from rpo_core import files

    text = files.find('scenario', 'approach').read_text()
    changed.write_text(text.replace('mass_kg: 10.0', 'mass_kg: 11.0'))
    plant = ros.node('rpo_sim', 'plant', scenario='approach')
    controller = ros.node('rpo_ctrl', 'fuzzy_controller', scenario=str(changed))
    assert controller.wait() == 2
    assert 'got approach with other content' in controller.output
    assert plant.wait() == 3
