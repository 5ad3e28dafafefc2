# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The decisions beside a log, recomputed from its states and its controller."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from itertools import zip_longest
from pathlib import Path
from typing import NamedTuple

import numpy as np
from mcap.records import Header, McapRecord, Metadata
from numpy.typing import NDArray

from rpo_core.chain.decimation import Decimation
from rpo_core.control import explain
from rpo_core.control.controller import AnyController
from rpo_core.wire import cdr, interfaces
from rpo_log.errors import Fault, LogError
from rpo_log.format import rosbag2
from rpo_log.format.rosbag2 import BagFile, BagTopic
from rpo_log.format.run import DECISIONS_FILE, TimeBase
from rpo_log.read.decisions import messages_of
from rpo_log.read.records import FileRecords
from rpo_log.verify.difference import Difference
from rpo_log.verify.form import Form, declarations
from rpo_log.write.mcap_file import LIBRARY, PROFILE

CHECK = 'decisions'

_OK, _WARN = 0, 1
_MOST_RECORDS = 16

Floats = NDArray[np.float64]


class _Logged(NamedTuple):
    tick: int
    data: bytes


class Decisions:
    """Compares decisions.mcap with the flight, block by block; raises LogError.

    folder : of the run
    topic : full name of the topic
    controller, content : that the log carries, and the bytes of its file
    """

    def __init__(
        self, folder: Path, base: TimeBase, topic: str, controller: AnyController, content: bytes
    ) -> None:
        self._base, self._topic = base, topic
        self._controllers: list[tuple[AnyController, str]] = []
        self.add(controller, content)
        self._records = FileRecords(folder / DECISIONS_FILE)
        self._form = Form(self._records.path, _MOST_RECORDS)
        self._ticks: list[int] = []
        self._unknown = 0
        self._messages = self._read()
        self._waiting = next(self._messages, None)

    def add(self, controller: AnyController, content: bytes) -> None:
        """Take a controller of the run, and the bytes of its file."""
        label = explain.label(controller, hashlib.sha256(content).hexdigest())
        self._controllers.append((controller, label))

    def difference(
        self, ticks: NDArray[np.int64], states: Floats, forces_n: Floats, active: NDArray[np.bool_]
    ) -> Difference | None:
        """Compare the decisions of some ticks of the log.

        states : (n, 6) m, m/s that the controller saw: from the goal, or from the reference
        forces_n : (n, 3) N that it commanded; active : (n,) where it was switched on
        """
        while self._waiting is not None and self._waiting.tick <= ticks[-1]:
            tick, data = self._waiting
            row = int(np.searchsorted(ticks, tick))
            inputs = np.concatenate([states[row], forces_n[row]])
            if ticks[row] != tick or not np.isfinite(inputs).all():
                self._unknown += 1
            elif found := self._compared(tick, data, inputs.tolist(), bool(active[row])):
                return found
            self._waiting = next(self._messages, None)
        return None

    @property
    def digest(self) -> str:
        """SHA-256 of decisions.mcap as it was read; empty if it was too long to be hashed."""
        return '' if self._records.unread else self._records.sha256.hexdigest()

    def gaps(self, rate_hz: float | None, last_tick: int) -> list[str]:
        """Return what is missing of the decisions of a flight; call it after the last block.

        rate_hz : decisions per simulated second; None: not known
        """
        found = [self._form.deviation(self._expected_records()), self._records.damage]
        if self._waiting is not None:
            found.append(f'it has a decision of tick {self._waiting.tick}, after the end')
            for _ in self._messages:  # so that all of the file is hashed
                pass
        if self._unknown:
            found.append(f'{self._unknown} decisions are of ticks without state or force')
        due = Decimation(rate_hz) if rate_hz is not None else None
        missing = {
            tick for tick in range(last_tick + 1) if due is not None and self._is_due(due, tick)
        } - set(self._ticks)
        if missing:
            found.append(f'{len(missing)} decisions are missing, the first at tick {min(missing)}')
        return [
            gap if DECISIONS_FILE in gap else f'{DECISIONS_FILE}: {gap}' for gap in found if gap
        ]

    def _is_due(self, due: Decimation, tick: int) -> bool:
        before = self._base.stamp_ns(tick - 1) if tick else None
        return due.due(self._base.stamp_ns(tick), before)

    def _read(self) -> Iterator[_Logged]:
        for number, message in enumerate(messages_of(self._records, self._form.take)):
            try:
                stamp_ns = cdr.stamp_ns(message.data)
            except cdr.CdrError as error:
                raise self._bad(number, f'a message {error}') from None
            tick = self._base.tick_of(stamp_ns)
            if tick is None or (self._ticks and tick <= self._ticks[-1]):
                raise self._bad(number, f'a stamp must be that of a later tick; got {stamp_ns} ns')
            if message[:4] != (1, number, stamp_ns, stamp_ns):
                raise self._bad(number, 'a message has another channel, number or time')
            self._ticks.append(tick)
            yield _Logged(tick, message.data)

    def _bad(self, number: int, why: str) -> LogError:
        return LogError(Fault.BAD_MESSAGE, self._records.path, f'decision {number}: {why}')

    def _expected_records(self) -> list[McapRecord]:
        topics = [
            BagTopic.of(self._topic, interfaces.ARRAY_TYPE, interfaces.LOCKSTEP, count)
            for count in (0, len(self._ticks))
        ]
        ends = (0, 0)
        if self._ticks:
            ends = (self._base.stamp_ns(self._ticks[0]), self._base.stamp_ns(self._ticks[-1]))
        files = BagFile(DECISIONS_FILE), BagFile(DECISIONS_FILE, *ends, len(self._ticks))
        first, last = (
            Metadata(rosbag2.RECORD, rosbag2.record_values([topic], file))
            for topic, file in zip(topics, files, strict=True)
        )
        return [Header(PROFILE, LIBRARY), first, *declarations(topics[:1]), last]

    def _compared(
        self, tick: int, data: bytes, inputs: list[float], active: bool
    ) -> Difference | None:
        """Return where a decision is not the one of a state and a force."""
        level = _OK if active else _WARN
        # Without a file when unconfigured; of several controllers the last is the one named.
        labels = [*([] if active else [(None, 'none')]), *reversed(self._controllers)]
        for controller, said in labels:
            reasons = explain.INACTIVE
            if active and controller is not None:
                reasons = explain.reasons(controller, inputs[:6], inputs[6:])
            statuses = [
                cdr.Status(level, f'decision: {axis}', sentence, said,
                           tuple((name, repr(number)) for name, number in pairs))
                for axis, (sentence, pairs) in zip(explain.AXES, reasons, strict=True)
            ]  # fmt: skip
            expected = cdr.encode_array(self._base.stamp_ns(tick), interfaces.LVLH_FRAME, statuses)
            if data == expected:
                return None
        return self._named(tick, data, expected)

    def _named(self, tick: int, data: bytes, expected: bytes) -> Difference:
        """Return the first field in which a decision differs."""
        try:
            found = [_fields(part) for part in (data, expected)]
        except cdr.CdrError as error:
            raise self._bad(self._ticks.index(tick), f'a message {error}') from None
        for logged, computed in zip_longest(*found, fillvalue=('end', '')):
            if logged != computed:
                return Difference(tick, self._topic, logged[0], logged[1], computed[1], CHECK)
        return Difference(tick, self._topic, 'bytes between its fields', '', '', CHECK)


def _fields(data: bytes) -> list[tuple[str, str]]:
    """Return the fields of the statuses of a decision, by name."""
    found = []
    for status in cdr.decode_array(data)[1]:
        named = zip(('level', 'name', 'message', 'hardware_id'), status, strict=False)
        found += [(name, str(value)) for name, value in named]
        found += [(f'{status.name} {name}', value) for name, value in status.values]
    return found
