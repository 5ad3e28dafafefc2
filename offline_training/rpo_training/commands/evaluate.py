# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""`rpo evaluate`."""

from __future__ import annotations

import csv as csv_files
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rpo_core.validation import InputError
from rpo_training.commands.shared import Workers
from rpo_training.outputs import writing

if TYPE_CHECKING:
    from rpo_core.controller import AnyController
    from rpo_training.evaluation.assessment import Assessment

EXAMPLES = """
Examples: `rpo evaluate trained` | `rpo evaluate trained paper_ga` |
`rpo evaluate runs/best/best.yaml --starts` | `rpo evaluate trained --csv starts.csv` |
`rpo evaluate trained pd --scenario mine.yaml` | `rpo evaluate --estimator world_leo --runs 100`
"""


def evaluate(
    controllers: Annotated[
        list[str] | None, typer.Argument(help='shipped names or files; none with --estimator')
    ] = None,
    scenario: Annotated[
        str,
        typer.Option(
            help='judge by what this scenario or set requires (name or file)  [what each was '
            'trained for; the targets for paper_training]'
        ),
    ] = '',
    starts: Annotated[bool, typer.Option('--starts', help='print all 216 starts')] = False,
    csv: Annotated[Path | None, typer.Option(help='write the starts to this file')] = None,
    check: Annotated[
        bool, typer.Option('--check', help='exit code 1 if a target is missed')
    ] = False,
    estimator: Annotated[
        str, typer.Option(help='judge the estimator of this scenario (name or file) instead')
    ] = '',
    runs: Annotated[int, typer.Option(help='flights that judge an estimator', min=2)] = 1000,
    workers: Workers = 0,
) -> None:
    """Judge fuzzy controllers by the targets Q1-Q5; compare each start with the least energy.

    Q1 to Q5: conditions from every start, energy, the paper's test, no limit cycle, readable rules.
    A controller that was trained for another scenario than the paper's is judged by what that
    requires; with --scenario, all are. With --estimator, a filter is judged by the errors of its
    estimates over many flights with the noise that it is told.
    """
    from rpo_core.controller import load_controller, only_fuzzy
    from rpo_training.display import print_table
    from rpo_training.evaluation.assessment import PAPER, assess
    from rpo_training.evaluation.judgement import trained_for

    if bool(estimator) == bool(controllers):
        raise InputError('`controllers` or `--estimator` must be given, and not both')
    missed = _judge_estimator(estimator, runs) if estimator else False
    for name in controllers or ():
        loaded = load_controller(name)
        of = scenario or trained_for(loaded)
        if of and (scenario or of != PAPER):
            if starts or csv:
                raise InputError(f'`--starts` and `--csv` go with the targets, not with {of}')
            missed |= _judge(loaded, name, of)
            continue
        found = assess(only_fuzzy(loaded), workers)
        missed |= not all(target.holds for target in found.targets())
        _print_targets(found)
        typer.echo(_bindings(found))
        if starts:
            title = f'{found.controller.name}: training starts'
            print_table(_HEADINGS, _rows(found), title, left=0)
        if csv:
            with writing(csv), csv.open('w', newline='') as file:
                writer = csv_files.writer(file, lineterminator='\n')
                writer.writerows([_HEADINGS, *_rows(found)])
    if check and missed:
        raise typer.Exit(1)


def _judge(controller: AnyController, name: str, scenario: str) -> bool:
    """Print how a controller keeps the requirements of a scenario; return whether it misses any."""
    from rpo_core.scenario import load
    from rpo_training.display import print_table, progress
    from rpo_training.evaluation.judgement import HEADINGS, judge, rows_of

    found = load(scenario)
    with progress() as show:
        judgements = judge(controller, found, show)
    print_table(HEADINGS, rows_of(judgements), f'{name}: requirements of {found.name}')
    return any(j.missed for j in judgements)


def _judge_estimator(name: str, runs: int) -> bool:
    """Print how consistent the estimator of a scenario is; return whether a mean is out of bounds.

    With the sensors as they are, and with a tenth of the measurements lost and 0.3 s late.
    """
    from rpo_core.scenario import load_scenario
    from rpo_training.display import print_table, progress
    from rpo_training.evaluation.consistency import HEADINGS, consistency, rows_of, told

    scenario = load_scenario(name)
    late = round(0.3 / scenario.dt_s)
    cases = {
        'sensors as they are': told(scenario),
        '10 % lost, 0.3 s late': told(scenario, dropout_share=0.1, latency_ticks=late),
    }
    missed = False
    for case, flown in cases.items():
        with progress() as show:
            found = consistency(flown, runs, show)
        print_table(HEADINGS, rows_of(found), f'{scenario.name}, {case}: {runs} flights')
        missed |= not found.holds
    return missed


def _print_targets(found: Assessment) -> None:
    from rpo_training.display import print_table
    from rpo_training.evaluation.assessment import QUESTIONS

    rows = [
        (
            target.name,
            target.what,
            f'{target.limit:.4g} {target.unit}',
            f'{target.reached:.4g} {target.unit}',
            'held' if target.holds else 'MISSED',
        )
        for target in found.targets()
    ]
    headings = ('', 'what', 'limit', 'reached', '')
    print_table(headings, rows, f'{found.controller.name}: targets', left=2)
    typer.echo(QUESTIONS)


def _bindings(found: Assessment) -> str:
    from rpo_core.metrics import ARRIVAL_DISTANCE, ARRIVAL_SPEED, ENERGY, SLEW

    rows, bindings = found.metrics, found.binding
    worst = rows.max(axis=0)
    counts = ', '.join(f'{name} {bindings.count(name)}' for name in sorted(set(bindings)))
    least = float(found.least.mean())
    return (
        f'mean J {found.mean_energy_n2s:.4f} N^2 s = {found.mean_energy_n2s / least:.2f} x the '
        f'least to rest in 200 s without conditions ({least:.3f}); from [100, 100, 100] m '
        f'{rows[-1, ENERGY]:.3f} = {rows[-1, ENERGY] / found.least[-1]:.2f} x\n'
        f'worst start: speed {worst[ARRIVAL_SPEED]:.4f} m/s, slew {worst[SLEW]:.4f} N/s, '
        f'distance {worst[ARRIVAL_DISTANCE]:.4f} m; condition nearest its limit: {counts}'
    )


_HEADINGS = (
    'x [m]',
    'y [m]',
    'z [m]',
    'J [N^2 s]',
    'J / least',
    'speed [m/s]',
    'slew [N/s]',
    'distance [m]',
    'nearest limit',
)


def _rows(found: Assessment) -> list[list[str]]:
    from rpo_core.metrics import ARRIVAL_DISTANCE, ARRIVAL_SPEED, ENERGY, SLEW

    return [
        [
            *(f'{r:g}' for r in start),
            f'{row[ENERGY]:.4f}',
            f'{row[ENERGY] / least:.3f}',
            f'{row[ARRIVAL_SPEED]:.5f}',
            f'{row[SLEW]:.5f}',
            f'{row[ARRIVAL_DISTANCE]:.5f}',
            binding,
        ]
        for start, row, least, binding in zip(
            found.starts, found.metrics, found.least, found.binding, strict=True
        )
    ]
