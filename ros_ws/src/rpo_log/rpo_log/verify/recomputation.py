# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Stages of the chain, recomputed on their logged inputs block by block.

And what the log says of them: switched on and off, decisions, which controller made a command,
which commands free running may have applied.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from rpo_core.chain.chain import Chain
from rpo_core.chain.stage import WITHOUT_COMMAND, Place, Stage
from rpo_core.control.controller import AnyController
from rpo_core.files.scenario import Scenario
from rpo_core.files.validation import shown
from rpo_core.wire import interfaces
from rpo_log.verify.verification import Difference
from rpo_mcap import topics
from rpo_mcap.errors import LogError
from rpo_mcap.format.run import CONTROLLER, is_controller
from rpo_mcap.read.decode import Event, TickBlock
from rpo_mcap.read.run_log import controller_of, parameters_of
from rpo_mcap.read.stream import RunReader

Floats = NDArray[np.float64]

MAX_NAMED = 3
"""So many spans of ticks, or names, of one kind are listed; of the others, the number."""


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
        self._changes: dict[str, list[tuple[int, bool]]] = {}
        self._missing: dict[str, set[int]] = {}
        self._commands: dict[str, list[tuple[int, str]]] = {}
        self.dropped: dict[str, int] = {}

    def take(self, block_events: Sequence[Event]) -> None:
        """Take the events of a block."""
        for event in block_events:
            tick = topics.tick_of(event.status)
            if event.signal == interfaces.RUN_STATUS:
                for signal, since in topics.dropped(event.status).items():
                    self.dropped.setdefault(signal, since)  # as the nodes do
            elif event.signal == interfaces.STAGE_STATUS:
                state = event.values.get('state')
                name = event.values.get('stage', '')
                switched = state in (WITHOUT_COMMAND, topics.ACTIVE, topics.INACTIVE)
                if tick is None or not self._follows(name, switched):
                    count, first = self.unfollowed.get(name, (0, event.tick))
                    self.unfollowed[name] = count + 1, first
                    continue
                if state == WITHOUT_COMMAND:
                    self._missing.setdefault(name, set()).add(tick)
                if state in (topics.ACTIVE, topics.INACTIVE):
                    changes = self._changes.setdefault(name, [])
                    changes.append((tick, state == topics.ACTIVE))
                    changes.sort(key=lambda change: change[0])
                elif state is not None:
                    self._commands.setdefault(name, []).append((tick, state))

    def _follows(self, name: str, switched: bool) -> bool:
        """Return whether an event has an effect on a stage."""
        may_tell = not switched and name in self._others
        return self._stages is None or name in self._stages or may_tell

    def commands(self, stage: str) -> list[tuple[int, str]]:
        """Return the commands that a stage got in flight, each with its tick; each one once."""
        return self._commands.pop(stage, [])

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
        found = [f'{name} off at {_spans_text(self._off)}'] if self._off else []
        if self._anew and self.stage.memory_ticks != 0:
            found.append(f'{name} without memory from {_spans_text(self._anew)} on')
        ticks: dict[str, list[tuple[int, int]]] = {}
        for tick, state in self._told:
            if state not in self.stage.decides:
                ticks.setdefault(state, []).append((tick, tick))
        states = list(ticks)
        for state in states[:MAX_NAMED]:
            said = state if state.isprintable() and len(state) <= 40 else shown(state, 40)
            found.append(f'{name} {said} at {_spans_text(ticks[state])}')
        if len(states) > MAX_NAMED:
            found.append(f'{len(states) - MAX_NAMED} other events of {name}')
        return found

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
        if self.stage.memory_ticks == 0:
            rows = np.flatnonzero(there)
            made, known = self._made(rows, ticks, inputs), there.copy()
            self._pass_on(np.flatnonzero(~active), made, known, inputs)
            if logged:  # an answer whose question is not in the log
                answered = np.any([np.isfinite(v).all(axis=1) for v in logged], axis=0)
                self._count(ticks[answered & ~known])
            return made, known
        return self._with_memory(ticks, inputs, active, (there, absent), began, logged)

    def _pass_on(
        self,
        rows: NDArray[np.intp],
        made: list[Floats],
        known: NDArray[np.bool_],
        inputs: Sequence[Floats],
    ) -> None:
        """Fill the outputs of ticks at which the stage is switched off."""
        for row in rows.tolist():
            found = self.stage.off(*(tuple(values[row].tolist()) for values in inputs))
            for values, numbers in zip(made, found, strict=True):
                values[row] = numbers
            known[row] = np.isfinite(np.concatenate(found)).all()

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
                self._forget(None, first)
            self._next = last + 1
            if missed[part[0]] and self.stage.memory_ticks is None:
                self._doubtful = True
                continue
            if missed[part[0]]:
                self._forget(0)
                continue
            if not active[part[0]]:
                self._pass_on(part, made, known, inputs)
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
            self._count(ticks[part[~known[part]]])
        for values in made:
            values[~known] = np.nan
        return made, known

    def _count(self, unknown: NDArray[np.int64]) -> None:
        """Count ticks at which it could not be computed."""
        if len(unknown):
            self.first_gap = self.first_gap if self.gaps else int(unknown[0])
            self.gaps += len(unknown)

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

    def _forget(self, filled: int | None, tick: int = 0) -> None:
        self._decided += self.stage.decided()
        self.stage.reset()
        for at, state in self._told:
            if at >= tick:
                self.stage.take_event(at, state)
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


