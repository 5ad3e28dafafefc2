# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The attitude of the target: section `target` of a scenario.

With the section, zones, port, goal and what is required of them are in the target's axes, which
turn. Without it these axes are those of target LVLH.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial
from math import radians, sqrt
from typing import Annotated, Any

import numpy as np

from rpo_core.attitude import attitude_kernels
from rpo_core.attitude.attitude_kernels import FRAME, Attitude, Body, Frame
from rpo_core.files.codec import unless_default
from rpo_core.files.validation import Checked, InputError, choice, matrix, real, shown, vector3
from rpo_core.kernels import calls
from rpo_core.kernels.arithmetic import Vector, norm, sin_cos
from rpo_core.kernels.arrays import Floats
from rpo_core.kernels.jit import as_table, step_kernel
from rpo_core.kernels.records import NOTHING
from rpo_core.stage import KernelStage, Place, Section, register
from rpo_core.wire import interfaces
from rpo_core.world.dynamics import CLOHESSY_WILTSHIRE
from rpo_core.world.zones import Zone

Quaternion = tuple[float, float, float, float]

FIXED, SPIN, TUMBLE = KINDS = ('fixed', 'spin', 'tumble')

ALIGNED: Quaternion = (0.0, 0.0, 0.0, 1.0)
BALL = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))

MOST_TURN_RAD = 0.1
"""Largest angle of a tick: beyond it the method of `attitude_step` loses its accuracy."""

ROUNDING = 4e-15
"""How far off 1 rounding leaves the length of a quaternion that was divided by it, at most."""

_BLOCK = 512
"""Ticks of a motion that are computed at a time."""

_angles = partial(vector3, unit='deg', bound=45.0)
_rates = partial(vector3, unit='deg/s', bound=360.0)


def quaternion(name: str, value: Any) -> Quaternion:
    """Return a unit quaternion x, y, z, w with w >= 0; raises InputError."""
    if not isinstance(value, (list, tuple)) or len(value) != 4:
        raise InputError(f'`{name}` must be a list of 4 numbers [x, y, z, w]; got {shown(value)}')
    q = [real(f'{name}[{i}]', item, least=-1e3, most=1e3) for i, item in enumerate(value)]
    size = _length(q)
    if size < 1e-6:
        raise InputError(f'`{name}` must be a quaternion with a length; got {shown(value)}')
    # one of length 1 keeps its bits: what is written is what is read again
    x, y, z, w = q if abs(size - 1.0) < ROUNDING else unit(q)
    return positive((x, y, z, w))


def _length(q: Sequence[float]) -> float:
    return sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])


def unit(q: Sequence[float]) -> Quaternion:
    """Return a quaternion divided by its length."""
    size = _length(q)
    x, y, z, w = (item / size for item in q)
    return x, y, z, w


def inertia(name: str, value: Any) -> tuple[tuple[float, ...], ...]:
    """Return a symmetric inertia (3, 3) [kg m^2] that a body can have; raises InputError."""
    rows = matrix(name, value, 3, 3, bound=1e9)
    if not _can_be(rows):
        raise InputError(
            f'`{name}` must be symmetric, its principal moments > 0 and none above the sum of the '
            f'others; got {shown(value)}'
        )
    return rows


@lru_cache(maxsize=256)
def _can_be(rows: tuple[tuple[float, ...], ...]) -> bool:
    """Return whether a body can have an inertia (3, 3)."""
    tensor = np.array(rows)
    moments = np.linalg.eigvalsh(tensor)
    even = not np.any(tensor != tensor.T)
    return bool(even and moments[0] > 0.0 and moments[2] <= moments[0] + moments[1])


def positive(q: Quaternion) -> Quaternion:
    """Return the quaternion of the same attitude with w >= 0."""
    x, y, z, w = q
    return q if w >= 0.0 else (-x, -y, -z, -w)


def product(p: Quaternion, q: Quaternion) -> Quaternion:
    """Return the attitude q, then p, as a quaternion."""
    (a, b, c, d), (x, y, z, w) = p, q
    return (
        d * x + w * a + b * z - c * y,
        d * y + w * b + c * x - a * z,
        d * z + w * c + a * y - b * x,
        d * w - a * x - b * y - c * z,
    )


def of_vector(rotation_rad: Vector) -> Quaternion:
    """Return the quaternion of a rotation vector (3,) [rad]: the same bits on every machine."""
    angle = norm(*rotation_rad)
    sine, cosine = sin_cos(0.5 * angle)
    x, y, z = (0.5 * r if angle == 0.0 else sine * r / angle for r in rotation_rad)
    return x, y, z, cosine


