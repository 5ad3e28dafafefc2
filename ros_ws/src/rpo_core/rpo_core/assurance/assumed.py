# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What the proof (docs/safety.md) may assume of a scenario, and how errors grow in a prediction.

A bound of an error that no section says as a whole is reached by some command. What only a flight
can show counts as nothing here.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from rpo_core.assurance.settings import Assurance
from rpo_core.files.validation import InputError
from rpo_core.kernels.arithmetic import Vector, norm
from rpo_core.kernels.arrays import Floats
from rpo_core.navigation.sensors import BEARING, PORT, Navigation, Sensor, Sensors
from rpo_core.stage import ZERO, Place, section_of
from rpo_core.thrusters.table import FULL, IDENTITY, NONE, PULSE_WIDTH, known_authority
from rpo_core.thrusters.thrusters import (
    STANDARD_GRAVITY_M_S2,
    Pulses,
    Thrusters,
    directions,
    valve_names,
)
from rpo_core.world import cw
from rpo_core.world.cw import cw_step
from rpo_core.world.disturbance import Disturbance
from rpo_core.world.dynamics import (
    CLOHESSY_WILTSHIRE,
    environment_of,
    orbit_tick,
    steps_per_tick,
    target_at,
    target_start,
)

SQRT_3 = math.sqrt(3.0)
SIGNS = tuple(product((1.0, -1.0), repeat=3))


def sensed_m(settings: Assurance, scenario: Any) -> float:
    """Return the error [m] of position at the start that all sensors of a scenario have in common.

    An estimator has nothing by which it could take that out: a bias, and a wrong scale; of several
    sensors what lies on the same side. 0.0 without an estimator: nothing reads the sensors. With
    `sigmas` the spread covers as much, which is at most that of a measurement.
    """
    common_m = _common_m(scenario)
    if settings.sigmas == 0.0 or common_m == 0.0:
        return common_m
    away = norm(*scenario.initial_position_m)
    spread_m = max(
        max(u.noise_floor_m, away * max(u.noise_share, u.bearing_noise_rad))
        for u in scenario.section(Sensors).units
    )
    scale = getattr(scenario.named('estimator'), 'noise_scale', 1.0)
    return common_m if common_m > settings.sigmas * SQRT_3 * scale * spread_m else 0.0


def _common_m(scenario: Any) -> float:
    """Return `sensed_m` of an estimator whose spread is not looked at."""
    sensors = scenario.section(Sensors)
    places = {section_of(s).place for s in scenario.sections}
    if sensors is None or Place.ESTIMATOR not in places:
        return 0.0
    units = sensors.units
    if any(unit.kind == BEARING for unit in units):
        return 0.0  # it tells two axes of three, in its own way
    if any(unit.body_fixed or unit.looks_at == PORT for unit in units):
        if len(units) > 1:
            return 0.0
        # Axes of the chaser or the target: the bias may be against the error of the scale.
        away = norm(*scenario.initial_position_m) + norm(*sensors.port_m)
        return max(0.0, norm(*units[0].bias_m) - abs(units[0].scale_error) * away)
    errors = np.array([_error_m(unit, scenario.initial_position_m) for unit in units])
    sides = [side / size for side in (*errors, errors.mean(axis=0)) if (size := _size(side)) > 0.0]
    return max([0.0, *(float((errors @ side).min()) for side in sides)])


def _size(vector: Floats) -> float:
    return norm(*vector.tolist())


def _error_m(unit: Sensor, position_m: Vector) -> list[float]:
    """Return what a sensor in axes of target LVLH measures wrongly of a position [m]."""
    pairs = zip(unit.bias_m, position_m, strict=True)
    return [bias + unit.scale_error * r for bias, r in pairs]


