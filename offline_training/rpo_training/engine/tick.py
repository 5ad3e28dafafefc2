# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The tick of many flights side by side, lane by lane: the bits of `rpo_core.flight.fly`.

Under Clohessy-Wiltshire z is decoupled from x and y, and a fuzzy controller acts axis by axis. So
runs are planar (x, y) and vertical (z) loops; their axes are lanes x..., y..., z... of the scratch
(`rpo_training.engine.lanes`). Either every planar loop is crossed with every vertical one (a set of
starts has few distinct ones), or loop i of both kinds is run i: then there are `RUNS` of each, and
the run may have parts that couple axes or differ from run to run.

A part that is None is not compiled: each kernel that takes it returns at once, which numba sees
from its type. Nothing is allocated while flying.
"""

from __future__ import annotations

from math import sqrt
from typing import Any, NamedTuple

from rpo_core import metrics
from rpo_core.baseline_kernels import baseline_force
from rpo_core.kernels import CwStep, cw_step, given_force, measured, saturate, sin_cos
from rpo_core.metrics import AxisSums, fill_row, larger, last_outside, norm, with_square
from rpo_core.noise import six_normals
from rpo_training.engine.lanes import E_R, E_V, FIRST_FREE, OUTPUT, STRIDE, compiled, infer_lanes
from rpo_training.engine.link import LOST, lateness

RUNS = 40
"""Paired runs side by side: whole SIMD registers, and three axes fit into a row."""

AXES = 3 * RUNS

# Rows of the scratch, after those of the inference.
R, V, SEEN_R, SEEN_V, FORCE, BEFORE, PUSH = ((FIRST_FREE + row) * STRIDE for row in range(7))
SUM_R, SUM_V, QUIET, BIAS_R, BIAS_V, NOISE_R, NOISE_V = (
    (FIRST_FREE + 7 + row) * STRIDE for row in range(7)
)
ENERGY, EFFORT, SLEW, LATE_R, LATE_V, LATE_F, OUTSIDE = (
    (FIRST_FREE + 14 + row) * STRIDE for row in range(7)
)
MATRIX = (FIRST_FREE + 21) * STRIDE  # 9 rows
STEP = (FIRST_FREE + 30) * STRIDE  # 26 rows
ROWS = FIRST_FREE + 30 + len(CwStep._fields)


class Navigation(NamedTuple):
    """Errors of navigation.

    biases : (40, 6) [m, m/s]; noise : (2,) 1 sigma [m], [m/s]; keys : (2, 40) of the noise
    """

    biases: Any
    noise: Any
    keys: Any


class Link(NamedTuple):
    """Messages lost or late between plant and controller, and the answers on their way.

    faults : `rpo_training.engine.link.Fates`; keys : (2, 40)
    past, lateness : (2 late + 1, 120), (2 late + 1, 40) the last answers, and when they come
    latest, held : (40,), (120,) tick of the latest answer that has come, and the answer
    """

    faults: Any
    keys: Any
    past: Any
    lateness: Any
    latest: Any
    held: Any


class Thrusters(NamedTuple):
    """How thrusters are late and off.

    delays : (40,) ticks; matrix : (40, 9), given = matrix x saturated command
    queue : (longest delay + 1, 120) saturated commands
    """

    delays: Any
    matrix: Any
    queue: Any


class Waves(NamedTuple):
    """The disturbance as its constant part and harmonics, of each run.

    times : (ticks,) [s]; constant : (3, 40) [N]
    waves : (harmonics, 3, 40) amplitude [N], rate [rad/s], phase [rad]
    axes, sines : (harmonics,) axis 0..2 of each, and whether it is a sine
    """

    times: Any
    constant: Any
    waves: Any
    axes: Any
    sines: Any


class Runs(NamedTuple):
    """Runs that fly side by side; all parts from `navigation` on may be None.

    planar : (P, 4) starts x, y, vx, vy [m, m/s]; vertical : (Q, 2) starts z, vz
    table : (ticks, 2 P + Q) disturbance [N], lanes x..., y..., z...; or (1, ...), always the same
    steps : (40, 26) fields of CwStep, where they are not the plant's
    """

    planar: Any
    vertical: Any
    navigation: Any = None
    link: Any = None
    thrusters: Any = None
    table: Any = None
    waves: Any = None
    steps: Any = None


class Control(NamedTuple):
    """A controller: `lanes.Law`, which acts axis by axis; or a BaselineLaw, for paired runs."""

    fuzzy: Any = None
    baseline: Any = None


class Plant(NamedTuple):
    """What all runs share: largest force of an axis [N], tick [s], CwStep or None."""

    limit: float
    dt: float
    step: Any = None


@compiled
def place(w, runs):  # type: ignore[no-untyped-def]
    """Put runs at their starts, with nothing on its way."""
    w[:] = 0.0
    p, q = len(runs.planar), len(runs.vertical)
    for i in range(p):
        w[R + i], w[R + p + i], w[V + i], w[V + p + i] = runs.planar[i]
    for i in range(q):
        w[R + 2 * p + i], w[V + 2 * p + i] = runs.vertical[i]
    _place_navigation(w, runs.navigation)
    _place_link(runs.link)
    _place_thrusters(w, runs.thrusters)
    _place_steps(w, runs.steps)


@compiled
def _place_navigation(w, navigation):  # type: ignore[no-untyped-def]
    if navigation is None:
        return
    for s in range(RUNS):
        for axis in range(3):
            w[BIAS_R + axis * RUNS + s] = navigation.biases[s, axis]
            w[BIAS_V + axis * RUNS + s] = navigation.biases[s, 3 + axis]


@compiled
def _place_link(link):  # type: ignore[no-untyped-def]
    if link is None:
        return
    link.past[:] = link.held[:] = 0.0
    link.lateness[:] = LOST
    link.latest[:] = -1


@compiled
def _place_thrusters(w, thrusters):  # type: ignore[no-untyped-def]
    if thrusters is None:
        return
    thrusters.queue[:] = 0.0
    for s in range(RUNS):
        for axis in range(3):
            w[QUIET + axis * RUNS + s] = thrusters.delays[s]
        for i in range(9):
            w[MATRIX + i * STRIDE + s] = thrusters.matrix[s, i]


@compiled
def _place_steps(w, steps):  # type: ignore[no-untyped-def]
    if steps is None:
        return
    for s in range(RUNS):
        for i in range(26):
            w[STEP + i * STRIDE + s] = steps[s, i]


@compiled
def measure(w, tick, navigation):  # type: ignore[no-untyped-def]
    """Fill rows SEEN: the truth, with bias and noise; without, the controller reads the truth."""
    if navigation is None:
        return
    sigma_r, sigma_v = navigation.noise[0], navigation.noise[1]
    if sigma_r > 0.0 or sigma_v > 0.0:
        first, second = navigation.keys[0], navigation.keys[1]
        for s in range(RUNS):
            x = six_normals(tick, int(first[s]), int(second[s]))
            w[NOISE_R + s], w[NOISE_R + RUNS + s], w[NOISE_R + 2 * RUNS + s] = x[0], x[1], x[2]
            w[NOISE_V + s], w[NOISE_V + RUNS + s], w[NOISE_V + 2 * RUNS + s] = x[3], x[4], x[5]
    for s in range(AXES):
        w[SEEN_R + s] = measured(w[R + s], w[BIAS_R + s], sigma_r, w[NOISE_R + s])
        w[SEEN_V + s] = measured(w[V + s], w[BIAS_V + s], sigma_v, w[NOISE_V + s])


@compiled
def _normalise(w, n, law, r, v):  # type: ignore[no-untyped-def]
    position_scale, velocity_scale = law.scales[0], law.scales[1]
    for s in range(n):
        w[E_R + s] = saturate(-w[r + s] / position_scale, 1.0)
        w[E_V + s] = saturate(-w[v + s] / velocity_scale, 1.0)


@compiled
def command_fuzzy(w, n, law, navigation):  # type: ignore[no-untyped-def]
    """Row FORCE [N] of n lanes from what the controller sees.

    Lanes are filled up to a multiple of eight, whole SIMD registers; the rest idles at the origin.
    """
    if law is None:
        return
    n = (n + 7) // 8 * 8
    if navigation is None:
        _normalise(w, n, law, R, V)
    else:
        _normalise(w, n, law, SEEN_R, SEEN_V)
    infer_lanes(w, n, law)
    force_scale = law.scales[2]
    for s in range(n):
        w[FORCE + s] = force_scale * w[OUTPUT + s]


@compiled
def _command_paired(w, tick, law, r, v):  # type: ignore[no-untyped-def]
    for s in range(RUNS):
        y, z = s + RUNS, s + 2 * RUNS
        seen = (w[r + s], w[r + y], w[r + z], w[v + s], w[v + y], w[v + z])
        w[FORCE + s], w[FORCE + y], w[FORCE + z] = baseline_force(seen, tick, law)


@compiled
def command_baseline(w, tick, law, navigation):  # type: ignore[no-untyped-def]
    """Row FORCE [N] of paired runs from what the controller sees."""
    if law is None:
        return
    if navigation is None:
        _command_paired(w, tick, law, R, V)
    else:
        _command_paired(w, tick, law, SEEN_R, SEEN_V)


@compiled
def hold(w, tick, link):  # type: ignore[no-untyped-def]
    """Replace row FORCE, the answers to this tick, by the latest that have come by now."""
    if link is None:
        return
    faults, depth, first, second = link.faults, len(link.past), link.keys[0], link.keys[1]
    slot = tick % depth
    for s in range(AXES):
        link.past[slot, s] = w[FORCE + s]
    for s in range(RUNS):
        link.lateness[slot, s] = lateness(tick, int(first[s]), int(second[s]), faults)
        for late in (0, faults.late_by, 2 * faults.late_by):
            answered = tick - late
            came = answered >= 0 and link.lateness[answered % depth, s] == late
            if came and answered > link.latest[s]:
                link.latest[s] = answered
                for lane in (s, s + RUNS, s + 2 * RUNS):
                    link.held[lane] = link.past[answered % depth, lane]
        fresh = link.latest[s] >= 0 and tick - link.latest[s] <= faults.stale_after
        for lane in (s, s + RUNS, s + 2 * RUNS):
            w[FORCE + lane] = link.held[lane] if fresh else 0.0


@compiled
def saturate_all(w, n, limit):  # type: ignore[no-untyped-def]
    """Saturate row FORCE."""
    for s in range(n):
        w[FORCE + s] = saturate(w[FORCE + s], limit)


@compiled
def delay(w, tick, thrusters):  # type: ignore[no-untyped-def]
    """Replace row FORCE by the saturated command of `delays` ticks ago."""
    if thrusters is None:
        return
    queue, slots = thrusters.queue, len(thrusters.queue)
    if slots == 1:
        return
    for s in range(AXES):
        queue[tick % slots, s] = w[FORCE + s]
    for s in range(RUNS):
        slot = (tick + slots - thrusters.delays[s]) % slots
        for axis in range(3):
            w[FORCE + axis * RUNS + s] = queue[slot, axis * RUNS + s]


@compiled
def give(w, thrusters):  # type: ignore[no-untyped-def]
    """Replace row FORCE by what the thrusters give."""
    if thrusters is None:
        return
    for s in range(RUNS):
        y, z, i = s + RUNS, s + 2 * RUNS, MATRIX + s
        w[FORCE + s], w[FORCE + y], w[FORCE + z] = given_force(
            w[i],
            w[i + STRIDE],
            w[i + 2 * STRIDE],
            w[i + 3 * STRIDE],
            w[i + 4 * STRIDE],
            w[i + 5 * STRIDE],
            w[i + 6 * STRIDE],
            w[i + 7 * STRIDE],
            w[i + 8 * STRIDE],
            w[FORCE + s],
            w[FORCE + y],
            w[FORCE + z],
        )


@compiled
def push_by_table(w, n, tick, table):  # type: ignore[no-untyped-def]
    """Fill row PUSH from a table; one that has a single row is read once."""
    if table is None:
        return
    if tick < len(table):
        d = table[tick]
        for s in range(n):
            w[PUSH + s] = d[s]


@compiled
def push_by_waves(w, tick, waves):  # type: ignore[no-untyped-def]
    """Fill row PUSH by the harmonics of each run, as `Disturbance.force_n` adds them up."""
    if waves is None:
        return
    t = waves.times[tick]
    for axis in range(3):
        for s in range(RUNS):
            w[PUSH + axis * RUNS + s] = waves.constant[axis, s]
    for h in range(len(waves.axes)):
        row, wave, is_sine = PUSH + waves.axes[h] * RUNS, waves.waves[h], waves.sines[h]
        for s in range(RUNS):
            sine, cosine = sin_cos(wave[1, s] * t + wave[2, s])
            w[row + s] += wave[0, s] * (sine if is_sine else cosine)


@compiled
def step_alike(w, p, q, c):  # type: ignore[no-untyped-def]
    """Step all loops by the plant's coefficients under rows FORCE and PUSH."""
    if c is None:
        return
    for i in range(p):
        state = (w[R + i], w[R + p + i], 0.0, w[V + i], w[V + p + i], 0.0)
        total = (w[FORCE + i] + w[PUSH + i], w[FORCE + p + i] + w[PUSH + p + i], 0.0)
        w[R + i], w[R + p + i], _, w[V + i], w[V + p + i], _ = cw_step(state, total, c)
    for i in range(2 * p, 2 * p + q):
        state = (0.0, 0.0, w[R + i], 0.0, 0.0, w[V + i])
        total = (0.0, 0.0, w[FORCE + i] + w[PUSH + i])
        _, _, w[R + i], _, _, w[V + i] = cw_step(state, total, c)


