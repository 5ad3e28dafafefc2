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
from rpo_log.reader import controller_of, read_flight
from rpo_log.run import CONTROLLER
from rpo_log.stream import RunReader

AXIS_NAMES = ('x (R-bar)', 'y (V-bar)', 'z (H-bar)')
AXIS_COLOURS = ('#0072B2', '#D55E00', '#009E73')
"""Okabe and Ito's blue, vermilion and green: told apart by colour-blind readers too."""

PICTURE = 'time_histories.png'

CLOSE_UP_S = metrics.CLAIM_WINDOW_S
"""The picture shows the last part of a flight a second time, close up."""

PAPER = "the paper's claims"
EXAMPLE = "the paper's training example (another start)"
TRAINING = 'conditions of training'

Row = tuple[str, str, str, str]
"""Figure, flown, limit, verdict."""


def show(run: Path) -> Path | None:
    """Print the table of a run, draw its picture into `report/`; return the picture's path.

    Raises LogError if the log is not that of a whole flight.
    """
    flight, reader = read_flight(run), RunReader(run)
    title = flight.scenario.name
    if CONTROLLER in reader.attachments:
        title += f', controller {controller_of(reader).name}'
    print_table(flight, title)
    return draw(flight, (run if run.is_dir() else run.parent) / 'report', title)


def rows(flight: Flight) -> dict[str, list[Row]]:
    """Return the table by sections: the paper's claims that apply, the conditions of training."""
    figures = metrics.assess(flight)
    met = figures.conditions
    limits = [
        ('mean speed, last 30 s', 'm/s', figures.arrival_speed_m_s, metrics.MAX_ARRIVAL_SPEED_M_S),
        ('largest |df/dt|', 'N/s', figures.slew_n_s, metrics.MAX_SLEW_N_S),
        (
            'mean distance, last 30 s',
            'm',
            figures.arrival_distance_m,
            metrics.MAX_ARRIVAL_DISTANCE_M,
        ),
    ]
    disturbed = not flight.scenario.disturbance.is_zero
    return {
        PAPER if disturbed else EXAMPLE: [
            _row(
                claim.statement,
                claim.unit,
                claim.flown,
                claim.paper,
                claim.holds if disturbed else None,
            )
            for claim in metrics.claims(flight)
        ],
        TRAINING: [
            *(_row(*limit, holds) for limit, holds in zip(limits, met, strict=True)),
            ('energy J', f'{figures.energy_n2s:.4g} N²s', '', ''),
        ],
    }


def _row(name: str, unit: str, flown: float, limit: float, holds: bool | None) -> Row:
    verdict = {True: 'holds', False: 'MISSED', None: ''}[holds]
    return name, f'{flown:.3g} {unit}', f'≤ {limit:.3g} {unit}', verdict


def print_table(flight: Flight, title: str) -> None:
    """Print the figures as a table; in plain text where rich is not installed."""
    sections = rows(flight)
    if importlib.util.find_spec('rich') is None:
        print(title)
        for section, lines in sections.items():
            print(f' {section}')
            for name, flown, limit, verdict in lines:
                print(f'  {name:<34}{flown:>16}{limit:>16}  {verdict}')
        return
    from rich.console import Console
    from rich.table import Table

    table = Table('figure', 'flown', 'limit', 'verdict', title=title, title_justify='left')
    for section, lines in sections.items():
        table.add_row(f'[bold]{section}[/]')
        for name, flown, limit, verdict in lines:
            style = {'holds': 'green', 'MISSED': 'bold red'}.get(verdict, 'none')
            table.add_row(f'  {name}', flown, limit, f'[{style}]{verdict}[/]')
        table.add_section()
    Console(highlight=False).print(table)


def draw(flight: Flight, folder: Path, title: str) -> Path | None:
    """Write the time histories of position, velocity and force, as in the paper's test figure.

    The right column is the last part close up, with the limits that the paper claims.
    Returns the picture's path, or None where matplotlib is not installed.
    """
    if importlib.util.find_spec('matplotlib') is None:
        return None
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    times, level = flight.scenario.times_s, metrics.disturbance_level_n(flight)
    disturbed = level > 0.0
    figure = Figure(figsize=(11.0, 8.0), layout='constrained')
    FigureCanvasAgg(figure)
    panels = figure.subplots(3, 2, sharex='col', width_ratios=(3, 2))
    limits = [claim.paper if disturbed else None for claim in metrics.claims(flight)] + [None]
    for (wide, close), values, label, limit, name in zip(
        panels,
        (flight.positions_m, flight.velocities_m_s, flight.applied_forces_n),
        ('relative position [m]', 'relative velocity [m/s]', 'control force [N]'),
        limits[:3],
        ("the paper's claim", "the paper's claim", 'level of the disturbance'),
        strict=True,
    ):
        last = metrics.window_ticks(flight.scenario, CLOSE_UP_S)
        _panel(wide, times[: len(values)], values, label)
        _panel(close, times[: len(values)][-last:], values[-last:])
        if limit is not None:
            _limit(close, limit, name)
    if disturbed:
        _limit(panels[2][0], level, 'level of the disturbance')
    panels[0][0].legend(loc='upper right', fontsize='small')
    panels[0][0].set_title('whole flight')
    panels[0][1].set_title(f'last {min(CLOSE_UP_S, flight.scenario.duration_s):g} s')
    for axes in panels[2]:
        axes.set_xlabel('time [s]')
    figure.suptitle(title)
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / PICTURE
    figure.savefig(path, dpi=120)
    return path


def _panel(axes: Any, times: np.ndarray, values: np.ndarray, label: str = '') -> None:
    for name, colour, column in zip(AXIS_NAMES, AXIS_COLOURS, values.T, strict=True):
        axes.plot(times, column, color=colour, linewidth=1.4, label=name)
    axes.axhline(0.0, color='0.8', linewidth=0.8, zorder=0)
    axes.set_ylabel(label)
    axes.grid(color='0.92')
    axes.margins(x=0.01)


def _limit(axes: Any, value: float, name: str) -> None:
    for sign in (-1.0, 1.0):
        axes.axhline(
            sign * value,
            color='0.3',
            linestyle='--',
            linewidth=1.0,
            label=name if sign > 0 else None,
        )
    handles, labels = axes.get_legend_handles_labels()
    axes.legend(handles[-1:], labels[-1:], loc='upper right', fontsize='small')
