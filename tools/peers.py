# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Rendezvous benchmarks of others, flown by the stack and by the controllers that they have.

`rpo safety peers` runs it. The control laws of others are restated from their publications, as
formulas and numbers.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from rpo_cli.display import print_table
from rpo_core.chain.flight import Flight, fly
from rpo_core.chain.stage import ZERO, Signal, Stage
from rpo_core.control.controller import AnyController, load_controller, only_fuzzy
from rpo_core.control.controller_file import ControllerStage
from rpo_core.files.scenario import Scenario, load_scenario
from rpo_core.files.validation import choice
from rpo_guidance.plan import Guidance
from rpo_safety.passive import clear_for, drifted

ABORTS_S = np.arange(7200.0, 9001.0, 30.0)
"""Moments at which ARCH-COMP lets the thrusters fail: 120 to 150 minutes."""

CONE_M, CONE_DEG, CONE_M_S, BOX_M = 100.0, 30.0, 3.3 / 60.0, 0.1
"""ARCH-COMP: the last 100 m in a cone of 30 degrees at 3.3 m/min; half of the target's edge."""

HORIZON_MIN = 300.0
"""ARCH-COMP: a flight and its drift last so long."""

STARTS_M, STARTS_HALF_M = (-900.0, -400.0), 25.0
"""ARCH-COMP: middle of the square of starts, at rest, and half of its edge."""

ABORT_MIN: dict[str, tuple[float, float] | None] = {
    'SRNA01': None,
    'SRA01': (120.0, 120.0),
    'SRA02': (120.0, 125.0),
    'SRA03': (120.0, 145.0),
    'SRA04': (240.0, 240.0),
    'SRA05': (235.0, 240.0),
    'SRA06': (230.0, 240.0),
    'SRA07': (50.0, 150.0),
    'SRA08': (0.0, 240.0),
    'SRU01': (260.0, 260.0),
    'SRU02': (0.0, 260.0),
}
"""ARCH-COMP's instances: when the thrusters may fail. U: not safe."""

BOXES_M = (BOX_M, 0.2)
"""Half of the target's edge: as ARCH-COMP's text and CORA have it; as JuliaReach and Hylaa do."""

CAPTURE_M, CAPTURE_M_S = 5.0, 0.05
"""V-BAR: at the hold point."""

Gains = tuple[tuple[float, ...], ...]

K_FAR: Gains = (
    (-28.8287, 0.1005, -1449.9754, 0.0046),
    (-0.087, -33.2562, 0.00462, -1451.5013),
)
K_NEAR: Gains = (
    (-288.0288, 0.1312, -9614.9898, 0.0),
    (-0.1312, -288.0, 0.0, -9614.9883),
)
"""Gains of ARCH-COMP for (x, y, vx, vy) in m and m/min, in kg m/min^2: far, and in the cone."""

_PD_RAD_S, _PD_HELD_S = 0.01, 10.0  # V-BAR's PD: natural frequency, damping 1; a step of it
_VBAR_S = 3600.0  # length of its flights


class _LawStage(ControllerStage):
    """A law in the chain: force (3,) [N] from the state (6,), held for some ticks."""

    memory_ticks = None

    def __init__(self, law: Callable[[Any], Any], held: int) -> None:
        self._law, self._held = law, held
        self._force: Signal = ZERO

    def step(self, tick: int, *inputs: Any) -> tuple[Signal, ...]:
        """Return the commanded force (3,) [N]."""
        if tick % self._held == 0:
            self._force = tuple(float(f) for f in self._law(np.array(inputs[0])))
        return (self._force,)


@dataclass(frozen=True)
class Peer:
    """A controller of others: a law of the state, held for so long."""

    name: str
    law: Callable[[Any], Any]
    held_s: float = 0.0
    provenance: Mapping[str, Any] = field(default_factory=dict)

    def stage(self, dt_s: float) -> Stage:
        """Return the controller as a stage of the chain."""
        return _LawStage(self.law, max(1, round(self.held_s / dt_s)))


def arch_lqr() -> Peer:
    """Return the switched linear quadratic regulator of ARCH-COMP, in m, s and N."""

    def law(state: Any) -> Any:
        gains = np.array(K_NEAR if state[0] >= -CONE_M else K_FAR)
        plane = np.array([state[0], state[1], 60.0 * state[3], 60.0 * state[4]])
        return (*(gains @ plane / 3600.0), 0.0)

    return Peer('LQR of ARCH-COMP', law)


