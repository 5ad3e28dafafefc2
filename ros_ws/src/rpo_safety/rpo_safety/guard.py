# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The constants of the proof (docs/safety.md), from a scenario and its section `assurance`."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from rpo_core import cw
from rpo_core.disturbance import Disturbance
from rpo_core.navigation import Navigation
from rpo_core.stage import Place, section_of
from rpo_core.thrusters import IDENTITY, Thrusters
from rpo_core.validation import InputError
from rpo_safety.kernels import Guard, speed_limit
from rpo_safety.settings import LEAST_CHANGE, Assurance, Corridor

ROUNDING_M = 1e-6
"""Covers the rounding of the kernels, below 1e-9 m in 1 km; added to the error of a position."""

BRAKE_SHARE = 0.95
"""Share of a thruster axis that the backup law may push along the range; 0.31 is left across."""

SLACK = 0.9
"""Share of the sure deceleration that the speed limit may ask for."""

SQRT_3 = math.sqrt(3.0)
_TRIALS = 20

GROWTH = 1.25
"""Steps in which the assumed errors grow with the covariance of an estimator."""

_MOST_GROWN = 40

LARGEST_NORMAL = math.sqrt(2.0) * math.sqrt(66.0 * math.log(2.0))
"""No three normals of `rpo_core.noise` have a larger norm: their words are at least 1/2^33."""


class Errors(NamedTuple):
    """Largest norms: position [m], velocity [m/s], disturbance [N], thrust (share of a force).

    mass_kg : as the filter takes it
    """

    position_m: float
    velocity_m_s: float
    disturbance_n: float
    thrust: float
    mass_kg: float


def largest_n(disturbance: Disturbance) -> float:
    """Return a bound of the norm [N] of a disturbance at any time."""
    axes = dict(zip('xyz', map(abs, disturbance.constant_n), strict=True))
    for term in disturbance.harmonics:
        axes[term.axis] += abs(term.amplitude_n)
    return math.sqrt(sum(value * value for value in axes.values()))


def errors_of(settings: Assurance, scenario: Any) -> Errors:
    """Return what the proof assumes: what the section says, else what the scenario has.

    Raises InputError if the section assumes less than the scenario has, or says nothing where the
    scenario has sensors, thrusters or dynamics whose errors are not known beforehand.
    """
    navigation = scenario.navigation or Navigation()
    mass_kg = settings.mass_kg or scenario.mass_kg
    own = {
        'position_error_m': _norm(navigation.position_bias_m)
        + LARGEST_NORMAL * navigation.position_noise_m,
        'velocity_error_m_s': _norm(navigation.velocity_bias_m_s)
        + LARGEST_NORMAL * navigation.velocity_noise_m_s,
        'disturbance_n': largest_n(scenario.disturbance) * mass_kg / scenario.mass_kg,
        'thrust_error': _thrust_error(scenario, mass_kg / scenario.mass_kg),
    }
    for name, bound in own.items():
        given, reason = getattr(settings, name), _why_unknown(name, scenario)
        if reason and given is None:
            raise InputError(f'`assurance.{name}` is missing; section `{reason}` needs it')
        if not reason and given is not None and given < bound:
            raise InputError(
                f'`assurance.{name}` must be at least {bound:.6g}, which the scenario has; '
                f'got {given!r}'
            )
        own[name] = bound if given is None else given
    return Errors(**dict(zip(Errors._fields, (*own.values(), mass_kg), strict=True)))


def _why_unknown(name: str, scenario: Any) -> str:
    """Return the section whose part of a bound is not known beforehand; '' if there is none."""
    if name.startswith(('position', 'velocity')):
        seeing = [s for s in scenario.sections if section_of(s).place <= Place.ESTIMATOR]
        return next((section_of(s).name for s in seeing if not isinstance(s, Navigation)), '')
    if name == 'disturbance_n':
        return 'dynamics' if scenario.dynamics is not None else ''
    own = scenario.thrusters
    plain = own is None or own == Thrusters(matrix=own.matrix, delay_ticks=own.delay_ticks)
    return '' if plain else 'thrusters'


