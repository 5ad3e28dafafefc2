# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Runs under hostile commands: what the world may do is drawn within the proof's bounds.

The stages of a flight are those of the chain: assurance, thrusters, motion. Before them stands one
that knows the state wrongly, commands and pushes. What has flown is looked at between the ticks.

A run is a function of its key. Random words are Philox4x32-10 of (tick, purpose, key).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from math import sqrt
from typing import Annotated, Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from rpo_core.assurance.assurance import AssuranceStage, assure_tick
from rpo_core.assurance.guard import attitude_rad, proof_of
from rpo_core.assurance.kernels import (
    APPROACH,
    OPEN,
    approach_margins,
    closing,
    in_corridor,
    open_margins,
    speed_limit,
)
from rpo_core.assurance.settings import Assurance
from rpo_core.attitude.attitude_kernels import FRAME, Frame, frame_at, moving_with, seen_from
from rpo_core.attitude.target import Motion
from rpo_core.chain.chain import Chain
from rpo_core.chain.driver import Driver
from rpo_core.files.validation import InputError
from rpo_core.kernels.arithmetic import State, Vector
from rpo_core.kernels.arrays import Floats
from rpo_core.kernels.jit import step_kernel, unlocked
from rpo_core.kernels.noise import philox
from rpo_core.kernels.records import as_rows
from rpo_core.scenario.scenario import Scenario
from rpo_core.stage import KernelStage, Place
from rpo_core.thrusters.thrusters import Thrusters
from rpo_core.wire import interfaces
from rpo_core.wire.interfaces import Interface
from rpo_core.world import cw
from rpo_core.world.cw import cw_step
from rpo_core.world.disturbance import NONE

KINDS = (
    'random', 'bang-bang', 'towards the target', 'frozen', 'late', 'sideways', 'not finite', 'away',
)  # fmt: skip
RANDOM, BANG_BANG, TOWARDS, FROZEN, LATE, SIDEWAYS, NOT_FINITE, AWAY = range(len(KINDS))

OWN = -1
"""Kind of a run whose commands are those of its controller."""

START, KIND, _, PUSH, SEEN, WANT = range(10, 16)
"""Purposes of random words."""

PARTS = 8
"""Moments of a tick at which the path is looked at, its end included."""

NEAR_M = 0.5
"""So near to the zone, and to the edge of the domain, the path is looked at between ticks."""

MOST_LATE = 30

# Columns of the results.
VIOLATED, INFEASIBLE, TOO_FAST, ACTED, CONTACTS, LEAST_FREE, OUTSIDE, HARD = range(8)
COLUMNS = 8

CONSTRAINT = interfaces.add(
    Interface('assurance_constraint', '', 'constraint that acted', logged=False, numbers=1)
).name

SIGNALS = (
    interfaces.RELATIVE_STATE, interfaces.THRUST_FORCE, interfaces.DISTURBANCE_FORCE, CONSTRAINT,
)  # fmt: skip
"""What is kept of a flight."""


@unlocked
def unit(word: int) -> float:
    """Return a word of 32 bits as a number in (0, 1)."""
    return (word + 0.5) * 2.3283064365386963e-10


@unlocked
def direction(tick: int, purpose: int, k0: int, k1: int) -> tuple[float, float, float, float]:
    """Return a random direction, from a point in the unit ball, and one more number in (0, 1)."""
    for turn in range(16):
        a, b, c, d = philox(tick, purpose, turn, 0, k0, k1)
        x, y, z = 2.0 * unit(a) - 1.0, 2.0 * unit(b) - 1.0, 2.0 * unit(c) - 1.0
        square = x * x + y * y + z * z
        if 0.01 < square <= 1.0:
            size = sqrt(square)
            return x / size, y / size, z / size, unit(d)
    return 1.0, 0.0, 0.0, 0.5


# What a hostile world does in flight.


