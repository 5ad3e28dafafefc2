# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""One run of a campaign as a scenario: the core and the nodes fly it to the same bits."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from rpo_core.chain.flight import Flight, fly
from rpo_core.chain.stage import Place
from rpo_core.files.scenario import Scenario
from rpo_core.wire.interfaces import APPLIED_FORCE
from rpo_core.world.dynamics import Dynamics
from rpo_core.world.navigation_errors import Navigation
from rpo_core.world.thrusters import Failure, Thrusters, valve_names
from rpo_guidance.plan import Guidance
from rpo_montecarlo.campaign.config import Campaign
from rpo_montecarlo.campaign.faults import LinkStage
from rpo_montecarlo.campaign.sampling import DrawnRuns, draw
from rpo_nav.estimator import Estimator
from rpo_nav.sensors import NOISES, Sensors
from rpo_safety.settings import Assurance


def fly_run(campaign: Campaign, number: int) -> Flight:
    """Return the flight of run `number`, tick by tick through the core.

    With message faults, its forces are those held at each tick.
    """
    scenario = scenario_of(campaign, number)
    faults = campaign.config.faults
    if faults is None:
        return fly(scenario, campaign.controller)
    key = draw(campaign, number, 1).keys[0].tolist()
    link = LinkStage(faults, (key[0], key[1]))
    flight = fly(scenario, campaign.controller, [(Place.LINK, link)])
    return replace(flight, forces_n=flight.signals[APPLIED_FORCE])


def scenario_of(campaign: Campaign, number: int) -> Scenario:
    """Return the scenario of run `number`."""
    return scenario_of_draw(campaign, draw(campaign, number, 1), 0)


def scenario_of_draw(campaign: Campaign, runs: DrawnRuns, index: int) -> Scenario:
    """Return the scenario of a drawn run: its start, mass, orbit, disturbance, stages."""
    nominal, row = campaign.scenario, runs.parameters[index].tolist()
    number = int(runs.numbers[index])
    return replace(
        nominal,
        name=f'{nominal.name}_run_{number}',
        description=f'run {number} of campaign {campaign.config.name}, seed {campaign.config.seed}',
        initial_position_m=tuple(row[:3]),
        initial_velocity_m_s=tuple(row[3:6]),
        mass_kg=row[6],
        orbit_radius_m=row[22],
        disturbance=runs.disturbance(index, nominal.disturbance),
    ).equipped(
        *_dynamics(campaign, runs, index),
        *_thrusters(campaign, runs, index),
        *_navigation(campaign, runs, index),
        *_sensing(campaign, runs, index),
        *_told(campaign),
    )


def _own(runs: DrawnRuns, name: str, index: int) -> float:
    return float(runs.own[name][index]) if name in runs.own else 0.0


def _dynamics(campaign: Campaign, runs: DrawnRuns, index: int) -> list[Dynamics]:
    """Return the dynamics of a run; the atmosphere does not rise with its orbit."""
    nominal = campaign.scenario.dynamics
    if nominal is None:
        return []
    drag = nominal.drag
    if drag is not None:
        lighter = 1.0 + _own(runs, 'ballistic_coefficient_share', index)
        drag = replace(
            drag,
            density_kg_m3=drag.density_kg_m3 * (1.0 + _own(runs, 'density_share', index)),
            density_radius_m=drag.density_radius_m or campaign.scenario.orbit_radius_m,
            chaser_ballistic_coefficient_kg_m2=drag.chaser_ballistic_coefficient_kg_m2 * lighter,
        )
    anomaly_deg = nominal.true_anomaly_deg + _own(runs, 'true_anomaly_deg', index)
    return [replace(nominal, true_anomaly_deg=anomaly_deg, drag=drag)]


def _thrusters(campaign: Campaign, runs: DrawnRuns, index: int) -> list[Thrusters]:
    """Return the thrusters of a run: the scenario's, and what is dispersed of them."""
    nominal, dispersed = campaign.scenario.thrusters, campaign.config.dispersions
    if nominal is None and not {'thrust_share', 'misalignment_deg', 'delay_ticks'} & set(dispersed):
        return []
    x, y, z = (tuple(row) for row in runs.thrust(index).tolist())
    found = replace(nominal or Thrusters(), matrix=(x, y, z), delay_ticks=int(runs.delays[index]))
    if found.pulses is not None and 'stuck_off_thruster' in runs.own:
        name = valve_names(found.pulses.count)[int(runs.own['stuck_off_thruster'][index])]
        failures = (*found.pulses.failures, Failure(thruster=name, stuck='off'))
        found = replace(found, pulses=replace(found.pulses, failures=failures))
    return [found]


def _sensing(campaign: Campaign, runs: DrawnRuns, index: int) -> list[Any]:
    """Return sensors and estimator of a run; the filter is told what is nominal."""
    sensors, estimator = campaign.scenario.section(Sensors), campaign.scenario.section(Estimator)
    if sensors is None:
        return []
    louder = 1.0 + _own(runs, 'sensor_noise_share', index)
    bias = [_own(runs, f'sensor_bias_{axis}_m', index) for axis in 'xyz']
    units = []
    for unit in sensors.units:
        changed: dict[str, Any] = {name: getattr(unit, name) * louder for name in NOISES}
        changed['scale_error'] = unit.scale_error + _own(runs, 'sensor_scale_error', index)
        changed['bias_m'] = tuple(b + more for b, more in zip(unit.bias_m, bias, strict=True))
        units.append(replace(unit, **changed))
    key = (int(runs.keys[index, 0]), int(runs.keys[index, 1]))
    found: list[Any] = [replace(sensors, units=tuple(units), noise_key=key)]
    if estimator is not None:
        nominal = campaign.scenario
        told = replace(
            estimator,
            noise_scale=estimator.noise_scale / louder,
            mass_kg=estimator.mass_kg or nominal.mass_kg,
            delay_ticks=getattr(nominal.thrusters, 'delay_ticks', 0)
            if estimator.delay_ticks < 0
            else estimator.delay_ticks,
        )
        found.append(told)
    return found


def _told(campaign: Campaign) -> list[Any]:
    """Return guidance and assurance, which are told the nominal mass."""
    nominal = campaign.scenario
    if 'mass_share' not in campaign.config.dispersions:
        return []
    found = [nominal.section(Guidance), nominal.section(Assurance)]
    return [replace(s, mass_kg=s.mass_kg or nominal.mass_kg) for s in found if s is not None]


def _navigation(campaign: Campaign, runs: DrawnRuns, index: int) -> list[Navigation]:
    config = campaign.config
    if not any(name.startswith('navigation_') for name in config.dispersions):
        return []
    biases = runs.biases[index].tolist()
    errors = Navigation(
        tuple(biases[:3]),
        tuple(biases[3:]),
        config.spread('navigation_position_noise_m')[0],
        config.spread('navigation_velocity_noise_m_s')[0],
        (int(runs.keys[index, 0]), int(runs.keys[index, 1])),
    )
    return [errors]
