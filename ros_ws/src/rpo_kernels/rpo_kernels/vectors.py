# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Scalar kernels for eight flights at once: what numba (`rpo_kernels.jit`) makes of them for lanes.

A kernel that gets a table of lanes (`lanes_at`) in the place of a flat table of floats is compiled
anew for it. Each number is then a SIMD vector of eight, one of each flight; + - * / sqrt and
comparisons act lane by lane, so each flight has the bits that the scalar kernel gives it. Constants
are the same in all lanes.

A branch must go one way in all lanes, and a number that becomes an integer must be the same one:
otherwise the kernel raises ArithmeticError, and the caller computes those flights one by one. Where
lanes often differ, a kernel says `pick` instead of `if`.
"""

from __future__ import annotations

import math
import operator
from typing import Any

from rpo_kernels.jit import COMPILED

WIDTH = 8 if COMPILED else 1
"""Flights in a vector. Interpreted kernels take one at a time."""


def pick(test: bool, a: float, b: float) -> float:
    """Return a where a test holds, else b."""
    return a if test else b


def lanes_at(table: Any, place: int) -> Any:
    """Return a flat table from a place on as rows of `WIDTH` numbers, one of each flight."""
    return table[place:]


def wide(table: Any) -> Any:
    """Return a flat table of which each place stands for it and the `WIDTH` - 1 after it."""
    return table


def _register() -> None:
    """Tell numba of vectors, of masks (what comparing them gives), and of their tables."""
    from llvmlite import ir  # type: ignore[import-untyped]
    from numba.core import cgutils, types
    from numba.core.typing.templates import ConcreteTemplate, infer_global, signature
    from numba.extending import (
        intrinsic,
        lower_builtin,
        lower_cast,
        models,
        overload,
        register_model,
    )

    double, word = ir.DoubleType(), ir.IntType(64)

    def made(data: Any, kind: Any) -> Any:
        register_model(kind)(type('', (models.PrimitiveModel,), {
            '__init__': lambda self, manager, typed: models.PrimitiveModel.__init__(
                self, manager, typed, data
            )
        }))  # fmt: skip
        return kind()

    V = made(ir.VectorType(double, WIDTH), Vectors)
    M = made(ir.VectorType(ir.IntType(1), WIDTH), Masks)
    T, Wide = made(double.as_pointer(), Tables), made(double.as_pointer(), WideTables)

    def known(function: Any, result: Any, *arguments: Any) -> Any:
        """Give a function a meaning for these types; decorates what builds it."""
        cases = {'key': function, 'cases': [signature(result, *arguments)]}
        infer_global(function)(type('', (ConcreteTemplate,), cases))

        def lowered(build: Any) -> Any:
            lower_builtin(function, *arguments)(
                lambda context, builder, signed, given: build(context, builder, *given)
            )
            return build

        return lowered

    def broadcast(builder: Any, value: Any) -> Any:
        vector = ir.Constant(V_TYPE, ir.Undefined)
        vector = builder.insert_element(vector, value, ir.Constant(ir.IntType(32), 0))
        zeros = ir.Constant(ir.VectorType(ir.IntType(32), WIDTH), [0] * WIDTH)
        return builder.shuffle_vector(vector, vector, zeros)

    V_TYPE = ir.VectorType(double, WIDTH)

    @lower_cast(types.Number, Vectors)
    def _cast(context, builder, fromty, toty, value):  # type: ignore[no-untyped-def]
        return broadcast(builder, context.cast(builder, value, fromty, types.float64))

    def all_alike(context: Any, builder: Any, mask: Any) -> Any:
        bits = builder.bitcast(mask, ir.IntType(WIDTH))
        everywhere = builder.icmp_unsigned('==', bits, ir.Constant(bits.type, 2**WIDTH - 1))
        nowhere = builder.icmp_unsigned('==', bits, ir.Constant(bits.type, 0))
        with cgutils.if_unlikely(builder, builder.not_(builder.or_(everywhere, nowhere))):
            context.call_conv.return_user_exc(builder, ArithmeticError, ('lanes differ',))
        return everywhere

    @lower_cast(Masks, types.Boolean)
    def _truth(context, builder, fromty, toty, value):  # type: ignore[no-untyped-def]
        return all_alike(context, builder, value)

    for name, instruction in (('add', 'fadd'), ('sub', 'fsub'), ('mul', 'fmul'),
                              ('truediv', 'fdiv')):  # fmt: skip
        for function in (getattr(operator, name), getattr(operator, f'i{name}')):
            known(function, V, V, V)(
                lambda context, builder, a, b, act=instruction: getattr(builder, act)(a, b)
            )
    for name, sign in (('lt', '<'), ('le', '<='), ('gt', '>'), ('ge', '>='), ('eq', '==')):
        known(getattr(operator, name), M, V, V)(
            lambda context, builder, a, b, sign=sign: builder.fcmp_ordered(sign, a, b)
        )
    known(operator.ne, M, V, V)(
        lambda context, builder, a, b: builder.fcmp_unordered('!=', a, b)
    )
    known(operator.neg, V, V)(lambda context, builder, a: builder.fneg(a))

    def called(name: str) -> Any:
        def build(context: Any, builder: Any, a: Any) -> Any:
            kind = ir.FunctionType(a.type, [a.type])
            full = f'llvm.{name}.v{WIDTH}f64'
            return builder.call(cgutils.get_or_insert_function(builder.module, kind, full), [a])

        return build

    known(math.sqrt, V, V)(called('sqrt'))
    known(abs, V, V)(called('fabs'))
    known(bool, types.boolean, M)(all_alike)
    known(operator.not_, types.boolean, M)(
        lambda context, builder, mask: builder.not_(all_alike(context, builder, mask))
    )

    def count(context: Any, builder: Any, a: Any, mask: Any) -> Any:
        return builder.add(a, builder.zext(all_alike(context, builder, mask), word))

    known(operator.add, types.int64, types.int64, M)(count)
    known(operator.iadd, types.int64, types.int64, M)(count)

    @known(int, types.int64, V)
    def _int(context, builder, a):  # type: ignore[no-untyped-def]
        whole = called('trunc')(context, builder, a)
        first = builder.extract_element(whole, ir.Constant(ir.IntType(32), 0))
        alike = builder.fcmp_ordered('==', whole, broadcast(builder, first))
        all_alike(context, builder, alike)
        return builder.fptosi(first, word)

    def place(builder: Any, table: Any, index: Any, step: int) -> Any:
        return builder.gep(table, [builder.mul(index, ir.Constant(word, step))])

    def readable(kind: Any, step: int) -> None:
        def row(builder: Any, table: Any, index: Any) -> Any:
            return builder.bitcast(place(builder, table, index, step), V_TYPE.as_pointer())

        @known(operator.getitem, V, kind, types.int64)
        def _get(context, builder, table, index):  # type: ignore[no-untyped-def]
            return builder.load(row(builder, table, index), align=8)

        @known(operator.setitem, types.none, kind, types.int64, V)
        def _set(context, builder, table, index, value):  # type: ignore[no-untyped-def]
            builder.store(value, row(builder, table, index), align=8)
            return context.get_dummy_value()

    readable(T, WIDTH)
    readable(Wide, 1)

    @known(operator.getitem, T, T, types.slice2_type)
    def _part(context, builder, table, part):  # type: ignore[no-untyped-def]
        first = context.make_helper(builder, types.slice2_type, part).start
        return place(builder, table, first, WIDTH)

    def data_of(context: Any, builder: Any, signed: Any, table: Any) -> Any:
        return context.make_array(signed.args[0])(context, builder, table).data

    @intrinsic
    def table_at(typing, table, index):  # type: ignore[no-untyped-def]
        def build(context, builder, signed, given):  # type: ignore[no-untyped-def]
            return place(builder, data_of(context, builder, signed, given[0]), given[1], 1)

        return T(table, types.int64), build

    @intrinsic
    def wide_table(typing, table):  # type: ignore[no-untyped-def]
        def build(context, builder, signed, given):  # type: ignore[no-untyped-def]
            return data_of(context, builder, signed, given[0])

        return Wide(table), build

    @intrinsic
    def selected(typing, test, a, b):  # type: ignore[no-untyped-def]
        return V(M, V, V), lambda context, builder, signed, given: builder.select(*given)

    @overload(lanes_at, jit_options={'forceinline': True})
    def _lanes_at(table, place):  # type: ignore[no-untyped-def]
        return lambda table, place: table_at(table, place)

    @overload(wide, jit_options={'forceinline': True})
    def _wide(table):  # type: ignore[no-untyped-def]
        return lambda table: wide_table(table)

    @overload(pick, jit_options={'forceinline': True})
    def _pick(test, a, b):  # type: ignore[no-untyped-def]
        if isinstance(test, Masks):
            return lambda test, a, b: selected(test, a, b)
        return lambda test, a, b: a if test else b


if COMPILED:
    from numba.core import types
    from numba.core.typeconv import Conversion

    class Vectors(types.Type):  # type: ignore[misc]
        """Eight numbers, one of each flight."""

        def __init__(self) -> None:
            super().__init__(f'{__name__}.Vectors')

        def unify(self, context: Any, other: Any) -> Any:
            """Return this type where it meets a number."""
            return self if isinstance(other, types.Number) else None

        def can_convert_from(self, context: Any, other: Any) -> Any:
            """Say that a number becomes a vector of it."""
            return Conversion.safe if isinstance(other, types.Number) else None

    class Masks(types.Type):  # type: ignore[misc]
        """Eight truths."""

        def __init__(self) -> None:
            super().__init__(f'{__name__}.Masks')

        def unify(self, context: Any, other: Any) -> Any:
            """Return a truth where it meets one: then it is the same in all lanes."""
            return other if isinstance(other, types.Boolean) else None

        def can_convert_to(self, context: Any, other: Any) -> Any:
            """Say that it becomes a truth."""
            return Conversion.unsafe if isinstance(other, types.Boolean) else None

    class Tables(types.Type):  # type: ignore[misc]
        """Rows of eight numbers."""

        def __init__(self) -> None:
            super().__init__(f'{__name__}.Tables')

    class WideTables(types.Type):  # type: ignore[misc]
        """Numbers side by side."""

        def __init__(self) -> None:
            super().__init__(f'{__name__}.WideTables')

    _register()
