# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Thrusters: what becomes of a command. Section `thrusters` of a scenario.

The thrusters take the command of `delay_ticks` ago, saturate it per axis, and exert it with their
own magnitude and direction. Energy is counted of the saturated command.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from rpo_core import interfaces, kernels
from rpo_core.kernels import Vector
from rpo_core.stage import Place, Section, Signal, Stage, register
from rpo_core.validation import InputError, check_fields, shown, vector3, whole

MAX_DELAY_TICKS = 1000
MAX_GAIN = 10.0
"""Largest entry of a thrust matrix; beyond it a number is a typing error."""

IDENTITY = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
ZERO: Vector = (0.0, 0.0, 0.0)


def _matrix(name: str, value: Any) -> tuple[Vector, ...]:
    if not isinstance(value, (list, tuple)) or len(value) != 3:
        raise InputError(f'`{name}` must be a list of 3 rows of 3 numbers; got {shown(value)}')
    return tuple(vector3(f'{name}[{i}]', row, '', bound=MAX_GAIN) for i, row in enumerate(value))


@dataclass(frozen=True)
class Thrusters:
    """What becomes of a command.

    matrix : 3 rows of 3, force exerted = matrix x saturated command, target LVLH axes
    delay_ticks : from a state to the force that answers it; zero force before the first
    """

    matrix: Annotated[tuple[Vector, Vector, Vector], _matrix] = IDENTITY
    delay_ticks: Annotated[int, partial(whole, least=0, most=MAX_DELAY_TICKS)] = 0

    def __post_init__(self) -> None:
        check_fields(self)


class ThrustersStage(Stage):
    """From the command to the force on the chaser; without settings, saturation alone.

    limit_n : largest |f| of an axis
    """

    name = 'thrusters'
    inputs = (interfaces.COMMAND,)
    outputs = (interfaces.DUE_FORCE, interfaces.SATURATED_FORCE, interfaces.THRUST_FORCE)

    def __init__(self, settings: Thrusters | None, limit_n: float) -> None:
        self._matrix: Any = tuple(t for row in settings.matrix for t in row) if settings else ()
        self._limit_n = float(limit_n)
        self.memory_ticks = settings.delay_ticks if settings else 0
        self.reset()

    def reset(self) -> None:
        """Forget the commands that are on their way."""
        self._line: deque[Signal] = deque([ZERO] * (self.memory_ticks or 0))

    def step(self, tick: int, *inputs: Any) -> tuple[Signal, ...]:
        """Return the command that is due (3,), saturated (3,), and the force exerted (3,) [N]."""
        due = inputs[0]
        if self.memory_ticks:
            self._line.append(due)
            due = self._line.popleft()
        limit = self._limit_n
        fx, fy, fz = due
        saturated = (
            kernels.saturate(fx, limit),
            kernels.saturate(fy, limit),
            kernels.saturate(fz, limit),
        )
        if not self._matrix:
            return due, saturated, saturated
        exerted: Any = kernels.exerted_force(*self._matrix, *saturated)  # type: ignore[call-arg]
        return due, saturated, exerted

    def steps(
        self, ticks: NDArray[np.int64], *inputs: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], ...]:
        """Return the outputs (n, 3) of many ticks."""
        if self.memory_ticks or self._matrix:
            return super().steps(ticks, *inputs)
        saturated = np.clip(inputs[0], -self._limit_n, self._limit_n)
        return inputs[0], saturated, saturated


def _make(settings: Thrusters, scenario: Any) -> Stage:
    return ThrustersStage(settings, scenario.max_force_n)


register(Section('thrusters', Thrusters, Place.THRUSTERS, _make))
