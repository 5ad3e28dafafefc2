# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The parts of runs that fly side by side, and their rows in the scratch.

Under Clohessy-Wiltshire z is decoupled from x and y, and a fuzzy controller acts axis by axis. So
runs are planar (x, y) and vertical (z) loops; their axes are lanes x..., y..., z... of the scratch
(`rpo_montecarlo.engine.lanes`). Either every planar loop is crossed with every vertical one (a set
of starts has few distinct ones), or loop i of both kinds is run i: then there are `RUNS` of each,
and a run may have parts that couple axes or differ from run to run.

A part that is None is not compiled: a kernel that takes it returns at once, and numba knows that
from the type.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rpo_core.kernels import CwStep
from rpo_core.kernels.jit import inlined
from rpo_core.kernels.noise import philox
from rpo_montecarlo.engine.lanes import FIRST_FREE, STRIDE, compiled

LOST = -1
"""The lateness of an answer that does not arrive."""

RUNS = 40
"""Paired runs side by side: whole SIMD registers, and three axes fit into a row."""

PAIRED_LANES = 3 * RUNS


def paired_lanes(count: int) -> NDArray[np.int64]:
    """Return the lanes (count, 3) x, y, z of the first paired runs."""
    return np.arange(count)[:, None] + RUNS * np.arange(3)


# Rows of the scratch, after those of the inference.
R, V, SEEN_R, SEEN_V, FORCE, BEFORE, PUSH = ((FIRST_FREE + row) * STRIDE for row in range(7))
SUM_R, SUM_V, BIAS_R, BIAS_V, NOISE_R, NOISE_V = (
    (FIRST_FREE + 7 + row) * STRIDE for row in range(6)
)
ENERGY, EFFORT, SLEW, LATE_R, LATE_V, LATE_F, OUTSIDE = (
    (FIRST_FREE + 13 + row) * STRIDE for row in range(7)
)
MATRIX = (FIRST_FREE + 20) * STRIDE  # 9 rows
STEP = (FIRST_FREE + 29) * STRIDE  # 26 rows
GOAL, HOLDING = ((FIRST_FREE + 29 + len(CwStep._fields) + row) * STRIDE for row in range(2))
MASS = (FIRST_FREE + 31 + len(CwStep._fields)) * STRIDE
KNOWN_R, KNOWN_V, LEVELS = (
    (FIRST_FREE + 32 + len(CwStep._fields) + row) * STRIDE for row in range(3)
)
ROWS = FIRST_FREE + 35 + len(CwStep._fields)


class Navigation(NamedTuple):
    """Errors of navigation.

    biases : (40, 6) [m, m/s]; noise : (2,) 1 sigma [m], [m/s]; keys : (2, 40) of the noise
    """

    biases: Any
    noise: Any
    keys: Any


class Fates(NamedTuple):
    """Faults of messages as the kernels read them: thresholds of words of 32 bits, and ticks."""

    state_loss: int
    state_delay: int
    force_loss: int
    force_delay: int
    late_by: int
    stale_after: int


@inlined
def hits(tick: int, k0: int, k1: int, faults: Fates) -> tuple[bool, bool, bool, bool]:
    """Whether state `tick` is lost, late, and the force that answers it is lost, late.

    Philox4x32-10 of (key of the run, tick): runs and ticks can be flown in any order.
    """
    a, b, c, d = philox(tick, 2, 0, 0, k0, k1)
    return (
        a < faults.state_loss,
        b < faults.state_delay,
        c < faults.force_loss,
        d < faults.force_delay,
    )


@inlined
def lateness(tick: int, k0: int, k1: int, faults: Fates) -> int:
    """Ticks from state `tick` to the force that answers it; LOST if there is none."""
    lost, late, force_lost, force_late = hits(tick, k0, k1, faults)
    return LOST if lost or force_lost else faults.late_by * (late + force_late)


class Link(NamedTuple):
    """Messages lost or late between plant and controller, and pending answers.

    faults : `Fates`; keys : (2, 40)
    past, lateness : (2 late + 1, 120), (2 late + 1, 40) the last answers, and how late they are
    latest, held : (40,), (120,) tick of the latest answer that has arrived, and the answer
    """

    faults: Any
    keys: Any
    past: Any
    lateness: Any
    latest: Any
    held: Any


