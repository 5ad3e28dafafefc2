# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The results of a campaign: in memory, or in a folder with its files and its partial results.

campaign.yaml, scenario.yaml, controller.yaml
    All that determines the outcome: the folder alone repeats any run.
versions.yaml
    Versions of the libraries that bits depend on, and a digest of the three files: results of two
    configurations cannot be mixed.
results.part, done.part
    Until the end: columns one after the other, float64; and 8 bytes per unit, a digest of the
    configuration and of its results when it is done, else 0. Units are written in any order, each
    at its place; nothing is kept in memory. A unit that does not fit its digest is flown again.
results.npz, summary.yaml
    At the end: one array per column, for `numpy.load`; rates, intervals, quantiles. They have the
    same bytes on any number of workers, interrupted or not.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import IO, Any

import numpy as np
import yaml

from rpo.montecarlo.config import Campaign
from rpo.montecarlo.outputs import (
    VERSIONS,
    alone,
    begin_folder,
    digest_of,
    make_folder,
    read_arrays,
    require_free,
    write_arrays,
    write_text,
)
from rpo.montecarlo.pool import versions
from rpo.montecarlo.run_batch import UNIT, columns_of, units
from rpo_core import files
from rpo_core.files.validation import InputError, mapping
from rpo_core.kernels.arrays import Floats

_TEXTS = ('campaign.yaml', 'scenario.yaml', 'controller.yaml')
_RESULTS, _SUMMARY, _PART, _DONE = 'results.npz', 'summary.yaml', 'results.part', 'done.part'
_BYTES = 8
"""Of a number, and of the digest of a unit."""

_BOUND = 'files_sha256'
_NOT_DONE = bytes(_BYTES)


class Results:
    """The results of one campaign, in memory."""

    def __init__(self, campaign: Campaign) -> None:
        self.campaign, self.columns = campaign, columns_of(campaign)
        self._units: dict[int, Floats] = {}

    @property
    def finished(self) -> bool:
        """Whether all runs are done."""
        return not self.pending()

    def pending(self) -> list[int]:
        """Return the units that are not done."""
        return [u for u in range(units(self.campaign.config.runs)) if u not in self._units]

    @property
    def done_runs(self) -> int:
        """Number of runs that are done."""
        total = self.campaign.config.runs
        return total - sum(min(UNIT, total - unit * UNIT) for unit in self.pending())

    def alone(self) -> AbstractContextManager[None]:
        """Lock the results; raises InputError if another process holds them."""
        return nullcontext()

    def put(self, unit: int, results: Floats) -> None:
        """Store results (columns, n) of a unit."""
        self._units[unit] = results

    def finish(self, summary: Mapping[str, Any]) -> None:
        """End a campaign whose runs are done."""

    def column(self, name: str) -> Floats:
        """Return a column (runs,) of a finished campaign."""
        place = self.columns.index(name)
        return np.concatenate([results[place] for _, results in sorted(self._units.items())])


