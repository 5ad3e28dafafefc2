# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""`rpo export`, `rpo import` and `rpo scale`: a controller for other tools and vehicles."""

from __future__ import annotations

import shlex
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer
from typer import Argument, Option

from rpo.cli.commands.shared import NoFail, Output, Set, echo, end, write_texts
from rpo.display import print_table, progress


def export(
    subject: Annotated[
        str,
        Argument(
            metavar='SUBJECT', help='controller or scenario, shipped name or file; or run folder'
        ),
    ],
    to: Annotated[str, Option(help='fis (MATLAB), fll (FuzzyLite), json or c')],
    output: Annotated[
        Path | None,
        Option('--output', '-o', help='file, - for the terminal  [named after the subject]'),
    ] = None,
    controller: Annotated[
        str | None, Option(help='of a scenario, shipped name or file  [allround]')
    ] = None,
    stages: Annotated[
        str, Option(help='of a scenario or run, separated by commas, or all  [those on board]')
    ] = '',
    changes: Set = None,
) -> None:
    """Write a controller for MATLAB or FuzzyLite, as JSON or C99; or a scenario or run as C99.

    Of a scenario or run, the stages on board are one C file: one call per tick from measurements to
    commands, with the bits that fly. Beside it are a header, which says how to compile and call it,
    a program that flies the ticks of the flight or the log again and compares, and these ticks.
    """
    from rpo.door.conversion import exported
    from rpo.montecarlo.outputs import make_folder
    from rpo_core.scenario import overrides

    path = None if output == Path('-') else output
    texts = exported(subject, to, path, controller, stages, overrides.read(changes or []))
    if output == Path('-'):
        typer.echo(next(iter(texts.values())), nl=False)
        return
    make_folder(next(iter(texts)).parent)
    write_texts(texts)


_HELP = 'of an error (force) of 1, if the file does not say'


def import_(
    file: Annotated[Path, Argument(help='.fis or .fll file')],
    output: Annotated[Path, Option('--output', '-o', help='controller file to write')],
    position_scale: Annotated[float | None, Option(help=f'metres {_HELP}')] = None,
    velocity_scale: Annotated[float | None, Option(help=f'm/s {_HELP}')] = None,
    force_scale: Annotated[float | None, Option(help=f'newtons {_HELP}')] = None,
) -> None:
    """Make a controller file from a MATLAB .fis or FuzzyLite .fll file of the paper's shape.

    Two inputs and one output of five mirrored triangles each, 25 rules, min-max, centroid.
    """
    from rpo.analysis.rule_base import warnings
    from rpo.exports.formats import load
    from rpo_core.control.controller import dumps

    loaded = replace(load(file, (position_scale, velocity_scale, force_scale)), name=output.stem)
    write_texts({output: dumps(loaded)})
    for warning in warnings(loaded.system):
        echo(f'warning: {warning}', err=True)


LEAST = 1.1
"""Factor from which a number counts as harder."""


def scale(
    controller: Annotated[str, Argument(help='shipped name or file')],
    scenario: Annotated[str, Option(help='scenario or set (name or file) to scale for')],
    changes: Set = None,
    output: Output = None,
    no_fail: NoFail = False,
) -> None:
    """Scale a controller for another vehicle and mission, without training, and fly it.

    The loop is similar under scaling of mass, force, length and time. Its units of length and time
    are chosen by flying the scenario from starts around its own. Prints which similarity numbers
    still differ, and the verdict. Exit code 1: a requirement of the scenario is missed; the file is
    written.
    """
    from rpo.cli.commands.evaluate import judge_by
    from rpo.door.conversion import scaled
    from rpo.door.flight import flown
    from rpo.montecarlo import outputs
    from rpo_core.control.controller import dumps
    from rpo_core.judge import similarity
    from rpo_core.scenario import overrides
    from rpo_core.scenario.scenario import ScenarioSet
    from rpo_log.show import report

    fields = overrides.read(changes or [])
    with progress() as show:
        result = scaled(controller, scenario, fields, show)
    search, mission, scenario_name = result.search, result.mission.subject, scenario
    name = result.name if output is None else output.stem
    path = output or Path(f'runs/scaled/{name}.yaml')
    outputs.make_folder(path.parent)
    if fields:
        scenario_name = str(path.with_name(f'{path.stem}_scenario.yaml'))
        outputs.write_text(Path(scenario_name), result.mission.text)
    command = similarity.command(controller, scenario, changes or ())
    law = search.named(name, controller, scenario_name, command)
    outputs.write_text(path, dumps(law))
    rows = []
    for number, made in search.made.items():
        here = search.here[number]
        by = similarity.factor(number, made, here)
        cells = ('–' if v is None else f'{v:.3g}' for v in (made, here, by))
        rows.append((number, *cells, similarity.HARDER[number][1] if by and by > LEAST else ''))
    headings = ('number', f'in {search.trained_for}', 'here', 'times harder', '')
    print_table(headings, rows, f'{mission.name}, {controller} scaled: similarity numbers')
    units, ratio = search.best.units, search.multiples
    echo(
        f'L = {units.length_m:.4g} m, T = {units.time_s:.4g} s, m = {units.mass_kg:g} kg: length × '
        f'{ratio.length_m:.3g}, time × {ratio.time_s:.3g}, mass × {ratio.mass_kg:.3g}, force × '
        f'{ratio.force_n:.3g}.'
    )
    echo(
        f'Of {search.tried} pairs of L and T, each flown from {search.starts} '
        f'start{"s" * (search.starts > 1)}, this pair misses the fewest requirements, and then '
        'keeps the most room to the limits.'
    )
    force_n, limit_n = similarity.force_of(law), similarity.base_of(mission).max_force_n
    share = f'{force_n:.3g} N of the {limit_n:g} N' if force_n < limit_n else f'all {limit_n:g} N'
    echo(
        f'The controller uses {share} of an axis: F follows from L, T and m, so that the authority '
        'F T²/(m L) is that of its training.'
    )
    if isinstance(mission, ScenarioSet):
        failed = judge_by(law, law.name, mission)
    else:
        flight = flown(mission, law, {})
        title = f'{mission.name}, controller {law.name}'
        print_table(report.COLUMNS, report.table(flight), title)
        failed = not flight.ok
    for sentence in search.why:
        echo(f'Why: {sentence}.')
    if search.why:
        again = shlex.join(['rpo', 'train', '--scenario', scenario_name])
        echo(f'Training may do more: `{again}`')
    echo(path)
    end(failed, no_fail)
