# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Verify passes on true logs and names the right tick of every forgery."""

from __future__ import annotations

import os
import struct
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from log_runs import CLOCK, DISTURBANCE, FORCE, STATE, STATUS, make_run, rewrite
from mcap.records import Schema

from rpo_core.wire import cdr
from rpo_kernels.jit import COMPILED
from rpo_log.verify import evidence, verify
from rpo_mcap.errors import ExitCode, Fault, LogError
from rpo_mcap.read import stream

QUICK = settings(max_examples=16, deadline=None, derandomize=True, database=None)


@pytest.fixture(scope='module')
def log(run, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp('verify')
    run.write(folder)
    return folder / 'run.mcap'


@pytest.fixture(scope='module')
def short_log(short_run, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp('verify_short')
    short_run.write(folder)
    return folder / 'run.mcap'


def forge(log: Path, tmp_path: Path, change) -> Path:
    target = tmp_path / 'forged.mcap'
    target.unlink(missing_ok=True)
    rewrite(log, target, change)
    return target


def test_a_true_log(log):
    found = verify(log)
    assert found.exit_code == ExitCode.OK
    assert found.difference is None and found.gaps == ()
    assert found.ticks == 401
    assert 'verified, 401 ticks' in found.sentence()


def test_of_a_definition_all_but_comments_counts():
    wanted = Schema(1, b'float64 x  # of the point\nfloat64 y\n', 'ros2msg', 'a/msg/B')
    for data, same in (
        (b'float64 x\nfloat64 y # ours\n', True),
        (b'float64 y\nfloat64 x\n', False),
    ):
        assert evidence._same(Schema(1, data, 'ros2msg', 'a/msg/B'), wanted) == same


def test_a_true_log_in_blocks(log, monkeypatch):
    monkeypatch.setattr(stream, 'BLOCK_TICKS', 7)
    assert verify(log).exit_code == ExitCode.OK


@pytest.mark.parametrize('name', ['approach', 'paper_test_phase'])
def test_other_scenarios(tmp_path, name):
    topics = (STATE, FORCE) if name == 'approach' else (STATE, FORCE, DISTURBANCE)
    make_run(20.0, name, topics).write(tmp_path)
    assert verify(tmp_path).exit_code == ExitCode.OK


FLOATS = {STATE: cdr.ODOMETRY_FIELDS, FORCE: cdr.WRENCH_FIELDS, DISTURBANCE: cdr.WRENCH_FIELDS}


@QUICK
@given(
    topic=st.sampled_from(sorted(FLOATS)),
    tick=st.one_of(st.sampled_from([0, 1, 49, 50]), st.integers(0, 50)),
    place=st.floats(0.0, 1.0, exclude_max=True),
    bit=st.integers(0, 63),
)
def test_one_flipped_bit_of_any_stored_float(short_log, tmp_path_factory, topic, tick, place, bit):
    fields = FLOATS[topic]
    index = int(place * len(fields))

    def change(name, at, data):
        if (name, at) != (topic, tick):
            return data
        first = len(data) - 8 * (len(fields) - index)
        number = int.from_bytes(data[first : first + 8], 'little') ^ (1 << bit)
        return data[:first] + number.to_bytes(8, 'little') + data[first + 8 :]

    found = verify(forge(short_log, tmp_path_factory.mktemp('flip'), change))
    assert found.exit_code == ExitCode.DIFFERENT
    difference = found.difference
    assert (difference.tick, difference.topic, difference.field) == (tick, topic, fields[index])
    logged, computed = (struct.pack('<d', v) for v in (difference.logged, difference.computed))
    flipped = int.from_bytes(logged, 'little') ^ int.from_bytes(computed, 'little')
    assert flipped == 1 << bit
    assert f'tick {tick}, {topic}, {fields[index]}' in found.sentence()


def test_the_first_of_two_is_named(log, tmp_path):
    def change(name, tick, data):
        if (name, tick) in ((FORCE, 60), (STATE, 200)):
            return data[:30] + bytes([data[30] ^ 1]) + data[31:]
        return data

    difference = verify(forge(log, tmp_path, change)).difference
    assert (difference.tick, difference.topic) == (60, FORCE)


def test_a_consistent_lie_is_found_from_the_start(run, log, tmp_path):
    # Everything after tick 100 follows from a state that was nudged there: each law holds, but for
    # the one step; and with that step's state forged too, the flight no longer starts where it did.
    from rpo_core.control.controller import load_controller
    from rpo_kernels import kernels

    control, flown = load_controller('handmade'), run.flight.scenario
    state = tuple(run.flight.states[100].tolist())
    state = (state[0] + 1e-9, *state[1:])
    lies = {}
    for tick in range(100, 401):
        force = control.force_n(state[:3], state[3:])
        stamp = run.base.stamp_ns(tick)
        lies[STATE, tick] = cdr.encode_odometry(stamp, 'target_lvlh', 'chaser', state)
        lies[FORCE, tick] = cdr.encode_wrench(stamp, 'target_lvlh', force)
        disturbance = flown.disturbance.force_n(flown.time_s(tick))
        state = kernels.plant_step(state, force, disturbance, flown.max_force_n, flown.step)
    found = verify(forge(log, tmp_path, lambda n, t, d: lies.get((n, t), d)))
    assert found.difference.tick == 100
    assert found.difference.field == 'pose.pose.position.x'


def test_another_controller_is_noticed(run, tmp_path):
    other = dict(run.attachments)
    other['controller.yaml'] = other['controller.yaml'].replace(b'position_m: ', b'position_m: 1')
    assert other != run.attachments
    type(run)(run.flight, other).write(tmp_path)
    difference = verify(tmp_path).difference
    assert (difference.tick, difference.topic, difference.check) == (0, FORCE, 'controller')


def test_another_scenario_is_noticed(run, tmp_path):
    for line, topic in ((b'mass_kg: 10.0', STATE), (b'[10.0, 60.0, -40.0]', STATE),
                        (b'paper_offset', DISTURBANCE)):  # fmt: skip
        other = dict(run.attachments)
        new = {b'mass_kg: 10.0': b'mass_kg: 10.5', b'[10.0, 60.0, -40.0]': b'[10.0, 60.5, -40.0]',
               b'paper_offset': b'paper_phase'}[line]  # fmt: skip
        other['scenario.yaml'] = other['scenario.yaml'].replace(line, new)
        type(run)(run.flight, other).write(tmp_path / topic[1:], overwrite=True)
        found = verify(tmp_path / topic[1:])
        assert found.exit_code == ExitCode.DIFFERENT
        assert found.difference.topic == topic
        assert found.difference.tick == (1 if new == b'mass_kg: 10.5' else 0)


@pytest.mark.parametrize(
    ('field', 'value'),
    [('energy_n2s', '1.5'), ('distance_m', 'near'), ('speed_m_s', 'nan'), ('time_s', '39.9')],
)
def test_figures_of_run_status(run, log, tmp_path, field, value):
    figures = {**run.figures(400, 'finished'), field: value}
    lie = cdr.encode_status(0, 'run', 'finished', 'none', figures)
    found = verify(forge(log, tmp_path, lambda n, t, d: lie if (n, t) == (STATUS, 400) else d))
    difference = found.difference
    assert (difference.tick, difference.topic, difference.field) == (400, STATUS, field)
    assert difference.logged == value


def test_the_frame_and_what_lies_between_fields(log, tmp_path):
    def rename(name, tick, data):
        return data.replace(b'target_lvlh', b'target_lvlx') if (name, tick) == (FORCE, 9) else data

    difference = verify(forge(log, tmp_path, rename)).difference
    assert (difference.tick, difference.field) == (9, 'header.frame_id')

    def dirty(name, tick, data):
        return data[:40] + b'\x01' + data[41:] if (name, tick) == (STATE, 9) else data

    difference = verify(forge(log, tmp_path, dirty)).difference
    assert (difference.tick, difference.field) == (9, 'bytes between its fields')


@pytest.mark.parametrize('topic', [STATE, FORCE, DISTURBANCE, CLOCK])
def test_a_hole_is_never_verified(log, tmp_path, topic):
    found = verify(forge(log, tmp_path, lambda n, t, d: None if (n, t) == (topic, 120) else d))
    assert found.exit_code == ExitCode.INCOMPLETE
    assert f'1 messages of {topic} are missing' in found.sentence()


def test_a_lie_beyond_a_hole_is_found(log, tmp_path):
    def change(name, tick, data):
        if (name, tick) == (FORCE, 120):
            return None
        return (
            data[:30] + bytes([data[30] ^ 1]) + data[31:] if (name, tick) == (FORCE, 300) else data
        )

    found = verify(forge(log, tmp_path, change))
    assert found.exit_code == ExitCode.DIFFERENT
    assert found.difference.tick == 300


def test_a_log_cut_short_is_never_verified(log, tmp_path):
    cut = tmp_path / 'cut.mcap'
    cut.write_bytes(log.read_bytes()[:-2000])
    found = verify(cut)
    assert found.exit_code == ExitCode.INCOMPLETE
    assert 'cut short' in found.sentence() and 'verified,' not in found.sentence()


def test_a_run_that_was_aborted(run, tmp_path):
    # state 200 was sent and not answered any more
    sent = [m for m in run.messages if m[1] < 200 or m[:2] in ((CLOCK, 200), (STATE, 200))]
    figures = run.figures(200, 'aborted')
    sent.append((STATUS, 200, cdr.encode_status(2, 'run', 'no answer', 'none', figures)))
    assert run.write(tmp_path, sent).whole
    found = verify(tmp_path)
    assert found.exit_code == ExitCode.INCOMPLETE
    assert 'ends at tick 200 of 400 (aborted)' in found.sentence()


def test_a_disturbance_that_was_not_recorded(tmp_path):
    make_run(5.0, 'paper_test', (STATE, FORCE)).write(tmp_path)
    with pytest.raises(LogError, match='its scenario has a disturbance') as found:
        verify(tmp_path)
    assert found.value.fault is Fault.MISSING_TOPIC


def test_interpreted_and_compiled_agree(log):
    script = (
        f'import sys; sys.path[:0] = {sys.path!r}\n'
        f'from rpo_log.verify import verify\nprint(int(verify({str(log)!r}).exit_code))'
    )
    jit = '0' if COMPILED else ''
    done = subprocess.run(
        [sys.executable, '-c', script], capture_output=True, text=True, timeout=50,
        env={**os.environ, 'RPO_JIT': jit},
    )  # fmt: skip
    assert done.stdout.strip() == '0', done.stderr


def test_a_log_without_its_controller_verifies_all_else(short_run, tmp_path):
    """A controller of somebody else's has no file of ours: what it commands is a premise."""
    carried = {k: v for k, v in short_run.attachments.items() if k != 'controller.yaml'}
    replace(short_run, attachments=carried).write(tmp_path)
    found = verify(tmp_path)
    assert found.exit_code == ExitCode.INCOMPLETE and found.difference is None
    assert len(found.gaps) == 1 and 'no controller.yaml' in found.gaps[0]
    assert 'disturbance' in found.stages and 'controller' not in found.stages

    def push(topic, tick, data):
        if topic != FORCE or tick != 20:
            return data
        base = short_run.base
        return cdr.encode_wrench(base.stamp_ns(tick), 'target_lvlh', [0.1, 0.1, 0.1])

    forged = verify(forge(tmp_path / 'run.mcap', tmp_path, push))
    assert forged.exit_code == ExitCode.DIFFERENT and forged.difference.tick == 21