def vbar_pd(scenario: Scenario) -> Peer:
    """Return the PD law of V-BAR about its hold point, with relative gravity taken out."""
    n, hold = scenario.mean_motion_rad_s, np.array(scenario.goal_state[:3])

    def law(s: Any) -> Any:
        gravity = np.array([3 * n * n * s[0] + 2 * n * s[4], -2 * n * s[3], -n * n * s[2]])
        a = -gravity - _PD_RAD_S**2 * (s[:3] - hold) - 2.0 * _PD_RAD_S * s[3:]
        return np.clip(scenario.mass_kg * a, -scenario.max_force_n, scenario.max_force_n)

    return Peer('PD of V-BAR', law, _PD_HELD_S)


def alone(scenario: Scenario) -> Scenario:
    """Return a scenario without guidance, assurance and goal: others fly to theirs."""
    return replace(scenario, sections=(), goal_position_m=(0.0, 0.0, 0.0))


def fitted(controller: AnyController, scenario: Scenario) -> AnyController:
    """Return a fuzzy controller of the paper's chaser with the force of another."""
    return replace(only_fuzzy(controller), force_scale_n=float(scenario.max_force_n))


class Rendezvous(NamedTuple):
    """A flight of ARCH-COMP's rendezvous.

    cone_deg : largest angle off the axis of the cone in the last 100 m, down to the target's box
    speed_m_s : largest speed there
    clear : of the aborts, those whose drift certainly misses the target; nearest_m : least
        distance of a drift to its centre
    end_m : distance to the target's centre at the end; delta_v_m_s : sum of |f| dt / m
    """

    cone_deg: float
    speed_m_s: float
    clear: int
    nearest_m: float
    end_m: float
    delta_v_m_s: float


def rendezvous(flight: Flight, until_s: float = 60.0 * HORIZON_MIN) -> Rendezvous:
    """Judge a flight by the constraints of ARCH-COMP; drifts last until 300 minutes."""
    states, dt = flight.states, flight.scenario.dt_s
    inside = (states[:, 0] >= -CONE_M) & (np.abs(states[:, :2]).max(axis=1) > BOX_M)
    seen = states[inside] if inside.any() else states[-1:]
    off = np.degrees(np.arctan2(np.hypot(seen[:, 1], seen[:, 2]), -seen[:, 0]))
    n, clear, nearest = flight.scenario.mean_motion_rad_s, 0, math.inf
    for at in ABORTS_S:
        state = tuple(states[round(at / dt)].tolist())
        left = until_s - at
        clear += clear_for(state, math.sqrt(2.0) * BOX_M, left, n, 0.0, 0.0) >= left
        path = (drifted(state, t, n, 0.0) for t in np.arange(0.0, left, 5.0))
        nearest = min(nearest, *(math.hypot(*r) for r in path))
    return Rendezvous(
        float(off.max()),
        float(np.linalg.norm(seen[:, 3:], axis=1).max()),
        int(clear),
        nearest,
        float(np.linalg.norm(states[-1, :3])),
        delta_v(flight),
    )


class Approach(NamedTuple):
    """A flight of V-BAR's approach: captured when, nearest to the target, sum of |f| dt / m."""

    captured_s: float
    nearest_m: float
    delta_v_m_s: float


def approach(flight: Flight, hold_m: Any) -> Approach:
    """Judge a flight by V-BAR's capture; delta-v counts until then."""
    states, dt = flight.states, flight.scenario.dt_s
    off = np.linalg.norm(states[:, :3] - np.array(hold_m), axis=1)
    there = (off <= CAPTURE_M) & (np.linalg.norm(states[:, 3:], axis=1) <= CAPTURE_M_S)
    last = int(np.flatnonzero(there)[0]) if there.any() else len(states) - 1
    ranges = np.linalg.norm(states[: last + 1, :3], axis=1)
    return Approach(
        dt * last if there.any() else math.inf, float(ranges.min()), delta_v(flight, last)
    )


def delta_v(flight: Flight, ticks: int | None = None) -> float:
    """Return the sum of |f| dt / m [m/s] of the thrust of some ticks."""
    forces = flight.thrust.forces_n[:ticks]
    return float(np.linalg.norm(forces, axis=1).sum() * flight.scenario.dt_s) / (
        flight.scenario.mass_kg
    )


def arch_starts(scenario: Scenario, count: int, seed: int) -> list[Scenario]:
    """Return flights from the set of starts: its corners, and drawn ones."""
    low, high = (tuple(m + s * STARTS_HALF_M for m in STARTS_M) for s in (-1.0, 1.0))
    corners = [(x, y) for x in (low[0], high[0]) for y in (low[1], high[1])]
    drawn = np.random.default_rng(seed).uniform(low, high, (count, 2)).tolist()
    return [replace(scenario, initial_position_m=(x, y, 0.0)) for x, y in [*corners, *drawn]]


