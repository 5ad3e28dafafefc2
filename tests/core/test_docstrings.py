# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Every public name of core and kernels says what it is; its dataclasses are frozen."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

import rpo_core
import rpo_kernels

FOLDERS = [Path(str(package.__file__)).parent for package in (rpo_core, rpo_kernels)]
MODULES = sorted(path for folder in FOLDERS for path in folder.rglob('*.py'))


def undocumented(node: ast.AST, place: str) -> list[str]:
    """Return the public names below a node that have no docstring."""
    missing = []
    for child in ast.iter_child_nodes(node):
        if isinstance(child, (ast.ClassDef, ast.FunctionDef)) and not child.name.startswith('_'):
            name = f'{place}.{child.name}'
            missing += [] if ast.get_docstring(child) else [name]
            missing += undocumented(child, name) if isinstance(child, ast.ClassDef) else []
    return missing


@pytest.mark.parametrize('path', MODULES, ids=lambda path: path.stem)
def test_public_names_have_docstrings(path):
    tree = ast.parse(path.read_text())
    assert ast.get_docstring(tree)
    assert undocumented(tree, path.stem) == []


def test_dataclasses_are_frozen():
    """But for what a faulty link holds back: it counts down."""
    classes = (n for path in MODULES for n in ast.walk(ast.parse(path.read_text())))
    made = {
        node.name: ast.unparse(decorator)
        for node in classes
        if isinstance(node, ast.ClassDef)
        for decorator in node.decorator_list
    }
    data = {name: how for name, how in made.items() if how.startswith('dataclass')}
    assert len(data) > 20
    assert [name for name, how in data.items() if 'frozen=True' not in how] == ['_Held']


def test_there_are_modules():
    assert {'jit', 'cw', 'fuzzy', 'scenario'} <= {path.stem for path in MODULES}
