# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The three wheels in empty environments without ROS.

The lowest versions that they allow on the lowest Python, the highest on the highest.
"""

from __future__ import annotations

import email
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from email.message import Message
from pathlib import Path
from zipfile import ZipFile

import pytest

ROOT = Path(__file__).resolve().parents[2]
SETTINGS = ('PIP_', 'UV_', 'SSL_', 'HTTP', 'http', 'NO_PROXY', 'no_proxy')
PYTHONS = {'lowest-direct': '3.10', 'highest': '3.13'}
UV = Path(sys.prefix) / 'bin' / 'uv'
SOURCES = {
    'rpo_core': ROOT / 'ros_ws' / 'src' / 'rpo_core',
    'rpo_log': ROOT / 'ros_ws' / 'src' / 'rpo_log',
    'rpo': ROOT / 'offline_training',
}
CORE = """
from rpo_core.chain.flight import fly
from rpo_core.control.controller import load_controller
from rpo_core.scenario.scenario import load_scenario

print(fly(load_scenario('approach'), load_controller('allround')).forces_n.max())
"""
USER = """
import numpy as np

import rpo

law = rpo.controller('allround').with_rule(position='SP', velocity='Z', force='LP')
flight = rpo.fly('paper_test', law, mass_kg=12.0)
print(flight.ok, flight.t[-1], flight.x[-1, :3], law(position=np.linspace(-1, 1, 3), velocity=0.0))
other = rpo.fly('quick', lambda t, x: -0.01 * x[:3] - 0.2 * x[3:])
print(other.metrics, rpo.scenarios()['quick'])
reveal_type(rpo.fly('quick'))
reveal_type(flight.x)
"""
pytestmark = pytest.mark.slow


def run(*words: object, cwd: Path, code: int = 0) -> str:
    """Run a program with nothing of this checkout in its environment; return what it prints."""
    kept = {key: value for key, value in os.environ.items() if key.startswith(SETTINGS)}
    # Where pyenv is, its names of interpreters answer if they are chosen.
    chosen = {'PYENV_VERSION': ':'.join(PYTHONS.values())}
    env = {**kept, **chosen, 'PATH': os.environ['PATH'], 'HOME': os.environ['HOME']}
    done = subprocess.run([*map(str, words)], cwd=cwd, env=env, capture_output=True, text=True)
    assert done.returncode == code, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope='module')
def wheels() -> dict[str, Path]:
    """Return name -> wheel; the builds warn of nothing."""
    built = subprocess.run(['make', '-s', 'wheels'], cwd=ROOT, capture_output=True, text=True)
    assert built.returncode == 0 and 'arning' not in built.stdout + built.stderr, built
    return {path.name.partition('-')[0]: path for path in (ROOT / 'dist').glob('*.whl')}


def metadata(wheel: Path) -> Message:
    with ZipFile(wheel) as archive:
        name = next(name for name in archive.namelist() if name.endswith('.dist-info/METADATA'))
        return email.message_from_bytes(archive.read(name))


def requirements(wheels: dict[str, Path]) -> Iterator[str]:
    """Return what the wheels need of others, with all extras, without conditions."""
    for path in wheels.values():
        for line in metadata(path).get_all('Requires-Dist'):
            requirement, _, extra = line.partition('; extra == ')
            if not requirement.startswith('rpo_') and 'test' not in extra:
                assert re.search('[=<>]', requirement), f'{requirement} of {path.name} has no bound'
                yield requirement


def test_a_wheel_is_one_package_with_all_that_it_says(wheels):
    assert wheels.keys() == SOURCES.keys()
    for name, path in wheels.items():
        said = metadata(path)
        assert said['License-Expression'] == 'Apache-2.0' and said['License-File'] == 'LICENSE'
        assert said['Requires-Python'] == '>=3.10' and said['Description-Content-Type']
        assert said['Summary'] and len(said.get_all('Project-URL')) == 3
        assert 'Typing :: Typed' in said.get_all('Classifier')
        assert said.get_payload().startswith('# ')
        with ZipFile(path) as archive:
            files = {x for x in archive.namelist() if '.dist-info/' not in x}
        listed = subprocess.run(
            ['git', 'ls-files', name], cwd=SOURCES[name], capture_output=True, text=True
        )
        assert files == set(listed.stdout.split()) and f'{name}/py.typed' in files


@pytest.mark.timeout(900)
@pytest.mark.parametrize('resolution', PYTHONS)
def test_the_wheels_fly_judge_and_train_without_ros(resolution, wheels, tmp_path):
    found = subprocess.run(
        [UV, 'python', 'find', PYTHONS[resolution]],
        env={**os.environ, 'PYENV_VERSION': ':'.join(PYTHONS.values())},
        capture_output=True,
        text=True,
    )
    if found.returncode:
        pytest.skip(f'this machine has no Python {PYTHONS[resolution]}')
    run(UV, 'venv', '-q', '--python', found.stdout.strip(), tmp_path / 'env', cwd=tmp_path)
    bin_, python = tmp_path / 'env' / 'bin', tmp_path / 'env' / 'bin' / 'python'
    install = (UV, 'pip', 'install', '-q', '--python', python, '--resolution', resolution)

    run(*install, wheels['rpo_core'], cwd=tmp_path)
    assert '0.228' in run(python, '-c', CORE, cwd=tmp_path)

    run(*install, *wheels.values(), cwd=tmp_path)
    user = USER.replace('reveal_type', 'print')
    assert run(python, '-c', user, cwd=tmp_path).count('\n') >= 4
    (tmp_path / 'user.py').write_text(USER)
    types = run(
        UV,
        'run',
        '-q',
        '--no-project',
        '--with',
        'mypy',
        '--python',
        sys.executable,
        'mypy',
        '--strict',
        '--python-executable',
        python,
        'user.py',
        cwd=tmp_path,
    )
    assert types.count('Revealed type') == 2 and 'Any"' not in types.replace('[Any', ''), types
    assert 'paper_test_measured' in run(bin_ / 'rpo', 'list', cwd=tmp_path)
    run(bin_ / 'rpo', 'simulate', 'quick', cwd=tmp_path)

    run(*install, *wheels.values(), *requirements(wheels), cwd=tmp_path)
    spec = 'import importlib.util; print(importlib.util.find_spec("rclpy"))'
    assert run(python, '-c', spec, cwd=tmp_path) == 'None\n'
    run(bin_ / 'rpo', 'simulate', 'approach', '--output', 'flown', cwd=tmp_path)
    assert 'verified, 4001 ticks' in run(bin_ / 'rpo', 'verify', 'flown', cwd=tmp_path)
    assert 'report.html' in run(bin_ / 'rpo', 'report', 'flown', cwd=tmp_path)
    assert 'allround.c' in run(bin_ / 'rpo', 'export', 'allround', '--to', 'c', cwd=tmp_path)
    assert ' / 40 ' in run(bin_ / 'rpo', 'campaign', 'random_starts', '--runs', 40, cwd=tmp_path)
    assert 'under all conditions' in run(bin_ / 'rpo', 'optimal', 'paper_test', cwd=tmp_path)
    gym = 'import rpo; rpo.FinalApproach("quick").reset(seed=1)'
    run(python, '-c', gym, cwd=tmp_path)
    few = ('--set', 'ga.generations=2', '--set', 'cmaes.evaluations=40', '--no-fail')
    words = ('--algorithm', 'ga-cmaes', *few, '--output', 'trained')
    assert 'trained.yaml' in run(bin_ / 'rpo', 'train', *words, cwd=tmp_path)
