# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Stages of the chain, recomputed on their logged inputs block by block.

And what the log says of them: switched on and off, decisions, which controller made a command.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
from itertools import pairwise

import numpy as np

from rpo_core.chain.chain import Chain
from rpo_core.control.controller import AnyController
from rpo_core.files.validation import shown
from rpo_core.kernels.arrays import Bools, Floats, Ints
from rpo_core.scenario.scenario import Scenario
from rpo_core.stage import WITHOUT_COMMAND, Place, Stage
from rpo_core.wire import interfaces
from rpo_log import topics
from rpo_log.errors import LogError
from rpo_log.format.run import CONTROLLER, is_controller
from rpo_log.read.decode import Event, TickBlock
from rpo_log.read.run_log import controller_of
from rpo_log.read.stream import RunReader

MAX_NAMED = 3
"""So many spans of ticks, or names, of one kind are listed; of the others, the number."""

_SWITCHES = topics.ACTIVE, topics.INACTIVE


class StageStates:
    """Which stages were switched off, and what the plant went on without, as the events say.

    stages : names of those that an event may switch off: nobody switches a stage of the plant off,
        but single thrusters; None: all
    others : names of those that it may only tell of
    unfollowed : stage -> number, and first tick, of the events that have no effect here: no such
        stage, or it cannot be switched off, or no tick
    """

    def __init__(self, stages: Collection[str] | None = None, others: Collection[str] = ()) -> None:
        self._stages, self._others = stages, others
        self.unfollowed: dict[str, tuple[int, int]] = {}
        self.dropped: dict[str, int] = {}
        self._events: dict[str, list[tuple[int, str]]] = {}
        self._told: dict[str, int] = {}  # how many of them `commands` has returned

    def take(self, block_events: Sequence[Event]) -> None:
        """Take the events of a block."""
        for event in block_events:
            tick = topics.tick_of(event.status)
            if event.signal == interfaces.RUN_STATUS:
                for signal, since in topics.dropped(event.status).items():
                    self.dropped.setdefault(signal, since)  # as the nodes do
            elif event.signal == interfaces.STAGE_STATUS:
                name, state = event.values.get('stage', ''), event.values.get('state')
                may_tell = state not in (*_SWITCHES, WITHOUT_COMMAND) and name in self._others
                if tick is None or not (self._stages is None or name in self._stages or may_tell):
                    count, first = self.unfollowed.get(name, (0, event.tick))
                    self.unfollowed[name] = count + 1, first
                elif state is not None:
                    self._events.setdefault(name, []).append((tick, state))

    def of(self, stage: str) -> list[tuple[int, str]]:
        """Return all events of a stage so far: tick and state of each."""
        return self._events.get(stage, [])

    def commands(self, stage: str) -> list[tuple[int, str]]:
        """Return the commands that a stage got in flight, each with its tick; each one once."""
        events = self.of(stage)
        begin, self._told[stage] = self._told.get(stage, 0), len(events)
        return [(tick, state) for tick, state in events[begin:] if state not in _SWITCHES]

    def missing(self, stage: str) -> set[int]:
        """Return the ticks at which a stage went on without the command before."""
        return {tick for tick, state in self.of(stage) if state == WITHOUT_COMMAND}

    def _switched(self, stage: str) -> list[tuple[int, bool]]:
        """Return when a stage was switched, and whether on, in the order of ticks."""
        events = sorted(self.of(stage), key=lambda event: event[0])
        return [(tick, state == topics.ACTIVE) for tick, state in events if state in _SWITCHES]

    def active(self, stage: str, ticks: Ints) -> Bools:
        """Return at which ticks a stage was switched on."""
        switched = self._switched(stage)
        states = np.array([True, *(on for _, on in switched)])
        at = np.array([tick for tick, _ in switched], dtype=np.int64)
        return states[np.searchsorted(at, ticks, side='right')]

    def began(self, stage: str, ticks: Ints) -> Bools:
        """Return at which ticks a stage began without memory: switched on, or started in flight."""
        return np.isin(ticks, [tick for tick, on in self._switched(stage) if on])


