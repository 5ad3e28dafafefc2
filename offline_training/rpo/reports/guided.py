# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Guidance of a run: the phases of its plan, and how well the chaser followed the reference.

The stage is run again on the logged states and commands: a log has no `guidance_status`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from rpo.reports.logged import steps_again
from rpo.reports.page import Section, Table, picture
from rpo_core.chain.flight import Flight
from rpo_core.guidance.guidance import GuidanceStage
from rpo_core.kernels.arrays import Floats
from rpo_core.wire.interfaces import REFERENCE_STATE
from rpo_core.world.zones import zones_of
from rpo_log.read.run_log import RunLog
from rpo_log.show import style

EXACT = 1e-6
"""A state closer to its reference [m, m/s] is on it."""

_FLOOR_M, _FLOOR_M_S = 1e-4, 1e-5
"""Smaller errors are drawn as these: the scale is logarithmic."""
_LETTER_PT = 5.6
"""Width of a letter of a phase's name, about."""


class Phase(NamedTuple):
    """A phase of the plan, from its first tick up to the one after its last.

    One that another follows at the same tick lasts no tick: `begin` is `end`.
    """

    name: str
    reason: str
    begin: int
    end: int


def phases_of(log: RunLog, flight: Flight) -> list[Phase]:
    """Return the phases of a run; none if it has no guidance, or a state is missing."""
    stages = [stage for _, stage, _ in steps_again(log, flight, GuidanceStage)]
    changes = stages[-1].changes if stages else []
    ends = [*(change.tick for change in changes[1:]), len(flight.states)]
    return [
        Phase(change.phase, change.reason, change.tick, end)
        for change, end in zip(changes, ends, strict=False)
    ]


def follows(flight: Flight) -> bool:
    """Whether the controller followed a reference."""
    return REFERENCE_STATE in flight.signals


def errors_of(flight: Flight) -> Floats:
    """Return true states (n, 6) relative to the reference, or to the goal where there is none."""
    return flight.states - flight.signals[REFERENCE_STATE] if follows(flight) else flight.errors


def sections(flight: Flight, phases: list[Phase]) -> list[Section]:
    """Return the section of a report; none if the run has no guidance."""
    if not phases:
        return []
    miss = errors_of(flight)
    errors, speeds = (np.linalg.norm(part, axis=1) for part in (miss[:, :3], miss[:, 3:]))
    ranges, exact = np.linalg.norm(flight.positions_m, axis=1), bool(np.abs(miss).max() < EXACT)
    times = flight.scenario.times_s
    rows = []
    for phase in phases:
        part = slice(phase.begin, phase.end)
        figures = ['–'] * 3
        if phase.end > phase.begin:
            numbers = (ranges[part].min(), errors[part].max(), speeds[part].max())
            figures = [f'{value:.3g}' for value in numbers]
        ends = (f'{times[min(tick, len(times) - 1)]:.1f}' for tick in (phase.begin, phase.end))
        rows.append((phase.name, *ends, *figures, phase.reason))
    columns = (
        'phase', 'from [s]', 'to [s]', 'least range [m]', 'largest distance to the reference [m]',
        'largest speed relative to it [m/s]', 'why it began',
    )  # fmt: skip
    figure = _picture(flight, phases, ranges, () if exact else (errors, speeds))
    key = 'guidance, of a chaser on its reference' if exact else 'guidance'
    shown = picture(key, figure, most_m=errors.max(), phases=len(phases))
    return [Section('Guidance', (Table('Phases of the plan', columns, tuple(rows)), shown))]


def _picture(flight: Flight, phases: list[Phase], ranges: Floats, misses: Sequence[Floats]) -> Any:
    count = 1 + len(misses)
    figure, column = style.new_panels(1.0 + 1.6 * count, count, 1, sharex=True, squeeze=False)
    times, panels = flight.scenario.times_s, column[:, 0]
    shown = zip(
        panels,
        (ranges, *misses),
        (0.0, _FLOOR_M, _FLOOR_M_S),
        ('range [m]', 'from reference [m]', 'relative speed [m/s]'),
        strict=False,
    )
    for axes, values, floor, label in shown:
        axes.plot(times, np.maximum(values, floor), color=style.LIGHT['ink'], linewidth=1.2)
        axes.set_ylabel(label)
        axes.margins(x=0.01)
        if axes is not panels[0]:
            style.log_scale(axes)
    panels[0].set_ylim(0.0, None)
    for radius in {zones.keep_out_m for zones in zones_of(flight.scenario)} - {0.0}:
        panels[0].axhline(radius, **style.LIMIT)
    panels[-1].set_xlabel('time [s]')
    mark(figure, phases, flight)
    return figure


def mark(figure: Any, phases: list[Phase], flight: Flight) -> None:
    """Draw a line where a phase begins, in every panel over time, and name it above the first."""
    over_time = [
        axes
        for axes in figure.axes
        if any(
            one.get_xlabel() == 'time [s]'
            for one in (axes, *axes.get_shared_x_axes().get_siblings(axes))
        )
    ]
    times = flight.scenario.times_s
    for i, axes in enumerate(over_time):
        low, high = axes.get_xlim()
        shown = [p for p in phases if low <= times[p.begin] <= high]
        for phase in shown:
            axes.axvline(times[phase.begin], color=style.LIGHT['muted'], linewidth=0.8)
        axes.set_xlim(low, high)
        if i == 0:
            _name(axes, shown, times)


def _name(axes: Any, phases: list[Phase], times: Floats) -> None:
    """Write the names above the axes, in rows so that none touches another."""
    low, high = axes.get_xlim()
    width_pt = axes.get_position().width * axes.figure.get_figwidth() * 72.0
    ends: list[float] = []  # of the last name in each row [pt]
    base = 4.0 if not axes.get_title() else 18.0
    for phase in phases:
        place = width_pt * (times[phase.begin] - low) / (high - low)
        row = next((i for i, end in enumerate(ends) if end < place), len(ends))
        ends[row : row + 1] = [place + _LETTER_PT * (len(phase.name) + 1)]
        axes.annotate(
            phase.name, (times[phase.begin], 1.0), xycoords=axes.get_xaxis_transform(),
            xytext=(0.0, base + 11.0 * row), textcoords='offset points', fontsize=8.5,
            color=style.LIGHT['muted'],
        )  # fmt: skip
