# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The configuration of a search: presets, YAML with every default visible, overrides.

A configuration for a scenario of one's own is fitted to it (`fitted`, `rpo.training.fitting`).
"""

from __future__ import annotations

import re
from abc import abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass, replace
from importlib import resources
from math import floor, log10
from pathlib import Path
from typing import Any, ClassVar, TypeVar

import numpy as np
import yaml

from rpo.montecarlo.outputs import check_name
from rpo.scoring.fitness import FitnessSettings
from rpo.training.algorithms import CmaSettings
from rpo.training.fitting import penalty_n2s, training_set
from rpo.training.genes import GeneSpace
from rpo.training.genetic import GaSettings
from rpo.training.staged import RaceSettings
from rpo_core import files
from rpo_core.control.controller import AnyController
from rpo_core.control.controller import parse as parse_controller
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
from rpo_core.judge.metrics import PENALTY
from rpo_core.judge.similarity import PAPER, range_m, time_s
from rpo_core.scenario.overrides import read
from rpo_core.scenario.scenario import Scenario

COMMAND = 'rpo train'
"""It creates a run, and resumes it."""

ALGORITHMS = ('ga', 'cmaes', 'ga-cmaes', 'race', 'nsga2')
"""Genetic algorithm; CMA-ES; the first, then the second; CMA-ES for each of the best rule tables;
NSGA-II, energy against arrival time."""


_UNUSED: dict[str, Any] = {
    'fitness.arrival': True,
    'fitness.disturbance': 0.0,
    'fitness.drawn.at_limit': 0.1,
    'fitness.drawn.openings': 0.0,
    'fitness.drawn.propellant': 0.0,
}
"""Fields that are gone, at the values by which files of 0.1 say that they do not use them."""

Config = TypeVar('Config', bound='Configuration')


class Configuration:
    """All that determines the outcome of a search; a kind of it is a dataclass of its file.

    schema, file : of the file, and its name in a run folder
    subject : field that a file must have, and option (or '', an argument) that gives it, if any
    words : of the command that trains any of this kind
    fitness : of all but a tuning, which has that of the baselines
    """

    schema: ClassVar[str]
    file: ClassVar[str]
    subject: ClassVar[tuple[str, ...]] = ()
    words: ClassVar[str] = COMMAND

    name: str
    seed: int
    scenario: str
    fitness: FitnessSettings

    def check(self) -> None:
        """Check the fields that all kinds have; raises InputError."""
        check_name(self.name, 'a file')
        whole('seed', self.seed, least=0, most=2**63 - 1)
        text('scenario', self.scenario, most=MOST_PATH)

    @property
    def starts(self) -> tuple[str, ...]:
        """Controllers from which the search begins."""
        return ()

    @classmethod
    @abstractmethod
    def of(cls: type[Config], *subject: str, scenario: str = PAPER) -> Config:
        """Return the configuration that ships, for a subject and a scenario; raises InputError."""

    def known(self) -> Iterator[tuple[str, Any]]:
        """Yield what ships for the scenario: words of its command, and the configuration."""
        name, option = self.subject
        of = getattr(self, name)
        scenario = '' if self.scenario == PAPER else f' --scenario {self.scenario}'
        yield f'{option}{of}{scenario}', self.of(of, scenario=self.scenario)

    @property
    def command(self) -> str:
        """The command that repeats the search; `-o` alone changes the name."""
        for words, known in self.known():
            if replace(known, seed=self.seed, name=self.name) == self:
                return f'{COMMAND} {words} --seed {self.seed}'
        return f'{self.words} --config {self.name}.yaml, the {self.file} of its run folder'

    @classmethod
    def parse(cls: type[Config], document: Any) -> Config:
        """Return the configuration of a parsed YAML document; raises InputError.

        A file may leave out fields that are as in the one that ships.
        """
        names = [f.name for f in fields(cls)]  # type: ignore[arg-type]
        required = cls.subject[:1]
        data = dict(mapping('', document, ['schema', *required], names))
        if data.pop('schema') != cls.schema:
            raise InputError(f'`schema` must be {cls.schema}; got {shown(document["schema"])}')
        found: Config = updated(cls.of(*(text(name, data[name]) for name in required)), data, '')
        return found

    @classmethod
    def load(cls: type[Config], path: str | Path) -> Config:
        """Return the configuration of a YAML file; raises InputError."""
        return files.load(Path(path), cls.parse)

    def dumps(self) -> str:
        """Return the YAML text of the configuration, every default visible."""
        document = {'schema': self.schema, **to_mapping(self)}
        return yaml.safe_dump(document, sort_keys=False, default_flow_style=None, width=100)


@dataclass(frozen=True)
class TrainingConfig(Configuration):
    """The search of a fuzzy controller; the defaults are the preset `paper`.

    start : controllers of the first generation; CMA-ES starts from the first of them
    start_scales : position [m] and velocity [m/s] scale of these; empty: those of their files
    ga : its population and generations are also those of NSGA-II
    """

    schema, file = 'rpo/training/1', 'config.yaml'

    name: str = 'paper_ga'
    seed: int = 1
    scenario: str = PAPER
    algorithm: str = 'ga'
    start: tuple[str, ...] = ('handmade',)
    start_scales: tuple[float, ...] = ()
    genes: GeneSpace = field(default_factory=GeneSpace)
    fitness: FitnessSettings = field(default_factory=FitnessSettings)
    ga: GaSettings = field(default_factory=GaSettings)
    cmaes: CmaSettings = field(default_factory=CmaSettings)
    race: RaceSettings = field(default_factory=RaceSettings)

    def __post_init__(self) -> None:
        self.check()
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

    @property
    def starts(self) -> tuple[str, ...]:
        """Controllers from which the search begins."""
        return self.start

    def known(self) -> Iterator[tuple[str, Any]]:
        """Yield the presets, fitted to the scenario."""
        for preset, known in PRESETS.items():
            if self.scenario == known.scenario:
                yield f'--preset {preset}', known
            else:
                scenario = f'--scenario {self.scenario}'
                yield f'--preset {preset} {scenario}', fitted(known, self.scenario)

    @classmethod
    def of(cls, *subject: str, scenario: str = PAPER) -> TrainingConfig:
        """Return the preset `paper`."""
        return cls(scenario=scenario)


def schema_of(path: Path) -> object:
    """Return the schema that a configuration names; raises InputError if it is unreadable."""
    document = files.load(path, lambda document: document)
    return document.get('schema') if isinstance(document, dict) else None


EXAMPLE = 'ga.population=30'
"""A setting as `--set` takes it."""


def override(config: Config, settings: Sequence[str]) -> Config:
    """Return the configuration with settings like `ga.population=30` applied."""
    return changed(config, read(settings, EXAMPLE))


def changed(config: Config, changes: Mapping[str, Any]) -> Config:
    """Return the configuration with fields changed, whose names have dots into sections."""
    for key, value in changes.items():
        nested: Any = value
        for name in reversed(key.split('.')):
            nested = {name: nested}
        config = updated(config, nested, '')
    return config


def updated(base: Any, data: Any, name: str) -> Any:
    """Return a configuration with the fields of a mapping changed; `name` is its place."""
    names, prefix = [f.name for f in fields(base)], f'{name}.' if name else ''
    if isinstance(data, Mapping):
        data = {k: v for k, v in data.items() if _UNUSED.get(f'{prefix}{k}', ...) != v}
    changes = {}
    for key, value in mapping(name, data, [], names).items():
        current = getattr(base, key)
        place = f'{prefix}{key}'
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


def written(section: str) -> Any:
    """Return a section of `presets.yaml`."""
    text = resources.files('rpo.training').joinpath('presets.yaml').read_text('utf-8')
    return yaml.safe_load(text)[section]


def presets(section: str, base: Config) -> dict[str, Config]:
    """Return the presets of a section of `presets.yaml`; what they leave out is as in `base`."""
    found: dict[str, Config] = {}
    for name, data in written(section).items():
        found[name] = updated(found.get(data.pop('like', ''), base), data, name)
    return found


PRESETS = presets('force', TrainingConfig())

STARTS = {path.stem: path for path in sorted(Path(__file__).parent.glob('starts/*.yaml'))}
"""Controllers that the presets `allround` and `mission` begin with; no command lists them."""


def start_file(name: str) -> Path:
    """Return the file of a start: one of `STARTS`, a shipped name or a path; raises InputError."""
    return STARTS.get(name) or files.find('controller', name)


def load_start(name: str) -> AnyController:
    """Return the controller that a search begins with; raises InputError."""
    return files.load(start_file(name), parse_controller)


AUTHORITY = 20.0
"""Of the paper's training: F T^2 / (m R)."""

