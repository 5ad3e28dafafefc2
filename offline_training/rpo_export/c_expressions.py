# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Expressions of a kernel in C99: the same operations, in the same order."""

from __future__ import annotations

import ast
import math
from collections.abc import Callable, Mapping
from types import ModuleType
from typing import Any, NamedTuple, Protocol

from rpo_core.files.validation import InputError
from rpo_export.kernel_source import Type, is_kernel

_BINARY = {ast.Add: ('+', 9), ast.Sub: ('-', 9), ast.Mult: ('*', 10), ast.Div: ('/', 10)}
_COMPARE = {
    ast.Lt: '<', ast.LtE: '<=', ast.Gt: '>', ast.GtE: '>=', ast.Eq: '==', ast.NotEq: '!='
}  # fmt: skip
_CHOICE, _OR, _AND, _COMPARED, _UNARY, WHOLE = 1, 2, 3, 6, 11, 12  # how tightly C binds them
_KEYWORDS = frozenset((
    'auto', 'break', 'case', 'char', 'const', 'continue', 'default', 'do', 'double', 'else',
    'enum', 'extern', 'float', 'for', 'goto', 'if', 'inline', 'int', 'long', 'register',
    'restrict', 'return', 'short', 'signed', 'sizeof', 'static', 'struct', 'switch', 'typedef',
    'union', 'unsigned', 'void', 'volatile', 'while',
))  # fmt: skip


class Written(NamedTuple):
    """A function in C."""

    name: str
    text: str
    parameters: tuple[Type, ...]
    returns: Type


class Expression(NamedTuple):
    """An expression in C, how tightly it binds, and its type."""

    text: str
    rank: int
    type: Type

    def within(self, rank: int) -> str:
        """Return it as a part of an expression of a rank."""
        return self.text if self.rank >= rank else f'({self.text})'


class Surroundings(Protocol):
    """The source that a function is part of: `rpo_export.c_source.Source`."""

    def spelled(self, kind: Type) -> str:
        """Return a type as C has it."""

    def constant(self, name: str, value: float) -> str:
        """Return the name of a constant of a module."""

    def field(self, record: type, name: str) -> Type:
        """Return the type of a field of a record, which is read."""

    def function(self, kernel: Callable[..., Any], given: tuple[Type, ...]) -> Written:
        """Return a kernel in C."""


def own_name(name: str) -> str:
    """Return the name of a variable in C."""
    return 'turn' if name == '_' else f'{name}_' if name in _KEYWORDS else name


def number(value: Any) -> str:
    """Return a number as C has it, bit for bit; raises InputError if it is not finite."""
    if isinstance(value, bool):
        return str(int(value))
    if not isinstance(value, (int, float)) or not math.isfinite(value):
        raise InputError(f'a constant of a kernel must be a finite number; got {value!r}')
    return repr(value)


