# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Which run_status is that of the plant whose states are recorded."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping

from rpo_core.files.scenario import Scenario
from rpo_core.wire import cdr
from rpo_core.wire.interfaces import RELATIVE_STATE, row_of
from rpo_log import topics
from rpo_log.write.writer import RunLogWriter

PHASES = ('running', 'finished', 'aborted')
"""Phases that a log holds."""

_MOST_CLAIMS = 1000


def is_of_the_run(status: cdr.Status, log: RunLogWriter, scenario: Scenario | None) -> bool | None:
    """Return whether a run_status fits the states of a log; None as long as its state is ahead.

    Its distance and speed must be those of the state of its tick; a run ends in its newest state.
    """
    values, tick = dict(status.values), topics.tick_of(status)
    if tick is None or tick > log.base.last_tick:
        return False
    if values.get('phase') == 'finished' and tick < log.base.last_tick:
        return False
    if tick > max(log.latest, 0):
        return None
    # One later: somebody else may have published a state that nothing contradicts any more.
    if values.get('phase') != 'running' and tick < log.latest - 1:
        return False
    states = _states(tick, log, scenario)
    if not states:
        return tick >= log.latest
    return any(
        _same(values, 'distance_m', state[:3]) and _same(values, 'speed_m_s', state[3:])
        for state in states
    )


def _states(tick: int, log: RunLogWriter, scenario: Scenario | None) -> list[tuple[float, ...]]:
    """Return the state of a tick, or those published if they differ; none if it is forgotten."""
    if tick == 0 and scenario is not None:
        return [tuple(map(float, scenario.start))]
    layout = row_of(RELATIVE_STATE).layout
    return [layout.decode(data)[1] for data in log.messages(RELATIVE_STATE, tick)]


def _same(values: Mapping[str, str], name: str, vector: tuple[float, ...]) -> bool:
    try:
        return math.isclose(float(values.get(name, '')), math.hypot(*vector), rel_tol=1e-9)
    except ValueError:
        return False


class Claims:
    """Each run_status that was heard, until its state shows whether it is of the run."""

    def __init__(self) -> None:
        self._waiting: list[tuple[float, bytes]] = []

    def take(self, data: bytes) -> None:
        """Take the CDR of a run_status."""
        if len(self._waiting) < _MOST_CLAIMS:
            self._waiting.append((time.monotonic(), data))

    def weigh(
        self, log: RunLogWriter, scenario: Scenario | None, patience_s: float
    ) -> Iterator[tuple[bytes, bool]]:
        """Yield those that are decided, and whether they are of the run.

        patience_s : wall time after which the state of a status is waited for no more
        """
        waiting, self._waiting = self._waiting, []
        for moment, data in waiting:
            fits = is_of_the_run(cdr.decode_status(data), log, scenario)
            if fits is None and time.monotonic() - moment < patience_s:
                self._waiting.append((moment, data))
            else:
                yield data, bool(fits)
