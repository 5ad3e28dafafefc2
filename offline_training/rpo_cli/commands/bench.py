# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""`rpo bench`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rpo_cli.commands.shared import NoFail, Workers, end
from rpo_core.files.validation import InputError, choice

EXAMPLES = """
Examples: `rpo bench` | `rpo bench inference` | `rpo bench training --evaluations 600` |
`rpo bench --write docs/benchmarks.md`
"""

PARTS = ('all', 'inference', 'training', 'campaign', 'ros')


def bench(
    what: Annotated[str, typer.Argument(help=', '.join(PARTS))] = 'all',
    evaluations: Annotated[
        int, typer.Option(min=1, help="training: controllers; the paper's budget is 60 x 301")
    ] = 60 * 301,
    runs: Annotated[int, typer.Option(min=1, help='campaign: runs')] = 10_000,
    workers: Workers = 0,
    output: Annotated[Path, typer.Option(help='all: folder of the JSON file')] = Path('runs/bench'),
    write: Annotated[Path | None, typer.Option(help='all: page to put the table into')] = None,
    no_fail: NoFail = False,
) -> None:
    """Measure speed, and that of other tools in the same run: targets P1 to P5.

    Exit code 1: a target is missed; only the whole table judges.
    """
    from rpo_montecarlo import machine

    choice('what', what, PARTS)
    if write is not None and what != 'all':
        raise InputError('`--write` writes the whole table: leave the part out')
    typer.echo(machine.machine())
    load = machine.load_per_core()
    if load > machine.BUSY:
        typer.echo(
            f'Load {load:.1f} per core: other work slows this machine, and wall times include it.',
            err=True,
        )
    if what == 'all':
        end(not _all(output, write), no_fail)
    elif what == 'inference':
        _inference()
    elif what == 'training':
        _training(evaluations, workers)
    elif what == 'campaign':
        _campaign(runs, workers)
    else:
        _ros()


def _all(output: Path, page: Path | None) -> bool:
    """Measure all; return whether every target is held."""
    from rpo_cli.bench import table
    from rpo_cli.display import print_table, progress
    from rpo_montecarlo import outputs

    with progress() as show:
        found = table.run(lambda what, share: show(what, 100.0 * share, 100.0))
    print_table(table.HEADINGS, [row.cells for row in found.rows], left=3)
    typer.echo(table.save(found, output))
    if page is not None:
        outputs.put(page, 'rpo bench --write', table.markdown(found))
        typer.echo(page)
    return all(row.holds for row in found.rows)


def _inference() -> None:
    from rpo_cli.bench.inference import breakdown, inference

    rates = inference()
    for rate in rates:
        typer.echo(
            f'{rate.name:26s} {rate.per_second:12.4g} inferences/s of one core   '
            f'ours {rates[0].per_second / rate.per_second:9.4g} x   '
            f'outputs differ by {rate.difference:.1e}'
        )
    for part, nanoseconds in breakdown().items():
        typer.echo(f'{part:20s} {nanoseconds:6.2f} ns per axis and step')


def _training(evaluations: int, workers: int) -> None:
    from rpo_cli.bench.flying import training

    budget = training(evaluations, workers)
    typer.echo(
        f'{budget.evaluations} controllers x 216 starts x {budget.steps} steps on {budget.workers} '
        f'threads: {budget.wall_s:.1f} s ({budget.cpu_s:.1f} s of CPU); '
        f'{budget.loops_per_evaluation} axis loops a controller instead of 648, '
        f'{budget.inferences_per_cpu_s:.3g} inferences per CPU second'
    )


def _campaign(runs: int, workers: int) -> None:
    from rpo_cli.bench.flying import campaign

    found = campaign(runs, workers)
    typer.echo(
        f'{found.runs} runs x {found.ticks} steps: {found.wall_s:.1f} s ({found.cpu_s:.1f} s of '
        f'CPU); the core alone, run by run: {found.core_s_per_run:.3g} s of CPU a run'
    )


def _ros() -> None:
    from rpo_cli.bench import ros

    typer.echo(f'two bare rclpy processes: {ros.ping_pong():.0f} round trips/s')
    for name, fly in (
        ('4 processes', ros.four_processes),
        ('1 process', ros.one_process),
        ('full chain, 7 processes', ros.seven_processes),
    ):
        loop = fly()
        typer.echo(
            f'{name}: {loop.ticks_per_s:.0f} ticks/s, {loop.real_time_factor:.0f} x real time'
        )
