# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""One stage of the chain, recomputed on its logged inputs block by block; and how stages were."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from rpo_core.chain.stage import WITHOUT_COMMAND, Stage
from rpo_core.wire import interfaces
from rpo_log import events
from rpo_log.errors import LogError
from rpo_log.read.decode import Event, TickBlock

Floats = NDArray[np.float64]


class StageStates:
    """Which stages were switched off, and what the plant went on without, as the events say."""

    def __init__(self) -> None:
        self._changes: dict[str, list[tuple[int, bool]]] = {}
        self._missing: dict[str, set[int]] = {}
        self._commands: dict[str, list[tuple[int, str]]] = {}
        self.dropped: dict[str, int] = {}

    def take(self, block_events: Sequence[Event]) -> None:
        """Take the events of a block."""
        for event in block_events:
            tick = events.tick_of(event.status)
            if event.signal == interfaces.RUN_STATUS:
                self.dropped.update(events.dropped(event.status))
            elif event.signal == interfaces.STAGE_STATUS and tick is not None:
                state = event.values.get('state')
                name = event.values.get('stage', '')
                if state == WITHOUT_COMMAND:
                    self._missing.setdefault(name, set()).add(tick)
                if state in (events.ACTIVE, events.INACTIVE):
                    changes = self._changes.setdefault(name, [])
                    changes.append((tick, state == events.ACTIVE))
                    changes.sort(key=lambda change: change[0])
                elif state is not None:
                    self._commands.setdefault(name, []).append((tick, state))

    def tell(self, stage: Stage) -> None:
        """Give a stage the commands that it got in flight."""
        for tick, state in self._commands.pop(stage.name, []):
            stage.take_event(tick, state)

    def missing(self, stage: str) -> set[int]:
        """Return the ticks at which a stage went on without the command before."""
        return self._missing.get(stage, set())

    def active(self, stage: str, ticks: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return at which ticks a stage was switched on."""
        changes = self._changes.get(stage, [])
        known = np.array([True, *(on for _, on in changes)])
        at = np.array([tick for tick, _ in changes], dtype=np.int64)
        return known[np.searchsorted(at, ticks, side='right')]

    def began(self, stage: str, ticks: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return at which ticks a stage began without memory: switched on, or started in flight."""
        return np.isin(ticks, [tick for tick, on in self._changes.get(stage, []) if on])


class Recomputation:
    """The outputs of a stage, as far as they can be computed from its logged inputs.

    A stage with memory is computed over ticks that follow each other. From tick 0, or from where it
    was switched on, its outputs are known at once; after a gap, when its memory is full again.

    In free running a node may have missed a tick. A memory of all ticks is then kept as if it had,
    and trusted if the next outputs are those of the log; if not, the recorder missed them.

    gaps : ticks whose inputs are there, and the memory is not
    first_gap : the first of them
    """

    def __init__(self, stage: Stage) -> None:
        self.stage = stage
        self.gaps, self.first_gap = 0, -1
        self._next = 0  # the tick that follows the last one
        self._filled: int | None = None  # ticks since the memory was lost; None: it was not
        self._doubtful = False  # whether it missed the tick before
        stage.reset()

    def run(
        self,
        ticks: NDArray[np.int64],
        inputs: Sequence[Floats],
        active: NDArray[np.bool_],
        began: NDArray[np.bool_],
        logged: Sequence[Floats] = (),
    ) -> tuple[list[Floats], NDArray[np.bool_]]:
        """Return the outputs (n, width) at each tick, NaN where unknown, and where they are known.

        inputs : (n, width) each, NaN where unknown
        active : where the stage is switched on; where it is not, its commands are zero
        began : where it began without memory
        logged : (n, width) each, outputs in the log, NaN where missing: in free running, of stages
            with memory
        """
        there, absent = active.copy(), np.zeros(len(ticks), dtype=bool)
        for name, values in zip(self.stage.inputs, inputs, strict=True):
            finite = np.isfinite(values).all(axis=1)
            if name in self.stage.may_miss:
                absent |= ~finite
            else:
                there &= finite
        if self.stage.memory_ticks == 0:
            rows = np.flatnonzero(there)
            made, known = self._made(rows, ticks, inputs), there.copy()
        else:
            made, known = self._with_memory(ticks, inputs, active, (there, absent), began, logged)
        if not active.all():
            carried = {interfaces.row_of(name).carries for name in self.stage.outputs}
            if carried == {interfaces.COMMAND}:
                known |= ~active
            for values in made:
                values[~active & known] = 0.0
        return made, known

    def _made(
        self, rows: NDArray[np.intp], ticks: NDArray[np.int64], inputs: Sequence[Floats]
    ) -> list[Floats]:
        """Return the outputs, computed at some rows, NaN at the others."""
        if not len(rows):
            rows_of = map(interfaces.row_of, self.stage.outputs)
            widths = (len(row.columns) or row.numbers for row in rows_of)
            return [np.full((len(ticks), width), np.nan) for width in widths]
        found = self.stage.steps(ticks[rows], *(values[rows] for values in inputs))
        if len(rows) == len(ticks):
            return list(found)
        made = [np.full((len(ticks), values.shape[1]), np.nan) for values in found]
        for values, computed in zip(made, found, strict=True):
            values[rows] = computed
        return made

    def _with_memory(
        self,
        ticks: NDArray[np.int64],
        inputs: Sequence[Floats],
        active: NDArray[np.bool_],
        present: tuple[NDArray[np.bool_], NDArray[np.bool_]],
        began: NDArray[np.bool_],
        logged: Sequence[Floats],
    ) -> tuple[list[Floats], NDArray[np.bool_]]:
        there, absent = present
        missed = np.zeros(len(ticks), dtype=bool)
        if logged:
            missed = active & ~np.any([np.isfinite(v).all(axis=1) for v in logged], axis=0)
        made = self._made(np.empty(0, dtype=np.intp), ticks, inputs)
        known = np.zeros(len(ticks), dtype=bool)
        change = (np.diff(ticks) != 1) | np.diff(active) | np.diff(there) | began[1:]
        change |= np.diff(missed)
        for part in np.split(np.arange(len(ticks)), np.flatnonzero(change) + 1):
            first, last = int(ticks[part[0]]), int(ticks[part[-1]])
            if first != self._next:
                self._forget(0)
            if began[part[0]]:
                self._forget(None)
            self._next = last + 1
            if missed[part[0]] and self.stage.memory_ticks is None:
                self._doubtful = True
                continue
            if missed[part[0]]:
                self._forget(0)
                continue
            if not there[part[0]]:  # switched on again it begins anew
                self._forget(0 if active[part[0]] else None)
                continue
            if absent[part].any():
                known[part] = self._without(part, made, ticks, inputs, absent)
            else:
                for values, found in zip(made, self._made(part, ticks, inputs), strict=True):
                    values[part] = found[part]
                known[part] = self._remembered(len(part))
            if self._doubtful and not _same(made, logged, part[0]):
                self._forget(0)
                known[part] = False
            self._doubtful = False
            unknown = part[~known[part]]
            if len(unknown):
                self.first_gap = self.first_gap if self.gaps else int(ticks[unknown[0]])
                self.gaps += len(unknown)
        for values in made:
            values[~known] = np.nan
        return made, known

    def _without(
        self,
        part: NDArray[np.intp],
        made: list[Floats],
        ticks: NDArray[np.int64],
        inputs: Sequence[Floats],
        absent: NDArray[np.bool_],
    ) -> NDArray[np.bool_]:
        """Fill the outputs of ticks some of whose inputs are absent; return which are known.

        The stage says whether it went on without them; if it did not, the log has lost them.
        """
        known = np.zeros(len(part), dtype=bool)
        for i, row in enumerate(part):
            tick = int(ticks[row])
            if absent[row] and not self.stage.goes_without(tick):
                self._forget(0)
                continue
            found = self.stage.step(tick, *(tuple(np.nan_to_num(v[row]).tolist()) for v in inputs))
            for values, computed in zip(made, found, strict=True):
                values[row] = computed
            known[i] = self._remembered(1)[0]
        return known

    def _forget(self, filled: int | None) -> None:
        self.stage.reset()
        self._doubtful = False
        self._filled = filled

    def _remembered(self, count: int) -> NDArray[np.bool_]:
        """Return at which of the next ticks the memory is full."""
        if self._filled is None:
            return np.ones(count, dtype=bool)
        ages = self._filled + np.arange(count)
        self._filled += count
        most = self.stage.memory_ticks
        return np.zeros(count, dtype=bool) if most is None else ages >= most


def _same(made: Sequence[Floats], logged: Sequence[Floats], row: np.intp) -> bool:
    """Return whether the outputs of a tick are those of the log, as far as it has them."""
    pairs = zip(made, logged, strict=True)
    return all(
        np.isnan(given[row]).any() or (mine[row] == given[row]).all() for mine, given in pairs
    )


def events_ahead(blocks: Iterable[TickBlock], states: StageStates) -> Iterator[TickBlock]:
    """Yield blocks, each when the events of the one after it are known: an event may come late."""
    before: TickBlock | None = None
    try:
        for block in blocks:
            states.take(block.events)
            if before is not None:
                yield before
            before = block
    except LogError:
        if before is not None:
            yield before
        raise
    if before is not None:
        yield before
