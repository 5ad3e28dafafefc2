# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The control surface: the force over the two inputs, in units."""

from __future__ import annotations

from typing import Any

import numpy as np

from rpo_core import surface
from rpo_core.controller import FuzzyController
from rpo_log import style

_POINTS = 141


def draw_force(
    axes: Any, controller: FuzzyController, spans: tuple[float, float], sign: float = -1.0
) -> Any:
    """Draw the force [N] over +- spans of position [m] and velocity [m/s]; return the contours.

    sign : -1 over position and velocity, +1 over their errors
    """
    from matplotlib.colors import ListedColormap

    position_scale, velocity_scale, force_scale = controller.scales
    r, v = (np.linspace(-span, span, _POINTS) for span in spans)
    e, w = np.meshgrid(
        np.clip(sign * r / position_scale, -1.0, 1.0), np.clip(sign * v / velocity_scale, -1.0, 1.0)
    )
    force = force_scale * surface.values(controller.system, e.ravel(), w.ravel()).reshape(e.shape)
    peak = _peak_n(controller)
    levels = np.linspace(-peak, peak, style.SHADES + 1)
    image = axes.contourf(r, v, force, levels, cmap=ListedColormap(style.SCALE), extend='neither')
    image.set_edgecolor('face')  # closes the hairlines between neighbouring shades
    image.set_linewidth(0.4)
    axes.grid(False)
    return image


def _peak_n(controller: FuzzyController) -> float:
    """Return the largest |force| of the surface on a coarse grid that has its corners."""
    e, v = np.meshgrid(np.linspace(-1.0, 1.0, 41), np.linspace(-1.0, 1.0, 41))
    return controller.force_scale_n * float(
        np.abs(surface.values(controller.system, e.ravel(), v.ravel())).max()
    )


def force_bar(figure: Any, image: Any, axes: Any) -> None:
    """Draw the scale of forces beside some axes."""
    from matplotlib.ticker import MaxNLocator

    bar = figure.colorbar(image, ax=axes, label='force [N]', ticks=MaxNLocator(7, symmetric=True))
    bar.ax.grid(False)
    bar.outline.set_edgecolor(style.LIGHT['muted'])
