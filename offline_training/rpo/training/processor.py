# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The arithmetic of a search: pinned before NumPy is imported, and read from the process after.

OpenBLAS (which NumPy and SciPy each bundle), NumPy and the C library have several forms of their
functions and choose by the processor. Their last bits differ, and a search carries a last bit on.
So a search runs with the forms that every x86-64 has. The kernels of `rpo_core` need none of this.
"""

from __future__ import annotations

import ctypes
import math
import os
import sys
import warnings
from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

SEARCH = 'train'
"""The command whose process is pinned."""

OPENBLAS, NUMPY, LIBM, PINNED = 'openblas', 'numpy', 'libm', 'pinned'
"""Keys of `in_use`."""

_CORE = 'Prescott'  # SSE3
_ALIASES = {'Katmai': _CORE}  # a build with few kernels names these by the first that they replace
_VARIABLES = {
    'OPENBLAS_CORETYPE': _CORE,
    'OPENBLAS_L2_SIZE': '1024',  # kB; else blocks have the size of the processor's own cache
    'OPENBLAS_NUM_THREADS': '1',  # the order of a sum follows the number of threads
}
_ENABLE, _DISABLE = 'NPY_ENABLE_CPU_FEATURES', 'NPY_DISABLE_CPU_FEATURES'
_TUNABLES, _CAPS = 'GLIBC_TUNABLES', 'glibc.cpu.hwcaps='
_NO_FMA = ','.join(f'-{name}{old}' for name in ('AVX2', 'FMA', 'FMA4') for old in ('', '_Usable'))
"""Features by their names since glibc 2.33, and before; it ignores names that it does not know."""
_RESTARTED = 'RPO_PINNED_PROCESS'

_FORMS = {
    '0x1.2c32a20e4f854p+5': 'without FMA',
    '0x1.2c32a20e4f855p+5': 'with FMA',
}
"""exp(3.625), where the two forms of the C library differ."""


def environment(given: Mapping[str, str], dispatched: Sequence[str]) -> dict[str, str]:
    """Return an environment in which a process is pinned, whatever the given one asks for.

    dispatched : features for which this build of NumPy has forms of their own
    """
    found = {**given, **_VARIABLES, _DISABLE: ' '.join(dispatched)}
    found.pop(_ENABLE, None)  # NumPy refuses both at once
    others = [t for t in given.get(_TUNABLES, '').split(':') if t and not t.startswith(_CAPS)]
    return {**found, _TUNABLES: ':'.join([*others, _CAPS + _NO_FMA])}


def restart_pinned() -> None:
    """Go on as a pinned process with the same arguments and number, unless this one is pinned."""
    simd = _simd()
    wanted = environment(os.environ, [*simd.get('found', ()), *simd.get('not found', ())])
    this = str(os.getpid())
    if wanted != dict(os.environ) and os.environ.get(_RESTARTED) != this and sys.executable:
        arguments = [sys.executable, *sys.orig_argv[1:]]
        os.execve(sys.executable, arguments, {**wanted, _RESTARTED: this})


def _simd() -> Mapping[str, Sequence[str]]:
    """Return the features of NumPy: `baseline`, and dispatched ones `found` and `not found`."""
    import numpy as np

    found: Mapping[str, Any] = np.show_config(mode='dicts')
    return dict(found.get('SIMD Extensions', {}))


def in_use() -> dict[str, str | bool]:
    """Return what this process computes with.

    `openblas` : kernels and threads of each library that is loaded; `numpy` : features whose forms
    are used; `libm` : version of the C library, and its form of exp; `pinned` : whether all of them
    are those of every x86-64
    """
    simd, blas = _simd(), _openblas()
    form = _FORMS.get(math.exp(3.625).hex(), 'unknown form')
    version = (os.confstr('CS_GNU_LIBC_VERSION') if hasattr(os, 'confstr') else None) or 'unknown'
    chosen = bool(simd.get('found')) or set(blas) != {f'{_CORE}, 1 thread'}
    return {
        OPENBLAS: '; '.join(blas) or 'none',
        NUMPY: ' '.join([*simd.get('baseline', ()), *simd.get('found', ())]) or 'unknown',
        LIBM: f'{version}, {form}',
        PINNED: not chosen and form == 'without FMA',
    }


def _openblas() -> list[str]:
    """Return kernels and threads of each OpenBLAS of this process, each pair once."""
    mapped = Path('/proc/self/maps').read_text(encoding='utf-8', errors='replace').splitlines()
    paths = {line.split(maxsplit=5)[-1] for line in mapped if 'openblas' in line}
    found = set()
    for path in sorted(paths):
        with suppress(OSError):  # removed since it was loaded
            library = ctypes.CDLL(path)
            core = _call(library, 'get_corename', ctypes.c_char_p)
            threads = _call(library, 'get_num_threads', ctypes.c_int)
            if core is not None:
                plural = '' if threads == 1 else 's'
                name = _ALIASES.get(core.decode(), core.decode())
                found.add(f'{name}, {threads} thread{plural}')
    return sorted(found)


def _call(library: ctypes.CDLL, name: str, result: type) -> Any:
    """Return what a function of OpenBLAS without arguments says; None if it has none."""
    for prefix in ('scipy_openblas_', 'openblas_'):
        for suffix in ('64_', ''):
            function = getattr(library, f'{prefix}{name}{suffix}', None)
            if function is not None:
                function.restype = result
                return function()
    return None


def named() -> str:
    """Return what this process computes with, in words."""
    found = in_use()
    return f'OpenBLAS {found[OPENBLAS]}; NumPy {found[NUMPY]}; {found[LIBM]}'


@cache
def warn_unless_pinned() -> None:
    """Warn once if this process computes with forms that another processor may not have."""
    if not in_use()[PINNED]:
        warnings.warn_explicit(
            f'this process computes with forms that its processor chose, {named()}: on another '
            'processor the same seed may train another controller; `rpo train` trains the same one',
            UserWarning,
            'rpo.train',  # no file, so that no line of source is shown
            lineno=0,
        )
