# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Compiled kernels follow every edit of the sources; a damaged or missing cache changes nothing."""

from __future__ import annotations

import importlib
import os
import pkgutil
import shutil
import subprocess
import sys
from pathlib import Path

import numba
import pytest

import rpo
import rpo_core
from rpo.cli.commands.simulate import FIRST_FLIGHT, LONG_TICKS
from rpo_core.kernels import compile_cache, numba_records
from rpo_core.kernels.jit import inlined, kernel

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
from rpo_small.low import GAIN, signed
from rpo_core.kernels.jit import kernel

@kernel
def step(x, pair):
    return GAIN * signed(x) + 100.0 * pair.left
"""
TOP = """
import sys
from rpo_small import low, middle
from rpo_core.kernels.jit import kernel

@kernel
def twice(x):
    return 2.0 * middle.step(x, low.Pair(x, 10.0 * x))

line = f'{twice(1.0)} {sum(twice.stats.cache_hits.values())}\\n'
sys.stdout.write(line)  # at once: other processes write too
"""


FORKS = """
import os, sys, numba
from rpo_core.kernels import compile_cache
numba.njit(lambda x: x)(1.0)  # what every process would do first
for line in sys.stdin:
    count, folder = line.split()
    children = []
    for _ in range(int(count)):
        children.append(os.fork())
        if not children[-1]:
            sys.path.insert(0, folder)
            import rpo_small.top
            sys.exit()
    if any([os.waitpid(child, 0)[1] for child in children]):
        print('failed', flush=True)
"""


@pytest.fixture
def imported(tmp_path):
    """Yield a function that imports `rpo_small.top` from a folder, in new processes at once.

    It returns what each printed: the result, and whether it came from the cache.
    """
    env = {**os.environ, 'RPO_JIT': '1', 'XDG_CACHE_HOME': str(tmp_path / 'home')}
    pipes = {'stdin': subprocess.PIPE, 'stdout': subprocess.PIPE}
    with subprocess.Popen([sys.executable, '-c', FORKS], env=env, text=True, **pipes) as process:

        def imported(folder: Path, processes: int = 1) -> list[str]:
            process.stdin.write(f'{processes} {folder}\n')
            process.stdin.flush()
            return sorted(process.stdout.readline().strip() for _ in range(processes))

        yield imported
        process.stdin.close()


def write_small(folder: Path) -> Path:
    """Write the package `rpo_small`, whose kernels call those of other modules."""
    modules = folder / 'rpo_small'
    modules.mkdir(parents=True)
    for name, text in (('__init__', ''), ('low', LOW), ('middle', MIDDLE), ('top', TOP)):
        (modules / f'{name}.py').write_text(text)
    return modules


def edit(path: Path, old: str, new: str) -> None:
    text = path.read_text()
    assert text.count(old) == 1
    before = path.stat().st_mtime
    path.write_text(text.replace(old, new))
    os.utime(path, (before + 2.0, before + 2.0))  # Python's bytecode is new from the next second on


@pytest.mark.every_landing
def test_an_edit_of_another_module_reaches_what_was_compiled_from_it(tmp_path, imported):
    modules = write_small(tmp_path / 'first')
    low = modules / 'low.py'
    assert imported(modules.parent, processes=2) == ['204.0 0', '204.0 1']  # one has compiled it
    edit(low, 'return +x', 'return -x')
    assert imported(modules.parent) == ['196.0 0']
    edit(low, 'GAIN = 2.0', 'GAIN = 3.0')
    edit(low, 'left: float\n    right: float', 'right: float\n    left: float')
    assert imported(modules.parent) == ['1994.0 0']
    edit(low, 'GAIN = 3.0', 'GAIN = 2.0')
    edit(low, 'right: float\n    left: float', 'left: float\n    right: float')
    assert imported(modules.parent) == ['196.0 1']  # seen before, and kept
    shutil.copytree(modules, tmp_path / 'second/rpo_small')
    assert imported(tmp_path / 'second') == ['196.0 1']  # another checkout of the same sources
    for path in (tmp_path / 'home').rglob('rpo_small*'):
        path.write_bytes(path.read_bytes()[:-9] + bytes(9))
    assert imported(modules.parent, processes=3) == ['196.0 0', '196.0 1', '196.0 1']


TWO_STAGES = """
from dataclasses import dataclass
from rpo_core.kernels.jit import step_kernel

@dataclass(slots=True)
class Settings:
    gain: float

@dataclass(slots=True)
class Memory:
    last: float

@step_kernel
def first(tick, u, p, m, y):
    m.last = y[0] = p.gain * u[0]

@step_kernel
def second(tick, u, p, m, y):
    y[0] = m.last
