# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Messages lost or late between plant and controller, as a free-running plant sees it, offline.

A tick has the newest force that has come by then: the answer to its own state or an older one,
held. A force that answers a state of more than `stale_after_ticks` ago counts as zero.
What becomes of the messages of a tick is said by `rpo_training.engine.link`.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from rpo_core.kernels import Vector
from rpo_core.link import Hits, Link
from rpo_core.noise import philox
from rpo_core.validation import InputError, mapping, real, whole
from rpo_training.engine.link import Fates

STALE_AFTER_TICKS = 10
LATE_BY_TICKS = 2
"""As the free-running plant and the fault injector have it."""

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
    """Return the section `faults` of a campaign file; one without effect is refused."""
    repeats = ('state_repeat', 'force_repeat')
    data = mapping('faults', value, [], [*asdict(Faults()), *repeats])
    for name in repeats:
        if name in data:
            raise InputError(
                f'`{name}` has no effect: a second answer to a state is ignored; leave it out'
            )
    found = Faults(**data)
    if not found.delays and found.state_loss <= 0.0 and found.force_loss <= 0.0:
        raise InputError(f'it has no effect: one of {", ".join(SHARES)} must be > 0')
    if 'late_by_ticks' in data and not found.delays:
        raise InputError('`late_by_ticks` has no effect: no message is delayed')
    return found


def to_document(faults: Faults) -> dict[str, Any]:
    """Return the section that `parse` reads."""
    document = asdict(faults)
    if not faults.delays:
        del document['late_by_ticks']
    return document


def hits(tick: int, key: tuple[int, int], faults: Fates) -> tuple[Hits, Hits]:
    """Return the faults of the state of a tick and of the force that answers it."""
    a, b, c, d = philox(tick, 2, 0, 0, *key)
    state = {'drop': a < faults.state_loss, 'delay': b < faults.state_delay}
    force = {'drop': c < faults.force_loss, 'delay': d < faults.force_delay}
    return dict.fromkeys(filter(state.get, state), ''), dict.fromkeys(filter(force.get, force), '')


class Channel:
    """The way of one run from state to force: what comes when, and what is held.

    Two links, clocked by ticks, one behind the other; `lateness` says the same in a number.
    key : two words of 32 bits
    """

    def __init__(self, faults: Faults, key: tuple[int, int]) -> None:
        self._fates, self._key = faults.fates, key
        late = float(faults.late_by_ticks)
        self._states: Link[tuple[int, Vector, Hits]] = Link(delay_s=late)
        self._forces: Link[tuple[int, Vector]] = Link(delay_s=late)
        self._newest, self._held = -1, (0.0, 0.0, 0.0)

    def passed(self, tick: int, command_n: Vector) -> Vector:
        """Return the force [N] held at a tick, whose state the controller answers by a command."""
        state, force = hits(tick, self._key, self._fates)
        seen = self._states.send((tick, command_n, force), state, tick) + self._states.due(tick)
        for (answered, command, faults), _ in seen:
            self._take(self._forces.send((answered, command), faults, tick))
        self._take(self._forces.due(tick))
        fresh = self._newest >= 0 and tick - self._newest <= self._fates.stale_after
        return self._held if fresh else (0.0, 0.0, 0.0)

    def _take(self, came: list[tuple[tuple[int, Vector], str]]) -> None:
        """Hold the newest force."""
        for (answered, command), _ in came:
            if answered > self._newest:
                self._newest, self._held = answered, command
