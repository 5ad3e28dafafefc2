# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Thrusters side by side: limit, delay, errors, pulses of valves, propellant."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from rpo.engine.lanes import (
    BEFORE,
    EXERTED_TORQUE,
    FORCE,
    MASS,
    PAIRED_LANES,
    RUNS,
    TORQUE,
    UNLOADING,
    compiled,
)
from rpo.engine.parts.attitude import vector_in
from rpo.engine.tick import LIMITED, Batch, Kind, Part, register, table_of
from rpo_core.kernels.arithmetic import saturate
from rpo_core.kernels.arrays import Floats
from rpo_core.kernels.vectors import WIDTH, lanes_at, wide
from rpo_core.scenario import requirements
from rpo_core.stage import Place
from rpo_core.thrusters.allocation_kernels import (
    AIM,
    MOST_THRUSTERS,
    ROWS,
    SCRATCH,
    THRUST,
    Table,
    allocate_from,
    carry,
    dearest,
    exert,
    leave_out,
    stick,
    want,
)
from rpo_core.thrusters.allocation_kernels import LIMIT as LARGEST
from rpo_core.thrusters.pulse_kernels import Spent, Tank, Valves, burn, exerted_force, fire
from rpo_core.thrusters.table import IDENTITY
from rpo_core.thrusters.thrusters import (
    failures_of,
    table_for,
    tank_of,
    turns_by_table,
    valves_of,
)

OPEN = ROWS
SPENT = OPEN + MOST_THRUSTERS
MEMORY = SPENT + 3
"""Places in the memory of a run: what is carried; which valves were open; what is spent (`Spent`).
And the numbers of a memory."""

WANTED, WORK = SCRATCH * WIDTH, (SCRATCH + ROWS) * WIDTH
"""Places in the scratch of `WIDTH` tables: what is wanted; the scratch of one."""

LANES, LIMIT, SLOTS, DELAYS = range(4)
"""Places in the table of a limit: number of lanes, largest force [N], slots of the queue of
commands, delay of each run [ticks]."""

TANKS, REST = 0, 3 * RUNS
"""Places in the table of valves and tanks: exhaust velocity, content and mass of each run (3, 40);
then the tick [s], or the valves: eight numbers that all runs share, the number of failures, and of
each run `directions` of `Valves` and its failures. The memory begins with those of the runs,
(MEMORY,) or of a table (MEMORY, `WIDTH`) of so many together."""

_SHARED = 8


@compiled
def limit(w, m, t, tick):  # type: ignore[no-untyped-def]
    """Saturate row FORCE; replace it by the command of some ticks ago.

    The first command that has an effect is its own predecessor: the step from rest does not count.
    """
    n, most, slots = int(t[LANES]), t[LIMIT], int(t[SLOTS])
    for s in range(n):
        w[FORCE + s] = saturate(w[FORCE + s], most)
    if slots == 1:
        if tick == 0:
            for s in range(n):
                w[BEFORE + s] = w[FORCE + s]
        return
    now = PAIRED_LANES * (tick % slots)
    for s in range(PAIRED_LANES):
        m[now + s] = w[FORCE + s]
    for s in range(RUNS):
        slot = PAIRED_LANES * ((tick + slots - int(t[DELAYS + s])) % slots)
        for axis in range(3):
            w[FORCE + axis * RUNS + s] = m[slot + axis * RUNS + s]
            if tick <= t[DELAYS + s]:
                w[BEFORE + axis * RUNS + s] = w[FORCE + axis * RUNS + s]


def limit_part(lanes: int, limit_n: float, delays: Sequence[float] = ()) -> Part:
    """Return the part of the largest force and of delays [ticks] of paired runs."""
    slots = int(max(delays, default=0)) + 1
    table, memory = table_of(lanes, limit_n, slots, delays), np.zeros(slots * PAIRED_LANES)
    return Part('limit', ((LIMITED, limit),), table, memory)


@compiled
def apply_matrix(w, m, t, tick):  # type: ignore[no-untyped-def]
    """Replace row FORCE by the force that thrusters with a matrix apply."""
    for s in range(RUNS):
        y, z = s + RUNS, s + 2 * RUNS
        w[FORCE + s], w[FORCE + y], w[FORCE + z] = exerted_force(
            t[s], t[RUNS + s], t[2 * RUNS + s],
            t[3 * RUNS + s], t[4 * RUNS + s], t[5 * RUNS + s],
            t[6 * RUNS + s], t[7 * RUNS + s], t[8 * RUNS + s],
            w[FORCE + s], w[FORCE + y], w[FORCE + z],
        )  # fmt: skip