@dataclass(slots=True)
class Hostile:
    """Settings of the kernels `intercept` and `surround`.

    kind : of the commands; OWN: there are none
    limit_n : of the thrusters on an axis
    key : random words of the run
    since : tick from which the commands come
    position_m, velocity_m_s, push_n : largest norms of the errors and the disturbance
    """

    kind: int
    limit_n: float
    key: Annotated[list[int], 2]
    since: int = 0
    position_m: float = 0.0
    velocity_m_s: float = 0.0
    push_n: float = 0.0


@dataclass(slots=True)
class Commanded:
    """Memory of these kernels: the command before, and those of the last ticks."""

    held_n: Annotated[list[float], 3]
    past_n: Annotated[list[list[float]], MOST_LATE, 3]


@step_kernel
def wanted(kind: int, tick: int, k0: int, k1: int, state: State, held: Vector, limit: float):  # type: ignore[no-untyped-def]
    """Return the hostile command [N] of a tick; `held` is the one before."""
    x, y, z, vx, vy, vz = state
    a, b, c, d = philox(tick, WANT, 0, 0, k0, k1)
    if kind == RANDOM:
        s = 3.0 * limit
        return s * (2.0 * unit(a) - 1.0), s * (2.0 * unit(b) - 1.0), s * (2.0 * unit(c) - 1.0)
    if kind == BANG_BANG:
        if tick % 16 and unit(d) > 0.02:
            return held
        return (
            limit if a & 1 else -limit,
            limit if b & 1 else -limit,
            limit if c & 1 else -limit,
        )
    if kind == FROZEN:
        return held if tick else (
            limit * (4.0 * unit(a) - 2.0), limit * (4.0 * unit(b) - 2.0),
            limit * (4.0 * unit(c) - 2.0),
        )  # fmt: skip
    if kind == NOT_FINITE and unit(d) < 0.3:
        return (math.nan, held[1], held[2]) if a & 1 else (held[0], math.inf, held[2])
    rho, closes, _ = closing(state)
    rho = rho if rho > 0.0 else 1.0
    k = (1.8 if kind == AWAY else -1.8) * limit / rho
    if kind == SIDEWAYS:  # faster and faster round the target, and towards it
        tx, ty, tz = vx + closes * x / rho, vy + closes * y / rho, vz + closes * z / rho
        size = sqrt(tx * tx + ty * ty + tz * tz) + 1e-9
        s = 1.8 * limit / size
        return 0.3 * k * x + s * tx, 0.3 * k * y + s * ty, 0.3 * k * z + s * tz
    return k * x, k * y, k * z


@step_kernel
def command(tick: int, state: State, p: Any, m: Any) -> Vector:
    """Return the hostile command [N] of a tick since they began, late where it is of that kind."""
    held, limit = m.held_n, p.limit_n
    last = (held[0], held[1], held[2])
    force = wanted(p.kind, tick, p.key[0], p.key[1], state, last, limit)
    held[0], held[1], held[2] = force
    if p.kind == NOT_FINITE:
        held[0], held[1], held[2] = 0.5 * limit, -limit, limit
    if p.kind == LATE:
        now, old = m.past_n[tick % MOST_LATE], m.past_n[(tick + 1) % MOST_LATE]
        now[0], now[1], now[2] = force
        force = (old[0], old[1], old[2])
    return force


@step_kernel
def intercept(tick: int, u: Any, p: Any, m: Any, y: Any) -> None:
    """Replace a command u[6:9] [N] to a state u[:6] [m, m/s] by a hostile one y (3,)."""
    force = (u[6], u[7], u[8])
    if p.kind != OWN and tick >= p.since:
        force = command(tick - p.since, (u[0], u[1], u[2], u[3], u[4], u[5]), p, m)
    y[0], y[1], y[2] = force


