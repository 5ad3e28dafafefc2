# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Where a path may be: out of a sphere about the target, or in the cone that leads through it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rpo_core.judge.zones import along_and_across, beside_m
from rpo_guidance.guidance import CONE_SHARE
from rpo_guidance.plan import Guidance

Floats = NDArray[np.float64]

SIDES = 16
"""Planes of the pyramid about the cone, or in it."""


class KeepOut(NamedTuple):
    """A sphere, and a cone through it.

    radius_m : 0: none
    port_m, axis : (3,) tip of the cone, unit vector outward
    slope : tangent of its half angle; 0: none
    """

    radius_m: float
    port_m: Floats
    axis: Floats
    slope: float

    @classmethod
    def of(cls, settings: Guidance, margins: bool) -> KeepOut:
        """Return the zones of a plan; with `margins` as transfers keep to them."""
        corridor, radius, slope = settings.corridor, settings.keep_out_m, 0.0
        if radius and corridor.from_m:
            slope = corridor.slope * (CONE_SHARE if margins else 1.0)
        if radius and margins:
            radius += settings.margin_m
        return cls(radius, np.array(settings.port_m), np.array(corridor.ahead), slope)

    def depth_m(self, positions: Floats) -> Floats:
        """Return how far (n,) [m] positions (n, 3) lie inside the sphere and beside the cone."""
        depth: Floats = self.radius_m - np.linalg.norm(positions, axis=1)
        return np.minimum(depth, self.beside_m(positions)) if self.slope else depth

    def beside_m(self, positions: Floats) -> Floats:
        """Return how far (n,) [m] positions (n, 3) lie beside the cone, across its axis."""
        along, across = along_and_across(positions.T, self.port_m, self.axis)
        beside: Floats = beside_m(along, np.linalg.norm(across, axis=0), 0.0, self.slope)
        return beside

    def pyramid(self, share: float = 1.0) -> tuple[Floats, Floats]:
        """Return planes n . r >= b, (SIDES, 3) and (SIDES,), that touch a cone of such a slope."""
        turned = np.cross(self.axis, np.eye(3)[int(np.abs(self.axis).argmin())])
        turned /= np.linalg.norm(turned)
        angles = np.arange(SIDES)[:, None] * (2.0 * np.pi / SIDES)
        outward = np.cos(angles) * turned + np.sin(angles) * np.cross(self.axis, turned)
        normals = share * self.slope * self.axis - outward
        return normals, normals @ self.port_m
