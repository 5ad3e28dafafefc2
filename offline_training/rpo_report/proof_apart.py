# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of a proof of axes apart: what they reach, and the unknown constants by margin."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rpo_core.world.disturbance import Harmonic
from rpo_log.show import style
from rpo_proof.cells import Found
from rpo_proof.problem import APART, Problem
from rpo_report import plane
from rpo_report.blocks import Picture

_BEFORE_S = 50.0
"""The second row of pictures begins so long before the time of hold."""


def pictures_of(problem: Problem, groups: Mapping[str, Found]) -> list[Picture]:
    """Return the pictures; groups : in the order in which they are proven."""
    return [_reach(problem, groups), *_constants(problem, groups)]


def _reach(problem: Problem, groups: Mapping[str, Found]) -> Picture:
    """Return the position that no flight leaves, over time, and near the target."""
    limit, dt = problem.hold_error_m, problem.scenario.dt_s
    hold_s = problem.hold_tick * dt
    figure, rows = style.new_panels(5.6, 2, 3)
    for column, group in enumerate(sorted(groups)):
        axis = APART[group][0]
        reach = groups[group].reach[:, :, 0]
        low, high = np.where(np.isfinite(reach), reach, np.nan)
        times = dt * np.arange(len(low))
        for axes in rows[:, column]:
            axes.fill_between(times, low, high, color=style.AXES[axis], linewidth=0.0)
            for side in (-limit, limit):
                axes.plot([hold_s, times[-1]], [side, side], **style.LIMIT)
        near = rows[1, column]
        near.set(xlabel='time [s]', xlim=(max(0.0, hold_s - _BEFORE_S), times[-1]))
        near.set(ylim=(-3.0 * limit, 3.0 * limit))
        rows[0, column].set(title=style.AXIS_NAMES[axis])
    for axes in rows[:, 0]:
        axes.set_ylabel('position [m]')
    return Picture(
        'reach',
        figure,
        'No flight leaves the bands, whatever its start, disturbance and mass. Below: near the '
        'target, with the limit of the error.',
        'Bands of position over time, of each axis.',
    )


def _constants(problem: Problem, groups: Mapping[str, Found]) -> list[Picture]:
    """Return the planes of cosine and sine of each axis's harmonic, by bound of the error."""
    planes, names = [], []
    for group in sorted(groups):
        place = _place(problem, group)
        found = groups[group].flown
        if place is None or not len(found.values):
            continue
        chosen = slice(place, place + 2)
        low, high = (found.centre - found.half)[:, chosen], (found.centre + found.half)[:, chosen]
        a = plane.points(0.0, 1.0)
        shares = found.column('hold_error_m') / problem.hold_error_m
        planes.append((a, a, plane.greatest(a, a, low, high, shares).T))
        names.append(style.AXIS_NAMES[APART[group][0]])
    if not planes:
        return []
    figure, (every,) = style.new_panels(3.4, 1, len(planes), squeeze=False)
    plane.draw(figure, every, planes)
    for axes, name in zip(every, names, strict=True):
        axes.set(title=name, xlabel='share of the cosine')
    every[0].set_ylabel('share of the sine')
    return [
        Picture(
            'constants',
            figure,
            'The harmonic of each axis: a cos ωt + b sin ωt, within the unit circle of (a, b). The '
            'greatest bound of the error of any cell, whatever the start, offset and mass.',
            'Planes of unknown constants, coloured by bound beside limit.',
        )
    ]


def _place(problem: Problem, group: str) -> int | None:
    """Return which number of a cell is the first constant of a harmonic; None: there is none."""
    waves = problem.waves(APART[group][0])
    kinds = [isinstance(wave, Harmonic) for wave in waves]
    return len(APART[group]) + kinds.index(True) if any(kinds) else None
