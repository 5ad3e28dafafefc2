# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Legs as they are flown: the reference state and the force that keeps a chaser on it.

A leg is a function of the ticks since it began, in target LVLH or in the axes of a target that
turns. Arithmetic is + - * / and square roots in a fixed order: the same bits on every machine.
"""

from __future__ import annotations

from collections.abc import Callable
from math import ceil, sqrt
from typing import Any, NamedTuple

import numpy as np

from rpo_core.attitude.attitude_kernels import Frame, acceleration_with, frame_at, moving_with
from rpo_core.attitude.target import Motion
from rpo_core.guidance import transfers
from rpo_core.guidance.transfers import Floats, Limits, Transfer, sample
from rpo_core.kernels.arithmetic import State, Vector, norm, sin_cos
from rpo_core.kernels.jit import as_table, inlined, kernel
from rpo_core.world import cw
from rpo_core.world.cw import CwStep


@inlined
def force_for(state: State, acceleration: Vector, n: float, m: float) -> Vector:
    """Return the force (3,) [N] for an acceleration (3,) [m/s^2] in a state of target LVLH.

    n : mean motion [rad/s]; m : mass [kg]
    """
    x, _, z, vx, vy, _ = state
    ax, ay, az = acceleration
    return (
        m * (ax - 3.0 * n * n * x - 2.0 * n * vy),
        m * (ay + 2.0 * n * vx),
        m * (az + n * n * z),
    )


@inlined
def turned(t: Any, now: Frame, half: Frame, n: float, m: float) -> tuple[State, Vector]:
    """Return state and force (3,) [N] in target LVLH of a moment that the turning target sees.

    t : (15,) state, and state and acceleration half a tick later; now, half : axes of the target
    """
    state = moving_with((t[0], t[1], t[2], t[3], t[4], t[5]), now)
    later = (t[6], t[7], t[8], t[9], t[10], t[11])
    acceleration = acceleration_with(later, (t[12], t[13], t[14]), half)
    return state, force_for(moving_with(later, half), acceleration, n, m)


class Speeds(NamedTuple):
    """A length run through with a first, a largest and a last speed, and one acceleration.

    up, up_s : length and time of speeding up; then an even part, then braking
    """

    acceleration: float
    first: float
    cruise: float
    last: float
    length: float
    up: float
    up_s: float
    even_s: float
    down_s: float

    @property
    def duration_s(self) -> float:
        """Time that it takes."""
        return self.up_s + self.even_s + self.down_s


AT_REST = Speeds(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@inlined
def progress(p: Speeds, time_s: float) -> Vector:
    """Return length, speed and acceleration at a time."""
    a = p.acceleration
    if time_s < p.up_s:
        return (p.first + 0.5 * a * time_s) * time_s, p.first + a * time_s, a
    later_s = time_s - p.up_s
    if later_s < p.even_s:
        return p.up + p.cruise * later_s, p.cruise, 0.0
    left = p.even_s + p.down_s - later_s
    if left > 0.0:
        return p.length - (p.last + 0.5 * a * left) * left, p.last + a * left, -a
    return p.length, p.last, 0.0


REST, COAST, LINE, ARC = range(4)


class Way(NamedTuple):
    """A motion as a function of time.

    begin : point [m] where it begins; of an arc the unit vector from the target to it
    ahead : velocity [m/s] of a coast; unit vector along a line; of an arc across `begin`
    speeds : along a line [m] or an arc [rad]
    radius, growth : of an arc, at its begin, and for each radian
    """

    shape: int
    begin: Vector
    ahead: Vector = (0.0, 0.0, 0.0)
    speeds: Speeds = AT_REST
    radius: float = 0.0
    growth: float = 0.0


@inlined
def _on_arc(a: float, b: float, way: Way, now: Vector, sine: float, cosine: float) -> Vector:
    """Return position, velocity and acceleration of an axis; a, b : of `begin` and `ahead`."""
    angle, rate, change = now
    r, dr = way.radius + way.growth * angle, way.growth
    # e = a cos + b sin points to the chaser, e' = b cos - a sin ahead
    e, ahead = a * cosine + b * sine, b * cosine - a * sine
    slope, bend = dr * e + r * ahead, 2.0 * dr * ahead - r * e
    return r * e, slope * rate, bend * rate * rate + slope * change


@inlined
def moved(way: Way, time_s: float) -> tuple[State, Vector]:
    """Return state (6,) [m, m/s] and acceleration (3,) [m/s^2] so long after its begin."""
    (px, py, pz), (ux, uy, uz) = way.begin, way.ahead
    if way.shape == ARC:
        now = progress(way.speeds, time_s)
        sine, cosine = sin_cos(now[0])
        x, vx, ax = _on_arc(px, ux, way, now, sine, cosine)
        y, vy, ay = _on_arc(py, uy, way, now, sine, cosine)
        z, vz, az = _on_arc(pz, uz, way, now, sine, cosine)
        return (x, y, z, vx, vy, vz), (ax, ay, az)
    if way.shape == LINE:
        length, speed, a = progress(way.speeds, time_s)
        state = (
            px + length * ux, py + length * uy, pz + length * uz,
            speed * ux, speed * uy, speed * uz,
        )  # fmt: skip
        return state, (a * ux, a * uy, a * uz)
    if way.shape == COAST:
        return (px + ux * time_s, py + uy * time_s, pz + uz * time_s, ux, uy, uz), (0.0, 0.0, 0.0)
    return (px, py, pz, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0)


@kernel
def way_rows(way: Way, first: int, dt_s: float, n: float, m: float, rows: Any) -> None:
    """Fill rows (n, 9), a tick each, from a tick on: the force is that in the middle of a tick."""
    for i in range(len(rows)):
        row, tick = rows[i], first + i
        state, _ = moved(way, tick * dt_s)
        later, acceleration = moved(way, (tick + 0.5) * dt_s)
        force = force_for(later, acceleration, n, m)
        row[0], row[1], row[2], row[3], row[4], row[5] = state
        row[6], row[7], row[8] = force


@kernel
def way_moments(way: Way, first: int, dt_s: float, table: Any) -> None:
    """Fill a table (n, 15) with states, and states and accelerations in the middle of ticks."""
    for i in range(len(table)):
        row, tick = table[i], first + i
        state, _ = moved(way, tick * dt_s)
        later, acceleration = moved(way, (tick + 0.5) * dt_s)
        for j in range(6):
            row[j], row[6 + j] = state[j], later[j]
        for j in range(3):
            row[12 + j] = acceleration[j]


@kernel
def turn_rows(
    table: Floats, frames: Floats, halves: Floats, n: float, m: float, rows: Floats
) -> None:
    """Fill rows (n, 9) with states and forces of a leg that the turning target sees.

    table : (n, 15) as `turned` reads them; frames, halves : (n, 15) of the target at these moments
    """
    for i in range(len(rows)):
        row = rows[i]
        state, force = turned(table[i], frame_at(frames[i]), frame_at(halves[i]), n, m)
        for j in range(6):
            row[j] = state[j]
        for j in range(3):
            row[6 + j] = force[j]


PI = 3.141592653589793

SEGMENTS = 100
"""Most segments of a transfer; each is a whole number of ticks. With `ease_s` each is a tick."""

STRETCH, STRETCHES = 1.25, 12
"""A transfer that needs more force than it may gets so much more time, so often."""

ACCELERATION_SHARE = 0.5
"""Share of the force that guidance may use, for speeding up and braking on lines and arcs."""


class Vehicle(NamedTuple):
    """What legs know of the chaser.

    limit_n : force of an axis that the reference may need
    """

    mean_motion_rad_s: float
    mass_kg: float
    dt_s: float
    limit_n: float
    step: CwStep

    @property
    def acceleration_m_s2(self) -> float:
        """Acceleration on lines and arcs."""
        return ACCELERATION_SHARE * self.limit_n / self.mass_kg

    def force_n(self, state: State, acceleration: Vector) -> Vector:
        """Return the force (3,) [N] for an acceleration (3,) [m/s^2] in a state."""
        return force_for(state, acceleration, self.mean_motion_rad_s, self.mass_kg)


class Moving:
    """A leg whose motion is a function of time: the force is that in the middle of a tick."""

    ticks: int | None = None
    way: Way
    _vehicle: Vehicle

    def moved(self, time_s: float) -> tuple[State, Vector]:
        """Return state (6,) [m, m/s] and acceleration (3,) [m/s^2] so long after its begin."""
        return moved(self.way, time_s)

    def at(self, tick: int) -> tuple[State, Vector]:
        """Return the state, and the force in the middle of the tick."""
        return _row_of(self, tick)

    def fill(self, rows: Any, first: int = 0) -> None:
        """Fill rows (n, 9) with references and forces, from a tick of it on."""
        v = self._vehicle
        way_rows(self.way, first, v.dt_s, v.mean_motion_rad_s, v.mass_kg, rows)


class Resting(Moving):
    """At rest at a point, for ever."""

    def __init__(self, position_m: Vector, vehicle: Vehicle) -> None:
        self._vehicle, self.way = vehicle, Way(REST, position_m)


class Coasting(Moving):
    """On with the velocity of its begin, so far."""

    def __init__(self, start: State, vehicle: Vehicle, length_m: float) -> None:
        self._vehicle, self.way = vehicle, Way(COAST, start[:3], start[3:])
        self.ticks = ceil(length_m / norm(*start[3:]) / vehicle.dt_s)


_tables: dict[str, Floats] = {}
"""Motions of legs in the target's axes: those of the runs of a campaign are the same."""

