# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What is drawn around the target, and how a flight passes it: a corridor and a keep-out sphere.

Those of the scenario, or else aids to the eye, which are no conditions of the paper or of a
scenario. A cone of 10 to 15 degrees about the docking axis is usual in practice (Fehse, *Automated
Rendezvous and Docking of Spacecraft*, 2003); the aid lies along the LVLH axis on which the flight
starts farthest out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rpo_core.chain.flight import Flight
from rpo_core.control.explain import AXES
from rpo_core.judge.zones import Cone, Zone

Floats = NDArray[np.float64]

CORRIDOR_HALF_ANGLE_DEG = 15.0
KEEP_OUT_RADIUS_M = 5.0

AT_PORT_M = 0.1
"""So near to the tip of the corridor the chaser is at the port, and no zone holds."""

_TURN = np.linspace(0.0, 2.0 * np.pi, 49)


def circle(radius_m: float) -> Floats:
    """Return the outline (n, 2) of a sphere about the target in any plane through it."""
    return radius_m * np.column_stack([np.cos(_TURN), np.sin(_TURN)])


def great_circles(radius_m: float) -> list[Floats]:
    """Return three great circles (3, n) of a sphere about the target."""
    lines = []
    for normal in range(3):
        line = np.zeros((3, len(_TURN)))
        line[[i for i in range(3) if i != normal]] = circle(radius_m).T
        lines.append(line)
    return lines


@dataclass(frozen=True)
class Aids:
    """A cone with its apex in the target, and a sphere around it, where a scenario has no zones.

    axis : 0, 1, 2 of LVLH; sign : the side of the target on which the cone lies
    length_m : of the cone
    """

    axis: int
    sign: float
    length_m: float

    @classmethod
    def of(cls, flight: Flight) -> Aids:
        """Return the aids of a flight."""
        start = flight.positions_m[0]
        axis = int(np.abs(start).argmax())
        return cls(axis, -1.0 if start[axis] < 0.0 else 1.0, float(np.abs(start).max()) * 1.1)

    @property
    def zones(self) -> Zone:
        """The aids as they are drawn."""
        ahead = tuple(self.sign if i == self.axis else 0.0 for i in range(3))
        slope = float(np.tan(np.deg2rad(CORRIDOR_HALF_ANGLE_DEG)))
        cone = Cone((0.0, 0.0, 0.0), ahead, slope, self.length_m)
        return Zone(KEEP_OUT_RADIUS_M, cone)

    def off_axis_deg(self, positions_m: Floats) -> Floats:
        """Return the angles (n,) between positions (n, 3) and the corridor's axis."""
        along = self.sign * positions_m[:, self.axis]
        across = np.linalg.norm(np.delete(positions_m, self.axis, axis=1), axis=1)
        return np.rad2deg(np.arctan2(across, along))


def passage(flight: Flight, aids: Aids) -> list[tuple[str, str]]:
    """Return names and values: how a flight passes the aids."""
    times, distance = flight.scenario.times_s, np.linalg.norm(flight.positions_m, axis=1)
    found = [
        ('distance at the start', f'{distance[0]:.4g} m'),
        (
            f"off the corridor's axis {AXES[aids.axis]} at the start",
            f'{aids.off_axis_deg(flight.positions_m[:1])[0]:.1f}°',
        ),
    ]
    inside = np.flatnonzero(distance <= KEEP_OUT_RADIUS_M)
    if not inside.size:
        return [*found, (f'within {KEEP_OUT_RADIUS_M:g} m of the target', 'never')]
    entry = int(inside[0])
    where = slice(entry, entry + 1)
    return [
        *found,
        (f'enters the keep-out sphere of {KEEP_OUT_RADIUS_M:g} m at', f'{times[entry]:.1f} s'),
        ('closing speed at the entry', f'{_closing_m_s(flight, entry):.3g} m/s'),
        (
            "off the corridor's axis at the entry",
            f'{aids.off_axis_deg(flight.positions_m[where])[0]:.1f}°',
        ),
    ]


def _closing_m_s(flight: Flight, tick: int) -> float:
    position, velocity = flight.positions_m[tick], flight.velocities_m_s[tick]
    range_m = np.linalg.norm(position)
    closing = np.vdot(position, velocity) / range_m if range_m else np.linalg.norm(velocity)
    return float(-closing)


def zone_passage(flight: Flight, zones: Zone) -> list[tuple[str, str]]:
    """Return names and values: how a flight passes zones of its scenario, at its ticks.

    It ends where the chaser is at the port.
    """
    until = len(flight.states)
    if zones.corridor is not None:
        away = np.linalg.norm(flight.positions_m - np.array(zones.corridor.tip_m), axis=1)
        until = int(np.argmax(away <= AT_PORT_M)) if (away <= AT_PORT_M).any() else until
    positions = [tuple(position) for position in flight.positions_m[:until].tolist()]
    distance = np.linalg.norm(flight.positions_m[:until], axis=1)
    before = ' before the port' if until < len(flight.states) else ''
    found = [(f'least distance to the target{before}', f'{distance.min():.4g} m')]
    if not zones.keep_out_m:
        return found
    name = f'the keep-out sphere of {zones.keep_out_m:g} m'
    outside = [zones.violated(position) for position in positions]
    where = ' outside the corridor' if zones.corridor is not None else ''
    broken = f'{sum(outside)} of {len(outside)}' if any(outside) else 'none'
    found.append((f'ticks in {name}{where}', broken))
    inside = np.flatnonzero(distance < zones.keep_out_m)
    if not inside.size:
        return [*found, (f'enters {name}', 'never')]
    entry = int(inside[0])
    found += [
        (f'enters {name} at', f'{flight.scenario.times_s[entry]:.1f} s'),
        ('closing speed at the entry', f'{_closing_m_s(flight, entry):.3g} m/s'),
    ]
    if zones.corridor is not None:
        room = -max(zones.corridor.outside_m(positions[tick]) for tick in inside.tolist())
        found.append(("least distance to the corridor's wall inside of it", f'{room:.3g} m'))
    return found
