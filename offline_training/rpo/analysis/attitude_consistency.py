# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Whether an attitude filter knows how well it knows; see `rpo.analysis.consistency`.

Of six states: the angles between estimated and true axes, in the chaser's, and the gyro's bias. The
chaser turns as the scenario has it, without commands. The bias at the start is drawn as large as
the filter assumes. Source: Crassidis, Markley and Cheng, "Survey of nonlinear attitude estimation
methods", 2007.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from rpo.analysis.consistency import Consistency, counted, gathered
from rpo_core.attitude.attitude_kernels import Attitude
from rpo_core.attitude.chaser_kernels import Craft, chaser_tick
from rpo_core.files.validation import InputError
from rpo_core.kernels.arrays import Floats, Ints
from rpo_core.kernels.jit import kernel
from rpo_core.navigation.attitude_estimator import (
    AttitudeEstimator,
    attitude_filter_of,
    attitude_memory_of,
)
from rpo_core.navigation.attitude_filter_kernels import (
    SQUARE,
    STATES,
    TESTED,
    P,
    X,
    estimate_attitude,
)
from rpo_core.navigation.attitude_sensor_kernels import BIAS, DRIFT, angles_between, sense_attitude
from rpo_core.navigation.attitude_sensors import AttitudeSensing, AttitudeSensors
from rpo_core.navigation.sensor_kernels import three_normals
from rpo_core.scenario.scenario import Scenario

_BIAS_STREAM = 254

OUTAGE = (0.35, 0.65)
"""Begin and end of an outage of the star tracker that is judged, as shares of the flight."""


def attitude_consistency(
    scenario: Scenario,
    runs: int,
    show: Callable[[str, float, float], object] = lambda what, done, of: None,
    *,
    outage: bool = False,
) -> Consistency:
    """Fly so often with the noise that the attitude filter of a scenario assumes.

    outage : without a star tracker for `OUTAGE` of the flight
    """
    sensors, settings = scenario.section(AttitudeSensors), scenario.section(AttitudeEstimator)
    if sensors is None or settings is None:
        raise InputError(f'scenario {scenario.name} must have section `attitude_estimator`')
    assumed = replace(settings, noise_scale=1.0, start_error_deg=(0.0, 0.0, 0.0))
    begin, end = (share * scenario.duration_s for share in OUTAGE)
    star, orbit = sensors.star_tracker, scenario.mean_motion_rad_s
    star = replace(star, outages_s=star.outages_s + (((begin, end),) if outage else ()))
    start, craft = scenario.attitude.start(orbit), scenario.attitude.craft(orbit)

    def fly_once(run: int, ticks: Ints, *filled: Floats) -> None:
        drawn = three_normals(0, 0, _BIAS_STREAM, run, 2**31)
        x, y, z = (assumed.bias_sigma_rad_s * draw for draw in drawn)
        gyro = replace(sensors.gyro, bias_rad_s=(x, y, z))
        mine = replace(sensors, star_tracker=star, gyro=gyro, noise_key=(run, 2**31))
        f, s = attitude_filter_of(assumed, mine, scenario), AttitudeSensing(mine, scenario)
        m = attitude_memory_of(f)
        _fly(ticks, start, craft, scenario.dt_s, f, m, s.table, s.memory, *filled)

    return gathered(scenario, runs, STATES, fly_once, show)


@kernel
def _fly(
    ticks: Any, a: Attitude, craft: Craft, dt: float, f: Any, m: Any, sensors: Any, measured: Any,
    errors: Any, spreads: Any, nis: Any, sums: Any,
) -> None:  # fmt: skip
    """Fly once; fill errors (times, 6), spreads (times, 36), nis (times,) and sums (6, 4)."""
    none, wheels = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    newest, at = 1.0, 0
    for tick in range(ticks[-1] + 1):
        sense_attitude(tick, a, sensors, measured)
        estimate_attitude(tick, measured, f, m)
        if m[TESTED] > 0.0:
            newest = counted(m, TESTED, sums)
        if tick == ticks[at]:
            found = angles_between(a, (m[X], m[X + 1], m[X + 2], m[X + 3]))
            for i in range(3):
                errors[at, i] = found[i]
                errors[at, 3 + i] = sensors[BIAS + i] + measured[DRIFT + i] - m[X + 4 + i]
            for i in range(SQUARE):
                spreads[at, i] = m[P + i]
            nis[at] = newest
            at += 1
        _, a, wheels = chaser_tick(a, wheels, none, none, dt, craft)
