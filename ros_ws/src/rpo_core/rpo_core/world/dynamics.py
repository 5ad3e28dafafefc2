# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""How chaser and target move: section `dynamics` of a scenario.

Without the section, and with kind `clohessy_wiltshire`, the target is on a circular orbit and the
step is exact (`rpo_core.world.cw`). The other kinds follow the target along its true orbit, and the
state is in axes that turn with it: x outward, z along the orbit's angular momentum, y completes
them.

The kernels are + - * / sqrt and comparisons (`rpo_core.kernels.jit`), the same bits everywhere. The
target's orbit, and the chaser's motion relative to it, are integrated by the Runge-Kutta method of
fourth order, at a fixed step. Half-way through a step the target is where Hermite's cubic between
both ends puts it.

The chaser's state is (x, y, z, ux, uy, uz): relative position and inertial relative velocity, both
in axes of `target_lvlh`. So its equations need the rate w of the frame, not the derivative of w:

    r' = u - w x r,    u' = a - w x u

Only differences of gravity are computed, by Encke's method, so that nothing cancels.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from functools import partial
from math import sqrt
from typing import Annotated, Any, NamedTuple

from rpo_core.files.codec import unless_default
from rpo_core.files.validation import Checked, InputError, choice, flag, optional, real
from rpo_core.kernels.arithmetic import State, Vector, sin_cos
from rpo_core.kernels.jit import inlined, step_kernel
from rpo_core.stage import KernelStage, Place, Section, Stage, register
from rpo_core.wire.interfaces import CHASER_MASS, DISTURBANCE, RELATIVE_STATE, THRUST, THRUST_SHIFT
from rpo_core.world import cw
from rpo_core.world.cw import CwStep

_LN_2_A = (
    0.6931471803691238  # ln 2 in two parts; the first has 32 bits, so that k times it is exact
)
_LN_2_B = 1.9082149292705877e-10


class Environment(NamedTuple):
    """What pulls at both spacecraft.

    mu : [m^3/s^2]; j2 : 3/2 J2 mu Re^2 [m^5/s^2], 0 without
    density : at the distance `reference` [m] from the centre of the body [kg/m^3], 0 without drag
    thinning : 1 / scale height [1/m], 0 where the density is constant
    spin : of the atmosphere with the body [rad/s]
    target, chaser : C_D A / m, the inverse of the ballistic coefficient [m^2/kg]
    linear : 1 where gravity is linear in the relative position, else 0
    """

    mu: float
    j2: float
    density: float
    reference: float
    thinning: float
    spin: float
    target: float
    chaser: float
    linear: int


Row = tuple[float, float, float, float, float, float, float, float, float, float, float]
"""Row of `COLUMNS` numbers of the target's orbit."""

COLUMNS = 11
"""Numbers of a row of the target's orbit: distance R [m] from the body's centre; rate of LVLH about
its x and its z axis [rad/s] (that about y is zero); inertial velocity along x and y [m/s]; the
body's pole, unit vector in LVLH; what accelerates the target beside point-mass gravity, in LVLH
[m/s^2]."""


class TargetState(NamedTuple):
    """The target at a time: inertial state (6,) [m, m/s], its derivative, the row of its orbit."""

    state: State
    rate: State
    row: Row


@inlined
def exponential(x: float) -> float:
    """e^x, from + - * / only, right to 2e-15 of itself; 0 below -700, e^700 above 700."""
    if x < -700.0:
        return 0.0
    x = 700.0 if x > 700.0 else x
    turns = x * 1.4426950408889634
    k = int(turns + 0.5) if turns >= 0.0 else int(turns - 0.5)
    r = (x - k * _LN_2_A) - k * _LN_2_B
    # fmt: off
    tail = 1 / 40320 + r * (1 / 362880 + r * (1 / 3628800 + r * (1 / 39916800 + r * (
        1 / 479001600 + r * (1 / 6227020800)))))
    total = 1.0 + r * (1.0 + r * (1 / 2 + r * (1 / 6 + r * (1 / 24 + r * (1 / 120 + r * (
        1 / 720 + r * (1 / 5040 + r * tail)))))))
    # fmt: on
    # By 2^k, exactly, bit by bit of k.
    size, factor = abs(k), 2.0 if k > 0 else 0.5
    while size > 0:
        total *= factor if size & 1 else 1.0
        size, factor = size >> 1, factor * factor
    return total


