# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Thrusters: what becomes of a command. Section `thrusters` of a scenario.

The thrusters take the command of `delay_ticks` ago, saturate it per axis, and exert it with their
own magnitude and direction; or in pulses of valves (`Pulses`); or by a table of thrusters with
places (`rpo_core.thrusters.table`). Energy is counted of the saturated
command. With `propellant`, the mass of the chaser falls.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Annotated, Any

import numpy as np

from rpo_core.files.codec import unless_default
from rpo_core.files.validation import (
    Checked,
    InputError,
    choice,
    matrix,
    real,
    shown,
    vector3,
    whole,
)
from rpo_core.kernels import arithmetic
from rpo_core.kernels.arithmetic import Vector
from rpo_core.kernels.arrays import Floats
from rpo_core.kernels.jit import step_kernel
from rpo_core.stage import ZERO, KernelStage, Place, Section, Stage, register
from rpo_core.thrusters import allocation_kernels, pulse_kernels
from rpo_core.thrusters.allocation_kernels import MOST_THRUSTERS, ROWS, SCRATCH, THRUST, Table
from rpo_core.thrusters.pulse_kernels import OFF, ON, Spent, Tank, Valves
from rpo_core.thrusters.table import (
    IDENTITY,
    MODULATIONS,
    SIGMA_DELTA,
    Failure,
    ThrusterTable,
    rows_of,
    seconds,
    table_of,
)
from rpo_core.wire import interfaces
from rpo_core.world import cw

MAX_DELAY_TICKS = 1000
MAX_GAIN = 10.0
"""Largest entry of a thrust matrix; beyond it a number is a typing error."""

READY = 'ready'
SWITCHES = ('off', 'on', READY)
"""How a thruster of a table is switched in flight."""

NEVER_TICK = 2**62

STANDARD_GRAVITY_M_S2 = 9.80665


def _count(name: str, value: Any) -> int:
    if value not in (6, 12) or isinstance(value, bool):
        raise InputError(f'`{name}` must be 6 or 12; got {shown(value)}')
    return int(value)


def valve_names(count: int) -> list[str]:
    """Return the names of 6 or 12 thrusters; each pushes the chaser to where its name says."""
    sides = [axis + sign for axis in 'xyz' for sign in '+-']
    return sides if count == 6 else [side + which for side in sides for which in 'ab']


_matrix = partial(matrix, rows=3, columns=3, bound=MAX_GAIN)
_misalignment = partial(vector3, unit='deg', bound=90.0)


@dataclass(frozen=True, kw_only=True)
class ThrusterError(Checked):
    """One thruster's error of magnitude, and of direction as a rotation vector, LVLH axes."""

    thruster: Annotated[str, partial(choice, known=[*valve_names(6), *valve_names(12)])]
    magnitude_share: Annotated[float, partial(real, least=-1.0, most=1.0)] = 0.0
    misalignment_deg: Annotated[Vector, _misalignment] = ZERO


@dataclass(frozen=True, kw_only=True)
class Pulses(Checked):
    """Thrusters that are open or shut.

    count : 6, one in each direction of each axis, or 12, two of half the thrust
    modulation : `pulse_width`, what cannot be fired in a tick is lost; `sigma_delta`, it is carried
        to the next ticks
    minimum_on_time_s : no pulse is shorter; times the thrust it is the minimum impulse bit
    on_time_quantum_s : pulses last a whole number of these; 0: any time
    dead_time_s, rise_time_s : from the signal to the first thrust, from there to full thrust
    """

    count: Annotated[int, _count]
    modulation: Annotated[str, partial(choice, known=MODULATIONS)]
    minimum_on_time_s: Annotated[float, seconds]
    on_time_quantum_s: Annotated[float, seconds] = unless_default(0.0)
    dead_time_s: Annotated[float, seconds] = unless_default(0.0)
    rise_time_s: Annotated[float, seconds] = unless_default(0.0)
    errors: tuple[ThrusterError, ...] = unless_default(())
    failures: tuple[Failure, ...] = unless_default(())

    def __post_init__(self) -> None:
        super().__post_init__()
        names = valve_names(self.count)
        for part in ('errors', 'failures'):
            for i, item in enumerate(getattr(self, part)):
                choice(f'{part}[{i}].thruster', item.thruster, names)


