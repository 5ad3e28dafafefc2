# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A writer that is killed: what is on the disk is readable, and never below the bound."""

from __future__ import annotations

import os
import pickle
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from landing import rest_at_landing
from log_runs import make_run

from rpo_log.tools.repair import repair
from rpo_mcap.errors import LogError
from rpo_mcap.read.run_log import read_run

# Writes ticks at a given pace and says, unbuffered, each tick that it has handed to the writer.
WRITER = """
import os, pathlib, pickle, time
from rpo_mcap.write.writer import RunLogWriter
folder = pathlib.Path({folder!r})
messages, *run = pickle.loads(folder.with_suffix('.pickle').read_bytes())
writer = RunLogWriter(folder, *run)
print('ready', flush=True)
begun = time.monotonic()
for name, tick, data in messages:
    if {pace_s}:
        time.sleep(max(0.0, begun + tick * {pace_s} - time.monotonic()))
    writer.write(name, tick, data)
    if name == '/disturbance_force':
        os.write(1, b'%d\\n' % tick)
writer.close()
os.write(1, b'closed\\n')
"""


def flown(folder: Path, duration_s: float, pace_s: float = 0.0) -> subprocess.Popen:
    run = make_run(duration_s)
    folder.with_suffix('.pickle').write_bytes(
        pickle.dumps((run.messages, run.base, run.topics, run.attachments))
    )
    script = WRITER.format(folder=str(folder), pace_s=pace_s)
    process = subprocess.Popen(
        [sys.executable, '-c', script],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, 'RPO_JIT': '0'},  # starts sooner
    )
    assert process.stdout is not None and process.stdout.readline() == 'ready\n'
    return process


def kill(process: subprocess.Popen, after_s: float, how: int = signal.SIGKILL) -> int:
    """Kill the writer; return the number of ticks that it had been given."""
    time.sleep(after_s)
    process.send_signal(how)
    said = process.stdout.read().splitlines()  # type: ignore[union-attr]
    process.wait(10)
    ticks = [int(line) for line in said if line.isdigit()]
    return ticks[-1] + 1 if ticks else 0


def read_and_repair(folder: Path, given: int) -> int:
    """Check the log of a killed writer; return how many ticks it holds."""
    try:
        log = read_run(folder)
    except LogError:
        assert given <= 1  # nothing had been complete
        return 0
    mended = read_run(repair(folder).output if log.damage else folder)
    np.testing.assert_array_equal(mended.states, log.states)
    assert not mended.damage
    return len(log.ticks)


@pytest.mark.timeout(600)
@pytest.mark.parametrize('how', [signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
@pytest.mark.parametrize('seed', rest_at_landing(range(3, 11), quick=0, landing=1))
def test_killed_at_full_speed(tmp_path, seed, how):
    process = flown(tmp_path / 'log', 400.0)
    given = kill(process, random.Random(seed).uniform(0.0, 0.16), how)
    held = read_and_repair(tmp_path / 'log', given)
    # one tick may be between the hand-over and the word about it
    assert held >= min(given - 1, 0.95 * given)


@pytest.mark.parametrize('how', rest_at_landing([signal.SIGKILL, signal.SIGTERM]))
def test_killed_in_real_time_at_most_the_last_second_is_lost(tmp_path, how):
    process = flown(tmp_path / 'log', 40.0, pace_s=0.002)  # beyond tick 250 a chunk is a second
    while int(process.stdout.readline()) < 300:
        pass
    given = kill(process, 0.1, how)
    held = read_and_repair(tmp_path / 'log', given)
    one_second = 10
    assert held >= given - one_second - 1
