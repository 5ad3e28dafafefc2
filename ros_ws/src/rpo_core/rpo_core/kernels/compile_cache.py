# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Compiled kernels, kept in a folder that is named by a digest of all sources with kernels.

numba looks only at the file that defines a function. A kernel that calls another one has the other
one's machine code inside it, so numba alone would run the old code after an edit of the other file.
numba adds the processor and the types of the arguments. No path is part of the digest, so all
checkouts of a user share the folders. Kernels of packages other than `rpo` and `rpo_...` are not
kept, because nothing says what they depend on.

Each entry begins with its digest: machine code with a flipped bit would end the process, or compute
something else. One that does not fit is compiled again.
"""

from __future__ import annotations

import fcntl
import gc
import hashlib
import importlib.util
import os
import pickle
import pkgutil
import re
import shutil
import sys
from collections.abc import Callable
from contextlib import ExitStack, suppress
from functools import cache
from pathlib import Path
from typing import Any

import llvmlite  # type: ignore[import-untyped]
import numba
import numpy as np
from numba.core.caching import FunctionCache
from numba.core.codegen import get_host_cpu_features
from numba.core.compiler import CompileResult
from numba.core.compiler_lock import global_compiler_lock
from numba.core.registry import CPUDispatcher
from numba.core.serialize import dumps
from numba.core.types.misc import unliteral

KEPT = 20
"""Folders that are kept: edits, branches and checkouts come and go."""

_USED = re.compile(rb'numba|kernels\.(calls|jit|records|simd)|kernels import|[Nn]amed_?[Tt]uple')
"""What a source says that has kernels, or types of their arguments."""

_CHECK = hashlib.sha256().digest_size

if numba.config.CPU_FEATURES is None and '+avx512f' in get_host_cpu_features():
    # By default LLVM fills half of each AVX-512 register, a tenth slower.
    numba.config.CPU_FEATURES = f'{get_host_cpu_features()},-prefer-256-bit'


class Kernel(CPUDispatcher):  # type: ignore[misc]
    """A kernel as numba compiles it.

    by_constant : whether it is compiled once more for each constant that another kernel calls it
        with. Where LLVM inlines it, it sees the constant all the same.
    """

    by_constant = False
    _inner: Kernel | None = None

    @property
    def _numba_type_(self) -> Any:
        """What other kernels see of it."""
        return numba.types.Dispatcher(self.inner)

    @property
    def _is_inner(self) -> bool:
        return 'no_cpython_wrapper' in self.targetoptions

    @property
    def inner(self) -> Kernel:
        """It, as other kernels call it: without what takes arguments from Python.

        Of all kernels, that would be a third of the compiling.
        """
        if self._is_inner:
            return self
        with global_compiler_lock:
            if self._inner is None:
                options = {**self.targetoptions, 'no_cpython_wrapper': True}
                self._inner = Kernel(self.py_func, targetoptions=options)
                self._inner.by_constant = self.by_constant
                self._inner.enable_caching()
        return self._inner

    def enable_caching(self) -> None:
        """Keep what is compiled, where the sources that it depends on are in the digest."""
        if _is_of_the_digest(self.py_func.__module__):
            self._cache = Cache(self.py_func, folder(), '-inner' * self._is_inner)

    def compile(self, sig: Any) -> Any:
        """Compile or load it for types of arguments, one process at a time.

        A file system without locks, or without the folder, costs time only.
        """
        with global_compiler_lock, ExitStack() as stack:  # in this order: else threads could wait
            if isinstance(self._cache, Cache):
                with suppress(OSError):
                    lock = stack.enter_context(self._cache.lock.open('w'))
                    fcntl.lockf(lock, fcntl.LOCK_EX)  # not flock: a forked process would hold it
            if gc.isenabled():
                gc.disable()  # a tenth of the time; the compiler leaves little behind
                stack.callback(gc.enable)
            return super().compile(sig)

    def is_kept(self, types: tuple[Any, ...]) -> bool:
        """Return whether its code for types of arguments is kept, or cannot be."""
        code: Any = self._cache
        if not isinstance(code, Cache):
            return True
        return code._path(code._index_key(types, self.targetctx.codegen())).exists()

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """Return its type for a call of another kernel."""
        types = self.fold_argument_types(args, kws)[1]
        any_value = types if self.by_constant else tuple(map(unliteral, types))
        return super().get_call_template(any_value, {})


class Cache(FunctionCache):  # type: ignore[misc]
    """The compiled code of one kernel, a checked file for each types of its arguments.

    It has no files of numba's own: these are believed whatever is in them.
    """

    def __init__(self, function: Callable[..., Any], folder: Path, suffix: str) -> None:
        self._py_func, self._cache_path = function, str(folder)
        name = f'{function.__module__}.{function.__qualname__}-{function.__code__.co_firstlineno}'
        self.lock = folder / f'{name}{suffix}.lock'

    def _load_overload(self, sig: Any, target_context: Any) -> Any:
        key = self._index_key(sig, target_context.codegen())
        with suppress(OSError):  # there is none, or another process has removed it
            content = self._path(key).read_bytes()
            if content == self._checked(key, content[_CHECK:]):
                saved_key, code = pickle.loads(content[_CHECK:])
                return CompileResult._rebuild(target_context, *code) if saved_key == key else None
        return None

    def _save_overload(self, sig: Any, data: Any) -> None:
        if data.library.has_dynamic_globals:  # addresses of this process
            return
        key = self._index_key(sig, data.codegen)
        try:
            code = data._reduce()
        except RuntimeError:  # Ctrl-C came as numba received the code, and was ignored
            raise KeyboardInterrupt from None
        path = self._path(key)
        aside = path.with_suffix(f'.{os.getpid()}')
        try:
            path.parent.mkdir(parents=True, exist_ok=True)  # another process may have removed it
            try:
                aside.write_bytes(self._checked(key, dumps((key, code))))
                aside.replace(path)
            finally:
                aside.unlink(missing_ok=True)
        except OSError as error:
            _say_once(f'{path.parent}: cannot keep compiled code: {error.strerror or error}')

    def _path(self, key: Any) -> Path:
        return self.lock.with_suffix(f'.{hashlib.sha256(repr(key).encode()).hexdigest()[:20]}')

    def _checked(self, key: Any, body: bytes) -> bytes:
        return hashlib.sha256(self._path(key).name.encode() + b' ' + body).digest() + body


@cache
def _say_once(sentence: str) -> None:
    print(sentence, file=sys.stderr)


def place() -> Path:
    """Return where the folder for the present sources is, in the user's cache."""
    home = os.environ.get('XDG_CACHE_HOME') or os.path.expanduser('~/.cache')
    return Path(home) / 'rpo' / 'compiled' / _digest()[:20]


