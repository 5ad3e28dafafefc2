# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""`rpo tune`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rpo_cli.commands.searching import end, fly
from rpo_cli.commands.shared import NoFail, Workers
from rpo_core.files.validation import InputError

EXAMPLES = """
Examples: `rpo tune pd` | `rpo tune mpc --seed 2 -o runs/mpc` | `rpo tune --resume runs/mpc` |
`rpo tune lqr --disturbance 20`
"""


def tune(
    kind: Annotated[str | None, typer.Argument(help='pd, lqr, mpc or apf_smc')] = None,
    seed: Annotated[int, typer.Option(help='seed of the random numbers')] = 1,
    evaluations: Annotated[
        int | None, typer.Option(help="at most, and no more than the paper's 60 x 301")
    ] = None,
    scenario: Annotated[
        str, typer.Option(help='tune for this scenario or set (name or file)')
    ] = 'paper_training',
    disturbance: Annotated[
        float, typer.Option(help="weight [N² s] of the paper's test, which training does not see")
    ] = 0.0,
    output: Annotated[
        Path | None, typer.Option('--output', '-o', help='folder  [runs/tune_NAME_SEED]')
    ] = None,
    resume: Annotated[Path | None, typer.Option(help='folder to go on with')] = None,
    workers: Workers = 0,
    no_fail: NoFail = False,
) -> None:
    """Tune a baseline controller: same starts and fitness as training, the paper's budget at most.

    Progress is saved after each generation: Ctrl-C stops cleanly, --resume goes on. Exit code 1:
    the best one, which is written, misses a condition.
    """
    from rpo_training.tuning import BUDGET, Tuning, TuningConfig

    if (kind is None) == (resume is None):
        raise InputError('say what to tune, pd, lqr, mpc or apf_smc; or --resume FOLDER')
    if resume is not None:
        tuning = Tuning.resume(resume, workers)
        end(tuning, fly(tuning), no_fail)
        return
    budget = BUDGET if evaluations is None else evaluations
    config = TuningConfig(str(kind), seed, budget, disturbance, scenario=scenario)
    tuning = Tuning.create(config, output or Path(f'runs/tune_{config.name}_{seed}'), workers)
    end(tuning, fly(tuning), no_fail)
