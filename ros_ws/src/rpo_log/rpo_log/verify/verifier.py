# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Proof that a flight happened as logged: each stage recomputed and compared, bit for bit.

From the scenario and the controller that the log carries:

- start: the first state is the scenario's;
- each stage of the chain: its logged outputs follow from its logged inputs; the next state follows
  from the dynamics. So the whole flight follows, tick by tick from its start;
- free running: what the plant says that it applied is given, all else follows from it;
- events: where a stage was switched off its commands are zero; what the plant went on without is
  zero from then on;
- the rest: attitude, torque, covariances, frames, phases and figures of run_status, all records of
  the file, metadata.yaml; by digest the files that do not follow from the flight.

The first difference ends it. Logs of any length are verified in bounded memory.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping
from pathlib import Path

import numpy as np

from rpo_core.chain.chain import NO_FORCE, Chain, Link, start_of
from rpo_core.files.validation import InputError, choice, shown
from rpo_core.kernels.arrays import Bools, Floats, Ints
from rpo_core.stage import Place
from rpo_core.wire import interfaces
from rpo_core.wire.interfaces import NEXT, RELATIVE_STATE, Interface, current, row_of
from rpo_log import topics
from rpo_log.bag import open_run
from rpo_log.errors import LogError
from rpo_log.format import run
from rpo_log.format.run import CONTROLLER
from rpo_log.manifests import HEARS, PUBLISHES
from rpo_log.read.decode import TickBlock
from rpo_log.read.run_log import controller_of, parameters_of, scenario_of
from rpo_log.read.stream import Completeness, RunReader
from rpo_log.signature import Digests
from rpo_log.topics import Topic
from rpo_log.verify.evidence import Evidence
from rpo_log.verify.recomputation import (
    MAX_NAMED,
    Controllers,
    Recomputation,
    StageStates,
    events_ahead,
)
from rpo_log.verify.run_status import Statuses
from rpo_log.verify.verification import (
    REST,
    START,
    Difference,
    Verification,
    non_canonical_difference,
)

FIGURES = 'figures of run_status'
LATE_TICKS = 50


