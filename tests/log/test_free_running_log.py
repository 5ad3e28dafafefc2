# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Logs of free running: what was flown is proved, what hung on the wall clock is not accused."""

import math
import random
from dataclasses import replace

import messages
import numpy as np
import pytest
import yaml
from log_runs import FORCE, STATE, FreeRun, changed, forge, make_run

from rpo_core import files
from rpo_core.scenario import scenario
from rpo_core.wire import cdr
from rpo_log.read.run_log import flight_of, read_run
from rpo_log.tools.export import table
from rpo_log.verify import verify

APPLIED = '/applied_force'
LAME = range(60, 75)
"""Ticks of which the plant gets no force: longer than it holds one."""


def free_run(loss=0.0, max_force_n=0.5):
    """Return a flight whose forces are lost on their way to the plant, or logged all the same."""
    chance = random.Random(7)
    flown = replace(make_run(30.0).flight.scenario, max_force_n=max_force_n)
    lost = {k for k in range(1, flown.ticks + 1) if chance.random() < loss or k in LAME}
    unlogged = {('control_force', k) for k in sorted(lost) if chance.random() < 0.5}
    return FreeRun(flown, lost=lost, unlogged=unlogged)


@pytest.fixture(scope='module')
def free():
    return free_run(0.2)


def forged(name, tick, force):
    """Return a change that puts another force into one message."""
    return changed(name, tick, lambda d: messages.wrench(cdr.stamp_ns(d), 'target_lvlh', force))


def test_answers_that_lack_are_no_fault_and_the_flight_verifies(free, tmp_path):
    summary = free.write(tmp_path / 'run')
    assert summary.messages[FORCE] < summary.messages[STATE]
    assert summary.whole, summary.sentence()
    found = verify(tmp_path / 'run')
    assert found.difference is None
    assert found.exit_code == 0, found.gaps
    assert found.free_running
    assert 'as computed from the forces that the plant says it applied, 301' in found.sentence()
    assert 'when forces came cannot be computed' in found.sentence()
    assert 'which commands the plant applied, and when' in found.unknown


def test_what_a_plant_limits_is_no_difference(tmp_path):
    free = free_run(max_force_n=0.05)
    assert free.plant.saturated_ticks > 50
    free.write(tmp_path)
    assert verify(tmp_path).exit_code == 0, verify(tmp_path).sentence()


def test_the_flight_of_a_log_is_what_was_flown(free, tmp_path):
    free.write(tmp_path / 'run')
    flight = flight_of(read_run(tmp_path / 'run'))
    np.testing.assert_array_equal(flight.forces_n, np.array(free.applied))
    energy = float((flight.saturated_forces_n**2).sum() * flight.scenario.dt_s)
    assert math.isclose(energy, free.plant.figures()['energy_n2s'], rel_tol=1e-12)
    assert (flight.forces_n[LAME.stop - 1] == 0.0).all()
    made = table(read_run(tmp_path / 'run'))
    np.testing.assert_array_equal(made['applied_fx_n'], flight.forces_n[:, 0])
    assert np.isnan(made['fx_n']).any()


def test_a_force_that_the_plant_did_not_apply_is_found_by_the_state_after_it(free, tmp_path):
    free.write(tmp_path, forged(APPLIED, 24, (0.01, 0.02, 0.03)))
    found = verify(tmp_path).difference
    assert (found.tick, found.topic, found.check) == (25, STATE, 'dynamics')


def turning():
    """Return 12 s of the shipped docking, whose thrusters empty its wheels at once."""
    found = yaml.safe_load(files.read_text(files.find('scenario', 'tumbling_docking')))
    found['attitude']['wheels']['start_nms'] = [0.07, -0.06, 0.0]
    return scenario.parse({**found, 'duration_s': 12.0})


def test_torques_that_were_late_empty_the_wheels_as_they_acted(tmp_path):
    """And an attitude controller that missed ticks goes on with what it remembers."""
    flown = turning()
    lost = {tick for tick in range(3, flown.ticks) if random.Random(tick).random() < 0.3}
    missed = {'attitude_control': {90, 100, 101}}
    FreeRun(flown, 'allround', lost, missed).write(tmp_path / 'run')
    flight = flight_of(read_run(tmp_path / 'run'))
    assert (flight.signal('unloading_torque') != 0.0).any(axis=1)[sorted(lost)].any()
    found = verify(tmp_path / 'run')
    assert found.difference is None, found.sentence()
    assert not [gap for gap in found.gaps if 'could not be recomputed' in gap], found.gaps


def test_a_command_whose_question_is_not_in_the_log_is_a_gap(tmp_path):
    """Any command passed for an answer where the log lacks what the controller read."""
    run = FreeRun(turning(), 'allround')
    run.write(tmp_path / 'run')
    assert verify(tmp_path / 'run').exit_code == 0
    lost = changed('/reference_state', 50, None)
    forge(tmp_path / 'run/run.mcap', tmp_path / 'forged', lost)
    gap = verify(tmp_path / 'forged').gaps[0]
    assert gap.startswith('controller could not be recomputed at 1 ticks, the first is 50')
