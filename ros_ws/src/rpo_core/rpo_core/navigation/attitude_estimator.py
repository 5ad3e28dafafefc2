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
makes exact but for 1e-3 (rate x tick)^2. A filter is two flat tables, f of its settings and m of
what it remembers.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from math import radians, sqrt
from typing import Annotated, Any

import numpy as np

from rpo_core.attitude.chaser import times, turn_back, upright
from rpo_core.files.codec import unless_default
from rpo_core.files.validation import Checked, real, vector3, whole
from rpo_core.kernels.arithmetic import Vector, saturate, sin_cos
from rpo_core.kernels.arrays import Floats
from rpo_core.kernels.jit import as_table, inlined, kernel
from rpo_core.navigation.attitude_sensors import (
    ARCSEC,
    MEASURED,
    START_STREAM,
    AttitudeSensors,
    angles_between,
    turned_by,
)
from rpo_core.navigation.estimator import FilterStage, gate, joseph
from rpo_core.navigation.sensors import three_normals
from rpo_core.stage import Place, Section, Signal, register
from rpo_core.wire import interfaces

STATES = 6
SQUARE = STATES * STATES
ESTIMATE = 7
BOTH = ESTIMATE + SQUARE

(
    ORBIT_SINE, ORBIT_COSINE, DT, TURN_NOISE, SHARED_NOISE, BIAS_NOISE, GATE, PATIENCE, LATENCY,
) = range(9)  # fmt: skip
AXES, VARIANCES, START, SPREAD = 9, 18, 21, 28
"""Places in a filter's settings: sine and cosine of half the angle by which LVLH turns in a tick,
its length [s]; variances that it adds to an angle, to an angle and the bias about it, to the bias;
largest NIS of a measurement (0: none); so many rejected ones in a row restart it (0: none do);
latency of the star tracker [ticks], its axes (3, 3) in those of the chaser, variances about them;
quaternion and bias (7,) at the start; variances of angle and bias at the start and after
a restart."""

NOW, BASE, ORIGIN, IN_A_ROW, RESETS, LAST_RESET, ACCEPTED, REJECTED, LAST_ACCEPTED = range(9)
RATE, X = 9, 12
P, SETTLED = X + ESTIMATE, X + BOTH
KEPT = SETTLED + BOTH
ERROR, WORK, TESTED = (KEPT + SQUARE + STATES * i for i in (0, 1, 3))
HISTORY, RECORD = TESTED + 5, 8
"""Places in what a filter remembers: counts; the newest rate (3,) less the bias; state and
covariance (7 + 36) of the newest tick, and of the tick up to which all measurements have come; a
covariance before a measurement; scratch. Of a measurement 5 numbers: how many were tested (0: none
came), the sum of their squares (NIS), each innovation over its sigma. Then of the newest ticks, 8
numbers each: rate of the gyro, quaternion of the star tracker, whether there is one."""

MOST_RATE_RAD_S = 1e3
"""Faster rates are taken for this one, and what is no number for zero."""


def scratch_of(f: Any) -> range:
    """Return the places of a memory that a tick writes before it reads them."""
    return range(KEPT if f[LATENCY] > 0.0 else SETTLED, TESTED)


@inlined
def _record(tick: int, f: Any) -> int:
    """Return the place of what was measured at a tick."""
    return HISTORY + RECORD * (tick % (int(f[LATENCY]) + 2))


@inlined
def _moved(m: Any, i: int, n: int, turned: tuple[float, float, float, float], half: float) -> None:
    """Move an error, a column (n = 6) or a row (n = 1) of P, by a tick: the bias turns it too."""
    j, k = i + n, i + 2 * n
    x, y, z = half * m[i + 3 * n], half * m[i + 4 * n], half * m[i + 5 * n]
    a, b, c = turn_back((m[i] - x, m[j] - y, m[k] - z), turned)
    m[i], m[j], m[k] = a - x, b - y, c - z


@kernel
def step_attitude(m: Any, rate: Vector, f: Any) -> None:
    """Move state and covariance by one tick at a rate (3,) of the gyro [rad/s]."""
    dt = f[DT]
    x, y, z = rate[0] - m[X + 4], rate[1] - m[X + 5], rate[2] - m[X + 6]
    size = sqrt(x * x + y * y + z * z)
    sine, cosine = sin_cos(0.5 * dt * size)
    share = sine / size if size > 0.0 else 0.5 * dt
    turned = (share * x, share * y, share * z, cosine)
    orbit = (0.0, 0.0, -f[ORBIT_SINE], f[ORBIT_COSINE])
    q = times(times(orbit, (m[X], m[X + 1], m[X + 2], m[X + 3])), turned)
    m[X], m[X + 1], m[X + 2], m[X + 3] = upright(q)
    for column in range(STATES):
        _moved(m, P + column, STATES, turned, 0.5 * dt)
    for row in range(3):  # a bias stays: so do the rows of it
        _moved(m, P + STATES * row, 1, turned, 0.5 * dt)
        for column in range(row + 1):
            m[P + STATES * column + row] = m[P + STATES * row + column]
        m[P + 7 * row] += f[TURN_NOISE]
        m[P + 7 * row + 3] += f[SHARED_NOISE]
        m[P + 7 * row + 21] += f[BIAS_NOISE]
        for column in range(3, STATES):
            m[P + STATES * column + row] = m[P + STATES * row + column]


