# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Random vehicles, orbits and sections `assurance`, at the borders of what may be kept."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from rpo_core.assurance.settings import FILTERS, SPEEDS, Assurance, Passage, Speed
from rpo_core.scenario.scenario import Scenario, load_scenario
from rpo_core.thrusters.thrusters import Thrusters
from rpo_core.world.disturbance import NONE

DIRECTIONS = ('+x', '-x', '+y', '-y', '+z', '-z')


def _between(random: np.random.Generator, least: float, most: float) -> float:
    """Return a number between two, evenly in its logarithm."""
    return float(math.exp(random.uniform(math.log(least), math.log(most))))


def _some(random: np.random.Generator, share: float, value: float) -> float:
    """Return a value in a share of the cases, else zero."""
    return value if random.uniform() < share else 0.0


def drawn(random: np.random.Generator) -> Scenario:
    """Return a scenario with a section `assurance`; raises InputError where it is refused."""
    mass_kg, push_m_s2 = _between(random, 1.0, 5000.0), _between(random, 1e-4, 0.2)
    zone_m = _between(random, 0.5, 200.0)
    domain_m = zone_m * _between(random, 1.1, 60.0)
    dt_s = round(_between(random, 0.02, 10.0), 3)
    ahead = random.normal(size=3)
    range_m = zone_m + random.uniform(0.02, 0.98) * (domain_m - zone_m)
    position_m = ahead / np.linalg.norm(ahead) * range_m
    limit_n = mass_kg * push_m_s2
    base = replace(
        load_scenario('paper_test'),
        orbit_radius_m=_between(random, 6.6e6, 4.3e7),
        mass_kg=mass_kg,
        max_force_n=limit_n,
        dt_s=dt_s,
        duration_s=100.0 * dt_s,
        initial_position_m=tuple(position_m.tolist()),
        initial_velocity_m_s=(0.0, 0.0, 0.0),
        disturbance=NONE,
    )
    delay = int(_some(random, 0.5, int(random.integers(1, 20))))
    settings = Assurance(
        filter=FILTERS[random.integers(len(FILTERS))],
        speed=_speed(random, push_m_s2, domain_m),
        keep_out_m=zone_m,
        domain_m=domain_m,
        corridor=_corridor(random, zone_m, domain_m),
        position_error_m=_some(random, 0.6, zone_m * _between(random, 1e-5, 0.2)),
        velocity_error_m_s=_some(random, 0.6, push_m_s2 * _between(random, 1e-2, 10.0)),
        disturbance_n=_some(random, 0.7, limit_n * _between(random, 1e-3, 0.5)),
        thrust_error=_some(random, 0.6, _between(random, 1e-3, 0.3)),
    )
    return base.equipped(Thrusters(delay_ticks=delay), settings)


def _speed(random: np.random.Generator, push_m_s2: float, domain_m: float) -> Any:
    """Return a preset, or a limit of one of the three kinds, up to what nobody can brake."""
    kind = random.integers(4)
    if kind == 0:
        return list(SPEEDS)[random.integers(len(SPEEDS))]
    first = math.sqrt(push_m_s2 * domain_m) * _between(random, 1e-3, 1.0)
    if kind == 1:
        return Speed(first)
    if kind == 2:
        return Speed(first, deceleration_m_s2=push_m_s2 * random.uniform(0.0, 0.9))
    return Speed(first, per_range_1_s=push_m_s2 / first * random.uniform(0.0, 0.9))


def _corridor(random: np.random.Generator, zone_m: float, domain_m: float) -> Passage | None:
    if random.uniform() < 0.6:
        return None
    return Passage(
        along=DIRECTIONS[random.integers(len(DIRECTIONS))],
        half_angle_deg=float(random.uniform(3.0, 45.0)),
        port_m=zone_m * float(random.uniform(0.0, 0.9)),
        outer_m=min(zone_m * float(random.uniform(1.01, 3.0)), domain_m),
        width_m=zone_m * _between(random, 1e-3, 0.3),
        closing_m_s=_between(random, 1e-3, 0.5),
        lateral_m_s=_between(random, 1e-3, 0.2),
    )