class Store(Results):
    """The folder of one campaign."""

    def __init__(self, folder: Path, campaign: Campaign) -> None:
        super().__init__(campaign)
        self.folder, self.bound = folder, digest_of(*campaign.texts)

    @classmethod
    def create(cls, folder: Path, campaign: Campaign) -> Store:
        """Make the folder.

        Raises
        ------
        InputError
            If it holds a campaign already, or other files.
        """

        def hint() -> str:
            same = cls._texts(folder) == campaign.texts
            state = 'this campaign: go on with --resume' if same else 'another configuration'
            return f', of {state}'

        require_free(folder, _TEXTS[0], 'campaign', hint)
        store = cls(folder, campaign)
        make_folder(folder)
        runs = campaign.config.runs
        store._reserve(_PART, len(store.columns) * runs * _BYTES)
        store._reserve(_DONE, units(runs) * _BYTES)
        texts = dict(zip(reversed(_TEXTS), reversed(campaign.texts), strict=True))
        begin_folder(folder, texts, {**versions(), _BOUND: store.bound})
        return store

    @classmethod
    def begun(cls, folder: Path, campaign: Campaign) -> Store:
        """Return the same campaign of a folder, or make it; raises InputError."""
        same = (folder / _TEXTS[0]).is_file() and cls._texts(folder) == campaign.texts
        return cls.open(folder) if same else cls.create(folder, campaign)

    @classmethod
    def open(cls, folder: Path) -> Store:
        """Return the campaign of a folder, finished or not; raises InputError."""
        if not (folder / _TEXTS[0]).is_file():
            raise InputError(f'{folder}: must be the folder of a campaign; it holds no {_TEXTS[0]}')
        names = tuple(str(folder / name) for name in _TEXTS)
        store = cls(folder, Campaign.of_texts(cls._texts(folder), names))  # type: ignore[arg-type]
        theirs = files.load(
            folder / VERSIONS, lambda found: dict(mapping('', found, versions(), [_BOUND]))
        )
        bound = theirs.pop(_BOUND, store.bound if store.finished else '')  # older ones have none
        if theirs != versions():
            raise InputError(
                f'{folder}: was begun with {theirs}; resuming requires the same versions, '
                f'not {versions()}'
            )
        if bound != store.bound:
            raise InputError(
                f'{folder}: {", ".join(_TEXTS)} must be as they were when the campaign began; '
                f'undo the changes, or begin anew in another folder'
            )
        return store

    @staticmethod
    def _texts(folder: Path) -> tuple[str, ...]:
        return tuple(files.read_text(folder / name) for name in _TEXTS)

    @property
    def finished(self) -> bool:
        """Whether all runs are done."""
        return (self.folder / _RESULTS).is_file()

    def pending(self) -> list[int]:
        """Return the units that are not done, or do not fit their digest."""
        if self.finished:
            return []
        runs = self.campaign.config.runs
        with self._read(_DONE) as file, self._read(_PART) as part:
            digests = file.read(units(runs) * _BYTES + 1)
            size = os.fstat(part.fileno()).st_size
            if len(digests) != units(runs) * _BYTES or size != len(self.columns) * runs * _BYTES:
                raise InputError(
                    f'{self.folder}: its results are damaged; start anew in another folder'
                )
            claims = (digests[i : i + _BYTES] for i in range(0, len(digests), _BYTES))
            return [
                unit
                for unit, claim in enumerate(claims)
                if claim == _NOT_DONE or claim != self._digest(unit, self._results(part, unit))
            ]

    def _results(self, part: IO[bytes], unit: int) -> bytes:
        """Return the results of a unit, column by column."""
        runs, first = self.campaign.config.runs, unit * UNIT
        size = min(UNIT, runs - first) * _BYTES
        offsets = ((column * runs + first) * _BYTES for column in range(len(self.columns)))
        return b''.join(os.pread(part.fileno(), size, offset) for offset in offsets)

    def _digest(self, unit: int, results: bytes) -> bytes:
        key = f'{self.bound} {unit} '.encode()
        return hashlib.blake2b(key + results, digest_size=_BYTES).digest()

    def alone(self) -> AbstractContextManager[None]:
        """Lock the folder; raises InputError if another process holds it."""
        return alone(self.folder / _TEXTS[0], 'flies this campaign')

    def put(self, unit: int, results: Floats) -> None:
        """Store results (columns, n) of a unit; they are safe from kill -9 afterwards."""
        runs, columns = self.campaign.config.runs, [v.astype('<f8').tobytes() for v in results]
        with self._opened(_PART) as part, self._opened(_DONE) as done:
            for column, values in enumerate(columns):
                os.pwrite(part.fileno(), values, (column * runs + unit * UNIT) * _BYTES)
            digest = self._digest(unit, b''.join(columns))
            os.pwrite(done.fileno(), digest, unit * _BYTES)

    def finish(self, summary: Mapping[str, Any]) -> None:
        """Write `results.npz` and the summary; remove the partial results."""
        text = yaml.safe_dump(dict(summary), sort_keys=False, width=100)
        write_text(self.folder / _SUMMARY, text)
        columns = ((name, self.column(name)) for name in self.columns)
        write_arrays(self.folder / _RESULTS, columns)
        for name in (_PART, _DONE):
            (self.folder / name).unlink()

    def column(self, name: str) -> Floats:
        """Return a column (runs,); zeros for runs that are not done."""
        runs = self.campaign.config.runs
        if self.finished:
            found = read_arrays(self.folder / _RESULTS, name)[name]
            if found.shape != (runs,) or found.dtype != np.float64:
                raise InputError(f'{self.folder / _RESULTS}: must have {runs} numbers of {name}')
            return found
        offset = self.columns.index(name) * runs * _BYTES
        with self._read(_PART) as part:
            return np.fromfile(part, '<f8', count=runs, offset=offset)

    def _read(self, name: str) -> IO[bytes]:
        try:
            return files.open_regular(self.folder / name)
        except OSError as error:
            raise InputError(f'{self.folder / name}: {error.strerror or error}') from None

    def _opened(self, name: str) -> IO[bytes]:
        return (self.folder / name).open('r+b', buffering=0)

    def _reserve(self, name: str, size: int) -> None:
        """Make a file of zeros; raises InputError now if the disk is too small for it."""
        path = self.folder / name
        try:
            with path.open('wb') as file:
                os.posix_fallocate(file.fileno(), 0, size)
        except OSError as error:
            path.unlink(missing_ok=True)
            raise InputError(
                f'{path}: cannot reserve {size} bytes: {error.strerror or error}'
            ) from None
