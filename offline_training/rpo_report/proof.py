# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The report of a proof: its claims, and the box of starts coloured by margin."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from rpo_core.files.validation import InputError
from rpo_judge.analysis.certificate import PROVEN, REFUTED
from rpo_log.show import style
from rpo_proof.cells import Found
from rpo_proof.check_claims import Written, flights_again, what_follows
from rpo_proof.claims import Claim, Range, of_planar
from rpo_proof.folder import TEXTS, Folder
from rpo_proof.premises import lower, origins, range_of, row_of, title_of, upper
from rpo_proof.sets import Rest
from rpo_report import plane, proof_apart
from rpo_report.blocks import Block, File, Picture, Report, Section, Table, Text


def report_of(path: Path) -> Report:
    """Return the report of a finished proof's folder; raises InputError."""
    folder = Folder.open(path)
    problem, written = folder.problem, Written.of(folder)
    groups = {group: folder.cells(group) for group in problem.groups}
    flown, faults = flights_again(folder, written)
    follows = what_follows(problem, groups, written, flown)
    for fault in (*faults, *follows.faults):
        raise InputError(f'{path}: {fault}')
    claims = follows.claims
    with style.applied():
        pictures = [
            _margins(folder, groups, claim)
            for claim in claims
            if claim.limit > 0.0 and 'planar' in groups
        ]
        if problem.settings.axes_apart:
            pictures = proof_apart.pictures_of(problem, groups)
    verdicts = [claim.verdict for claim in claims]
    counted = ', '.join(f'{verdicts.count(v)} {v}' for v in dict.fromkeys(verdicts))
    files_of = tuple(File(name, content) for name, content in zip(TEXTS, folder.texts, strict=True))
    check = shlex.join(['rpo', 'prove', '--check', str(path)])
    return Report(
        f'Proof: {problem.controller.name}, {problem.scenario.name}',
        f'As the cells of the folder say, not checked here: {counted}. `{check}` checks them. '
        'What was flown is flown again.',
        (
            Section(
                'Claims',
                (
                    Text(f'{title_of(problem)}; {range_of(problem)}.'),
                    _table(claims),
                    *_refuted(folder, claims),
                    _ranges(follows.ranges),
                    _rest(written.rest),
                    *(Text(origin) for origin in origins(folder)),
                ),
            ),
            *([Section('Margins', tuple(pictures))] if pictures else []),
            Section('Files', files_of),
        ),
        missed=any(verdict != PROVEN for verdict in verdicts),
    )


def _table(claims: Sequence[Claim]) -> Table:
    rows = tuple(tuple(map(_unit, row_of(claim))) for claim in claims)
    columns = ('claim', 'limit', 'proven', 'flown', 'open cells', 'verdict')
    caption = (
        'If the cells are right, no start exceeds what is proven. A flight reaches what is flown.'
    )
    return Table(caption, columns, rows)


def _unit(text: str) -> str:
    return text.replace('N^2 s', 'N²s')


def _refuted(folder: Folder, claims: Sequence[Claim]) -> list[Block]:
    """Return how to fly the counterexamples again."""
    found: list[Block] = []
    for claim in claims:
        if claim.verdict == REFUTED:
            flight, controller = folder.flights(claim.key)[0], folder.path / TEXTS[0]
            command = ['rpo', 'simulate', str(flight), '--controller', str(controller)]
            found.append(Text(f'{claim.statement}: refuted by {shlex.join(command)}'))
    return found


def _ranges(ranges: Mapping[str, Range]) -> Table:
    rows = tuple(
        (found.statement, lower(found.low), f'{upper(found.high)} {_unit(found.unit)}')
        for found in ranges.values()
    )
    return Table('What no flight leaves, if the cells are right.', ('', 'from', 'to'), rows)


def _rest(rest: Rest | None) -> Text:
    if rest is None:
        return Text('No set of rest was found: nothing is proven for ever.')
    return Text(
        f'Set of rest, on each axis: |r| ≤ {rest.radius_m:g} m and |v + {rest.rate:g}/s r| ≤ '
        f'{rest.speed_m_s:g} m/s. `rpo prove --check` shows that a tick maps it into itself.'
    )


def _margins(folder: Folder, groups: dict[str, Found], claim: Claim) -> Picture:
    """Return the x-y plane of starts, coloured by bound beside limit."""
    planar, settings = groups['planar'], folder.problem.settings
    shares = of_planar(groups, claim.key) / claim.limit
    x, y = (plane.points(settings.centre[i], settings.half[i]) for i in (0, 1))
    low, high = (planar.centre - planar.half)[:, :2], (planar.centre + planar.half)[:, :2]
    values = plane.greatest(x, y, low, high, shares)
    if folder.problem.odd:
        values = np.fmax(values, plane.greatest(x, y, -high, -low, shares))
    figure, axes = style.new_panels(6.2)
    plane.draw(figure, [axes], [(y, x, values)])
    axes.set(title=claim.statement, xlabel='start y, V-bar [m]', ylabel='start x, R-bar [m]')
    worst = int(shares.argmax())
    place = ', '.join(f'{x:.4g}' for x in planar.centre[worst])
    return Picture(
        f'margin_{claim.key}',
        figure,
        f'{claim.statement}: the greatest bound of the motion on x and y, at each place. '
        f'The worst cell is about ({place}).',
        f'{claim.open_cells} of {len(shares)} cells exceed the limit.',
    )
