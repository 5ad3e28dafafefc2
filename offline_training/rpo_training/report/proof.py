# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The report of a proof: its claims, and the box of starts coloured by margin."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rpo_core import files
from rpo_log.show import style
from rpo_training.proof.cells import Found
from rpo_training.proof.claims import of_planar
from rpo_training.proof.folder import TEXTS, Folder
from rpo_training.report.blocks import Block, File, Picture, Report, Section, Table, Text

Floats = NDArray[np.float64]

_POINTS = 161
_LEVELS = (0.0, 0.25, 0.5, 0.7, 0.8, 0.9, 1.0)
"""Shares of a limit; what is beyond is open, or refuted."""


def report_of(path: Path) -> Report:
    """Return the report of a finished proof's folder; raises InputError."""
    folder = Folder.open(path)
    summary = folder.summary()
    groups = {group: folder.cells(group) for group in folder.problem.groups}
    claims = summary['claims']
    with style.applied():
        pictures = [
            _margins(folder, groups, key, claim)
            for key, claim in claims.items()
            if claim['limit'] > 0.0 and 'planar' in groups
        ]
    problem, settings = folder.problem, folder.problem.settings
    box = ', '.join(f'{c:g} ± {h:g}' for c, h in zip(settings.centre, settings.half, strict=True))
    verdicts = [claim['verdict'] for claim in claims.values()]
    counted = ', '.join(f'{verdicts.count(v)} {v}' for v in dict.fromkeys(verdicts))
    files_of = tuple(File(name, files.read_text(path / name)) for name in TEXTS)
    return Report(
        f'Proof: {problem.controller.name}, {problem.scenario.name}',
        f'Every start of ({box}) m, m/s: {counted}.',
        (
            Section(
                'Claims',
                (_table(claims), *_refuted(path, claims), _ranges(summary), _rest(summary)),
            ),
            *([Section('Margins', tuple(pictures))] if pictures else []),
            Section('Files', files_of),
        ),
    )


def _table(claims: dict[str, Any]) -> Table:
    rows = tuple(
        (
            claim['statement'],
            f'{claim["limit"]:g} {_unit(claim["unit"])}',
            f'{claim["bound"]:.4g}',
            f'{claim["found"]:.4g}',
            str(claim['open_cells']),
            claim['verdict'],
        )
        for claim in claims.values()
    )
    columns = ('claim', 'limit', 'proven', 'flown', 'open cells', 'verdict')
    return Table('No start exceeds what is proven; a flight reached what is flown.', columns, rows)


def _unit(ascii_unit: str) -> str:
    return ascii_unit.replace('N^2 s', 'N²s')


def _refuted(path: Path, claims: dict[str, Any]) -> list[Block]:
    """Return how to fly the counterexamples again."""
    found: list[Block] = []
    for key, claim in claims.items():
        if claim['verdict'] == 'refuted':
            flight, controller = path / f'counterexample_{key}.yaml', path / 'controller.yaml'
            command = ['rpo', 'simulate', str(flight), '--controller', str(controller)]
            found.append(Text(f'{claim["statement"]}: refuted by {shlex.join(command)}'))
    return found


def _ranges(summary: dict[str, Any]) -> Table:
    rows = tuple(
        (found['statement'], f'{found["low"]:.4g}', f'{found["high"]:.4g} {_unit(found["unit"])}')
        for found in summary['ranges'].values()
    )
    return Table('What no flight leaves.', ('', 'from', 'to'), rows)


def _rest(summary: dict[str, Any]) -> Text:
    rest = summary['rest']
    if rest is None:
        return Text('No set of rest was found: nothing is proven for ever.')
    return Text(
        f'Set of rest, on each axis: |r| ≤ {rest["radius_m"]:g} m and |v + {rest["rate"]:g}/s r| ≤ '
        f'{rest["speed_m_s"]:g} m/s. A tick maps it into itself.'
    )


def _margins(folder: Folder, groups: dict[str, Found], key: str, claim: dict[str, Any]) -> Picture:
    """Return the x-y plane of starts, coloured by bound beside limit."""
    from matplotlib.colors import ListedColormap

    planar = groups['planar']
    shares = of_planar(groups, key) / claim['limit']
    grid, values = _raster(folder, planar, shares)
    figure, axes = style.new_panels(6.2)
    half = style.SHADES // 2
    colours = [*style.SCALE[half : half + len(_LEVELS) - 1], style.LIGHT['bad']]
    levels = [*_LEVELS, 1e9]
    image = axes.contourf(*grid, values, levels, colors=ListedColormap(colours).colors)
    bar = figure.colorbar(image, ax=axes, label='bound / limit', ticks=_LEVELS)
    bar.ax.grid(False)
    axes.grid(False)
    axes.set(title=claim['statement'], xlabel='start y, V-bar [m]', ylabel='start x, R-bar [m]')
    axes.set_aspect('equal')
    worst = int(shares.argmax())
    place = ', '.join(f'{x:.4g}' for x in planar.centre[worst])
    return Picture(
        f'margin_{key}',
        figure,
        f'{claim["statement"]}: the greatest bound of the motion on x and y, at each place. '
        f'The worst cell is about ({place}).',
        f'{claim["open_cells"]} of {len(shares)} cells exceed the limit.',
    )


def _raster(folder: Folder, planar: Found, shares: Floats) -> tuple[tuple[Floats, Floats], Floats]:
    """Return a grid of y and x, and the greatest share of the cells at each point."""
    settings = folder.problem.settings
    x, y = (settings.centre[i] + settings.half[i] * np.linspace(-1.0, 1.0, _POINTS) for i in (0, 1))
    values = np.zeros((_POINTS, _POINTS))
    low, high = planar.centre - planar.half, planar.centre + planar.half
    images = [(low, high), (-high, -low)] if folder.problem.odd else [(low, high)]
    for least, most in images:
        first = [np.searchsorted(a, least[:, i], side='left') for i, a in ((0, x), (1, y))]
        last = [np.searchsorted(a, most[:, i], side='right') for i, a in ((0, x), (1, y))]
        for k, share in enumerate(shares):
            part = values[first[0][k] : last[0][k], first[1][k] : last[1][k]]
            np.maximum(part, share, out=part)
    return (y, x), values
