# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Reading what a proof's folder says, strictly: the shape, type and range of every number."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rpo_core.validation import InputError, mapping, real, shown, within
from rpo_montecarlo.outputs import read_arrays
from rpo_proof.cells import VALUES, Found, Layout
from rpo_proof.problem import Problem
from rpo_proof.sets import Rest

Floats = NDArray[np.float64]

FIELDS = tuple(Found.__dataclass_fields__)

CLAIM = ('statement', 'verdict', 'unit', 'limit', 'bound', 'found', 'start', 'open_cells')
"""Fields of a claim of a summary."""

FARTHEST = 1e7
"""Middle and half-width of a cell, at most; those of a box are a tenth of it."""

_WHOLE = VALUES.index('depth')


def exactly(path: Path, *names: str) -> dict[str, NDArray[Any]]:
    """Return the arrays of a file that holds these, each once, and no other.

    Raises
    ------
    InputError
        If it is missing, a link or damaged, or holds other arrays.
    """
    found = read_arrays(path)
    if sorted(found) != sorted(names):
        raise InputError(f'{path}: must hold the arrays {", ".join(names)}; got {", ".join(found)}')
    return found


def cells_of(path: Path, problem: Problem, group: str) -> Found:
    """Return the cells of a group that a file holds; raises InputError."""
    arrays = exactly(path, *FIELDS)
    layout = Layout.of(problem, group)
    with within(str(path)):
        _check_shapes(arrays, layout)
        found = Found(**arrays)
        _check_ranges(found)
    return found


def _check_shapes(arrays: Mapping[str, NDArray[Any]], layout: Layout) -> None:
    """Refuse arrays of other shapes, of other types, or without a row."""
    rows, units = (arrays[name].shape[:1] for name in ('values', 'tail'))
    shapes = {
        'centre': (*rows, layout.sides),
        'half': (*rows, layout.sides),
        'values': (*rows, len(VALUES)),
        'boxes': (*rows, layout.checkpoints, 2, layout.states),
        'tail': (*units, 2, layout.tail),
        'reach': (2, layout.reach, layout.states),
    }
    for name, shape in shapes.items():
        found = arrays[name]
        if found.shape != shape or found.dtype != np.float64 or not shape[0]:
            raise InputError(
                f'`{name}` must be float64 of shape {shape}, with a row at least; '
                f'got {found.dtype} of {found.shape}'
            )


def _check_ranges(found: Found) -> None:
    """Refuse numbers that are not what they stand for; written so that NaN is refused too."""
    values, depth, last_s = found.values, found.values[:, _WHOLE], found.column('last_s')
    low, high = found.boxes[:, :, 0], found.boxes[:, :, 1]
    unknown = np.isnan(low) & np.isnan(high)
    checks = {
        f'`centre` must be within {FARTHEST:g}': np.abs(found.centre) <= FARTHEST,
        f'`half` must be from 0 to {FARTHEST:g}': (found.half >= 0.0) & (found.half <= FARTHEST),
        '`depth` must be whole': np.isfinite(depth) & (depth == np.floor(depth)),
        '`last_s` must be finite': np.isfinite(last_s),
        '`last_s` must be >= 0 somewhere': np.array([(last_s >= 0.0).any()]),
        '`values` must be >= 0': np.delete(values, VALUES.index('last_s'), axis=1) >= 0.0,
        '`boxes` must be from low to high, or not known': (low <= high) | unknown,
        '`tail` must be >= 0': found.tail >= 0.0,
        '`reach` must be from low to high': found.reach[0] <= found.reach[1],
    }
    for sentence, holds in checks.items():
        if not holds.all():
            raise InputError(f'{sentence}; row {int(np.argwhere(~holds)[0][0])} is not')


def summary_of(document: Any) -> dict[str, Any]:
    """Return a summary whose set of rest and flights have numbers that can be used.

    What else it says is compared with what follows from the cells. Raises InputError.
    """
    found = dict(mapping('', document, ('rest', 'cells', 'claims', 'ranges')))
    if found['rest'] is not None:
        numbers = mapping('rest', found['rest'], Rest._fields)
        found['rest'] = {
            name: real(f'rest.{name}', numbers[name], above=0.0, most=1e3) for name in Rest._fields
        }
    if not isinstance(found['claims'], Mapping):
        raise InputError(f'`claims` must be a mapping; got {shown(found["claims"])}')
    for key, claim in found['claims'].items():
        mapping(f'claims.{key}', claim, CLAIM)
        real(f'claims.{key}.found', claim['found'])
        start = claim['start']
        if not isinstance(start, list) or len(start) not in (0, 6):
            raise InputError(f'`claims.{key}.start` must be 6 numbers, or none; got {shown(start)}')
        for number in start:
            real(f'claims.{key}.start', number)
    return found
