# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Hostile commands in the runs of a campaign: all its stages fly, those of attitude too.

From a moment that is drawn on, a run's force is not its controller's. Where `attitude_control` has
limits, neither is the torque of every other forty runs, from the beginning on. What the campaign
disperses stays: estimates, attitudes, thrusters. Beside the zone it looks at the contract between
attitude and translation (docs/safety.md, lemma 6): the angle by which a force was turned wrongly.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rpo.analysis import attack
from rpo.analysis.attack import LATE, NOT_FINITE, wanted
from rpo.engine.lanes import (
    BODY_R,
    BODY_V,
    FORCE,
    KNOWN_R,
    KNOWN_V,
    QUAT,
    QUAT_W,
    RATE,
    RUNS,
    SEEN_QUAT,
    SEEN_QUAT_W,
    SEEN_RATE,
    R,
    V,
    compiled,
    make_scratch,
)
from rpo.engine.parts.attitude import attitude_in, vector_in
from rpo.engine.parts.attitude_control import FUZZY, SHARED
from rpo.engine.parts.control import control_of
from rpo.engine.simulator import fly_pairs
from rpo.engine.support import why_not
from rpo.engine.tick import COMMANDED, MOVED, Part, table_of
from rpo.montecarlo.config import Campaign
from rpo.montecarlo.quantities import Dispersion
from rpo.montecarlo.run_batch import UNIT, case_of
from rpo.montecarlo.sampling import draw
from rpo_core.assurance.assumed import LARGEST_NORMAL, SQRT_3, errors_of
from rpo_core.attitude.chaser import times
from rpo_core.control.attitude_law_kernels import attitude_ahead
from rpo_core.files.validation import InputError
from rpo_core.kernels.arithmetic import norm
from rpo_core.kernels.arrays import Floats
from rpo_core.scenario.scenario import Scenario
from rpo_core.stage import Place, section_of

HOSTILE_KINDS = (-1, *(i for i in range(len(attack.KINDS)) if i != LATE))
KINDS = ('its own', *(attack.KINDS[i] for i in HOSTILE_KINDS[1:]))

BIASED = 0.9
"""Share of an assumed error that is a bias; the rest is noise."""

GAIN_NM = 10.0
"""Of hostile torques, for a radian or a radian a second: their signs are drawn."""

LIMIT, SINCE, HOSTILE, WORDS = 0, 1, 1 + RUNS, 1 + 2 * RUNS
"""Places in the table of commands: force limit [N]; tick from which on each run has hostile ones;
kind of each, -1 for none; two random words of each. The memory has the commands before (3, 40)."""

DT, ORBIT, SEEN, ROWS, ZONE, AXIS, SIDE, PORT, WIDTH, SLOPE = 0, 1, 2, 5, *range(7, 13)
DELAY = 13
"""Places in the table of what is watched: tick [s]; mean motion [rad/s]; rows of the attitude that
turns the force; rows of position and velocity that are judged; zone and corridor as assurance has
them; delay of each run [ticks]."""

CLOSING, LATERAL, BEFORE, SINE, USED = (RUNS * i for i in range(1, 6))
"""Places in its memory, after the depth (40,): speeds at contact, infinite before it; distance of
the port a tick before; largest sine of half the angle; then, of each of the last ticks, the
quaternions that turned a force (4, 40)."""


@compiled
def command(w, m, t, tick):  # type: ignore[no-untyped-def]
    """Replace row FORCE by a hostile command, after COMMANDED."""
    limit = t[LIMIT]
    for s in range(RUNS):
        since, behaviour = tick - int(t[SINCE + s]), int(t[HOSTILE + s])
        if behaviour < 0 or since < 0:
            continue
        state = (*vector_in(w, KNOWN_R, s), *vector_in(w, KNOWN_V, s))
        a, b = int(t[WORDS + s]), int(t[WORDS + RUNS + s])
        x, y, z = wanted(behaviour, since, a, b, state, vector_in(m, 0, s), limit)
        w[FORCE + s], w[FORCE + RUNS + s], w[FORCE + 2 * RUNS + s] = x, y, z
        if behaviour == NOT_FINITE:
            x, y, z = 0.5 * limit, -limit, limit
        m[s], m[RUNS + s], m[2 * RUNS + s] = x, y, z


