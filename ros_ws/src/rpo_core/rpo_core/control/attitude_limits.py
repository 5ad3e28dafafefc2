# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What a torque must not do: turn the chaser too fast, off its reference, or fill its wheels.

Field `limits` of section `attitude_control`, and the filter that keeps them: docs/safety.md, lemma
7. Each axis has an interval of angular accelerations. The rate limit gives one that ends with the
tick. Each side of the pointing cone is a wall, which one may approach as fast as the chaser still
stops before it (lemma 1). The torque becomes that of the nearest acceleration in all intervals.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from math import radians, sqrt
from typing import Annotated, NamedTuple

from rpo_core.attitude.attitude_kernels import Body, Six, cross, symmetric
from rpo_core.files.codec import unless_default
from rpo_core.files.validation import Checked, InputError, optional, real
from rpo_core.kernels.arithmetic import Vector
from rpo_core.kernels.jit import inlined, kernel

PASSED, LIMITED = 0, 1
"""What became of a torque."""

FAR = 1e30


class TorqueLimits(NamedTuple):
    """Limits as the kernel reads them, with what errors and a tick take of them.

    dt : tick [s]; 0.0: there are no limits
    inertia, inverse : xx, yy, zz, xy, xz, yz [kg m^2]; of the inverse of that matrix
    torque, momentum : largest of each axis [N m], of a wheel [N m s]; FAR without wheels
    sure : angular acceleration that all axes have at once [rad/s^2]
    rate : largest, of each axis [rad/s]
    angle, within : half of the cone on each axis, and up to where it is kept [rad]; 0.0: no cone
    doubt : error of the rate towards a wall [rad/s]
    brake, off : authority before a wall, and what an acceleration may be off there [rad/s^2]
    """

    dt: float
    inertia: Six
    inverse: Six
    torque: float
    momentum: float
    sure: float
    rate: float
    angle: float
    within: float
    doubt: float
    brake: float
    off: float


NONE = TorqueLimits(0.0, (0.0,) * 6, (0.0,) * 6, *(0.0,) * 9)
"""No limits."""


@inlined
def _towards(s: float, c: float, lim: TorqueLimits) -> float:
    """Largest acceleration [rad/s^2] towards a wall at a gap [rad] and closing rate [rad/s]."""
    dt, a = lim.dt, lim.brake
    left = s - 0.5 * c * dt
    if left >= 0.0:
        return (a * (sqrt(0.25 * dt * dt + 2.0 / a * left) - 0.5 * dt) - c) / dt
    if c <= 0.0:  # outside by an error, and on its way back
        return -c / dt
    return -0.5 * c * c / s if s > 0.0 else -FAR


@inlined
def _clip(value: float, least: float, most: float) -> float:
    """Nearest number in an interval."""
    return least if value < least else most if value > most else value


@inlined
def _within(wanted: float, least: float, most: float, sure: float) -> float:
    """Nearest to what is wanted in an interval, of which no end asks for more than is sure."""
    return _clip(wanted, least if least < sure else sure, most if most > -sure else -sure)


@inlined
def _interval(wheel: float, lim: TorqueLimits) -> tuple[float, float]:
    """Torques [N m] that an axis has, and whose wheel stays within its momentum."""
    most = lim.torque
    return (
        _clip((wheel - lim.momentum) / lim.dt, -most, most),
        _clip((wheel + lim.momentum) / lim.dt, -most, most),
    )


@inlined
def _allowed(
    wanted: float, rate: float, e: float, c: float, ahead: float, cone: bool, lim: TorqueLimits
) -> float:
    """Angular acceleration [rad/s^2] of an axis that keeps its limits, nearest to the wanted one.

    rate : [rad/s]; e, c : angle off the reference, and its change; ahead : acceleration of that
    """
    found = wanted
    if cone:
        most = _towards(lim.angle - e, c + lim.doubt, lim) - lim.off
        least = _towards(lim.angle + e, lim.doubt - c, lim) - lim.off
        found = _within(found, ahead - least, ahead + most, lim.sure)
    most = (lim.rate - rate) / lim.dt
    least = (-lim.rate - rate) / lim.dt
    return _within(found, least, most, lim.sure)


