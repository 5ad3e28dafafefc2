# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""One run of a campaign as a scenario: the core and the nodes fly it to the same bits."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from rpo_core.flight import Flight, fly
from rpo_core.hardware import Chaser, Navigation, Thrusters
from rpo_core.scenario import Scenario
from rpo_training.campaign.config import Campaign
from rpo_training.campaign.faults import Channel
from rpo_training.campaign.sampling import Runs, draw


def fly_run(campaign: Campaign, number: int) -> Flight:
    """Return the flight of run `number`, tick by tick through the core.

    With message faults, its forces are those held at each tick.
    """
    scenario = scenario_of(campaign, number)
    if campaign.config.faults is None:
        return fly(scenario, campaign.controller)
    key = draw(campaign, number, 1).keys[0].tolist()
    channel = Channel(campaign.config.faults, (key[0], key[1]))
    chaser, navigation = Chaser(scenario), scenario.navigation or Navigation()
    states, held = np.empty((scenario.ticks + 1, 6)), np.empty((scenario.ticks + 1, 3))
    disturbances = scenario.disturbance.over(scenario.times_s)
    for tick, push in enumerate(disturbances.tolist()):
        states[tick] = chaser.state
        seen = navigation.solution(tick, chaser.state)
        command = campaign.controller.force_n(seen[:3], seen[3:], tick)
        held[tick] = force = channel.passed(tick, command)
        if tick < scenario.ticks:
            chaser.advance(force, (push[0], push[1], push[2]))
    return Flight(scenario, states, held, disturbances)


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
        thrusters=_thrusters(campaign.config.dispersions, runs),
        navigation=_navigation(campaign, runs),
    )


def _thrusters(dispersed: Collection[str], runs: Runs) -> Thrusters | None:
    if not {'thrust_share', 'misalignment_deg', 'delay_ticks'} & set(dispersed):
        return None
    x, y, z = (tuple(row) for row in runs.thrust(0).tolist())
    return Thrusters((x, y, z), int(runs.delays[0]))


def _navigation(campaign: Campaign, runs: Runs) -> Navigation | None:
    config = campaign.config
    if not any(name.startswith('navigation_') for name in config.dispersions):
        return None
    biases = runs.biases[0].tolist()
    return Navigation(
        tuple(biases[:3]),
        tuple(biases[3:]),
        config.spread('navigation_position_noise_m')[0],
        config.spread('navigation_velocity_noise_m_s')[0],
        (int(runs.keys[0, 0]), int(runs.keys[0, 1])),
    )
