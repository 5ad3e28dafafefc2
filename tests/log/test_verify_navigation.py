# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Logs of sensors and an estimator: proved across blocks, and one bit of each message is found."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from log_runs import FORCE, STATE, STATUS, TOPICS, Run, make_run, rewrite
from nav_scenarios import LIDAR, make

from rpo_core import interfaces, scenario
from rpo_core.controller import load_controller
from rpo_core.flight import fly
from rpo_log.read import stream
from rpo_log.read.run_log import read_run
from rpo_log.tools.export import export
from rpo_log.verify import verify

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
