# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What is drawn around the target, and how a flight passes it: a corridor and a keep-out sphere.

They help the eye; they are no conditions of the paper or of a scenario. A cone of 10 to 15
degrees about the docking axis is usual in practice (Fehse, *Automated Rendezvous and Docking of
Spacecraft*, 2003); here it lies along the LVLH axis on which the flight starts farthest out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rpo_core.explain import AXES
from rpo_core.flight import Flight

Floats = NDArray[np.float64]

CORRIDOR_HALF_ANGLE_DEG = 15.0
KEEP_OUT_RADIUS_M = 5.0

_TURN = np.linspace(0.0, 2.0 * np.pi, 49)


@dataclass(frozen=True)
class Aids:
    """A cone with its apex in the target, and a sphere around it.

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
    def _half_width_m(self) -> float:
        return self.length_m * float(np.tan(np.deg2rad(CORRIDOR_HALF_ANGLE_DEG)))

    def corridor_edges(self, across: int, up: int) -> list[Floats]:
        """Return the edges (2, 2) of the cone in the plane of two axes; none where it is round."""
        if self.axis not in (across, up):
            return []
        ends = []
        for side in (-1.0, 1.0):
            end = np.zeros(3)
            end[self.axis] = self.sign * self.length_m
            end[up if self.axis == across else across] = side * self._half_width_m
            ends.append(end)
        return [np.array([end[[across, up]], [0.0, 0.0]]) for end in ends]

    def circle(self) -> Floats:
        """Return the sphere's outline (n, 2) in any plane through the target."""
        return KEEP_OUT_RADIUS_M * np.column_stack([np.cos(_TURN), np.sin(_TURN)])

    def cone(self) -> list[Floats]:
        """Return lines (3, n) along the cone and around its end."""
        others = [i for i in range(3) if i != self.axis]
        rim = np.zeros((3, len(_TURN)))
        rim[self.axis] = self.sign * self.length_m
        rim[others] = self._half_width_m * np.array([np.cos(_TURN), np.sin(_TURN)])
        return [rim, *(np.column_stack([np.zeros(3), rim[:, i]]) for i in range(0, 48, 6))]

    def sphere(self) -> list[Floats]:
        """Return three great circles (3, n)."""
        lines = []
        for normal in range(3):
            line = np.zeros((3, len(_TURN)))
            line[[i for i in range(3) if i != normal]] = self.circle().T
            lines.append(line)
        return lines

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
    toward = -np.vdot(flight.positions_m[entry], flight.velocities_m_s[entry]) / distance[entry]
    return [
        *found,
        (f'enters the keep-out sphere of {KEEP_OUT_RADIUS_M:g} m at', f'{times[entry]:.1f} s'),
        ('closing speed at the entry', f'{toward:.3g} m/s'),
        (
            "off the corridor's axis at the entry",
            f'{aids.off_axis_deg(flight.positions_m[where])[0]:.1f}°',
        ),
    ]
