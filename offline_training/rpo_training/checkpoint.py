# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The checkpoint of a run: the scores of every generation.

A search with the same objectives asks for the same chromosomes. A run is therefore resumed from its
scores, without flying again; the state of the search itself is not saved. A digest of the
chromosomes of each generation shows when they differ, as under another version of a library.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rpo_core.files.validation import InputError
from rpo_judge.scoring.fitness import Scores
from rpo_montecarlo.outputs import digest_of, read_arrays, write_aside
from rpo_training import __version__

Floats = NDArray[np.float64]

SCHEMA = 'rpo/checkpoint/2'

LIBRARIES = ('numpy', 'numba', 'pymoo', 'cma')
"""The bits of a run depend on these, and on this package."""


def versions() -> dict[str, str]:
    """Return the versions of this package and of `LIBRARIES`."""
    return {'rpo_training': __version__, **{name: version(name) for name in LIBRARIES}}


@dataclass
class Checkpoint:
    """The generations so far.

    config : text of the configuration
    inputs : texts of the files that it names
    scores : per generation (n, 3 + k): fitness, energy, failures of k conditions, arrival time
    digests : of the chromosomes of each
    """

    config: str
    inputs: Sequence[str] = ()
    scores: list[Floats] = field(default_factory=list)
    digests: list[str] = field(default_factory=list)

    def add(self, genes: Floats, scores: Scores) -> None:
        """Add a generation."""
        self.scores.append(
            np.column_stack([scores.fitness, scores.energy, scores.failures, scores.arrival])
        )
        self.digests.append(digest(genes))

    @property
    def evaluations(self) -> int:
        """Controllers evaluated so far."""
        return sum(map(len, self.scores))

    def save(self, path: Path) -> None:
        """Write the checkpoint."""
        arrays = {
            'schema': np.array(SCHEMA),
            'config': np.array(self.config),
            'inputs': np.array(digest_of(*self.inputs)),
            'versions': np.array([f'{k} {v}' for k, v in versions().items()]),
            'sizes': np.array([len(s) for s in self.scores]),
            'marks': np.concatenate(self.scores) if self.scores else np.empty((0, 3)),
            'digests': np.array(self.digests, dtype='U16'),
        }
        write_aside(path, lambda file: np.savez(file, allow_pickle=False, **arrays))

    @classmethod
    def load(cls, path: Path, config: str, inputs: Sequence[str] = ()) -> Checkpoint:
        """Return a checkpoint that was written under the configuration `config`.

        Raises
        ------
        InputError
            If it is missing, damaged, or of another version, configuration or other inputs.
        """
        if not path.exists():
            raise InputError(f'{path}: there is no checkpoint to resume from')
        data = read_arrays(path)
        if (found := str(data.get('schema'))) != SCHEMA:
            raise InputError(f'{path}: its schema must be {SCHEMA}; got {found}')
        try:
            theirs = dict(entry.split(' ', 1) for entry in data['versions'].tolist())
            written, bound = str(data['config']), str(data['inputs'])
            sizes, digests = data['sizes'].tolist(), data['digests'].tolist()
            scores = _split(data['marks'], sizes)
            if len(sizes) != len(digests):
                raise ValueError('a generation has no digest')
        except (KeyError, ValueError, TypeError, AttributeError) as error:
            raise InputError(f'{path}: is damaged: {error}') from None
        if theirs != versions():
            changed = [
                f'{k} {theirs.get(k, "none")} (now {v})'
                for k, v in versions().items()
                if theirs.get(k) != v
            ]
            raise InputError(
                f'{path}: was written with {", ".join(changed)}; resuming requires the same '
                'versions'
            )
        if written != config:
            raise InputError(f'{path}: is of another configuration than {path.parent}/config.yaml')
        if bound != digest_of(*inputs):
            raise InputError(
                f'{path}: was written with another content of the scenario or of a start that '
                f'{path.parent}/config.yaml names'
            )
        return cls(config, inputs, scores, digests)


def _split(rows: Floats, sizes: list[int]) -> list[Floats]:
    """Return the rows (n, 3 + k) of each generation; raises ValueError if they do not fit."""
    fits = rows.ndim == 2 and len(rows) == sum(sizes) and rows.shape[1] >= 3
    if not fits or rows.dtype != np.float64 or min(sizes, default=1) < 1:
        raise ValueError(f'{rows.shape} scores of {len(sizes)} generations')
    return np.split(rows, np.cumsum(sizes)[:-1]) if sizes else []


def digest(genes: Floats) -> str:
    """Return a short digest of chromosomes."""
    return hashlib.sha256(np.ascontiguousarray(genes).tobytes()).hexdigest()[:16]
