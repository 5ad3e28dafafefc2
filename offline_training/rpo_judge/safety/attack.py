# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Attacks on runtime assurance: many dispersed runs of one scenario under hostile commands.

What the world does is drawn within what the scenario's section `assurance` assumes. A wrong mass
and a wrong thrust are one: force exerted = matrix x command, |matrix - 1| as large as assumed.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rpo_core.files.scenario import Scenario
from rpo_core.files.validation import InputError
from rpo_core.world import cw
from rpo_judge.safety import hostile
from rpo_judge.safety.hostile import COLUMNS, KINDS, LONGEST_DELAY, PARTS, Bounds
from rpo_safety.guard import Proof, proof_of
from rpo_safety.settings import Assurance

REACH_M = 60.0
"""Starts are up to so far outside the zone."""

_CHUNK = 1000


@dataclass(frozen=True)
class Result:
    """What became of the runs of one kind of command.

    rows : (n, COLUMNS), see `rpo_judge.safety.hostile`
    """

    kind: str
    rows: NDArray[np.float64]

    def total(self, column: int) -> int:
        """Return the sum of a column that counts."""
        return int(self.rows[:, column].sum())

    def least(self, column: int) -> float:
        """Return the smallest value of a column; infinite if there was none."""
        found = float(self.rows[:, column].min()) if len(self.rows) else math.inf
        return found if found < 1e29 else math.inf


def settings_of(scenario: Scenario) -> Assurance:
    """Return the section `assurance`; raises InputError if there is none, or no zone in it."""
    settings = scenario.section(Assurance)
    if settings is None or settings.keep_out_m <= 0.0:
        raise InputError(
            f'scenario {scenario.name} must have a section `assurance` with `keep_out_m` to be '
            'attacked'
        )
    return settings


def attack(
    scenario: Scenario,
    runs: int,
    seed: int,
    ticks: int,
    advance: Callable[[int], None] = lambda _: None,
) -> list[Result]:
    """Fly runs under hostile commands, in turn of each kind; return what became of them.

    advance : gets how many runs are done
    """
    settings = settings_of(scenario)
    proof = proof_of(settings, scenario)
    world = _bounds(settings, scenario, proof)
    n, mass, dt = scenario.mean_motion_rad_s, scenario.mass_kg, scenario.dt_s
    step, fine = (np.array(cw.discretise(n, mass, t)) for t in (dt, dt / PARTS))
    kinds = np.arange(runs) % len(KINDS)
    rows = np.zeros((runs, COLUMNS))
    for first in range(0, runs, _CHUNK):
        part = slice(first, min(first + _CHUNK, runs))
        random = np.random.default_rng([seed, first])
        count = len(kinds[part])
        keys = random.integers(0, 2**32, (count, 2))
        off = random.uniform(-1.0, 1.0, (count, 9))
        off *= proof.errors.thrust / np.linalg.norm(off, axis=1, keepdims=True)
        matrices = np.eye(3).ravel() + off
        hostile.fly_many(
            keys, kinds[part], ticks, step, fine, proof.guard, world, matrices, rows[part]
        )
        advance(part.stop)
    return [Result(kind, rows[kinds == i]) for i, kind in enumerate(KINDS)]


def _bounds(settings: Assurance, scenario: Any, proof: Proof) -> Bounds:
    delay = scenario.thrusters.delay_ticks if scenario.thrusters else 0
    if delay > LONGEST_DELAY:
        raise InputError(f'`thrusters.delay_ticks` must be <= {LONGEST_DELAY}; got {delay}')
    wait = delay * scenario.dt_s
    way = settings.corridor
    pushed = 1.01 * proof.errors.disturbance_n / scenario.mass_kg
    return Bounds(
        *(proof.errors.position_m, proof.errors.velocity_m_s),
        push_n=proof.errors.disturbance_n,
        delay=delay,
        zone_m=settings.keep_out_m,
        domain_m=settings.domain_m,
        width_m=way.width_m if way else 0.0,
        contact_m_s=way.closing_m_s if way else 0.0,
        lateral_m_s=way.lateral_m_s if way else 0.0,
        floor_m_s=proof.floor_m_s,
        reach_m=min(REACH_M, 0.9 * (settings.domain_m - settings.keep_out_m)),
        drift_m=0.5 * pushed * wait * wait,
        drift_m_s=pushed * wait,
    )
