# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Clohessy-Wiltshire motion about a target on a circular orbit, in closed form.

Frame `target_lvlh`: x R-bar, from the Earth's centre outward through the target; y V-bar, along the
target's velocity; z H-bar, along the orbit's angular momentum. State: (x, y, z, vx, vy, vz).

    x'' - 3 n^2 x - 2 n y' = (f_x + d_x)/m
    y'' + 2 n x'           = (f_y + d_y)/m
    z'' + n^2 z            = (f_z + d_z)/m
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rpo_core.files import codec
from rpo_core.files.codec import unless_default
from rpo_core.files.validation import Checked, InputError, optional, real, shown
from rpo_core.kernels.arithmetic import State, Vector, sin_cos
from rpo_core.kernels.jit import inlined


class CwStep(NamedTuple):
    """Coefficients of one exact CW step under a constant force (`rpo_core.world.cw.discretise`).

    `yvx` is what a velocity vx [m/s] adds to y [m], `vyfx` what a force fx [N] adds to vy [m/s];
    SI units. Coefficients that are 0, and yy, which is 1, are left out.
    """

    xx: float
    xvx: float
    xvy: float
    yx: float
    yvx: float
    yvy: float
    vxx: float
    vxvx: float
    vxvy: float
    vyx: float
    vyvx: float
    vyvy: float
    zz: float
    zvz: float
    vzz: float
    vzvz: float
    xfx: float
    xfy: float
    yfx: float
    yfy: float
    vxfx: float
    vxfy: float
    vyfx: float
    vyfy: float
    zfz: float
    vzfz: float


@inlined
def cw_step(state: State, force: Vector, c: CwStep) -> State:
    """State (x, y, z, vx, vy, vz) one step later under a constant force (fx, fy, fz) [N]."""
    x, y, z, vx, vy, vz = state
    fx, fy, fz = force
    return (
        c.xx * x + c.xvx * vx + c.xvy * vy + c.xfx * fx + c.xfy * fy,
        c.yx * x + y + c.yvx * vx + c.yvy * vy + c.yfx * fx + c.yfy * fy,
        c.zz * z + c.zvz * vz + c.zfz * fz,
        c.vxx * x + c.vxvx * vx + c.vxvy * vy + c.vxfx * fx + c.vxfy * fy,
        c.vyx * x + c.vyvx * vx + c.vyvy * vy + c.vyfx * fx + c.vyfy * fy,
        c.vzz * z + c.vzvz * vz + c.vzfz * fz,
    )


MU_EARTH_M3_S2 = 3.986004418e14
"""Standard gravitational parameter of the Earth (WGS 84)."""

MAX_ORBIT_RADIUS_M = 1e9
Mass = Annotated[float, partial(real, unit='kg', least=1e-3, most=1e9)]
TickLength = Annotated[float, partial(real, unit='s', least=1e-6, most=1e3)]
"""Annotations of the fields of a dataclass, see `rpo_core.files.validation.Checked`."""


_some_radius = partial(optional, unit='m', above=0.0, most=MAX_ORBIT_RADIUS_M)


@dataclass(frozen=True)
class Body(Checked):
    """What the target orbits.

    radius_m : no orbit is lower
    j2 : second zonal harmonic; its scale is `equatorial_radius_m`, if not given `radius_m`
    """

    mu_m3_s2: Annotated[float, partial(real, unit='m^3/s^2', above=0.0, most=1e21)]
    radius_m: Annotated[float, partial(real, unit='m', above=0.0, most=MAX_ORBIT_RADIUS_M)]
    j2: Annotated[float, partial(real, least=0.0, most=0.1)] = unless_default(0.0)
    equatorial_radius_m: Annotated[float | None, _some_radius] = unless_default(None)

    @property
    def equator_m(self) -> float:
        """Radius that `j2` is scaled by."""
        return self.radius_m if self.equatorial_radius_m is None else self.equatorial_radius_m


EARTH = Body(MU_EARTH_M3_S2, 6.4e6, 1.0826267e-3, 6.378137e6)
BODIES = {
    'earth': EARTH,
    'moon': Body(4.9028e12, 1.7374e6, 2.0322e-4, 1.738e6),
    'mars': Body(4.282837e13, 3.3962e6, 1.9566e-3, 3.396e6),
}
"""Bodies by name; no orbit about the Earth is lower than 6400 km. J2 of EGM96, GRAIL (GL0660B) and
GMM-3, with the radius of each model."""


def body_of(name: str, value: Any) -> Body:
    """Return the body of a name, a mapping or itself; raises InputError."""
    if isinstance(value, Body):
        return value
    if isinstance(value, Mapping):
        return codec.from_mapping(Body, name, value)
    if not isinstance(value, str) or value not in BODIES:
        raise InputError(
            f'`{name}` must be one of {", ".join(BODIES)}, or a mapping with mu_m3_s2, radius_m; '
            f'got {shown(value)}'
        )
    return BODIES[value]


def document_of(body: Body) -> Any:
    """Return a body as a file has it: its name, or a mapping."""
    names = [name for name, known in BODIES.items() if known == body]
    return names[0] if names else codec.to_mapping(body)