def _norm(values: Any) -> float:
    return math.sqrt(sum(value * value for value in values))


def _thrust_error(scenario: Any, lighter: float) -> float:
    """Return a bound of |T f - f| / |f|: of T - 1 the norm of Frobenius, or sqrt(rows x columns).

    lighter : mass as the filter takes it, over what it is; forces act by so much more
    """
    rows = scenario.thrusters.matrix if scenario.thrusters is not None else IDENTITY
    off = [[lighter * rows[i][j] - (i == j) for j in range(3)] for i in range(3)]
    return min(_norm(value for row in off for value in row), _block(np.array(off), 0, 0))


def ahead(errors: Errors, scenario: Any, ticks: int) -> tuple[float, float]:
    """Return bounds of the error [m], [m/s] of a state predicted some ticks ahead.

    The error at hand grows as the state does, by the CW transition; disturbance and thrust error
    add to it for as long. Norms of blocks are bounded by sqrt(row sum x column sum).
    """
    t = ticks * scenario.dt_s
    if not ticks:
        return errors.position_m + ROUNDING_M, errors.velocity_m_s
    state, _ = cw.matrices(cw.discretise(scenario.mean_motion_rad_s, errors.mass_kg, t))
    rr, rv, vr, vv = (_block(state, i, j) for i in (0, 3) for j in (0, 3))
    a = _unknown_n(errors, scenario) / errors.mass_kg
    return (
        rr * errors.position_m + rv * errors.velocity_m_s + rv * t * a / 2.0 + ROUNDING_M,
        vr * errors.position_m + vv * errors.velocity_m_s + vv * t * a,
    )


def _unknown_n(errors: Errors, scenario: Any) -> float:
    """Return the largest force [N] that a prediction does not know, under any command."""
    return errors.disturbance_n + errors.thrust * SQRT_3 * float(scenario.max_force_n)


def _block(matrix: Any, i: int, j: int) -> float:
    rows = [[abs(float(matrix[i + a, j + b])) for b in range(3)] for a in range(3)]
    return math.sqrt(max(map(sum, rows)) * max(map(sum, zip(*rows, strict=True))))


class Proof(NamedTuple):
    """The numbers of the filter, what they assume, and the speed that is kept for certain.

    floor_m_s : the true speed stays below the limit, or this (docs/safety.md, lemma 3)
    """

    guard: Guard
    errors: Errors
    floor_m_s: float


def guard_of(settings: Assurance, scenario: Any) -> Guard:
    """Return the numbers of the filter; raises InputError if constraints exclude each other."""
    return proof_of(settings, scenario).guard


def proof_of(settings: Assurance, scenario: Any, errors: Errors | None = None) -> Proof:
    """Return the constants of the proof; raises InputError if constraints exclude each other.

    errors : None: those of the section and the scenario

    The largest speed near the zone is that of the limit, or the one that is kept for certain, which
    depends on it: the first that is large enough.
    """
    errors = errors or errors_of(settings, scenario)
    speed, zone = settings.speed, settings.keep_out_m
    top = speed.speed_m_s + speed.slope(scenario.mean_motion_rad_s) * zone
    top += math.sqrt(2.0 * speed.deceleration_m_s2 * zone)
    for _ in range(_TRIALS):
        guard = _guard(settings, scenario, errors, top)
        floor = _speed_floor(guard, errors, settings, scenario)
        if floor <= top or zone <= 0.0:
            return Proof(guard, errors, floor)
        top = 1.01 * floor
    raise InputError(
        '`assurance.velocity_error_m_s` and `max_force_n` exclude each other: with errors of '
        f'{errors.position_m:.6g} m and {errors.velocity_m_s:.6g} m/s no speed is kept for certain'
    )


