# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Compiled kernels follow every edit of the sources: of another module's kernel, constant, type."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numba
import numpy as np
import pytest
from numba.core.errors import TypingError
from numba.core.types import Float, Integer
from numba.extending import overload

import rpo_core
import rpo_guidance
import rpo_judge
import rpo_kernels
import rpo_montecarlo
import rpo_nav
import rpo_safety
from rpo_kernels import compile_cache
from rpo_kernels.jit import inlined

LOW = """
from typing import NamedTuple
from rpo_kernels.jit import kernel

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
from rpo_kernels.jit import kernel

@kernel
def step(x, pair):
    return GAIN * signed(x) + 100.0 * pair.left
"""
TOP = """
from small import low, middle
from rpo_kernels.jit import kernel

@kernel
def twice(x):
    return 2.0 * middle.step(x, low.Pair(x, 10.0 * x))

print(twice(1.0), sum(twice.stats.cache_hits.values()))
"""


FORKS = """
import os, sys
from rpo_kernels.jit import kernel
kernel(lambda x: x)(1.0)  # what every process would do first
for line in sys.stdin:
    count, folder = line.split()
    children = []
    for _ in range(int(count)):
        children.append(os.fork())
        if not children[-1]:
            sys.path.insert(0, folder)
            import small.top
            sys.exit()
    if any([os.waitpid(child, 0)[1] for child in children]):
        print('failed', flush=True)
"""


