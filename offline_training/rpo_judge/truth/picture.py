# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The error of the linear plant as a picture: over time, and over distance."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from rpo_judge.truth.two_body import AXIS_NAMES, Comparison
from rpo_log.show import style


def draw(found: Comparison, path: Path) -> None:
    """Write the picture; matplotlib must be there."""
    with style.applied():
        figure, (left, right) = style.new_panels(4.2, 1, 2)
        _over_time(left, found)
        _over_distance(right, found)
        figure.suptitle(found.title)
        figure.savefig(path)


def _over_time(axes: Any, found: Comparison) -> None:
    times, colours = found.scenario.times_s[1:], (style.LIGHT['ink'], style.LIGHT['y'])
    for (name, errors), colour, line in zip(
        found.errors.items(), colours, ('-', '--'), strict=False
    ):
        norms = np.linalg.norm(errors[1:, :3], axis=1)
        axes.plot(times, norms, line, color=colour, label=name)
    style.log_scale(axes)
    axes.set(xlabel='time [s]', ylabel=f'|{found.plant} − true position| [m]', title='the flight')
    axes.legend(loc='lower right')


def _over_distance(axes: Any, found: Comparison) -> None:
    distances = np.array([g.distance_m for g in found.growth])
    for axis, (colour, line) in enumerate(zip(style.AXES, ('o-', 'o-', 's--'), strict=True)):
        errors = np.array([g.position_m[axis] for g in found.growth])
        axes.plot(
            distances, errors, line, color=colour, label=f'along {AXIS_NAMES[axis]}', markersize=4
        )
    style.log_scale(axes, x=True)
    axes.set(
        xlabel='distance at the start [m]',
        ylabel='|linear − true position| [m]',
        title=f'free drift from rest, after {found.scenario.duration_s:g} s',
    )
    axes.legend(loc='lower right')
