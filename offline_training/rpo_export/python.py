# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A Python module without dependencies: the kernels' own source, and the tables as numbers."""

from __future__ import annotations

import ast
import math
from collections.abc import Callable
from typing import Any

import numpy as np

from rpo_core.control.controller import AnyController
from rpo_core.files.validation import InputError
from rpo_export import formats
from rpo_export.kernel_source import is_kernel, law_of, plain, read


def text(controller: AnyController) -> str:
    """Return the Python source of a controller; raises InputError if it answers by no kernel."""
    law = law_of(controller)
    trees, numbers = _collected(law.kernel, law.tables)
    fields = {part.attr for tree in trees.values() for part in ast.walk(tree)
              if isinstance(part, ast.Attribute)}  # fmt: skip
    tables = {name: value for name, value in law.tables._asdict().items() if name in fields}
    return formats.filled(
        'python',
        'module',
        facts='\n'.join(f'# {line}' for line in formats.facts(controller)),
        goal='\n'.join(formats.GOAL),
        name=formats.one_line(controller.name),
        constants=''.join(f'\n{name} = {value!r}' for name, value in numbers.items()),
        fields=repr(' '.join(tables)),
        tables='\n'.join(f'    {name}={_table(value)},' for name, value in tables.items()),
        kernel=plain(law.kernel).__name__,
        second=repr(law.scales) if law.scales else 'tick',
        functions='\n\n\n'.join(map(ast.unparse, trees.values())),
    )


def _collected(
    kernel: Callable[..., Any], tables: Any
) -> tuple[dict[str, ast.FunctionDef], dict[str, float]]:
    """Return the functions that a kernel needs, itself first, and the constants, by name."""
    trees: dict[str, ast.FunctionDef] = {}
    numbers: dict[str, float] = {}
    waiting = [kernel]
    while waiting:
        tree, _, names = read(waiting.pop(), {type(tables): tables})
        trees[tree.name] = tree
        used = [part for part in ast.walk(tree) if isinstance(part, ast.Name)]
        own = {argument.arg for argument in tree.args.args}
        own |= {part.id for part in used if isinstance(part.ctx, ast.Store)}
        for name in sorted({part.id for part in used} - own):
            value: Any = names.get(name)
            if isinstance(value, (int, float)):
                numbers[name] = value
            elif is_kernel(value):
                waiting += [value] if name not in trees else []
            elif value not in (None, math.sqrt):
                raise InputError(f'`--to python` does not know `{name}` of `{tree.name}`')
    return trees, numbers


def _table(value: Any) -> str:
    """Return a number or a table as Python that reads back bit for bit."""
    array = np.asarray(value)
    if array.ndim == 0:
        return repr(value)
    rows = array.tolist() if array.ndim == 2 else [array]
    lines = [formats.listed(row, 8, 98) for row in rows]
    if array.ndim == 2:
        lines = [f'        [{line.strip()}],' for line in lines]
    return '\n'.join(['[', *lines, '    ]'])