@pytest.fixture
def imported(tmp_path):
    """Yield a function that imports `small.top` from a folder, in new processes at once.

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


def edit(path: Path, old: str, new: str) -> None:
    text = path.read_text()
    assert text.count(old) == 1
    before = path.stat().st_mtime
    path.write_text(text.replace(old, new))
    os.utime(path, (before + 2.0, before + 2.0))  # Python's bytecode is new from the next second on


@pytest.mark.slow
def test_an_edit_of_another_module_reaches_what_was_compiled_from_it(tmp_path, imported):
    modules = tmp_path / 'first/small'
    modules.mkdir(parents=True)
    for name, text in (('__init__', ''), ('low', LOW), ('middle', MIDDLE), ('top', TOP)):
        (modules / f'{name}.py').write_text(text)
    low = modules / 'low.py'
    assert imported(modules.parent, processes=2) == ['204.0 0', '204.0 1']  # one has compiled it
    edit(low, 'return +x', 'return -x')
    assert imported(modules.parent) == ['196.0 0']
    (modules / '__init__.py').unlink()
    edit(low, 'GAIN = 2.0', 'GAIN = 3.0')
    edit(low, 'left: float\n    right: float', 'right: float\n    left: float')
    assert imported(modules.parent) == ['1994.0 0']
    edit(low, 'GAIN = 3.0', 'GAIN = 2.0')
    edit(low, 'right: float\n    left: float', 'left: float\n    right: float')
    assert imported(modules.parent) == ['196.0 1']  # seen before, and kept
    shutil.copytree(modules, tmp_path / 'second/small')
    assert imported(tmp_path / 'second') == ['196.0 1']  # another checkout of the same sources


def damaged(content: bytes, how: str) -> bytes:
    """Return the content of an entry, damaged."""
    half = len(content) // 2
    flipped = {'a bit of the code': half, 'a bit of the digest': 3, 'its last bit': -1}
    if how in flipped:
        changed = bytearray(content)
        changed[flipped[how]] ^= 1
        return bytes(changed)
    return {'cut': content[:half], 'empty': b'', 'longer': content + b'\0'}[how]


DAMAGES = ('a bit of the code', 'a bit of the digest', 'its last bit', 'cut', 'empty', 'longer')


@pytest.mark.every_landing
def test_damaged_entries_are_compiled_again_and_a_folder_may_vanish(tmp_path, imported):
    """A flipped bit ended every command, and made `rpo verify` of a good log exit 1."""
    modules, home = tmp_path / 'first/small', tmp_path / 'home'
    modules.mkdir(parents=True)
    for name, text in (('__init__', ''), ('low', LOW), ('middle', MIDDLE), ('top', TOP)):
        (modules / f'{name}.py').write_text(text)
    assert imported(modules.parent) == ['204.0 0']
    for how in DAMAGES:
        entries = [path for path in home.rglob('*.compiled') if 'small' in str(path)]
        assert len(entries) == 3
        for path in entries:
            path.write_bytes(damaged(path.read_bytes(), how))
        assert imported(modules.parent) == ['204.0 0'], how
    assert imported(modules.parent) == ['204.0 1']
    swapped = [path.read_bytes() for path in reversed(entries)]
    for path, content in zip(entries, swapped, strict=True):
        path.write_bytes(content)
    assert imported(modules.parent, processes=2) == ['204.0 0', '204.0 1']
    shutil.rmtree(home)
    assert imported(modules.parent) == ['204.0 0']


@pytest.mark.parametrize('how', DAMAGES)
def test_an_entry_that_does_not_fit_is_removed(tmp_path, how):
    entries, key = compile_cache.Entries(tmp_path, 'f-1'), ('int64', 'x86')
    entries.save(key, 'code')
    assert entries.load(key) == 'code' and entries.load(('float64', 'x86')) is None
    (path,) = tmp_path.iterdir()
    path.write_bytes(damaged(path.read_bytes(), how))
    assert entries.load(key) is None and not path.exists()


def test_an_entry_is_of_one_function_and_of_one_key(tmp_path):
    first, second = (compile_cache.Entries(tmp_path, name) for name in ('f-1', 'g-2'))
    first.save('key', 'code')
    (path,) = tmp_path.iterdir()
    shutil.copy(path, second._path('key'))
    assert second.load('key') is None and first.load('key') == 'code'
    same_name = SimpleNamespace(__class__=str)
    first._path = lambda key: path  # keys whose texts are equal
    assert first.load(same_name) is None


def test_a_folder_that_vanishes_is_made_again_or_named_in_one_sentence(tmp_path, capsys):
    folder = tmp_path / 'home/kernels'
    entries = compile_cache.Entries(folder, 'f-1')
    assert entries.load('key') is None
    entries.save('key', 'code')
    shutil.rmtree(tmp_path / 'home')
    with compile_cache.alone(folder / 'f.lock'):
        shutil.rmtree(tmp_path / 'home')
        entries.save('key', 'code')
    assert entries.load('key') == 'code'
    shutil.rmtree(tmp_path / 'home')
    (tmp_path / 'home').write_text('')
    with compile_cache.alone(folder / 'f.lock'):
        for key in ('key', 'key', 'other'):
            entries.save(key, 'code')
            assert entries.load(key) is None
    sentence = f'{folder}: cannot keep compiled code: Not a directory\n'
    assert capsys.readouterr() == ('', sentence)


@pytest.fixture
def digest(tmp_path, monkeypatch):
    """Return a function that returns the digest of a module that uses one with some source."""
    top, low = ModuleType('top'), ModuleType('low')
    for module in (top, low):
        monkeypatch.setitem(sys.modules, module.__name__, module)
        module.__file__ = str(tmp_path / f'{module.__name__}.py')
        Path(module.__file__).write_text('jit')

    def digest(source: str, **names: object) -> str:
        Path(low.__file__).write_text(source)
        vars(top).update(names)
        compile_cache.digest.cache_clear()
        compile_cache._sources.cache_clear()
        return compile_cache.digest('top')

    yield digest
    compile_cache.digest.cache_clear()
    compile_cache._sources.cache_clear()


def test_a_digest_has_what_compiled_code_depends_on(digest):
    """Sources of the modules whose kernels or tuples it uses, and the values of constants."""
    kernel = SimpleNamespace(py_func=None, __module__='low')
    pair = type('Pair', (tuple,), {'_fields': ('x', 'y'), '__module__': 'low'})
    whole = sys.modules['low']
    whole.kernel = kernel
    for used in (kernel, pair, whole):
        assert digest('jit 1', used=used) == digest('jit 1') != digest('jit 2')
        assert digest('of 1') == digest('of 2')  # there is nothing to compile in it
    other = SimpleNamespace(__module__='low')
    assert digest('jit 1', used=other) == digest('jit 2')
    for one, two in ((1, 2), (0.5, -0.5), ((1, 'a'), (1, 'b')), (np.zeros(2), np.zeros((2, 1)))):
        assert digest('', used=one) == digest('', used=one) != digest('', used=two)


def test_every_source_with_kernels_is_in_the_digest():
    """Else an edit of it flies the machine code from before."""
    root, kernel = Path(__file__).parents[2], re.compile(rb'^@(kernel|inlined|compiled|jit)', re.M)
    paths = {
        *root.glob('ros_ws/src/rpo_*/rpo_*/**/*.py'),
        *root.glob('offline_training/rpo_*/**/*.py'),
    }
    sources = [content for path in paths if kernel.search(content := path.read_bytes())]
    assert len(sources) > 40
    assert all(any(mark in content for mark in compile_cache.MARKS) for content in sources)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Return a function that asks for the folder of a module in some state of its sources."""
    module = ModuleType('mine')
    module.__file__ = str(tmp_path / 'sources/mine.py')
    monkeypatch.setitem(sys.modules, 'mine', module)
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path / 'home'))

    def folder(state: str = 'x') -> Path | None:
        monkeypatch.setattr(compile_cache, 'digest', lambda name: state)
        return compile_cache.folder_for.__wrapped__('mine')

    return folder


