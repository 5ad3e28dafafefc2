# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What all tests share: a ROS domain of their own, and no test skipped without a known reason."""

from __future__ import annotations

import fcntl
import fnmatch
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

# Node id pattern -> why that test may be skipped. A skip that is not here fails the session.
ALLOWED_SKIPS = {
    'tests/system/test_env.py::*zsh*': 'zsh is not installed',
    'tests/log/test_other_readers.py::test_javascript': 'node or its MCAP packages are not there',
    'tests/log/test_writer.py::test_a_small_tmpfs': 'a tmpfs can be mounted by root only',
}
DOMAINS = range(1, 102)  # 0 is everybody's default; above 101 the ports are not safe on Linux


@contextmanager
def own_domain() -> Iterator[int]:
    """Hold a ROS domain that no other test on this machine holds, in this run or another."""
    folder = Path(tempfile.gettempdir(), f'rpo_ros_domains_{os.getuid()}')
    folder.mkdir(exist_ok=True)
    for domain in DOMAINS:
        with (folder / str(domain)).open('w') as file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                continue
            yield domain
            return
    raise RuntimeError('all ROS domains are taken by other tests')


@pytest.fixture
def ros_env(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[dict[str, str]]:
    """Give the test its own ROS domain, in this process and, as variables, for others it starts."""
    with own_domain() as domain:
        variables = {
            'ROS_DOMAIN_ID': str(domain),
            'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
            'ROS_PYTHON_CHECK_FIELDS': '1',
            'ROS_LOG_DIR': str(tmp_path / 'ros_log'),
        }
        for name, value in variables.items():
            monkeypatch.setenv(name, value)
        for name in ('ROS_LOCALHOST_ONLY', 'ROS_STATIC_PEERS'):
            monkeypatch.delenv(name, raising=False)
        yield variables


class SkipWatch:
    """Collects skipped tests and fails the session for those without a known reason."""

    def __init__(self) -> None:
        self.unexplained: list[str] = []

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.skipped and not hasattr(report, 'wasxfail'):
            self._judge(report.nodeid, report.longrepr)

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        if report.skipped:
            self._judge(report.nodeid, report.longrepr)

    def _judge(self, node: str, reason: object) -> None:
        text = str(reason[2] if isinstance(reason, tuple) else reason).removeprefix('Skipped: ')
        for pattern, allowed in ALLOWED_SKIPS.items():
            if fnmatch.fnmatch(node, pattern) and text == allowed:
                return
        self.unexplained.append(f'{node}: {text}')

    @pytest.hookimpl(trylast=True)
    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        if self.unexplained:
            session.exitstatus = pytest.ExitCode.TESTS_FAILED

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        if self.unexplained:
            terminalreporter.section('skipped without a reason in tests/conftest.py', red=True)
            for line in self.unexplained:
                terminalreporter.line(line)


def pytest_configure(config: pytest.Config) -> None:
    config.pluginmanager.register(SkipWatch(), 'skip_watch')
