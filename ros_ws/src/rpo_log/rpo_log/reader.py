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

from rpo_core import cdr, controller, files, scenario
from rpo_core.controller import AnyController
from rpo_core.flight import Flight
from rpo_core.scenario import Scenario
from rpo_core.validation import InputError
from rpo_log import topics
from rpo_log.completeness import Completeness
from rpo_log.decode import Odd
from rpo_log.errors import ExitCode, Kind, LogError
from rpo_log.run import CONTROLLER, SCENARIO, TimeBase
from rpo_log.stream import RunReader
from rpo_log.topics import Topic

_Parsed = TypeVar('_Parsed')


@dataclass(frozen=True)
class RunLog:
    """A whole log in memory; rows are ticks, NaN where a message lacks.

    path : folder or file that was read
    base : the ticks of the run
    topics : what was recorded
    attachments : file name to bytes
    ticks : (n,) int64
    states : (n, 6) x, y, z [m], vx, vy, vz [m/s], target LVLH
    forces_n : (n, 3) commanded force; disturbances_n : (n, 3), None if the topic was not recorded
    navigation : (n, 6) like states, what the controller saw; None if that was the truth
    applied_n, applied_disturbances_n : (n, 3) what was flown in free running; None in lockstep
    statuses : (tick, status)
    missing : per topic, number of ticks without a message, up to the last tick of the log
    odd : messages that hold more than a stamp and a state or force
    damage : where the file ends early; empty if it was closed in order
    gaps : why the log does not show a whole flight; empty if it does
    """

    path: Path
    base: TimeBase
    topics: tuple[Topic, ...]
    attachments: Mapping[str, bytes]
    ticks: NDArray[np.int64]
    states: NDArray[np.float64]
    forces_n: NDArray[np.float64]
    disturbances_n: NDArray[np.float64] | None
    navigation: NDArray[np.float64] | None
    applied_n: NDArray[np.float64] | None
    applied_disturbances_n: NDArray[np.float64] | None
    statuses: tuple[tuple[int, cdr.Status], ...]
    missing: Mapping[str, int]
    odd: tuple[Odd, ...]
    damage: str
    gaps: tuple[str, ...]

    @property
    def complete(self) -> bool:
        """Whether the log shows a whole flight: every message of every tick, closed in order."""
        return not self.gaps

    @property
    def dt_s(self) -> float:
        """Tick length."""
        return self.base.dt_ns / 1_000_000_000

    @property
    def times_s(self) -> NDArray[np.float64]:
        """Times (n,) since tick 0; one rounding each."""
        return self.ticks * self.base.dt_ns / 1_000_000_000

    @property
    def until_ns(self) -> int:
        """Stamp of the last tick."""
        return self.base.stamp_ns(int(self.ticks[-1]))

    @property
    def outcome(self) -> str | None:
        """What run_status said last: finished, aborted; running if it never said the end."""
        return dict(self.statuses[-1][1].values).get('phase') if self.statuses else None

    @property
    def exit_code(self) -> ExitCode:
        """OK, or INCOMPLETE."""
        return ExitCode.OK if self.complete else ExitCode.INCOMPLETE

    def sentence(self) -> str:
        """Return one line that says whether the log is whole, and what to do if it is not."""
        said = (
            f'{self.path}: ticks {int(self.ticks[0])} to {int(self.ticks[-1])} of '
            f'{self.base.last_tick}, {self.times_s[-1]:g} s'
        )
        return '; '.join([said, *self.gaps])


