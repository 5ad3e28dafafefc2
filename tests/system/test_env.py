# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""`source ros_ws/env.bash` in bash and zsh, interactive or not, from a bare environment."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
ENV = ROOT / 'ros_ws' / 'env.bash'
SYSTEM_PATH = '/usr/local/bin:/usr/bin:/bin'
SHELLS = {
    'bash': ['bash', '--norc', '--noprofile'],
    'bash interactive': ['bash', '--norc', '--noprofile', '-i'],
    'bash strict': ['bash', '--norc', '--noprofile', '-eu'],
    'zsh': ['zsh', '-f'],
    'zsh interactive': ['zsh', '-f', '-i'],
    'zsh strict': ['zsh', '-f', '-eu'],
}


def run(shell: str, script: str, **environ: str) -> subprocess.CompletedProcess[str]:
    """Run a script in a shell that has nothing but a PATH and an empty home."""
    command = SHELLS[shell]
    if shutil.which(command[0]) is None:
        pytest.skip(f'{command[0]} is not installed')
    return subprocess.run(
        [*command, '-c', script],
        env={'PATH': SYSTEM_PATH, 'HOME': '/nonexistent', 'TERM': 'dumb', **environ},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=30,
        cwd='/',
    )


def variables(text: str) -> dict[str, str]:
    return dict(line.split('=', 1) for line in text.split('\0') if '=' in line)


@pytest.mark.parametrize('shell', SHELLS)
def test_underlay_and_overlay_work(shell):
    done = run(
        shell,
        f'. {ENV}; python -c "import rclpy, rpo_core, rpo; print(rpo_core.__file__)" '
        '&& ros2 pkg prefix rpo_sim && command -v rpo ros2',
    )
    assert done.returncode == 0, done.stderr
    core, prefix, rpo, _ = done.stdout.splitlines()
    assert Path(core).resolve().is_relative_to(ROOT / 'ros_ws' / 'src')  # links, not copies
    assert prefix == f'{ROOT}/ros_ws/install/rpo_sim'
    assert rpo == f'{ROOT}/.venv/bin/rpo'


@pytest.mark.parametrize('shell', SHELLS)
def test_sourcing_twice_changes_nothing_and_leaves_no_helpers(shell):
    once = run(shell, f'. {ENV}; env -0')
    twice = run(shell, f'. {ENV}; . {ENV}; env -0')
    assert once.returncode == 0, once.stderr
    assert variables(once.stdout) == variables(twice.stdout)
    assert not once.stderr.replace('bash: no job control in this shell\n', '').count('env.bash')
    left = run(shell, f'. {ENV}; set').stdout
    assert [line for line in left.splitlines() if line.startswith('_rpo')] == []


def test_both_shells_give_the_same_environment_zsh():
    bash = variables(run('bash', f'. {ENV}; env -0').stdout)
    zsh = variables(run('zsh', f'. {ENV}; env -0').stdout)
    for name in ('_', 'SHLVL', 'PWD', 'OLDPWD', 'LOGNAME'):
        bash.pop(name, None), zsh.pop(name, None)
    assert bash == zsh


def test_what_the_user_had_is_kept_and_what_is_not_set_has_a_default():
    mine = {
        'PYTHONPATH': '/mine/python',
        'AMENT_PREFIX_PATH': '/mine/overlay',
        'LD_LIBRARY_PATH': '/mine/lib',
    }
    theirs = {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'SUBNET', 'ROS_DOMAIN_ID': '17'}
    found = variables(run('bash', f'. {ENV}; env -0', **mine, **theirs).stdout)
    assert all(found[name].endswith(f':{value}') for name, value in mine.items())
    assert {name: found[name] for name in theirs} == theirs
    found = variables(run('bash', f'. {ENV}; env -0').stdout)
    assert found['ROS_DISTRO'] == 'jazzy'
    assert found['ROS_AUTOMATIC_DISCOVERY_RANGE'] == 'LOCALHOST'
    assert 'ROS_DOMAIN_ID' not in found
    assert '' not in found['PATH'].split(':') + found['PYTHONPATH'].split(':')


def test_a_real_ros2_goes_first(tmp_path):
    real = tmp_path / 'ros2'
    real.write_text('#!/bin/sh\n')
    real.chmod(0o755)
    done = run('bash', f'. {ENV}; command -v ros2', PATH=f'{SYSTEM_PATH}:{tmp_path}')
    first = shutil.which('ros2', path=SYSTEM_PATH) or str(real)
    ros = (ROOT / '.venv' / 'rpo_ros_prefix').read_text().strip()
    assert done.stdout.strip() == (f'{ros}/bin/ros2' if ros else first)


def test_a_middleware_that_the_wheels_lack_is_replaced_and_said():
    if (ROOT / '.venv' / 'rpo_ros_prefix').read_text().strip():
        return  # an installed ROS 2 brings what middleware it has
    done = run('bash', f'. {ENV}; echo $RMW_IMPLEMENTATION', RMW_IMPLEMENTATION='rmw_x_cpp')
    assert done.stdout == 'rmw_fastrtps_cpp\n'
    assert 'RMW_IMPLEMENTATION=rmw_x_cpp is not among the wheels' in done.stderr


@pytest.mark.parametrize('shell', ['bash', 'zsh'])
def test_another_distribution_is_refused_in_a_sentence(shell):
    done = run(shell, f'. {ENV}; echo code $?', ROS_DISTRO='humble')
    assert done.stdout == 'code 1\n'
    assert 'ROS 2 humble is sourced in this shell' in done.stderr


@pytest.mark.parametrize('shell', ['bash', 'zsh'])
def test_says_that_set_up_has_not_run(shell, tmp_path):
    copy = tmp_path / 'ros_ws' / 'env.bash'
    copy.parent.mkdir()
    shutil.copy(ENV, copy)
    done = run(shell, f'. {copy}; echo code $?; echo $AMENT_PREFIX_PATH')
    assert done.stdout == 'code 1\n\n'
    assert done.stderr == (
        f'env.bash: this checkout is not set up yet: run `make setup` in {tmp_path} first.\n'
    )


def test_an_installed_ros_2_is_the_ground(tmp_path):
    """A stand-in installation: what matters is who is sourced, once, and what lies on it."""
    root, ros = tmp_path / 'root', tmp_path / 'jazzy'
    for folder in (root / '.venv', root / 'ros_ws' / 'install', ros / 'bin'):
        folder.mkdir(parents=True)
    shutil.copy(ENV, root / 'ros_ws')
    (root / '.venv' / 'rpo_ros_prefix').write_text(f'{ros}\n')
    (root / 'ros_ws' / 'install' / '.rpo_build.json').write_text('{}')
    sourced = 'export AMENT_PREFIX_PATH={0} ROS_DISTRO=jazzy PATH="{0}/bin:$PATH" N=x$N\n'
    (ros / 'setup.bash').write_text(sourced.format(ros))
    script = f'. {root}/ros_ws/env.bash; . {root}/ros_ws/env.bash; env -0'
    found = variables(run('bash', script).stdout)
    assert found['AMENT_PREFIX_PATH'] == str(ros)
    assert found['N'] == 'x'
    assert '_ROS_WHEELS_BOOTSTRAP_COMPLETE' not in found
    assert 'LD_LIBRARY_PATH' not in found
    assert found['PATH'].startswith(f'{root}/.venv/bin:{ros}/bin:')
    assert os.environ.get('N') is None
