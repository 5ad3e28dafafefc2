# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""One run of a campaign as a scenario: the core and the nodes fly it to the same bits."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

from rpo_core.flight import Flight, fly
from rpo_core.interfaces import APPLIED_FORCE
from rpo_core.navigation import Navigation
from rpo_core.scenario import Scenario
from rpo_core.stage import Place
from rpo_core.thrusters import Thrusters
from rpo_training.campaign.config import Campaign
from rpo_training.campaign.faults import LinkStage
from rpo_training.campaign.sampling import DrawnRuns, draw


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
    """Return the scenario of a run: its start, mass, orbit, disturbance, thrusters, navigation."""
    nominal, runs = campaign.scenario, draw(campaign, number, 1)
    row = runs.parameters[0].tolist()
    return replace(
        nominal,
        name=f'{nominal.name}_run_{number}',
        description=f'run {number} of campaign {campaign.config.name}, seed {campaign.config.seed}',
        initial_position_m=tuple(row[:3]),
        initial_velocity_m_s=tuple(row[3:6]),
        mass_kg=row[6],
        orbit_radius_m=row[22],
        disturbance=runs.disturbance(0, nominal.disturbance),
    ).equipped(
        *_thrusters(campaign.config.dispersions, runs),
        *_navigation(campaign, runs),
    )


def _thrusters(dispersed: Collection[str], runs: DrawnRuns) -> list[Thrusters]:
    if not {'thrust_share', 'misalignment_deg', 'delay_ticks'} & set(dispersed):
        return []
    x, y, z = (tuple(row) for row in runs.thrust(0).tolist())
    return [Thrusters((x, y, z), int(runs.delays[0]))]


def _navigation(campaign: Campaign, runs: DrawnRuns) -> list[Navigation]:
    config = campaign.config
    if not any(name.startswith('navigation_') for name in config.dispersions):
        return []
    biases = runs.biases[0].tolist()
    errors = Navigation(
        tuple(biases[:3]),
        tuple(biases[3:]),
        config.spread('navigation_position_noise_m')[0],
        config.spread('navigation_velocity_noise_m_s')[0],
        (int(runs.keys[0, 0]), int(runs.keys[0, 1])),
    )
    return [errors]
