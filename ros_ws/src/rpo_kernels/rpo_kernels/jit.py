# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""One switch: scalar kernels run as plain Python, or compiled by numba, with the same bits.

Set `RPO_JIT=0` to interpret, `RPO_JIT=1` to insist on numba; unset, numba is used where installed.
No `fastmath`: a compiled kernel adds, multiplies and divides in the order the source says.
"""

from __future__ import annotations

import importlib.util
import os
from collections.abc import Callable
from functools import cache, wraps
from pathlib import Path
from typing import Any, TypeVar, cast

import numpy as np

from rpo_kernels.compile_cache import Locator, alone, folder_for
from rpo_kernels.errors import InputError

Kernel = TypeVar('Kernel', bound=Callable[..., Any])

_CHOICES = ('', '0', '1')


def _wanted() -> bool:
    choice = os.environ.get('RPO_JIT', '')
    if choice not in _CHOICES:
        raise InputError(f'environment variable `RPO_JIT` must be 0, 1 or unset; got {choice!r}')
    if choice == '0':
        return False
    installed = importlib.util.find_spec('numba') is not None
    if choice == '1' and not installed:
        raise InputError('`RPO_JIT=1` needs compiled kernels, but numba is not installed')
    return installed


COMPILED = _wanted()
"""Whether kernels of this process are compiled."""


def kernel(function: Kernel) -> Kernel:
    """Compile a scalar kernel where `COMPILED`, else return it as it is."""
    return compiled(function)


def inlined(function: Kernel) -> Kernel:
    """Compile as `kernel` does, and inline: only then do loops over lanes become SIMD."""
    return compiled(function, forceinline=True)


def compiled(function: Kernel, **options: Any) -> Kernel:
    """Compile with more options of numba where `COMPILED`, else return it as it is."""
    if not COMPILED:
        return function
    numba = _numba()
    folder = folder_for(function.__module__)
    # error_model 'numpy' drops the zero-division branch; kernels never divide by zero. Nobody calls
    # one as C does: the wrapper for that would take a tenth of the compiling.
    options = {'error_model': 'numpy', 'fastmath': False, 'no_cfunc_wrapper': True, **options}
    before = numba.config.CACHE_LOCATOR_CLASSES
    # numba's own look at the sources stops at the file: see `compile_cache`.
    numba.config.CACHE_LOCATOR_CLASSES = f'{Locator.__module__}.{Locator.__name__}'
    try:
        made = numba.njit(cache=folder is not None, **options)(function)
    finally:
        numba.config.CACHE_LOCATOR_CLASSES = before
    if folder is not None:
        made.compile = _once(made.compile, folder / f'{function.__qualname__}.lock')
    if options.get('forceinline'):
        made.get_call_template = _of_any_value(made.get_call_template)
    return cast(Kernel, made)


def _once(compile_for: Callable[[Any], Any], lock: Path) -> Callable[[Any], Any]:
    """Return a kernel's `compile` that only one process at a time enters."""
    from numba.core.compiler_lock import global_compiler_lock

    @wraps(compile_for)
    def compile_alone(signature: Any) -> Any:
        with global_compiler_lock, alone(lock):  # in this order: else two threads could wait
            return compile_for(signature)

    return compile_alone


def _of_any_value(template_of: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
    """Return the `get_call_template` of an inlined kernel for which a constant is any number.

    By default numba compiles a kernel once more for each constant that another one calls it with.
    Of an inlined one LLVM sees the constant all the same.
    """
    from numba.core.types.misc import unliteral

    def template_of_types(args: Any, kws: Any) -> Any:
        named = {name: unliteral(value) for name, value in kws.items()}
        return template_of(tuple(map(unliteral, args)), named)

    return template_of_types


@cache
def _numba() -> Any:
    """Return numba, set to fill AVX-512 registers: by default LLVM fills half, a tenth slower."""
    import numba
    from numba.core import codegen

    if numba.config.CPU_FEATURES is None:
        features = codegen.get_host_cpu_features()
        if '+avx512f' in features:
            numba.config.CPU_FEATURES = f'{features},-prefer-256-bit'
    return numba


def as_table(values: Any, dtype: Any = np.float64) -> Any:
    """Return a table in the container kernels read fastest.

    A C-ordered array when compiled; nested Python lists of floats (or ints) when interpreted, where
    indexing an array costs a hundred nanoseconds an element.
    """
    array = np.ascontiguousarray(values, dtype=dtype)
    return array if COMPILED else array.tolist()
