# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A flight as a moving picture for slides; whoever has a browser is better off with the replay."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rpo_attitude.target import motion_of
from rpo_core.chain.flight import Flight
from rpo_core.files.validation import InputError
from rpo_core.judge.zones import Zone, zones_of
from rpo_log.show import style
from rpo_montecarlo.outputs import writing
from rpo_report.run_plots import axis_names, circle
from rpo_report.turned import in_lvlh

WRITERS = {'.gif': 'pillow', '.mp4': 'ffmpeg'}
FRAMES, FRAMES_PER_S = 100, 10
_SIZE_IN, _DPI = (9.6, 5.4), 100
_ARROW = 0.25
"""Length of the arrow of the largest force, beside the size of the picture."""


def check(path: Path) -> None:
    """Raise InputError if there is no way to write a video of this name."""
    from matplotlib import animation

    writer = WRITERS.get(path.suffix.lower())
    if writer is None:
        raise InputError(f'`--video` must end in {" or ".join(WRITERS)}; got {str(path)!r}')
    if not animation.writers.is_available(writer):
        raise InputError(f'`--video` needs {writer} for {path.suffix}: install it, or name a .gif')


def write(flight: Flight, title: str, verdict: str, path: Path) -> None:
    """Write a video of `FRAMES` frames: the path so far, the force, slowly turned."""
    from matplotlib import animation

    check(path)
    writer = animation.writers[WRITERS[path.suffix.lower()]](fps=FRAMES_PER_S)
    with style.applied(), writing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        figure, axes, clock = _stage(flight, title, verdict)
        x, y, z = flight.positions_m.T
        (flown,) = axes.plot([], [], [], color=style.LIGHT['x'], linewidth=2.0)
        (chaser,) = axes.plot([], [], [], 'o', color=style.LIGHT['x'], markersize=8)
        (force,) = axes.plot([], [], [], color=style.LIGHT['y'], linewidth=2.5)
        forces = forces_of(flight)
        scale = _ARROW * np.ptp(axes.get_w_lims()[:2]) / flight.scenario.max_force_n
        with writer.saving(figure, str(path), _DPI):
            for share in np.linspace(0.0, 1.0, FRAMES):
                tick = round(share * (len(x) - 2))
                flown.set_data_3d(y[: tick + 1], z[: tick + 1], x[: tick + 1])
                here = np.array([y[tick], z[tick], x[tick]])
                chaser.set_data_3d(*here[:, None])
                f = forces[tick, [1, 2, 0]]
                force.set_data_3d(*np.column_stack([here, here + scale * f]))
                clock.set_text(
                    f'{flight.scenario.times_s[tick]:.0f} s, {np.linalg.norm(here):.1f} m'
                )
                axes.view_init(elev=20.0, azim=-70.0 + 40.0 * share)
                writer.grab_frame()


def forces_of(flight: Flight) -> NDArray[np.float64]:
    """Return the forces (N, 3) [N] in the axes of the picture: of target LVLH, or the target's."""
    forces, target = in_lvlh(flight, flight.saturated_forces_n), flight.scenario.target
    if target is None:
        return forces
    turns = motion_of(target, flight.scenario).frames(len(forces))[:, :9]
    return np.asarray(np.einsum('tji,tj->ti', turns.reshape(-1, 3, 3), forces))


def _stage(flight: Flight, title: str, verdict: str) -> tuple[Any, Any, Any]:
    """Return figure, axes and clock of a video, with what does not move."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=_SIZE_IN)
    axes: Any = figure.add_axes((-0.15, -0.2, 1.3, 1.25), projection='3d')
    x, y, z = flight.positions_m.T
    axes.plot(y, z, x, color=style.LIGHT['muted'], linewidth=0.6)
    axes.plot([0.0], [0.0], [0.0], 's', color=style.LIGHT['ink'], markersize=8)
    for zone in zones_of(flight.scenario):
        _draw(axes, zone)
    axes.set_aspect('equal')
    up, along, across = (f'{name} [m]' for name in axis_names(flight.scenario))
    axes.set_xlabel(along, labelpad=14)
    axes.set_ylabel(across, labelpad=8)
    axes.set_zlabel(up.replace(' outward', ''))
    axes.locator_params(nbins=4)
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.set_pane_color((0.0, 0.0, 0.0, 0.0))
    figure.text(0.02, 0.94, title, fontsize=14.0, weight='bold')
    figure.text(0.02, 0.89, verdict, fontsize=10.0, color=style.LIGHT['muted'])
    return figure, axes, figure.text(0.98, 0.94, '', fontsize=14.0, ha='right')


def _draw(axes: Any, zone: Zone) -> None:
    for line in zone.corridor.lines() if zone.corridor is not None else ():
        x, y, z = np.array(line).T
        axes.plot(y, z, x, color=style.LIGHT['small_positive'], linewidth=0.6)
    if zone.keep_out_m:
        a, b = circle(zone.keep_out_m).T
        for turn in np.linspace(0.0, np.pi, 6, endpoint=False):
            axes.plot(a, b * np.cos(turn), b * np.sin(turn), color=style.LIGHT['z'], linewidth=0.5)
