# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Where compiled kernels are kept: a folder for each state of the sources they were made from.

numba looks only at the file that defines a function. A kernel that calls another one has the other
one's machine code inside it, so numba alone would run the old code after an edit of the other file.
Here the folder is named by a digest of the compiler, of the constants of the module, and of all
sources with kernels or types of tuples in its package and in the packages whose kernels it uses.
numba adds the version of Python, the processor and the types of the arguments. No path is part of
the name, so all checkouts of a user share the folders, and a second one compiles nothing.

Each entry begins with its digest: machine code with a flipped bit would end the process, or compute
something else. One that does not fit is removed, and compiled again.
"""

from __future__ import annotations

import fcntl
import hashlib
import os
import pickle
import shutil
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import cache
from importlib.metadata import version
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

KEPT = 10
"""States of one module that are kept: edits, branches and checkouts come and go."""

_FROZEN = (bool, int, float, complex, str, bytes, tuple, np.generic)
"""Types of global names whose value a compiled function contains."""

MARKS = (b'jit', b'@compiled', b'NamedTuple', b'namedtuple')
"""A source with kernels, or with types of tuples, has one of these words."""


class Locator:
    """Tells numba where to keep what it compiles of a function: its `CACHE_LOCATOR_CLASSES`."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self._module = function.__module__
        self._line = function.__code__.co_firstlineno

    @classmethod
    def from_function(cls, function: Callable[..., Any], _file: str) -> Locator:
        """Return the locator of a function."""
        return cls(function)

    def get_cache_path(self) -> str:
        """Return the folder of its module."""
        return str(folder_for(self._module))

    def ensure_cache_path(self) -> None:
        """Leave it to `Entries` to make that folder."""

    def get_source_stamp(self) -> str:
        """Return what changes with the sources."""
        return digest(self._module)

    def get_disambiguator(self) -> str:
        """Return what differs between functions of one name."""
        return str(self._line)


class InsideLocator(Locator):
    """The same for what other kernels call, which has no wrapper for Python."""

    def get_disambiguator(self) -> str:
        """Return what differs between functions of one name."""
        return f'{self._line}-inside'


class Entries:
    """The compiled code of one function, a file for each types of its arguments.

    It stands in the place of numba's own files, which are believed whatever is in them.

    name : of the function, as numba makes it of its place in the source and the version of Python
    """

    def __init__(self, folder: Path, name: str) -> None:
        self._folder, self._name = folder, name

    def load(self, key: Any) -> Any:
        """Return what was saved under a key, None if there is nothing, or nothing that fits."""
        path = self._path(key)
        try:
            content = path.read_bytes()
            digest, body = content[:_DIGEST], content[_DIGEST:]
            if digest == self._digest(path, body):
                saved_key, found = pickle.loads(body)
                return found if saved_key == key else None
            path.unlink()
        except OSError:  # there is none, or another process has removed it
            pass
        return None

    def save(self, key: Any, found: Any) -> None:
        """Keep what was compiled; where that cannot be done, say so, once."""
        from numba.core.serialize import dumps

        path, body = self._path(key), dumps((key, found))
        aside = path.with_suffix(f'.{os.getpid()}-{threading.get_ident()}')
        try:
            self._folder.mkdir(parents=True, exist_ok=True)  # another process may have removed it
            try:
                aside.write_bytes(self._digest(path, body) + body)
                aside.replace(path)
            finally:
                aside.unlink(missing_ok=True)
        except OSError as error:
            _say_once(f'{self._folder}: cannot keep compiled code: {error.strerror or error}')

    def flush(self) -> None:
        """Remove nothing: what the sources do not make any more is in another folder."""

    def _path(self, key: Any) -> Path:
        types = hashlib.sha256(repr(key).encode()).hexdigest()[:20]
        return self._folder / f'{self._name}.{types}.compiled'

    @staticmethod
    def _digest(path: Path, body: bytes) -> bytes:
        return hashlib.sha256(path.name.encode() + b' ' + body).digest()


_DIGEST = hashlib.sha256().digest_size


@cache
def _say_once(sentence: str) -> None:
    print(sentence, file=sys.stderr)


_held: set[Path] = set()


