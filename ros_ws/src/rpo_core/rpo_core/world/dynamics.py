# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""How chaser and target move: section `dynamics` of a scenario.

Without the section, and with kind `clohessy_wiltshire`, the target is on a circular orbit and the
step is exact (`rpo_core.world.cw`). The other kinds follow the target along its true orbit, and the
state is in axes that turn with it: x outward, z along the orbit's angular momentum, y completes
them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from functools import lru_cache, partial
from threading import Lock
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from rpo_core.files.codec import unless_default
from rpo_core.files.validation import Checked, InputError, choice, flag, optional, real
from rpo_core.kernels.arithmetic import State, sin_cos
from rpo_core.kernels.arrays import Floats
from rpo_core.kernels.jit import as_table
from rpo_core.stage import Place, Section, Signal, Stage, register
from rpo_core.wire.interfaces import CHASER_MASS, DISTURBANCE, RELATIVE_STATE, THRUST, THRUST_SHIFT
from rpo_core.world import cw, cw_kernels, orbit_kernels
from rpo_core.world.orbit_kernels import Environment

CLOHESSY_WILTSHIRE, LINEAR_ELLIPTIC, TWO_BODY = KINDS = (
    'clohessy_wiltshire',
    'linear_elliptic',
    'two_body',
)

MOST_TURN_RAD = 1.0 / 64.0
"""A step of the integration turns the target by no more at its periapsis; longer ticks have several
steps. The error of a step is then below 1e-11 of the relative state."""

_BLOCK_STEPS = 2048
"""Steps of the target's orbit that are computed at a time, so that memory stays flat."""


_ballistic = partial(real, unit='kg/m^2', least=1e-3, most=1e6)
_angle = partial(real, unit='deg', least=-360.0, most=360.0)
_inclination = partial(optional, unit='deg', least=0.0, most=180.0)


@dataclass(frozen=True, kw_only=True)
class Drag(Checked):
    """Drag on target and chaser: acceleration = -1/2 density v^2 / ballistic coefficient.

    density_kg_m3 : of the atmosphere at the distance `density_radius_m` from the body's centre;
        None: at `orbit_radius_m` of the scenario
    target_ballistic_coefficient_kg_m2, chaser_... : mass / (C_D x area); the chaser's at its start
    scale_height_m : the density falls by e over it; None: the density is the same everywhere
    atmosphere_rate_rad_s : at which the atmosphere turns with the body
    """

    density_kg_m3: Annotated[float, partial(real, unit='kg/m^3', least=0.0, most=1e-6)]
    target_ballistic_coefficient_kg_m2: Annotated[float, _ballistic]
    chaser_ballistic_coefficient_kg_m2: Annotated[float, _ballistic]
    scale_height_m: Annotated[float | None, partial(optional, unit='m', least=100.0, most=1e7)] = (
        unless_default(None)
    )
    density_radius_m: Annotated[
        float | None, partial(optional, unit='m', above=0.0, most=cw.MAX_ORBIT_RADIUS_M)
    ] = unless_default(None)
    atmosphere_rate_rad_s: Annotated[float, partial(real, unit='rad/s', least=-1e-2, most=1e-2)] = (
        unless_default(0.0)
    )


@dataclass(frozen=True, kw_only=True)
class Dynamics(Checked):
    """The target's orbit at tick 0, and what acts on both spacecraft.

    The semi-major axis is the scenario's `orbit_radius_m`. Where the orbit is circular, the true
    anomaly is counted from the ascending node.

    kind : `clohessy_wiltshire`, circular and linear; `linear_elliptic`, gravity linear in the
        relative position, any eccentricity; `two_body`, true gravity
    inclination_deg : to the body's equator; needed with `j2` or an atmosphere that turns
    j2 : whether the body's oblateness acts
    """

    kind: Annotated[str, partial(choice, known=KINDS)]
    eccentricity: Annotated[float, partial(real, least=0.0, below=1.0)] = unless_default(0.0)
    true_anomaly_deg: Annotated[float, _angle] = unless_default(0.0)
    argument_of_periapsis_deg: Annotated[float, _angle] = unless_default(0.0)
    inclination_deg: Annotated[float | None, _inclination] = unless_default(None)
    j2: Annotated[bool, flag] = unless_default(False)
    drag: Drag | None = unless_default(None)

    def __post_init__(self) -> None:
        super().__post_init__()
        others = [f.name for f in fields(self) if f.name != 'kind']
        given = [name for name in others if getattr(self, name) not in (0.0, False, None)]
        if self.kind == CLOHESSY_WILTSHIRE and given:
            raise InputError(
                f'`{given[0]}` needs `kind` {LINEAR_ELLIPTIC} or {TWO_BODY}; got {self.kind}'
            )
        forces = [name for name in given if name in ('j2', 'drag')]
        if self.kind == LINEAR_ELLIPTIC and forces:
            raise InputError(f'`{forces[0]}` needs `kind` {TWO_BODY}; got {self.kind}')
        turning = self.drag is not None and self.drag.atmosphere_rate_rad_s != 0.0
        if self.inclination_deg is None and (self.j2 or turning):
            what = 'j2' if self.j2 else 'drag.atmosphere_rate_rad_s'
            raise InputError(f'`inclination_deg` is missing; `{what}` needs it')


