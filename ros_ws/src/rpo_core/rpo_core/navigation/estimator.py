# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The estimator: a Kalman filter on the relative motion. Section `estimator`.

It reads the measurements and the force that was commanded one tick before. Arithmetic is + - * /
sqrt and comparisons, in the order written.

The state has six numbers, position [m] and velocity [m/s] in target LVLH, or nine with a constant
disturbance force [N]. A covariance is a 9 x 9 table, always symmetric; without a disturbance its
last rows and columns are not used.

A measurement is taken number by number (they are independent in the frame of the line of sight).
An update is in Joseph's form: P - K h' P, then the same from the other side, plus K r K'. Source:
Bar-Shalom, Li and Kirubarajan, "Estimation with Applications to Tracking and Navigation", 2001, 5.2
and 10.4.

What a sensor that turns with the chaser measures is turned to LVLH by the attitude estimated at its
tick. An error e (3,) of that attitude moves a point r by r x e, across the line of sight; the
variance there grows by that of e times the square of the distance.

A sensor that looks at the port measures the chaser from there. The port is where the known attitude
of the target puts it at that tick.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from functools import partial
from math import sqrt
from typing import Annotated, Any

import numpy as np

from rpo_core.attitude.chaser import turn, turn_back
from rpo_core.files.codec import unless_default
from rpo_core.files.validation import Checked, InputError, flag, real, whole
from rpo_core.kernels.arithmetic import Vector, saturate
from rpo_core.kernels.arrays import Floats
from rpo_core.kernels.calls import ASK
from rpo_core.kernels.jit import inlined, step_kernel
from rpo_core.navigation.sensors import (
    MAX_SENSORS,
    MESSAGE,
    PORT_TICKS,
    Measurement,
    PortBlock,
    PortMotion,
    SensorRow,
    Sensors,
    across,
    larger,
    sight,
    three_normals,
)
from rpo_core.stage import KernelStage, Place, Section, Signal, register
from rpo_core.wire import interfaces
from rpo_core.wire.interfaces import ATTITUDE, PREVIOUS_COMMAND
from rpo_core.world import cw
from rpo_core.world.cw import CwStep, cw_step

STATES = 9
POSITION, VELOCITY = 0, 3
"""Places in a state."""

NONE, TRUE, ESTIMATED = range(3)
"""Attitudes that a filter reads."""


def zeros(rows: int, columns: int) -> list[list[float]]:
    """Return a table of zeros."""
    return [[0.0] * columns for _ in range(rows)]


@dataclass(slots=True)
class Filter:
    """Settings of the kernel `estimate`.

    states : 6, or 9 with a disturbance
    limit_n : of the thrusters; delay : ticks from a command to its force
    patience : so many rejected measurements in a row restart it; 0: none do
    latency : the largest of a sensor [ticks]
    covariance : 1 where the covariance of the newest tick is wanted; 0: the state alone, which is
        faster where measurements come late
    attitude : NONE, TRUE or ESTIMATED, of the chaser, where a sensor rotates with it
    at_port : 1 where a sensor looks at the port
    gust : share by which the process noise grows with the square of a command [1/N^2]
    step : exact step of the relative motion for one tick
    gates : largest NIS of so many numbers
    start : state at the start
    process_noise, spread, spread_again : covariances that a tick adds, at the start, after a
        restart
    sensors : as the filter takes them
    port : where the known attitude of the target puts it
    """

    states: int
    limit_n: float
    delay: int
    patience: int
    latency: int
    covariance: int
    attitude: int
    at_port: int
    gust: float
    step: CwStep
    gates: Annotated[list[float], 7]
    start: Annotated[list[float], 9]
    process_noise: Annotated[list[list[float]], 9, 9]
    spread: Annotated[list[list[float]], 9, 9]
    spread_again: Annotated[list[list[float]], 9, 9]
    sensors: list[SensorRow]
    port: PortBlock


@dataclass(slots=True)
class Heading:
    """What is known at a tick of the attitudes of chaser and target.

    attitude : quaternion of the chaser; covariance : of its angles, the chaser's axes [rad^2]
    port : [m], target LVLH
    """

    attitude: Annotated[list[float], 4] = field(default_factory=lambda: [0.0] * 4)
    covariance: Annotated[list[list[float]], 3, 3] = field(default_factory=partial(zeros, 3, 3))
    port: Annotated[list[float], 3] = field(default_factory=lambda: [0.0] * 3)


