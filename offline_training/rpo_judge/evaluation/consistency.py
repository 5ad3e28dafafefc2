# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Whether an estimator knows how well it knows: NEES, NIS, whiteness over many flights.

The flights of `consistency` have the noise that the filter assumes: white acceleration, a
disturbance that walks, sensors without bias, scale error and outliers. The kernels are those of the
stages. Those of `in_its_world` have the scenario's own dynamics, thrusters and sensors, of which
the filter models less. Source: Bar-Shalom, Li and Kirubarajan, "Estimation with Applications to
Tracking and Navigation", 5.4.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import pi, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rpo_core.chain.flight import Flight, fly
from rpo_core.control.controller import AnyController
from rpo_core.files.scenario import Scenario
from rpo_core.files.validation import InputError
from rpo_core.wire.interfaces import (
    ALIGNED,
    ATTITUDE_COVARIANCE,
    CHASER_ATTITUDE,
    NAVIGATION_ATTITUDE,
    NAVIGATION_COVARIANCE,
    NAVIGATION_STATE,
)
from rpo_kernels.chaser_kernels import Quaternion, times
from rpo_kernels.jit import as_table, inlined, kernel
from rpo_kernels.kernels import State, Vector, cw_step, saturate, unpacked
from rpo_nav.attitude_sensors import AttitudeSensors
from rpo_nav.estimator import Estimator, filter_of, memory_of
from rpo_nav.filter_kernels import HEADING, LIMIT, SQUARE, STATES, STEP, TESTED, TESTS, X, estimate
from rpo_nav.sensor_kernels import sense, three_normals
from rpo_nav.sensors import Sensing, Sensor, Sensors

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

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

    name: str
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
        least, most = self.nis_bounds
        return low <= self.nees.mean() <= high and least <= self.nis.mean() <= most

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


def rows_of(found: Consistency) -> list[tuple[str, ...]]:
    """Return the rows of a table."""
    rows: list[tuple[str, ...]] = []
    for name, values, bounds in (
        ('NEES of 6 states', found.nees, found.nees_bounds),
        ('NIS of a number', found.nis, found.nis_bounds),
    ):
        rows.append(_row(name, values, bounds))
    white = f'{found.correlation:.5f}', '', f'below {found.correlation_bound:.5f}'
    rows.append(('correlation of successive innovations', *white, f'{found.innovations} measured'))
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

    def fly_once(run: int, ticks: Ints, errors: Floats, spreads: Floats, *counted: Floats) -> None:
        mine = replace(sensors, noise_key=(run, 2**31))
        f, s = filter_of(settings, mine, scenario), Sensing(mine, scenario)
        _fly(
            ticks, scenario.start, f, memory_of(f), s.table, s.memory, run,
            _forces(settings, scenario), errors, spreads, *counted,
        )  # fmt: skip

    return gathered(scenario, runs, STATES, fly_once, show)


