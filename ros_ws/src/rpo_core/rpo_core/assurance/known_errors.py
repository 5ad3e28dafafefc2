# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Lower bounds of errors that no section says as a whole; `assurance.assumed` compares them.

Each bound is reached by some command. What only a flight can show counts as nothing here.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np

from rpo_core.assurance.settings import Assurance
from rpo_core.kernels.arithmetic import Vector, norm
from rpo_core.kernels.arrays import Floats
from rpo_core.navigation.sensors import BEARING, PORT, Sensor, Sensors
from rpo_core.stage import ZERO, Place, section_of
from rpo_core.thrusters.authority import known
from rpo_core.thrusters.table import IDENTITY, PULSE_WIDTH
from rpo_core.thrusters.thrusters import (
    STANDARD_GRAVITY_M_S2,
    Pulses,
    Thrusters,
    directions,
    valve_names,
)
from rpo_core.world.cw import cw_step
from rpo_core.world.dynamics import (
    CLOHESSY_WILTSHIRE,
    TargetOrbit,
    environment_of,
    relative_step,
    steps_per_tick,
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
    found = _common_m(scenario)
    if settings.sigmas == 0.0 or found == 0.0:
        return found
    away = norm(*scenario.initial_position_m)
    spread_m = max(
        max(u.noise_floor_m, away * max(u.noise_share, u.bearing_noise_rad))
        for u in scenario.section(Sensors).units
    )
    scale = getattr(scenario.named('estimator'), 'noise_scale', 1.0)
    return found if found > settings.sigmas * SQRT_3 * scale * spread_m else 0.0


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
    orbit = TargetOrbit(target_start(settings, scenario), dt, steps, world)
    x, y, z = scenario.disturbance.force_n(0.0)
    push, step_s = (x / mass, y / mass, z / mass), orbit.step_s
    after = relative_step(scenario.start, push, 1.0, orbit.rows(1), 0, steps, step_s, world)
    plain = cw_step(scenario.start, ZERO, scenario.step)
    return mass / dt * norm(*(a - b for a, b in zip(after[3:], plain[3:], strict=True)))


def stuck_n(scenario: Any) -> float:
    """Return the force [N] by which valves that are known to be stuck on differ from what is known.

    The others make up for a valve without errors.
    """
    own = scenario.thrusters
    pulses = own.pulses if own is not None else None
    if pulses is None:
        return 0.0
    names, off = valve_names(pulses.count), np.zeros(3)
    thrust_n = scenario.max_force_n / (pulses.count // 6)
    true = directions(own, pulses, thrust_n)
    plain = directions(own, replace(pulses, errors=()), thrust_n)
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
    own, found = scenario.thrusters, [0.0]
    falls = _falls(own, scenario)
    for signs, sides in _octants(own):
        whole, empty = (_share(mass * sides, signs) for mass in (lighter, lighter * falls))
        # What commands burn counts by itself: it does not make the most of all other errors.
        found += [whole, min(empty, falls - 1.0)]
        if own.pulses is not None:
            thrust = lighter * sides @ signs
            found += _of_pulses(own.pulses, signs, thrust, scenario, disturbance_n)
    return max(found)


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
    own = scenario.thrusters
    tank = own.propellant if own is not None else None
    if tank is None:
        return ''
    force_n = float(scenario.max_force_n)
    if own.table is not None:
        force_n = min(force_n, max(known(own.table).axes_n))
    needed_kg = force_n * scenario.duration_s / _exhaust_m_s(own)
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
