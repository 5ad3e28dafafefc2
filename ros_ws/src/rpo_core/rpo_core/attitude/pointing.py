# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The attitude that a chaser shall have (section `pointing`), and how far it is from that.

Near the port its axes are those of the docked attitude. Farther away its docking axis, and the
camera along it, looks at the port. The target's attitude is the known one.

Quaternions are (x, y, z, w), scalar last. A turn from the chaser's axes to the target's is written
as docked attitude (`mate`), then the turn that points its docking axis.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from math import radians, sqrt
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from rpo_core.attitude.attitude_kernels import (
    LVLH,
    Attitude,
    Frame,
    cross,
    frame_at,
    seen_from,
    synchronised,
)
from rpo_core.attitude.chaser import relative_to, times, turn, turn_back
from rpo_core.attitude.target import (
    ALIGNED,
    MOST_TURN_RAD,
    Quaternion,
    known_motion,
    of_vector,
    product,
    quaternion,
)
from rpo_core.files.validation import Checked, InputError, real, vector3
from rpo_core.kernels import calls
from rpo_core.kernels.arithmetic import State, Vector, norm, saturate
from rpo_core.kernels.arrays import Floats
from rpo_core.kernels.jit import inlined, kernel, step_kernel
from rpo_core.scenario.scenario import Scenario
from rpo_core.stage import KernelStage, Place, Section, register
from rpo_core.wire import interfaces
from rpo_core.wire.interfaces import ATTITUDE, STATE
from rpo_core.world.zones import Zones, zones_of

DEGREES = 57.29577951308232

SETTLE_S = 5.0
"""Time in which the chaser settles about its docking axis."""

_SMALL = 1e-9
"""Cosine of half a turn below which its axis is not known."""


class Aim(NamedTuple):
    """Section `pointing`, as the kernels read it.

    port : (3,) [m]; axis : (3,) of the docking axis when docked; aside : (3,) across it; all in
        the target's axes, the latter unit vectors
    mate : quaternion from the chaser's axes to the target's when docked
    own : (3,) the docking axis in the chaser's axes, a unit vector
    near_m, width_m : distance of the port within which the chaser is aligned, and of the passage
    most_rad_s, sine : largest rate against the target; sine of half of it in a tick
    dt : of a tick [s]
    """

    port: Vector
    axis: Vector
    aside: Vector
    mate: Quaternion
    own: Vector
    near_m: float
    width_m: float
    most_rad_s: float
    sine: float
    dt: float


@inlined
def looking(seen: State, aim: Aim) -> tuple[Quaternion, Vector]:
    """Return the smallest turn from the docked attitude that looks at the port, and its rate.

    seen : state (6,) [m, m/s] as the target sees it
    Quaternion in the target's axes, rate (3,) [rad/s] in the turned ones. Near the port no turn.
    """
    none, rest = (0.0, 0.0, 0.0, 1.0), (0.0, 0.0, 0.0)
    x, y, z = aim.port[0] - seen[0], aim.port[1] - seen[1], aim.port[2] - seen[2]
    distance = norm(x, y, z)
    if distance <= aim.near_m:
        return none, rest
    x, y, z = x / distance, y / distance, z / distance
    grows = -(x * seen[3] + y * seen[4] + z * seen[5])
    along = (distance - aim.near_m) / aim.width_m
    share, more = 1.0, 0.0
    if along < 1.0:
        share = along * along * (3.0 - 2.0 * along)
        more = 6.0 * along * (1.0 - along) * grows / aim.width_m
    a, by = aim.axis, share / distance
    # from the docked axis a to what is looked at, and the change of that
    dx, dy, dz = x - a[0], y - a[1], z - a[2]
    b = (a[0] + share * dx, a[1] + share * dy, a[2] + share * dz)
    c = (
        more * dx - by * (seen[3] + x * grows),
        more * dy - by * (seen[4] + y * grows),
        more * dz - by * (seen[5] + z * grows),
    )
    size = norm(b[0], b[1], b[2])
    w = size + a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    if w <= _SMALL:  # it looks the other way: about any axis across
        return (aim.aside[0], aim.aside[1], aim.aside[2], 0.0), rest
    u, du = cross(a, b), cross(a, c)
    dw = (b[0] * c[0] + b[1] * c[1] + b[2] * c[2]) / size
    dw += a[0] * c[0] + a[1] * c[1] + a[2] * c[2]
    turned = cross(u, du)
    square = u[0] * u[0] + u[1] * u[1] + u[2] * u[2] + w * w
    length, twice = sqrt(square), 2.0 / square
    return (u[0] / length, u[1] / length, u[2] / length, w / length), (
        twice * (w * du[0] - dw * u[0] - turned[0]),
        twice * (w * du[1] - dw * u[1] - turned[1]),
        twice * (w * du[2] - dw * u[2] - turned[2]),
    )


