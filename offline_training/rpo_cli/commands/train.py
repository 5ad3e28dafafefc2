# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""`rpo train`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rpo_cli.commands.searching import end, fly
from rpo_cli.commands.shared import Cluster, NoFail, Workers, echo
from rpo_core.files.validation import InputError, choice

if TYPE_CHECKING:
    from rpo_core.control.controller import FuzzyController
    from rpo_training.config import TrainingConfig
    from rpo_training.family_training import FamilyTraining
    from rpo_training.training import Training

EXAMPLES = """
Examples: `rpo train` | `rpo train --scenario mine.yaml` | `rpo train --preset best -o runs/best` |
`rpo train --resume runs/best` | `rpo train --seed 3 --set ga.generations=50 --set genes.rules=odd`
| `rpo train --show > mine.yaml` then `rpo train --config mine.yaml` |
`rpo train --cluster tcp://127.0.0.1:8786` | `rpo train --family time_to_go`
"""


def train(
    preset: Annotated[
        str | None,
        typer.Option(
            help='paper, best, robust, allround, world, front, mission  '
            '[paper; with --scenario, mission]'
        ),
    ] = None,
    family: Annotated[
        str, typer.Option(help='train another family than the 30 parameters: pace, time_to_go')
    ] = '',
    scenario: Annotated[
        str, typer.Option(help='train for this scenario or set (name or file); scales are fitted')
    ] = '',
    config: Annotated[Path | None, typer.Option(help='YAML file, instead of a preset')] = None,
    seed: Annotated[int | None, typer.Option(help='seed of the random numbers')] = None,
    algorithm: Annotated[
        str | None, typer.Option(help='ga, cmaes, ga-cmaes, race or nsga2')
    ] = None,
    settings: Annotated[
        list[str] | None,
        typer.Option('--set', metavar='KEY=VALUE', help='any setting, as --show names it'),
    ] = None,
    output: Annotated[
        Path | None, typer.Option('--output', '-o', help='run folder  [runs/NAME_SEED]')
    ] = None,
    resume: Annotated[Path | None, typer.Option(help='run folder to go on with')] = None,
    workers: Workers = 0,
    cluster: Cluster = '',
    show: Annotated[bool, typer.Option('--show', help='print the configuration, and end')] = False,
    plots: Annotated[bool, typer.Option(help='pictures at the end')] = True,
    no_fail: NoFail = False,
) -> None:
    """Train a controller; the same configuration and seed give the same bits anywhere.

    Progress is saved after each generation: Ctrl-C stops cleanly, --resume goes on. Exit code 1:
    the best controller, which is written, misses a condition.
    """
    from rpo_training import config as configs
    from rpo_training.family_training import CONFIG as FAMILY
    from rpo_training.family_training import FamilyTraining, is_family
    from rpo_training.training import Training

    if resume is not None:
        given = (preset, config, seed, algorithm, settings, output)
        if family or scenario or any(option is not None for option in given):
            raise InputError('`--resume` takes its configuration from the run folder: give none')
        if (resume / FAMILY).exists():
            training = FamilyTraining.resume(resume, workers)
            end(training, fly(training), no_fail)
        else:
            _fly(Training.resume(resume, workers, cluster), plots, no_fail)
        return
    if family or (config is not None and is_family(config)):
        if preset or algorithm or cluster:
            raise InputError('`--family` takes no `--preset`, `--algorithm` and `--cluster`')
        found = _family(family, scenario, config, seed, settings or [], output, workers, show)
        if found is not None:
            end(found, fly(found), no_fail)
        return
    options = {'seed': seed, 'algorithm': algorithm}
    named = [f'{key}={value}' for key, value in options.items() if value is not None]
    for setting in settings or []:
        if setting.startswith('scenario='):
            raise InputError('`--set scenario=...` would keep the scales: use `--scenario`')
    chosen = configs.override(_base(preset, scenario, config), [*named, *(settings or [])])
    folder = output or Path('runs') / f'{chosen.name}_{chosen.seed}'
    if not any(setting.startswith('name=') for setting in settings or []):
        chosen = configs.override(chosen, [f'name={folder.resolve().name}'])
    if show:
        typer.echo(chosen.dumps(), nl=False)
        return
    _fly(Training.create(chosen, folder, workers, cluster), plots, no_fail)


def _family(
    family: str,
    scenario: str,
    path: Path | None,
    seed: int | None,
    settings: list[str],
    output: Path | None,
    workers: int,
    show: bool,
) -> FamilyTraining | None:
    """Return a training run of a family; None where its configuration was shown instead."""
    from rpo_training import config as configs
    from rpo_training import family_training

    if path is None:
        chosen = family_training.config_of(family, scenario)
    elif family or scenario:
        raise InputError('`--config` says family and scenario: give neither')
    else:
        chosen = family_training.FamilyConfig.load(path)
    named = [] if seed is None else [f'seed={seed}']
    chosen = configs.override(chosen, [*named, *settings])
    folder = output or Path('runs') / f'{chosen.name}_{chosen.seed}'
    if not any(setting.startswith('name=') for setting in settings):
        chosen = configs.override(chosen, [f'name={folder.resolve().name}'])
    if show:
        typer.echo(chosen.dumps(), nl=False)
        return None
    return family_training.FamilyTraining.create(chosen, folder, workers)


def _base(preset: str | None, scenario: str, path: Path | None) -> TrainingConfig:
    from rpo_training import config as configs

    name = preset or ('mission' if scenario else 'paper')
    known = configs.PRESETS[choice('--preset', name, configs.PRESETS)]
    base = known if path is None else configs.TrainingConfig.load(path)
    return configs.fitted(base, scenario) if scenario else base


def _fly(training: Training, plots: bool, no_fail: bool) -> None:
    best = fly(training)
    if plots:
        _draw(training, best)
    end(training, best, no_fail)


def _draw(training: Training, best: FuzzyController) -> None:
    try:
        from rpo_report.training import draw_run
    except ImportError:
        typer.echo('No pictures: matplotlib is not installed.', err=True)
        return
    for path in draw_run(training.folder, best):
        echo(path)
