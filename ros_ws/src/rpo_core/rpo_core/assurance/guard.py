# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The constants of the proof (docs/safety.md), from a scenario and its section `assurance`."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any, NamedTuple

from rpo_core.assurance.assumed import SQRT_3, Errors, ahead, errors_of, limit_n, unknown_n
from rpo_core.assurance.doubt import most_m
from rpo_core.assurance.edge import speed_floor, within_domain
from rpo_core.assurance.kernels import FAR, Guard, speed_limit
from rpo_core.assurance.settings import LEAST_CHANGE, Assurance
from rpo_core.assurance.walls import NO_CORRIDOR, standing, turning
from rpo_core.files.validation import InputError

BRAKE_SHARE = 0.95
"""Share of a thruster axis that the backup law may push along the range; 0.31 is left across."""

SLACK = 0.9
"""Share of the sure deceleration that the speed limit may ask for."""

_TRIALS = 20


class Proof(NamedTuple):
    """The numbers of the filter, what they assume, and the speed that is kept for certain.

    floor_m_s : the true speed stays below the limit, or this (docs/safety.md, lemma 3)
    walls : numbers of the corridor in the axes of a target that turns; None: as `guard` has them
    """

    guard: Guard
    errors: Errors
    floor_m_s: float
    walls: Guard | None = None


def guard_of(settings: Assurance, scenario: Any) -> Guard:
    """Return the numbers of the filter; raises InputError if constraints exclude each other."""
    return proof_of(settings, scenario).guard


@lru_cache(maxsize=64)
def proof_of(settings: Assurance, scenario: Any) -> Proof:
    """Return the constants of the proof; raises InputError if constraints exclude each other.

    The largest speed near the zone is that of the limit, or the one that is kept for certain, which
    depends on it: the first that is large enough.
    """
    errors = errors_of(settings, scenario)
    speed, zone = settings.speed, settings.keep_out_m
    top = speed.speed_m_s + speed.slope(scenario.mean_motion_rad_s) * zone
    top += math.sqrt(2.0 * speed.deceleration_m_s2 * zone)
    for _ in range(_TRIALS):
        guard = _guard(settings, scenario, errors, top)
        push = _zone_push(guard, settings)
        floor = speed_floor(guard, errors, settings, scenario, *push, 0.0)
        if floor == math.inf:
            break
        if zone > 0.0 and floor > top:
            top = 1.01 * floor
            continue
        if zone > 0.0:
            guard, floor = within_domain(guard, floor, push, errors, settings, scenario)
        if settings.corridor is None or scenario.target is None:
            return Proof(guard, errors, floor)
        walls = turning(guard, settings, scenario, errors)
        own = {name: getattr(walls, name) for name in NO_CORRIDOR}
        own['port_m'] = settings.corridor.port_m
        return Proof(guard._replace(**own), errors, floor, walls)
    raise InputError(
        f'`assurance` and `max_force_n` exclude each other: with errors of '
        f'{errors.position_m:.6g} m and {errors.velocity_m_s:.6g} m/s no speed is kept for certain'
    )