def _check(settings: Dynamics, scenario: Any) -> None:
    """Raise InputError where the body and the orbit of a scenario do not allow these dynamics."""
    body, periapsis_m = scenario.body, scenario.orbit_radius_m * (1.0 - settings.eccentricity)
    if periapsis_m < body.radius_m:
        raise InputError(
            f'`dynamics.eccentricity` must keep the periapsis at or above {body.radius_m:g} m, '
            f'the least radius about the body; got a periapsis of {periapsis_m:.6g} m'
        )
    if settings.j2 and body.j2 == 0.0:
        raise InputError('`dynamics.j2` needs a `body` with `j2`; got one whose `j2` is 0')


def environment_of(settings: Dynamics, scenario: Any) -> Environment:
    """Return what pulls at both spacecraft of a scenario."""
    body, drag = scenario.body, settings.drag
    oblate = 1.5 * body.j2 * body.mu_m3_s2 * body.equator_m * body.equator_m
    height_m = None if drag is None else drag.scale_height_m
    return Environment(
        mu=body.mu_m3_s2,
        j2=oblate if settings.j2 else 0.0,
        density=drag.density_kg_m3 if drag else 0.0,
        reference=(drag and drag.density_radius_m) or scenario.orbit_radius_m,
        thinning=1.0 / height_m if height_m else 0.0,
        spin=drag.atmosphere_rate_rad_s if drag else 0.0,
        target=1.0 / drag.target_ballistic_coefficient_kg_m2 if drag else 0.0,
        chaser=1.0 / drag.chaser_ballistic_coefficient_kg_m2 if drag else 0.0,
        linear=int(settings.kind == LINEAR_ELLIPTIC),
    )


def target_start(settings: Dynamics, scenario: Any) -> State:
    """Return the target's inertial state (6,) [m, m/s] at tick 0.

    x points to the ascending node, z along the body's pole. Without an inclination it is zero.
    """
    degree = math.pi / 180.0
    e, anomaly = settings.eccentricity, settings.true_anomaly_deg * degree
    sine, cosine = sin_cos(anomaly)
    su, cu = sin_cos(anomaly + settings.argument_of_periapsis_deg * degree)
    si, ci = sin_cos((settings.inclination_deg or 0.0) * degree)
    parameter = scenario.orbit_radius_m * (1.0 - e * e)
    radius, speed = parameter / (1.0 + e * cosine), math.sqrt(scenario.body.mu_m3_s2 / parameter)
    out, across = speed * e * sine, speed * (1.0 + e * cosine)
    x, y = (cu, su * ci, su * si), (-su, cu * ci, cu * si)
    vx, vy, vz = (out * a + across * b for a, b in zip(x, y, strict=True))
    return radius * x[0], radius * x[1], radius * x[2], vx, vy, vz


def steps_per_tick(settings: Dynamics, scenario: Any) -> int:
    """Return how many steps of the integration a tick has."""
    e = settings.eccentricity
    fastest = scenario.mean_motion_rad_s * (1.0 + e) ** 2 / (1.0 - e * e) ** 1.5
    return max(1, math.ceil(fastest * scenario.dt_s / MOST_TURN_RAD))