@inlined
def limited(q: Quaternion, rate: Vector, before: Quaternion, aim: Aim) -> tuple[Quaternion, Vector]:
    """Return a turn that follows a wanted one, and its rate: first the docking axis, then about it.

    q, rate : wanted turn, and its rate (3,) [rad/s] in the chaser's axes
    before : turn of the tick before; zeros where there was none
    The axis turns at most at the largest rate; so does the chaser about it, and settles there.
    """
    a, most = aim.own, aim.most_rad_s
    along = rate[0] * a[0] + rate[1] * a[1] + rate[2] * a[2]
    x, y, z = rate[0] - along * a[0], rate[1] - along * a[1], rate[2] - along * a[2]
    size = norm(x, y, z)
    share = most / size if size > most else 1.0
    across = (share * x, share * y, share * z)
    if before[0] == 0.0 and before[1] == 0.0 and before[2] == 0.0 and before[3] == 0.0:
        along = saturate(along, most)
        return q, (across[0] + along * a[0], across[1] + along * a[1], across[2] + along * a[2])
    now, wanted = turn(a, before), turn(a, q)
    x, y, z = cross(now, wanted)
    w = 1.0 + now[0] * wanted[0] + now[1] * wanted[1] + now[2] * wanted[2]
    sine, size = norm(x, y, z), sqrt(x * x + y * y + z * z + w * w)
    if sine > aim.sine * size:
        x, y, z = x / sine, y / sine, z / sine
        cosine = sqrt(1.0 - aim.sine * aim.sine)
        found = times((aim.sine * x, aim.sine * y, aim.sine * z, cosine), before)
        return found, turn_back((most * x, most * y, most * z), found)
    swung = before
    if size > 0.0:
        swung = times((x / size, y / size, z / size, w / size), before)
    x, y, z, w = relative_to(swung, q)
    off = 2.0 * w * (x * a[0] + y * a[1] + z * a[2])  # a sine: no jump at half a turn
    about = saturate(along + (off - along * aim.dt) / SETTLE_S, most)
    half = 0.5 * about * aim.dt
    step = (half * a[0], half * a[1], half * a[2], sqrt(1.0 - half * half))
    found = times(swung, step)
    x, y, z = turn(across, relative_to(found, q))
    return found, (x + about * a[0], y + about * a[1], z + about * a[2])


@inlined
def pointed(
    state: State, target: Attitude, f: Frame, before: Quaternion, aim: Aim
) -> tuple[Attitude, Quaternion]:
    """Return the reference attitude of a chaser, and its turn from the target's axes.

    state : (6,) [m, m/s], target LVLH; target, f : attitude of the target, and its frame
    before : the turn of the tick before; zeros where there was none
    """
    q, rate = looking(seen_from(state, f), aim)
    q, rate = limited(times(q, aim.mate), turn_back(rate, aim.mate), before, aim)
    own = turn_back((target[4], target[5], target[6]), q)
    x, y, z, w = times((target[0], target[1], target[2], target[3]), q)
    side = 1.0 if w >= 0.0 else -1.0
    return (
        side * x, side * y, side * z, side * w,
        own[0] + rate[0], own[1] + rate[1], own[2] + rate[2],
    ), q  # fmt: skip


@inlined
def from_target(q: Quaternion, target: Attitude) -> Quaternion:
    """Return the turn from the axes of a chaser to those of the target; q : its attitude."""
    return relative_to((target[0], target[1], target[2], target[3]), q)


@kernel
def contact_turn(chaser: Attitude, target: Attitude, mate: Quaternion) -> tuple[float, float]:
    """Return how far a chaser is turned from its docked attitude, and how fast it turns.

    The largest of the three angles [deg], each 2 sin(half of the turn) along an axis; the norm of
    the rate against the target [deg/s].
    """
    turned = from_target((chaser[0], chaser[1], chaser[2], chaser[3]), target)
    x, y, z, _ = relative_to(mate, turned)
    p = turn_back((target[4], target[5], target[6]), turned)
    rate = norm(chaser[4] - p[0], chaser[5] - p[1], chaser[6] - p[2])
    return 2.0 * DEGREES * max(abs(x), abs(y), abs(z)), DEGREES * rate