def grown(settings: Assurance, scenario: Any) -> list[Proof]:
    """Return the constants for larger and larger errors of the state, as far as there are any.

    Each of GROWTH times the errors before. The first are those of `proof_of`. Where the errors
    become too large for the corridor, it is shut: those that follow have none.
    """
    proofs = [proof_of(settings, scenario)]
    for _ in range(_MOST_GROWN):
        errors = proofs[-1].errors
        wider = errors._replace(
            position_m=GROWTH * errors.position_m, velocity_m_s=GROWTH * errors.velocity_m_s
        )
        found = _proof_or_none(settings, scenario, wider)
        if found is None:
            settings = replace(settings, corridor=None)
            found = _proof_or_none(settings, scenario, wider)
        if found is None:
            break
        proofs.append(found)
    return proofs


def _proof_or_none(settings: Assurance, scenario: Any, errors: Errors) -> Proof | None:
    """Return the constants; None where the errors are too large for the constraints."""
    try:
        return proof_of(settings, scenario, errors)
    except InputError:
        return None


def _guard(settings: Assurance, scenario: Any, errors: Errors, top: float) -> Guard:
    """Return the numbers of the filter, if near the zone no speed is larger than `top` [m/s]."""
    limit, mass, dt = float(scenario.max_force_n), errors.mass_kg, scenario.dt_s
    n2 = scenario.mean_motion_rad_s * scenario.mean_motion_rad_s
    delay = scenario.thrusters.delay_ticks if scenario.thrusters else 0
    here, following = ahead(errors, scenario, delay), ahead(errors, scenario, delay + 1)
    zone, speed = settings.keep_out_m, settings.speed
    per_range = speed.slope(scenario.mean_motion_rad_s)
    brake = (BRAKE_SHARE if zone > 0.0 else 1.0) * limit
    off = errors.thrust * limit + errors.disturbance_n
    dip, kappa = _between_ticks(errors, scenario, zone, top, here)
    sure = (brake * (1.0 - 0.5 * kappa * kappa) - kappa * limit - off) / mass
    slowing = SLACK * ((brake - off) / mass - 3.0 * n2 * settings.domain_m)
    _check_speed(speed, per_range, slowing, sure - n2 * settings.domain_m, settings)
    knee = (slowing - per_range * speed.speed_m_s) / (per_range * per_range) if per_range else 1e30
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
        here_m=here[0],
        here_m_s=here[1],
        next_m=following[0],
        next_m_s=following[1],
        **_corridor(settings.corridor, scenario, errors, following, settings),
    )


def _speed_floor(g: Guard, errors: Errors, settings: Assurance, scenario: Any) -> float:
    """Return the speed [m/s] above which the backup law brakes for certain.

    Errors of navigation make it push where it should brake; above this speed the chaser loses
    energy all the same. docs/safety.md, lemma 3.
    """
    m, dt, n = g.mass_kg, g.dt_s, scenario.mean_motion_rad_s
    off = errors.disturbance_n + errors.thrust * g.limit_n + 3.0 * m * n * n * settings.domain_m
    left = math.sqrt(g.limit_n * g.limit_n - g.brake_n * g.brake_n)
    left = left if g.keep_out_m > 0.0 else g.limit_n
    near = g.keep_out_m - g.here_m
    top = speed_limit(g.keep_out_m, g) + g.here_m_s
    doubt = g.here_m_s + (top * g.here_m / near if near > 0.0 else 0.0)
    spare = g.brake_n - m * (g.authority_m_s2 - g.tide_1_s2 * settings.domain_m)
    pushed = doubt + spare * dt / m
    second = g.brake_n * (g.brake_n - m * g.slowing_m_s2) + left * left
    second = 0.5 * dt / m * (second + off * (2.0 * g.limit_n + off))
    cost = g.here_m_s * g.limit_n + m * g.slowing_m_s2 * doubt + second
    along, across = g.brake_n - off - m * g.slowing_m_s2, left - off
    if min(along, across) <= 0.0:
        return math.inf
    receding = (pushed * (g.brake_n + off) + cost) / across
    return g.here_m_s + max(cost / min(along, across), math.hypot(receding, pushed))


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
    force = SQRT_3 * float(scenario.max_force_n) + _unknown_n(errors, scenario)
    most = force / errors.mass_kg + 3.0 * n * n * zone_m + 2.0 * n * top_m_s
    bend = most + top_m_s * top_m_s / zone_m
    moved = here[0] + (top_m_s + here[1]) * dt + 0.5 * most * dt * dt
    if moved >= 0.5 * zone_m:
        raise InputError(
            '`assurance.keep_out_m` and the errors exclude each other: the direction to the target '
            f'must be known to half the radius, {0.5 * zone_m:.6g} m; got {moved:.6g} m'
        )
    return bend * dt * dt / 8.0, moved / (zone_m - moved)


