# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Messages, parameters and times that no node can take: refused in a sentence, and no node ends."""

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus
from inside import inside
from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rosgraph_msgs.msg import Clock

from rpo_core.files.scenario import load_scenario
from rpo_core.wire import interfaces
from rpo_ctrl.controller_node import ControllerNode
from rpo_ros import qos, signals
from rpo_ros.running import FlightNode
from rpo_view.listening import Latest

SCENARIO = load_scenario('paper_test')
NOT_CDR = (b'', b'\x00', b'\x00\x01\x00\x00' + b'\xff' * 40)
ODD = Parameter(name='seed', value=ParameterValue(type=99))


def test_a_parameter_of_no_type_ends_no_node_and_is_warned_of_by_powers_of_ten(ros_env, capfd):
    with inside() as inner:
        inner.start(FlightNode('bare'))
        for _ in range(6):
            asked = SetParameters.Request(parameters=[ODD])
            assert not inner.call(SetParameters, '/bare/set_parameters', asked).results
            asked = SetParametersAtomically.Request(parameters=[ODD])
            service = '/bare/set_parameters_atomically'
            assert not inner.call(SetParametersAtomically, service, asked).result.successful
        for _ in range(4):
            asked = SetParameters.Request(parameters=[ODD])
            inner.call(SetParameters, '/bare/set_parameters', asked)
    said = [line for line in capfd.readouterr().err.splitlines() if 'was refused' in line]
    assert len(said) == 3, said  # one for each service, and the tenth of the first
    assert '99 is not a valid' in said[0] and said[-1].endswith('(10 times)')


def manifest(text):
    pairs = [('role', 'plant'), ('file.scenario.yaml', text)]
    return signals.to_status(b'\x00', 'plant', 'manifest', pairs)


def test_a_manifest_that_no_plant_can_have_ends_no_node(ros_env, capfd):
    with inside() as inner:
        node = inner.start(ControllerNode({'controller': 'handmade', 'scenario': 'quick'}))
        sender = inner.user.create_publisher(
            DiagnosticStatus, interfaces.NODE_MANIFEST, qos.LATCHED
        )
        inner.until(lambda: node.count_publishers(interfaces.NODE_MANIFEST) > 1)
        inner.until(sender.get_subscription_count)
        for text in ('[', '!!python/object:x', 'x' * 200_000):
            sender.publish(manifest(text))
            inner.until(lambda: node._complaints['a message on node_manifest was refused'])
            node._complaints.clear()
        assert node.exit_code == 0 and node.scenario.name == 'quick'
    assert all(len(line) < 1000 for line in capfd.readouterr().err.splitlines())


def test_bytes_that_are_no_message_are_ignored_in_one_line(ros_env, capfd):
    with inside() as inner:
        node, heard = inner.start(FlightNode('bare')), []
        node.create_subscription(DiagnosticStatus, 'status', heard.append, qos.LATCHED_QUEUE)
        viewer = FlightNode('viewer')  # it is not spun: it looks when it wants
        newest = Latest(viewer, interfaces.row_of(interfaces.RELATIVE_STATE))
        rows = {
            'status': DiagnosticStatus,
            interfaces.RELATIVE_STATE: newest._subscription.msg_type,
        }
        senders = [inner.user.create_publisher(k, n, qos.LATCHED) for n, k in rows.items()]
        for sender in senders:
            inner.until(sender.get_subscription_count)
            for data in NOT_CDR:
                sender.publish(data)
        senders[0].publish(DiagnosticStatus(name='good'))
        inner.until(lambda: heard)
        assert [status.name for status in heard] == ['good'] and newest.take() is None
        viewer.destroy_node()
    assert len(capfd.readouterr().err.splitlines()) == 1


def test_a_negative_time_ends_no_node_with_simulated_time(ros_env, capfd):
    with inside() as inner:
        node = inner.start(FlightNode('bare', {'use_sim_time': True}))
        sender = inner.user.create_publisher(Clock, '/clock', qos.CLOCK)
        inner.until(sender.get_subscription_count)
        sender.publish(Clock(clock=Time(sec=-5)))
        inner.until(lambda: node._complaints)
        sender.publish(Clock(clock=Time(sec=7)))
        inner.until(lambda: node.get_clock().now().nanoseconds == 7_000_000_000)
    assert 'a message on /clock was refused' in capfd.readouterr().err
