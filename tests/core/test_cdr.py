# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Our CDR against three other implementations: rosbags, mcap_ros2 and the middleware's own."""

from __future__ import annotations

import struct
from functools import partial

import messages
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory
from rosbags.typesys import Stores, get_typestore

from rpo_core.wire import cdr, interfaces
from rpo_core.wire.cdr import Layout
from rpo_log.format import rosbag2

STORE = get_typestore(Stores.ROS2_JAZZY)
ODOMETRY, WRENCH = interfaces.STATE_TYPE, interfaces.FORCE_TYPE
CLOCK, STATUS = interfaces.CLOCK_TYPE, interfaces.STATUS_TYPE

QUICK = settings(max_examples=30, deadline=None, derandomize=True, database=None)
stamps = st.integers(0, 2**31 * 10**9 - 1)
words = st.text(st.characters(exclude_characters='\0', exclude_categories=['Cs']), max_size=40)
# every bit pattern, so that infinities, subnormals, negative zeros and NaNs are among them
floats = st.integers(0, 2**64 - 1).map(lambda n: struct.unpack('<d', struct.pack('<Q', n))[0])


def message(type_name: str, /, **fields):
    return STORE.types[type_name](**fields)


def header(stamp_ns: int, frame: str):
    stamp = message('builtin_interfaces/msg/Time', sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
    return message('std_msgs/msg/Header', stamp=stamp, frame_id=frame)


def vector(x: float, y: float, z: float):
    return message('geometry_msgs/msg/Vector3', x=x, y=y, z=z)


def by_rosbags(msg) -> bytes:
    return bytes(STORE.serialize_cdr(msg, msg.__msgtype__))


def same_bits(a, b) -> bool:
    return struct.pack(f'<{len(a)}d', *a) == struct.pack(f'<{len(b)}d', *b)


def odometry(stamp_ns: int, frame: str, child: str, state):
    point = message('geometry_msgs/msg/Point', x=state[0], y=state[1], z=state[2])
    still = message('geometry_msgs/msg/Quaternion', x=0.0, y=0.0, z=0.0, w=1.0)
    pose = message('geometry_msgs/msg/Pose', position=point, orientation=still)
    twist = message(
        'geometry_msgs/msg/Twist', linear=vector(*state[3:]), angular=vector(0.0, 0.0, 0.0)
    )
    return message(
        ODOMETRY,
        header=header(stamp_ns, frame),
        child_frame_id=child,
        pose=message('geometry_msgs/msg/PoseWithCovariance', pose=pose, covariance=np.zeros(36)),
        twist=message(
            'geometry_msgs/msg/TwistWithCovariance', twist=twist, covariance=np.zeros(36)
        ),
    )


STATE = interfaces.row_of(interfaces.RELATIVE_STATE).columns


@QUICK
@given(stamps, words, words, st.lists(floats, min_size=6, max_size=6))
def test_odometry_as_rosbags_writes_it(stamp_ns, frame, child, state):
    data = messages.odometry(stamp_ns, frame, child, state)
    assert data == by_rosbags(odometry(stamp_ns, frame, child, state))
    layout = Layout.of(ODOMETRY, (frame, child), STATE)
    assert layout.encode(stamp_ns, state) == data
    stamp, values, right_frame = layout.decode(data)
    assert (stamp, right_frame) == (stamp_ns, True) and same_bits(values, state)
    assert not Layout.of(ODOMETRY, (frame + '_', child), STATE).decode(data)[2]
    either = Layout.of(ODOMETRY, (frame, child), STATE, also=frame + '_')
    told = Layout.of(ODOMETRY, (frame + '_', child), STATE).encode(stamp_ns, state)
    assert either.like(told) is either.also and either.knows(told) and either.knows(data)
    back = cdr.decode_stamped(ODOMETRY, data)
    assert (back.stamp_ns, back.texts) == (stamp_ns, (frame, child))
    named = dict(zip(cdr.ODOMETRY_FIELDS, back.floats, strict=True))
    parts = ('pose.pose.position', 'twist.twist.linear')
    assert same_bits([named[f'{part}.{axis}'] for part in parts for axis in 'xyz'], state)
    assert data[-8 * len(back.floats) :][:24] == struct.pack('<3d', *state[:3])


@QUICK
@given(stamps, words, st.lists(floats, min_size=3, max_size=3))
def test_wrench_as_rosbags_writes_it(stamp_ns, frame, force):
    data = messages.wrench(stamp_ns, frame, force)
    wrench = message('geometry_msgs/msg/Wrench', force=vector(*force), torque=vector(0.0, 0.0, 0.0))
    other = message(WRENCH, header=header(stamp_ns, frame), wrench=wrench)
    assert data == by_rosbags(other)
    back = cdr.decode_stamped(WRENCH, data)
    assert (back.stamp_ns, back.texts) == (stamp_ns, (frame,))
    assert same_bits(back.floats[:3], force)
    assert cdr.stamp_ns(data) == stamp_ns


@QUICK
@given(stamps)
def test_clock_as_rosbags_writes_it(stamp_ns):
    data = cdr.encode_clock(stamp_ns)
    assert data == by_rosbags(message(CLOCK, clock=header(stamp_ns, '').stamp))
    assert cdr.decode_stamped(CLOCK, data) == (stamp_ns, (), ())


@QUICK
@given(st.integers(0, 3), words, words, words, st.lists(st.tuples(words, words), max_size=4))
def test_status_as_rosbags_writes_it(level, name, text, hardware, values):
    data = cdr.encode_status(level, name, text, hardware, values)
    pairs = [message('diagnostic_msgs/msg/KeyValue', key=k, value=v) for k, v in values]
    other = message(
        STATUS, level=level, name=name, message=text, hardware_id=hardware, values=pairs
    )
    assert data == by_rosbags(other)
    assert cdr.decode_status(data) == (level, name, text, hardware, tuple(values))


@QUICK
@given(st.lists(floats, min_size=6, max_size=6))
def test_mcap_ros2_reads_the_same_bits(state):
    definition = rosbag2.definition(ODOMETRY)
    schema = Schema(1, definition.text.encode(), 'ros2msg', ODOMETRY)
    decode = DecoderFactory().decoder_for('cdr', schema)
    read = decode(messages.odometry(7, 'target_lvlh', 'chaser', state))
    position, velocity = read.pose.pose.position, read.twist.twist.linear
    found = [position.x, position.y, position.z, velocity.x, velocity.y, velocity.z]
    assert same_bits(found, state)
    assert read.pose.pose.orientation.w == 1.0


def test_as_the_middleware_writes_it():
    from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
    from geometry_msgs.msg import WrenchStamped
    from nav_msgs.msg import Odometry
    from rclpy.serialization import serialize_message

    state = Odometry(child_frame_id='chaser')
    state.header.stamp.sec, state.header.frame_id = 12, 'target_lvlh'
    state.pose.pose.position.y, state.twist.twist.linear.z = -0.0, 5e-324
    values = [0.0, -0.0, 0.0, 0.0, 0.0, 5e-324]
    ours = messages.odometry(12 * 10**9, 'target_lvlh', 'chaser', values)
    assert cdr.canonical(ODOMETRY, serialize_message(state)) == ours
    force = WrenchStamped()
    force.wrench.force.x = 0.25
    ours = messages.wrench(0, '', [0.25, 0.0, 0.0])
    assert cdr.canonical(WRENCH, serialize_message(force)) == ours
    said = DiagnosticStatus(level=b'\x01', name='a', values=[KeyValue(key='k', value='värde')])
    ours = cdr.encode_status(1, 'a', '', '', {'k': 'värde'})
    assert cdr.canonical(STATUS, serialize_message(said)) == ours


def gaps(type_name: str, data: bytes) -> list[int]:
    """Offsets between fields, found by turning each byte and asking rosbags if it can tell."""
    plain = repr(STORE.deserialize_cdr(data, type_name))
    found = []
    for at in range(4, len(data)):
        turned = data[:at] + bytes([data[at] ^ 0x55]) + data[at + 1 :]
        try:
            same = repr(STORE.deserialize_cdr(turned, type_name)) == plain
        except Exception:  # any complaint of the other library says that the byte matters
            same = False
        if same:
            found.append(at)
    return found


@pytest.mark.parametrize(
    ('type_name', 'data'),
    [
        (ODOMETRY, messages.odometry(5, 'target_lvlh', 'chaser', [1.0] * 6)),
        (WRENCH, messages.wrench(5, 'lvlh', [1.0] * 3)),
        (STATUS, cdr.encode_status(2, 'abc', 'de', 'f', {'k': 'value', '': 'x'})),
    ],
    ids=['odometry', 'wrench', 'status'],
)
def test_canonical_clears_what_no_field_holds(type_name, data):
    found = gaps(type_name, data)
    assert found  # each of the messages has gaps
    dirty = bytearray(data)
    for at in found:
        dirty[at] = 0xAA
    assert cdr.canonical(type_name, bytes(dirty)) == data
    assert cdr.canonical(type_name, data) == data


DECODERS = {
    ODOMETRY: partial(cdr.decode_stamped, ODOMETRY),
    WRENCH: partial(cdr.decode_stamped, WRENCH),
    CLOCK: partial(cdr.decode_stamped, CLOCK),
    STATUS: cdr.decode_status,
}


@pytest.mark.parametrize('type_name', DECODERS)
@settings(QUICK, max_examples=60)
@given(st.data())
def test_other_bytes_are_refused_in_words(type_name, data):
    whole = {
        ODOMETRY: messages.odometry(5, 'target_lvlh', 'chaser', [1.0] * 6),
        WRENCH: messages.wrench(5, 'abc', [1.0] * 3),
        CLOCK: cdr.encode_clock(5),
        STATUS: cdr.encode_status(2, 'abc', 'de', 'f', {'k': 'v'}),
    }[type_name]
    garbage = data.draw(
        st.one_of(
            st.binary(max_size=120),
            st.integers(0, len(whole) - 1).map(lambda n: whole[:n]),
            st.binary(max_size=60).map(lambda tail: whole[:16] + tail),
        )
    )
    for read in (DECODERS[type_name], lambda raw: cdr.canonical(type_name, raw)):
        try:
            read(garbage)
        except cdr.CdrError as error:
            assert str(error).startswith('must ')


def test_big_endian_is_refused():
    with pytest.raises(cdr.CdrError, match='little-endian'):
        cdr.decode_stamped(CLOCK, b'\x00\x00\x00\x00' + bytes(8))


def test_why_a_message_cannot_be_used():
    layout = interfaces.row_of(interfaces.CONTROL_FORCE).layout
    stamp, right = 3 * 10**9 + 999_999_999, interfaces.row_of(interfaces.CONTROL_FORCE).frames[0]
    data = bytearray(messages.wrench(stamp, right, [1.0, 2.0, 3.0]))
    assert layout.use(bytes(data)) == ('', stamp, (1.0, 2.0, 3.0))
    assert layout.use(bytes(data[:-1])) == ('malformed', 0, ())
    struct.pack_into('<I', data, cdr.STAMP_AT + 4, 10**9)  # four seconds, written another way
    assert layout.use(bytes(data)) == ('malformed', 4 * 10**9, (1.0, 2.0, 3.0))
    elsewhere = messages.wrench(stamp, 'elsewhere', [1.0, 2.0, 3.0])
    assert layout.use(elsewhere) == ('wrong_frame', stamp, (1.0, 2.0, 3.0))
    for force, why in (
        ([1.0, np.nan, 3.0], 'not_finite'),
        ([np.inf, 0.0, -np.inf], 'not_finite'),
        ([1e308, 1e308, 0.0], ''),
    ):
        assert layout.use(messages.wrench(stamp, right, force))[0] == why


@pytest.mark.parametrize(
    ('at', 'wrong', 'said'),
    [
        (13, b'\xff', 'must hold UTF-8 text at 12'),
        (15, b'x', 'must hold a string of 4 bytes at 12, the last one 0'),
        (32, b'\xff\xff\xff', 'must hold 16777215 elements; got 50 bytes'),
    ],
)
def test_a_damaged_status_is_refused_with_its_place(at, wrong, said):
    data = cdr.encode_status(2, 'abc', 'de', 'f', {'k': 'v'})
    assert cdr.decode_status(data).values == (('k', 'v'),)
    with pytest.raises(cdr.CdrError, match=said):
        cdr.decode_status(data[:at] + wrong + data[at + len(wrong) :])
    with pytest.raises(cdr.CdrError, match='must hold a level; got no more bytes'):
        cdr.decode_status(data[:4])
