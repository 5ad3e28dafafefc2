# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Flights side by side that follow a plan, under runtime assurance.

A plan without holds and commands does not depend on the flight: its phases come from tables.
"""

from __future__ import annotations

import numpy as np

from rpo.engine.lanes import (
    FORCE,
    KNOWN_R,
    KNOWN_SPREAD,
    KNOWN_V,
    PAIRED_LANES,
    RUNS,
    SEEN_R,
    SEEN_V,
    compiled,
)
from rpo.engine.parts.target import ATTITUDE, BODIES, DT, fill_axes, step_attitudes, targets_of
from rpo.engine.tick import ADDED, Batch, Kind, Part, register, table_of
from rpo_core.assurance.assurance import AssuranceStage
from rpo_core.assurance.doubt import DOUBT, doubt_at, doubted, unless_unsure, unless_unsure_turning
from rpo_core.assurance.filters import assure, assure_turning, guard_at
from rpo_core.assurance.kernels import APPROACH, FAR
from rpo_core.assurance.settings import Assurance
from rpo_core.attitude.attitude_kernels import FRAME, frame_at, to_lvlh
from rpo_core.guidance.guidance import HOLD, Guidance, GuidanceStage
from rpo_core.guidance.legs import Turning, tabled, turned
from rpo_core.guidance.transfers import at_port
from rpo_core.scenario.scenario import Scenario
from rpo_core.stage import Place
from rpo_core.world.cw import cw_step, unpacked

PAST, AXES, MOST, PORT, LAST = 0, 1, 2, 3, 9
MASSES = LAST + RUNS
PHASES = MASSES + RUNS
"""Places in the table of a plan: distance behind the port at which a chaser has docked, 0.0: it
does not; tick from which on the axes of the targets count; most phases of a run; port [m] and axis;
tick from which on the last leg of each run is flown; the mass that its guidance takes; `PHASE`
numbers of each of its phases. Then those of `targets_of`, if there are any; then the rows."""

BEGINS, TURNS_WITH, COUNT, PLACE = range(4)
PHASE = 4
"""Of a phase its first tick, 1 where it is flown in the target's axes, how many rows it has, the
last for the ticks that follow, and their place."""

UNDER_WAY, NEEDS = RUNS, 2 * RUNS
ATTITUDES = NEEDS + PAIRED_LANES
NOW = ATTITUDES + ATTITUDE
HALF = NOW + FRAME * RUNS
LATER = HALF + FRAME * RUNS
"""Places in the memory of a plan: who has docked, the phase of each run, the force [N] that its
reference needs; attitudes of the targets, their axes at the tick and half a tick later; attitudes
then."""

DELAYS, LONGEST, MODES = 0, RUNS, RUNS + 1
NUMBERS = MODES + RUNS
DOUBTS = NUMBERS + 1
GUARDS = DOUBTS + DOUBT * RUNS
"""Places in the table of assurance: ticks from a command to its force; the most of them, at least
one; modes at the start; how many numbers step and guards have; the numbers of `Doubt` of each run;
step and guards of each run; then those of `targets_of`, if the corridor turns."""

MODE, LINES = PAIRED_LANES, PAIRED_LANES + RUNS
"""Places in the memory of assurance: last forces; modes; the line of each run of forces that are on
their way; then attitudes and axes (2, 15, 40) of the targets when a force of now acts."""

_GUARD = 58


@compiled
def know(w, m, t, tick):  # type: ignore[no-untyped-def]
    """Keep what navigation found in rows KNOWN."""
    for s in range(PAIRED_LANES):
        w[KNOWN_R + s], w[KNOWN_V + s] = w[SEEN_R + s], w[SEEN_V + s]


@compiled
def _docks(w, m, t, s):  # type: ignore[no-untyped-def]
    """Whether a chaser has come to the port."""
    port, ahead = (t[PORT], t[PORT + 1], t[PORT + 2]), (t[PORT + 3], t[PORT + 4], t[PORT + 5])
    if t[AXES] < FAR:
        axes = frame_at(m, NOW + s, RUNS)
        port, ahead = to_lvlh(port, axes), to_lvlh(ahead, axes)
    (px, py, pz), (ax, ay, az) = port, ahead
    x, y, z = w[SEEN_R + s], w[SEEN_R + s + RUNS], w[SEEN_R + s + 2 * RUNS]
    return at_port(x, y, z, px, py, pz, ax, ay, az, t[PAST])


@compiled
def _reference(m, t, tick, s):  # type: ignore[no-untyped-def]
    """Return state and force of a run at a tick of its plan."""
    most = PHASE * int(t[MOST])
    phases, at = t[PHASES + most * s :], int(m[UNDER_WAY + s])
    if tick >= phases[at + PHASE + BEGINS]:
        at += PHASE
        m[UNDER_WAY + s] = at
    begins, count, place = phases[at + BEGINS], int(phases[at + COUNT]), int(phases[at + PLACE])
    behind = min(tick - int(begins), count - 1)
    if phases[at + TURNS_WITH] > 0.0:
        orbit = t[PHASES + most * RUNS + BODIES]
        now, half = frame_at(m, NOW + s, RUNS), frame_at(m, HALF + s, RUNS)
        return turned(t[place + FRAME * behind :], now, half, orbit, t[MASSES + s])
    row = t[place + 9 * behind :]
    return (row[0], row[1], row[2], row[3], row[4], row[5]), (row[6], row[7], row[8])


@compiled
def follow(w, m, t, tick):  # type: ignore[no-untyped-def]
    """Fill rows SEEN with the state relative to the reference; keep the force that it needs.

    Of a chaser that has docked the reference is its own state.
    """
    if t[AXES] < FAR:
        targets, attitudes = t[PHASES + PHASE * int(t[MOST]) * RUNS :], m[ATTITUDES:]
        if tick > 0:
            step_attitudes(attitudes, targets, targets[DT])
        if tick >= t[AXES]:
            fill_axes(attitudes, targets, m[NOW:])
            m[LATER : LATER + ATTITUDE] = attitudes[:ATTITUDE]
            step_attitudes(m[LATER:], targets, 0.5 * targets[DT])
            fill_axes(m[LATER:], targets, m[HALF:])
    for s in range(RUNS):
        y, z = s + RUNS, s + 2 * RUNS
        if t[PAST] > 0.0 and tick >= t[LAST + s] and m[s] == 0.0 and _docks(w, m, t, s):
            m[s] = 1.0
        state = (
            w[SEEN_R + s], w[SEEN_R + y], w[SEEN_R + z],
            w[SEEN_V + s], w[SEEN_V + y], w[SEEN_V + z],
        )  # fmt: skip
        force = (0.0, 0.0, 0.0)
        if m[s] == 0.0:
            state, force = _reference(m, t, tick, s)
        for axis in range(3):
            lane = axis * RUNS + s
            w[SEEN_R + lane] -= state[axis]
            w[SEEN_V + lane] -= state[3 + axis]
            m[NEEDS + lane] = force[axis]


@compiled
def add_feed_forward(w, m, t, tick):  # type: ignore[no-untyped-def]
    """Add the force that a chaser on the reference needs to row FORCE."""
    for s in range(PAIRED_LANES):
        w[FORCE + s] += m[NEEDS + s]


@compiled
def assure_all(w, m, t, tick):  # type: ignore[no-untyped-def]
    """Replace row FORCE by what runtime assurance lets pass."""
    longest, width = int(t[LONGEST]), int(t[NUMBERS])
    attitudes, targets = m[LINES + 3 * longest * RUNS :], t[GUARDS + width * RUNS :]
    now, following = attitudes[ATTITUDE:], attitudes[ATTITUDE + FRAME * RUNS :]
    if width > _GUARD:
        if tick == 0:
            fill_axes(attitudes, targets, following)
        now[: FRAME * RUNS] = following[: FRAME * RUNS]
        step_attitudes(attitudes, targets, targets[DT])
        fill_axes(attitudes, targets, following)
    for s in range(RUNS):
        y, z, delay, table = s + RUNS, s + 2 * RUNS, int(t[DELAYS + s]), t[GUARDS + width * s :]
        line = m[LINES + 3 * longest * s :]
        if tick == 0:
            m[MODE + s] = t[MODES + s]
        step, guard = unpacked(table, 0, 1), guard_at(table, 26)
        state = (
            w[KNOWN_R + s], w[KNOWN_R + y], w[KNOWN_R + z],
            w[KNOWN_V + s], w[KNOWN_V + y], w[KNOWN_V + z],
        )  # fmt: skip
        for i in range(delay):
            due = 3 * ((tick + i) % delay)
            state = cw_step(state, (line[due], line[due + 1], line[due + 2]), step)
        command, last = (w[FORCE + s], w[FORCE + y], w[FORCE + z]), (m[s], m[y], m[z])
        mode, doubt = int(m[MODE + s]), doubt_at(t, DOUBTS + DOUBT * s)
        spread, fast = w[KNOWN_SPREAD + s], w[KNOWN_SPREAD + y]
        guard = doubted(guard, doubt, 0.0, spread, fast)
        if width > _GUARD:
            axes = frame_at(now, s, RUNS), frame_at(following, s, RUNS)
            walls = doubted(guard_at(table, _GUARD), doubt, doubt.turns_rad_s, spread, fast)
            lost, command = unless_unsure_turning(
                state, command, mode, axes[0], guard, walls, doubt, spread
            )
            found = assure_turning(state, command, last, mode, *axes, step, guard, walls)
        else:
            lost, command = unless_unsure(state, command, mode, guard, doubt, spread)
            found = assure(state, command, last, mode, step, guard)
        newest = 3 * (tick % delay) if delay > 0 else 0
        fx, fy, fz, m[MODE + s], _, _, _ = found
        if lost and m[MODE + s] == APPROACH:
            fx, fy, fz = command
        w[FORCE + s], w[FORCE + y], w[FORCE + z] = m[s], m[y], m[z] = fx, fy, fz
        line[newest], line[newest + 1], line[newest + 2] = fx, fy, fz


def guiding_of(batch: Batch) -> Part | None:
    """Return the references of runs from the states that they see; None without plan.

    Lanes without a run rest at the target. What is flown in the axes of a target that turns is the
    same in all runs: one table.
    """
    settings = batch.base.section(Guidance)
    if settings is None:
        return None
    rows = {0: np.zeros((1, 9))}
    plans = [[(0, False, 1, 0)] for _ in range(RUNS)]
    last, masses, axes = np.full(RUNS, FAR), np.ones(RUNS), FAR
    for i, (scenario, state) in enumerate(zip(batch.scenarios, batch.seen, strict=True)):
        own = scenario.section(Guidance)
        assert own is not None
        plans[i], masses[i] = [], own.mass_kg or scenario.mass_kg
        for tick, count, flown, is_last in GuidanceStage(own, scenario).phases(
            state, scenario.ticks
        ):
            found, turns = tabled(flown, count), isinstance(flown, Turning)
            rows[id(found)] = found
            plans[i].append((tick, turns, len(found), id(found)))
            last[i] = min(last[i], tick if is_last else FAR)
            docks = is_last and settings.past_port_m and scenario.target is not None
            axes = min(axes, tick if turns or docks else FAR)
    memory, targets = np.zeros(ATTITUDES), []
    if axes < FAR:
        known = [scenario.target.known for scenario in batch.scenarios]
        numbers, attitudes = targets_of(batch, known, [0] * len(known))
        memory = table_of(memory, attitudes, np.zeros(2 * FRAME * RUNS + ATTITUDE))
        targets = [numbers]
    most = max(map(len, plans)) + 1
    places, place = {}, PHASES + PHASE * most * RUNS + sum(map(len, targets))
    for key, found in rows.items():
        places[key], place = place, place + found.size
    phases = np.full((RUNS, most, PHASE), FAR)
    for i, plan in enumerate(plans):
        phases[i, : len(plan)] = [(*numbers, places[key]) for *numbers, key in plan]
    port = (*settings.port_m, *settings.corridor.ahead)
    table = table_of(
        settings.past_port_m, axes, most, port, last, masses, phases, *targets, *rows.values()
    )
    steps = ((Place.GUIDANCE, follow), (ADDED, add_feed_forward))
    return Part('guidance', steps, table, memory)


def _assured(batch: Batch) -> Part | None:
    """Return the assurance of runs; lanes without a run are copies of the first."""
    if batch.base.section(Assurance) is None:
        return None
    guards, modes, delays, targets, doubts = [], [], [], [], []
    for scenario, state in zip(batch.scenarios, batch.seen, strict=True):
        settings = scenario.section(Assurance)
        assert settings is not None
        stage = AssuranceStage(settings, scenario)
        guards.append(stage.numbers)
        doubts.append(stage.doubt)
        modes.append(float(stage.mode_of(stage.ahead(state), stage.delay_ticks)))
        delays.append(stage.delay_ticks)
        targets += [scenario.target.known] if stage.motion is not None else []
    longest, memory = max(1, *delays), np.zeros(0)
    table = table_of(
        *(batch.lanes(delays), longest, batch.lanes(modes), len(guards[0])),
        *(batch.lanes(doubts).T, batch.lanes(guards).T),
    )
    if targets:
        numbers, attitudes = targets_of(batch, targets, delays)
        table = table_of(table, numbers)
        memory = table_of(attitudes, np.zeros(2 * FRAME * RUNS))
    return Part(
        'assurance',
        ((Place.GUIDANCE - 1, know), (Place.ASSURANCE, assure_all)),
        table,
        table_of(np.zeros(LINES + 3 * longest * RUNS), memory),
    )


def _refuse_plan(scenario: Scenario) -> str:
    plan = scenario.section(Guidance)
    held = plan is not None and any(leg.kind == HOLD for leg in plan.legs)
    return 'a plan with holds' if held else ''


def _refuse_assurance(scenario: Scenario) -> str:
    assurance = scenario.section(Assurance)
    return 'an abort table' if assurance is not None and assurance.abort is not None else ''


register(Kind('guidance', guiding_of, _refuse_plan, True))
register(Kind('assurance', _assured, _refuse_assurance, True))
