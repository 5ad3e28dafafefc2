# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Metrics of a flight, defined once: what they are called, and how they add up.

The kernels count axis by axis, tick by tick; a flight that is there (`row_of`), and the lanes of
the Monte Carlo engine, which keep no flight, use the same ones and get the same bits.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rpo_core.chain.flight import Flight
from rpo_core.judge.contact import docked_at
from rpo_core.kernels.arithmetic import norm
from rpo_core.kernels.jit import as_table, kernel
from rpo_core.scenario.requirements import (
    ARRIVAL_WINDOW_S,
    MAX_ARRIVAL_DISTANCE_M,
    MAX_ARRIVAL_SPEED_M_S,
    MAX_SLEW_N_S,
)
from rpo_core.scenario.scenario import Scenario

PENALTY = 100.0
"""Added to J [N^2 s] for each condition not met."""

CLAIM_WINDOW_S = 200.0
CLAIM_POSITION_M, CLAIM_VELOCITY_M_S = 0.5, 0.01

METRICS = {
    'energy_n2s': ('N^2 s', 'J: integral of f.f dt over the applied forces f'),
    'mean_speed_norm_m_s': ('m/s', 'mean norm of the velocity, in the mean window'),
    'slew_per_axis_n_s': ('N/s', 'largest |f_k - f_(k-1)| / dt of an axis, f saturated commands'),
    'mean_error_norm_m': ('m', 'mean norm of the position error, in the mean window'),
    'hold_error_per_axis_m': ('m', 'largest position error of an axis, in the late window'),
    'hold_speed_per_axis_m_s': ('m/s', 'largest speed of an axis, in the late window'),
    'hold_force_per_axis_n': ('N', 'largest applied force of an axis, in the late window'),
    'arrival_time_s': ('s', 'after it every axis stays within 0.5 m of the goal'),
    'delta_v_axis_sum_m_s': ('m/s', 'integral of |f_x| + |f_y| + |f_z| over the mass'),
    'hold_speed_bound_m_s': ('m/s', "norm of the axes' largest speeds, in the late window"),
    'hold_error_bound_m': ('m', "norm of the axes' largest errors, in the late window"),
}
"""Metric -> unit, and what it is, in the order of a row; the smaller, the better.

A requirement has the same name. The mean window is the last 30 s of the judged flight, or the
`mean_window_s` that the scenario requires; the late window the last 200 s, or from the
`hold_from_s` that it requires. The step from rest to the first command that acts is no slew
(`first_slew_tick`). The search of a controller takes the arrival error that its scenario requires
(`Windows.arrival_m`). A bound is never less than the largest norm.
"""

UNITS = {name: unit for name, (unit, _) in METRICS.items()}

(
    ENERGY,
    ARRIVAL_SPEED,
    SLEW,
    ARRIVAL_DISTANCE,
    LATE_POSITION,
    LATE_VELOCITY,
    LATE_FORCE,
    ARRIVAL_TIME,
    DELTA_V,
    LATE_SPEED,
    LATE_DISTANCE,
) = range(len(UNITS))
"""Columns of a row of metrics."""


class Windows(NamedTuple):
    """What is counted when, in ticks.

    ticks : flight that is judged
    tail : last states of it whose norms are averaged
    horizon : flight in all, >= ticks
    late : last ticks of the horizon whose extremes are kept
    arrival_m : error of an axis [m] that counts as arrived
    """

    ticks: int
    tail: int
    horizon: int
    late: int
    arrival_m: float = MAX_ARRIVAL_DISTANCE_M


class AxisSums(NamedTuple):
    """What was counted of one axis.

    energy, effort : sums of f^2 [N^2] and |f| [N]
    step : largest change of force between ticks [N]
    position, velocity, force : largest absolute values in the late window
    outside : number of the last tick after which |r| > `arrival_m`, from 1; 0 if none
    """

    energy: float
    effort: float
    step: float
    position: float
    velocity: float
    force: float
    outside: float


