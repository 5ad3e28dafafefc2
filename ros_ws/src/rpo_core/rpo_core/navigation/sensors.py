# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What the chaser knows of the target: sections `navigation` (errors) and `sensors`.

Arithmetic is + - * / sqrt and comparisons, in the order written. Random numbers are functions of
(tick, stream, key), so a measurement is a function of them and of the true state. Sources of usual
sizes: Fehse, "Automated Rendezvous and Docking of Spacecraft", 2003, 7.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from math import nan, pi, sqrt
from typing import Annotated, Any

from rpo_core.attitude.chaser import turn_back
from rpo_core.attitude.target import Target, motion_of
from rpo_core.files.codec import unless_default
from rpo_core.files.validation import (
    Checked,
    InputError,
    choice,
    flag,
    real,
    shown,
    store,
    vector3,
    whole,
)
from rpo_core.kernels.arithmetic import State, Vector, pick, sin_cos
from rpo_core.kernels.calls import ASK
from rpo_core.kernels.jit import as_table, inlined, step_kernel
from rpo_core.kernels.noise import normal_pair, philox, six_normals
from rpo_core.kernels.records import prepared
from rpo_core.stage import KernelStage, Place, Section, Signal, register
from rpo_core.wire import interfaces
from rpo_core.world.zones import Zones

NO_DIRECTION_M = 1e-9
"""Closer to the target than this, the line of sight is taken to be along V-bar."""

FIRST, SECOND, OUTLYING, WALKING = range(4)  # blocks of random words of a tick

MESSAGE = 24
"""Numbers of a measurement's message: position, velocity, and the covariance of each (3, 3)."""

AHEAD = 64
"""Ticks, or measurements, of a block whose noise is computed together."""

PORT_TICKS = 512
"""Ticks for which the place of the port is computed ahead."""


@dataclass(slots=True)
class PortBlock:
    """Where the port is, tick by tick.

    first : tick of the first position
    positions : (n, 3) [m], target LVLH; empty where there is none yet
    """

    first: int = 0
    positions: list[list[float]] = field(default_factory=list)


@dataclass(slots=True)
class SensorRow:
    """A sensor as kernels read it; see `Sensor`.

    cross_share : sigma across the line of sight, as a share of the distance
    walk : sigma of a tick [m]
    dropout, outlier : bounds of a random word of 32 bits
    cosine : of the half angle of the field of view, -2 if there is no limit
    rotates : 1 where all is in the chaser's axes
    at_port : 1 where the sensor looks at the port
    outages : (n, 2) ticks, first and end of each
    """

    noise_floor: float
    noise_share: float
    cross_share: float
    velocity_floor: float
    velocity_share: float
    has_range: int
    has_velocity: int
    bias: Vector
    walk: float
    scale: float
    period: int
    latency: int
    dropout: float
    outlier: float
    outlier_size: float
    cosine: float
    axis: Vector
    velocity_bias: Vector
    rotates: int
    at_port: int
    outages: list[list[int]]


@dataclass(slots=True)
class SensorSuite:
    """Settings of the kernel `sense`; at_port : 1 where a sensor looks at the port."""

    key: tuple[int, int]
    sensors: list[SensorRow]
    at_port: int
    port: PortBlock


@dataclass(slots=True)
class Measurement:
    """What a sensor measured.

    tick : at which it was taken; -1: there is none
    position : [m], a unit vector without range; velocity : [m/s]
    """

    tick: int = -1
    position: Annotated[list[float], 3] = field(default_factory=lambda: [0.0] * 3)
    velocity: Annotated[list[float], 3] = field(default_factory=lambda: [0.0] * 3)


