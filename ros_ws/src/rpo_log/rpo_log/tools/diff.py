# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Two logs side by side: where they first differ, in how many ticks, and by how much."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rpo_core.wire import interfaces
from rpo_core.wire.interfaces import Interface
from rpo_log.bag import open_run
from rpo_mcap.errors import ExitCode
from rpo_mcap.read.decode import Event, TickBlock
from rpo_mcap.read.stream import RunReader


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


class _Side:
    """One of the two logs; its events and its last tick, as far as it was read."""

    def __init__(self, path: str | Path) -> None:
        self.reader = open_run(path)
        self.events: list[Event] = []
        self.last = -1

    def blocks(self) -> Iterator[TickBlock]:
        """Yield all ticks in order."""
        for block in self.reader.blocks():
            self.events += block.events
            if len(block.ticks):
                self.last = int(block.ticks[-1])
                yield block


def diff(a: str | Path, b: str | Path) -> LogDiff:
    """Compare two logs tick by tick, bit for bit, in bounded memory; raises LogError."""
    sides = left, right = _Side(a), _Side(b)
    found = LogDiff((left.reader.path, right.reader.path))
    _compare_heads(left.reader, right.reader, found)
    blocks = [side.blocks() for side in sides]
    one, other = (next(rest, None) for rest in blocks)
    while one is not None and other is not None:
        end = min(one.ticks[-1], other.ticks[-1])
        ticks = np.union1d(one.ticks[one.ticks <= end], other.ticks[other.ticks <= end])
        _compare_blocks((one.at(ticks), other.at(ticks)), found)
        one, other = (
            block.at(block.ticks[block.ticks > end]) if block.ticks[-1] > end else next(rest, None)
            for block, rest in zip((one, other), blocks, strict=True)
        )
    for rest in blocks:
        deque(rest, maxlen=0)
    if left.last != right.last:
        found.remarks.append(f'they end at ticks {left.last} and {right.last}')
    for signal in sorted({event.signal for event in (*left.events, *right.events)}):
        in_a, in_b = ([e for e in side.events if e.signal == signal] for side in sides)
        if in_a != in_b:
            found.remarks.append(f'{signal} differs')
    return found


def _compare_heads(a: RunReader, b: RunReader, found: LogDiff) -> None:
    if a.base != b.base:
        found.remarks.append(f'their ticks differ: {a.base} and {b.base}')
    if a.topics != b.topics:
        names = (', '.join(topic.name for topic in reader.topics) for reader in (a, b))
        found.remarks.append('their topics differ: ' + ' and '.join(names))
    for name in sorted({*a.attachments, *b.attachments}):
        if a.attachments.get(name) != b.attachments.get(name):
            found.remarks.append(f'{name} differs')


def _compare_blocks(pair: tuple[TickBlock, TickBlock], found: LogDiff) -> None:
    """Compare the signals of two blocks of the same ticks."""
    ticks = pair[0].ticks
    found.compared += len(ticks)
    for row in interfaces.table().values():
        width = next((b.values[row.name].shape[1] for b in pair if row.name in b.values), None)
        if width is not None:
            nothing, never = np.full((len(ticks), width), np.nan), np.zeros(len(ticks), dtype=bool)
            values = tuple(block.values.get(row.name, nothing) for block in pair)
            present = tuple(block.present.get(row.name, never) for block in pair)
            _compare_signal(found, row, ticks, present, values)
    others = [[(m.tick, m.data) for m in block.non_canonical] for block in pair]
    remark = 'messages with more than a stamp and a state or force differ'
    if others[0] != others[1] and remark not in found.remarks:
        found.remarks.append(remark)


def _compare_signal(
    found: LogDiff,
    row: Interface,
    ticks: NDArray[np.int64],
    present: tuple[NDArray[np.bool_], ...],
    values: tuple[NDArray[np.float64], ...],
) -> None:
    bits = [np.ascontiguousarray(v).view(np.uint64) for v in values]
    unequal = (bits[0] != bits[1]) & (present[0] & present[1])[:, None]
    rows = np.flatnonzero(unequal.any(axis=1) | (present[0] != present[1]))
    if not len(rows):
        return
    found.ticks[row.name] = found.ticks.get(row.name, 0) + len(rows)
    if row.name not in found.first:
        i, column = int(rows[0]), int(unequal[rows[0]].argmax())
        a, b = (float(v[i, column]) if p[i] else None for v, p in zip(values, present, strict=True))
        found.first[row.name] = (int(ticks[i]), row.columns[column], a, b)
    with np.errstate(invalid='ignore'):
        sizes = np.nanmax(np.abs(np.where(unequal, values[0] - values[1], 0.0)), axis=0)
    for name, size in zip(row.columns, sizes.tolist(), strict=True):
        key = f'{row.name} {name}'
        if size > found.largest.get(key, 0.0):
            found.largest[key] = size
