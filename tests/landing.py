# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Which slow tests continuous integration runs: `pytest -p landing -m slow`, as in `.ci/run`.

Those that were never run or not for the longest time, until about `TIME_S` is full. What each took,
and when, is in a file of the user's cache. Without that file, as after a new checkout, the count of
commits chooses another tenth of the tests each time.
"""

from __future__ import annotations

import json
import os
import subprocess
import time
import zlib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pytest

TIME_S = 90.0
LONGEST_S = 300.0
GUESS_S = 10.0
"""How long a test takes that was never run here."""
PATIENCE = 3
"""Times the time-out of a test: on a shared machine a slow test is not a wrong one."""
BEGUN_S = time.monotonic()
RECORD = Path(os.environ.get('XDG_CACHE_HOME') or Path.home() / '.cache', 'rpo', 'slow_tests.json')


def rest_at_landing(values: Iterable[Any], quick: int = 1, landing: int = 1000) -> list[Any]:
    """Return parameters of a test: first for `make test`, then for each landing, then slow ones."""
    several = [value if isinstance(value, tuple) else (value,) for value in values]
    marks = [(), pytest.mark.every_landing, pytest.mark.slow]
    return [
        pytest.param(*one, marks=marks[(i >= quick) + (i >= quick + landing)])
        for i, one in enumerate(several)
    ]


def record() -> dict[str, tuple[str, float]]:
    """Return test -> (date of its last run that passed, how long it took in s)."""
    return json.loads(RECORD.read_text()) if RECORD.exists() else {}


def turn(name: str, commits: int) -> int:
    """Return in how many landings it is this test's turn, 0 to 9."""
    return (zlib.crc32(name.encode()) - commits) % 10


def chosen(names: list[str], commits: int, workers: int) -> list[str]:
    """Return the tests for this landing, in their order."""
    known = record()

    def order(name: str) -> tuple[str, int]:
        return known.get(name, ('', 0.0))[0], turn(name, commits)

    found, planned_s = [], 0.0
    for name in sorted(names, key=order):
        if planned_s < TIME_S * workers and (known or not turn(name, commits)):
            found.append(name)
            planned_s += known.get(name, ('', GUESS_S))[1]
    return found


def time_out_s(item: pytest.Item) -> float:
    """Return the time-out of a test."""
    own = item.get_closest_marker('timeout')
    return LONGEST_S if own is None else own.args[0]


def is_short(item: pytest.Item) -> bool:
    """Return whether a test ends within `LONGEST_S`, by its time-out."""
    return time_out_s(item) <= LONGEST_S


def pytest_runtest_setup() -> None:
    if time.monotonic() - BEGUN_S > TIME_S:
        pytest.skip('no time left in this landing')


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    commits = subprocess.check_output(['git', 'rev-list', '--count', 'HEAD'], cwd=config.rootpath)
    workers = int(os.environ.get('PYTEST_XDIST_WORKER_COUNT', '1'))
    of = {item.nodeid: item for item in items if item.get_closest_marker('slow') and is_short(item)}
    found = chosen(list(of), int(commits), workers)
    config.hook.pytest_deselected(items=[item for item in items if item.nodeid not in found])
    items[:] = [of[name] for name in found]
    for item in items:
        item.add_marker(pytest.mark.timeout(PATIENCE * time_out_s(item)), append=False)


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    if hasattr(terminalreporter.config, 'workerinput'):
        return  # who started the workers knows what all of them ran
    before, now = record(), {}
    terminalreporter.section('slow tests of this landing: last run, time now')
    for report in terminalreporter.stats.get('passed', []):
        last = before.get(report.nodeid, ('never here', 0.0))[0]
        terminalreporter.line(f'{last:>10} {report.duration:6.1f} s {report.nodeid}')
        now[report.nodeid] = (time.strftime('%Y-%m-%d'), round(report.duration, 1))
    RECORD.parent.mkdir(parents=True, exist_ok=True)
    RECORD.write_text(json.dumps({**before, **now}, indent=0, sort_keys=True))
    oldest = min((date for date, _ in before.values()), default='')
    terminalreporter.line(f'{len(before)} slow tests ran here before, the first of them {oldest}')
