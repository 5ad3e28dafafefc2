# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""`--help` comes at once: it waits for no numerical library, no drawing, no ROS."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

SRC = Path(__file__).resolve().parents[2] / 'ros_ws' / 'src'
NODES = sorted(
    words
    for path in SRC.glob('*/*/commands.py')
    for words in re.findall(r"start_node, '(\w+)\.(\w+)_node'\)", path.read_text())
)
SLOW = {'matplotlib', 'mcap', 'numba', 'numpy', 'rclpy', 'scipy'}

HELP = """
import importlib, sys
module, function, name = sys.argv[1:4]
sys.argv = [name, *sys.argv[4:]]
try:
    getattr(importlib.import_module(module), function)()
except SystemExit as error:
    assert not error.code, error
print(*sys.modules, file=sys.stderr)
"""


def help_of(module: str, function: str, name: str, *words: str) -> str:
    """Return what `--help` prints; fails if it imported what takes long."""
    command = [sys.executable, '-c', HELP, module, function, name, *words, '--help']
    done = subprocess.run(command, capture_output=True, text=True, timeout=50)
    assert done.returncode == 0, done.stderr
    assert not {loaded.partition('.')[0] for loaded in done.stderr.split()} & SLOW
    return done.stdout


def test_all_nodes_are_here():
    assert len(NODES) >= 13


@pytest.mark.parametrize(('package', 'name'), NODES)
def test_a_node_says_its_parameters(package, name):
    text = help_of(f'{package}.commands', name, name)
    assert text.startswith(f'usage: ros2 run {package} {name} [--ros-args')
    assert f'\nNode `{name}`' in text
    assert f'example:\n  ros2 run {package} {name} --ros-args -p ' in text


def test_final_approach():
    text = help_of('rpo_bringup.commands', 'final_approach', 'final_approach')
    assert text.startswith('usage: final_approach')
    assert '--real-time-factor' in text


@pytest.mark.parametrize('words', [(), ('train',), ('report',), ('log',)])
def test_rpo(words):
    assert 'Usage' in help_of('rpo_training.entry', 'main', 'rpo', *words)
