# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Compiled kernels follow every edit of the sources: of another module's kernel, constant, type."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import rpo_core
import rpo_guidance
import rpo_judge
import rpo_montecarlo
import rpo_nav
import rpo_safety

pytestmark = pytest.mark.timeout(300)  # compiling on a busy machine

LOW = """
from typing import NamedTuple
from rpo_core.kernels.jit import kernel

GAIN = 2.0

class Pair(NamedTuple):
    left: float
    right: float

@kernel
def signed(x):
    return +x
"""
MIDDLE = """
from small.low import GAIN, signed
from rpo_core.kernels.jit import kernel

@kernel
def step(x, pair):
    return GAIN * signed(x) + 100.0 * pair.left
"""
TOP = """
from small import low, middle
from rpo_core.kernels.jit import kernel

@kernel
def twice(x):
    return 2.0 * middle.step(x, low.Pair(x, 10.0 * x))

print(twice(1.0), sum(twice.stats.cache_hits.values()))
"""


def run(folder: Path, code: str, **environment: str) -> str:
    done = subprocess.run(
        [sys.executable, '-c', code],
        cwd=folder,
        env={**os.environ, 'RPO_JIT': '1', **environment},
        capture_output=True,
        text=True,
        timeout=280,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout.strip()


@pytest.fixture
def modules(tmp_path):
    folder = tmp_path / 'small'
    folder.mkdir()
    for name, text in (('__init__', ''), ('low', LOW), ('middle', MIDDLE), ('top', TOP)):
        (folder / f'{name}.py').write_text(text)
    return folder


def edit(path: Path, old: str, new: str) -> None:
    text = path.read_text()
    assert text.count(old) == 1
    before = path.stat().st_mtime
    path.write_text(text.replace(old, new))
    os.utime(path, (before + 2.0, before + 2.0))  # Python's bytecode is new from the next second on


def test_an_edit_of_another_module_reaches_what_was_compiled_from_it(modules):
    assert run(modules.parent, 'import small.top') == '204.0 0'
    assert run(modules.parent, 'import small.top') == '204.0 1'
    edit(modules / 'low.py', 'return +x', 'return -x')
    assert run(modules.parent, 'import small.top') == '196.0 0'
    edit(modules / 'low.py', 'GAIN = 2.0', 'GAIN = 3.0')
    assert run(modules.parent, 'import small.top') == '194.0 0'
    edit(modules / 'low.py', 'left: float\n    right: float', 'right: float\n    left: float')
    assert run(modules.parent, 'import small.top') == '1994.0 0'
    edit(modules / 'low.py', 'right: float\n    left: float', 'left: float\n    right: float')
    assert run(modules.parent, 'import small.top') == '194.0 1'  # seen before, and kept


def test_a_package_without_init_has_its_kernels_compiled_too(modules):
    (modules / '__init__.py').unlink()
    assert run(modules.parent, 'import small.top') == '204.0 0'
    edit(modules / 'low.py', 'return +x', 'return -x')
    assert run(modules.parent, 'import small.top') == '196.0 0'


def test_old_states_do_not_pile_up(modules):
    for gain in range(5):
        (modules / 'low.py').write_text(LOW.replace('GAIN = 2.0', f'GAIN = {gain}.0'))
        run(modules.parent, 'import small.middle')
    assert len(list((modules / '__pycache__').glob('middle-*'))) == 3


def test_where_the_sources_cannot_be_written_the_cache_is_the_users(modules):
    moved = 'import small.top' if os.getuid() else UNWRITABLE
    assert run(modules.parent, moved, XDG_CACHE_HOME=str(modules.parent / 'home')) == '204.0 0'
    assert run(modules.parent, moved, XDG_CACHE_HOME=str(modules.parent / 'home')) == '204.0 1'
    assert list((modules.parent / 'home/rpo/kernels/small').glob('top-*'))
    assert not list((modules / '__pycache__').glob('top-*'))


# Root may write anywhere: the question is answered for it.
UNWRITABLE = """
import os
asked = os.access
os.access = lambda path, mode: 'home' in str(path) and asked(path, mode)
import small.top
"""

FLOWN = """
import numpy as np
from rpo_core.control.controller import load_fuzzy
from rpo_core.chain.flight import fly
from rpo_core.files.scenario import load_set
from rpo_montecarlo.engine.flights import flights_of
found = load_set('least_energy_starts')
controller = load_fuzzy('handmade')
member = found.scenarios()[0]
print(fly(member, controller).states[-1].tobytes().hex())
print(next(flights_of(controller, found)).states[-1].tobytes().hex())
"""


@pytest.mark.slow
def test_a_flipped_sign_of_the_plant_changes_the_chain_and_the_engine(tmp_path):
    for package in (rpo_core, rpo_nav, rpo_guidance, rpo_safety, rpo_judge, rpo_montecarlo):
        source = Path(package.__file__).parent
        shutil.copytree(
            source, tmp_path / source.name, ignore=shutil.ignore_patterns('__pycache__')
        )
    first = run(tmp_path, FLOWN).split()
    assert first[0] == first[1]
    kernels = tmp_path / 'rpo_core' / 'kernels' / '__init__.py'
    edit(kernels, 'c.zz * z + c.zvz * vz + c.zfz', 'c.zz * z - c.zvz * vz + c.zfz')
    edit(kernels, 'c.xx * x + c.xvx * vx + c.xvy', 'c.xx * x - c.xvx * vx + c.xvy')
    second = run(tmp_path, FLOWN).split()
    assert second[0] == second[1] != first[0]