@dataclass(slots=True)
class Arrived:
    """What came of a sensor; the measurement of tick k is at place k % len(line)."""

    line: list[Measurement]


@dataclass(slots=True)
class Counts:
    """What a filter counts of its measurements; ticks are -1 before the first."""

    rejected_in_a_row: int = 0
    accepted: int = 0
    rejected: int = 0
    last_accepted: int = -1
    restarts: int = 0
    last_restart: int = -1


@dataclass(slots=True)
class FilterMemory:
    """Memory of the kernel `estimate`.

    now, origin : the newest tick, and the first one; -1: it has not begun
    settled : tick up to which all measurements have come
    whole : whether the newest covariance is another one than the settled
    x, p : state and covariance of the newest tick; of the settled one; before a measurement
    ph, gain : scratch
    tested, nis, innovations : of the newest measurement of each sensor, how many numbers were
        tested (0: none came), the sum of their squares, and each innovation over its sigma
    commands, arrived, headings : of the newest ticks, that of tick k at place k % len(commands)
    """

    commands: list[list[float]]
    arrived: list[Arrived]
    headings: list[Heading]
    now: int = -1
    origin: int = -1
    settled: int = -1
    counts: Counts = field(default_factory=Counts)
    whole: int = 1
    x: Annotated[list[float], 9] = field(default_factory=lambda: [0.0] * 9)
    p: Annotated[list[list[float]], 9, 9] = field(default_factory=partial(zeros, 9, 9))
    settled_x: Annotated[list[float], 9] = field(default_factory=lambda: [0.0] * 9)
    settled_p: Annotated[list[list[float]], 9, 9] = field(default_factory=partial(zeros, 9, 9))
    kept_x: Annotated[list[float], 9] = field(default_factory=lambda: [0.0] * 9)
    kept_p: Annotated[list[list[float]], 9, 9] = field(default_factory=partial(zeros, 9, 9))
    ph: Annotated[list[float], 9] = field(default_factory=lambda: [0.0] * 9)
    gain: Annotated[list[float], 9] = field(default_factory=lambda: [0.0] * 9)
    tested: Annotated[list[int], MAX_SENSORS] = field(default_factory=lambda: [0] * MAX_SENSORS)
    nis: Annotated[list[float], MAX_SENSORS] = field(default_factory=lambda: [0.0] * MAX_SENSORS)
    innovations: Annotated[list[list[float]], MAX_SENSORS, 6] = field(
        default_factory=partial(zeros, MAX_SENSORS, 6)
    )


@step_kernel
def copy_state(x: Any, to: Any) -> None:
    """Copy a state (n,)."""
    for i in range(len(x)):
        to[i] = x[i]


@step_kernel
def copy_covariance(p: Any, to: Any) -> None:
    """Copy a covariance (n, n)."""
    for i in range(len(p)):
        row, copy = p[i], to[i]
        for j in range(len(row)):
            copy[j] = row[j]


@step_kernel
def step_state(x: Any, states: int, force: Any, step: CwStep) -> None:
    """Move the state (9,) by one tick under a force (3,) [N]."""
    fx, fy, fz = force[0], force[1], force[2]
    if states == STATES:
        fx, fy, fz = fx + x[6], fy + x[7], fz + x[8]
    following = cw_step((x[0], x[1], x[2], x[3], x[4], x[5]), (fx, fy, fz), step)
    for i in range(6):
        x[i] = following[i]


@step_kernel
def step_covariance(p: Any, step: CwStep, noise: Any, louder: float) -> None:
    """Replace the covariance P by F P F' + Q; louder : factor of what Q has of the motion."""
    a, b, c, d, e, f, fx, fy, fz = p[0], p[1], p[2], p[3], p[4], p[5], p[6], p[7], p[8]
    for j in range(STATES):
        column = (a[j], b[j], c[j], d[j], e[j], f[j])
        a[j], b[j], c[j], d[j], e[j], f[j] = cw_step(column, (fx[j], fy[j], fz[j]), step)
    for i in range(6):  # a disturbance stays: so do the rows of it
        r = p[i]
        following = cw_step((r[0], r[1], r[2], r[3], r[4], r[5]), (r[6], r[7], r[8]), step)
        for j in range(6):
            r[j] = following[j]
    for i in range(STATES):
        row, added, factor = p[i], noise[i], louder if i < 6 else 1.0
        for j in range(i, STATES):
            value = row[j] + added[j] * factor
            row[j] = value
            p[j][i] = value


