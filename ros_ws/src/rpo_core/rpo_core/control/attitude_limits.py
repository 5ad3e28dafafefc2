# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What a torque must not do: turn the chaser too fast, off its reference, or fill its wheels.

Field `limits` of section `attitude_control`: the numbers of the filter, docs/safety.md, lemma 7.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from math import radians, sqrt
from typing import Annotated, NamedTuple

from rpo_core.attitude.attitude_kernels import Body
from rpo_core.control.attitude_limit_kernels import TorqueLimits
from rpo_core.files.codec import unless_default
from rpo_core.files.validation import Checked, InputError, optional, real

SQRT_3 = sqrt(3.0)

_degrees = partial(real, unit='deg', least=0.0, most=20.0)
_rates = partial(real, unit='deg/s', least=0.0, most=45.0)
_share = partial(real, least=0.0, most=0.5)
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
    inertia_share: Annotated[float, _share] = unless_default(0.0)
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
    parts, share = body[2:14], settings.inertia_share
    rows, light = _rows(parts[:6]), max(_rows(parts[6:]))
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
    settings: AttitudeLimits, found: Bounds, body: Body, torque_nm: float, full: float, dt_s: float
) -> TorqueLimits:
    """Return the limits as the kernel reads them; raises InputError where none are certain.

    full : momentum of a wheel [N m s]; FAR without wheels
    """
    heavy = (1.0 + settings.inertia_share) * max(_rows(body[2:8]))
    most = heavy * SQRT_3 * radians(settings.rate_deg_s)
    if found.momentum + most > full:
        raise InputError(
            '`attitude_control.limits` and the wheels exclude each other: '
            f'{found.momentum:.6g} N m s of chaser and wheels and {most:.6g} at `rate_deg_s` are '
            f'more than {full:.6g}'
        )
    limits = TorqueLimits(
        dt_s,
        *body[2:14],
        *(torque_nm, full, found.sure, found.rate),
        *(0.0, -1.0, 0.0, 1.0, 0.0),
    )
    if settings.angle_deg is None:
        return limits
    return _coned(limits, settings, found.fastest, found.unknown)


def _coned(
    found: TorqueLimits, settings: AttitudeLimits, fastest: float, unknown: float
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
    brake = found.sure - unknown - bent - 2.0 * SQRT_3 * change
    # What a wall asks for in a tick must leave the way to stop before the other one, and must be
    # a rate that is allowed.
    leaves = (found.sure + unknown + bent) * found.dt + 2.0 * doubt
    needed = (1.0 + size) * (doubt + (unknown + bent) * found.dt)
    room = off + 0.5 * doubt * found.dt + 0.25 * leaves * found.dt
    room += 0.25 * leaves * leaves / brake if brake > 0.0 else 0.0
    if brake <= 0.0 or angle <= room or found.rate <= needed:
        raise InputError(
            '`attitude_control.limits.angle_deg` must leave room to brake in: '
            f'{brake:.6g} rad/s^2 are certain, errors take {room:.6g} rad and {needed:.6g} rad/s; '
            f'got {angle:.6g} rad, and {found.rate:.6g} rad/s are kept'
        )
    return found._replace(
        angle=angle - off, within=angle + off, doubt=doubt, brake=brake, off=unknown + bent
    )


def _rows(m: tuple[float, ...]) -> list[float]:
    """Return the sums of the rows of a matrix xx, yy, zz, xy, xz, yz, which bound its norm."""
    xx, yy, zz, xy, xz, yz = map(abs, m)
    return [xx + xy + xz, xy + yy + yz, xz + yz + zz]
