# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Logs of free running: what was flown is proved, what hung on the wall clock is not accused."""

import math
import random
from dataclasses import replace

import numpy as np
import pytest
from log_runs import CLOCK, DISTURBANCE, FORCE, STATE, STATUS, make_run

from rpo_core.control.controller import load_controller
from rpo_core.files import scenario
from rpo_core.wire import cdr
from rpo_core.wire.statuses import numbers_text
from rpo_log.tools.diff import diff
from rpo_log.tools.export import tables
from rpo_log.verify import verify
from rpo_mcap.read.run_log import read_flight
from rpo_mcap.read.stream import RunReader
from rpo_mcap.write.writer import RunLogWriter
from rpo_sim.free_running import FreeRunningPlant

APPLIED, APPLIED_DISTURBANCE = '/applied_force', '/applied_disturbance'
STALE_AFTER = 4
LAME = range(60, 75)
"""Ticks of which the plant gets no force: longer than it holds one."""


class FreeRun:
    """A flight with a fifth of the forces lost on their way to the plant, or late."""

    def __init__(self, loss: float = 0.2, max_force_n: float = 0.5) -> None:
        run = make_run(30.0)
        flown = replace(run.flight.scenario, max_force_n=max_force_n)
        run.attachments['scenario.yaml'] = scenario.dumps(flown).encode()
        self.run, self.scenario = run, flown
        self.plant = FreeRunningPlant(
            self.scenario, ['control_force', 'disturbance_force'], STALE_AFTER
        )
        chance = random.Random(7)
        law = load_controller('handmade')
        self.messages: list[tuple[str, int, bytes]] = []
        self.applied: list[tuple[float, float, float]] = []
        self.taken: list[dict[str, str]] = []
        for tick in range(self.scenario.ticks + 1):
            state = self.plant.state
            force = law.force_n(state[:3], state[3:])
            disturbance = self.scenario.disturbance.force_n(self.scenario.time_s(tick))
            lost = tick and (chance.random() < loss or tick in LAME)
            self.plant.answer('disturbance_force', self.plant.stamp_ns, disturbance)
            if not lost:
                self.plant.answer('control_force', self.plant.stamp_ns, force)
            logged = not lost or chance.random() < 0.5  # the recorder may have what the plant lacks
            self._say(tick, state, force if logged else None, disturbance)
            answers = {'control_force': () if lost else force, 'disturbance_force': disturbance}
            self.taken.append({name: numbers_text(found) for name, found in answers.items()})
            if tick < self.scenario.ticks:
                self.plant.advance()

    def _say(self, tick, state, force, disturbance):
        stamp = self.scenario.stamp_ns(tick)
        say = [(CLOCK, cdr.encode_clock(stamp))]
        say.append((STATE, cdr.encode_odometry(stamp, 'target_lvlh', 'chaser', state)))
        forces = {FORCE: force, DISTURBANCE: disturbance}
        forces[APPLIED] = self.plant.applied('control_force')
        forces[APPLIED_DISTURBANCE] = self.plant.applied('disturbance_force')
        self.applied.append(forces[APPLIED])
        for name, value in forces.items():
            if value is not None:
                say.append((name, cdr.encode_wrench(stamp, 'target_lvlh', value)))
        if tick in (0, self.scenario.ticks):
            values = {key: repr(value) for key, value in self.plant.figures().items()}
            values['phase'] = 'finished' if tick else 'running'
            say.append((STATUS, cdr.encode_status(0, 'run', '', 'none', values)))
        self.messages += [(name, tick, data) for name, data in say]

    def write(self, folder, change=None, stale_after=STALE_AFTER, **options):
        """Write the log; `change(name, tick, data)` forges it."""
        names = [CLOCK, STATE, FORCE, DISTURBANCE, APPLIED, APPLIED_DISTURBANCE, STATUS]
        parameters = f'plant: {{mode: free_running, stale_after_ticks: {stale_after}}}\n'
        attached = {**self.run.attachments, 'parameters.yaml': parameters.encode()}
        writer = RunLogWriter(folder, self.run.base, names, attached, **options)
        for name, tick, data in self.messages:
            writer.write(name, tick, change(name, tick, data) if change else data)
            if tick >= STALE_AFTER:  # no answer to an older state can act any more
                writer.report(tick - STALE_AFTER, self.taken[tick - STALE_AFTER])
        for tick in range(len(self.taken) - STALE_AFTER, len(self.taken)):
            writer.report(tick, self.taken[tick])
        return writer.close()


@pytest.fixture(scope='module')
def free():
    return FreeRun()


def forged(name, tick, force):
    """Return a change that puts another force into one message."""

    def change(topic, at, data):
        if (topic, at) != (name, tick):
            return data
        return cdr.encode_wrench(cdr.stamp_ns(data), 'target_lvlh', force)

    return change


