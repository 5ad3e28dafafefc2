# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Every public name of core and kernels says what it is."""

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


def test_there_are_modules():
    assert {'jit', 'cw', 'fuzzy', 'scenario'} <= {path.stem for path in MODULES}
