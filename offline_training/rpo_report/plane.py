# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A plane of cells, coloured by what each of them needs of a limit."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rpo_log.show import style

Floats = NDArray[np.float64]

_POINTS = 161
_LEVELS = (0.0, 0.25, 0.5, 0.7, 0.8, 0.9, 1.0)
"""Shares of a limit; what is beyond is open, or refuted."""


def points(centre: float, half: float) -> Floats:
    """Return the places of a side of the plane."""
    return centre + half * np.linspace(-1.0, 1.0, _POINTS)


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


def draw(
    figure: Any, every: Sequence[Any], planes: Sequence[tuple[Floats, Floats, Floats]]
) -> None:
    """Draw planes, each in its axes: places along and up, and shares (up, along); one scale."""
    half = style.SHADES // 2
    colours = [*style.SCALE[half : half + len(_LEVELS) - 1], style.LIGHT['bad']]
    for axes, (along, up, values) in zip(every, planes, strict=True):
        image = axes.contourf(along, up, values, [*_LEVELS, 1e9], colors=colours)
        axes.grid(False)
        axes.set_aspect('equal')
    bar = figure.colorbar(image, ax=list(every), label='bound / limit', ticks=_LEVELS)
    bar.ax.grid(False)
