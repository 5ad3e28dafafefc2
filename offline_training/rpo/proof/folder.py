# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The folder of a proof: what was proven, cell by cell.

controller.yaml, scenario.yaml, proof.yaml
    All that the proof follows from.
versions.yaml
    Versions of the libraries, digests of the three files and of the code.
table.npz
    The enclosure of the control surface, for whoever checks it elsewhere; it is never read as true.
parts/GROUP_NNNN.npz
    Finished units: cells, bounds, boxes at checkpoints. An interrupted proof goes on from them.
planar.npz, vertical.npz (or x.npz, y.npz, z.npz), summary.yaml
    At the end: all cells; the invariant set, and the claims. They have the same bytes on any number
    of workers, interrupted or not.
counterexample_CLAIM.yaml, flown_CLAIM.yaml
    The worst flight of each claim: one that refutes it, or one that does not.
"""

from __future__ import annotations

import hashlib
import zipfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import reduce
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

import rpo.proof
import rpo_core
from rpo.montecarlo import outputs
from rpo.montecarlo.outputs import (
    VERSIONS,
    ArrayHeader,
    digest_of,
    make_folder,
    read_arrays,
    write_text,
)
from rpo.montecarlo.pool import versions
from rpo.proof import cells
from rpo.proof.cells import VALUES, CellBounds, Layout
from rpo.proof.enclosure import Table
from rpo.proof.problem import Problem
from rpo.proof.tube import InvariantSet
from rpo_core import files
from rpo_core.control import controller as controllers
from rpo_core.files.validation import InputError, mapping, quoted, real, shown, text, within
from rpo_core.scenario import scenario
from rpo_core.scenario.scenario import Scenario, ScenarioSet

FIELDS = tuple(CellBounds.__dataclass_fields__)

CLAIM = ('statement', 'verdict', 'unit', 'limit', 'bound', 'found', 'start', 'open_cells')
"""Fields of a claim of a summary."""

FARTHEST = 1e7
"""Middle and half-width of a cell, at most; those of a box are a tenth of it."""

_WHOLE = VALUES.index('depth')

TEXTS = ('controller.yaml', 'scenario.yaml', 'proof.yaml')
SUMMARY, _TABLE, _PARTS = 'summary.yaml', 'table.npz', 'parts'
_TABLE_ARRAYS = ('e', 'w', 'u', 'bend', 'slopes', 'steep', 'part_range', 'part_slopes', 'slack')


class Folder:
    """The folder of one proof.

    texts : content of the files of `TEXTS`, as they were read or are to be written
    """

    def __init__(self, path: Path, problem: Problem, texts: Sequence[str]) -> None:
        self.path, self.problem, self.texts = path, problem, texts
        self.bound = digest_of(*problem.texts)

    @classmethod
    def create(cls, path: Path, problem: Problem) -> Folder:
        """Make the folder; raises InputError if it holds something."""
        hint = ': go on with --resume, or check it'
        outputs.require_free(path, TEXTS[2], 'proof', lambda: hint)
        folder = cls(path, problem, problem.texts)
        make_folder(path / _PARTS)
        recorded = {**versions(), 'code_sha256': code_digest(), 'files_sha256': folder.bound}
        outputs.begin_folder(path, dict(zip(TEXTS, problem.texts, strict=True)), recorded)
        return folder

    @classmethod
    def open(cls, path: Path) -> Folder:
        """Return the proof of a folder, finished or not; raises InputError."""
        if not (path / TEXTS[2]).is_file():
            raise InputError(f'{path}: must be the folder of a proof; it holds no {TEXTS[2]}')
        for entry in sorted(path.iterdir()):
            if entry.is_symlink():
                raise InputError(f'{entry}: must be in the folder itself; it is a symbolic link')
        texts = [files.read_text(path / name) for name in TEXTS]
        with within(str(path)):
            folder = cls(path, Problem.of_texts(texts), texts)
        if folder.recorded['files_sha256'] != folder.bound:
            raise InputError(f'{path}: {", ".join(TEXTS)} must be as they were when it was begun')
        return folder

    @property
    def recorded(self) -> dict[str, str]:
        """Versions and digests of when the proof was begun."""
        known = [*versions(), 'code_sha256', 'files_sha256']
        found = files.load(self.path / VERSIONS, lambda found: mapping('', found, known))
        with within(str(self.path / VERSIONS)):
            return {name: text(name, found[name]) for name in known}

    def refuse_other_code(self) -> None:
        """Raise InputError if the proof was begun with other code, or other libraries."""
        theirs = self.recorded
        if {name: theirs[name] for name in versions()} != versions():
            raise InputError(f'{self.path}: was begun with other libraries: {theirs}')
        if theirs['code_sha256'] != code_digest():
            raise InputError(f'{self.path}: was begun with other code: begin anew elsewhere')

    @property
    def finished(self) -> bool:
        """Whether the proof has come to its end."""
        return (self.path / SUMMARY).is_file()

    def put_table(self) -> None:
        """Write the enclosure of the surface."""
        write_arrays(self.path / _TABLE, table_arrays(self.problem.table))

    def table(self) -> dict[str, NDArray[Any]]:
        """Return the arrays that are said to be the enclosure of the surface."""
        return exactly(self.path / _TABLE, *_TABLE_ARRAYS)

    def done(self, group: str, unit: int) -> CellBounds | None:
        """Return a finished unit, None if there is none, or it is damaged."""
        try:
            return cells_of(self._part(group, unit), self.problem, group)
        except InputError:
            return None

    def put(self, group: str, unit: int, bounds: CellBounds) -> None:
        """Keep a finished unit."""
        write_arrays(self._part(group, unit), vars(bounds))

    def cells(self, group: str) -> CellBounds:
        """Return all cells of a finished proof."""
        return cells_of(self.path / f'{group}.npz', self.problem, group)

    def put_flight(self, key: str, refutes: bool, flight: Scenario) -> None:
        """Write the worst flight of a claim, the only one that there is then."""
        counterexample, flown = self.flights(key)
        keep, drop = (counterexample, flown) if refutes else (flown, counterexample)
        write_text(keep, scenario.dumps(flight))
        drop.unlink(missing_ok=True)

    def flights(self, key: str) -> tuple[Path, Path]:
        """Return where the worst flight of a claim is, if it refutes the claim, and if not."""
        return self.path / f'counterexample_{key}.yaml', self.path / f'flown_{key}.yaml'

    def finish(self, groups: Mapping[str, CellBounds], summary: Mapping[str, Any]) -> None:
        """Write all cells and the summary; remove the parts."""
        for group, bounds in groups.items():
            write_arrays(self.path / f'{group}.npz', vars(bounds))
        write_text(self.path / SUMMARY, yaml.safe_dump(dict(summary), sort_keys=False, width=100))
        for part in sorted((self.path / _PARTS).glob('*.npz')):
            part.unlink()

    def summary(self) -> dict[str, Any]:
        """Return the summary of a finished proof; raises InputError if there is none."""
        if not self.finished:
            raise InputError(f'{self.path}: is not finished: go on with --resume')
        return files.load(self.path / SUMMARY, summary_of)

    def others(self) -> list[str]:
        """Return names in the folder that nothing of the proof is read from."""
        names = {*TEXTS, SUMMARY, VERSIONS, _TABLE, _PARTS, 'report'}
        names |= {f'{group}.npz' for group in self.problem.groups}
        for key in self.problem.limits:
            first = next((path for path in self.flights(key) if path.is_file()), None)
            names |= {first.name} if first else set()
        return sorted({entry.name for entry in self.path.iterdir()} - names)

    def _part(self, group: str, unit: int) -> Path:
        return self.path / _PARTS / f'{group}_{unit:04d}.npz'


def table_arrays(table: Table) -> dict[str, Any]:
    """Return what `table.npz` holds; its `steep` is the division of cells."""
    return {name: getattr(table, 'division' if name == 'steep' else name) for name in _TABLE_ARRAYS}


def joined(parts: Iterable[CellBounds]) -> CellBounds:
    """Return the cells of all units."""
    units = list(parts)
    joint = {
        name: np.concatenate([getattr(p, name) for p in units])
        for name in ('centre', 'half', 'values', 'boxes', 'tail')
    }
    return CellBounds(**joint, reach=reduce(cells.joint, [p.reach for p in units]))


def code_digest() -> str:
    """Return a digest of the sources that a proof depends on."""
    digest = hashlib.sha256()
    for package in (rpo_core, rpo.proof):
        base = Path(str(package.__file__)).parent
        for path in sorted(base.rglob('*.py')):
            name = f'{package.__name__} {path.relative_to(base)} '
            digest.update(name.encode() + path.read_bytes())
    return digest.hexdigest()


def write_arrays(path: Path, arrays: Mapping[str, Any]) -> None:
    """Write arrays: the same bytes each time."""
    outputs.write_arrays(path, arrays.items(), zipfile.ZIP_DEFLATED)


def exactly(
    path: Path, *names: str, check: Callable[[Mapping[str, ArrayHeader]], object] = lambda _: None
) -> dict[str, NDArray[Any]]:
    """Return the arrays of a file that holds these, each once, and no other.

    check : raises InputError for headers that are not as expected, before the arrays are read

    Raises InputError if it is missing, a link or damaged, holds other arrays, or is too large.
    """

    def check_all(headers: Mapping[str, ArrayHeader]) -> None:
        if sorted(headers) != sorted(names):
            there = shown(', '.join(headers), 200)
            raise InputError(f'{path}: must hold the arrays {", ".join(names)}; got {there}')
        with within(str(path)):
            check(headers)

    return read_arrays(path, check=check_all)


def cells_of(path: Path, problem: Problem, group: str) -> CellBounds:
    """Return the cells of a group that a file holds; raises InputError."""
    layout = Layout.of(problem, group)
    arrays = exactly(path, *FIELDS, check=lambda headers: _check_shapes(headers, layout))
    with within(str(path)):
        bounds = CellBounds(**arrays)
        _check_ranges(bounds)
    return bounds


def _check_shapes(arrays: Mapping[str, ArrayHeader], layout: Layout) -> None:
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
        array = arrays[name]
        if array.shape != shape or array.dtype != np.float64 or not shape[0]:
            raise InputError(
                f'`{name}` must be float64 of shape {shape}, with a row at least; '
                f'got {array.dtype} of {array.shape}'
            )


def _check_ranges(bounds: CellBounds) -> None:
    """Refuse numbers that are not what they stand for; written so that NaN is refused too."""
    values, depth, last_s = bounds.values, bounds.values[:, _WHOLE], bounds.column('last_s')
    low, high = bounds.boxes[:, :, 0], bounds.boxes[:, :, 1]
    unknown = np.isnan(low) & np.isnan(high)
    checks = {
        f'`centre` must be within {FARTHEST:g}': np.abs(bounds.centre) <= FARTHEST,
        f'`half` must be from 0 to {FARTHEST:g}': (bounds.half >= 0.0) & (bounds.half <= FARTHEST),
        '`depth` must be whole': np.isfinite(depth) & (depth == np.floor(depth)),
        '`last_s` must be finite': np.isfinite(last_s),
        '`last_s` must be >= 0 somewhere': np.array([(last_s >= 0.0).any()]),
        '`values` must be >= 0': np.delete(values, VALUES.index('last_s'), axis=1) >= 0.0,
        '`boxes` must be from low to high, or not known': (low <= high) | unknown,
        '`tail` must be >= 0': bounds.tail >= 0.0,
        '`reach` must be from low to high': bounds.reach[0] <= bounds.reach[1],
    }
    for sentence, holds in checks.items():
        if not holds.all():
            raise InputError(f'{sentence}; row {int(np.argwhere(~holds)[0][0])} is not')


def summary_of(document: Any) -> dict[str, Any]:
    """Return a summary whose invariant set and flights have numbers that can be used.

    What else it says is compared with what follows from the cells. Raises InputError.
    """
    summary = dict(mapping('', document, ('rest', 'cells', 'claims', 'ranges')))
    if summary['rest'] is not None:
        numbers = mapping('rest', summary['rest'], InvariantSet._fields)
        summary['rest'] = {
            name: real(f'rest.{name}', numbers[name], above=0.0, most=1e3)
            for name in InvariantSet._fields
        }
    if not isinstance(summary['claims'], Mapping):
        raise InputError(f'`claims` must be a mapping; got {shown(summary["claims"])}')
    for key, claim in summary['claims'].items():
        mapping(f'claims.{key}', claim, CLAIM)
        real(f'claims.{key}.found', claim['found'])
        start = claim['start']
        if not isinstance(start, list) or len(start) not in (0, 6):
            raise InputError(f'`claims.{key}.start` must be 6 numbers, or none; got {shown(start)}')
        for number in start:
            real(f'claims.{key}.start', number)
    return summary


def origins(folder: Folder) -> list[str]:
    """Return whether controller and scenario mean those that ship, and digests of their files."""
    names = folder.problem.controller.name, folder.problem.scenario.name
    problem, ships = folder.problem, names[0] in files.shipped('controller')
    same_controller = ships and controllers.load_controller(names[0]) == problem.controller
    shipped = same_controller, is_shipped_scenario(problem)
    lines = []
    kinds = 'controller', 'scenario'
    for role, content, name, same in zip(kinds, folder.texts[:2], names, shipped, strict=True):
        digest = hashlib.sha256(content.encode()).hexdigest()
        if same:
            what = f'means the same as the shipped {name}'
        elif name in files.shipped(role):
            what = f'named {name}, and NOT the one that ships with this name'
        else:
            what = f'{quoted(name)}, which does not ship'
        lines.append(f'{role}: {what}; SHA-256 {digest}')
    return lines


def is_shipped_scenario(problem: Problem) -> bool:
    """Whether the scenario is the one that ships with its name, with the same requirements."""
    ours = problem.scenario
    if ours.name not in files.shipped('scenario'):
        return False
    shipped = scenario.load(ours.name)
    theirs = shipped.base if isinstance(shipped, ScenarioSet) else shipped
    return theirs == ours and theirs.requirements == ours.requirements
