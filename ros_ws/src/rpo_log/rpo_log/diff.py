# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Two logs side by side: where they first differ, in how many ticks, and by how much."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rpo_core import cdr
from rpo_log import topics
from rpo_log.decode import Block
from rpo_log.errors import ExitCode
from rpo_log.stream import RunReader

STATE_FIELDS = (*cdr.ODOMETRY_FIELDS[cdr.POSITION], *cdr.ODOMETRY_FIELDS[cdr.VELOCITY])
FORCE_FIELDS = cdr.WRENCH_FIELDS[:3]


@dataclass
class LogDiff:
    """How two logs of a run differ.

    remarks : differences beside the ticks: attachments, topics, lengths, statuses
    first : per role, (tick, field, value in a, value in b); None for a message that one log lacks
    ticks : per role, number of ticks that differ
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
        """Whether both logs say the same."""
        return not (self.remarks or self.first)

    @property
    def exit_code(self) -> ExitCode:
        """OK or DIFFERENT."""
        return ExitCode.OK if self.equal else ExitCode.DIFFERENT

    def lines(self) -> list[str]:
        """Return what there is to say, in lines for people."""
        said = [
            f'{self.paths[0]} and {self.paths[1]}: {self.compared} ticks compared, '
            + ('equal' if self.equal else 'DIFFERENT')
        ]
        said += self.remarks
        for role, (tick, name, a, b) in sorted(self.first.items(), key=lambda item: item[1][0]):
            said.append(
                f'{role}: {self.ticks[role]} ticks differ, the first is {tick}: {name} is '
                f'{_shown(a)} and {_shown(b)}'
            )
        said += [
            f'largest difference of {name}: {value:.6g}' for name, value in self.largest.items()
        ]
        return said


def _shown(value: float | None) -> str:
    return 'missing' if value is None else repr(value)


class _Side:
    """One of the two logs, read block by block.

    last : last tick so far
    """

    def __init__(self, path: str | Path) -> None:
        self.reader = RunReader(path)
        self.statuses: list[tuple[int, cdr.Status]] = []
        self.last = -1
        self.held: Block | None = None
        self._blocks = self.reader.blocks()

    def fill(self) -> Block | None:
        """Return the ticks that were not taken yet, more if there are none; None at the end."""
        while self.held is None or not len(self.held.ticks):
            self.held = next(self._blocks, None)
            if self.held is None:
                return None
            self.statuses.extend(self.held.statuses)
        return self.held

    def take(self, block: Block, ticks: NDArray[np.int64]) -> Block:
        """Take the next ticks out of what `fill` returned; NaN for those that this log lacks."""
        self.held = _after(block, int(ticks[-1]))
        taken = block.ticks[: len(block.ticks) - len(self.held.ticks)]
        self.last = int(taken[-1]) if len(taken) else self.last
        return _at(block, ticks)

    def drain(self) -> None:
        """Read to the end."""
        while (block := self.fill()) is not None:
            self.last = int(block.ticks[-1])
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
    if left.statuses != right.statuses:
        found.remarks.append(f'{topics.STATUS} differs')
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


def _at(block: Block, ticks: NDArray[np.int64]) -> Block:
    """Return the rows of some ticks; NaN for those that the block lacks."""
    where = np.isin(ticks, block.ticks)
    rows = np.isin(block.ticks, ticks)

    def spread(values: NDArray[np.float64]) -> NDArray[np.float64]:
        out = np.full((len(ticks), values.shape[1]), np.nan)
        out[where] = values[rows]
        return out

    present = {}
    for role, there in block.present.items():
        present[role] = np.zeros(len(ticks), dtype=bool)
        present[role][where] = there[rows]
    return Block(
        ticks,
        spread(block.states),
        spread(block.forces_n),
        spread(block.disturbances_n),
        spread(block.navigation),
        spread(block.applied_n),
        spread(block.applied_disturbances_n),
        present,
        odd=tuple(odd for odd in block.odd if odd.tick in ticks),
    )


def _after(block: Block, tick: int) -> Block:
    keep = block.ticks > tick
    return Block(
        block.ticks[keep],
        block.states[keep],
        block.forces_n[keep],
        block.disturbances_n[keep],
        block.navigation[keep],
        block.applied_n[keep],
        block.applied_disturbances_n[keep],
        {r: p[keep] for r, p in block.present.items()},
        odd=tuple(odd for odd in block.odd if odd.tick > tick),
    )


def _compare_blocks(pair: tuple[Block, Block], found: LogDiff) -> None:
    a, b = pair
    found.compared += len(a.ticks)
    none = np.zeros(len(a.ticks), dtype=bool)
    for role, name, fields in (
        (topics.STATE, 'states', STATE_FIELDS),
        (topics.NAVIGATION, 'navigation', STATE_FIELDS),
        (topics.FORCE, 'forces_n', FORCE_FIELDS),
        (topics.DISTURBANCE, 'disturbances_n', FORCE_FIELDS),
        (topics.APPLIED, 'applied_n', FORCE_FIELDS),
        (topics.APPLIED_DISTURBANCE, 'applied_disturbances_n', FORCE_FIELDS),
    ):
        here = a.present.get(role, none), b.present.get(role, none)
        values = getattr(a, name), getattr(b, name)
        _compare_role(found, role, fields, a.ticks, here, values)
    if [(o.tick, o.data) for o in a.odd] != [(o.tick, o.data) for o in b.odd]:
        remark = 'messages with more than a stamp and a state or force differ'
        found.remarks += [remark] if remark not in found.remarks else []


def _compare_role(
    found: LogDiff,
    role: str,
    fields: tuple[str, ...],
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
    found.ticks[role] = found.ticks.get(role, 0) + len(rows)
    if role not in found.first:
        row = int(rows[0])
        column = int(unequal[row].argmax())
        shown = [
            float(v[row, column]) if h[row] else None for v, h in zip(values, here, strict=True)
        ]
        found.first[role] = (int(ticks[row]), fields[column], shown[0], shown[1])
    with np.errstate(invalid='ignore'):
        sizes = np.nanmax(np.abs(np.where(unequal, values[0] - values[1], 0.0)), axis=0)
    for name, size in zip(fields, sizes, strict=True):
        key = f'{role} {name}'
        if size > found.largest.get(key, 0.0):
            found.largest[key] = float(size)
