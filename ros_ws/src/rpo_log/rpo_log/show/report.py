# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What a run shows a person: its metrics beside what is required, and the three time histories.

The picture is drawn by matplotlib, which is not needed to fly.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rpo_core.chain.flight import Flight
from rpo_core.files.validation import InputError, printable
from rpo_core.judge import metrics
from rpo_core.judge.similarity import hint
from rpo_core.judge.verdicts import UNBOUNDED, missed, number, unbounded, verdicts
from rpo_core.scenario.scenario import Scenario
from rpo_log.bag import open_run
from rpo_log.format.run import CONTROLLER, REPORT
from rpo_log.read.run_log import RunLog, controller_of, flight_of, read_run, scenario_of
from rpo_log.show import style

PICTURE = 'time_histories.png'

METRICS = 'metrics'
NO_REQUIREMENTS = 'no requirements in the scenario'

COLUMNS = ('metric', 'value', 'limit', 'verdict')
TableLine = tuple[str, str, str, str]


def show(run: Path, scale: str = '') -> tuple[Path | None, bool]:
    """Print the table of a run, draw its picture into `report/`.

    scale : command that scales its controller, for a hint; '': no hint

    Returns the picture's path, None without matplotlib, and whether a requirement is missed.

    Raises LogError if the log is not that of a whole flight.
    """
    log = read_run(open_run(run))
    flight, title = flight_of(log), title_of(log)
    print(printable(title))
    for name, value, limit, verdict in table(flight):
        print(printable(f' {name:<42}{value:>16}{limit:>16}  {verdict}'))
    if scale and (line := hint(flight, controller_of(log), scale)):
        print(printable(line))
    return draw(flight, folder_of(run), title), missed(flight)


def title_of(log: RunLog) -> str:
    """Return the names of the scenario and of the controller."""
    title = scenario_of(log).name
    if CONTROLLER in log.attachments:
        title += f', controller {controller_of(log).name}'
    return title


def folder_of(run: Path) -> Path:
    """Return where the report of a run folder or .mcap file goes."""
    return (run if run.is_dir() else run.parent) / REPORT


def rows(flight: Flight) -> dict[str, list[TableLine]]:
    """Return the table by sections: requirements and their verdicts, then the other metrics."""
    required = verdicts(flight)
    judged = {verdict.statement for verdict in required}
    title = f'requirements of {flight.scenario.name}' if required else NO_REQUIREMENTS
    others = [
        (statement, number(value, unit), '', '')
        for statement, unit, value in metrics.others_of(flight)
        if statement not in judged
    ]
    names = unbounded(flight.scenario) if required else []
    rest = [(name, '–', 'none', UNBOUNDED) for name in names]
    judged_rows = [
        (v.statement, number(v.value, v.unit), f'≤ {number(v.limit, v.unit)}', v.word)
        for v in required
    ]
    return {title: judged_rows + rest, METRICS: others}


def table(flight: Flight) -> list[TableLine]:
    """Return the sections of `rows` in one table, each below its title; see `COLUMNS`."""
    lines = []
    for title, section in rows(flight).items():
        lines += [(title, '', '', ''), *((f'  {row[0]}', *row[1:]) for row in section)]
    return lines


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
        style.save_figure(figure, path)
    return path


def close_up_s(scenario: Scenario) -> float:
    """Return from when a flight is drawn close up: where its requirements begin to hold [s].

    Where no requirement says from when, it is the last part.
    """
    required = scenario.requirements
    held_s = None if required is None else required.hold_from_s
    if held_s is not None and held_s < scenario.duration_s:
        return held_s
    return max(0.0, scenario.duration_s - metrics.CLAIM_WINDOW_S)


def close_up_ticks(scenario: Scenario) -> int:
    """Return how many ticks a flight is drawn close up."""
    return metrics.window_ticks(scenario, scenario.duration_s - close_up_s(scenario))


def time_histories(flight: Flight) -> Any:
    """Return the figure of position, velocity and force, as in the paper's test figure.

    The right column is the last part close up. Limits are drawn where they hold.
    """
    times, scenario = flight.scenario.times_s, flight.scenario
    begin_s, end_s = close_up_s(scenario), scenario.duration_s
    last = close_up_ticks(scenario)
    limits = {verdict.key: verdict.limit for verdict in verdicts(flight)}
    figure, panels = style.new_panels(6.6, 3, 2, sharex='col', width_ratios=(3, 2))
    rows = (
        (flight.errors[:, :3], position_label(scenario), ['hold_error_per_axis_m']),
        (flight.velocities_m_s, 'relative velocity [m/s]', ['hold_speed_per_axis_m_s']),
        (flight.saturated_forces_n, force_label(scenario),
         ['hold_force_per_axis_n', 'hold_force_per_disturbance']),
    )  # fmt: skip
    for (wide, close), (values, label, keys) in zip(panels, rows, strict=True):
        by_axis(wide, times[: len(values)], values, label, names=legend_names(scenario))
        by_axis(close, times[: len(values)][-last:], values[-last:], '')
        # From the start the limits of the other two are too small to see.
        drawn_on = (close, wide) if wide is panels[2][0] else (close,)
        for key in (key for key in keys if key in limits):
            for axes in drawn_on:
                limit_lines(axes, limits[key], 'required', (begin_s, end_s))
    panels[0][0].set_title('from the start')
    panels[0][1].set_title(f'last {last * scenario.dt_s:g} s')
    for axes in panels[2]:
        axes.set_xlabel('time [s]')
    style.legend_below(figure, panels[0][0], panels[2][0])
    return figure