@step_kernel
def surround(tick: int, u: Any, p: Any, m: Any, y: Any) -> None:
    """From a true state u (6,) to what is known of it, the command and the disturbance, y (12,).

    Known is x + (e_r b_r, e_v b_v), the disturbance e_d b_d, with unit vectors b that stay in a
    run, change each tick, or are the worst: from or to the target. All in target LVLH [m, m/s, N].
    """
    k0, k1 = p.key[0], p.key[1]
    rho, share = closing((u[0], u[1], u[2], u[3], u[4], u[5]))[0], 1.0
    chosen = unit(philox(3, KIND, 0, 0, k0, k1)[0])
    if chosen < 0.33 and rho > 0.0:
        ux, uy, uz = u[0] / rho, u[1] / rho, u[2] / rho
        wx, wy, wz = ux, uy, uz
    elif chosen < 0.66:
        ux, uy, uz, share = direction(tick, SEEN, k0, k1)
        wx, wy, wz, _ = direction(tick, SEEN + 100, k0, k1)
    else:
        ux, uy, uz, _ = direction(2, SEEN, k0, k1)
        wx, wy, wz = uy, uz, ux
    er, ev = share * p.position_m, share * p.velocity_m_s
    y[0], y[1], y[2] = u[0] + er * ux, u[1] + er * uy, u[2] + er * uz
    y[3], y[4], y[5] = u[3] + ev * wx, u[4] + ev * wy, u[5] + ev * wz
    y[6], y[7], y[8] = command(tick, (y[0], y[1], y[2], y[3], y[4], y[5]), p, m)
    dx, dy, dz, chosen = direction(4, PUSH, k0, k1)
    if chosen < 0.33 and rho > 0.0:
        dx, dy, dz = -u[0] / rho, -u[1] / rho, -u[2] / rho
    elif chosen < 0.66:
        dx, dy, dz, _ = direction(tick, PUSH, k0, k1)
    y[9], y[10], y[11] = p.push_n * dx, p.push_n * dy, p.push_n * dz


class Interceptor(KernelStage):
    """Replaces the command of the controller from a tick on."""

    name = 'interceptor'
    inputs: tuple[str, ...] = (interfaces.STATE, interfaces.COMMAND)
    outputs: tuple[str, ...] = (interfaces.CONTROL_FORCE,)
    memory_ticks = None
    kernel = intercept

    def __init__(self, p: Hostile) -> None:
        super().__init__(p, Commanded([0.0] * 3, [[0.0] * 3 for _ in range(MOST_LATE)]))


class Surroundings(Interceptor):
    """Knows the state wrongly, commands and pushes."""

    name = 'surroundings'
    inputs = (interfaces.RELATIVE_STATE,)
    outputs = (
        interfaces.NAVIGATION_STATE,
        interfaces.CONTROL_FORCE,
        interfaces.DISTURBANCE_FORCE,
    )
    kernel = surround


@step_kernel
def assure_and_report(tick: int, u: Any, p: Any, m: Any, y: Any) -> int:
    """Step assurance, `assure_tick`; y (4,) ends with the constraint that acted."""
    asked: int = assure_tick(tick, u, p, m, y)
    y[3] = m.acted
    return asked


class Defender(AssuranceStage):
    """Assurance of a scenario, as its proof is without an estimator's spread and an abort table.

    mode : in which a flight begins
    """

    outputs = (interfaces.ASSURED_FORCE, CONSTRAINT)  # type: ignore[assignment]
    kernel = assure_and_report
    mode = OPEN

    def __init__(self, settings: Assurance, scenario: Scenario) -> None:
        super().__init__(replace(settings, abort=None, sigmas=0.0), scenario)
        self.proof = proof_of(settings, scenario)
        self.p.guard, self.p.step = self.proof.guard, scenario.step
        self.p.walls = self.proof.walls or self.proof.guard

    def reset(self) -> None:
        """Begin a flight in the mode that was drawn."""
        super().reset()
        self.m.mode = self.mode


# Where runs start.