@inlined
def pull(
    position: Vector, velocity: Vector, pole: Vector, inverse: float, w: Environment
) -> Vector:
    """Acceleration (3,) [m/s^2] beside point-mass gravity: the body's J2, and drag.

    J2 as in Vallado, Fundamentals of Astrodynamics and Applications, equation 8-30, for any axes.

    position : from the centre of the body; velocity : inertial; pole : unit vector; all in the
        same axes
    inverse : of the ballistic coefficient [m^2/kg]
    """
    x, y, z = position
    px, py, pz = pole
    square = x * x + y * y + z * z
    radius = sqrt(square)
    ax = ay = az = 0.0
    if w.j2 != 0.0:
        height = x * px + y * py + z * pz
        factor = -w.j2 / (square * square * radius)
        along = 1.0 - 5.0 * height * height / square
        ax = factor * (along * x + 2.0 * height * px)
        ay = factor * (along * y + 2.0 * height * py)
        az = factor * (along * z + 2.0 * height * pz)
    if w.density != 0.0:
        vx = velocity[0] - w.spin * (py * z - pz * y)
        vy = velocity[1] - w.spin * (pz * x - px * z)
        vz = velocity[2] - w.spin * (px * y - py * x)
        density = w.density
        if w.thinning != 0.0:
            density *= exponential((w.reference - radius) * w.thinning)
        factor = -0.5 * density * inverse * sqrt(vx * vx + vy * vy + vz * vz)
        ax += factor * vx
        ay += factor * vy
        az += factor * vz
    return ax, ay, az


@inlined
def moved(s: State, rate: State, h: float) -> State:
    """Return s + h * rate."""
    return (
        s[0] + h * rate[0],
        s[1] + h * rate[1],
        s[2] + h * rate[2],
        s[3] + h * rate[3],
        s[4] + h * rate[4],
        s[5] + h * rate[5],
    )


@inlined
def gathered(a: State, b: State, c: State, d: State) -> State:
    """Return the mean rate of a step of Runge and Kutta from those at its four points."""
    return (
        (a[0] + 2.0 * (b[0] + c[0]) + d[0]) / 6.0,
        (a[1] + 2.0 * (b[1] + c[1]) + d[1]) / 6.0,
        (a[2] + 2.0 * (b[2] + c[2]) + d[2]) / 6.0,
        (a[3] + 2.0 * (b[3] + c[3]) + d[3]) / 6.0,
        (a[4] + 2.0 * (b[4] + c[4]) + d[4]) / 6.0,
        (a[5] + 2.0 * (b[5] + c[5]) + d[5]) / 6.0,
    )


@inlined
def target_rate(s: State, w: Environment) -> State:
    """Return the derivative of the target's inertial state (6,); the body's pole is the z axis."""
    x, y, z, vx, vy, vz = s
    square = x * x + y * y + z * z
    k = -w.mu / (square * sqrt(square))
    ax, ay, az = pull((x, y, z), (vx, vy, vz), (0.0, 0.0, 1.0), w.target, w)
    return vx, vy, vz, k * x + ax, k * y + ay, k * z + az


@inlined
def target_step(s: State, a: State, h: float, w: Environment) -> State:
    """Target's inertial state (6,) [m, m/s] a time h [s] later; a is its derivative now."""
    b = target_rate(moved(s, a, 0.5 * h), w)
    c = target_rate(moved(s, b, 0.5 * h), w)
    d = target_rate(moved(s, c, h), w)
    return moved(s, gathered(a, b, c, d), h)


