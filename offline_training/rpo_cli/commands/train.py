# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""`rpo train`: show a search, stop it cleanly, print its result."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rpo_cli.commands import shared
from rpo_cli.commands.shared import Cluster, NoFail, Workers, echo, interruptible
from rpo_cli.display import TrainingDisplay
from rpo_core.files.validation import InputError, choice

if TYPE_CHECKING:
    from rpo_training.attitude_training import AttitudeConfig
    from rpo_training.config import TrainingConfig
    from rpo_training.run import Config, Found, SearchRun


def train(
    context: typer.Context,
    kind: Annotated[
        str | None,
        typer.Argument(help='tune a baseline: pd, lqr, mpc or apf_smc; else, train a fuzzy one'),
    ] = None,
    preset: Annotated[
        str | None,
        typer.Option(
            help='paper, best, robust, allround, front, mission  [paper; with --scenario, mission]'
        ),
    ] = None,
    family: Annotated[
        str, typer.Option(help='another family than the 30 numbers: more_words, time_to_go')
    ] = '',
    attitude: Annotated[
        bool, typer.Option('--attitude', help='train a controller of attitude: paper, best')
    ] = False,
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
    """Train or tune a controller; the same configuration and seed give the same bits anywhere.

    Progress is saved after each generation: Ctrl-C stops cleanly, --resume goes on. A baseline has
    the same starts and fitness, and at most the evaluations of the paper: 60 x 301.

    Exit code 1: the best controller, which is written, misses a condition.
    """
    from rpo_ctrl.similarity import PAPER
    from rpo_training import config as configs
    from rpo_training.attitude_training import AttitudeTraining
    from rpo_training.family_training import FamilyConfig, FamilyTraining
    from rpo_training.training import Training
    from rpo_training.tuning import Tuning, TuningConfig

    runs: tuple[type[SearchRun[Any, Any]], ...] = (
        FamilyTraining,
        AttitudeTraining,
        Tuning,
        Training,
    )
    shared.refuse_workers_of_a_scheduler(workers, cluster)
    if resume is not None:
        shared.refuse_beside(context, 'resume', 'workers', 'cluster', 'plots', 'no_fail')
        run = next((r for r in runs if (resume / r.config_type.file).exists()), Training)
        _refuse_of_another_kind(context, run)
        _finish(run.resume(resume, workers, cluster), plots, no_fail)
        return
    changes = list(settings or ())
    _refuse_given_twice(context, changes)
    if config is not None and preset:
        raise InputError('`--preset` and `--config` are two configurations: give one of them')
    if any(_key(setting) == 'scenario' for setting in changes):
        raise InputError('`--set scenario=...` would keep the scales: use `--scenario`')
    schema = '' if config is None else configs.schema_of(config)
    named = 'a baseline' if kind else '`--family`' if family else '`--config`'
    if kind or family or schema in (FamilyConfig.schema, TuningConfig.schema):
        if preset or algorithm or attitude or (kind and family):
            raise InputError(f'{named} takes no `--preset`, `--algorithm` and `--attitude`')
        if config is not None and (kind or family or scenario):
            raise InputError('`--config` says what is searched and the scenario: give neither')
        if config is not None:
            of: Any = FamilyConfig if schema == FamilyConfig.schema else TuningConfig
            base: Any = of.load(config)
        else:
            of = FamilyConfig if family else TuningConfig
            base = of.of(family or str(kind), scenario=scenario or PAPER)
    elif not attitude:
        base = _base(preset, scenario, config)
    elif scenario:
        raise InputError('`--attitude` takes no `--scenario`')
    else:
        base = _base_of_attitude(preset, config)
    run = next(r for r in runs if r.config_type is type(base))
    _refuse_of_another_kind(context, run)
    options = {'seed': seed, 'algorithm': algorithm}
    options = {key: value for key, value in options.items() if value is not None}
    chosen = configs.override(base, [*(f'{k}={v}' for k, v in options.items()), *changes])
    folder = output or Path('runs') / f'{chosen.name}_{chosen.seed}'
    if not any(_key(setting) == 'name' for setting in changes):
        chosen = configs.override(chosen, [f'name={folder.resolve().name}'])
    if show:
        typer.echo(chosen.dumps(), nl=False)
        return
    _finish(run.create(chosen, folder, workers, cluster), plots, no_fail)


def _key(setting: str) -> str:
    """Return the key of a setting KEY=VALUE."""
    return setting.partition('=')[0].strip()


def _refuse_given_twice(context: typer.Context, settings: list[str]) -> None:
    """Raise InputError if an option and a setting say the same."""
    for key in sorted({_key(each) for each in settings} & set(shared.given(context))):
        option = shared.given(context)[key]
        raise InputError(f'`{option}` and `--set {key}=...` say the same: give one of them')


def _refuse_of_another_kind(context: typer.Context, run: type[SearchRun[Any, Any]]) -> None:
    """Raise InputError for options that only the training of the 30 numbers takes."""
    from rpo_training.training import Training

    for option in sorted({'cluster', 'plots'} & set(shared.given(context))):
        if run is not Training and context.params[option]:
            raise InputError(
                f'`--{option}` is for a training of the 30 numbers: one of a baseline, a family or '
                'attitude, new or with `--resume`, runs on the threads of `--workers` and has no '
                'pictures'
            )


def _base_of_attitude(preset: str | None, path: Path | None) -> AttitudeConfig:
    from rpo_training.attitude_training import PRESETS, AttitudeConfig

    known = PRESETS[choice('--preset', preset or 'paper', PRESETS)]
    return known if path is None else AttitudeConfig.load(path)


def _base(preset: str | None, scenario: str, path: Path | None) -> TrainingConfig:
    from rpo_training import config as configs

    name = preset or ('mission' if scenario else 'paper')
    known = configs.PRESETS[choice('--preset', name, configs.PRESETS)]
    base = known if path is None else configs.TrainingConfig.load(path)
    return configs.fitted(base, scenario) if scenario else base


def _finish(run: SearchRun[Config, Found], plots: bool, no_fail: bool) -> None:
    """Fly a run to its end, and draw what the training of a force has found."""
    from rpo_training.training import Training

    best = fly(run)
    if plots and isinstance(run, Training):
        try:
            from rpo_report.training import draw_run
        except ImportError:
            typer.echo('No pictures: matplotlib is not installed.', err=True)
        else:
            for path in draw_run(run.folder, best):
                echo(path)
    end(run, best, no_fail)


def fly(run: SearchRun[Config, Found]) -> Found:
    """Fly a run to its end and return the best; if interrupted, print how to go on, and exit."""
    from rpo_training.config import COMMAND

    def sentence() -> str:
        return (
            f'Interrupted after {len(run.checkpoint.scores)} generations, which are saved. '
            f'Go on with: {COMMAND} {shlex.join(["--resume", str(run.folder)])}'
        )

    with interruptible(sentence), TrainingDisplay(run.folder) as display:
        best = run.run(display.show)
    made = best.provenance
    echo(f'{made["stopped"]}; {made["evaluations"]} controllers evaluated')
    fitness, energy, _, misses = (made[name] for name in run.scored)
    missed = ', '.join(f'{name} {n}' for name, n in misses.items())
    typer.echo(
        f'fitness {fitness:.4f} {run.unit}, mean J {energy:.4f} {run.unit}; '
        f'of {run.flown} miss: {missed}'
    )
    echo(f'{run.folder / best.name}.yaml')
    return best


def end(run: SearchRun[Config, Found], best: Found, no_fail: bool) -> None:
    """End with exit code 1 and a sentence if the best controller misses a condition."""
    missed = best.provenance[run.scored[-1]].items()
    which = ', '.join(f'{name} from {n} of {run.flown}' for name, n in missed if n)
    if not which:
        return
    echo(
        f'The best controller misses conditions of {run.config.scenario}: {which}. '
        'It is written. Try another seed or more evaluations; or give the scenario more time, '
        'force or weaker limits.',
        err=True,
    )
    shared.end(missed=True, no_fail=no_fail)
