# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Logs of sensors and an estimator: proved across blocks, and one bit of each message is found."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from log_runs import FORCE, STATE, STATUS, TOPICS, Run, make_run, rewrite
from nav_scenarios import LIDAR, make

from rpo_core.chain.chain import Chain
from rpo_core.chain.flight import fly
from rpo_core.chain.stage import Place
from rpo_core.control.controller import load_controller
from rpo_core.files import scenario
from rpo_core.wire import interfaces
from rpo_log.format.run import TimeBase
from rpo_log.read import stream
from rpo_log.read.run_log import read_run
from rpo_log.tools.export import export
from rpo_log.verify import verify
from rpo_log.write.writer import RunLogWriter
from rpo_sim.free_running import FreeRunningPlant

SCENARIO = make([{**LIDAR, 'latency_ticks': 2}], ticks=30, estimator={'disturbance_sigma_n': 0.01})
MEASURED, ESTIMATE, PUSH = '/measurement', '/navigation_state', '/estimated_disturbance'
KEPT = (
    *(topic for topic in TOPICS if topic not in (STATUS, '/disturbance_force')),
    MEASURED, ESTIMATE, PUSH,
)  # fmt: skip


class NavigatedRun(Run):
    """A run whose navigation publishes what it measures and estimates."""

    def of_tick(self, tick):
        """Say what the nodes say at a tick."""
        yield from super().of_tick(tick)
        signals = self.flight.signals
        covariance = signals[interfaces.NAVIGATION_COVARIANCE][tick].tolist()
        for name in (MEASURED, ESTIMATE, PUSH):
            values = signals[name[1:]][tick].tolist()
            values += covariance if name == ESTIMATE else []
            layout = interfaces.row_of(name[1:]).layout
            yield name, layout.encode(self.base.stamp_ns(tick), values)


@pytest.fixture(scope='module')
def run():
    attachments = make_run(2.0).attachments | {'scenario.yaml': scenario.dumps(SCENARIO).encode()}
    return NavigatedRun(fly(SCENARIO, load_controller('handmade')), attachments, KEPT)


@pytest.fixture(params=[4096, 7], ids=['one block', 'blocks of 7'])
def blocks(request, monkeypatch):
    monkeypatch.setattr(stream, 'BLOCK_TICKS', request.param)


def test_it_is_verified_and_read(run, blocks, tmp_path):
    run.write(tmp_path)
    verified = verify(tmp_path)
    assert verified.exit_code == 0, verified.sentence()
    assert 'recomputed: sensors, estimator, controller' in verified.sentence()
    found = read_run(tmp_path).values[interfaces.NAVIGATION_COVARIANCE]
    assert np.array_equal(found, run.flight.signals[interfaces.NAVIGATION_COVARIANCE])
    export(tmp_path, tmp_path / 'run.csv')
    header = (tmp_path / 'run.csv').read_text().splitlines()[0].split(',')
    assert {'measurement_x_m', 'navigation_x_m', 'navigation_x_x_m2'} <= set(header)


@pytest.mark.parametrize(
    ('topic', 'place', 'check'),
    [
        (MEASURED, 0, 'sensors'), (MEASURED, 2, 'sensors'), (ESTIMATE, 0, 'estimator'),
        (ESTIMATE, 7, 'estimator'), (PUSH, 0, 'estimator'), (FORCE, 0, 'controller'),
        (STATE, 0, 'dynamics'),
    ],
)  # fmt: skip
def test_one_bit_of_a_message_is_found(run, blocks, topic, place, check, tmp_path):
    run.write(tmp_path / 'a')

    def flip(name, sequence, data):
        if (name, sequence) != (topic, 15):
            return data
        at = interfaces.row_of(name[1:]).layout.places[place]
        (value,) = struct.unpack_from('<q', data, at)
        return data[:at] + struct.pack('<q', value ^ 1) + data[at + 8 :]

    (tmp_path / 'b').mkdir()
    rewrite(tmp_path / 'a' / 'run.mcap', tmp_path / 'b' / 'run.mcap', flip)
    found = verify(tmp_path / 'b').difference
    assert (found.check, found.tick, found.topic) == (check, 15, topic)


class FreeNavigation:
    """Navigation against the wall clock: it misses some ticks, and so does the controller."""

    def __init__(self, missed=(), lost=()):
        self.missed, self.lost = missed, lost
        navigation = Chain.of(SCENARIO).part(Place.SENSOR, Place.ESTIMATOR)
        law = load_controller('handmade')
        plant = FreeRunningPlant(SCENARIO, ['control_force', 'disturbance_force'], 4)
        self.messages, before = [], (0.0, 0.0, 0.0)
        (previous,) = (name for name in navigation.inputs if name != 'relative_state')
        for tick in range(SCENARIO.ticks + 1):
            said = {'relative_state': plant.state}
            if tick not in missed:
                signals = {'relative_state': plant.state, previous: before}
                navigation.step(tick, signals)
                seen = signals['navigation_state']
                said['control_force'] = law.force_n(seen[:3], seen[3:])
                plant.answer('control_force', plant.stamp_ns, said['control_force'])
                if tick not in lost:
                    said |= {
                        name: signals[name] for name in ('measurement', 'estimated_disturbance')
                    }
                    said['navigation_state'] = (*seen, *signals['navigation_covariance'])
            said['applied_force'] = before = plant.applied('control_force')
            said['applied_disturbance'] = plant.applied('disturbance_force')
            self.messages += [(f'/{name}', tick, plant.stamp_ns, v) for name, v in said.items()]
            if tick < SCENARIO.ticks:
                plant.advance()

    def write(self, folder, flip=None):
        """Write the log."""
        names = [*KEPT, '/applied_force', '/applied_disturbance']
        parameters = b'plant: {mode: free_running, stale_after_ticks: 4}\n'
        attached = make_run(2.0).attachments | {
            'scenario.yaml': scenario.dumps(SCENARIO).encode(),
            'parameters.yaml': parameters,
        }
        base = TimeBase(SCENARIO.epoch_ns, SCENARIO.dt_ns, SCENARIO.ticks)
        writer = RunLogWriter(folder, base, names, attached)
        order = [row.name for row in interfaces.rows()]
        for name, tick, stamp, values in sorted(
            self.messages, key=lambda m: (m[1], order.index(m[0][1:]))
        ):
            given = list(values)
            if flip == (name, tick):
                given[0] += 1e-9
            row = interfaces.row_of(name[1:])
            writer.write(name, tick, row.layout.encode(stamp, given))
        writer.close()


def test_a_tick_that_navigation_missed_is_recomputed_as_missed(blocks, tmp_path):
    FreeNavigation(missed=(10, 19, 20)).write(tmp_path / 'run')
    verified = verify(tmp_path / 'run')
    assert verified.difference is None, verified.sentence()
    assert 'estimator could not' not in verified.sentence()
    FreeNavigation(missed=(10, 19, 20)).write(tmp_path / 'forged', flip=('/navigation_state', 25))
    found = verify(tmp_path / 'forged').difference
    assert (found.check, found.tick) == ('estimator', 25)


def test_a_message_that_the_recorder_missed_is_a_gap_that_is_said(blocks, tmp_path):
    FreeNavigation(lost=(10,)).write(tmp_path)
    verified = verify(tmp_path)
    assert verified.difference is None, verified.sentence()
    assert 'estimator could not be recomputed at 20 ticks, the first is 11' in verified.sentence()
