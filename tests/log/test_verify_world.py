# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Logs of a true world: dynamics and pulses proved across blocks, with a gap, forged."""

import struct
from dataclasses import replace

import numpy as np
import pytest
from log_runs import FORCE, STATE, STATUS, TOPICS, Run, make_run, rewrite

from rpo_core.chain.flight import fly
from rpo_core.control.controller import load_controller
from rpo_core.files import scenario
from rpo_core.wire import cdr, interfaces
from rpo_core.world.thrusters import Propellant
from rpo_log.errors import ExitCode, LogError
from rpo_log.read import stream
from rpo_log.verify import verify

EXERTED = '/exerted_force'
LEO = scenario.load_scenario('world_leo')
SCENARIO = replace(LEO, duration_s=2.0, sections=(LEO.dynamics, LEO.thrusters))
KEPT = (*(t for t in TOPICS if t not in (STATUS, '/disturbance_force')), EXERTED)


class WorldRun(Run):
    """A run whose plant publishes what its thrusters exert."""

    def of_tick(self, tick):
        """Say what the nodes say at a tick."""
        for name, data in super().of_tick(tick):
            yield name, data
            if name == FORCE:
                force = self.flight.signals[interfaces.EXERTED_FORCE][tick].tolist()
                stamp = self.base.stamp_ns(tick)
                yield EXERTED, cdr.encode_wrench(stamp, 'target_lvlh', force)


def run_of(flown=SCENARIO, recorded=KEPT):
    """Return the run of a scenario, with `SCENARIO` attached to its log; no run_status."""
    attachments = make_run(2.0).attachments | {'scenario.yaml': scenario.dumps(SCENARIO).encode()}
    flight = fly(flown, load_controller('handmade'))
    return WorldRun(replace(flight, scenario=SCENARIO), attachments, recorded)


@pytest.fixture(params=[4096, 7], ids=['one block', 'blocks of 7'])
def blocks(request, monkeypatch):
    monkeypatch.setattr(stream, 'BLOCK_TICKS', request.param)


def test_it_is_verified(blocks, tmp_path):
    run_of().write(tmp_path)
    verified = verify(tmp_path)
    assert verified.exit_code == 0, verified.sentence()
    assert 'recomputed: controller, thrusters, dynamics' in verified.sentence()


@pytest.mark.parametrize(
    ('topic', 'check'), [(EXERTED, 'thrusters'), (STATE, 'dynamics'), (FORCE, 'controller')]
)
def test_one_bit_of_a_message_is_found(blocks, topic, check, tmp_path):
    run_of().write(tmp_path / 'a')

    def flip(name, sequence, data):
        if (name, sequence) != (topic, 15):
            return data
        at = interfaces.row_of(name.rsplit('/', 1)[-1]).layout.places[0]
        (value,) = struct.unpack_from('<q', data, at)
        return data[:at] + struct.pack('<q', value ^ 1) + data[at + 8 :]

    (tmp_path / 'b').mkdir()
    rewrite(tmp_path / 'a' / 'run.mcap', tmp_path / 'b' / 'run.mcap', flip)
    found = verify(tmp_path / 'b').difference
    assert (found.check, found.tick, found.topic) == (check, 15, topic)


def other_air(world):
    return replace(world, drag=replace(world.drag, density_kg_m3=2.1e-11))


def other_tank(thrusters):
    return replace(thrusters, propellant=Propellant(specific_impulse_s=71.0, mass_kg=0.5))


def other_valves(thrusters):
    return replace(thrusters, pulses=replace(thrusters.pulses, dead_time_s=0.0))


@pytest.mark.parametrize(
    ('section', 'change', 'check'),
    [
        ('dynamics', lambda world: replace(world, eccentricity=1e-3), 'dynamics'),
        ('dynamics', other_air, 'dynamics'),
        ('thrusters', other_tank, 'dynamics'),
        ('thrusters', other_valves, 'thrusters'),
    ],
)
def test_another_world_than_the_scenarios_is_found(blocks, section, change, check, tmp_path):
    other = SCENARIO.equipped(change(getattr(SCENARIO, section)))
    run_of(flown=other).write(tmp_path)
    assert verify(tmp_path).difference.check == check


def test_a_missing_command_is_a_gap_of_valves_that_remember(blocks, tmp_path):
    run = run_of()
    run.write(tmp_path, [m for m in run.messages if m[:2] != (FORCE, 10)])
    verified = verify(tmp_path)
    assert verified.difference is None, verified.sentence()
    assert verified.exit_code == ExitCode.INCOMPLETE
    assert 'thrusters could not be recomputed at 10 ticks, the first is 11' in verified.sentence()


def test_pulses_without_their_topic_cannot_be_verified(tmp_path):
    run_of(recorded=KEPT[:-1]).write(tmp_path)
    with pytest.raises(LogError, match='no topic exerted_force, but its scenario has the stage'):
        verify(tmp_path)


def test_what_is_logged_is_what_moves_the_chaser():
    flight = run_of().flight
    given = flight.signals[interfaces.EXERTED_FORCE]
    assert np.abs(given - flight.forces_n).max() > 1e-3
    np.testing.assert_array_equal(flight.thrust.forces_n, given[:-1])