@inlined
def orbit_row(s: State, w: Environment) -> Row:
    """Row of `COLUMNS` numbers of a target's inertial state (6,).

    LVLH turns about z by h / R^2, and about x by R a_z / h, where the acceleration a_z leaves the
    plane of the orbit; h is the angular momentum.
    """
    x, y, z, vx, vy, vz = s
    radius = sqrt(x * x + y * y + z * z)
    hx, hy, hz = y * vz - z * vy, z * vx - x * vz, x * vy - y * vx
    momentum = sqrt(hx * hx + hy * hy + hz * hz)
    across = momentum / radius
    outward = (x * vx + y * vy + z * vz) / radius
    pole = (z / radius, (hx * y - hy * x) / (momentum * radius), hz / momentum)
    a = pull((radius, 0.0, 0.0), (outward, across, 0.0), pole, w.target, w)
    about_x, about_z = a[2] / across, across / radius
    return (
        radius, about_x, about_z, outward, across, pole[0], pole[1], pole[2], a[0], a[1], a[2]
    )  # fmt: skip


@inlined
def middle(s: State, rate: State, after: State, rate_after: State, h: float) -> State:
    """State half-way through a step: Hermite's cubic, wrong by h^4 / 384 of the 4th derivative."""
    e = 0.125 * h
    return (
        0.5 * (s[0] + after[0]) + e * (rate[0] - rate_after[0]),
        0.5 * (s[1] + after[1]) + e * (rate[1] - rate_after[1]),
        0.5 * (s[2] + after[2]) + e * (rate[2] - rate_after[2]),
        0.5 * (s[3] + after[3]) + e * (rate[3] - rate_after[3]),
        0.5 * (s[4] + after[4]) + e * (rate[4] - rate_after[4]),
        0.5 * (s[5] + after[5]) + e * (rate[5] - rate_after[5]),
    )


@inlined
def relative_rate(s: State, push: Vector, lightness: float, o: Any, w: Environment) -> State:
    """Return the derivative of the chaser's state (x, y, z, ux, uy, uz).

    push : force over mass (3,) [m/s^2]
    lightness : mass at the start over mass now
    o : row of the target's orbit
    """
    x, y, z, ux, uy, uz = s
    radius, about_x, about_z = o[0], o[1], o[2]
    k = w.mu / (radius * radius * radius)
    ax, ay, az = push
    if w.linear == 1:
        ax += 2.0 * k * x
        ay -= k * y
        az -= k * z
    else:
        # Battin, Mathematics and Methods of Astrodynamics (1999), section 8.7: -k (d + F(q) r).
        away = radius + x
        q = -(x * (away + radius) + y * y + z * z) / (away * away + y * y + z * z)
        f = q * (3.0 + q * (3.0 + q)) / (1.0 + (1.0 + q) * sqrt(1.0 + q))
        ax -= k * (x + f * away)
        ay -= k * (y + f * y)
        az -= k * (z + f * z)
    if w.j2 != 0.0 or w.density != 0.0:
        velocity, pole = (o[3] + ux, o[4] + uy, uz), (o[5], o[6], o[7])
        own = pull((radius + x, y, z), velocity, pole, w.chaser * lightness, w)
        ax += own[0] - o[8]
        ay += own[1] - o[9]
        az += own[2] - o[10]
    return (
        ux + about_z * y,
        uy - about_z * x + about_x * z,
        uz - about_x * y,
        ax + about_z * uy,
        ay - about_z * ux + about_x * uz,
        az - about_x * uy,
    )


@inlined
def relative_after(
    s: State,
    push: Vector,
    lightness: float,
    begin: Any,
    middle: Any,
    end: Any,
    h: float,
    w: Environment,
) -> State:
    """Return the chaser's state (x, y, z, ux, uy, uz) a step of h [s] later.

    begin, middle, end : rows of the target's orbit
    """
    a = relative_rate(s, push, lightness, begin, w)
    b = relative_rate(moved(s, a, 0.5 * h), push, lightness, middle, w)
    c = relative_rate(moved(s, b, 0.5 * h), push, lightness, middle, w)
    d = relative_rate(moved(s, c, h), push, lightness, end, w)
    return moved(s, gathered(a, b, c, d), h)


