# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""`rpo bench`."""

from __future__ import annotations

from typing import Annotated

import typer

EXAMPLES = """
Examples: `rpo bench inference` | `rpo bench training` | `rpo bench training --evaluations 600`
"""


def bench(
    what: Annotated[str, typer.Argument(help='inference or training')],
    evaluations: Annotated[
        int, typer.Option(min=1, help="controllers to fly; the paper's budget is 60 x 301")
    ] = 60 * 301,
    workers: Annotated[int, typer.Option(min=0, help='threads, 0 = one per core')] = 0,
) -> None:
    """Measure speed beside pyfuzzylite and scikit-fuzzy, which must be installed."""
    from rpo_core.validation import choice
    from rpo_training import bench as measure

    choice('what', what, ('inference', 'training'))
    typer.echo(measure.machine())
    if what == 'inference':
        rates = measure.inference()
        for rate in rates:
            typer.echo(
                f'{rate.name:26s} {rate.per_second:12.4g} inferences/s of one core   '
                f'ours {rates[0].per_second / rate.per_second:9.4g} x   '
                f'outputs differ by {rate.difference:.1e}'
            )
        return
    for part, nanoseconds in measure.breakdown().items():
        typer.echo(f'{part:20s} {nanoseconds:6.2f} ns per axis and step')
    budget = measure.training(evaluations, workers)
    typer.echo(
        f'{budget.evaluations} controllers x 216 starts x {budget.steps} steps on {budget.workers} '
        f'threads: {budget.wall_s:.1f} s ({budget.cpu_s:.1f} s of CPU); '
        f'{budget.loops_per_evaluation} axis loops a controller instead of 648, '
        f'{budget.inferences_per_cpu_s:.3g} inferences per CPU second'
    )
