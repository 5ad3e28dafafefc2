# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Configuration of a campaign: scenario, controller, dispersions, and the limits of success."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from rpo_core import files, metrics, overrides
from rpo_core.codec import to_mapping
from rpo_core.controller import AnyController
from rpo_core.controller import parse as parse_controller
from rpo_core.controller_file import ControllerFile
from rpo_core.scenario import Scenario, ScenarioSet
from rpo_core.scenario import parse as parse_scenario
from rpo_core.validation import (
    MOST_PATH,
    InputError,
    choice,
    mapping,
    real,
    shown,
    text,
    whole,
    within,
)
from rpo_core.verdicts import unit_of
from rpo_training.campaign import faults
from rpo_training.campaign.faults import Faults
from rpo_training.outputs import check_name

SCHEMA = 'rpo/campaign/1'

SAMPLINGS = ('latin_hypercube', 'random')
"""Blocks of 1000 runs, each a Latin hypercube; or independent runs."""

CUT = 3.0
"""Normal dispersions are cut at so many standard deviations."""

MAX_RUNS = 100_000_000


class Quantity(NamedTuple):
    """A quantity that can be dispersed; most : largest deviation that is accepted."""

    components: int
    unit: str
    distributions: tuple[str, ...]
    most: float


_SPREADS = ('uniform', 'normal')
QUANTITIES = {
    'initial_position_m': Quantity(3, 'm', _SPREADS, 1e4),
    'initial_velocity_m_s': Quantity(3, 'm/s', _SPREADS, 1e2),
    'mass_share': Quantity(1, '', _SPREADS, 0.99),
    'thrust_share': Quantity(3, '', _SPREADS, 1.0),
    'misalignment_deg': Quantity(3, 'deg', _SPREADS, 90.0),
    'navigation_position_bias_m': Quantity(3, 'm', _SPREADS, 1e4),
    'navigation_velocity_bias_m_s': Quantity(3, 'm/s', _SPREADS, 1e2),
    'disturbance_amplitude_share': Quantity(1, '', _SPREADS, 1e3),
    'disturbance_phase_rad': Quantity(1, 'rad', _SPREADS, 10.0),
    'disturbance_frequency_share': Quantity(1, '', _SPREADS, 1e3),
    'orbit_altitude_m': Quantity(1, 'm', _SPREADS, 1e8),
    'delay_ticks': Quantity(1, 'ticks', ('whole',), 1000),
    'navigation_position_noise_m': Quantity(1, 'm', ('white',), 1e4),
    'navigation_velocity_noise_m_s': Quantity(1, 'm/s', ('white',), 1e2),
}
"""What can be dispersed. The names `share` are relative: mass = (1 + share) x the scenario's."""

METRICS = {name: unit for name, unit in metrics.UNITS.items() if '_bound_' not in name}
"""Metrics of every run, over the forces applied."""

_SHARE = 'hold_force_per_disturbance'
LEVEL = 'disturbance_level_n'
"""Largest |disturbance| of an axis of a run; a limit of force may be a share of it."""


@dataclass(frozen=True)
class Dispersion:
    """How one quantity deviates from the scenario's.

    distribution : 'uniform', within +- spread; 'normal', spread = 1 sigma, cut at 3 sigma; 'whole',
        0..spread with equal chance; 'white', noise of 1 sigma = spread, new at each tick
    spread : one number per component
    """

    distribution: str
    spread: tuple[float, ...]

    @property
    def extreme(self) -> tuple[float, ...]:
        """Largest deviation of each component."""
        return tuple(s * (CUT if self.distribution == 'normal' else 1.0) for s in self.spread)