@compiled
def coefficients(w, s):  # type: ignore[no-untyped-def]
    """Step of the relative dynamics of run s."""
    i = STEP + s
    # fmt: off
    return CwStep(
        w[i], w[i + STRIDE], w[i + 2 * STRIDE], w[i + 3 * STRIDE], w[i + 4 * STRIDE],
        w[i + 5 * STRIDE], w[i + 6 * STRIDE], w[i + 7 * STRIDE], w[i + 8 * STRIDE],
        w[i + 9 * STRIDE], w[i + 10 * STRIDE], w[i + 11 * STRIDE], w[i + 12 * STRIDE],
        w[i + 13 * STRIDE], w[i + 14 * STRIDE], w[i + 15 * STRIDE], w[i + 16 * STRIDE],
        w[i + 17 * STRIDE], w[i + 18 * STRIDE], w[i + 19 * STRIDE], w[i + 20 * STRIDE],
        w[i + 21 * STRIDE], w[i + 22 * STRIDE], w[i + 23 * STRIDE], w[i + 24 * STRIDE],
        w[i + 25 * STRIDE],
    )
    # fmt: on


@compiled
def step_each(w, steps):  # type: ignore[no-untyped-def]
    """Step paired runs by coefficients of their own under rows FORCE and PUSH."""
    if steps is None:
        return
    for s in range(RUNS):
        y, z = s + RUNS, s + 2 * RUNS
        state = (w[R + s], w[R + y], w[R + z], w[V + s], w[V + y], w[V + z])
        total = (
            w[FORCE + s] + w[PUSH + s],
            w[FORCE + y] + w[PUSH + y],
            w[FORCE + z] + w[PUSH + z],
        )
        after = cw_step(state, total, coefficients(w, s))
        w[R + s], w[R + y], w[R + z] = after[0], after[1], after[2]
        w[V + s], w[V + y], w[V + z] = after[3], after[4], after[5]


