# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Whether an estimator knows how well it knows: NEES, NIS, whiteness over many flights.

The flights of `consistency` have the noise that the filter assumes: white acceleration, a
disturbance that walks, sensors without bias, scale error and outliers. The kernels are those of the
stages. Those of `in_its_world` have the scenario's own dynamics, thrusters and sensors, of which
the filter models less. Source: Bar-Shalom, Li and Kirubarajan, "Estimation with Applications to
Tracking and Navigation", 5.4.

An attitude filter has six states: the angles between estimated and true axes, in the chaser's, and
the gyro's bias. The chaser turns as the scenario has it, without commands; the bias at the start is
drawn as large as the filter assumes. Source: Crassidis, Markley and Cheng, "Survey of nonlinear
attitude estimation methods", 2007.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import pi, sqrt
from typing import Any

import numpy as np

from rpo_core.attitude.attitude_kernels import Attitude
from rpo_core.attitude.chaser import Craft, chaser_tick
from rpo_core.chain.flight import fly
from rpo_core.control.controller import AnyController
from rpo_core.files.validation import InputError
from rpo_core.kernels import calls
from rpo_core.kernels.arithmetic import State, Vector, saturate
from rpo_core.kernels.arrays import Floats, Ints
from rpo_core.kernels.jit import as_table, inlined
from rpo_core.navigation import attitude_estimator
from rpo_core.navigation.attitude_estimator import AttitudeEstimator, AttitudeEstimatorStage
from rpo_core.navigation.attitude_sensors import (
    AttitudeSensors,
    AttitudeSensorsStage,
    angles_between,
)
from rpo_core.navigation.estimator import STATES, Estimator, EstimatorStage, filter_of
from rpo_core.navigation.sensors import (
    CENTRE,
    MESSAGE,
    Sensor,
    Sensors,
    SensorsStage,
    three_normals,
)
from rpo_core.scenario.scenario import Scenario
from rpo_core.wire import interfaces
from rpo_core.world.cw import CwStep, cw_step

TIMES = 10
"""Moments of a flight at which NEES and NIS are taken, the last one at its end."""

_FORCE, _WALK = 253, 254  # streams of random numbers beside those of the sensors

_NORMAL_95 = 1.959963984540054


@dataclass(frozen=True)
class Consistency:
    """What many flights say of a filter.

    nees : (times,) mean over the runs, of the six states
    nis : (times,) mean over the runs of the newest measurement, divided by its count of numbers
    numbers : of a measurement
    runs : how many
    correlation : largest |correlation| of an innovation of the first sensor with the one before it
    innovations : how many measurements of it that is over
    """

    nees: Floats
    nis: Floats
    numbers: float
    runs: int
    correlation: float
    innovations: int

    @property
    def holds(self) -> bool:
        """Whether NEES and NIS, averaged over the moments too, are within their bounds."""
        low, high = self.nees_bounds
        nis_low, nis_high = self.nis_bounds
        return low <= self.nees.mean() <= high and nis_low <= self.nis.mean() <= nis_high

    @property
    def nees_bounds(self) -> tuple[float, float]:
        """Where the mean of 6 lies with 95 %."""
        return _bounds(6.0, self.runs)

    @property
    def nis_bounds(self) -> tuple[float, float]:
        """Where the mean NIS of a number, 1, lies with 95 %."""
        return _bounds(1.0, self.runs * self.numbers)

    @property
    def correlation_bound(self) -> float:
        """Below it, with 95 %, is the correlation of white innovations."""
        return _NORMAL_95 / sqrt(self.innovations)


HEADINGS = ('', 'mean', 'moments, least to most', '95 % of one moment', '')
"""Of `rows_of`."""


def rows_of(judged: Consistency) -> list[tuple[str, ...]]:
    """Return the rows of a table."""
    rows = [
        _row('NEES of 6 states', judged.nees, judged.nees_bounds),
        _row('NIS of a number', judged.nis, judged.nis_bounds),
    ]
    white = f'{judged.correlation:.5f}', '', f'below {judged.correlation_bound:.5f}'
    rows.append(('correlation of successive innovations', *white, f'{judged.innovations} measured'))
    return rows