def orbit_radius(radius_m: Any, body: Body) -> float:
    """Return the radius of an orbit about a body; raises InputError."""
    return real('orbit_radius_m', radius_m, 'm', least=body.radius_m, most=MAX_ORBIT_RADIUS_M)


def mean_motion(orbit_radius_m: float, body: Body = EARTH) -> float:
    """Return n = sqrt(mu / r^3) [rad/s] of a circular orbit; the paper prints r^2, a misprint."""
    r = orbit_radius_m
    return math.sqrt(body.mu_m3_s2 / (r * r * r))


def holding_force_n(goal_m: Vector, mean_motion_rad_s: float, mass_kg: float) -> Vector:
    """Return the force (3,) [N] that keeps a chaser at rest at a point (3,) [m] of the frame.

    At rest, relative gravity pulls by 3 m n^2 x outward and by -m n^2 z; along V-bar nothing pulls.
    """
    pull = mass_kg * mean_motion_rad_s * mean_motion_rad_s
    return -3.0 * pull * goal_m[0], 0.0, pull * goal_m[2]


_SERIES = [(1.0 / math.factorial(k), 1.0 / math.factorial(k + 1)) for k in range(22, 0, -2)]
"""Coefficients of c2 and c3."""


def stumpff(angle_rad: float) -> tuple[float, float, float, float]:
    """Return Stumpff's functions c0..c3 of angle^2.

    c0 = cos a, c1 = sin a / a, c2 = (1 - cos a) / a^2, c3 = (a - sin a) / a^3. A step of 0.1 s
    turns the orbit by 1e-4 rad, where the differences would cancel to eight digits: the series
    does not.
    """
    square = angle_rad * angle_rad
    if square > 1.0:
        sine, cosine = sin_cos(angle_rad)
        c2 = (1.0 - cosine) / square
        c3 = (angle_rad - sine) / (square * angle_rad)
        return cosine, sine / angle_rad, c2, c3
    c2 = c3 = 0.0
    for even, odd in _SERIES:  # Horner, from the 22nd power down
        c2 = even - square * c2
        c3 = odd - square * c3
    return 1.0 - square * c2, 1.0 - square * c3, c2, c3


def discretise(mean_motion_rad_s: float, mass_kg: float, dt_s: float) -> CwStep:
    """Return the exact step of `dt_s` under a force held constant.

    The entries are those of exp(A dt) and its integral, written with Stumpff's functions.
    """
    n, t = mean_motion_rad_s, dt_s
    a = n * t
    c0, c1, c2, c3 = stumpff(a)
    return CwStep(
        xx=1.0 + 3.0 * a * a * c2,
        xvx=t * c1,
        xvy=2.0 * a * t * c2,
        yx=-6.0 * a * a * a * c3,
        yvx=-2.0 * a * t * c2,
        yvy=t * (4.0 * c1 - 3.0),
        vxx=3.0 * n * a * c1,
        vxvx=c0,
        vxvy=2.0 * a * c1,
        vyx=-6.0 * n * a * a * c2,
        vyvx=-2.0 * a * c1,
        vyvy=1.0 - 4.0 * a * a * c2,
        zz=c0,
        zvz=t * c1,
        vzz=-n * a * c1,
        vzvz=c0,
        xfx=t * t * c2 / mass_kg,
        xfy=2.0 * a * t * t * c3 / mass_kg,
        yfx=-2.0 * a * t * t * c3 / mass_kg,
        yfy=t * t * (4.0 * c2 - 1.5) / mass_kg,
        vxfx=t * c1 / mass_kg,
        vxfy=2.0 * a * t * c2 / mass_kg,
        vyfx=-2.0 * a * t * c2 / mass_kg,
        vyfy=t * (4.0 * c1 - 3.0) / mass_kg,
        zfz=t * t * c2 / mass_kg,
        vzfz=t * c1 / mass_kg,
    )


def matrices(step: CwStep) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return A_d (6, 6) and B_d (6, 3) of x+ = A_d x + B_d (f + d), SI units."""
    c = step
    state = np.array(
        [
            [c.xx, 0.0, 0.0, c.xvx, c.xvy, 0.0],
            [c.yx, 1.0, 0.0, c.yvx, c.yvy, 0.0],
            [0.0, 0.0, c.zz, 0.0, 0.0, c.zvz],
            [c.vxx, 0.0, 0.0, c.vxvx, c.vxvy, 0.0],
            [c.vyx, 0.0, 0.0, c.vyvx, c.vyvy, 0.0],
            [0.0, 0.0, c.vzz, 0.0, 0.0, c.vzvz],
        ]
    )
    force = np.array(
        [
            [c.xfx, c.xfy, 0.0],
            [c.yfx, c.yfy, 0.0],
            [0.0, 0.0, c.zfz],
            [c.vxfx, c.vxfy, 0.0],
            [c.vyfx, c.vyfy, 0.0],
            [0.0, 0.0, c.vzfz],
        ]
    )
    return state, force
