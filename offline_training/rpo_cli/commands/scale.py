# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""`rpo scale`."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rpo_cli.commands.shared import NoFail, Set, echo, end
from rpo_cli.display import print_table, progress

if TYPE_CHECKING:
    from rpo_training.scaling import Found


LEAST = 1.1
"""Factor from which a number counts as harder."""


def scale(
    controller: Annotated[str, typer.Argument(help='shipped name or file')],
    scenario: Annotated[str, typer.Option(help='scenario or set (name or file) to scale for')],
    changes: Set = None,
    output: Annotated[
        Path | None, typer.Option('--output', '-o', help='file  [runs/scaled/NAME.yaml]')
    ] = None,
    no_fail: NoFail = False,
) -> None:
    """Scale a controller for another vehicle and mission, without training, and fly it.

    The loop is similar under scaling of mass, force, length and time. Its units of length and time
    are chosen by flying the scenario from starts around its own. Prints which similarity numbers
    still differ, and the verdict. Exit code 1: a requirement of the scenario is missed; the file is
    written.
    """
    from rpo_cli.commands.evaluate import judge_by
    from rpo_core import files
    from rpo_core.chain.flight import fly
    from rpo_core.control.controller import dumps, load_controller
    from rpo_core.files import overrides
    from rpo_core.files import scenario as scenarios
    from rpo_core.judge.verdicts import missed
    from rpo_ctrl import similarity
    from rpo_log.show import report
    from rpo_montecarlo import outputs
    from rpo_training.scaling import search

    given, named = load_controller(controller), scenario
    content = overrides.text_of(scenario, changes or [])
    found = files.loads(content, scenarios.parse, scenario)
    with progress() as show:
        chosen = search(given, found, show)
    goal = found.name.replace(overrides.CHANGED, '_changed')
    name = outputs.identifier(f'{given.name}_{goal}') if output is None else output.stem
    path = output or Path(f'runs/scaled/{name}.yaml')
    outputs.make_folder(path.parent)
    if changes:
        named = str(path.with_name(f'{path.stem}_scenario.yaml'))
        outputs.write_text(Path(named), content)
    command = similarity.command(controller, scenario, changes or ())
    made = chosen.named(name, controller, named, command)
    outputs.write_text(path, dumps(made))
    print_table(*_numbers(chosen), f'{found.name}, {controller} scaled: similarity numbers')
    echo(_choice(chosen))
    if isinstance(found, scenarios.ScenarioSet):
        failed = judge_by(made, made.name, found)
    else:
        flight = fly(found, made)
        report.print_table(flight, f'{found.name}, controller {made.name}')
        failed = missed(flight)
    for sentence in chosen.why:
        echo(f'Why: {sentence}.')
    if chosen.why:
        echo(f'Training may do more: `{shlex.join(["rpo", "train", "--scenario", named])}`')
    echo(path)
    end(failed, no_fail)


def _numbers(chosen: Found) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Return headings and rows of the similarity numbers."""
    from rpo_ctrl.similarity import HARDER, factor

    rows = []
    for name, made in chosen.made.items():
        here, meaning = chosen.here[name], ''
        by = factor(name, made, here)
        if by is not None and by > LEAST:
            meaning = HARDER[name][1]
        cells = ('–' if value is None else f'{value:.3g}' for value in (made, here, by))
        rows.append((name, *cells, meaning))
    trained = f'in {chosen.trained_for}'
    return ('number', trained, 'here', 'times harder', ''), rows


def _choice(chosen: Found) -> str:
    units, by = chosen.best.units, chosen.multiples
    return (
        f'L = {units.length_m:.4g} m, T = {units.time_s:.4g} s, m = {units.mass_kg:g} kg: '
        f'length × {by.length_m:.3g}, time × {by.time_s:.3g}, mass × {by.mass_kg:.3g}, force × '
        f'{by.force_n:.3g}. It misses the fewest requirements of the {chosen.tried} scalings that '
        'were flown, and then keeps the most room to the limits.'
    )
