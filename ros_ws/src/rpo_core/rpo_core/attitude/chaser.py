# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The attitude of the chaser: sections `attitude` and `unloading` of a scenario.

With section `attitude` the chaser is a rigid body with three wheels whose thrusters turn with it.
Without it its axes are those of target LVLH. Quaternions and rates are as in `attitude_kernels`;
torque, force and momentum are in the chaser's axes unless said otherwise.

Unloading: while a wheel has more than a momentum, the thrusters exert a torque against it, which
the wheel takes up: the chaser does not feel it. docs/safety.md, lemma 9, has what that bounds.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from math import radians, sqrt
from typing import Annotated, Any, NamedTuple

from rpo_core.attitude.attitude_kernels import (
    Attitude,
    Body,
    accelerated,
    cross,
    frame_of,
    momentum_of,
    plus,
    turning_at,
)
from rpo_core.attitude.target import (
    ALIGNED,
    Quaternion,
    body_of,
    check_turning,
    inertia,
    product,
    quaternion,
)
from rpo_core.files.codec import unless_default
from rpo_core.files.validation import Checked, InputError, flag, optional, real, vector3
from rpo_core.kernels.arithmetic import State, Vector, norm, saturate
from rpo_core.kernels.jit import inlined, kernel, step_kernel
from rpo_core.stage import ZERO, KernelStage, Place, Section, register
from rpo_core.wire import interfaces


class Craft(NamedTuple):
    """A chaser as the kernels read it.

    body : its inertia, and the orbit
    gradient : 3 n^2 where gravity turns it [rad^2/s^2]; 0.0 where not
    torque, momentum : largest of a wheel, one along each axis [N m], [N m s]; 0.0: no wheels
    x, y, z : torque from outside [N m]
    """

    body: Body
    gradient: float
    torque: float
    momentum: float
    x: float
    y: float
    z: float


@inlined
def turn(v: Vector, q: Quaternion) -> Vector:
    """Return a vector of the body's axes in target LVLH."""
    u = (q[0], q[1], q[2])
    x, y, z = cross(u, v)
    x, y, z = x + x, y + y, z + z
    a, b, c = cross(u, (x, y, z))
    return v[0] + q[3] * x + a, v[1] + q[3] * y + b, v[2] + q[3] * z + c


@inlined
def turn_back(v: Vector, q: Quaternion) -> Vector:
    """Return a vector of target LVLH in the body's axes."""
    return turn(v, (-q[0], -q[1], -q[2], q[3]))


times = inlined(product)
"""The attitude q, then p: `product` for kernels."""


@inlined
def relative_to(p: Quaternion, q: Quaternion) -> Quaternion:
    """Return the attitude q as a body with the attitude p sees it."""
    return times((-p[0], -p[1], -p[2], p[3]), q)


@inlined
def upright(q: Quaternion) -> Quaternion:
    """Return a quaternion of length 1 with w >= 0."""
    x, y, z, w = q
    size = sqrt(x * x + y * y + z * z + w * w)
    size = size if w >= 0.0 else -size
    return x / size, y / size, z / size, w / size


@inlined
def _change(a: Attitude, h: Vector, torque: Vector, c: Craft) -> Attitude:
    """Return the derivative of an attitude; h : momentum of the wheels now [N m s].

    Gravity pulls the long axis towards the vertical: 3 n^2 o x J o, o = x of LVLH (Hughes,
    "Spacecraft Attitude Dynamics", 1986, 8.1).
    """
    x, y, z, w, p, q, r = a
    b = c.body
    g = momentum_of((p, q, r), b)
    tx, ty, tz = cross((g[0] + h[0], g[1] + h[1], g[2] + h[2]), (p, q, r))
    tx, ty, tz = tx + torque[0], ty + torque[1], tz + torque[2]
    if c.gradient > 0.0:
        up = (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w))
        ux, uy, uz = cross(up, momentum_of(up, b))
        tx, ty, tz = tx + c.gradient * ux, ty + c.gradient * uy, tz + c.gradient * uz
    return turning_at(a, b.orbit, accelerated((tx, ty, tz), b))


@inlined
def _ahead(v: Vector, h: float, rate: Vector) -> Vector:
    return v[0] + h * rate[0], v[1] + h * rate[1], v[2] + h * rate[2]


@inlined
def unit(a: Attitude) -> Attitude:
    """Return an attitude whose quaternion has length 1 and w >= 0."""
    x, y, z, w = upright((a[0], a[1], a[2], a[3]))
    return x, y, z, w, a[4], a[5], a[6]