@dataclass(frozen=True, kw_only=True)
class CampaignConfig:
    """All that determines the outcome of a campaign, beside the scenario and the controller.

    success : metric or requirement -> limit; a run that keeps all of them succeeds. If the file
        does not say, what the scenario requires (`success_of`)
    faults : of the messages between plant and controller; None without
    """

    name: str
    scenario: str
    controller: str
    runs: int
    seed: int = 1
    sampling: str = SAMPLINGS[0]
    dispersions: Mapping[str, Dispersion]
    success: Mapping[str, float] = field(default_factory=dict)
    faults: Faults | None = None

    def __post_init__(self) -> None:
        check_name(self.name, 'a folder')
        text('scenario', self.scenario, most=MOST_PATH)
        text('controller', self.controller, most=MOST_PATH)
        whole('runs', self.runs, least=1, most=MAX_RUNS)
        whole('seed', self.seed, least=0, most=2**63 - 1)
        choice('sampling', self.sampling, SAMPLINGS)

    def spread(self, name: str) -> tuple[float, ...]:
        """Return the spread of a quantity, zeros where it is not dispersed."""
        return self._dispersion(name).spread

    def extreme(self, name: str) -> tuple[float, ...]:
        """Return the largest deviation of a quantity, zeros where it is not dispersed."""
        return self._dispersion(name).extreme

    def _dispersion(self, name: str) -> Dispersion:
        none = Dispersion('uniform', (0.0,) * QUANTITIES[name].components)
        return self.dispersions.get(name, none)

    @property
    def more(self) -> dict[str, str]:
        """What runs are judged by beside `METRICS`: name -> unit."""
        names = [name for name in self.success if name not in METRICS]
        return dict((LEVEL, 'N') if name == _SHARE else (name, unit_of(name)) for name in names)

    @property
    def metrics(self) -> dict[str, str]:
        """What is known of a run: name -> unit."""
        return {**METRICS, **self.more}

    def limit(self, name: str, columns: Mapping[str, Any]) -> tuple[Any, Any]:
        """Return the values of a condition of success, and its limit, which may be a run's own."""
        if name == _SHARE:
            return columns['hold_force_per_axis_n'], self.success[name] * columns[LEVEL]
        return columns[name], self.success[name]

    @property
    def judging(self) -> tuple[str, ...]:
        """Names of the columns that success is judged by."""
        forces = ('hold_force_per_axis_n', LEVEL)
        return tuple(c for name in self.success for c in (forces if name == _SHARE else (name,)))

    @property
    def most_delay(self) -> int:
        """Longest delay [ticks]."""
        return int(self.spread('delay_ticks')[0])


def parse(document: Any) -> CampaignConfig:
    """Return the configuration of a parsed YAML document; raises InputError."""
    names = ['name', 'scenario', 'controller', 'runs', 'dispersions']
    optional = ['seed', 'sampling', 'faults', 'success']
    data = dict(mapping('', document, ['schema', *names], optional))
    if data.pop('schema') != SCHEMA:
        raise InputError(f'`schema` must be {SCHEMA}; got {shown(document["schema"])}')
    dispersions = mapping('dispersions', data['dispersions'], [], QUANTITIES)
    data['dispersions'] = {name: _dispersion(name, dispersions[name]) for name in dispersions}
    if 'success' in data:
        data['success'] = _success(data['success'])
    if 'faults' in data:
        with within('faults'):
            data['faults'] = faults.parse(data['faults'])
    return CampaignConfig(**data)


def _success(value: Any) -> dict[str, float]:
    success = mapping('success', value, [], METRICS)
    if not success:
        raise InputError(f'`success` must limit at least one of {", ".join(METRICS)}; got none')
    return {
        name: real(f'success.{name}', limit, METRICS[name], least=0.0)
        for name, limit in success.items()
    }


def success_of(scenario: Scenario) -> dict[str, float]:
    """Return what a scenario requires; raises InputError if nothing, or of later than its end."""
    required = scenario.requirements
    if required is None:
        raise InputError(f'`success` is missing, and scenario {scenario.name} has no requirements')
    hold = metrics.hold_tick(scenario)
    if hold is not None and hold >= scenario.ticks:
        raise InputError(
            f'`success` is missing, and scenario {scenario.name} requires to hold from '
            f'{required.hold_from_s:g} s on, but ends at {scenario.duration_s:g} s'
        )
    return required.limits


def _dispersion(name: str, value: Any) -> Dispersion:
    quantity, place = QUANTITIES[name], f'dispersions.{name}'
    data = mapping(place, value, [], quantity.distributions)
    if len(data) != 1:
        raise InputError(
            f'`{place}` must give one of {", ".join(quantity.distributions)}; got {shown(value)}'
        )
    distribution, spread = next(iter(data.items()))
    place = f'{place}.{distribution}'
    if distribution == 'whole':
        return Dispersion(distribution, (whole(place, spread, least=0, most=int(quantity.most)),))
    most = quantity.most / (CUT if distribution == 'normal' else 1.0)
    if not isinstance(spread, list):
        spread = [spread] * quantity.components
    if len(spread) != quantity.components:
        raise InputError(
            f'`{place}` must be one number or a list of {quantity.components} in '
            f'{quantity.unit or "1"}; got {shown(spread)}'
        )
    return Dispersion(
        distribution, tuple(real(place, s, quantity.unit, least=0.0, most=most) for s in spread)
    )


def dumps(config: CampaignConfig) -> str:
    """Return the YAML text of a configuration."""
    document = {'schema': SCHEMA, **to_mapping(config)}
    document['dispersions'] = {
        name: {d.distribution: list(d.spread) if len(d.spread) > 1 else d.spread[0]}
        for name, d in config.dispersions.items()
    }
    del document['faults']
    if not config.success:
        del document['success']
    if config.faults is not None:
        document['faults'] = faults.to_document(config.faults)
    return yaml.safe_dump(document, sort_keys=False, default_flow_style=None, width=100)