class Expressions:
    """The expressions of one function.

    types : of the variables that are known so far
    names : globals of the module of the function
    """

    def __init__(self, source: Surroundings, names: Mapping[str, Any], where: str) -> None:
        self._source, self._names, self._where = source, names, where
        self.types: dict[str, Type] = {}

    def of(self, node: ast.expr, wanted: Type = None) -> Expression:
        """Return an expression; raises InputError for what kernels do not use.

        wanted : type of a tuple, which the tuple itself does not say
        """
        method: Any = getattr(self, f'_{type(node).__name__.lower()}', None)
        if method is None:
            raise self.refused(node)
        if isinstance(node, (ast.Tuple, ast.IfExp)):
            return method(node, wanted)
        return method(node)

    def refused(self, node: ast.AST) -> InputError:
        """Return the error for what C does not get."""
        return InputError(
            f'kernel `{self._where}` must have + - * /, comparisons, if, loops over range, tuples '
            f'and calls of kernels alone, to be C; got {ast.unparse(node)}'
        )

    def _name(self, node: ast.Name) -> Expression:
        if node.id in self.types:
            return Expression(own_name(node.id), WHOLE, self.types[node.id])
        return self._global(node.id, self._names.get(node.id), node)

    def _global(self, name: str, value: Any, node: ast.expr) -> Expression:
        if not isinstance(value, (int, float)):
            raise self.refused(node)
        kind = 'double' if isinstance(value, float) else 'int'
        return Expression(self._source.constant(name, value), WHOLE, kind)

    def _constant(self, node: ast.Constant) -> Expression:
        kind = 'double' if isinstance(node.value, float) else 'int'
        return Expression(number(node.value), WHOLE, kind)

    def _attribute(self, node: ast.Attribute) -> Expression:
        module = self._module(node.value)
        if module is not None:
            return self._global(node.attr, getattr(module, node.attr), node)
        record = self.of(node.value)
        kind = self._source.field(record.type, node.attr)
        return Expression(f'{record.text}->{own_name(node.attr)}', WHOLE, kind)

    def _module(self, node: ast.expr) -> ModuleType | None:
        found = self._names.get(node.id) if isinstance(node, ast.Name) else None
        return found if isinstance(found, ModuleType) else None

    def _subscript(self, node: ast.Subscript) -> Expression:
        whole, index = self.of(node.value), self.of(node.slice)
        text = whole.within(WHOLE)
        if whole.type == 'rows':
            row = f'(table){{{text}.at + {text}.width * ({index.text}), {text}.width}}'
            return Expression(row, WHOLE, 'table')
        if whole.type in ('table', 'ints'):
            kind = 'int' if whole.type == 'ints' else 'double'
            return Expression(f'{text}.at[{index.text}]', WHOLE, kind)
        if not isinstance(whole.type, tuple):
            raise self.refused(node)
        return self.part(whole, index.text, node)

    def part(self, whole: Expression, index: str, node: ast.AST) -> Expression:
        """Return an element of a tuple."""
        if set(whole.type) == {'double'}:
            return Expression(f'{whole.text}.at[{index}]', WHOLE, 'double')
        if not index.isdigit():
            raise self.refused(node)
        return Expression(f'{whole.text}.f{index}', WHOLE, whole.type[int(index)])

    def _unaryop(self, node: ast.UnaryOp) -> Expression:
        value = self.of(node.operand)
        if isinstance(node.op, ast.Not):
            return Expression(f'!{value.within(_UNARY + 1)}', _UNARY, 'int')
        if not isinstance(node.op, ast.USub):
            raise self.refused(node)
        return Expression(f'-{value.within(_UNARY + 1)}', _UNARY, value.type)

    def _binop(self, node: ast.BinOp) -> Expression:
        if type(node.op) not in _BINARY:
            raise self.refused(node)
        sign, rank = _BINARY[type(node.op)]
        left, right = self.of(node.left), self.of(node.right)
        kind = 'double' if 'double' in (left.type, right.type) else 'int'
        first = left.within(rank)
        if isinstance(node.op, ast.Div) and kind == 'int':
            first, kind = f'(double){left.within(_UNARY)}', 'double'
        return Expression(f'{first} {sign} {right.within(rank + 1)}', rank, kind)

    def _compare(self, node: ast.Compare) -> Expression:
        if not all(type(op) in _COMPARE for op in node.ops):
            raise self.refused(node)
        parts = [self.of(part).within(_COMPARED + 2) for part in (node.left, *node.comparators)]
        tests = [f'{parts[i]} {_COMPARE[type(op)]} {parts[i + 1]}' for i, op in enumerate(node.ops)]
        return Expression(' && '.join(tests), _COMPARED if len(tests) == 1 else _AND, 'int')

    def _boolop(self, node: ast.BoolOp) -> Expression:
        sign, rank = ('||', _OR) if isinstance(node.op, ast.Or) else ('&&', _AND)
        tests = [self.of(value).within(_COMPARED) for value in node.values]
        return Expression(f' {sign} '.join(tests), rank, 'int')

    def _ifexp(self, node: ast.IfExp, wanted: Type) -> Expression:
        test = self.of(node.test).within(_CHOICE + 1)
        yes, no = self.of(node.body, wanted), self.of(node.orelse, wanted)
        kind = yes.type if yes.type == no.type else 'double'
        text = f'{test} ? {yes.within(_CHOICE + 1)} : {no.within(_CHOICE + 1)}'
        return Expression(text, _CHOICE, kind)

    def _tuple(self, node: ast.Tuple, wanted: Type) -> Expression:
        found = [self.of(value) for value in node.elts]
        kind = wanted if isinstance(wanted, tuple) else tuple(one.type for one in found)
        texts = ', '.join(one.text for one in found)
        name = self._source.spelled(kind)
        inner = f'{{{{{texts}}}}}' if set(kind) == {'double'} else f'{{{texts}}}'
        return Expression(f'({name}){inner}', WHOLE, kind)

    def _call(self, node: ast.Call) -> Expression:
        module = self._module(node.func.value) if isinstance(node.func, ast.Attribute) else None
        if module is not None and isinstance(node.func, ast.Attribute):
            called: Any = getattr(module, node.func.attr)
        elif isinstance(node.func, ast.Name):
            name = node.func.id
            called = self._names.get(name, {'len': len, 'abs': abs, 'int': int}.get(name))
        else:
            raise self.refused(node)
        given = [self.of(argument) for argument in node.args]
        if called is len and isinstance(given[0].type, str):
            return Expression(f'{given[0].text}.count', WHOLE, 'int')
        if called in (math.sqrt, abs):
            name = 'sqrt' if called is math.sqrt else 'fabs'
            return Expression(f'{name}({given[0].text})', WHOLE, 'double')
        if called is int:
            return Expression(f'(int){given[0].within(_UNARY)}', _UNARY, 'int')
        if not is_kernel(called) or node.keywords:
            raise self.refused(node)
        written = self._source.function(called, tuple(one.type for one in given))
        texts = (
            self.of(argument, kind).text
            for argument, kind in zip(node.args, written.parameters, strict=True)
        )
        return Expression(f'{written.name}({", ".join(texts)})', WHOLE, written.returns)