class World(NamedTuple):
    """What starts keep and what has flown is judged by.

    delay : ticks to the force
    zone_m, domain_m, width_m, slope, contact_m_s, lateral_m_s : as the file has them
    floor_m_s : speed below which the limit is not kept for certain
    reach_m : starts are up to so far outside the zone
    drift_m, drift_m_s : what the disturbance does before the first force arrives
    """

    delay: int
    zone_m: float
    domain_m: float
    width_m: float
    slope: float
    contact_m_s: float
    lateral_m_s: float
    floor_m_s: float
    reach_m: float
    drift_m: float
    drift_m_s: float


@unlocked
def seen_at(state, frames, i):  # type: ignore[no-untyped-def]
    """Return a state in the corridor's axes: of frames (n, 15) the i-th, of none those of LVLH."""
    return state if len(frames) == 0 else seen_from(state, frame_at(frames[i]))


@unlocked
def in_lvlh(state, frames, i):  # type: ignore[no-untyped-def]
    """Return a state of the corridor's axes in LVLH: the inverse of `seen_at`."""
    return state if len(frames) == 0 else moving_with(state, frame_at(frames[i]))


@unlocked
def may_start(state, c, g, world):  # type: ignore[no-untyped-def]
    """Whether a state is in the OPEN set, now and when the first force arrives."""
    if open_margins(state, 0.0, 0.0, g)[0] < 0.0:
        return False
    for _ in range(world.delay):
        state = cw_step(state, (0.0, 0.0, 0.0), c)
        rho = closing(state)[0]
        if rho - world.drift_m < g.keep_out_m or rho + world.drift_m > g.domain_m:
            return False
    a, b = open_margins(state, world.drift_m, world.drift_m_s, g)
    return a >= 0.0 and b >= 0.0


@unlocked
def on_axis(a, b, c, axis):  # type: ignore[no-untyped-def]
    """Return a vector that has a on an axis, b and c on those that follow it."""
    if axis == 0:
        return a, b, c
    return (c, a, b) if axis == 1 else (b, c, a)


@unlocked
def start_of(k0, k1, c, g, world):  # type: ignore[no-untyped-def]
    """Return a state of the OPEN set, half of the runs at the edge of it."""
    ex, ey, ez, far = direction(0, START, k0, k1)
    vx, vy, vz, fast = direction(1, START, k0, k1)
    if g.side != 0.0 and k1 % 5 == 0:  # behind the target, in line with the corridor
        along, off = -g.side, 0.02 * far * g.width_m / g.keep_out_m
        ex = along if g.axis == 0 else off * ex
        ey = along if g.axis == 1 else off * ey
        ez = along if g.axis == 2 else off * ez
        vx, vy, vz = on_axis(-along, 0.0, 0.0, g.axis)
    rho = g.keep_out_m + 2.0 * world.drift_m + 1e-6 + far * far * world.reach_m
    if k1 % 3 == 0:  # at the edge of the domain instead of that of the zone
        rho = g.domain_m - 2.0 * world.drift_m - 1e-6 - far * far * world.reach_m
    speed = speed_limit(rho, g) * (0.999999 if fast > 0.5 else 2.0 * fast)
    state = (rho * ex, rho * ey, rho * ez, speed * vx, speed * vy, speed * vz)
    lowest, highest = 0.0, 1.0
    if may_start(state, c, g, world):
        return state
    for _ in range(40):  # the fastest of this direction that can still stop
        k = 0.5 * (lowest + highest)
        state = (rho * ex, rho * ey, rho * ez, k * speed * vx, k * speed * vy, k * speed * vz)
        if may_start(state, c, g, world):
            lowest = k
        else:
            highest = k
    k = lowest
    if k == 0.0:  # not even at rest: in the middle between both edges
        rho = 0.5 * (g.keep_out_m + g.domain_m)
    return rho * ex, rho * ey, rho * ez, k * speed * vx, k * speed * vy, k * speed * vz