NOWHERE: Quaternion = (0.0, 0.0, 0.0, 0.0)
"""The turn of the tick before the first one."""


@dataclass(frozen=True, kw_only=True)
class Pointing(Checked):
    """Where the chaser looks.

    mate : quaternion x, y, z, w from the chaser's axes to the target's when docked
    docking_axis : (3,) of the chaser, towards the port when docked
    align_within_m : distance of the port within which the attitude is the docked one; from twice
        as far on the axis looks at the port, by the smallest turn
    most_deg_s : largest rate of the docking axis against the target, and about it
    port_m : (3,) in the target's axes; as in section `zones`, unless it differs
    """

    mate: Annotated[Quaternion, quaternion] = ALIGNED
    docking_axis: Annotated[Vector, partial(vector3, unit='', bound=1e3)] = (0.0, -1.0, 0.0)
    align_within_m: Annotated[float, partial(real, unit='m', above=0.0, most=1e4)] = 5.0
    most_deg_s: Annotated[float, partial(real, unit='deg/s', above=0.0, most=90.0)] = 2.0
    port_m: Annotated[Vector, partial(vector3, unit='m', bound=1e4)] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if norm(*self.docking_axis) < 1e-6:
            raise InputError(
                f'`docking_axis` must be at least 1e-06 long; got {list(self.docking_axis)!r}'
            )

    def aim(self, dt_s: float) -> Aim:
        """Return the section as the kernels read it."""
        size = norm(*self.docking_axis)
        x, y, z = (a / size for a in self.docking_axis)
        # across it: less its part along the axis of the chaser that it is farthest from
        i = min(range(3), key=lambda j: abs((x, y, z)[j]))
        across = [(float(j == i)) - (x, y, z)[i] * a for j, a in enumerate((x, y, z))]
        size = norm(*across)
        a, b, c = (part / size for part in across)
        rate = radians(self.most_deg_s)
        return Aim(
            self.port_m,
            turn((x, y, z), self.mate),
            turn((a, b, c), self.mate),
            self.mate,
            (x, y, z),
            self.align_within_m,
            self.align_within_m,
            rate,
            of_vector((rate * dt_s, 0.0, 0.0))[0],
            dt_s,
        )

    @staticmethod
    def of_zones(_document: Any, zones: Zones) -> dict[str, Any]:
        """Return the fields that are as the zones of the scenario, unless the section has them."""
        return {'port_m': list(zones.port_m)}


@dataclass(slots=True)
class Looking:
    """Settings of the kernel `look`.

    begins : 1 where it begins with the attitude of the chaser, which is then read
    turns : 1 where the target has an attitude
    orbit_rad_s : rate of LVLH
    """

    aim: Aim
    begins: int
    turns: int
    orbit_rad_s: float


@dataclass(slots=True)
class Looked:
    """Memory of the kernel `look`.

    before : the turn of the tick before, a quaternion; zeros where there was none
    attitudes, frames : known ones of the target, (n, 7), (n, 15), from a tick on
    """

    before: Annotated[list[float], 4]
    first: int
    attitudes: list[list[float]]
    frames: list[list[float]]


@step_kernel
def look(tick: int, u: Any, p: Any, m: Any, y: Any) -> int:
    """Return the attitude y (7,) to have: `pointed`.

    u : state (6,) [m, m/s], target LVLH, then the attitude (7,) of the chaser, where it has one
    """
    target, f = synchronised(p.orbit_rad_s), LVLH
    if p.turns:
        at = tick - m.first
        if at < 0 or at >= len(m.attitudes):
            return calls.ASK
        a = m.attitudes[at]
        target, f = (a[0], a[1], a[2], a[3], a[4], a[5], a[6]), frame_at(m.frames[at])
    q = m.before
    before = (q[0], q[1], q[2], q[3])
    if p.begins and before == NOWHERE:
        before = from_target((u[6], u[7], u[8], u[9]), target)
    state = (u[0], u[1], u[2], u[3], u[4], u[5])
    reference, before = pointed(state, target, f, before, p.aim)
    y[0], y[1], y[2], y[3], y[4], y[5], y[6] = reference
    q[0], q[1], q[2], q[3] = before
    return 0


