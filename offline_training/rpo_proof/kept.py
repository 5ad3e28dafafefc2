# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Arrays of proofs in files, and the digest of the code that a proof depends on."""

from __future__ import annotations

import hashlib
import io
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

import rpo_core
import rpo_judge.analysis
import rpo_montecarlo.engine
import rpo_proof
from rpo_montecarlo.outputs import write_aside


def code_digest() -> str:
    """Return a digest of the sources that a proof depends on."""
    found = hashlib.sha256()
    packages = rpo_core, rpo_judge.analysis, rpo_montecarlo.engine, rpo_proof
    for package in packages:
        for path in sorted(Path(str(package.__file__)).parent.glob('*.py')):
            found.update(f'{package.__name__} {path.name} '.encode() + path.read_bytes())
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


def write_arrays(path: Path, arrays: Mapping[str, Any]) -> None:
    """Write arrays: the same bytes each time."""
    content = _archive(arrays)
    write_aside(path, lambda file: file.write(content))
