# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""`rpo scale`."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from rpo.cli.commands.shared import NoFail, Output, Set, echo, end
from rpo.cli.display import print_table, progress

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
    from rpo.montecarlo import outputs
    from rpo.training.scaling import search
    from rpo_core import files
    from rpo_core.chain.flight import fly
    from rpo_core.control.controller import dumps, load_controller
    from rpo_core.judge import similarity
    from rpo_core.judge.verdicts import missed
    from rpo_core.scenario import overrides
    from rpo_core.scenario import scenario as scenarios
    from rpo_log.show import report

    given, named = load_controller(controller), scenario
    content = overrides.text_of(scenario, changes or [])
    loaded = files.loads(content, scenarios.parse, scenario)
    with progress() as show:
        found = search(given, loaded, show)
    goal = loaded.name.replace(overrides.CHANGED, '_changed')
    name = outputs.identifier(f'{given.name}_{goal}') if output is None else output.stem
    path = output or Path(f'runs/scaled/{name}.yaml')
    outputs.make_folder(path.parent)
    if changes:
        named = str(path.with_name(f'{path.stem}_scenario.yaml'))
        outputs.write_text(Path(named), content)
    command = similarity.command(controller, scenario, changes or ())
    scaled = found.named(name, controller, named, command)
    outputs.write_text(path, dumps(scaled))
    rows = []
    for number, made in found.made.items():
        by = similarity.factor(number, made, found.here[number])
        cells = ('–' if v is None else f'{v:.3g}' for v in (made, found.here[number], by))
        rows.append((number, *cells, similarity.HARDER[number][1] if by and by > LEAST else ''))
    headings = ('number', f'in {found.trained_for}', 'here', 'times harder', '')
    print_table(headings, rows, f'{loaded.name}, {controller} scaled: similarity numbers')
    units, ratio = found.best.units, found.multiples
    echo(
        f'L = {units.length_m:.4g} m, T = {units.time_s:.4g} s, m = {units.mass_kg:g} kg: length × '
        f'{ratio.length_m:.3g}, time × {ratio.time_s:.3g}, mass × {ratio.mass_kg:.3g}, force × '
        f'{ratio.force_n:.3g}. It misses the fewest requirements of the {found.tried} scalings '
        'that were flown, and then keeps the most room to the limits.'
    )
    if isinstance(loaded, scenarios.ScenarioSet):
        failed = judge_by(scaled, scaled.name, loaded)
    else:
        flight = fly(loaded, scaled)
        report.print_table(flight, f'{loaded.name}, controller {scaled.name}')
        failed = missed(flight)
    for sentence in found.why:
        echo(f'Why: {sentence}.')
    if found.why:
        echo(f'Training may do more: `{shlex.join(["rpo", "train", "--scenario", named])}`')
    echo(path)
    end(failed, no_fail)
