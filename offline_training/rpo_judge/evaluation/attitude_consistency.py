# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Whether an attitude filter knows how well it knows; see `rpo_judge.evaluation.consistency`.

Of six states: the angles between estimated and true axes, in the chaser's, and the gyro's bias. The
chaser turns as the scenario has it, without commands. The bias at the start is drawn as large as
the filter assumes. Source: Crassidis, Markley and Cheng, "Survey of nonlinear attitude estimation
methods", 2007.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from rpo_core.chain.flight import Flight
from rpo_core.files.scenario import Scenario
from rpo_core.files.validation import InputError
from rpo_core.wire.interfaces import ATTITUDE_COVARIANCE, CHASER_ATTITUDE, NAVIGATION_ATTITUDE
from rpo_judge.evaluation.consistency import TIMES, Consistency, Floats
from rpo_kernels.attitude_kernels import Attitude
from rpo_kernels.chaser_kernels import Craft, Quaternion, chaser_tick, times
from rpo_kernels.jit import inlined, kernel
from rpo_kernels.kernels import Vector
from rpo_nav.attitude_estimator import AttitudeEstimator, attitude_filter_of, attitude_memory_of
from rpo_nav.attitude_filter_kernels import SQUARE, STATES, TESTED, P, X, estimate_attitude
from rpo_nav.attitude_sensor_kernels import BIAS, DRIFT, sense_attitude
from rpo_nav.attitude_sensors import AttitudeSensing, AttitudeSensors
from rpo_nav.sensor_kernels import three_normals

_BIAS_STREAM = 254

OUTAGE = (0.35, 0.65)
"""Share of a flight without a star tracker, where an outage is judged."""


def attitude_consistency(
    scenario: Scenario,
    runs: int,
    show: Callable[[str, float, float], object] = lambda what, done, of: None,
    *,
    outage: bool = False,
) -> Consistency:
    """Fly so often with the noise that the attitude filter assumes; raises InputError.

    outage : without a star tracker for `OUTAGE` of the flight
    """
    sensors, settings = scenario.section(AttitudeSensors), scenario.section(AttitudeEstimator)
    if sensors is None or settings is None:
        raise InputError(
            f'scenario {scenario.name} must have sections `attitude_sensors` and '
            '`attitude_estimator`'
        )
    settings = replace(settings, noise_scale=1.0, start_error_deg=(0.0, 0.0, 0.0))
    begin, end = (share * scenario.duration_s for share in OUTAGE)
    blind = [(begin, end)] if outage else []
    star = replace(sensors.star_tracker, outages_s=(*sensors.star_tracker.outages_s, *blind))
    ticks = np.array([scenario.ticks * i // TIMES for i in range(1, TIMES + 1)])
    orbit = scenario.mean_motion_rad_s
    start, craft = scenario.attitude.start(orbit), scenario.attitude.craft(orbit)
    nees, nis = np.empty((runs, TIMES)), np.empty((runs, TIMES))
    sums, counts = np.zeros((3, 3)), np.zeros(2)
    for run in range(runs):
        drawn = three_normals(0, 0, _BIAS_STREAM, run, 2**31)
        x, y, z = (settings.bias_sigma_rad_s * draw for draw in drawn)
        mine = replace(
            sensors,
            star_tracker=star,
            gyro=replace(sensors.gyro, bias_rad_s=(x, y, z)),
            noise_key=(run, 2**31),
        )
        f, s = attitude_filter_of(settings, mine, scenario), AttitudeSensing(mine, scenario)
        errors, spreads = np.empty((TIMES, STATES)), np.empty((TIMES, SQUARE))
        _fly(
            ticks, start, craft, scenario.dt_s, f, attitude_memory_of(f), s.table, s.memory,
            errors, spreads, nis[run], sums, counts,
        )  # fmt: skip
        whole = spreads.reshape(TIMES, STATES, STATES)
        nees[run] = np.einsum('ti,ti->t', errors, np.linalg.solve(whole, errors[..., None])[..., 0])
        show('flights', run + 1, runs)
    correlation = float(np.abs(sums[:, 2] / sums[:, 1]).max())
    return Consistency(
        scenario.name, nees.mean(axis=0), nis.mean(axis=0), 3.0, runs, correlation, int(counts[1])
    )


def nees_of_flight(flight: Flight, ticks: list[int]) -> Floats:
    """Return the NEES (n,) of the angles at some ticks of a flight, three numbers each."""
    names = CHASER_ATTITUDE, NAVIGATION_ATTITUDE
    truth, estimate = (map(tuple, flight.signals[name][ticks, :4].tolist()) for name in names)
    errors = np.array(list(map(_error, truth, estimate)))
    spreads = flight.signals[ATTITUDE_COVARIANCE][ticks].reshape(-1, 3, 3)
    return np.einsum('ti,ti->t', errors, np.linalg.solve(spreads, errors[..., None])[..., 0])


@inlined
def _error(truth: Quaternion, estimate: Quaternion) -> Vector:
    """Return the angles (3,) [rad] from the estimated axes to the true ones, in the former."""
    x, y, z, w = times((-estimate[0], -estimate[1], -estimate[2], estimate[3]), truth)
    sign = 2.0 if w >= 0.0 else -2.0
    return sign * x, sign * y, sign * z


@kernel
def _fly(
    ticks: Any, a: Attitude, craft: Craft, dt: float, f: Any, m: Any, sensors: Any, measured: Any,
    errors: Any, spreads: Any, nis: Any, sums: Any, counts: Any,
) -> None:  # fmt: skip
    """Fly once; fill errors (times, 6), spreads (times, 36) and nis (times,).

    sums : (3, 3) per number: count, squares, products with the one before
    counts : numbers measured, measurements
    """
    none, wheels = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    before, newest, at = (0.0, 0.0, 0.0), 1.0, 0
    for tick in range(ticks[-1] + 1):
        sense_attitude(tick, a, sensors, measured)
        estimate_attitude(tick, measured, f, m)
        if m[TESTED] > 0.0:
            newest = m[TESTED + 1] / 3.0
            counts[0] += 3.0
            counts[1] += 1.0
            now = (m[TESTED + 2], m[TESTED + 3], m[TESTED + 4])
            for i in range(3):
                sums[i, 0] += 1.0
                sums[i, 1] += now[i] * now[i]
                sums[i, 2] += now[i] * before[i]
            before = now
        if tick == ticks[at]:
            found = _error((a[0], a[1], a[2], a[3]), (m[X], m[X + 1], m[X + 2], m[X + 3]))
            for i in range(3):
                errors[at, i] = found[i]
                errors[at, 3 + i] = sensors[BIAS + i] + measured[DRIFT + i] - m[X + 4 + i]
            for i in range(SQUARE):
                spreads[at, i] = m[P + i]
            nis[at] = newest
            at += 1
        _, a, wheels = chaser_tick(a, wheels, none, none, dt, craft)