def read_run(path: str | Path) -> RunLog:
    """Return the log of a run folder, or of one .mcap file, in memory; raises LogError.

    A log that is cut short is read as far as it goes (`RunLog.damage`); `RunReader.blocks` reads
    long logs in bounded memory.
    """
    reader = RunReader(path)
    completeness, blocks = Completeness(reader), []
    for block in reader.blocks():
        completeness.add(block)
        blocks.append(block)
    ticks = np.concatenate([b.ticks for b in blocks])
    if not len(ticks):
        raise LogError(Kind.EMPTY, reader.path, 'holds no tick, only statuses')
    roles = [topic.role for topic in reader.topics]

    def recorded(role: str, name: str) -> NDArray[np.float64] | None:
        return np.concatenate([getattr(b, name) for b in blocks]) if role in roles else None

    return RunLog(
        path=reader.path,
        base=reader.base,
        topics=reader.topics,
        attachments=reader.attachments,
        ticks=ticks,
        states=np.concatenate([b.states for b in blocks]),
        forces_n=np.concatenate([b.forces_n for b in blocks]),
        disturbances_n=recorded(topics.DISTURBANCE, 'disturbances_n'),
        navigation=recorded(topics.NAVIGATION, 'navigation'),
        applied_n=recorded(topics.APPLIED, 'applied_n'),
        applied_disturbances_n=recorded(topics.APPLIED_DISTURBANCE, 'applied_disturbances_n'),
        statuses=tuple(status for b in blocks for status in b.statuses),
        missing=completeness.missing,
        odd=tuple(odd for b in blocks for odd in b.odd),
        damage=reader.damage,
        gaps=completeness.gaps(reader.damage),
    )


def scenario_of(log: RunLog | RunReader) -> Scenario:
    """Return the scenario that a log carries; LogError if it lacks, or is not that of the log."""
    flown = _parsed(log, SCENARIO, scenario.parse)
    if not isinstance(flown, Scenario):
        raise LogError(
            Kind.BAD_ATTACHMENT, log.path, f'its {SCENARIO} must be a single flight; it is a set'
        )
    base = TimeBase(flown.epoch_ns, flown.dt_ns, flown.ticks)
    if base != log.base:
        raise LogError(
            Kind.BAD_ATTACHMENT,
            log.path,
            f'its {SCENARIO} must have the ticks of the log, {log.base}; it has {base}',
        )
    return flown


def controller_of(log: RunLog | RunReader) -> AnyController:
    """Return the controller that a log carries; raises LogError."""
    return _parsed(log, CONTROLLER, controller.parse)


def _parsed(log: RunLog | RunReader, name: str, parse: Callable[[Any], _Parsed]) -> _Parsed:
    data = attachment(log.path, log.attachments, name)
    try:
        return files.loads(data.decode(), parse, name)
    except UnicodeDecodeError:
        raise LogError(Kind.BAD_ATTACHMENT, log.path, f'its {name} is not UTF-8 text') from None
    except InputError as error:
        raise LogError(Kind.BAD_ATTACHMENT, log.path, f'its {error}') from None


def attachment(path: Path, attachments: Mapping[str, bytes], name: str) -> bytes:
    """Return the bytes of an attached file; raises LogError."""
    if name not in attachments:
        raise LogError(
            Kind.MISSING_ATTACHMENT,
            path,
            f'must carry {name}; it carries {", ".join(attachments) or "no file"}',
        )
    return attachments[name]


def flight_of(log: RunLog) -> Flight:
    """Return the flight that a log shows.

    Raises LogError if the log is not whole: a flight has every state and force, from tick 0 to the
    last. Without a recorded disturbance it is zero. Of free running, its forces are those flown.
    """
    flown = scenario_of(log)
    if not log.complete:
        raise LogError(
            Kind.TRUNCATED,
            log.path,
            f'must hold a whole flight, ticks 0 to {flown.ticks}, but {"; ".join(log.gaps)}',
        )
    forces, disturbances = log.forces_n, log.disturbances_n
    if log.applied_n is not None:
        forces, disturbances = log.applied_n, log.applied_disturbances_n
    return Flight(
        flown,
        log.states,
        forces,
        np.zeros((len(log.ticks), 3)) if disturbances is None else disturbances,
    )


def read_flight(path: str | Path) -> Flight:
    """Return the flight of a run folder or .mcap file; raises LogError, as `flight_of`."""
    return flight_of(read_run(path))