@kernel
def larger(largest: float, value: float) -> float:
    """Return the larger of what was largest so far and |value|."""
    size = abs(value)
    return size if size > largest else largest


@kernel
def with_square(total: float, force: float) -> float:
    """Return a sum of squares with one more."""
    return total + force * force


@kernel
def last_outside(last: float, tick: int, r: float, arrival_m: float) -> float:
    """Return the number of the last tick, from 1, after which |r| [m] is beyond arrival."""
    return tick + 1.0 if abs(r) > arrival_m else last


@kernel
def fill_row(
    row: Any,
    x: AxisSums,
    y: AxisSums,
    z: AxisSums,
    distances: float,
    speeds: float,
    tail: int,
    dt: float,
    mass: float,
) -> None:
    """Fill a row of metrics, the columns of `UNITS`.

    distances, speeds : sums over the `tail` of the norms of position [m] and velocity [m/s]
    """
    row[ENERGY] = (x.energy + y.energy + z.energy) * dt
    row[ARRIVAL_SPEED] = speeds / tail
    row[SLEW] = max(x.step, y.step, z.step) / dt
    row[ARRIVAL_DISTANCE] = distances / tail
    row[LATE_POSITION] = max(x.position, y.position, z.position)
    row[LATE_SPEED] = norm(x.velocity, y.velocity, z.velocity)
    row[LATE_DISTANCE] = norm(x.position, y.position, z.position)
    row[LATE_FORCE] = max(x.force, y.force, z.force)
    row[ARRIVAL_TIME] = max(x.outside, y.outside, z.outside) * dt
    row[LATE_VELOCITY] = max(x.velocity, y.velocity, z.velocity)
    row[DELTA_V] = (x.effort + y.effort + z.effort) * dt / mass


@kernel
def axis_sums(states: Any, forces: Any, axis: int, windows: Windows, first_slew: int) -> AxisSums:
    """Count one axis of a flight: states (N+1, 6), applied forces (N, 3), N = `horizon`.

    first_slew : the first tick whose change of force is counted
    """
    energy = effort = step = position = velocity = largest = outside = before = 0.0
    for tick in range(windows.horizon):
        force = forces[tick][axis]
        r, v = states[tick + 1][axis], states[tick + 1][3 + axis]
        if tick < windows.ticks:
            energy = with_square(energy, force)
            effort += abs(force)
            step = larger(step, force - before) if tick >= first_slew else step
            before = force
            outside = last_outside(outside, tick, r, windows.arrival_m)
        if tick >= windows.horizon - windows.late:
            position, velocity = larger(position, r), larger(velocity, v)
            largest = larger(largest, force)
    return AxisSums(energy, effort, step, position, velocity, largest, outside)


@kernel
def count(
    states: Any, forces: Any, windows: Windows, first_slew: int, dt: float, mass: float, row: Any
) -> None:
    """Fill the row of metrics of a flight; see `axis_sums`."""
    distances = speeds = 0.0
    for tick in range(windows.ticks - windows.tail + 1, windows.ticks + 1):
        s = states[tick]
        distances += norm(s[0], s[1], s[2])
        speeds += norm(s[3], s[4], s[5])
    x = axis_sums(states, forces, 0, windows, first_slew)
    y = axis_sums(states, forces, 1, windows, first_slew)
    z = axis_sums(states, forces, 2, windows, first_slew)
    fill_row(row, x, y, z, distances, speeds, windows.tail, dt, mass)


def window_ticks(scenario: Scenario, window_s: float) -> int:
    """Return how many last states, or forces, make up `window_s`; at most all but the start."""
    return min(scenario.ticks, max(1, round(window_s / scenario.dt_s)))