@dataclass(slots=True)
class SensorNoise:
    """Noise of the measurements of a block: it depends on the tick alone, and together it is SIMD.

    block : its number; -1 before the first
    normals : of the position, then of the velocity
    words : random words of 32 bits, for a loss and for an outlier
    """

    block: int = -1
    normals: Annotated[list[list[float]], 6, AHEAD] = field(
        default_factory=lambda: [[0.0] * AHEAD for _ in range(6)]
    )
    words: Annotated[list[list[int]], 2, AHEAD] = field(
        default_factory=lambda: [[0] * AHEAD for _ in range(2)]
    )


@dataclass(slots=True)
class SensorMemory:
    """What a sensor remembers.

    walk : (3,) [m] the part of its bias that is a random walk; walked : tick up to which
    line : measurements on their way, that of tick k at place k % len(line)
    """

    line: list[Measurement]
    walk: Annotated[list[float], 3] = field(default_factory=lambda: [0.0] * 3)
    walked: int = -1
    noise: SensorNoise = field(default_factory=SensorNoise)


@dataclass(slots=True)
class SuiteMemory:
    """Memory of the kernel `sense`."""

    sensors: list[SensorMemory]


@inlined
def larger(floor: float, value: float) -> float:
    """Return the larger one of two numbers."""
    return value if value > floor else floor


@inlined
def sight(x: float, y: float, z: float) -> tuple[float, float, float, float]:
    """Return the distance [m] of a point, and its direction (3,)."""
    distance = sqrt(x * x + y * y + z * z)
    if distance < NO_DIRECTION_M:
        return distance, 0.0, 1.0, 0.0
    return distance, x / distance, y / distance, z / distance


@inlined
def across(ux: float, uy: float, uz: float) -> tuple[Vector, Vector]:
    """Return two unit vectors that form a right-handed frame with a unit vector.

    The first is at right angles to the axis that is farthest from the vector. Of a vector of zeros,
    as `sight` has where the distance overflows, they are no numbers.
    """
    sx, sy, sz = abs(ux), abs(uy), abs(uz)
    no_z = sy <= sz
    no_x = sx <= pick(no_z, sy, sz)
    ax = pick(no_x, 0.0, pick(no_z, -uz, uy))
    ay = pick(no_x, uz, pick(no_z, 0.0, -ux))
    az = pick(no_x, -uy, pick(no_z, ux, 0.0))
    size = sqrt(ax * ax + ay * ay + az * az)
    size = pick(size > 0.0, size, nan)  # interpreted, a division by zero raises
    ax, ay, az = ax / size, ay / size, az / size
    return (ax, ay, az), (uy * az - uz * ay, uz * ax - ux * az, ux * ay - uy * ax)


@inlined
def three_normals(tick: int, block: int, stream: int, k0: int, k1: int) -> Vector:
    """Return three independent standard normals of a block of a tick of a stream."""
    a, b, c, d = philox(tick, block, stream, 0, k0, k1)
    n0, n1 = normal_pair(a, b)
    n2, _ = normal_pair(c, d)
    return n0, n1, n2


@step_kernel
def is_due(tick: int, s: Any) -> bool:
    """Return whether a sensor measures at a tick: its period, and no outage [begin, end)."""
    due = tick % s.period == 0
    for i in range(len(s.outages)):
        due = due and not s.outages[i][0] <= tick < s.outages[i][1]
    return due


@inlined
def scattered(
    point: Vector, normals: Vector, floor: float, share: float, cross_share: float, scale: float
) -> Vector:
    """Return a point (3,) [m] as it is measured: scaled, with noise along and across the sight."""
    x, y, z = point
    distance, ux, uy, uz = sight(x, y, z)
    along = larger(floor, share * distance) * normals[0]
    cross = larger(floor, cross_share * distance)
    (ax, ay, az), (bx, by, bz) = across(ux, uy, uz)
    first, second = cross * normals[1], cross * normals[2]
    return (
        x * scale + (ux * along + ax * first + bx * second),
        y * scale + (uy * along + ay * first + by * second),
        z * scale + (uz * along + az * first + bz * second),
    )


