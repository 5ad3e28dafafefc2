# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Records and kernels of stages as numba has them; imported only where kernels are compiled."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from llvmlite import ir  # type: ignore[import-untyped]
from numba import types
from numba.core.cgutils import if_unlikely
from numba.core.datamodel import models
from numba.extending import intrinsic
from numba.np.arrayobj import populate_array

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


@cache
def address(step: Any, settings: Any, memory: Any) -> int:
    """Return the address of a kernel `step(tick, u, p, m, y)`; it is compiled now, or loaded."""
    given = types.int64, FLOATS, record_type(settings), record_type(memory), FLOATS
    step.compile(given)
    made = step.overloads[given]
    return int(made.library.get_pointer_to_function(made.fndesc.llvm_func_name))


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
