# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Which slow tests continuous integration runs: `pytest -p landing -m slow`, as in `.ci/run`.

The count of commits chooses another tenth of them each time; none begins after `TIME_S`.
"""

from __future__ import annotations

import subprocess
import time
import zlib
from collections.abc import Iterable
from typing import Any

import pytest

TIME_S = 90.0
LONGEST_S = 300.0
PATIENCE = 3
"""Times the time-out of a test: on a shared machine a slow test is not a wrong one."""
BEGUN_S = time.monotonic()


def rest_at_landing(values: Iterable[Any], quick: int = 1, landing: int = 1000) -> list[Any]:
    """Return parameters of a test: first for `make test`, then for each landing, then slow ones."""
    several = [value if isinstance(value, tuple) else (value,) for value in values]
    marks = [(), pytest.mark.every_landing, pytest.mark.slow]
    return [
        pytest.param(*one, marks=marks[(i >= quick) + (i >= quick + landing)])
        for i, one in enumerate(several)
    ]


def time_out_s(item: pytest.Item) -> float:
    """Return the time-out of a test."""
    own = item.get_closest_marker('timeout')
    return LONGEST_S if own is None else own.args[0]


def pytest_runtest_setup() -> None:
    if time.monotonic() - BEGUN_S > TIME_S:
        pytest.skip('no time left in this landing')


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    commits = subprocess.check_output(['git', 'rev-list', '--count', 'HEAD'], cwd=config.rootpath)
    turn = [
        item
        for item in items
        if item.get_closest_marker('slow')
        and time_out_s(item) <= LONGEST_S
        and (zlib.crc32(item.nodeid.encode()) - int(commits)) % 10 == 0
    ]
    config.hook.pytest_deselected(items=[item for item in items if item not in turn])
    items[:] = turn
    for item in items:
        item.add_marker(pytest.mark.timeout(PATIENCE * time_out_s(item)), append=False)