def _row(name: str, values: Floats, bounds: tuple[float, float]) -> tuple[str, ...]:
    low, high = bounds
    inside = ((low <= values) & (values <= high)).sum()
    return (
        name, f'{values.mean():.3f}', f'{values.min():.3f} to {values.max():.3f}',
        f'{low:.3f} to {high:.3f}', f'{inside} of {len(values)} within',
    )  # fmt: skip


def _bounds(freedom: float, count: float) -> tuple[float, float]:
    half = _NORMAL_95 * sqrt(2.0 * freedom / count)
    return freedom - half, freedom + half


def consistency(
    scenario: Scenario,
    runs: int,
    show: Callable[[str, float, float], object] = lambda what, done, of: None,
) -> Consistency:
    """Fly a scenario so often with the noise that its filter assumes; raises InputError."""
    sensors, settings = _sections(scenario)
    white = settings.acceleration_noise_m_s1_5 * scenario.mass_kg / sqrt(scenario.dt_s)
    walk = settings.disturbance_walk_n_s0_5 * sqrt(scenario.dt_s)
    forces = white, settings.disturbance_sigma_n, walk

    def fly_once(run: int, ticks: Ints, *filled: Floats) -> None:
        mine = replace(sensors, noise_key=(run, 2**31))
        f = filter_of(settings, mine, scenario)
        suite, stage = (
            SensorsStage(mine, scenario),
            EstimatorStage(settings, scenario.equipped(mine)),
        )
        rows = suite.row, stage.row
        inputs = [as_table(np.zeros(n)) for n in (6, 3 + MESSAGE * len(f.sensors), 27)]
        limits = f.limit_n, f.gust
        state, step = scenario.start, f.step
        _fly(ticks, state, step, limits, *rows, *inputs, *tested(stage.m), run, forces, *filled)

    return gathered(scenario, runs, STATES, fly_once, show)


