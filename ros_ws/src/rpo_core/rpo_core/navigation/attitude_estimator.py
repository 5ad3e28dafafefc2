# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The attitude filter: star tracker and gyro to attitude, rate, bias. Section `attitude_estimator`.

A multiplicative extended Kalman filter. Its state is a quaternion from the chaser's axes to target
LVLH and the bias of the gyro [rad/s]; its error has six numbers, twice the vector part of the
quaternion from the estimated to the true axes [rad], and true less estimated bias. The gyro drives
it, so no torque is modelled. Source: Lefferts, Markley and Shuster, "Kalman filtering for
spacecraft attitude estimation", 1982; Markley and Crassidis, "Fundamentals of Spacecraft Attitude
Determination and Control", 2014, 6.2.

A tick is turned through at the mean of the rates measured at its ends, which a constant torque
makes exact but for 1e-3 (rate x tick)^2.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from math import radians, sqrt
from typing import Annotated, Any

import numpy as np

from rpo_core.attitude.chaser import times, turn_back, upright
from rpo_core.files.codec import unless_default
from rpo_core.files.validation import Checked, real, vector3, whole
from rpo_core.kernels.arithmetic import Vector, saturate, sin_cos
from rpo_core.kernels.arrays import Floats
from rpo_core.kernels.jit import inlined, step_kernel
from rpo_core.navigation.attitude_sensors import (
    ARCSEC,
    START_STREAM,
    AttitudeSensors,
    angles_between,
    turned_by,
)
from rpo_core.navigation.estimator import (
    Counts,
    copy_covariance,
    copy_state,
    gate,
    is_lost,
    joseph,
    trouble_of,
    zeros,
)
from rpo_core.navigation.sensors import three_normals
from rpo_core.stage import KernelStage, Place, Section, Signal, register
from rpo_core.wire import interfaces

STATES = 6

MAX_RATE_RAD_S = 1e3
"""Faster rates are taken for this one, and what is no number for zero."""


@dataclass(slots=True)
class AttitudeFilter:
    """Settings of the kernel `estimate_attitude`.

    orbit_sine, orbit_cosine : of half the angle by which LVLH turns in a tick; dt : its length [s]
    turn_noise, shared_noise, bias_noise : variances that a tick adds to an angle, to an angle and
        the bias about it, to the bias
    gate : largest NIS of a measurement; 0: none
    patience : so many rejected ones in a row restart the filter; 0: none do
    latency : of the star tracker [ticks]; axes : (3, 3) in those of the chaser; variances : about
        them [rad^2]
    start : quaternion and bias [rad/s] at the start
    angle_variance, bias_variance : at the start and after a restart
    """

    orbit_sine: float
    orbit_cosine: float
    dt: float
    turn_noise: float
    shared_noise: float
    bias_noise: float
    gate: float
    patience: int
    latency: int
    axes: Annotated[list[list[float]], 3, 3]
    variances: Annotated[list[float], 3]
    start: Annotated[list[float], 7]
    angle_variance: float
    bias_variance: float


@dataclass(slots=True)
class AttitudeRecord:
    """What was measured at a tick: rate of the gyro [rad/s]; attitude, where has_star is 1."""

    rate: Annotated[list[float], 3] = field(default_factory=lambda: [0.0] * 3)
    star: Annotated[list[float], 4] = field(default_factory=lambda: [0.0] * 4)
    has_star: int = 0


@dataclass(slots=True)
class AttitudeFilterMemory:
    """Memory of the kernel `estimate_attitude`.

    now, origin : the newest tick, and the first one; -1: it has not begun
    settled : tick up to which all measurements have come
    x, p : quaternion and bias (7,), and covariance, of the newest tick; of the settled one; before
        a measurement
    error, ph, gain : scratch
    tested, nis, innovations : of the newest measurement, how many numbers were tested (0: none
        came), the sum of their squares, and each innovation over its sigma
    line : of the newest ticks, that of tick k at place k % len(line)
    newest : attitude given last
    """

    line: list[AttitudeRecord]
    newest: Annotated[list[float], 4]
    now: int = -1
    origin: int = -1
    settled: int = -1
    counts: Counts = field(default_factory=Counts)
    x: Annotated[list[float], 7] = field(default_factory=lambda: [0.0] * 7)
    p: Annotated[list[list[float]], 6, 6] = field(default_factory=partial(zeros, 6, 6))
    settled_x: Annotated[list[float], 7] = field(default_factory=lambda: [0.0] * 7)
    settled_p: Annotated[list[list[float]], 6, 6] = field(default_factory=partial(zeros, 6, 6))
    kept_p: Annotated[list[list[float]], 6, 6] = field(default_factory=partial(zeros, 6, 6))
    error: Annotated[list[float], 6] = field(default_factory=lambda: [0.0] * 6)
    ph: Annotated[list[float], 6] = field(default_factory=lambda: [0.0] * 6)
    gain: Annotated[list[float], 6] = field(default_factory=lambda: [0.0] * 6)
    tested: Annotated[list[int], 1] = field(default_factory=lambda: [0])
    nis: Annotated[list[float], 1] = field(default_factory=lambda: [0.0])
    innovations: Annotated[list[list[float]], 1, 3] = field(default_factory=partial(zeros, 1, 3))


