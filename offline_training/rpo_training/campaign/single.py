# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""One run of a campaign by itself, tick by tick through the core: the bits of the campaign."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rpo_core.closed_loop import Flight
from rpo_core.controller import FuzzyController
from rpo_core.kernels import State, cw_step, saturate
from rpo_core.scenario import Scenario
from rpo_training.campaign.config import Campaign
from rpo_training.campaign.loops import given_force
from rpo_training.campaign.noise import six_normals
from rpo_training.campaign.sampling import Runs, draw


def fly_run(campaign: Campaign, number: int) -> Flight:
    """Return the flight of run `number`.

    Its states are the truth; its forces are what the thrusters were told, late by the run's delay;
    its scenario is the run's, so that the figures of `rpo_core.metrics` are those of the campaign.
    """
    runs = draw(campaign, number, 1)
    scenario = scenario_of(campaign.scenario, runs, number)
    states, forces = np.empty((scenario.ticks + 1, 6)), np.zeros((scenario.ticks + 1, 3))
    disturbances = scenario.disturbance.over(scenario.times_s)
    delay, limit = int(runs.delays[0]), scenario.max_force_n
    thrust = runs.thrust(0).ravel().tolist()
    measured = _Navigation(campaign, runs)
    state = scenario.start
    for tick in range(scenario.ticks):
        states[tick] = state
        command = _command(campaign.controller, measured(tick, state))
        if tick + delay < scenario.ticks:
            forces[tick + delay] = [saturate(f, limit) for f in command]
        given = given_force(*thrust, *forces[tick].tolist())
        total = tuple(g + d for g, d in zip(given, disturbances[tick].tolist(), strict=True))
        state = cw_step(state, total, scenario.step)
    states[-1] = state
    return Flight(scenario, states, forces, disturbances)


def _command(controller: FuzzyController, state: list[float]) -> tuple[float, float, float]:
    return controller.force_n(state[:3], state[3:])


class _Navigation:
    """Truth plus bias plus white noise."""

    def __init__(self, campaign: Campaign, runs: Runs) -> None:
        position = campaign.config.spread('navigation_position_noise_m')[0]
        velocity = campaign.config.spread('navigation_velocity_noise_m_s')[0]
        self._sigmas = [position] * 3 + [velocity] * 3
        self._biases = runs.biases[0].tolist()
        self._key = [int(k) for k in runs.keys[0]]
        self._noisy = position > 0.0 or velocity > 0.0

    def __call__(self, tick: int, state: State) -> list[float]:
        noise = six_normals(tick, *self._key) if self._noisy else (0.0,) * 6
        return [
            truth + bias + sigma * normal
            for truth, bias, sigma, normal in zip(
                state, self._biases, self._sigmas, noise, strict=True
            )
        ]


def scenario_of(nominal: Scenario, runs: Runs, number: int) -> Scenario:
    """Return the scenario of a single drawn run: its start, mass, orbit and disturbance."""
    row = runs.parameters[0].tolist()
    return replace(
        nominal,
        name=f'{nominal.name}_run_{number}',
        initial_position_m=tuple(row[:3]),
        initial_velocity_m_s=tuple(row[3:6]),
        mass_kg=row[6],
        orbit_radius_m=row[22],
        disturbance=runs.disturbance(0, nominal.disturbance),
    )
