# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What becomes of a tick's messages between plant and controller, as a kernel.

It is a function of (key of the run, tick), by Philox4x32-10: the engine's lanes and
`rpo_training.campaign.faults`, which flies one run, ask the same.
"""

from __future__ import annotations

from typing import NamedTuple

from rpo_core.noise import kernel, philox

LOST = -1
"""What `lateness` says of an answer that never comes."""


class Fates(NamedTuple):
    """Faults as the kernels read them: thresholds of words of 32 bits, and ticks."""

    state_loss: int
    state_delay: int
    force_loss: int
    force_delay: int
    late_by: int
    stale_after: int


@kernel
def lateness(tick: int, k0: int, k1: int, faults: Fates) -> int:
    """Ticks from state `tick` to the force that answers it; LOST if there is none."""
    a, b, c, d = philox(tick, 2, 0, 0, k0, k1)
    late = 0
    if b < faults.state_delay:
        late += faults.late_by
    if d < faults.force_delay:
        late += faults.late_by
    return LOST if a < faults.state_loss or c < faults.force_loss else late
