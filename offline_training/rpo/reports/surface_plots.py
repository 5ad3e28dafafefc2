# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Planes: the control surface over its two inputs, and cells coloured by bound beside limit."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np

from rpo.analysis import surface
from rpo_core.control.controller import AnyController, FuzzyController
from rpo_core.kernels.arrays import Floats
from rpo_log.show import style

_PLANE_POINTS = 161
_LEVELS = (0.0, 0.25, 0.5, 0.7, 0.8, 0.9, 1.0)
"""Shares of a limit; what is beyond is open, or refuted."""


def points(centre: float, half: float) -> Floats:
    """Return the places of a side of the plane."""
    return centre + half * np.linspace(-1.0, 1.0, _PLANE_POINTS)


def greatest(x: Floats, y: Floats, low: Floats, high: Floats, shares: Floats) -> Floats:
    """Return the greatest share (len(x), len(y)) of the cells at each place; nan where none is.

    low, high : (k, 2) of each cell; shares : (k,)
    """
    values = np.full((len(x), len(y)), np.nan)
    first = [np.searchsorted(a, low[:, i], side='left') for i, a in ((0, x), (1, y))]
    last = [np.searchsorted(a, high[:, i], side='right') for i, a in ((0, x), (1, y))]
    for k, share in enumerate(shares):
        part = values[first[0][k] : last[0][k], first[1][k] : last[1][k]]
        np.fmax(part, share, out=part)
    return values


def is_flat(values: Floats) -> bool:
    """Return whether all shares have one colour: such a plane shows nothing."""
    shown = values[np.isfinite(values)]
    return len(np.unique(np.digitize(shown, _LEVELS))) < 2


def draw_plane(figure: Any, axes: Any, along: Floats, up: Floats, values: Floats) -> None:
    """Draw a plane in its axes: places along and up, and shares (up, along), with their scale."""
    half = style.SHADES // 2
    colours = [*style.SCALE[half : half + len(_LEVELS) - 1], style.LIGHT['bad']]
    image = axes.contourf(along, up, values, [*_LEVELS, 1e9], colors=colours)
    axes.grid(False)
    axes.set_aspect('equal')
    bar = figure.colorbar(image, ax=axes, label='bound / limit', ticks=_LEVELS)
    bar.ax.grid(False)


_POINTS = 141
_COARSE = 61
_REACH_M, _REACH_M_S = 100.0, 1.0


def draw_force(axes: Any, controller: FuzzyController, spans: tuple[float, float]) -> Any:
    """Draw the force [N] over +- spans of position [m] and velocity [m/s]; return the contours."""
    position_scale, velocity_scale, force_scale = controller.scales
    r, v = (np.linspace(-span, span, _POINTS) for span in spans)
    e, w = np.meshgrid(
        np.clip(-r / position_scale, -1.0, 1.0), np.clip(-v / velocity_scale, -1.0, 1.0)
    )
    force = force_scale * surface.values(controller.system, e.ravel(), w.ravel()).reshape(e.shape)
    # The largest of a coarse grid that has the corners of the surface.
    coarse = np.meshgrid(np.linspace(-1.0, 1.0, 41), np.linspace(-1.0, 1.0, 41))
    peak = float(np.abs(surface.values(controller.system, *map(np.ravel, coarse))).max())
    return _contours(axes, (r, v), force, force_scale * peak)


def _contours(axes: Any, grid: tuple[Floats, Floats], force: Floats, peak: float) -> Any:
    from matplotlib.colors import ListedColormap

    levels = np.linspace(-peak, peak, style.SHADES + 1)
    inside = np.clip(force, -peak, peak)  # the peak is that of a coarser grid; beyond it: holes
    image = axes.contourf(*grid, inside, levels, cmap=ListedColormap(style.SCALE), extend='neither')
    image.set_edgecolor('face')  # closes the hairlines between neighbouring shades
    image.set_linewidth(0.4)
    axes.grid(False)
    return image


def axis_forces(controller: AnyController) -> Any:
    """Return each axis's force over its position and velocity, the others at rest, at t = 0."""
    r, v = (np.linspace(-span, span, _COARSE) for span in (_REACH_M, _REACH_M_S))
    forces = np.empty((3, _COARSE, _COARSE))
    stage = controller.stage(getattr(controller, 'clock_s', None) or 1.0)
    for axis, row, column in itertools.product(range(3), range(_COARSE), range(_COARSE)):
        position, velocity = np.zeros(3), np.zeros(3)
        position[axis], velocity[axis] = r[column], v[row]
        (force,) = stage.step(0, (*position.tolist(), *velocity.tolist()))
        forces[axis, row, column] = force[axis]
    figure, panels = style.new_panels(3.9, 1, 3, sharey=True)
    peak = float(np.abs(forces).max()) or 1.0
    for axes, name, values in zip(panels, style.AXIS_NAMES, forces, strict=True):
        image = _contours(axes, (r, v), values, peak)
        axes.set(title=name, xlabel='position [m]', xticks=(-_REACH_M / 2, 0.0, _REACH_M / 2))
    panels[0].set_ylabel('velocity [m/s]')
    force_bar(figure, image, panels)
    return figure


def force_bar(figure: Any, image: Any, axes: Any) -> None:
    """Draw the scale of forces beside some axes."""
    from matplotlib.ticker import MaxNLocator

    bar = figure.colorbar(image, ax=axes, label='force [N]', ticks=MaxNLocator(7, symmetric=True))
    bar.ax.grid(False)
    bar.outline.set_edgecolor(style.LIGHT['muted'])
