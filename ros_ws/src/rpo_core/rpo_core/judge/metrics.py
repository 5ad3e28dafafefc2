# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What a flight is judged by, defined once: names, and kernels that count it, tick by tick.

To add a metric or a requirement, name it in `VALUES` and count it here; a requirement has a row in
`rpo_core/scenario/requirements.yaml` and a field in `requirements.py` too. The lanes of a search
(`rpo.engine`), which keep no flight, count by the same kernels, and get the same bits.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, isfinite, nan
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rpo_core.attitude.attitude_kernels import synchronised
from rpo_core.attitude.pointing import contact_turn
from rpo_core.chain.flight import Flight
from rpo_core.judge.contact import (
    Port,
    contact_speeds,
    depth_m,
    docked_at,
    port_of,
    touches,
)
from rpo_core.kernels.arithmetic import norm
from rpo_core.kernels.jit import as_table, as_view, kernel
from rpo_core.scenario.requirements import (
    ARRIVAL_WINDOW_S,
    ATTITUDES,
    MAX_ARRIVAL_DISTANCE_M,
    MAX_ARRIVAL_SPEED_M_S,
    MAX_SLEW_N_S,
    SHARES,
    THRUST,
)
from rpo_core.scenario.scenario import NANOSECONDS, Scenario
from rpo_core.wire.interfaces import ALIGNED, CHASER_ATTITUDE

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

VALUES = (
    *METRICS,
    'final_error_per_axis_m',
    'final_error_norm_m',
    'final_speed_per_axis_m_s',
    'final_speed_norm_m_s',
    'hold_error_norm_m',
    'hold_speed_norm_m_s',
    'required_arrival_time_s',
    'contact_closing_speed_m_s',
    'contact_lateral_speed_m_s',
    'keep_out_depth_m',
    'contact_tick',
    *ATTITUDES,
    *THRUST,
)
"""What is counted of a flight, in the order of a row: metrics, and values of requirements.

`required_arrival_time_s` : after it, the error is within what the requirements call arrival
`contact_tick` : of the first contact, -1 where there is none
"""

ARRIVAL = 'arrival_time_s'
"""A metric, within 0.5 m; and a requirement, within what a scenario says."""

COUNTED = len(VALUES) - len(ATTITUDES) - len(THRUST)
"""How many of `VALUES` the kernels count."""

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
    FINAL_POSITION,
    FINAL_DISTANCE,
    FINAL_VELOCITY,
    FINAL_SPEED,
    HOLD_DISTANCE,
    HOLD_SPEED,
    REQUIRED_ARRIVAL,
    CLOSING,
    LATERAL,
    DEPTH,
    CONTACT,
) = range(COUNTED)
"""Columns of a row; after these come the attitude at contact, and what thrusters spent."""

COLUMNS = {name: i for i, name in enumerate(VALUES)}
COLUMNS |= {ARRIVAL: REQUIRED_ARRIVAL, **{name: COLUMNS[of] for name, of in SHARES.items()}}
"""Requirement -> column of a row that has its value."""


FINAL = tuple(f'final_{name}' for name in ('x_m', 'y_m', 'z_m', 'vx_m_s', 'vy_m_s', 'vz_m_s'))
"""Columns of the final state."""

LEVEL = 'disturbance_level_n'
"""Largest |disturbance| of an axis of a flight."""


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


class Asked(NamedTuple):
    """What requirements ask of the axes together.

    hold : tick after which the extremes of the norms are kept
    arrival_m : error that counts as arrived, of each axis or, without `by_axis`, of the norm
    port : what counts as contact, and where a path may be before it
    dt_ns : length of a tick
    """

    hold: int
    arrival_m: float
    by_axis: bool
    port: Port
    dt_ns: int


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
def axis_sums(
    states: Any, goal: Any, forces: Any, axis: int, windows: Windows, first_slew: int
) -> AxisSums:
    """Count one axis of a flight: states (N+1, 6), applied forces (N, 3), N = `horizon`.

    goal : (6,), errors are states less it
    first_slew : the first tick whose change of force is counted
    """
    energy = effort = step = position = velocity = largest = outside = before = 0.0
    for tick in range(windows.horizon):
        force, r = forces[tick][axis], states[tick + 1][axis] - goal[axis]
        if tick < windows.ticks:
            energy = with_square(energy, force)
            effort += abs(force)
            step = larger(step, force - before) if tick >= first_slew else step
            before = force
            outside = last_outside(outside, tick, r, windows.arrival_m)
        if tick >= windows.horizon - windows.late:
            v = states[tick + 1][3 + axis] - goal[3 + axis]
            position, velocity, largest = (
                larger(position, r), larger(velocity, v), larger(largest, force)
            )  # fmt: skip
    return AxisSums(energy, effort, step, position, velocity, largest, outside)