def _extend(spans: list[tuple[int, int]], ticks: NDArray[np.int64]) -> None:
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


class PreviousSignals:
    """Remembers the last tick of each block."""

    def __init__(self) -> None:
        self._last: dict[str, tuple[int, Floats]] = {}

    def of(
        self, name: str, ticks: NDArray[np.int64], values: Floats, missing: Collection[int]
    ) -> Floats:
        """Return the values (n, width) of a signal one tick before each of these ticks.

        missing : ticks at which the reader went on without it: zero

        Zero at tick 0; NaN where the tick before is not in the log.
        """
        found = np.full_like(values, np.nan)
        follows = np.diff(ticks) == 1
        found[1:][follows] = values[:-1][follows]
        tick, last = self._last.get(name, (-1, np.zeros(values.shape[1])))
        if ticks[0] == tick + 1:
            found[0] = last
        found[np.isin(ticks, list(missing))] = 0.0
        self._last[name] = int(ticks[-1]), values[-1].copy()
        return found


MOST_HELD_TICKS = 1000
"""A force held longer than that is not looked for."""


def held_ticks(reader: RunReader) -> int:
    """Return for how many ticks the plant of a log held a force; -1 if that is not known."""
    plant = parameters_of(reader).get('plant')
    ticks = plant.get('stale_after_ticks') if isinstance(plant, Mapping) else None
    return ticks if type(ticks) is int and 0 <= ticks <= MOST_HELD_TICKS else -1


