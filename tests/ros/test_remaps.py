# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Topics that a user has remapped: recorded where they are, or named as a gap; over real DDS."""

import yaml
from inside import inside
from scenarios import lasting

from rpo_ctrl.controller_node import ControllerNode
from rpo_log.recorder_node import RecorderNode
from rpo_log.tools.info import inspect
from rpo_log.verify import ExitCode, verify
from rpo_mcap.format.run import TOPICS
from rpo_mcap.read.run_log import read_run
from rpo_nav.navigation_node import NavigationNode
from rpo_sim.plant_node import PlantNode

ODOMETRY = '/truth/odometry'


def fly(folder, scenario, *remaps):
    """Fly for two seconds with a recorder that nobody told of the remaps; return its folder."""
    with inside([part for rule in remaps for part in ('-r', rule)]) as inner:
        for kind in (ControllerNode, NavigationNode):
            inner.start(kind({}))
        recorder = inner.start(RecorderNode({'output': str(folder / 'run')}))
        path = lasting(2.0, folder, scenario)
        plant = inner.start(PlantNode({'scenario': path, 'wait_for_recorder': True}))
        inner.until(lambda: recorder.done and plant.done)
    assert (recorder.exit_code, plant.exit_code) == (0, 0)
    return folder / 'run'


def test_a_remapped_topic_is_recorded_where_it_is(ros_env, tmp_path):
    nodes = ('plant', 'fuzzy_controller')
    run = fly(tmp_path, 'approach', *(f'{node}:relative_state:={ODOMETRY}' for node in nodes))
    found = verify(run)
    assert found.exit_code == ExitCode.OK, found.sentence()
    topics = {topic.signal: topic.name for topic in inspect(run).messages}
    assert topics['relative_state'] == ODOMETRY and topics['control_force'] == '/control_force'


def test_a_node_that_hears_something_else_is_a_gap(ros_env, tmp_path):
    """Its command does not follow from what the chain gives it: that was `NOT as computed`."""
    run = fly(tmp_path, 'world_leo', 'fuzzy_controller:navigation_state:=relative_state')
    found = verify(run)
    assert found.exit_code == ExitCode.INCOMPLETE, found.sentence()
    gap = 'fuzzy_controller heard navigation_state on /relative_state, and not what the log has'
    assert found.gaps == (gap,)
    assert found.given == ('control_force (controller)',)
    assert 'dynamics' in found.stages and 'controller' not in found.stages
    topics = yaml.safe_load(read_run(run).attachments[TOPICS])['fuzzy_controller']
    assert topics['hears.navigation_state'] == '/relative_state'