@step_kernel
def copy_estimate(x: Any, p: Any, to_x: Any, to_p: Any) -> None:
    """Copy a state (7,) and its covariance (6, 6)."""
    copy_state(x, to_x)
    copy_covariance(p, to_p)


@inlined
def _moved(e: Vector, b: Vector, turned: tuple[float, float, float, float], half: float) -> Vector:
    """Return angles e (3,) of an error one tick later: the bias b (3,) turns them too."""
    x, y, z = half * b[0], half * b[1], half * b[2]
    r, s, t = turn_back((e[0] - x, e[1] - y, e[2] - z), turned)
    return r - x, s - y, t - z


@step_kernel
def step_attitude(x: Any, p: Any, rate: Vector, f: Any) -> None:
    """Move state (7,) and covariance (6, 6) by one tick at a rate (3,) of the gyro [rad/s].

    f : settings, `AttitudeFilter`
    """
    dt = f.dt
    wx, wy, wz = rate[0] - x[4], rate[1] - x[5], rate[2] - x[6]
    size = sqrt(wx * wx + wy * wy + wz * wz)
    sine, cosine = sin_cos(0.5 * dt * size)
    share = sine / size if size > 0.0 else 0.5 * dt
    turned = (share * wx, share * wy, share * wz, cosine)
    orbit = (0.0, 0.0, -f.orbit_sine, f.orbit_cosine)
    q = upright(times(times(orbit, (x[0], x[1], x[2], x[3])), turned))
    for i in range(4):
        x[i] = q[i]
    r0, r1, r2, r3, r4, r5 = p[0], p[1], p[2], p[3], p[4], p[5]
    for j in range(STATES):
        angles, bias = (r0[j], r1[j], r2[j]), (r3[j], r4[j], r5[j])
        r0[j], r1[j], r2[j] = _moved(angles, bias, turned, 0.5 * dt)
    for i in range(3):  # a bias stays: so do the rows of it
        row = p[i]
        angles, bias = (row[0], row[1], row[2]), (row[3], row[4], row[5])
        row[0], row[1], row[2] = _moved(angles, bias, turned, 0.5 * dt)
        for j in range(i + 1):
            p[j][i] = row[j]
        row[i] += f.turn_noise
        row[3 + i] += f.shared_noise
        p[3 + i][3 + i] += f.bias_noise
        for j in range(3, STATES):
            p[j][i] = row[j]


@step_kernel
def _accept(star: Any, f: Any, m: Any) -> bool:
    """Take a quaternion (4,) of the star tracker unless its NIS is too large."""
    copy_covariance(m.p, m.kept_p)
    for j in range(STATES):
        m.error[j] = 0.0
    q = (m.x[0], m.x[1], m.x[2], m.x[3])
    x, y, z = angles_between(star, q)
    nis, innovations = 0.0, m.innovations[0]
    for i in range(3):
        axis = f.axes[i]
        h = (axis[0], axis[1], axis[2])
        angle = h[0] * x + h[1] * y + h[2] * z
        innovation = joseph(m.error, m.p, STATES, m.ph, m.gain, 0, h, angle, f.variances[i])
        innovations[i] = innovation
        nis += innovation * innovation
    m.tested[0], m.nis[0] = 3, nis
    if f.gate > 0.0 and nis > f.gate:
        copy_covariance(m.kept_p, m.p)
        return False
    turned = turned_by(q, (m.error[0], m.error[1], m.error[2]))
    for i in range(4):
        m.x[i] = turned[i]
    for i in range(3):
        m.x[4 + i] += m.error[3 + i]
    return True


@step_kernel
def _spread(p: Any, f: Any) -> None:
    """Give a covariance the variances of the start."""
    for i in range(STATES):
        for j in range(STATES):
            p[i][j] = 0.0
        p[i][i] = f.angle_variance if i < 3 else f.bias_variance