@step_kernel
def noise_of(tick: int, s: Any, stream: int, key: Any, m: Any) -> int:
    """Return the place in a block, which is filled, of the noise of a measurement at a tick."""
    number = tick // s.period
    block = number // AHEAD
    first = block * AHEAD
    if m.block != block:
        m.block = block
        k0, k1, period = key[0], key[1], s.period
        for j in range(AHEAD):
            t = (first + j) * period
            a, b, c, d = philox(t, FIRST, stream, 0, k0, k1)
            e, f, m.words[0][j], m.words[1][j] = philox(t, SECOND, stream, 0, k0, k1)
            m.normals[0][j], m.normals[1][j] = normal_pair(a, b)
            m.normals[2][j], m.normals[3][j] = normal_pair(c, d)
            m.normals[4][j], m.normals[5][j] = normal_pair(e, f)
    return number - first


@step_kernel
def take(tick: int, u: Any, point: Vector, s: Any, stream: int, p: Any, m: Any, taken: Any) -> None:
    """Fill what a sensor measures at a tick, unless it measures nothing.

    u : its first numbers are the true state (6,); point : (3,) [m], where the sensor has the chaser
    s, m : settings and memory of the sensor; taken : the measurement

        r = point + bias + walk,  measured = scale r + along n_0 u + across (n_1 a + n_2 b)

    u is the line of sight, a and b are at right angles to it. The noise has one sigma along the
    line of sight, another across it; both grow with the distance |r|.
    """
    x, y, z = point
    x, y, z = x + s.bias[0] + m.walk[0], y + s.bias[1] + m.walk[1], z + s.bias[2] + m.walk[2]
    distance, ux, uy, uz = sight(x, y, z)
    away = ux * s.axis[0] + uy * s.axis[1] + uz * s.axis[2]
    if not -away >= s.cosine:  # out of the field of view
        return
    at, normals, words = noise_of(tick, s, stream, p.key, m.noise), m.noise.normals, m.noise.words
    if words[0][at] < s.dropout:
        return
    n = (normals[0][at], normals[1][at], normals[2][at])
    x, y, z = scattered((x, y, z), n, s.noise_floor, s.noise_share, s.cross_share, s.scale)
    if words[1][at] < s.outlier:
        ox, oy, oz = three_normals(tick, OUTLYING, stream, p.key[0], p.key[1])
        x, y, z = x + s.outlier_size * ox, y + s.outlier_size * oy, z + s.outlier_size * oz
    if not s.has_range:
        _, x, y, z = sight(x, y, z)
    taken.tick = tick
    taken.position[0], taken.position[1], taken.position[2] = x, y, z
    if s.has_velocity:
        sigma = larger(s.velocity_floor, s.velocity_share * distance)
        for j in range(3):
            taken.velocity[j] = u[3 + j] + s.velocity_bias[j] + sigma * normals[3 + j][at]


@step_kernel
def sense(tick: int, u: Any, p: Any, m: Any, y: Any) -> int:
    """Measure at a tick, and send what arrives at it.

    u : true state (6,) [m, m/s], target LVLH, then the chaser's attitude (7,) where a sensor
        rotates with it
    y : message (24,) of each sensor, see `describe`
    """
    if p.at_port and not 0 <= tick - p.port.first < len(p.port.positions):
        return ASK
    for i in range(len(p.sensors)):
        s, sensor = p.sensors[i], m.sensors[i]
        while s.walk > 0.0 and sensor.walked < tick:
            sensor.walked += 1
            n = three_normals(sensor.walked, WALKING, i + 1, p.key[0], p.key[1])
            for j in range(3):
                sensor.walk[j] += s.walk * n[j]
        slots = len(sensor.line)
        taken = sensor.line[tick % slots]
        taken.tick = -1
        if is_due(tick, s):
            point = (u[0], u[1], u[2])
            if s.at_port:
                port = p.port.positions[tick - p.port.first]
                point = (u[0] - port[0], u[1] - port[1], u[2] - port[2])
            if s.rotates:
                point = turn_back(point, (u[6], u[7], u[8], u[9]))
            take(tick, u, point, s, i + 1, p, sensor, taken)
        due = tick - s.latency
        describe(s, due >= 0, due, sensor.line[due % slots], y, MESSAGE * i)
    return 0