@unlocked
def start_within(k0, k1, c, g, world, frames, at):  # type: ignore[no-untyped-def]
    """Return a state of the APPROACH set; at rest on the axis if none was drawn.

    g, at : numbers of the corridor, and place of the axes at the start
    """
    reach = g.outer_m - g.port_m
    for turn in range(100):
        a, b, d, _ = philox(turn, START, 1, 0, k0, k1)
        far = 0.02 + unit(a) * unit(a) * 0.9 * reach
        half = g.width_m + g.slope * far
        p, q = half * (2.0 * unit(b) - 1.0), half * (2.0 * unit(d) - 1.0)
        vx, vy, vz, fast = direction(turn, START + 100, k0, k1)
        s = fast * speed_limit(far + g.port_m, g)
        x, y, z = on_axis(g.side * (far + g.port_m), p, q, g.axis)
        state = (x, y, z, s * vx, s * vy, s * vz)
        if approach_margins(state, 0.0, 0.0, g)[0] < 0.0:
            continue
        state = after = in_lvlh(state, frames, at)
        for _ in range(world.delay):
            after = cw_step(after, (0.0, 0.0, 0.0), c)
        after = seen_at(after, frames, at + PARTS * world.delay)
        room, slower = approach_margins(after, world.drift_m, world.drift_m_s, g)
        if room >= 0.0 and slower >= 0.0:
            return state
    x, y, z = on_axis(g.side * (g.port_m + 0.5 * reach), 0.0, 0.0, g.axis)
    return in_lvlh((x, y, z, 0.0, 0.0, 0.0), frames, at)


# What has flown.


@unlocked
def watch(states, forces, acted, fine, g, w, frames, at, true, world, row):  # type: ignore[no-untyped-def]
    """Count what became of a run, up to a contact.

    states, forces, acted : (n + 1, 6), (n + 1, 3) all that moves the chaser [N], (n + 1, 1)
    fine : CW step of a `PARTS`th of a tick
    g, w : numbers of the filter, those of the corridor where it turns (else again `g`)
    frames, at : its axes at each `PARTS`th of a tick, (0, 15) where it does not turn; the first one
    true : (15,) true axes of the target, against those that are known
    """
    row[LEAST_FREE] = 1e30
    for tick in range(len(states) - 1):
        s, f, e = states[tick], forces[tick], states[tick + 1]
        state, now = (s[0], s[1], s[2], s[3], s[4], s[5]), at + PARTS * tick
        row[ACTED] += acted[tick, 0] > 2
        if look(state, (f[0], f[1], f[2]), fine, g, world, frames, now, true, row):
            row[CONTACTS] = 1.0
            return
        if tick >= world.delay:  # no force has arrived before
            state = (e[0], e[1], e[2], e[3], e[4], e[5])
            judge(state, seen_at(state, frames, now + PARTS), g, w, world, row)


@unlocked
def look(state, force, fine, g, world, frames, at, true, row):  # type: ignore[no-untyped-def]
    """Look for zone and edge along the path of a tick; return whether it comes to the port."""
    rho, _, speed = closing(state)
    moved = NEAR_M + 2.0 * speed * g.dt_s
    if world.zone_m + moved < rho < world.domain_m - moved:
        return False
    entered = outside = False
    axes = frame_at(true)  # turned against those that are known
    seen = seen_from(seen_at(state, frames, at), axes)
    for part in range(PARTS):
        state = cw_step(state, force, fine)
        before, seen = seen, seen_from(seen_at(state, frames, at + part + 1), axes)
        rho = closing(state)[0]
        clear = rho - world.zone_m
        if g.side != 0.0:
            d, _, p, q, _, _ = in_corridor(seen, g)
            half = world.width_m + world.slope * (d if d > 0.0 else 0.0)
            side = half - (abs(p) if abs(p) > abs(q) else abs(q))
            clear = side if side > clear and d > 0.0 else clear
            if d <= 0.0 and side >= 0.0 and in_corridor(before, g)[0] > 0.0:
                touch(before, seen, g, world, row)
                return True
        row[LEAST_FREE] = clear if clear < row[LEAST_FREE] else row[LEAST_FREE]
        entered = entered or clear < 0.0
        outside = outside or rho > world.domain_m
    row[VIOLATED] += entered
    row[OUTSIDE] += outside
    return False


