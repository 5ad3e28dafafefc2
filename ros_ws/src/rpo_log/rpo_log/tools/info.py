# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What is in a log, at a glance."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from rpo_log.bag import open_run
from rpo_log.errors import ExitCode
from rpo_log.format.run import TimeBase
from rpo_log.read.run_log import read_run
from rpo_log.topics import Topic


@dataclass(frozen=True)
class LogInfo:
    """A log at a glance.

    files : of the log, each with its size in bytes
    messages : per topic
    ticks : first and last in the log
    attachments : per file that it carries, its size in bytes
    outcome : last phase in run_status; None if there is none
    gaps : why the log does not show a whole flight; empty if it does
    """

    files: tuple[tuple[Path, int], ...]
    base: TimeBase
    messages: dict[Topic, int]
    ticks: tuple[int, int]
    attachments: dict[str, int]
    outcome: str | None
    gaps: tuple[str, ...]

    @property
    def exit_code(self) -> ExitCode:
        """OK, or INCOMPLETE."""
        return ExitCode.INCOMPLETE if self.gaps else ExitCode.OK

    def lines(self) -> list[str]:
        """Return the table as lines of text."""
        first, last = self.ticks
        seconds = (last - first) * self.base.dt_ns / 1_000_000_000
        return [
            *(f'{path}  {size} bytes' for path, size in self.files),
            f'ticks {first} to {last} of {self.base.last_tick}, '
            f'{seconds:g} s, outcome: {self.outcome or "unknown"}',
            *(f'{t.name}  {t.type}  {count} messages' for t, count in self.messages.items()),
            *(f'attached: {name}  {size} bytes' for name, size in self.attachments.items()),
            *self.gaps,
        ]


def inspect(path: str | Path) -> LogInfo:
    """Read a log or a bag through; raises LogError."""
    reader = open_run(path)
    log = read_run(reader)
    return LogInfo(
        files=tuple((file, file.stat().st_size) for file in reader.sources),
        base=log.base,
        messages={
            topic: sum(file.counts[index] for file in reader.extents.values())
            for index, topic in enumerate(log.topics)
        },
        ticks=(int(log.ticks[0]), int(log.ticks[-1])),
        attachments={name: len(data) for name, data in log.attachments.items()},
        outcome=log.outcome,
        gaps=(*log.gaps, *log.lacks),
    )
