# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The training of the fuzzy attitude controller: searches, genes, presets of the force controller.

In a configuration the scales of position and velocity are those of attitude [rad] and rate [rad/s],
that of force the torque [N m]. Fitness is the mean energy [mN²m²s] of the flights of
`rpo.analysis.attitude.trained_draws`, plus a penalty for each that has not settled in time or
overshoots; of `rpo.scoring.fitness`, the margin, and the terms `damping` and `falls`, too;
`between` is the number of hard slews beside the others.
"""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np

from rpo.analysis.attitude import MOMENT_KG_M2, Flights, Outcome, trained_draws
from rpo.engine.population import Population
from rpo.scoring.conditions import AT_LIMIT
from rpo.scoring.fitness import FitnessSettings, Scores, excess, mean, with_surface
from rpo.training.algorithms import Search
from rpo.training.config import ALGORITHMS, COMMAND, TrainingConfig, presets, start_file
from rpo.training.run import SearchRun
from rpo.training.training import search_of
from rpo_core import files
from rpo_core.control import attitude
from rpo_core.control.attitude import AttitudeControl, FuzzyAttitude
from rpo_core.files.validation import choice
from rpo_core.kernels.arrays import Floats

FLIGHTS = 'slews_and_tumbles'
CONDITIONS = ('settling', 'overshoot')
TRAINED_DEG = 0.15
"""Flights of the training settle within less than `ANGLE_DEG`: no dead zone."""

NOISE = (0.02, 0.01)
"""What a filter leaves of the attitude [deg] and of the rate [deg/s]; steep laws answer to it."""

_MICRO = 1e6  # N^2 m^2 s to mN^2 m^2 s


@dataclass(frozen=True)
class AttitudeConfig(TrainingConfig):
    """The search of a fuzzy attitude controller."""

    file, words = 'attitude.yaml', f'{COMMAND} --attitude'

    def __post_init__(self) -> None:
        super().__post_init__()
        choice('scenario', self.scenario, (FLIGHTS,))
        choice('algorithm', self.algorithm, ALGORITHMS[:-1])  # there is no second objective

    def known(self) -> Iterator[tuple[str, Any]]:
        """Yield the presets."""
        for preset, known in PRESETS.items():
            yield f'--attitude --preset {preset}', known

    @classmethod
    def of(cls, *subject: str, scenario: str = FLIGHTS) -> AttitudeConfig:
        """Return the preset `paper`."""
        return PRESETS['paper']


PRESETS = presets('attitude', AttitudeConfig(scenario=FLIGHTS))


class AttitudeFitness:
    """What a search of attitude controllers is judged by."""

    labels, conditions = CONDITIONS, SimpleNamespace(labels=CONDITIONS)
    drawn: tuple[Any, ...] = ()

    def __init__(self, settings: FitnessSettings, workers: int) -> None:
        self._settings, keep = settings, 1.0 - settings.margin
        draws = trained_draws(settings.between)
        self._flights = Flights(draws, keep, NOISE, TRAINED_DEG)
        self._workers, self.simulator = workers or None, nullcontext()

    def enter(self, number: int, best: Any = None) -> None:
        """Draw nothing: all stages have the same flights."""

    def score(self, population: Population) -> Scores:
        """Return the scores of a population."""
        members = [made_of(population, i, 'candidate') for i in range(len(population.scales))]
        with ThreadPoolExecutor(self._workers) as pool:
            outcomes = list(pool.map(self._fly, members))
        energy = mean(np.array([_MICRO * o.energy for o in outcomes]))
        values = np.array([(o.worst, o.beyond) for o in outcomes])
        over = (values > 1.0).astype(np.float64)
        if self._settings.penalty == 'graded':
            over *= AT_LIMIT + (1.0 - AT_LIMIT) * excess(values, 1.0)
        fitness = energy + self._settings.penalty_n2s * mean(over.sum(axis=1))
        fitness = with_surface(fitness, self._settings, population)
        settled = mean(np.array([np.minimum(o.settled_s, 1e3) for o in outcomes]))
        return Scores(fitness, energy, (values > 1.0).sum(axis=-1), settled)

    def _fly(self, controller: FuzzyAttitude) -> Outcome:
        return self._flights.fly(AttitudeControl(controller=controller))


def made_of(population: Population, index: int, name: str) -> FuzzyAttitude:
    """Return a member of a population as an attitude controller."""
    axis = population.controller(index, name)
    angle, rate, torque = axis.scales
    return FuzzyAttitude(
        name=name,
        system=axis.system,
        angle_rad=angle,
        rate_rad_s=rate,
        torque_nm=torque,
        moment_kg_m2=MOMENT_KG_M2,
    )


class AttitudeTraining(SearchRun[AttitudeConfig, FuzzyAttitude]):
    """The training of a fuzzy attitude controller."""

    config_type = AttitudeConfig
    unit = 'mN²m²s'
    scored = ('fitness', 'mean_energy_mn2m2s', 'mean_settling_s', 'flights_that_miss')

    def inputs(self) -> list[str]:
        """Return the texts of the starts."""
        return [files.read_text(start_file(name)) for name in self.config.starts]

    def make_search(self) -> Search:
        """Return the search of the configuration, at its beginning."""
        return search_of(self.config)

    def make_fitness(self, workers: int) -> Any:
        """Return the fitness of the configuration, on threads."""
        return AttitudeFitness(self.config.fitness, workers)

    def decode(self, genes: Floats) -> Population:
        """Return the controllers of a generation."""
        return self.config.genes.decode(genes)

    def found(self) -> FuzzyAttitude:
        """Return the best so far, its provenance filled in."""
        population = self.decode(self.best_genes[None])
        made = made_of(population, 0, self.config.name)
        description = "The paper's fuzzy system for each body axis, trained on slews and tumbles."
        made = replace(made, description=description)
        return self.credited(made, self.config.algorithm, self.fitness.score(population))

    @property
    def flown(self) -> str:
        """What every candidate flies."""
        return f'{len(trained_draws(self.config.fitness.between).attitudes)} flights'

    def dumps(self, controller: Any) -> str:
        """Return the YAML text of a controller."""
        return attitude.dumps(controller)