def test_states_that_were_not_used_for_long_do_not_pile_up(tmp_path, folder, monkeypatch):
    monkeypatch.setattr(compile_cache, 'KEPT', 3)
    for age, state in enumerate('abc'):
        os.utime(folder(state), (age, age))
    assert folder('a').is_dir()
    folder('d')
    kept = {path.name for path in (tmp_path / 'home/rpo/kernels').iterdir()}
    assert kept == {'mine-a', 'mine-c', 'mine-d'}


def test_where_the_users_cache_cannot_be_written_it_is_beside_the_sources(
    tmp_path, folder, monkeypatch
):
    monkeypatch.setenv('XDG_CACHE_HOME', '/dev/null')
    assert folder() == tmp_path / 'sources/__pycache__/mine-x'
    monkeypatch.setattr(os, 'access', lambda path, mode: False)
    assert folder() is None


def run(folder: Path, code: str) -> str:
    done = subprocess.run(
        [sys.executable, '-c', code],
        cwd=folder,
        env={**os.environ, 'RPO_JIT': '1', 'XDG_CACHE_HOME': str(folder / 'home')},
        capture_output=True,
        text=True,
        timeout=280,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout.strip()


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
    folders = (rpo_core, rpo_kernels, rpo_nav, rpo_guidance, rpo_safety, rpo_judge, rpo_montecarlo)
    for package in folders:
        source = Path(package.__file__).parent
        shutil.copytree(
            source, tmp_path / source.name, ignore=shutil.ignore_patterns('__pycache__')
        )
    first = run(tmp_path, FLOWN).split()
    assert first[0] == first[1]
    kernels = tmp_path / 'rpo_kernels' / 'kernels.py'
    edit(kernels, 'c.zz * z + c.zvz * vz + c.zfz', 'c.zz * z - c.zvz * vz + c.zfz')
    edit(kernels, 'c.xx * x + c.xvx * vx + c.xvy', 'c.xx * x - c.xvx * vx + c.xvy')
    second = run(tmp_path, FLOWN).split()
    assert second[0] == second[1] != first[0]


@inlined
def moved(x: int, by: int) -> int:
    return x + by


def test_a_kernel_is_compiled_once_for_all_constants_and_python_calls_it_too():
    """numba would compile it for each constant; what kernels call alone has no wrapper."""
    moved_twice = numba.njit(lambda x: moved(x, 1) + moved(x, by=2))
    assert moved_twice(5) == 13
    assert (len(moved.inside().signatures), len(moved.signatures)) == (1, 0)
    assert moved(5, by=2) == 7 == moved(5, 2)
    assert numba.njit(lambda x: moved(x, 3))(5) == 8, 'that of Python serves kernels too'
    assert (len(moved.inside().signatures), len(moved.signatures)) == (1, 1)


def test_what_numba_is_taught_later_is_not_hidden_by_what_it_remembers():
    def kind(value):
        raise NotImplementedError

    def called(value):
        return kind(value)

    compiled = numba.njit  # without a cache: what another process compiled would be found
    overload(kind)(lambda value: (lambda value: 1) if isinstance(value, Integer) else None)
    assert compiled(called)(1) == 1
    with pytest.raises(TypingError):
        compiled(called)(1.0)
    overload(kind)(lambda value: (lambda value: 2) if isinstance(value, Float) else None)
    assert (compiled(called)(1.0), compiled(called)(1)) == (2, 1)