class HeldForces:
    """The answers of the last ticks, of which free running applies one.

    ticks : for how many a force is held; -1: not known, and nothing is
    limits : of each number: that of the thrusters [N], of a torque infinite
    """

    def __init__(self, ticks: int, limits: Sequence[float]) -> None:
        self._most, self._limits = ticks, np.array(limits)
        self._ticks = np.empty(0, dtype=np.int64)
        self._forces = np.empty((0, len(limits)))

    def held(
        self,
        ticks: NDArray[np.int64],
        answers_n: NDArray[np.float64],
        applied_n: NDArray[np.float64],
    ) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Return the force (n, width) [N] applied, as it was commanded, and where that is known.

        answers_n : (n, width) of these ticks, NaN where they are missing
        """
        new = ticks > self._ticks[-1] if len(self._ticks) else np.ones(len(ticks), dtype=bool)
        known = np.concatenate([self._ticks, ticks[new]])
        commanded = np.clip(answers_n[new], -self._limits, self._limits)
        commanded = np.concatenate([self._forces, commanded])
        computed, found = np.zeros_like(applied_n), (applied_n == 0.0).all(axis=1)
        sure = np.full(len(ticks), self._most >= 0)
        for age in range(self._most, -1, -1):
            wanted = ticks - age
            at = np.searchsorted(known, wanted)
            there = (known[at] == wanted) & np.isfinite(commanded[at]).all(axis=1)
            sure &= there | (wanted < 0)
            computed[there] = np.where(found[there, None], computed[there], commanded[at][there])
            found |= there & (commanded[at] == applied_n).all(axis=1)
        computed[found] = applied_n[found]
        kept = known >= ticks[-1] - max(self._most, 0)
        self._ticks, self._forces = known[kept], commanded[kept]
        return computed, sure | found


LATE_TICKS = 50


class StatedDecisions:
    """Keeps the decisions that a log tells of, and compares them when all is recomputed."""

    def __init__(self, stages: Sequence[Recomputation], topic: str) -> None:
        self._stages = {found.stage.name: found for found in stages if found.stage.decides}
        self._topic = topic
        self._logged: dict[str, list[tuple[int, str]]] = {name: [] for name in self._stages}

    def take(self, event: Event) -> None:
        """Take an event; those that are no decision of a stage here are no matter."""
        name, state = event.values.get('stage', ''), event.values.get('state', '')
        tick = topics.tick_of(event.status)
        if event.signal != interfaces.STAGE_STATUS or name not in self._stages or tick is None:
            return
        if state in self._stages[name].stage.decides:
            self._logged[name].append((tick, state))

    def difference(self) -> Difference | None:
        """Return the first decision in the log that the stage does not make."""
        for name, found in self._stages.items():
            extra = Counter(self._logged[name]) - Counter(found.decided())
            if extra and not found.gaps:
                tick, state = min(extra)
                return Difference(tick, self._topic, 'state', state, 'nothing', name)
        return None

    def gaps(self, last: int) -> list[str]:
        """Return the decisions that the log does not tell of, for people.

        last : newest tick of the log; what is said right before it may come after it
        """
        found = []
        for name, stage in self._stages.items():
            missing = Counter(stage.decided()) - Counter(self._logged[name])
            tick, state = min(missing, default=(last, ''))
            if tick < last - LATE_TICKS and not stage.gaps:
                found.append(f'{self._topic} does not say that {name} is {state} from tick {tick}')
        return found


Made = tuple[list[Floats], NDArray[np.bool_]]
"""Outputs of a stage at some ticks, and where they are known."""


class Controllers:
    """The controllers of a run, each recomputed; the first is that of controller.yaml.

    first : None if the log carries none: no command is then recomputed
    """

    def __init__(
        self,
        reader: RunReader,
        scenario: Scenario,
        first: AnyController | None,
    ) -> None:
        self._reader, self._scenario = reader, scenario
        self._files = [CONTROLLER]
        self._names = [first.name if first else '']
        self._ticks = [0]
        self._more: list[tuple[Recomputation, Sequence[str]]] = []
        self._owner = 0

    @property
    def shares(self) -> tuple[str, ...]:
        """Per controller its name, file and number of commands; empty if there is only one."""
        if not self._more:
            return ()
        return tuple(
            f'{name} ({file}) at {ticks} ticks'
            for name, file, ticks in zip(self._names, self._files, self._ticks, strict=True)
        )

    def _find(self) -> None:
        """Take the files that were attached since."""
        for file in sorted(self._reader.attachments, key=lambda name: (len(name), name)):
            if is_controller(file) and file not in self._files:
                found = controller_of(self._reader, file)
                (link,) = Chain.of(self._scenario, found).part(Place.CONTROLLER).links
                self._files.append(file)
                self._names.append(found.name)
                self._ticks.append(0)
                self._more.append((Recomputation(link.stage), link.reads))

    def any_of(
        self,
        block: TickBlock,
        output: str,
        first: Made,
        run: Callable[[Recomputation, Sequence[str]], Made],
        active: NDArray[np.bool_],
    ) -> Made:
        """Return the commands as computed by the controller that made them.

        output : name of the command
        first : as the first controller computes them
        run : recomputes another one, with the signals that it reads
        active : where the controllers are switched on
        """
        self._find()
        if not self._more:
            return first
        logged = block.values[output]
        equal = [_equal(logged, first)]
        equal += [_equal(logged, run(stage, reads)) for stage, reads in self._more]
        for row in np.flatnonzero(active & block.present[output]).tolist():
            owners = [number for number, found in enumerate(equal) if found[row]]
            if owners:
                self._owner = self._owner if self._owner in owners else owners[0]
                self._ticks[self._owner] += 1
        known = np.logical_or.reduce(equal)
        (made,), first_known = first
        return [np.where(known[:, None], logged, made)], known | first_known


def _equal(logged: Floats, computed: Made) -> NDArray[np.bool_]:
    """Return where a command has the bits that are computed."""
    (made,), known = computed
    bits = [np.ascontiguousarray(values).view(np.uint64) for values in (logged, made)]
    same: NDArray[np.bool_] = known & (bits[0] == bits[1]).all(axis=1)
    return same
