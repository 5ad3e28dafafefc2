# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Runs without ROS: a flight of the core, put into messages as nodes put it; free-running ones."""

from __future__ import annotations

import math
import random
import resource
import signal
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import numpy as np
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.serialization import (
    Encoding,
    NoEncryption,
    PrivateFormat,
    PublicFormat,
)
from log_parts import Parts
from mcap.records import Channel, Message

from rpo_core import files
from rpo_core.chain.chain import Chain
from rpo_core.chain.flight import Flight, fly
from rpo_core.control import controller
from rpo_core.control.controller import dumps, load_controller
from rpo_core.scenario import scenario
from rpo_core.scenario.scenario import Scenario
from rpo_core.stage import Place, Stage
from rpo_core.wire import cdr, interfaces
from rpo_log import signature
from rpo_log.format.run import RunSummary, TimeBase
from rpo_log.write.writer import RunLogWriter
from rpo_sim.plant import FreeRunningPlant

CLOCK, STATE = '/clock', '/relative_state'
FORCE, DISTURBANCE, STATUS = '/control_force', '/disturbance_force', '/run_status'
TOPICS = (CLOCK, STATE, FORCE, DISTURBANCE, STATUS)

Sent = tuple[str, int, bytes]
"""Topic, tick, CDR."""


def make_key(path: Path) -> Path:
    """Write a private key and beside it the public one, `*.pub.pem`, as OpenSSL does."""
    key = Ed25519PrivateKey.generate()
    pem, secret = Encoding.PEM, NoEncryption()
    path.write_bytes(key.private_bytes(pem, PrivateFormat.PKCS8, secret))
    target = path.with_name(f'{path.stem}.pub.pem')
    form = PublicFormat.SubjectPublicKeyInfo
    target.write_bytes(key.public_key().public_bytes(pem, form))
    return target


@dataclass(frozen=True)
class Run:
    """A flight and what its nodes say.

    topics : those that are logged; events : more messages, each with its tick
    """

    flight: Flight
    attachments: dict[str, bytes]
    topics: tuple[str, ...] = TOPICS
    events: tuple[Sent, ...] = ()

    @property
    def base(self) -> TimeBase:
        """The ticks of the run."""
        return TimeBase.of(self.flight.scenario)

    @cached_property
    def messages(self) -> list[Sent]:
        """Every message once, in the order of the log."""
        sent: list[Sent] = []
        for tick in range(self.base.last_tick + 1):
            sent += [(n, tick, d) for n, d in self.of_tick(tick) if n in self.topics]
        return sent

    def of_tick(self, tick: int) -> Iterable[tuple[str, bytes]]:
        """Say what the nodes say at a tick."""
        flight, stamp = self.flight, self.base.stamp_ns(tick)
        own = {STATE: flight.states, FORCE: flight.forces_n, DISTURBANCE: flight.disturbances_n}
        for row in interfaces.rows(logged=True):
            rider = flight.signals.get(row.rider)
            values = own.get(f'/{row.name}', flight.signals.get(row.name))
            if row.name == interfaces.CLOCK:
                yield CLOCK, cdr.encode_clock(stamp)
            elif values is not None:
                more = [] if rider is None else rider[tick].tolist()
                yield f'/{row.name}', row.layout.encode(stamp, [*values[tick].tolist(), *more])
        if STATUS in self.topics and tick in (0, self.base.last_tick):
            phase = 'running' if tick == 0 else 'finished'
            yield STATUS, cdr.encode_status(0, 'run', phase, 'none', self.figures(tick, phase))
        yield from ((name, data) for name, at, data in self.events if at == tick)

    def figures(self, tick: int, phase: str) -> dict[str, str]:
        """What run_status says at a tick."""
        state = self.flight.states[tick].tolist()
        commanded = self.flight.forces_n[:tick]
        applied = np.clip(commanded, -0.5, 0.5)
        squares = [0.0, 0.0, 0.0]
        for force_n in applied.tolist():  # in the order of the ticks, as the plant adds them up
            squares = [total + force * force for total, force in zip(squares, force_n, strict=True)]
        return {
            'phase': phase,
            'tick': str(tick),
            'time_s': repr(self.flight.scenario.time_s(tick)),
            'energy_n2s': repr(sum(squares) * self.flight.scenario.dt_s),
            'distance_m': repr(math.sqrt(sum(r * r for r in state[:3]))),
            'speed_m_s': repr(math.sqrt(sum(v * v for v in state[3:]))),
            'saturated_ticks': repr(int((applied != commanded).any(axis=1).sum())),
        }

    def fed(
        self, folder: Path, messages: Iterable[Sent] | None = None, **options: Any
    ) -> RunLogWriter:
        """Return the open writer of a log with the messages of the run, or others."""
        writer = RunLogWriter(folder, self.base, self.topics, self.attachments, **options)
        for name, tick, data in self.messages if messages is None else messages:
            writer.write(name, tick, data)
        return writer

    def write(
        self, folder: Path, messages: Iterable[Sent] | None = None, **options: Any
    ) -> RunSummary:
        """Write the log of the run, from its messages or others."""
        return self.fed(folder, messages, **options).close()

    def shuffled(self, seed: int, spread: float = 12.0) -> list[Sent]:
        """Every message, some twice, in an order in which several publishers may deliver them."""
        rng = random.Random(seed)
        queues = {name: [m for m in self.messages if m[0] == name] for name in self.topics}
        late = {name: rng.uniform(0.0, spread) for name in queues}
        timed = []
        for name, queue in queues.items():
            at = 0.0
            for message in queue:
                # a publisher's messages stay in order; topics drift against each other
                at = max(at, message[1] + rng.uniform(0.0, late[name]))
                if name == STATUS and message[1] == 0:
                    at = 0.0
                timed.append((at, message))
                if rng.random() < 0.1:
                    timed.append((at + rng.uniform(0.0, 2.0), message))
        return [message for _, message in sorted(timed, key=lambda pair: pair[0])]