def moving_n(scenario: Any) -> float:
    """Return the force [N] beyond Clohessy and Wiltshire that acts in the first tick.

    It is that of other dynamics, with the disturbance; 0.0 where there are none.
    """
    settings, mass, dt = scenario.dynamics, scenario.mass_kg, scenario.dt_s
    if settings is None or settings.kind == CLOHESSY_WILTSHIRE:
        return 0.0
    steps, world = steps_per_tick(settings, scenario), environment_of(settings, scenario)
    target, (x, y, z) = target_start(settings, scenario), scenario.disturbances_n[0].tolist()
    push = (x / mass, y / mass, z / mass)
    begin = target_at(target, 0, dt, world)
    after, _ = orbit_tick(scenario.start, push, 1.0, begin, steps, dt / steps, world)
    plain = cw_step(scenario.start, ZERO, scenario.step)
    return mass / dt * norm(*(a - b for a, b in zip(after[3:], plain[3:], strict=True)))


def stuck_n(scenario: Any) -> float:
    """Return the force [N] by which valves that are known to be stuck on differ from what is known.

    The others make up for a valve without errors.
    """
    thrusters = scenario.thrusters
    pulses = thrusters.pulses if thrusters is not None else None
    if pulses is None:
        return 0.0
    names, off = valve_names(pulses.count), np.zeros(3)
    thrust_n = scenario.max_force_n / (pulses.count // 6)
    true = directions(thrusters, pulses, thrust_n)
    plain = directions(thrusters, replace(pulses, errors=()), thrust_n)
    for name in {f.thruster for f in pulses.failures if f.known and f.stuck == 'on'}:
        off += (true - plain)[names.index(name)]
    return _size(off)


def ready(pulses: Pulses) -> dict[str, int]:
    """Return side, such as `y+` -> thrusters of it that push, less those on the other side.

    When all that are known to fail have failed, and those that are stuck on are made up for.
    """
    stuck = {f.thruster: f.stuck for f in pulses.failures if f.known}
    counts = {name[:2]: 0 for name in valve_names(pulses.count)}
    for name in valve_names(pulses.count):
        side, how = name[:2], stuck.get(name)
        counts[side] += how != 'off'
        if how == 'on':
            counts[side[0] + ('-' if side[1] == '+' else '+')] -= 1
    return counts


def thrust_share(scenario: Any, lighter: float, disturbance_n: float) -> float:
    """Return the largest share of a command by which the thrust is known to differ from it.

    lighter : mass as the filter takes it, over what it is; forces act by so much more
    disturbance_n : as assumed; so much of a difference it covers
    """
    thrusters, shares = scenario.thrusters, [0.0]
    falls = _falls(thrusters, scenario)
    for signs, sides in _octants(thrusters):
        whole, empty = (_share(mass * sides, signs) for mass in (lighter, lighter * falls))
        # What commands burn counts by itself: it does not make the most of all other errors.
        shares += [whole, min(empty, falls - 1.0)]
        if thrusters.pulses is not None:
            thrust = lighter * sides @ signs
            shares += _of_pulses(thrusters.pulses, signs, thrust, scenario, disturbance_n)
    return max(shares)


def _share(sides: Floats, signs: Floats) -> float:
    """Return by how much of a command with some signs its force differs, of the worst."""
    off = sides - IDENTITY
    return max(_size(off @ f) / _size(f) for f in _worst(off, signs) if f.any())


def _worst(off: Floats, signs: Floats) -> list[Floats]:
    """Return commands (3,) with these signs, or zeros, for which a matrix is large."""
    far = np.linalg.svd(off)[2][0]
    return [*np.diag(signs), signs, *(np.where(f * signs > 0.0, f, 0.0) for f in (far, -far))]


def _falls(own: Thrusters, scenario: Any) -> float:
    """Return the mass at the start over what commands on all axes can leave of it."""
    if own.propellant is None:
        return 1.0
    burnt = 3.0 * scenario.max_force_n * scenario.duration_s / _exhaust_m_s(own)
    start: float = scenario.mass_kg
    return start / (start - min(own.propellant.mass_kg, burnt))


def _exhaust_m_s(own: Thrusters) -> float:
    """Return the exhaust velocity of the best thruster."""
    isp_s: float = own.propellant.specific_impulse_s if own.propellant is not None else 0.0
    if own.table is not None:
        isp_s = max([isp_s, *(t.specific_impulse_s or 0.0 for t in own.table.each)])
    return isp_s * STANDARD_GRAVITY_M_S2


def _octants(own: Thrusters) -> Iterator[tuple[Floats, Floats]]:
    """Yield signs of the axes of a command, and what the thrusters make of such ones: (3, 3).

    When all that are known to fail have failed. A table's thrusters have errors in common alone.
    """
    names = valve_names(own.pulses.count) if own.pulses is not None else []
    pulses, matrix = own.pulses, np.array(own.matrix)
    each = directions(own, pulses, 1.0) if pulses is not None else np.zeros((0, 3))
    failed = {f.thruster for f in pulses.failures if f.known} if pulses is not None else set()
    for signs in SIGNS:
        columns = list(matrix.T)
        for axis, sign in enumerate(signs):
            side = 'xyz'[axis] + ('+' if sign > 0.0 else '-')
            firing = [i for i, n in enumerate(names) if n[:2] == side and n not in failed]
            if firing:
                columns[axis] = sign * each[firing].mean(axis=0)
        yield np.array(signs), np.array(columns).T


def _of_pulses(
    pulses: Pulses, signs: Floats, thrust: Floats, scenario: Any, disturbance_n: float
) -> Iterator[float]:
    """Yield shares by which commands differ that are the same tick after tick, on all axes alike.

    Of pulses at half thrust the dead time and half of the rise time are lost; what is too short for
    a pulse is lost for ever where it is not carried.

    signs : of the axes; thrust : (3,) what long pulses make of that command
    """
    dt, quantum, force = scenario.dt_s, pulses.on_time_quantum_s, scenario.max_force_n
    dead, rise = pulses.dead_time_s, pulses.rise_time_s
    on = max(0.5 * dt, pulses.minimum_on_time_s)
    on = quantum * math.ceil(on / quantum - 1e-9) if quantum > 0.0 else on
    if on <= dt / SQRT_3:  # what thrusters that turn have in every attitude
        full = max(on - dead - 0.5 * rise, 0.0)
        if dead <= on < dead + rise:
            full = 0.5 * (on - dead) ** 2 / rise
        off_n = force * on / dt * _size(full / on * thrust - signs)
        yield (off_n - disturbance_n) / (SQRT_3 * force * on / dt)
    lost_s = max(pulses.minimum_on_time_s, 0.5 * quantum)
    if pulses.modulation == PULSE_WIDTH and lost_s > 0.0:
        lost_n = SQRT_3 * force / (pulses.count // 6) * lost_s / dt
        yield 1.0 - disturbance_n / lost_n


def short_tank(scenario: Any) -> str:
    """Return why a tank does not last for one axis at full thrust all the time; '' if it does.

    Any command may ask for that, to and fro.
    """
    thrusters = scenario.thrusters
    tank = thrusters.propellant if thrusters is not None else None
    if tank is None:
        return ''
    force_n = float(scenario.max_force_n)
    if thrusters.table is not None:
        force_n = min(force_n, max(known_authority(thrusters.table).axes_n))
    needed_kg = force_n * scenario.duration_s / _exhaust_m_s(thrusters)
    if needed_kg <= tank.mass_kg:
        return ''
    longer = upwards(tank.specific_impulse_s * needed_kg / tank.mass_kg)
    more = f', or `mass_kg` {upwards(needed_kg)}' if needed_kg < 0.99 * scenario.mass_kg else ''
    return (
        '`thrusters.propellant` must last for one axis at full thrust all the time: '
        f'`specific_impulse_s` at least {longer}{more}; got {tank.specific_impulse_s!r} and '
        f'{tank.mass_kg!r}'
    )


def upwards(value: float) -> str:
    """Return a number in six digits, never below it: as a bound it will do."""
    text = f'{value:.6g}'
    if float(text) >= value:
        return text
    return f'{value + 10.0 ** (math.floor(math.log10(abs(value))) - 5):.6g}'


ROUNDING_M = 1e-6
"""Covers the rounding of the kernels, below 1e-9 m in 1 km; added to the error of a position."""

LARGEST_NORMAL = math.sqrt(2.0) * math.sqrt(66.0 * math.log(2.0))
"""No three normals of `rpo_core.kernels.noise` have a larger norm: words are at least 1/2^33."""


class Errors(NamedTuple):
    """Largest norms: position [m], velocity [m/s], disturbance [N], thrust (share of a force).

    thrust : that of the thrusters, and what a wrong attitude of the chaser turns
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

    Raises InputError, with all conflicts, if the section assumes less than the scenario has, or
    says nothing where the scenario has sensors, thrusters or dynamics whose errors are not known
    beforehand.
    """
    bounds = known(settings, scenario)
    conflicts, _ = compared(settings, bounds)
    if conflicts:
        raise InputError('; '.join(conflicts))

    def assumed(name: str) -> float:
        given: float | None = getattr(settings, name)
        return bounds[name][0] if given is None else given

    return Errors(
        assumed('position_error_m'),
        assumed('velocity_error_m_s'),
        assumed('disturbance_n'),
        assumed('thrust_error') + turned_share(settings, scenario),
        settings.mass_kg or scenario.mass_kg,
    )


def compared(
    settings: Assurance, found: dict[str, tuple[float, str, str]]
) -> tuple[list[str], dict[str, Any]]:
    """Return in what a section conflicts with what is known of its scenario, and what would do.

    found : of `known`
    """
    conflicts: list[str] = []
    changed: dict[str, Any] = {}
    for name, (least, source, reason) in found.items():
        given = getattr(settings, name)
        if given is not None and given < least:
            would_do = f'must be at least {upwards(least)}, which {source}; got {given!r}'
        elif given is None and reason:
            more = f', at least {upwards(least)}' if least > 0.0 else ''
            would_do = f'is missing; section `{reason}` needs it{more}'
        else:
            continue
        if name == 'thrust_error' and least > 1.0:
            would_do += ' (1 at most can be assumed: `thrusters` must exert more of a command)'
        conflicts.append(f'`assurance.{name}` {would_do}')
        changed[name] = float(upwards(least))
    return conflicts, changed


@lru_cache(maxsize=8)
def known(settings: Assurance, scenario: Any) -> dict[str, tuple[float, str, str]]:
    """Return of each assumption what is known at least, whose that is, and what makes it unknown.

    The last is the section whose part is not known beforehand; '' if there is none.
    """
    navigation = scenario.section(Navigation) or Navigation()
    mass_kg = settings.mass_kg or scenario.mass_kg
    lighter = mass_kg / scenario.mass_kg
    seeing = _seeing(scenario)
    # Sensors without an estimator change nothing; what another stage makes of noise is its own.
    most = LARGEST_NORMAL * all(isinstance(s, Sensors) for s in seeing)
    position_m = _norm(navigation.position_bias_m) + most * navigation.position_noise_m
    velocity_m_s = _norm(navigation.velocity_bias_m_s) + most * navigation.velocity_noise_m_s
    seen = next((section_of(s).name for s in seeing), '')
    moved_n = max(largest_n(scenario.disturbance), moving_n(scenario), stuck_n(scenario))
    disturbance_n = moved_n * mass_kg / scenario.mass_kg
    pushed = _first_of(scenario, (Place.DISTURBANCE, Place.DYNAMICS))
    own, assumed_n = scenario.thrusters, settings.disturbance_n
    thrust, exerting = _thrust_error(scenario, lighter), ''
    if own is not None and own != Thrusters(matrix=own.matrix, delay_ticks=own.delay_ticks):
        exerting = 'thrusters'
        covered_n = disturbance_n if assumed_n is None else assumed_n
        share = thrust_share(scenario, lighter, covered_n)
        alike = own.pulses is None or not own.pulses.errors
        thrust = max(share * (1.0 - 1e-9), thrust if alike else 0.0)
    after = (Place.ASSURANCE, Place.LINK, Place.THRUSTERS)
    exerting = exerting or _first_of(scenario, after, Thrusters)
    has = 'the scenario has'
    found = {
        'position_error_m': (max(position_m, sensed_m(settings, scenario)), has, seen),
        'velocity_error_m_s': (velocity_m_s, has, seen),
        'disturbance_n': (disturbance_n, has, pushed),
        'thrust_error': (thrust, has + (' with `mass_kg`' if settings.mass_kg else ''), exerting),
    }
    if scenario.target is not None and settings.corridor is not None:
        found['attitude_error_deg'] = (_norm(scenario.target.known_error_deg), has, '')
    if scenario.attitude is not None:
        found['chaser_attitude_error_deg'] = (
            _turned_deg(scenario),
            '`attitude_control.limits` and the delay of the thrusters have',
            'attitude',
        )
    return found


def _seeing(scenario: Any) -> list[Any]:
    """Return the settings of sensors and estimators whose errors are not known beforehand."""
    places = (Place.SENSOR, Place.ESTIMATOR)
    settings = [s for s in scenario.sections if section_of(s).place in places]
    return [s for s in settings if not isinstance(s, Navigation)]


def _first_of(scenario: Any, places: tuple[Place, ...], *skipped: type) -> str:
    """Return the name of the first section after assurance in some places; '' if there is none.

    skipped : settings whose errors are known beforehand
    """
    types = [type(s) for s in scenario.sections]
    after = types.index(Assurance) + 1 if Assurance in types else 0
    for settings in scenario.sections[after:]:
        section = section_of(settings)
        if section.place in places and not isinstance(settings, skipped):
            return section.name
    return ''


def _norm(values: Any) -> float:
    return math.sqrt(sum(value * value for value in values))


def _thrust_error(scenario: Any, lighter: float) -> float:
    """Return a bound of |T f - f| / |f|: of T - 1 the norm of Frobenius, or sqrt(rows x columns).

    lighter : mass as the filter takes it, over what it is; forces act by so much more
    """
    rows = scenario.thrusters.matrix if scenario.thrusters is not None else IDENTITY
    off = [[lighter * rows[i][j] - (i == j) for j in range(3)] for i in range(3)]
    return min(_norm(value for row in off for value in row), _block(np.array(off), 0, 0))


def turned_share(settings: Assurance, scenario: Any) -> float:
    """Return the largest share of a force by which a wrong attitude of the chaser changes it.

    2 sin(angle / 2); 0.0 where the chaser's axes are those of target LVLH. docs/safety.md, lemma 6.
    """
    degrees = settings.chaser_attitude_error_deg
    if scenario.attitude is None:
        if degrees is not None:
            raise InputError('`assurance.chaser_attitude_error_deg` needs section `attitude`')
        return 0.0
    if scenario.named('attitude_control') is None:
        raise InputError(
            '`assurance` needs section `attitude_control` beside `attitude`: it turns the force '
            "into the chaser's axes"
        )
    return 2.0 * math.sin(0.5 * math.radians(degrees or 0.0))


def _turned_deg(scenario: Any) -> float:
    """Return the angle that limits of the torque leave certain: errors, and the turn of a tick.

    A force is turned for the middle of the tick in which it acts, by the rate of now.
    """
    control = scenario.named('attitude_control')
    limits = control.limits if control is not None else None
    if limits is None:
        return 0.0
    delay = scenario.thrusters.delay_ticks if scenario.thrusters else 0
    fastest = SQRT_3 * limits.rate_deg_s + math.degrees(scenario.mean_motion_rad_s)
    change_deg_s2 = math.degrees(control.bounds(scenario).fastest)
    later = (delay + 0.5) * scenario.dt_s
    error_deg = SQRT_3 * (limits.known_deg + later * limits.known_deg_s)
    return error_deg + 0.5 * scenario.dt_s * fastest + 0.5 * later * later * change_deg_s2


def spreading(errors: Errors, scenario: Any, ticks: int) -> tuple[float, float, float, float]:
    """Return how errors grow in some ticks: position by position, by velocity; velocity likewise.

    Norms of blocks of the CW transition are bounded by sqrt(row sum x column sum).
    """
    if not ticks:
        return 1.0, 0.0, 0.0, 1.0
    return _spreading(scenario.mean_motion_rad_s, errors.mass_kg, ticks * scenario.dt_s)


@lru_cache(maxsize=256)
def _spreading(n: float, mass_kg: float, t: float) -> tuple[float, float, float, float]:
    """Return `spreading` in a time [s]: many runs of a campaign have the same."""
    state, _ = cw.matrices(cw.discretise(n, mass_kg, t))
    rr, rv, vr, vv = (_block(state, i, j) for i in (0, 3) for j in (0, 3))
    return rr, rv, vr, vv


def ahead(errors: Errors, scenario: Any, ticks: int) -> tuple[float, float]:
    """Return bounds of the error [m], [m/s] of a state predicted some ticks ahead.

    The error at hand grows as the state does, by the CW transition; disturbance and thrust error
    add to it for as long.
    """
    t = ticks * scenario.dt_s
    if not ticks:
        return errors.position_m + ROUNDING_M, errors.velocity_m_s
    rr, rv, vr, vv = spreading(errors, scenario, ticks)
    a = unknown_n(errors, scenario) / errors.mass_kg
    return (
        rr * errors.position_m + rv * errors.velocity_m_s + rv * t * a / 2.0 + ROUNDING_M,
        vr * errors.position_m + vv * errors.velocity_m_s + vv * t * a,
    )


def limit_n(scenario: Any) -> float:
    """Return the force [N] that all axes of target LVLH have at once.

    Of pulses and of a table that is what is left when all that are known to fail have failed; of a
    table without torque, and while the wheels are unloaded, or, without wheels, limits of the
    attitude kept. Raises InputError where nothing is. Where the thrusters turn with the chaser, it
    is that of the largest ball of forces: what there is in every attitude.
    """
    limit, turns = float(scenario.max_force_n), scenario.attitude is not None
    thrusters = scenario.thrusters
    if thrusters is not None and thrusters.pulses is not None:
        sides = ready(thrusters.pulses)
        without = [side for side, count in sides.items() if count <= 0]
        if without:
            raise InputError(
                '`assurance` needs a force to all sides; `thrusters.pulses`, with the failures '
                f'that are known, have none to {", ".join(without)}'
            )
        limit *= min(1.0, min(sides.values()) / (thrusters.pulses.count // 6))
    if thrusters is None or thrusters.table is None:
        return limit / SQRT_3 if turns else limit
    left = known_authority(thrusters.table, _torque_nm(scenario))
    has = left.left(limit)
    if has == NONE:
        raise InputError(
            '`assurance` needs a force to all sides without torque; `thrusters.table`, with the '
            'failures that are known, has none (`rpo safety thrusters`)'
        )
    if turns:
        return min(limit, left.least_n) / SQRT_3
    return limit if has == FULL else left.box_n


def _torque_nm(scenario: Any) -> float:
    """Return the torque [N m] that a table of thrusters gives about each axis beside its force."""
    unloading, control = scenario.named('unloading'), scenario.named('attitude_control')
    if unloading is not None:
        found: float = unloading.torque_nm
        return found
    chaser = scenario.attitude  # without it the check of `attitude_control` refuses the scenario
    if control is None or control.limits is None or chaser is None or chaser.wheels is not None:
        return 0.0
    return control.limit_nm


def unknown_n(errors: Errors, scenario: Any) -> float:
    """Return the largest force [N] that a prediction does not know, under any command."""
    return errors.disturbance_n + errors.thrust * SQRT_3 * limit_n(scenario)


def _block(matrix: Any, i: int, j: int) -> float:
    rows = [[abs(float(matrix[i + a, j + b])) for b in range(3)] for a in range(3)]
    return math.sqrt(max(map(sum, rows)) * max(map(sum, zip(*rows, strict=True))))