@inlined
def inertial(state: State, about_x: float, about_z: float) -> State:
    """Return (x, y, z, ux, uy, uz) of a state in LVLH, which turns about x and z [rad/s]."""
    x, y, z, vx, vy, vz = state
    return x, y, z, vx - about_z * y, vy + about_z * x - about_x * z, vz + about_x * y


@inlined
def turning(s: State, about_x: float, about_z: float) -> State:
    """Return the state in LVLH of (x, y, z, ux, uy, uz): the inverse of `inertial`."""
    x, y, z, ux, uy, uz = s
    return x, y, z, ux + about_z * y, uy - about_z * x + about_x * z, uz - about_x * y


@inlined
def target_at(target: State, steps: int, h: float, w: Environment) -> TargetState:
    """Return the target some steps of h [s] after an inertial state (6,) [m, m/s]."""
    rate = target_rate(target, w)
    for _ in range(steps):
        target = target_step(target, rate, h, w)
        rate = target_rate(target, w)
    return TargetState(target, rate, orbit_row(target, w))


@inlined
def orbit_tick(
    state: State,
    push: Vector,
    lightness: float,
    t: TargetState,
    steps: int,
    h: float,
    w: Environment,
) -> tuple[State, TargetState]:
    """Chaser's state (6,) [m, m/s], target LVLH, and the target a tick of steps of h [s] later.

    push : force over mass (3,) [m/s^2], constant in the axes of LVLH during the tick
    """
    target, rate, begin = t.state, t.rate, t.row
    s = inertial(state, begin[1], begin[2])
    for _ in range(steps):
        after = target_step(target, rate, h, w)
        rate_after, end = target_rate(after, w), orbit_row(after, w)
        half = orbit_row(middle(target, rate, after, rate_after, h), w)
        s = relative_after(s, push, lightness, begin, half, end, h, w)
        target, rate, begin = after, rate_after, end
    return turning(s, begin[1], begin[2]), TargetState(target, rate, begin)


CLOHESSY_WILTSHIRE, LINEAR_ELLIPTIC, TWO_BODY = KINDS = (
    'clohessy_wiltshire',
    'linear_elliptic',
    'two_body',
)

MOST_TURN_RAD = 1.0 / 64.0
"""A step of the integration turns the target by no more at its periapsis; longer ticks have several
steps. The error of a step is then below 1e-11 of the relative state."""

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


def _inputs(scenario: Any) -> tuple[str, ...]:
    """Return what dynamics read: also the mass where propellant is spent, the shift by turning."""
    falls = scenario.thrusters is not None and scenario.thrusters.propellant is not None
    turns = scenario.attitude is not None
    more = [CHASER_MASS] * falls + [THRUST_SHIFT] * turns
    return (RELATIVE_STATE, THRUST, DISTURBANCE, *more)


@dataclass(slots=True)
class Motion:
    """Settings of the kernel `move`.

    mass_kg : at the start; falls, turns : 1 where the mass, and the shift by turning, are read
    """

    step: CwStep
    mass_kg: float
    falls: int
    turns: int


@step_kernel
def move(tick: int, u: Any, p: Any, m: Any, y: Any) -> None:
    """x_(k+1) = Phi x_k + Gamma (f + d), exact under forces that are constant in a tick.

    u : state (6,) [m, m/s], thrust and disturbance (3,) [N], target LVLH, then the mass [kg] where
        it falls, and the shift (6,) where the chaser turns; y : state (6,) one tick later
    """
    fx, fy, fz, mass = u[6] + u[9], u[7] + u[10], u[8] + u[11], p.mass_kg
    if p.falls:
        mass = u[12]
        more = p.mass_kg / mass
        fx, fy, fz = fx * more, fy * more, fz * more
    state = cw.cw_step((u[0], u[1], u[2], u[3], u[4], u[5]), (fx, fy, fz), p.step)
    for i in range(6):
        y[i] = state[i] + u[12 + p.falls + i] / mass if p.turns else state[i]


