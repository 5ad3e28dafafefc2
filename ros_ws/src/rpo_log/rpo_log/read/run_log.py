# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The log of a run as arrays, as a flight, as the scenario and the controller that it carries."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from rpo_core import files
from rpo_core.chain.flight import Flight
from rpo_core.control import controller
from rpo_core.control.controller import AnyController
from rpo_core.files.validation import InputError
from rpo_core.scenario import scenario
from rpo_core.scenario.scenario import Scenario
from rpo_core.wire import cdr, interfaces
from rpo_log.errors import LogError
from rpo_log.format.run import CONTROLLER, PARAMETERS, SCENARIO, TimeBase
from rpo_log.read.decode import Event, Message
from rpo_log.read.stream import Completeness, RunReader
from rpo_log.topics import APPLIED, Topic, coasted, dropped

_Parsed = TypeVar('_Parsed')


@dataclass(frozen=True)
class RunLog:
    """A whole log in memory; rows are ticks, NaN where a message is missing.

    path : folder or file that was read
    base : the ticks of the run
    topics : what was recorded
    attachments : file name to bytes
    ticks : (n,) int64
    values : by signal, (n, width) its numbers
    events : messages of the event topics
    outcome : last phase in run_status: finished, aborted; running if the log ends before; None: it
        says none
    non_canonical : messages that hold more than a stamp and the numbers of their signal
    damage : where the file ends early; empty if it was closed in order
    gaps : why the log does not show a whole flight; empty if it does
    lacks : what a bag does not hold beside the flight, and a log does
    """

    path: Path
    base: TimeBase
    topics: tuple[Topic, ...]
    attachments: Mapping[str, bytes]
    ticks: NDArray[np.int64]
    values: Mapping[str, NDArray[np.float64]]
    events: tuple[Event, ...]
    outcome: str | None
    non_canonical: tuple[Message, ...]
    damage: str
    gaps: tuple[str, ...]
    lacks: tuple[str, ...] = ()

    @property
    def states(self) -> NDArray[np.float64]:
        """True states (n, 6) x, y, z [m], vx, vy, vz [m/s], target LVLH."""
        return self.values[interfaces.RELATIVE_STATE]

    @property
    def forces_n(self) -> NDArray[np.float64]:
        """Forces (n, 3) that the controller commanded."""
        return self.values[interfaces.CONTROL_FORCE]

    @property
    def disturbances_n(self) -> NDArray[np.float64] | None:
        """Disturbances (n, 3); None if the topic was not recorded."""
        return self.values.get(interfaces.DISTURBANCE_FORCE)

    @property
    def statuses(self) -> tuple[tuple[int, cdr.Status], ...]:
        """Each run_status with its tick."""
        return tuple((e.tick, e.status) for e in self.events if e.signal == interfaces.RUN_STATUS)

    @property
    def complete(self) -> bool:
        """Whether the log shows a whole flight: every message of every tick, closed in order."""
        return not self.gaps

    @property
    def times_s(self) -> NDArray[np.float64]:
        """Times (n,) since tick 0; one rounding each."""
        return self.ticks * self.base.dt_ns / 1_000_000_000


def read_run(path: str | Path | RunReader) -> RunLog:
    """Return the log of a run folder, of one .mcap file or of a reader, in memory; LogError.

    A log that is cut short is read as far as it goes (`RunLog.damage`); `RunReader.blocks` reads
    long logs in bounded memory.
    """
    reader = path if isinstance(path, RunReader) else RunReader(path)
    completeness, blocks = Completeness(reader), []
    for block in reader.blocks():
        completeness.add(block)
        blocks.append(block)
    ticks = np.concatenate([b.ticks for b in blocks])
    if not len(ticks):
        raise LogError(reader.path, 'holds no tick, only statuses')
    return RunLog(
        path=reader.path,
        base=reader.base,
        topics=reader.topics,
        attachments=reader.attachments,
        ticks=ticks,
        values={s: np.concatenate([b.values[s] for b in blocks]) for s in blocks[0].values},
        events=tuple(event for b in blocks for event in b.events),
        outcome=completeness.outcome,
        non_canonical=tuple(message for b in blocks for message in b.non_canonical),
        damage=reader.damage,
        gaps=completeness.gaps(reader.damage),
        lacks=reader.lacks,
    )


def scenario_of(log: RunLog | RunReader) -> Scenario:
    """Return the scenario that a log carries; LogError if it is missing, or of other ticks."""
    flown = _parsed(log, SCENARIO, scenario.parse)
    if not isinstance(flown, Scenario):
        raise LogError(log.path, f'its {SCENARIO} must be a single flight; it is a set')
    base = TimeBase.of(flown)
    if base != log.base:
        sentence = f'must have the ticks of the log, {log.base}; it has {base}'
        raise LogError(log.path, f'its {SCENARIO} {sentence}')
    return flown


