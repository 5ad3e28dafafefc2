# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Calls of kernels by their address, so that the caller need not be compiled together with them."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rpo_core.kernels.jit import COMPILED

Call = tuple[Any, NDArray[np.float64], NDArray[np.float64]]
"""A kernel `(w, memory, table, tick)`, its memory and its table."""


def rows_of(calls: Sequence[Call]) -> Any:
    """Return calls as `call` takes them, one in a row; the caller keeps the arrays."""
    if not COMPILED:
        return calls
    rows = [(_address(f), m.ctypes.data, m.size, t.ctypes.data, t.size) for f, m, t in calls]
    return np.array(rows, np.int64)


@cache
def _address(kernel: Any) -> int:
    """Return the address of a kernel, which is compiled now, or loaded."""
    kernel.compile(_numba_types())
    made = kernel.overloads[_numba_types()]
    return int(made.library.get_pointer_to_function(made.fndesc.llvm_func_name))


@cache
def _numba_types() -> tuple[Any, ...]:
    """Return the types of the arguments of a kernel."""
    from numba import types

    floats = types.Array(types.float64, 1, 'C')
    return floats, floats, floats, types.int64


def _compiled() -> Any:
    """Return the call of the kernel of a row, for compiled code."""
    from llvmlite import ir  # type: ignore[import-untyped]
    from numba import types
    from numba.core.cgutils import if_unlikely
    from numba.extending import intrinsic
    from numba.np.arrayobj import populate_array

    kinds = _numba_types()

    def call(_typing, row, w, tick):  # type: ignore[no-untyped-def]
        def generate(context, builder, _signature, given):  # type: ignore[no-untyped-def]
            data = context.make_array(row)(context, builder, given[0]).data
            numbers = [
                builder.load(builder.gep(data, [ir.Constant(ir.IntType(64), i)])) for i in range(5)
            ]
            eight = ir.Constant(ir.IntType(64), 8)

            def floats(address, size):  # type: ignore[no-untyped-def]
                made = context.make_array(kinds[0])(context, builder)
                pointer = builder.inttoptr(address, ir.DoubleType().as_pointer())
                populate_array(made, pointer, [size], [eight], eight, None)
                return made._getvalue()

            function = context.call_conv.get_function_type(types.none, kinds)
            kernel = builder.inttoptr(numbers[0], function.as_pointer())
            arguments = (given[1], floats(*numbers[1:3]), floats(*numbers[3:]), given[2])
            passed = context.call_conv.call_function(builder, kernel, types.none, kinds, arguments)
            with if_unlikely(builder, passed[0].is_error):
                context.call_conv.return_status_propagate(builder, passed[0])
            return context.get_dummy_value()

        return types.void(row, w, tick), generate

    return intrinsic(call)


def _interpreted(row: Call, w: Any, tick: int) -> None:
    row[0](w, *row[1:], tick)


call: Any = _compiled() if COMPILED else _interpreted
"""Call the kernel of a row for a scratch and a tick."""