class Recomputation:
    """The outputs of a stage, as far as they can be computed from its logged inputs.

    A stage with memory is computed over ticks that follow each other. From tick 0, or from where it
    was switched on, its outputs are known at once; after a gap, when its memory is full again.

    In free running a node may have missed a tick. A memory of all ticks is then kept as if it had,
    and trusted if the next outputs are those of the log; if not, the recorder missed them.

    gaps : ticks whose inputs are there, and the memory is not; or, in free running, whose outputs
        are there, and the inputs are not
    first_gap : the first of them
    compared : number of ticks at which it was on, and outputs in the log could be compared
    """

    def __init__(self, stage: Stage) -> None:
        self.stage = stage
        self.compared = 0
        self._off: list[tuple[int, int]] = []  # spans of ticks, first and last
        self._anew: list[tuple[int, int]] = []  # where it began anew and had not been off
        self.gaps, self.first_gap = 0, -1
        self._next = 0  # the tick that follows the last one
        self._filled: int | None = None  # ticks since the memory was lost; None: it was not
        self._doubtful = False  # whether it missed the tick before
        self._told: list[tuple[int, str]] = []
        self._decided: list[tuple[int, str]] = []  # before it began anew
        stage.reset()

    def take_events(self, events: Sequence[tuple[int, str]]) -> None:
        """Take commands that the stage got in flight, each with its tick."""
        self._told += events
        for tick, state in events:
            self.stage.take_event(tick, state)

    def decided(self) -> list[tuple[int, str]]:
        """Return what the stage decided so far: tick and state of each."""
        return [*self._decided, *self.stage.decided()]

    def by_events(self) -> list[str]:
        """Return what the log's events say of the stage and nothing computes, for people."""
        name = self.stage.name
        sentences = [f'{name} off at {_spans_text(self._off)}'] if self._off else []
        if self._anew and self.stage.memory_ticks != 0:
            sentences.append(f'{name} without memory from {_spans_text(self._anew)} on')
        ticks: dict[str, list[tuple[int, int]]] = {}
        for tick, state in self._told:
            if state not in self.stage.decides:
                ticks.setdefault(state, []).append((tick, tick))
        states = list(ticks)
        for state in states[:MAX_NAMED]:
            said = state if state.isprintable() and len(state) <= 40 else shown(state, 40)
            sentences.append(f'{name} {said} at {_spans_text(ticks[state])}')
        if len(states) > MAX_NAMED:
            sentences.append(f'{len(states) - MAX_NAMED} other events of {name}')
        return sentences

    def run(
        self,
        ticks: Ints,
        inputs: Sequence[Floats],
        active: Bools,
        began: Bools,
        logged: Sequence[Floats] = (),
    ) -> tuple[list[Floats], Bools]:
        """Return the outputs (n, width) at each tick, NaN where unknown, and where they are known.

        inputs : (n, width) each, NaN where unknown
        active : where the stage is switched on; where it is not, it passes on what it gets
        began : where it began without memory
        logged : (n, width) each, outputs in the log, NaN where missing: in free running
        """
        _extend(self._off, ticks[~active])
        after_off = np.array([0, *(last + 1 for _, last in self._off)])
        _extend(self._anew, ticks[began & active & ~np.isin(ticks, after_off)])
        there, absent = active.copy(), np.zeros(len(ticks), dtype=bool)
        for name, values in zip(self.stage.inputs, inputs, strict=True):
            finite = np.isfinite(values).all(axis=1)
            if name in self.stage.may_miss:
                absent |= ~finite
            else:
                there &= finite
        missed, due = np.zeros(len(ticks), dtype=bool), there
        if logged:  # an answer whose question is not in the log is due too
            due = np.any([np.isfinite(v).all(axis=1) for v in logged], axis=0)
            missed = active & ~due
        rows = map(interfaces.row_of, self.stage.outputs)
        made = [np.full((len(ticks), len(row.columns) or row.numbers), np.nan) for row in rows]
        known = np.zeros(len(ticks), dtype=bool)
        change = (np.diff(ticks) != 1) | np.diff(active) | np.diff(there) | began[1:]
        change |= np.diff(missed)
        for first, end in pairwise([0, *(np.flatnonzero(change) + 1), len(ticks)]):
            if ticks[first] != self._next:
                self._forget(0)
            if began[first]:
                self._forget(None, int(ticks[first]))
            self._next = int(ticks[end - 1]) + 1
            if missed[first]:
                if self.stage.memory_ticks is None:
                    self._doubtful = True
                else:
                    self._forget(0)
                continue
            part = slice(first, end)
            if not active[first]:
                self._pass_on(part, made, known, inputs)
            if not there[first]:  # switched on again it begins anew
                self._forget(0 if active[first] else None)
                continue
            if absent[part].any():
                self._go_without(part, made, known, ticks, inputs, absent)
            else:
                computed = self.stage.steps(ticks[part], *(values[part] for values in inputs))
                for values, numbers in zip(made, computed, strict=True):
                    values[part] = numbers
                known[part] = self._remembered(end - first)
            if self._doubtful and not _same(made, logged, first):
                self._forget(0)
                known[part] = False
            self._doubtful = False
        gaps = ticks[due & ~known]
        if len(gaps):
            self.first_gap = self.first_gap if self.gaps else int(gaps[0])
            self.gaps += len(gaps)
        for values in made:
            values[~known] = np.nan
        return made, known

    def _pass_on(
        self, part: slice, made: list[Floats], known: Bools, inputs: Sequence[Floats]
    ) -> None:
        """Fill the outputs of ticks at which the stage is switched off."""
        for row in range(part.start, part.stop):
            computed = self.stage.off(*(tuple(values[row].tolist()) for values in inputs))
            for values, numbers in zip(made, computed, strict=True):
                values[row] = numbers
            known[row] = np.isfinite(np.concatenate(computed)).all()

    def _go_without(
        self,
        part: slice,
        made: list[Floats],
        known: Bools,
        ticks: Ints,
        inputs: Sequence[Floats],
        absent: Bools,
    ) -> None:
        """Fill the outputs of ticks some of whose inputs are absent.

        The stage says whether it went on without them; if it did not, the log has lost them.
        """
        for row in range(part.start, part.stop):
            tick = int(ticks[row])
            if absent[row] and not self.stage.goes_without(tick):
                self._forget(0)
                continue
            read = (tuple(np.nan_to_num(v[row]).tolist()) for v in inputs)
            for values, numbers in zip(made, self.stage.step(tick, *read), strict=True):
                values[row] = numbers
            known[row] = self._remembered(1)[0]

    def _forget(self, filled: int | None, tick: int = 0) -> None:
        self._decided += self.stage.decided()
        self.stage.reset()
        for at, state in self._told:
            if at >= tick:
                self.stage.take_event(at, state)
        self._doubtful = False
        self._filled = filled

    def _remembered(self, count: int) -> Bools:
        """Return at which of the next ticks the memory is full."""
        if self._filled is None:
            return np.ones(count, dtype=bool)
        ages = self._filled + np.arange(count)
        self._filled += count
        memory_ticks = self.stage.memory_ticks
        return np.zeros(count, dtype=bool) if memory_ticks is None else ages >= memory_ticks