class Thrusters(NamedTuple):
    """Delays and errors of thrusters.

    delays : (40,) ticks; matrix : (40, 9), applied force = matrix x saturated command
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


class Goal(NamedTuple):
    """A goal away from the target, as `rpo_core.control.controller_file.FollowStage` flies to it.

    position, force : (2 P + Q,) lanes x..., y..., z...: the goal [m], and the force [N] on top of
        the command
    """

    position: Any
    force: Any


class Firing(NamedTuple):
    """Thrusters that fire in pulses, or spend propellant without: `rpo_core.kernels.pulse_kernels`.

    shared : `Valves`, what is the same in all runs; None without pulses
    directions, failures : (40, valves, 3), (40, n, 5) of each run, with its matrix
    tanks : (40, 3) exhaust velocity, content, mass; memory : (40, MEMORY); on : (valves,) scratch
    """

    shared: Any
    directions: Any
    failures: Any
    tanks: Any
    memory: Any
    on: Any


class Orbits(NamedTuple):
    """True dynamics (`rpo_core.kernels.orbit_kernels`).

    shared : `World`, what is the same in all runs
    table : flat rows of 40 lanes, see `worlds`: targets, what differs from run to run, orbits
    starts : (6, 40) inertial states of the targets [m, m/s]
    steps : of a tick, each `step` [s] long
    """

    shared: Any
    table: Any
    starts: Any
    steps: int
    step: float


class Estimators(NamedTuple):
    """Sensors and filters (`rpo_nav`); the last axis of a table is that of 40 runs.

    shared : (sensors, columns) the sensors of the first run, for what is the same in all runs
    true, told : (sensors, columns, 40) sensors as they are, and as the filter takes them
    outages : (sensors, 2 m); keys : (2, 40)
    walk, queue : (sensors, 3, 40), (sensors, slots, 7, 40) memory of the sensors
    n, gates, limit, patience, newest, delay : of the filter; delay : (40,)
    steps, force : fields of CwStep, the force of a tick [N]; rows of 40, flat
    rows : (rows, 40) of `navigation`: what the filters are told and remember, and scratch
    compensate : whether the command opposes the disturbance that is estimated
    commands : (slots, 3, 40) [N]; rejected : (40,) so many measurements in a row
    """

    shared: Any
    true: Any
    told: Any
    outages: Any
    keys: Any
    walk: Any
    queue: Any
    n: int
    gates: Any
    limit: float
    patience: int
    newest: int
    delay: Any
    steps: Any
    force: Any
    rows: Any
    commands: Any
    rejected: Any
    compensate: bool


class Guiding(NamedTuple):
    """References of plans without holds (`rpo_guidance`).

    table : (ticks + 1, 9, 40) state [m, m/s] and force [N] of each tick
    last : (40,) tick from which on the last leg is flown; port : (7,) numbers of `at_port` after
        the position; docked : (40,) memory
    """

    table: Any
    last: Any
    port: Any
    docked: Any


class Assured(NamedTuple):
    """Runtime assurance (`rpo_safety`).

    tables : (40, 58) step and guard; modes : (40,) at the start; delays : (40,) ticks
    line, numbers : (40, longest delay, 3), (40, 13) memory
    """

    tables: Any
    modes: Any
    delays: Any
    line: Any
    numbers: Any


class Runs(NamedTuple):
    """Runs that fly side by side; all parts from `navigation` on may be None.

    planar : (P, 4) starts x, y, vx, vy [m, m/s]; vertical : (Q, 2) starts z, vz
    table : (ticks, 2 P + Q) disturbance [N], lanes x..., y..., z...; or (1, ...), always the same
    steps : (40, 26) fields of CwStep, where they are not the plant's
    goal : None: the target
    valves : in place of the matrix of the thrusters; paired runs only
    orbits : in place of `steps`; paired runs only
    estimators : in place of `navigation`, which must be there too; paired runs only
    guiding : in place of the goal; assured; both of paired runs that have `navigation`
    """

    planar: Any
    vertical: Any
    navigation: Any = None
    link: Any = None
    thrusters: Any = None
    table: Any = None
    waves: Any = None
    steps: Any = None
    goal: Any = None
    valves: Any = None
    orbits: Any = None
    estimators: Any = None
    guiding: Any = None
    assured: Any = None


class Control(NamedTuple):
    """A controller, one of these.

    fuzzy : `lanes.Law`, which acts axis by axis
    baseline : BaselineLaw, for paired runs; axes : one that treats all axes alike
    """

    fuzzy: Any = None
    baseline: Any = None
    axes: Any = None


class Plant(NamedTuple):
    """Shared by all runs: largest force of an axis [N], tick [s], CwStep or None."""

    limit: float
    dt: float
    step: Any = None


@compiled
def place(w, runs):  # type: ignore[no-untyped-def]
    """Put runs at their starts, without pending answers or commands."""
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
    _place_goal(w, runs.goal)


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
def _place_goal(w, goal):  # type: ignore[no-untyped-def]
    if goal is None:
        return
    for s in range(len(goal.position)):
        w[GOAL + s] = goal.position[s]
        w[HOLDING + s] = goal.force[s]