MOST_TABLES = 16


class Turning:
    """A leg that is flown in the axes of the target, which turn.

    motion : how they turn; since : tick at which the leg begins
    kind, args : of the leg in these axes
    """

    def __init__(
        self, motion: Motion, since: int, vehicle: Vehicle, kind: type[Moving], *args: Any
    ) -> None:
        self._motion, self._since, self._vehicle = motion, since, vehicle
        self._inner = kind(*args)
        self._key = repr((kind.__name__, args))  # 0.0 is not -0.0
        self.ticks = self._inner.ticks

    def seen(self, tick: int) -> State:
        """Return the state (6,) in the target's axes, so many ticks after its begin."""
        return self._inner.moved(tick * self._vehicle.dt_s)[0]

    def at(self, tick: int) -> tuple[State, Vector]:
        """Return the state in LVLH, and the force in the middle of the tick."""
        return _row_of(self, tick)

    def moments(self, ticks: int, first: int = 0) -> Floats:
        """Return the motion (n, 15) in the target's axes of so many ticks."""
        key = f'{first} {ticks} {self._key}'
        moments = _tables.get(key)
        if moments is None:
            if len(_tables) >= MOST_TABLES:
                _tables.clear()
            table = as_table(np.empty((ticks, 15)))
            way_moments(self._inner.way, first, self._vehicle.dt_s, table)
            _tables[key] = moments = np.array(table).reshape(-1, 15)
        return moments

    def fill(self, rows: Any, first: int = 0) -> None:
        """Fill rows (n, 9) with references and forces, from a tick of it on."""
        table = self.moments(len(rows), first)
        begin, vehicle = self._since + first, self._vehicle
        frames, halves = (
            as_table(self._motion.frames(begin + len(rows), half=half)[begin:])
            for half in (False, True)
        )
        n, mass_kg = vehicle.mean_motion_rad_s, vehicle.mass_kg
        turn_rows(as_table(table), frames, halves, n, mass_kg, rows)