@inlined
def joseph(
    x: Any, p: Any, n: int, ph: Any, gain: Any, first: int, h: Vector, measured: float,
    variance: float,
) -> float:  # fmt: skip
    """Take one measured number, h . x[first : first + 3] plus noise; return innovation / sigma.

    x, p : state (n,) and its covariance (n, n); ph, gain : (n,) scratch

        K = P h' / s,   s = h P h' + r,   x + K (z - h x),   (I - K h) P (I - K h)' + K r K'

    Of a variance more than 1e16 times the measured one, rounding leaves P with no digit that is
    right, and a diagonal or the spread may be negative; the updates that follow put that right.
    """
    a, b, c = p[first], p[first + 1], p[first + 2]  # P is symmetric: rows are faster than columns
    for i in range(n):
        ph[i] = h[0] * a[i] + h[1] * b[i] + h[2] * c[i]
    spread = variance + h[0] * ph[first] + h[1] * ph[first + 1] + h[2] * ph[first + 2]
    innovation = measured - (h[0] * x[first] + h[1] * x[first + 1] + h[2] * x[first + 2])
    for i in range(n):
        gain[i] = ph[i] / spread
        x[i] += gain[i] * innovation
    share = spread - variance  # h P h'
    for j in range(n):
        row, gain_j, ph_j = p[j], gain[j], ph[j]
        for i in range(j + 1):
            gain_i = gain[i]
            rest, noise = ph[i] - gain_i * share, gain_i * variance  # of (I - K h) P h'; K r
            value = row[i] - gain_i * ph_j - rest * gain_j + noise * gain_j
            row[i] = value
            p[i][j] = value
    return innovation / sqrt(abs(spread))


@step_kernel
def update(m: Any, first: int, h: Vector, measured: float, variance: float) -> float:
    """Take one measured number of position or velocity; see `joseph`."""
    return joseph(m.x, m.p, STATES, m.ph, m.gain, first, h, measured, variance)


@inlined
def _shared(p: Any, a: Vector, b: Vector) -> float:
    """Return a' P b of a covariance P (3, 3)."""
    return (
        a[0] * (p[0][0] * b[0] + p[0][1] * b[1] + p[0][2] * b[2])
        + a[1] * (p[1][0] * b[0] + p[1][1] * b[1] + p[1][2] * b[2])
        + a[2] * (p[2][0] * b[0] + p[2][1] * b[1] + p[2][2] * b[2])
    )


@inlined
def _widened(heading: Any, a: Vector, b: Vector, distance: float) -> tuple[float, float]:
    """Return variances [m^2] along a and b that are sure to cover those of an attitude.

    a, b : (3,) at right angles to each other and to the line of sight, target LVLH

    An angle about one moves the point along the other. Independent errors as large as the diagonal
    and the correlation together are never less than correlated ones.
    """
    q, p = heading.attitude, heading.covariance
    a, b = turn_back(a, q), turn_back(b, q)
    shared, square = abs(_shared(p, a, b)), distance * distance
    along_a, along_b = _shared(p, b, b) + shared, _shared(p, a, a) + shared
    return square * along_a, square * along_b


