# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Vectors for numba: what `rpo_core.kernels.simd` describes."""

from __future__ import annotations

import operator
from collections.abc import Callable
from functools import partial
from typing import Any

from llvmlite import ir  # type: ignore[import-untyped]
from numba.core import cgutils, types
from numba.core.typeconv import Conversion
from numba.core.typing.templates import ConcreteTemplate, infer_global, signature
from numba.extending import lower_builtin, lower_cast, models, register_model

LANES = 8

_WORD, _VECTOR = ir.IntType(64), ir.VectorType(ir.DoubleType(), LANES)
_NUMBERS = types.Array(types.float64, 1, 'C')


class Vectors(types.Type):
    """A number of each lane; one number that meets them becomes a vector of it."""

    def unify(self, _context: Any, other: Any) -> Any:
        """Return what a variable is that is sometimes this, sometimes another type."""
        return self if other == types.float64 else None

    def can_convert_from(self, _context: Any, other: Any) -> Any:
        """Return whether another type becomes this one."""
        return Conversion.safe if other == types.float64 else None


class Tables(types.Type):
    """A table of floats: in place i the vector of those from i on, 0.0 behind the end."""


_V, _TABLE = Vectors('Vectors'), Tables('Tables')
_POINTER_AND_SIZE = ir.LiteralStructType([ir.DoubleType().as_pointer(), _WORD])
for _type, _data in ((Vectors, _VECTOR), (Tables, _POINTER_AND_SIZE)):
    register_model(_type)(partial(models.PrimitiveModel, be_type=_data))


def compiled(function: Any, result: Any, *arguments: Any) -> Callable[[Any], Any]:
    """Give a function a meaning for types; decorates what builds it from (context, builder, …)."""
    cases = {'key': function, 'cases': [signature(result, *arguments)]}
    infer_global(function)(type('Template', (ConcreteTemplate,), cases))

    def lowered(build: Any) -> Any:
        lower_builtin(function, *arguments)(
            lambda context, builder, _signature, given: build(context, builder, *given)
        )
        return build

    return lowered


def _of_all(builder: Any, value: Any) -> Any:
    """Return a vector of one number."""
    first = builder.insert_element(ir.VectorType(value.type, LANES)(ir.Undefined), value, _WORD(0))
    return builder.shuffle_vector(first, first, ir.VectorType(ir.IntType(32), LANES)([0] * LANES))


lower_cast(types.float64, Vectors)(
    lambda _context, builder, _number, _vector, value: _of_all(builder, value)
)
for _name, _act in (('add', 'fadd'), ('sub', 'fsub'), ('mul', 'fmul')):
    for _function in (getattr(operator, _name), getattr(operator, f'i{_name}')):
        compiled(_function, _V, _V, _V)(
            lambda _context, builder, a, b, act=_act: getattr(builder, act)(a, b)
        )


@compiled(operator.getitem, _V, _TABLE, types.int64)
def _numbers(_context: Any, builder: Any, table: Any, place: Any) -> Any:
    data, size = (builder.extract_value(table, i) for i in range(2))
    first = builder.bitcast(builder.gep(data, [place]), _VECTOR.as_pointer())
    left = builder.sub(size, place)
    with builder.if_else(builder.icmp_signed('>=', left, _WORD(LANES))) as (whole, part):
        with whole:
            numbers, at = builder.load(first, align=8), builder.basic_block
        with part:
            lanes = ir.VectorType(_WORD, LANES)(list(range(LANES)))
            is_there = builder.icmp_signed('<', lanes, _of_all(builder, left))
            load = cgutils.get_or_insert_function(
                builder.module,
                ir.FunctionType(_VECTOR, [first.type, ir.IntType(32), is_there.type, _VECTOR]),
                f'llvm.masked.load.v{LANES}f64.p0v{LANES}f64',
            )
            rest = builder.call(load, [first, ir.IntType(32)(8), is_there, _VECTOR([0.0] * LANES)])
            at_rest = builder.basic_block
    result = builder.phi(_VECTOR)
    result.add_incoming(numbers, at)
    result.add_incoming(rest, at_rest)
    return result


def teach(passes: Any, lanes: Any, added: Any, joined: Any) -> None:
    """Tell numba what the functions of `rpo_core.kernels.simd` are in compiled kernels."""
    compiled(passes, types.int64)(lambda _context, _builder: _WORD(1))

    @compiled(lanes, _TABLE, _NUMBERS)
    def _lanes(context: Any, builder: Any, table: Any) -> Any:
        array = context.make_array(_NUMBERS)(context, builder, table)
        return cgutils.pack_struct(builder, [array.data, array.nitems])

    @compiled(added, types.float64, types.float64, _V)
    def _added(_context: Any, builder: Any, total: Any, partial: Any) -> Any:
        for lane in range(LANES):
            total = builder.fadd(total, builder.extract_element(partial, _WORD(lane)))
        return total

    @compiled(joined, _V, _V, _V, _V)
    def _joined(_context: Any, builder: Any, grade: Any, other: Any, limit: Any) -> Any:
        smaller = builder.fcmp_ordered('<', other, limit)
        clipped = builder.select(smaller, other, limit)
        return builder.select(builder.fcmp_ordered('>', clipped, grade), clipped, grade)