def chain_run(
    flown: scenario.Scenario,
    control: controller.Controller,
    more: Iterable[tuple[Place, Stage]] = (),
    events: tuple[Sent, ...] = (),
) -> Run:
    """Fly a scenario with all its stages; there is no run_status.

    more : stages that no section names; events : what nodes say of the flight
    """
    flight = fly(flown, control, more)
    names = {STATE, FORCE, *(f'/{name}' for name in flight.signals), *(e[0] for e in events)}
    names |= set() if flown.disturbance.is_zero else {DISTURBANCE}
    topics = [f'/{row.name}' for row in interfaces.rows(logged=True) if f'/{row.name}' in names]
    attached = {
        'scenario.yaml': scenario.dumps(flown).encode(),
        'controller.yaml': controller.dumps(control).encode(),
    }
    return Run(flight, attached, (CLOCK, *topics), events)


def make_run(
    duration_s: float,
    name: str = 'paper_test',
    topics: tuple[str, ...] = TOPICS,
    control: str = 'handmade',
) -> Run:
    """Fly a shipped scenario for so long; what is asked for twice is flown once."""
    flight, attached = _flown(duration_s, name, control)
    own = {key: getattr(flight, key).copy() for key in ('states', 'forces_n', 'disturbances_n')}
    return Run(replace(flight, **own), dict(attached), topics)


@cache
def _flown(duration_s: float, name: str, control: str) -> tuple[Flight, dict[str, bytes]]:
    text = files.read_text(files.find('scenario', name))
    lines = [
        f'duration_s: {duration_s}' if line.startswith('duration_s:') else line
        for line in text.splitlines()
    ]
    text = '\n'.join(lines) + '\n'
    flown = files.loads(text, scenario.parse, name)
    content = files.read_text(files.find('controller', control))
    flight = fly(flown, files.loads(content, controller.parse, control))
    return flight, {
        'scenario.yaml': text.encode(),
        'controller.yaml': content.encode(),
        'parameters.yaml': b'plant: {scenario: paper_test}\n',
    }


Change = Callable[[str, int, bytes], bytes | None]
"""Topic, tick, data to new data; None to leave a message out."""


def changed(topic: str, tick: int, new: bytes | Callable[[bytes], bytes] | None) -> Change:
    """Return a change of one message: to other bytes, by what makes them of its own; or None."""

    def change(name: str, at: int, data: bytes) -> bytes | None:
        if (name, at) != (topic, tick):
            return data
        return new(data) if callable(new) else new

    return change


def turned(content: bytes, at: int) -> bytes:
    """Return bytes one bit of which is another one."""
    at %= len(content)
    return content[:at] + bytes([content[at] ^ 1]) + content[at + 1 :]


def flipped(topic: str, tick: int, place: int = 0) -> Change:
    """Return a change that flips one bit of a number of a message."""
    byte = interfaces.row_of(topic[1:]).layout.runs[place][0]
    return changed(topic, tick, lambda data: turned(data, byte))


def forge(log: Path, folder: Path, *changes: Change) -> Path:
    """Return a copy of a log with other messages in it, run.mcap of a folder."""
    folder.mkdir(exist_ok=True)
    target = folder / 'run.mcap'
    target.unlink(missing_ok=True)

    def change(name: str, tick: int, data: bytes | None) -> bytes | None:
        for each in changes:
            data = None if data is None else each(name, tick, data)
        return data

    rewrite(log, target, change)
    return target


def rewrite(source: Path, target: Path, change: Change) -> None:
    """Copy a log with other messages in it, all checksums right: a forgery, not damage."""
    parts = Parts.of(source)
    topics = {one.id: one.topic for one in parts.records if isinstance(one, Channel)}
    kept: list[Any] = []
    for record in parts.records:
        if isinstance(record, Message):
            data = change(topics[record.channel_id], record.sequence, record.data)
            if data is None:
                continue
            record = replace(record, data=data)
        kept.append(record)
    parts.records = kept
    parts.write(target)


