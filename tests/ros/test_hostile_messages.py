# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Hostile messages, calls and parameters to every node of a flight: none ends, no bit changes.

ROS 2 without SROS2 knows no sender. A finite force in the right frame with the stamp of the present
tick is an answer, `deactivate` is an order of an operator, a `run_status` that says `finished` ends
a run. Everything but these valid acts of the moment is sent.
"""

from __future__ import annotations

import math
import re
import signal
from contextlib import suppress
from importlib import import_module

import pytest
from flights import assert_flown
from hostile import FIGURES, WORDS, other, spoilt
from hypothesis import given, settings
from hypothesis import strategies as st
from rclpy.parameter import parameter_value_to_python
from rclpy.serialization import deserialize_message, serialize_message
from test_guidance import STAGES, written

from rpo_core.chain.flight import fly
from rpo_core.control.controller import load_controller
from rpo_core.files.scenario import load_scenario
from rpo_core.files.validation import InputError
from rpo_core.wire import cdr, interfaces, statuses
from rpo_guidance.operator_node import OperatorNode
from rpo_ros import qos
from rpo_ros.parameter_rows import tables
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


def hostile(rng, kind, words):
    """Return a hostile value for a field of a simple type."""
    if kind.startswith('string'):
        return rng.choice((*words, *NO_TEXTS))
    if kind in ('float', 'double'):
        return rng.choice(FIGURES[:4] if kind == 'float' else FIGURES)
    if kind in ('boolean', 'byte', 'octet'):
        return rng.random() < 0.5 if kind == 'boolean' else bytes([rng.choice((0, 1, 3, 255))])
    bits = int(re.sub(r'\D', '', kind))
    low, high = (0, 2**bits - 1) if kind[0] == 'u' else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
    return rng.choice((low, high, max(low, -1), 1, rng.randint(low, high)))


def spoil(rng, message, share, words=WORDS):
    """Give a share of the fields of a message hostile values, and lists another length."""
    for name, kind in message.get_fields_and_field_types().items():
        value, chosen = getattr(message, name), rng.random() < share
        listed = re.fullmatch(r'sequence<([^,>]*).*|(.*)\[\d+\]', kind)
        item = (listed[1] or listed[2]) if listed else kind
        if '/' in item:
            package, _, name_of_item = item.rpartition('/')
            if listed and chosen:
                made = getattr(import_module(f'{package}.msg'), name_of_item)
                value = [made() for _ in range(rng.choice((0, 1, 2, 7)))]
                setattr(message, name, value)
            for inner in value if listed else [value]:
                spoil(rng, inner, share, words)
        elif chosen and listed and listed[2]:
            value[rng.randrange(len(value))] = hostile(rng, item, words)
        elif chosen:
            found = hostile(rng, item, words)
            setattr(message, name, [found] * rng.choice((0, 1, 7, 300)) if listed else found)
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
        texts = {statuses.TICK: [str(tick)], statuses.NUMBER: ['0.5'], statuses.FIGURE: ['0.5']}
        texts[statuses.NAMES] = [row.name for row in interfaces.rows()]
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
        if row.type == interfaces.ARRAY_TYPE:
            _, found = cdr.decode_array(data)
            return any(dict(status.values).get('state') in STATES for status in found)
        if row.name not in statuses.READERS:
            return False
        said = statuses.READERS[row.name].of(cdr.decode_status(data))
    except (cdr.CdrError, InputError):
        return False
    return getattr(said, 'state', '') != statuses.REFUSED  # in flight, a refusal is none


def is_order(name, request, rows):
    """Return whether a call is a valid order; rows : parameters of the node, by name."""
    last = name.rpartition('/')[2]
    if last == 'change_state':
        asked = request.transition
        return asked.label in ('deactivate', 'shutdown') if asked.label else asked.id in (4, 7)
    if not last.startswith('set_parameters'):
        return last in ORDERS or (last == 'pause' and request.data)
    for parameter in request.parameters:
        row = rows.get(parameter.name)
        with suppress(
            InputError, RuntimeError
        ):  # a value that it may not have, a type that is none
            if row is not None and row.changeable:
                row.check(parameter_value_to_python(parameter.value))
                return True
    return False


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
        packages = 'rpo_sim', 'rpo_ctrl', 'rpo_nav', 'rpo_guidance', 'rpo_safety', 'rpo_log'
        self.parameters = {name: rows for p in packages for name, rows in tables(p).items()}

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
        rows = {row.name: row for row in self.parameters.get(name.split('/')[-2], ())}
        words = (*rows, 'use_sim_time', *WORDS)
        data = as_bytes(spoil(rng, kind.Request(), rng.choice((0.3, 0.6, 1.0)), words))
        request = deserialize_message(data, kind.Request)
        if not is_order(name, request, rows):
            self.inner.call(kind, name, request)


@pytest.mark.every_landing
def test_a_flight_endures_hostile_messages_calls_and_parameters(ros, inner, tmp_path, capfd):
    """Each example is sent at another tick of one flight, to nodes that live on."""
    path = tmp_path / 'whole.yaml'
    written(path)
    path.write_text(re.sub('disturbance: .*', 'disturbance: paper_offset', path.read_text()))
    views = [ros.node('rpo_view', 'visualizer'), ros.node('rpo_view', 'web', port=0)]
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
    assert inner.ends() in (0, 1)  # 1: it says that messages contradict each other
    assert_flown(tmp_path / 'run', fly(load_scenario(path), load_controller('handmade')))
    said = capfd.readouterr().err
    assert said.count('\n') < 200 * len(inner.nodes)
    for view in views:
        assert view.stop(signal.SIGINT) == 0, view.output
        said += view.output
    assert 'Traceback' not in said, said