def controller_of(log: RunLog | RunReader, name: str = CONTROLLER) -> AnyController:
    """Return the controller that a log carries, or a later one of its run; raises LogError."""
    return _parsed(log, name, controller.parse)


def parameters_of(log: RunLog | RunReader, name: str = PARAMETERS) -> Mapping[str, Any]:
    """Return the parameters of the nodes by their names, or topics; {} if the log has none."""
    try:
        values = files.parse_yaml(log.attachments.get(name, b'').decode())
    except (InputError, UnicodeDecodeError):
        return {}
    return values if isinstance(values, Mapping) else {}


def _parsed(log: RunLog | RunReader, name: str, parse: Callable[[Any], _Parsed]) -> _Parsed:
    if name not in log.attachments:
        sentence = f'must carry {name}; it carries {", ".join(log.attachments) or "no file"}'
        hint = '; `--scenario` names that of a bag' if name == SCENARIO else ''
        raise LogError(log.path, sentence + hint)
    try:
        return files.loads(log.attachments[name].decode(), parse, name)
    except UnicodeDecodeError:
        raise LogError(log.path, f'its {name} is not UTF-8 text') from None
    except InputError as error:
        raise LogError(log.path, f'its {error}') from None


def flight_of(log: RunLog) -> Flight:
    """Return the flight that a log shows.

    Raises LogError if the log is not whole: a flight has every state and force, from tick 0 to the
    last.
    """
    flown = scenario_of(log)
    if not log.complete:
        flight = f'a whole flight, ticks 0 to {flown.ticks}'
        raise LogError(log.path, f'must hold {flight}, but {"; ".join(log.gaps)}')
    return flown_of(log, flown)


def flown_of(log: RunLog, flown: Scenario) -> Flight:
    """Return the ticks of a log as a flight of a scenario, NaN where a message is missing.

    Without a recorded disturbance it is zero, as is what the plant flew on without. Of free
    running, its forces are those applied; of a chaser that turns, in the chaser's axes.
    """
    # If it was said twice, the first counts, as in the nodes.
    said = reversed(log.statuses)
    gone = {name: tick for _, status in said for name, tick in dropped(status).items()}
    values = coasted(log.values, log.ticks, gone)
    zero = np.zeros((len(log.ticks), 3))
    forces = values.get(interfaces.APPLIED_FORCE, values[interfaces.CONTROL_FORCE])
    pushes = values.get(interfaces.DISTURBANCE_FORCE, zero)
    if APPLIED & values.keys():
        pushes = values.get(interfaces.APPLIED_DISTURBANCE, zero)
        if interfaces.APPLIED_FORCE not in values:
            forces = np.nan_to_num(forces)  # an answer may be missing
    events: dict[str, list[tuple[int, str]]] = {}
    for event in log.events:
        if event.signal == interfaces.STAGE_STATUS:
            told = event.values
            events.setdefault(told.get('stage', ''), []).append((event.tick, told.get('state', '')))
    states = values[interfaces.RELATIVE_STATE]
    return Flight(flown, states, forces, pushes, other_signals(values), events)


_OF_FLIGHT = (
    interfaces.RELATIVE_STATE,
    interfaces.CONTROL_FORCE,
    interfaces.DISTURBANCE_FORCE,
    interfaces.APPLIED_FORCE,
    interfaces.APPLIED_DISTURBANCE,
)
_TAKEN = {
    interfaces.APPLIED_BODY_FORCE: interfaces.BODY_FORCE,
    interfaces.APPLIED_TORQUE: interfaces.BODY_TORQUE,
}
"""What free running says of a chaser that turns, and what it stands for."""


def other_signals(logged: Mapping[str, NDArray[np.float64]]) -> dict[str, NDArray[np.float64]]:
    """Return the logged signals beside state, force and disturbance.

    In free running the force applied is the last of the commands: those before it are left out.
    That of a chaser that turns has both names, by which one knows that it may have come late.
    """
    applied = APPLIED & logged.keys()
    signals = {
        name: values
        for name, values in logged.items()
        if name not in _OF_FLIGHT
        and not (applied and interfaces.row_of(name).carries == interfaces.COMMAND)
    }
    taken = {name: signals.pop(said, logged.get(said)) for said, name in _TAKEN.items()}
    taken[interfaces.APPLIED_BODY_FORCE] = taken[interfaces.BODY_FORCE]
    return signals | {name: values for name, values in taken.items() if values is not None}