@inlined
def _share(start: float, end: float, least: float, most: float) -> float:
    """Largest share of the way from a torque in an interval to another that stays in it."""
    if end > most:
        return (most - start) / (end - start) if start < most else 0.0
    if end < least:
        return (least - start) / (end - start) if start > least else 0.0
    return 1.0


@kernel
def within_limits(
    torque: Vector,
    rate: Vector,
    angle: Vector,
    against: Vector,
    ahead: Vector,
    wheels: Vector,
    lim: TorqueLimits,
) -> tuple[float, float, float, int]:
    """Return a torque (3,) [N m] that keeps the limits, and PASSED or LIMITED.

    rate : (3,) of the chaser, as it is known [rad/s]
    angle, against, ahead : (3,) error of the attitude, of the rate, acceleration of the reference,
        as of `attitude_law_kernels.Errors`
    wheels : (3,) their momentum [N m s]
    """
    if lim.dt == 0.0:
        return torque[0], torque[1], torque[2], PASSED
    (lx, mx), (ly, my), (lz, mz) = (
        _interval(wheels[0], lim), _interval(wheels[1], lim), _interval(wheels[2], lim),
    )  # fmt: skip
    tx, ty, tz = _clip(torque[0], lx, mx), _clip(torque[1], ly, my), _clip(torque[2], lz, mz)
    hx, hy, hz = symmetric(rate, lim.inertia)
    gx, gy, gz = cross(rate, (hx + wheels[0], hy + wheels[1], hz + wheels[2]))
    ax, ay, az = symmetric((tx - gx, ty - gy, tz - gz), lim.inverse)
    # the change of the errors: of twice the vector part of a quaternion whose real part is w
    ex, ey, ez = angle
    square = 0.25 * (ex * ex + ey * ey + ez * ez)
    w = sqrt(1.0 - square) if square < 1.0 else 0.0
    ux, uy, uz = cross(angle, against)
    cx, cy, cz = w * against[0] + 0.5 * ux, w * against[1] + 0.5 * uy, w * against[2] + 0.5 * uz
    cone = abs(ex) <= lim.within and abs(ey) <= lim.within and abs(ez) <= lim.within
    bx = _allowed(ax, rate[0], ex, cx, ahead[0], cone, lim)
    by = _allowed(ay, rate[1], ey, cy, ahead[1], cone, lim)
    bz = _allowed(az, rate[2], ez, cz, ahead[2], cone, lim)
    if bx == ax and by == ay and bz == az:
        return tx, ty, tz, PASSED if (tx, ty, tz) == torque else LIMITED
    # from the mildest acceleration that is allowed towards that one, as far as there is torque
    sx = _allowed(0.0, rate[0], ex, cx, ahead[0], cone, lim)
    sy = _allowed(0.0, rate[1], ey, cy, ahead[1], cone, lim)
    sz = _allowed(0.0, rate[2], ez, cz, ahead[2], cone, lim)
    px, py, pz = symmetric((sx, sy, sz), lim.inertia)
    qx, qy, qz = symmetric((bx, by, bz), lim.inertia)
    px, py, pz, qx, qy, qz = px + gx, py + gy, pz + gz, qx + gx, qy + gy, qz + gz
    u, v, w = _share(px, qx, lx, mx), _share(py, qy, ly, my), _share(pz, qz, lz, mz)
    u = v if v < u else u
    u = w if w < u else u
    return (
        _clip(px + u * (qx - px), lx, mx),
        _clip(py + u * (qy - py), ly, my),
        _clip(pz + u * (qz - pz), lz, mz),
        LIMITED,
    )


SQRT_3 = sqrt(3.0)

_degrees = partial(real, unit='deg', least=0.0, most=20.0)
_rates = partial(real, unit='deg/s', least=0.0, most=45.0)
_fraction = partial(real, least=0.0, most=0.5)
_least = partial(real, least=0.0, most=1e6)