class DynamicsStage(KernelStage):
    """Clohessy-Wiltshire motion: from a true state and forces to the next true state.

    Where the mass falls, forces count as much more as they move a lighter chaser.
    """

    name = 'dynamics'
    outputs = (RELATIVE_STATE,)
    kernel = move

    def __init__(self, scenario: Any) -> None:
        self.inputs = _inputs(scenario)
        flags = int(CHASER_MASS in self.inputs), int(THRUST_SHIFT in self.inputs)
        super().__init__(Motion(scenario.step, scenario.mass_kg, *flags))


@dataclass(slots=True)
class Orbit:
    """Settings of the kernel `follow`.

    start : inertial state (6,) of the target at tick 0 [m, m/s]
    steps, step_s : steps of a tick, and how long one is
    mass_kg : at the start; falls : 1 where the mass is read
    """

    world: Environment
    start: State
    steps: int
    step_s: float
    mass_kg: float
    falls: int


@dataclass(slots=True)
class Followed:
    """Memory of the kernel `follow`: the target at the beginning of a tick, as of `TargetState`."""

    tick: int
    state: Annotated[list[float], 6]
    rate: Annotated[list[float], 6]
    row: Annotated[list[float], COLUMNS]


@step_kernel
def follow(tick: int, u: Any, p: Any, m: Any, y: Any) -> None:
    """Step the chaser and its target, each on its orbit, by a tick: see `orbit_tick`.

    The target at a tick is a function of the settings: the memory has where it is, unless ticks are
    missing or come again.

    u : state (6,) [m, m/s], thrust and disturbance (3,) [N], target LVLH, then the mass [kg] where
        it falls; y : state (6,) one tick later
    """
    s, r, o, w = m.state, m.rate, m.row, p.world
    if 0 < tick == m.tick:
        row = (o[0], o[1], o[2], o[3], o[4], o[5], o[6], o[7], o[8], o[9], o[10])
        target = TargetState(
            (s[0], s[1], s[2], s[3], s[4], s[5]), (r[0], r[1], r[2], r[3], r[4], r[5]), row
        )
    else:
        first = 0 if tick < m.tick else m.tick
        a = p.start if first == 0 else s
        steps = (tick - first) * p.steps
        target = target_at((a[0], a[1], a[2], a[3], a[4], a[5]), steps, p.step_s, w)
    mass = u[12] if p.falls else p.mass_kg
    push = ((u[6] + u[9]) / mass, (u[7] + u[10]) / mass, (u[8] + u[11]) / mass)
    state = (u[0], u[1], u[2], u[3], u[4], u[5])
    state, target = orbit_tick(state, push, p.mass_kg / mass, target, p.steps, p.step_s, w)
    y[0], y[1], y[2], y[3], y[4], y[5] = state
    m.tick = tick + 1
    s[0], s[1], s[2], s[3], s[4], s[5] = target.state
    r[0], r[1], r[2], r[3], r[4], r[5] = target.rate
    o[0], o[1], o[2], o[3], o[4], o[5], o[6], o[7], o[8], o[9], o[10] = target.row


class OrbitStage(KernelStage):
    """True motion about a target that follows its own orbit.

    It depends on no earlier tick: where the target is at a tick is a function of the scenario.
    """

    name = 'dynamics'
    outputs = (RELATIVE_STATE,)
    kernel = follow

    def __init__(self, settings: Dynamics, scenario: Any) -> None:
        self.inputs, steps = _inputs(scenario), steps_per_tick(settings, scenario)
        start, world = target_start(settings, scenario), environment_of(settings, scenario)
        falls = int(CHASER_MASS in self.inputs)
        orbit = Orbit(world, start, steps, scenario.dt_s / steps, scenario.mass_kg, falls)
        super().__init__(orbit, Followed(0, [0.0] * 6, [0.0] * 6, [0.0] * COLUMNS))


def _make(settings: Dynamics | None, scenario: Any) -> Stage:
    if settings is None or settings.kind == CLOHESSY_WILTSHIRE:
        return DynamicsStage(scenario)
    return OrbitStage(settings, scenario)


register(Section('dynamics', Dynamics, Place.DYNAMICS, _make, _check, always=True))
