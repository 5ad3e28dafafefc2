# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The kernel that answers for a controller, and its source without what its constants exclude.

A kernel (`rpo_core.kernels.jit`) is a function of floats, tuples of floats and tables, with
annotations.
"""

from __future__ import annotations

import ast
import inspect
import textwrap
import types
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple, get_args, get_origin, get_type_hints

import numpy as np

from rpo_core.control import inference
from rpo_core.control.baselines import Baseline, baseline_force
from rpo_core.control.controller import AnyController, FuzzyController
from rpo_core.files.validation import InputError, shown
from rpo_core.kernels.arithmetic import State, Vector, saturate

Type = Any
"""'double', 'int', or a table: 'table' of floats, 'ints', 'rows' of floats, 'scratch' that kernels
fill; a tuple of types; 'void'; a class of constants (NamedTuple); or a `Record` or an `Array`."""


@dataclass(frozen=True)
class Record:
    """Where a record is (`rpo_core.kernels.records`), which a kernel may write unless it is const.

    base : its class; is_value : whether it is the record itself, which a kernel made
    """

    base: Any
    is_const: bool
    is_value: bool = False


@dataclass(frozen=True)
class Array:
    """Where numbers or records are, as a `Field` of a record has them.

    shape : None in the place of a length that is not fixed, 0 of one that C is not told
    """

    base: Any
    shape: tuple[int | None, ...]
    is_const: bool


_SCALARS = {float: 'double', int: 'int', bool: 'int', type(None): 'void'}


class AlikeGains(NamedTuple):
    """Rows (k, d) of gains that are the same on each axis, a row a tick; and the limit."""

    gains: Any
    limit: float


def alike_force(state: State, tick: int, law: AlikeGains) -> Vector:
    """Force [N] of a law that treats all axes alike, with the bits of that for any gains."""
    x, y, z, vx, vy, vz = state
    last = len(law.gains) - 1
    row = law.gains[tick if tick < last else last]
    k, d = row[0], row[1]
    fx = -(k * x + 0.0 * y + 0.0 * z + d * vx + 0.0 * vy + 0.0 * vz)
    fy = -(0.0 * x + k * y + 0.0 * z + 0.0 * vx + d * vy + 0.0 * vz)
    fz = -(0.0 * x + 0.0 * y + k * z + 0.0 * vx + 0.0 * vy + d * vz)
    return saturate(fx, law.limit), saturate(fy, law.limit), saturate(fz, law.limit)


class Law(NamedTuple):
    """What answers a state: a kernel of state, scales or tick, and tables.

    scales : of the paper's fuzzy system; empty: the kernel takes the tick
    """

    kernel: Callable[..., Vector]
    tables: Any
    scales: tuple[float, ...] = ()


def law_of(controller: AnyController) -> Law:
    """Return what answers for a controller; raises InputError if that is no kernel."""
    if isinstance(controller, FuzzyController):
        return Law(inference.fuzzy_force, controller.system.tables, controller.scales)
    if not isinstance(controller, Baseline):
        raise InputError(
            f'source code needs a fuzzy controller or one that answers by `kernel`, like those of '
            f'`rpo_core.control.baselines`; got kind {shown(controller.kind)}'
        )
    kernel, tables = controller.kernel()
    gains = getattr(tables, 'gains', ())
    if kernel is baseline_force and controller.alike and len(gains):
        kernel, tables = alike_force, AlikeGains(np.asarray(gains)[:, [0, 3]], tables.limit)
    return Law(kernel, tables)


def type_of(annotation: Any) -> Type:
    """Return the type of an annotation; None for a table, whose type the caller knows."""
    if annotation in _SCALARS:
        return _SCALARS[annotation]
    if get_origin(annotation) is tuple:
        return tuple(map(type_of, get_args(annotation)))
    return annotation if isinstance(annotation, type) and issubclass(annotation, tuple) else None


def type_of_value(value: Any) -> Type:
    """Return the type of a number or table."""
    if isinstance(value, (int, float)):
        return _SCALARS[type(value)]
    array = np.asarray(value)
    if array.ndim == 2:
        return 'rows'
    return 'ints' if array.dtype.kind == 'i' else 'table'


def plain(function: Any) -> Any:
    """Return the Python function of a kernel."""
    return getattr(function, 'py_func', function)  # numba keeps it there


def is_kernel(value: Any) -> bool:
    """Whether a global of a kernel is a function that it calls."""
    return isinstance(plain(value), types.FunctionType)


class Read(NamedTuple):
    """A kernel: its definition, the types of its annotations, the globals of its module."""

    tree: ast.FunctionDef
    hints: dict[str, Type]
    names: Mapping[str, Any]


def read(function: Callable[..., Any], constants: Mapping[type, Any]) -> Read:
    """Return a kernel without its annotations and decorator, and without what constants exclude.

    constants : class -> the one value of it; an argument of that class is this value
    """
    function = plain(function)
    is_function = isinstance(function, types.FunctionType)
    node = ast.parse(textwrap.dedent(inspect.getsource(function))).body[0] if is_function else None
    if not isinstance(node, ast.FunctionDef):
        raise InputError(f'a kernel must be a plain function; got {function!r}')
    node.decorator_list, node.returns = [], None
    hints = {name: type_of(annotation) for name, annotation in get_type_hints(function).items()}
    for argument in node.args.args:
        argument.annotation = None
    known = {name: constants[kind] for name, kind in hints.items() if kind in constants}
    tree = _Decided(node, known, function.__globals__).tree
    while _Unread(tree).found:
        pass
    return Read(tree, hints, function.__globals__)


class _Unread(ast.NodeTransformer):
    """Takes out what is stored and never read: its reader was excluded."""

    def __init__(self, tree: ast.FunctionDef) -> None:
        self._loaded = {
            part.id
            for part in ast.walk(tree)
            if isinstance(part, ast.Name) and isinstance(part.ctx, ast.Load)
        }
        self.found = False
        self.visit(tree)

    def visit_Assign(self, node: ast.Assign) -> ast.Assign | ast.Expr | None:
        """Return None for a variable that nothing reads; a call may write more than it returns."""
        target = node.targets[0]
        if len(node.targets) > 1 or not isinstance(target, ast.Name) or target.id in self._loaded:
            return node
        self.found = True
        return ast.Expr(node.value) if isinstance(node.value, ast.Call) else None


class _Decided(ast.NodeTransformer):
    """A function without the branches that its constants exclude."""

    def __init__(
        self, node: ast.FunctionDef, known: Mapping[str, Any], names: Mapping[str, Any]
    ) -> None:
        own = {part.id for part in ast.walk(node) if isinstance(part, ast.Name)
               and isinstance(part.ctx, ast.Store)}  # fmt: skip
        own |= {argument.arg for argument in node.args.args}
        numbers = {n: v for n, v in names.items() if isinstance(v, (int, float)) and n not in own}
        self._known = {**numbers, 'COMPILED': True, **known, 'len': len, '__builtins__': {}}
        node.body = self._block(node.body)
        self.tree = node

    def _value(self, node: ast.expr) -> bool | None:
        """Return whether a test holds; None if that depends on more than the constants."""
        for part in ast.walk(node):
            if isinstance(part, ast.Call) and ast.unparse(part.func) != 'len':
                return None
            if isinstance(part, ast.Name) and part.id not in self._known:
                return None
        code = compile(ast.fix_missing_locations(ast.Expression(node)), 'kernel', 'eval')
        return bool(eval(code, dict(self._known)))

    def visit_BoolOp(self, node: ast.BoolOp) -> ast.expr:
        """Return the operands that are not known, or what the others decide."""
        self.generic_visit(node)
        ends = isinstance(node.op, ast.Or)
        values = [(value, self._value(value)) for value in node.values]
        if any(known is ends for _, known in values):
            return ast.Constant(ends)
        left = [value for value, known in values if known is None]
        if not left:
            return ast.Constant(not ends)
        return left[0] if len(left) == 1 else ast.BoolOp(node.op, left)

    def visit_IfExp(self, node: ast.IfExp) -> ast.expr:
        """Return the side that is known to be taken."""
        self.generic_visit(node)
        known = self._value(node.test)
        return node if known is None else (node.body if known else node.orelse)

    def visit_If(self, node: ast.If) -> Any:
        """Return the statements that are known to be taken."""
        node.test = self.visit(node.test)
        known = self._value(node.test)
        if known is not None:
            return self._block(node.body if known else node.orelse)
        node.body, node.orelse = self._block(node.body), self._block(node.orelse)
        return node

    def _block(self, statements: list[ast.stmt]) -> list[ast.stmt]:
        taken: list[ast.stmt] = []
        for statement in statements:
            new = self.visit(statement)
            taken += new if isinstance(new, list) else [new]
            if taken and isinstance(taken[-1], ast.Return):
                break
        return taken
