# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What a run shows a person: metrics beside the paper's claims, and the three time histories.

The table is drawn by rich and the picture by matplotlib; neither is needed to fly.
"""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any

from rpo_core import metrics
from rpo_core.flight import Flight
from rpo_core.validation import printable
from rpo_log.format.run import CONTROLLER
from rpo_log.read.run_log import RunLog, controller_of, flight_of, read_run, scenario_of
from rpo_log.show import style

PICTURE = 'time_histories.png'

CLOSE_UP_S = metrics.CLAIM_WINDOW_S
"""The picture shows the last part of a flight a second time, close up."""

_LIMIT = 'limit (paper)'

PAPER = "the paper's claims"
EXAMPLE = "the paper's training example (another start)"
TRAINING = 'conditions of training'

COLUMNS = ('metric', 'value', 'limit', 'verdict')
TableLine = tuple[str, str, str, str]


def show(run: Path) -> Path | None:
    """Print the table of a run, draw its picture into `report/`; return the picture's path.

    Raises LogError if the log is not that of a whole flight.
    """
    log = read_run(run)
    flight, title = flight_of(log), title_of(log)
    print_table(flight, title)
    return draw(flight, folder_of(run), title)


def title_of(log: RunLog) -> str:
    """Return the names of the scenario and of the controller."""
    title = scenario_of(log).name
    if CONTROLLER in log.attachments:
        title += f', controller {controller_of(log).name}'
    return title


def folder_of(run: Path) -> Path:
    """Return where the report of a run folder or .mcap file goes."""
    return (run if run.is_dir() else run.parent) / 'report'


def rows(flight: Flight) -> dict[str, list[TableLine]]:
    """Return the table by sections: the paper's claims that apply, the conditions of training."""
    found = metrics.of_flight(flight)
    met, most_m = found.conditions, metrics.MAX_ARRIVAL_DISTANCE_M
    limits = [
        ('mean speed, last 30 s', 'm/s', metrics.MAX_ARRIVAL_SPEED_M_S, found.arrival_speed_m_s),
        ('largest |df/dt|', 'N/s', metrics.MAX_SLEW_N_S, found.slew_n_s),
        ('mean distance, last 30 s', 'm', most_m, found.arrival_distance_m),
    ]
    disturbed = not flight.scenario.disturbance.is_zero
    return {
        PAPER if disturbed else EXAMPLE: [
            _row(*claim, claim.holds if disturbed else None) for claim in metrics.claims(flight)
        ],
        TRAINING: [
            *(_row(*limit, holds) for limit, holds in zip(limits, met, strict=True)),
            ('energy J', f'{found.energy_n2s:.4g} N²s', '', ''),
        ],
    }


def _row(name: str, unit: str, limit: float, value: float, holds: bool | None) -> TableLine:
    verdict = {True: 'holds', False: 'MISSED', None: ''}[holds]
    return name, f'{value:.3g} {unit}', f'≤ {limit:.3g} {unit}', verdict


def print_table(flight: Flight, title: str) -> None:
    """Print the metrics as a table; in plain text where rich is not installed."""
    sections = rows(flight)
    if importlib.util.find_spec('rich') is None:
        print(printable(title))
        for section, lines in sections.items():
            print(f' {section}')
            for name, value, limit, verdict in lines:
                print(f'  {name:<34}{value:>16}{limit:>16}  {verdict}')
        return
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(*COLUMNS, title=Text(printable(title)), title_justify='left')
    for section, lines in sections.items():
        table.add_row(f'[bold]{section}[/]')
        for name, value, limit, verdict in lines:
            colour = {'holds': 'green', 'MISSED': 'bold red'}.get(verdict, 'none')
            table.add_row(f'  {name}', value, limit, f'[{colour}]{verdict}[/]')
        table.add_section()
    Console(highlight=False).print(table)


def draw(flight: Flight, folder: Path, title: str) -> Path | None:
    """Draw the time histories into a folder; return the picture's path.

    None where matplotlib is not installed.
    """
    if importlib.util.find_spec('matplotlib') is None:
        return None
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / PICTURE
    with style.applied():
        figure = time_histories(flight)
        figure.suptitle(title, fontsize=11)
        figure.savefig(path)
    return path


def time_histories(flight: Flight) -> Any:
    """Return the figure of position, velocity and force, as in the paper's test figure.

    The right column is the last part close up, with the limits that the paper claims.
    """
    times, level = flight.scenario.times_s, metrics.disturbance_level_n(flight)
    disturbed, last = level > 0.0, metrics.window_ticks(flight.scenario, CLOSE_UP_S)
    figure, panels = style.new_panels(6.6, 3, 2, sharex='col', width_ratios=(3, 2))
    limits = [claim.paper for claim in metrics.claims(flight)] if disturbed else [None] * 3
    for (wide, close), values, label, limit in zip(
        panels,
        (flight.positions_m, flight.velocities_m_s, flight.saturated_forces_n),
        ('relative position [m]', 'relative velocity [m/s]', 'control force [N]'),
        limits,
        strict=True,
    ):
        by_axis(wide, times[: len(values)], values, label)
        by_axis(close, times[: len(values)][-last:], values[-last:], '')
        if limit is not None:
            limit_lines(close, limit, _LIMIT)
    if disturbed:
        limit_lines(panels[2][0], level, _LIMIT)
    panels[0][0].set_title('from the start')
    panels[0][1].set_title(f'last {min(CLOSE_UP_S, flight.scenario.duration_s):g} s')
    for axes in panels[2]:
        axes.set_xlabel('time [s]')
    style.legend_below(figure, panels[0][0], panels[2][0])
    return figure


def by_axis(axes: Any, times_s: Any, values: Any, label: str, linewidth: float = 1.5) -> None:
    """Draw the columns (n, 3) of a vector over time."""
    for name, colour, column in zip(style.AXIS_NAMES, style.AXES, values.T, strict=True):
        axes.plot(times_s, column, color=colour, label=name, linewidth=linewidth)
    axes.set_ylabel(label)
    axes.margins(x=0.01)


def limit_lines(axes: Any, value: float, name: str) -> None:
    """Draw the limits +- value."""
    for sign in (-1.0, 1.0):
        label = name if sign > 0 else None
        axes.axhline(sign * value, **style.LIMIT, zorder=3.0, label=label)
