# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What a torque must not do: turn the chaser too fast, off its reference, or fill its wheels.

Field `limits` of section `attitude_control`: the numbers of the filter, docs/safety.md, lemma 7.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from math import radians, sqrt
from typing import Annotated

from rpo_core.files.codec import unless_default
from rpo_core.files.validation import InputError, check_fields, optional, real
from rpo_ctrl.attitude_limit_kernels import FAR, TorqueLimits
from rpo_kernels.attitude_kernels import Body

SQRT_3 = sqrt(3.0)

_degrees = partial(real, unit='deg', least=0.0, most=20.0)
_rates = partial(real, unit='deg/s', least=0.0, most=45.0)
_least = partial(real, least=0.0, most=1e6)


@dataclass(frozen=True, kw_only=True)
class AttitudeLimits:
    """What the torque must keep, and what the proof may assume.

    rate_deg_s : largest rate about each axis of the chaser, against inertial space
    angle_deg : largest angle off the reference about each axis, once it is reached; None: any
    momentum_nms : of each wheel; None: what the wheels have
    known_deg, known_deg_s : largest error, about each axis, of the attitude and the rate it sees
    disturbance_nm : largest torque about each axis beside the commanded one
    reference_deg_s2 : largest change of the reference's rate about each axis
    """

    rate_deg_s: Annotated[float, partial(_rates, above=0.0)]
    angle_deg: Annotated[float | None, partial(optional, check=_degrees)] = unless_default(None)
    momentum_nms: Annotated[float | None, partial(optional, check=_least)] = unless_default(None)
    known_deg: Annotated[float, _degrees] = 0.0
    known_deg_s: Annotated[float, _rates] = 0.0
    disturbance_nm: Annotated[float, partial(_least, unit='N m')] = 0.0
    reference_deg_s2: Annotated[float, _rates] = 0.1

    def __post_init__(self) -> None:
        check_fields(self)


def numbers_of(
    settings: AttitudeLimits,
    body: Body,
    torque_nm: float,
    momentum_nms: float,
    start_nms: float,
    dt_s: float,
    duration_s: float,
) -> TorqueLimits:
    """Return the limits as the kernel reads them; raises InputError where none are certain.

    body : as the control assumes it; torque_nm : of each axis; momentum_nms : of a wheel, 0.0
    without wheels; start_nms : norm of the momentum of body and wheels at tick 0
    """
    parts, dt = body[2:14], dt_s
    rows, heavy, light = _rows(parts[:6]), max(_rows(parts[:6])), max(_rows(parts[6:]))
    rate, error = radians(settings.rate_deg_s), radians(settings.known_deg_s)
    fast, push = SQRT_3 * rate, SQRT_3 * settings.disturbance_nm
    wheels = momentum_nms > 0.0
    whole = start_nms + push * duration_s if wheels else heavy * fast
    full = min(settings.momentum_nms or momentum_nms, momentum_nms) if wheels else FAR
    if wheels and whole + heavy * fast > full:
        raise InputError(
            f'`attitude_control.limits` and the wheels exclude each other: {whole:.6g} N m s of '
            f'chaser and wheels and {heavy * fast:.6g} at `rate_deg_s` are more than {full:.6g}'
        )
    # Of the gyroscopic torque: all of it, and what the filter does not know.
    turning = fast * whole
    fastest = light * (SQRT_3 * torque_nm + turning + push)
    late = dt * (fastest * whole + fast * (turning + push))
    unknown = light * (push + late + SQRT_3 * error * (whole + heavy * fast))
    sure = min((torque_nm - turning) / row for row in rows)
    kept = rate - dt * unknown - error
    if sure <= unknown or kept <= 0.0:
        raise InputError(
            '`attitude_control.limits` must leave torque to brake with: of '
            f'{torque_nm / max(rows):.6g} rad/s^2, {sure:.6g} are left of the turn at '
            f'`rate_deg_s`, and {unknown:.6g} may be lost; {kept:.6g} rad/s are kept'
        )
    found = TorqueLimits(
        dt,
        *parts,
        *(torque_nm, full, sure, kept),
        *(0.0, -1.0, 0.0, 1.0, 0.0),
    )
    return found if settings.angle_deg is None else _coned(found, settings, fastest, unknown)


def _coned(
    found: TorqueLimits, settings: AttitudeLimits, fastest: float, unknown: float
) -> TorqueLimits:
    """Return the limits with the walls of the cone; raises InputError where there is no room."""
    angle, off = radians(settings.angle_deg or 0.0), radians(settings.known_deg)
    rate, error = radians(settings.rate_deg_s), radians(settings.known_deg_s)
    size, against, change = SQRT_3 * angle, 2.0 * SQRT_3 * rate, radians(settings.reference_deg_s2)
    # second order of the error's angle: it is twice the vector part of a quaternion
    bent = 0.5 * size * against * against
    bent += (0.5 * size + 0.125 * size * size) * (fastest + SQRT_3 * change)
    doubt = (1.0 + size) * error + SQRT_3 * off * (SQRT_3 * rate + 0.5 * against)
    brake = found.sure - unknown - bent - 2.0 * SQRT_3 * change
    # A wall must not be met by an error, or in the tick in which the other one is left.
    room = off + 2.0 * doubt * found.dt + (unknown + bent) * found.dt * found.dt
    room += 0.5 * doubt * doubt / brake if brake > 0.0 else 0.0
    if brake <= 0.0 or angle <= room:
        raise InputError(
            '`attitude_control.limits.angle_deg` must leave room to brake in: '
            f'{brake:.6g} rad/s^2 are certain, and errors take {room:.6g} rad; got {angle:.6g} rad'
        )
    return found._replace(
        angle=angle - off, within=angle + off, doubt=doubt, brake=brake, off=unknown + bent
    )


def _rows(m: tuple[float, ...]) -> list[float]:
    """Return the sums of the rows of a matrix xx, yy, zz, xy, xz, yz, which bound its norm."""
    xx, yy, zz, xy, xz, yz = map(abs, m)
    return [xx + xy + xz, xy + yy + yz, xz + yz + zz]
