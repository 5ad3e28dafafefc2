# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What a run shows a person: figures beside the paper's claims, and the three time histories.

The table is drawn by rich and the picture by matplotlib; neither is needed to fly.
"""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any

import numpy as np

from rpo_core import metrics
from rpo_core.closed_loop import Flight

AXIS_NAMES = ('x (R-bar)', 'y (V-bar)', 'z (H-bar)')
AXIS_COLOURS = ('#0072B2', '#D55E00', '#009E73')
"""Okabe and Ito's blue, vermillion and green: told apart by colour-blind readers too."""

PICTURE = 'time_histories.png'

Row = tuple[str, str, str, str]
"""Figure, flown, limit, verdict."""


def rows(flight: Flight) -> list[Row]:
    """Return the table: the paper's claims that apply, the conditions of training, the energy."""
    figures = metrics.assess(flight)
    speed, slew, arrival = figures.conditions
    table = [
        (
            f'paper: {claim.statement}',
            f'{claim.flown:.4g} {claim.unit}',
            f'<= {claim.paper:.4g} {claim.unit}',
            _verdict(claim.holds),
        )
        for claim in metrics.claims(flight)
    ]
    return [
        *table,
        (
            'mean speed, last 30 s',
            f'{figures.arrival_speed_m_s:.4g} m/s',
            f'<= {metrics.MAX_ARRIVAL_SPEED_M_S:g} m/s',
            _verdict(speed),
        ),
        (
            'largest |df/dt|',
            f'{figures.slew_n_s:.4g} N/s',
            f'<= {metrics.MAX_SLEW_N_S:g} N/s',
            _verdict(slew),
        ),
        (
            'mean distance, last 30 s',
            f'{figures.arrival_distance_m:.4g} m',
            f'<= {metrics.MAX_ARRIVAL_DISTANCE_M:g} m',
            _verdict(arrival),
        ),
        ('energy J', f'{figures.energy_n2s:.4g} N^2 s', '', ''),
    ]


def _verdict(holds: bool) -> str:
    return 'holds' if holds else 'MISSED'


def print_table(flight: Flight, title: str) -> None:
    """Print the figures as a table; in plain text where rich is not installed."""
    header = ('figure', 'flown', 'limit', 'verdict')
    if importlib.util.find_spec('rich') is None:
        print(title)
        for row in (header, *rows(flight)):
            print(f'  {row[0]:<38}{row[1]:>18}{row[2]:>18}  {row[3]}')
        return
    from rich.console import Console
    from rich.table import Table

    table = Table(title=title, title_justify='left')
    for name, side in zip(header, ('left', 'right', 'right', 'left'), strict=True):
        table.add_column(name, justify=side)  # type: ignore[arg-type]
    for row in rows(flight):
        style = {'holds': 'green', 'MISSED': 'bold red'}.get(row[3], '')
        table.add_row(*row[:3], f'[{style}]{row[3]}[/]' if style else row[3])
    Console().print(table)


def draw(flight: Flight, folder: Path, title: str) -> Path | None:
    """Write the time histories of position, velocity and force, as in the paper's test figure.

    Returns the picture's path, or None where matplotlib is not installed.
    """
    if importlib.util.find_spec('matplotlib') is None:
        return None
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 8.5), layout='constrained')
    FigureCanvasAgg(figure)
    panels = figure.subplots(3, 1, sharex=True)
    times = flight.scenario.times_s
    _panel(panels[0], times, flight.positions_m, 'relative position [m]')
    _panel(panels[1], times, flight.velocities_m_s, 'relative velocity [m/s]')
    _panel(panels[2], times[:-1], flight.applied_forces_n, 'control force [N]')
    level = metrics.disturbance_level_n(flight)
    if level > 0.0:
        for sign in (-1.0, 1.0):
            panels[2].axhline(
                sign * level,
                color='0.35',
                linestyle='--',
                linewidth=1.0,
                label='level of the disturbance' if sign > 0 else None,
            )
    panels[2].legend(loc='upper right', fontsize='small')
    panels[0].legend(loc='upper right', fontsize='small')
    panels[2].set_xlabel('time [s]')
    figure.suptitle(title)
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / PICTURE
    figure.savefig(path, dpi=120)
    return path


def _panel(axes: Any, times: np.ndarray, values: np.ndarray, label: str) -> None:
    for name, colour, column in zip(AXIS_NAMES, AXIS_COLOURS, values.T, strict=True):
        axes.plot(times, column, color=colour, linewidth=1.4, label=name)
    axes.axhline(0.0, color='0.8', linewidth=0.8, zorder=0)
    axes.set_ylabel(label)
    axes.grid(color='0.92')
    axes.margins(x=0.01)
