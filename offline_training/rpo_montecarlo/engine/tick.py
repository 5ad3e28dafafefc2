# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The tick of many flights side by side, lane by lane: the bits of `rpo_core.chain.flight.fly`.

`fly` shows the tick; each kernel is one part of it. Nothing is allocated while flying.
"""

from __future__ import annotations

from rpo_core.judge.metrics import larger
from rpo_core.kernels import CwStep, cw_step, exerted_force, measured, saturate, sin_cos
from rpo_core.kernels.noise import six_normals
from rpo_ctrl.baseline_kernels import axis_force, baseline_force
from rpo_montecarlo.engine.approach import (
    add_feed_forward,
    assure_all,
    follow,
    know,
    place_approach,
)
from rpo_montecarlo.engine.counters import begin_forces, count_force, count_state, keep_norms
from rpo_montecarlo.engine.lanes import E_R, E_V, OUTPUT, STRIDE, compiled, infer_lanes
from rpo_montecarlo.engine.navigation import navigate, oppose, place_estimators, remember
from rpo_montecarlo.engine.parts import (
    BIAS_R,
    BIAS_V,
    FORCE,
    GOAL,
    HOLDING,
    LEVELS,
    MASS,
    MATRIX,
    NOISE_R,
    NOISE_V,
    PAIRED_LANES,
    PUSH,
    RUNS,
    SEEN_R,
    SEEN_V,
    STEP,
    R,
    V,
    lateness,
    place,
)
from rpo_montecarlo.engine.worlds import (
    burn_propellant,
    fire_valves,
    place_orbits,
    place_valves,
    step_orbits,
)


@compiled
def measure(w, tick, navigation):  # type: ignore[no-untyped-def]
    """Fill rows SEEN: truth, bias and noise. Without navigation the controller reads the truth."""
    if navigation is None:
        return
    sigma_r, sigma_v = navigation.noise[0], navigation.noise[1]
    if sigma_r > 0.0 or sigma_v > 0.0:
        first, second = navigation.keys[0], navigation.keys[1]
        for s in range(RUNS):
            x = six_normals(tick, int(first[s]), int(second[s]))
            w[NOISE_R + s], w[NOISE_R + RUNS + s], w[NOISE_R + 2 * RUNS + s] = x[0], x[1], x[2]
            w[NOISE_V + s], w[NOISE_V + RUNS + s], w[NOISE_V + 2 * RUNS + s] = x[3], x[4], x[5]
    for s in range(PAIRED_LANES):
        w[SEEN_R + s] = measured(w[R + s], w[BIAS_R + s], sigma_r, w[NOISE_R + s])
        w[SEEN_V + s] = measured(w[V + s], w[BIAS_V + s], sigma_v, w[NOISE_V + s])


@compiled
def aim(w, n, navigation, goal, guiding):  # type: ignore[no-untyped-def]
    """Fill rows SEEN with the state relative to the goal, as navigation finds it."""
    if goal is None or guiding is not None:
        return
    if navigation is None:
        for s in range(n):
            w[SEEN_R + s] = w[R + s]
            w[SEEN_V + s] = w[V + s]
    for s in range(n):
        w[SEEN_R + s] -= w[GOAL + s]


@compiled
def add_holding(w, n, goal, guiding):  # type: ignore[no-untyped-def]
    """Add the force that holds at the goal to row FORCE."""
    if goal is None or guiding is not None:
        return
    for s in range(n):
        w[FORCE + s] += w[HOLDING + s]


@compiled
def _normalise(w, n, law, r, v):  # type: ignore[no-untyped-def]
    position_scale, velocity_scale = law.scales[0], law.scales[1]
    for s in range(n):
        w[E_R + s] = saturate(-w[r + s] / position_scale, 1.0)
        w[E_V + s] = saturate(-w[v + s] / velocity_scale, 1.0)


@compiled
def command_fuzzy(w, n, law, navigation, goal):  # type: ignore[no-untyped-def]
    """Row FORCE [N] of n lanes from the input of the controller.

    n is rounded up to a multiple of eight, whole SIMD registers; the added lanes are at the origin.
    """
    if law is None:
        return
    n = (n + 7) // 8 * 8
    if navigation is None and goal is None:
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
def command_baseline(w, tick, law, navigation, goal):  # type: ignore[no-untyped-def]
    """Row FORCE [N] of paired runs from the input of the controller."""
    if law is None:
        return
    if navigation is None and goal is None:
        _command_paired(w, tick, law, R, V)
    else:
        _command_paired(w, tick, law, SEEN_R, SEEN_V)


@compiled
def _command_axes(w, n, tick, law, r, v):  # type: ignore[no-untyped-def]
    for s in range(n):
        w[FORCE + s] = axis_force(w[r + s], w[v + s], tick, law)


@compiled
def command_axes(w, n, tick, law, navigation, goal):  # type: ignore[no-untyped-def]
    """Row FORCE [N] of n lanes from the input of a controller that treats all axes alike."""
    if law is None:
        return
    if navigation is None and goal is None:
        _command_axes(w, n, tick, law, R, V)
    else:
        _command_axes(w, n, tick, law, SEEN_R, SEEN_V)


@compiled
def hold(w, tick, link):  # type: ignore[no-untyped-def]
    """Replace row FORCE, the answers to this tick, by the latest that have arrived."""
    if link is None:
        return
    faults, depth, first, second = link.faults, len(link.past), link.keys[0], link.keys[1]
    slot = tick % depth
    for s in range(PAIRED_LANES):
        link.past[slot, s] = w[FORCE + s]
    for s in range(RUNS):
        link.lateness[slot, s] = lateness(tick, int(first[s]), int(second[s]), faults)
        for late in (0, faults.late_by, 2 * faults.late_by):
            answered = tick - late
            arrives = answered >= 0 and link.lateness[answered % depth, s] == late
            if arrives and answered > link.latest[s]:
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
    for s in range(PAIRED_LANES):
        queue[tick % slots, s] = w[FORCE + s]
    for s in range(RUNS):
        slot = (tick + slots - thrusters.delays[s]) % slots
        for axis in range(3):
            w[FORCE + axis * RUNS + s] = queue[slot, axis * RUNS + s]


@compiled
def apply(w, thrusters, valves):  # type: ignore[no-untyped-def]
    """Replace row FORCE by the force that the thrusters apply; valves have the matrix in them."""
    if thrusters is None or (valves is not None and valves.shared is not None):
        return
    for s in range(RUNS):
        y, z, i = s + RUNS, s + 2 * RUNS, MATRIX + s
        w[FORCE + s], w[FORCE + y], w[FORCE + z] = exerted_force(
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
    """Fill row PUSH by the harmonics of each run, as `Disturbance.force_n` adds them up.

    Row LEVELS keeps the largest |push| of an axis so far.
    """
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
    for s in range(RUNS):
        x, y, z = w[PUSH + s], w[PUSH + RUNS + s], w[PUSH + 2 * RUNS + s]
        w[LEVELS + s] = larger(larger(larger(w[LEVELS + s], x), y), z)


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
def lighten(w, valves):  # type: ignore[no-untyped-def]
    """Let forces count as much more as they move a chaser that has spent propellant.

    Row FORCE is then the sum of FORCE and PUSH.
    """
    if valves is None:
        return
    for s in range(RUNS):
        more = valves.tanks[s, 2] / w[MASS + s]
        for lane in (s, s + RUNS, s + 2 * RUNS):
            w[FORCE + lane] = (w[FORCE + lane] + w[PUSH + lane]) * more
            w[PUSH + lane] = 0.0


@compiled
def step_each(w, steps, valves):  # type: ignore[no-untyped-def]
    """Step paired runs by coefficients of their own under rows FORCE and PUSH."""
    if steps is None:
        return
    lighten(w, valves)
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
def keep_trace(w, n, tick, trace):  # type: ignore[no-untyped-def]
    """Keep states and commands for tests."""
    if trace is None:
        return
    states, forces = trace
    for s in range(n):
        states[tick, s, 0] = w[R + s]
        states[tick, s, 1] = w[V + s]
        forces[tick, s] = w[FORCE + s]


@compiled
def fly(runs, control, plant, windows, w, norms, trace):  # type: ignore[no-untyped-def]
    """Fly runs to the horizon; sums and extremes stay in `w` and `norms`.

    norms : (2, tail, >= P + Q) squared distances and speeds, planar loops first; None where paired
    trace : states (horizon + 1, lanes, 2), r and v, and commands (horizon + 1, lanes); or None
    """
    place(w, runs)
    place_valves(w, runs.valves)
    place_estimators(runs.estimators)
    place_approach(runs.guiding, runs.assured)
    place_orbits(runs.orbits)
    # Unpacked before the loop: a kernel that gets arrays in a tuple counts references at each call.
    # fmt: off
    (planar, vertical, navigation, link, thrusters, table, waves, steps, goal, valves, orbits,
     estimators, guiding, assured) = runs
    # fmt: on
    fuzzy, baseline, axes = control
    p, q = len(planar), len(vertical)
    n = 2 * p + q
    for tick in range(windows.horizon + 1):
        measure(w, tick, navigation)
        navigate(w, tick, estimators)
        know(w, guiding, assured)
        follow(w, tick, guiding)
        aim(w, n, navigation, goal, guiding)
        command_fuzzy(w, n, fuzzy, navigation, goal)
        command_baseline(w, tick, baseline, navigation, goal)
        command_axes(w, n, tick, axes, navigation, goal)
        add_holding(w, n, goal, guiding)
        add_feed_forward(w, tick, guiding)
        oppose(w, estimators)
        keep_trace(w, n, tick, trace)
        assure_all(w, tick, assured)
        remember(w, tick, estimators)
        if tick == windows.horizon:
            break
        hold(w, tick, link)
        saturate_all(w, n, plant.limit)
        delay(w, tick, thrusters)
        begin_forces(w, n, tick, thrusters)
        count_force(w, n, tick, windows)
        apply(w, thrusters, valves)
        burn_propellant(w, valves, plant.dt)
        fire_valves(w, tick, valves)
        push_by_table(w, n, tick, table)
        push_by_waves(w, tick, waves)
        step_alike(w, p, q, plant.step)
        step_each(w, steps, valves)
        step_orbits(w, orbits, valves)
        count_state(w, n, tick, windows, goal)
        keep_norms(w, p, q, tick, windows, norms, goal)