@compiled
def _tank(t, s):  # type: ignore[no-untyped-def]
    return Tank(t[TANKS + s], t[TANKS + RUNS + s], t[TANKS + 2 * RUNS + s])


@compiled
def _spent(m):  # type: ignore[no-untyped-def]
    return Spent(m[SPENT], m[SPENT + 1], m[SPENT + 2])


@compiled
def _keep(m, spent):  # type: ignore[no-untyped-def]
    for i in range(len(spent)):
        m[SPENT + i] = spent[i]


@compiled
def burn_propellant(w, m, t, tick):  # type: ignore[no-untyped-def]
    """Replace row FORCE, exerted without pulses, by what the tanks allow; fill row MASS.

    The saturated command, which is counted already, is in row BEFORE.
    """
    for s in range(RUNS):
        y, z, memory = s + RUNS, s + 2 * RUNS, m[MEMORY * s : MEMORY * (s + 1)]
        force = (w[FORCE + s], w[FORCE + y], w[FORCE + z])
        command = (w[BEFORE + s], w[BEFORE + y], w[BEFORE + z])
        force, w[MASS + s], spent = burn(force, command, _spent(memory), _tank(t, s), t[REST])
        _keep(memory, spent)
        w[FORCE + s], w[FORCE + y], w[FORCE + z] = force


@compiled
def fire_valves(w, m, t, tick):  # type: ignore[no-untyped-def]
    """Replace row FORCE, the saturated command, by the mean force of pulses; fill row MASS."""
    shared, count = t[REST : REST + _SHARED], int(t[REST + _SHARED])
    number = int(shared[0])
    on = m[MEMORY * RUNS :]
    for s in range(RUNS):
        y, z = s + RUNS, s + 2 * RUNS
        a = REST + _SHARED + 1 + (3 * number + 5 * count) * s
        b = a + 3 * number
        valves = Valves(
            number, int(shared[1]), shared[2], shared[3], shared[4], shared[5], shared[6],
            shared[7], t[a:b].reshape(number, 3),
        )  # fmt: skip
        failures = t[b : b + 5 * count].reshape(count, 5)
        command = (w[FORCE + s], w[FORCE + y], w[FORCE + z])
        memory = m[MEMORY * s : MEMORY * (s + 1)]
        force, w[MASS + s], spent = fire(
            tick, command, memory, memory[OPEN:], _spent(memory), valves, failures, _tank(t, s), on
        )
        _keep(memory, spent)
        w[FORCE + s], w[FORCE + y], w[FORCE + z] = force


def _limit_part(batch: Batch) -> Part:
    delays = batch.columns('delay_ticks')[0]
    return limit_part(PAIRED_LANES, batch.base.max_force_n, delays.tolist())


def _part(batch: Batch) -> Part:
    """Return the errors of thrusters; or their valves, which have the errors in them."""
    thrusters = batch.base.thrusters
    if thrusters is not None and thrusters.pulses:
        return _valves_part(batch)
    if thrusters is not None and thrusters.table:
        return _table_part(batch)
    matrices = np.zeros((9, RUNS))
    for s, scenario in enumerate(batch.scenarios):
        matrices[:, s] = np.ravel(scenario.thrusters.matrix if scenario.thrusters else IDENTITY)
    if thrusters is None or not thrusters.propellant:
        return Part('errors', ((Place.THRUSTERS, apply_matrix),), matrices.ravel())
    table = table_of(matrices, _tanks(batch), batch.base.dt_s)
    return Part('thrusters', ((Place.THRUSTERS, _exert_and_burn),), table, np.zeros(MEMORY * RUNS))


@compiled
def _exert_and_burn(w, m, t, tick):  # type: ignore[no-untyped-def]
    apply_matrix(w, m, t, tick)
    burn_propellant(w, m, t[9 * RUNS :], tick)


def _tanks(batch: Batch) -> Floats:
    """Return the tanks (3, 40)."""
    return batch.lanes([tank_of(s.thrusters, s) for s in batch.scenarios])


def _valves_part(batch: Batch) -> Part:
    made, rows = [], []
    for s in batch.scenarios:
        assert s.thrusters is not None and s.thrusters.pulses is not None
        made.append(valves_of(s.thrusters, s.thrusters.pulses, s))
        rows.append(failures_of(s.thrusters, s.dt_s))
    one, count = made[0], len(rows[0])
    own = np.zeros((RUNS, 3 * one.number + 5 * count))
    own[: len(made)] = [table_of(v.directions, r) for v, r in zip(made, rows, strict=True)]
    table = table_of(_tanks(batch), one[:_SHARED], count, own)
    memory = np.zeros(MEMORY * RUNS + one.number)
    return Part('thrusters', ((Place.THRUSTERS, fire_valves),), table, memory)


