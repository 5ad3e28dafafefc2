# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The configuration of a training run: presets, YAML with every default visible, overrides."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, is_dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

import yaml

from rpo_core import files
from rpo_core.files.codec import to_mapping
from rpo_core.files.validation import (
    MOST_PATH,
    InputError,
    choice,
    mapping,
    real,
    shown,
    text,
    whole,
)
from rpo_judge.scoring.drawn import POSITION_AND_SPEED, DrawnSettings
from rpo_judge.scoring.fitness import FitnessSettings
from rpo_montecarlo.outputs import check_name
from rpo_training.algorithms import CmaSettings
from rpo_training.genes import GeneSpace
from rpo_training.genetic import GaSettings
from rpo_training.race import RaceSettings

SCHEMA = 'rpo/training/1'

ALGORITHMS = ('ga', 'cmaes', 'ga-cmaes', 'race', 'nsga2')
"""Genetic algorithm; CMA-ES; the first, then the second; CMA-ES for each of the best rule tables;
NSGA-II, energy against arrival time."""


Config = TypeVar('Config')


@dataclass(frozen=True)
class TrainingConfig:
    """All that determines the outcome of a run; the defaults are the preset `paper`.

    start : controllers of the first generation; CMA-ES starts from the first of them
    start_scales : position [m] and velocity [m/s] scale of these; empty: those of their files
    ga : its population and generations are also those of NSGA-II
    """

    name: str = 'paper_ga'
    seed: int = 1
    scenario: str = 'paper_training'
    algorithm: str = 'ga'
    start: tuple[str, ...] = ('handmade',)
    start_scales: tuple[float, ...] = ()
    genes: GeneSpace = field(default_factory=GeneSpace)
    fitness: FitnessSettings = field(default_factory=FitnessSettings)
    ga: GaSettings = field(default_factory=GaSettings)
    cmaes: CmaSettings = field(default_factory=CmaSettings)
    race: RaceSettings = field(default_factory=RaceSettings)

    def __post_init__(self) -> None:
        check_name(self.name, 'a file')
        whole('seed', self.seed, least=0, most=2**63 - 1)
        text('scenario', self.scenario, most=MOST_PATH)
        choice('algorithm', self.algorithm, ALGORITHMS)
        for i, name in enumerate(self.start):
            text(f'start[{i}]', name, most=MOST_PATH)
        if len(self.start_scales) not in (0, 2):
            raise InputError(
                f'`start_scales` must be empty or two numbers; got {list(self.start_scales)}'
            )
        for scale, unit in zip(self.start_scales, ('m', 'm/s'), strict=False):
            real('start_scales', scale, unit, above=0.0)
        if self.algorithm in ('cmaes', 'race') and not self.start:
            raise InputError(
                f'`start` must name a controller for {self.algorithm} to start from; got none'
            )


_READABLE = GeneSpace('odd-monotone', position_scale_m=(20.0, 200.0), velocity_scale_m_s=(0.3, 3.0))

