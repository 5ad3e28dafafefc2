# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""One run of a campaign as a scenario: the core and the nodes fly it to the same bits."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from rpo.engine.support import kinds
from rpo.engine.tick import Draw
from rpo.montecarlo.config import Campaign
from rpo.montecarlo.faults import LinkStage
from rpo.montecarlo.sampling import STARTS, DrawnRuns, draw
from rpo_core.attitude.target import move_together
from rpo_core.chain.flight import Flight, fly
from rpo_core.files.validation import within
from rpo_core.scenario.scenario import Scenario
from rpo_core.stage import Place
from rpo_core.wire.interfaces import APPLIED_FORCE
from rpo_core.world.cw import mean_motion


def fly_run(campaign: Campaign, number: int) -> Flight:
    """Return the flight of run `number`, tick by tick through the core.

    With message faults, its forces are those held at each tick.
    """
    scenario = scenario_of(campaign, number)
    faults = campaign.config.faults
    if faults is None:
        return fly(scenario, campaign.controller)
    key = draw(campaign, number, 1).keys[0].tolist()
    turns = scenario.named('attitude_control') is not None
    link = LinkStage(faults, (key[0], key[1]), turns)
    flight = fly(scenario, campaign.controller, [(Place.UNLOADING, link)])
    return flight if turns else replace(flight, forces_n=flight.signals[APPLIED_FORCE])


def scenario_of(campaign: Campaign, number: int) -> Scenario:
    """Return the scenario of run `number`."""
    return scenarios_of(campaign, draw(campaign, number, 1))[0]


def scenarios_of(campaign: Campaign, runs: DrawnRuns) -> list[Scenario]:
    """Return the scenarios of drawn runs: their starts, masses, orbits, disturbances, stages."""
    named = [within(f'run {number}') for number in runs.numbers.tolist()]  # in what is refused
    found = [by(_changes)(campaign, runs, index) for index, by in enumerate(named)]
    nominal, motions, ticks = campaign.scenario, [], []
    if nominal.target is not None and nominal.named('assurance') is not None:
        for changes, delay in zip(found, runs.column('delay_ticks').tolist(), strict=True):
            target = next(s for s in changes['sections'] if type(s) is type(nominal.target))
            orbit = mean_motion(changes['orbit_radius_m'], nominal.body)
            motions.append(target.known.motion(orbit, nominal.dt_s))
            ticks.append(nominal.ticks + int(delay) + 2)
        move_together(motions, ticks)  # by itself the check of each would compute its own
    return [by(replace)(nominal, **changes) for by, changes in zip(named, found, strict=True)]


def _changes(campaign: Campaign, runs: DrawnRuns, index: int) -> dict[str, Any]:
    """Return what a drawn run changes of the scenario."""
    nominal, number = campaign.scenario, int(runs.numbers[index])
    values = dict(zip(runs.names, runs.parameters[index].tolist(), strict=True))
    dispersed = {name: d.spread for name, d in campaign.config.dispersions.items()}
    k0, k1 = runs.keys[index].tolist()
    start = [values[name] for name in STARTS]
    varied = Draw(values, dispersed, (k0, k1))
    disturbance = nominal.disturbance.varied(
        values['disturbance_amplitude_share'],
        phase_rad=values['disturbance_phase_rad'],
        frequency_share=values['disturbance_frequency_share'],
    )
    return {
        'name': f'{nominal.name}_run_{number}',
        'description': f'run {number} of campaign {campaign.config.name}, '
        f'seed {campaign.config.seed}',
        'initial_position_m': tuple(start[:3]),
        'initial_velocity_m_s': tuple(start[3:]),
        'mass_kg': values['mass_kg'],
        'orbit_radius_m': values['orbit_radius_m'],
        'disturbance': disturbance,
        'sections': nominal.sections_with(*(s for k in kinds() for s in k.vary(nominal, varied))),
    }
