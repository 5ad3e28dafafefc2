# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A run as its log sees it: the ticks, the files of its folder, what was logged and what not."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from rpo_core.scenario.scenario import Scenario
from rpo_log.errors import ExistsAlready, NotARun, cannot_write

LOG_FORMAT = 1
"""Version of the layout of a run's log: its records, its attachments, its order."""

RUN_RECORD = 'rpo_run'
"""Name of the MCAP metadata record that holds the time base."""

SCENARIO = 'scenario.yaml'
CONTROLLER = 'controller.yaml'
PARAMETERS = 'parameters.yaml'
TOPICS = 'topics.yaml'
"""Names of the attachments; the parameters are those of every node, resolved; the topics those of
nodes that hear a signal where it is not recorded."""

DIFFERING = 'differing.yaml'
"""Name of the attachment of a log some of whose messages differed from the first of their tick."""

MOST_CONTROLLERS = 16
"""Controller files of one run that are attached."""

_NUMBERED = re.compile(r'controller(-[1-9][0-9]?)?\.yaml')


def controller_name(number: int) -> str:
    """Return the name of the n-th controller file of a run: controller.yaml, controller-2.yaml."""
    return CONTROLLER if number == 1 else f'controller-{number}.yaml'


def is_controller(name: str) -> bool:
    """Return whether an attachment is a controller file of the run."""
    return _NUMBERED.fullmatch(name) is not None


METADATA_FILE = 'metadata.yaml'
INFO_FILE = 'run_info.yaml'
SUMS_FILE = 'SHA256SUMS'
SIGNATURE_FILE = 'SHA256SUMS.sig'

REPORT = 'report'
"""Folder of pictures and a page, which are drawn after the recording, again and again."""

_OF_0_1 = 'decisions.mcap', 'health.mcap'
"""What a recorder of version 0.1 wrote too: it goes with the log that it is of."""
_BESIDE = (METADATA_FILE, *_OF_0_1, INFO_FILE, SUMS_FILE, SIGNATURE_FILE)

MAX_CHUNK_TICKS = 512

_WHOLE = 'run.mcap'
_PART = re.compile(r'run_(0|[1-9][0-9]{0,8})\.mcap')

_NS = 1_000_000_000


