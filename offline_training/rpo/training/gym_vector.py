# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The dispersed final approach as a vectorised Gymnasium environment: the engine's lanes.

Importing this module registers `rpo/DispersedApproach-v0`, for `gymnasium.make_vec`. An environment
is a run of a campaign, so its starts, masses, thrusters, sensors and disturbances are drawn, and a
controller that plays it flies as in its campaign, to the rounding of its actions. Needs the layers
`gym` and `train`.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space

from rpo.engine.lanes import BEFORE, SEEN_R, SEEN_V, R, V
from rpo.engine.parts.dynamics import uneven_steps
from rpo.engine.support import why_not
from rpo.montecarlo import config
from rpo.montecarlo.config import MAX_RUNS
from rpo.montecarlo.run_batch import case_of, known_of
from rpo.montecarlo.sampling import draw
from rpo.training.gym import MAX_OBSERVED, UNITS, spaces
from rpo.training.stepping import Stepping
from rpo_core.files.validation import InputError, mapping, whole
from rpo_core.judge.metrics import PENALTY
from rpo_core.kernels.arrays import Floats

ENVIRONMENT = 'rpo/DispersedApproach-v0'

HELD_OUT = 90210
"""Seed of the draws that are for judging: `reset` takes it only with the option `judging`."""


class DispersedApproach(gymnasium.vector.VectorEnv[Floats, Floats, Any]):
    """Runs of a campaign, which all begin and end together.

    Actions, observations and rewards are those of `rpo.training.gym.FinalApproach`, one row for
    each run; what is seen is what a controller sees. At the last step -100 for each limit of the
    campaign's `success` that is missed; then `infos` has `kept`, limit -> (n,) bool, `values` of
    what is limited, and `fitness_n2s` (n,). The next step begins the next runs of the campaign.

    Parameters
    ----------
    num_envs : how many runs fly side by side
    campaign : shipped name or path
    ticks_per_step : an action is held for so many ticks; rewards add up

    Examples
    --------
    >>> import rpo
    >>> rpo.DispersedApproach(40, 'paper_test_measured').reset(seed=1)[0].shape
    (40, 10)
    """

    metadata = {'autoreset_mode': AutoresetMode.NEXT_STEP}  # noqa: RUF012 (as Gymnasium wants it)

    def __init__(
        self, num_envs: int = 40, campaign: str = 'paper_test', ticks_per_step: int = 1
    ) -> None:
        self.num_envs = whole('num_envs', num_envs, least=1)
        self.campaign = config.load(config.find(campaign), controller='drift', runs=MAX_RUNS)
        self.scenario = self.campaign.scenario
        if reason := why_not(self.scenario, self.campaign.controller):
            raise InputError(f'the environment is the engine: {reason}')
        ticks = self.scenario.ticks
        self.ticks_per_step = whole('ticks_per_step', ticks_per_step, least=1, most=ticks)
        self.single_action_space, self.single_observation_space = spaces()
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.tick, self._first = ticks, 0

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Floats, dict[str, Any]]:
        """Begin the first runs of a seed; without one, the next runs. Raises InputError."""
        judging = bool(mapping('options', options or {}, (), ('judging',)).get('judging', False))
        if seed is not None:
            if seed == HELD_OUT and not judging:
                raise InputError(f'seed {HELD_OUT} is for judging: options={{"judging": True}}')
            own = replace(self.campaign.config, seed=seed)
            self.campaign, self._first = replace(self.campaign, config=own), 0
        return self._begin()

    def _begin(self) -> tuple[Floats, dict[str, Any]]:
        if self._first + self.num_envs > MAX_RUNS:
            raise InputError(f'a seed has {MAX_RUNS} runs; `reset` with another seed')
        drawn = draw(self.campaign, self._first, self.num_envs)
        if reason := uneven_steps(self.scenario, drawn.column('orbit_radius_m')):
            raise InputError(f'the environment is the engine: {reason}')
        self._first += self.num_envs
        self.tick, self.stepping = 0, Stepping(case_of(self.campaign, drawn))
        self.stepping.sense(0)
        return self._observations(), {}

    def step(self, actions: Floats) -> tuple[Floats, Floats, Any, Any, dict[str, Any]]:
        """Fly `ticks_per_step` ticks; after the end of the flights, begin the next."""
        over = np.zeros(self.num_envs, np.bool_)
        rewards = np.zeros(self.num_envs)
        if self.tick == self.scenario.ticks:
            return self._begin()[0], rewards, over, over.copy(), {}
        given = np.asarray(actions, np.float64)
        if given.shape != (self.num_envs, 3) or not np.isfinite(given).all():
            raise InputError(f'`actions` must be {self.num_envs} x 3 finite numbers')
        forces_n = self.scenario.max_force_n * given
        for _ in range(min(self.ticks_per_step, self.scenario.ticks - self.tick)):
            self.stepping.pass_tick(self.tick, forces_n)
            self.tick += 1
            self.stepping.sense(self.tick)
            applied = self.stepping.vectors(BEFORE)
            rewards -= (applied * applied).sum(axis=1) * self.scenario.dt_s
        infos: dict[str, Any] = {}
        if self.tick == self.scenario.ticks:
            self.stepping.end(self.tick)
            over[:], infos = True, self._judged()
            missed = sum(~kept for kept in infos['kept'].values())
            infos['fitness_n2s'] = infos['energy_n2s'] + PENALTY * missed
            rewards -= PENALTY * missed
        return self._observations(), rewards, over, np.zeros_like(over), infos

    def _judged(self) -> dict[str, Any]:
        """Return energies (n,) [N²s], values of what is limited, and which limits are kept."""
        figures = known_of(self.campaign, self.stepping.case, self.stepping.landed())
        limits = self.campaign.config.limits(figures)
        kept = {name: np.asarray(value <= limit) for name, (value, limit) in limits.items()}
        values = {name: value for name, (value, _) in limits.items()}
        return {'energy_n2s': figures['energy_n2s'], 'values': values, 'kept': kept}

    def _observations(self) -> Floats:
        rows = (SEEN_R, SEEN_V) if self.stepping.case.batches[0].is_seen else (R, V)
        states = np.hstack([self.stepping.vectors(row) for row in rows]) / UNITS
        commands = self.stepping.vectors(BEFORE) / self.scenario.max_force_n
        share = np.full((self.num_envs, 1), self.tick / self.scenario.ticks)
        return np.hstack([states.clip(-MAX_OBSERVED, MAX_OBSERVED), commands, share])


if ENVIRONMENT not in gymnasium.registry:
    gymnasium.register(ENVIRONMENT, vector_entry_point=f'{__name__}:DispersedApproach')
