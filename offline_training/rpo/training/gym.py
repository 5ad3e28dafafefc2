# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The final approach as a Gymnasium environment, for controllers that learn.

Importing this module registers `rpo/FinalApproach-v0`. One step is one tick of the core's plant
(`rpo_core.chain.chain`), so a policy that commands what a controller commands flies the same bits.
The return of an episode is minus its fitness, -(J + 100 for each condition missed), AAS 23-199.

Needs NumPy, PyYAML and gymnasium (layer `gym`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from rpo.scoring.conditions import LABELS, PAPER
from rpo_core.assurance.assurance import AssuranceStage
from rpo_core.chain.chain import Chain, Signals, start_of
from rpo_core.chain.flight import Flight
from rpo_core.files.validation import InputError, mapping, real, shown, vector3, whole, within
from rpo_core.judge.metrics import PENALTY, of_flight
from rpo_core.judge.verdicts import verdicts
from rpo_core.kernels.arithmetic import saturate
from rpo_core.kernels.arrays import Floats
from rpo_core.scenario.scenario import MAX_VELOCITY_M_S, Scenario, ScenarioSet, load
from rpo_core.stage import Place, Signal
from rpo_core.wire.interfaces import (
    CONTROL_FORCE,
    NAVIGATION_STATE,
    RELATIVE_STATE,
    SATURATED_FORCE,
)
from rpo_core.world.starts import MAX_POSITION_M

ENVIRONMENT = 'rpo/FinalApproach-v0'

UNITS = np.array([100.0] * 3 + [1.0] * 3)
"""Units of an observation [m, m/s]: 100 m is the largest start of the training set."""

MAX_OBSERVED = 100.0
"""Observed positions and velocities saturate here (10 km, 100 m/s); those of `info` do not."""


def spaces() -> tuple[gymnasium.Space[Floats], gymnasium.Space[Floats]]:
    """Return the spaces of an action (3,) and of an observation (10,)."""
    high = np.array([MAX_OBSERVED] * 6 + [1.0] * 4)
    low = np.concatenate([-high[:9], [0.0]])
    action: gymnasium.Space[Any] = gymnasium.spaces.Box(-1.0, 1.0, (3,), np.float64)
    observed: gymnasium.Space[Any] = gymnasium.spaces.Box(low, high, dtype=np.float64)
    return action, observed


class FinalApproach(gymnasium.Env[Floats, Floats]):
    """One flight of a scenario; the policy commands the force of every tick.

    Action (3,) float64 in [-1, 1]: force on x, y, z of target LVLH, in units of the scenario's
    maximum force; held for one tick, saturated.

    Observation (10,) float64, dimensionless: position / 100 m and velocity / 1 m/s from navigation;
    the saturated command of the tick before / maximum force; the share of the flight that is over.

    Reward: -f.f dt [N²s] of the saturated command, and with the last one -100 for each condition
    missed: what the scenario requires, or the paper's conditions if it requires nothing. The
    episode terminates at the end of the flight; it is never truncated.

    Parameters
    ----------
    scenario : shipped name, path, Scenario or ScenarioSet; of a set, each reset draws a member
    render_mode : None; 'ansi' for a line of text; 'rgb_array' for a picture of the flight so far,
        which needs matplotlib

    Examples
    --------
    >>> import rpo
    >>> rpo.FinalApproach('quick').reset(seed=1)[0].shape
    (10,)
    """

    metadata = {'render_modes': ['ansi', 'rgb_array'], 'render_fps': 10}  # noqa: RUF012 (as Gymnasium wants it)

    def __init__(
        self,
        scenario: str | Path | Scenario | ScenarioSet = 'paper_training',
        render_mode: str | None = None,
    ) -> None:
        self.action_space, self.observation_space = spaces()
        self.render_mode = render_mode
        self._members = _members(scenario)
        self._begin(self._members[0])

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Floats, dict[str, Any]]:
        """Begin a flight.

        options : `scenario`, from now on; `start`, the index of a member of the set, or a position
        (3,) [m], or a position and a velocity (6,) [m, m/s], target LVLH

        Raises InputError for bad options.
        """
        super().reset(seed=seed)
        data: Mapping[str, Any] = mapping('options', options or {}, (), ('scenario', 'start'))
        if 'scenario' in data:
            self._members = _members(data['scenario'])
        start = data.get('start')
        if start is None:
            start = int(self.np_random.integers(len(self._members)))
        with within('options'):
            self._begin(self._from(start))
        return self._observation(), self._info()

    def _from(self, start: Any) -> Scenario:
        """Return the member of this number, or the scenario from these 3 or 6 numbers."""
        if np.ndim(start) == 0:
            return self._members[whole('start', start, least=0, most=len(self._members) - 1)]
        first, values = self._members[0], np.asarray(start).tolist()
        if len(values) not in (3, 6):
            raise InputError(
                f'`start` must be the number of a start, or 3 or 6 numbers; got {shown(start)}'
            )
        velocity = values[3:] or first.initial_velocity_m_s
        position = vector3('start', values[:3], 'm', bound=MAX_POSITION_M)
        velocity = vector3('start', velocity, 'm/s', bound=MAX_VELOCITY_M_S)
        return first.starting_at((*position, *velocity))

    def _begin(self, scenario: Scenario) -> None:
        self.scenario, self.tick = scenario, 0
        chain = Chain.of(scenario)
        self._sensors, self._plant = chain.before(Place.CONTROLLER), chain.after(Place.CONTROLLER)
        chain.reset()
        self._states = np.empty((scenario.ticks + 1, 6))
        self._commands = np.zeros((scenario.ticks + 1, 3))
        self._signals: Signals = {**start_of(scenario), SATURATED_FORCE: (0.0, 0.0, 0.0)}
        self._sense()

    def _sense(self) -> None:
        """Record the true state of the present tick, and run the sensors on it."""
        self._states[self.tick] = self._signals[RELATIVE_STATE]
        self._sensors.step(self.tick, self._signals)

    def step(self, action: Floats) -> tuple[Floats, float, bool, bool, dict[str, Any]]:
        """Fly one tick; raises InputError if the action is not a force or the flight is over."""
        scenario, values = self.scenario, np.asarray(action)
        if self.tick == scenario.ticks:
            raise InputError('the flight is over; call `reset` before the next `step`')
        if values.shape != (3,):
            raise InputError(f'`action` must be 3 numbers in [-1, 1]; got {shown(action)}')
        limit = scenario.max_force_n
        x, y, z = (saturate(real('action', f) * limit, limit) for f in values.tolist())
        self._commands[self.tick] = self._signals[CONTROL_FORCE] = x, y, z
        self._plant.step(self.tick, self._signals)
        self.tick += 1
        self._sense()
        fx, fy, fz = self._signals[SATURATED_FORCE]
        reward = -(fx * fx + fy * fy + fz * fz) * scenario.dt_s
        info, over = self._info(), self.tick == scenario.ticks
        if over:
            metrics, held = of_flight(self.flight), self._held()
            penalty = PENALTY * list(held.values()).count(False)
            reward -= penalty
            info |= {'figures': asdict(metrics), 'conditions': tuple(held.values())}
            info |= {'requirements': held, 'fitness_n2s': metrics.energy_n2s + penalty}
        return self._observation(), reward, over, False, info

    def _held(self) -> dict[str, bool]:
        """Return requirement -> whether the flight keeps it; of the paper's training, without."""
        flight = self.flight
        if self.scenario.requirements is None:
            flight = replace(flight, scenario=replace(self.scenario, requirements=PAPER))
        held = {v.key: v.holds is not False for v in verdicts(flight)}
        first = [key for key in LABELS if key in held]
        return {**{key: held[key] for key in first}, **held}

    @property
    def flight(self) -> Flight:
        """The flight since the last reset; after its end, whole. Its last command is zero."""
        if self.tick < self.scenario.ticks:
            raise InputError('the flight is not over; `flight` exists after the last step')
        return Flight(self.scenario, self._states, self._commands, self.scenario.disturbances_n)

    @property
    def seen(self) -> Signal:
        """State (6,) [m, m/s], target LVLH, from navigation; the truth if there is none."""
        return self._signals.get(NAVIGATION_STATE, self._signals[RELATIVE_STATE])

    def _observation(self) -> Floats:
        scenario = self.scenario
        state = np.clip(scenario.from_goal(self.seen) / UNITS, -MAX_OBSERVED, MAX_OBSERVED)
        command = np.array(self._signals[SATURATED_FORCE]) / scenario.max_force_n
        return np.array([*state, *command, self.tick / scenario.ticks])

    def _info(self) -> dict[str, Any]:
        return {
            'tick': self.tick,
            'time_s': self.scenario.time_s(self.tick),
            'state': np.array(self._signals[RELATIVE_STATE]),
            'seen': np.array(self.seen),
            'force_n': np.array(self._signals[SATURATED_FORCE]),
            # The limit for which assurance changed the last command.
            'constraint': ''.join(
                link.stage.decision.constraint
                for link in self._plant.links
                if isinstance(link.stage, AssuranceStage) and link.stage.decision
            ),
        }

    def render(self) -> Any:
        """Return a line of text ('ansi'), or a picture (height, width, 3) uint8 ('rgb_array')."""
        if self.render_mode == 'rgb_array':
            return self._picture()
        x, y, z, vx, vy, vz = self._signals[RELATIVE_STATE]
        fx, fy, fz = self._signals[SATURATED_FORCE]
        line = (
            f't = {self.scenario.time_s(self.tick):7.1f} s   r = [{x:8.3f} {y:8.3f} {z:8.3f}] m   '
            f'v = [{vx:7.4f} {vy:7.4f} {vz:7.4f}] m/s   f = [{fx:7.4f} {fy:7.4f} {fz:7.4f}] N'
        )
        return line if self.render_mode == 'ansi' else None

    def _picture(self) -> NDArray[np.uint8]:
        """Return the path so far in both planes, and the commands over time."""
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        figure = Figure(figsize=(9.0, 3.0), dpi=80, layout='constrained')
        canvas = FigureCanvasAgg(figure)
        planes, states = figure.subplots(1, 3), self._states[: self.tick + 1]
        for axes, up, name in zip(planes, (0, 2), ('x, R-bar [m]', 'z, H-bar [m]'), strict=False):
            axes.plot(states[:, 1], states[:, up], color='0.5')
            axes.plot(*states[-1, [1, up]], 'o')
            axes.plot(*np.array(self.scenario.goal_position_m)[[1, up]], 's', color='black')
            axes.set(xlabel='y, V-bar [m]', ylabel=name)
        limit = 1.05 * self.scenario.max_force_n
        planes[2].plot(self.scenario.times_s[: self.tick], self._commands[: self.tick])
        planes[2].set(xlabel='time [s]', ylabel='force [N]', ylim=(-limit, limit))
        planes[2].set_title(f't = {self.scenario.time_s(self.tick):.1f} s', fontsize=9)
        canvas.draw()
        return np.asarray(canvas.buffer_rgba())[..., :3].copy()


def _members(scenario: str | Path | Scenario | ScenarioSet) -> list[Scenario]:
    """Return the flights that a reset chooses from."""
    found = scenario if isinstance(scenario, (Scenario, ScenarioSet)) else load(scenario)
    return found.scenarios() if isinstance(found, ScenarioSet) else [found]


if ENVIRONMENT not in gymnasium.registry:
    gymnasium.register(ENVIRONMENT, entry_point=f'{__name__}:FinalApproach')