@dataclass(frozen=True, kw_only=True)
class Target(Checked):
    """How the target turns.

    kind : `fixed` to target LVLH; `spin`, at a constant rate about an axis of its own; `tumble`, a
        free rigid body
    attitude : quaternion x, y, z, w at tick 0, from the target's axes to target LVLH
    axis, rate_deg_s : of a spin, in the target's axes, against inertial space
    rates_deg_s : (3,) of a tumble at tick 0, in the target's axes, against inertial space
    inertia_kg_m2 : (3, 3) of a tumble; only its shape counts
    known_error_deg : (3,) rotation vector, target's axes: guidance and assurance take the target
        for turned by it
    """

    kind: Annotated[str, partial(choice, known=KINDS)]
    attitude: Annotated[Quaternion, quaternion] = ALIGNED
    axis: Annotated[Vector, partial(vector3, unit='', bound=1e3)] = unless_default((0.0, 0.0, 1.0))
    rate_deg_s: Annotated[float, partial(real, unit='deg/s', least=-360.0, most=360.0)] = (
        unless_default(0.0)
    )
    rates_deg_s: Annotated[Vector, _rates] = unless_default((0.0, 0.0, 0.0))
    inertia_kg_m2: Annotated[Any, inertia] = unless_default(BALL)
    known_error_deg: Annotated[Vector, _angles] = unless_default((0.0, 0.0, 0.0))

    def __post_init__(self) -> None:
        super().__post_init__()
        if norm(*self.axis) < 1e-6:
            raise InputError(f'`axis` must be at least 1e-06 long; got {list(self.axis)!r}')
        for kind, names in _OF_KIND.items():
            for name in names:
                default = Target.__dataclass_fields__[name].default
                if self.kind != kind and getattr(self, name) != default:
                    raise InputError(f'`{name}` needs `kind` {kind}; got {self.kind}')

    @property
    def rates_rad_s(self) -> Vector:
        """Rate (3,) at tick 0, target's axes, against inertial space; of a fixed one zero."""
        if self.kind == TUMBLE:
            x, y, z = (radians(rate) for rate in self.rates_deg_s)
            return x, y, z
        size = radians(self.rate_deg_s) / norm(*self.axis)
        return size * self.axis[0], size * self.axis[1], size * self.axis[2]

    @property
    def fastest_rad_s(self) -> float:
        """Bound of the rate against inertial space: a tumble keeps its energy."""
        if self.kind != TUMBLE:
            return norm(*self.rates_rad_s)
        inertia, rate = np.array(self.inertia_kg_m2), np.array(self.rates_rad_s)
        return float(np.sqrt(rate @ inertia @ rate / np.linalg.eigvalsh(inertia)[0]))

    @cached_property
    def _motions(self) -> dict[tuple[float, float], Motion]:
        return {}

    def motion(self, orbit_rad_s: float, dt_s: float) -> Motion:
        """Return how it turns, tick by tick; computed once, also for its equals just before."""
        key = orbit_rad_s, dt_s
        if key not in self._motions:
            turns, orbit, inertia, inverse = self.body(orbit_rad_s)
            numbers = [turns, orbit, *inertia, *inverse, *self.start(orbit_rad_s), dt_s]
            self._motions[key] = _motion(np.array(numbers).tobytes())
        return self._motions[key]

    @cached_property
    def known(self) -> Target:
        """The target as guidance and assurance take it: axes turned by `known_error_deg`."""
        if not any(self.known_error_deg):
            return self
        x, y, z = (radians(angle) for angle in self.known_error_deg)
        error = of_vector((x, y, z))
        still = Body(0.0, 0.0, (0.0,) * 6, (0.0,) * 6)
        turned = attitude_kernels.frame_of((*error, 0.0, 0.0, 0.0), still)
        back = partial(attitude_kernels.to_body, f=turned)
        half = [back(row) for row in self.inertia_kg_m2]  # J E, and E' (J E) by its columns
        inertia = np.array([back(column) for column in zip(*half, strict=True)]).T
        return replace(
            self,
            attitude=unit(product(self.attitude, error)),
            axis=back(self.axis) if self.kind == SPIN else self.axis,
            rates_deg_s=back(self.rates_deg_s),
            inertia_kg_m2=(0.5 * (inertia + inertia.T)).tolist() if self.kind == TUMBLE else BALL,
            known_error_deg=(0.0, 0.0, 0.0),
        )

    def body(self, orbit_rad_s: float) -> Body:
        """Return the body as the kernels read it."""
        turns = 0.0 if self.kind == FIXED else 1.0
        return body_of(self.inertia_kg_m2, orbit_rad_s)._replace(turns=turns)

    def start(self, orbit_rad_s: float) -> Attitude:
        """Return quaternion and rate at tick 0."""
        a = (*self.attitude, *self.rates_rad_s)
        if self.kind != FIXED:
            return a
        f = attitude_kernels.frame_of(a, self.body(orbit_rad_s))
        return (*self.attitude, orbit_rad_s * f.zx, orbit_rad_s * f.zy, orbit_rad_s * f.zz)

    def seen(self, states: Floats, scenario: Any, first: int = 0) -> Floats:
        """Return states (n, 6) of the ticks from `first` on as the target sees them.

        In its axes, velocities against them [m, m/s].
        """
        turning = motion_of(self, scenario).frames(first + len(states))[first:]
        seen_states = np.empty((len(states), 6))
        attitude_kernels.see_all(np.ascontiguousarray(states, np.float64), turning, seen_states)
        return seen_states