def test_answers_that_lack_are_no_fault_and_the_flight_verifies(free, tmp_path):
    summary = free.write(tmp_path / 'run')
    assert summary.messages[FORCE] < summary.messages[STATE]
    assert summary.whole, summary.sentence()
    found = verify(tmp_path / 'run')
    assert found.difference is None
    assert found.exit_code == 0, found.gaps
    assert found.free_running
    assert 'When forces came cannot be computed' in found.sentence()


def test_what_a_plant_limits_is_no_difference(tmp_path):
    free = FreeRun(loss=0.0, max_force_n=0.05)
    assert free.plant.saturated_ticks > 50
    free.write(tmp_path)
    assert verify(tmp_path).exit_code == 0, verify(tmp_path).sentence()


def test_the_flight_of_a_log_is_what_was_flown(free, tmp_path):
    free.write(tmp_path / 'run')
    flight = read_flight(tmp_path / 'run')
    np.testing.assert_array_equal(flight.forces_n, np.array(free.applied))
    energy = float((flight.saturated_forces_n**2).sum() * flight.scenario.dt_s)
    assert math.isclose(energy, free.plant.energy_n2s, rel_tol=1e-12)
    assert (flight.forces_n[LAME.stop - 1] == 0.0).all()
    parts = list(tables(RunReader(tmp_path / 'run')))
    applied, commanded = (
        np.concatenate([part[name] for part in parts]) for name in ('applied_fx_n', 'fx_n')
    )
    np.testing.assert_array_equal(applied, flight.forces_n[:, 0])
    assert np.isnan(commanded).any()


def test_a_force_flown_that_nobody_commanded_is_found(free, tmp_path):
    """Forge the force flown and all that follows from it: only its origin gives it away."""
    logged = {tick for name, tick, _ in free.messages if name == FORCE}
    tick = next(k for k in range(20, 50) if logged >= set(range(k - STALE_AFTER, k + 1)))
    free.write(tmp_path / 'run', forged(APPLIED, tick, (0.01, 0.02, 0.03)))
    found = verify(tmp_path / 'run').difference
    assert (found.tick, found.topic) == (tick, APPLIED)
    assert found.check == 'force applied'
    found = verify(tmp_path / 'run', given=['control_force'])
    assert found.difference.check == 'force applied', 'the commands are given, their use is not'
    found = verify(tmp_path / 'run', given=['applied_force', 'relative_state'])
    assert found.exit_code == 4 and 'had been commanded' not in found.sentence()


def test_where_an_answer_lacks_in_the_log_no_origin_is_missed(free, tmp_path):
    """The recorder may have lost what the plant got: the dynamics are checked all the same."""
    gone = {j for j in range(20, 26)}
    run = FreeRun(loss=0.0)
    run.messages = [m for m in run.messages if not (m[0] == FORCE and m[1] in gone)]
    run.write(tmp_path / 'run')
    assert verify(tmp_path / 'run').exit_code == 0
    run.write(tmp_path / 'forged', forged(APPLIED, 24, (0.01, 0.02, 0.03)))
    found = verify(tmp_path / 'forged').difference
    assert (found.tick, found.topic, found.check) == (25, STATE, 'dynamics')


def test_diff_names_the_force_flown(free, tmp_path):
    free.write(tmp_path / 'a')
    free.write(tmp_path / 'b', forged(APPLIED, 9, (0.0, 0.0, 0.0)))
    found = diff(tmp_path / 'a', tmp_path / 'b')
    assert found.first['applied_force'][0] == 9
    assert set(found.first) == {'applied_force'}


@pytest.mark.parametrize('stale_after', ['1001', '-1', 'true', '"many"', '2026-02-30', '[1', '{}'])
def test_where_the_hold_is_not_known_nothing_is_said_to_be_proved(free, stale_after, tmp_path):
    """An invented force is then no difference, but the log is not verified either."""
    free.write(tmp_path, forged(APPLIED, 30, (0.1, 0.1, 0.1)), stale_after)
    found = verify(tmp_path)
    assert found.exit_code != 0
    if found.difference is None:
        assert 'applied forces could not be compared with a command' in found.sentence()
        assert 'had been commanded' not in found.sentence()


def test_of_two_answers_the_one_that_was_applied_is_logged(tmp_path):
    """Somebody else answers each state too, half of the time before the controller."""
    free = FreeRun(loss=0.0)
    free.write(tmp_path / 'a')
    chance, messages = random.Random(3), []
    for name, tick, data in free.messages:
        messages.append((name, tick, data))
        if name == FORCE and 0 < tick < free.scenario.ticks and tick not in LAME:
            other = cdr.encode_wrench(cdr.stamp_ns(data), 'target_lvlh', (0.4, -0.4, 0.4))
            messages.insert(len(messages) - chance.randrange(2), (name, tick, other))
    free.messages = messages
    summary = free.write(tmp_path / 'b')
    assert summary.whole, summary.sentence()
    assert summary.ignored[FORCE] > 250
    runs = [(tmp_path / name / 'run.mcap').read_bytes() for name in 'ab']
    assert runs[0] == runs[1]
