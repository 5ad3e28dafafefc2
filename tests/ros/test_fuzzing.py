# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The bench of hostile messages: what it sends, what it must not send, and flights under it."""

from random import Random

import pytest
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus
from inside import inside
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.serialization import deserialize_message, serialize_message
from rosgraph_msgs.msg import Clock
from std_srvs.srv import SetBool

from rpo_core.files.scenario import load_scenario
from rpo_core.files.validation import InputError
from rpo_core.wire import cdr, interfaces, statuses
from rpo_ctrl.controller_node import ControllerNode
from rpo_ros import conversions, names, qos
from rpo_ros.parameter_rows import tables
from rpo_ros.running import FlightNode
from rpo_ros.signals import message_class
from rpo_view.listening import Latest
from tools.trials import messages
from tools.trials.fuzz import LOOP

SCENARIO = load_scenario('paper_test')
NOT_CDR = (b'', b'\x00', b'\x00\x01\x00\x00' + b'\xff' * 40)
ODD = Parameter(name='seed', value=ParameterValue(type=99))


@pytest.mark.parametrize('row', interfaces.rows(), ids=lambda row: row.name)
def test_every_row_of_the_table_has_hostile_messages_the_same_for_the_same_seed(row):
    kind = message_class(row.type)
    plain = messages.Encoder(Random(1), 0.0).encode(kind())
    assert deserialize_message(plain, kind) == kind()
    for how in messages.KINDS:
        made = [[messages.spoilt(kind(), how, Random(f'{i}')) for i in range(9)] for _ in '12']
        assert made[0] == made[1]
        assert any(messages.spoilt(kind(), how, Random(f'{i}')) != plain for i in range(30)), how


@pytest.mark.parametrize('kind', [SetParameters, ChangeState, SetBool])
def test_a_request_is_one_of_its_type(kind):
    for i in range(50):
        data = messages.Encoder(Random(i), 0.5).encode(kind.Request())
        serialize_message(deserialize_message(data, kind.Request))


def force(tick, frame='target_lvlh', x=0.1):
    stamp_ns = SCENARIO.epoch_ns + tick * SCENARIO.dt_ns
    return cdr.encode_wrench(stamp_ns, frame, (x, 0.0, 0.0))


@pytest.mark.parametrize(
    ('data', 'act'),
    [
        (force(10), True),
        (force(12), True),
        (force(9), True),  # an estimator reads it
        (force(8), False),
        (force(10 + messages.FAR_TICKS), False),
        (force(10)[:-4], False),
        (force(10, frame='chaser'), False),
        (force(10, x=float('nan')), False),
        (force(10)[:-1], True),  # the middleware fills words of four bytes with zeros
    ],
)
def test_a_valid_answer_for_the_present_is_an_act(data, act):
    row = interfaces.row_of(interfaces.CONTROL_FORCE)
    assert messages.is_act(row, data, 10, SCENARIO) == act


STAGE = {'stage': 'a', 'state': 'inactive', 'tick': '0', 'reason': 'so'}
RECORDER = {'recorder': '1', 'run': '', 'reason': ''}


@pytest.mark.parametrize(
    ('name', 'message', 'pairs', 'act'),
    [
        ('run_status', '', {'phase': 'finished', 'tick': '12'}, True),
        ('run_status', '', {'phase': 'finished', 'tick': 'x'}, False),
        ('run_status', '', {'phase': 'finished'}, False),
        ('stage_status', '', STAGE, True),
        ('stage_status', '', {**STAGE, 'state': 'refused'}, False),  # in flight, it is none
        ('stage_status', '', {'state': 'inactive'}, False),
        ('recorder_status', 'closed', RECORDER, True),
        ('recorder_status', 'shut', RECORDER, False),
        ('node_manifest', '', {'role': 'controller'}, True),
        ('node_manifest', '', {'role': 'plant', 'file.scenario.yaml': '['}, False),
    ],
)
def test_a_whole_status_of_a_peer_is_an_act(name, message, pairs, act):
    data = cdr.encode_status(0, 'run', message, 'none', pairs)
    assert messages.is_act(interfaces.row_of(name), data, 10, SCENARIO) == act


@pytest.mark.parametrize('topic', sorted(statuses.READERS))
def test_a_plausible_status_is_whole_until_one_field_is_wrong(topic):
    """The bench sends what a reader refuses: for each kind of spoiling there are such statuses."""
    reader, refused = statuses.READERS[topic], set()
    for i in range(300):
        rng = Random(i)
        whole = messages.made(topic, rng, 40)
        reader.of(whole)
        how = rng.choice(messages.STATUS_KINDS)
        try:
            reader.of(messages.spoilt_status(whole, how, rng))
        except InputError as error:
            refused.add(how)
            assert str(error).isprintable() and len(str(error)) < 600
    assert refused >= {'value', 'missing', 'twice'}


def set_to(name, **value):
    parameter = Parameter(name=name, value=ParameterValue(**value))
    return SetParameters.Request(parameters=[parameter])


def test_an_order_of_an_operator_is_an_act():
    rows = {row.name: row for row in tables('rpo_sim')['plant']}
    whole, far = {'type': 2, 'integer_value': 5}, {'type': 2, 'integer_value': -5}
    assert messages.is_order('/plant/set_parameters', set_to('step_ticks', **whole), rows)
    assert not messages.is_order('/plant/set_parameters', set_to('step_ticks', **far), rows)
    assert not messages.is_order('/plant/set_parameters', set_to('resend_after_s', **whole), rows)
    assert not messages.is_order('/plant/set_parameters', set_to('step_ticks', type=99), rows)
    asked = ChangeState.Request(transition=Transition(id=4))
    assert messages.is_order('/a/change_state', asked, {})
    asked.transition.label = 'activate'
    assert not messages.is_order('/a/change_state', asked, {})


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
    return conversions.to_status(b'\x00', 'plant', 'manifest', pairs)


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
        newest = Latest(viewer, interfaces.RELATIVE_STATE)
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
        sender = inner.user.create_publisher(Clock, names.CLOCK, qos.CLOCK)
        inner.until(sender.get_subscription_count)
        sender.publish(Clock(clock=Time(sec=-5)))
        inner.until(lambda: node._complaints)
        sender.publish(Clock(clock=Time(sec=7)))
        inner.until(lambda: node.get_clock().now().nanoseconds == 7_000_000_000)
    assert 'a message on /clock was refused' in capfd.readouterr().err


def endured(ros, *arguments, deadline_s):
    trial = ros.node('rpo_bringup', 'trial', 'fuzz', *arguments)
    assert trial.wait(deadline_s) == 0, trial.output
    assert '0 deaths, 0 flights with changed bits, 0 logs that do not verify' in trial.output


@pytest.mark.every_landing
def test_a_flight_endures_some_hundred_hostile_cases(ros):
    endured(ros, '--cases', '300', '--nodes', *LOOP, deadline_s=110.0)


@pytest.mark.slow
@pytest.mark.timeout(2700)
def test_every_node_endures_half_an_hour_of_hostile_cases(ros):
    endured(ros, '--cases', '1000000', '--minutes', '30', deadline_s=2600.0)