@kernel
def _accept(m: Any, found: int, f: Any) -> bool:
    """Take the quaternion at a place of the memory unless its NIS is too large."""
    for j in range(SQUARE):
        m[KEPT + j] = m[P + j]
    for j in range(STATES):
        m[ERROR + j] = 0.0
    q = (m[X], m[X + 1], m[X + 2], m[X + 3])
    star = (m[found], m[found + 1], m[found + 2], m[found + 3])
    x, y, z = angles_between(star, q)
    m[TESTED + 1] = 0.0
    for i in range(3):
        h = (f[AXES + 3 * i], f[AXES + 3 * i + 1], f[AXES + 3 * i + 2])
        angle = h[0] * x + h[1] * y + h[2] * z
        m[TESTED + 2 + i] = joseph(m, ERROR, P, STATES, WORK, 0, h, angle, f[VARIANCES + i])
        m[TESTED + 1] += m[TESTED + 2 + i] * m[TESTED + 2 + i]
    m[TESTED] = 3.0
    if f[GATE] > 0.0 and m[TESTED + 1] > f[GATE]:
        for j in range(SQUARE):
            m[P + j] = m[KEPT + j]
        return False
    error = (m[ERROR], m[ERROR + 1], m[ERROR + 2])
    m[X], m[X + 1], m[X + 2], m[X + 3] = turned_by(q, error)
    for i in range(3):
        m[X + 4 + i] += m[ERROR + 3 + i]
    return True


@inlined
def _spread(m: Any, f: Any) -> None:
    """Give P the variances of the start."""
    for j in range(SQUARE):
        m[P + j] = 0.0
    for i in range(3):
        m[P + 7 * i], m[P + 7 * i + 21] = f[SPREAD], f[SPREAD + 1]


@kernel
def _advance(tick: int, f: Any, m: Any) -> None:
    """Move the state to a tick, and take what the star tracker measured at it."""
    found = _record(tick, f)
    if tick > m[ORIGIN]:
        old = _record(tick - 1, f)
        rate = (
            0.5 * (m[old] + m[found]),
            0.5 * (m[old + 1] + m[found + 1]),
            0.5 * (m[old + 2] + m[found + 2]),
        )
        step_attitude(m, rate, f)
    if m[found + 7] == 0.0:
        return
    if _accept(m, found + 3, f):
        m[ACCEPTED] += 1.0
        m[IN_A_ROW] = 0.0
        m[LAST_ACCEPTED] = tick
        return
    m[REJECTED] += 1.0
    m[IN_A_ROW] += 1.0
    if f[PATIENCE] > 0.0 and m[IN_A_ROW] >= f[PATIENCE]:
        for j in range(4):
            m[X + j] = m[found + 3 + j]
        for j in range(3):
            m[X + 4 + j] = f[START + 4 + j]
        _spread(m, f)
        m[IN_A_ROW] = 0.0
        m[RESETS] += 1.0
        m[LAST_RESET] = tick


@kernel
def _settle(tick: int, f: Any, m: Any) -> None:
    """Move the base to the newest tick of which no more measurements will come."""
    late = f[LATENCY] > 0.0  # else the newest tick is the one that is settled
    if tick - int(f[LATENCY]) > m[BASE]:
        for j in range(BOTH if late else 0):
            m[X + j] = m[SETTLED + j]
        m[BASE] += 1.0
        _advance(int(m[BASE]), f, m)
        for j in range(BOTH if late else 0):
            m[SETTLED + j] = m[X + j]


@kernel
def _begin(tick: int, f: Any, m: Any) -> None:
    """Begin with the start at a tick."""
    for j in range(HISTORY + RECORD * (int(f[LATENCY]) + 2)):
        m[j] = 0.0
    for j in range(ESTIMATE):
        m[X + j] = f[START + j]
    _spread(m, f)
    for j in range(BOTH):
        m[SETTLED + j] = m[X + j]
    m[NOW] = m[BASE] = tick - 1
    m[ORIGIN] = m[LAST_ACCEPTED] = tick
    m[LAST_RESET] = -1.0


