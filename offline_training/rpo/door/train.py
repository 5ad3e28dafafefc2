# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The training of a controller: the best, how it was found, and how the search went."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from rpo.display import Show, progress_in_python
from rpo.door.subjects import fields_of, proposing
from rpo.training import attitude_training, config, training
from rpo.training.attitude_training import AttitudeConfig, AttitudeTraining
from rpo.training.config import Configuration, TrainingConfig
from rpo.training.family_training import FamilyConfig, FamilyTraining
from rpo.training.run import SearchRun
from rpo.training.tuning import TUNING_SPACES, Tuning, TuningConfig
from rpo_core.control.family import families
from rpo_core.files.validation import InputError, choice, missing_reported, shown, whole
from rpo_core.judge.similarity import PAPER

AnyRun = SearchRun[Any, Any]

SEARCHES: Mapping[type[Configuration], type[AnyRun]] = {
    FamilyConfig: FamilyTraining,
    AttitudeConfig: AttitudeTraining,
    TuningConfig: Tuning,
    TrainingConfig: training.Training,
}
"""Kind of a configuration -> its search; the last one is of the 30 numbers."""


class Training:
    """A search that has ended.

    Attributes
    ----------
    best : controller
        The best: it flies, explains and exports; its name, description and provenance say how it
        was found.
    configuration : Configuration
        All that determines the outcome; ``configuration.command`` repeats it.
    folder : Path or None
        Where the run is, if it is in a folder.
    """

    def __init__(self, run: AnyRun, best: Any) -> None:
        self.run, self.best = run, best
        self.configuration, self.folder = run.config, run.folder

    @cached_property
    def history(self) -> Any:
        """A structured NumPy array: a row a generation, the first ones random; columns by name.

        `generation`, `evaluations` (controllers so far); `best_fitness` (least so far),
        `mean_fitness`, `fitness_spread` (standard deviation) [N²s]; of the best `best_energy_n2s`,
        `best_misses_...` (starts that miss a condition), `best_arrival_s`; `stage` (each has a
        fitness of its own). ``pandas.DataFrame(search.history)`` makes a table of it.

        Examples
        --------
        >>> import rpo
        >>> search = rpo.train('paper', generations=2, seed=4, ga__population=8)
        >>> search.history['evaluations'].tolist()
        [8, 13, 18]
        >>> search.history[-2:]['generation'].tolist()
        [1, 2]
        """
        rows = self.run.history
        types = [(name, type(value)) for name, value in rows[0].items()]
        return np.array([tuple(row.values()) for row in rows], types)

    @property
    def scores(self) -> tuple[float, float, float, dict[str, int]]:
        """Fitness, mean energy [N²s] and arrival time [s] of the best; condition -> misses."""
        fitness, energy, arrival_s, misses = (self.best.provenance[n] for n in self.run.scored)
        return fitness, energy, arrival_s, misses

    @property
    def ok(self) -> bool:
        """Whether the best controller meets all conditions from every start."""
        return not any(self.scores[3].values())

    def __repr__(self) -> str:
        fitness, energy, _, misses = self.scores
        missed = ', '.join(f'{name} {n}' for name, n in misses.items())
        return (
            f'<Training {self.configuration.name}: {self.best.provenance["evaluations"]} '
            f'controllers; the best over {self.run.flown} of {self.configuration.scenario}: '
            f'fitness {fitness:.4g}, mean J {energy:.4g} {self.run.unit}; misses: {missed}>'
        )

    def plot(self, ax: Any = None) -> Any:
        """Draw fitness and energy over the number of controllers.

        Parameters
        ----------
        ax : matplotlib Axes, optional
            Where to draw; a new figure without.

        Returns
        -------
        Axes
            Where it was drawn.

        Raises
        ------
        InputError
            If matplotlib is not installed.

        Examples
        --------
        >>> import rpo
        >>> search = rpo.train('paper', generations=2, seed=4, ga__population=8)
        >>> len(search.plot().lines)
        3
        """
        with missing_reported():
            from matplotlib import pyplot

            from rpo.reports.training import convergence
            from rpo_log.show import style

        with style.applied():
            size = (style.WIDTH_IN, 4.4)
            ax = ax or pyplot.subplots(figsize=size, layout='constrained')[1]
            convergence(ax, self.history)
            ax.legend()
        return ax


