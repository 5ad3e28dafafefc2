# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Configuration of a campaign: scenario, controller, dispersions, and the limits of success."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import yaml

from rpo.montecarlo import faults
from rpo.montecarlo.faults import Faults
from rpo.montecarlo.outputs import check_name
from rpo.montecarlo.quantities import QUANTITIES, SHELL, Dispersion, dispersion
from rpo_core import files
from rpo_core.control.controller import AnyController
from rpo_core.control.controller import parse as parse_controller
from rpo_core.control.controller_file import ControllerFile
from rpo_core.files.codec import to_mapping
from rpo_core.files.validation import (
    MOST_PATH,
    InputError,
    choice,
    mapping,
    real,
    schema,
    text,
    whole,
    within,
)
from rpo_core.judge import metrics
from rpo_core.judge.metrics import LEVEL
from rpo_core.navigation.sensors import Sensors
from rpo_core.scenario import overrides
from rpo_core.scenario.requirements import LIMITS, ROWS, SHARES, THRUST, Requirements
from rpo_core.scenario.scenario import Scenario, ScenarioSet
from rpo_core.scenario.scenario import parse as parse_scenario
from rpo_core.thrusters.table import IDENTITY
from rpo_core.thrusters.thrusters import Thrusters

SCHEMA = 'rpo/campaign/1'

Texts = tuple[str, str, str]
"""YAML of a campaign, of its scenario, of its controller."""

SAMPLINGS = ('latin_hypercube', 'random')
"""Blocks of 1000 runs, each a Latin hypercube; or independent runs."""

MAX_RUNS = 100_000_000


METRICS = {name: unit for name, unit in metrics.UNITS.items() if '_bound_' not in name}
"""Metrics of every run, over the forces applied."""


@dataclass(frozen=True, kw_only=True)
class CampaignConfig:
    """All that determines the outcome of a campaign, beside the scenario and the controller.

    success : requirement -> limit; a run that keeps all of them succeeds. If the file does not say,
        what the scenario requires (`success_of`)
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

    @property
    def more(self) -> dict[str, str]:
        """What runs are judged by beside `METRICS`: name -> unit."""
        names = [name for name in self.success if name not in METRICS]
        return dict((LEVEL, 'N') if n in SHARES else (n, ROWS[n].unit) for n in names)

    def limit(self, name: str, columns: Mapping[str, Any]) -> tuple[Any, Any]:
        """Return the values of a condition of success, and its limit, which may be a run's own."""
        if name in SHARES:
            return columns[SHARES[name]], self.success[name] * columns[LEVEL]
        return columns[name], self.success[name]

    def limits(self, columns: Mapping[str, Any]) -> dict[str, tuple[Any, Any]]:
        """Return condition of success -> its values, and its limit."""
        return {name: self.limit(name, columns) for name in self.success}

    @property
    def judging(self) -> tuple[str, ...]:
        """Names of the columns that success is judged by."""
        return tuple(column for name in self.success for column in self.judging_of(name))

    def judging_of(self, name: str) -> tuple[str, ...]:
        """Names of the columns that a limit is judged by: the value; its size, if a run's own."""
        return (SHARES[name], LEVEL) if name in SHARES else (name,)


def parse(document: Any) -> CampaignConfig:
    """Return the configuration of a parsed YAML document; raises InputError."""
    schema(document, SCHEMA)
    names = ['name', 'scenario', 'controller', 'runs', 'dispersions']
    optional = ['seed', 'sampling', 'faults', 'success']
    data = dict(mapping('', document, ['schema', *names], optional))
    del data['schema']
    dispersions = mapping('dispersions', data['dispersions'], [], QUANTITIES)
    data['dispersions'] = {name: dispersion(name, dispersions[name]) for name in dispersions}
    if 'success' in data:
        limits = mapping('success', data['success'], [], LIMITS)
        if not limits:
            raise InputError(f'`success` must limit at least one of {", ".join(LIMITS)}; got none')
        data['success'] = {
            name: real(f'success.{name}', limit, ROWS[name].unit, least=0.0)
            for name, limit in limits.items()
        }
    if 'faults' in data:
        with within('faults'):
            data['faults'] = faults.parse(data['faults'])
    return CampaignConfig(**data)


def _requiring(scenario: Scenario, success: Mapping[str, float]) -> Scenario:
    """Return the scenario, requiring also what `success` names and not every run has as a column.

    Raises InputError where the scenario does not say when or where such a limit holds.
    """
    required = scenario.requirements
    known = {*METRICS, *THRUST, *SHARES, *(required.limits if required else ())}
    more: dict[str, Any] = {n: limit for n, limit in success.items() if n not in known}
    if not more:
        return scenario
    with within(f'`success` needs more `requirements` of scenario {scenario.name}'):
        made = replace(required, **more) if required else Requirements(**more)
    return replace(scenario, requirements=made)


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


def dumps(config: CampaignConfig) -> str:
    """Return the YAML text of a configuration."""
    document = {'schema': SCHEMA, **to_mapping(config)}
    document['dispersions'] = {
        name: {d.distribution: list(d.spread) if len(d.spread) > 1 else d.spread[0]}
        for name, d in config.dispersions.items()
    }
    if not config.success:
        del document['success']
    if config.faults is None:
        del document['faults']
    elif not config.faults.delays:
        del document['faults']['late_by_ticks']
    return yaml.safe_dump(document, sort_keys=False, default_flow_style=None, width=100)


