# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""When a chaser touches the port, how fast, and how deep it was in a zone before.

Kernels of + - * / sqrt and comparisons, tick by tick: `verdicts` and the Monte Carlo engine count
with them, with the same bits.
"""

from __future__ import annotations

from math import inf
from typing import Any, NamedTuple

import numpy as np

from rpo_core.chain.flight import Flight
from rpo_core.kernels.arithmetic import Vector, norm
from rpo_core.kernels.jit import as_table, kernel
from rpo_core.scenario.requirements import Requirements
from rpo_core.scenario.scenario import Scenario
from rpo_core.world.zones import beside_kernel, tangent

LINE_OF_SIGHT = -1
"""The axis of a contact that has none: speeds are along the line of sight, and across it."""


class Port(NamedTuple):
    """What counts as contact, and where a path may be before it.

    range_m : largest distance to the goal
    axis, side : x, y, z = 0, 1, 2 and +1.0 or -1.0, from the port outward; or LINE_OF_SIGHT
    least_m_s : slower, the latches do not catch
    goal : (3,) of the port [m]
    zone_m, slope : sphere about the target, 0: none; tangent of the cone that leads to the port,
        where it is `range_m` wide to each side
    """

    range_m: float
    axis: int
    side: float
    least_m_s: float
    goal: Vector
    zone_m: float
    slope: float


def port_of(required: Requirements | None, goal: Vector) -> Port:
    """Return what requirements say of contact and zone."""
    if required is None:
        return Port(0.0, LINE_OF_SIGHT, 1.0, 0.0, goal, 0.0, 0.0)
    along = required.contact_axis or ''
    return Port(
        required.contact_range_m or 0.0,
        'xyz'.index(along[1]) if along else LINE_OF_SIGHT,
        -1.0 if along.startswith('-') else 1.0,
        required.contact_least_closing_speed_m_s or 0.0,
        goal,
        required.keep_out_m or 0.0,
        tangent(required.corridor_half_angle_deg or 0.0),
    )


@kernel
def outward(x: float, y: float, z: float, axis: int, side: float) -> float:
    """Return the component of a vector along an axis, outward."""
    return side * (x if axis == 0 else (y if axis == 1 else z))


@kernel
def across(x: float, y: float, z: float, axis: int) -> float:
    """Return the length of a vector across an axis."""
    if axis == 0:
        return norm(0.0, y, z)
    return norm(x, 0.0, z) if axis == 1 else norm(x, y, 0.0)


@kernel
def touches(x: float, y: float, z: float, port: Port) -> bool:
    """Whether an error of position [m] is contact: near the goal; with an axis, at its plane."""
    if norm(x, y, z) > port.range_m:
        return False
    return port.axis < 0 or outward(x, y, z, port.axis, port.side) <= 0.0


@kernel
def contact_speeds(
    x: float, y: float, z: float, vx: float, vy: float, vz: float, port: Port
) -> tuple[float, float]:
    """Return the closing and the lateral speed [m/s] of a contact; infinite: nothing caught.

    x, y, z : position [m] from the goal; vx, vy, vz : velocity [m/s]. Along the port's axis and
    across it; without one along the line of sight and across. At the goal itself there is no line
    of sight, and all of the speed is closing.
    """
    distance = norm(x, y, z)
    if port.axis >= 0:
        closing = -outward(vx, vy, vz, port.axis, port.side)
        lateral = across(vx, vy, vz, port.axis)
    elif distance == 0.0:
        closing, lateral = norm(vx, vy, vz), 0.0
    else:
        sx, sy, sz = x / distance, y / distance, z / distance
        along = sx * vx + sy * vy + sz * vz
        closing, lateral = -along, norm(vx - along * sx, vy - along * sy, vz - along * sz)
    if closing < port.least_m_s:
        return inf, inf
    return closing, lateral


@kernel
def depth_m(x: float, y: float, z: float, port: Port) -> float:
    """Return how deep [m] an error of position is in the zone and off the cone; 0.0 outside."""
    depth = port.zone_m - norm(x + port.goal[0], y + port.goal[1], z + port.goal[2])
    if port.axis >= 0 and port.slope > 0.0:
        along = outward(x, y, z, port.axis, port.side)
        beside = beside_kernel(along, across(x, y, z, port.axis), port.range_m, port.slope)
        depth = beside if beside < depth else depth
    return depth if depth > 0.0 else 0.0


@kernel
def first_contact(errors: Any, port: Port) -> int:
    """Return the first of errors (n, 6) that is contact; n where none is."""
    for i in range(len(errors)):
        if touches(errors[i][0], errors[i][1], errors[i][2], port):
            return i
    return len(errors)


def caught_at(errors: Any, required: Requirements | None, goal: Vector) -> int | None:
    """Return the first of errors (n, 6) at which the latches catch the chaser; None: none do.

    A zone is no longer judged from then on. Requirements that know no contact catch nothing.
    """
    if required is None or required.contact_range_m is None:
        return None
    table, port = as_table(errors), port_of(required, goal)
    tick = first_contact(table, port)
    if tick == len(errors):
        return None
    x, y, z, vx, vy, vz = table[tick]
    return None if contact_speeds(x, y, z, vx, vy, vz, port)[0] == inf else tick


class Dock(NamedTuple):
    """Where the guidance of a scenario docks.

    port_m, ahead : (3,) of the port, and unit vector outward, as the target sees them
    past_m : at its plane, no farther than this, it has docked
    """

    port_m: Vector
    ahead: Vector
    past_m: float


def dock_of(scenario: Scenario) -> Dock | None:
    """Return where the last leg of a scenario docks; None: it does not."""
    guidance: Any = scenario.named('guidance')
    past_m = getattr(guidance, 'past_port_m', 0.0)
    return Dock(guidance.port_m, guidance.corridor.ahead, past_m) if past_m else None


def docked_at(flight: Flight) -> int | None:
    """Return the first tick at which the chaser has docked; None: it never does, or shall not.

    As the requirements on contact have it; without any, as guidance does, from the true states.
    Where a flight goes on past it, that says nothing of the flight.
    """
    scenario, required = flight.scenario, flight.scenario.requirements
    if required is not None and required.contact_range_m is not None:
        return caught_at(flight.errors, required, scenario.goal_position_m)
    dock = dock_of(scenario)
    if dock is None:
        return None
    offsets = flight.positions_m - np.array(dock.port_m)
    at = (offsets @ dock.ahead <= 0.0) & (np.linalg.norm(offsets, axis=1) <= dock.past_m)
    return int(np.argmax(at)) if at.any() else None