@dataclass(frozen=True)
class Campaign:
    """A configuration with its scenario and its controller.

    texts : YAML of the configuration, of the scenario, of the controller
    """

    config: CampaignConfig
    scenario: Scenario
    controller: AnyController
    texts: tuple[str, str, str]

    def __post_init__(self) -> None:
        if isinstance(self.controller, ControllerFile):
            self.controller.refuse_other_ticks(self.scenario.dt_s)
        if self.scenario.thrusters or self.scenario.navigation:
            raise InputError(
                '`scenario` must have perfect thrusters and navigation, which `dispersions` make '
                f'imperfect; {self.config.scenario} has a section `thrusters` or `navigation`'
            )
        with within('dispersions'):
            _check_effects(self.config, self.scenario)
            _check_extremes(self.config, self.scenario)

    @classmethod
    def of_texts(cls, texts: tuple[str, str, str], names: tuple[str, str, str]) -> Campaign:
        """Return the campaign of three YAML texts; an InputError names the source of its text."""
        config = files.loads(texts[0], parse, names[0])
        scenario = files.loads(texts[1], parse_scenario, names[1])
        if isinstance(scenario, ScenarioSet):
            raise InputError(f'`scenario` must be a single flight; {config.scenario} is a set')
        controller = files.loads(texts[2], parse_controller, names[2])
        with within(names[0]):
            if not config.success:
                config = replace(config, success=success_of(scenario))
            return cls(config, scenario, controller, texts)


SHIPPED = Path(__file__).parents[2] / 'campaigns'
"""The folder of the campaigns that ship."""


def find(name: str) -> Path:
    """Return the file of a shipped campaign, or of a path; raises InputError."""
    if os.sep in name or name.endswith(('.yaml', '.yml')):
        return Path(name)
    known = {path.stem: path for path in sorted(SHIPPED.glob('*.yaml'))}
    return known[choice('campaign', name, known)]


def load(path: str | Path, overridden: Sequence[str] = (), **changes: Any) -> Campaign:
    """Return the campaign of a YAML file, with some fields changed; raises InputError.

    overridden : fields of the scenario, see `rpo_core.overrides`
    """
    found = files.load(Path(path), parse)
    if changes:
        found = replace(found, **changes)
    with within(str(path)):
        sources = files.find('scenario', found.scenario), files.find('controller', found.controller)
    scenario = overrides.text_of(found.scenario, overridden)
    controller = files.read_text(sources[1])
    names = (str(path), str(sources[0]), str(sources[1]))
    return Campaign.of_texts((dumps(found), scenario, controller), names)


def _check_effects(config: CampaignConfig, scenario: Scenario) -> None:
    """Refuse a dispersion that cannot change any flight."""
    acting = {
        'disturbance_amplitude_share': not scenario.disturbance.is_zero,
        'disturbance_phase_rad': any(h.amplitude_n for h in scenario.disturbance.harmonics),
        'disturbance_frequency_share': any(h.amplitude_n for h in scenario.disturbance.harmonics),
    }
    for name, has_effect in acting.items():
        if name in config.dispersions and not has_effect:
            raise InputError(
                f'`{name}` has no effect: scenario {scenario.name} has no such disturbance'
            )


def _check_extremes(config: CampaignConfig, scenario: Scenario) -> None:
    """Make the scenario of the largest deviations, both ways; it raises InputError if invalid."""
    for sign in (1.0, -1.0):

        def off(name: str, sign: float = sign) -> tuple[float, ...]:
            return tuple(sign * e for e in config.extreme(name))

        share, phase, frequency = (
            off(f'disturbance_{name}')[0]
            for name in ('amplitude_share', 'phase_rad', 'frequency_share')
        )
        replace(
            scenario,
            mass_kg=scenario.mass_kg * (1.0 + off('mass_share')[0]),
            orbit_radius_m=scenario.orbit_radius_m + off('orbit_altitude_m')[0],
            initial_position_m=_sum(scenario.initial_position_m, off('initial_position_m')),
            initial_velocity_m_s=_sum(scenario.initial_velocity_m_s, off('initial_velocity_m_s')),
            disturbance=scenario.disturbance.varied(
                share, phase_rad=phase, frequency_share=frequency
            ),
        )


def _sum(a: tuple[float, ...], b: tuple[float, ...]) -> tuple[float, float, float]:
    x, y, z = (p + q for p, q in zip(a, b, strict=True))
    return x, y, z
