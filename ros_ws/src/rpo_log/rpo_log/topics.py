# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The topics of one run: rows of `rpo_core.wire.interfaces`; and what its events say."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rpo_core.wire import cdr, interfaces, statuses
from rpo_core.wire.interfaces import Interface
from rpo_log.errors import LogError

REQUIRED = (interfaces.RELATIVE_STATE, interfaces.CONTROL_FORCE)
"""Signals without which a log is not that of a closed loop."""


@dataclass(frozen=True)
class Topic:
    """One recorded topic: its full name, and the row of the table that it follows."""

    name: str
    row: Interface

    @property
    def signal(self) -> str:
        """Name of the signal that it carries."""
        return self.row.name

    @property
    def type(self) -> str:
        """ROS type, like nav_msgs/msg/Odometry."""
        return self.row.type

    @property
    def remapped(self) -> bool:
        """Whether its name does not end in that of its signal: then its channel names it."""
        return self.name.rpartition('/')[2] != self.signal

    @property
    def is_event(self) -> bool:
        """Whether its messages are rare, not one at each tick."""
        return self.row.due == interfaces.EVENT


APPLIED = {interfaces.APPLIED_FORCE, interfaces.APPLIED_BODY_FORCE}
"""What a plant publishes that keeps the wall clock: the command that it applied."""


def free_running(recorded: Iterable[Topic]) -> bool:
    """Return whether the plant kept the wall clock."""
    return any(topic.signal in APPLIED for topic in recorded)


def due(recorded: Sequence[Topic]) -> list[Topic]:
    """Return those with a message at each tick; in free running an answer may be missing."""
    missing = {interfaces.EVENT, *[interfaces.EACH_TICK] * free_running(recorded)}
    return [topic for topic in recorded if topic.row.due not in missing]


SIGNAL = 'rpo_signal'
"""Key of the metadata of a channel whose topic is remapped: the signal that it carries."""


def find(name: str, signal: str = '') -> Topic | None:
    """Return the topic of a full name; None if a log holds no such topic.

    signal : that it carries, where its name does not say so
    """
    row = interfaces.find(signal or name)
    return Topic(name, row) if row is not None and row.logged else None


def resolve(names: Iterable[str | Topic], path: str = 'topics') -> tuple[Topic, ...]:
    """Return the topics of a run in the order of the table; raises LogError.

    names : the last part of each is its signal; a Topic where it is not
    """
    order = [row.name for row in interfaces.rows(logged=True)]
    topics_by_signal: dict[str, Topic] = {}
    for name in names:
        topic = name if isinstance(name, Topic) else find(name)
        if topic is None:
            rule = f'the last part of a name must be one of {", ".join(order)}'
            raise LogError(path, f'topic {name} has no role in a run; {rule}')
        if (other := topics_by_signal.setdefault(topic.signal, topic)) is not topic:
            both = f'topics {other.name} and {topic.name} have the same role, {topic.signal}'
            raise LogError(path, f'{both}; one run is recorded in one log')
    return tuple(topics_by_signal[signal] for signal in order if signal in topics_by_signal)


ACTIVE, INACTIVE = 'active', 'inactive'
"""Values `state` of a stage_status: from its `tick` on, the stage is switched on or off."""


def dropped(status: cdr.Status) -> dict[str, int]:
    """Return the signals that the plant goes on without, by a run_status, and from which tick."""
    if (tick := tick_of(status)) is None:
        return {}
    names = dict(status.values).get('dropped', '').split()
    return {row.name: tick for row in map(interfaces.find, names) if row is not None}


def coasted(
    values: Mapping[str, NDArray[np.float64]], ticks: NDArray[np.int64], without: Mapping[str, int]
) -> dict[str, NDArray[np.float64]]:
    """Return signals with zeros, riders too, from the ticks on that the plant flew without them."""
    signals = dict(values)
    for signal, tick in without.items():
        for name in {signal, interfaces.row_of(signal).rider} & signals.keys():
            signals[name] = np.where((ticks >= tick)[:, None], 0.0, signals[name])
    return signals


def tick_of(status: cdr.Status) -> int | None:
    """Return the first tick that an event holds for; None if it has none."""
    return statuses.tick_of(dict(status.values))
