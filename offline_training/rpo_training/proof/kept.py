# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Tables of surfaces, kept in the user's cache: a proof of the same controller finds its own.

A file is named after a digest of all that a table follows from, the code included. The checker does
not read the cache.
"""

from __future__ import annotations

import hashlib
import io
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

import rpo_core
import rpo_training.analysis
import rpo_training.proof
from rpo_core.compile_cache import user_cache
from rpo_core.validation import InputError
from rpo_training.cluster.pool import versions
from rpo_training.outputs import digest_of, read_arrays, write_aside
from rpo_training.proof.problem import Problem
from rpo_training.proof.tables import Table

ARRAYS = ('e', 'w', 'u', 'bend', 'slopes', 'steep', 'part_range', 'part_slopes')
"""Fields of a table that are arrays."""


def code_digest() -> str:
    """Return a digest of the sources that a proof depends on."""
    found = hashlib.sha256()
    for package in (rpo_core, rpo_training.analysis, rpo_training.proof):
        for path in sorted(Path(str(package.__file__)).parent.glob('*.py')):
            found.update(path.name.encode() + b'\0' + path.read_bytes())
    return found.hexdigest()


def _archive(arrays: Mapping[str, Any]) -> bytes:
    """Return an .npz of arrays, without times of files: the same bytes each time."""
    content = io.BytesIO()
    with zipfile.ZipFile(content, 'w', zipfile.ZIP_DEFLATED) as archived:
        for name, values in arrays.items():
            entry = zipfile.ZipInfo(f'{name}.npy')
            entry.compress_type = zipfile.ZIP_DEFLATED
            with archived.open(entry, 'w') as member:
                np.lib.format.write_array(member, np.asarray(values), allow_pickle=False)
    return content.getvalue()


def table_of(problem: Problem) -> Table:
    """Return the table of a problem: the one of the cache, if it is there and whole."""
    path = _place(problem)
    if path.is_file():
        try:
            return read(path, problem)
        except InputError:
            pass  # cut short by a full disk or a crash: made anew below
    made = problem.table_anew()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write(path, made)
    except (OSError, InputError):
        pass  # a cache that cannot be written costs time only
    return made


def _place(problem: Problem) -> Path:
    required = problem.scenario.requirements
    slew = None if required is None else required.slew_per_axis_n_s
    numbers = problem.scenario.max_force_n, problem.scenario.mass_kg, slew
    named = repr((numbers, problem.settings.coarseness, versions(), code_digest()))
    return user_cache() / 'tables' / f'{digest_of(problem.texts[0], named)}.npz'


def read(path: Path, problem: Problem) -> Table:
    """Return the table of a file; raises InputError if it is damaged."""
    found: dict[str, Any] = read_arrays(path, *ARRAYS, 'slack')
    slack, controller = float(found.pop('slack')), problem.controller
    position_m, velocity_m_s, force_n = controller.scales
    return Table(
        **found,
        slack=slack,
        limit=problem.scenario.max_force_n / controller.force_scale_n,
        position_m=position_m,
        velocity_m_s=velocity_m_s,
        force_n=force_n,
        fis=controller.system.tables,
    )


def write(path: Path, table: Table) -> None:
    """Write a table: the same bytes each time."""
    write_arrays(path, {name: getattr(table, name) for name in (*ARRAYS, 'slack')})


def write_arrays(path: Path, arrays: Mapping[str, Any]) -> None:
    """Write arrays: the same bytes each time."""
    content = _archive(arrays)
    write_aside(path, lambda file: file.write(content))
