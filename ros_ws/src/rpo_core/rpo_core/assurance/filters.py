# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The filter: the backup law instead of a command (Simplex), or the least change of it.

What it finds is tested before it acts, so that the proof (docs/safety.md) needs only that test and
the backup laws. Where the target turns, and with it the corridor (lemma 5), the OPEN set stays in
LVLH. The APPROACH set is in the target's axes, velocities against them: `w` has its numbers there,
`g` those of the OPEN set and the true place of the port; now, following : axes of the target in the
tick in which the force acts, and one later.
"""

from __future__ import annotations

from rpo_core.assurance.kernels import (
    APPROACH,
    CONTACT,
    FAR,
    LARGEST,
    OPEN,
    Guard,
    approach_margins,
    at_port,
    authority,
    backup_approach,
    backup_open,
    both_margins,
    closing,
    fastest_after,
    in_corridor,
    open_margins,
)
from rpo_core.attitude.attitude_kernels import Frame, seen_from, to_lvlh
from rpo_core.kernels.arithmetic import State, Vector, saturate
from rpo_core.kernels.jit import kernel
from rpo_core.world.cw import CwStep, cw_step

NOTHING, FORCE, SLEW, SPEED, KEEP_OUT, CORRIDOR, NOT_FINITE, DOMAIN = range(8)
"""Constraints by their number; NOTHING: the command acts as it came."""


@kernel
def push_within(force: Vector, e: Vector, more: float, limit: float) -> Vector:
    """Least change of a force in the box of the thrusters that adds `more` [N] along unit e."""
    x, y, z = force
    for _ in range(3):
        ex = e[0] if (x < limit if e[0] > 0.0 else x > -limit) else 0.0
        ey = e[1] if (y < limit if e[1] > 0.0 else y > -limit) else 0.0
        ez = e[2] if (z < limit if e[2] > 0.0 else z > -limit) else 0.0
        free = ex * ex + ey * ey + ez * ez
        if free < 1e-12 or more <= 0.0:
            break
        nx = saturate(x + more / free * ex, limit)
        ny = saturate(y + more / free * ey, limit)
        nz = saturate(z + more / free * ez, limit)
        more -= (nx - x) * e[0] + (ny - y) * e[1] + (nz - z) * e[2]
        x, y, z = nx, ny, nz
    return x, y, z


@kernel
def margins(
    state: State, mode: int, error_m: float, error_m_s: float, g: Guard
) -> tuple[float, float]:
    """Margins of a mode: in position [m] and in speed [m/s]; neither negative: in its set."""
    if mode == APPROACH:
        return approach_margins(state, error_m, error_m_s, g)
    return open_margins(state, error_m, error_m_s, g)


@kernel
def first_mode(state: State, g: Guard) -> int:
    """Mode in which a flight begins, or goes on after a gap."""
    m = open_margins(state, 0.0, 0.0, g)
    if g.side == 0.0 or (m[0] >= 0.0 and m[1] >= 0.0):
        return OPEN
    m = approach_margins(state, 0.0, 0.0, g)
    return APPROACH if m[0] >= 0.0 and m[1] >= 0.0 else OPEN


@kernel
def nearest(state: State, force: Vector, c: CwStep, g: Guard) -> Vector:
    """Least change of a force after which the next state is in the OPEN set.

    Exact for one constraint, up to a thousandth. Where both act, and where that leaves the box of
    the thrusters, the caller looks on towards the backup law.
    """
    over = 1.001
    after = cw_step(state, force, c)
    _, slower = open_margins(after, g.next_m, g.next_m_s, g)
    if slower < 0.0:
        speed = closing(after)[2]
        k = over * slower * g.mass_kg / (g.dt_s * speed) if speed > 0.0 else 0.0
        force = (
            saturate(force[0] + k * after[3], g.limit_n),
            saturate(force[1] + k * after[4], g.limit_n),
            saturate(force[2] + k * after[5], g.limit_n),
        )
        after = cw_step(state, force, c)
    keep, left, _ = both_margins(after, g.next_m, g.next_m_s, g)
    rho, closes, speed = closing(after)
    near = rho - g.next_m
    if (keep < 0.0 or left < 0.0) and near > 0.0:
        doubt = g.next_m_s + speed * g.next_m / near
        if keep < 0.0:
            a, gap, closes = authority(rho + g.next_m, g), near - g.keep_out_m, closes + doubt
            e = (after[0] / rho, after[1] / rho, after[2] / rho)
        else:
            a, gap, closes = g.edge_m_s2, g.domain_m - rho - g.next_m, doubt - closes
            e = (-after[0] / rho, -after[1] / rho, -after[2] / rho)
        w = fastest_after(gap + closes * g.dt_s, closes, a, g.dt_s)
        more = over * g.mass_kg * (closes - (w if w > 0.0 else 0.0)) / g.dt_s + 1e-9
        force = push_within(force, e, more, g.limit_n)
    return force


@kernel
def between(start: Vector, end: Vector, share: float) -> Vector:
    """Force that lies a share of the way from one to another."""
    return (
        start[0] + share * (end[0] - start[0]),
        start[1] + share * (end[1] - start[1]),
        start[2] + share * (end[2] - start[2]),
    )


@kernel
def share_within(safe: float, wanted: float) -> float:
    """Share of the way from a margin >= 0 to another at which it is still >= 0."""
    if wanted >= 0.0:
        return 1.0
    return 0.999 * safe / (safe - wanted) if safe > 0.0 else 0.0


@kernel
def finite(a: float, b: float, c: float) -> bool:
    """Whether three numbers are finite, and their squares too."""
    return abs(a) < LARGEST and abs(b) < LARGEST and abs(c) < LARGEST


@kernel
def within_limits(command: Vector, last: Vector, g: Guard) -> tuple[float, float, float, int]:
    """Command within the limits of force and slew, and which of them it broke."""
    x, y, z = command
    if not finite(x, y, z):
        return 0.0, 0.0, 0.0, NOT_FINITE
    fx, fy, fz = saturate(x, g.limit_n), saturate(y, g.limit_n), saturate(z, g.limit_n)
    broke = FORCE if fx != x or fy != y or fz != z else NOTHING
    if g.slew_n > 0.0:
        x, y, z = fx, fy, fz
        fx = last[0] + saturate(x - last[0], g.slew_n)
        fy = last[1] + saturate(y - last[1], g.slew_n)
        fz = last[2] + saturate(z - last[2], g.slew_n)
        broke = SLEW if fx != x or fy != y or fz != z else broke
    return fx, fy, fz, broke


@kernel
def margins_after(
    state: State,
    force: Vector,
    mode: int,
    turns: int,
    following: Frame,
    c: CwStep,
    g: Guard,
    w: Guard,
) -> tuple[float, float]:
    """Margins [m], [m/s] to the set of a mode, one tick after a state with a force."""
    after = cw_step(state, force, c)
    if mode != APPROACH:
        return open_margins(after, g.next_m, g.next_m_s, g)
    after = seen_from(after, following) if turns != 0 else after
    return approach_margins(after, w.next_m, w.next_m_s, w)


@kernel
def backup(state: State, mode: int, turns: int, now: Frame, g: Guard, w: Guard) -> Vector:
    """Backup law [N] of a mode. In a corridor that turns it stops what recedes too, as it must.

    That push inward is at most what may push the chaser outward: it never gets faster.
    """
    if mode != APPROACH:
        return backup_open(state, g)
    if turns == 0:
        return backup_approach(state, w)
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
def assure(
    state: State,
    command: Vector,
    last: Vector,
    mode: int,
    turns: int,
    now: Frame,
    following: Frame,
    c: CwStep,
    g: Guard,
    w: Guard,
) -> tuple[float, float, float, int, int, float, float]:
    """Force (3) [N] that keeps the assured set; mode, constraint that acted, margins [m], [m/s].

    state : as it is known for the tick in which the force will act
    last : the force before, for the slew limit
    mode : the set in which the chaser is
    turns : 1 where the corridor turns; if it does not, w is g, and nobody reads the axes
    The margins are those that the command as it came would leave one tick later.
    """
    fx, fy, fz, broke = within_limits(command, last, g)
    if not (finite(state[0], state[1], state[2]) and finite(state[3], state[4], state[5])):
        return 0.0, 0.0, 0.0, mode, NOT_FINITE, -FAR, -FAR
    seen = seen_from(state, now) if turns != 0 else state
    # Contact begins where all true states are at the port, and is over where none is. The port of
    # `w` lies before the true one by as much as may lie behind it.
    beyond = w.here_m + 2.0 * (w.port_m - g.port_m)
    if mode == CONTACT and w.side != 0.0 and not at_port(seen, -w.here_m, w):
        mode = APPROACH
    if mode == APPROACH and at_port(seen, beyond, w):
        mode = CONTACT
    if mode == CONTACT:
        return fx, fy, fz, CONTACT, broke, FAR, FAR
    if mode == APPROACH and open_margins(state, g.here_m, g.here_m_s, g)[0] >= 0.0:
        mode = OPEN
    wanted = (fx, fy, fz)
    m = margins_after(state, wanted, mode, turns, following, c, g, w)
    if m[0] >= 0.0 and m[1] >= 0.0:
        return fx, fy, fz, mode, broke, m[0], m[1]
    if w.side != 0.0:
        other = OPEN if mode == APPROACH else APPROACH
        o = margins_after(state, wanted, other, turns, following, c, g, w)
        # The place of now too: between two places of one mode, the path stays clear of the zone.
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
        n = margins_after(state, wanted, mode, turns, following, c, g, w)
        if n[0] >= 0.0 and n[1] >= 0.0:
            return wanted[0], wanted[1], wanted[2], mode, acted, m[0], m[1]
    force = backup(state, mode, turns, now, g, w)
    if g.least != 0.0:  # as near to what is wanted as the set allows
        a = margins_after(state, force, mode, turns, following, c, g, w)
        b = margins_after(state, wanted, mode, turns, following, c, g, w)
        first, second = share_within(a[0], b[0]), share_within(a[1], b[1])
        between_both = between(force, wanted, first if first < second else second)
        n = margins_after(state, between_both, mode, turns, following, c, g, w)
        if n[0] >= 0.0 and n[1] >= 0.0:
            force = between_both
    return force[0], force[1], force[2], mode, acted, m[0], m[1]
