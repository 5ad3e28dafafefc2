# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What all tests share: a ROS domain, signals put back, and a collection that is quick."""

from __future__ import annotations

import gc
import os
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, settings
from node_processes import own_domain

# A busy machine is no failure, and a run that fails fails again.
settings.register_profile(
    'deterministic',
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow],
    derandomize=True,
    database=None,
)
settings.load_profile('deterministic')

os.environ['ROS_PYTHON_CHECK_FIELDS'] = '1'  # read when the first message module is imported
os.environ['OPENBLAS_NUM_THREADS'] = '1'  # read with NumPy; threads that wait for work take time
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # `make test &`; processes would inherit it
    signal.signal(signal.SIGINT, signal.default_int_handler)
if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:  # `nohup make test`; processes start with
    signal.signal(signal.SIGHUP, lambda *_: None)  # the default, and these tests live on


_ENDING = signal.SIGINT, signal.SIGTERM, signal.SIGHUP


@pytest.fixture(autouse=True)
def own_signals() -> Iterator[None]:
    """Put back what a test does with signals: later tests start processes, which inherit it."""
    before = {number: signal.getsignal(number) for number in _ENDING}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


SET_ELSEWHERE = (
    'ROS_LOCALHOST_ONLY', 'ROS_STATIC_PEERS',
    'FASTDDS_DEFAULT_PROFILES_FILE', 'FASTRTPS_DEFAULT_PROFILES_FILE',
)  # fmt: skip
"""What changes whom a node finds; a node in this process sets the last two."""


@pytest.fixture
def ros_env(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[dict[str, str]]:
    """Give the test its own ROS domain, in this process and, as variables, for others it starts."""
    with own_domain() as domain:
        variables = {
            'ROS_DOMAIN_ID': str(domain),
            'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
            'ROS_PYTHON_CHECK_FIELDS': '1',
            'RPO_JIT': '0',  # the bits are the same, and importing numba takes half a second
            'ROS_LOG_DIR': str(tmp_path / 'ros_log'),
        }
        for name, value in variables.items():
            monkeypatch.setenv(name, value)
        for name in SET_ELSEWHERE:
            monkeypatch.setenv(name, '')  # so that what a node of this process sets ends with it
            monkeypatch.delenv(name)
        yield variables


@pytest.fixture(scope='session')
def handmade() -> Any:
    from rpo_core.control.controller import load_controller

    return load_controller('handmade')


gc.disable()  # imports make no garbage; looking for it would take a third of the collection


def pytest_collection_finish() -> None:
    gc.freeze()
    gc.set_threshold(20_000)  # compiling makes many objects and little garbage
    gc.enable()