@compiled
def watch(w, m, t, tick):  # type: ignore[no-untyped-def]
    """Keep how deep in the zone a run comes outside its corridor, and how fast to the port."""
    zone, axis, side = t[ZONE], int(t[AXIS]), t[SIDE]
    for s in range(RUNS):
        if m[CLOSING + s] < np.inf:
            continue
        r, v = vector_in(w, int(t[ROWS]), s), vector_in(w, int(t[ROWS + 1]), s)
        inside = zone - norm(r[0], r[1], r[2])
        d = side * r[axis] - t[PORT]
        off = max(abs(r[(axis + 1) % 3]), abs(r[(axis + 2) % 3]))
        within = t[WIDTH] + t[SLOPE] * (d if d > 0.0 else 0.0) - off if side != 0.0 else -np.inf
        if within >= 0.0 and d <= 0.0 < m[BEFORE + s]:
            m[CLOSING + s] = -side * v[axis]
            m[LATERAL + s] = max(abs(v[(axis + 1) % 3]), abs(v[(axis + 2) % 3]))
            continue
        m[BEFORE + s] = d
        inside = min(inside, -within) if d > 0.0 else inside
        m[s] = max(m[s], inside)


@compiled
def turned_with(w, m, t, tick):  # type: ignore[no-untyped-def]
    """Keep the quaternions that turn the force of this tick, after STEERING."""
    slots = (len(m) - USED) // (4 * RUNS)
    for s in range(RUNS):
        seen = attitude_in(w, int(t[SEEN]), int(t[SEEN + 1]), int(t[SEEN + 2]), s)
        q = attitude_ahead(seen, t[ORBIT], (t[DELAY + s] + 0.5) * t[DT])
        for j in range(4):
            m[USED + RUNS * (4 * (tick % slots) + j) + s] = q[j]


@compiled
def turned_wrongly(w, m, t, tick):  # type: ignore[no-untyped-def]
    """Compare them with the true attitude, before and after the tick in which the force acts."""
    slots = (len(m) - USED) // (4 * RUNS)
    for s in range(RUNS):
        of = tick - int(t[DELAY + s])
        if of < 0 or m[CLOSING + s] < np.inf:
            continue
        i = USED + RUNS * 4 * (of % slots) + s
        q = (-m[i], -m[i + RUNS], -m[i + 2 * RUNS], m[i + 3 * RUNS])
        a = attitude_in(w, QUAT, QUAT_W, RATE, s)
        x, y, z, _ = times(q, (a[0], a[1], a[2], a[3]))
        sine = np.sqrt(x * x + y * y + z * z)
        m[SINE + s] = sine if sine > m[SINE + s] else m[SINE + s]


def _commands(campaign: Campaign, first: int) -> Part:
    """Return the commands of up to 40 runs, `first` being the number of the first one."""
    random = np.random.default_rng([campaign.config.seed, first])
    ticks = campaign.scenario.ticks
    since, words = random.integers(0, ticks, RUNS), random.integers(0, 2**32, (2, RUNS))
    kinds = np.array([HOSTILE_KINDS[(first + i) % len(KINDS)] for i in range(RUNS)])
    table = table_of(campaign.scenario.max_force_n, since, kinds, words)
    return Part('commands', ((COMMANDED + 1, command),), table, np.zeros(3 * RUNS))


def _hostile(parts: Sequence[Part], seed: int, first: int) -> list[Part]:
    """Return parts of a batch whose attitude controller answers errors with any torque."""
    random, hostile = np.random.default_rng([seed, first, 1]), []
    for part in parts:
        if part.name == 'attitude_control':
            gains = random.choice((-GAIN_NM, GAIN_NM), 18)
            head = part.table[: SHARED + FUZZY]
            part = part._replace(table=table_of(head, 0.0, gains))
        hostile.append(part)
    return hostile