class PointingStage(KernelStage):
    """The reference attitude of a tick; it remembers where it looked the tick before.

    It begins with the attitude of the chaser, where it has one.
    """

    name = 'pointing'
    outputs = (interfaces.REFERENCE_ATTITUDE,)
    memory_ticks = None
    kernel = look

    def __init__(self, settings: Pointing, scenario: Any) -> None:
        self._motion = known_motion(scenario)
        self.inputs = (STATE, ATTITUDE) if scenario.attitude else (STATE,)
        aim, n = settings.aim(scenario.dt_s), scenario.mean_motion_rad_s
        begins, turns = int(len(self.inputs) > 1), int(self._motion is not None)
        super().__init__(Looking(aim, begins, turns, n), Looked(list(NOWHERE), 0, [], []))

    def answer(self, tick: int, u: Sequence[float]) -> None:
        """Write the known attitudes of the target of a block of ticks."""
        assert self._motion is not None
        self.m.first, self.m.attitudes, self.m.frames = self._motion.block_of(tick)

    def answer_ahead(self, ticks: int, u: Sequence[float]) -> None:
        """Write the known attitudes of the target in a flight."""
        if self._motion is not None:
            self.m.attitudes, self.m.frames = self._motion.table(0, ticks + 1)


def _check(settings: Pointing, scenario: Any) -> None:
    """Raise InputError where a docked chaser would look away from the port."""
    zones = scenario.zones
    if zones is None or not zones.corridor.from_m:
        return
    axis, ahead = settings.aim(scenario.dt_s).axis, zones.corridor.ahead
    if sum(a * b for a, b in zip(axis, ahead, strict=True)) > 0.0:
        raise InputError(
            '`pointing.docking_axis`, turned by `mate`, must point against `corridor.axis`; '
            f'got {[round(a, 6) for a in axis]}'
        )


register(Section('pointing', Pointing, Place.POINTING, PointingStage, _check))


_BACK = np.array([-1.0, -1.0, -1.0, 1.0])
"""Times a quaternion: the attitude back."""


def turned(vectors: ArrayLike, quaternions: ArrayLike) -> Floats:
    """Return vectors (..., 3) of a body's axes, in those that its quaternions (..., 4) lead to."""
    v, q = np.asarray(vectors, np.float64), np.asarray(quaternions, np.float64)
    u = q[..., :3]
    twice = 2.0 * np.cross(u, v)
    return np.asarray(v + q[..., 3:4] * twice + np.cross(u, twice))


def errors(attitudes: ArrayLike, references: ArrayLike) -> Floats:
    """Return errors (..., 7) of attitudes (..., 7), in the axes of the body that has them.

    Quaternion from the body's axes to those of the reference, w >= 0; rate error [rad/s].
    """
    a, b = np.asarray(attitudes, np.float64), np.asarray(references, np.float64)
    ahead: Any = np.moveaxis(a[..., :4], -1, 0)
    back: Any = np.moveaxis(b[..., :4] * _BACK, -1, 0)
    e = np.stack(product(back, ahead), axis=-1)
    e = np.where(e[..., 3:] < 0.0, -e, e)
    return np.concatenate([e, a[..., 4:] - turned(b[..., 4:], e * _BACK)], axis=-1)


def apart(attitudes: ArrayLike, references: ArrayLike) -> Floats:
    """Return angle [rad] and size of the rate error [rad/s], (..., 2), of attitudes (..., 7)."""
    e = errors(attitudes, references)
    angle = 2.0 * np.arctan2(np.linalg.norm(e[..., :3], axis=-1), e[..., 3])
    return np.stack([angle, np.linalg.norm(e[..., 4:], axis=-1)], axis=-1)


def too_fast(attitudes: Floats, dt_s: float) -> str:
    """Return where a chaser turns farther in a tick than its motion is exact; '' if nowhere."""
    turns = dt_s * np.linalg.norm(attitudes[:, 4:], axis=1)
    for tick in np.flatnonzero(~(turns <= MOST_TURN_RAD))[:1].tolist():
        return (
            f'NOT exact from tick {tick} on: the chaser turns {turns[tick]:.3g} rad in a tick of '
            f'{dt_s:g} s, more than {MOST_TURN_RAD:g}'
        )
    return ''


def docking_axis(scenario: Scenario) -> Vector:
    """Return the unit vector (3,) of the chaser's axes towards the port when docked.

    Without section `pointing` it is against the first corridor, or else -y.
    """
    pointing: Any = scenario.named('pointing')
    if pointing is not None:
        x, y, z = pointing.docking_axis
        size = norm(x, y, z)
        return x / size, y / size, z / size
    cones = [zone.corridor for zone in zones_of(scenario) if zone.corridor is not None]
    x, y, z = cones[0].ahead if cones else (0.0, 1.0, 0.0)
    return -x, -y, -z
