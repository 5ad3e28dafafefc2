# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Which code recorded or verified a run."""

from __future__ import annotations

import hashlib
from functools import cache
from importlib import metadata
from pathlib import Path

import rpo_core
import rpo_log

_PACKAGES = (rpo_core, rpo_log)


@cache
def version() -> str:
    """Return the version of the flight software, as installed."""
    try:
        return metadata.version(rpo_core.__name__)
    except metadata.PackageNotFoundError:
        return 'not installed'


@cache
def digest() -> str:
    """Return a SHA-256 over the sources of the core and of the logs, names and contents."""
    found = hashlib.sha256()
    for package in _PACKAGES:
        folder = Path(str(package.__file__)).parent
        for path in sorted(folder.rglob('*.py')):
            name = f'{package.__name__}/{path.relative_to(folder).as_posix()}'
            content = path.read_bytes()
            found.update(f'{name} {len(content)}\n'.encode() + content)
    return found.hexdigest()