def _watched(scenario: Scenario, late: Floats) -> Part:
    """Return what looks for the zone, the corridor of assurance, contact, and how forces turn.

    late : (n,) more delay of each run [ticks]
    """
    thrusters, settings = scenario.thrusters, attack.settings_of(scenario)
    delays = np.zeros(RUNS)
    delays[: len(late)] = late + (thrusters.delay_ticks if thrusters else 0)
    estimated = scenario.named('attitude_estimator') is not None
    seen = (SEEN_QUAT, SEEN_QUAT_W, SEEN_RATE) if estimated else (QUAT, QUAT_W, RATE)
    way, rows = settings.corridor, (R, V) if scenario.target is None else (BODY_R, BODY_V)
    corridor: tuple[float, ...] = (0.0,) * 5
    if way is not None:
        side = 1.0 if way.along[0] == '+' else -1.0
        corridor = ('xyz'.index(way.along[1]), side, way.port_m, way.width_m, way.slope)
    numbers = scenario.dt_s, scenario.mean_motion_rad_s, seen, rows, settings.keep_out_m, corridor
    memory = np.zeros(USED + RUNS * 4 * (int(delays.max()) + 1))
    memory[CLOSING:BEFORE] = math.inf
    steps = (
        (Place.STEERING + 1, turned_with),
        (Place.ATTITUDE - 1, turned_wrongly),
        (MOVED, turned_wrongly),
        (MOVED, watch),
    )
    return Part('watched', steps, table_of(*numbers, delays), memory)


@dataclass(frozen=True)
class Flown:
    """Runs of one kind of commands.

    depth_m : (n,) deepest in the zone, outside the corridor, before contact; 0.0: never
    closing_m_s, lateral_m_s : (n,) at contact, the latter per axis; infinite without one
    turned_deg : (n,) largest angle by which a force was turned wrongly, before contact
    """

    kind: str
    depth_m: Floats
    closing_m_s: Floats
    lateral_m_s: Floats
    turned_deg: Floats


def bounded(campaign: Campaign) -> Campaign:
    """Return a campaign whose position is known as badly as assurance assumes, by no sensors."""
    scenario, config = campaign.scenario, campaign.config
    settings = attack.settings_of(scenario)
    errors = errors_of(settings, scenario)
    seeing = (Place.SENSOR, Place.ESTIMATOR)
    sections = tuple(s for s in scenario.sections if section_of(s).place not in seeing)
    kept = {n: d for n, d in config.dispersions.items() if not n.startswith('sensor_')}
    for name, unit, bound in (
        ('position', 'm', errors.position_m),
        ('velocity', 'm_s', errors.velocity_m_s),
    ):
        bias, noise = (BIASED * bound / SQRT_3,) * 3, ((1.0 - BIASED) * bound / LARGEST_NORMAL,)
        kept[f'navigation_{name}_bias_{unit}'] = Dispersion('uniform', bias)
        kept[f'navigation_{name}_noise_{unit}'] = Dispersion('white', noise)
    without_sensors = replace(scenario, sections=sections)
    return replace(campaign, config=replace(config, dispersions=kept), scenario=without_sensors)


def attack_campaign(
    campaign: Campaign, advance: Callable[[int], None] = lambda _: None
) -> list[Flown]:
    """Fly the runs of a campaign with each kind of command in turn; raises InputError.

    advance : gets how many runs are done
    """
    scenario, runs = campaign.scenario, campaign.config.runs
    attack.settings_of(scenario)
    steered: Any = scenario.named('attitude_control')
    reason = why_not(scenario, campaign.controller)
    if not reason and steered is None:
        reason = f'scenario {scenario.name} has no `attitude_control`'
    if reason:
        raise InputError(f'a campaign under attack must be flown by the engine; {reason}')
    figures, w = np.empty((4, runs)), make_scratch()
    control = control_of(campaign.controller)
    for first in range(0, runs, UNIT):
        drawn = draw(campaign, first, min(UNIT, runs - first))
        case, batches = case_of(campaign, drawn), []
        for at, batch in zip(range(0, UNIT, RUNS), case.batches, strict=False):
            late = drawn.column('delay_ticks')[at : at + RUNS]
            parts: Sequence[Part] = batch.parts
            if steered.limits is not None and (first + at) // RUNS % 2:
                parts = _hostile(parts, campaign.config.seed, first + at)
            more = _commands(campaign, first + at), _watched(scenario, late)
            batches.append(batch._replace(parts=(*parts, *more)))
        for pairs in fly_pairs(control, replace(case, batches=tuple(batches)), w):
            n, memory = len(pairs.rows), pairs.memories['watched']
            rows = memory[:USED].reshape(-1, RUNS)[:, :n]
            some = slice(first + pairs.some.start, first + pairs.some.stop)
            figures[:3, some], figures[3, some] = rows[:3], np.degrees(2.0 * np.arcsin(rows[4]))
        advance(min(first + UNIT, runs))
    kinds = np.arange(runs) % len(KINDS)
    return [Flown(name, *figures[:, kinds == i]) for i, name in enumerate(KINDS)]