@compiled
def _allocate_each(wanted, t, w):  # type: ignore[no-untyped-def]
    """Fill THRUST of the scratch of `WIDTH` tables: only pivots differ."""
    own, aims = w[WORK:], lanes_at(w, 0)
    aims[AIM] = dearest(lanes_at(wanted, 0), t)
    for s in range(WIDTH):
        mine = w[s::WIDTH]
        for i in range(t.number):
            own[LARGEST + i] = mine[LARGEST + i]
        allocate_from(int(mine[AIM]), wanted[s::WIDTH], t, own)
        for i in range(t.number):
            mine[THRUST + i] = own[THRUST + i]


@compiled
def fire_table(w, m, t, tick):  # type: ignore[no-untyped-def]
    """Replace row FORCE, the saturated command, by the mean force of a table; fill row MASS.

    `allocation_kernels.fire` for `WIDTH` chasers at once, with the bits of each.
    """
    head, n, bases, count = t[REST:], int(t[REST]), int(t[REST + 6]), int(t[REST + 7])
    a, b, row = REST + 9, REST + 9 + 10 * n, int(head[8])
    shared, acts = t[a:b], b + bases
    stuck = t[acts + 6 * n * RUNS :].reshape(RUNS, count, 5)
    rows, tanks, scratch = wide(w), wide(t), m[MEMORY * RUNS :]
    work, wanted = lanes_at(scratch, 0), scratch[WANTED:WORK]
    for s in range(0, RUNS, WIDTH):
        y, z = s + RUNS, s + 2 * RUNS
        table = Table(
            n, int(head[1]), head[2], head[3], head[4], head[5], shared[: 6 * n],
            shared[6 * n : 7 * n], shared[7 * n : 8 * n], shared[8 * n : 9 * n],
            shared[9 * n : 10 * n], lanes_at(t, acts + 6 * n * s), t[b : b + bases],
        )  # fmt: skip
        memory, command = lanes_at(m, MEMORY * s), vector_in(rows, FORCE, s)
        want(command, vector_in(rows, row, s), memory, table, work, lanes_at(wanted, 0))
        for lane in range(WIDTH):
            leave_out(tick, stuck[s + lane], table, scratch[lane::WIDTH], wanted[lane::WIDTH])
        _allocate_each(wanted, table, scratch)
        carry(memory, table, work, lanes_at(wanted, 0))
        for lane in range(WIDTH):
            stick(tick, stuck[s + lane], table, scratch[lane::WIDTH])
        was_open = lanes_at(m, MEMORY * s + OPEN * WIDTH)
        force, torque, rows[MASS + s], spent = exert(
            was_open, _spent(memory), table, _tank(tanks, s), work
        )
        _keep(memory, spent)
        rows[FORCE + s], rows[FORCE + y], rows[FORCE + z] = force
        rows[EXERTED_TORQUE + s], rows[EXERTED_TORQUE + y], rows[EXERTED_TORQUE + z] = torque


def _table_part(batch: Batch) -> Part:
    made, rows = [], []
    for s in batch.scenarios:
        assert s.thrusters is not None and s.thrusters.table is not None
        made.append(table_for(s.thrusters, s))
        rows.append(failures_of(s.thrusters, s.dt_s))
    one, count = made[0], len(rows[0])
    acts = batch.lanes([t.acts for t in made])
    acts = acts.reshape(len(acts), -1, WIDTH).swapaxes(0, 1)
    shared = (one.columns, one.most, one.cost, one.burns, one.bits, one.bases)
    sizes = (len(one.bases), count, TORQUE if turns_by_table(batch.base) else UNLOADING)
    stuck = np.zeros((RUNS, 5 * count))
    stuck[: len(rows)] = np.reshape(rows, (len(rows), -1))
    table = table_of(_tanks(batch), one[:6], *sizes, *shared, acts, stuck)
    memory = np.zeros(MEMORY * RUNS + (WIDTH + 1) * SCRATCH + ROWS * WIDTH)
    return Part('thruster_table', ((Place.THRUSTERS, fire_table),), table, memory)


def spent_of(memories: Mapping[str, Floats]) -> dict[str, Floats]:
    """Return what runs have spent, of the memories of a flight: a requirement -> (40,)."""
    for part, width in (('thrusters', 1), ('thruster_table', WIDTH)):
        if part in memories:
            runs = memories[part][: MEMORY * RUNS].reshape(-1, MEMORY, width)
            pairs = zip(requirements.THRUST, range(SPENT, MEMORY), strict=True)
            return {name: runs[:, at].ravel() for name, at in pairs}
    return {}


register(Kind('', _limit_part))
register(Kind('thrusters', _part))