@step_kernel
def describe(s: Any, begun: bool, due: int, measured: Any, y: Any, first: int) -> None:
    """Fill the numbers (24,) of a message, from place `first` on: of what was taken at tick `due`.

    Position, velocity, and the covariance of each (rows of 3 x 3) as the sensor claims it, from the
    distance measured: along^2 u u' + across^2 (1 - u u'). As in sensor_msgs/Imu, a covariance that
    begins with -1 means: not measured.
    """
    for j in range(MESSAGE):
        y[first + j] = 0.0
    y[first + 6], y[first + 15] = -1.0, -1.0
    if not begun or measured.tick != due:
        return
    x, v = measured.position, measured.velocity
    for j in range(3):
        y[first + j] = x[j]
    distance, ux, uy, uz = sight(x[0], x[1], x[2])
    along = larger(s.noise_floor, s.noise_share * distance)
    cross = larger(s.noise_floor, s.cross_share * distance)
    if not s.has_range:
        along, cross = 0.0, s.cross_share
    u = (ux, uy, uz)
    for row in range(3):
        for column in range(3):
            one = 1.0 if row == column else 0.0
            shared = u[row] * u[column]
            value = along * along * shared + cross * cross * (one - shared)
            y[first + 6 + 3 * row + column] = value
    if s.has_velocity:
        sigma = larger(s.velocity_floor, s.velocity_share * distance)
        y[first + 15] = 0.0
        for j in range(3):
            y[first + 3 + j] = v[j]
            y[first + 15 + 4 * j] = sigma * sigma


MAX_POSITION_ERROR_M = 1e5
MAX_VELOCITY_ERROR_M_S = 1e3


def key(name: str, value: Any) -> tuple[int, ...]:
    """Return two words of 32 bits, a key of Philox4x32-10; raises InputError."""
    if not isinstance(value, (list, tuple)) or len(value) != 2:
        raise InputError(f'`{name}` must be a list of 2 words of 32 bits; got {shown(value)}')
    return tuple(whole(f'{name}[{i}]', v, least=0, most=2**32 - 1) for i, v in enumerate(value))


_metres = partial(real, unit='m', least=0.0, most=MAX_POSITION_ERROR_M)
_speed = partial(real, unit='m/s', least=0.0, most=MAX_VELOCITY_ERROR_M_S)
_vector = partial(vector3, unit='m', bound=MAX_POSITION_ERROR_M)
_velocity = partial(vector3, unit='m/s', bound=MAX_VELOCITY_ERROR_M_S)


@dataclass(frozen=True)
class Navigation(Checked):
    """Error of the navigation solution, which is what the controller sees.

    position_bias_m, velocity_bias_m_s : (3,) added to the truth, target LVLH
    position_noise_m, velocity_noise_m_s : 1 sigma, white, each axis by itself, new at each tick
    noise_key : two words of 32 bits, the key of Philox4x32-10
    """

    position_bias_m: Annotated[Vector, _vector] = (0.0, 0.0, 0.0)
    velocity_bias_m_s: Annotated[Vector, _velocity] = (0.0, 0.0, 0.0)
    position_noise_m: Annotated[float, _metres] = 0.0
    velocity_noise_m_s: Annotated[float, _speed] = 0.0
    noise_key: Annotated[tuple[int, int], key] = (0, 0)


@dataclass(slots=True)
class NavigationErrors:
    """Settings of the kernel `navigate`: see `Navigation`; noisy : 1 where there is noise."""

    noisy: int
    noise: State
    bias: State
    key: tuple[int, int]


