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

from rpo_log import rosbag2, schemas
from rpo_log.errors import LogError
from rpo_log.mcap_file import McapFile
from rpo_log.run import HEALTH_FILE, INFO_FILE, cannot_write
from rpo_log.topics import Qos

HEALTH_TYPE = 'diagnostic_msgs/msg/DiagnosticArray'
CHUNK_S = 2.0
"""Wall time after which a chunk is closed: so much a crash may take."""

_LIBRARIES = ('numpy', 'PyYAML', 'mcap', 'zstandard', 'numba', 'rclpy')


class HealthLogWriter:
    """Writes `/diagnostics` to health.mcap, stamped with the wall clock; never raises once open.

    folder : that of the run, prepared (`rpo_log.run.prepare_folder`)
    failure : why the log ended early; None if it did not
    """

    def __init__(self, folder: str | Path, name: str = '/diagnostics') -> None:
        self.failure: str | None = None
        self.messages = 0
        definition = schemas.definition(HEALTH_TYPE)
        path = Path(folder) / HEALTH_FILE
        self._file = McapFile(path)
        self._name = name
        self._stamps = (0, 0)
        try:
            self._add_rosbag2_record()
            schema = self._file.add_schema(HEALTH_TYPE, definition.text.encode())
            self._channel = self._file.add_channel(
                name,
                schema,
                {
                    'offered_qos_profiles': rosbag2.qos_text([Qos()]),
                    'topic_type_hash': definition.type_hash,
                },
            )
            self._file.close_chunk()
        except OSError as error:
            raise cannot_write(path, error) from None
        self._closed_s = time.monotonic()

    def write(self, stamp_ns: int, data: bytes) -> None:
        """Log the CDR of one DiagnosticArray, received at `stamp_ns` (UTC since 1970)."""
        if self.failure is not None:
            return
        try:
            self._file.add_message(self._channel, stamp_ns, self.messages, data)
            self._stamps = (self._stamps[0] if self.messages else stamp_ns, stamp_ns)
            self.messages += 1
            now_s = time.monotonic()
            if now_s - self._closed_s >= CHUNK_S:
                self._closed_s = now_s
                self._file.close_chunk()
        except OSError as error:
            self.failure = error.strerror or str(error)

    def close(self) -> None:
        """End the file; never raises."""
        try:
            if self.failure is None:
                self._add_rosbag2_record()
                self._file.finish()
        except (OSError, LogError) as error:
            self.failure = getattr(error, 'strerror', None) or str(error)
        self._file.close()

    def _add_rosbag2_record(self) -> None:
        type_hash = schemas.definition(HEALTH_TYPE).type_hash
        qos = [Qos().to_document()]
        topic = rosbag2.BagTopic(self._name, HEALTH_TYPE, type_hash, qos, self.messages)
        file = rosbag2.BagFile(HEALTH_FILE, *self._stamps, self.messages)
        document = rosbag2.metadata([topic], [file])
        self._file.add_metadata(rosbag2.RECORD, rosbag2.record_values(document))


def machine_facts() -> dict[str, Any]:
    """Return what a run was flown on: processor, system, Python and libraries."""
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
