# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Flights side by side that follow a plan, under runtime assurance: kernels of those rooms.

A plan without holds and commands does not depend on the flight: its references come from a table.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from rpo_core.chain.stage import Place
from rpo_core.files.scenario import Scenario
from rpo_guidance.guidance import GuidanceStage
from rpo_guidance.plan import HOLD, Guidance
from rpo_guidance.transfer_kernels import at_port
from rpo_kernels.attitude_kernels import FRAME
from rpo_kernels.kernels import cw_step, unpacked
from rpo_montecarlo.engine.lanes import (
    FORCE,
    KNOWN_R,
    KNOWN_V,
    PAIRED_LANES,
    RUNS,
    SEEN_R,
    SEEN_V,
    compiled,
)
from rpo_montecarlo.engine.tick import ADDED, Batch, Draw, Kind, Part, register, table_of
from rpo_nav.estimator import Estimator
from rpo_safety.assurance import AssuranceStage
from rpo_safety.packed import assure_packed, assure_turning_packed
from rpo_safety.settings import Assurance

PAST, WIDTH, LAST = 0, 1, 2
REFERENCES = LAST + RUNS
"""Places in the table of a plan: distance behind the port at which a chaser has docked, 0.0: it
does not; numbers of a tick; tick from which on the last leg of each run is flown; of each tick,
state [m, m/s] and force [N] (9, 40). Where chasers dock, port [m] and axis (6, 40) follow in each
tick. The memory has who has docked."""

_DOCKING = 9 * RUNS

DELAYS, LONGEST, MODES = 0, RUNS, RUNS + 1
NUMBERS = MODES + RUNS
AXES = NUMBERS + 1
GUARDS = AXES + RUNS
"""Places in the table of assurance: ticks from a command to its force; the most of them, at least
one; modes at the start; how many numbers step and guards have; place of the axes of a target that
turns; step and guards of each run; then the axes (n, 15) of each motion. The memory has the numbers
of `assure_packed` of each run, then its line of forces that are on their way."""

_GUARD, _NUMBERS = 58, 13
AHEAD, COMMAND, PREVIOUS, MODE = 0, 6, 9, 12
"""Columns of `assure_packed`: state, command, last force, mode."""


@compiled
def know(w, m, t, tick):  # type: ignore[no-untyped-def]
    """Keep what navigation found in rows KNOWN."""
    for s in range(PAIRED_LANES):
        w[KNOWN_R + s], w[KNOWN_V + s] = w[SEEN_R + s], w[SEEN_V + s]


@compiled
def follow(w, m, t, tick):  # type: ignore[no-untyped-def]
    """Fill rows SEEN with the state relative to the reference.

    Of a chaser that has docked the reference is its own state.
    """
    row = t[REFERENCES + int(t[WIDTH]) * tick :]
    for s in range(RUNS):
        y, z = s + RUNS, s + 2 * RUNS
        if t[PAST] > 0.0 and tick >= t[LAST + s] and m[s] == 0.0:
            p = row[_DOCKING + s :]
            docked = at_port(
                w[SEEN_R + s], w[SEEN_R + y], w[SEEN_R + z],
                p[0], p[RUNS], p[2 * RUNS], p[3 * RUNS], p[4 * RUNS], p[5 * RUNS], t[PAST],
            )  # fmt: skip
            m[s] = 1.0 if docked else 0.0
        for axis in range(3):
            lane = axis * RUNS + s
            if m[s] > 0.0:
                w[SEEN_R + lane] -= w[SEEN_R + lane]
                w[SEEN_V + lane] -= w[SEEN_V + lane]
            else:
                w[SEEN_R + lane] -= row[lane]
                w[SEEN_V + lane] -= row[PAIRED_LANES + lane]


@compiled
def add_feed_forward(w, m, t, tick):  # type: ignore[no-untyped-def]
    """Add the force that a chaser on the reference needs to row FORCE."""
    row = t[REFERENCES + int(t[WIDTH]) * tick :]
    for s in range(RUNS):
        for axis in range(3):
            force = 0.0 if m[s] > 0.0 else row[2 * PAIRED_LANES + axis * RUNS + s]
            w[FORCE + axis * RUNS + s] += force


