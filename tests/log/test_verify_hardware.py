# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Logs of imperfect thrusters and navigation: proved across blocks, with gaps, forged."""

import struct
from dataclasses import replace

import pytest
from log_runs import DISTURBANCE, FORCE, STATE, TOPICS, Run, make_run, rewrite

from rpo_core.chain.flight import fly
from rpo_core.control.controller import load_controller
from rpo_core.files import scenario
from rpo_core.wire import cdr, interfaces
from rpo_core.world.navigation import Navigation
from rpo_core.world.thrusters import Thrusters
from rpo_log.errors import ExitCode, LogError
from rpo_log.read import stream
from rpo_log.verify import verify

NAVIGATION = '/navigation_state'
MATRIX = ((0.97, 0.02, 0.0), (-0.02, 1.04, 0.01), (0.0, -0.01, 0.99))
HARDWARE = (
    Thrusters(MATRIX, 3),
    Navigation((0.02, 0.0, -0.01), (0.0, 0.001, 0.0), 0.01, 0.0005, (7, 8)),
)
SCENARIO = make_run(2.0).flight.scenario.equipped(*HARDWARE)


class HardwareRun(Run):
    """A run whose controller sees what navigation finds."""

    def of_tick(self, tick):
        """Say what the nodes say at a tick."""
        for name, data in super().of_tick(tick):
            yield name, data
            if name == STATE:
                seen = SCENARIO.navigation.solution(tick, self.flight.states[tick].tolist())
                stamp = self.base.stamp_ns(tick)
                yield NAVIGATION, cdr.encode_odometry(stamp, 'target_lvlh', 'chaser', seen)


def run_of(flown=SCENARIO, recorded=(*TOPICS[:-1], NAVIGATION)):
    """Return the run of a scenario, with `SCENARIO` attached to its log; no run_status."""
    attachments = make_run(2.0).attachments | {'scenario.yaml': scenario.dumps(SCENARIO).encode()}
    flight = fly(flown, load_controller('handmade'))
    return HardwareRun(replace(flight, scenario=SCENARIO), attachments, recorded)


@pytest.fixture(params=[4096, 7], ids=['one block', 'blocks of 7'])
def blocks(request, monkeypatch):
    monkeypatch.setattr(stream, 'BLOCK_TICKS', request.param)


def test_it_is_verified(blocks, tmp_path):
    run_of().write(tmp_path)
    verified = verify(tmp_path)
    assert verified.exit_code == 0, verified.sentence()
    assert '21 ticks bit for bit' in verified.sentence()


@pytest.mark.parametrize(
    ('topic', 'check', 'tick'),
    [(NAVIGATION, 'navigation', 15), (FORCE, 'controller', 15), (DISTURBANCE, 'disturbance', 15)],
)
def test_one_bit_of_a_message_is_found(blocks, topic, check, tick, tmp_path):
    run_of().write(tmp_path / 'a')

    def flip(name, sequence, data):
        if (name, sequence) != (topic, tick):
            return data
        at = interfaces.row_of(name.rsplit('/', 1)[-1]).layout.places[0]
        (value,) = struct.unpack_from('<q', data, at)
        return data[:at] + struct.pack('<q', value ^ 1) + data[at + 8 :]

    (tmp_path / 'b').mkdir()
    rewrite(tmp_path / 'a' / 'run.mcap', tmp_path / 'b' / 'run.mcap', flip)
    found = verify(tmp_path / 'b').difference
    assert (found.check, found.tick, found.topic) == (check, tick, topic)


@pytest.mark.parametrize(
    ('sections', 'check'),
    [
        ((Thrusters(MATRIX, 2), HARDWARE[1]), 'dynamics'),
        ((Thrusters(((0.98, 0.02, 0.0), *MATRIX[1:]), 3), HARDWARE[1]), 'dynamics'),
        ((HARDWARE[1],), 'dynamics'),
        ((HARDWARE[0], replace(HARDWARE[1], noise_key=(7, 9))), 'controller'),
        ((HARDWARE[0],), 'controller'),
    ],
)
def test_other_hardware_than_the_scenarios_is_found(blocks, sections, check, tmp_path):
    run_of(flown=replace(SCENARIO, sections=sections)).write(tmp_path)
    assert verify(tmp_path).difference.check == check


@pytest.mark.parametrize('topic', [STATE, FORCE, NAVIGATION])
def test_a_missing_message_is_a_gap_and_no_difference(blocks, topic, tmp_path):
    run = run_of()
    run.write(tmp_path, [m for m in run.messages if m[:2] != (topic, 10)])
    verified = verify(tmp_path)
    assert verified.difference is None, verified.sentence()
    assert verified.exit_code == ExitCode.INCOMPLETE and '1 messages of' in verified.sentence()


def test_late_thrusters_are_a_named_gap_after_a_missing_force_and_then_verified_again(
    blocks, tmp_path
):
    run = run_of()
    kept = [m for m in run.messages if m[:2] != (FORCE, 10)]
    run.write(tmp_path / 'a', kept)
    said = verify(tmp_path / 'a').sentence()
    assert 'thrusters could not be recomputed at 3 ticks, the first is 11' in said
    assert 'recomputed: navigation, controller, disturbance, thrusters, dynamics' in said
    state = list(run.flight.states[15])
    state[0] += 1e-9
    lie = cdr.encode_odometry(run.base.stamp_ns(15), 'target_lvlh', 'chaser', state)
    run.write(tmp_path / 'b', [(n, k, lie if (n, k) == (STATE, 15) else d) for n, k, d in kept])
    assert verify(tmp_path / 'b').difference.tick == 15


def test_without_its_topic_it_cannot_be_verified(tmp_path):
    run_of(recorded=TOPICS).write(tmp_path)
    with pytest.raises(LogError, match='no topic navigation_state, but its scenario has errors'):
        verify(tmp_path)
