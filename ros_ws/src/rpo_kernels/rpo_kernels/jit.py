# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""One switch: scalar kernels run as plain Python, or compiled by numba, with the same bits.

Set `RPO_JIT=0` to interpret, `RPO_JIT=1` to insist on numba; unset, numba is used where installed.
No `fastmath`: a compiled kernel adds, multiplies and divides in the order the source says.
"""

from __future__ import annotations

import importlib.util
import os
from collections.abc import Callable, Mapping
from functools import cache, partial, wraps
from pathlib import Path
from typing import Any, TypeVar, cast

import numpy as np

from rpo_kernels.compile_cache import Entries, InsideLocator, Locator, alone, folder_for
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


def compiled(function: Kernel, by_constant: bool = False, **options: Any) -> Kernel:
    """Compile with more options of numba where `COMPILED`, else return it as it is.

    by_constant : compile once more for each constant that another kernel calls it with, where
        loops become SIMD only if LLVM knows it

    For calls from Python and from other kernels it is compiled apart: the latter need no wrapper
    that unpacks Python's objects, which takes a fifth of the compiling.
    """
    if not COMPILED:
        return function
    made = _dispatcher(function, Locator, options)
    made.inside = cache(
        partial(_dispatcher, function, InsideLocator, {'no_cpython_wrapper': True, **options})
    )
    template_of, overload_of = made.get_call_template, made.get_overload

    def template_inside(args: Any, kws: Any) -> Any:
        types = made.fold_argument_types(args, kws)[1]
        if not by_constant:
            types = _of_any_value(types)
        known = types in made.overloads
        return template_of(types, {}) if known else made.inside().get_call_template(types, {})

    def overload_inside(types: Any) -> Any:
        known = tuple(types) in made.overloads
        return overload_of(types) if known else made.inside().get_overload(types)

    made.get_call_template, made.get_overload = template_inside, overload_inside
    return cast(Kernel, made)


def _dispatcher(function: Kernel, locator: type[Locator], options: Mapping[str, Any]) -> Any:
    """Return what numba makes of a kernel, kept where the locator says."""
    numba = _numba()
    folder = folder_for(function.__module__)
    # error_model 'numpy' drops the zero-division branch; kernels never divide by zero. Nobody calls
    # one as C does: the wrapper for that would take a tenth of the compiling.
    options = {'error_model': 'numpy', 'fastmath': False, 'no_cfunc_wrapper': True, **options}
    before = numba.config.CACHE_LOCATOR_CLASSES
    # numba's own look at the sources stops at the file: see `compile_cache`.
    numba.config.CACHE_LOCATOR_CLASSES = f'{locator.__module__}.{locator.__name__}'
    try:
        made = numba.njit(cache=folder is not None, **options)(function)
    finally:
        numba.config.CACHE_LOCATOR_CLASSES = before
    if folder is not None:
        made._cache._cache_file = Entries(folder, made._cache._impl.filename_base)
        made.compile = _once(made.compile, folder / f'{function.__qualname__}.lock')
    return made


def _once(compile_for: Callable[[Any], Any], lock: Path) -> Callable[[Any], Any]:
    """Return a kernel's `compile` that only one process at a time enters."""
    from numba.core.compiler_lock import global_compiler_lock

    @wraps(compile_for)
    def compile_alone(signature: Any) -> Any:
        with global_compiler_lock, alone(lock):  # in this order: else two threads could wait
            return compile_for(signature)

    return compile_alone


def _of_any_value(types: Any) -> Any:
    """Return the types of arguments with any number in the place of a constant.

    Where LLVM inlines a kernel, it sees the constant all the same.
    """
    from numba.core.types.misc import unliteral

    return tuple(map(unliteral, types))


@cache
def _numba() -> Any:
    """Return numba, set to compile in less time, and to fill AVX-512 registers.

    By default LLVM fills half of each, a tenth slower.
    """
    import numba
    from numba.core import codegen

    if numba.config.CPU_FEATURES is None:
        features = codegen.get_host_cpu_features()
        if '+avx512f' in features:
            numba.config.CPU_FEATURES = f'{features},-prefer-256-bit'
    _remember_calls()
    return numba


def _remember_calls() -> None:
    """Let numba ask only once what a function of its own returns for arguments of some types.

    Else it tries all templates of `+` at each `+` of each kernel: a sixth of the compiling.
    """
    from numba.core.targetconfig import ConfigStack
    from numba.core.types import functions

    function_type: Any = functions.BaseFunction
    ask = function_type.get_call_type
    known: dict[Any, Any] = {}

    def get_call_type(self: Any, context: Any, args: Any, kws: Any) -> Any:
        asked = self.key, context, tuple(args), tuple(kws.items()), ConfigStack.top_or_none()
        if asked not in known:
            found = ask(self, context, args, kws)
            known[asked] = found, self._impl_keys[found.args]
        found, self._impl_keys[found.args] = known[asked]
        return found

    function_type.get_call_type = get_call_type


def as_table(values: Any, dtype: Any = np.float64) -> Any:
    """Return a table in the container kernels read fastest.

    A C-ordered array when compiled; nested Python lists of floats (or ints) when interpreted, where
    indexing an array costs a hundred nanoseconds an element.
    """
    array = np.ascontiguousarray(values, dtype=dtype)
    return array if COMPILED else array.tolist()
