# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What files and messages hold, kept in a list: the fields with their limits, and the signals.

A limit that narrows refuses files that loaded, and a default that moves changes what they mean.
A constant that moves changes flights, bounds and proofs, within all that their tests ask for.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from dataclasses import MISSING, Field, fields, is_dataclass
from functools import cache, partial
from importlib import import_module
from pathlib import Path
from typing import Any, get_type_hints

import pytest
from kept import assert_kept

from rpo_core.files.validation import InputError
from rpo_core.wire import interfaces, statuses
from rpo_kernels.compile_cache import MARKS

LIST = Path(__file__).with_name('records.txt')
PATHS = {
    '.'.join(path.relative_to(init.parents[1]).with_suffix('').parts): path
    for folder in ('ros_ws/src/rpo_*', 'offline_training')
    for init in sorted(Path(__file__).parents[2].glob(f'{folder}/rpo_*/__init__.py'))
    for path in sorted(init.parent.rglob('*.py'))
}
"""The modules of all packages."""
LISTED = [
    'attitude',
    'core',
    'ctrl',
    'guidance',
    'kernels',
    'log',
    'mcap',
    'montecarlo',
    'nav',
    'proof',
    'safety',
    'thrusters',
]
"""Packages whose constants are in the list: mathematics, logs, proofs and campaigns."""
CHECKS = ('matrix', 'optional', 'real', 'vector3', 'whole')
"""Checks that take limits."""
MUTABLE = [
    'Checkpoint',
    'Counts',
    'Effort',
    'FileRecords',
    'FileRepair',
    'Form',
    'Gathering',
    'LiveRun',
    'LogDiff',
    'TickOrderer',
    '_Extent',
    '_Group',
    '_Held',
    '_OpenChunk',
    '_Tick',
]
"""What counts, or is put together, piece by piece."""


@cache
def nodes_of(path: Path, kind: type[ast.AST]) -> list[Any]:
    """Return the nodes of a kind in a source."""
    return [node for node in all_nodes(path) if isinstance(node, kind)]


@cache
def all_nodes(path: Path) -> list[ast.AST]:
    return list(ast.walk(ast.parse(path.read_text())))


@pytest.fixture(scope='module', autouse=True)
def forgotten() -> Iterator[None]:
    """Free the trees of all sources behind the last test."""
    yield
    for cached in (nodes_of, all_nodes):
        cached.cache_clear()


def records() -> Iterator[Any]:
    """Yield the classes that check their fields, of all packages."""
    for name, path in PATHS.items():
        if '(Checked' in path.read_text():
            made = [kind for kind in vars(import_module(name)).values() if isinstance(kind, type)]
            yield from (kind for kind in made if has_checks(kind, name))


def has_checks(kind: Any, module: str) -> bool:
    return kind.__module__ == module and is_dataclass(kind) and bool(checks_of(kind))


def checks_of(kind: Any) -> dict[str, tuple[Any, ...]]:
    """Return the checks of the fields that have one."""
    hints = get_type_hints(kind, include_extras=True).items()
    return {name: hint.__metadata__ for name, hint in hints if hasattr(hint, '__metadata__')}


def told(check: Any) -> str:
    """Return the name of a check and what it is given."""
    if not isinstance(check, partial):
        return str(check.__name__)
    named = {n: tuple(v) if isinstance(v, dict) else v for n, v in check.keywords.items()}
    given = [f'{n}={told(v) if callable(v) else repr(v)}' for n, v in named.items()]
    return f'{told(check.func)}({", ".join([*map(str, check.args), *given])})'


def line_of(field: Field[Any], checks: tuple[Any, ...]) -> str:
    made = field.default if field.default_factory is MISSING else field.default_factory()
    default = 'required' if made is MISSING else repr(made)
    return ' '.join([' *'[field.kw_only], field.name, default, *map(told, checks)])


def lines() -> Iterator[str]:
    """Yield a line for each class, and one for each of its fields; * : by its name only."""
    for kind in records():
        yield f'{kind.__module__}.{kind.__name__}'
        checks = checks_of(kind)
        for field in fields(kind):
            yield line_of(field, checks.get(field.name, ()))
    for name, row in interfaces.table().items():
        yield f'{name} {row.type} {row.due}{", logged" * row.logged}'
        yield f'  {row.columns[:1]} to {row.columns[-1:]} {row.widths} {row.rest[3:4]}'
        yield f'  {row.frames} {(row.carries, row.also, row.rider, row.rides, row.beside)}'
        yield f'  {row.qos}'
    yield f'levels {statuses.LEVELS}'
    yield from limits()
    yield from constants()