@dataclass(frozen=True)
class Campaign:
    """A configuration with its scenario and its controller.

    scenario : as it is flown: it requires also what `success` names beyond its file
    texts : the last one is empty if the controller has no file
    required : what the file of the scenario requires: name -> limit
    """

    config: CampaignConfig
    scenario: Scenario
    controller: AnyController
    texts: Texts
    required: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if isinstance(self.controller, ControllerFile):
            self.controller.refuse_other_ticks(self.scenario.dt_s)
        thrusters = self.scenario.thrusters or Thrusters()
        errors = self.scenario.named('navigation')
        if errors or thrusters.matrix != IDENTITY or thrusters.delay_ticks:
            raise InputError(
                '`scenario` must have no `navigation`, and no `matrix` and `delay_ticks` of '
                f'thrusters: `dispersions` have them; {self.config.scenario} has'
            )
        for name in self.config.success:
            if name in THRUST and name not in self.metrics_of_thrusters:
                raise InputError(
                    f'`success.{name}` needs thrusters with `pulses` or `propellant`; scenario '
                    f'{self.scenario.name} has none'
                )
        with within('dispersions'):
            _check_effects(self.config, self.scenario)
            _check_extremes(self.config, self.scenario)

    @property
    def metrics_of_thrusters(self) -> dict[str, str]:
        """Those of `THRUST` that its thrusters have: name -> unit."""
        thrusters = self.scenario.thrusters
        if thrusters is not None and thrusters.fires:
            return THRUST
        if thrusters is None or thrusters.propellant is None:
            return {}
        return {name: THRUST[name] for name in THRUST if 'valve' not in name}

    @property
    def more(self) -> dict[str, str]:
        """What is known of a run beside `METRICS`: name -> unit."""
        return {**self.metrics_of_thrusters, **self.config.more}

    @property
    def metrics(self) -> dict[str, str]:
        """What is known of a run: name -> unit."""
        return {**METRICS, **self.more}

    @classmethod
    def of_texts(cls, texts: Texts, names: Texts, law: AnyController | None = None) -> Campaign:
        """Return the campaign of three YAML texts; an InputError names the source of its text.

        law : the controller, if it has no file; the third text is then empty
        """
        config = files.loads(texts[0], parse, names[0])
        scenario = files.loads(texts[1], parse_scenario, names[1])
        if isinstance(scenario, ScenarioSet):
            raise InputError(f'`scenario` must be a single flight; {config.scenario} is a set')
        controller = files.loads(texts[2], parse_controller, names[2]) if law is None else law
        with within(names[0]):
            required = scenario.requirements.limits if scenario.requirements else {}
            if config.success:
                scenario = _requiring(scenario, config.success)
            else:
                config = replace(config, success=success_of(scenario))
            return cls(config, scenario, controller, texts, required)

    def judging(self, names: Collection[str]) -> Campaign:
        """Return the same runs, judged by some of the limits alone; raises InputError."""
        success = self.config.success
        for name in names:
            choice('judge', name, success)
        chosen = {name: limit for name, limit in success.items() if name in names}
        return self.with_config(replace(self.config, success=chosen))

    def with_config(self, config: CampaignConfig) -> Campaign:
        """Return the same scenario and controller under another configuration."""
        return replace(self, config=config, texts=(dumps(config), *self.texts[1:]))


def load(source: str | Path, overridden: Sequence[str] = (), **changes: Any) -> Campaign:
    """Return the campaign of a shipped name or a path, with fields changed; raises InputError.

    overridden : fields of the scenario, see `rpo_core.scenario.overrides`
    """
    path = files.find('campaign', source) if isinstance(source, str) else source
    found = files.load(path, parse)
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
    for name, quantity in QUANTITIES.items():
        need = quantity.need
        if name in config.dispersions and need is not None and not need.is_met(scenario):
            raise InputError(f'`{name}` has no effect: scenario {scenario.name} has no {need.what}')
    navigated = [name for name in config.dispersions if name.startswith('navigation_')]
    if navigated and scenario.section(Sensors) is not None:
        raise InputError(
            f'`{navigated[0]}` must be left out: scenario {scenario.name} has `sensors`, whose '
            'noise is drawn anew for each run'
        )
    count = len(scenario.thrusters.names) if scenario.thrusters else 0
    stuck = config.dispersions.get('stuck_off_thruster')
    if stuck is not None and stuck.spread[0] >= count:
        raise InputError(
            f'`stuck_off_thruster.whole` must be below {count}, the number of thrusters of '
            f'{scenario.name}; got {stuck.spread[0]:g}'
        )


def _check_extremes(config: CampaignConfig, scenario: Scenario) -> None:
    """Make the scenario of the largest deviations, both ways; it raises InputError if invalid."""
    for sign in (1.0, -1.0):

        def off(name: str, sign: float = sign) -> tuple[float, ...]:
            none = Dispersion('uniform', (0.0,) * QUANTITIES[name].components)
            return tuple(sign * e for e in config.dispersions.get(name, none).extreme)

        def start(name: str, extreme: tuple[float, ...]) -> tuple[float, float, float]:
            found = config.dispersions.get(name)
            in_place = found is not None and found.distribution == SHELL
            begin = (0.0,) * 3 if in_place else getattr(scenario, name)
            x, y, z = (p + q for p, q in zip(begin, extreme, strict=True))
            return x, y, z

        share, phase, frequency = (
            off(f'disturbance_{name}')[0]
            for name in ('amplitude_share', 'phase_rad', 'frequency_share')
        )
        replace(
            scenario,
            mass_kg=scenario.mass_kg * (1.0 + off('mass_share')[0]),
            orbit_radius_m=scenario.orbit_radius_m + off('orbit_altitude_m')[0],
            initial_position_m=start('initial_position_m', off('initial_position_m')),
            initial_velocity_m_s=start('initial_velocity_m_s', off('initial_velocity_m_s')),
            disturbance=scenario.disturbance.varied(
                share, phase_rad=phase, frequency_share=frequency
            ),
        )