@step_kernel
def _take(i: int, taken: Any, s: Any, heading: Any, m: Any) -> int:
    """Take the numbers of a measurement of sensor i, and return how many; fill its tests."""
    px, py, pz = 0.0, 0.0, 0.0
    if s.at_port:
        px, py, pz = heading.port[0], heading.port[1], heading.port[2]
    distance, ux, uy, uz = sight(m.x[0] - px, m.x[1] - py, m.x[2] - pz)
    first, second = across(ux, uy, uz)
    wide = (0.0, 0.0)
    if s.rotates:
        wide = _widened(heading, first, second, distance)
    mx, my, mz = taken.position[0], taken.position[1], taken.position[2]
    if not s.has_range:  # a direction: the point at the distance that is expected
        mx, my, mz = px + distance * mx, py + distance * my, pz + distance * mz
    numbers, nis, innovations = 0, 0.0, m.innovations[i]
    cross = larger(s.noise_floor, s.cross_share * distance)
    for k in range(0 if s.has_range else 1, 3):
        sigma = cross if k else larger(s.noise_floor, s.noise_share * distance)
        h = (ux, uy, uz) if k == 0 else first if k == 1 else second
        value = h[0] * mx + h[1] * my + h[2] * mz
        variance = sigma * sigma
        if s.rotates and k:
            variance += wide[k - 1]
        innovation = update(m, POSITION, h, value, variance)
        innovations[numbers] = innovation
        nis += innovation * innovation
        numbers += 1
    if s.has_velocity:
        sigma = larger(s.velocity_floor, s.velocity_share * distance)
        v = taken.velocity
        for k in range(3):
            h = (1.0 if k == 0 else 0.0, 1.0 if k == 1 else 0.0, 1.0 if k == 2 else 0.0)
            value = h[0] * v[0] + h[1] * v[1] + h[2] * v[2]
            innovation = update(m, VELOCITY, h, value, sigma * sigma)
            innovations[numbers] = innovation
            nis += innovation * innovation
            numbers += 1
    m.tested[i], m.nis[i] = numbers, nis
    return numbers


@step_kernel
def _accept(i: int, taken: Any, s: Any, p: Any, m: Any) -> bool:
    """Take a measurement unless its NIS is too large; return whether it was taken."""
    copy_state(m.x, m.kept_x)
    copy_covariance(m.p, m.kept_p)
    heading = m.headings[taken.tick % len(m.headings)]
    gate = p.gates[_take(i, taken, s, heading, m)]
    if gate <= 0.0 or m.nis[i] <= gate:
        return True
    copy_state(m.kept_x, m.x)
    copy_covariance(m.kept_p, m.p)
    return False


@step_kernel
def is_lost(tick: int, now: int, accepted: bool, patience: int, counts: Any) -> bool:
    """Count a measurement; return whether too many in a row were rejected: the filter restarts.

    tick, now : of the measurement; the newest one
    """
    if accepted:
        counts.accepted += 1
        counts.rejected_in_a_row = 0
        counts.last_accepted = tick
        return False
    counts.rejected += 1
    counts.rejected_in_a_row += 1
    lost = 0 < patience <= counts.rejected_in_a_row
    if lost:
        counts.rejected_in_a_row = 0
        counts.restarts += 1
        counts.last_restart = now
    return lost


@step_kernel
def _restart(taken: Any, s: Any, p: Any, m: Any) -> None:
    """Begin again with what was measured: P is large again, the disturbance is zero."""
    copy_covariance(p.spread_again, m.p)
    for j in range(3):
        m.x[6 + j] = 0.0
        if s.has_range:
            m.x[j] = taken.position[j]
        if s.has_velocity:
            m.x[3 + j] = taken.velocity[j]


@step_kernel
def _advance(tick: int, p: Any, m: Any, last: bool, covariance: bool) -> None:
    """Move the state to a tick, and take what was measured at that tick.

    last : whether all measurements of the tick have come; they are counted then, and only then
    covariance : whether it moves too; otherwise nothing may be measured at the tick
    """
    slots = len(m.commands)
    if tick > m.origin:
        c = m.commands[(tick - 1 - p.delay) % slots]
        step_state(m.x, p.states, c, p.step)
        if covariance:
            louder = 1.0 + p.gust * (c[0] * c[0] + c[1] * c[1] + c[2] * c[2])
            step_covariance(m.p, p.step, p.process_noise, louder)
    for i in range(len(p.sensors)):
        taken, s = m.arrived[i].line[tick % slots], p.sensors[i]
        if taken.tick != tick:
            continue
        accepted = _accept(i, taken, s, p, m)
        if last and is_lost(tick, m.now, accepted, p.patience, m.counts):
            _restart(taken, s, p, m)


@step_kernel
def _settle(tick: int, p: Any, m: Any) -> None:
    """Settle the newest tick of which no more measurements will come."""
    if tick - p.latency > m.settled:
        m.settled += 1
        _advance(m.settled, p, m, True, True)