_POSITION, _VELOCITY = (0.2, 2.0), (0.6, 6.0)
_START = (0.588465, 2.3266)
"""Bounds of the searched scales, and the scales of `trained`, in R and R / T."""

_FIXED = (1.0, 2.0)
"""Fixed scales, the paper's 100 m and 1 m/s, in R and R / T."""

_OVER_GRAVITY = 4.0  # force scale, over the relative gravity at the farthest start


def fitted(base: TrainingConfig, scenario: str) -> TrainingConfig:
    """Return a configuration for another scenario; its scales are fitted, its name is the set's.

    The terms of the paper's own test are left out. Raises InputError.
    """
    if scenario == base.scenario:
        return base
    starts = training_set(scenario)
    length, time, one = range_m(starts), time_s(starts.base), starts.base
    if length == 0.0:
        raise InputError(f'scenario {one.name} starts at its goal; a search needs another start')
    energy = penalty_n2s(starts) / PENALTY
    space, fitness = base.genes, base.fitness
    free = space.free_scales == 2
    position, velocity = (_POSITION, _VELOCITY) if free else ((_FIXED[0],) * 2, (_FIXED[1],) * 2)
    return replace(
        base,
        name=re.sub(r'[^\w-]', '_', starts.name),
        scenario=scenario,
        start_scales=_scaled(_START, (length, length / time)) if free else (),
        genes=replace(
            space,
            position_scale_m=_scaled(position, (length, length)),
            velocity_scale_m_s=_scaled(velocity, (length / time,) * 2),
            force_scale_n=_force_n(one, length, time),
        ),
        fitness=replace(
            fitness,
            penalty_n2s=_short(fitness.penalty_n2s * energy),
            limit_cycle=0.0,
            robustness=0.0,
            drawn=replace(fitness.drawn, weight=0.0),
        ),
        cmaes=replace(base.cmaes, tolerance=_short(base.cmaes.tolerance * energy)),
        race=replace(base.race, gain=_short(base.race.gain * energy)),
    )


def _force_n(base: Scenario, length: float, time: float) -> float:
    """Return the force at full output: the paper's authority, enough against what pushes."""
    n, m = base.mean_motion_rad_s, base.mass_kg
    pushed = float(np.abs(base.disturbances_n).max()) + 3.0 * m * n * n * length
    wanted = max(AUTHORITY * m * length / time**2, _OVER_GRAVITY * pushed)
    return min(base.max_force_n, _short(wanted))


def _scaled(shares: Sequence[float], units: Sequence[float]) -> tuple[float, float]:
    first, second = (_short(a * b) for a, b in zip(shares, units, strict=True))
    return first, second


def _short(value: float) -> float:
    """Return a number rounded to four digits: a person reads the file."""
    return round(value, 3 - floor(log10(value)))
