# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The filter where the target turns, and with it the corridor. docs/safety.md, lemma 5.

The OPEN set stays in LVLH. The APPROACH set is in the target's axes, velocities against them: `w`
has its numbers there, `g` those of the OPEN set and the true place of the port.
now, following : axes of the target in the tick in which the force acts, and one later
"""

from __future__ import annotations

from rpo_core.assurance.corridor import approach_margins, at_port, backup_approach, in_corridor
from rpo_core.assurance.filters import (
    CORRIDOR,
    DOMAIN,
    KEEP_OUT,
    NOT_FINITE,
    SPEED,
    between,
    finite,
    nearest,
    share_within,
    within_limits,
)
from rpo_core.assurance.kernels import (
    APPROACH,
    CONTACT,
    FAR,
    OPEN,
    Guard,
    backup_open,
    both_margins,
    open_margins,
)
from rpo_core.attitude.attitude_kernels import Frame, seen_from, to_lvlh
from rpo_core.kernels.arithmetic import State, Vector, saturate
from rpo_core.kernels.jit import kernel
from rpo_core.world.cw import CwStep, cw_step


@kernel
def margins_after(
    state: State, force: Vector, mode: int, following: Frame, c: CwStep, g: Guard, w: Guard
) -> tuple[float, float]:
    """Margins [m], [m/s] to the set of a mode, one tick after a state with a force."""
    after = cw_step(state, force, c)
    if mode == APPROACH:
        return approach_margins(seen_from(after, following), w.next_m, w.next_m_s, w)
    return open_margins(after, g.next_m, g.next_m_s, g)


@kernel
def backup_turning(state: State, mode: int, now: Frame, g: Guard, w: Guard) -> Vector:
    """Backup law [N] of a mode. In the corridor it stops what recedes, too, as far as it must.

    That push inward is at most what may push the chaser outward: it never gets faster.
    """
    if mode != APPROACH:
        return backup_open(state, g)
    seen = seen_from(state, now)
    fx, fy, fz = backup_approach(seen, w)
    closes = in_corridor(seen, w)[1]
    if closes < 0.0:
        back = w.side * saturate(w.mass_kg * closes / w.dt_s, w.mass_kg * w.doubt_m_s2)
        if w.axis == 0:
            fx += back
        elif w.axis == 1:
            fy += back
        else:
            fz += back
    return to_lvlh((fx, fy, fz), now)


@kernel
def assure_turning(
    state: State,
    command: Vector,
    last: Vector,
    mode: int,
    now: Frame,
    following: Frame,
    c: CwStep,
    g: Guard,
    w: Guard,
) -> tuple[float, float, float, int, int, float, float]:
    """Return what `rpo_core.assurance.filters.assure` returns, where the target turns."""
    fx, fy, fz, broke = within_limits(command, last, g)
    if not (finite(state[0], state[1], state[2]) and finite(state[3], state[4], state[5])):
        return 0.0, 0.0, 0.0, mode, NOT_FINITE, -FAR, -FAR
    seen = seen_from(state, now)
    # The port of `w` lies before the true one by as much as may lie behind it.
    beyond = w.here_m + 2.0 * (w.port_m - g.port_m)
    if mode == CONTACT and not at_port(seen, -w.here_m, w):
        mode = APPROACH
    if mode == APPROACH and at_port(seen, beyond, w):
        mode = CONTACT
    if mode == CONTACT:
        return fx, fy, fz, CONTACT, broke, FAR, FAR
    if mode == APPROACH and open_margins(state, g.here_m, g.here_m_s, g)[0] >= 0.0:
        mode = OPEN
    wanted = (fx, fy, fz)
    m = margins_after(state, wanted, mode, following, c, g, w)
    if m[0] >= 0.0 and m[1] >= 0.0:
        return fx, fy, fz, mode, broke, m[0], m[1]
    other = OPEN if mode == APPROACH else APPROACH
    o = margins_after(state, wanted, other, following, c, g, w)
    if other == OPEN:
        room = open_margins(state, g.here_m, g.here_m_s, g)[0]
    else:
        room = approach_margins(seen, w.here_m, w.here_m_s, w)[0]
    if o[0] >= 0.0 and o[1] >= 0.0 and room >= 0.0:
        return fx, fy, fz, other, broke, o[0], o[1]
    acted = SPEED if m[0] >= 0.0 else (CORRIDOR if mode == APPROACH else KEEP_OUT)
    if acted == KEEP_OUT:
        after = cw_step(state, wanted, c)
        acted = DOMAIN if both_margins(after, g.next_m, g.next_m_s, g)[0] >= 0.0 else KEEP_OUT
    if mode == OPEN and g.least != 0.0:
        wanted = nearest(state, wanted, c, g)
        n = margins_after(state, wanted, mode, following, c, g, w)
        if n[0] >= 0.0 and n[1] >= 0.0:
            return wanted[0], wanted[1], wanted[2], mode, acted, m[0], m[1]
    force = backup_turning(state, mode, now, g, w)
    if g.least != 0.0:
        a = margins_after(state, force, mode, following, c, g, w)
        b = margins_after(state, wanted, mode, following, c, g, w)
        first, second = share_within(a[0], b[0]), share_within(a[1], b[1])
        found = between(force, wanted, first if first < second else second)
        n = margins_after(state, found, mode, following, c, g, w)
        if n[0] >= 0.0 and n[1] >= 0.0:
            force = found
    return force[0], force[1], force[2], mode, acted, m[0], m[1]