@dataclass(frozen=True)
class TimeBase:
    """The ticks of a run: tick k has the stamp epoch_ns + k dt_ns, k = 0..last_tick."""

    epoch_ns: int
    dt_ns: int
    last_tick: int

    @classmethod
    def of(cls, flown: Scenario) -> TimeBase:
        """Return the ticks of a scenario."""
        return cls(flown.epoch_ns, flown.dt_ns, flown.ticks)

    def stamp_ns(self, tick: int) -> int:
        """Return the stamp of a tick."""
        return self.epoch_ns + tick * self.dt_ns

    def tick_of(self, stamp_ns: int) -> int | None:
        """Return the tick of a stamp; None if the run has no such tick."""
        tick, rest = divmod(stamp_ns - self.epoch_ns, self.dt_ns)
        return tick if rest == 0 and 0 <= tick <= self.last_tick else None

    @property
    def chunk_ticks(self) -> int:
        """Most ticks in one chunk: one second of simulated time, and a bound on its size."""
        return max(1, min(MAX_CHUNK_TICKS, _NS // self.dt_ns))

    def to_record(self) -> dict[str, str]:
        """Return the values of the MCAP metadata record."""
        return {name: str(value) for name, value in vars(self).items()}

    @classmethod
    def from_record(cls, values: Mapping[str, str], path: Path) -> TimeBase:
        """Return the time base of an MCAP metadata record; raises LogError."""
        try:
            base = cls(*(int(values[name]) for name in ('epoch_ns', 'dt_ns', 'last_tick')))
        except (KeyError, ValueError):
            base = cls(0, 0, 0)
        if base.dt_ns <= 0 or base.last_tick < 0 or base.epoch_ns < 0:
            what = 'epoch_ns, dt_ns > 0 and last_tick as whole numbers'
            raise NotARun(path, f'its record {RUN_RECORD} must hold {what}; got {dict(values)}')
        return base


@dataclass(frozen=True)
class RunSummary:
    """What a log holds, and what it does not.

    messages : per topic, those that have reached the file
    missing : per topic, (ticks without a message before the last tick seen, the first of them)
    duplicates : per topic, messages that came again with the same bytes (dropped)
    differing : per topic, (messages with other bytes than the first of their tick, which is logged;
        the first such tick)
    foreign : messages that are of no tick of this run, or not of their type
    ignored : messages that did not act, as the plant ignores them: by reason, or per topic
    lost : messages that could not be written
    failure : why the log ended early; None if it did not
    """

    files: tuple[str, ...]
    messages: Mapping[str, int]
    missing: Mapping[str, tuple[int, int]]
    duplicates: Mapping[str, int]
    differing: Mapping[str, tuple[int, int]]
    foreign: int
    lost: int
    failure: str | None
    ignored: Mapping[str, int] = field(default_factory=dict)

    @property
    def whole(self) -> bool:
        """Whether the log has every message that it must have."""
        return not (self.failure or self.lost or self.missing or self.differing)

    def differing_lines(self) -> list[str]:
        """Return what differs from the first message of its tick, a line for each topic."""
        return [
            f'{count} messages of {name} differ from the first of their tick, from tick {first} on'
            for name, (count, first) in self.differing.items()
        ]

    def sentence(self) -> str:
        """Return one line for people."""
        faults = [
            f'{count} missing on {name}, the first at tick {first}'
            for name, (count, first) in self.missing.items()
        ]
        faults += self.differing_lines()
        if self.failure:
            faults.append(f'the log failed ({self.failure}), {self.lost} lost')
        sentence = f'{sum(self.messages.values())} messages logged; ' + (
            '; '.join(faults) if faults else 'none missing'
        )
        if self.ignored:
            sentence += f'; {sum(self.ignored.values())} ignored, as the plant ignored them'
        return sentence


def log_files(folder: Path) -> list[Path]:
    """Return the MCAP files of a run's log in order of time; empty if there are none.

    Raises LogError if the folder holds two logs, one whole and one in parts.
    """
    logs = _all_logs(folder)
    if len(logs) > 1 and logs[0].name == _WHOLE:
        names = ', '.join(path.name for path in logs)
        one = f'one log, {_WHOLE} or run_0.mcap, run_1.mcap, ...'
        raise NotARun(folder, f'must hold {one}; it holds {names}')
    return logs


def _all_logs(folder: Path) -> list[Path]:
    """Return what has the name of a log: the whole one first, then the parts in order of time."""
    whole = folder / _WHOLE
    parts = [path for path in folder.glob('run_*.mcap') if _PART.fullmatch(path.name)]
    parts.sort(key=lambda path: int(path.stem[4:]))
    return [whole, *parts] if os.path.lexists(whole) else parts


def prepare_folder(folder: Path, overwrite: bool) -> None:
    """Create the folder of a run, or clear a log from it when asked to; raises LogError."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        taken = _all_logs(folder)
        taken += [folder / name for name in _BESIDE if os.path.lexists(folder / name)]
        if taken and not overwrite:
            names = ', '.join(path.name for path in taken)
            way = 'overwrite this one (`--overwrite`; recorder: `-p overwrite:=true`)'
            sentence = f'holds a log already ({names}); name another folder, or {way}'
            raise ExistsAlready(folder, sentence)
        for path in taken:
            path.unlink()
    except OSError as error:
        raise cannot_write(folder, error) from None


def write_whole(path: Path, data: bytes) -> None:
    """Write a file, whole or not at all; raises OSError."""
    draft = path.with_name(f'{path.name}.part')
    try:
        with draft.open('wb') as stream:
            stream.write(data)
            stream.flush()
            os.fsync(stream.fileno())
        draft.replace(path)
    except OSError:
        with suppress(OSError):
            draft.unlink()
        raise