@contextmanager
def alone(path: Path) -> Iterator[None]:
    """Hold the lock of a file, so that of several processes one compiles and the others load.

    A process that holds it goes on. A file system without locks, or without the folder, costs time
    only.
    """
    if path in _held:
        yield
        return
    with ExitStack() as stack:
        with suppress(OSError):
            path.parent.mkdir(parents=True, exist_ok=True)
            file = stack.enter_context(path.open('w'))
            fcntl.flock(file, fcntl.LOCK_EX)
            # A process that was forked meanwhile has the file too: to close it is not enough.
            stack.callback(fcntl.flock, file, fcntl.LOCK_UN)
        _held.add(path)
        stack.callback(_held.remove, path)
        yield


@cache
def folder_for(module: str) -> Path | None:
    """Return the folder for what is compiled of a module, and remove folders of its old states.

    module : its full name. The first of its kernels asks, behind the imports of the module: what
    it imports later, and what it computes with functions of other modules, is not in the digest.

    The folder is in the user's cache; where that cannot be written, beside the sources; None where
    these cannot be written either, or there is no file, as for what is typed into Python.
    """
    source = getattr(sys.modules[module], '__file__', None)
    if source is None:
        return None
    for base in (user_cache() / 'kernels', Path(source).parent / '__pycache__'):
        folder = base / f'{module}-{digest(module)[:20]}'
        is_new = not folder.exists()
        try:
            folder.mkdir(parents=True, exist_ok=True)
            os.utime(folder)  # used now
        except OSError:
            continue
        if os.access(folder, os.W_OK):
            if is_new:
                _forget(base, module)
            return folder
    return None


def user_cache() -> Path:
    """Return the folder for what may be computed again, below the user's home."""
    return Path(os.environ.get('XDG_CACHE_HOME') or os.path.expanduser('~/.cache')) / 'rpo'


@cache
def digest(module: str) -> str:
    """Return the SHA-256, in hexadecimal, of all that the compiled code of a module depends on."""
    found = hashlib.sha256(_sources(module.partition('.')[0]).encode())
    used = set()
    for key, value in sorted(vars(sys.modules[module]).items()):
        origin = _origin(value)
        if origin is not None:
            used.add(origin)
        elif isinstance(value, np.ndarray):
            found.update(f'{key} {value.dtype} {value.shape}'.encode() + value.tobytes())
        elif isinstance(value, _FROZEN) and not key.startswith('__'):
            found.update(f'{key} {value!r}'.encode())
    for name in sorted(used - {module}):
        found.update(f'{name} {digest(name)}'.encode())
    return found.hexdigest()


@cache
def _sources(package: str) -> str:
    """Return the digest of the compiler, and of the sources of a package that it may look into.

    A kernel takes tuples whose types its module need not import: so whole packages.
    """
    found = hashlib.sha256(f'{version("numba")} {version("llvmlite")} {np.__version__}'.encode())
    for path in _files(sys.modules[package]):
        text = path.read_bytes()
        if any(word in text for word in MARKS):
            found.update(f'{path.name} {len(text)} '.encode() + text)
    return found.hexdigest()


def _files(package: ModuleType) -> list[Path]:
    """Return the sources of a package, of one without an `__init__`, or of a single module."""
    folders = getattr(package, '__path__', None)
    if folders is None:
        return [Path(str(package.__file__))]
    return sorted(path for folder in folders for path in Path(folder).rglob('*.py'))


def _origin(value: Any) -> str | None:
    """Return the module of a kernel, of a type of tuples, or of kernels; None for other values."""
    if isinstance(value, ModuleType):
        return value.__name__ if any(map(_is_kernel, vars(value).values())) else None
    named = _is_kernel(value) or (isinstance(value, type) and hasattr(value, '_fields'))
    return value.__module__ if named else None


def _is_kernel(value: Any) -> bool:
    return 'py_func' in getattr(value, '__dict__', ())  # asks no object that makes up its answers


def _forget(base: Path, module: str) -> None:
    """Remove all but the folders of one module that were used last."""
    folders = [path for path in base.glob(f'{module}-*') if path.is_dir()]
    folders.sort(key=_used_s, reverse=True)
    for path in folders[KEPT:]:
        shutil.rmtree(path, ignore_errors=True)


def _used_s(folder: Path) -> float:
    """Return when a folder was used last; long ago if another process has just removed it."""
    try:
        return folder.stat().st_mtime
    except OSError:
        return 0.0
