# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Control laws in lanes: fuzzy ones, and those of baselines, with the bits of their kernels."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from rpo.engine.lanes import (
    E_R,
    E_V,
    FORCE,
    OUTPUT,
    Law,
    V,
    infer_lanes,
    make_law,
)
from rpo_core.control.baselines import GAINS, Baseline, BaselineLaw, baseline_force, table_force
from rpo_core.kernels.arithmetic import saturate
from rpo_core.kernels.jit import inlined

FUZZY, AXES, COUPLED = range(3)
"""How a law commands: each axis by inference, or by a table of forces; or all three together."""


class Candidate(NamedTuple):
    """A controller of a search as the kernels read it.

    form : FUZZY, AXES or COUPLED; the other law is empty
    """

    form: int
    fuzzy: Law
    baseline: BaselineLaw


def _law_of(limit: float, *tables: Any) -> BaselineLaw:
    """Return a law with all of its tables as arrays, however its controller keeps them."""
    gains, field, distances, speeds, forces = (np.array(t, np.float64) for t in tables)
    law: Any = gains.reshape(-1, GAINS), field, limit, distances, speeds, forces
    return BaselineLaw(*law)


_NO_FUZZY = make_law(1, (), np.zeros(15), ())
_NO_BASELINE = _law_of(0.0, (), (), (), (), ())


def fuzzy_candidate(law: Law) -> Candidate:
    """Return a fuzzy controller for the lanes."""
    return Candidate(FUZZY, law, _NO_BASELINE)


def baseline_candidate(controller: Baseline) -> Candidate:
    """Return a baseline for the lanes."""
    law: Any = controller.law
    tables = law.gains, law.field, law.distances, law.speeds, law.forces
    form = AXES if controller.alike and len(law.forces) else COUPLED
    return Candidate(form, _NO_FUZZY, _law_of(float(law.limit), *tables))


@inlined
def command(w: Any, n: int, position: int, tick: int, c: Candidate) -> None:
    """Fill row FORCE [N] of n lanes, from row `position` and row V.

    Where axes are not coupled, as many lanes are computed as whole SIMD registers have; those
    beyond n are at the origin.
    """
    padded = (n + 7) // 8 * 8
    if c.form == FUZZY:
        _command_fuzzy(w, padded, position, c.fuzzy)
    elif c.form == AXES:
        _command_axes(w, n, position, c.baseline)
    else:
        _command_coupled(w, n // 3, position, tick, c.baseline)


@inlined
def _command_fuzzy(w, n, position, law):  # type: ignore[no-untyped-def]
    position_scale, velocity_scale, force_scale = law.scales[0], law.scales[1], law.scales[2]
    for s in range(n):
        w[E_R + s] = saturate(-w[position + s] / position_scale, 1.0)
        w[E_V + s] = saturate(-w[V + s] / velocity_scale, 1.0)
    infer_lanes(w, n, law)
    for s in range(n):
        w[FORCE + s] = force_scale * w[OUTPUT + s]


@inlined
def _command_axes(w, n, position, law):  # type: ignore[no-untyped-def]
    for s in range(n):
        force = table_force(w[position + s], w[V + s], law.distances, law.speeds, law.forces)
        w[FORCE + s] = saturate(force, law.limit)


@inlined
def _command_coupled(w, flights, position, tick, law):  # type: ignore[no-untyped-def]
    for x in range(flights):
        y, z = x + flights, x + 2 * flights
        r, v = position, V
        state = (w[r + x], w[r + y], w[r + z], w[v + x], w[v + y], w[v + z])
        w[FORCE + x], w[FORCE + y], w[FORCE + z] = baseline_force(state, tick, law)
