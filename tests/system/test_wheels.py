# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The wheels in an empty environment without ROS: docs/python.md and the command `rpo`."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SETTINGS = ('PIP_', 'UV_', 'SSL_', 'HTTP', 'http', 'NO_PROXY', 'no_proxy')


def run(*words: object, cwd: Path, path: str = '/usr/bin:/bin') -> str:
    """Run a program with nothing of this checkout in its environment; return what it prints."""
    kept = {key: value for key, value in os.environ.items() if key.startswith(SETTINGS)}
    env = {**kept, 'PATH': path, 'HOME': os.environ['HOME']}
    done = subprocess.run([*map(str, words)], cwd=cwd, env=env, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.mark.slow
def test_the_wheels_fly_judge_and_report_without_ros(tmp_path):
    run('make', '-s', 'wheels', cwd=ROOT, path=os.environ['PATH'])
    bin_, python = tmp_path / 'env' / 'bin', tmp_path / 'env' / 'bin' / 'python'
    uv = Path(sys.prefix) / 'bin' / 'uv'
    run(uv, 'venv', '-q', '--python', sys.executable, tmp_path / 'env', cwd=tmp_path)
    install = (uv, 'pip', 'install', '-q', '--python', python)
    core, rpo = (next((ROOT / 'dist').glob(f'{name}-*.whl')) for name in ('rpo_core', 'rpo'))
    run(*install, core, cwd=tmp_path)
    page = (ROOT / 'docs' / 'python.md').read_text()
    ten_lines = re.search(r'```python\n(.*?)```', page, re.DOTALL)[1]
    assert '0.228' in run(python, '-c', ten_lines, cwd=tmp_path)
    run(*install, f'{rpo}[log]', cwd=tmp_path)
    found = 'import importlib.util; print(importlib.util.find_spec("rclpy"))'
    assert run(python, '-c', found, cwd=tmp_path) == 'None\n'
    assert 'paper_test_measured' in run(bin_ / 'rpo', 'list', cwd=tmp_path)
    run(bin_ / 'rpo', 'simulate', 'approach', '--output', 'flown', cwd=tmp_path)
    assert 'verified, 4001 ticks' in run(bin_ / 'rpo', 'verify', 'flown', cwd=tmp_path)
    assert 'report.html' in run(bin_ / 'rpo', 'report', 'flown', cwd=tmp_path)
    assert 'allround.c' in run(bin_ / 'rpo', 'export', 'allround', '--to', 'c', cwd=tmp_path)
    assert 'algorithm: race' in run(
        bin_ / 'rpo', 'train', '--preset', 'best', '--show', cwd=tmp_path
    )
    assert ' / 40 ' in run(bin_ / 'rpo', 'campaign', 'random_starts', '--runs', 40, cwd=tmp_path)
