# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Records and kernels of stages as numba has them; imported only where kernels are compiled."""

from __future__ import annotations

import fcntl
import os
import signal
import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, suppress
from functools import cache
from pathlib import Path
from pkgutil import resolve_name
from subprocess import DEVNULL, Popen
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from llvmlite import ir  # type: ignore[import-untyped]
from numba import types
from numba.core.cgutils import if_unlikely
from numba.core.compiler_lock import global_compiler_lock
from numba.core.datamodel import models
from numba.extending import intrinsic
from numba.np.arrayobj import populate_array

from rpo_core.kernels import compile_cache
from rpo_core.kernels.records import format_of, places_of

FLOATS = types.Array(types.float64, 1, 'C')


class Record(types.Record):  # type: ignore[misc]
    """A record whose fields may be arrays: of numba's own, NumPy must know the types."""

    dtype = np.dtype([])

    def can_convert_to(self, typingctx: Any, other: Any) -> Any:
        """Return that it is no other record, not even one of which it has the first fields."""


models.register_default(Record)(models.RecordModel)


@cache
def record_type(record: Any) -> Record:
    """Return a record as numba has it."""
    fields = []
    for field, place in places_of(record).values():
        base = field.base
        one = record_type(base) if base not in (float, int) else types.float64
        one = types.int64 if base is int else one
        if not field.is_fixed:
            of_field: Any = types.Array(one, len(field.shape), 'C')
        else:
            of_field = types.NestedArray(one, field.shape) if field.shape else one
        fields.append((field.name, {'type': of_field, 'offset': 8 * place}))
    return Record(fields, 8 * len(format_of(record)), True)


def _arguments(settings: Any, memory: Any) -> tuple[types.Type, ...]:
    """Return the types of the arguments of a kernel `step(tick, u, p, m, y)`."""
    return types.int64, FLOATS, record_type(settings), record_type(memory), FLOATS


@cache
def address(step: Any, settings: Any, memory: Any) -> int:
    """Return the address of a kernel `step(tick, u, p, m, y)`; it is compiled now, or loaded."""
    given = _arguments(settings, memory)
    step.inner.compile(given)
    made = step.inner.overloads[given]
    return int(made.library.get_pointer_to_function(made.fndesc.llvm_func_name))


COMPILE_NAMED = f'import {__name__} as here; here.compile_named()'
"""What another process runs; its arguments are those of `compile_named`."""


@cache
def compile_together(*steps: tuple[Any, Any, Any]) -> None:
    """Compile kernels, each with the classes of its settings and memory, in several processes.

    numba compiles one kernel at a time in a process. What another process compiles, this one loads.
    One that cannot be compiled here, or while another process is here, is compiled at its use.
    """
    with global_compiler_lock, suppress(OSError), ExitStack() as stack:
        missing = [step for step in steps if not step[0].inner.is_kept(_arguments(*step[1:]))]
        if not missing:
            return
        lock = stack.enter_context((compile_cache.folder() / 'together.lock').open('w'))
        fcntl.lockf(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        folder = stack.enter_context(TemporaryDirectory())
        names = [' '.join(f'{c.__module__}:{c.__qualname__}' for c in step) for step in missing]
        words = [sys.executable, '-c', COMPILE_NAMED, folder, *names]
        path = os.pathsep.join(filter(None, sys.path))
        is_watched = sys.stderr.isatty() or 'ipykernel' in sys.modules
        others = []
        for _ in range(min(len(os.sched_getaffinity(0)), len(missing)) - 1):
            other = Popen(words, stderr=DEVNULL, env={**os.environ, 'PYTHONPATH': path})
            others.append(stack.enter_context(other))
            stack.callback(other.kill)  # after Ctrl-C
        for number, step in _claimed(folder, missing):
            if is_watched:
                text = f'compiling kernels, once: stage {number + 1} of {len(missing)}'
                print(text, file=sys.stderr)
            address(*step)
        for other in others:
            other.wait()


def compile_named() -> None:
    """Compile kernels by their names, as another process: see `compile_together`.

    Arguments of the process: the folder of claims; of each stage, the names of kernel and classes.
    """
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    parent, (folder, *names) = os.getppid(), sys.argv[1:]
    for _, name in _claimed(folder, names):
        if os.getppid() == parent:  # it goes on
            address(*map(resolve_name, name.split()))


def _claimed(folder: str, steps: Sequence[Any]) -> Iterator[tuple[int, Any]]:
    """Yield number and stage of those that no other process has claimed, by a file in a folder."""
    for number, step in enumerate(steps):
        with suppress(FileExistsError):
            Path(folder, str(number)).touch(exist_ok=False)
            yield number, step


@intrinsic
def call(_typing, step, tick, u, p, m, y, first, size):  # type: ignore[no-untyped-def]
    """Call a kernel by its address; return what it returns, 0 of None, or raise what it raises.

    u : (n,) its inputs; p, m : addresses of its settings and its memory
    y : its outputs are y[first : first + size]
    """
    given = types.int64, FLOATS, types.voidptr, types.voidptr, FLOATS

    def generate(context, builder, _signature, arguments):  # type: ignore[no-untyped-def]
        word, pointer = ir.IntType(64), ir.IntType(8).as_pointer()
        step, tick, u, p, m, y, first, size = arguments
        eight = ir.Constant(word, 8)
        outputs = context.make_array(FLOATS)(context, builder)
        place = builder.gep(context.make_array(FLOATS)(context, builder, y).data, [first])
        populate_array(outputs, place, [size], [eight], eight, None)
        convention = context.call_conv
        function = convention.get_function_type(types.int64, given)
        kernel = builder.inttoptr(step, function.as_pointer())
        passed = [tick, u, builder.inttoptr(p, pointer), builder.inttoptr(m, pointer)]
        passed.append(outputs._getvalue())
        status, returned = convention.call_function(builder, kernel, types.int64, given, passed)
        with if_unlikely(builder, status.is_error):
            convention.return_status_propagate(builder, status)
        return returned

    words = types.int64
    return words(words, words, FLOATS, words, words, FLOATS, words, words), generate