@unlocked
def touch(before, after, g, world, row):  # type: ignore[no-untyped-def]
    """Count a contact between two states that is faster than the port allows."""
    d, w, _, _, vp, vq = in_corridor(before, g)
    end, faster, _, _, up, uq = in_corridor(after, g)
    share = d / (d - end)
    closes = w + share * (faster - w) - world.contact_m_s
    p, q = abs(vp + share * (up - vp)), abs(vq + share * (uq - vq))
    across = (p if p > q else q) - world.lateral_m_s
    worst = closes if closes > across else across
    row[HARD] += worst > 1e-6


@unlocked
def judge(state, seen, g, w, world, row):  # type: ignore[no-untyped-def]
    """Count a true state outside the assured set: there the backup law may not be enough."""
    a, b = open_margins(state, 0.0, 0.0, g)
    if g.side != 0.0:
        p, _ = approach_margins(seen, 0.0, 0.0, w)
        if p >= 0.0 or (a < 0.0 and p > a):  # its speeds are looked at when it touches
            a, b = p, 1e30
    row[INFEASIBLE] += a < 0.0
    speed = closing(state)[2]
    row[TOO_FAST] += b < 0.0 and speed > world.floor_m_s


REACH_M = 60.0
"""Starts are up to so far outside the zone."""

_CHUNK = 1000


@dataclass(frozen=True)
class Result:
    """What became of the runs of one kind of command.

    rows : (n, COLUMNS), from `VIOLATED` to `HARD`
    """

    kind: str
    rows: Floats

    def total(self, column: int) -> int:
        """Return the sum of a column that counts."""
        return int(self.rows[:, column].sum())

    def least(self, column: int) -> float:
        """Return the smallest value of a column; infinite if there was none."""
        smallest = float(self.rows[:, column].min()) if len(self.rows) else math.inf
        return smallest if smallest < 1e29 else math.inf


def settings_of(scenario: Scenario) -> Assurance:
    """Return the section `assurance`; raises InputError if there is none, or no zone in it."""
    settings = scenario.section(Assurance)
    if settings is None or settings.keep_out_m <= 0.0:
        raise InputError(
            f'scenario {scenario.name} must have a section `assurance` with `keep_out_m` to be '
            'attacked'
        )
    return settings


def world_of(scenario: Scenario) -> World:
    """Return what starts keep in a scenario, and what its runs are judged by."""
    settings = settings_of(scenario)
    proof, way = proof_of(settings, scenario), settings.corridor
    delay = scenario.thrusters.delay_ticks if scenario.thrusters else 0
    wait, pushed = delay * scenario.dt_s, 1.01 * proof.errors.disturbance_n / scenario.mass_kg
    zone_m, domain_m = settings.keep_out_m, settings.domain_m
    reach_m, drift_m = min(REACH_M, 0.9 * (domain_m - zone_m)), 0.5 * pushed * wait * wait
    walls: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    if way is not None:
        walls = way.width_m, way.slope, way.closing_m_s, way.lateral_m_s
    return World(
        delay, zone_m, domain_m, *walls, proof.floor_m_s, reach_m, drift_m, pushed * wait
    )  # fmt: skip


