# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A whole log from one that is cut short or corrupt: a tolerant read, into the writer."""

from __future__ import annotations

import shutil
from contextlib import ExitStack, closing
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

from rpo_log.errors import ExitCode, LogError, cannot_write, exists
from rpo_log.format import rosbag2
from rpo_log.format.run import METADATA_FILE, SIGNATURE_FILE, SUMS_FILE
from rpo_log.read.stream import RunReader
from rpo_log.signature import write_sums
from rpo_log.write.mcap_file import BagFileWriter

_NEW = (METADATA_FILE, SUMS_FILE, SIGNATURE_FILE)


@dataclass(frozen=True)
class Repair:
    """What was kept of a log, where it is; what was wrong, and chunks that could not be read."""

    output: Path
    messages: int
    damage: str
    lost_chunks: int

    @property
    def exit_code(self) -> ExitCode:
        """OK, or INCOMPLETE if chunks are lost."""
        return ExitCode.INCOMPLETE if self.lost_chunks else ExitCode.OK

    def lines(self) -> list[str]:
        """Return what was done, for people."""
        lost = f', {self.lost_chunks} chunks lost' if self.lost_chunks else ''
        return [f'{self.output}: {self.messages} messages{lost}; {self.damage or "it was whole"}']


def repair(path: str | Path, output: str | Path | None = None) -> Repair:
    """Write what can be read of a run folder or .mcap file as a whole log; raises LogError.

    output : folder of the result, by default <name>-repaired; files beside the log are copied
    """
    source = Path(path)
    reader = RunReader(source, tolerant=True)
    target = Path(output or source.with_name(f'{source.name.removesuffix(".mcap")}-repaired'))
    with ExitStack() as undo:
        try:
            target.mkdir(parents=True)
            undo.callback(shutil.rmtree, target)
            messages = _write(reader, target)
            for beside in source.iterdir() if source.is_dir() else ():
                if beside.is_file() and beside not in reader.files and beside.name not in _NEW:
                    shutil.copy2(beside, target / beside.name)
        except FileExistsError:
            raise exists(target, 'name another output') from None
        except OSError as error:
            raise cannot_write(target, error) from None
        write_sums(target)
        undo.pop_all()
    return Repair(target, messages, reader.damage, reader.lost_chunks)


def _write(reader: RunReader, folder: Path) -> int:
    """Write run.mcap and metadata.yaml of the messages; return their number."""
    index = {topic: i for i, topic in enumerate(reader.topics)}
    parts = reader.topics, reader.base, reader.attachments
    with closing(BagFileWriter(folder / 'run.mcap', *parts)) as file:
        for tick, messages in groupby(reader.messages(), key=lambda message: message.tick):
            file.add_tick(tick, [(index[message.topic], message.data) for message in messages])
        if not file.ticks:
            raise LogError(reader.path, f'holds no whole chunk ({reader.damage})')
        file.finish()
        rosbag2.write_metadata(folder, reader.topics, [file.entry])
        return sum(file.entry.counts)
