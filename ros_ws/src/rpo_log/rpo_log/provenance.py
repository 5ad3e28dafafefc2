# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Who made a run: its code, its machine and the wall clock; all of it is kept out of its log."""

from __future__ import annotations

import datetime
import hashlib
import platform
from collections.abc import Mapping
from contextlib import suppress
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

import yaml

import rpo_core
import rpo_log
from rpo_log.errors import cannot_write
from rpo_log.format.run import INFO_FILE, write_whole

_PACKAGES = (rpo_core, rpo_log)


def version(package: str = rpo_core.__name__) -> str:
    """Return the version of a package, that of the flight software by default, as installed."""
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return 'not installed'


@cache
def digest() -> str:
    """Return a SHA-256 over the sources of kernels, core and logs, names and contents."""
    sources = hashlib.sha256()
    for package in _PACKAGES:
        folder = Path(str(package.__file__)).parent
        for path in sorted([*folder.rglob('*.py'), *folder.rglob('*.yaml')]):
            name = f'{package.__name__}/{path.relative_to(folder).as_posix()}'
            content = path.read_bytes()
            sources.update(f'{name} {len(content)}\n'.encode() + content)
    return sources.hexdigest()


_LIBRARIES = ('numpy', 'PyYAML', 'mcap', 'zstandard', 'numba', 'rclpy')


def machine_facts() -> dict[str, Any]:
    """Return where a run was made: processor, system, Python and libraries."""
    lines = list[str]()
    with suppress(OSError):
        lines = Path('/proc/cpuinfo').read_text().splitlines()
    models = [line.partition(':')[2].strip() for line in lines if line.startswith('model name')]
    return {
        'machine': platform.machine(),
        'processor': f'{len(models)} x {models[0]}' if models else platform.processor(),
        'system': platform.platform(),
        'python': platform.python_version(),
        'libraries': {name: version(name) for name in _LIBRARIES},
    }


def utc(moment_s: float) -> str:
    """Return a time of the wall clock as text."""
    return datetime.datetime.fromtimestamp(moment_s, datetime.timezone.utc).isoformat()


def write_run_info(folder: str | Path, facts: Mapping[str, Any]) -> None:
    """Write run_info.yaml: the facts of the caller, of the code, of the machine; LogError."""
    path = Path(folder) / INFO_FILE
    made_by = {'version': version(), 'sha256': digest()}
    text = yaml.safe_dump({**facts, 'code': made_by, 'machine': machine_facts()}, sort_keys=False)
    try:
        write_whole(path, text.encode())
    except OSError as error:
        raise cannot_write(path, error) from None
