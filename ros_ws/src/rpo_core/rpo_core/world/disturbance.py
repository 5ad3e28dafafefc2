# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Disturbance forces as a constant plus harmonics per axis, held constant during a tick."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any

import numpy as np

from rpo_core.files.validation import Checked, choice, real, vector3
from rpo_core.kernels.arithmetic import Vector, sin_cos
from rpo_core.kernels.arrays import Floats
from rpo_core.kernels.jit import step_kernel
from rpo_core.kernels.records import prepared
from rpo_core.stage import KernelStage
from rpo_core.wire import interfaces

AXES = ('x', 'y', 'z')

MAX_FORCE_N = 1e6
"""Largest force a file may name; beyond it a number is a typing error."""


@dataclass(frozen=True)
class Harmonic(Checked):
    """One term: amplitude_n * function(angular_rate_rad_s * t + phase_rad) on one axis."""

    axis: Annotated[str, partial(choice, known=AXES)]
    function: Annotated[str, partial(choice, known=('sin', 'cos'))]
    amplitude_n: Annotated[float, partial(real, unit='N', least=-MAX_FORCE_N, most=MAX_FORCE_N)]
    angular_rate_rad_s: Annotated[float, partial(real, unit='rad/s', least=-10.0, most=10.0)]
    phase_rad: Annotated[float, partial(real, unit='rad', least=-100.0, most=100.0)] = 0.0


@dataclass(frozen=True)
class Disturbance(Checked):
    """Force on the chaser from outside, in target LVLH axes [N]."""

    constant_n: Annotated[Vector, partial(vector3, unit='N', bound=MAX_FORCE_N)] = (0.0, 0.0, 0.0)
    harmonics: tuple[Harmonic, ...] = ()

    @property
    def is_zero(self) -> bool:
        """Whether nothing acts at any time."""
        return not any(self.constant_n) and not any(h.amplitude_n for h in self.harmonics)

    def varied(
        self, amplitude_share: float, *, phase_rad: float = 0.0, frequency_share: float = 0.0
    ) -> Disturbance:
        """Return it (1 + share) as strong, shifted in phase, (1 + frequency share) as fast."""
        x, y, z = (c * (1.0 + amplitude_share) for c in self.constant_n)
        return Disturbance(
            (x, y, z),
            tuple(
                Harmonic(
                    h.axis,
                    h.function,
                    h.amplitude_n * (1.0 + amplitude_share),
                    h.angular_rate_rad_s * (1.0 + frequency_share),
                    h.phase_rad + phase_rad,
                )
                for h in self.harmonics
            ),
        )

    def over(self, ticks: Sequence[int], dt_ns: int) -> Floats:
        """Return the forces (len(ticks), 3) [N, target LVLH] at ticks of a length [ns]."""
        return DisturbanceStage(self, dt_ns).steps(np.array(ticks, np.int64))[0]


NONE = Disturbance()


@dataclass(slots=True)
class Wave:
    """A harmonic as `disturb` reads it; is_sine : 1 for a sine, 0 for a cosine."""

    axis: int
    is_sine: int
    amplitude_n: float
    rate_rad_s: float
    phase_rad: float


@dataclass(slots=True)
class Push:
    """Settings of the kernel `disturb`."""

    dt_ns: int
    constant_n: Vector
    waves: list[Wave]


AHEAD = 64
"""Ticks of a block whose disturbance is computed together."""


@dataclass(slots=True)
class PushAhead:
    """Forces [N] of the ticks of a block: they depend on the tick alone, and together are SIMD.

    block : its number; -1 before the first
    """

    block: int
    force: Annotated[list[list[float]], AHEAD, 3]


NO_PUSH = prepared(PushAhead(-1, [[0.0] * 3 for _ in range(AHEAD)]))
"""Before tick 0."""


@step_kernel
def disturb(tick: int, u: Any, p: Any, m: Any, y: Any) -> None:
    """D = c + sum of a_h sin or cos(w_h t + phi_h) at the time of a tick, y (3,) [N]."""
    block = tick // AHEAD
    if m.block != block:
        m.block = block
        for i in range(3):
            for j in range(AHEAD):
                m.force[j][i] = p.constant_n[i]
        for h in range(len(p.waves)):
            wave = p.waves[h]
            amplitude, rate, phase = wave.amplitude_n, wave.rate_rad_s, wave.phase_rad
            axis, is_sine, dt_ns = wave.axis, wave.is_sine, p.dt_ns
            for j in range(AHEAD):
                time_s = (block * AHEAD + j) * dt_ns / 1_000_000_000
                sine, cosine = sin_cos(rate * time_s + phase)
                m.force[j][axis] += amplitude * (sine if is_sine else cosine)
    for i in range(3):
        y[i] = m.force[tick - block * AHEAD][i]


class DisturbanceStage(KernelStage):
    """The disturbance at the time of a tick."""

    name = 'disturbance'
    outputs = (interfaces.DISTURBANCE_FORCE,)
    kernel = disturb

    def __init__(self, disturbance: Disturbance, dt_ns: int) -> None:
        waves = [
            Wave(
                AXES.index(h.axis),
                int(h.function == 'sin'),
                h.amplitude_n,
                h.angular_rate_rad_s,
                h.phase_rad,
            )
            for h in disturbance.harmonics
        ]
        super().__init__(Push(dt_ns, disturbance.constant_n, waves), NO_PUSH)


def paper(reading: str, mean_motion_rad_s: float) -> Disturbance:
    """Return 1e-2 x [-1.1 cos(pi n t), -2.2 sin(pi n t) + pi/3, 1.4 cos(pi n t)] N, AAS 23-199.

    reading : 'offset', +pi/3 added as printed, or 'phase', -2.2 sin(pi n t + pi/3)
    """
    choice('reading', reading, ('offset', 'phase'))
    rate = math.pi * mean_motion_rad_s
    third = math.pi / 3
    offset, phase = (1e-2 * third, 0.0) if reading == 'offset' else (0.0, third)
    return Disturbance(
        (0.0, offset, 0.0),
        (
            Harmonic('x', 'cos', -1.1e-2, rate),
            Harmonic('y', 'sin', -2.2e-2, rate, phase),
            Harmonic('z', 'cos', 1.4e-2, rate),
        ),
    )
