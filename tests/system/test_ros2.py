# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The stand-in `ros2`: on a made-up package, then on the built workspace."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from rpo_core.files import gone

ROOT = Path(__file__).resolve().parents[2]
ROS2 = ROOT / 'ros_ws' / 'underlay' / 'bin' / 'ros2'
PROBE = """#!/bin/sh
for word; do printf '<%s>' "$word"; done
exit 7
"""
WAITER = """#!/bin/sh
trap 'exit 42' INT
trap 'exit 43' TERM
echo ready
while :; do sleep 0.05; done
"""


@pytest.fixture
def prefix(tmp_path: Path) -> Path:
    """Return an install prefix with the package `made_up`."""
    index = tmp_path / 'share' / 'ament_index' / 'resource_index' / 'packages'
    index.mkdir(parents=True)
    (index / 'made_up').touch()
    folder = tmp_path / 'lib' / 'made_up'
    folder.mkdir(parents=True)
    for name, text in {'probe': PROBE, 'waiter': WAITER, 'data.txt': 'no program'}.items():
        (folder / name).write_text(text)
        (folder / name).chmod(0o644 if '.' in name else 0o755)
    return tmp_path


def command(prefix: Path | str, *words: str) -> tuple[list[str], dict[str, str]]:
    return [sys.executable, str(ROS2), *words], {**os.environ, 'AMENT_PREFIX_PATH': str(prefix)}


def ros2(prefix: Path | str, *words: str) -> subprocess.CompletedProcess[str]:
    argv, env = command(prefix, *words)
    return subprocess.run(argv, env=env, capture_output=True, text=True, timeout=20)


def test_arguments_and_exit_code_pass_through(prefix):
    words = ['a b', '', '--ros-args', '-p', 'x:=[1.0, 2.0]', "it's", '$HOME', '-h', '--prefix']
    done = ros2(prefix, 'run', 'made_up', 'probe', *words)
    assert done.stdout == ''.join(f'<{word}>' for word in words)
    assert done.returncode == 7
    done = ros2(prefix, 'run', '--prefix', 'env -i WORD="a b"', 'made_up', 'probe', 'x')
    assert (done.stdout, done.returncode) == ('<x>', 7)


@pytest.mark.parametrize(('number', 'code'), [(signal.SIGINT, 42), (signal.SIGTERM, 43)])
def test_signals_reach_the_executable(prefix, number, code):
    argv, env = command(prefix, 'run', 'made_up', 'waiter')
    with subprocess.Popen(argv, env=env, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout.readline() == 'ready\n'
            process.send_signal(number)
            assert process.wait(20) == code
        finally:
            process.kill()


def test_the_first_prefix_on_the_path_wins_and_one_name_twice_is_refused(prefix, tmp_path_factory):
    other = tmp_path_factory.mktemp('other')
    shutil.copytree(prefix, other, dirs_exist_ok=True)
    (other / 'lib' / 'made_up' / 'sub').mkdir()
    (other / 'lib' / 'made_up' / 'sub' / 'probe').symlink_to('../probe')
    assert ros2(f'{other}:{prefix}', 'pkg', 'prefix', 'made_up').stdout == f'{other}\n'
    assert ros2(f'{prefix}:{other}', 'pkg', 'prefix', 'made_up').stdout == f'{prefix}\n'
    done = ros2(other, 'run', 'made_up', 'probe')
    assert done.returncode == 1 and 'Multiple executables found' in done.stderr


def test_pkg_verbs(prefix):
    assert ros2(prefix, 'pkg', 'list').stdout == 'made_up\n'
    assert ros2(prefix, 'pkg', 'executables', 'made_up').stdout == 'made_up probe\nmade_up waiter\n'
    assert ros2(prefix, 'pkg', 'executables').stdout == 'made_up probe\nmade_up waiter\n'
    full = ros2(prefix, 'pkg', 'executables', '--full-path', 'made_up').stdout.splitlines()
    assert full == [f'{prefix}/lib/made_up/probe', f'{prefix}/lib/made_up/waiter']
    share = ros2(prefix, 'pkg', 'prefix', '--share', 'made_up').stdout
    assert share == f'{prefix}/share/made_up\n'


@pytest.mark.parametrize(
    ('words', 'message'),
    [
        (('run', 'nothing', 'x'), "Package 'nothing' not found"),
        (('run', 'made_up', 'x'), 'No executable found'),
        (('run', 'made_up', 'data.txt'), 'No executable found'),
        (('run', '--prefix', 'no_such_program', 'made_up', 'probe'), 'cannot be started'),
        (('pkg', 'prefix', 'nothing'), 'Package not found'),
        (('pkg', 'executables', 'nothing'), "Package 'nothing' not found"),
        (('topic', 'list'), '`ros2 topic` needs a ROS 2 installation'),
        (('pkg', 'create', 'x'), '`ros2 pkg create` needs a ROS 2 installation'),
    ],
)
def test_one_sentence_and_a_failure_code(prefix, words, message):
    done = ros2(prefix, *words)
    assert done.returncode == 1
    assert message in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert done.stdout == ''


def test_help_has_an_example(prefix):
    done = ros2(prefix, '--help')
    assert done.returncode == 0
    assert 'example: ros2 run rpo_sim plant' in done.stdout
    assert ros2(prefix).stdout == done.stdout


def test_finds_what_the_workspace_built():
    path = os.environ['AMENT_PREFIX_PATH']
    listed = set(ros2(path, 'pkg', 'executables').stdout.splitlines())
    assert {
        'rpo_bringup final_approach',
        'rpo_ctrl fuzzy_controller',
        'rpo_log recorder',
        'rpo_sim disturbance_injector',
        'rpo_sim plant',
    } <= listed
    packages = set(ros2(path, 'pkg', 'list').stdout.split())
    assert {'rclpy', 'nav_msgs', 'rpo_core', 'rpo_ros'} <= packages


def test_an_executable_of_0_1_says_where_it_is():
    path = os.environ['AMENT_PREFIX_PATH']
    listed = ros2(path, 'pkg', 'executables').stdout.splitlines()
    still = ('disturbance_injector', 'fault_injector', 'plant')
    lines = [line.split() for line in listed]
    old = [(package, x) for package, x in lines if package in gone.MOVED and x not in still]
    assert {package for package, _ in old} == gone.MOVED.keys()
    for package, name in old:
        done = ros2(path, 'run', package, name)
        assert (done.returncode, done.stdout) == (2, '')
        now = f'{gone.MOVED[package]} {name}'
        if now in listed:
            assert done.stderr == f'`{package} {name}` is now `ros2 run {now}`\n'
        else:
            assert f'`{package} {name}` is gone in 0.2; use ' in done.stderr
