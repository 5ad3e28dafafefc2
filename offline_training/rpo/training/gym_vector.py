# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The dispersed final approach as a vectorised Gymnasium environment: flights side by side.

Importing this module registers `rpo/DispersedApproach-v0`, for `gymnasium.make_vec`. An environment
is a run of a campaign, so its starts, masses, thrusters, sensors and disturbances are drawn, and a
controller that plays it flies as in its campaign, to the rounding of its actions. Needs the layers
`gym` and `train`.
"""

from __future__ import annotations

import gc
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space

from rpo.montecarlo import config
from rpo.montecarlo.config import MAX_RUNS
from rpo.montecarlo.run_batch import as_flown, faulty, scenarios_of
from rpo.montecarlo.sampling import DrawnRuns, draw
from rpo.training.gym import MAX_OBSERVED, UNITS, spaces
from rpo_core.chain.chain import Chain, start_of
from rpo_core.chain.driver import Flights
from rpo_core.chain.flight import JUDGED, flight_of
from rpo_core.files.validation import InputError, mapping, whole
from rpo_core.judge.metrics import PENALTY
from rpo_core.judge.verdicts import values_of
from rpo_core.kernels.arrays import Floats
from rpo_core.scenario.scenario import Scenario
from rpo_core.stage import ZERO, Place, Stage, section_of
from rpo_core.wire.interfaces import (
    CONTROL_FORCE,
    ESTIMATED_DISTURBANCE,
    REFERENCE_FORCE,
    REFERENCE_STATE,
    SATURATED_FORCE,
    STATE,
)

ENVIRONMENT = 'rpo/DispersedApproach-v0'

HELD_OUT = 90210
"""Seed of the draws that are for judging: `reset` takes it only with the option `judging`."""


class _Commanded(Stage):
    """A controller that commands from outside; it reads what `FollowStage` needs."""

    name, outputs = 'controller', (CONTROL_FORCE,)

    def __init__(self, scenario: Scenario) -> None:
        self.guided = any(section_of(s).place is Place.GUIDANCE for s in scenario.sections)
        followed = (REFERENCE_STATE, REFERENCE_FORCE) if self.guided else ()
        opposed = (ESTIMATED_DISTURBANCE,) if scenario.compensated else ()
        self.inputs = (STATE, *followed, *opposed)


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
    workers : threads that fly them; it changes no bit

    Examples
    --------
    >>> import rpo
    >>> rpo.DispersedApproach(40, 'paper_test_measured').reset(seed=1)[0].shape
    (40, 10)
    """

    metadata = {'autoreset_mode': AutoresetMode.NEXT_STEP}  # noqa: RUF012 (as Gymnasium wants it)

    def __init__(
        self,
        num_envs: int = 40,
        campaign: str = 'paper_test',
        ticks_per_step: int = 1,
        workers: int = 1,
    ) -> None:
        self.num_envs = whole('num_envs', num_envs, least=1)
        self.campaign = config.load(campaign, controller='drift', runs=MAX_RUNS)
        self.scenario = self.campaign.scenario
        ticks = self.scenario.ticks
        self.ticks_per_step = whole('ticks_per_step', ticks_per_step, least=1, most=ticks)
        self.single_action_space, self.single_observation_space = spaces()
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.tick, self._first = ticks, 0
        self._room: Floats | None = None
        self._parts = whole('workers', workers, least=1, most=num_envs)
        self._each: Any = map if workers == 1 else ThreadPoolExecutor(workers).map
        self._units = np.tile(UNITS, (num_envs, 1))

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
        self._first += self.num_envs
        is_collecting = gc.isenabled()
        gc.disable()  # to look for garbage in what stays would take as long as to make it
        try:
            self._make(drawn)
        finally:
            if is_collecting:
                gc.enable()
        self.flights.go_on(self._each)
        self.tick = 0
        return self._observations(), {}

    def _make(self, drawn: DrawnRuns) -> None:
        """Make the flights of drawn runs."""
        self.runs, self.controller = scenarios_of(self.campaign, drawn), _Commanded(self.scenario)
        commanded = Place.CONTROLLER, self.controller
        chains = [
            Chain.of(run, more=[commanded, *faulty(self.campaign, drawn, index)])
            for index, run in enumerate(self.runs)
        ]
        goals = [run.goal for run in self.runs]
        self._goals = np.array([run.goal_state for run in self.runs])
        self._goal_forces_n = np.array([goal.force_n if goal else ZERO for goal in goals])
        self.flights = Flights(chains, self.controller.name, JUDGED, self._parts)
        self.flights.begin([start_of(run) for run in self.runs], self.scenario.ticks, self._room)
        self._room = self.flights.room  # to map memory anew would take longer than to fly

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
            self._pass_tick(forces_n)
            self.tick += 1
            x, y, z = self._of(SATURATED_FORCE).T
            rewards -= (x * x + y * y + z * z) * self.scenario.dt_s
        observations, infos = self._observations(), dict[str, Any]()
        if self.tick == self.scenario.ticks:
            for driver in self.flights.drivers:
                driver.spend()
            self._pass_tick(np.zeros((self.num_envs, 3)))  # it moves nothing any more
            over[:], infos = True, self._judged()
            missed = sum(~kept for kept in infos['kept'].values())
            infos['fitness_n2s'] = infos['energy_n2s'] + PENALTY * missed
            rewards -= PENALTY * missed
        return observations, rewards, over, np.zeros_like(over), infos

    def _pass_tick(self, forces_n: Floats) -> None:
        """Let commands (n, 3) [N] act, and fly on to the controller of the next tick."""
        commands = self._of(CONTROL_FORCE)
        guided, read = self.controller.guided, self.flights.read
        np.add(forces_n, read[:, 12:15] if guided else self._goal_forces_n, out=commands)
        if self.scenario.compensated:
            commands -= self._of(ESTIMATED_DISTURBANCE)
        self.flights.pass_stage()
        self.flights.go_on(self._each)

    def _of(self, name: str) -> Floats:
        """Return a signal (n, width) of the present tick, as a view."""
        return self.flights.signals[:, self.flights.places[name]]

    def _judged(self) -> dict[str, Any]:
        """Return energies (n,) [N²s], values of what is limited, and which limits are kept."""
        flown = zip(self.runs, self.flights.flown(), self.flights.drivers, strict=True)
        flights = (flight_of(run, signals, driver.spent) for run, signals, driver in flown)
        rows = [values_of(as_flown(flight)) for flight in flights]
        figures = {name: np.array([row[name] for row in rows]) for name in rows[0]}
        limits = self.campaign.config.limits(figures)
        kept = {name: np.asarray(value <= limit) for name, (value, limit) in limits.items()}
        values = {name: value for name, (value, _) in limits.items()}
        return {'energy_n2s': figures['energy_n2s'], 'values': values, 'kept': kept}

    def _observations(self) -> Floats:
        read, observed = self.flights.read, np.empty((self.num_envs, 10))
        states = read[:, :6] - (read[:, 6:12] if self.controller.guided else self._goals)
        states /= self._units
        np.clip(states, -MAX_OBSERVED, MAX_OBSERVED, out=observed[:, :6])
        np.divide(self._of(SATURATED_FORCE), self.scenario.max_force_n, out=observed[:, 6:9])
        observed[:, 9] = self.tick / self.scenario.ticks
        return observed


if ENVIRONMENT not in gymnasium.registry:
    gymnasium.register(ENVIRONMENT, vector_entry_point=f'{__name__}:DispersedApproach')
