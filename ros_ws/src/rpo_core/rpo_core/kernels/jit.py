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
from typing import Any, TypeVar, cast

import numpy as np

from rpo_core.files.validation import InputError

Kernel = TypeVar('Kernel', bound=Callable[..., Any])


def _wanted() -> bool:
    choice = os.environ.get('RPO_JIT', '')
    if choice not in ('', '0', '1'):
        raise InputError(f'environment variable `RPO_JIT` must be 0, 1 or unset; got {choice!r}')
    if choice == '0':
        return False
    installed = importlib.util.find_spec('numba') is not None
    if choice == '1' and not installed:
        raise InputError('`RPO_JIT=1` needs compiled kernels, but numba is not installed')
    return installed


COMPILED = _wanted()
"""Whether kernels of this process are compiled."""

FIRST_FLIGHT = False
"""Whether they are not, because no process has compiled any of these sources."""


def interpret_first_flight() -> None:
    """Interpret the kernels of this process if none was ever compiled; before they are imported.

    A flight takes less time so than its kernels take to compile, unless it is long.
    """
    global COMPILED, FIRST_FLIGHT
    if COMPILED and not os.environ.get('RPO_JIT'):
        from rpo_core.kernels import compile_cache  # imports numba

        FIRST_FLIGHT = not compile_cache.place().exists()
        COMPILED = not FIRST_FLIGHT


def kernel(function: Kernel) -> Kernel:
    """Compile a scalar kernel where `COMPILED`, else return it as it is."""
    return compiled(function)


def step_kernel(function: Kernel) -> Kernel:
    """Compile the kernel of a stage, `step(tick, u, p, m, y)`: one that makes no array.

    A kernel of another package than `rpo` and `rpo_...` is told where it leaves an array.
    """
    ours = function.__module__.partition('.')[0].partition('_')[0] == 'rpo'
    return compiled(function, _nrt=False, boundscheck=not ours)


def unlocked(function: Kernel) -> Kernel:
    """Compile as `kernel` does, free of the interpreter's lock: other threads go on."""
    return compiled(function, nogil=True)


def inlined(function: Kernel) -> Kernel:
    """Compile as `kernel` does, and inline: only then do loops over lanes become SIMD."""
    return compiled(function, forceinline=True)


def compiled(function: Kernel, by_constant: bool = False, **options: Any) -> Kernel:
    """Compile with more options of numba where `COMPILED`, else return it as it is.

    by_constant : compile once more for each constant that another kernel calls it with, where
        loops become SIMD only if LLVM knows it
    """
    if not COMPILED:
        return function
    from rpo_core.kernels import compile_cache  # imports numba

    # error_model 'numpy' drops the zero-division branch; kernels never divide by zero. Nobody calls
    # one as C does: the wrapper for that would take a tenth of the compiling.
    fixed = {'nopython': True, 'error_model': 'numpy', 'no_cfunc_wrapper': True}
    made = compile_cache.Kernel(function, targetoptions={**fixed, **options})
    made.by_constant = by_constant
    made.enable_caching()
    return cast(Kernel, made)


def as_table(values: Any, dtype: Any = np.float64) -> Any:
    """Return a table in the container kernels read fastest.

    A C-ordered array when compiled; nested Python lists of floats (or ints) when interpreted, where
    indexing an array costs a hundred nanoseconds an element.
    """
    array = np.ascontiguousarray(values, dtype=dtype)
    return array if COMPILED else array.tolist()


def as_view(values: Any) -> Any:
    """Return a table of floats that kernels only read: an array as it is, whatever its strides."""
    return np.asarray(values, np.float64) if COMPILED else values.tolist()
