# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The rules that tests/conftest.py makes for all tests hold."""

from __future__ import annotations

import ast
import os
import runpy
import subprocess
import sys
from fnmatch import fnmatch
from pathlib import Path

import landing
import pytest

from tools.node_processes import DOMAINS, own_domain

CONFTEST = Path(__file__).resolve().parents[1] / 'conftest.py'
INNER = """
import pytest

def test_fine(): pass

@pytest.mark.skip(reason='known')
def test_known(): pass

@pytest.mark.skip(reason='another')
def test_other_reason(): pass

def test_skips_itself(): pytest.skip('no mood')

@pytest.mark.xfail(reason='to be repaired', strict=True)
def test_known_bug(): assert False
"""


@pytest.mark.parametrize('workers', [pytest.param('0', marks=pytest.mark.slow), '1'])
def test_a_skip_without_a_known_reason_is_a_failure(tmp_path, workers):
    (tmp_path / 'test_inner.py').write_text(INNER)
    (tmp_path / 'test_module.py').write_text('import pytest\npytest.importorskip("no_such")\n')
    text = CONFTEST.read_text()
    allowed = "ALLOWED_SKIPS = {\n    '*test_known': 'known',"
    (tmp_path / 'conftest.py').write_text(text.replace('ALLOWED_SKIPS = {', allowed))
    (tmp_path / 'pytest.ini').write_text(f'[pytest]\npythonpath = {CONFTEST.parents[1]}\n')
    command = [sys.executable, '-m', 'pytest', '-p', 'xdist', '-n', workers, '-rA']
    command += ['--continue-on-collection-errors']
    env = {**os.environ, 'PYTEST_DISABLE_PLUGIN_AUTOLOAD': '1', 'PYTEST_ADDOPTS': ''}
    done = subprocess.run(command, cwd=tmp_path, env=env, capture_output=True, text=True)
    assert done.returncode == 1
    assert '1 failed, 1 passed, 1 skipped, 1 xfailed, 2 errors' in done.stdout
    assert 'does not say why it may be: no mood' in done.stdout
    assert 'does not say why it may be: could not import' in done.stdout


def skips_of(path):
    """Return (test or '*', reason) of the skips of a file whose reason is a text."""
    text = path.read_text()
    tree = ast.parse(text if 'pytest.skip' in text or 'skipif' in text else '')
    for name, node in [
        (getattr(top, 'name', ''), node) for top in tree.body for node in ast.walk(top)
    ]:
        called = ast.unparse(node.func) if isinstance(node, ast.Call) else ''
        if called == 'pytest.skip':
            given = node.args[0]
        elif called == 'pytest.mark.skipif':
            given = node.keywords[-1].value
        else:
            continue
        if isinstance(given, ast.Constant):
            yield name if name.startswith('test_') else '*', given.value


def test_a_skip_that_is_not_seen_here_has_a_known_reason():
    """A slow test, or one whose library is installed here, may be skipped elsewhere only."""
    allowed = runpy.run_path(str(CONFTEST))['ALLOWED_SKIPS'].items()
    skips = [
        (f'{path.relative_to(CONFTEST.parents[1])}::{name}', why)
        for path in sorted(CONFTEST.parent.glob('*/test_*.py'))
        if path != Path(__file__).resolve()
        for name, why in skips_of(path)
    ]
    for test, reason in skips:
        rows = [pattern for pattern, known in allowed if known == reason]
        found = any(fnmatch(test, row) or fnmatch(row, test) for row in rows)
        assert found, f'{test}: {reason}'
    assert len(skips) > 15


def test_domains_are_held_one_by_one():
    with own_domain() as one, own_domain() as two:
        assert one != two
        assert {one, two} <= set(DOMAINS)
    with own_domain() as three:
        assert three not in (one, two)


def test_ros_variables(ros_env):
    assert ros_env['ROS_PYTHON_CHECK_FIELDS'] == '1'
    assert ros_env['ROS_AUTOMATIC_DISCOVERY_RANGE'] == 'LOCALHOST'
    assert os.environ['ROS_DOMAIN_ID'] == ros_env['ROS_DOMAIN_ID']


def test_slow_tests_take_turns_in_continuous_integration(monkeypatch):
    names = [f'test_{number}' for number in range(60)]
    monkeypatch.setattr(landing, 'record', dict)
    turns = [landing.chosen(names, commits, 2) for commits in range(100, 110)]
    assert all(len(found) < 20 for found in turns)
    assert {name for found in turns for name in found} == set(names)
    ran = {name: ('2026-01-02', 30.0) for name in names[:-1]} | {'test_5': ('2026-01-01', 60.0)}
    monkeypatch.setattr(landing, 'record', lambda: ran)
    found = landing.chosen(names, 0, 1)
    assert found[:2] == ['test_59', 'test_5']  # never, longest ago
    assert len(found) == 3 and landing.TIME_S <= landing.GUESS_S + 60.0 + 30.0
