# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The report of a controller: how it flies, how it decides, what is proven of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from rpo.analysis.judgement import (
    HEADINGS,
    PAPER,
    QUESTIONS,
    Assessment,
    assess,
    judge,
    rows_of,
    trained_for,
)
from rpo.analysis.rule_base import FORCES, WELL, force_rows, warnings
from rpo.proof import surface
from rpo.proof.certificate import PROVEN, Certificate, Claim, certify
from rpo.reports.page import Block, File, Picture, Report, Section, Table, Text, picture, plain
from rpo.reports.run_plots import axis_forces, draw_force, force_bar
from rpo.scoring import fitness
from rpo_core import files
from rpo_core.chain.flight import Flight, flights_of
from rpo_core.control.controller import AnyController, FuzzyController, load_controller
from rpo_core.control.explain import SPOKEN
from rpo_core.control.family import Family
from rpo_core.control.fuzzy import WORDS
from rpo_core.judge.metrics import ARRIVAL_DISTANCE, ARRIVAL_SPEED, ENERGY, SLEW
from rpo_core.scenario.scenario import Scenario, ScenarioSet, load
from rpo_log.show import report as flight_report
from rpo_log.show import style

_SLICES = (-1.0, -0.5, 0.0, 0.5, 1.0)
_CONDITIONS = {
    'mean speed, last 30 s': ARRIVAL_SPEED,
    'slew': SLEW,
    'mean distance, last 30 s': ARRIVAL_DISTANCE,
}


def words(controller: FuzzyController) -> Any:
    """Return the membership functions of the three variables, in their units."""
    system, x = controller.system, np.linspace(-1.0, 1.0, 1001)
    figure, panels = style.new_panels(5.6, 3)
    names = 'position error [m]', 'velocity error [m/s]', 'force [N]'
    variables = system.position, system.velocity, system.force
    for axes, name, scale, functions in zip(
        panels, names, controller.scales, variables, strict=True
    ):
        for grades, word, colour in zip(functions.grades(x).T, WORDS, style.WORDS, strict=True):
            axes.plot(scale * x, np.where(grades > 0.0, grades, np.nan), label=word, color=colour)
        axes.set(xlabel=name, ylabel='grade', xlim=(-scale, scale), ylim=(0.0, 1.05))
    style.legend_below(figure, panels[0])
    return figure


def rules(controller: FuzzyController) -> Any:
    """Return the rule table."""
    from matplotlib.patches import Rectangle

    figure, axes = style.new_panels(4.0)
    table = controller.system.rules
    for (row, column), code in np.ndenumerate(table.codes):
        shade = style.SCALE[round(int(code) * (style.SHADES - 1) / 4)]
        corner, edge = (column - 0.5, row - 0.5), style.LIGHT['paper']
        axes.add_patch(Rectangle(corner, 1, 1, facecolor=shade, edgecolor=edge))
        axes.text(column, row, table.words[row][column], ha='center', va='center')
    axes.set(
        xticks=range(5),
        yticks=range(5),
        xticklabels=WORDS,
        yticklabels=WORDS,
        xlim=(-0.5, 4.5),
        ylim=(-0.5, 4.5),
        xlabel='word of the position error',
        ylabel='word of the velocity error',
        title='word of the force',
    )
    axes.set_aspect('equal')
    axes.grid(False)
    return figure


def control_surface(controller: AnyController) -> Any:
    """Return the force over position and velocity; of a fuzzy one also at some velocities."""
    if not isinstance(controller, FuzzyController):
        return axis_forces(controller)
    position, velocity, force = controller.scales
    figure, (wide, slices) = style.new_panels(4.2, 1, 2, width_ratios=(5, 4))
    image = draw_force(wide, controller, (position, velocity))
    wide.set(xlabel='position [m]', ylabel='velocity [m/s]')
    force_bar(figure, image, wide)
    e = np.linspace(-1.0, 1.0, 401)
    for share, colour in zip(_SLICES, style.WORDS, strict=True):
        u = surface.values(controller.system, -e, np.full_like(e, -share))
        label = f'velocity {share * velocity:.3g} m/s'
        slices.plot(position * e, force * u, color=colour, label=label)
    slices.set(xlabel='position [m]', ylabel='force [N]')
    slices.margins(x=0.01)
    style.legend_below(figure, slices, columns=3)
    return figure


