# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Vectors, masks and tables of vectors for numba: what `rpo_core.kernels.vectors` describes."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from functools import partial
from typing import Any

from llvmlite import ir  # type: ignore[import-untyped]
from numba.core import cgutils, types
from numba.core.typeconv import Conversion
from numba.core.typing.templates import ConcreteTemplate, infer_global, signature
from numba.extending import (
    intrinsic,
    lower_builtin,
    lower_cast,
    models,
    overload,
    register_model,
)

WIDTH = 8
"""Numbers in a vector: a register of AVX-512, two of AVX2."""

_WORD = ir.IntType(64)
_VECTOR = ir.VectorType(ir.DoubleType(), WIDTH)
_Build = Callable[..., Any]


class Vectors(types.Type):
    """One number of each flight; a number that meets one becomes a vector of it."""

    data = _VECTOR

    def unify(self, _context: Any, other: Any) -> Any:
        """Return what a variable is that is sometimes this, sometimes another type."""
        return self if isinstance(other, types.Number) else None

    def can_convert_from(self, _context: Any, other: Any) -> Any:
        """Return whether another type becomes this one."""
        return Conversion.safe if isinstance(other, types.Number) else None


class Masks(types.Type):
    """One truth of each flight; where a branch asks for one, all must be the same."""

    data = ir.VectorType(ir.IntType(1), WIDTH)

    def unify(self, _context: Any, other: Any) -> Any:
        """Return what a variable is that is sometimes this, sometimes another type."""
        return other if isinstance(other, types.Boolean) else None

    def can_convert_to(self, _context: Any, other: Any) -> Any:
        """Return whether this becomes another type."""
        return Conversion.unsafe if isinstance(other, types.Boolean) else None


class Tables(types.Type):
    """A place of a flat table of floats; step : floats from a vector to the next."""

    data = ir.DoubleType().as_pointer()

    def __init__(self, step: int) -> None:
        self.step = step
        super().__init__(f'Tables({step})')


def _model(kind: Any, manager: Any, typed: Any) -> Any:
    return models.PrimitiveModel(manager, typed, kind.data)


for _kind in (Vectors, Masks, Tables):
    register_model(_kind)(partial(_model, _kind))

_V, _M = Vectors('Vectors'), Masks('Masks')


def _known(function: Any, result: Any, *arguments: Any) -> Callable[[_Build], _Build]:
    """Give a function a meaning for types; decorates what builds it from (context, builder, …)."""
    cases = {'key': function, 'cases': [signature(result, *arguments)]}
    infer_global(function)(type('Template', (ConcreteTemplate,), cases))

    def lowered(build: _Build) -> _Build:
        lower_builtin(function, *arguments)(
            lambda context, builder, _signature, given: build(context, builder, *given)
        )
        return build

    return lowered


def _of_all(builder: Any, value: Any) -> Any:
    """Return a vector of one number."""
    one = ir.IntType(32)
    vector = builder.insert_element(ir.Constant(_VECTOR, ir.Undefined), value, one(0))
    zeros = ir.Constant(ir.VectorType(one, WIDTH), [0] * WIDTH)
    return builder.shuffle_vector(vector, vector, zeros)


def _from_number(context: Any, builder: Any, given: Any, _wanted: Any, value: Any) -> Any:
    return _of_all(builder, context.cast(builder, value, given, types.float64))


lower_cast(types.Number, Vectors)(_from_number)


@_known(bool, types.boolean, _M)
def _alike(context: Any, builder: Any, mask: Any) -> Any:
    """Return the one truth of a mask; raise where flights differ."""
    bits = builder.bitcast(mask, ir.IntType(WIDTH))
    yes = builder.icmp_unsigned('==', bits, bits.type(2**WIDTH - 1))
    no = builder.icmp_unsigned('==', bits, bits.type(0))
    with cgutils.if_unlikely(builder, builder.not_(builder.or_(yes, no))):
        context.call_conv.return_user_exc(builder, ArithmeticError, ('flights differ',))
    return yes


lower_cast(Masks, types.Boolean)(
    lambda context, builder, _given, _wanted, mask: _alike(context, builder, mask)
)


@_known(operator.not_, types.boolean, _M)
def _not(context: Any, builder: Any, mask: Any) -> Any:
    return builder.not_(_alike(context, builder, mask))