@dataclass(slots=True)
class NoiseAhead:
    """Normals of the ticks of a block: they depend on the tick alone, and together they are SIMD.

    block : its number; -1 before the first
    """

    block: int
    normals: Annotated[list[list[float]], AHEAD, 6]


NO_NOISE = prepared(NoiseAhead(-1, [[0.0] * 6 for _ in range(AHEAD)]))
"""Before tick 0."""


@step_kernel
def navigate(tick: int, u: Any, p: Any, m: Any, y: Any) -> None:
    """x_k + bias + sigma n_k: from the true state u (6,) to the navigation solution y (6,)."""
    block = tick // AHEAD
    at = tick - block * AHEAD
    if p.noisy and m.block != block:
        m.block = block
        for j in range(AHEAD):
            n = six_normals(tick - at + j, p.key[0], p.key[1])
            for i in range(6):
                m.normals[j][i] = n[i]
    for i in range(6):
        y[i] = u[i] + p.bias[i] + p.noise[i] * m.normals[at][i]


class NavigationStage(KernelStage):
    """From the true state to the navigation solution."""

    name = 'navigation'
    inputs = (interfaces.RELATIVE_STATE,)
    outputs = (interfaces.NAVIGATION_STATE,)
    kernel = navigate

    def __init__(self, settings: Navigation, _scenario: Any = None) -> None:
        self.settings = settings
        r, v = settings.position_noise_m, settings.velocity_noise_m_s
        noise, bias = (r, r, r, v, v, v), (*settings.position_bias_m, *settings.velocity_bias_m_s)
        errors = NavigationErrors(int(r > 0.0 or v > 0.0), noise, bias, settings.noise_key)
        super().__init__(errors, NO_NOISE)


register(Section('navigation', Navigation, Place.SENSOR, NavigationStage))


MAX_SENSORS = 4
MAX_LATENCY_TICKS = 100
MAX_OUTAGES = 100
POSITION, RANGE_BEARING, BEARING = 'relative_position', 'range_bearing', 'bearing'
KINDS = (POSITION, RANGE_BEARING, BEARING)
CENTRE, PORT = 'centre', 'port'

NOISES = (
    'noise_floor_m',
    'noise_share',
    'bearing_noise_rad',
    'velocity_floor_m_s',
    'velocity_share_1_s',
)
"""Fields of a sensor that scale its noise."""

MEASUREMENTS = ('measurement', *(f'measurement_{i}' for i in range(2, MAX_SENSORS + 1)))
"""Signals, one of each sensor."""

for _name in MEASUREMENTS:
    interfaces.add(
        interfaces.Interface(
            _name,
            interfaces.STATE_TYPE,
            'what a sensor measured, with its covariance; -1 as the first one: nothing',
            covariance=True,
            also=interfaces.CHASER_FRAME,
        ),
        before=interfaces.NAVIGATION_STATE,
    )


def intervals(name: str, value: Any) -> tuple[tuple[float, float], ...]:
    """Return intervals [begin, end) of flight time [s]; raises InputError."""
    if not isinstance(value, (list, tuple)) or len(value) > MAX_OUTAGES:
        raise InputError(
            f'`{name}` must be a list of at most {MAX_OUTAGES} intervals [begin, end] in s; '
            f'got {shown(value)}'
        )
    pairs = []
    for i, pair in enumerate(value):
        if not isinstance(pair, (list, tuple)) or len(pair) != 2:
            raise InputError(f'`{name}[{i}]` must be [begin, end] in s; got {shown(pair)}')
        begin = real(f'{name}[{i}][0]', pair[0], 's', least=0.0)
        pairs.append((begin, real(f'{name}[{i}][1]', pair[1], 's', above=begin)))
    return tuple(pairs)


_share = partial(real, least=0.0, most=1.0)
_direction = partial(vector3, unit='', bound=1e6)


