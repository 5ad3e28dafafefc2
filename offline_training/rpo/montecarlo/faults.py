# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Messages lost or late between a free-running plant and its controller, offline.

At each tick the plant holds the latest force that has arrived: the answer to the state of this tick
or of an older one. A force that answers a state older than `stale_after_ticks` counts as zero.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from rpo.engine.parts.link import Fates, hits
from rpo_core.files.validation import InputError, mapping, real, whole
from rpo_core.stage import ZERO, Signal, Stage
from rpo_core.wire.interfaces import APPLIED_BODY_FORCE, APPLIED_FORCE, BODY_TORQUE, COMMAND
from rpo_core.world.link import FaultyLink, Hits

STALE_AFTER_TICKS = 10
LATE_BY_TICKS = 2
"""The values of the free-running plant and of the fault injector."""

MOST_LATE_TICKS = 100

SHARES = ('state_loss', 'state_delay', 'force_loss', 'force_delay')
_WORDS = 2**32


@dataclass(frozen=True)
class Faults:
    """Shares in [0, 1] of the messages of a topic that are lost, or late; independent.

    late_by_ticks : how late a delayed message is
    stale_after_ticks : a force that answers an older state than that counts as zero
    """

    state_loss: float = 0.0
    state_delay: float = 0.0
    force_loss: float = 0.0
    force_delay: float = 0.0
    late_by_ticks: int = LATE_BY_TICKS
    stale_after_ticks: int = STALE_AFTER_TICKS

    def __post_init__(self) -> None:
        for name in SHARES:
            real(name, getattr(self, name), least=0.0, most=1.0)
        whole('late_by_ticks', self.late_by_ticks, least=1, most=MOST_LATE_TICKS)
        whole('stale_after_ticks', self.stale_after_ticks, least=0, most=10_000_000)

    @property
    def delays(self) -> bool:
        """Whether any message is late."""
        return self.state_delay > 0.0 or self.force_delay > 0.0

    @property
    def fates(self) -> Fates:
        """The same for the kernels."""
        loss, delay, force_loss, force_delay = (
            int(getattr(self, name) * _WORDS) for name in SHARES
        )
        late, stale = self.late_by_ticks, self.stale_after_ticks
        return Fates(loss, delay, force_loss, force_delay, late, stale)


def parse(value: Any) -> Faults:
    """Return the section `faults` of a campaign file; raises InputError if it has no effect."""
    data = mapping('faults', value, [], asdict(Faults()))
    found = Faults(**data)
    if not found.delays and found.state_loss <= 0.0 and found.force_loss <= 0.0:
        raise InputError(f'it has no effect: one of {", ".join(SHARES)} must be > 0')
    if 'late_by_ticks' in data and not found.delays:
        raise InputError('`late_by_ticks` has no effect: no message is delayed')
    return found


Answer = tuple[Signal, ...]
"""The force of a message, and the torque in it."""


class LinkStage(Stage):
    """Messages lost or late: from the command to the force that the plant holds.

    Two links, clocked by ticks, one behind the other: states, then forces. The engine has the same
    as a number of ticks, `engine.parts.link.lateness`.

    key : two words of 32 bits
    turns : whether the command is of a chaser that turns, and has a torque in its message
    """

    name = 'link'
    memory_ticks = None

    def __init__(self, faults: Faults, key: tuple[int, int], turns: bool = False) -> None:
        self.inputs = (COMMAND, BODY_TORQUE) if turns else (COMMAND,)
        self.outputs = (APPLIED_BODY_FORCE, BODY_TORQUE) if turns else (APPLIED_FORCE,)
        self._fates, self._key = faults.fates, key
        self._late_by = float(faults.late_by_ticks)
        self._none: Answer = (ZERO,) * len(self.inputs)
        self.reset()

    def reset(self) -> None:
        """Begin with no message on its way, and no force held."""
        self._states: FaultyLink[tuple[int, Answer, Hits]] = FaultyLink(delay_s=self._late_by)
        self._forces: FaultyLink[tuple[int, Answer]] = FaultyLink(delay_s=self._late_by)
        self._latest, self._held = -1, self._none

    def step(self, tick: int, *inputs: Any) -> tuple[Signal, ...]:
        """Return the force (3,) [N], and torque, held at a tick; inputs answer its state."""
        state, force = self._hits(tick)
        arrived = self._states.send((tick, inputs, force), state, tick) + self._states.due(tick)
        for (answered, command, faults), _ in arrived:
            self._take(self._forces.send((answered, command), faults, tick))
        self._take(self._forces.due(tick))
        fresh = self._latest >= 0 and tick - self._latest <= self._fates.stale_after
        return self._held if fresh else self._none

    def _hits(self, tick: int) -> list[Hits]:
        """Return the faults of the state of a tick and of the force that answers it."""
        lost, late, force_lost, force_late = hits(tick, *self._key, self._fates)
        pairs = ((lost, late), (force_lost, force_late))
        kinds = ('drop', 'delay')
        return [{kind: '' for kind, hit in zip(kinds, pair, strict=True) if hit} for pair in pairs]

    def _take(self, arrived: list[tuple[tuple[int, Answer], str]]) -> None:
        """Hold the latest force."""
        for (answered, command), _ in arrived:
            if answered > self._latest:
                self._latest, self._held = answered, command
