# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The report of a proof: its claims, and the box of starts coloured by margin."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Any

import numpy as np

from rpo_core import files
from rpo_log.show import style
from rpo_training.proof.cells import Found
from rpo_training.proof.claims import of_planar
from rpo_training.proof.folder import TEXTS, Folder
from rpo_training.report import plane, proof_apart
from rpo_training.report.blocks import Block, File, Picture, Report, Section, Table, Text


def report_of(path: Path) -> Report:
    """Return the report of a finished proof's folder; raises InputError."""
    folder = Folder.open(path)
    summary = folder.summary()
    groups = {group: folder.cells(group) for group in folder.problem.groups}
    problem, claims = folder.problem, summary['claims']
    with style.applied():
        pictures = [
            _margins(folder, groups, key, claim)
            for key, claim in claims.items()
            if claim['limit'] > 0.0 and 'planar' in groups
        ]
        if problem.settings.axes_apart:
            pictures = proof_apart.pictures_of(problem, groups)
    settings = problem.settings
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
    planar, settings = groups['planar'], folder.problem.settings
    shares = of_planar(groups, key) / claim['limit']
    x, y = (plane.points(settings.centre[i], settings.half[i]) for i in (0, 1))
    low, high = (planar.centre - planar.half)[:, :2], (planar.centre + planar.half)[:, :2]
    values = plane.greatest(x, y, low, high, shares)
    if folder.problem.odd:
        values = np.fmax(values, plane.greatest(x, y, -high, -low, shares))
    figure, axes = style.new_panels(6.2)
    plane.draw(figure, [axes], [(y, x, values)])
    axes.set(title=claim['statement'], xlabel='start y, V-bar [m]', ylabel='start x, R-bar [m]')
    worst = int(shares.argmax())
    place = ', '.join(f'{x:.4g}' for x in planar.centre[worst])
    return Picture(
        f'margin_{key}',
        figure,
        f'{claim["statement"]}: the greatest bound of the motion on x and y, at each place. '
        f'The worst cell is about ({place}).',
        f'{claim["open_cells"]} of {len(shares)} cells exceed the limit.',
    )
