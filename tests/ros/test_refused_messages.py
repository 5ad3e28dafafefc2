# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Messages, parameters and times that no node can take: refused in a sentence, and no node ends."""

from builtin_interfaces.msg import Time
from inside import inside
from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rosgraph_msgs.msg import Clock

from rpo_ros import qos
from rpo_ros.running import FlightNode

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
