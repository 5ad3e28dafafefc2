# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The damping sign: the force of a velocity opposes it.

The energy H = m v^2 / 2 + integral of |F(s, 0)| ds falls along a flight where
v (F(e, v) - F(e, 0)) <= 0. This is checked on a grid of normalised errors. The velocity error is
-v over its scale, so that the force must not be less for a larger velocity error.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rpo_core.fuzzy import DEFAULT_SAMPLES
from rpo_montecarlo.engine.lanes import infer_many, make_scratch
from rpo_montecarlo.engine.population import Population

Floats = NDArray[np.float64]

POSITIONS, VELOCITIES = 41, 20
"""Of the grid: position errors from -1 to 1, velocity errors from 0.05 to 1."""


def driving(population: Population, samples: int = DEFAULT_SAMPLES) -> Floats:
    """Return the mean (n,) over the grid of the force that drives, as a share of full output.

    Negative velocity errors need no grid of their own where the rules are odd; other rules are
    checked with their mirror.
    """
    positions = np.linspace(-1.0, 1.0, POSITIONS)
    velocities = np.linspace(0.0, 1.0, VELOCITIES + 1)
    grid = np.stack(np.meshgrid(positions, velocities, indexing='ij')).reshape(2, -1)
    scratch, found = make_scratch(), np.empty((len(population.scales), 2))
    for index in range(len(population.scales)):
        law = population.law(index, samples)
        for side, sign in enumerate((1.0, -1.0)):
            outputs = np.empty(grid.shape[1])
            infer_many(sign * grid, law, scratch, outputs)
            table = sign * outputs.reshape(POSITIONS, -1)
            found[index, side] = np.maximum(table[:, :1] - table[:, 1:], 0.0).mean()
    return found.max(axis=1)