@dataclass(frozen=True)
class Sensor(Checked):
    """One sensor. Noise is white; its sigma is the larger one of a floor and a share of the range.

    kind : `relative_position` (each axis alike), `range_bearing` (a lidar, a camera that knows the
        size of the target) or `bearing` (a camera that does not)
    noise_floor_m, noise_share : sigma of each axis, or along the line of sight
    bearing_noise_rad : sigma across the line of sight; `noise_floor_m` is the floor of that too
    velocity_floor_m_s, velocity_share_1_s : sigma of velocity, by range; both 0: not measured
    bias_m : (3,) added to the position; bias_walk_m_s0_5 : per root of a second, each axis
    velocity_bias_m_s : (3,) added to the velocity, where that is measured
    scale_error : share by which distances are too long
    period_ticks, latency_ticks : between measurements; from a measurement to its arrival
    dropout_share : probability that a measurement does not come
    boresight : (3,) axis of the field of view, from the chaser, target LVLH
    body_fixed : whether boresight, bias and measurement are in the axes of the chaser, which turn
    looks_at : the target's `centre`, or the `port`, as the target's attitude puts it: the chaser
        is measured from there
    field_of_view_rad : half angle about the boresight; pi: there is no limit
    outages_s : intervals [begin, end) of flight time without measurements
    outlier_share : probability of an outlier; outlier_size_m : sigma of it, each axis
    """

    kind: Annotated[str, partial(choice, known=KINDS)]
    noise_floor_m: Annotated[float, _metres] = 0.01
    noise_share: Annotated[float, _share] = 0.0
    bearing_noise_rad: Annotated[float, _share] = 0.0
    velocity_floor_m_s: Annotated[float, _speed] = 0.0
    velocity_share_1_s: Annotated[float, _share] = 0.0
    bias_m: Annotated[Vector, _vector] = (0.0, 0.0, 0.0)
    bias_walk_m_s0_5: Annotated[float, _metres] = 0.0
    scale_error: Annotated[float, partial(real, above=-1.0, most=1.0)] = 0.0
    period_ticks: Annotated[int, partial(whole, least=1, most=1_000_000)] = 1
    latency_ticks: Annotated[int, partial(whole, least=0, most=MAX_LATENCY_TICKS)] = 0
    dropout_share: Annotated[float, partial(real, least=0.0, below=1.0)] = 0.0
    boresight: Annotated[Vector, _direction] = (0.0, 1.0, 0.0)
    field_of_view_rad: Annotated[float, partial(real, unit='rad', above=0.0, most=pi)] = pi
    outages_s: Annotated[tuple[tuple[float, float], ...], intervals] = ()
    outlier_share: Annotated[float, partial(real, least=0.0, below=1.0)] = 0.0
    outlier_size_m: Annotated[float, _metres] = 0.0
    velocity_bias_m_s: Annotated[Vector, _velocity] = unless_default((0.0, 0.0, 0.0))
    body_fixed: Annotated[bool, flag] = unless_default(False)
    looks_at: Annotated[str, partial(choice, known=(CENTRE, PORT))] = unless_default(CENTRE)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.noise_floor_m <= 0.0:
            raise InputError('`noise_floor_m` must be > 0 m: a covariance must be positive; got 0')
        if self.kind == POSITION and self.bearing_noise_rad > 0.0:
            raise InputError('`bearing_noise_rad` must be 0 for a sensor of relative_position')
        if self.kind == BEARING and self.bearing_noise_rad == 0.0:
            raise InputError('`bearing_noise_rad` must be > 0 rad for a sensor of bearing; got 0')
        if self.kind == BEARING and self.noise_share > 0.0:
            raise InputError('`noise_share` must be 0 for a sensor of bearing: it has no range')
        if self.velocity_share_1_s > 0.0 and self.velocity_floor_m_s == 0.0:
            raise InputError('`velocity_floor_m_s` must be > 0 m/s where velocity is measured')
        if self.kind != POSITION and self.velocity_floor_m_s > 0.0:
            raise InputError('`velocity_floor_m_s` must be 0 but for a sensor of relative_position')
        if any(self.velocity_bias_m_s) and self.velocity_floor_m_s == 0.0:
            raise InputError('`velocity_bias_m_s` must be 0 where velocity is not measured')
        if self.kind == POSITION and self.body_fixed:
            raise InputError('`body_fixed` must be false for a sensor of relative_position')
        if self.kind == POSITION and self.looks_at != CENTRE:
            raise InputError('`looks_at` must be centre for a sensor of relative_position')
        if not any(self.boresight):
            raise InputError('`boresight` must have a direction; got [0, 0, 0]')

    def row(self, scenario: Any) -> SensorRow:
        """Return the sensor as the kernels read it."""
        x, y, z = self.boresight
        size = sqrt(x * x + y * y + z * z)
        limited = self.field_of_view_rad < pi
        return SensorRow(
            noise_floor=self.noise_floor_m,
            noise_share=self.noise_share,
            cross_share=self.noise_share if self.kind == POSITION else self.bearing_noise_rad,
            velocity_floor=self.velocity_floor_m_s,
            velocity_share=self.velocity_share_1_s,
            has_range=int(self.kind != BEARING),
            has_velocity=int(self.velocity_floor_m_s > 0.0),
            bias=self.bias_m,
            walk=self.bias_walk_m_s0_5 * sqrt(scenario.dt_s),
            scale=1.0 + self.scale_error,
            period=self.period_ticks,
            latency=self.latency_ticks,
            dropout=self.dropout_share * 2**32,
            outlier=self.outlier_share * 2**32,
            outlier_size=self.outlier_size_m,
            cosine=sin_cos(self.field_of_view_rad)[1] if limited else -2.0,
            axis=(x / size, y / size, z / size),
            velocity_bias=self.velocity_bias_m_s,
            rotates=int(self.body_fixed),
            at_port=int(self.looks_at == PORT),
            outages=[[first_tick(time, scenario) for time in pair] for pair in self.outages_s],
        )


