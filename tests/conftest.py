# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What all tests share: a ROS domain, no skip without a known reason, a budget of CPU time."""

from __future__ import annotations

import fnmatch
import gc
import os
import resource
import signal
import time
from collections.abc import Generator, Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

from tools.node_processes import own_domain

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
    'tests/log/test_writer.py::test_a_small_tmpfs': 'a tmpfs can be mounted by root only',
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


# --- what tests may cost ----------------------------------------------------------------------

BUDGET_S = 3.0
"""CPU time that a quick test may take on the usual machine, with the processes it waits for."""
NOISE = 1.25
LOOP_S = 0.0065
"""CPU time of `loop_s` on that machine."""
gc.disable()  # imports make no garbage; looking for it would take a third of the collection


def pytest_collection_finish() -> None:
    gc.freeze()
    gc.set_threshold(20_000)  # compiling makes many objects and little garbage
    gc.enable()


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption('--cpu', type=int, default=0, help='list the N dearest tests by CPU time')


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    wanted = terminalreporter.config.getoption('--cpu')
    if not wanted:
        return
    found = [
        (spent, name)
        for reports in terminalreporter.stats.values()
        for report in reports
        for name, spent in getattr(report, 'costs', {}).items()
    ]
    terminalreporter.section(f'CPU time, in s: {sum(spent for spent, _ in found):.1f}')
    for spent, name in sorted(found, reverse=True)[:wanted]:
        terminalreporter.line(f'{spent:8.2f} {name}')


def cpu_s() -> float:
    """Return the CPU time of this process and of its children that it has waited for, in s."""
    usages = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(usage.ru_utime + usage.ru_stime for usage in usages)


def loop_s() -> float:
    """Return the CPU time that a loop takes now, in s: how slow the machine is at the moment."""
    before, x = cpu_s(), 0.0
    for i in range(200_000):
        x = x * 0.5 + i
    return cpu_s() - before


class Cost:
    """CPU time of the test that runs now, in s, and of the fixtures that it made for others too."""

    def __init__(self) -> None:
        self.start = cpu_s()
        self.begun = time.time()
        self.fixtures: dict[str, float] = {}

    @property
    def own(self) -> float:
        return cpu_s() - self.start - sum(self.fixtures.values())

    def too_much(self, budget_s: float) -> str:
        """Return what to say of a test that took more than its budget; '' where it did not.

        A test during which a kernel was compiled, by this process or another, is not judged.
        """
        own, most = self.own, budget_s * NOISE
        allowed = own <= most or own <= most * max(loop_s() for _ in range(5)) / LOOP_S
        cache = Path(os.environ.get('XDG_CACHE_HOME') or Path.home() / '.cache', 'rpo', 'kernels')
        if allowed or any(path.stat().st_mtime > self.begun for path in cache.glob('*/*.nbc')):
            return ''
        return f'took {own:.1f} s of CPU time, and has {budget_s:g} s: CONTRIBUTING.md says more'


COST = [Cost()]


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_logstart() -> None:
    COST[:] = [Cost()]


class Fixtures:
    """A plugin: pytest asks no `conftest.py` below the root about fixtures of the session."""

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(
        self, fixturedef: pytest.FixtureDef[object]
    ) -> Generator[None, object, object]:
        """Count a fixture of a module or of the session for itself, not for its first test."""
        own = COST[0].own
        try:
            return (yield)
        finally:
            if fixturedef.scope != 'function':
                COST[0].fixtures[f'{fixturedef.baseid} {fixturedef.argname}'] = COST[0].own - own


def pytest_configure(config: pytest.Config) -> None:
    config.pluginmanager.register(Fixtures())


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_makereport(
    item: pytest.Item,
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    report = yield
    explained(report)
    if report.when == 'teardown':
        report.costs = {report.nodeid: COST[0].own, **COST[0].fixtures}
        budget = item.get_closest_marker('cpu_s')
        said = COST[0].too_much(budget.args[0] if budget else BUDGET_S)
        quick = not any(map(item.get_closest_marker, ('slow', 'every_landing')))
        if said and report.passed and quick:
            report.outcome, report.longrepr = 'failed', said
    return report


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_make_collect_report() -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
    report = yield
    explained(report)
    return report