@dataclass(frozen=True, kw_only=True)
class AttitudeLimits(Checked):
    """What the torque must keep, and what the proof may assume.

    rate_deg_s : largest rate about each axis of the chaser, against inertial space
    angle_deg : largest angle off the reference about each axis, once it is reached, while that
        turns at half of what errors leave of `rate_deg_s` at most; None: any
    momentum_nms : of each wheel; None: what the wheels have
    known_deg, known_deg_s : largest error, about each axis, of the attitude and the rate it sees
    disturbance_nm : largest torque about each axis beside the commanded one: of thrusters that are
        misaligned; that of section `attitude` is counted too
    inertia_share : largest share by which all true moments of inertia are off alike
    reference_deg_s2 : largest change of the reference's rate about each axis
    """

    rate_deg_s: Annotated[float, partial(_rates, above=0.0)]
    angle_deg: Annotated[float | None, partial(optional, check=_degrees)] = unless_default(None)
    momentum_nms: Annotated[float | None, partial(optional, check=_least)] = unless_default(None)
    known_deg: Annotated[float, _degrees] = 0.0
    known_deg_s: Annotated[float, _rates] = 0.0
    disturbance_nm: Annotated[float, partial(_least, unit='N m')] = 0.0
    inertia_share: Annotated[float, _fraction] = unless_default(0.0)
    reference_deg_s2: Annotated[float, partial(_rates, unit='deg/s^2')] = 0.1


class Bounds(NamedTuple):
    """What is certain of a chaser within its limits.

    momentum : of body and wheels together [N m s]
    fastest, sure : largest angular acceleration, and what all axes have at once [rad/s^2]
    unknown : what an acceleration may be off at any time of a tick [rad/s^2]
    rate : which commands may lead to about an axis [rad/s]
    """

    momentum: float
    fastest: float
    sure: float
    unknown: float
    rate: float


def bounds_of(
    settings: AttitudeLimits,
    body: Body,
    torque_nm: float,
    start_nms: float,
    dt_s: float,
    duration_s: float,
    wheels: bool = True,
    unloading: tuple[float, float] = (0.0, 0.0),
) -> Bounds:
    """Return what is certain; raises InputError where nothing is.

    body : as the control assumes it; torque_nm : of each axis; start_nms : norm of the momentum of
    body and wheels at tick 0; unloading : momentum [N m s] and torque [N m], 0.0: none
    """
    share, rows = settings.inertia_share, _rows(body.inertia)
    light = max(_rows(body.inverse))
    rate, error = radians(settings.rate_deg_s), radians(settings.known_deg_s)
    heavy, fast = (1.0 + share) * max(rows), SQRT_3 * rate
    push, empties = SQRT_3 * settings.disturbance_nm, SQRT_3 * unloading[1]
    whole = heavy * fast
    if wheels and empties:
        drift = dt_s * (push + empties)
        whole = _emptied(unloading, push, heavy * rate + drift, dt_s * fast, start_nms)
    elif wheels:
        whole = start_nms + push * duration_s
    # Of the gyroscopic torque: all of it, what a tick changes, and what the filter does not know.
    turning = fast * whole
    fastest = light * (SQRT_3 * torque_nm + turning + push) / (1.0 - share)
    late = dt_s * (fastest * whole + fast * (turning + push + empties))
    steady = settings.disturbance_nm + SQRT_3 * error * (whole + heavy * fast)
    steady += share * heavy * fast * fast
    # Of an acceleration a chaser of another inertia makes a multiple: it brakes all the same.
    most = share * light * (torque_nm + turning)
    off = [(light * (steady + part * late) + most) / (1.0 - share) for part in (0.5, 1.0)]
    sure = min((torque_nm - turning) / row for row in rows)
    kept, unknown = rate - dt_s * off[0] - error, light * (steady + 0.5 * late)
    if sure <= unknown or kept <= 0.0:
        raise InputError(
            '`attitude_control.limits` must leave torque to brake with: of '
            f'{torque_nm / max(rows):.6g} rad/s^2, {sure:.6g} are left of the turn at '
            f'`rate_deg_s`, and {unknown:.6g} may be lost; {kept:.6g} rad/s are kept'
        )
    return Bounds(whole, fastest, sure, off[1], kept)


