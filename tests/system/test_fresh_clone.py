# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A stranger's first minutes: an empty clone, an empty home, one command. Needs a package index."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
KEPT = ('PIP_', 'UV_', 'SSL_', 'HTTP', 'http', 'NO_PROXY', 'no_proxy', 'REQUESTS_')

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]


@pytest.fixture(scope='module')
def clone(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a clone of what is committed."""
    path = tmp_path_factory.mktemp('stranger') / 'rpo'
    subprocess.run(['git', 'clone', '--quiet', str(ROOT), str(path)], check=True)
    return path


def environment(home: Path) -> dict[str, str]:
    """Return what a login shell has, with an empty home; how to reach an index is kept."""
    home.mkdir(exist_ok=True)
    kept = {key: value for key, value in os.environ.items() if key.startswith(KEPT)}
    return {'PATH': '/usr/local/bin:/usr/bin:/bin', 'HOME': str(home), **kept}


def make(clone: Path, *words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        ['make', '--no-print-directory', *words],
        cwd=clone,
        env=environment(clone.parent / 'home'),
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
    )


def test_demo_flies_from_nothing(clone):
    done = make(clone, 'demo')
    assert done.returncode == 0, done.stdout + done.stderr
    run = clone / 'runs' / 'demo'
    assert (run / 'run.mcap').stat().st_size > 0
    assert (run / 'metadata.yaml').is_file()
    assert list((run / 'report').glob('*.png'))
    assert (run / 'report' / 'replay.html').is_file()
    assert done.stdout.splitlines()[-1].startswith('next: '), done.stdout


def test_the_home_has_what_the_tutorial_says(clone):
    home = clone.parent / 'home'
    files = [path.relative_to(home).parts for path in home.rglob('*') if path.is_file()]
    made = {'/'.join(parts[:2]) for parts in files}
    text = (ROOT / 'docs/tutorial.md').read_text()
    assert made and [place for place in made if f'`~/{place}`' not in text] == []


def test_a_second_call_has_nothing_to_say(clone):
    done = make(clone, 'setup')
    assert (done.returncode, done.stdout, done.stderr) == (0, '', '')


def flies(clone: Path) -> bool:
    script = 'source ros_ws/env.bash && python -c "import rclpy, rpo_core" && ros2 pkg executables'
    done = subprocess.run(
        ['bash', '-c', script],
        cwd=clone,
        env=environment(clone.parent / 'home'),
        capture_output=True,
        text=True,
    )
    return done.returncode == 0 and 'rpo_sim plant' in done.stdout


@pytest.mark.parametrize('seconds', [2, 5, 10])
def test_killed_at_any_moment_it_heals(clone, seconds):
    make(clone, 'clean')
    process = subprocess.Popen(
        ['make', 'setup'],
        cwd=clone,
        env=environment(clone.parent / 'home'),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        start_new_session=True,
    )
    time.sleep(seconds)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    assert make(clone, 'setup').returncode == 0
    assert flies(clone)


def test_a_lost_interpreter_and_a_lost_build_are_replaced(clone):
    python = clone / '.venv' / 'bin' / 'python'
    python.unlink()
    python.symlink_to('/no/such/python')
    done = make(clone, 'setup')
    assert done.returncode == 0 and 'is missing or has changed' in done.stdout
    assert flies(clone)
    (clone / 'ros_ws' / 'install' / 'rpo_sim' / 'lib' / 'rpo_sim' / 'plant').unlink()
    done = make(clone, 'setup')
    assert done.returncode == 0 and 'building rpo_sim' in done.stdout
    assert flies(clone)
