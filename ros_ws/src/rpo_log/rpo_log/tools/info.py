# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What is in a log, at a glance."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from rpo_log.bag import open_run
from rpo_mcap.errors import ExitCode
from rpo_mcap.format.run import TimeBase
from rpo_mcap.read.stream import Completeness
from rpo_mcap.topics import Topic


@dataclass(frozen=True)
class LogInfo:
    """A log at a glance.

    messages : per topic
    ticks : first and last in the log
    outcome : last phase in run_status; None if there is none
    gaps : why the log does not show a whole flight; empty if it does
    """

    path: Path
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

    @property
    def duration_s(self) -> float:
        """Simulated time from the first to the last tick."""
        return (self.ticks[1] - self.ticks[0]) * self.base.dt_ns / 1_000_000_000

    def lines(self) -> list[str]:
        """Return the table as lines of text."""
        lines = [f'{path}  {size} bytes' for path, size in self.files]
        lines.append(
            f'ticks {self.ticks[0]} to {self.ticks[1]} of {self.base.last_tick}, '
            f'{self.duration_s:g} s, outcome: {self.outcome or "unknown"}'
        )
        lines += [
            f'{topic.name}  {topic.type}  {count} messages'
            for topic, count in self.messages.items()
        ]
        lines += [f'attached: {name}  {size} bytes' for name, size in self.attachments.items()]
        return [*lines, *self.gaps]


def inspect(path: str | Path) -> LogInfo:
    """Read a log or a bag through, in bounded memory; raises LogError."""
    reader = open_run(path)
    completeness = Completeness(reader)
    for block in reader.blocks():
        completeness.add(block)
    return LogInfo(
        path=reader.path,
        files=tuple((file, file.stat().st_size) for file in reader.sources),
        base=reader.base,
        messages=completeness.messages,
        ticks=(completeness.first, completeness.last),
        attachments={name: len(data) for name, data in reader.attachments.items()},
        outcome=completeness.outcome,
        gaps=(*completeness.gaps(reader.damage), *reader.lacks),
    )