@compiled
def count_force(w, n, tick, windows):  # type: ignore[no-untyped-def]
    """Count row FORCE: saturated and late, before the thrusters' errors."""
    if tick < windows.ticks:
        for s in range(n):
            force = w[FORCE + s]
            w[ENERGY + s] = with_square(w[ENERGY + s], force)
            w[EFFORT + s] += abs(force)
            change = force - w[BEFORE + s] if tick > w[QUIET + s] else 0.0
            w[SLEW + s] = larger(w[SLEW + s], change)
            w[BEFORE + s] = force
    if tick >= windows.horizon - windows.late:
        for s in range(n):
            w[LATE_F + s] = larger(w[LATE_F + s], w[FORCE + s])


@compiled
def count_state(w, n, tick, windows):  # type: ignore[no-untyped-def]
    """Count rows R and V, after the step of a tick."""
    if tick < windows.ticks:
        for s in range(n):
            w[OUTSIDE + s] = last_outside(w[OUTSIDE + s], tick, w[R + s])
    if tick >= windows.horizon - windows.late:
        for s in range(n):
            w[LATE_R + s] = larger(w[LATE_R + s], w[R + s])
            w[LATE_V + s] = larger(w[LATE_V + s], w[V + s])


@compiled
def keep_norms(w, p, q, tick, windows, norms):  # type: ignore[no-untyped-def]
    """Keep squared norms of the tail for `finish_crossed`, or add up those of paired runs."""
    if not windows.ticks - windows.tail <= tick < windows.ticks:
        return
    if norms is None:
        for s in range(RUNS):
            y, z = s + RUNS, s + 2 * RUNS
            w[SUM_R + s] += norm(w[R + s], w[R + y], w[R + z])
            w[SUM_V + s] += norm(w[V + s], w[V + y], w[V + z])
        return
    row = tick - (windows.ticks - windows.tail)
    for i in range(p):
        norms[0, row, i] = w[R + i] * w[R + i] + w[R + p + i] * w[R + p + i]
        norms[1, row, i] = w[V + i] * w[V + i] + w[V + p + i] * w[V + p + i]
    for i in range(q):
        s = 2 * p + i
        norms[0, row, p + i] = w[R + s] * w[R + s]
        norms[1, row, p + i] = w[V + s] * w[V + s]


