# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Exported C, compiled by the system and driven through its standard input."""

from __future__ import annotations

import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rpo.exports.c import Files

FLAGS = [
    '-std=c99', '-pedantic', '-Wall', '-Wextra', '-Werror', '-Wshadow', '-Wconversion',
    '-Wstrict-prototypes', '-ffp-contract=off',
]  # fmt: skip


def compiled(folder: Path, files: Files, main: str, optimise: str = '-O2') -> Path:
    """Return the program of `exported.c`, its header and a main; warnings are errors."""
    for name, text in zip(('exported.c', 'exported.h', 'main.c'), (*files, main), strict=True):
        (folder / name).write_text(text)
    built = subprocess.run(
        ['cc', *FLAGS, optimise, '-o', 'program', 'exported.c', 'main.c', '-lm'],
        cwd=folder, capture_output=True, text=True, timeout=50,
    )  # fmt: skip
    assert built.returncode == 0, built.stderr
    return folder / 'program'


def driven(program: Path, rows: Sequence[Sequence[float]]) -> Any:
    """Return the numbers (len(rows), k) that it prints for rows of numbers."""
    lines = '\n'.join(' '.join(map(repr, row)) for row in rows)
    done = subprocess.run([program], input=lines, capture_output=True, text=True, timeout=50)
    assert done.returncode == 0
    return np.array(done.stdout.split(), dtype=np.float64).reshape(len(rows), -1)


def bits(numbers: Any) -> Any:
    """Return the bits of numbers, so that -0 is not 0."""
    return np.ascontiguousarray(numbers, dtype=np.float64).view(np.uint64).tolist()


def states(count=1000):
    """Return (ticks, states (count, 6)): near, far, and awkward."""
    draw = np.random.default_rng(5)
    found = draw.normal(size=(count, 6)) * [30, 30, 30, 0.4, 0.4, 0.4]
    found[::7] *= 10.0 ** draw.uniform(-12, 2, (len(found[::7]), 1))
    found[::11, 0], found[::13, 4], found[::17, 2] = -0.0, 0.0, 14.0
    found[:2] = [-1e5, 1e3, 1e-300, -1e-300, 0.0, -0.0], [0.0] * 6
    return draw.integers(0, 2500, count).tolist(), found.tolist()