@kernel
def count_together(states: Any, goal: Any, asked: Asked, row: Any) -> bool:
    """Count what is required of the axes together; the columns of a row from `FINAL_POSITION` on.

    Return whether all states are finite.

    states : (N+1, 6); goal : (6,), errors are states less it
    """
    port, hold_distance, hold_speed, depth, outside, contact = asked.port, 0.0, 0.0, 0.0, 0, -1
    closing, lateral, finite = inf, inf, True
    for tick in range(len(states)):
        s = states[tick]
        x, y, z = s[0] - goal[0], s[1] - goal[1], s[2] - goal[2]
        vx, vy, vz = s[3] - goal[3], s[4] - goal[4], s[5] - goal[5]
        finite = finite and isfinite(x + y + z + vx + vy + vz)
        position, distance = max(abs(x), abs(y), abs(z)), norm(x, y, z)
        velocity, speed = max(abs(vx), abs(vy), abs(vz)), norm(vx, vy, vz)
        if tick > asked.hold:
            hold_distance = larger(hold_distance, distance)
            hold_speed = larger(hold_speed, speed)
        if (position if asked.by_axis else distance) > asked.arrival_m:
            outside = tick
        if contact < 0 and touches(x, y, z, port):
            contact = tick
            closing, lateral = contact_speeds(x, y, z, vx, vy, vz, port)
        elif contact < 0:
            depth = larger(depth, depth_m(x, y, z, port))
    row[FINAL_POSITION], row[FINAL_DISTANCE] = position, distance
    row[FINAL_VELOCITY], row[FINAL_SPEED] = velocity, speed
    row[HOLD_DISTANCE], row[HOLD_SPEED] = hold_distance, hold_speed
    arrived = outside < len(states) - 1
    row[REQUIRED_ARRIVAL] = outside * asked.dt_ns / NANOSECONDS if arrived else inf
    row[CONTACT] = contact
    row[CLOSING], row[LATERAL], row[DEPTH] = closing, lateral, depth
    return finite


@kernel
def count(
    states: Any,
    goal: Any,
    forces: Any,
    windows: Windows,
    asked: Asked,
    first_slew: int,
    dt: float,
    mass: float,
    row: Any,
) -> None:
    """Fill a row, the columns of `VALUES`, of a flight; NaN where a number is not finite.

    See `axis_sums`, `count_together`.
    """
    distances = speeds = 0.0
    for tick in range(windows.ticks - windows.tail + 1, windows.ticks + 1):
        s = states[tick]
        distances += norm(s[0] - goal[0], s[1] - goal[1], s[2] - goal[2])
        speeds += norm(s[3] - goal[3], s[4] - goal[4], s[5] - goal[5])
    x = axis_sums(states, goal, forces, 0, windows, first_slew)
    y = axis_sums(states, goal, forces, 1, windows, first_slew)
    z = axis_sums(states, goal, forces, 2, windows, first_slew)
    fill_row(row, x, y, z, distances, speeds, windows.tail, dt, mass)
    if not (count_together(states, goal, asked, row) and isfinite(row[ENERGY])):
        for i in range(COUNTED):
            row[i] = nan


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


def asked_of(scenario: Scenario) -> Asked:
    """Return what the requirements of a scenario ask of the axes together."""
    required = scenario.requirements
    port = port_of(required, scenario.goal_position_m)
    if required is None:
        return Asked(0, 0.0, False, port, scenario.dt_ns)
    axis_m, norm_m = required.arrival_error_per_axis_m, required.arrival_error_norm_m
    by_axis = axis_m is not None
    within_m = (axis_m if by_axis else norm_m) or 0.0
    return Asked(hold_tick(scenario) or 0, within_m, by_axis, port, scenario.dt_ns)


