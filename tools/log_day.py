# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A day in a log: time and memory to write, read, verify, repair, and rosbags reading the same.

    python tools/log_day.py [hours] [folder]

Each step is a process of its own; the system measures its CPU time and its peak memory. The runs
are those of the tests of the log.
"""

from __future__ import annotations

import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[1] / 'tests' / 'log'))

STEPS = EMPTY, FLY, WRITE, WRITE_SPLIT, READ, ARRAYS, VERIFY, REPAIR, ROSBAGS = (
    'import the reader', 'simulate only', 'write', 'write, split hourly',
    'read, block by block', 'read into arrays', 'verify', 'repair a cut copy',
    'rosbags: read and decode',
)  # fmt: skip


def day(hours: float):
    """Return the flight of a day and its attachments."""
    from log_runs import make_run

    return make_run(hours * 3600.0)


def step(name: str, hours: float, folder: Path) -> None:
    """Do one step of the benchmark in this process."""
    log = folder / 'day'
    if name in (WRITE, WRITE_SPLIT):
        write(hours, log if name == WRITE else folder / 'split', name == WRITE_SPLIT)
    elif name == FLY:
        print(day(hours).flight.states.shape, 'states')
    elif name == READ:
        from rpo_mcap.read.stream import RunReader

        print(sum(len(block.ticks) for block in RunReader(log).blocks()), 'ticks')
    elif name == ARRAYS:
        from rpo_mcap.read.run_log import read_run

        print(read_run(log).states.shape, 'states')
    elif name == VERIFY:
        from rpo_log.verify import verify

        print(verify(log).sentence().partition(': ')[2])
    elif name == REPAIR:
        from rpo_log.tools.repair import repair

        cut = shutil.copy(log / 'run.mcap', folder / 'cut.mcap')
        os.truncate(cut, cut.stat().st_size * 9 // 10)
        print(repair(folder / 'cut.mcap').files[0].messages, 'messages')
    elif name == ROSBAGS:
        rosbags(log)
    elif name == EMPTY:
        import rpo_mcap.read.stream  # noqa: F401


def write(hours: float, log: Path, split: bool) -> None:
    """Write the log, one message at a time, as a recorder does."""
    from log_runs import TOPICS

    from rpo_mcap.write.writer import RunLogWriter

    run = day(hours)
    before = resident_mb()
    writer = RunLogWriter(log, run.base, TOPICS, run.attachments, split_s=3600.0 if split else 0.0)
    spent = 0.0
    for tick in range(run.base.last_tick + 1):
        messages = list(run.of_tick(tick))
        begun = time.perf_counter()
        for name, data in messages:
            writer.write(name, tick, data)
        spent += time.perf_counter() - begun
    grown = resident_mb() - before
    summary = writer.close()
    total = sum(summary.messages.values())
    size = sum(path.stat().st_size for path in log.glob('*.mcap'))
    print(
        f'{total} messages, {size / 1e6:.0f} MB, {spent / total * 1e6:.1f} us a message; '
        f'the writer has grown by {grown:.0f} MB'
    )


def resident_mb() -> float:
    """Return the memory of this process [MiB]."""
    fields = Path('/proc/self/statm').read_text().split()
    return int(fields[1]) * resource.getpagesize() / 2**20


def rosbags(log: Path) -> None:
    """Read every message as rosbags does."""
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    count = 0
    with AnyReader([log], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
        for connection, _, raw in reader.messages():
            reader.deserialize(raw, connection.msgtype)
            count += 1
    print(count, 'messages')


def main() -> None:
    """Run every step and print the table."""
    hours = float(sys.argv[1]) if len(sys.argv) > 1 else 24.0
    if len(sys.argv) > 3:
        step(sys.argv[3], hours, Path(sys.argv[2]))
        return
    with tempfile.TemporaryDirectory(dir=sys.argv[2] if len(sys.argv) > 2 else None) as folder:
        print(f'{hours:g} h of flight, {hours * 36_000:.0f} ticks')
        for name in STEPS:
            measure(name, hours, folder)


def measure(name: str, hours: float, folder: str) -> None:
    """Print one row of the table."""
    script = (
        f'import resource, runpy, sys; sys.path[:0] = {sys.path!r}; '
        f'sys.argv = {[__file__, str(hours), folder, name]!r}; '
        f'runpy.run_path({__file__!r}, run_name="__main__"); '
        'used = resource.getrusage(resource.RUSAGE_SELF); '
        'print(used.ru_utime + used.ru_stime, used.ru_maxrss)'
    )
    begun = time.perf_counter()
    done = subprocess.run([sys.executable, '-c', script], capture_output=True, text=True)
    wall = time.perf_counter() - begun
    if done.returncode:
        raise SystemExit(done.stderr)
    *lines, used = done.stdout.splitlines()
    processor, memory = map(float, used.split())
    times = f'{wall:8.1f} s wall{processor:8.1f} s CPU{memory / 1024:7.0f} MB'
    print(f'{name:26}{times}  {" ".join(lines)}', flush=True)


if __name__ == '__main__':
    main()