_OF_KIND = {SPIN: ('axis', 'rate_deg_s'), TUMBLE: ('rates_deg_s', 'inertia_kg_m2')}


def body_of(inertia_kg_m2: Any, orbit_rad_s: float) -> Body:
    """Return a body with an inertia (3, 3) as the kernels read it."""
    return _body(tuple(map(tuple, inertia_kg_m2)), orbit_rad_s)


@lru_cache(maxsize=256)
def _body(inertia_kg_m2: tuple[tuple[float, ...], ...], orbit_rad_s: float) -> Body:
    j = np.array(inertia_kg_m2, np.float64)
    inertia, inverse = (
        (m[0][0], m[1][1], m[2][2], m[0][1], m[0][2], m[1][2])
        for m in (j.tolist(), _inverse(j).tolist())
    )
    return Body(1.0, orbit_rad_s, inertia, inverse)


def _inverse(m: Floats) -> Floats:
    """Return the inverse of a symmetric matrix (3, 3) by its cofactors: the same bits anywhere."""
    (a, d, e), (_, b, f), (_, _, c) = m.tolist()
    p, q, r = b * c - f * f, e * f - d * c, d * f - e * b
    det = a * p + d * q + e * r
    rows = [[p, q, r], [q, a * c - e * e, d * e - a * f], [r, d * e - a * f, a * b - d * d]]
    return np.array(rows) / det


class Motion:
    """The attitudes of a body, tick by tick, as far as they were asked for."""

    def __init__(self, body: Body, start: Attitude, dt_s: float) -> None:
        self.body, self._dt_s = body, dt_s
        self._attitudes = np.array([start])
        self._frames = [np.empty((0, FRAME)), np.empty((0, FRAME))]
        self._largest: dict[int, Floats] = {}

    def _have(self, ticks: int) -> Floats:
        """Return the attitudes (n, 7) of so many ticks at least."""
        attitudes = self._attitudes  # of this call: another thread may ask for more meanwhile
        have = len(attitudes)
        if ticks > have:
            rows = np.empty((1 + max(ticks - have, _BLOCK), 7))
            last: Attitude = tuple(attitudes[-1].tolist())
            attitude_kernels.attitudes(last, self._dt_s, self.body, rows)
            self._attitudes = attitudes = np.vstack([attitudes[:-1], rows])
        return attitudes

    def attitude(self, tick: int) -> Attitude:
        """Return quaternion and rate [rad/s] at a tick."""
        row: Attitude = tuple(self._have(tick + 1)[tick].tolist())
        return row

    def block_of(self, tick: int) -> tuple[int, Any, Any]:
        """Return the block of a tick: its first tick, attitudes (n, 7), frames (n, 15)."""
        first = tick // _BLOCK * _BLOCK
        return first, *self.table(first, _BLOCK)

    def table(self, first: int, count: int) -> tuple[Any, Any]:
        """Return attitudes (count, 7) and frames (count, 15) of ticks from the first one on."""
        attitudes = self._have(first + count)[first : first + count]
        return as_table(attitudes), as_table(self.block(first, count))

    def frame(self, tick: int) -> Frame:
        """Return the frame at a tick."""
        return Frame(*self.block(tick, 1)[0].tolist())

    def block(self, first: int, count: int) -> Floats:
        """Return the frames (count, 15) of ticks from the first one on."""
        end = first + count
        if first < len(self._frames[False]) + _BLOCK:
            return self.frames(end)[first:]
        alone = np.empty((count, FRAME))  # far ahead: those in between are not wanted
        rows = np.ascontiguousarray(self._have(end)[first:end])
        attitude_kernels.frames(rows, 0.0, self.body, alone)
        return alone

    def frames(self, ticks: int, *, half: bool = False) -> Floats:
        """Return the frames (ticks, 15) of the first ticks, or half a tick later."""
        found = self._frames[half]
        count = len(found)
        if ticks > count:
            rows = np.ascontiguousarray(self._have(ticks)[count:])
            new_frames = np.empty((len(rows), FRAME))
            attitude_kernels.frames(rows, 0.5 * self._dt_s if half else 0.0, self.body, new_frames)
            found = self._frames[half] = np.vstack([found, new_frames])
        return found[:ticks]

    def largest(self, ticks: int) -> Floats:
        """Return the largest (7,) of the frames of the first ticks.

        |rate| [rad/s] and |change of it| [rad/s^2] about each axis, and sum of the |numbers| of a
        row of the matrix.
        """
        if ticks not in self._largest:
            sizes = np.abs(self.frames(ticks))
            rows = sizes[:, 0:9:3] + sizes[:, 1:9:3] + sizes[:, 2:9:3]
            self._largest[ticks] = np.array([*sizes[:, 9:].max(axis=0), rows.max()])
        return self._largest[ticks]