def counts_of(flight: Flight, windows: Windows | None = None) -> list[float]:
    """Return the numbers of a flight, the columns of `VALUES`; NaN where a state is not finite.

    Positions are errors, relative to the goal of the scenario. Angles are those that requirements
    limit, else NaN; what thrusters spent is NaN where they have neither pulses nor propellant.
    """
    scenario, required = flight.scenario, flight.scenario.requirements
    row = as_table(np.empty(COUNTED))
    count(
        as_view(flight.seen),
        scenario.goal_state,
        as_view(flight.saturated_forces_n),
        windows or windows_of(scenario),
        asked_of(scenario),
        first_slew_tick(scenario),
        scenario.dt_s,
        scenario.mass_kg,
        row,
    )
    angles: tuple[float, ...] = (nan,) * len(ATTITUDES)
    spent: tuple[float, ...] = (nan,) * len(THRUST)
    if required is not None and not required.limits.keys().isdisjoint(ATTITUDES):
        angles = angles_of(flight, row[CONTACT])
    if spends(scenario):
        spent = flight.thrust[2:] if flight.spent is None else flight.spent
    return [*map(float, row), *angles, *map(float, spent)]


def angles_of(flight: Flight, contact_tick: float) -> tuple[float, ...]:
    """Return how far the chaser is off its docked attitude at contact, and how fast it turns.

    Infinite without a contact, `contact_tick` -1; NaN where no attitude is known.
    """
    scenario, signals = flight.scenario, flight.signals
    if CHASER_ATTITUDE not in signals or not contact_tick >= 0:
        return (inf if CHASER_ATTITUDE in signals else nan,) * len(ATTITUDES)
    still, tick = synchronised(scenario.mean_motion_rad_s), int(contact_tick)
    target: Any = signals['target_attitude'][tick].tolist() if scenario.target else still
    chaser: Any = signals[CHASER_ATTITUDE][tick].tolist()
    mate = getattr(scenario.named('pointing'), 'mate', ALIGNED[:4])
    return contact_turn(tuple(chaser), tuple(target), mate)


def row_of(flight: Flight, windows: Windows | None = None) -> NDArray[np.float64]:
    """Return the metrics of a flight, the columns of `UNITS`; see `counts_of`."""
    return np.array(counts_of(flight, windows)[: len(UNITS)])


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

    Per axis: the largest absolute value of any axis. The duty of thrusters is the mean of |f| over
    ticks and axes, as a share of the largest force: of the time, if they only switch on and off. Of
    a flight that docks, nothing that comes after the contact is shown as where it arrives or ends.
    """
    duty = float(np.abs(flight.saturated_forces_n).mean()) / flight.scenario.max_force_n
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
        Figure('thruster duty (mean of the axes)', '', duty),
        Figure('slew per axis', 'N/s', float(row[SLEW])),
        when,
        Figure('largest closing speed', 'm/s', float(closing.max())),
        Figure(f'position error per axis, {place}', 'm', max(map(abs, error))),
        Figure(f'position error (norm), {place}', 'm', norm(*error)),
        Figure(f'speed (norm), {place}', 'm/s', norm(*speed)),
        *rate,
        *_of_valves(flight),
    ]


def spends(scenario: Scenario) -> bool:
    """Return whether the thrusters of a scenario have pulses or propellant."""
    thrusters = scenario.thrusters
    return thrusters is not None and (thrusters.fires or thrusters.propellant is not None)


def _of_valves(flight: Flight) -> list[Figure]:
    """Return what the thrusters of a flight spent, where its scenario has pulses or propellant."""
    thrusters = flight.scenario.thrusters
    if thrusters is None or not spends(flight.scenario):
        return []
    spent = flight.thrust
    figures = [Figure('Δv of the thrusters, waste included', 'm/s', spent.delta_v_m_s)]
    if thrusters.propellant:
        figures.append(Figure('propellant', 'kg', spent.propellant_kg))
    if thrusters.fires:
        figures.append(Figure('openings of the valves', '', float(spent.openings)))
    return figures