@dataclass(frozen=True, kw_only=True)
class Propellant(Checked):
    """What thrust costs: the mass falls by impulse / (specific impulse x 9.80665 m/s^2).

    mass_kg : in the tank at the start, part of the mass of the chaser; without any there is no
        thrust
    """

    specific_impulse_s: Annotated[float, partial(real, unit='s', least=1.0, most=1e5)]
    mass_kg: Annotated[float, partial(real, unit='kg', above=0.0, most=1e9)]


@dataclass(frozen=True)
class Thrusters(Checked):
    """What becomes of a command.

    matrix : 3 rows of 3, force exerted = matrix x saturated command, target LVLH axes
    delay_ticks : from a state to the force that answers it; zero force before the first
    pulses : None: any force up to the largest
    table : instead of `pulses`: thrusters with places, whose torque counts
    propellant : None: the mass stays
    """

    matrix: Annotated[tuple[Vector, Vector, Vector], _matrix] = IDENTITY
    delay_ticks: Annotated[int, partial(whole, least=0, most=MAX_DELAY_TICKS)] = 0
    pulses: Pulses | None = unless_default(None)
    table: ThrusterTable | None = unless_default(None)
    propellant: Propellant | None = unless_default(None)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.pulses is not None and self.table is not None:
            raise InputError('`thrusters` must have one of `pulses` and `table`; got both')

    @property
    def fires(self) -> bool:
        """Whether thrusters open and shut."""
        return self.pulses is not None or self.table is not None

    @property
    def names(self) -> list[str]:
        """Names of the thrusters; none without `pulses` and `table`."""
        if self.table is not None:
            return self.table.names
        return valve_names(self.pulses.count) if self.pulses is not None else []


def _check(settings: Thrusters, scenario: Any) -> None:
    """Raise InputError where the ticks or the mass of a scenario do not allow these thrusters."""
    pulses, propellant, dt_s = settings.pulses, settings.propellant, scenario.dt_s
    if propellant is not None and propellant.mass_kg >= scenario.mass_kg:
        raise InputError(
            f'`thrusters.propellant.mass_kg` must be below `mass_kg`, {scenario.mass_kg!r} kg; '
            f'got {propellant.mass_kg!r}'
        )
    for which in ('pulses', 'table'):
        part = getattr(settings, which)
        for failure in part.failures if part is not None else ():
            if failure.from_s >= scenario.duration_s:
                raise InputError(
                    f'`thrusters.{which}.failures` must begin before the end of the flight, '
                    f'{scenario.duration_s!r} s; got `from_s` {failure.from_s!r}'
                )
    if pulses is None:
        return
    for name in ('minimum_on_time_s', 'on_time_quantum_s'):
        if getattr(pulses, name) > dt_s:
            raise InputError(
                f'`thrusters.pulses.{name}` must be at most `dt_s`, {dt_s!r} s; '
                f'got {getattr(pulses, name)!r}'
            )
    late_s = pulses.dead_time_s + pulses.rise_time_s
    if late_s > dt_s:
        raise InputError(
            '`thrusters.pulses.dead_time_s` and `rise_time_s` together must be at most `dt_s`, '
            f'{dt_s!r} s; got {late_s!r}'
        )


def rotation(vector_rad: Vector) -> tuple[Vector, Vector, Vector]:
    """Return the matrix (3, 3) of a rotation vector, by Rodrigues' formula.

    sin a / a and (1 - cos a) / a^2 are Stumpff's functions: the same bits on every machine.
    """
    x, y, z = vector_rad
    _, c1, c2, _ = cw.stumpff(math.sqrt(x * x + y * y + z * z))
    xy, xz, yz = c2 * (x * y), c2 * (x * z), c2 * (y * z)
    return (
        (1.0 - c2 * (y * y + z * z), 0.0 - c1 * z + xy, 0.0 + c1 * y + xz),
        (0.0 + c1 * z + xy, 1.0 - c2 * (x * x + z * z), 0.0 - c1 * x + yz),
        (0.0 - c1 * y + xz, 0.0 + c1 * x + yz, 1.0 - c2 * (x * x + y * y)),
    )  # a zero has no sign


@lru_cache(maxsize=256)
def _turned(misalignment_deg: Vector, axis: int) -> list[float]:
    """Return an axis (3,) as a misalignment turns it."""
    x, y, z = misalignment_deg
    degree = math.pi / 180.0
    return [row[axis] for row in rotation((x * degree, y * degree, z * degree))]


