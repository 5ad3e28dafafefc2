# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Proof that a flight happened as logged: each stage recomputed and compared, bit for bit.

From the scenario and the controller that the log carries:

- start: the first state is the scenario's;
- each stage of the chain: its logged outputs follow from its logged inputs; the next state follows
  from the dynamics. So the whole flight follows, tick by tick from its start;
- free running, where the wall clock had its part: each force applied is one that was commanded not
  long before;
- events: where a stage was switched off its commands are zero; what the plant went on without is
  zero from then on;
- the rest: attitude, torque, covariances, frames, phases and figures of run_status, all records of
  the file, metadata.yaml; by digest the files that do not follow from the flight.

The first difference ends it. Logs of any length are verified in bounded memory.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rpo_core.chain.chain import NO_FORCE, Chain, Link, start_of
from rpo_core.chain.stage import Place
from rpo_core.files.validation import InputError, choice, shown
from rpo_core.wire import interfaces
from rpo_core.wire.interfaces import NEXT, RELATIVE_STATE, Interface, current, row_of
from rpo_log.bag import open_run
from rpo_log.manifests import HEARS, PUBLISHES
from rpo_log.signature import Digests
from rpo_log.verify.evidence import Evidence
from rpo_log.verify.recomputation import (
    MAX_NAMED,
    MOST_HELD_TICKS,
    Controllers,
    Floats,
    HeldForces,
    PreviousSignals,
    Recomputation,
    StageStates,
    StatedDecisions,
    events_ahead,
    held_ticks,
)
from rpo_log.verify.run_status import Statuses
from rpo_log.verify.verification import (
    APPLIED,
    REST,
    START,
    Difference,
    Verification,
    non_canonical_difference,
)
from rpo_mcap import topics
from rpo_mcap.errors import LogError
from rpo_mcap.format import run
from rpo_mcap.format.run import CONTROLLER
from rpo_mcap.read.decode import TickBlock
from rpo_mcap.read.run_log import controller_of, parameters_of, scenario_of
from rpo_mcap.read.stream import Completeness, RunReader
from rpo_mcap.topics import Topic

_SECTIONS = {
    'disturbance': 'a disturbance', 'navigation': 'errors of navigation',
    'sensors': 'sensors', 'estimator': 'an estimator',
}  # fmt: skip


