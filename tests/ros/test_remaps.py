# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Topics that a user has remapped: recorded where they are, or named as a gap; over real DDS."""

import time
from functools import partial

import yaml
from inside import inside
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from scenarios import lasting

from rpo_core.wire import interfaces
from rpo_ctrl.controller_node import ControllerNode
from rpo_log.recorder_node import RecorderNode
from rpo_log.tools.info import inspect
from rpo_log.verify import ExitCode, verify
from rpo_mcap.format.run import TOPICS
from rpo_mcap.read.run_log import read_run
from rpo_nav.navigation_node import NavigationNode
from rpo_ros import qos
from rpo_ros.signals import message_class
from rpo_sim.disturbance_injector_node import DisturbanceInjectorNode
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


def test_a_plant_flies_on_answers_that_are_remapped(ros_env, tmp_path):
    """It looked for their publisher under the name before, and waited for ever."""
    nodes = ('plant', 'fuzzy_controller')
    run = fly(tmp_path, 'approach', *(f'{node}:control_force:=/cmd/force' for node in nodes))
    assert verify(run).exit_code == ExitCode.OK, verify(run).sentence()
    topics = {topic.signal: topic.name for topic in inspect(run).messages}
    assert topics['control_force'] == '/cmd/force'


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


def test_what_somebody_else_records_in_flight_verifies(ros_env, tmp_path):
    """As `ros2 bag record --all` does: each message as it comes, by the wall clock; remapped."""
    store = get_typestore(Stores.ROS2_JAZZY)
    with (
        Writer(tmp_path / 'bag', version=9, storage_plugin=StoragePlugin.SQLITE3) as bag,
        inside(['-r', f'relative_state:={ODOMETRY}']) as inner,
    ):
        for row in interfaces.rows():
            name = {'relative_state': ODOMETRY}.get(row.name, f'/{row.name}')
            topic = bag.add_connection(name, row.type, typestore=store)
            profile = qos.LATCHED_QUEUE if row.qos == interfaces.LATCHED else qos.RECORDING
            inner.user.create_subscription(
                message_class(row.type), name, partial(write, bag, topic), profile, raw=True
            )
        inner.start(ControllerNode({}))
        inner.start(DisturbanceInjectorNode({}))
        path = lasting(2.0, tmp_path, 'quick')
        options = {'scenario': path, 'wait_for_recorder': False, 'real_time_factor': 4.0}
        plant = inner.start(PlantNode(options))
        inner.until(lambda: plant.done)
    found = verify(tmp_path / 'bag')
    assert found.exit_code == ExitCode.OK, found.sentence()
    assert found.ticks == 21 and 'disturbance' in found.stages


def write(bag, topic, data):
    bag.write(topic, time.time_ns(), data)
