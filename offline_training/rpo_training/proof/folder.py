# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The folder of a proof: what was proven, cell by cell.

controller.yaml, scenario.yaml, proof.yaml
    All that the proof follows from.
versions.yaml
    Versions of the libraries, digests of the three files and of the code.
table.npz
    The enclosure of the control surface.
parts/GROUP_NNNN.npz
    Finished units: cells, bounds, boxes at checkpoints. An interrupted proof goes on from them.
planar.npz, vertical.npz, summary.yaml
    At the end: all cells; the set of rest, and the claims. They have the same bytes on any number
    of workers, interrupted or not.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import reduce
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from rpo_core import files
from rpo_core.validation import InputError, mapping
from rpo_training.cluster.pool import versions
from rpo_training.outputs import digest_of, make_folder, read_arrays, write_text
from rpo_training.proof import cells, kept
from rpo_training.proof.cells import VALUES, Found
from rpo_training.proof.problem import Problem
from rpo_training.proof.tables import Table

TEXTS = ('controller.yaml', 'scenario.yaml', 'proof.yaml')
SUMMARY, _VERSIONS, _TABLE, _PARTS = 'summary.yaml', 'versions.yaml', 'table.npz', 'parts'
_FOUND = ('centre', 'half', 'values', 'boxes')
_TAIL, _REACH = 'tail', 'reach'


class Folder:
    """The folder of one proof."""

    def __init__(self, path: Path, problem: Problem) -> None:
        self.path, self.problem = path, problem
        self.bound = digest_of(*problem.texts)

    @classmethod
    def create(cls, path: Path, problem: Problem) -> Folder:
        """Make the folder; raises InputError if it holds something."""
        if path.exists() and (not path.is_dir() or any(path.iterdir())):
            if (path / TEXTS[2]).is_file():
                raise InputError(f'{path}: holds a proof already: go on with --resume, or check it')
            raise InputError(f'{path}: must be a new or empty folder; it holds other things')
        found = cls(path, problem)
        make_folder(path / _PARTS)
        stamped = {**versions(), 'code_sha256': kept.code_digest(), 'files_sha256': found.bound}
        write_text(path / _VERSIONS, yaml.safe_dump(stamped))
        for name, content in zip(TEXTS, problem.texts, strict=True):
            write_text(path / name, content)  # proof.yaml last: with it, the folder is one
        return found

    @classmethod
    def open(cls, path: Path) -> Folder:
        """Return the proof of a folder, finished or not; raises InputError."""
        if not (path / TEXTS[2]).is_file():
            raise InputError(f'{path}: must be the folder of a proof; it holds no {TEXTS[2]}')
        found = cls(path, Problem.of_texts([files.read_text(path / name) for name in TEXTS]))
        if found.stamped['files_sha256'] != found.bound:
            raise InputError(f'{path}: {", ".join(TEXTS)} must be as they were when it was begun')
        return found

    @property
    def stamped(self) -> dict[str, str]:
        """Versions and digests of when the proof was begun."""
        known = [*versions(), 'code_sha256', 'files_sha256']
        return dict(files.load(self.path / _VERSIONS, lambda found: mapping('', found, known)))

    def refuse_other_code(self) -> None:
        """Raise InputError if the proof was begun with other code, or other libraries."""
        theirs = self.stamped
        if {name: theirs[name] for name in versions()} != versions():
            raise InputError(f'{self.path}: was begun with other libraries: {theirs}')
        if theirs['code_sha256'] != kept.code_digest():
            raise InputError(f'{self.path}: was begun with other code: begin anew elsewhere')

    @property
    def finished(self) -> bool:
        """Whether the proof has come to its end."""
        return (self.path / SUMMARY).is_file()

    def table(self) -> Table:
        """Return the enclosure of the surface; made and kept, if it is not there."""
        path = self.path / _TABLE
        if path.is_file():
            return kept.read(path, self.problem)
        made = kept.table_of(self.problem)
        kept.write(path, made)
        return made

    def done(self, group: str, unit: int) -> Found | None:
        """Return a finished unit, None if there is none, or it is damaged."""
        path = self._part(group, unit)
        if not path.is_file():
            return None
        try:
            return Found(**read_arrays(path, *_FOUND, _TAIL, _REACH))
        except InputError:
            return None

    def put(self, group: str, unit: int, found: Found) -> None:
        """Keep a finished unit."""
        self._write(self._part(group, unit), vars(found))

    def cells(self, group: str) -> Found:
        """Return all cells of a finished proof."""
        found = Found(**read_arrays(self.path / f'{group}.npz', *_FOUND, _TAIL, _REACH))
        n = len(cells.roots(self.problem, group)[0].centre)
        if found.centre.shape != (len(found.values), n) or found.values.shape[1] != len(VALUES):
            raise InputError(f'{self.path / group}.npz: must have rows of {n} and {len(VALUES)}')
        return found

    def finish(self, groups: Mapping[str, Found], summary: Mapping[str, Any]) -> None:
        """Write all cells and the summary; remove the parts."""
        for group, found in groups.items():
            self._write(self.path / f'{group}.npz', vars(found))
        write_text(self.path / SUMMARY, yaml.safe_dump(dict(summary), sort_keys=False, width=100))
        for part in sorted((self.path / _PARTS).glob('*.npz')):
            part.unlink()

    def summary(self) -> dict[str, Any]:
        """Return the summary of a finished proof; raises InputError if there is none."""
        if not self.finished:
            raise InputError(f'{self.path}: is not finished: go on with --resume')
        return dict(files.load(self.path / SUMMARY, lambda found: found))

    def _part(self, group: str, unit: int) -> Path:
        return self.path / _PARTS / f'{group}_{unit:04d}.npz'

    def _write(self, path: Path, arrays: Mapping[str, Any]) -> None:
        kept.write_arrays(path, arrays)


def joined(parts: Iterable[Found]) -> Found:
    """Return the cells of all units."""
    found = list(parts)
    joint = {name: np.concatenate([getattr(p, name) for p in found]) for name in _FOUND}
    reach = reduce(cells.joint, [p.reach for p in found])
    return Found(**joint, tail=np.concatenate([p.tail for p in found]), reach=reach)