@step_kernel
def _advance(tick: int, p: Any, m: Any) -> None:
    """Move the state to a tick, and take what the star tracker measured at it."""
    slots = len(m.line)
    new = m.line[tick % slots]
    if tick > m.origin:
        old, a = m.line[(tick - 1) % slots].rate, new.rate
        rate = (0.5 * (old[0] + a[0]), 0.5 * (old[1] + a[1]), 0.5 * (old[2] + a[2]))
        step_attitude(m.x, m.p, rate, p)
    if not new.has_star:
        return
    if is_lost(tick, tick, _accept(new.star, p, m), p.patience, m.counts):
        for j in range(4):
            m.x[j] = new.star[j]
        for j in range(4, 7):
            m.x[j] = p.start[j]
        _spread(m.p, p)


@step_kernel
def _settle(tick: int, p: Any, m: Any) -> None:
    """Settle the newest tick of which no more measurements will come."""
    late = p.latency > 0  # else the newest tick is the one that is settled
    if tick - p.latency > m.settled:
        if late:
            copy_estimate(m.settled_x, m.settled_p, m.x, m.p)
        m.settled += 1
        _advance(m.settled, p, m)
        if late:
            copy_estimate(m.x, m.p, m.settled_x, m.settled_p)


@step_kernel
def _begin(tick: int, p: Any, m: Any) -> None:
    """Begin with the start at a tick."""
    for i in range(7):
        m.x[i] = p.start[i]
    _spread(m.p, p)
    copy_estimate(m.x, m.p, m.settled_x, m.settled_p)
    m.now = m.settled = tick - 1
    m.origin = m.counts.last_accepted = tick


@step_kernel
def _keep(tick: int, u: Any, p: Any, m: Any) -> None:
    """Keep what arrives at a tick; of ticks that are missing, the rate before is held."""
    slots = len(m.line)
    for t in range(m.now + 1, tick + 1):
        new, old = m.line[t % slots], m.line[(t - 1) % slots]
        for i in range(3):
            value = old.rate[i]
            if t == tick:
                value = u[4 + i]
                value = saturate(value if value - value == 0.0 else 0.0, MAX_RATE_RAD_S)
            new.rate[i] = value
        new.has_star = 0
        m.now = t
        if t < tick:
            _settle(t, p, m)
    due = tick - p.latency
    size = sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2] + u[3] * u[3])
    if due >= m.origin and 0.5 < size < 2.0:
        q, taken = upright((u[0], u[1], u[2], u[3])), m.line[due % slots]
        for i in range(4):
            taken.star[i] = q[i]
        taken.has_star = 1


@step_kernel
def estimate_attitude(tick: int, u: Any, p: Any, m: Any, y: Any) -> None:
    """Take a tick: the estimate follows from the gyro and the star tracker.

    u : quaternion (4,) of the star tracker, 0, 0, 0, 0 for none; rate (3,) of the gyro [rad/s]
    y : quaternion (4,); rate (3,) [rad/s], that of the gyro less its bias; covariance (3, 3) of the
        angles about the chaser's axes [rad^2]

    The star tracker may come late. The settled tick is the newest one of which it has come; from
    there to this tick the motion is computed anew.
    """
    if m.origin < 0:
        _begin(tick, p, m)
    m.tested[0] = 0
    _keep(tick, u, p, m)
    _settle(tick, p, m)
    if p.latency > 0:
        copy_estimate(m.settled_x, m.settled_p, m.x, m.p)
        for t in range(m.settled + 1, tick + 1):
            _advance(t, p, m)
    rate = m.line[tick % len(m.line)].rate
    for i in range(4):
        y[i] = m.newest[i] = m.x[i]
    for i in range(3):
        y[4 + i] = rate[i] - m.x[4 + i]
        for j in range(3):
            y[7 + 3 * i + j] = m.p[i][j]


_angle = partial(real, unit='deg', above=0.0, most=30.0)
_angles = partial(vector3, unit='deg', bound=90.0)


@dataclass(frozen=True, kw_only=True)
class AttitudeEstimator(Checked):
    """A multiplicative extended Kalman filter; it assumes the noise of the sensors.

    attitude_sigma_deg, bias_sigma_rad_s : each axis, of attitude and bias at the start: the filter
        begins with the attitude of the scenario turned by an error of that size, drawn with the
        sensors' key, and with no bias; the same after a restart
    noise_scale : sigma of the star tracker as the filter takes it, over that of the scenario
    gate_sigmas : a measurement is rejected beyond the chi-square quantile of so many sigmas of a
        normal number; 0: none is
    restart_after : so many rejected measurements in a row restart the filter; 0: none do
    start_error_deg : (3,) the start is turned by it too, the chaser's axes
    """

    attitude_sigma_deg: Annotated[float, _angle] = 0.1
    bias_sigma_rad_s: Annotated[float, partial(real, unit='rad/s', above=0.0, most=0.1)] = 5e-5
    noise_scale: Annotated[float, partial(real, least=1e-3, most=1e3)] = 1.0
    gate_sigmas: Annotated[float, partial(real, least=0.0, most=100.0)] = 5.0
    restart_after: Annotated[int, partial(whole, least=0, most=1_000_000)] = 20
    start_error_deg: Annotated[Vector, _angles] = unless_default((0.0, 0.0, 0.0))


