# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Messages lost or late between a free-running plant and its controller, offline.

At each tick the plant holds the latest force that has arrived: the answer to the state of this tick
or of an older one. A force that answers a state older than `stale_after_ticks` counts as zero.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Annotated, Any, NamedTuple

from rpo_core.files.validation import InputError, mapping, real, whole
from rpo_core.kernels.jit import inlined, step_kernel
from rpo_core.kernels.noise import philox
from rpo_core.stage import KernelStage
from rpo_core.wire.interfaces import APPLIED_BODY_FORCE, APPLIED_FORCE, BODY_TORQUE, COMMAND

STALE_AFTER_TICKS = 10
LATE_BY_TICKS = 2
"""The values of the free-running plant and of the fault injector."""

MOST_LATE_TICKS = 100

SHARES = ('state_loss', 'state_delay', 'force_loss', 'force_delay')
_WORDS = 2**32

MAX_SIZE = 6
"""Numbers of an answer: force and torque."""

LOST = -1
"""The lateness of an answer that does not arrive."""


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

    def settings(self, key: tuple[int, int], size: int) -> LinkFaults:
        """Return the same for the kernel, with the key of a run and the numbers of an answer."""
        loss, delay, force_loss, force_delay = (
            int(getattr(self, name) * _WORDS) for name in SHARES
        )
        ticks = self.late_by_ticks, self.stale_after_ticks
        return LinkFaults(loss, delay, force_loss, force_delay, *ticks, *key, size)


def parse(value: Any) -> Faults:
    """Return the section `faults` of a campaign file; raises InputError if it has no effect."""
    data = mapping('faults', value, [], asdict(Faults()))
    found = Faults(**data)
    if not found.delays and found.state_loss <= 0.0 and found.force_loss <= 0.0:
        raise InputError(f'it has no effect: one of {", ".join(SHARES)} must be > 0')
    if 'late_by_ticks' in data and not found.delays:
        raise InputError('`late_by_ticks` has no effect: no message is delayed')
    return found


class LinkFaults(NamedTuple):
    """Settings of the kernel `hold`: faults of messages, as thresholds of words of 32 bits.

    late_by, stale_after : as `Faults` has them [ticks]
    k0, k1 : words of the key of the run
    size : numbers of an answer
    """

    state_loss: int
    state_delay: int
    force_loss: int
    force_delay: int
    late_by: int
    stale_after: int
    k0: int
    k1: int
    size: int


@dataclass(slots=True)
class Answers:
    """Memory of the kernel `hold`.

    latest : tick of the latest answer that has arrived; -1: none has
    held : that answer
    answers, late : ring of the last answers, and how many ticks late each is
    """

    held: Annotated[list[float], MAX_SIZE]
    answers: list[list[float]]
    late: list[int]
    latest: int = -1


@inlined
def lateness(tick: int, p: Any) -> int:
    """Return the ticks from state `tick` to the force that answers it; LOST if there is none.

    Philox4x32-10 of (key of the run, tick): runs and ticks can be flown in any order.
    """
    a, b, c, d = philox(tick, 2, 0, 0, p.k0, p.k1)
    if a < p.state_loss or c < p.force_loss:
        return LOST
    return int(p.late_by * ((b < p.state_delay) + (d < p.force_delay)))


@step_kernel
def hold(tick: int, u: Any, p: Any, m: Any, y: Any) -> None:
    """y_k = u_j of the largest j with j + lateness(j) <= k; zero where k - j > stale_after.

    u, y (size,) : force [N], then torque [N m] if the chaser turns; u answers the state of this
    tick. A state may be late, and the force that answers it.
    """
    depth = len(m.late)
    now = tick % depth
    for i in range(p.size):
        m.answers[now][i] = u[i]
    m.late[now] = lateness(tick, p)
    for times in range(3):
        answered = tick - times * p.late_by
        slot = answered % depth
        if answered > m.latest and m.late[slot] == times * p.late_by:
            m.latest = answered
            for i in range(p.size):
                m.held[i] = m.answers[slot][i]
    fresh = m.latest >= 0 and tick - m.latest <= p.stale_after
    for i in range(p.size):
        y[i] = m.held[i] if fresh else 0.0


class LinkStage(KernelStage):
    """Messages lost or late: from the command to the force that the plant holds.

    key : two words of 32 bits
    turns : whether the command is of a chaser that turns, and has a torque in its message
    """

    name = 'link'
    memory_ticks = None
    kernel = hold

    def __init__(self, faults: Faults, key: tuple[int, int], turns: bool = False) -> None:
        self.inputs = (COMMAND, BODY_TORQUE) if turns else (COMMAND,)
        self.outputs = (APPLIED_BODY_FORCE, BODY_TORQUE) if turns else (APPLIED_FORCE,)
        size, depth = MAX_SIZE if turns else MAX_SIZE // 2, 2 * faults.late_by_ticks + 1
        answers = [[0.0] * size for _ in range(depth)]
        memory = Answers([0.0] * MAX_SIZE, answers, [LOST] * depth)
        super().__init__(faults.settings(key, size), memory)
