# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The attitude filter: star tracker and gyro to attitude, rate and bias.

Section `attitude_estimator`. Its arithmetic is in `rpo_core.navigation.attitude_filter_kernels`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from math import radians
from typing import Annotated, Any

import numpy as np

from rpo_core.files.codec import unless_default
from rpo_core.files.validation import Checked, real, vector3, whole
from rpo_core.kernels.arithmetic import Vector, sin_cos
from rpo_core.kernels.arrays import Floats
from rpo_core.kernels.jit import as_table
from rpo_core.navigation import attitude_filter_kernels as mekf
from rpo_core.navigation.attitude_filter_kernels import (
    RATE,
    SQUARE,
    STATES,
    P,
    X,
    estimate_attitude,
)
from rpo_core.navigation.attitude_sensor_kernels import MEASURED, START_STREAM, turned_by
from rpo_core.navigation.attitude_sensors import ARCSEC, AttitudeSensors
from rpo_core.navigation.estimator import FilterStage, gate
from rpo_core.navigation.sensor_kernels import three_normals
from rpo_core.stage import Place, Section, Signal, register
from rpo_core.wire import interfaces

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
    """Return the settings of the filter of a scenario, a table of `attitude_filter_kernels`."""
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
    """Return the memory of a filter that has not begun, a table of `attitude_filter_kernels`."""
    slots = int(f[mekf.LATENCY]) + 2
    return as_table([-1.0] * RATE + [0.0] * (mekf.HISTORY - RATE + mekf.RECORD * slots))


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
