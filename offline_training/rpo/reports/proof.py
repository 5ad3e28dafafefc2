# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The report of a proof: its claims, and the box of starts coloured by margin."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from rpo.proof.cells import CellBounds
from rpo.proof.certificate import PROVEN, REFUTED
from rpo.proof.check import followed
from rpo.proof.claims import Claim, Range, lower, of_planar, row_of, upper
from rpo.proof.folder import TEXTS, Folder, origins
from rpo.proof.problem import PER_AXIS, Problem, range_of, title_of
from rpo.proof.tube import InvariantSet
from rpo.reports.page import Block, File, Picture, Report, Section, Table, Text, picture, plain
from rpo_core.chain.flight import fly
from rpo_core.kernels.arrays import Floats
from rpo_log.show import style
from rpo_log.show.report import limit_lines

_PLANE_POINTS = 161
_LEVELS = (0.0, 0.25, 0.5, 0.7, 0.8, 0.9, 1.0)
"""Shares of a limit; what is beyond is open, or refuted."""


def report_of(path: Path) -> Report:
    """Return the report of a finished proof's folder; raises InputError."""
    folder = Folder.open(path)
    problem = folder.problem
    written, groups, follows = followed(folder)
    claims = follows.claims
    with style.applied():
        pictures = [
            _margins(folder, groups, claim)
            for claim in claims
            if claim.limit > 0.0 and 'planar' in groups
        ]
        if problem.settings.axes_apart:
            pictures = [_reach(problem, groups)]
    verdicts = [claim.verdict for claim in claims]
    counted = ', '.join(f'{verdicts.count(v)} {v}' for v in dict.fromkeys(verdicts))
    files_of = tuple(map(File, TEXTS, folder.texts))
    check = shlex.join(['rpo', 'prove', '--check', str(path)])
    return Report(
        f'Proof: {problem.controller.name}, {problem.scenario.name}',
        f'As the cells of the folder say, not checked here: {counted}. `{check}` checks them. '
        'What was flown is flown again.',
        (
            Section('Claims', tuple(_claims(folder, claims, follows.ranges, written.omega))),
            *([Section('Margins', tuple(pictures))] if pictures else []),
            Section('Files', files_of),
        ),
        missed=any(verdict != PROVEN for verdict in verdicts),
    )


def _claims(
    folder: Folder,
    claims: Sequence[Claim],
    ranges: Mapping[str, Range],
    omega: InvariantSet | None,
) -> Iterator[Block]:
    """Yield what is proven, how to fly the counterexamples again, and where it comes from."""
    yield Text(f'{title_of(folder.problem)}; {range_of(folder.problem)}.')
    yield Table(
        'If the cells are right, no start exceeds what is proven. A flight reaches what is flown.',
        ('claim', 'limit', 'proven', 'flown', 'open cells', 'verdict'),
        tuple(tuple(map(plain, row_of(claim))) for claim in claims),
    )
    for claim in claims:
        if claim.verdict == REFUTED:
            flight, controller = folder.flights(claim.key)[0], folder.path / TEXTS[0]
            command = ['rpo', 'simulate', str(flight), '--controller', str(controller)]
            yield Text(f'{claim.statement}: refuted by {shlex.join(command)}')
    rows = tuple(
        (bounds.statement, lower(bounds.low), f'{upper(bounds.high)} {plain(bounds.unit)}')
        for bounds in ranges.values()
    )
    yield Table('What no flight leaves, if the cells are right.', ('', 'from', 'to'), rows)
    if omega is None:
        yield Text('No invariant set was found: nothing is proven for ever.')
    else:
        yield Text(
            f'Invariant set, on each axis: |r| ≤ {omega.radius_m:g} m and |v + {omega.rate:g}/s r| '
            f'≤ {omega.speed_m_s:g} m/s. `rpo prove --check` shows that a tick maps it into itself.'
        )
    yield from map(Text, origins(folder))