@kernel
def estimate_attitude(tick: int, measured: Any, f: Any, m: Any) -> None:
    """Take a tick: fill the newest state and covariance of the memory, from place X, and RATE.

    measured : (7,) that arrived at this tick, see `attitude_sensors`; of ticks that are
    missing, the rate before is held

    The star tracker may come late. The base is moved to the newest tick of which it has come; from
    there to this tick the motion is computed anew.
    """
    if m[ORIGIN] < 0.0:
        _begin(tick, f, m)
    m[TESTED] = 0.0
    for t in range(int(m[NOW]) + 1, tick + 1):
        new, old = _record(t, f), _record(t - 1, f)
        for i in range(3):
            value = m[old + i]
            if t == tick:
                value = measured[4 + i]
                value = saturate(value if value - value == 0.0 else 0.0, MOST_RATE_RAD_S)
            m[new + i] = value
        m[new + 7] = 0.0
        m[NOW] = t
        if t < tick:
            _settle(t, f, m)
    taken = tick - int(f[LATENCY])
    x, y, z, w = measured[0], measured[1], measured[2], measured[3]
    size = sqrt(x * x + y * y + z * z + w * w)
    if taken >= m[ORIGIN] and 0.5 < size < 2.0:
        at = _record(taken, f)
        m[at + 3], m[at + 4], m[at + 5], m[at + 6] = upright((x, y, z, w))
        m[at + 7] = 1.0
    _settle(tick, f, m)
    if f[LATENCY] > 0.0:
        for j in range(BOTH):
            m[X + j] = m[SETTLED + j]
        for t in range(int(m[BASE]) + 1, tick + 1):
            _advance(t, f, m)
    newest = _record(tick, f)
    for i in range(3):
        m[RATE + i] = m[newest + i] - m[X + 4 + i]


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


def attitude_filter_of(settings: AttitudeEstimator, sensors: AttitudeSensors, scenario: Any) -> Any:
    """Return the settings of the filter of a scenario, table f of the kernels."""
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
    return as_table(
        [
            *sin_cos(0.5 * scenario.mean_motion_rad_s * dt_s),
            dt_s,
            noise + 0.25 * walk * dt_s * dt_s,
            -0.5 * walk * dt_s,
            walk,
            gate(3, settings.gate_sigmas),
            settings.restart_after,
            star.latency_ticks,
            *(part for axis in star.axes for part in axis),
            *(about, across, across),
            *turned_by(start, (x, y, z)),
            *(0.0, 0.0, 0.0),
            angle * angle,
            settings.bias_sigma_rad_s * settings.bias_sigma_rad_s,
        ]
    )


def attitude_memory_of(f: Any) -> Any:
    """Return the memory of a filter that has not begun, table m of the kernels."""
    slots = int(f[LATENCY]) + 2
    return as_table([-1.0] * RATE + [0.0] * (HISTORY - RATE + RECORD * slots))


class AttitudeEstimatorStage(FilterStage):
    """From star tracker and gyro to the estimated attitude and rate, and their covariance."""

    name = 'attitude_estimator'
    inputs = (interfaces.ATTITUDE_MEASUREMENT,)
    outputs = (interfaces.NAVIGATION_ATTITUDE, interfaces.ATTITUDE_COVARIANCE)
    title = 'attitude estimator'
    silence = 'no star tracker'

    def __init__(self, settings: AttitudeEstimator, scenario: Any) -> None:
        sensors = scenario.named('attitude_sensors')
        self.filter = attitude_filter_of(settings, sensors, scenario)
        self._silent_ticks = 10 * sensors.star_tracker.period_ticks
        self._measured = as_table([0.0] * MEASURED)
        self._start = tuple(scenario.attitude.start(scenario.mean_motion_rad_s)[:4])
        self.reset()

    def reset(self) -> None:
        """Begin with the start of the scenario."""
        self.memory, self._given = attitude_memory_of(self.filter), self._start

    def step(self, tick: int, *inputs: Any) -> tuple[Signal, ...]:
        """Return quaternion and rate (7,) [rad/s], and the covariance (9,) of the angles [rad^2].

        The covariance is about the chaser's axes, 3 x 3.
        """
        for i in range(MEASURED):
            self._measured[i] = inputs[0][i]
        estimate_attitude(tick, self._measured, self.filter, self.memory)
        m = list(map(float, self.memory[:P]))
        spread = self.covariance[:3, :3].ravel().tolist()
        self._given = tuple(m[X : X + 4])
        return (*m[X : X + 4], *m[RATE : RATE + 3]), tuple(spread)

    def passes_on(self) -> tuple[int | Signal, ...]:
        """Return that the attitude is what was measured; the covariance is zero."""
        return 0, ()

    def off(self, *inputs: Signal) -> tuple[Signal, ...]:
        """Return the measurement; of a star tracker that has none, the attitude given last."""
        measured, covariance = super().off(*inputs)
        if any(measured[:4]):
            self._given = tuple(measured[:4])
        return (*self._given, *measured[4:]), covariance

    @property
    def covariance(self) -> Floats:
        """Covariance (6, 6) of the newest estimate: angles [rad], bias [rad/s]."""
        return np.array(self.memory[P : P + SQUARE]).reshape(STATES, STATES)


register(
    Section(
        'attitude_estimator',
        AttitudeEstimator,
        Place.ATTITUDE_ESTIMATOR,
        AttitudeEstimatorStage,
        needs=('attitude_sensors', 'something to measure'),
    )
)