@compiled
def keep_trace(w, n, tick, trace):  # type: ignore[no-untyped-def]
    """Keep states and commands where somebody wants to see them."""
    if trace is None:
        return
    states, forces = trace
    for s in range(n):
        states[tick, s, 0] = w[R + s]
        states[tick, s, 1] = w[V + s]
        forces[tick, s] = w[FORCE + s]


@compiled
def answer(w, n, tick, navigation, fuzzy, baseline):  # type: ignore[no-untyped-def]
    """Fill row FORCE with the commands of a tick."""
    measure(w, tick, navigation)
    command_fuzzy(w, n, fuzzy, navigation)
    command_baseline(w, tick, baseline, navigation)


@compiled
def fly(runs, control, plant, windows, w, norms, trace):  # type: ignore[no-untyped-def]
    """Fly runs to the horizon; what was counted stays in `w` and `norms`.

    norms : (2, tail, >= P + Q) squared distances and speeds, planar loops first; None where paired
    trace : states (horizon + 1, lanes, 2), r and v, and commands (horizon + 1, lanes); or None
    """
    place(w, runs)
    # Taken out of the loop: whoever is handed arrays in a tuple counts references at each call.
    planar, vertical, navigation, link, thrusters, table, waves, steps = runs
    fuzzy, baseline = control
    p, q = len(planar), len(vertical)
    n = 2 * p + q
    for tick in range(windows.horizon):
        answer(w, n, tick, navigation, fuzzy, baseline)
        keep_trace(w, n, tick, trace)
        hold(w, tick, link)
        saturate_all(w, n, plant.limit)
        delay(w, tick, thrusters)
        count_force(w, n, tick, windows)
        give(w, thrusters)
        push_by_table(w, n, tick, table)
        push_by_waves(w, tick, waves)
        step_alike(w, p, q, plant.step)
        step_each(w, steps)
        count_state(w, n, tick, windows)
        keep_norms(w, p, q, tick, windows, norms)
    if trace is not None:
        answer(w, n, windows.horizon, navigation, fuzzy, baseline)
        keep_trace(w, n, windows.horizon, trace)