FIGURES = 'figures of run_status'


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
        self._take_given(reader)
        self.free = topics.free_running(reader.topics)
        self._applied = {self._taken(x, name) for x in self.chain.links for name in x.reads} - {''}
        self._require_topics(reader)
        self.stages = [Recomputation(link.stage) for link in self.chain.links]
        nodes = [x.stage.name for x in self.chain.links if x.place < Place.UNLOADING]
        self.states = StageStates(nodes, [x.stage.name for x in self.chain.links])
        ticks = held_ticks(reader) if self.free else 0
        self._hold_known = ticks >= 0
        self._unchecked, self._first_unchecked = 0, -1  # applied forces without a known command
        most_n = float(self.scenario.max_force_n)
        self._held = {
            interfaces.APPLIED_FORCE: HeldForces(ticks, [most_n] * 3),
            interfaces.APPLIED_BODY_FORCE: HeldForces(ticks, [most_n] * 3 + [math.inf] * 3),
            interfaces.APPLIED_DISTURBANCE: HeldForces(ticks, [math.inf] * 3),
        }
        self._previous = PreviousSignals()
        rows = (topic.row for topic in reader.topics if topic.row.also)
        own = [row.name for row in rows if row.layout_in(self.scenario) is row.layout.also]
        self._own_axes, self._old_frames = own, set[str]()
        self._following: dict[str, tuple[int, Floats] | None] = {}  # computed for the next tick
        status = self.topics.get(interfaces.RUN_STATUS)
        foreign = RELATIVE_STATE in self._given
        awaited = self.chain.after(Place.STEERING).inputs
        self.statuses = Statuses(self.scenario, status, self.free, awaited, foreign)
        said = self.topics.get(interfaces.STAGE_STATUS)
        self.stated = StatedDecisions(
            [found for found in self.stages if found.stage.name in self.names],
            said.name if said else interfaces.STAGE_STATUS,
        )
        self.controllers = Controllers(reader, self.scenario, controller)
        self._controller_known = known or interfaces.CONTROL_FORCE in given

    def _take_given(self, reader: RunReader) -> None:
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
                row = interfaces.row_of(name)
                if row.type and row.logged and name not in self.topics:
                    what = _SECTIONS.get(link.stage.name, f'the stage {link.stage.name}')
                    sentence = f'has no topic {name}, but its scenario has {what}'
                    raise LogError(reader.path, sentence)
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
        found = [f'{name}, which no stage of its scenario makes' for name in names]
        return [*found, *(f'the axes of {name}: its frame is that of older versions'
                          for name in sorted(self._old_frames))]  # fmt: skip

    @staticmethod
    def _is_at_rest(row: Interface) -> bool:
        """Return whether a signal has numbers of rest where no stage makes it."""
        return row.carries == interfaces.DISTURBANCE or bool(row.rides)

    @property
    def recomputed(self) -> tuple[str, ...]:
        """Names of the stages that were on, and were compared, at one tick at least."""
        compared = {found.stage.name for found in self.stages if found.compared}
        return tuple(name for name in self.names if name in compared)

    @property
    def by_events(self) -> tuple[str, ...]:
        """What the events of the log say of stages and peers, and nothing computes, for people."""
        found = [text for stage in self.stages for text in stage.by_events()]
        dropped = self.states.dropped.items()
        return (*found, *(f'flown without {name} from tick {tick} on' for name, tick in dropped))

    @property
    def unfollowed(self) -> list[str]:
        """The events that have no effect on what is recomputed, for people."""
        found = self.states.unfollowed.items()
        texts = [
            f'events of {shown(name)} ({count}, the first at tick {tick}), which switch no stage '
            'that is recomputed'
            for name, (count, tick) in list(found)[:MAX_NAMED]
        ]
        others = len(found) - MAX_NAMED
        return [*texts, *[f'events of {others} other such stages'] * (others > 0)]

    @property
    def gaps(self) -> list[str]:
        """What could not be checked, for people."""
        found = [
            f'{found.stage.name} could not be recomputed at {found.gaps} ticks, the first is '
            f'{found.first_gap}: what it read or remembered was lost with a missing message'
            for found in self.stages
            if found.gaps and found.stage.name in self.names
        ]
        if self._unchecked:
            why = 'the log lacks commands of the ticks before it'
            if not self._hold_known:
                why = f'{run.PARAMETERS} does not say for how long, up to {MOST_HELD_TICKS} ticks, '
                why += 'the plant held a force'
            found.append(
                f'{self._unchecked} applied forces could not be compared with a command, the first '
                f'at tick {self._first_unchecked}: {why}'
            )
        return found

    @property
    def unknown_controller(self) -> list[str]:
        """Say that the commands do not follow from anything that the log carries."""
        if self._controller_known:
            return []
        return [
            f'{interfaces.CONTROL_FORCE} could not be recomputed: the log carries no {CONTROLLER}, '
            'and all else follows from the commands as logged'
        ]

    def first_difference(self, block: TickBlock) -> Difference | None:
        """Return the first difference in a block, None if there is none."""
        found: list[Difference | None] = [
            non_canonical_difference(message, self.scenario)
            for message in block.non_canonical
            if message.topic.signal not in self._given
        ]
        if len(block.ticks):
            found += self._compare(block)
        found += [self._not_finite(name, block) for name in self._given & block.values.keys()]
        self._note_frames(block)
        found += [self.statuses.difference(event) for event in block.events]
        for event in block.events:
            self.stated.take(event)
        order = {row.name: index for index, row in enumerate(interfaces.rows())}
        return min(
            (d for d in found if d is not None),
            default=None,
            key=lambda d: (d.tick, order[_signal_of(d, self.topics.values())]),
        )

    def _not_finite(self, signal: str, block: TickBlock) -> Difference | None:
        """Return the first number of a given signal that no node takes: nothing follows from it."""
        values = block.values[signal]
        wrong = ~np.isfinite(values) & block.present[signal][:, None]
        if not wrong.any():
            return None
        row, column = divmod(int(wrong.argmax()), wrong.shape[1])
        topic = self.topics[signal]
        name, logged = topic.row.columns[column], float(values[row, column])
        return Difference(
            int(block.ticks[row]), topic.name, name, logged, 'a finite number', 'given'
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
            reads = [signals[name] for name in self._reads(link)]
            stage.take_events(self.states.commands(link.stage.name))
            active = self.states.active(link.stage.name, block.ticks)
            began = self.states.began(link.stage.name, block.ticks)
            made, known = stage.run(block.ticks, reads, active, began, self._answers(link, block))
            if link.place is Place.CONTROLLER:
                made, known = self.controllers.any_of(
                    block, link.stage.outputs[0], (made, known),
                    lambda other, names: other.run(
                        block.ticks, [signals[name] for name in names],
                        active, began),  # noqa: B023
                    active)  # fmt: skip
            logged = [block.present[x] for x in link.stage.outputs if x in self.topics]
            there = np.logical_or.reduce(logged) if logged else True
            stage.compared += int((active & known & there).sum())
            for name, values in zip(link.stage.outputs, made, strict=True):
                if name in NEXT:
                    yield self._next_states(link.stage.name, name, block, values, known)
                elif name in self.topics:
                    yield self._first(link.stage.name, name, block, values, known)
                else:
                    signals[name] = values
        yield from self._unmade(block)
        if self.free:
            yield from self._compare_applied(block)
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
                missing = self.states.missing(link.stage.name)
                signals[name] = self._previous.of(source, block.ticks, signals[source], missing)

    def _reads(self, link: Link) -> Iterator[str]:
        """Yield the signals that a stage reads; in free running the plant says what it took."""
        yield from (self._taken(link, name) or name for name in link.reads)

    def _taken(self, link: Link, name: str) -> str:
        """Return what says what the plant took of a signal that its stage reads; '' if nothing."""
        if not self.free or link.place < Place.UNLOADING or name == NO_FORCE:
            return ''
        plants = (x.stage.outputs for x in self.chain.links if x.place >= Place.UNLOADING)
        return '' if any(name in made for made in plants) else interfaces.applied(name)

    def _next_states(
        self, stage: str, name: str, block: TickBlock, following: Floats, known: NDArray[np.bool_]
    ) -> Difference | None:
        """Compare each state, or attitude, with the one that follows from the tick before it."""
        computed = np.full_like(following, np.nan)
        where = np.zeros(len(block.ticks), dtype=bool)
        follows = known[:-1] & (np.diff(block.ticks) == 1)
        computed[1:][follows], where[1:] = following[:-1][follows], follows
        before = self._following.get(name)
        if before is not None and before[0] == block.ticks[0]:
            computed[0], where[0] = before[1], True
        last = int(block.ticks[-1]) + 1
        self._following[name] = (last, following[-1]) if known[-1] else None
        return self._first(stage, name, block, computed, where)

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

    def _compare_applied(self, block: TickBlock) -> Iterator[Difference | None]:
        """Compare the forces applied with those commanded not long before, where they are known.

        With the torque in their messages. Zero is always one: the plant cuts off what is too old.
        """
        pairs = {name: self._taken(link, name) for link in self.chain.links for name in link.reads}
        for name, taken in pairs.items():
            if not taken or name not in block.values or row_of(name).rides:
                continue
            said, names = ([n, row_of(n).rider][: 1 + bool(row_of(n).rider)] for n in (name, taken))
            answers, applied = (np.hstack([block.values[n] for n in ns]) for ns in (said, names))
            computed, known = self._held[taken].held(block.ticks, answers, applied)
            if taken not in self._given:
                there = np.isfinite(applied).all(axis=1)
                self._count_unchecked(block.ticks[~known & there])
            for one, values in zip(names, np.hsplit(computed, len(names)), strict=True):
                yield self._first(APPLIED, one, block, values, known)

    def _count_unchecked(self, ticks: NDArray[np.int64]) -> None:
        if len(ticks) and not self._unchecked:
            self._first_unchecked = int(ticks[0])
        self._unchecked += len(ticks)

    def _first(
        self,
        check: str,
        signal: str,
        block: TickBlock,
        computed: Floats,
        known: NDArray[np.bool_],
    ) -> Difference | None:
        """Return the first logged message of a signal whose bits differ from what is computed."""
        logged = np.ascontiguousarray(block.values[signal])
        computed = np.ascontiguousarray(computed)
        unequal = logged.view(np.uint64) != computed.view(np.uint64)
        unequal &= (known & block.present[signal])[:, None]
        if signal in self._given or not unequal.any():
            return None
        row, column = divmod(int(unequal.argmax()), unequal.shape[1])
        topic = self.topics[signal]
        return Difference(
            int(block.ticks[row]),
            topic.name,
            topic.row.columns[column],
            float(logged[row, column]),
            float(computed[row, column]),
            check,
        )


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
        found, remaps = _verification(reader, trusted, given), _remaps(reader)
        said: list[str] = []
        while (difference := found.difference) is not None:
            signal = _signal_of(difference, reader.topics)
            node = next((n for n, (_, made) in remaps.items() if signal in made), None)
            if node is None:
                return found
            sentence, made = remaps.pop(node)
            said.append(sentence)
            given = {*given, *made}
            found = _verification(open_run(path, scenario, controller), trusted, given)
        return replace(found, gaps=(*said, *found.gaps))
    except LogError as error:
        faults = _faults_of(Path(path))
        if not faults:
            raise
        gap = f'{error.path.name} {error.sentence}'
        return Verification(Path(path), 0, None, (gap,), faults=faults)


def _signal_of(difference: Difference, recorded: Iterable[Topic]) -> str:
    named = {topic.name: topic.signal for topic in recorded if not topic.row.rides}
    found = named.get(difference.topic, difference.topic.rsplit('/', 1)[-1])
    return found


def _remaps(reader: RunReader) -> dict[str, tuple[str, list[str]]]:
    """Return the nodes that hear a signal elsewhere than the log: in words, and what they make."""
    found, where = {}, {topic.signal: topic.name for topic in reader.topics}
    for node, values in parameters_of(reader, run.TOPICS).items():
        said = values if isinstance(values, Mapping) else {}
        heard = {k[len(HEARS) :]: t for k, t in said.items() if str(k).startswith(HEARS)}
        away = [f'{s} on {t}' for s, t in heard.items() if where.get(s, t) != t]
        made = [s for s in where if said.get(PUBLISHES + s) and row_of(s).columns]
        if away:
            found[node] = f'{node} heard {", ".join(away)}, and not what the log has', made
    return found


def _faults_of(folder: Path) -> tuple[str, ...]:
    """Return what of a run folder is not as SHA256SUMS lists it, as far as that can be known."""
    try:
        return Digests.of(folder).faults if folder.is_dir() else ()
    except LogError:
        return ()


def _verification(reader: RunReader, trusted: Path | None, given: Collection[str]) -> Verification:
    verifier, evidence = _Verifier(reader, given), Evidence(reader)
    completeness = Completeness(reader)
    for block in events_ahead(reader.blocks(), verifier.states):
        completeness.add(block)
        difference = verifier.first_difference(block)
        if difference is not None:
            break
    else:
        difference = verifier.stated.difference()
    ticks = completeness.last + 1
    if difference is not None:
        return Verification(
            reader.path, ticks, difference, (), verifier.free, verifier.recomputed,
            given=verifier.given,
        )  # fmt: skip
    gaps = [*completeness.gaps(reader.damage), *reader.lacks, *verifier.gaps]
    gaps += verifier.stated.gaps(completeness.last)
    gaps += verifier.statuses.gaps if not gaps else []
    gaps += verifier.unknown_controller
    foreign = FIGURES in verifier.given
    unjudged = [*verifier.unfollowed, *verifier.unjudged]
    evidence.of_log(verifier.statuses, verifier.free, unjudged, foreign)
    evidence.of_folder(trusted)
    return Verification(
        reader.path,
        ticks,
        None,
        (*gaps, *evidence.gaps),
        verifier.free,
        verifier.recomputed,
        evidence.faults,
        tuple(evidence.recomputed),
        evidence.digested,
        tuple(evidence.unknown),
        evidence.premises,
        evidence.signed_by,
        evidence.signed,
        verifier.controllers.shares,
        verifier.given,
        verifier.by_events,
    )