_STYLES = ('-', '--', ':', '-.')
"""Lines of flights that are drawn over each other."""


def drawn_over(flight: Flight, ax: Any, label: str) -> Any:
    """Draw position, velocity and force over time, over the flights that are there already.

    ax : three Axes; None: those of a new figure; one: it gets the distance from the goal
    """
    from matplotlib import pyplot
    from matplotlib.lines import Line2D

    times, scenario = flight.scenario.times_s, flight.scenario
    if ax is not None and hasattr(ax, 'plot'):
        ax.plot(times, np.linalg.norm(flight.errors[:, :3], axis=1), label=label)
        ax.set(xlabel='time [s]', ylabel='distance from the goal [m]')
        ax.legend()
        return ax
    with style.applied():
        if ax is None:
            size = (style.WIDTH_IN, 6.6)
            ax = pyplot.subplots(3, sharex=True, figsize=size, layout='constrained')[1]
        if not all(hasattr(each, 'plot') for each in np.atleast_1d(ax)) or np.size(ax) != 3:
            raise InputError(f'`ax` must be one Axes, or three of them; got {ax!r:.60}')
        line = _STYLES[len(ax[0].lines) // 3 % len(_STYLES)]
        rows = (
            (flight.errors[:, :3], position_label(scenario)),
            (flight.velocities_m_s, 'velocity [m/s]'),
            (flight.saturated_forces_n, force_label(scenario)),
        )
        for axes, (values, name) in zip(ax, rows, strict=True):
            by_axis(axes, times[: len(values)], values, name, linestyle=line, gid=label)
        ax[2].set_xlabel('time [s]')
        shown = [
            Line2D([], [], color=colour, label=name)
            for colour, name in zip(style.AXES, legend_names(scenario), strict=True)
        ]
        shown += [
            Line2D([], [], color=style.LIMIT['color'], linestyle=each.get_linestyle(), label=gid)
            for each in ax[0].lines[::3]
            if (gid := each.get_gid())
        ]
        ax[0].legend(handles=shown)
    return ax


def turns(scenario: Scenario) -> bool:
    """Return whether chaser or target have axes of their own, which turn."""
    return scenario.target is not None or scenario.attitude is not None


def legend_names(scenario: Scenario) -> tuple[str, ...]:
    """Return the names of the axes of a vector that may be in those."""
    return ('x', 'y', 'z') if turns(scenario) else style.AXIS_NAMES


def position_label(scenario: Scenario) -> str:
    """Return the label of positions relative to the goal."""
    place = 'relative position [m]' if scenario.goal is None else 'position from the goal [m]'
    return place if scenario.target is None else place.replace('[m]', "[m],\nthe target's axes")


def force_label(scenario: Scenario) -> str:
    """Return the label of forces as the thrusters take them, which turn with the chaser."""
    return 'control force [N]' if scenario.attitude is None else "force in the\nchaser's axes [N]"


def by_axis(
    axes: Any,
    times_s: Any,
    values: Any,
    label: str,
    linewidth: float = 1.5,
    names: Sequence[str] = style.AXIS_NAMES,
    **line: Any,
) -> None:
    """Draw the columns (n, 3) of a vector over time; or numbers (n,), as one line."""
    if values.ndim == 1:
        axes.plot(times_s, values, color=style.LIGHT['ink'], linewidth=linewidth, **line)
    else:
        for name, colour, column in zip(names, style.AXES, values.T, strict=True):
            axes.plot(times_s, column, color=colour, label=name, linewidth=linewidth, **line)
    axes.set_ylabel(label)
    axes.margins(x=0.01)


def limit_lines(axes: Any, value: float, name: str, times_s: tuple[float, float]) -> None:
    """Draw the limits +- value over the times (from, to) in which they hold."""
    for sign in (-1.0, 1.0):
        label = name if sign > 0 else None
        axes.plot(times_s, [sign * value] * 2, **style.LIMIT, zorder=3.0, label=label)