class _Verifier:
    """Computes the blocks of a log anew; keeps what one hands to the next.

    given : signals that are taken as they are
    """

    def __init__(self, reader: RunReader, given: Collection[str]) -> None:
        self.scenario = scenario_of(reader)
        self._given = frozenset(given)
        known = CONTROLLER in reader.attachments and interfaces.CONTROL_FORCE not in given
        controller = controller_of(reader) if known else None
        try:
            self.chain = Chain.of(self.scenario, controller)
        except InputError as error:
            if isinstance(error, LogError):
                raise
            raise LogError(reader.path, f'its {CONTROLLER}: {error}') from None
        self.topics = {topic.signal: topic for topic in reader.topics}
        for topic in reader.topics:
            if topic.row.rider:
                self.topics[topic.row.rider] = Topic(topic.name, row_of(topic.row.rider))
        self._take_given()
        self.free = topics.free_running(reader.topics)
        self._reads = {link.stage.name: self._read_by(link) for link in self.chain.links}
        self._applied = {name for link in self.chain.links
                         for name in {*self._reads[link.stage.name]} - {*link.reads}}  # fmt: skip
        self._require_topics(reader)
        self.stages = [Recomputation(link.stage) for link in self.chain.links]
        nodes = [x.stage.name for x in self.chain.links if x.place < Place.UNLOADING]
        self.states = StageStates(nodes, [x.stage.name for x in self.chain.links])
        self._last: dict[str, tuple[int, Floats]] = {}  # of signals, before the next block
        rows = (topic.row for topic in reader.topics if topic.row.also)
        own = [row.name for row in rows if row.layout_in(self.scenario) is row.layout.also]
        self._own_axes, self._old_frames = own, set[str]()
        status = self.topics.get(interfaces.RUN_STATUS)
        self.foreign = RELATIVE_STATE in self._given
        awaited = self.chain.after(Place.STEERING).inputs
        self.statuses = Statuses(self.scenario, status, self.free, awaited, self.foreign)
        self.controllers = Controllers(reader, self.scenario, controller)
        self.controller_known = known or interfaces.CONTROL_FORCE in given

    def _take_given(self) -> None:
        """Check what is given, and find which stages are judged all the same.

        A stage is judged if something that is compared follows from its outputs. Raises InputError.
        """
        logged = [name for name, topic in self.topics.items() if topic.row.columns]
        for name in self._given:
            choice('--given', name, logged)
        riders = (interfaces.row_of(name).rider for name in self._given)
        self._given |= {name for name in riders if name}
        self.names: tuple[str, ...] = ()
        needed = self.topics.keys() - self._given
        for link in reversed(self.chain.links):
            if needed & set(link.stage.outputs):
                self.names = (link.stage.name, *self.names)
                needed |= {name for name in link.reads if name not in self.topics}

    @property
    def given(self) -> tuple[str, ...]:
        """Signals that are given, each with the stage that makes it, in the order of the table."""
        makers = {name: x.stage.name for x in self.chain.links for name in x.stage.outputs}
        makers.setdefault(interfaces.CONTROL_FORCE, 'controller')
        rows = (row for row in interfaces.table().values() if row.rides not in self._given)
        made = {row.name: row.rider for row in rows if row.name in self._given}
        named = []
        for name, rider in made.items():
            stages = dict.fromkeys(makers[n] for n in (name, rider) if n in makers)
            named.append(f'{name} ({", ".join(stages)})' if stages else name)
        return (*named, *[FIGURES] * (RELATIVE_STATE in made))

    def _require_topics(self, reader: RunReader) -> None:
        for link in self.chain.links:
            for name in link.stage.outputs:
                row = row_of(name)
                if row.type and row.logged and name not in self.topics:
                    sentence = f'has no topic {name}, but its scenario has the stage '
                    raise LogError(reader.path, sentence + link.stage.name)
        for name in sorted(self._applied - self.topics.keys()):
            sentence = f'has no topic {name}, but is a log of free running'
            raise LogError(reader.path, sentence)

    @property
    def unjudged(self) -> list[str]:
        """What of the messages is not compared, for people."""
        judged = {*self.chain.outputs, *self._applied, *self._given, interfaces.CONTROL_FORCE}
        names = (
            name
            for name, topic in self.topics.items()
            if topic.row.columns and not (name in judged or self._is_at_rest(topic.row))
        )
        texts = [f'{name}, which no stage of its scenario makes' for name in names]
        return [*texts, *(f'the axes of {name}: its frame is that of older versions'
                          for name in sorted(self._old_frames))]  # fmt: skip

    @staticmethod
    def _is_at_rest(row: Interface) -> bool:
        """Return whether a signal has numbers of rest where no stage makes it."""
        return row.carries == interfaces.DISTURBANCE or bool(row.rides)

    @property
    def recomputed(self) -> tuple[str, ...]:
        """Names of the stages that were on, and were compared, at one tick at least."""
        compared = {stage.stage.name for stage in self.stages if stage.compared}
        return tuple(name for name in self.names if name in compared)

    @property
    def by_events(self) -> tuple[str, ...]:
        """What the events of the log say of stages and peers, and nothing computes, for people."""
        texts = [text for stage in self.stages for text in stage.by_events()]
        dropped = self.states.dropped.items()
        return (*texts, *(f'flown without {name} from tick {tick} on' for name, tick in dropped))

    @property
    def unfollowed(self) -> list[str]:
        """The events that have no effect on what is recomputed, for people."""
        events = self.states.unfollowed.items()
        texts = [
            f'events of {shown(name)} ({count}, the first at tick {tick}), which switch no stage '
            'that is recomputed'
            for name, (count, tick) in list(events)[:MAX_NAMED]
        ]
        others = len(events) - MAX_NAMED
        return [*texts, *[f'events of {others} other such stages'] * (others > 0)]

    @property
    def gaps(self) -> list[str]:
        """What could not be checked, for people."""
        return [
            f'{stage.stage.name} could not be recomputed at {stage.gaps} ticks, the first is '
            f'{stage.first_gap}: what it read or remembered was lost with a missing message'
            for stage in self.stages
            if stage.gaps and stage.stage.name in self.names
        ]

    def compare_decisions(self, last: int) -> tuple[Difference | None, list[str]]:
        """Return the first decision in the log that its stage does not make, and those not told.

        last : newest tick of the log; what is said right before it may come after it
        """
        topic, gaps = self.topics.get(interfaces.STAGE_STATUS), []
        topic_name = topic.name if topic else interfaces.STAGE_STATUS
        for stage in self.stages:
            name, decides = stage.stage.name, stage.stage.decides
            if not decides or stage.gaps or name not in self.names:
                continue
            logged = Counter(event for event in self.states.of(name) if event[1] in decides)
            decided = Counter(stage.decided())
            if extra := logged - decided:
                tick, state = min(extra)
                return Difference(tick, topic_name, 'state', state, 'nothing', name), []
            tick, state = min(decided - logged, default=(last, ''))
            if tick < last - LATE_TICKS:
                gaps.append(f'{topic_name} does not say that {name} is {state} from tick {tick}')
        return None, gaps

    def first_difference(self, block: TickBlock) -> Difference | None:
        """Return the first difference in a block, None if there is none."""
        found: list[Difference | None] = [
            non_canonical_difference(message, self.scenario)
            for message in block.non_canonical
            if message.topic.signal not in self._given
        ]
        if len(block.ticks):
            found += self._compare(block)
        for name in self._given & block.values.keys():  # from such a number nothing follows
            wrong = ~np.isfinite(block.values[name])
            found.append(self._named('given', name, block, wrong, 'a finite number'))
        self._note_frames(block)
        found += [self.statuses.difference(event) for event in block.events]
        order = {row.name: index for index, row in enumerate(interfaces.rows())}
        return min(
            (d for d in found if d is not None),
            default=None,
            key=lambda d: (d.tick, order[_signal_of(d, self.topics.values())]),
        )

    def _note_frames(self, block: TickBlock) -> None:
        """Note the signals with axes of their own whose messages have the frame of all others."""
        for name in self._own_axes:
            theirs = sum(message.topic.signal == name for message in block.non_canonical)
            if theirs < block.present[name].sum():
                self._old_frames.add(name)

    def _compare(self, block: TickBlock) -> Iterator[Difference | None]:
        """Recompute each stage of the ticks of a block and compare its outputs."""
        signals = topics.coasted(block.values, block.ticks, self.states.dropped)
        signals[NO_FORCE] = np.zeros((len(block.ticks), 3))
        self._look_back(block, signals)
        if block.ticks[0] == 0:
            known = np.arange(len(block.ticks)) == 0
            for name, start in start_of(self.scenario).items():
                yield self._first(START, name, block, np.tile(start, (len(known), 1)), known)
        for link, stage in zip(self.chain.links, self.stages, strict=True):
            name, outputs = link.stage.name, link.stage.outputs
            reads = [signals[signal] for signal in self._reads[name]]
            stage.take_events(self.states.commands(name))
            active = self.states.active(name, block.ticks)
            began = self.states.began(name, block.ticks)
            made, known = stage.run(block.ticks, reads, active, began, self._answers(link, block))
            logged = [block.present[output] for output in outputs if output in self.topics]
            there = active & (np.logical_or.reduce(logged) if logged else True)
            if link.place is Place.CONTROLLER:
                self.controllers.find()
                commands = [(made[0], known)]
                for other, others in self.controllers.others:
                    reads = [signals[signal] for signal in others]
                    (command,), sure = other.run(block.ticks, reads, active, began)
                    commands.append((command, sure))
                if self.controllers.others:
                    made[0], known = self.controllers.merged(
                        block.values[outputs[0]], there, commands
                    )
            stage.compared += int((there & known).sum())
            for output, values in zip(outputs, made, strict=True):
                if output in NEXT:
                    yield self._next_states(name, output, block, values, known)
                elif output in self.topics:
                    yield self._first(name, output, block, values, known)
                else:
                    signals[output] = values
        yield from self._unmade(block)
        taken, due = signals[interfaces.SATURATED_FORCE], signals[interfaces.DUE_FORCE]
        self.statuses.account(block, taken, due)

    def _answers(self, link: Link, block: TickBlock) -> list[Floats]:
        """Return the outputs in the log of a stage that may have missed ticks in free running."""
        outputs = link.stage.outputs
        may_miss = self.free and link.place < Place.UNLOADING
        if not may_miss or not all(name in self.topics for name in outputs):
            return []
        return [
            np.where(block.present[name][:, None], block.values[name], math.nan) for name in outputs
        ]

    def _look_back(self, block: TickBlock, signals: dict[str, Floats]) -> None:
        """Add what stages read of the tick before; in free running, as the plant took it."""
        for link in self.chain.links:
            for name in link.reads:
                if current(name) == name:
                    continue
                source = current(name)
                if self.free and self.scenario.named('attitude_control') is None:
                    source = interfaces.applied(source) or source
                before = self._before(source, block.ticks, signals[source])
                before[np.isin(block.ticks, list(self.states.missing(link.stage.name)))] = 0.0
                signals[name] = before

    def _before(self, name: str, ticks: Ints, values: Floats) -> Floats:
        """Return the values (n, width) of a signal one tick before each of these ticks.

        Zero at tick 0; NaN where the tick before is not in the log.
        """
        before = np.full_like(values, np.nan)
        follows = np.diff(ticks) == 1
        before[1:][follows] = values[:-1][follows]
        tick, last = self._last.get(name, (-1, np.zeros(values.shape[1])))
        if ticks[0] == tick + 1:
            before[0] = last
        self._last[name] = int(ticks[-1]), values[-1].copy()
        return before

    def _read_by(self, link: Link) -> tuple[str, ...]:
        """Return the signals that a stage reads; in free running the plant says what it took."""
        if not self.free or link.place < Place.UNLOADING:
            return tuple(link.reads)
        stages = (x.stage for x in self.chain.links if x.place >= Place.UNLOADING)
        made = {NO_FORCE, *(name for stage in stages for name in stage.outputs)}
        return tuple(
            name if name in made else interfaces.applied(name) or name for name in link.reads
        )

    def _next_states(
        self, stage: str, name: str, block: TickBlock, following: Floats, known: Bools
    ) -> Difference | None:
        """Compare each state, or attitude, with the one that follows from the tick before it."""
        rows = np.column_stack([following, known])  # at tick 0 nothing is known
        before = self._before(f'next {name}', block.ticks, rows)
        return self._first(stage, name, block, before[:, :-1], before[:, -1] == 1.0)

    def _unmade(self, block: TickBlock) -> Iterator[Difference | None]:
        """Compare disturbances, and what rides in messages, that no stage makes with rest."""
        made = {*self.chain.outputs, *self._applied, interfaces.APPLIED_TORQUE}
        for name, values in block.values.items():
            row = interfaces.row_of(name)
            if name not in made and self._is_at_rest(row):
                known = np.ones(len(values), dtype=bool)
                check = REST if row.rides else 'disturbance'
                rest = np.tile(row.rest, (len(values), 1))
                yield self._first(check, name, block, rest, known)

    def _first(
        self, check: str, signal: str, block: TickBlock, computed: Floats, known: Bools
    ) -> Difference | None:
        """Return the first logged message of a signal whose bits differ from what is computed."""
        if signal in self._given:
            return None
        pair = (np.ascontiguousarray(values) for values in (block.values[signal], computed))
        logged_bits, computed_bits = (values.view(np.uint64) for values in pair)
        wrong = (logged_bits != computed_bits) & known[:, None]
        return self._named(check, signal, block, wrong, computed)

    def _named(
        self, check: str, signal: str, block: TickBlock, wrong: Bools, computed: Floats | str
    ) -> Difference | None:
        """Return the first of the wrong numbers (n, width) of a signal that are in the log."""
        wrong = wrong & block.present[signal][:, None]
        if not wrong.any():
            return None
        place = divmod(int(wrong.argmax()), wrong.shape[1])
        tick, topic = int(block.ticks[place[0]]), self.topics[signal]
        logged = float(block.values[signal][place])
        wanted = computed if isinstance(computed, str) else float(computed[place])
        return Difference(tick, topic.name, topic.row.columns[place[1]], logged, wanted, check)