class Times(NamedTuple):
    """Times of a transfer: its length, the way in the corridor, each burn, the fall of its force.

    None: as `Leg` has them
    """

    duration_s: float
    corridor_s: float | None = None
    burn_s: float | None = None
    ease_s: float | None = None


class Transferring:
    """On a transfer of least energy.

    end : state (6,) [m, m/s] at its end, by its length in ticks
    port : where port and axis of a corridor that turns point (6,) so many ticks after its begin
    """

    def __init__(
        self,
        start: State,
        end: Callable[[int], State],
        vehicle: Vehicle,
        times: Times,
        zones: Limits,
        port: Callable[[int], tuple[float, ...]] | None = None,
    ) -> None:
        self._vehicle, self._port = vehicle, port
        for _ in range(STRETCHES):
            self._plan(start, end, times, zones)
            if self.largest_n <= vehicle.limit_n:
                break
            longer: Any = (time_s and time_s * STRETCH for time_s in times)
            times = Times(*longer)

    def _plan(self, start: State, end: Callable[[int], State], times: Times, zones: Limits) -> None:
        duration_s, corridor_s, burn_s, ease_s = times
        vehicle = self._vehicle
        wanted = max(1, round(duration_s / vehicle.dt_s))
        # a force that falls evenly changes at each tick
        max_segments = wanted if ease_s else SEGMENTS
        self._hold = hold = max(1, -(-wanted // max_segments))  # ticks of a segment
        segments = max(4, -(-wanted // hold))
        seconds = hold * vehicle.dt_s
        step = cw.discretise(vehicle.mean_motion_rad_s, vehicle.mass_kg, seconds)
        burn = None if burn_s is None else max(2, round(burn_s / seconds))
        if corridor_s is not None:
            zones = zones._replace(corridor=segments - max(1, round(corridor_s / seconds)))
            if self._port is not None:
                turned = tuple(self._port(hold * segment) for segment in range(segments + 1))
                zones = zones._replace(ports=turned)
        ease = round(ease_s / seconds) if ease_s else 0
        self.ticks: int | None = segments * hold
        self._end = end(segments * hold)
        self.transfer: Transfer = transfers.least_energy(
            start, self._end, step, segments, zones, burn, ease
        )
        self.largest_n = float(abs(self.transfer.forces).max())

    def at(self, tick: int) -> tuple[State, Vector]:
        """Return the planned state and the force of its segment."""
        if tick >= (self.ticks or 0):
            return self._end, self._vehicle.force_n(self._end, (0.0, 0.0, 0.0))
        return _row_of(self, tick)

    def fill(self, rows: Any, first: int = 0) -> None:
        """Fill rows (n, 9) with references and forces, from a tick of it on."""
        states, forces = as_table(self.transfer.states), as_table(self.transfer.forces)
        sample(states, forces, self._hold, self._vehicle.step, first, rows)


Flown = Moving | Turning | Transferring
"""A leg under way: its `ticks`, None for no end of its own, and the reference `at` a tick."""


def _row_of(flown: Flown, tick: int) -> tuple[State, Vector]:
    """Return state and force of a tick of a leg."""
    rows = as_table(np.empty((1, 9)))
    flown.fill(rows, tick)
    x, y, z, vx, vy, vz, fx, fy, fz = map(float, rows[0])
    return (x, y, z, vx, vy, vz), (fx, fy, fz)


def profile(length: float, first: float, cruise: float, last: float, acceleration: float) -> Speeds:
    """Return how a length is run through.

    Speeds that the length does not allow become smaller; the length is kept.
    """
    a = acceleration
    reached = sqrt(a * length + (first * first + last * last) / 2.0)
    cruise = max(min(cruise, reached), first, last)
    up = (cruise * cruise - first * first) / (2.0 * a)
    down = (cruise * cruise - last * last) / (2.0 * a)
    if abs(last * last - first * first) > 2.0 * a * length:  # too short: it changes faster
        a = abs(last * last - first * first) / (2.0 * length)
        up, down = (length, 0.0) if last > first else (0.0, length)
    up_s = (cruise - first) / a if a > 0.0 else 0.0
    down_s = (cruise - last) / a if a > 0.0 else 0.0
    even_s = max(0.0, (length - up - down) / cruise)  # below 0 by rounding
    return Speeds(a, first, cruise, last, length, up, up_s, even_s, down_s)


class Straight(Moving):
    """On a straight line, with a profile of speed."""

    def __init__(
        self, start: State, to_m: Vector, vehicle: Vehicle, speed_m_s: float, end_m_s: float
    ) -> None:
        self._vehicle = vehicle
        x, y, z, vx, vy, vz = start
        line = (to_m[0] - x, to_m[1] - y, to_m[2] - z)
        length = norm(*line)
        self.ticks = 0
        if length < 1e-6:
            self.way = Way(REST, to_m)
            return
        ahead = (line[0] / length, line[1] / length, line[2] / length)
        closing = vx * ahead[0] + vy * ahead[1] + vz * ahead[2]
        first = min(max(closing, 0.0), speed_m_s)
        speeds = profile(length, first, speed_m_s, end_m_s, vehicle.acceleration_m_s2)
        self.way = Way(LINE, (x, y, z), ahead, speeds)
        self.ticks = ceil(speeds.duration_s / vehicle.dt_s)


class FlyingAround(Moving):
    """On an arc about the target; its radius changes evenly with the angle."""

    def __init__(self, start: State, to_m: Vector, vehicle: Vehicle, speed_m_s: float) -> None:
        self._vehicle = vehicle
        radius, begin = _polar(start[:3])
        last, end = _polar(to_m)
        angle, ahead = _arc(begin, end)
        speed = speed_m_s / max(radius, last)
        rate = vehicle.acceleration_m_s2 / max(radius, last)
        speeds = profile(angle, 0.0, speed, 0.0, rate)
        self.way = Way(ARC, begin, ahead, speeds, radius, (last - radius) / angle)
        self.ticks = ceil(speeds.duration_s / vehicle.dt_s)


def _polar(position_m: tuple[float, ...]) -> tuple[float, Vector]:
    """Return the range [m] and direction of a point; R-bar outward for the target itself."""
    x, y, z = position_m
    size = norm(x, y, z)
    return (size, (x / size, y / size, z / size)) if size > 0.0 else (0.0, (1.0, 0.0, 0.0))


def _arc(a: Vector, end: Vector) -> tuple[float, Vector]:
    """Return the angle [rad] from a to end, unit vectors, and the unit vector b ahead at a."""
    cosine = a[0] * end[0] + a[1] * end[1] + a[2] * end[2]
    for towards in (end, (-1.0, 0.0, 0.0), (0.0, 0.0, 1.0)):  # opposite: by below, or H-bar
        along = towards[0] * a[0] + towards[1] * a[1] + towards[2] * a[2]
        across = [t - along * u for t, u in zip(towards, a, strict=True)]
        size = norm(*across)
        if size > 1e-6:  # of the last, where those before are not
            break
    low, high = 1e-9, PI
    for _ in range(60):  # bisection: the cosine falls from 0 to pi
        angle = 0.5 * (low + high)
        low, high = (angle, high) if sin_cos(angle)[1] > cosine else (low, angle)
    return high, (across[0] / size, across[1] / size, across[2] / size)
