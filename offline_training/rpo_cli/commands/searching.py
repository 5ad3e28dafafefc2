# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What `rpo train` and `rpo tune` share: show a run, stop it cleanly, print its result."""

from __future__ import annotations

import shlex
from typing import TYPE_CHECKING

import typer

from rpo_cli.commands import shared
from rpo_cli.commands.shared import echo, interruptible

if TYPE_CHECKING:
    from rpo_training.run import Config, Found, SearchRun


def fly(run: SearchRun[Config, Found]) -> Found:
    """Fly a run to its end and return the best; if interrupted, print how to go on, and exit."""
    from rpo_cli.progress import TrainingDisplay

    def sentence() -> str:
        return (
            f'Interrupted after {len(run.checkpoint.scores)} generations, which are saved. '
            f'Go on with: {run.command} {shlex.join(["--resume", str(run.folder)])}'
        )

    with interruptible(sentence), TrainingDisplay(run.folder) as display:
        best = run.run(display.show)
    made = best.provenance
    echo(f'{made["stopped"]}; {made["evaluations"]} controllers evaluated')
    count = len(run.starts.initial_positions_m)
    missed = ', '.join(f'{name} {n}' for name, n in made['starts_that_miss'].items())
    typer.echo(
        f'fitness {made["fitness_n2s"]:.4f} N^2 s, mean J {made["mean_energy_n2s"]:.4f} '
        f'N^2 s; of {count} starts miss: {missed}'
    )
    echo(f'{run.folder / best.name}.yaml')
    return best


def end(run: SearchRun[Config, Found], best: Found, no_fail: bool) -> None:
    """End with exit code 1 and a sentence if the best controller misses a condition."""
    misses = {name: n for name, n in best.provenance['starts_that_miss'].items() if n}
    if not misses:
        return
    count = len(run.starts.initial_positions_m)
    which = ', '.join(f'{name} from {n} of {count} starts' for name, n in misses.items())
    echo(
        f'The best controller misses conditions of {run.scenario}: {which}. It is written. Try '
        'another seed or more evaluations; or give the scenario more time, force or weaker limits.',
        err=True,
    )
    shared.end(missed=True, no_fail=no_fail)