PRESETS = {
    'paper': TrainingConfig(),
    'best': TrainingConfig(
        name='best',
        algorithm='race',
        genes=_READABLE,
        fitness=FitnessSettings(penalty='graded', margin=0.001, limit_cycle=20.0),
        cmaes=CmaSettings(population=20, evaluations=8000, descents=2),
    ),
    'robust': TrainingConfig(
        name='robust',
        algorithm='race',
        genes=_READABLE,
        fitness=FitnessSettings(penalty='graded', margin=0.001, limit_cycle=20.0, robustness=100.0),
        cmaes=CmaSettings(population=20, evaluations=8000, descents=2),
    ),
    'allround': TrainingConfig(
        name='allround',
        algorithm='race',
        start=('robust',),
        genes=_READABLE,
        fitness=FitnessSettings(
            penalty='graded',
            margin=0.03,
            limit_cycle=20.0,
            damping=20.0,
            drawn=DrawnSettings(
                30.0,
                ('paper_test', 'random_moving_starts'),
                0.005,
                judged={'paper_test': POSITION_AND_SPEED},
            ),
        ),
        cmaes=CmaSettings(
            population=14, sigma=0.006, evaluations=3000, descents=3, tolerance=0.005, patience=1000
        ),
        race=RaceSettings(rounds=1, entrants=3, evaluations=700, last=980, sigma=0.02, stages=True),
    ),
    'world': TrainingConfig(
        name='world',
        algorithm='cmaes',
        start=('allround',),
        genes=_READABLE,
        fitness=FitnessSettings(
            penalty='graded',
            margin=0.01,
            damping=20.0,
            drawn=DrawnSettings(
                100.0,
                ('world_leo_stuck',),
                0.25,
                flights=60,
                pool=0,
                openings=0.003,
                propellant=200.0,
            ),
        ),
        cmaes=CmaSettings(
            population=12, sigma=0.012, evaluations=420, descents=9, tolerance=0.02, patience=360
        ),
    ),
    'mission': TrainingConfig(
        name='mission',
        algorithm='race',
        start=('trained',),
        genes=_READABLE,
        fitness=FitnessSettings(penalty='graded', margin=0.2, error_weight=3.0, between=12),
        cmaes=CmaSettings(population=20, evaluations=3000, descents=2),
        race=RaceSettings(rounds=3, entrants=4, evaluations=700, gain=0.2, scan=10),
    ),
    'front': TrainingConfig(
        name='front',
        algorithm='nsga2',
        genes=_READABLE,
        fitness=FitnessSettings(penalty='graded', margin=0.001),
        ga=GaSettings(population=100, generations=200, stall=200),
    ),
}
"""`paper`: GA and fitness of the paper. `best`: made the controller `trained`. `robust`: as `best`,
with the limits of the paper under dispersions. `allround`: from `robust`, judged by drawn flights,
with a margin to every condition. `world`: from `allround`, judged by flights with sensors, a filter
and pulses, where valve openings and propellant cost. `mission`: in minutes, for a scenario of one's
own (`search.fitting`). `front`: a Pareto front."""


def dumps(config: TrainingConfig) -> str:
    """Return the YAML text of a configuration, every default visible."""
    document = {'schema': SCHEMA, **to_mapping(config)}
    return yaml.safe_dump(document, sort_keys=False, default_flow_style=None, width=100)


def parse(document: Any) -> TrainingConfig:
    """Return the configuration of a parsed YAML document; defaults are those of `paper`."""
    names = [f.name for f in fields(TrainingConfig)]
    data = dict(mapping('', document, ['schema'], names))
    if data.pop('schema') != SCHEMA:
        raise InputError(f'`schema` must be {SCHEMA}; got {shown(document["schema"])}')
    return updated(PRESETS['paper'], data, '')


def load(path: str | Path) -> TrainingConfig:
    """Return the configuration of a YAML file; raises InputError."""
    return files.load(Path(path), parse)


def override(config: Config, settings: Sequence[str]) -> Config:
    """Return the configuration with settings like `ga.population=30` applied."""
    for setting in settings:
        key, equals, value = setting.partition('=')
        if not equals or not key.strip():
            raise InputError(f'`--set` must be like ga.population=30; got {shown(setting)}')
        nested: Any = files.parse_yaml(value)
        for name in reversed(key.strip().split('.')):
            nested = {name: nested}
        config = updated(config, nested, '')
    return config


def updated(base: Any, data: Any, name: str) -> Any:
    """Return a configuration with the fields of a mapping changed; `name` is its place."""
    known = mapping(name, data, [], [f.name for f in fields(base)])
    changes = {}
    for key, value in known.items():
        current = getattr(base, key)
        place = f'{name}.{key}' if name else key
        if is_dataclass(current):
            changes[key] = updated(current, value, place)
        elif isinstance(current, tuple):
            if not isinstance(value, list):
                raise InputError(
                    f'`{place}` must be a list like {list(current)}; got {shown(value)}'
                )
            changes[key] = tuple(value)
        else:
            changes[key] = value
    return replace(base, **changes)