def windows_of(
    scenario: Scenario, tail_s: float | None = None, late_s: float | None = None
) -> Windows:
    """Return the windows of a flight that is judged to its end.

    tail_s, late_s : if not given, those of the scenario's requirements, else the paper's
    """
    required = scenario.requirements
    if tail_s is None:
        tail_s = ARRIVAL_WINDOW_S if required is None else required.mean_window_s
    if late_s is None:
        hold = hold_tick(scenario)
        late_s = CLAIM_WINDOW_S if hold is None else (scenario.ticks - hold) * scenario.dt_s
    tail, late = (window_ticks(scenario, seconds) for seconds in (tail_s, late_s))
    return Windows(scenario.ticks, tail, scenario.ticks, late)


def hold_tick(scenario: Scenario) -> int | None:
    """Return the tick of `hold_from_s`, after which a scenario requires to hold; None without."""
    required = scenario.requirements
    if required is None or required.hold_from_s is None:
        return None
    return round(required.hold_from_s / scenario.dt_s)


def first_slew_tick(scenario: Scenario) -> int:
    """Return the first tick whose change of force counts as slew.

    The first command has no command before it. It acts at tick 0; where the thrusters are late, at
    the tick of their delay. The step from rest to it is not counted.
    """
    return 1 + (scenario.thrusters.delay_ticks if scenario.thrusters else 0)


def row_of(flight: Flight, windows: Windows | None = None) -> NDArray[np.float64]:
    """Return the metrics of a flight, the columns of `UNITS`; not a number where states are not.

    Positions are errors, relative to the goal of the scenario.
    """
    scenario, forces = flight.scenario, flight.saturated_forces_n
    row = np.full(len(UNITS), np.nan)
    if np.isfinite(flight.errors).all() and np.isfinite(forces).all():
        count(
            as_table(flight.errors),
            as_table(forces),
            windows or windows_of(scenario),
            first_slew_tick(scenario),
            scenario.dt_s,
            scenario.mass_kg,
            row,
        )
    return row


@dataclass(frozen=True)
class Metrics:
    """What a flight is judged by; see `UNITS`."""

    energy_n2s: float
    mean_speed_norm_m_s: float
    slew_per_axis_n_s: float
    mean_error_norm_m: float

    @property
    def conditions(self) -> tuple[bool, bool, bool]:
        """Whether speed, slew (the paper's two) and arrival (ours) are met."""
        return (
            self.mean_speed_norm_m_s <= MAX_ARRIVAL_SPEED_M_S,
            self.slew_per_axis_n_s <= MAX_SLEW_N_S,
            self.mean_error_norm_m <= MAX_ARRIVAL_DISTANCE_M,
        )

    @property
    def fitness(self) -> float:
        """J plus the flat penalty of each condition not met."""
        return self.energy_n2s + PENALTY * self.conditions.count(False)


def of_flight(flight: Flight) -> Metrics:
    """Return what the paper judges a flight by, over its own windows."""
    row = row_of(flight, windows_of(flight.scenario, tail_s=ARRIVAL_WINDOW_S))
    return Metrics(*row[: ARRIVAL_DISTANCE + 1].tolist())


class Window(NamedTuple):
    """Largest absolute value of any axis in the last part of a flight."""

    position_m: float
    velocity_m_s: float
    force_n: float


def window(flight: Flight, window_s: float) -> Window:
    """Return the extremes of the last `window_s` seconds."""
    row = row_of(flight, windows_of(flight.scenario, late_s=window_s))
    return Window(*row[LATE_POSITION : LATE_FORCE + 1].tolist())


def disturbance_level_n(flight: Flight) -> float:
    """Return the largest |d| of any axis over the flight: the paper's level of the disturbance."""
    return float(np.abs(flight.disturbances_n).max())


def arrival_time_s(flight: Flight) -> float | None:
    """Return the time after which every axis stays within 0.5 m; None if it never does."""
    time_s = float(row_of(flight)[ARRIVAL_TIME])
    return time_s if time_s < flight.scenario.duration_s else None