def _check_speed(
    speed: Any, per_range: float, slowing: float, sure: float, settings: Assurance
) -> None:
    """Refuse limits that the thrusters cannot keep."""
    if min(slowing, sure) <= 0.0:
        raise InputError(
            '`assurance` must leave the thrusters something to brake with; disturbance, errors and '
            f'tides up to domain_m = {settings.domain_m!r} m take all of it: '
            f'{min(slowing, sure):.6g} m/s^2 are left'
        )
    asked = max(speed.deceleration_m_s2, per_range * speed.speed_m_s)
    if asked >= slowing:
        raise InputError(
            f'`assurance.speed` and `max_force_n` exclude each other: the limit asks for '
            f'{asked:.6g} m/s^2, and {slowing:.6g} m/s^2 are sure'
        )


def _corridor(
    way: Corridor | None,
    scenario: Any,
    errors: Errors,
    following: tuple[float, float],
    settings: Assurance,
) -> dict[str, Any]:
    """Return the corridor's part of the numbers."""
    if way is None:
        return {
            'axis': 0, 'side': 0.0, 'port_m': 0.0, 'outer_m': 0.0, 'width_m': 0.0, 'slope': 0.0,
            'contact_m_s': 0.0, 'lateral_m_s': 0.0, 'lateral_1_s': 0.0, 'wall_m_s2': 1.0,
            'doubt_m_s2': 0.0,
        }  # fmt: skip
    n, dt, mass = scenario.mean_motion_rad_s, scenario.dt_s, errors.mass_kg
    speed = settings.speed
    top = speed.speed_m_s + speed.slope(n) * way.outer_m
    top += math.sqrt(2.0 * speed.deceleration_m_s2 * way.outer_m)
    doubt = _unknown_n(errors, scenario) / mass + 3.0 * n * n * way.outer_m + 2.0 * n * top
    slope = way.slope
    per_axis = float(scenario.max_force_n) / mass
    wall = per_axis - (1.0 + slope) * doubt
    dip = (1.0 + slope) * (per_axis + doubt) * dt * dt / 8.0
    width = way.width_m - dip
    narrow = slope * (way.closing_m_s + following[1]) + 2.0 * following[1]
    room = following[0] * (1.0 + slope) + (narrow * narrow) / (2.0 * max(wall, 1e-9)) + 2.0 * dip
    if wall <= 0.0 or room >= width:
        raise InputError(
            '`assurance.corridor` and the errors exclude each other: at the port, to stop between '
            f'the walls takes {room:.6g} m to each side, and `width_m` leaves {width:.6g} m'
        )
    return {
        'axis': 'xyz'.index(way.along[1]),
        'side': 1.0 if way.along[0] == '+' else -1.0,
        'port_m': way.port_m,
        'outer_m': way.outer_m,
        'width_m': width,
        'slope': slope,
        'contact_m_s': way.closing_m_s,
        'lateral_m_s': way.lateral_m_s,
        'lateral_1_s': 0.02,
        'wall_m_s2': wall,
        'doubt_m_s2': (1.0 + slope) * doubt,
    }
