# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Parts of the cells of a table where the command changes fastest: bounds of slew need them.

Which cells are divided changes how sharp a bound is, never whether it holds.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rpo_core.controller import FuzzyController
from rpo_judge.analysis import surface
from rpo_proof.tables import Table, enclosed, saturated

Floats = NDArray[np.float64]
Cells = tuple[NDArray[np.intp], NDArray[np.intp]]
"""Rows and columns (k,) of cells."""

PARTS = 16
"""Parts of a divided cell, along each error."""

SHARE = 0.9
"""A cell is divided where the command may change by so much of the limit of slew."""

MOST = 512
"""Cells that are divided, at most: the steepest."""

FASTEST = 1.5
"""Velocity error at which the rates of cells without end are taken."""

DRIFT_M_S2 = 0.0035
"""Acceleration beside the control's own, which the choice of the cells assumes."""

CHANGE = 0.01
"""Change of the output in a tick, which the choice of the cells assumes."""


def divided(controller: FuzzyController, table: Table, limit_n_s: float, mass_kg: float) -> Table:
    """Return a table with its steep cells divided: limit of slew [N/s], mass [kg]."""
    rates = _rates(table, mass_kg)
    found = np.flatnonzero(rates > SHARE * limit_n_s)
    found = np.sort(found[np.argsort(-rates.ravel()[found], kind='stable')[:MOST]])
    if not len(found):
        return table
    cells = np.unravel_index(found, rates.shape)
    number = np.full(rates.shape, -1, np.int32)
    number[cells] = np.arange(len(found))
    ranges, slopes = parts_of(controller, table, (cells[0], cells[1]))
    return table._replace(steep=number, part_range=ranges, part_slopes=slopes)


def parts_of(controller: FuzzyController, table: Table, cells: Cells) -> tuple[Floats, Floats]:
    """Return ranges (k, p, p, 2) and slopes (k, p, p, 4) on the parts of some cells."""
    shape = len(cells[0]), PARTS, PARTS
    share = np.arange(PARTS + 1) / PARTS
    sides = []
    for edges, some in zip((table.e, table.w), cells, strict=True):
        at = edges[some][:, None] + np.diff(edges)[some][:, None] * share
        sides.append(np.clip(at, -1.0, 1.0))
    e, w = sides
    ends = (e[:, :-1, None], e[:, 1:, None], w[:, None, :-1], w[:, None, 1:])
    boxes = surface.Boxes(*(np.broadcast_to(end, shape).ravel() for end in ends))
    found = enclosed(controller, boxes)
    ranges = np.clip(np.stack([found.low, found.high], axis=1), -table.limit, table.limit)
    return ranges.reshape(*shape, 2), saturated(found, table.limit).reshape(*shape, 4)


def _rates(table: Table, mass_kg: float) -> Floats:
    """Return about the greatest rate (m, n) of the command in each cell [N/s]."""
    u, room = table.u, table.bend + table.slack + CHANGE
    corners = np.stack([u[:-1, :-1], u[1:, :-1], u[:-1, 1:], u[1:, 1:]])
    forces = (
        table.force_n * (corners.min(axis=0) - room),
        table.force_n * (corners.max(axis=0) + room),
    )
    fast = np.clip(table.w, -FASTEST, FASTEST) * table.velocity_m_s / table.position_m
    pulls = (
        -(DRIFT_M_S2 + forces[1] / mass_kg) / table.velocity_m_s,
        (DRIFT_M_S2 - forces[0] / mass_kg) / table.velocity_m_s,
    )
    s = table.slopes
    by_e = np.stack([s[..., k] * v for k in (0, 1) for v in (fast[:-1], fast[1:])])
    by_w = np.stack([s[..., k] * a for k in (2, 3) for a in pulls])
    rise, fall = by_e.max(axis=0) + by_w.max(axis=0), by_e.min(axis=0) + by_w.min(axis=0)
    return np.asarray(table.force_n * np.maximum(rise, -fall))