@inlined
def chaser_step(
    a: Attitude, wheels: Vector, torque: Vector, spun: Vector, h: float, c: Craft
) -> Attitude:
    """Return the attitude a time h [s] later, by Runge and Kutta's method of fourth order.

    wheels : their momentum now; spun : its change a second; torque : on the body, that of the
    wheels too
    """
    half = _ahead(wheels, 0.5 * h, spun)
    k1 = _change(a, wheels, torque, c)
    k2 = _change(plus(a, 0.5 * h, k1), half, torque, c)
    k3 = _change(plus(a, 0.5 * h, k2), half, torque, c)
    k4 = _change(plus(a, h, k3), _ahead(wheels, h, spun), torque, c)
    s = plus(plus(a, h / 6.0, k1), h / 3.0, k2)
    return unit(plus(plus(s, h / 3.0, k3), h / 6.0, k4))


@inlined
def _spun(wanted: float, momentum: float, dt: float, c: Craft) -> float:
    """Return the torque that a wheel takes from the body: limited, and none beyond its momentum."""
    torque = c.torque if wanted > c.torque else -c.torque if wanted < -c.torque else wanted
    after = momentum - torque * dt
    if after > c.momentum:
        return (momentum - c.momentum) / dt
    return (momentum + c.momentum) / dt if after < -c.momentum else torque


@inlined
def _against(momentum: float, above: float, torque: float) -> float:
    return -torque if momentum > above else torque if momentum < -above else 0.0


@kernel
def unloaded(wheels: Vector, above: float, torque: float, dt: float) -> tuple[Vector, Vector]:
    """Return the torque [N m] of thrusters on each wheel above a momentum [N m s], to empty it.

    And the momentum of the wheels after a tick of it; torque : 0.0 where none are unloaded
    """
    if torque == 0.0:
        return (0.0, 0.0, 0.0), wheels
    x, y, z = wheels
    u = (_against(x, above, torque), _against(y, above, torque), _against(z, above, torque))
    return u, _ahead(wheels, dt, u)


@inlined
def wheels_after(wheels: Vector, torque: Vector, dt: float, most: float) -> Vector:
    """Return the momentum (3,) [N m s] of wheels that exert a torque on the body for a tick."""
    return (
        saturate(wheels[0] - torque[0] * dt, most),
        saturate(wheels[1] - torque[1] * dt, most),
        saturate(wheels[2] - torque[2] * dt, most),
    )


@inlined
def chaser_tick(
    a: Attitude, wheels: Vector, wanted: Vector, outside: Vector, dt: float, c: Craft
) -> tuple[Attitude, Attitude, Vector]:
    """Return the attitude in the middle and at the end of a tick, and the momentum of the wheels.

    wanted : torque that the wheels shall exert on the body [N m]; outside : other torque, beside
    that of the craft
    """
    mine = (
        _spun(wanted[0], wheels[0], dt, c),
        _spun(wanted[1], wheels[1], dt, c),
        _spun(wanted[2], wheels[2], dt, c),
    )
    spun = (-mine[0], -mine[1], -mine[2])
    torque = (
        mine[0] + outside[0] + c.x, mine[1] + outside[1] + c.y, mine[2] + outside[2] + c.z,
    )  # fmt: skip
    h = 0.5 * dt
    middle = chaser_step(a, wheels, torque, spun, h, c)
    half = _ahead(wheels, h, spun)
    end = chaser_step(middle, half, torque, spun, h, c)
    return middle, end, _ahead(half, h, spun)


@inlined
def turned_force(
    force: Vector, begin: Attitude, middle: Attitude, end: Attitude, dt: float, orbit: float
) -> tuple[Vector, State]:
    """Return the mean of a force that turns with the body [N], and what it shifts the chaser.

    By Simpson's rule; both in target LVLH. The second is position x mass [N s^2] and velocity x
    mass [N s], beyond what the mean gives: a force that comes early moves the chaser farther than
    one that comes late, and Coriolis' force turns that into speed.
    """
    ax, ay, az = turn(force, (begin[0], begin[1], begin[2], begin[3]))
    bx, by, bz = turn(force, (middle[0], middle[1], middle[2], middle[3]))
    cx, cy, cz = turn(force, (end[0], end[1], end[2], end[3]))
    k, twice = dt * dt / 12.0, orbit + orbit
    x, y, z = k * (ax - cx), k * (ay - cy), k * (az - cz)
    return (
        ((ax + 4.0 * bx + cx) / 6.0, (ay + 4.0 * by + cy) / 6.0, (az + 4.0 * bz + cz) / 6.0),
        (x, y, z, twice * y, -twice * x, 0.0),
    )


_torque = partial(real, unit='N m', above=0.0, most=1e6)
_momentum = partial(real, unit='N m s', above=0.0, most=1e6)
_torques = partial(vector3, unit='N m', bound=1e6)
_momenta = partial(vector3, unit='N m s', bound=1e6)
_rates = partial(optional, check=vector3, unit='deg/s', bound=360.0)


