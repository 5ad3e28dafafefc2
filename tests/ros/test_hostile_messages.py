# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Hostile messages, calls and parameters to every node of a flight: none ends, no bit changes.

ROS 2 without SROS2 knows no sender. A finite force in the right frame with the stamp of the present
tick is an answer, `deactivate` is an order of an operator, a `run_status` that says `finished` ends
a run. Everything but these valid acts of the moment is sent. What no node can take is refused in a
sentence.
"""

from __future__ import annotations

import math
import re
import signal
from contextlib import suppress
from importlib import import_module

import pytest
from builtin_interfaces.msg import Time
from flights import assert_flown
from hostile import WORDS, other, spoilt
from hypothesis import given, settings
from hypothesis import strategies as st
from inside import inside
from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.serialization import deserialize_message, serialize_message
from rosgraph_msgs.msg import Clock
from test_guidance import STAGES, written

from rpo_core.chain.flight import fly
from rpo_core.control.controller import load_controller
from rpo_core.files.validation import InputError
from rpo_core.scenario.scenario import load_scenario
from rpo_core.wire import cdr, interfaces, statuses
from rpo_ctrl.operator_node import OperatorNode
from rpo_ros import qos
from rpo_ros.parameter_rows import tables
from rpo_ros.running import FlightNode
from rpo_ros.signals import message_class
from rpo_sim.disturbance_injector_node import DisturbanceInjectorNode

NO_TEXTS = {'@0@@': b'\xff\xfe\xc3\x28', '@1@@': b'\xed\xa0\x80a', '@2@@': b'a\x00b\x00'}
"""Words that become, in the bytes, what is no UTF-8 or ends early."""
STAMPS = 0, 0, 1, -1, -5, 5000, 10**6, 10**10, -(10**6), -(10**11)
"""Hostile stamps, in ticks from the present one."""
FAR_TICKS = 200
"""A message for a tick so far ahead is no answer."""
ORDERS = 'reset', 'abort', 'go', 'hold', 'retreat', 'drift', 'resume', 'arm', 'inhibit', 'step'
"""Services whose every call is an order."""
STATES = 'unconfigured', 'inactive', 'active', 'finalized'
"""States of the lifecycle, in the health of a controller."""
CASES = 200


def spoil(rng, message, share, words=WORDS):
    """Give a share of the fields of a message other values, and lists another length."""
    for name, kind in message.get_fields_and_field_types().items():
        value = getattr(message, name)
        listed = re.fullmatch(r'sequence<(.+)/(\w+)(?:, \d+)?>', kind)
        if listed and not value:
            value = [getattr(import_module(f'{listed[1]}.msg'), listed[2])()]
            setattr(message, name, value)
        for inner in value if listed else [value]:
            if hasattr(inner, 'get_fields_and_field_types'):
                spoil(rng, inner, share, words)
        if rng.random() < share:
            wrong = list(value) if kind.startswith('sequence') else value
            wrong = rng.choice(words) if kind == 'string' else other(rng, wrong)
            with suppress(AssertionError):  # a type or length that the message cannot have
                setattr(message, name, wrong)
    return message


def as_bytes(message):
    """Return a message as CDR, with texts that are no texts."""
    data = serialize_message(message)
    for word, bad in NO_TEXTS.items():
        data = data.replace(word.encode(), bad)
    return data


def status_with_one_wrong(rng, topic, tick):
    """Return a status of a topic of `statuses.READERS`: whole, but for one field."""
    contract, values = statuses.READERS[topic].contract, {}
    for key in contract.keys:
        words = re.findall('`(.+?)`', key.kind.words) or ['active', 'plant', '0' * 32]
        of_kind = {'tick': [str(tick)], 'number': ['0.5'], 'figure': ['0.5']}
        of_kind['names'] = [row.name for row in interfaces.rows()]
        texts = {statuses.KINDS[kind]: words for kind, words in of_kind.items()}
        if '<' not in key.name and (key.needed or rng.random() < 0.5):
            values[key.name] = rng.choice(texts.get(key.kind, words))
    head = {'name': 'guidance', 'message': 'so', 'hardware_id': 'none'}
    head |= {field: rng.choice(allowed) for field, allowed in contract.fields.items()}
    level = statuses.LEVELS.get(values.get('phase', ''), (0,))[0]
    pairs = list(values.items())
    way = rng.choice(('value', 'value', 'twice', 'head', 'level'))
    if way == 'value':
        pairs = [(key, str(value)) for key, value in other(rng, values).items()]
    elif way == 'twice':
        pairs.append((rng.choice(pairs)[0], rng.choice(WORDS)))
    elif way == 'head':
        head[rng.choice(sorted(head))] = rng.choice(WORDS)
    return cdr.encode_status(3 if way == 'level' else level, *head.values(), pairs)


def message(rng, row, plant):
    """Return a hostile message for a topic, as CDR."""
    made, tick = message_class(row.type)(), plant.tick
    if row.columns and rng.random() < 0.4:  # an answer of the moment, but for a number or its frame
        values = [0.1] * len(row.columns)
        values[rng.randrange(len(values))] = rng.choice((math.nan, math.inf, 0.2))
        data = row.layout.encode(plant.scenario.stamp_ns(tick), values)
        return data.replace(b'target_lvlh', b'chaser_lvlh') if 0.2 in values else data
    if row.name in statuses.READERS and rng.random() < 0.6:
        return status_with_one_wrong(rng, row.name, tick)
    if hasattr(made, 'header'):
        made.header.frame_id = rng.choice(('target_lvlh', 'chaser', 'map'))
        stamp_ns = plant.scenario.stamp_ns(tick + rng.choice(STAMPS))
        seconds, made.header.stamp.nanosec = divmod(stamp_ns, 10**9)
        made.header.stamp.sec = max(-(2**31), min(seconds, 2**31 - 1))
    data = as_bytes(spoil(rng, made, rng.choice((0.0, 0.05, 0.3, 1.0))))
    return spoilt(rng, data) if rng.random() < 0.4 else data


def is_act(row, data, plant):
    """Return whether a message is a valid act while the flight is at its tick or a little later."""
    data += bytes(-len(data) % 4)  # the middleware sends words of four bytes
    try:
        if row.columns:
            stamp_ns, values, right_frame = row.layout.decode(data)
            tick = plant.scenario.tick_of(stamp_ns)  # an estimator reads the one before
            due = tick is not None and plant.tick - 1 <= tick < plant.tick + FAR_TICKS
            return due and right_frame and all(map(math.isfinite, values))
        if row.name == interfaces.DIAGNOSTICS:
            return any(state.encode() + b'\0' in data for state in STATES)
        if row.name not in statuses.READERS:
            return False
        said = statuses.READERS[row.name].of(cdr.decode_status(data))
    except (cdr.CdrError, InputError):
        return False
    return getattr(said, 'state', '') != statuses.REFUSED  # in flight, a refusal is none


def is_order(name, request, fixed):
    """Return whether a call may be a valid order; fixed : parameters that no call may set."""
    last = name.rpartition('/')[2]
    if last.startswith('set_parameters'):
        return any(one.name not in fixed for one in request.parameters)
    if last == 'change_state':
        asked = request.transition
        return asked.label in ('deactivate', 'shutdown') if asked.label else asked.id in (4, 7)
    return last in ORDERS or (last == 'pause' and request.data)


class Hostile:
    """A user beside the nodes of a flight who sends what nobody should."""

    def __init__(self, inner):
        self.inner, self.plant, self.rows = inner, inner.plant, interfaces.rows()
        self.out = {
            row: inner.user.create_publisher(message_class(row.type), row.topic, qos.of(row.qos))
            for row in self.rows
        }
        found = sorted(inner.user.get_service_names_and_types())
        self.services = [
            (name, *kinds[0].split('/')) for name, kinds in found if '/user/' not in name
        ]
        self.fixed = {
            node: [row.name for row in rows if not row.changeable]
            for package in (
                'rpo_sim',
                'rpo_ctrl',
                'rpo_log',
            )
            for node, rows in tables(package).items()
        }

    def send(self, rng):
        """Send a message that is no act, before the nodes answer the plant."""
        self.inner.reaches(self.plant.tick)
        row = rng.choice(self.rows)
        data = message(rng, row, self.plant)
        if not is_act(row, data, self.plant):
            with suppress(RuntimeError):  # longer than any message of its type: it is not sent
                self.out[row].publish(data)

    def call(self, rng):
        """Call a service with what is no order; it must answer."""
        name, package, _, kind = rng.choice(self.services)
        kind = getattr(import_module(f'{package}.srv'), kind)
        fixed = (*self.fixed.get(name.split('/')[-2], ()), 'nobody', '')
        words = fixed if 'set_parameters' in name else WORDS
        data = as_bytes(spoil(rng, kind.Request(), rng.choice((0.3, 0.6, 1.0)), words))
        request = deserialize_message(data, kind.Request)
        if not is_order(name, request, fixed):
            self.inner.call(kind, name, request)


@pytest.mark.every_landing
def test_a_flight_endures_hostile_messages_calls_and_parameters(ros, inner, tmp_path, capfd):
    """Each example is sent at another tick of one flight, to nodes that live on."""
    path = tmp_path / 'whole.yaml'
    written(path)
    path.write_text(re.sub('disturbance: .*', 'disturbance: paper_offset', path.read_text()))
    views = [ros.node('rpo_bringup', 'visualizer'), ros.node('rpo_bringup', 'web', port=0)]
    inner.start(OperatorNode({'phase': 'never'}))
    others = (*STAGES, DisturbanceInjectorNode)
    inner.fly(tmp_path / 'run', str(path), *others, real_time_factor=4.0)
    inner.reaches(1)
    user = Hostile(inner)

    @settings(max_examples=CASES)
    @given(rng=st.randoms(use_true_random=False), calls=st.sampled_from((False, False, True)))
    def endure(rng, calls):
        (user.call if calls else user.send)(rng)
        assert all(node.exit_code == 0 for node in inner.nodes)
        assert inner.plant.phase == 'running'

    endure()
    inner.set('plant', real_time_factor=0.0)
    assert inner.ends() in (0, 1)  # 1: it says that messages differ
    assert_flown(tmp_path / 'run', fly(load_scenario(path), load_controller('handmade')))
    said = capfd.readouterr().err
    assert said.count('\n') < 200 * len(inner.nodes)
    for view in views:
        assert view.stop(signal.SIGINT) == 0, view.output
        said += view.output
    assert 'Traceback' not in said, said


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
        sender = inner.user.create_publisher(Clock, '/clock', qos.LOCKSTEP)
        inner.until(sender.get_subscription_count)
        sender.publish(Clock(clock=Time(sec=-5)))
        inner.until(lambda: node._complaints)
        sender.publish(Clock(clock=Time(sec=7)))
        inner.until(lambda: node.get_clock().now().nanoseconds == 7_000_000_000)
    assert 'a message on /clock was refused' in capfd.readouterr().err