def verify(
    path: str | Path,
    trusted: Path | None = None,
    given: Collection[str] = (),
    scenario: str = '',
    controller: str = '',
) -> Verification:
    """Compute the flight of a run folder, .mcap file or bag anew and compare.

    trusted : public key, or folder of them; one of them must have signed the run folder
    given : signals of the log that somebody else's node made: they are taken as they are
    scenario, controller : names or files, of a bag that does not carry them

    Raises LogError if it is not the log of a run, InputError if `trusted` holds no keys, or what is
    given is no signal of the log. A log that cannot be read and is not the one that SHA256SUMS
    lists is a difference, no LogError.
    """
    try:
        reader = open_run(path, scenario, controller)
        outcome, remaps = _verification(reader, trusted, given), _remaps(reader)
        said: list[str] = []
        while (difference := outcome.difference) is not None:
            signal = _signal_of(difference, reader.topics)
            node = next((n for n, (_, made) in remaps.items() if signal in made), None)
            if node is None:
                return outcome
            sentence, made = remaps.pop(node)
            said.append(sentence)
            given = {*given, *made}
            outcome = _verification(open_run(path, scenario, controller), trusted, given)
        outcome.gaps = (*said, *outcome.gaps)
        return outcome
    except LogError as error:
        faults = _faults_of(Path(path))
        if not faults:
            raise
        gap = f'{error.path.name} {error.sentence}'
        return Verification(Path(path), gaps=(gap,), faults=faults)


