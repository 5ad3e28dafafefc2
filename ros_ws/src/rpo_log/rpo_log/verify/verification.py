# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The outcome of a verification: what is proven, what it rests on, what is not known."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from rpo_core.scenario.scenario import Scenario
from rpo_core.wire import cdr
from rpo_log import provenance
from rpo_log.errors import ExitCode
from rpo_log.format.run import SUMS_FILE
from rpo_log.read.decode import Message


@dataclass(repr=False)
class Verification:
    """The outcome of `verify`; `ok` if the whole flight is proven.

    Attributes
    ----------
    ticks : int
        Ticks in the log.
    difference : Difference | None
        The first thing in the flight that is not as computed; None if there is none.
    faults : tuple[str, ...]
        Files of the folder that are not those that were recorded.
    gaps : tuple[str, ...]
        Why not all is proven; empty if it is.
    free_running : bool
        The plant kept the wall clock: what it said that it applied was taken as it is.
    stages : tuple[str, ...]
        Names of the stages that were recomputed, at one tick at least, in the order of the
        chain.
    recomputed : tuple[str, ...]
        What else follows from the flight, and was compared.
    digested : tuple[str, ...]
        Files that do not follow from it, and have the digest that they had.
    unknown : tuple[str, ...]
        What nothing here proves.
    premises : Mapping[str, str]
        What the proof rests on, by name; SHA-256 each.
    signed_by : str | None
        File name of the trusted key that signed all that was read; None if none did, or
        none was asked for.
    signed : Mapping[str, str]
        Files that it signed, and that are as they were; SHA-256 each.
    controllers : tuple[str, ...]
        Per controller its commands, if there was more than one.
    given : tuple[str, ...]
        Signals that were taken as they are, not judged; each with the stage that makes it.
    by_events : tuple[str, ...]
        What the log's events say and nothing computes: which stages were off, and when.
    """

    path: Path
    ticks: int = 0
    difference: Difference | None = None
    gaps: tuple[str, ...] = ()
    free_running: bool = False
    stages: tuple[str, ...] = ()
    faults: tuple[str, ...] = ()
    recomputed: tuple[str, ...] = ()
    digested: tuple[str, ...] = ()
    unknown: tuple[str, ...] = ()
    premises: Mapping[str, str] = field(default_factory=dict)
    signed_by: str | None = None
    signed: Mapping[str, str] = field(default_factory=dict)
    controllers: tuple[str, ...] = ()
    given: tuple[str, ...] = ()
    by_events: tuple[str, ...] = ()

    def __repr__(self) -> str:
        return f'<Verification {self.sentence()}>'

    @property
    def ok(self) -> bool:
        """Whether every tick is as computed, and nothing was missing or given."""
        return self.exit_code == ExitCode.OK

    @property
    def exit_code(self) -> ExitCode:
        """OK, DIFFERENT, INCOMPLETE, or GIVEN where nothing but what was given is not proven."""
        if self.difference is not None or self.faults:
            return ExitCode.DIFFERENT
        if self.gaps:
            return ExitCode.INCOMPLETE
        return ExitCode.GIVEN if self.given else ExitCode.OK

    def sentence(self) -> str:
        """Return one line for people."""
        if self.difference is not None:
            differences = '; '.join((self.difference.sentence(), *self.gaps))
            return f'{self.path}: NOT as computed: {differences}'
        if self.faults:
            return f'{self.path}: NOT as recorded: {"; ".join((*self.faults, *self.gaps))}'
        stages = f'recomputed: {", ".join(self.stages) or "nothing"}'
        if self.controllers:
            stages += f'; {len(self.controllers)} controllers: {", ".join(self.controllers)}'
        if self.by_events:
            stages = f'by events of the log: {", ".join(self.by_events)}; {stages}'
        if self.given:
            stages = f'given, not judged: {", ".join(self.given)}; {stages}'
        if self.gaps:
            gaps = '; '.join(self.gaps)
            return f'{self.path}: as computed as far as it goes, but {gaps}; {stages}'
        verified = 'verified'
        if self.given:
            verified = 'as computed from what was given'
        elif self.free_running:
            verified = 'as computed from the forces that the plant says it applied'
        sentence = f'{self.path}: {verified}, {self.ticks} ticks bit for bit; {stages}'
        if self.free_running:
            sentence += '; a free-running flight: when forces came cannot be computed'
        return sentence

    def lines(self) -> Iterator[str]:
        """Yield the sentence with what is not judged, then the rest of the evidence, by line."""
        if self.exit_code == ExitCode.DIFFERENT:
            yield self.sentence()
            return
        by = f'signed by {self.signed_by}' if self.signed_by else 'not signed by a trusted key'
        signed = f'; {by}' if self.signed_by else ''
        unknown = f'. Not judged: {"; ".join(self.unknown)}' if self.unknown else ''
        yield self.sentence() + signed + unknown
        named = (
            ('recomputed', ', '.join((*self.stages, *self.recomputed))),
            (f'by digest ({SUMS_FILE}, {by})', ', '.join(self.digested)),
        )
        for name, text in named:
            if text:
                yield f'  {name}: {text}'
        if self.signed_by:
            yield f'  signed by {self.signed_by} (SHA-256):'
            yield from (f'    {digest}  {name}' for name, digest in self.signed.items())
        yield '  rests on (SHA-256):'
        yield from (f'    {digest}  {name}' for name, digest in self.premises.items())
        yield f'    {provenance.digest()}  verified with rpo_core {provenance.version()}'


START, REST = 'start', 'rest'
"""Checks beside the stages, as a difference names them."""


@dataclass(frozen=True)
class Difference:
    """The first thing in a log that is not as computed.

    check : name of the stage that computed it, or one of the checks beside the stages
    """

    tick: int
    topic: str
    field: str
    logged: float | str
    computed: float | str
    check: str

    def sentence(self) -> str:
        """Return one line for people."""
        return (
            f'tick {self.tick}, {self.topic}, {self.field}: logged {self.logged!r}, computed '
            f'{self.computed!r} ({self.check})'
        )


def non_canonical_difference(message: Message, flown: Scenario) -> Difference | None:
    """Name what it holds beside stamp and numbers in the axes of its scenario; None: nothing."""
    topic, tick, data = message
    values = topic.row.layout.decode(data)[1]
    expected = topic.row.layout_in(flown).encode(flown.stamp_ns(tick), values)
    if expected == data:
        return None
    texts, floats = cdr.FIELDS[topic.type]
    messages = (cdr.decode_stamped(topic.type, each) for each in (data, expected))
    numbers = ((*message_fields.texts, *message_fields.floats) for message_fields in messages)
    for name, logged, computed in zip((*texts, *floats), *numbers, strict=True):
        if repr(logged) != repr(computed):  # -0.0 is not 0.0
            return Difference(tick, topic.name, name, logged, computed, REST)
    where = 'bytes between its fields'
    return Difference(tick, topic.name, where, data.hex(), expected.hex(), REST)
