# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Two logs side by side: where they first differ, in how many ticks, and by how much."""

from __future__ import annotations

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
    def equal(self) -> bool:
        """Whether both logs hold the same."""
        return not (self.remarks or self.first)

    @property
    def exit_code(self) -> ExitCode:
        """OK or DIFFERENT."""
        return ExitCode.OK if self.equal else ExitCode.DIFFERENT

    def lines(self) -> list[str]:
        """Return the comparison as lines of text."""
        lines = [
            f'{self.paths[0]} and {self.paths[1]}: {self.compared} ticks compared, '
            + ('equal' if self.equal else 'DIFFERENT')
        ]
        lines += self.remarks
        for signal, (tick, name, a, b) in sorted(self.first.items(), key=lambda item: item[1][0]):
            lines.append(
                f'{signal}: {self.ticks[signal]} ticks differ, the first is {tick}: {name} is '
                f'{_shown(a)} and {_shown(b)}'
            )
        lines += [
            f'largest difference of {name}: {value:.6g}' for name, value in self.largest.items()
        ]
        return lines


def _shown(value: float | None) -> str:
    return 'missing' if value is None else repr(value)


class _Side:
    """One of the two logs, read block by block.

    last : last tick that was read
    """

    def __init__(self, path: str | Path) -> None:
        self.reader = open_run(path)
        self.events: list[Event] = []
        self.last = -1
        self.held: TickBlock | None = None
        self._blocks = self.reader.blocks()

    def fill(self) -> TickBlock | None:
        """Return the ticks that were not taken yet, more if there are none; None at the end."""
        while self.held is None or not len(self.held.ticks):
            self.held = next(self._blocks, None)
            if self.held is None:
                return None
            self.events.extend(self.held.events)
            self.last = int(self.held.ticks[-1]) if len(self.held.ticks) else self.last
        return self.held

    def take(self, block: TickBlock, ticks: NDArray[np.int64]) -> TickBlock:
        """Take the next ticks out of what `fill` returned; NaN for those that are not there."""
        self.held = block.at(block.ticks[block.ticks > ticks[-1]])
        return block.at(ticks)

    def drain(self) -> None:
        """Read to the end."""
        while self.fill() is not None:
            self.held = None


def diff(a: str | Path, b: str | Path) -> LogDiff:
    """Compare two logs tick by tick, bit for bit, in bounded memory; raises LogError."""
    left, right = _Side(a), _Side(b)
    found = LogDiff((left.reader.path, right.reader.path))
    _compare_heads((left.reader, right.reader), found)
    while (one := left.fill()) is not None and (other := right.fill()) is not None:
        upto = min(one.ticks[-1], other.ticks[-1])
        ticks = np.union1d(one.ticks[one.ticks <= upto], other.ticks[other.ticks <= upto])
        _compare_blocks((left.take(one, ticks), right.take(other, ticks)), found)
    left.drain()
    right.drain()
    if left.last != right.last:
        found.remarks.append(f'they end at ticks {left.last} and {right.last}')
    for signal in sorted({event.signal for event in (*left.events, *right.events)}):
        in_a, in_b = ([e for e in side.events if e.signal == signal] for side in (left, right))
        if in_a != in_b:
            found.remarks.append(f'{signal} differs')
    return found


def _compare_heads(readers: tuple[RunReader, RunReader], found: LogDiff) -> None:
    a, b = readers
    if a.base != b.base:
        found.remarks.append(f'their ticks differ: {a.base} and {b.base}')
    if a.topics != b.topics:
        names = (', '.join(topic.name for topic in reader.topics) for reader in readers)
        found.remarks.append('their topics differ: ' + ' and '.join(names))
    for name in sorted({*a.attachments, *b.attachments}):
        if a.attachments.get(name) != b.attachments.get(name):
            found.remarks.append(f'{name} differs')


def _compare_blocks(pair: tuple[TickBlock, TickBlock], found: LogDiff) -> None:
    a, b = pair
    found.compared += len(a.ticks)
    none = np.zeros(len(a.ticks), dtype=bool)
    for row in interfaces.table().values():
        sides = [block for block in pair if row.name in block.values]
        if sides:
            here = a.present.get(row.name, none), b.present.get(row.name, none)
            nothing = np.full_like(sides[0].values[row.name], np.nan)
            values = a.values.get(row.name, nothing), b.values.get(row.name, nothing)
            _compare_signal(found, row, a.ticks, here, values)
    if [(m.tick, m.data) for m in a.non_canonical] != [(m.tick, m.data) for m in b.non_canonical]:
        remark = 'messages with more than a stamp and a state or force differ'
        found.remarks += [remark] if remark not in found.remarks else []


def _compare_signal(
    found: LogDiff,
    row: Interface,
    ticks: NDArray[np.int64],
    here: tuple[NDArray[np.bool_], NDArray[np.bool_]],
    values: tuple[NDArray[np.float64], NDArray[np.float64]],
) -> None:
    bits = [np.ascontiguousarray(v).view(np.uint64) for v in values]
    both = here[0] & here[1]
    unequal = (bits[0] != bits[1]) & both[:, None]
    rows = np.flatnonzero(unequal.any(axis=1) | (here[0] != here[1]))
    if not len(rows):
        return
    found.ticks[row.name] = found.ticks.get(row.name, 0) + len(rows)
    if row.name not in found.first:
        i = int(rows[0])
        column = int(unequal[i].argmax())
        shown = [float(v[i, column]) if h[i] else None for v, h in zip(values, here, strict=True)]
        found.first[row.name] = (int(ticks[i]), row.columns[column], shown[0], shown[1])
    with np.errstate(invalid='ignore'):
        sizes = np.nanmax(np.abs(np.where(unequal, values[0] - values[1], 0.0)), axis=0)
    for name, size in zip(row.columns, sizes, strict=True):
        key = f'{row.name} {name}'
        if size > found.largest.get(key, 0.0):
            found.largest[key] = float(size)
