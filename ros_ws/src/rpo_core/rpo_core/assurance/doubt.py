# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""An error of navigation that grows with the spread of an estimator. docs/safety.md, lemma 8.

The sets are of true states, so they stay; what is tested, and what the backup law takes for the
worst, has the error of the tick.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from rpo_core.assurance.assumed import Errors, spreading
from rpo_core.assurance.guard import follows, most_m, swing_of
from rpo_core.assurance.kernels import APPROACH, CONTACT, Guard, backup_open, in_corridor
from rpo_core.assurance.manoeuvre import RETREAT_M_S
from rpo_core.assurance.settings import Assurance
from rpo_core.attitude.attitude_kernels import Frame, seen_from, to_lvlh
from rpo_core.kernels.arithmetic import State, Vector, norm, saturate
from rpo_core.kernels.jit import inlined, kernel


class Doubt(NamedTuple):
    """What an estimator's spread adds to the errors of a guard.

    sigmas : so many of them count as an error; 0.0: the spread is not looked at
    position_m, velocity_m_s : errors that the guard has without
    most_m : error of position up to which the zone is kept
    turns_rad_s : largest rate of the corridor's axes
    here_rr, here_rv, here_vr, here_vv : growth of errors of position and velocity until the command
        acts, `assumed.spreading`; next_rr and following: until one tick later
    """

    sigmas: float
    position_m: float
    velocity_m_s: float
    most_m: float
    turns_rad_s: float
    here_rr: float
    here_rv: float
    here_vr: float
    here_vv: float
    next_rr: float
    next_rv: float
    next_vr: float
    next_vv: float


def doubt_of(settings: Assurance, scenario: Any, errors: Errors) -> Doubt:
    """Return what the spread of a scenario's estimator adds to the errors of its guard."""
    delay = scenario.thrusters.delay_ticks if scenario.thrusters else 0
    turns = settings.corridor is not None and scenario.target is not None
    return Doubt(
        settings.sigmas if follows(settings, scenario) else 0.0,
        errors.position_m,
        errors.velocity_m_s,
        most_m(settings, scenario, errors),
        norm(*swing_of(scenario).rate_rad_s) if turns else 0.0,
        *spreading(errors, scenario, delay),
        *spreading(errors, scenario, delay + 1),
    )


@kernel
def doubted(g: Guard, d: Doubt, turns_rad_s: float, spread_m: float, spread_m_s: float) -> Guard:
    """Return a guard whose errors are at least so many sigmas of a spread.

    turns_rad_s : largest rate of the axes in which its velocities are
    spread_m, spread_m_s : roots of the traces of the covariances of position and velocity
    """
    r, v = d.sigmas * spread_m - d.position_m, d.sigmas * spread_m_s - d.velocity_m_s
    r, v = r if r > 0.0 else 0.0, v if v > 0.0 else 0.0
    here, after = d.here_rr * r + d.here_rv * v, d.next_rr * r + d.next_rv * v
    # fmt: off
    return Guard(
        g.dt_s, g.mass_kg, g.limit_n, g.slew_n, g.least, g.keep_out_m, g.brake_n,
        g.authority_m_s2, g.tide_1_s2, g.speed_m_s, g.speed_1_s, g.deceleration_m_s2,
        g.slowing_m_s2, g.knee_m, g.domain_m, g.top_m_s, g.edge_m_s2,
        g.here_m + here, g.here_m_s + (d.here_vr * r + d.here_vv * v + turns_rad_s * here),
        g.next_m + after, g.next_m_s + (d.next_vr * r + d.next_vv * v + turns_rad_s * after),
        g.axis, g.side, g.port_m, g.outer_m, g.width_m, g.slope, g.contact_m_s, g.lateral_m_s,
        g.lateral_1_s, g.wall_m_s2, g.doubt_m_s2,
    )
    # fmt: on


@inlined
def unsure(state: State, g: Guard) -> bool:
    """Whether a state is known too badly for the corridor: `retreat` shall act.

    state, g : as its set has them, `g` with the errors of the tick
    """
    distance, closes, _, _, _, _ = in_corridor(state, g)
    near = distance - g.here_m
    half = g.width_m + g.slope * (near if near > 0.0 else 0.0)
    narrow = g.slope * ((closes if closes > 0.0 else 0.0) + g.next_m_s) + 2.0 * g.next_m_s
    room = g.next_m * (1.0 + g.slope) + narrow * narrow / g.wall_m_s2
    return bool(room >= half)


@inlined
def retreat(state: State, g: Guard) -> Vector:
    """Force [N] that leaves the corridor backwards, without moving across it; as `unsure`.

    From farther off the chaser sees the port. Slower, hostile torques turn the camera away until
    what was not known of the speed has led out of the corridor.
    """
    _, closes, _, _, across, other = in_corridor(state, g)
    stop = g.mass_kg / g.dt_s
    out = g.side * saturate(stop * (closes + RETREAT_M_S), g.limit_n)
    fp, fq = saturate(-stop * across, g.limit_n), saturate(-stop * other, g.limit_n)
    if g.axis == 0:
        return out, fp, fq
    if g.axis == 1:
        return fq, out, fp
    return fp, fq, out


@kernel
def unless_unsure(
    state: State,
    command: Vector,
    mode: int,
    turns: int,
    now: Frame,
    g: Guard,
    w: Guard,
    d: Doubt,
    spread_m: float,
) -> tuple[bool, Vector]:
    """Return whether a state is known too badly, and the command, or what acts instead [N].

    turns, now, g, w : as in `assurance.filters`, with the errors of the tick
    """
    if mode == CONTACT or d.sigmas == 0.0:
        return False, command
    if mode != APPROACH:
        if d.sigmas * spread_m > d.most_m:
            return True, backup_open(state, g)
        return False, command
    seen = seen_from(state, now) if turns != 0 else state
    if not unsure(seen, w):
        return False, command
    return True, to_lvlh(retreat(seen, w), now) if turns != 0 else retreat(seen, w)