class Arena:
    """A scenario as its runs are attacked: what assurance, thrusters and motion make of a world."""

    def __init__(self, scenario: Scenario, ticks: int) -> None:
        settings = settings_of(scenario)
        self.world, self.defender = world_of(scenario), Defender(settings, scenario)
        guard, errors, _, walls = self.defender.proof
        self.guard, self.walls, self.ticks = guard, walls or guard, ticks
        self.thrust_error, self.lean_rad = errors.thrust, 0.0
        self.frames = np.empty((0, FRAME))
        if walls is not None:
            self.ticks = min(ticks, scenario.ticks)
            self.lean_rad = attitude_rad(settings, scenario)
            target, orbit = scenario.target.known, scenario.mean_motion_rad_s
            motion = Motion(target.body(orbit), target.start(orbit), scenario.dt_s / PARTS)
            self.frames = motion.frames(PARTS * (scenario.ticks + self.world.delay + 2))
        n, mass_kg, dt_s = scenario.mean_motion_rad_s, scenario.mass_kg, scenario.dt_s
        self.step, self.fine = scenario.step, cw.discretise(n, mass_kg, dt_s / PARTS)
        bounds = errors.position_m, errors.velocity_m_s, errors.disturbance_n
        self.hostile = Surroundings(Hostile(OWN, guard.limit_n, [0, 0], 0, *bounds))
        thrusters = Thrusters(delay_ticks=self.world.delay)
        bare = replace(scenario, sections=(thrusters,), disturbance=NONE, requirements=None)
        stages = (Place.SENSOR, self.hostile), (Place.ASSURANCE, self.defender)
        self.driver = Driver(Chain.of(bare, None, stages), SIGNALS)
        links = self.driver.chain.links
        self.thrusters: Any = next(x.stage for x in links if x.place is Place.THRUSTERS)

    def fly(self, kind: int, key: list[int], thrust: Floats, true: Floats, row: Floats) -> None:
        """Fly a run of a key; what became of it goes to `row`.

        thrust : (9,) force exerted = matrix x command; true : axes of the target, see `watch`
        """
        frames, world, at, (k0, k1) = self.frames, self.world, 0, key
        mode = APPROACH if self.guard.side != 0.0 and k0 % 2 else OPEN
        if len(frames):  # any time of the flight
            at = PARTS * ((k0 ^ k1) % (len(frames) // PARTS - self.ticks - world.delay))
            axes = frames[at::PARTS][: self.ticks + world.delay + 2]
            self.defender.p.frames = as_rows(axes, Frame)
        if mode == APPROACH:
            start = start_within(k0, k1, self.step, self.walls, world, frames, at)
        else:
            start = start_of(k0, k1, self.step, self.guard, world)
        self.defender.mode, self.thrusters.p.matrix = mode, thrust.tolist()
        self.hostile.p.kind, self.hostile.p.key = kind, key
        flown = self.driver.fly({interfaces.RELATIVE_STATE: start}, self.ticks)
        states, thrust_n, push_n, acted = (flown[name] for name in SIGNALS)
        walls = self.guard, self.walls
        watch(states, thrust_n + push_n, acted, self.fine, *walls, frames, at, true, world, row)


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
    arena = Arena(scenario, ticks)
    kinds = np.arange(runs) % len(KINDS)
    rows = np.zeros((runs, COLUMNS))
    for first in range(0, runs, _CHUNK):
        random = np.random.default_rng([seed, first])
        count = min(_CHUNK, runs - first)
        keys = random.integers(0, 2**32, (count, 2)).tolist()
        off = random.uniform(-1.0, 1.0, (count, 9))
        off *= arena.thrust_error / np.linalg.norm(off, axis=1, keepdims=True)
        true = np.zeros((count, FRAME))
        true[:, :9] = np.eye(3).ravel()
        if arena.lean_rad > 0.0:
            axis = random.normal(size=(count, 3))
            axis *= arena.lean_rad / np.linalg.norm(axis, axis=1, keepdims=True)
            true[:, :9] = Rotation.from_rotvec(axis).as_matrix().reshape(-1, 9)
        for i in range(count):
            run, thrust = first + i, np.eye(3).ravel() + off[i]
            arena.fly(int(kinds[run]), keys[i], thrust, true[i], rows[run])
            advance(run + 1)
    return [Result(name, rows[kinds == i]) for i, name in enumerate(KINDS)]