@dataclass(frozen=True)
class Sensors(Checked):
    """The sensors of a chaser.

    noise_key : two words of 32 bits, the key of Philox4x32-10, for all of them and for the start of
        the estimator
    port_m : (3,) in the target's axes, where a sensor looks at it; as in section `zones`, unless it
        differs
    """

    units: tuple[Sensor, ...]
    noise_key: Annotated[tuple[int, int], key] = (0, 0)
    port_m: Annotated[Vector, partial(vector3, unit='m', bound=1e4)] = unless_default(
        (0.0, 0.0, 0.0)
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 1 <= len(self.units) <= MAX_SENSORS:
            raise InputError(f'`units` must be 1 to {MAX_SENSORS} sensors; got {len(self.units)}')
        store(self, units=tuple(self.units))
        if self.look and not any(self.port_m):
            raise InputError('`looks_at` port needs `port_m`, or that of section `zones`')

    @property
    def signals(self) -> tuple[str, ...]:
        """Names of the signals, one of each sensor."""
        return MEASUREMENTS[: len(self.units)]

    @property
    def own_axes(self) -> tuple[str, ...]:
        """Names of the signals whose numbers are in the chaser's axes."""
        pairs = zip(self.signals, self.units, strict=True)
        return tuple(name for name, unit in pairs if unit.body_fixed)

    @property
    def turn(self) -> bool:
        """Whether one of them turns with the chaser."""
        return any(unit.body_fixed for unit in self.units)

    @property
    def look(self) -> bool:
        """Whether one of them looks at the port."""
        return any(unit.looks_at == PORT for unit in self.units)

    @staticmethod
    def of_zones(document: Any, zones: Zones) -> dict[str, Any]:
        """Return the fields that are as the zones of the scenario, unless the section has them."""
        units = document.get('units') if isinstance(document, Mapping) else None
        looking = [u for u in units or () if isinstance(u, Mapping) and u.get('looks_at') == PORT]
        return {'port_m': list(zones.port_m)} if looking else {}


STILL = Target(kind='fixed')
"""In place of a target without attitude: its axes are those of target LVLH."""


class PortMotion:
    """Where the port of a scenario is, block by block.

    known : by the attitude that the chaser takes the target to have; else by the true one
    """

    def __init__(self, settings: Sensors, scenario: Any, *, known: bool = False) -> None:
        target = scenario.target or STILL
        self._port = settings.port_m
        self._motion = motion_of(target.known if known else target, scenario)

    def write(self, p: Any, first: int, ticks: int) -> None:
        """Write where it is in some ticks into the settings of a kernel."""
        x, y, z = self._port
        rows = self._motion.block(first, ticks)[:, :9].reshape(-1, 3, 3)
        positions = rows[:, :, 0] * x + rows[:, :, 1] * y + rows[:, :, 2] * z
        p.port.first, p.port.positions = first, as_table(positions)


def first_tick(time_s: float, scenario: Any) -> int:
    """Return the first tick at a time or after it."""
    return min(-(-round(time_s * 1e9) // scenario.dt_ns), 2**31)


class SensorsStage(KernelStage):
    """From the true state to the measurements that arrive."""

    name = 'sensors'
    inputs: tuple[str, ...] = (interfaces.RELATIVE_STATE,)
    kernel = sense

    def __init__(self, settings: Sensors, scenario: Any) -> None:
        self.outputs = settings.signals
        if settings.turn:
            self.inputs = (interfaces.RELATIVE_STATE, interfaces.CHASER_ATTITUDE)
        self.memory_ticks = max(unit.latency_ticks for unit in settings.units)
        self._port = PortMotion(settings, scenario)
        rows = [unit.row(scenario) for unit in settings.units]
        lines = ([Measurement() for _ in range(row.latency + 1)] for row in rows)
        suite = SensorSuite(settings.noise_key, rows, int(settings.look), PortBlock())
        super().__init__(suite, SuiteMemory([SensorMemory(line) for line in lines]))

    def answer(self, tick: int, u: Sequence[float]) -> None:
        """Compute where the port is."""
        self._port.write(self.p, tick - tick % PORT_TICKS, PORT_TICKS)

    def answer_ahead(self, ticks: int, u: Sequence[float]) -> None:
        """Compute where the port is in a flight."""
        if self.p.at_port:
            self._port.write(self.p, 0, ticks + 1)

    def passes_on(self) -> tuple[int | Signal, ...]:
        """Return that each measurement is the true state."""
        return (0,) * len(self.outputs)


def _check(settings: Sensors, scenario: Any) -> None:
    """Raise InputError if a sensor never measures in a flight of the scenario."""
    for i, unit in enumerate(settings.units):
        place = f'`sensors.units[{i}]`'
        if unit.body_fixed and scenario.attitude is None:
            raise InputError(f'{place}: `body_fixed` needs section `attitude`; it is missing')
        if unit.latency_ticks > scenario.ticks:
            raise InputError(
                f'{place}: `latency_ticks` must be at most {scenario.ticks}, the length of the '
                f'flight; got {unit.latency_ticks}'
            )
        last = scenario.ticks - unit.latency_ticks
        end = 0
        for begin, until in sorted(unit.outages_s):
            if -(-first_tick(begin, scenario) // unit.period_ticks) * unit.period_ticks > end:
                break
            end = max(end, first_tick(until, scenario))
            end = -(-end // unit.period_ticks) * unit.period_ticks
        if end > last:
            raise InputError(f'{place}: `outages_s` must leave time to measure; they leave none')


register(Section('sensors', Sensors, Place.SENSOR, SensorsStage, _check))