@proposing
def train(
    configuration: str | Path | Configuration | None = None,
    generations: int | None = None,
    seed: int | None = None,
    *,
    scenario: str | Path = '',
    attitude: bool = False,
    folder: str | Path | None = None,
    workers: int = 0,
    **settings: Any,
) -> Training:
    """Train or tune a controller, with the bits of `rpo train`.

    `rpo train` computes in the same way on every x86-64 processor; Python that has imported NumPy
    takes what its processor has, and a warning says so: the last bits of CMA-ES may then differ.

    Parameters
    ----------
    configuration : str, Path or Configuration, optional
        Preset (`paper`, `best`, `robust`, `allround`, `front`, `mission`), baseline (`pd`, `lqr`,
        `mpc`, `apf_smc`), family (`more_words`, `time_to_go`), path of a file, or an object.
        Without, `paper`; with a scenario, `mission`.
    generations : int, optional
        Of the genetic algorithm; without, as many as the configuration says.
    seed : int, optional
        Of the random numbers; without, that of the configuration.
    scenario : str or Path
        Train for this scenario or set: name or path.
    attitude : bool
        Whether the preset (`paper` or `best`) is that of the attitude controller.
    folder : str or Path, optional
        Where the run is saved after each generation; the same call goes on there, and so does
        `rpo train --resume`. Without, it is in memory alone.
    workers : int
        Threads; 0: one per core.
    **settings
        Any setting of the configuration with its new value; two underscores lead into a section:
        ``ga__population=30``. `rpo train --show` names them.

    Returns
    -------
    Training
        The best controller, the history; it draws itself.

    Raises
    ------
    InputError
        If configuration, scenario or a setting is none, or no controller can fly the scenario.

    Examples
    --------
    >>> import rpo
    >>> search = rpo.train('paper', generations=2, seed=4, ga__population=8)
    >>> search.best
    <FuzzyController paper_ga_2_generations_seed_4: Trained from paper_ga, 2 generations, seed 4.>
    >>> rpo.fly('paper_test', search.best).metrics['energy_n2s'] > 1.0
    True
    >>> rpo.train('pd', evaluations=20)
    <Training pd_seed_1: 20 controllers; the best over 216 starts of paper_training: fitness ...>
    >>> rpo.train('papr')
    Traceback (most recent call last):
        ...
    rpo_core.files.validation.InputError: `configuration` must be one of paper, best, ...
    """
    changes = {} if seed is None else {'seed': seed}
    chosen = configured(configuration, str(scenario), attitude, {**changes, **fields_of(settings)})
    if generations is not None:
        chosen = _of_generations(chosen, generations)
    path, preset = None if folder is None else Path(folder), chosen.name
    if path is not None and 'name' not in settings:
        chosen = named_as(path, chosen)
    elif 'name' not in settings and not isinstance(configuration, Configuration):
        length = f'_{generations}_generations' if generations else ''
        chosen = config.changed(chosen, {'name': f'{preset}{length}_seed_{chosen.seed}'})
    run = SEARCHES[type(chosen)].begin(chosen, path, workers)
    with progress_in_python() as show:
        search = trained(run, show)
    best, length = search.best, f'{search.best.provenance["generations"]} generations'
    text = f'{best.description} Trained from {preset}, {length}, seed {chosen.seed}.'
    search.best = replace(best, description=text.strip())
    return search


def trained(run: AnyRun, show: Show) -> Training:
    """Run a search to its end; show each generation."""

    def report() -> None:
        row = run.history[-1]
        missed = ' '.join(f'{name} {row[f"best_misses_{name}"]}' for name in run.fitness.labels)
        show(
            run.search.phase,
            row['generation'],
            row['generation'] + run.search.left,
            f'best {row["best_fitness"]:.4f} (J {row["best_energy_n2s"]:.4f}; misses {missed}) '
            f'mean {row["mean_fitness"]:.1f} ± {row["fitness_spread"]:.1f}',
        )

    return Training(run, run.run(report))


def configured(
    subject: object, scenario: str, attitude: bool, changes: Mapping[str, Any]
) -> Configuration:
    """Return the configuration of a search; see `train`.

    changes : setting, with dots into sections -> value as YAML has it
    """
    presets: Mapping[str, Any] = attitude_training.PRESETS if attitude else config.PRESETS
    subject = subject or ('mission' if scenario else 'paper')
    name, base = str(subject), None
    if isinstance(subject, Configuration):
        base = subject
    elif not isinstance(subject, (str, Path)):
        raise InputError(f'configuration: name, path or object expected; got {shown(subject)}')
    elif not attitude and (name in TUNING_SPACES or name in families()):
        of: Any = TuningConfig if name in TUNING_SPACES else FamilyConfig
        return config.changed(of.of(name, scenario=scenario or PAPER), changes)
    elif Path(name).suffix in ('.yaml', '.yml') or Path(name).is_file():
        kinds = {each.schema: each for each in (FamilyConfig, TuningConfig)}
        force: Any = AttitudeConfig if attitude else TrainingConfig
        base = kinds.get(str(config.schema_of(Path(name))), force).load(name)
    else:
        names = presets if attitude else (*presets, *TUNING_SPACES, *families())
        base = presets[choice('configuration', name, names)]
    if scenario:
        if type(base) is not TrainingConfig:
            raise InputError('scenario: the configuration says which; leave it out')
        base = config.fitted(base, scenario)
    return config.changed(base, changes)


def named_as(folder: Path, chosen: Configuration) -> Configuration:
    """Return the configuration with the name of its folder."""
    return config.changed(chosen, {'name': folder.resolve().name})


def _of_generations(chosen: Configuration, generations: int) -> Configuration:
    """Return the configuration of a genetic algorithm with so many generations."""
    whole('generations', generations, least=1)
    if isinstance(chosen, TrainingConfig) and chosen.algorithm in ('ga', 'ga-cmaes', 'nsga2'):
        return config.changed(chosen, {'ga.generations': generations})
    budget = 'evaluations' if isinstance(chosen, TuningConfig) else 'cmaes__evaluations'
    raise InputError(
        f'generations: {chosen.name} is no genetic algorithm; limit its evaluations, like '
        f'{budget}=2000'
    )