def starts(assessment: Assessment) -> Any:
    """Return energy and conditions over the training starts."""
    figure, (energy, conditions) = style.new_panels(4.0, 1, 2)
    _energies(energy, assessment)
    count = np.arange(1, len(assessment.starts) + 1)
    for (name, column), limit, colour in zip(
        _CONDITIONS.items(), fitness.LIMITS, style.AXES, strict=True
    ):
        share = np.sort(assessment.metrics[:, column]) / limit
        conditions.step(share, count, where='post', color=colour, label=name)
    conditions.axvline(1.0, **style.LIMIT, label='limit')
    conditions.set(xlabel='share of its limit', ylabel='starts that stay below', xlim=(0.0, None))
    style.legend_below(figure, energy, conditions, columns=3)
    return figure


def _energies(axes: Any, assessment: Assessment) -> None:
    energy = assessment.metrics[:, ENERGY]
    axes.plot(assessment.least, energy, 'o', color=style.LIGHT['x'], markersize=4, label='a start')
    axis_n2s = np.array([0.0, 1.05 * assessment.least.max()])
    for factor, line, label in ((1, '-', 'the least itself'), (2, (0, (5, 2)), 'twice the least')):
        colour = style.LIGHT['optimum']
        axes.plot(axis_n2s, factor * axis_n2s, color=colour, linestyle=line, label=label)
    axes.set(
        xlabel='least J to rest in 200 s [N²s]',
        ylabel='J of the flight [N²s]',
        xlim=axis_n2s,
        ylim=(0.0, 1.05 * max(energy.max(), axis_n2s[1])),
    )


class _Flown(NamedTuple):
    """How a controller flies: a summary, blocks of the page, and whether something is missed."""

    summary: str
    blocks: Sequence[Block]
    missed: bool


def report_of(name: str, scenario: str = '') -> Report:
    """Return the report of a shipped controller or a file; raises InputError.

    scenario : what it is judged by; if not given, what it was trained for, else the paper's starts
    """
    controller, path = load_controller(name), files.find('controller', name)
    of, proven = scenario or trained_for(controller) or PAPER, None
    if isinstance(controller, FuzzyController):
        proven = certify(controller.system)
    rows = tuple(
        (str(key), f'{value:.6g}' if isinstance(value, float) else str(value))
        for key, value in controller.provenance.items()
        if not isinstance(value, Mapping)
    )
    origin = [Table('How it came to be', ('what', 'value'), rows)] if rows else []
    with style.applied():
        if isinstance(controller, FuzzyController) and proven and not scenario and of == PAPER:
            flown = _assessed(controller, proven)
        else:
            flown = _judged(controller, load(of))
        sections = (
            Section('How it flies', tuple(flown.blocks)),
            *_inside(controller, proven),
            Section('Provenance', (*origin, File(path.name, files.read_text(path)))),
        )
    summary = f'{controller.description} {flown.summary}'.strip()
    return Report(f'Controller {controller.name}', summary, sections, flown.missed)


def _judged(controller: AnyController, scenario: Scenario | ScenarioSet) -> _Flown:
    """Return how a controller keeps what a scenario or set requires."""
    judged = judge(controller, scenario, lambda *_: None)
    judgements = judged.judgements
    flight = next(flights_of(controller, scenario))
    table = Table(f'Requirements of {scenario.name}', HEADINGS, tuple(rows_of(judged)))
    kept, flights = sum(not j.missed for j in judgements), judgements[0].flights
    where = 'its flight' if flights == 1 else f'all {flights} flights'
    summary = f'{kept} of {len(judgements)} requirements of {scenario.name} held in {where}.'
    return _Flown(summary, [table, _histories(flight)], kept < len(judgements))