@compiled
def assure_all(w, m, t, tick):  # type: ignore[no-untyped-def]
    """Replace row FORCE by what runtime assurance lets pass."""
    longest, width = int(t[LONGEST]), int(t[NUMBERS])
    for s in range(RUNS):
        y, z, delay = s + RUNS, s + 2 * RUNS, int(t[DELAYS + s])
        v, table = m[_NUMBERS * s :][:_NUMBERS], t[GUARDS + width * s :][:width]
        line = m[_NUMBERS * RUNS + 3 * longest * s :]
        if tick == 0:
            v[MODE] = t[MODES + s]
        state = (
            w[KNOWN_R + s], w[KNOWN_R + y], w[KNOWN_R + z],
            w[KNOWN_V + s], w[KNOWN_V + y], w[KNOWN_V + z],
        )  # fmt: skip
        if delay > 0:
            step = unpacked(table, 0, 1)
            for i in range(delay):
                due = 3 * ((tick + i) % delay)
                state = cw_step(state, (line[due], line[due + 1], line[due + 2]), step)
        for i in range(6):
            v[AHEAD + i] = state[i]
        v[COMMAND], v[COMMAND + 1], v[COMMAND + 2] = w[FORCE + s], w[FORCE + y], w[FORCE + z]
        if width == _GUARD:
            fx, fy, fz, mode, _, _, _ = assure_packed(v, table)
        else:
            axes = t[int(t[AXES + s]) + FRAME * (tick + delay) :][: 2 * FRAME]
            fx, fy, fz, mode, _, _, _ = assure_turning_packed(v, axes, table)
        v[PREVIOUS], v[PREVIOUS + 1], v[PREVIOUS + 2], v[MODE] = fx, fy, fz, mode
        if delay > 0:
            newest = 3 * (tick % delay)
            line[newest], line[newest + 1], line[newest + 2] = fx, fy, fz
        w[FORCE + s], w[FORCE + y], w[FORCE + z] = fx, fy, fz


def guiding_of(batch: Batch) -> Part | None:
    """Return the references of runs from the states that they see; None without plan."""
    settings = batch.base.section(Guidance)
    if settings is None:
        return None
    count = batch.base.ticks + 1
    table = np.zeros((count, 15 if settings.past_port_m else 9, RUNS))
    last = np.zeros(RUNS)
    for i, (scenario, state) in enumerate(zip(batch.scenarios, batch.seen, strict=True)):
        own = scenario.section(Guidance)
        assert own is not None
        stage = GuidanceStage(own, scenario)
        table[:, :9, i], last[i] = stage.rows(state, count - 1)
        if settings.past_port_m:
            table[:, 9:, i] = stage.ports(count)
    steps = ((Place.GUIDANCE, follow), (ADDED, add_feed_forward))
    numbers = table_of(settings.past_port_m, table[0].size, last, table)
    return Part('guidance', steps, numbers, np.zeros(RUNS))


def _assured(batch: Batch) -> Part | None:
    """Return the assurance of runs; lanes without a run are copies of the first."""
    if batch.base.section(Assurance) is None:
        return None
    guards, modes, delays, motions = [], [], [], []
    for scenario, state in zip(batch.scenarios, batch.seen, strict=True):
        settings = scenario.section(Assurance)
        assert settings is not None
        stage = AssuranceStage(settings, scenario)
        guards.append(stage.numbers)
        modes.append(float(stage.mode_of(stage.ahead(state), stage.delay_ticks)))
        delays.append(float(stage.delay_ticks))
        motions.append(stage.motion)
    longest, width = int(max(1, *delays)), len(guards[0])
    moving = list(dict.fromkeys(motion for motion in motions if motion is not None))
    ticks = batch.base.ticks + longest + 2
    first = GUARDS + width * RUNS
    places = [first + FRAME * ticks * moving.index(m) if m is not None else 0 for m in motions]
    table = table_of(
        *(batch.lanes(delays), longest, batch.lanes(modes), width, batch.lanes(places)),
        *(batch.lanes(guards).T, *(motion.frames(ticks) for motion in moving)),
    )
    return Part(
        'assurance',
        ((Place.GUIDANCE - 1, know), (Place.ASSURANCE, assure_all)),
        table,
        np.zeros(RUNS * (_NUMBERS + 3 * longest)),
    )


def _refuse_plan(scenario: Scenario) -> str:
    plan = scenario.section(Guidance)
    held = plan is not None and any(leg.kind == HOLD for leg in plan.legs)
    return 'a plan with holds' if held else ''


def _refuse_assurance(scenario: Scenario) -> str:
    assurance = scenario.section(Assurance)
    if assurance is not None and assurance.abort is not None:
        return 'an abort table'
    if assurance is None or assurance.sigmas == 0.0 or scenario.section(Estimator) is None:
        return ''
    return 'runtime assurance that follows an estimator'


def vary(kind: type[Guidance] | type[Assurance], scenario: Scenario, draw: Draw) -> list[Any]:
    """Return guidance or assurance of a run, which assume the nominal mass."""
    settings: Any = scenario.section(kind)
    if settings is None or 'mass_share' not in draw.dispersed:
        return []
    return [replace(settings, mass_kg=settings.mass_kg or scenario.mass_kg)]


register(Kind('guidance', guiding_of, _refuse_plan, lambda s, draw: vary(Guidance, s, draw)))
register(Kind('assurance', _assured, _refuse_assurance, lambda s, draw: vary(Assurance, s, draw)))