class TargetOrbit:
    """The target's orbit as rows of `orbit_kernels.COLUMNS` numbers, computed as far as needed.

    start : inertial state of the target at tick 0
    dt_s : of a tick, which has `steps` steps
    """

    def __init__(self, start: State, dt_s: float, steps: int, world: Environment) -> None:
        self.steps, self.world = steps, world
        self.step_s = dt_s / steps
        self.block_ticks = max(1, _BLOCK_STEPS // steps)
        self._starts = [start]
        self._blocks: dict[int, Any] = {}
        self._lock = Lock()  # threads of a campaign share orbits

    def block(self, number: int) -> Any:
        """Return the rows of the ticks from `number` x `block_ticks`, two rows for each step."""
        with self._lock:
            if number not in self._blocks:
                for before in range(min(number, len(self._starts) - 1), number):
                    self._compute(before)
                self._compute(number)
            return self._blocks[number]

    def _compute(self, number: int) -> None:
        rows = np.empty((2 * self.steps * self.block_ticks + 1, orbit_kernels.COLUMNS))
        last = orbit_kernels.fill_orbit(self._starts[number], self.step_s, self.world, rows)
        if number + 1 == len(self._starts):
            self._starts.append(last)
        while len(self._blocks) > 3:
            del self._blocks[next(iter(self._blocks))]
        self._blocks[number] = as_table(rows)

    def rows(self, ticks: int) -> Floats:
        """Return all rows (2 x steps x ticks + 1, COLUMNS) of a flight."""
        rows = np.empty((2 * self.steps * ticks + 1, orbit_kernels.COLUMNS))
        orbit_kernels.fill_orbit(self._starts[0], self.step_s, self.world, rows)
        return rows


@lru_cache(maxsize=8)
def _orbit(start: State, dt_s: float, steps: int, world: Environment) -> TargetOrbit:
    return TargetOrbit(start, dt_s, steps, world)


def orbit_of(settings: Dynamics, scenario: Any) -> TargetOrbit:
    """Return the target's orbit in a scenario; the same one for all its chains."""
    start, world = target_start(settings, scenario), environment_of(settings, scenario)
    return _orbit(start, scenario.dt_s, steps_per_tick(settings, scenario), world)


def _inputs(scenario: Any) -> tuple[str, ...]:
    """Return what dynamics read: also the mass where propellant is spent, the shift by turning."""
    falls = scenario.thrusters is not None and scenario.thrusters.propellant is not None
    turns = scenario.attitude is not None
    more = [CHASER_MASS] * falls + [THRUST_SHIFT] * turns
    return (RELATIVE_STATE, THRUST, DISTURBANCE, *more)


class DynamicsStage(Stage):
    """Clohessy-Wiltshire motion: from a true state and forces to the next true state.

    Where the mass falls, forces count as much more as they move a lighter chaser.
    """

    name = 'dynamics'
    outputs = (RELATIVE_STATE,)

    def __init__(self, scenario: Any) -> None:
        self._step, self._mass_kg = scenario.step, scenario.mass_kg
        self.inputs = _inputs(scenario)
        self._falls, self._turns = CHASER_MASS in self.inputs, THRUST_SHIFT in self.inputs

    def step(self, tick: int, *inputs: Any) -> tuple[Signal, ...]:
        """Return the state (6,) [m, m/s] one tick later."""
        state, (tx, ty, tz), (dx, dy, dz), *rest = inputs
        x, y, z = tx + dx, ty + dy, tz + dz
        mass = rest[0][0] if self._falls else self._mass_kg
        if self._falls:
            more = self._mass_kg / mass
            x, y, z = x * more, y * more, z * more
        found: State = cw_kernels.cw_step(state, (x, y, z), self._step)
        if not self._turns:
            return (found,)
        return (tuple(at + shift / mass for at, shift in zip(found, rest[-1], strict=True)),)

    def steps(self, ticks: NDArray[np.int64], *inputs: Floats) -> tuple[Floats, ...]:
        """Return the state (n, 6) that follows each tick."""
        states, thrust, disturbance, *rest = inputs
        forces, masses_kg = thrust + disturbance, rest[0] if self._falls else self._mass_kg
        if self._falls:
            forces = forces * (self._mass_kg / masses_kg)
        following = np.empty_like(states)
        cw_kernels.cw_steps(as_table(states), as_table(forces), self._step, following)
        if self._turns:
            following += rest[-1] / masses_kg
        return (following,)


class OrbitStage(Stage):
    """True motion about a target that follows its own orbit.

    It has no memory: where the target is at a tick is a function of the scenario.
    """

    name = 'dynamics'
    outputs = (RELATIVE_STATE,)

    def __init__(self, settings: Dynamics, scenario: Any) -> None:
        self._orbit, self._mass_kg = orbit_of(settings, scenario), scenario.mass_kg
        self.inputs = _inputs(scenario)

    def step(self, tick: int, *inputs: Any) -> tuple[Signal, ...]:
        """Return the state (6,) [m, m/s] one tick later."""
        state, (tx, ty, tz), (dx, dy, dz), *masses = inputs
        orbit, start_kg = self._orbit, self._mass_kg
        mass = masses[0][0] if masses else start_kg
        lightness = start_kg / mass
        number, within = divmod(tick, orbit.block_ticks)
        push = ((tx + dx) / mass, (ty + dy) / mass, (tz + dz) / mass)
        first = 2 * orbit.steps * within
        following: State = orbit_kernels.relative_step(
            state,
            push,
            lightness,
            orbit.block(number),
            first,
            orbit.steps,
            orbit.step_s,
            orbit.world,
        )
        return (following,)


def _make(settings: Dynamics | None, scenario: Any) -> Stage:
    if settings is None or settings.kind == CLOHESSY_WILTSHIRE:
        return DynamicsStage(scenario)
    return OrbitStage(settings, scenario)


register(Section('dynamics', Dynamics, Place.DYNAMICS, _make, _check, always=True))