def gathered(
    scenario: Scenario,
    runs: int,
    states: int,
    fly_once: Callable[..., None],
    show: Callable[[str, float, float], object],
) -> Consistency:
    """Return what many flights say of a filter whose covariance is so many states wide.

    fly_once : from the run, the ticks (times,) and tables to fill, see `_fly`
    """
    ticks = np.array([scenario.ticks * i // TIMES for i in range(1, TIMES + 1)])
    nees, nis = np.empty((runs, TIMES)), np.empty((runs, TIMES))
    sums = np.zeros((6, 4))
    errors, spreads = np.empty((TIMES, 6)), np.empty((TIMES, states * states))
    for run in range(runs):
        sums[:, 3] = 0.0
        fly_once(run, ticks, errors, spreads, nis[run], sums)
        nees[run] = _nees(errors, spreads.reshape(TIMES, states, states)[:, :6, :6])
        show('flights', run + 1, runs)
    count = sums[sums[:, 0] > 0]
    return Consistency(
        nees.mean(axis=0), nis.mean(axis=0), count[:, 0].sum() / count[0, 0], runs,
        float(np.abs(count[:, 2] / count[:, 1]).max()), int(count[0, 0]),
    )  # fmt: skip


def _nees(errors: Floats, spreads: Floats) -> Floats:
    """Return NEES (...) of errors (..., n) and their covariances (..., n, n)."""
    shares = np.linalg.solve(spreads, errors[..., None])[..., 0]
    return np.asarray(np.einsum('...i,...i', errors, shares))


def in_its_world(
    scenario: Scenario,
    controller: AnyController,
    runs: int,
    show: Callable[[str, float, float], object] = lambda what, done, of: None,
) -> dict[str, Floats]:
    """Fly a scenario as it is so often, each with its own noise of the sensors.

    Returns position, velocity and, with an attitude filter, attitude -> (times,) mean over the runs
    of the NEES of three numbers. Raises InputError where the scenario has no filter.
    """
    sensors, _ = _sections(scenario)
    ticks = [scenario.ticks * i // TIMES for i in range(1, TIMES + 1)]
    nees, both = np.zeros((runs, TIMES, 3)), (sensors, scenario.section(AttitudeSensors))
    for run in range(runs):
        mine: list[Any] = [replace(s, noise_key=(run, 2**31)) for s in both if s is not None]
        flight = fly(scenario.equipped(*mine), controller)
        signals = {name: values[ticks] for name, values in flight.signals.items()}
        errors = signals[interfaces.NAVIGATION_STATE] - flight.states[ticks]
        spreads = signals[interfaces.NAVIGATION_COVARIANCE].reshape(-1, 2, 3, 3)
        nees[run, :, :2] = _nees(errors.reshape(-1, 2, 3), spreads)
        if interfaces.ATTITUDE_COVARIANCE in signals:
            names = interfaces.CHASER_ATTITUDE, interfaces.NAVIGATION_ATTITUDE
            pairs = zip(*(map(tuple, signals[name].tolist()) for name in names), strict=True)
            angles = np.array([angles_between(*pair) for pair in pairs])
            nees[run, :, 2] = _nees(
                angles, signals[interfaces.ATTITUDE_COVARIANCE].reshape(-1, 3, 3)
            )
        show('flights in its world', run + 1, runs)
    kinds = 'position', 'velocity', 'attitude'
    means = zip(kinds, nees.mean(axis=0).T, strict=True)
    return {name: values for name, values in means if values.any()}


def rows_in_its_world(nees: dict[str, Floats], runs: int) -> list[tuple[str, ...]]:
    """Return the rows of a table, under `HEADINGS`."""
    bounds = _bounds(3.0, runs)
    return [_row(f'NEES of {name}, 3 numbers', nees[name], bounds) for name in nees]


def size_of(nees: Floats) -> str:
    """Return how large errors are beside what the filter says, of the NEES of three numbers."""
    share = sqrt(float(nees.mean()) / 3.0) - 1.0
    return f'{100 * abs(share):.0f} % {"larger" if share > 0.0 else "smaller"}'


def _sections(scenario: Scenario) -> tuple[Sensors, Estimator]:
    sensors, settings = scenario.section(Sensors), scenario.section(Estimator)
    if sensors is None or settings is None:
        raise InputError(f'scenario {scenario.name} must have sections `sensors` and `estimator`')
    return sensors, settings


def as_configured(scenario: Scenario, **changes: Any) -> Scenario:
    """Return a scenario as its filter takes it: no dynamics, thrusters, biases of their own.

    changes : of every sensor
    """
    sensors, settings = _sections(scenario)
    true: dict[str, Any] = {
        'bias_m': (0.0, 0.0, 0.0),
        'bias_walk_m_s0_5': 0.0,
        'scale_error': 0.0,
        'outlier_share': 0.0,
    }
    units = tuple(replace(_all_round(unit), **true, **changes) for unit in sensors.units)
    sections = replace(sensors, units=units), settings
    return replace(scenario, sections=sections, requirements=None)


def _all_round(unit: Sensor) -> Sensor:
    """Return a sensor as it is where the target is in view; others as they are."""
    turns = unit.body_fixed or unit.looks_at != CENTRE
    plain: dict[str, Any] = {'body_fixed': False, 'looks_at': CENTRE, 'field_of_view_rad': pi}
    return replace(unit, **plain) if turns else unit


@inlined
def _command(y: Any, limit: float) -> Vector:
    """Return the force (3,) [N] of a PD controller that reads the estimate."""
    return (
        saturate(-0.00625 * y[0] - 0.5 * y[3], limit),
        saturate(-0.00625 * y[1] - 0.5 * y[4], limit),
        saturate(-0.00625 * y[2] - 0.5 * y[5], limit),
    )


def tested(m: Any) -> tuple[Any, ...]:
    """Return what `_fly` reads of the memory of a filter: state, covariance, and the tests."""
    return m.x, m.p, m.tested, m.nis, m.innovations


@inlined
def counted(count: int, nis: float, innovations: Any, sums: Any) -> float:
    """Count a measurement that was tested; return its NIS by number.

    count : of its numbers
    sums : (6, 4) per number: count, squares, products with the one before, the newest
    """
    for i in range(count):
        newest = innovations[i]
        sums[i, 0] += 1.0
        sums[i, 1] += newest * newest
        sums[i, 2] += newest * sums[i, 3]
        sums[i, 3] = newest
    return nis / count


@calls.driver
def _fly(
    ticks: Any, start: State, step: CwStep, limits: Any, sensors: Any, estimator: Any,
    true: Any, u: Any, y: Any, x: Any, p: Any, tested: Any, nis: Any, innovations: Any, run: int,
    forces: Vector, errors: Any, spreads: Any, means: Any, sums: Any,
) -> None:  # fmt: skip
    """Fly once; fill errors (times, 6), spreads (times, 81) and means (times,), the NIS by number.

    limits : of the thrusters [N], and `gust` of the filter
    sensors, estimator : rows of the stages
    true, u, y : scratch, the inputs of both and the outputs of the estimator
    x, p, tested, nis, innovations : arrays of the filter's memory
    forces : sigmas [N] of the white force of a tick, of the disturbance, and of its walk
    sums : see `counted`
    """
    state, key = start, 2**31
    white, constant, drift = forces
    first = three_normals(0, 1, _WALK, run, key)
    dx, dy, dz = constant * first[0], constant * first[1], constant * first[2]
    newest, at = 1.0, 0
    for tick in range(ticks[-1] + 1):
        for i in range(6):
            true[i] = state[i]
        calls.call(sensors[0], tick, true, sensors[1], sensors[2], u, 3, len(u) - 3)
        calls.call(estimator[0], tick, u, estimator[1], estimator[2], y, 0, len(y))
        if tested[0] > 0:
            newest = counted(tested[0], nis[0], innovations[0], sums)
        if tick == ticks[at]:
            for i in range(6):
                errors[at, i] = x[i] - state[i]
            for i in range(STATES):
                for j in range(STATES):
                    spreads[at, STATES * i + j] = p[i][j]
            means[at] = newest
            at += 1
        command = _command(y, limits[0])
        n0, n1, n2 = three_normals(tick, 0, _FORCE, run, key)
        fx, fy, fz = command
        u[0], u[1], u[2] = fx, fy, fz
        loud = white * sqrt(1.0 + limits[1] * (fx * fx + fy * fy + fz * fz))
        pushed = (fx + dx + loud * n0, fy + dy + loud * n1, fz + dz + loud * n2)
        state = cw_step(state, pushed, step)
        w0, w1, w2 = three_normals(tick, 0, _WALK, run, key)
        dx, dy, dz = dx + drift * w0, dy + drift * w1, dz + drift * w2


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
        stage = AttitudeEstimatorStage(assumed, scenario.equipped(mine))
        suite = AttitudeSensorsStage(mine, scenario)
        rows = suite.row, stage.row
        inputs = [as_table(np.zeros(n)) for n in (7, 7, 16)]
        bias = gyro.bias_rad_s, suite.m.drift
        dt_s, arrays = scenario.dt_s, tested(stage.m)
        _fly_attitude(ticks, start, craft, dt_s, *rows, *inputs, *bias, *arrays, *filled)

    return gathered(scenario, runs, attitude_estimator.STATES, fly_once, show)


@calls.driver
def _fly_attitude(
    ticks: Any, a: Attitude, craft: Craft, dt: float, sensors: Any, estimator: Any,
    true: Any, u: Any, y: Any, bias: Vector, drift: Any,
    x: Any, p: Any, tested: Any, nis: Any, innovations: Any,
    errors: Any, spreads: Any, means: Any, sums: Any,
) -> None:  # fmt: skip
    """Fly once; fill errors (times, 6), spreads (times, 36), means (times,) and sums (6, 4).

    bias, drift : of the gyro, at tick 0 and what walked since [rad/s]; the others as of `_fly`
    """
    none, wheels = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    newest, at = 1.0, 0
    for tick in range(ticks[-1] + 1):
        for i in range(7):
            true[i] = a[i]
        calls.call(sensors[0], tick, true, sensors[1], sensors[2], u, 0, len(u))
        calls.call(estimator[0], tick, u, estimator[1], estimator[2], y, 0, len(y))
        if tested[0] > 0:
            newest = counted(tested[0], nis[0], innovations[0], sums)
        if tick == ticks[at]:
            angles = angles_between(a, (x[0], x[1], x[2], x[3]))
            for i in range(3):
                errors[at, i] = angles[i]
                errors[at, 3 + i] = bias[i] + drift[i] - x[4 + i]
            for i in range(6):
                for j in range(6):
                    spreads[at, 6 * i + j] = p[i][j]
            means[at] = newest
            at += 1
        _, a, wheels = chaser_tick(a, wheels, none, none, dt, craft)
