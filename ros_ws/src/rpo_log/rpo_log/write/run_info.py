# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What depends on the wall clock and the machine, kept out of the run's log."""

from __future__ import annotations

import platform
import time
from collections.abc import Mapping
from importlib import metadata
from pathlib import Path
from typing import Any

import yaml

from rpo_core import interfaces
from rpo_log.format.run import HEALTH_FILE, INFO_FILE, cannot_write
from rpo_log.write.side_file import SideFile

CHUNK_S = 2.0
"""Wall time after which a chunk is closed: so much a crash may take."""

_LIBRARIES = ('numpy', 'PyYAML', 'mcap', 'zstandard', 'numba', 'rclpy')


class HealthLogWriter(SideFile):
    """Writes `/diagnostics` to health.mcap, stamped with the wall clock; never raises once open.

    folder : that of the run, prepared (`rpo_log.format.run.prepare_folder`)
    """

    def __init__(self, folder: str | Path, name: str = '/diagnostics') -> None:
        super().__init__(Path(folder) / HEALTH_FILE, name, interfaces.LOCKSTEP)
        self._closed_s = time.monotonic()

    def chunk_is_full(self) -> bool:
        """Give a crash no more than CHUNK_S of wall time."""
        full = time.monotonic() - self._closed_s >= CHUNK_S
        self._closed_s = time.monotonic() if full else self._closed_s
        return full


def machine_facts() -> dict[str, Any]:
    """Return where a run was made: processor, system, Python and libraries."""
    libraries: dict[str, str | None] = {}
    for name in _LIBRARIES:
        try:
            libraries[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            libraries[name] = None
    return {
        'machine': platform.machine(),
        'processor': _processor(),
        'system': platform.platform(),
        'python': platform.python_version(),
        'libraries': libraries,
    }


def _processor() -> str:
    try:
        lines = Path('/proc/cpuinfo').read_text().splitlines()
    except OSError:
        return platform.processor()
    models = [line.partition(':')[2].strip() for line in lines if line.startswith('model name')]
    return f'{len(models)} x {models[0]}' if models else platform.processor()


def write_run_info(folder: str | Path, facts: Mapping[str, Any]) -> None:
    """Write run_info.yaml: the facts of the caller, then those of the machine; raises LogError."""
    path = Path(folder) / INFO_FILE
    text = yaml.safe_dump({**facts, 'machine': machine_facts()}, sort_keys=False)
    try:
        path.write_text(text, encoding='utf-8')
    except OSError as error:
        raise cannot_write(path, error) from None
