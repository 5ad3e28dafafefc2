# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What is required of the three axes of a flight together, from the states of its lanes.

`counters` counts axis by axis, and keeps no flight. For a norm over time, for a contact and for the
last state, the states of all lanes are kept (`counters.Trace`) and read three at a time: the bits
of `rpo_core.judge.verdicts`.
"""

from __future__ import annotations

from math import inf
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rpo.engine.counters import COLUMNS
from rpo.engine.lanes import compiled
from rpo_core.judge.contact import Port, contact_speeds, depth_m, port_of, touches
from rpo_core.judge.metrics import hold_tick, larger
from rpo_core.kernels.arithmetic import norm
from rpo_core.kernels.arrays import Floats
from rpo_core.scenario.requirements import ATTITUDES
from rpo_core.scenario.scenario import NANOSECONDS, Scenario

VALUES = (
    'final_error_per_axis_m',
    'final_error_norm_m',
    'final_speed_per_axis_m_s',
    'final_speed_norm_m_s',
    'hold_error_norm_m',
    'hold_speed_norm_m_s',
    'arrival_time_s',
    'contact_closing_speed_m_s',
    'contact_lateral_speed_m_s',
    'keep_out_depth_m',
    *ATTITUDES,
)
"""Requirements of the axes together, in the order of a row; arrival is that of the norm. The last
are counted in flight (`rpo.engine.parts.pointing`)."""

_FINAL_R, _FINAL_D, _FINAL_V, _FINAL_S, _HOLD_D, _HOLD_S = range(6)
_ARRIVAL, _CLOSING, _LATERAL, _DEPTH = range(6, 10)


class Judged(NamedTuple):
    """hold : tick after which norms are kept; arrival_m : norm of the error [m]; port : contact."""

    hold: int
    arrival_m: float
    port: Port


class JudgedTogether:
    """The part of a case that says what is judged of the axes together.

    base : its scenario; together : whether its rows have the columns of `VALUES` too
    """

    base: Scenario
    together: bool

    @property
    def judged(self) -> Judged | None:
        """What is judged of the axes together."""
        return judged_by(self.base) if self.together else None

    @property
    def columns(self) -> int:
        """Columns of a row."""
        return COLUMNS + (len(VALUES) if self.together else 0)


def judged_by(scenario: Scenario) -> Judged | None:
    """Return what a scenario requires of the axes together; None if nothing."""
    required = scenario.requirements
    if required is None:
        return None
    arrival_m = required.arrival_error_norm_m
    names = set(required.limits) & set(VALUES)
    if arrival_m is None:
        names.discard('arrival_time_s')  # of each axis: counted
    if not names:
        return None
    port = port_of(required, scenario.goal_position_m)
    return Judged(hold_tick(scenario) or 0, arrival_m or 0.0, port)


@compiled
def _judge(states, lanes, goal, judged, rows):  # type: ignore[no-untyped-def]
    last, port = len(states) - 1, judged.port
    touched = np.zeros(len(rows), np.bool_)
    for tick in range(last + 1):
        now = states[tick]
        for i in range(len(rows)):
            row, x, y, z = rows[i], lanes[i, 0], lanes[i, 1], lanes[i, 2]
            rx, ry, rz = now[x, 0] - goal[0], now[y, 0] - goal[1], now[z, 0] - goal[2]
            vx, vy, vz = now[x, 1], now[y, 1], now[z, 1]
            distance, speed = norm(rx, ry, rz), norm(vx, vy, vz)
            if tick > judged.hold:
                row[_HOLD_D] = larger(row[_HOLD_D], distance)
                row[_HOLD_S] = larger(row[_HOLD_S], speed)
            if distance > judged.arrival_m:
                row[_ARRIVAL] = tick
            if not touched[i]:
                if touches(rx, ry, rz, port):
                    touched[i] = True
                    row[_CLOSING], row[_LATERAL] = contact_speeds(rx, ry, rz, vx, vy, vz, port)
                else:
                    row[_DEPTH] = larger(row[_DEPTH], depth_m(rx, ry, rz, port))
            if tick == last:
                row[_FINAL_R], row[_FINAL_D] = max(abs(rx), abs(ry), abs(rz)), distance
                row[_FINAL_V], row[_FINAL_S] = max(abs(vx), abs(vy), abs(vz)), speed


def judge(states: Floats, lanes: NDArray[np.int64], scenario: Scenario, judged: Judged) -> Floats:
    """Return rows (n, len(VALUES)) of flights.

    states : (N + 1, lanes, 2) r and v, as `counters.Trace` has them
    lanes : (n, 3) the lanes x, y, z of each flight
    """
    rows = np.zeros((len(lanes), len(VALUES)))
    rows[:, [_CLOSING, _LATERAL]] = inf
    _judge(states, lanes, np.array(scenario.goal_position_m), judged, rows)
    rows[:, _ARRIVAL] = arrival_s(scenario, rows[:, _ARRIVAL])
    return rows


def arrival_s(scenario: Scenario, outside: Floats) -> Floats:
    """Return the times [s] of the last ticks outside; infinite where that is the end."""
    return np.where(outside == scenario.ticks, inf, outside * scenario.dt_ns / NANOSECONDS)