@step_kernel
def _receive(tick: int, i: int, u: Any, s: Any, m: Any) -> None:
    """Keep the measurement of sensor i that arrives at a tick, in target LVLH."""
    first, slots, due = 3 + MESSAGE * i, len(m.commands), tick - s.latency
    if not u[first + 6] >= 0.0 or due < m.origin:
        return
    taken, heading = m.arrived[i].line[due % slots], m.headings[due % slots]
    taken.tick = due
    x, y, z = u[first], u[first + 1], u[first + 2]
    if s.rotates:
        x, y, z = turn((x, y, z), heading.attitude)
    if s.at_port and s.has_range:
        x, y, z = x + heading.port[0], y + heading.port[1], z + heading.port[2]
    taken.position[0], taken.position[1], taken.position[2] = x, y, z
    for j in range(3):
        taken.velocity[j] = u[first + 3 + j]


@step_kernel
def _keep(tick: int, u: Any, p: Any, m: Any) -> None:
    """Keep the command of the tick before, and what arrives at this one."""
    slots, attitude = len(m.commands), 3 + MESSAGE * len(p.sensors)
    for t in range(m.now + 1, tick + 1):  # of missing ticks, the command is held
        command, heading = m.commands[(t - 1) % slots], m.headings[t % slots]
        for j in range(3):
            command[j] = saturate(u[j], p.limit_n)
        for i in range(len(p.sensors)):
            m.arrived[i].line[t % slots].tick = -1
        if p.attitude != NONE:
            for j in range(4):
                heading.attitude[j] = u[attitude + j]
        if p.attitude == ESTIMATED:
            for j in range(9):
                heading.covariance[j // 3][j % 3] = u[attitude + 7 + j]
        if p.at_port:
            for j in range(3):
                heading.port[j] = p.port.positions[tick - p.port.first][j]
        m.now = t
        if t < tick:
            _settle(t, p, m)
    for i in range(len(p.sensors)):
        _receive(tick, i, u, p.sensors[i], m)


@step_kernel
def _begin(tick: int, p: Any, m: Any) -> None:
    """Begin with the start at a tick."""
    copy_state(p.start, m.settled_x)
    copy_covariance(p.spread, m.settled_p)
    m.now = m.settled = tick - 1
    m.origin = m.counts.last_accepted = tick
    m.counts.rejected_in_a_row = m.counts.accepted = m.counts.rejected = m.counts.restarts = 0
    m.counts.last_restart, m.whole = -1, 1
    for k in range(len(m.commands)):
        for j in range(3):
            m.commands[k][j] = 0.0
        for i in range(len(p.sensors)):
            m.arrived[i].line[k].tick = -1


@step_kernel
def estimate(tick: int, u: Any, p: Any, m: Any, y: Any) -> int:
    """Take a tick: the estimate follows from commands and measurements.

        x_(k+1) = Phi x_k + Gamma (f + d),   P_(k+1) = F P F' + Q,   then `joseph` by number

    u : command of the tick before (3,) [N]; message (24,) of each sensor that arrived at this tick;
        where a sensor rotates with the chaser its attitude (7,), and where that is estimated its
        covariance (9,) [rad^2]
    y : state (6,) [m, m/s], covariances of position [m^2] and velocity [m^2/s^2], (3, 3) each; the
        disturbance (3,) [N] where it is estimated; all in target LVLH

    Measurements come late. The settled tick is the newest one whose measurements have all come;
    from there to this tick the motion, and what has come already, are computed anew. So each
    measurement is taken at the tick it belongs to.
    """
    if p.at_port and not 0 <= tick - p.port.first < len(p.port.positions):
        return ASK
    if m.origin < 0:
        _begin(tick, p, m)
    for i in range(len(p.sensors)):
        m.tested[i] = 0
    late = p.latency > 0
    if late or m.now < m.origin:  # else the newest tick is the one that is settled
        copy_state(m.settled_x, m.x)
        if m.whole:
            copy_covariance(m.settled_p, m.p)
    _keep(tick, u, p, m)
    _settle(tick, p, m)
    if late:
        _look_ahead(tick, p, m)
    wrong = False
    for i in range(STATES):
        row, rest = m.p[i], m.x[i] - m.x[i]
        for j in range(i, STATES):
            rest += row[j] - row[j]
        wrong = wrong or rest != 0.0  # 0, or not a number
    if wrong:
        _begin_again(tick, p, m)
    for i in range(6):
        y[i] = m.x[i]
    for i in range(3):
        for j in range(3):
            y[6 + 3 * i + j], y[15 + 3 * i + j] = m.p[i][j], m.p[3 + i][3 + j]
        if p.states == STATES:
            y[24 + i] = m.x[6 + i]
    return 0


@step_kernel
def _look_ahead(tick: int, p: Any, m: Any) -> None:
    """Keep the settled tick, and move on to the newest one with what has come already."""
    covariance = p.covariance != 0
    for t in range(m.settled + 1, tick + 1):
        for i in range(len(p.sensors)):
            covariance = covariance or m.arrived[i].line[t % len(m.commands)].tick == t
    m.whole = 1 if covariance else 0
    copy_state(m.x, m.settled_x)
    if covariance:
        copy_covariance(m.p, m.settled_p)
    for t in range(m.settled + 1, tick + 1):
        _advance(t, p, m, False, covariance)


@step_kernel
def _begin_again(tick: int, p: Any, m: Any) -> None:
    """Restart from the start: the numbers ran out of range."""
    restarts = m.counts.restarts
    _begin(tick + 1, p, m)
    m.counts.restarts, m.counts.last_restart = restarts + 1, tick
    copy_covariance(p.spread_again, m.settled_p)
    copy_state(m.settled_x, m.x)
    copy_covariance(m.settled_p, m.p)


_START = 255
"""Stream of the random numbers of the start."""

_above = partial(real, above=0.0, most=1e6)
_least = partial(real, least=0.0, most=1e6)


@dataclass(frozen=True)
class Estimator(Checked):
    """A Kalman filter; it assumes the noise of the sensors that the scenario has.

    position_sigma_m, velocity_sigma_m_s : each axis, of the state at the start: the filter begins
        with the start of the scenario plus an error of that size, drawn with the sensors' key
    acceleration_noise_m_s1_5 : root of the spectral density of what is not modelled, each axis
    noise_scale : sigma of the sensors as the filter takes it, over that of the scenario
    disturbance_sigma_n : of a constant disturbance force at the start, each axis; 0: the filter has
        no such state
    disturbance_walk_n_s0_5 : how the disturbance changes, per root of a second
    compensate : whether the controller subtracts the disturbance that is estimated from its command
    gate_sigmas : a measurement is rejected beyond the chi-square quantile of so many sigmas of a
        normal number; 0: none is
    restart_after : so many rejected measurements in a row restart the filter; 0: none do
    restart_velocity_sigma_m_s : each axis, after a restart
    mass_kg : of the chaser as the filter takes it; 0: as the scenario has it
    delay_ticks : from a command to its force as the filter takes it; -1: as the scenario has it
    thrust_noise_s0_5 : root of the spectral density of the thrust's error, as a share of the
        command, each axis
    """

    position_sigma_m: Annotated[float, partial(_above, unit='m')] = 1.0
    velocity_sigma_m_s: Annotated[float, partial(_above, unit='m/s')] = 0.01
    acceleration_noise_m_s1_5: Annotated[float, partial(_least, unit='m/s^1.5')] = 1e-5
    noise_scale: Annotated[float, partial(real, least=1e-3, most=1e3)] = 1.0
    disturbance_sigma_n: Annotated[float, partial(_least, unit='N')] = 0.0
    disturbance_walk_n_s0_5: Annotated[float, partial(_least, unit='N/s^0.5')] = 0.0
    gate_sigmas: Annotated[float, partial(real, least=0.0, most=100.0)] = 5.0
    restart_after: Annotated[int, partial(whole, least=0, most=1_000_000)] = 20
    restart_velocity_sigma_m_s: Annotated[float, partial(_above, unit='m/s')] = 1.0
    mass_kg: Annotated[float, partial(_least, unit='kg')] = unless_default(0.0)
    delay_ticks: Annotated[int, partial(whole, least=-1, most=1000)] = unless_default(-1)
    compensate: Annotated[bool, flag] = unless_default(False)
    thrust_noise_s0_5: Annotated[float, partial(_least, unit='s^0.5')] = unless_default(0.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.thrust_noise_s0_5 > 0.0 and self.acceleration_noise_m_s1_5 == 0.0:
            raise InputError('`acceleration_noise_m_s1_5` must be > 0 with `thrust_noise_s0_5`')
        if self.disturbance_walk_n_s0_5 > 0.0 and self.disturbance_sigma_n == 0.0:
            raise InputError('`disturbance_sigma_n` must be > 0 N where the disturbance walks')
        if self.compensate and self.disturbance_sigma_n == 0.0:
            raise InputError(
                '`disturbance_sigma_n` must be > 0 N to `compensate` the disturbance; got 0'
            )

    @property
    def states(self) -> int:
        """6 states, or 9 with a disturbance."""
        return 9 if self.disturbance_sigma_n > 0.0 else 6


def gate(numbers: int, sigmas: float) -> float:
    """Return the chi-square quantile of so many numbers; 0 for none.

    By Wilson and Hilferty, "The distribution of chi-square", 1931: right to 12 % up to 5 sigmas,
    and made of + - * / sqrt.
    """
    if sigmas == 0.0 or numbers == 0:
        return 0.0
    share = 2.0 / (9.0 * numbers)
    root = 1.0 - share + sigmas * sqrt(share)
    return numbers * root * root * root


def filter_of(settings: Estimator, sensors: Sensors, scenario: Any) -> Filter:
    """Return the settings of a scenario's filter."""
    rows, louder = [unit.row(scenario) for unit in sensors.units], settings.noise_scale
    for row in rows:
        for name in _NOISES:
            setattr(row, name, getattr(row, name) * louder)
    first, second = (three_normals(0, i, _START, *sensors.noise_key) for i in range(2))
    sigmas = [settings.position_sigma_m] * 3 + [settings.velocity_sigma_m_s] * 3
    draws = zip(scenario.start, sigmas, (*first, *second), strict=True)
    disturbed = [settings.disturbance_sigma_n] * 3
    again = [settings.position_sigma_m] * 3 + [settings.restart_velocity_sigma_m_s] * 3
    mass_kg = settings.mass_kg or scenario.mass_kg
    step = cw.discretise(scenario.mean_motion_rad_s, mass_kg, scenario.dt_s)
    delay_ticks = int(getattr(scenario.thrusters, 'delay_ticks', 0))
    gust, attitude = settings.thrust_noise_s0_5, NONE
    if gust > 0.0:
        gust /= settings.acceleration_noise_m_s1_5 * mass_kg
    if sensors.turn:
        attitude = TRUE if scenario.named('attitude_estimator') is None else ESTIMATED
    return Filter(
        states=settings.states,
        limit_n=scenario.max_force_n,
        delay=delay_ticks if settings.delay_ticks < 0 else settings.delay_ticks,
        patience=settings.restart_after,
        latency=max(unit.latency_ticks for unit in sensors.units),
        covariance=1,
        attitude=attitude,
        at_port=int(sensors.look),
        gust=gust * gust,
        step=step,
        gates=[gate(numbers, settings.gate_sigmas) for numbers in range(7)],
        start=[value + sigma * draw for value, sigma, draw in draws] + [0.0] * 3,
        process_noise=_process_noise(settings, step, mass_kg, scenario.dt_s).tolist(),
        spread=np.diag(np.square([*sigmas, *disturbed])).tolist(),
        spread_again=np.diag(np.square([*again, *disturbed])).tolist(),
        sensors=rows,
        port=PortBlock(),
    )


_NOISES = ('noise_floor', 'noise_share', 'cross_share', 'velocity_floor', 'velocity_share')


def _process_noise(settings: Estimator, step: CwStep, mass_kg: float, dt_s: float) -> Floats:
    """Return Q (9, 9): white acceleration, held for a tick; the walk of the disturbance."""
    density, walk = settings.acceleration_noise_m_s1_5 * mass_kg, settings.disturbance_walk_n_s0_5
    unit = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    columns = [cw_step((0.0,) * 6, force, step) for force in unit]
    noise = np.diag([0.0] * 6 + [walk * walk * dt_s] * 3)
    noise[:6, :6] = density * density / dt_s * sum(np.outer(column, column) for column in columns)
    return noise


def memory_of(p: Filter) -> FilterMemory:
    """Return the memory of a filter that has not begun."""
    slots = p.latency + p.delay + 2
    lines = ([Measurement() for _ in range(slots)] for _ in p.sensors)
    headings = [Heading() for _ in range(slots)]
    return FilterMemory(zeros(slots, 3), [Arrived(line) for line in lines], headings)


class EstimatorStage(KernelStage):
    """From measurements and the command before to the estimated state and its covariance."""

    name = 'estimator'
    memory_ticks = None
    outputs: tuple[str, ...] = (interfaces.NAVIGATION_STATE, interfaces.NAVIGATION_COVARIANCE)
    kernel = estimate

    def __init__(self, settings: Estimator, scenario: Any) -> None:
        sensors = scenario.named('sensors')
        self.inputs = (PREVIOUS_COMMAND, *sensors.signals)
        self._silent_ticks = 10 * max(unit.period_ticks for unit in sensors.units)
        self._states, self._sensors = settings.states, len(sensors.units)
        self._port = PortMotion(sensors, scenario, known=True)
        p = filter_of(settings, sensors, scenario)
        if p.attitude != NONE:
            covariance = [interfaces.ATTITUDE_COVARIANCE] * (p.attitude == ESTIMATED)
            self.inputs += (ATTITUDE, *covariance)
        if self._states == STATES:
            self.outputs = (*self.outputs, interfaces.ESTIMATED_DISTURBANCE)
        super().__init__(p, memory_of(p))

    def answer(self, tick: int, u: Sequence[float]) -> None:
        """Compute where the port is."""
        self._port.write(self.p, tick - tick % PORT_TICKS, PORT_TICKS)

    def answer_ahead(self, ticks: int, u: Sequence[float]) -> None:
        """Compute where the port is in a flight."""
        if self.p.at_port:
            self._port.write(self.p, 0, ticks + 1)

    def take_unread(self, signals: Collection[str]) -> None:
        """Leave the covariance of the newest tick out where nobody reads it."""
        self.p.covariance = int(interfaces.NAVIGATION_COVARIANCE not in signals)

    def passes_on(self) -> tuple[int | Signal, ...]:
        """Return that the state is what the first sensor measured; all else is zero."""
        return (1, (), ())[: len(self.outputs)]

    def trouble(self) -> str:
        """Return what is wrong, for /diagnostics; '' if nothing is."""
        return trouble_of('estimator', self.m, self._silent_ticks, 'no measurement was taken')

    @property
    def covariance(self) -> Floats:
        """Whole covariance (n, n) of the newest estimate; SI units."""
        n = self._states
        return np.array(self.m.p)[:n, :n]

    @property
    def innovations(self) -> list[list[float]]:
        """Per sensor, innovations over sigma of what was measured newly; empty if nothing was."""
        rows = zip(self.m.innovations, self.m.tested, strict=True)
        return [list(map(float, row[:count])) for row, count in rows][: self._sensors]

    @property
    def rejected(self) -> int:
        """How many measurements were rejected."""
        return int(self.m.counts.rejected)

    @property
    def restarts(self) -> int:
        """How often it was restarted."""
        return int(self.m.counts.restarts)


def trouble_of(title: str, m: Any, silent_ticks: int, silence: str) -> str:
    """Return what is wrong with a filter by the counts of its memory; '' if nothing is.

    silence : what it says of more than so many ticks without a measurement
    """
    counts = m.counts
    if counts.restarts > 0:
        return (
            f'the {title} diverged: it was restarted {counts.restarts} times, the last time at '
            f'tick {counts.last_restart}'
        )
    silent = m.settled - counts.last_accepted
    if m.now >= 0 and silent > silent_ticks:
        return f'the {title} is coasting: {silence} for {silent} ticks'
    return ''


def _check(_settings: Estimator, scenario: Any) -> None:
    """Raise InputError if another stage makes the navigation state."""
    if scenario.named('navigation') is not None:
        raise InputError('`estimator` must be alone: `navigation` makes a navigation state too')


register(
    Section(
        'estimator',
        Estimator,
        Place.ESTIMATOR,
        EstimatorStage,
        _check,
        needs=('sensors', 'something to measure'),
    )
)