@_known(operator.add, types.int64, types.int64, _M)
@_known(operator.iadd, types.int64, types.int64, _M)
def _count(context: Any, builder: Any, number: Any, mask: Any) -> Any:
    return builder.add(number, builder.zext(_alike(context, builder, mask), _WORD))


def _called(name: str, _context: Any, builder: Any, value: Any) -> Any:
    kind = ir.FunctionType(_VECTOR, [_VECTOR])
    name = f'llvm.{name}.v{WIDTH}f64'
    return builder.call(cgutils.get_or_insert_function(builder.module, kind, name), [value])


for _function, _name in ((math.sqrt, 'sqrt'), (abs, 'fabs')):
    _known(_function, _V, _V)(partial(_called, _name))
_known(operator.neg, _V, _V)(lambda _context, builder, a: builder.fneg(a))
for _name, _act in (('add', 'fadd'), ('sub', 'fsub'), ('mul', 'fmul'), ('truediv', 'fdiv')):
    for _function in (getattr(operator, _name), getattr(operator, f'i{_name}')):
        _known(_function, _V, _V, _V)(
            lambda _context, builder, a, b, act=_act: getattr(builder, act)(a, b)
        )
for _name, _sign in (('lt', '<'), ('le', '<='), ('gt', '>'), ('ge', '>='), ('eq', '==')):
    _known(getattr(operator, _name), _M, _V, _V)(
        lambda _context, builder, a, b, sign=_sign: builder.fcmp_ordered(sign, a, b)
    )
_known(operator.ne, _M, _V, _V)(lambda _context, builder, a, b: builder.fcmp_unordered('!=', a, b))


@_known(int, types.int64, _V)
def _int(context: Any, builder: Any, value: Any) -> Any:
    whole = _called('trunc', context, builder, value)
    first = builder.extract_element(whole, ir.IntType(32)(0))
    _alike(context, builder, builder.fcmp_ordered('==', whole, _of_all(builder, first)))
    return builder.fptosi(first, _WORD)


def _readable(table: Tables) -> None:
    """Let a table be read, written, and cut."""

    def place(_context: Any, builder: Any, data: Any, index: Any) -> Any:
        return builder.gep(data, [builder.mul(index, _WORD(table.step))])

    @_known(operator.getitem, _V, table, types.int64)
    def _get(context: Any, builder: Any, data: Any, index: Any) -> Any:
        at = builder.bitcast(place(context, builder, data, index), _VECTOR.as_pointer())
        return builder.load(at, align=8)

    @_known(operator.setitem, types.none, table, types.int64, _V)
    def _set(context: Any, builder: Any, data: Any, index: Any, value: Any) -> Any:
        at = builder.bitcast(place(context, builder, data, index), _VECTOR.as_pointer())
        builder.store(value, at, align=8)
        return context.get_dummy_value()

    @_known(operator.getitem, table, table, types.slice2_type)
    def _part(context: Any, builder: Any, data: Any, part: Any) -> Any:
        first = context.make_helper(builder, types.slice2_type, part).start
        return place(context, builder, data, first)


_LANES, _WIDE = Tables(WIDTH), Tables(1)
_readable(_LANES)
_readable(_WIDE)


def _table(kind: Tables) -> Any:
    """Return an intrinsic: a table (n,) of floats from a place on, as tables of this kind."""

    def table_at(_typing, table, place):  # type: ignore[no-untyped-def]
        def build(context: Any, builder: Any, signed: Any, given: Any) -> Any:
            data = context.make_array(signed.args[0])(context, builder, given[0]).data
            return builder.gep(data, [given[1]])

        return kind(table, types.int64), build

    return intrinsic(table_at)


_lanes_at, _wide_at = _table(_LANES), _table(_WIDE)


@intrinsic
def _picked(_typing, test, a, b):  # type: ignore[no-untyped-def]
    return _V(_M, _V, _V), lambda _context, builder, _signature, given: builder.select(*given)


def _pick(test, a, b):  # type: ignore[no-untyped-def]
    if isinstance(test, Masks):
        return lambda test, a, b: _picked(test, a, b)
    return lambda test, a, b: a if test else b


def teach(lanes_at: Any, wide: Any, pick: Any) -> None:
    """Tell numba what three functions of `rpo_core.kernels.vectors` are in compiled kernels."""
    inlined = partial(overload, jit_options={'forceinline': True})
    inlined(lanes_at)(lambda table, place: lambda table, place: _lanes_at(table, place))
    inlined(wide)(lambda table: lambda table: _wide_at(table, 0))
    inlined(pick)(_pick)