def _histories(flight: Flight) -> Picture:
    figure, name = flight_report.time_histories(flight), flight.scenario.name
    return picture('time_histories, of a controller', figure, name=name)


def _inside(controller: AnyController, proven: Certificate | None) -> tuple[Section, ...]:
    """Return how a controller decides, and what is proven of it."""
    if isinstance(controller, FuzzyController) and proven:
        headings, rows = force_rows(controller.system)
        said = warnings(controller.system) or (WELL,)
        shown = picture('rules', rules(controller)), Table(FORCES, headings, tuple(rows))
        spoken = ', '.join(f'{word} {SPOKEN[word]}' for word in WORDS)
        scales = dict(zip(('position', 'velocity', 'force'), controller.scales, strict=True))
        functions = picture('membership_functions', words(controller), words=spoken, **scales)
        return (
            Section('Membership functions', (functions,)),
            Section('Rules', (*shown, *map(Text, said))),
            Section('Control surface', (picture('surface', control_surface(controller)),)),
            Section('Certificate', tuple(_certificate(controller, proven))),
        )
    force = Section('Force', (picture('surface, of each axis', control_surface(controller)),))
    if not isinstance(controller, Family):
        return (force,)
    tables = tuple(Table(t.title, t.headings, tuple(t.rows)) for t in controller.tables())
    claims = tuple(
        (claim.name, 'proven' if claim.holds else 'not proven', claim.statement)
        for claim in controller.claims()
    )
    certificate = Table('Claims', ('claim', 'verdict', 'statement'), claims)
    return Section('Rules', tables), force, Section('Certificate', (certificate,))


def _certified(controller: FuzzyController, certificate: Certificate) -> str:
    """Return whether the certificate holds; of each claim that fails, where."""
    if certificate.holds:
        return 'The certificate of its surface holds.'
    fails = (
        f'{claim.name} is {claim.verdict}, {_places(controller, claim)}'
        for claim in certificate.claims
        if claim.verdict != PROVEN
    )
    return f'The certificate of its surface fails: {"; ".join(fails)}.'


def _places(controller: FuzzyController, claim: Claim) -> str:
    """Return the points of a claim in units: errors, and the force that the kernel gives."""
    position, velocity, force = controller.scales
    return '; '.join(
        f'at errors of {p.position_error * position:.4g} m and {p.velocity_error * velocity:.4g} '
        f'm/s the force is {p.output * force:.4g} N'
        for p in claim.points
    )


def _assessed(controller: FuzzyController, proven: Certificate) -> _Flown:
    """Return how a fuzzy controller reaches its targets."""
    assessment = assess(controller)
    targets = assessment.targets()
    rows = tuple(tuple(map(plain, target.cells('≤ '))) for target in targets)
    shown = picture(
        'starts',
        starts(assessment),
        starts=len(assessment.starts),
        mean_n2s=assessment.mean_energy_n2s,
        ratio=assessment.mean_energy_n2s / float(assessment.least.mean()),
        worst_n2s=assessment.metrics[:, ENERGY].max(),
    )
    summary = (
        f'{plain(assessment.verdict())}. Mean J of {len(assessment.starts)} starts '
        f'{assessment.mean_energy_n2s:.4g} N²s. {_certified(controller, proven)}'
    )
    table = Table('Targets', ('target', 'what', 'limit', 'reached', 'verdict'), rows)
    return _Flown(summary, [table, Text(QUESTIONS), shown], not all(t.holds for t in targets))


def _certificate(controller: FuzzyController, certificate: Certificate) -> list[Block]:
    rows = tuple(
        (claim.name, claim.verdict, claim.statement, _places(controller, claim))
        for claim in certificate.claims
    )
    return [
        Text(
            'Proven over the whole input square, not on a grid; errors and outputs of a statement '
            f'are shares of their scales. {certificate.boxes} boxes; the kernel that flies is '
            f'within {certificate.rounding:.1e} of the exact surface. The points are those that '
            'refute a claim, or the worst that were found.'
        ),
        Table('Claims', ('claim', 'verdict', 'statement', 'where'), rows),
    ]
