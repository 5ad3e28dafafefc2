# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A plan as a picture: the reference in the plane of the orbit and beside it, and the zones."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rpo_guidance.plan import Guidance
from rpo_guidance.rehearsal import Checked
from rpo_judge.evaluation.plan_bound import Bound
from rpo_log.show import style
from rpo_montecarlo import outputs
from rpo_report.run_plots import Drawn, draw_zones


def draw(found: Checked, bound: Bound, settings: Guidance, path: Path) -> None:
    """Write the picture; matplotlib must be there."""
    with style.applied():
        figure, (left, right) = style.new_panels(5.0, 1, 2)
        states = np.array(found.references)
        for axes, (across, label) in zip(
            (left, right), ((0, 'x, R-bar [m]'), (2, 'z, H-bar [m]')), strict=True
        ):
            draw_zones(axes, Drawn([settings.zones(None)]), across)
            axes.plot(
                bound.positions_m[:, 1], bound.positions_m[:, across], '--',
                color=style.LIGHT['y'], label='best path found',
            )  # fmt: skip
            axes.plot(states[:, 1], states[:, across], color=style.LIGHT['ink'], label='plan')
            for change in found.changes:
                axes.plot(*states[change.tick, [1, across]], 'o', color=style.LIGHT['ink'])
            axes.set(xlabel='y, V-bar [m]', ylabel=label)
            axes.set_aspect('equal', adjustable='datalim')
        left.legend(loc='best')
        figure.suptitle(f'J = {bound.plan:.3f} N²s; best path found {bound.best:.3f} N²s')
        with outputs.writing(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            figure.savefig(path)