@lru_cache(maxsize=8)
def _motion(numbers: bytes) -> Motion:
    """Return the motion of a body, a start and a tick, by their bits: nodes share a process."""
    turns, orbit, *values, dt_s = np.frombuffer(numbers).tolist()
    inertia, inverse, start = (tuple(values[i:j]) for i, j in ((0, 6), (6, 12), (12, 19)))
    return Motion(Body(turns, orbit, inertia, inverse), start, dt_s)


def motion_of(target: Target, scenario: Any) -> Motion:
    """Return how a target turns in a scenario."""
    return target.motion(scenario.mean_motion_rad_s, scenario.dt_s)


def known_motion(scenario: Any) -> Motion | None:
    """Return how the target turns as guidance and assurance take it; None: it has no attitude."""
    return None if scenario.target is None else motion_of(scenario.target.known, scenario)


def in_lvlh(zone: Zone, f: Frame) -> Zone:
    """Return a zone of the target's axes in target LVLH."""
    turn: Any = partial(attitude_kernels.to_lvlh, f=f)
    cone, points_m = zone.corridor, {n: turn(at_m) for n, at_m in zone.points_m.items()}
    if cone is not None:
        cone = replace(cone, tip_m=turn(cone.tip_m), ahead=turn(cone.ahead))
    return replace(zone, corridor=cone, points_m=points_m)


@dataclass(slots=True)
class Attitudes:
    """Attitudes (n, 7) of a body from a tick on, as many as there are."""

    first: int
    attitudes: list[list[float]]


@step_kernel
def show(tick: int, u: Any, p: Any, m: Any, y: Any) -> int:
    """Return the attitude of the target at a tick.

    y : quaternion x, y, z, w with w >= 0, and rate (3,) [rad/s]
    """
    at = tick - m.first
    if at < 0 or at >= len(m.attitudes):
        return calls.ASK
    a = m.attitudes[at]
    side = -1.0 if a[3] < 0.0 else 1.0
    y[0], y[1], y[2], y[3] = side * a[0], side * a[1], side * a[2], side * a[3]
    y[4], y[5], y[6] = a[4], a[5], a[6]
    return 0


class TargetStage(KernelStage):
    """The attitude of the target at a tick."""

    name = 'target'
    outputs = (interfaces.TARGET_ATTITUDE,)
    kernel = show

    def __init__(self, settings: Target, scenario: Any) -> None:
        self._motion = motion_of(settings, scenario)
        super().__init__(NOTHING, Attitudes(0, []))

    def answer(self, tick: int, u: Sequence[float]) -> None:
        """Write the block of a tick."""
        self.m.first, self.m.attitudes, _ = self._motion.block_of(tick)

    def answer_ahead(self, ticks: int, u: Sequence[float]) -> None:
        """Write the attitudes of a flight."""
        self.m.attitudes, _ = self._motion.table(0, ticks + 1)


def check_turning(name: str, rate_rad_s: float, scenario: Any) -> None:
    """Raise InputError where a scenario does not allow a body that turns at a rate.

    name : of its section
    """
    dynamics = scenario.dynamics
    if dynamics is not None and dynamics.kind != CLOHESSY_WILTSHIRE:
        raise InputError(
            f'`{name}` needs a circular orbit, `dynamics.kind` clohessy_wiltshire; got '
            f'{dynamics.kind}'
        )
    turn = rate_rad_s * scenario.dt_s
    if turn > MOST_TURN_RAD:
        raise InputError(
            f'`{name}` must turn at most {MOST_TURN_RAD:g} rad in a tick of `dt_s` = '
            f'{scenario.dt_s!r} s; got {turn:.3g}'
        )


def _check(settings: Target, scenario: Any) -> None:
    """Raise InputError where a scenario does not allow such a target."""
    check_turning('target', settings.fastest_rad_s, scenario)
    if scenario.goal is not None and scenario.named('guidance') is None:
        raise InputError(
            '`goal_position_m` is in the axes of `target`; to fly there needs section `guidance`'
        )


register(Section('target', Target, Place.TARGET, TargetStage, _check))
