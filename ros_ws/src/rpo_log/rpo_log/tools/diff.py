# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A log at a glance; two side by side: where they differ first, in how many ticks, by how much."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rpo_core.wire import interfaces
from rpo_core.wire.interfaces import Interface
from rpo_log.bag import open_run
from rpo_log.errors import ExitCode
from rpo_log.format.run import TimeBase
from rpo_log.read.run_log import RunLog, read_run
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


@dataclass
class LogDiff:
    """How two logs of a run differ.

    remarks : differences beside the ticks: attachments, topics, lengths, statuses
    first : per signal, (tick, field, value in a, value in b); None for a missing message
    ticks : per signal, number of ticks that differ
    largest : per field, largest absolute difference
    """

    paths: tuple[Path, Path]
    compared: int = 0
    remarks: list[str] = field(default_factory=list)
    first: dict[str, tuple[int, str, float | None, float | None]] = field(default_factory=dict)
    ticks: dict[str, int] = field(default_factory=dict)
    largest: dict[str, float] = field(default_factory=dict)

    @property
    def exit_code(self) -> ExitCode:
        """OK or DIFFERENT."""
        return ExitCode.DIFFERENT if self.remarks or self.first else ExitCode.OK

    def lines(self) -> Iterator[str]:
        """Yield the comparison as lines of text."""
        verdict = 'DIFFERENT' if self.exit_code else 'equal'
        yield f'{self.paths[0]} and {self.paths[1]}: {self.compared} ticks compared, {verdict}'
        yield from self.remarks
        for signal, (tick, name, *pair) in sorted(self.first.items(), key=lambda row: row[1][0]):
            a, b = ('missing' if value is None else repr(value) for value in pair)
            ticks = self.ticks[signal]
            yield f'{signal}: {ticks} ticks differ, the first is {tick}: {name} is {a} and {b}'
        for name, value in self.largest.items():
            yield f'largest difference of {name}: {value:.6g}'


def diff(a: str | Path, b: str | Path) -> LogDiff:
    """Compare two logs tick by tick, bit for bit, as far as both go; raises LogError."""
    logs = one, other = read_run(open_run(a)), read_run(open_run(b))
    difference = LogDiff((one.path, other.path))
    if one.base != other.base:
        difference.remarks.append(f'their ticks differ: {one.base} and {other.base}')
    if one.topics != other.topics:
        names = (', '.join(topic.name for topic in log.topics) for log in logs)
        difference.remarks.append('their topics differ: ' + ' and '.join(names))
    for name in sorted({*one.attachments, *other.attachments}):
        if one.attachments.get(name) != other.attachments.get(name):
            difference.remarks.append(f'{name} differs')
    ends = [int(log.ticks[-1]) for log in logs]
    ticks = np.union1d(one.ticks, other.ticks)
    ticks = ticks[ticks <= min(ends)]
    difference.compared = len(ticks)
    for row in interfaces.table().values():
        if row.name in {*one.values, *other.values}:
            _compare(difference, row, ticks, [_at(ticks, log, row.name) for log in logs])
    others = [[m for m in log.non_canonical if m.tick <= min(ends)] for log in logs]
    if others[0] != others[1]:
        difference.remarks.append('messages with more than a stamp and a state or force differ')
    if ends[0] != ends[1]:
        difference.remarks.append(f'they end at ticks {ends[0]} and {ends[1]}')
    for signal in sorted({event.signal for log in logs for event in log.events}):
        in_a, in_b = ([e for e in log.events if e.signal == signal] for log in logs)
        if in_a != in_b:
            difference.remarks.append(f'{signal} differs')
    return difference


def _at(ticks: NDArray[np.int64], log: RunLog, signal: str) -> NDArray[np.float64] | None:
    """Return the numbers (n, width) of a signal at some ticks, NaN where the log has no message."""
    values = log.values.get(signal)
    if values is None:
        return None
    values_at_ticks = np.full((len(ticks), values.shape[1]), np.nan)
    values_at_ticks[np.isin(ticks, log.ticks)] = values[np.isin(log.ticks, ticks)]
    return values_at_ticks


def _compare(
    difference: LogDiff,
    row: Interface,
    ticks: NDArray[np.int64],
    pair: Sequence[NDArray[np.float64] | None],
) -> None:
    """Compare a signal at the same ticks of two logs; None: a log has it not."""
    shape = next(values.shape for values in pair if values is not None)
    a, b = (np.full(shape, np.nan) if values is None else values for values in pair)
    unequal = a.view(np.uint64) != b.view(np.uint64)
    rows = np.flatnonzero(unequal.any(axis=1))
    if not len(rows):
        return
    difference.ticks[row.name] = len(rows)
    i, column = int(rows[0]), int(unequal[rows[0]].argmax())
    one, other = (None if np.isnan(v[i]).all() else float(v[i, column]) for v in (a, b))
    difference.first[row.name] = (int(ticks[i]), row.columns[column], one, other)
    sizes = np.nan_to_num(np.abs(a - b)).max(axis=0)
    for name, size in zip(row.columns, sizes.tolist(), strict=True):
        if size > 0.0:
            difference.largest[f'{row.name} {name}'] = size