@contextmanager
def file_size_limit(size: int) -> Iterator[None]:
    """Let no file grow beyond `size`: what a full disk does, for this process alone."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, handler)


PARAMETERS = b'plant: {scenario: paper_test}\n'


def record(
    folder: Path, duration_s: float = 3.0, control: str = 'handmade', **options: Any
) -> Path:
    """Write a run folder as the recorder leaves it."""
    run = make_run(duration_s, control=control)
    run = Run(run.flight, run.attachments | {'parameters.yaml': PARAMETERS}, TOPICS)
    run.write(folder, **options)
    (folder / 'flown.txt').write_text('of the day')
    (folder / 'run_info.yaml').write_text('run: {end: finished}\n')
    signature.write_sums(folder)
    return folder


STALE_AFTER = 4


class FreeRun:
    """A flight in free running, and what its nodes say.

    lost : ticks whose command does not reach the plant
    missed : ticks at which a stage of the software does nothing, by its name
    unlogged : topics and ticks of the messages that the recorder does not get
    """

    def __init__(
        self,
        flown: Scenario,
        control: str = 'handmade',
        lost: Collection[int] = (),
        missed: Mapping[str, Collection[int]] | None = None,
        unlogged: Collection[tuple[str, int]] = (),
    ) -> None:
        self.law, self.scenario = load_controller(control), flown
        software = Chain.of(flown, self.law).part(*(p for p in Place if p < Place.UNLOADING))
        command = interfaces.CONTROL_FORCE if flown.attitude is None else interfaces.BODY_FORCE
        calm = flown.disturbance.is_zero
        peers = [command] if calm else [command, interfaces.DISTURBANCE_FORCE]
        self.plant = plant = FreeRunningPlant(flown, peers, STALE_AFTER)
        self.messages: list[tuple[str, int, bytes]] = []
        self.applied: list[tuple[float, ...]] = []
        delayed = [name for name in software.inputs if interfaces.current(name) != name]
        before: tuple[float, ...] = (0.0, 0.0, 0.0)
        software.reset()
        for tick in range(flown.ticks + 1):
            signals = {n: plant.signals[n] for n in interfaces.NEXT if n in plant.signals}
            signals |= dict.fromkeys(delayed, before)
            for link in software.links:
                if tick not in (missed or {}).get(link.stage.name, ()):
                    made = link.stage.step(tick, *(signals[name] for name in link.reads))
                    signals |= dict(zip(link.stage.outputs, made, strict=True))
            answers = {n: interfaces.row_of(n).whole(signals) for n in peers if n in signals}
            if tick in lost:
                answers.pop(command, None)
            for name, values in answers.items():
                plant.answer(name, plant.stamp_ns, values)
            for name in peers:
                applied = interfaces.row_of(interfaces.applied(name))
                signals[applied.name] = plant.applied(name)[:3]
                if applied.rider:
                    signals[applied.rider] = plant.applied(name)[3:]
            self.applied.append(plant.applied(command)[:3])
            turns = flown.named('attitude_control') is not None
            before = signals[interfaces.current(delayed[0])] if turns else self.applied[-1]
            self._say(tick, signals, unlogged)

    def _say(self, tick: int, signals: dict, unlogged: Collection[tuple[str, int]]) -> None:
        """Take what is said at a tick, and fly on to the next."""
        plant, stamp_ns, last = self.plant, self.plant.stamp_ns, tick == self.scenario.ticks
        figures = {key: repr(value) for key, value in plant.figures().items()}
        if not last:
            plant.advance()
        made = plant.last_signals(plant.answers) if last else plant.signals
        signals = {name: made[name] for name in plant.chain.outputs} | signals
        self.messages.append((CLOCK, tick, cdr.encode_clock(stamp_ns)))
        for row in interfaces.rows(logged=True):
            if row.name in signals and (row.name, tick) not in unlogged:
                data = row.layout_in(self.scenario).encode(stamp_ns, row.whole(signals))
                self.messages.append((f'/{row.name}', tick, data))
        if tick == 0 or last:
            values = {**figures, 'phase': 'finished' if last else 'running'}
            self.messages.append((STATUS, tick, cdr.encode_status(0, 'run', '', 'none', values)))

    def write(self, folder: Path, change: Change = lambda name, tick, data: data) -> RunSummary:
        """Write the log; `change` forges it."""
        flown, names = self.scenario, {name for name, *_ in self.messages}
        parameters = f'plant: {{mode: free_running, stale_after_ticks: {STALE_AFTER}}}\n'
        attached = {
            'scenario.yaml': scenario.dumps(flown).encode(),
            'controller.yaml': dumps(self.law).encode(),
            'parameters.yaml': parameters.encode(),
        }
        writer = RunLogWriter(folder, TimeBase.of(flown), names, attached)
        for name, tick, data in self.messages:
            writer.write(name, tick, change(name, tick, data))
        return writer.close()
