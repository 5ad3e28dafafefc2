# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Controllers in lanes: fuzzy ones and those with a kernel law (`BaselineLaw`)."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from rpo.engine.lanes import (
    E_R,
    E_V,
    FORCE,
    OUTPUT,
    RUNS,
    SEEN_R,
    SEEN_V,
    STRIDE,
    Law,
    R,
    V,
    compiled,
    infer_lanes,
)
from rpo.engine.population import population_of
from rpo.engine.tick import Part, Runs, table_of
from rpo_core.control.baselines import GAINS, Baseline, BaselineLaw, baseline_force
from rpo_core.control.controller import Controller, FuzzyController
from rpo_core.control.lane_kernels import ROWS, axis_forces
from rpo_core.files.validation import InputError
from rpo_core.kernels.arithmetic import saturate
from rpo_core.kernels.arrays import Floats
from rpo_core.stage import Place

LANES, POSITION, VELOCITY, LAW = range(4)
"""Places in the table of a controller: number of lanes, the rows that it reads, its numbers."""


class Control(NamedTuple):
    """A controller as the engine flies it: a kernel, and the numbers of its law."""

    kernel: Any
    numbers: Floats

    def part(self, runs: Runs) -> Part:
        """Return the part that commands some runs."""
        rows = (SEEN_R, SEEN_V) if runs.is_seen else (R, V)
        table = table_of(runs.lanes, *rows, self.numbers)
        return Part('controller', ((Place.CONTROLLER, self.kernel),), table)


def is_known(controller: Controller) -> bool:
    """Return whether the engine has the kernel of a controller, and it no stage of its own."""
    kinds = [kind for kind in (FuzzyController, Baseline) if isinstance(controller, kind)]
    return bool(kinds) and type(controller).stage is kinds[0].stage


def control_of(controller: Controller, *, limited: bool = True) -> Control:
    """Return a controller for the engine; raises InputError if it does not know it.

    limited : whether a law saturates its force itself; if not, `gain_part` does
    """
    if isinstance(controller, FuzzyController):
        return fuzzy_control(population_of(controller).law(0, controller.system.samples))
    if not isinstance(controller, Baseline):
        raise InputError(f'the engine does not know controller {controller.name}')
    law = controller.law
    tables = [np.ravel(t) for t in (law.gains, law.field, law.distances, law.speeds, law.forces)]
    sizes = [len(table) for table in tables]
    limit_n = law.limit if limited else np.inf
    numbers = table_of(sizes, limit_n, *tables)
    return Control(command_axes if controller.alike else command_paired, numbers)


def fuzzy_control(law: Law) -> Control:
    """Return a fuzzy controller, which acts axis by axis."""
    return Control(command_fuzzy, table_of(*law))


@compiled
def amplify(w, m, t, tick):  # type: ignore[no-untyped-def]
    """Multiply row FORCE, and saturate it; t : number of lanes, factor, largest force [N]."""
    for s in range(int(t[0])):
        w[FORCE + s] = saturate(t[1] * w[FORCE + s], t[2])


def gain_part(lanes: int, gain: float, limit_n: float) -> Part:
    """Return the part that multiplies the command, and keeps the limit [N] of its law."""
    return Part('gain', ((Place.CONTROLLER + 1, amplify),), table_of(lanes, gain, limit_n))


@compiled
def command_fuzzy(w, m, t, tick):  # type: ignore[no-untyped-def]
    """Fill row FORCE [N] from the input of a fuzzy controller.

    The number of lanes is rounded up to a multiple of eight, whole SIMD registers; the added lanes
    are at the origin.
    """
    n, r, v, t = (int(t[LANES]) + 7) // 8 * 8, int(t[POSITION]), int(t[VELOCITY]), t[LAW:]
    k = (len(t) - 43) // 4
    law = Law(
        t[:3], t[3:18], t[18:43], t[43 : 43 + k], t[43 + k : 43 + 2 * k],
        t[43 + 2 * k : 43 + 3 * k], t[43 + 3 * k :],
    )  # fmt: skip
    position_scale, velocity_scale, force_scale = law.scales[0], law.scales[1], law.scales[2]
    for s in range(n):
        w[E_R + s] = saturate(-w[r + s] / position_scale, 1.0)
        w[E_V + s] = saturate(-w[v + s] / velocity_scale, 1.0)
    infer_lanes(w, n, law)
    for s in range(n):
        w[FORCE + s] = force_scale * w[OUTPUT + s]


@compiled
def _law(t):  # type: ignore[no-untyped-def]
    """Return the law of a table."""
    a = LAW + 6
    b = a + int(t[LAW])
    c = b + int(t[LAW + 1])
    d = c + int(t[LAW + 2])
    e = d + int(t[LAW + 3])
    gains = t[a:b].reshape((b - a) // GAINS, GAINS)
    return BaselineLaw(gains, t[b:c], t[LAW + 5], t[c:d], t[d:e], t[e:])


@compiled
def command_paired(w, m, t, tick):  # type: ignore[no-untyped-def]
    """Fill row FORCE [N] of paired runs by a law of three axes."""
    law, r, v = _law(t), int(t[POSITION]), int(t[VELOCITY])
    for s in range(RUNS):
        y, z = s + RUNS, s + 2 * RUNS
        seen = (w[r + s], w[r + y], w[r + z], w[v + s], w[v + y], w[v + z])
        w[FORCE + s], w[FORCE + y], w[FORCE + z] = baseline_force(seen, tick, law)


@compiled
def command_axes(w, m, t, tick):  # type: ignore[no-untyped-def]
    """Fill row FORCE [N] by a law that treats all axes alike, in whole SIMD registers."""
    r, v, n = int(t[POSITION]), int(t[VELOCITY]), (int(t[LANES]) + 7) // 8 * 8
    forces, work = w[FORCE : FORCE + n], w[: ROWS * STRIDE]
    axis_forces(w[r : r + n], w[v : v + n], forces, work, tick, _law(t))