@dataclass(frozen=True, kw_only=True)
class Wheels(Checked):
    """Three wheels, one along each axis of the chaser.

    torque_nm, momentum_nms : largest of each, momentum against inertial space
    start_nms : (3,) momentum at tick 0
    """

    torque_nm: Annotated[float, _torque]
    momentum_nms: Annotated[float, _momentum]
    start_nms: Annotated[Vector, _momenta] = unless_default(ZERO)

    def __post_init__(self) -> None:
        super().__post_init__()
        if max(map(abs, self.start_nms)) > self.momentum_nms:
            raise InputError(
                f'`start_nms` must be at most `momentum_nms`, {self.momentum_nms!r} N m s; '
                f'got {list(self.start_nms)!r}'
            )


@dataclass(frozen=True, kw_only=True)
class Chaser(Checked):
    """The chaser as a rigid body.

    inertia_kg_m2 : (3, 3) about its centre of mass, its axes
    Commands are turned into its axes by section `attitude_control`; without it they are in them.

    attitude : quaternion x, y, z, w at tick 0, from its axes to target LVLH
    rates_deg_s : (3,) at tick 0, its axes, against inertial space; None: it turns with target LVLH
    wheels : None: torque is that of `thrusters.table`
    gravity_gradient : whether gravity turns it
    disturbance_torque_nm : (3,) constant, its axes
    """

    inertia_kg_m2: Annotated[Any, inertia]
    attitude: Annotated[Quaternion, quaternion] = ALIGNED
    rates_deg_s: Annotated[Vector | None, _rates] = unless_default(None)
    wheels: Wheels | None = unless_default(None)
    gravity_gradient: Annotated[bool, flag] = unless_default(True)
    disturbance_torque_nm: Annotated[Vector, _torques] = unless_default(ZERO)

    def craft(self, orbit_rad_s: float) -> Craft:
        """Return the chaser as the kernels read it."""
        wheels, n = self.wheels, orbit_rad_s
        return Craft(
            body_of(self.inertia_kg_m2, n),
            3.0 * n * n if self.gravity_gradient else 0.0,
            wheels.torque_nm if wheels else 0.0,
            wheels.momentum_nms if wheels else 0.0,
            *map(float, self.disturbance_torque_nm),
        )

    def start(self, orbit_rad_s: float) -> Attitude:
        """Return quaternion and rate at tick 0."""
        n = orbit_rad_s
        if self.rates_deg_s is not None:
            p, q, r = map(radians, self.rates_deg_s)
        else:
            f = frame_of((*self.attitude, 0.0, 0.0, 0.0), body_of(self.inertia_kg_m2, n))
            p, q, r = n * f.zx, n * f.zy, n * f.zz
        attitude: Attitude = unit((*self.attitude, p, q, r))
        return attitude


@dataclass(slots=True)
class Turning:
    """Settings of the kernel `rotate`; dt_s : of a tick.

    commanded, fired, unloaded : 1 where the torque of wheels, of thrusters, and that which empties
        the wheels, are read
    """

    craft: Craft
    dt_s: float
    commanded: int
    fired: int
    unloaded: int


@dataclass(slots=True)
class Momentum:
    """Memory of what has wheels: their momentum."""

    wheels_nms: Annotated[list[float], 3]


@step_kernel
def rotate(tick: int, u: Any, p: Any, m: Any, y: Any) -> None:
    """Turn the chaser by a tick, and its thrust with it: `chaser_tick`, `turned_force`.

    u : attitude (7,), force [N], then the torques that are read [N m], all of the chaser's axes
    y : mean force (3,) [N], its shift (6,), in target LVLH; momentum of the wheels (3,) [N m s] at
        the beginning of the tick, attitude (7,) at its end
    """
    attitude, force = (u[0], u[1], u[2], u[3], u[4], u[5], u[6]), (u[7], u[8], u[9])
    wanted, outside, at = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 10
    if p.commanded:
        wanted, at = (u[at], u[at + 1], u[at + 2]), at + 3
    if p.fired:
        outside, at = (u[at], u[at + 1], u[at + 2]), at + 3
    if p.unloaded:  # the wheels take up what empties them
        wanted = (wanted[0] - u[at], wanted[1] - u[at + 1], wanted[2] - u[at + 2])
    w = m.wheels_nms
    wheels = (w[0], w[1], w[2])
    middle, end, after = chaser_tick(attitude, wheels, wanted, outside, p.dt_s, p.craft)
    mean, shift = turned_force(force, attitude, middle, end, p.dt_s, p.craft.body.orbit)
    y[0], y[1], y[2] = mean
    y[3], y[4], y[5], y[6], y[7], y[8] = shift
    y[9], y[10], y[11] = wheels
    y[12], y[13], y[14], y[15], y[16], y[17], y[18] = end
    w[0], w[1], w[2] = after