def gathered(
    scenario: Scenario,
    runs: int,
    states: int,
    fly_once: Callable[..., None],
    show: Callable[[str, float, float], object],
) -> Consistency:
    """Return what many flights say of a filter.

    states : width of its covariance
    fly_once : from the run, the ticks (times,) and tables to fill, see `_fly`
    """
    ticks = np.array([scenario.ticks * i // TIMES for i in range(1, TIMES + 1)])
    nees, nis = np.empty((runs, TIMES)), np.empty((runs, TIMES))
    sums, counts = np.zeros((6, 3)), np.zeros(2)
    errors, spreads = np.empty((TIMES, 6)), np.empty((TIMES, states * states))
    for run in range(runs):
        fly_once(run, ticks, errors, spreads, nis[run], sums, counts)
        whole = spreads.reshape(TIMES, states, states)[:, :6, :6]
        nees[run] = np.einsum('ti,ti->t', errors, np.linalg.solve(whole, errors[..., None])[..., 0])
        show('flights', run + 1, runs)
    measured = sums[:, 0] > 0
    correlation = sums[measured, 2] / sums[measured, 1]
    return Consistency(
        scenario.name, nees.mean(axis=0), nis.mean(axis=0), counts[0] / counts[1], runs,
        float(np.abs(correlation).max()), int(counts[1]),
    )  # fmt: skip


@dataclass(frozen=True)
class InItsWorld:
    """What flights as the scenario is say of its filter.

    position, velocity, attitude : (times,) mean over the runs of the NEES of three numbers; zeros
        without an attitude filter
    runs : how many
    """

    position: Floats
    velocity: Floats
    attitude: Floats
    runs: int

    @property
    def bounds(self) -> tuple[float, float]:
        """Where the mean of 3 lies with 95 % where the covariance is that of the errors."""
        return _bounds(3.0, self.runs)


def in_its_world(
    scenario: Scenario,
    controller: AnyController,
    runs: int,
    show: Callable[[str, float, float], object] = lambda what, done, of: None,
) -> InItsWorld:
    """Fly a scenario as it is so often, each with its own noise of the sensors.

    Raises InputError where the scenario has no filter.
    """
    sensors, _ = _sections(scenario)
    ticks = [scenario.ticks * i // TIMES for i in range(1, TIMES + 1)]
    nees, stars = np.zeros((runs, TIMES, 3)), scenario.section(AttitudeSensors)
    for run in range(runs):
        mine: list[Any] = [s for s in (sensors, stars) if s is not None]
        mine = [replace(s, noise_key=(run, 2**31)) for s in mine]
        flight = fly(scenario.equipped(*mine), controller)
        errors = (flight.signals[NAVIGATION_STATE] - flight.states)[ticks].reshape(-1, 2, 3, 1)
        spreads = flight.signals[NAVIGATION_COVARIANCE][ticks].reshape(-1, 2, 3, 3)
        nees[run, :, :2] = (errors * np.linalg.solve(spreads, errors)).sum(axis=(2, 3))
        if ATTITUDE_COVARIANCE in flight.signals:
            nees[run, :, 2] = _of_attitude(flight, ticks)
        show('flights in its world', run + 1, runs)
    position, velocity, attitude = nees.mean(axis=0).T
    return InItsWorld(position, velocity, attitude, runs)


def _of_attitude(flight: Flight, ticks: list[int]) -> Floats:
    """Return the NEES (n,) of the angles at some ticks of a flight."""
    truth, estimate, spreads = (
        flight.signals[name][ticks]
        for name in (CHASER_ATTITUDE, NAVIGATION_ATTITUDE, ATTITUDE_COVARIANCE)
    )
    pairs = zip(truth[:, :4].tolist(), estimate[:, :4].tolist(), strict=True)
    errors = np.array([angles_between(tuple(q), tuple(p)) for q, p in pairs])[..., None]
    return np.asarray((errors * np.linalg.solve(spreads.reshape(-1, 3, 3), errors)).sum((1, 2)))


@inlined
def angles_between(truth: Quaternion, estimate: Quaternion) -> Vector:
    """Return the angles (3,) [rad] from estimated to true axes, twice a vector part."""
    x, y, z, w = times((-estimate[0], -estimate[1], -estimate[2], estimate[3]), truth)
    sign = 2.0 if w >= 0.0 else -2.0
    return sign * x, sign * y, sign * z


def rows_in_its_world(found: InItsWorld) -> list[tuple[str, ...]]:
    """Return the rows of a table, under `HEADINGS`."""
    every = {name: getattr(found, name) for name in ('position', 'velocity', 'attitude')}
    return [
        _row(f'NEES of {name}, 3 numbers', values, found.bounds)
        for name, values in every.items()
        if values.any()
    ]


def size_of(nees: Floats) -> str:
    """Return how large errors are beside what the filter says, of the NEES of three numbers."""
    share = sqrt(float(nees.mean()) / 3.0) - 1.0
    return f'{100 * abs(share):.0f} % {"larger" if share > 0.0 else "smaller"}'


SETTLING_S = 60.0
"""After this time at rest at the goal, the filter's covariance is that of a hold."""


def sigmas_at_goal(scenario: Scenario) -> tuple[float, float]:
    """Return the filter's own sigma of a position [m] and velocity [m/s] at rest at the goal.

    Of the worst axis, after `SETTLING_S`; raises InputError where the scenario has no filter.
    """
    sensors, settings = _sections(scenario)
    sensors = replace(sensors, units=tuple(map(_all_round, sensors.units)))
    f, s = filter_of(settings, sensors, scenario), Sensing(sensors, scenario)
    m = memory_of(f)
    attitude = as_table([*ALIGNED[:4], *[0.0] * (HEADING - 4)])
    x, y, z = scenario.goal_position_m
    for tick in range(round(SETTLING_S / scenario.dt_s)):
        state = (x, y, z, 0.0, 0.0, 0.0)
        sense(tick, state, ALIGNED[:4], s.table, s.memory)
        estimate(tick, (0.0, 0.0, 0.0), s.memory, attitude, f, m)
    variances = np.array(m[X + STATES : X + STATES + SQUARE]).reshape(STATES, STATES).diagonal()
    return sqrt(variances[:3].max()), sqrt(variances[3:6].max())


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
    return replace(scenario, sections=(replace(sensors, units=units), settings))


def _all_round(unit: Sensor) -> Sensor:
    """Return a sensor as it is where the target is in view; others as they are."""
    return replace(unit, body_fixed=False, field_of_view_rad=pi) if unit.body_fixed else unit


def _forces(settings: Estimator, scenario: Scenario) -> Vector:
    """Return sigmas [N] of the white force of a tick, of the disturbance, and of its walk."""
    white = settings.acceleration_noise_m_s1_5 * scenario.mass_kg / sqrt(scenario.dt_s)
    walk = settings.disturbance_walk_n_s0_5 * sqrt(scenario.dt_s)
    return white, settings.disturbance_sigma_n, walk


@kernel
def _command(m: Any, limit: float) -> Vector:
    """Return the force (3,) [N] of a PD controller that reads the estimate."""
    return (
        saturate(-0.00625 * m[X] - 0.5 * m[X + 3], limit),
        saturate(-0.00625 * m[X + 1] - 0.5 * m[X + 4], limit),
        saturate(-0.00625 * m[X + 2] - 0.5 * m[X + 5], limit),
    )


@kernel
def _fly(
    ticks: Any, start: State, f: Any, m: Any, sensors: Any, measured: Any, run: int,
    forces: Vector, errors: Any, spreads: Any, nis: Any, sums: Any, counts: Any,
) -> None:  # fmt: skip
    """Fly once; fill errors (times, 6), spreads (times, 81) and nis (times,).

    sums : (6, 3) per number: count, squares, products with the one before
    counts : numbers measured, measurements
    """
    state, command, key = start, (0.0, 0.0, 0.0), 2**31
    white, constant, drift = forces
    first = three_normals(0, 1, _WALK, run, key)
    dx, dy, dz = constant * first[0], constant * first[1], constant * first[2]
    before, newest, at = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0), 1.0, 0
    attitude = measured  # it is not read: no sensor turns
    for tick in range(ticks[-1] + 1):
        sense(tick, state, (0.0, 0.0, 0.0, 1.0), sensors, measured)
        estimate(tick, command, measured, attitude, f, m)
        row = m[TESTED : TESTED + TESTS]
        if row[0] > 0.0:
            newest = row[1] / row[0]
            counts[0] += row[0]
            counts[1] += 1.0
            now = (row[2], row[3], row[4], row[5], row[6], row[7])
            for i in range(int(row[0])):
                sums[i, 0] += 1.0
                sums[i, 1] += now[i] * now[i]
                sums[i, 2] += now[i] * before[i]
            before = now
        if tick == ticks[at]:
            for i in range(6):
                errors[at, i] = m[X + i] - state[i]
            for i in range(SQUARE):
                spreads[at, i] = m[X + STATES + i]
            nis[at] = newest
            at += 1
        command = _command(m, f[LIMIT])
        n0, n1, n2 = three_normals(tick, 0, _FORCE, run, key)
        pushed = (
            command[0] + dx + white * n0,
            command[1] + dy + white * n1,
            command[2] + dz + white * n2,
        )
        state = cw_step(state, pushed, unpacked(f, STEP, 1))
        w0, w1, w2 = three_normals(tick, 0, _WALK, run, key)
        dx, dy, dz = dx + drift * w0, dy + drift * w1, dz + drift * w2