def _signal_of(difference: Difference, recorded: Iterable[Topic]) -> str:
    named = {topic.name: topic.signal for topic in recorded if not topic.row.rides}
    return named.get(difference.topic, difference.topic.rsplit('/', 1)[-1])


def _remaps(reader: RunReader) -> dict[str, tuple[str, list[str]]]:
    """Return the nodes that hear a signal elsewhere than the log: in words, and what they make."""
    remaps, where = {}, {topic.signal: topic.name for topic in reader.topics}
    for node, values in parameters_of(reader, run.TOPICS).items():
        said = values if isinstance(values, Mapping) else {}
        heard = {k[len(HEARS) :]: t for k, t in said.items() if str(k).startswith(HEARS)}
        away = [f'{s} on {t}' for s, t in heard.items() if where.get(s, t) != t]
        made = [s for s in where if said.get(PUBLISHES + s) and row_of(s).columns]
        if away:
            remaps[node] = f'{node} heard {", ".join(away)}, and not what the log has', made
    return remaps


def _faults_of(folder: Path) -> tuple[str, ...]:
    """Return what of a run folder is not as SHA256SUMS lists it, as far as that can be known."""
    try:
        return Digests.of(folder).faults if folder.is_dir() else ()
    except LogError:
        return ()


def _verification(reader: RunReader, trusted: Path | None, given: Collection[str]) -> Verification:
    verifier, outcome = _Verifier(reader, given), Verification(reader.path)
    evidence, completeness = Evidence(reader, outcome), Completeness(reader)
    outcome.free_running, outcome.given = verifier.free, verifier.given
    for block in events_ahead(reader.blocks(), verifier.states):
        completeness.add(block)
        outcome.difference = verifier.first_difference(block)
        if outcome.difference is not None:
            break
    last, untold = completeness.last, list[str]()
    if outcome.difference is None:
        outcome.difference, untold = verifier.compare_decisions(last)
    outcome.ticks, outcome.stages = last + 1, verifier.recomputed
    if outcome.difference is not None:
        outcome.gaps = reader.lacks
        return outcome
    gaps = [*completeness.gaps(reader.damage), *reader.lacks, *verifier.gaps, *untold]
    gaps += verifier.statuses.gaps if not gaps else []
    if not verifier.controller_known:
        gaps.append(
            f'{interfaces.CONTROL_FORCE} could not be recomputed: the log carries no {CONTROLLER}, '
            'and all else follows from the commands as logged'
        )
    outcome.gaps = tuple(gaps)
    outcome.controllers, outcome.by_events = verifier.controllers.shares, verifier.by_events
    evidence.of_log(verifier.statuses, [*verifier.unfollowed, *verifier.unjudged], verifier.foreign)
    evidence.of_folder(trusted)
    return outcome
