# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Thrusters and navigation as they are, not as they should be, and the chaser that flies with them.

At tick k navigation measures the state with a bias and noise; the controller answers that; the
thrusters saturate the command of `delay_ticks` ago, and give it with their own magnitude and
direction. Noise is a function of tick and key (`rpo_core.noise`), so all of it can be repeated.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rpo_core import kernels
from rpo_core.kernels import State, Vector
from rpo_core.noise import six_normals
from rpo_core.validation import InputError, mapping, real, shown, store, vector3, whole, within

if TYPE_CHECKING:
    from rpo_core.scenario import Scenario

MAX_DELAY_TICKS = 1000
MAX_GAIN = 10.0
"""Largest entry of a thrust matrix; beyond it a number is a typing error."""

MAX_POSITION_ERROR_M = 1e5
MAX_VELOCITY_ERROR_M_S = 1e3

IDENTITY = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@dataclass(frozen=True)
class Thrusters:
    """What becomes of a command.

    matrix : 3 rows of 3, force given = matrix x saturated command, target LVLH axes
    delay_ticks : from a state to the force that answers it; zero force before the first
    """

    matrix: tuple[Vector, Vector, Vector] = IDENTITY
    delay_ticks: int = 0

    def __post_init__(self) -> None:
        rows = self.matrix
        if not isinstance(rows, (list, tuple)) or len(rows) != 3:
            raise InputError(f'`matrix` must be a list of 3 rows of 3 numbers; got {shown(rows)}')
        checked = tuple(
            vector3(f'matrix[{i}]', row, '', bound=MAX_GAIN) for i, row in enumerate(rows)
        )
        delay = whole('delay_ticks', self.delay_ticks, least=0, most=MAX_DELAY_TICKS)
        store(self, matrix=checked, delay_ticks=delay)

    def given_n(self, told_n: Vector) -> Vector:
        """Return the force [N] that the thrusters give when told a saturated one [N]."""
        return kernels.given_force(*self.matrix[0], *self.matrix[1], *self.matrix[2], *told_n)


@dataclass(frozen=True)
class Navigation:
    """Error of the navigation solution, which is what the controller sees.

    position_bias_m, velocity_bias_m_s : (3,) added to the truth, target LVLH
    position_noise_m, velocity_noise_m_s : 1 sigma, white, each axis by itself, new at each tick
    noise_key : two words of 32 bits, the key of Philox4x32-10
    """

    position_bias_m: Vector = (0.0, 0.0, 0.0)
    velocity_bias_m_s: Vector = (0.0, 0.0, 0.0)
    position_noise_m: float = 0.0
    velocity_noise_m_s: float = 0.0
    noise_key: tuple[int, int] = (0, 0)

    def __post_init__(self) -> None:
        key = self.noise_key
        if not isinstance(key, (list, tuple)) or len(key) != 2:
            raise InputError(f'`noise_key` must be a list of 2 words of 32 bits; got {shown(key)}')
        r, v = MAX_POSITION_ERROR_M, MAX_VELOCITY_ERROR_M_S
        noise_m, noise_m_s = self.position_noise_m, self.velocity_noise_m_s
        store(
            self,
            position_bias_m=vector3('position_bias_m', self.position_bias_m, 'm', bound=r),
            velocity_bias_m_s=vector3('velocity_bias_m_s', self.velocity_bias_m_s, 'm/s', bound=v),
            position_noise_m=real('position_noise_m', noise_m, 'm', least=0.0, most=r),
            velocity_noise_m_s=real('velocity_noise_m_s', noise_m_s, 'm/s', least=0.0, most=v),
            noise_key=tuple(
                whole(f'noise_key[{i}]', word, least=0, most=2**32 - 1)
                for i, word in enumerate(key)
            ),
        )

    def solution(self, tick: int, state: State) -> State:
        """Return the state (x, y, z, vx, vy, vz) [m, m/s] that navigation finds at a tick."""
        noisy = self.position_noise_m > 0.0 or self.velocity_noise_m_s > 0.0
        n = six_normals(tick, *self.noise_key) if noisy else (0.0,) * 6
        r, v = self.position_noise_m, self.velocity_noise_m_s
        x, y, z, vx, vy, vz = (
            kernels.measured(truth, bias, sigma, normal)
            for truth, bias, sigma, normal in zip(
                state,
                (*self.position_bias_m, *self.velocity_bias_m_s),
                (r, r, r, v, v, v),
                n,
                strict=True,
            )
        )
        return x, y, z, vx, vy, vz

    def solutions(
        self, ticks: NDArray[np.int64], states: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the navigation solutions (n, 6) at ticks (n,) of states (n, 6)."""
        rows = zip(ticks.tolist(), states.tolist(), strict=True)
        return np.array([self.solution(tick, tuple(state)) for tick, state in rows]).reshape(-1, 6)


def parse_thrusters(value: Any) -> Thrusters:
    """Return the thrusters of section `thrusters` of a scenario file; raises InputError."""
    data = mapping('thrusters', value, [], ['matrix', 'delay_ticks'])
    with within('thrusters'):
        return Thrusters(**data)


def parse_navigation(value: Any) -> Navigation:
    """Return the navigation of section `navigation` of a scenario file; raises InputError."""
    known = list(Navigation.__dataclass_fields__)
    data: Mapping[str, Any] = mapping('navigation', value, [], known)
    with within('navigation'):
        return Navigation(**data)


class Chaser:
    """The chaser in flight: its true state, and the commands that are on their way.

    state : x, y, z [m], vx, vy, vz [m/s], target LVLH
    """

    def __init__(self, scenario: Scenario) -> None:
        x, y, z, vx, vy, vz = map(float, scenario.start)
        self.state: State = (x, y, z, vx, vy, vz)
        self._thrusters = scenario.thrusters
        self._limit, self._step = float(scenario.max_force_n), scenario.step
        delay = self._thrusters.delay_ticks if self._thrusters else 0
        self._line: deque[Vector] = deque([(0.0, 0.0, 0.0)] * delay)

    def advance(self, command_n: Vector, disturbance_n: Vector) -> Vector:
        """Step under a command and a disturbance [N]; return the command that is flown now."""
        self._line.append(command_n)
        flown = self._line.popleft()
        if self._thrusters is None:
            self.state = kernels.plant_step(
                self.state, flown, disturbance_n, self._limit, self._step
            )
            return flown
        limit = self._limit
        x, y, z = (kernels.saturate(force, limit) for force in flown)
        given = self._thrusters.given_n((x, y, z))
        total = (
            given[0] + disturbance_n[0],
            given[1] + disturbance_n[1],
            given[2] + disturbance_n[2],
        )
        self.state = kernels.cw_step(self.state, total, self._step)
        return flown
