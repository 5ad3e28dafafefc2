# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What all tests share: a ROS domain, no skip without a known reason."""

from __future__ import annotations

import fnmatch
import gc
import os
import signal
from collections.abc import Generator, Iterator
from pathlib import Path

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

# Node id pattern -> why that test may be skipped. Any other skip is a failure.
ALLOWED_SKIPS = {
    '*': 'no time left in this landing',  # tests/landing.py
    'tests/system/test_env.py::*zsh*': 'zsh is not installed',
    'tests/log/test_other_readers.py::test_javascript': 'node or its MCAP packages are not there',
    'tests/log/test_other_readers.py::test_rerun': 'rerun is not installed',
    'tests/ros/test_recorder.py::test_a_full_disk*': 'a tmpfs can be mounted by root only',
    'tests/training/test_export_c.py::*': 'cc is not installed',
    'tests/safety/test_export_assured.py::*': 'cc is not installed',
    'tests/log/test_signed.py::test_openssl_agrees': 'openssl is not installed',
    'tests/training/test_cluster.py::test_with_tls*': 'openssl is not installed',
    'tests/training/test_report_browser.py::*': 'chromium is not installed',
    'tests/attitude/test_chaser.py::*_basilisk*': 'Basilisk (layer truth) is not installed',
    'tests/training/test_truth.py::test_basilisk*': 'Basilisk (layer truth) is not installed',
    'tests/ros/test_foreign.py::test_basilisk*': 'Basilisk (layer truth) is not installed',
    'tests/ros/test_view_live.py::test_the_page*': 'chromium is not installed',
    'tests/ros/test_launch_files.py::test_a_real_launch': 'ros2 launch is not installed',
    'tests/ros/test_two_hosts.py::*': 'network namespaces are not allowed here',
    'tests/ros/test_two_hosts.py::*link*': 'there is no /dev/net/tun',
}
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


def explained(report: pytest.TestReport | pytest.CollectReport) -> None:
    """Turn a skip that has no reason in ALLOWED_SKIPS into a failure that says so."""
    if not report.skipped or hasattr(report, 'wasxfail'):
        return
    given = report.longrepr[2] if isinstance(report.longrepr, tuple) else report.longrepr
    reason = str(given).removeprefix('Skipped: ')
    for pattern, allowed in ALLOWED_SKIPS.items():
        if fnmatch.fnmatch(report.nodeid, pattern) and reason == allowed:
            return
    report.outcome = 'failed'
    report.longrepr = f'skipped, and tests/conftest.py does not say why it may be: {reason}'


gc.disable()  # imports make no garbage; looking for it would take a third of the collection


def pytest_collection_finish() -> None:
    gc.freeze()
    gc.set_threshold(20_000)  # compiling makes many objects and little garbage
    gc.enable()


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_makereport() -> Generator[None, pytest.TestReport, pytest.TestReport]:
    report = yield
    explained(report)
    return report


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_make_collect_report() -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
    report = yield
    explained(report)
    return report