def closing_speeds_m_s(flight: Flight) -> NDArray[np.float64]:
    """Return -d|r|/dt (N+1,), r from the goal: the range rate with the opposite sign; 0 at it."""
    x, y, z, vx, vy, vz = flight.errors.T
    ranges = np.sqrt(x * x + y * y + z * z)
    toward = -(x * vx + y * vy + z * vz)
    return np.asarray(np.divide(toward, ranges, out=np.zeros_like(ranges), where=ranges > 0.0))


def thruster_duty(flight: Flight) -> float:
    """Return the mean of |f| over the ticks and axes, as a share of the largest force.

    Thrusters that only switch on and off are on for this share of the time, each axis on average.
    """
    mean_n = float(np.abs(flight.saturated_forces_n).mean())
    return mean_n / flight.scenario.max_force_n


def run_figures(
    scenario: Scenario, tick: int, state: Sequence[float], squares: Sequence[float], saturated: int
) -> dict[str, float | int]:
    """Return what `run_status` says of a flight at a tick; the distance is to the target.

    squares : (3,) sums over the ticks before of the squared forces of an axis [N^2]
    saturated : ticks with a saturated command
    """
    x, y, z = squares
    return {
        'tick': tick,
        'time_s': scenario.time_s(tick),
        'energy_n2s': (x + y + z) * scenario.dt_s,
        'distance_m': norm(*state[:3]),
        'speed_m_s': norm(*state[3:]),
        'saturated_ticks': saturated,
    }


class Figure(NamedTuple):
    """A number of a flight, as tables show it; infinite: it never happens."""

    statement: str
    unit: str
    value: float


def others_of(flight: Flight) -> list[Figure]:
    """Return what a table shows of any flight, whatever is required of it.

    Per axis: the largest absolute value of any axis. Of a flight that docks, nothing that comes
    after the contact is shown as where it arrives or ends.
    """
    row, docked = row_of(flight), docked_at(flight)
    last, place = (-1, 'at the end') if docked is None else (docked, 'at contact')
    closing = closing_speeds_m_s(flight)[: None if docked is None else docked + 1]
    error, speed = flight.errors[last, :3].tolist(), flight.errors[last, 3:].tolist()
    arrived = arrival_time_s(flight)
    when = Figure('time to goal, within 0.5 m per axis', 's', inf if arrived is None else arrived)
    rate = [Figure('range rate, at the end', 'm/s', -float(closing[-1]))]
    if docked is not None:  # the goal may be reached exactly: then a range has no rate
        when, rate = Figure('time to contact', 's', flight.scenario.time_s(docked)), []
    return [
        Figure('energy J', 'N²s', float(row[ENERGY])),
        Figure('Δv (sum of the axes)', 'm/s', float(row[DELTA_V])),
        Figure('thruster duty (mean of the axes)', '', thruster_duty(flight)),
        Figure('slew per axis', 'N/s', float(row[SLEW])),
        when,
        Figure('largest closing speed', 'm/s', float(closing.max())),
        Figure(f'position error per axis, {place}', 'm', max(map(abs, error))),
        Figure(f'position error (norm), {place}', 'm', norm(*error)),
        Figure(f'speed (norm), {place}', 'm/s', norm(*speed)),
        *rate,
        *_of_valves(flight),
    ]


def _of_valves(flight: Flight) -> list[Figure]:
    """Return what the thrusters of a flight spent, where its scenario has pulses or propellant."""
    thrusters = flight.scenario.thrusters
    if thrusters is None or not (thrusters.fires or thrusters.propellant):
        return []
    spent = flight.thrust
    figures = [Figure('Δv of the thrusters, waste included', 'm/s', spent.delta_v_m_s)]
    if thrusters.propellant:
        figures.append(Figure('propellant', 'kg', spent.propellant_kg))
    if thrusters.fires:
        figures.append(Figure('openings of the valves', '', float(spent.openings)))
    return figures
