# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Corner flights: the paper's test with the extremes of its dispersions, for the term `robustness`.

A campaign draws thousands of runs; a search cannot. It flies the extremes of the dispersions that
change the late flight most: start, mass, strength and phase of the disturbance. The limits of the
paper, |position| <= 0.5 m and |velocity| <= 0.01 m/s over the last 200 s, apply to each flight; the
velocity is here the norm of the largest values of the axes, which is stricter.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import product

from rpo_core.files.scenario import Scenario, load_scenario
from rpo_core.judge.metrics import CLAIM_WINDOW_S
from rpo_montecarlo.engine.cases import Case, case_of_flights

POSITION_M, VELOCITY_M_S = 5.0, 0.04
"""The start is off by so much on every axis, and moves on in that direction."""

MASS_SHARES = (-0.09, 0.09)
AMPLITUDE_SHARE = 0.5
PHASES_RAD = tuple(quarter * math.pi / 2 for quarter in range(4))


def flights(mass_share: float) -> list[Scenario]:
    """Return the corner flights of a chaser with 1 + `mass_share` times the nominal mass."""
    nominal = load_scenario('paper_test')
    base = replace(nominal, mass_kg=nominal.mass_kg * (1.0 + mass_share))
    found = []
    for signs in product((-1.0, 1.0), repeat=3):
        x, y, z = (r + s * POSITION_M for r, s in zip(base.start[:3], signs, strict=True))
        vx, vy, vz = (v + s * VELOCITY_M_S for v, s in zip(base.start[3:], signs, strict=True))
        start = replace(base, initial_position_m=(x, y, z), initial_velocity_m_s=(vx, vy, vz))
        found += [
            replace(start, disturbance=base.disturbance.varied(AMPLITUDE_SHARE, phase_rad=phase))
            for phase in PHASES_RAD
        ]
    return found


def cases() -> list[Case]:
    """Return the corner flights, a case for each mass."""
    return [case_of_flights(flights(share), CLAIM_WINDOW_S) for share in MASS_SHARES]
