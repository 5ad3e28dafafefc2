# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A flight as a moving picture for slides; whoever has a browser is better off with the replay."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rpo_attitude.target import motion_of
from rpo_attitude.turns import docking_axis, turned
from rpo_core.chain.flight import Flight
from rpo_core.files.validation import InputError
from rpo_core.judge.zones import Zone, zones_of
from rpo_core.wire.interfaces import CHASER_ATTITUDE
from rpo_log.show import style
from rpo_montecarlo.outputs import writing
from rpo_report.run_plots import axis_names, circle
from rpo_report.turned import in_lvlh

WRITERS = {'.gif': 'pillow', '.mp4': 'ffmpeg'}
FRAMES, FRAMES_PER_S = 100, 10
_SIZE_IN, _DPI = (9.6, 5.4), 100
_ARROW = 0.25
"""Length of the arrow of the largest force, beside the size of the picture."""

_BODY, _AXIS = 0.012, 0.08
"""Half of an edge of a chaser that turns, and the length of its docking axis, beside the same."""

_CORNERS = np.array([(x, y, z) for z in (-1, 1) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))])
_EDGES = [0, 1, 2, 3, 0, 4, 5, 1, 5, 6, 2, 6, 7, 3, 7, 4]
"""A way along all edges of a cube."""


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

    writer = animation.writers[WRITERS[path.suffix.lower()]](fps=FRAMES_PER_S)
    with style.applied(), writing(path), ExitStack() as stack:
        path.parent.mkdir(parents=True, exist_ok=True)
        figure, axes, clock = _stage(flight, title, verdict)
        x, y, z = flight.positions_m.T
        (flown,) = axes.plot([], [], [], color=style.LIGHT['x'], linewidth=2.0)
        look: Any = {} if CHASER_ATTITUDE in flight.signals else {'marker': 'o', 'markersize': 8}
        (chaser,) = axes.plot([], [], [], color=style.LIGHT['x'], **look)
        (axis,) = axes.plot([], [], [], color=style.LIGHT['muted'], linewidth=1.2, linestyle='--')
        (force,) = axes.plot([], [], [], color=style.LIGHT['y'], linewidth=2.5)
        forces = forces_of(flight)
        size = np.ptp(axes.get_w_lims()[:2])
        scale = _ARROW * size / flight.scenario.max_force_n
        body = bodies_of(flight, size)
        aside = path.with_name(f'.new.{path.name}')
        stack.callback(aside.unlink, missing_ok=True)
        with writer.saving(figure, str(aside), _DPI):
            for share in np.linspace(0.0, 1.0, FRAMES):
                tick = round(share * (len(x) - 2))
                flown.set_data_3d(y[: tick + 1], z[: tick + 1], x[: tick + 1])
                here = np.array([y[tick], z[tick], x[tick]])
                edges, ahead = body(tick)
                chaser.set_data_3d(*(here[:, None] + edges.T[[1, 2, 0]]))
                axis.set_data_3d(*(here[:, None] + ahead.T[[1, 2, 0]]))
                f = forces[tick, [1, 2, 0]]
                force.set_data_3d(*np.column_stack([here, here + scale * f]))
                clock.set_text(
                    f'{flight.scenario.times_s[tick]:.0f} s, {np.linalg.norm(here):.1f} m'
                )
                axes.view_init(elev=20.0, azim=-70.0 + 40.0 * share)
                writer.grab_frame()
        aside.replace(path)


def forces_of(flight: Flight) -> NDArray[np.float64]:
    """Return the forces (N, 3) [N] in the axes of the picture: of target LVLH, or the target's."""
    forces = in_lvlh(flight, flight.saturated_forces_n)
    return np.asarray(np.einsum('tji,tj->ti', _frames(flight)[:-1], forces))


def _frames(flight: Flight) -> NDArray[np.float64]:
    """Return the axes of the picture (n, 3, 3), in columns, target LVLH."""
    scenario, count = flight.scenario, len(flight.states)
    if scenario.target is None:
        return np.broadcast_to(np.eye(3), (count, 3, 3))
    return motion_of(scenario.target, scenario).frames(count)[:, :9].reshape(-1, 3, 3)


Lines = tuple[NDArray[np.float64], NDArray[np.float64]]


def bodies_of(flight: Flight, size_m: float) -> Callable[[int], Lines]:
    """Return what draws the chaser of a tick in the axes of the picture, about its centre [m].

    Its edges (16, 3) and its docking axis (2, 3); without an attitude a point, and nothing.
    """
    attitudes = flight.signals.get(CHASER_ATTITUDE)
    if attitudes is None:
        return lambda tick: (np.zeros((1, 3)), np.empty((0, 3)))
    axis = _AXIS * size_m * np.array([(0.0, 0.0, 0.0), docking_axis(flight.scenario)])
    lines = np.vstack([_BODY * size_m * _CORNERS[_EDGES], axis])
    frames = _frames(flight)

    def drawn(tick: int) -> Lines:
        found = turned(lines, attitudes[tick, :4]) @ frames[tick]
        return found[:-2], found[-2:]

    return drawn


def _stage(flight: Flight, title: str, verdict: str) -> tuple[Any, Any, Any]:
    """Return figure, axes and clock of a video, with what does not move."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=_SIZE_IN)
    axes: Any = figure.add_axes((-0.05, 0.03, 1.1, 0.96), projection='3d')
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