def _margins(folder: Folder, groups: dict[str, CellBounds], claim: Claim) -> Block:
    """Return the x-y plane of starts, coloured by bound beside limit; words if all is alike."""
    planar, settings = groups['planar'], folder.problem.settings
    shares = of_planar(groups, claim.key) / claim.limit
    side = np.linspace(-1.0, 1.0, _PLANE_POINTS)
    x, y = (settings.centre[i] + settings.half[i] * side for i in (0, 1))
    low, high = (planar.centre - planar.half)[:, :2], (planar.centre + planar.half)[:, :2]
    values = _greatest(x, y, low, high, shares)
    if folder.problem.odd:
        values = np.fmax(values, _greatest(x, y, -high, -low, shares))
    colours = np.unique(np.digitize(values[np.isfinite(values)], _LEVELS))
    if len(colours) < 2:  # a plane of one colour shows nothing
        low_percent, high_percent = 100.0 * np.nanmin(values), 100.0 * np.nanmax(values)
        span = f'{low_percent:.0f} to {high_percent:.0f} %'
        return Text(f'{claim.statement}: {span} of the limit everywhere.')
    figure, axes = style.new_panels(6.2)
    half = style.SHADES // 2
    scale = [*style.SCALE[half : half + len(_LEVELS) - 1], style.LIGHT['bad']]
    image = axes.contourf(y, x, values, [*_LEVELS, 1e9], colors=scale)
    axes.grid(False)
    axes.set_aspect('equal')
    bar = figure.colorbar(image, ax=axes, label='bound / limit', ticks=_LEVELS)
    bar.ax.grid(False)
    axes.set(title=claim.statement, xlabel='start y, V-bar [m]', ylabel='start x, R-bar [m]')
    worst = int(shares.argmax())
    place = ', '.join(f'{x:.4g}' for x in planar.centre[worst])
    number, cells = claim.open_cells, len(shares)
    shown = picture(
        'margin', figure, statement=claim.statement, worst=place, open=number, cells=cells
    )
    return shown._replace(name=f'margin_{claim.key}')


def _greatest(x: Floats, y: Floats, low: Floats, high: Floats, shares: Floats) -> Floats:
    """Return the greatest share (len(x), len(y)) of the cells at each place; nan where none is.

    low, high : (k, 2) of each cell; shares : (k,)
    """
    values = np.full((len(x), len(y)), np.nan)
    first = [np.searchsorted(a, low[:, i], side='left') for i, a in ((0, x), (1, y))]
    last = [np.searchsorted(a, high[:, i], side='right') for i, a in ((0, x), (1, y))]
    for k, share in enumerate(shares):
        part = values[first[0][k] : last[0][k], first[1][k] : last[1][k]]
        np.fmax(part, share, out=part)
    return values


_BEFORE_S = 50.0
"""The second row of pictures begins so long before the time of hold."""


def _reach(problem: Problem, groups: Mapping[str, CellBounds]) -> Picture:
    """Return the position that no flight leaves, over time, and near the target, and a flight.

    groups : in the order in which they are proven
    """
    flight = fly(problem.scenario.starting_at(problem.settings.centre), problem.controller)
    limit, dt = problem.hold_error_m, problem.scenario.dt_s
    hold_s = problem.hold_tick * dt
    figure, rows = style.new_panels(5.6, 2, 3)
    for column, group in enumerate(sorted(groups)):
        axis = PER_AXIS[group][0]
        reach = groups[group].reach[:, :, 0]
        low, high = np.where(np.isfinite(reach), reach, np.nan)
        times = dt * np.arange(len(low))
        for axes in rows[:, column]:
            fill = {'color': style.AXES[axis], 'linewidth': 0.0, 'alpha': 0.55}
            axes.fill_between(times, low, high, **fill, label='no flight leaves the band')
            path = flight.positions_m[: len(times), axis]
            label = 'a flight from the middle of the starts'
            axes.plot(
                times[: len(path)], path, color=style.LIGHT['ink'], linewidth=1.0, label=label
            )
            limit_lines(axes, limit, 'limit of the error', (hold_s, times[-1]))
        near = rows[1, column]
        near.set(xlabel='time [s]', xlim=(max(0.0, hold_s - _BEFORE_S), times[-1]))
        near.set(ylim=(-3.0 * limit, 3.0 * limit))
        rows[0, column].set(title=style.AXIS_NAMES[axis])
    for axes in rows[:, 0]:
        axes.set_ylabel('position [m]')
    style.legend_below(figure, rows[0, 0])
    return picture('reach', figure)