def _emptied(
    unloading: tuple[float, float], push: float, body: float, turn: float, start: float
) -> float:
    """Return the largest momentum [N m s] of chaser and wheels that thrusters empty, for ever.

    push : of disturbances [N m]; body : of the body about an axis, and what a tick changes
    [N m s]; turn : of a tick [rad]
    """
    above, torque = unloading
    share = push / torque
    if share >= 1.0:
        raise InputError(
            '`unloading.torque_nm` must be above what disturbs all axes at once, '
            f'{push:.6g} N m; got {torque!r}'
        )
    times = max(SQRT_3, sqrt(2.0 / (1.0 - share * share)))
    whole = max(start, times * (above + body) / (1.0 - times * turn))
    if above < body + turn * whole:
        raise InputError(
            f'`unloading.above_nms` must be at least {body + turn * whole:.6g}, which the body may '
            f'have at `rate_deg_s`; got {above!r}'
        )
    return whole


def numbers_of(
    settings: AttitudeLimits, bounds: Bounds, body: Body, torque_nm: float, full: float, dt_s: float
) -> TorqueLimits:
    """Return the limits as the kernel reads them; raises InputError where none are certain.

    full : momentum of a wheel [N m s]; FAR without wheels
    """
    heavy = (1.0 + settings.inertia_share) * max(_rows(body.inertia))
    most = heavy * SQRT_3 * radians(settings.rate_deg_s)
    if bounds.momentum + most > full:
        raise InputError(
            '`attitude_control.limits` and the wheels exclude each other: '
            f'{bounds.momentum:.6g} N m s of chaser and wheels and {most:.6g} at `rate_deg_s` are '
            f'more than {full:.6g}'
        )
    limits = TorqueLimits(
        dt_s,
        body.inertia,
        body.inverse,
        *(torque_nm, full, bounds.sure, bounds.rate),
        *(0.0, -1.0, 0.0, 1.0, 0.0),
    )
    if settings.angle_deg is None:
        return limits
    return _coned(limits, settings, bounds.fastest, bounds.unknown)


def _coned(
    limits: TorqueLimits, settings: AttitudeLimits, fastest: float, unknown: float
) -> TorqueLimits:
    """Return the limits with the walls of the cone; raises InputError where there is no room."""
    angle, rate = radians(settings.angle_deg or 0.0), radians(settings.rate_deg_s)
    size, against, change = SQRT_3 * angle, 2.0 * SQRT_3 * rate, radians(settings.reference_deg_s2)
    # an error of what is seen, beside an error of another axis, is one of the third
    off, error = (1.0 + size) * radians(settings.known_deg), radians(settings.known_deg_s)
    # second order of the error's angle: it is twice the vector part of a quaternion
    bent = 0.5 * size * against * against
    bent += (0.5 * size + 0.125 * size * size) * (fastest + SQRT_3 * change)
    doubt = (1.0 + size) * error + SQRT_3 * off * (SQRT_3 * rate + 0.5 * against)
    brake = limits.sure - unknown - bent - 2.0 * SQRT_3 * change
    # What a wall asks for in a tick must leave the way to stop before the other one, and must be
    # a rate that is allowed.
    leaves = (limits.sure + unknown + bent) * limits.dt + 2.0 * doubt
    needed = (1.0 + size) * (doubt + (unknown + bent) * limits.dt)
    room = off + 0.5 * doubt * limits.dt + 0.25 * leaves * limits.dt
    room += 0.25 * leaves * leaves / brake if brake > 0.0 else 0.0
    if brake <= 0.0 or angle <= room or limits.rate <= needed:
        raise InputError(
            '`attitude_control.limits.angle_deg` must leave room to brake in: '
            f'{brake:.6g} rad/s^2 are certain, errors take {room:.6g} rad and {needed:.6g} rad/s; '
            f'got {angle:.6g} rad, and {limits.rate:.6g} rad/s are kept'
        )
    return limits._replace(
        angle=angle - off, within=angle + off, doubt=doubt, brake=brake, off=unknown + bent
    )


def _rows(m: Six) -> list[float]:
    """Return the sums of the rows of a matrix xx, yy, zz, xy, xz, yz, which bound its norm."""
    xx, yy, zz, xy, xz, yz = map(abs, m)
    return [xx + xy + xz, xy + yy + yz, xz + yz + zz]
