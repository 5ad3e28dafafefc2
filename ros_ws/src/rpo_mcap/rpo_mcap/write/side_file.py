# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The health of a run, `/diagnostics`, in a file beside its log.

It is apart from run.mcap, which holds the same messages every tick, and is therefore read many
ticks at once.
"""

from __future__ import annotations

import time
from pathlib import Path

from rpo_core.wire import interfaces
from rpo_mcap.errors import cannot_write
from rpo_mcap.format.run import HEALTH_FILE
from rpo_mcap.topics import Topic
from rpo_mcap.write.mcap_file import BagFileWriter

CHUNK_S = 2.0
"""Wall time after which a chunk is closed: a crash loses no more."""


class HealthLogWriter:
    """Writes `/diagnostics` to health.mcap, stamped with the wall clock; never raises once open.

    folder : of the run, which is prepared (`rpo_mcap.format.run.prepare_folder`)
    name : full name of the topic
    failure : why the file ended early; None if it did not
    """

    def __init__(self, folder: str | Path, name: str = '/diagnostics') -> None:
        self.failure: str | None = None
        self._messages, self._closed = 0, False
        self._closed_s = time.monotonic()
        path = Path(folder) / HEALTH_FILE
        try:
            topic = Topic(name, interfaces.row_of(interfaces.DIAGNOSTICS))
            self._file = BagFileWriter(path, [topic])
        except OSError as error:
            raise cannot_write(path, error) from None

    def write(self, stamp_ns: int, data: bytes) -> None:
        """Log the CDR of one DiagnosticArray under a stamp (UTC since 1970)."""
        if self.failure is not None or self._closed:
            return
        try:
            self._file.add(stamp_ns, self._messages, [(0, data)])
            self._messages += 1
            if time.monotonic() - self._closed_s >= CHUNK_S:
                self._closed_s = time.monotonic()
                self._file.close_chunk()
        except OSError as error:
            self.failure = error.strerror or str(error)

    def close(self) -> None:
        """End the file; what comes after is dropped. Never raises."""
        if self._closed:
            return
        self._closed = True
        for step in (self._file.close,) if self.failure else (self._file.finish, self._file.close):
            try:
                step()
            except OSError as error:
                self.failure = error.strerror or str(error)