@cache
def folder() -> Path:
    """Return the folder for the present sources; remove old ones."""
    present = place()
    with suppress(OSError):  # a cache that cannot be written, or another process that removes
        is_new = not present.exists()
        present.mkdir(parents=True, exist_ok=True)
        os.utime(present)  # used now
        if is_new:
            by_use = sorted(present.parent.iterdir(), key=lambda path: path.stat().st_mtime)
            for path in by_use[:-KEPT]:
                shutil.rmtree(path, ignore_errors=True)
    return present


def _is_of_the_digest(module: str) -> bool:
    """Return whether the sources of the package of a module are in the digest."""
    return module.partition('.')[0].partition('_')[0] == 'rpo'


@cache
def _digest() -> str:
    """Return a digest of the compiler and all sources that kernels may depend on.

    A kernel takes tuples whose types its module need not import, so their types count too.
    """
    compiler = sys.version, numba.__version__, llvmlite.__version__, np.__version__
    total = hashlib.sha256(repr(compiler).encode())
    for name in sorted({m.name for m in pkgutil.iter_modules() if _is_of_the_digest(m.name)}):
        spec = importlib.util.find_spec(name)
        for root in (spec and spec.submodule_search_locations) or ():
            for path in sorted(Path(root).rglob('*.py')):
                text = path.read_bytes()
                if _USED.search(text):
                    total.update(f'{name} {len(text)} '.encode() + text)
    return total.hexdigest()