def vbar_starts(scenario: Scenario, count: int, seed: int) -> list[Scenario]:
    """Return flights from V-BAR's default starts: ahead of the target, the zone in the way."""
    low = [-200, 200, -50, -0.1, -0.1, -0.1]
    drawn = np.random.default_rng(seed).uniform(low, [200, 600, 50, 0.1, 0.1, 0.1], (count, 6))
    return [
        replace(scenario, initial_position_m=tuple(s[:3]), initial_velocity_m_s=tuple(s[3:]))
        for s in drawn.tolist()
    ]


class Row(NamedTuple):
    """A line of the table: a controller, its figures as text, and whether all is met."""

    cells: tuple[str, ...]
    met: bool


OURS = 'guidance'
"""How the rows of our stack begin."""

ARCH, VBAR = 'arch_rendezvous', 'vbar_approach'

HEADINGS = {
    ARCH: ('flown by', 'flights', 'cone', 'speed, m/min', 'aborts clear', 'nearest', 'at the end',
           'delta-v, m/s'),
    VBAR: ('flown by', 'flights', 'captured', 'after, s', 'nearest', 'in the zone',
           'delta-v, m/s'),
}  # fmt: skip


def arch_rows(scenario: Scenario, ours: AnyController, count: int, seed: int) -> list[Row]:
    """Return what our stack and the regulator of ARCH-COMP do, over its set of starts."""
    starts, rows = arch_starts(scenario, count, seed), []
    for name, flights in (
        (f'{OURS}, {ours.name}', (fly(s, fitted(ours, s)) for s in starts)),
        (arch_lqr().name, (fly(alone(s), arch_lqr()) for s in starts)),
    ):
        worst = [rendezvous(flight) for flight in flights]
        cone, speed = max(w.cone_deg for w in worst), max(w.speed_m_s for w in worst)
        clear, aborts = sum(w.clear for w in worst), len(worst) * len(ABORTS_S)
        cells = (
            name,
            str(len(worst)),
            f'{cone:.2f} of {CONE_DEG:g} deg',
            f'{60.0 * speed:.3f} of {60.0 * CONE_M_S:.1f}',
            f'{clear} of {aborts}',
            f'{min(w.nearest_m for w in worst):.2f} m',
            f'{max(w.end_m for w in worst):.2f} m',
            f'{np.mean([w.delta_v_m_s for w in worst]):.3f}',
        )
        rows.append(Row(cells, cone <= CONE_DEG and speed <= CONE_M_S and clear == aborts))
    return rows


def vbar_rows(scenario: Scenario, ours: AnyController, count: int, seed: int) -> list[Row]:
    """Return what our stack and the PD of V-BAR do: from behind, and from starts ahead."""
    guidance, pd, rows = scenario.section(Guidance), vbar_pd(scenario), []
    zone = guidance.keep_out_m if guidance is not None else 0.0
    for where, starts in (
        ('behind', [scenario]),
        ('ahead', vbar_starts(scenario, count, seed)),
    ):
        for name, flights in (
            (f'{OURS}, {ours.name}, assurance', (fly(s, fitted(ours, s)) for s in starts)),
            (pd.name, (fly(replace(alone(s), duration_s=_VBAR_S), pd) for s in starts)),
        ):
            done = [approach(flight, scenario.goal_position_m) for flight in flights]
            captured = [a.captured_s for a in done if math.isfinite(a.captured_s)]
            inside = sum(a.nearest_m < zone for a in done)
            cells = (
                f'{name}, from {where}',
                str(len(done)),
                str(len(captured)),
                f'{np.mean(captured):.0f}' if captured else '-',
                f'{min(a.nearest_m for a in done):.1f} m',
                str(inside),
                f'{np.mean([a.delta_v_m_s for a in done]):.2f}',
            )
            rows.append(Row(cells, len(captured) == len(done) and not inside))
    return rows


ROWS = {ARCH: arch_rows, VBAR: vbar_rows}
"""Name of a scenario -> what makes its table."""


def compare(files: Sequence[str], controller: str, starts: int, seed: int) -> bool:
    """Fly and print benchmarks; return whether our stack breaks a constraint."""
    ours, broken = load_controller(controller), False
    for file in files:
        scenario = load_scenario(file)
        known = choice('scenario', scenario.name, ROWS)
        rows = ROWS[known](scenario, ours, starts, seed)
        cells = [(*row.cells, 'met' if row.met else 'broken') for row in rows]
        print_table((*HEADINGS[known], 'constraints'), cells, scenario.name)
        broken |= any(not row.met for row in rows if row.cells[0].startswith(OURS))
    return broken
