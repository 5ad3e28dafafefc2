# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The training of a family (`rpo_ctrl.family`): CMA-ES in stages, judged by drawn flights.

The folder holds `family.yaml`, `checkpoint.npz` after each generation, and at the end the
controller `<name>.yaml`.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from rpo_core import files
from rpo_core.control.controller import load_controller
from rpo_core.files.codec import to_mapping
from rpo_core.files.validation import MOST_PATH, InputError, mapping, shown, text, whole
from rpo_core.judge.metrics import PENALTY
from rpo_ctrl.family import Family, Gene, Mission, family_of
from rpo_judge.evaluation.assessment import PAPER
from rpo_judge.scoring.drawn import POSITION_AND_SPEED, DrawnSettings
from rpo_judge.scoring.fitness import Fitness, FitnessSettings, Scores
from rpo_montecarlo import processor
from rpo_montecarlo.outputs import check_name
from rpo_training.algorithms import CmaSettings, Search
from rpo_training.checkpoint import versions
from rpo_training.config import updated
from rpo_training.fitting import penalty_n2s, training_set, units_of
from rpo_training.run import SearchRun
from rpo_training.staged import StagedSearch, StagedSettings

Floats = NDArray[np.float64]

SCHEMA = 'rpo/family_training/1'
CONFIG = 'family.yaml'

_JUDGED = FitnessSettings(
    penalty='graded',
    margin=0.06,
    limit_cycle=20.0,
    drawn=DrawnSettings(
        weight=100.0,
        campaigns=('paper_test', 'random_starts', 'random_moving_starts'),
        margin=0.03,
        flights=80,
        judged={'paper_test': POSITION_AND_SPEED},
    ),
)

_DESCENT = CmaSettings(population=20, sigma=0.03, evaluations=6000, descents=1, tolerance=1e-4)


@dataclass(frozen=True)
class FamilyConfig:
    """All that determines the outcome of the training of a family.

    start : controller of the family from which the search begins; empty: the family's own
    """

    family: str
    name: str
    seed: int = 1
    scenario: str = PAPER
    start: str = ''
    fitness: FitnessSettings = _JUDGED
    cmaes: CmaSettings = _DESCENT
    staged: StagedSettings = field(default_factory=StagedSettings)

    def __post_init__(self) -> None:
        family_of(self.family)
        check_name(self.name, 'a file')
        whole('seed', self.seed, least=0, most=2**63 - 1)
        text('scenario', self.scenario, most=MOST_PATH)
        if not isinstance(self.start, str):
            raise InputError(f'`start` must be a name or a path; got {shown(self.start)}')


def config_of(family: str, scenario: str = '') -> FamilyConfig:
    """Return the configuration of a family; of another scenario, without the paper's own terms."""
    kind = family_of(family)
    first, later = (count * len(kind.genes()) for count in kind.effort)
    descent, staged = replace(_DESCENT, evaluations=first), StagedSettings(evaluations=later)
    config = FamilyConfig(family, family, cmaes=descent, staged=staged)
    if scenario in ('', PAPER):
        return config
    starts = training_set(scenario)
    energy = penalty_n2s(starts) / PENALTY
    fitness = FitnessSettings('graded', round(PENALTY * energy, 6), margin=0.15, error_weight=3.0)
    cmaes = replace(config.cmaes, tolerance=config.cmaes.tolerance * energy)
    return replace(config, scenario=scenario, fitness=fitness, cmaes=cmaes)


def parse(document: Any) -> FamilyConfig:
    """Return the configuration of a parsed YAML document."""
    names = [f.name for f in fields(FamilyConfig)]
    data = dict(mapping('', document, ['schema', 'family'], names))
    if data.pop('schema') != SCHEMA:
        raise InputError(f'`schema` must be {SCHEMA}; got {shown(document["schema"])}')
    found: FamilyConfig = updated(config_of(text('family', data.pop('family'))), data, '')
    return found


def is_family(path: Path) -> bool:
    """Return whether a configuration is one of a family; raises InputError if it is unreadable."""
    document = files.load(path, lambda document: document)
    return isinstance(document, dict) and document.get('schema') == SCHEMA


def dumps(config: FamilyConfig) -> str:
    """Return the YAML text of a configuration, every default visible."""
    document = {'schema': SCHEMA, **to_mapping(config)}
    return yaml.safe_dump(document, sort_keys=False, default_flow_style=None, width=100)


