# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What is recorded: manifests that are late or none, odd names, remaps; a switch, a lost peer."""

import time
from functools import partial

import numpy as np
import pytest
import yaml
from diagnostic_msgs.msg import DiagnosticStatus
from flights import lasting, told, verified
from hypothesis import assume, given
from hypothesis import strategies as st
from inside import inside
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from rosgraph_msgs.msg import Clock

import rpo_log.recorder_node
from rpo_core.wire import interfaces
from rpo_core.wire.interfaces import EXERTED_FORCE, EXERTED_TORQUE
from rpo_ctrl.navigation_node import NavigationNode
from rpo_log.format.run import TOPICS
from rpo_log.read.run_log import flight_of, read_run
from rpo_log.tools.diff import inspect
from rpo_log.verify import ExitCode, verify
from rpo_ros import health, qos
from rpo_ros.signals import message_class
from rpo_sim.disturbance_injector_node import DisturbanceInjectorNode

LATE = 'late_manifest'
ASIDE = ['-r', f'fuzzy_controller:{interfaces.NODE_MANIFEST}:={LATE}']
"""The controller's manifest goes elsewhere, from where the test may pass it on."""
ODOMETRY = '/truth/odometry'


@pytest.fixture
def scenario(tmp_path):
    """Two seconds of `approach`."""
    return lasting(2.0, tmp_path)


def test_a_late_manifest_is_waited_for_however_much_is_heard_before(ros_env, tmp_path, scenario):
    with inside(ASIDE) as inner:
        held = []
        inner.user.create_subscription(DiagnosticStatus, LATE, held.append, qos.LATCHED)
        onward = inner.user.create_publisher(
            DiagnosticStatus, interfaces.NODE_MANIFEST, qos.LATCHED
        )
        clock = inner.user.create_publisher(Clock, '/clock', qos.LOCKSTEP)
        inner.fly(tmp_path / 'run', scenario)
        inner.until(lambda: held and clock.get_subscription_count())
        for _ in range(500):
            clock.publish(Clock())
            inner.executor.spin_once(timeout_sec=0.0)
        inner.until(lambda: inner.recorder._health()[2]['backlog'] > 450)
        after = time.monotonic() + 0.2
        inner.until(lambda: time.monotonic() > after)
        assert inner.recorder.log is None
        onward.publish(held[0])
        assert inner.ends() == 0
    assert set(read_run(tmp_path / 'run').attachments) == {
        'controller.yaml', 'parameters.yaml', 'scenario.yaml',
    }  # fmt: skip


def test_a_controller_without_a_manifest_is_recorded_in_the_end(
    ros_env, tmp_path, scenario, monkeypatch
):
    monkeypatch.setattr(rpo_log.recorder_node, 'MANIFEST_PATIENCE_S', 0.2)
    with inside(ASIDE) as inner:
        inner.fly(tmp_path / 'run', scenario)
        inner.ends()
    log = read_run(tmp_path / 'run')
    assert len(log.ticks) == 21
    assert set(log.attachments) == {'parameters.yaml', 'scenario.yaml'}


@given(st.text() | st.sampled_from(['2026-02-30', '2026-01-01', '1e3', 'yes', '0x10', 'null']))
def test_a_name_is_read_back_as_what_it_was(name):
    assume(name.isprintable())
    assert yaml.safe_load(health.as_yaml(name)) == name


def test_plain_names_stay_plain():
    assert [health.as_yaml(v) for v in ('paper_test', 2, True)] == ['paper_test', '2', 'True']


# Topics that a user has remapped: recorded where they are, or named as a gap.


def fly(folder, scenario, *remaps):
    """Fly for two seconds with a recorder that nobody told of the remaps; return its folder."""
    with inside([part for rule in remaps for part in ('-r', rule)]) as inner:
        path = lasting(2.0, folder, scenario)
        inner.fly(folder / 'run', path, NavigationNode, controller='allround')
        assert (inner.ends(), inner.plant.exit_code) == (0, 0)
    return folder / 'run'


@pytest.mark.parametrize(
    ('topic', 'name'), [('relative_state', ODOMETRY), ('control_force', '/cmd/force')]
)
def test_a_remapped_topic_is_flown_and_recorded_where_it_is(ros_env, tmp_path, topic, name):
    """The plant looked for the publisher of an answer under the name before, for ever."""
    nodes = ('plant', 'fuzzy_controller')
    run = fly(tmp_path, 'approach', *(f'{node}:{topic}:={name}' for node in nodes))
    found = verify(run)
    assert found.exit_code == ExitCode.OK, found.sentence()
    usual = {signal: f'/{signal}' for signal in ('relative_state', 'control_force')}
    topics = {topic.signal: topic.name for topic in inspect(run).messages}
    assert topics.items() >= {**usual, topic: name}.items()


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
        path = lasting(2.0, tmp_path, 'quick')
        options = {'wait_for_recorder': False, 'real_time_factor': 4.0}
        inner.fly(tmp_path / 'run', path, DisturbanceInjectorNode, **options)
        inner.until(lambda: inner.plant.done)
    found = verify(tmp_path / 'bag')
    assert found.exit_code == ExitCode.OK, found.sentence()
    assert found.ticks == 21 and 'disturbance' in found.stages


def write(bag, topic, data):
    bag.write(topic, time.time_ns(), data)


def start(inner, folder, duration_s, **options):
    """Start a run, and wait until it has begun."""
    path = lasting(duration_s, folder, 'paper_test')
    inner.fly(folder / 'run', path, DisturbanceInjectorNode, real_time_factor=40.0, **options)
    inner.until(lambda: inner.recorder.log is not None and inner.recorder.log.next_tick > 20)


@pytest.mark.every_landing
@pytest.mark.parametrize('lost', [0, 1], ids=['controller', 'disturbance'])
def test_a_plant_that_goes_on_without_a_peer(inner, tmp_path, lost):
    start(inner, tmp_path, 30.0, on_peer_timeout='coast', peer_timeout_s=0.5)
    inner.executor.remove_node(inner.nodes[lost])  # it hears and says nothing more
    assert inner.ends() == 0
    log = verified(tmp_path / 'run')
    assert log.complete and log.outcome == 'finished'
    name = ('/control_force', '/disturbance_force')[lost]
    assert name in {topic.name for topic in log.topics}


# A thruster of a table.

TABLE = {'preset': 'quads_16', 'force_n': 0.25, 'minimum_impulse_bit_n_s': 0.002}


def test_a_thruster_is_switched_in_flight(inner, tmp_path):
    path = lasting(30.0, tmp_path, thrusters={'table': TABLE})
    options = {'real_time_factor': 20.0, 'thruster': 'x-a off'}
    inner.fly(tmp_path / 'run', path, controller='allround', **options)
    inner.reaches(20)
    refused, reason = inner.set('/plant', thruster='x+q off')
    assert not refused and 'must be one of x+a' in reason
    assert inner.set('/plant', thruster='y-a on')[0]
    inner.reaches(inner.plant.tick + 50)
    assert inner.set('/plant', thruster='y-a ready')[0]
    assert inner.ends() == 0
    log = verified(tmp_path / 'run')
    _, states, ticks = zip(*told(log), strict=True)
    assert states == ('x-a off', 'y-a on', 'y-a ready')
    assert 0 == ticks[0] < ticks[1] < ticks[2]
    flight = flight_of(log)
    np.testing.assert_array_equal(flight.thrust.forces_n, log.values[EXERTED_FORCE][:-1])
    assert np.abs(log.values[EXERTED_TORQUE]).max() > 0.0