@compiled
def _sums(w, s):  # type: ignore[no-untyped-def]
    return AxisSums(
        w[ENERGY + s],
        w[EFFORT + s],
        w[SLEW + s],
        w[LATE_R + s],
        w[LATE_V + s],
        w[LATE_F + s],
        w[OUTSIDE + s],
    )


@compiled
def _sum_norms(w, p, vertical, tail, norms):  # type: ignore[no-untyped-def]
    for i in range(p):
        w[SUM_R + i] = w[SUM_V + i] = 0.0
    for tick in range(tail):
        distance, speed = norms[0, tick, vertical], norms[1, tick, vertical]
        for i in range(p):
            w[SUM_R + i] += sqrt(norms[0, tick, i] + distance)
            w[SUM_V + i] += sqrt(norms[1, tick, i] + speed)


@compiled
def finish_crossed(p, q, plant, mass, windows, w, norms, rows):  # type: ignore[no-untyped-def]
    """Pair every planar with every vertical loop: rows of metrics (P * Q, columns), z fastest."""
    for j in range(q):
        z = 2 * p + j
        _sum_norms(w, p, p + j, windows.tail, norms)
        for i in range(p):
            fill_row(
                rows[i * q + j],
                _sums(w, i),
                _sums(w, p + i),
                _sums(w, z),
                w[SUM_R + i],
                w[SUM_V + i],
                windows.tail,
                plant.dt,
                mass,
            )


@compiled
def finish_paired(plant, masses, windows, w, rows, final):  # type: ignore[no-untyped-def]
    """Fill rows of metrics (n, columns) and final states (n, 6) of the first n runs."""
    for s in range(len(rows)):
        y, z = s + RUNS, s + 2 * RUNS
        fill_row(
            rows[s],
            _sums(w, s),
            _sums(w, y),
            _sums(w, z),
            w[SUM_R + s],
            w[SUM_V + s],
            windows.tail,
            plant.dt,
            masses[s],
        )
        for axis in range(3):
            final[s, axis] = w[R + axis * RUNS + s]
            final[s, 3 + axis] = w[V + axis * RUNS + s]


COLUMNS = len(metrics.UNITS)
"""Columns of a row of metrics."""