class FamilyTraining(SearchRun[FamilyConfig, Family]):
    """The training of a family."""

    config_file, kind, command = CONFIG, 'run', 'rpo train'

    @classmethod
    def load(cls, path: Path) -> FamilyConfig:
        """Return the configuration of a file; raises InputError."""
        return files.load(path, parse)

    @property
    def scenario(self) -> str:
        """The scenario or set that is trained for."""
        return self.config.scenario

    def dumps(self) -> str:
        """Return the configuration as the text of its file."""
        return dumps(self.config)

    def inputs(self) -> list[str]:
        """Return the texts of the scenario, of the start, and of the campaigns."""
        paths = [files.find('scenario', self.config.scenario)]
        if self.config.start:
            paths.append(files.find('controller', self.config.start))
        flown = (text for flights in self.fitness.drawn for text in flights.texts)
        return [*map(files.read_text, paths), *flown]

    @cached_property
    def family(self) -> type[Family]:
        """The kind of controller that is searched."""
        return family_of(self.config.family)

    @cached_property
    def mission(self) -> Mission:
        """What the family needs of the mission."""
        base = self.starts.base
        paper = self.config.scenario == PAPER
        units = (1.0, 1.0, 1.0) if paper else units_of(self.starts)
        return Mission(units, base.max_force_n, base.dt_s)

    @cached_property
    def genes(self) -> tuple[Gene, ...]:
        """What is searched."""
        return tuple(gene.fitted(self.mission.units) for gene in self.family.genes())

    def make_search(self) -> Search:
        """Return the search at its beginning."""
        config, values = self.config, {gene.name: gene.start for gene in self.genes}
        if config.start:
            start = load_controller(config.start)
            if not isinstance(start, self.family):
                raise InputError(f'`start` must be of the family {config.family}; got {start.name}')
            values = start.values()
        shares = np.array([gene.share(values[gene.name]) for gene in self.genes])
        return StagedSearch(config.staged, config.cmaes, config.seed, shares)

    def make_fitness(self, workers: int, address: str) -> Fitness:
        """Return the fitness of the configuration; the flights of one controller fill a thread."""
        return Fitness(self.starts, self.config.fitness, workers)

    def decode(self, genes: Floats) -> list[Family]:
        """Return the controllers of a generation."""
        return [self.make(row) for row in genes]

    def make(self, shares: Floats) -> Family:
        """Return the controller of a chromosome, without provenance."""
        pairs = zip(self.genes, shares.tolist(), strict=True)
        values = {gene.name: gene.value(share) for gene, share in pairs}
        return self.family.of_values(self.config.name, values, self.mission)

    def found(self) -> Family:
        """Return the best so far, its provenance filled in."""
        found, config = self.make(self.best_genes), self.config
        scores = self.fitness.score([found])
        provenance: dict[str, object] = {
            'method': 'rpo train',
            'command': command(config),
            'algorithm': 'cmaes in stages',
            'seed': config.seed,
            'scenario': config.scenario,
            'evaluations': self.checkpoint.evaluations,
            'stopped': self.search.stopped,
            'fitness_n2s': float(scores.fitness[0]),
            'mean_energy_n2s': float(scores.energy[0]),
            'mean_arrival_s': float(scores.arrival[0]),
            'starts_that_miss': self.misses(scores),
            'held_out_that_miss': self.missed_draws(scores),
            'versions': versions(),
            'arithmetic': processor.in_use(),
        }
        if self.fitness.drawn:
            provenance['drawn_flights_judged_by'] = self.fitness.judged_in_drawn
        return replace(found, provenance=provenance)

    def missed_draws(self, scores: Scores) -> dict[str, str]:
        """Return campaign -> how many of the held-out draws the controller misses."""
        count = len(self.fitness.conditions.labels)
        drawn = self.fitness.drawn
        missed = scores.failures[0, count:]
        of = self.config.fitness.drawn.held_out
        return {d.label: f'{int(n)} of {of}' for d, n in zip(drawn, missed, strict=True)}


def command(config: FamilyConfig) -> str:
    """Return the command that trains this configuration; `-o` alone changes the name."""
    known = config_of(config.family, config.scenario)
    if replace(known, seed=config.seed, name=config.name) != config:
        return f'rpo train --config {CONFIG}, of its run folder'
    scenario = '' if config.scenario == PAPER else f' --scenario {config.scenario}'
    return f'rpo train --family {config.family}{scenario} --seed {config.seed}'