def attitude_filter_of(
    settings: AttitudeEstimator, sensors: AttitudeSensors, scenario: Any
) -> AttitudeFilter:
    """Return the settings of the filter of a scenario."""
    dt_s, gyro, star = scenario.dt_s, sensors.gyro, sensors.star_tracker
    angle = radians(settings.attitude_sigma_deg)
    draws = three_normals(0, 0, START_STREAM, *sensors.noise_key)
    off = zip(settings.start_error_deg, draws, strict=True)
    x, y, z = (radians(error) + angle * draw for error, draw in off)
    start = scenario.attitude.start(scenario.mean_motion_rad_s)[:4]
    walk = gyro.bias_walk_rad_s1_5 * gyro.bias_walk_rad_s1_5 * dt_s
    noise = gyro.noise_rad_s0_5 * gyro.noise_rad_s0_5 * dt_s
    about, across = (
        (settings.noise_scale * arcsec * ARCSEC) ** 2
        for arcsec in (star.boresight_noise_arcsec, star.cross_noise_arcsec)
    )
    orbit_sine, orbit_cosine = sin_cos(0.5 * scenario.mean_motion_rad_s * dt_s)
    return AttitudeFilter(
        orbit_sine=orbit_sine,
        orbit_cosine=orbit_cosine,
        dt=dt_s,
        turn_noise=noise + 0.25 * walk * dt_s * dt_s,
        shared_noise=-0.5 * walk * dt_s,
        bias_noise=walk,
        gate=gate(3, settings.gate_sigmas),
        patience=settings.restart_after,
        latency=star.latency_ticks,
        axes=[list(axis) for axis in star.axes],
        variances=[about, across, across],
        start=[*turned_by(start, (x, y, z)), 0.0, 0.0, 0.0],
        angle_variance=angle * angle,
        bias_variance=settings.bias_sigma_rad_s * settings.bias_sigma_rad_s,
    )


class AttitudeEstimatorStage(KernelStage):
    """From star tracker and gyro to the estimated attitude and rate, and their covariance."""

    name = 'attitude_estimator'
    memory_ticks = None
    inputs = (interfaces.ATTITUDE_MEASUREMENT,)
    outputs = (interfaces.NAVIGATION_ATTITUDE, interfaces.ATTITUDE_COVARIANCE)
    kernel = estimate_attitude

    def __init__(self, settings: AttitudeEstimator, scenario: Any) -> None:
        sensors = scenario.named('attitude_sensors')
        self._silent_ticks = 10 * sensors.star_tracker.period_ticks
        start = scenario.attitude.start(scenario.mean_motion_rad_s)[:4]
        p = attitude_filter_of(settings, sensors, scenario)
        line = [AttitudeRecord() for _ in range(p.latency + 2)]
        super().__init__(p, AttitudeFilterMemory(line, list(start)))

    def trouble(self) -> str:
        """Return what is wrong, for /diagnostics; '' if nothing is."""
        return trouble_of('attitude estimator', self.m, self._silent_ticks, 'no star tracker')

    def passes_on(self) -> tuple[int | Signal, ...]:
        """Return that the attitude is what was measured; the covariance is zero."""
        return 0, ()

    def off(self, *inputs: Signal) -> tuple[Signal, ...]:
        """Return the measurement; of a star tracker that has none, the attitude given last."""
        measured, covariance = super().off(*inputs)
        if any(measured[:4]):
            for i in range(4):
                self.m.newest[i] = measured[i]
        return (*map(float, self.m.newest), *measured[4:]), covariance

    @property
    def covariance(self) -> Floats:
        """Covariance (6, 6) of the newest estimate: angles [rad], bias [rad/s]."""
        return np.array(self.m.p)


register(
    Section(
        'attitude_estimator',
        AttitudeEstimator,
        Place.ATTITUDE_ESTIMATOR,
        AttitudeEstimatorStage,
        needs=('attitude_sensors', 'something to measure'),
    )
)