"""


def test_another_process_compiles_the_stages_that_nobody_claimed(tmp_path):
    modules, claims = write_small(tmp_path), tmp_path / 'claims'
    (modules / 'stages.py').write_text(TWO_STAGES)
    claims.mkdir()
    (claims / '0').touch()
    stages = 'rpo_small.stages:{} rpo_small.stages:Settings rpo_small.stages:Memory'
    path = os.pathsep.join((str(tmp_path), os.environ.get('PYTHONPATH', '')))
    env = {**os.environ, 'PYTHONPATH': path, 'XDG_CACHE_HOME': str(tmp_path / 'home')}
    words = [sys.executable, '-c', numba_records.COMPILE_NAMED, str(claims)]
    subprocess.run([*words, stages.format('first'), stages.format('second')], env=env, check=True)
    compiled = {path.name.partition('-')[0] for path in (tmp_path / 'home').rglob('rpo_small*')}
    assert compiled == {'rpo_small.stages.second'}


@pytest.mark.every_landing
def test_the_first_flight_compiles_nothing_unless_it_is_long(tmp_path):
    env = {name: value for name, value in os.environ.items() if name != 'RPO_JIT'}
    env['XDG_CACHE_HOME'] = str(tmp_path)

    def flown(*words: str) -> tuple[str, str]:
        command = ['rpo', 'simulate', 'quick', *words]
        process = subprocess.run(command, env=env, capture_output=True, text=True, check=True)
        return process.stdout, process.stderr

    table, sentence = flown()
    assert ' '.join(sentence.split()) == FIRST_FLIGHT
    (folder,) = (tmp_path / 'rpo/compiled').iterdir()
    folder.rmdir()  # it is empty
    assert flown('--set', f'duration_s={LONG_TICKS}')[1] == ''
    assert any(folder.iterdir())
    assert flown() == (table, '')


def test_the_digest_has_the_kernels_and_tuples_of_all_packages(tmp_path, monkeypatch):
    modules = write_small(tmp_path)
    (modules / 'tuples.py').write_text('NamedTuple')
    (modules / 'other.py').write_text('')
    monkeypatch.syspath_prepend(str(tmp_path))
    digest = compile_cache._digest.__wrapped__
    digests = [digest()]
    for name in ('low', 'top', 'tuples', 'other'):
        with (modules / f'{name}.py').open('a') as file:
            file.write('# edited\n')
        digests.append(digest())
    assert len(set(digests[:-1])) == 4 and digests[-1] == digests[-2]


def test_the_source_of_every_kernel_is_in_the_digest():
    """Else an edit of it flies the machine code from before."""
    packages = [(f'{package.__name__}.', package.__path__) for package in (rpo, rpo_core)]
    names = [m.name for name, path in packages for m in pkgutil.walk_packages(path, name)]
    values = [value for name in names for value in vars(importlib.import_module(name)).values()]
    kernels = [value.py_func for value in values if isinstance(value, compile_cache.Kernel)]
    ours = {Path(kernel.__code__.co_filename) for kernel in kernels}
    assert len(ours) > 30
    assert all(compile_cache._USED.search(source.read_bytes()) for source in ours)


def plus(x: float) -> float:
    return x + 1.0


@pytest.fixture
def home(tmp_path, monkeypatch):
    """Return the folder of the kernels of this module."""
    monkeypatch.setattr(compile_cache, '_is_of_the_digest', lambda _module: True)
    monkeypatch.setattr(compile_cache, 'folder', lambda: tmp_path / 'rpo' / 'x')
    compile_cache._say_once.cache_clear()
    return tmp_path / 'rpo' / 'x'


def is_loaded() -> bool:
    """Return whether a kernel, which a new process calls, is loaded; it must be right."""
    made = kernel(plus)
    assert made(2.0) == 3.0
    return bool(sum(made.stats.cache_hits.values()))


def damaged(content: bytes, how: str) -> bytes:
    """Return the content of an entry, damaged."""
    half = len(content) // 2
    flipped = {'a bit of the code': half, 'a bit of the digest': 3, 'its last bit': -1}
    if how in flipped:
        changed = bytearray(content)
        changed[flipped[how]] ^= 1
        return bytes(changed)
    return {'cut': content[:half], 'empty': b'', 'longer': content + b'\0'}[how]


def test_a_damaged_entry_is_compiled_again(home):
    """A flipped bit ended every command, and made `rpo verify` of a good log exit 1."""
    assert not is_loaded() and is_loaded()
    (entry,) = (path for path in home.iterdir() if path.suffix != '.lock')
    content = entry.read_bytes()
    for how in ('a bit of the code', 'a bit of the digest', 'its last bit', 'cut', 'empty'):
        entry.write_bytes(damaged(content, how))
        assert not is_loaded(), how
    entry.write_bytes(damaged(content, 'longer'))
    assert not is_loaded() and is_loaded()
    kernel(plus)(1)
    (other,) = (path for path in home.iterdir() if path.suffix not in ('.lock', entry.suffix))
    shutil.copy(other, entry)  # whole, but of other types
    assert not is_loaded() and is_loaded()


def test_a_folder_that_vanishes_or_cannot_be_written_stops_nothing(home, capsys):
    assert not is_loaded()
    shutil.rmtree(home.parent)
    assert not is_loaded() and is_loaded()
    shutil.rmtree(home.parent)
    home.parent.write_text('')
    assert not is_loaded() and not is_loaded()
    assert capsys.readouterr().err == f'{home}: cannot keep compiled code: Not a directory\n'


def test_states_that_were_not_used_for_long_do_not_pile_up(tmp_path, monkeypatch):
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path))
    monkeypatch.setattr(compile_cache, 'KEPT', 3)

    def folder(state: str) -> Path:
        monkeypatch.setattr(compile_cache, '_digest', lambda: state)
        return compile_cache.folder.__wrapped__()

    for age, state in enumerate('abc'):
        os.utime(folder(state), (age, age))
    assert folder('a').is_dir()
    folder('d')
    assert {path.name for path in (tmp_path / 'rpo/compiled').iterdir()} == {'a', 'c', 'd'}
    monkeypatch.setenv('XDG_CACHE_HOME', '/proc/none')
    assert not folder('a').exists()


@inlined
def moved(x: int, by: int) -> int:
    return x + by


def test_a_kernel_is_compiled_once_for_all_constants():
    """numba would compile it for each."""
    moved_twice = numba.njit(lambda x: moved(x, 1) + moved(x, by=2))
    assert moved_twice(5) == 13 and moved(5, by=2) == 7 == moved(5, 2)
    assert len(moved.inner.signatures) == 1