def _guard(settings: Assurance, scenario: Any, errors: Errors, top: float) -> Guard:
    """Return the numbers of the filter, if near the zone no speed is larger than `top` [m/s]."""
    limit, mass, dt = limit_n(scenario), errors.mass_kg, scenario.dt_s
    n2 = scenario.mean_motion_rad_s * scenario.mean_motion_rad_s
    delay = scenario.thrusters.delay_ticks if scenario.thrusters else 0
    here, following = ahead(errors, scenario, delay), ahead(errors, scenario, delay + 1)
    zone, speed = settings.keep_out_m, settings.speed
    per_range = speed.slope(scenario.mean_motion_rad_s)
    brake = (BRAKE_SHARE if zone > 0.0 else 1.0) * limit
    off = errors.thrust * limit + errors.disturbance_n
    widest = errors._replace(position_m=most_m(settings, scenario, errors))
    dip, kappa = _between_ticks(errors, scenario, zone, top, ahead(widest, scenario, delay))
    sure = (brake * (1.0 - 0.5 * kappa * kappa) - kappa * limit - off) / mass
    slowing = SLACK * ((brake - off) / mass - 3.0 * n2 * settings.domain_m)
    _check_speed(speed, per_range, slowing, sure - n2 * settings.domain_m, settings)
    square = per_range * per_range
    knee = (slowing - per_range * speed.speed_m_s) / square if square > 0.0 else FAR
    return Guard(
        dt_s=dt,
        mass_kg=mass,
        limit_n=limit,
        slew_n=(settings.slew_n_s or 0.0) * dt,
        least=1.0 if settings.filter == LEAST_CHANGE else 0.0,
        keep_out_m=zone + dip if zone > 0.0 else 0.0,
        brake_n=brake,
        authority_m_s2=sure,
        tide_1_s2=n2,
        speed_m_s=speed.speed_m_s,
        speed_1_s=per_range,
        deceleration_m_s2=speed.deceleration_m_s2,
        slowing_m_s2=slowing,
        knee_m=knee,
        domain_m=settings.domain_m,
        top_m_s=FAR,
        edge_m_s2=1.0,
        here_m=here[0],
        here_m_s=here[1],
        next_m=following[0],
        next_m_s=following[1],
        **_corridor(settings, scenario, errors, here, following),
    )


def _zone_push(g: Guard, settings: Assurance) -> tuple[float, float]:
    """Return the error of the closing speed [m/s] near the zone, and what the authority leaves out.

    A chaser that recedes may be pushed by that thrust [N] along the range.
    """
    near = g.keep_out_m - g.here_m
    top = speed_limit(g.keep_out_m, g) + g.here_m_s
    doubt = g.here_m_s + (top * g.here_m / near if near > 0.0 else 0.0)
    return doubt, g.brake_n - g.mass_kg * (g.authority_m_s2 - g.tide_1_s2 * settings.domain_m)


def _between_ticks(
    errors: Errors, scenario: Any, zone_m: float, top_m_s: float, here: tuple[float, float]
) -> tuple[float, float]:
    """Return how far a path may dip below both ends of a tick [m], and a bound of the chord.

    The chord is the change of the direction to the target between the one that the filter uses and
    the true one at any time of the tick. docs/safety.md, "Between the ticks".
    """
    if zone_m <= 0.0:
        return 0.0, 0.0
    dt, n = scenario.dt_s, scenario.mean_motion_rad_s
    force = SQRT_3 * limit_n(scenario) + unknown_n(errors, scenario)
    most = force / errors.mass_kg + 3.0 * n * n * zone_m + 2.0 * n * top_m_s
    bend = most + top_m_s * top_m_s / zone_m
    moved = here[0] + (top_m_s + here[1]) * dt + 0.5 * most * dt * dt
    if moved >= 0.5 * zone_m:
        raise InputError(
            f'`assurance.keep_out_m` and the assumed errors, or the way of a tick by `speed`, '
            'exclude each other: the direction to the target must be known to half the radius, '
            f'{0.5 * zone_m:.6g} m; got {moved:.6g} m'
        )
    return bend * dt * dt / 8.0, moved / (zone_m - moved)


def _check_speed(
    speed: Any, per_range: float, slowing: float, sure: float, settings: Assurance
) -> None:
    """Refuse limits that the thrusters cannot keep."""
    if min(slowing, sure) <= 0.0:
        raise InputError(
            '`assurance` must leave the thrusters something to brake with; the assumed errors '
            f'and tides up to domain_m = {settings.domain_m!r} m take all of it: '
            f'{min(slowing, sure):.6g} m/s^2 are left'
        )
    asked = max(speed.deceleration_m_s2, per_range * speed.speed_m_s)
    if asked >= slowing:
        raise InputError(
            f'`assurance.speed` and `max_force_n` exclude each other: the limit asks for '
            f'{asked:.6g} m/s^2, and {slowing:.6g} m/s^2 are sure'
        )


def _corridor(
    settings: Assurance,
    scenario: Any,
    errors: Errors,
    here: tuple[float, float],
    following: tuple[float, float],
) -> dict[str, Any]:
    """Return the corridor's part of the numbers; of one that turns, `turning` has them."""
    way = settings.corridor
    if way is None or scenario.target is not None:
        return NO_CORRIDOR
    return standing(way, scenario, errors, here, following, settings)
