# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A file of one topic of DiagnosticArrays beside a run's log: its health, its decisions."""

from __future__ import annotations

from pathlib import Path

from rpo_core.interfaces import ARRAY_TYPE, Qos
from rpo_log.errors import LogError
from rpo_log.format import rosbag2, schemas
from rpo_log.format.run import cannot_write
from rpo_log.write.mcap_file import McapFile


class SideFile:
    """Writes one topic to an MCAP file; never raises once open.

    path : in the folder of the run, which is prepared (`rpo_log.format.run.prepare_folder`)
    name : full name of the topic
    failure : why the file ended early; None if it did not
    """

    def __init__(self, path: Path, name: str, qos: Qos) -> None:
        self.failure: str | None = None
        self.messages = 0
        self._closed = False
        definition = schemas.definition(ARRAY_TYPE)
        self._file = McapFile(path)
        self._path, self._name, self._qos = path, name, qos
        self._stamps = (0, 0)
        try:
            self._add_rosbag2_record()
            schema = self._file.add_schema(ARRAY_TYPE, definition.text.encode())
            self._channel = self._file.add_channel(
                name,
                schema,
                {
                    'offered_qos_profiles': rosbag2.qos_text([qos]),
                    'topic_type_hash': definition.type_hash,
                },
            )
            self._file.close_chunk()
        except OSError as error:
            raise cannot_write(path, error) from None

    def write(self, stamp_ns: int, data: bytes) -> None:
        """Log the CDR of one DiagnosticArray under a stamp (UTC since 1970)."""
        if self.failure is not None or self._closed:
            return
        try:
            self._file.add_message(self._channel, stamp_ns, self.messages, data)
            self._stamps = (self._stamps[0] if self.messages else stamp_ns, stamp_ns)
            self.messages += 1
            if self.chunk_is_full():
                self._file.close_chunk()
        except OSError as error:
            self.failure = error.strerror or str(error)

    def chunk_is_full(self) -> bool:
        """Return whether what is in the open chunk should be out of a crash's reach now."""
        raise NotImplementedError

    def close(self) -> None:
        """End the file; what comes after is dropped. Never raises."""
        if self._closed:
            return
        self._closed = True
        try:
            if self.failure is None:
                self._add_rosbag2_record()
                self._file.finish()
        except (OSError, LogError) as error:
            self.failure = getattr(error, 'strerror', None) or str(error)
        self._file.close()

    def _add_rosbag2_record(self) -> None:
        type_hash = schemas.definition(ARRAY_TYPE).type_hash
        qos = [rosbag2.qos_document(self._qos)]
        topic = rosbag2.BagTopic(self._name, ARRAY_TYPE, type_hash, qos, self.messages)
        file = rosbag2.BagFile(self._path.name, *self._stamps, self.messages)
        document = rosbag2.metadata([topic], [file])
        self._file.add_metadata(rosbag2.RECORD, rosbag2.record_values(document))
