# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""`rpo train`: show a search, stop it cleanly, print its result."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer import Argument, Option

from rpo.cli.commands import shared
from rpo.cli.commands.shared import NoFail, Output, Resume, Workers, echo
from rpo_core.files.validation import InputError, choice

if TYPE_CHECKING:
    from rpo.door.train import AnyRun


def train(
    context: typer.Context,
    kind: Annotated[str | None, Argument(help='baseline to tune: pd, lqr, mpc, apf_smc')] = None,
    preset: Annotated[
        str | None,
        Option(
            help='paper, best, robust, allround, front, mission  [paper; with --scenario, mission]'
        ),
    ] = None,
    family: Annotated[str, Option(help='another form of rules: more_words, time_to_go')] = '',
    attitude: Annotated[bool, Option('--attitude', help='of attitude: paper, best')] = False,
    scenario: Annotated[str, Option(help='train for this scenario or set (name or file)')] = '',
    config: Annotated[Path | None, Option(help='YAML file, instead of a preset')] = None,
    seed: Annotated[int | None, Option(help='seed of the random numbers')] = None,
    algorithm: Annotated[str | None, Option(help='ga, cmaes, ga-cmaes, race or nsga2')] = None,
    settings: Annotated[
        list[str] | None,
        Option('--set', metavar='KEY=VALUE', help='any setting, as --show names it'),
    ] = None,
    output: Output = None,
    resume: Resume = None,
    workers: Workers = 0,
    show: Annotated[bool, Option('--show', help='print the configuration, and end')] = False,
    plots: Annotated[bool, Option(help='pictures at the end')] = True,
    no_fail: NoFail = False,
) -> None:
    """Train or tune a controller; the same configuration and seed give the same bits anywhere.

    Progress is saved after each generation: Ctrl-C stops cleanly, --resume goes on. A baseline has
    the same starts and fitness, and at most the evaluations of the paper: 60 x 301.

    Exit code 1: the best controller, which is written, misses a condition.
    """
    from rpo.door.train import SEARCHES, configured, named_as
    from rpo.training.attitude_training import PRESETS as ATTITUDE
    from rpo.training.config import EXAMPLE, PRESETS, schema_of
    from rpo.training.family_training import FamilyConfig
    from rpo.training.training import Training
    from rpo.training.tuning import TUNING_SPACES, TuningConfig
    from rpo_core.control.family import family_of
    from rpo_core.scenario.overrides import read

    if resume is not None:
        shared.refuse_beside(context, 'resume', 'workers', 'plots', 'no_fail')
        searches = SEARCHES.values()
        search = next((s for s in searches if (resume / s.config_type.file).exists()), Training)
        _refuse_of_another_kind(context, search)
        _finish(search.resume(resume, workers), resume, plots, no_fail)
        return
    changes = read(settings or (), EXAMPLE)
    for key in sorted(changes.keys() & set(shared.given(context))):
        option = shared.given(context)[key]
        raise InputError(f'`{option}` and `--set {key}=...` say the same: give one of them')
    if config is not None and preset:
        raise InputError('`--preset` and `--config` are two configurations: give one of them')
    if 'scenario' in changes:
        raise InputError('`--set scenario=...` would keep the scales: use `--scenario`')
    schema = '' if config is None else schema_of(config)
    named = 'a baseline' if kind else '`--family`' if family else '`--config`'
    if kind or family or schema in (FamilyConfig.schema, TuningConfig.schema):
        if preset or algorithm or attitude or (kind and family):
            raise InputError(f'{named} takes no `--preset`, `--algorithm` and `--attitude`')
        if config is not None and (kind or family or scenario):
            raise InputError('`--config` says what is searched and the scenario: give neither')
        if kind:
            choice('kind', kind, TUNING_SPACES)
        elif family:
            family_of(family)
    elif attitude and scenario:
        raise InputError('`--attitude` takes no `--scenario`')
    elif preset:
        choice('--preset', preset, ATTITUDE if attitude else PRESETS)
    given = {'seed': seed, 'algorithm': algorithm}
    changes = {**{k: v for k, v in given.items() if v is not None}, **changes}
    chosen = configured(config or kind or family or preset, scenario, attitude, changes)
    search = SEARCHES[type(chosen)]
    _refuse_of_another_kind(context, search)
    folder = output or Path('runs') / f'{chosen.name}_{chosen.seed}'
    if 'name' not in changes:
        chosen = named_as(folder, chosen)
    if show:
        typer.echo(chosen.dumps(), nl=False)
        return
    _finish(search.create(chosen, folder, workers), folder, plots, no_fail)


def _refuse_of_another_kind(context: typer.Context, search: Any) -> None:
    """Raise InputError for the option that only the training of the 30 numbers takes."""
    from rpo.training.training import Training

    if search is not Training and 'plots' in shared.given(context) and context.params['plots']:
        raise InputError(
            '`--plots` is for a training of the 30 numbers: one of a baseline, a family or '
            'attitude, new or with `--resume`, has no pictures'
        )


def _finish(run: AnyRun, folder: Path, plots: bool, no_fail: bool) -> None:
    """Fly a run to its end, print the best, and draw what the training of a force has found."""
    from rpo.door.train import trained
    from rpo.training.training import Training

    with shared.saved_work(folder, 'finished generations', 'rpo', 'train') as show:
        ended = trained(run, show)
    best, (fitness, energy, _, misses) = ended.best, ended.scores
    made = best.provenance
    echo(f'{made["stopped"]}; {made["evaluations"]} controllers evaluated')
    missed = ', '.join(f'{name} {n}' for name, n in misses.items())
    typer.echo(
        f'fitness {fitness:.4f} {run.unit}, mean J {energy:.4f} {run.unit}; '
        f'of {run.flown} miss: {missed}'
    )
    echo(f'{folder / best.name}.yaml')
    if plots and isinstance(run, Training):
        try:
            from rpo.reports.training import draw_run
        except ImportError:
            typer.echo('No pictures: matplotlib is not installed.', err=True)
        else:
            for path in draw_run(folder):
                echo(path)
    which = ', '.join(f'{name} from {n} of {run.flown}' for name, n in misses.items() if n)
    if which:
        echo(
            f'The best controller misses conditions of {run.config.scenario}: {which}. It is '
            'written. Try another seed or more evaluations; or give the scenario more time, force '
            'or weaker limits.',
            err=True,
        )
    shared.end(bool(which), no_fail)
