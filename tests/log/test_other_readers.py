# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Readers that people use read every message back equal, from the folder and from the bare file."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from log_runs import DISTURBANCE, FORCE, STATE, STATUS
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader

JAVASCRIPT_PACKAGES = [
    '@mcap/core',
    '@foxglove/rosmsg',
    '@foxglove/rosmsg2-serialization',
    'fzstd',
]
"""`npm install` them in a folder and name it in RPO_NODE_DIR."""

JAVASCRIPT = Path(__file__).with_name('read_run.mjs')


@pytest.fixture(scope='module', params=['one file', 'split'])
def folder(request, run, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp('readers')
    run.write(folder, split_s=15.0 if request.param == 'split' else 0.0)
    return folder


def values(topic: str, message) -> list[float]:
    if topic == STATE:
        position, velocity = message.pose.pose.position, message.twist.twist.linear
        return [position.x, position.y, position.z, velocity.x, velocity.y, velocity.z]
    force = message.wrench.force
    return [force.x, force.y, force.z]


def test_rosbags(folder, run):
    with AnyReader([folder]) as reader:
        found = [(c.topic, stamp, bytes(raw)) for c, stamp, raw in reader.messages()]
        decoded = {
            (c.topic, stamp): reader.deserialize(raw, c.msgtype)
            for c, stamp, raw in reader.messages()
        }
    stamped = [(name, run.base.stamp_ns(tick), data) for name, tick, data in run.messages]
    assert sorted(found) == sorted(stamped)
    assert [stamp for _, stamp, _ in found] == sorted(stamp for _, stamp, _ in found)
    flight = run.flight
    for topic, rows in ((STATE, flight.states), (FORCE, flight.forces_n)):
        for tick, row in enumerate(rows):
            message = decoded[topic, run.base.stamp_ns(tick)]
            assert values(topic, message) == row.tolist()
            stamp = message.header.stamp
            assert stamp.sec * 10**9 + stamp.nanosec == run.base.stamp_ns(tick)
            assert message.header.frame_id == 'target_lvlh'
    last = decoded[STATUS, run.base.stamp_ns(run.base.last_tick)]
    assert last.message == 'finished'
    for path in folder.glob('*.mcap'):
        with AnyReader([path]) as reader:
            assert reader.message_count == sum(1 for _ in reader.messages())


def test_mcap_ros2_support(folder, run):
    found = []
    for path in sorted(folder.glob('*.mcap')):
        with path.open('rb') as stream:
            reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
            for _, channel, raw, message in reader.iter_decoded_messages():
                found.append((channel.topic, raw.sequence, raw.data))
                if channel.topic in (FORCE, DISTURBANCE):
                    rows = run.flight.forces_n
                    rows = rows if channel.topic == FORCE else run.flight.disturbances_n
                    assert values(channel.topic, message) == rows[raw.sequence].tolist()
    assert sorted(found) == sorted(run.messages)


def javascript_packages() -> str | None:
    """Where node finds the packages of the test below; None if it does not."""
    node = shutil.which('node')
    if node is None:
        return None
    script = f'for (const name of {JAVASCRIPT_PACKAGES}) require.resolve(name)'
    found = subprocess.run(
        [node, '-e', script], cwd=os.environ.get('RPO_NODE_DIR', '.'), capture_output=True
    )
    return node if found.returncode == 0 else None


@pytest.mark.skipif(javascript_packages() is None, reason='node or its MCAP packages are not there')
def test_javascript(run, tmp_path):
    run.write(tmp_path)
    done = subprocess.run(
        [javascript_packages(), JAVASCRIPT, tmp_path / 'run.mcap'],
        cwd=os.environ.get('RPO_NODE_DIR', '.'), capture_output=True, text=True, timeout=50,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    said = json.loads(done.stdout)
    assert said['counts'] == {
        name: sum(1 for n, _, _ in run.messages if n == name) for name in run.topics
    }
    # JSON carries doubles by their shortest text, which is exact
    np.testing.assert_array_equal(np.array(said['states']), run.flight.states)
    np.testing.assert_array_equal(np.array(said['forces']), run.flight.forces_n)


@pytest.mark.skipif(shutil.which('rerun') is None, reason='rerun is not installed')
def test_rerun(run, tmp_path):
    run.write(tmp_path)
    for command in (['check'], ['convert', '-o', str(tmp_path / 'run.rrd')]):
        done = subprocess.run(
            ['rerun', 'mcap', *command, str(tmp_path / 'run.mcap')],
            capture_output=True, text=True, timeout=50, env={**os.environ, 'HOME': str(tmp_path)},
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        said = done.stdout + done.stderr
        assert all(name in said for name in run.topics)
        assert 'ERROR' not in said
    assert (tmp_path / 'run.rrd').stat().st_size > 100_000