def limits() -> Iterator[str]:
    """Yield a line for each check that a function makes with numbers of its own."""
    for module, path in PATHS.items():
        for function in nodes_of(path, ast.FunctionDef):
            calls = [node for node in ast.walk(function) if isinstance(node, ast.Call)]
            for call in (c for c in calls if ast.unparse(c.func) in CHECKS):
                values = [*call.args, *(k.value for k in call.keywords)]
                if any(map(is_of_numbers, values)):
                    yield f'{module} {function.name} {ast.unparse(call)}'


def constants() -> Iterator[str]:
    """Yield a line for each constant, and one for the defaults of each class and function."""
    checked = {f'{kind.__module__}.{kind.__name__}' for kind in records()}
    for module, path in PATHS.items():
        if module.split('.')[0].removeprefix('rpo_') not in LISTED or path.stem.endswith('_node'):
            continue
        (tree,) = nodes_of(path, ast.Module)
        for node in tree.body:
            if isinstance(node, ast.Assign | ast.AnnAssign) and is_constant(node):
                yield f'{module} {ast.unparse(node)}'
        for kind in (node for node in tree.body if isinstance(node, ast.ClassDef)):
            own = [node for node in kind.body if isinstance(node, ast.AnnAssign) and node.value]
            found = [ast.unparse(n) for n in own if is_of_numbers(n.value)]
            found = [text for text in found if 'ClassVar' not in text]
            if found and f'{module}.{kind.name}' not in checked:
                yield f'{module} {kind.name}: {"; ".join(found)}'
        for function in nodes_of(path, ast.FunctionDef):
            own = function.args
            named = [*zip([a.arg for a in own.args][::-1], own.defaults[::-1], strict=False)][::-1]
            named += [(a.arg, v) for a, v in zip(own.kwonlyargs, own.kw_defaults, strict=True) if v]
            found = [f'{name}={ast.unparse(v)}' for name, v in named if is_of_numbers(v)]
            if found:
                yield f'{module} {function.name}({", ".join(found)})'


def is_constant(node: ast.Assign | ast.AnnAssign) -> bool:
    """Whether a value is of numbers, or has a name in capitals and is computed with a number."""
    if not node.value or is_of_numbers(node.value):
        return bool(node.value)
    target = node.targets[0] if isinstance(node, ast.Assign) else node.target
    leaves = [n.value for n in ast.walk(node.value) if isinstance(n, ast.Constant)]
    numbers = bool(leaves) and all(isinstance(leaf, int | float) for leaf in leaves)
    return numbers and ast.unparse(target).isupper()


def is_of_numbers(value: ast.expr) -> bool:
    """Whether a value is made of nothing but numbers, and what is true or false."""
    nodes = list(ast.walk(value))
    made = (ast.Call, ast.JoinedStr, ast.comprehension, ast.Attribute, ast.Subscript, ast.Name)
    leaves = [node.value for node in nodes if isinstance(node, ast.Constant)]
    plain = not any(isinstance(node, made) for node in nodes)
    return plain and bool(leaves) and all(isinstance(leaf, int | float) for leaf in leaves)


def test_limits_and_defaults_are_those_of_the_list():
    assert_kept(LIST, lines())


@pytest.mark.parametrize('kind', list(records()), ids=lambda kind: kind.__name__)
def test_a_record_checks_its_fields_when_it_is_made(kind):
    """Also one that Python makes, without a file."""
    made = object.__new__(kind)
    checks = checks_of(kind)
    for field in fields(kind):
        kept = field.default_factory is dict and field.name not in checks
        object.__setattr__(made, field.name, {} if kept else object())
    with pytest.raises(InputError, match=f'^`{kind.PLACE}{next(iter(checks))}` must '):
        made.__post_init__()


def test_dataclasses_are_frozen():
    classes = [node for path in PATHS.values() for node in nodes_of(path, ast.ClassDef)]
    made = [(c.name, ast.unparse(how)) for c in classes for how in c.decorator_list]
    data = [(name, how) for name, how in made if how.startswith('dataclass')]
    assert len(data) > 150
    assert sorted(name for name, how in data if 'frozen=True' not in how) == MUTABLE


def test_every_source_with_kernels_is_in_the_digest_of_what_was_compiled():
    """Else an edit of it flies the machine code from before."""
    marked = re.compile(rb'^@(kernel|inlined|compiled|jit)', re.MULTILINE)
    texts = {name: path.read_bytes() for name, path in PATHS.items()}
    kernels = {name: text for name, text in texts.items() if marked.search(text)}
    assert len(kernels) > 40
    assert [n for n, text in kernels.items() if not any(m in text for m in MARKS)] == []
