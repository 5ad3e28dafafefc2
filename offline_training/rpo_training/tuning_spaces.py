# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""From a few numbers to a baseline: what is tuned of each kind, within which range."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_discrete_are

from rpo_ctrl.baselines import Baseline, Lqr, Model, Mpc, Pd, PotentialField

Floats = NDArray[np.float64]

_DIGITS = 4  # a person reads the file

PLANAR, VERTICAL = [0, 1, 3, 4], [2, 5]
"""States of the two decoupled parts of the relative motion."""


class Parameter(NamedTuple):
    """A tuned number and its range, searched on a logarithmic scale.

    metres, seconds, newtons : powers of its unit; a weight is in the units of the cost, N^2
    """

    name: str
    least: float
    most: float
    metres: int = 0
    seconds: int = 0
    newtons: int = 0


class TuningSpace(NamedTuple):
    """What is tuned of a kind, and how a baseline is made of it."""

    parameters: tuple[Parameter, ...]
    make: Callable[[Mapping[str, float], Model], Baseline]
    description: str

    def scaled(self, units: tuple[float, float, float]) -> TuningSpace:
        """Return the space with its ranges in other units of length, time and force."""
        metre, second, newton = units
        scaled = []
        for p in self.parameters:
            unit = metre**p.metres * second**p.seconds * newton**p.newtons
            scaled.append(p._replace(least=p.least * unit, most=p.most * unit))
        return self._replace(parameters=tuple(scaled))

    def values(self, genes: Floats) -> dict[str, float]:
        """Return the numbers of a chromosome (parameters,) in [0, 1]."""
        return {
            p.name: float(f'{p.least * (p.most / p.least) ** gene:.{_DIGITS}g}')
            for p, gene in zip(self.parameters, genes.tolist(), strict=True)
        }


def lqr_gains(model: Model, position_weight: float, velocity_weight: float) -> Floats:
    """Return K (3, 6) of the discrete linear quadratic regulator, f = -K x, R = 1 N^2.

    K = (R + B' P B)^-1 B' P A with P from the discrete algebraic Riccati equation (SciPy), solved
    for the planar and the vertical motion by themselves, so that they stay decoupled exactly.
    """
    a, b = model.matrices()
    gains = np.zeros((3, 6))
    for states, axes in ((PLANAR, [0, 1]), (VERTICAL, [2])):
        part_a, part_b = a[np.ix_(states, states)], b[np.ix_(states, axes)]
        half = len(states) // 2
        weights = np.diag([position_weight] * half + [velocity_weight] * half)
        r = np.eye(len(axes))
        p = solve_discrete_are(part_a, part_b, weights, r)
        gains[np.ix_(axes, states)] = np.linalg.solve(
            r + part_b.T @ p @ part_b, part_b.T @ p @ part_a
        )
    return gains


def _lqr(values: Mapping[str, float], model: Model) -> Lqr:
    gains = lqr_gains(model, values['position_weight'], values['velocity_weight'])
    return Lqr(name='lqr', model=model, gains=gains, **values)  # type: ignore[arg-type]


TUNING_SPACES: Mapping[str, TuningSpace] = {
    Pd.kind: TuningSpace(
        (
            Parameter('position_gain_n_m', 1e-4, 1.0, -1, 0, 1),
            Parameter('velocity_gain_n_s_m', 1e-2, 20.0, -1, 1, 1),
        ),
        lambda values, _model: Pd(name='pd', **values),  # type: ignore[arg-type]
        'Saturated proportional-derivative law, axis by axis.',
    ),
    Lqr.kind: TuningSpace(
        (
            Parameter('position_weight', 1e-9, 1e-2, -2, 0, 2),
            Parameter('velocity_weight', 1e-7, 10.0, -2, 2, 2),
        ),
        _lqr,
        'Infinite-horizon linear quadratic regulator of the discrete relative dynamics.',
    ),
    Mpc.kind: TuningSpace(
        (
            Parameter('horizon_s', 100.0, 200.0, 0, 1),
            Parameter('least_time_to_go_s', 2.0, 60.0, 0, 1),
        ),
        lambda values, model: Mpc(name='mpc', model=model, **values),  # type: ignore[arg-type]
        'Shrinking-horizon least-energy transfer to rest, planned anew at every tick.',
    ),
    PotentialField.kind: TuningSpace(
        (
            Parameter('approach_speed_m_s', 0.1, 10.0, 1, -1),
            Parameter('rounding_radius_m', 0.1, 500.0, 1),
            Parameter('switching_gain_n', 1e-3, 1.0, 0, 0, 1),
            Parameter('boundary_layer_m_s', 1e-3, 10.0, 1, -1),
        ),
        lambda values, model: PotentialField(
            name='apf_smc',
            model=model,
            **values,  # type: ignore[arg-type]
        ),
        'Artificial potential field tracked by sliding mode with a boundary layer.',
    ),
}
"""Kind -> tuning space; drift has nothing to tune."""