def directions(settings: Thrusters, pulses: Pulses, thrust_n: float) -> Floats:
    """Return the force (n, 3) [N] of each valve at full thrust, with its errors."""
    names, matrix = valve_names(pulses.count), settings.matrix
    each = len(names) // 6
    errors = {error.thruster: error for error in pulses.errors}
    accurate, forces = ThrusterError(thruster=names[0]), []
    for i, name in enumerate(names):
        error = errors.get(name, accurate)
        axis, sign = i // each // 2, 1.0 if i // each % 2 == 0 else -1.0
        size = sign * thrust_n * (1.0 + error.magnitude_share)
        x, y, z = (size * part for part in _turned(error.misalignment_deg, axis))
        forces.append([a * x + b * y + c * z for a, b, c in matrix])
    return np.array(forces)


def valves_of(settings: Thrusters, pulses: Pulses, scenario: Any) -> Valves:
    """Return thrusters that fire in pulses as the kernels read them."""
    thrust_n = scenario.max_force_n / (pulses.count // 6)
    return Valves(
        pulses.count,
        int(pulses.modulation == SIGMA_DELTA),
        scenario.dt_s,
        pulses.minimum_on_time_s,
        pulses.on_time_quantum_s,
        pulses.dead_time_s,
        pulses.rise_time_s,
        thrust_n,
        directions(settings, pulses, thrust_n).tolist(),
    )


def failures_of(settings: Thrusters, dt_s: float) -> list[list[int]]:
    """Return the failures of a scenario as the kernels read them; see `table.rows_of`."""
    part = settings.pulses or settings.table
    return rows_of(part.failures, settings.names, dt_s) if part is not None else []


def tank_of(settings: Thrusters | None, scenario: Any) -> Tank:
    """Return what thrust costs in a scenario."""
    propellant = settings.propellant if settings else None
    if propellant is None:
        return Tank(0.0, 0.0, scenario.mass_kg)
    exhaust = propellant.specific_impulse_s * STANDARD_GRAVITY_M_S2
    return Tank(exhaust, propellant.mass_kg, scenario.mass_kg)


@dataclass(slots=True)
class Limit:
    """Settings of the kernel `thrust`; matrix : row by row; exact : 1 where it counts."""

    limit_n: float
    exact: int
    matrix: Annotated[list[float], 9]


@dataclass(slots=True)
class Line:
    """Commands on their way; at : place of the oldest one."""

    at: int
    line_n: list[list[float]]


@step_kernel
def take(u: Any, p: Any, m: Any, y: Any) -> Vector:
    """Return T sat(c_(k - delay)) (3,), and write what is due and what is saturated, y (6,)."""
    late = len(m.line_n) > 0
    for i in range(3):
        y[i] = m.line_n[m.at][i] if late else u[i]
        y[3 + i] = arithmetic.saturate(y[i], p.limit_n)
    if late:
        for i in range(3):
            m.line_n[m.at][i] = u[i]
        m.at = (m.at + 1) % len(m.line_n)
    if not p.exact:
        return y[3], y[4], y[5]
    t, fx, fy, fz = p.matrix, y[3], y[4], y[5]
    return (
        t[0] * fx + t[1] * fy + t[2] * fz,
        t[3] * fx + t[4] * fy + t[5] * fz,
        t[6] * fx + t[7] * fy + t[8] * fz,
    )


@step_kernel
def thrust(tick: int, u: Any, p: Any, m: Any, y: Any) -> None:
    """F = T sat(c_(k - delay)): from the command u (3,) to what is due, saturated, exerted y (9,).

    All in target LVLH [N].
    """
    y[6], y[7], y[8] = take(u, p, m, y)


class ThrustersStage(KernelStage):
    """From the command to the force on the chaser; without settings, saturation alone.

    limit_n : largest |f| of an axis
    """

    name = 'thrusters'
    inputs: tuple[str, ...] = (interfaces.COMMAND,)
    outputs: tuple[str, ...] = (
        interfaces.DUE_FORCE,
        interfaces.SATURATED_FORCE,
        interfaces.THRUST_FORCE,
    )
    kernel = thrust

    def __init__(self, settings: Thrusters | None, limit_n: float) -> None:
        self.memory_ticks = settings.delay_ticks if settings else 0
        super().__init__(limit_of(settings, limit_n), line_of(settings))

    def refusal(self, state: str) -> str:
        """Return why a thruster cannot be switched in flight; '' if it can."""
        return 'a switch needs a scenario with `thrusters.table`'


def limit_of(settings: Thrusters | None, limit_n: float) -> Limit:
    """Return the largest |f| of an axis, and the matrix of the thrusters."""
    matrix = [t for row in settings.matrix for t in row] if settings else [0.0] * 9
    return Limit(float(limit_n), int(settings is not None), matrix)


def line_of(settings: Thrusters | None) -> Line:
    """Return the commands on their way before tick 0."""
    return Line(0, [[0.0] * 3 for _ in range(settings.delay_ticks if settings else 0)])


@dataclass(slots=True)
class Firing:
    """Settings of the kernel `pulse`; failures : see `pulse_kernels.fire`; dt_s : of a tick."""

    limit: Limit
    dt_s: float
    valves: Valves
    failures: list[list[int]]
    tank: Tank


@dataclass(slots=True)
class Fired:
    """Memory of the kernel `pulse`.

    carried_n_s, was_open, on_s : see `pulse_kernels.fire`; on_s is of the last tick
    delta_v_m_s, propellant_kg, openings : see `Spent`
    """

    line: Line
    carried_n_s: Annotated[list[float], 3]
    was_open: list[float]
    on_s: list[float]
    delta_v_m_s: float
    propellant_kg: float
    openings: float


@step_kernel
def pulse(tick: int, u: Any, p: Any, m: Any, y: Any) -> None:
    """From the command u (3,) to what is due, saturated, exerted y (9,) [N], and the mass [kg].

    Force and mass are those of pulses (`pulse_kernels.fire`), without valves of what the tank has
    (`burn`). y has the mass where it falls. All forces in target LVLH.
    """
    exerted, command = take(u, p.limit, m.line, y), (y[3], y[4], y[5])
    spent = Spent(m.delta_v_m_s, m.propellant_kg, m.openings)
    if p.valves.number > 0:
        force, mass, spent = pulse_kernels.fire(
            tick, command, m.carried_n_s, m.was_open, spent, p.valves, p.failures, p.tank, m.on_s
        )
    else:
        force, mass, spent = pulse_kernels.burn(exerted, command, spent, p.tank, p.dt_s)
    m.delta_v_m_s, m.propellant_kg, m.openings = spent
    y[6], y[7], y[8] = force
    if p.tank.exhaust > 0.0:
        y[9] = mass


class ValvesStage(ThrustersStage):
    """Thrusters with pulses, or with propellant, or both; the fourth output is the mass [kg]."""

    kernel = pulse

    def __init__(self, settings: Thrusters, scenario: Any) -> None:
        self.memory_ticks = None
        logged = settings.fires and scenario.attitude is None  # else the chaser turns it
        force = interfaces.EXERTED_FORCE if logged else interfaces.THRUST_FORCE
        mass = [interfaces.CHASER_MASS] if settings.propellant else []
        self.outputs = (interfaces.DUE_FORCE, interfaces.SATURATED_FORCE, force, *mass)
        KernelStage.__init__(self, *self._records(settings, scenario))

    def _records(self, settings: Thrusters, scenario: Any) -> tuple[Any, Any]:
        """Return settings and memory of the kernel."""
        valves, dt_s = Valves(0, 0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, []), scenario.dt_s
        if settings.pulses is not None:
            valves = valves_of(settings, settings.pulses, scenario)
        limit, failures = limit_of(settings, scenario.max_force_n), failures_of(settings, dt_s)
        shut, off = [0.0] * valves.number, [0.0] * valves.number
        return (
            Firing(limit, dt_s, valves, failures, tank_of(settings, scenario)),
            Fired(line_of(settings), [0.0] * 3, shut, off, 0.0, 0.0, 0.0),
        )

    def spent(self) -> tuple[float, float, int]:
        """Return delta-v [m/s], propellant [kg] and openings of valves so far."""
        return self.m.delta_v_m_s, self.m.propellant_kg, round(self.m.openings)


@dataclass(slots=True)
class Allocating:
    """Settings of the kernel `allocate`; torques : 1 where a torque is commanded."""

    limit: Limit
    table: Table
    tank: Tank
    torques: int


@dataclass(slots=True)
class Allocated:
    """Memory of the kernel `allocate`.

    failures : see `allocation_kernels.fire`; a switch in flight changes them
    carried_n_s, was_open, scratch, wanted_n : see there
    thrusts_n : of each thruster in the last tick
    delta_v_m_s, propellant_kg, openings : see `Spent`
    """

    line: Line
    failures: list[list[int]]
    carried_n_s: Annotated[list[float], ROWS]
    was_open: Annotated[list[float], MOST_THRUSTERS]
    thrusts_n: Annotated[list[float], MOST_THRUSTERS]
    scratch: Annotated[list[float], SCRATCH]
    wanted_n: Annotated[list[float], ROWS]
    delta_v_m_s: float
    propellant_kg: float
    openings: float


@step_kernel
def allocate(tick: int, u: Any, p: Any, m: Any, y: Any) -> None:
    """From the command u (3,) [N], and a torque (3,) [N m], to y: see `allocation_kernels.fire`.

    y has what is due, saturated, the mean force (3,) [N] and torque (3,) [N m], and the mass [kg]
    where it falls; in target LVLH, or in the axes of a chaser that turns.
    """
    take(u, p.limit, m.line, y)
    torque = (u[3], u[4], u[5]) if p.torques else (0.0, 0.0, 0.0)
    spent = Spent(m.delta_v_m_s, m.propellant_kg, m.openings)
    force, torque, mass, spent = allocation_kernels.fire(
        tick, (y[3], y[4], y[5]), torque, m.carried_n_s, m.was_open, spent,
        p.table, m.failures, p.tank, m.scratch, m.wanted_n,
    )  # fmt: skip
    for i in range(p.table.number):
        m.thrusts_n[i] = m.scratch[THRUST + i]
    m.delta_v_m_s, m.propellant_kg, m.openings = spent
    y[6], y[7], y[8] = force
    y[9], y[10], y[11] = torque
    if p.tank.exhaust > 0.0:
        y[12] = mass


class TableStage(ValvesStage):
    """Thrusters of a table; the fourth output is the torque, then the mass [kg] where it falls."""

    kernel = allocate

    def __init__(self, settings: Thrusters, scenario: Any) -> None:
        self._names = settings.names
        chaser, steered = scenario.attitude, scenario.named('attitude_control') is not None
        if steered and chaser is not None and chaser.wheels is None:  # nothing else turns it
            self.inputs = (interfaces.COMMAND, interfaces.BODY_TORQUE)
        elif scenario.named('unloading') is not None:
            self.inputs = (interfaces.COMMAND, interfaces.UNLOADING_TORQUE)
        super().__init__(settings, scenario)
        mass = self.outputs[3:]
        self.outputs = (*self.outputs[:3], interfaces.EXERTED_TORQUE, *mass)

    def _records(self, settings: Thrusters, scenario: Any) -> tuple[Any, Any]:
        """Return settings and memory of the kernel."""
        limit = limit_of(None, scenario.max_force_n)  # the matrix is in the table
        tank, failures = tank_of(settings, scenario), failures_of(settings, scenario.dt_s)
        assert settings.table is not None
        best = settings.propellant.specific_impulse_s if settings.propellant else None
        dt_s, limit_n = scenario.dt_s, scenario.max_force_n
        table = table_of(settings.table, dt_s, limit_n, best, settings.matrix)
        carried, shut, off, scratch, wanted = (
            [0.0] * n for n in (ROWS, MOST_THRUSTERS, MOST_THRUSTERS, SCRATCH, ROWS)
        )
        return (
            Allocating(limit, table, tank, int(len(self.inputs) > 1)),
            Allocated(
                line_of(settings), failures, carried, shut, off, scratch, wanted, 0.0, 0.0, 0.0
            ),
        )  # fmt: skip

    def refusal(self, state: str) -> str:
        """Return why a thruster cannot be switched so; '' if it can."""
        name, _, how = state.rpartition(' ')
        if name in self._names and how in SWITCHES:
            return ''
        expected = f'one of {", ".join(self._names)}, then {", ".join(SWITCHES)}'
        return f'a switch must be {expected}; got {shown(state)}'

    def take_event(self, tick: int, state: str) -> None:
        """Switch a thruster from a tick on: `NAME off` or `NAME on`, as is known; `NAME ready`."""
        name, _, how = state.rpartition(' ')
        if self.refusal(state):
            return
        at, rows = self._names.index(name), np.array(self.m.failures, np.int64).reshape(-1, 5)
        rows[rows[:, 0] == at, 3] = np.minimum(rows[rows[:, 0] == at, 3], tick)
        if how != READY:
            rows = np.vstack([rows, [at, ON if how == 'on' else OFF, tick, NEVER_TICK, 1]])
        self.m.failures = rows.tolist()


def stage_of(settings: Thrusters | None, scenario: Any) -> Stage:
    """Return the thrusters of a scenario as a stage of the chain."""
    if settings is not None and settings.table is not None:
        return TableStage(settings, scenario)
    if settings is not None and (settings.fires or settings.propellant):
        return ValvesStage(settings, scenario)
    return ThrustersStage(settings, scenario.max_force_n)


register(Section('thrusters', Thrusters, Place.THRUSTERS, stage_of, _check, always=True))