class AttitudeStage(KernelStage):
    """The chaser turns by a tick, and its thrust with it."""

    name = 'attitude'
    outputs = (
        interfaces.EXERTED_FORCE,
        interfaces.THRUST_SHIFT,
        interfaces.WHEEL_MOMENTUM,
        interfaces.CHASER_ATTITUDE,
    )
    memory_ticks = None
    counts_ticks = False
    kernel = rotate

    def __init__(self, settings: Chaser, scenario: Any) -> None:
        steered = scenario.named('attitude_control') is not None
        commanded = steered and settings.wheels is not None
        fired = getattr(scenario.thrusters, 'table', None) is not None
        unloaded = scenario.named('unloading') is not None
        self.inputs = (
            interfaces.CHASER_ATTITUDE,
            interfaces.THRUST,
            *([interfaces.BODY_TORQUE] if commanded else []),
            *([interfaces.EXERTED_TORQUE] if fired else []),
            *([interfaces.UNLOADING_TORQUE] if unloaded else []),
        )
        craft, flags = settings.craft(scenario.mean_motion_rad_s), (commanded, fired, unloaded)
        start = settings.wheels.start_nms if settings.wheels else ZERO
        super().__init__(
            Turning(craft, scenario.dt_s, *map(int, flags)), Momentum(list(map(float, start)))
        )


def _check(settings: Chaser, scenario: Any) -> None:
    """Raise InputError where a scenario does not allow a chaser that turns."""
    rates = settings.start(scenario.mean_motion_rad_s)[4:]
    check_turning('attitude', norm(*rates), scenario)
    if scenario.named('estimator') is not None and scenario.named('attitude_control') is None:
        raise InputError(
            '`attitude_control` is missing: `estimator` takes commands to act as they are in LVLH'
        )


register(Section('attitude', Chaser, Place.ATTITUDE, AttitudeStage, _check))


@dataclass(frozen=True, kw_only=True)
class Unloading(Checked):
    """When the thrusters empty the wheels.

    above_nms : momentum of a wheel above which they do
    torque_nm : of the thrusters about each axis
    """

    above_nms: Annotated[float, partial(real, unit='N m s', least=0.0, most=1e6)]
    torque_nm: Annotated[float, partial(real, unit='N m', above=0.0, most=1e6)]


@dataclass(slots=True)
class Emptying:
    """Settings of the kernel `empty`: see `Unloading`; full_nms : momentum of a wheel."""

    above_nms: float
    torque_nm: float
    full_nms: float
    dt_s: float


@step_kernel
def empty(tick: int, u: Any, p: Any, m: Any, y: Any) -> None:
    """Return the torque y (3,) [N m] that empties the wheels, axes of the chaser: `unloaded`.

    u : torque (3,) that is commanded [N m]
    """
    w = m.wheels_nms
    torque, spun = unloaded((w[0], w[1], w[2]), p.above_nms, p.torque_nm, p.dt_s)
    y[0], y[1], y[2] = torque
    w[0], w[1], w[2] = wheels_after(spun, (u[0], u[1], u[2]), p.dt_s, p.full_nms)


class UnloadingStage(KernelStage):
    """The torque that empties the wheels; memory: their momentum, by the commands."""

    name = 'unloading'
    inputs = (interfaces.BODY_TORQUE,)
    outputs = (interfaces.UNLOADING_TORQUE,)
    memory_ticks = None
    counts_ticks = False
    kernel = empty

    def __init__(self, settings: Unloading, scenario: Any) -> None:
        wheels, dt_s = scenario.attitude.wheels, scenario.dt_s
        numbers = settings.above_nms, settings.torque_nm, wheels.momentum_nms, dt_s
        super().__init__(Emptying(*numbers), Momentum(list(map(float, wheels.start_nms))))


def _check_unloading(settings: Unloading, scenario: Any) -> None:
    """Raise InputError where there is nothing to unload, or to unload with."""
    wheels = scenario.attitude.wheels if scenario.attitude else None
    table = scenario.thrusters.table if scenario.thrusters else None
    if wheels is None or table is None or scenario.named('attitude_control') is None:
        raise InputError(
            '`unloading` needs `attitude.wheels`, `attitude_control` and `thrusters.table`'
        )
    for name, most in (('above_nms', wheels.momentum_nms), ('torque_nm', wheels.torque_nm)):
        if getattr(settings, name) >= most:
            raise InputError(
                f'`unloading.{name}` must be below that of the wheels, {most!r}; '
                f'got {getattr(settings, name)!r}'
            )


register(Section('unloading', Unloading, Place.UNLOADING, UnloadingStage, _check_unloading))