def _extend(spans: list[tuple[int, int]], ticks: Ints) -> None:
    """Add ticks, in order, to spans of ticks: first and last of each."""
    for tick in ticks.tolist():
        if spans and tick == spans[-1][1] + 1:
            spans[-1] = spans[-1][0], tick
        else:
            spans.append((tick, tick))


def _spans_text(spans: Sequence[tuple[int, int]]) -> str:
    words = [f'{a} to {b}' if a < b else f'{a}' for a, b in spans[:MAX_NAMED]]
    several = len(spans) > 1 or spans[0][0] < spans[0][1]
    rest = f' and {len(spans) - MAX_NAMED} more times' if len(spans) > MAX_NAMED else ''
    return f'tick{"s" * several} {", ".join(words)}{rest}'


def _same(made: Sequence[Floats], logged: Sequence[Floats], row: int) -> bool:
    """Return whether the outputs of a tick are those of the log, as far as it has them."""
    pairs = zip(made, logged, strict=True)
    return all(
        np.isnan(given[row]).any() or (mine[row] == given[row]).all() for mine, given in pairs
    )


def events_ahead(blocks: Iterable[TickBlock], states: StageStates) -> Iterator[TickBlock]:
    """Yield blocks, each when the events of the one after it are known: an event may come late."""
    before: list[TickBlock] = []
    try:
        for block in blocks:
            states.take(block.events)
            yield from before
            before = [block]
    except LogError:
        yield from before
        raise
    yield from before


class Controllers:
    """The controllers of a run, each recomputed; the first is that of controller.yaml.

    others : the later ones, as far as the log has shown them, and the signals that each reads
    """

    def __init__(self, reader: RunReader, scenario: Scenario, first: AnyController | None) -> None:
        self._reader, self._scenario = reader, scenario
        self._names = {CONTROLLER: first.name if first else ''}
        self._ticks = {CONTROLLER: 0}
        self._of_last = CONTROLLER
        self.others: list[tuple[Recomputation, Sequence[str]]] = []

    @property
    def shares(self) -> tuple[str, ...]:
        """Per controller its name, file and number of commands; empty if there is only one."""
        shares = [f'{name} ({file}) at {self._ticks[file]} ticks'
                  for file, name in self._names.items()]  # fmt: skip
        return tuple(shares) if self.others else ()

    def find(self) -> None:
        """Take the files that were attached since."""
        for file in sorted(self._reader.attachments, key=lambda name: (len(name), name)):
            if is_controller(file) and file not in self._names:
                controller = controller_of(self._reader, file)
                (link,) = Chain.of(self._scenario, controller).part(Place.CONTROLLER).links
                self._names[file], self._ticks[file] = controller.name, 0
                self.others.append((Recomputation(link.stage), link.reads))

    def merged(
        self, logged: Floats, answered: Bools, commands: Sequence[tuple[Floats, Bools]]
    ) -> tuple[Floats, Bools]:
        """Return the commands as computed by the controller that made them.

        answered : where one is in the log, and the controllers are switched on
        commands : those of each controller, and where they are known
        """
        equal = [
            known & (np.ascontiguousarray(made).view(np.uint64) == logged.view(np.uint64)).all(1)
            for made, known in commands
        ]
        for row in np.flatnonzero(answered).tolist():
            makers = [file for file, same in zip(self._names, equal, strict=True) if same[row]]
            if makers:
                self._of_last = self._of_last if self._of_last in makers else makers[0]
                self._ticks[self._of_last] += 1
        known = np.logical_or.reduce(equal)
        made, first_known = commands[0]
        return np.where(known[:, None], logged, made), known | first_known
