# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""An ordinary bag (`ros2 bag record`) of the topics of a run, read as if we had recorded it.

rosbags reads the bag: MCAP or sqlite3, any file name, compressed or not. Its messages are put in
the order of their ticks by the recorder's own writer, in a temporary log. What the bag lacks is
said in `lacks`.
"""

from __future__ import annotations

import os
import shutil
import tempfile
import weakref
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from rpo_core import files
from rpo_core.files.validation import InputError
from rpo_core.scenario import scenario as scenario_file
from rpo_core.scenario.scenario import Scenario
from rpo_core.wire import cdr, interfaces
from rpo_core.wire.statuses import Manifest, RunStatus
from rpo_log import topics
from rpo_log.errors import LogError, NotARun
from rpo_log.format import run
from rpo_log.format.run import METADATA_FILE, TimeBase
from rpo_log.manifests import Manifests
from rpo_log.read.stream import RunReader
from rpo_log.topics import Topic
from rpo_log.write.writer import RunLogWriter

_STORAGE = ('.mcap', '.db3')
_NOT_NEEDED = '`--scenario` and `--controller` are for a bag that does not carry them'
_MOST_HOLES = 10
"""Stamps on a grid have at most so many ticks for each of them; else they are on none."""


def open_run(path: str | Path, scenario: str = '', controller: str = '') -> RunReader:
    """Return the reader of a log: a run's own, or an ordinary bag of its topics.

    scenario, controller : of a bag without manifests, names or files

    Raises InputError, LogError.
    """
    try:
        reader = RunReader(path)
    except NotARun:
        if (bag := bag_at(Path(path))) is None:
            raise
        return BagReader(bag, scenario, controller)
    if scenario or controller:
        raise InputError(f'{_NOT_NEEDED}; {reader.path} does')
    return reader


def bag_at(path: Path) -> Path | None:
    """Return the folder of a bag, or its file, by the names of its files; None if it is none."""
    if path.name == METADATA_FILE:
        path = path.parent
    if path.suffix in _STORAGE and path.is_file():
        return path
    # A folder with digests was written by our recorder: what is wrong with it is no bag.
    ours = os.path.lexists(path / run.SUMS_FILE)
    return path if (path / METADATA_FILE).is_file() and not ours else None


def _files_of(bag: Path) -> list[Path]:
    """Return the files of a bag; LogError if one is a pipe, a socket or a device."""
    beside = sorted(bag.iterdir()) if bag.is_dir() else [bag]
    paths = [path for path in beside if set(_STORAGE) & set(path.suffixes)]
    for path in paths:
        if not path.is_file():
            raise NotARun(path, 'must be a regular file')
    return paths


class BagReader(RunReader):
    """Reads an ordinary bag; what its messages prove is as with a log.

    scenario, controller : names or files, where no manifest in the bag brings them

    Raises InputError, LogError; ModuleNotFoundError without rosbags.
    """

    foreign = True

    def __init__(self, path: Path, scenario: str = '', controller: str = '') -> None:
        from rosbags.rosbag2 import Reader

        folder = Path(tempfile.mkdtemp(prefix='rpo_bag_'))
        weakref.finalize(self, shutil.rmtree, folder, ignore_errors=True)
        self.lacks: tuple[str, ...] = ()
        sources = _files_of(path)
        try:
            with Reader(path) as bag:
                self._convert(bag, path, folder, (scenario, controller))
        except (InputError, ModuleNotFoundError):
            raise
        except Exception as error:  # of a library that reads what anybody may have written
            sentence = f'cannot be read as a bag: {error}; try `ros2 bag reindex`'
            raise LogError(path, sentence) from None
        super().__init__(folder)
        self.path, self.sources = path, sources

    def _convert(self, bag: Any, path: Path, folder: Path, given: tuple[str, str]) -> None:
        """Write the messages of a bag as a log into a folder; note what it lacks."""
        there = {found.topic: found for found in bag.connections if found.msgcount}
        said = [name for name in there if name.rpartition('/')[2] == interfaces.NODE_MANIFEST]
        manifests, controllers = _manifests(bag, said)
        recorded = _topics_of(there, said, manifests, path)
        lacks = [f'it has no manifest of the {role}' for role in manifests.missing]
        attachments = dict[str, bytes]()
        if manifests.scenario is not None:
            attachments = manifests.attachments({}) | manifests.remaps(recorded.values())
            attachments |= controllers  # the first of them as controller.yaml
        for kind, value in zip(('scenario', 'controller'), given, strict=True):
            name = f'{kind}.yaml'
            if value and name in attachments:
                raise InputError(f'{_NOT_NEEDED}; {path} does')
            if value:
                attachments[name] = files.read_text(files.find(kind, value)).encode()
                lacks.append(f'its {kind} is not in the bag: {value} is given')
        base = _base_of(bag, path, recorded, attachments, lacks)
        writer = RunLogWriter(folder, base, recorded.values(), attachments)
        for topic, data in _messages(bag, recorded):
            if recorded[topic].signal != interfaces.RUN_STATUS or _is_phase(data):
                writer.record(topic, data)
        found = writer.close()
        if found.failure:
            raise LogError(folder, f'cannot hold a log: {found.failure}')
        lacks += [f'{found.foreign} messages are of no tick of the run'] if found.foreign else []
        self.lacks = tuple(lacks)


def _messages(bag: Any, names: Collection[str]) -> Iterator[tuple[str, bytes]]:
    """Yield topic and CDR of the messages of some topics, in their order."""
    wanted = [connection for connection in bag.connections if connection.topic in names]
    for connection, _, data in bag.messages(wanted) if wanted else ():
        yield connection.topic, bytes(data)


def _topics_of(
    there: Mapping[str, Any], said: Sequence[str], manifests: Manifests, path: Path
) -> dict[str, Topic]:
    """Return the topics of the run in a bag: where its nodes say, else by name; raises LogError.

    said : topics of manifests
    """
    signals = {manifests.topic_of(row.name): row.name for row in interfaces.rows(logged=True)}
    states = [name for name in there if name.rpartition('/')[2] == interfaces.RELATIVE_STATE]
    if len(said or states) > 1:
        sentence = f'holds several runs ({", ".join(states)}); record one namespace alone'
        raise LogError(path, sentence)
    space = (*said, *states, '')[0].rpartition('/')[0]
    topics_by_name = {}
    for name, connection in there.items():
        topic = topics.find(name, signals.get(name, ''))
        if topic is None:
            continue
        wanted = manifests.topic_of(topic.signal) or f'{space}/{topic.signal}'
        if name not in (wanted, topic.row.topic):
            continue
        if connection.msgtype != topic.type:
            sentence = f'{name} must be {topic.type}; got {connection.msgtype}'
            raise LogError(path, sentence)
        topics_by_name[name] = topic
    for signal in topics.REQUIRED:
        if signal not in {topic.signal for topic in topics_by_name.values()}:
            names = ', '.join(sorted(there)) or 'no message'
            raise LogError(path, f'has no topic {signal}; it has {names}')
    return topics_by_name


def _manifests(bag: Any, names: Sequence[str]) -> tuple[Manifests, dict[str, bytes]]:
    """Return the manifests in a bag, and the controller files, in their order."""
    manifests, controllers = Manifests(), dict[str, bytes]()
    for _, data in _messages(bag, names):
        with suppress(InputError, cdr.CdrError):
            manifest = Manifest.of(cdr.decode_status(data))
            manifests.take(manifest.node, manifest.values)
            if another := manifests.another_controller():
                controllers[another[0]] = another[1]
    return manifests, controllers


def _base_of(
    bag: Any, path: Path, recorded: dict[str, Topic], attachments: dict[str, bytes],
    lacks: list[str],
) -> TimeBase:  # fmt: skip
    """Return the ticks of the scenario; without one, those of the stamps of the states."""
    if run.SCENARIO in attachments:
        text = attachments[run.SCENARIO].decode()
        scenario = files.loads(text, scenario_file.parse, run.SCENARIO)
        if not isinstance(scenario, Scenario):
            raise InputError('`--scenario` must be a single flight; it is a set')
        return TimeBase.of(scenario)
    state = next(name for name, t in recorded.items() if t.signal == interfaces.RELATIVE_STATE)
    stamps = np.unique([cdr.stamp_ns(data) for _, data in _messages(bag, {state})])
    dt_ns = int(np.gcd.reduce(np.diff(stamps))) if len(stamps) > 1 else 0
    first, last = int(stamps[0]), int(stamps[-1])
    if not dt_ns or (last - first) // dt_ns > _MOST_HOLES * len(stamps):
        sentence = f'the stamps of {state} show no length of a tick; `--scenario` names it'
        raise LogError(path, sentence)
    lacks.append(
        f'its scenario is not known: ticks are the stamps of {state}, every {dt_ns / 1e9:g} s from '
        'the first to the last'
    )
    return TimeBase(first, dt_ns, (last - first) // dt_ns)


def _is_phase(data: bytes) -> bool:
    """Return whether a run_status is one of those that a log holds."""
    try:
        status = RunStatus.of(cdr.decode_status(data))
    except (InputError, cdr.CdrError):
        return False
    return status.logged
