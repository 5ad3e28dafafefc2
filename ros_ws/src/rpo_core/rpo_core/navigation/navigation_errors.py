# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Navigation with errors: the truth plus a bias and white noise. Section `navigation`.

Noise is a function of tick and key (`rpo_core.kernels.noise`), so all of it can be repeated.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any

from rpo_core.files.validation import Checked, InputError, real, shown, vector3, whole
from rpo_core.kernels.arithmetic import State, Vector
from rpo_core.kernels.noise import six_normals
from rpo_core.navigation import sensor_kernels
from rpo_core.stage import Place, Section, Signal, Stage, register
from rpo_core.wire import interfaces

MAX_POSITION_ERROR_M = 1e5
MAX_VELOCITY_ERROR_M_S = 1e3


def key(name: str, value: Any) -> tuple[int, ...]:
    """Return two words of 32 bits, a key of Philox4x32-10; raises InputError."""
    if not isinstance(value, (list, tuple)) or len(value) != 2:
        raise InputError(f'`{name}` must be a list of 2 words of 32 bits; got {shown(value)}')
    return tuple(whole(f'{name}[{i}]', v, least=0, most=2**32 - 1) for i, v in enumerate(value))


_position_bias = partial(vector3, unit='m', bound=MAX_POSITION_ERROR_M)
_velocity_bias = partial(vector3, unit='m/s', bound=MAX_VELOCITY_ERROR_M_S)
_position_noise = partial(real, unit='m', least=0.0, most=MAX_POSITION_ERROR_M)
_velocity_noise = partial(real, unit='m/s', least=0.0, most=MAX_VELOCITY_ERROR_M_S)


@dataclass(frozen=True)
class Navigation(Checked):
    """Error of the navigation solution, which is what the controller sees.

    position_bias_m, velocity_bias_m_s : (3,) added to the truth, target LVLH
    position_noise_m, velocity_noise_m_s : 1 sigma, white, each axis by itself, new at each tick
    noise_key : two words of 32 bits, the key of Philox4x32-10
    """

    position_bias_m: Annotated[Vector, _position_bias] = (0.0, 0.0, 0.0)
    velocity_bias_m_s: Annotated[Vector, _velocity_bias] = (0.0, 0.0, 0.0)
    position_noise_m: Annotated[float, _position_noise] = 0.0
    velocity_noise_m_s: Annotated[float, _velocity_noise] = 0.0
    noise_key: Annotated[tuple[int, int], key] = (0, 0)

    def solution(self, tick: int, state: Signal) -> State:
        """Return the state (x, y, z, vx, vy, vz) [m, m/s] that navigation finds at a tick."""
        noisy = self.position_noise_m > 0.0 or self.velocity_noise_m_s > 0.0
        n = six_normals(tick, *self.noise_key) if noisy else (0.0,) * 6
        r, v = self.position_noise_m, self.velocity_noise_m_s
        bias = (*self.position_bias_m, *self.velocity_bias_m_s)
        x, y, z, vx, vy, vz = map(sensor_kernels.measured, state, bias, (r, r, r, v, v, v), n)
        return x, y, z, vx, vy, vz


class NavigationStage(Stage):
    """From the true state to the navigation solution."""

    name = 'navigation'
    inputs = (interfaces.RELATIVE_STATE,)
    outputs = (interfaces.NAVIGATION_STATE,)

    def __init__(self, settings: Navigation) -> None:
        self.settings = settings

    def step(self, tick: int, *inputs: Any) -> tuple[Signal, ...]:
        """Return the navigation solution (6,) [m, m/s]."""
        return (self.settings.solution(tick, inputs[0]),)


def _make(settings: Navigation, _scenario: Any) -> Stage:
    return NavigationStage(settings)


register(Section('navigation', Navigation, Place.SENSOR, _make))
