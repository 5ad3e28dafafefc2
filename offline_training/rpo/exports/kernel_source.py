# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The source of a kernel (`rpo_core.kernels.jit`), and the types of what it reads and writes."""

from __future__ import annotations

import ast
import inspect
import textwrap
import types
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple, get_args, get_origin, get_type_hints

from rpo_core.files.validation import InputError

Type = Any
"""'double', 'int' or 'void'; a tuple of types; a class of named tuples; a `Record`, an `Array`."""


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


def type_of(annotation: Any) -> Type:
    """Return the type of an annotation; None for one that the caller knows."""
    if annotation in _SCALARS:
        return _SCALARS[annotation]
    if get_origin(annotation) is tuple:
        return tuple(map(type_of, get_args(annotation)))
    return annotation if isinstance(annotation, type) and issubclass(annotation, tuple) else None


def type_of_value(value: Any) -> Type:
    """Return the type of a number."""
    return _SCALARS[type(value)]


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


def read(function: Callable[..., Any]) -> Read:
    """Return a kernel without its annotations and decorator, and as it is compiled."""
    function = plain(function)
    is_function = isinstance(function, types.FunctionType)
    node = ast.parse(textwrap.dedent(inspect.getsource(function))).body[0] if is_function else None
    if not isinstance(node, ast.FunctionDef):
        raise InputError(f'a kernel must be a plain function; got {function!r}')
    node.decorator_list, node.returns = [], None
    hints = {name: type_of(annotation) for name, annotation in get_type_hints(function).items()}
    for argument in node.args.args:
        argument.annotation = None
    return Read(_Compiled().visit(node), hints, function.__globals__)


class _Compiled(ast.NodeTransformer):
    """Takes out the branches that interpreted kernels alone take."""

    def visit_If(self, node: ast.If) -> Any:
        """Return the statements that are taken."""
        self.generic_visit(node)
        taken = {'COMPILED': node.body, 'not COMPILED': node.orelse}
        return taken.get(ast.unparse(node.test), node)
