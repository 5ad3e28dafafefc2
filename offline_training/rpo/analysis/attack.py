# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Runs under hostile commands, compiled: what the world may do is drawn within the proof's bounds.

A run is a function of its key. Random words are Philox4x32-10 of (tick, purpose, key).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from math import sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from rpo.engine.lanes import compiled
from rpo_core.assurance.filters import assure, assure_turning
from rpo_core.assurance.guard import Proof, attitude_rad, proof_of
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
from rpo_core.attitude.attitude_kernels import FRAME, frame_at, moving_with, seen_from
from rpo_core.attitude.target import Motion
from rpo_core.files.validation import InputError
from rpo_core.kernels.noise import philox
from rpo_core.scenario.scenario import Scenario
from rpo_core.thrusters.pulse_kernels import exerted_force
from rpo_core.world import cw
from rpo_core.world.cw import cw_step, unpacked

KINDS = (
    'random', 'bang-bang', 'towards the target', 'frozen', 'late', 'sideways', 'not finite', 'away',
)  # fmt: skip
RANDOM, BANG_BANG, TOWARDS, FROZEN, LATE, SIDEWAYS, NOT_FINITE, AWAY = range(len(KINDS))

START, KIND, WORLD, PUSH, SEEN, WANT, SWITCH = range(10, 17)
"""Purposes of random words."""

PARTS = 8
"""Moments of a tick at which the path is looked at, its end included."""

NEAR_M = 0.5
"""So near to the zone, and to the edge of the domain, the path is looked at between ticks."""

LONGEST_DELAY = 64
MOST_LATE = 30

# Columns of the results.
VIOLATED, INFEASIBLE, TOO_FAST, ACTED, CONTACTS, LEAST_FREE, OUTSIDE, HARD = range(8)
COLUMNS = 8


class Bounds(NamedTuple):
    """What the world may do, the bounds of the proof.

    position_m, velocity_m_s, push_n : largest norms of the errors and the disturbance
    delay : ticks to the force
    zone_m, domain_m, width_m, contact_m_s, lateral_m_s : as the file has them
    floor_m_s : speed below which the limit is not kept for certain
    reach_m : starts are up to so far outside the zone
    drift_m, drift_m_s : what the disturbance does before the first force arrives
    slope : of the corridor's walls, as the file has it
    """

    position_m: float
    velocity_m_s: float
    push_n: float
    delay: int
    zone_m: float
    domain_m: float
    width_m: float
    contact_m_s: float
    lateral_m_s: float
    floor_m_s: float
    reach_m: float
    drift_m: float
    drift_m_s: float
    slope: float


@compiled
def seen_at(state, frames, i):  # type: ignore[no-untyped-def]
    """Return a state in the corridor's axes: of frames (n, 15) the i-th, of none those of LVLH."""
    return state if len(frames) == 0 else seen_from(state, frame_at(frames[i], 0))


@compiled
def unit(word: int) -> float:
    """Return a word of 32 bits as a number in (0, 1)."""
    return (word + 0.5) * 2.3283064365386963e-10


@compiled
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


@compiled
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


@compiled
def on_axis(a, b, c, axis):  # type: ignore[no-untyped-def]
    """Return a vector that has a on an axis, b and c on those that follow it."""
    if axis == 0:
        return a, b, c
    return (c, a, b) if axis == 1 else (b, c, a)


@compiled
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


@compiled
def in_lvlh(state, frames, i):  # type: ignore[no-untyped-def]
    """Return a state of the corridor's axes in LVLH: the inverse of `seen_at`."""
    return state if len(frames) == 0 else moving_with(state, frame_at(frames[i], 0))


@compiled
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


@compiled
def wanted(behaviour, tick, k0, k1, state, held, limit):  # type: ignore[no-untyped-def]
    """Return the hostile command [N] of a tick; `held` is the one before."""
    x, y, z, vx, vy, vz = state
    a, b, c, d = philox(tick, WANT, 0, 0, k0, k1)
    if behaviour == RANDOM:
        s = 3.0 * limit
        return s * (2.0 * unit(a) - 1.0), s * (2.0 * unit(b) - 1.0), s * (2.0 * unit(c) - 1.0)
    if behaviour == BANG_BANG:
        if tick % 16 and unit(d) > 0.02:
            return held
        return (
            limit if a & 1 else -limit,
            limit if b & 1 else -limit,
            limit if c & 1 else -limit,
        )
    if behaviour == FROZEN:
        return held if tick else (
            limit * (4.0 * unit(a) - 2.0), limit * (4.0 * unit(b) - 2.0),
            limit * (4.0 * unit(c) - 2.0),
        )  # fmt: skip
    if behaviour == NOT_FINITE and unit(d) < 0.3:
        return (np.nan, held[1], held[2]) if a & 1 else (held[0], np.inf, held[2])
    rho, closes, _ = closing(state)
    rho = rho if rho > 0.0 else 1.0
    k = (1.8 if behaviour == AWAY else -1.8) * limit / rho
    if behaviour == SIDEWAYS:  # faster and faster round the target, and towards it
        tx, ty, tz = vx + closes * x / rho, vy + closes * y / rho, vz + closes * z / rho
        size = sqrt(tx * tx + ty * ty + tz * tz) + 1e-9
        s = 1.8 * limit / size
        return 0.3 * k * x + s * tx, 0.3 * k * y + s * ty, 0.3 * k * z + s * tz
    return k * x, k * y, k * z


@compiled
def fly_hostile(k0, k1, behaviour, ticks, c, fine, g, w, frames, world, drawn, row):  # type: ignore[no-untyped-def]
    """Fly one run; its results go to `row`.

    c, fine : CW step of a tick, and of a `PARTS`th of it
    g, w, frames : numbers of the filter, those of the corridor where it turns (else again `g`), and
        its axes at each `PARTS`th of a tick; (0, 15) where it does not
    drawn : (24,) force exerted = matrix (9,) x saturated command; true axes of the target (15,),
        against those that are known
    """
    at = 0
    if len(frames) > 0:  # any time of the flight
        at = PARTS * ((k0 ^ k1) % (len(frames) // PARTS - ticks - world.delay))
    mode = APPROACH if g.side != 0.0 and k0 % 2 else OPEN
    state = start_of(k0, k1, c, g, world)
    if mode == APPROACH:
        state = start_within(k0, k1, c, w, world, frames, at)
    bx, by, bz, _ = direction(2, SEEN, k0, k1)
    constant = unit(philox(3, KIND, 0, 0, k0, k1)[0])
    px, py, pz, strong = direction(4, PUSH, k0, k1)
    line = np.zeros((LONGEST_DELAY, 3))
    past = np.zeros((MOST_LATE, 3))
    last, held = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    row[LEAST_FREE] = 1e30
    m = drawn
    for tick in range(ticks):
        x, y, z, vx, vy, vz = state
        rho, _, _ = closing(state)
        # The state as the chaser knows it: the worst direction in a third of the runs.
        ux, uy, uz, wx, wy, wz = bx, by, bz, by, bz, bx
        share = 1.0
        if constant < 0.33 and rho > 0.0:
            ux, uy, uz = x / rho, y / rho, z / rho
            wx, wy, wz = ux, uy, uz
        elif constant < 0.66:
            ux, uy, uz, share = direction(tick, SEEN, k0, k1)
            wx, wy, wz, _ = direction(tick, SEEN + 100, k0, k1)
        er, ev = share * world.position_m, share * world.velocity_m_s
        seen = (x + er * ux, y + er * uy, z + er * uz, vx + ev * wx, vy + ev * wy, vz + ev * wz)
        held = wanted(behaviour, tick, k0, k1, seen, held, g.limit_n)
        command = held
        if behaviour == LATE:
            past[tick % MOST_LATE] = held
            old = past[(tick + 1) % MOST_LATE]
            command = (old[0], old[1], old[2])
        if behaviour == NOT_FINITE:
            held = (0.5 * g.limit_n, -g.limit_n, g.limit_n)
        ahead = seen
        for i in range(world.delay):
            f = line[(tick + i) % world.delay]
            ahead = cw_step(ahead, (f[0], f[1], f[2]), c)
        if len(frames) > 0:
            acts = at + PARTS * world.delay
            now, following = frame_at(frames[acts], 0), frame_at(frames[acts + PARTS], 0)
            answer = assure_turning(ahead, command, last, mode, now, following, c, g, w)
        else:
            answer = assure(ahead, command, last, mode, c, g)
        fx, fy, fz, mode, acted, _, _ = answer
        last = (fx, fy, fz)
        row[ACTED] += acted > 2
        if world.delay:
            f = line[tick % world.delay]
            due = (f[0], f[1], f[2])
            f[0], f[1], f[2] = fx, fy, fz
        else:
            due = last
        tx, ty, tz = exerted_force(
            m[0], m[1], m[2], m[3], m[4], m[5], m[6], m[7], m[8], due[0], due[1], due[2]
        )
        # The force from outside: towards the target in a third of the runs, random, or constant.
        dx, dy, dz, d = px, py, pz, world.push_n
        if strong < 0.33 and rho > 0.0:
            dx, dy, dz = -x / rho, -y / rho, -z / rho
        elif strong < 0.66:
            dx, dy, dz, _ = direction(tick, PUSH, k0, k1)
        total = (tx + d * dx, ty + d * dy, tz + d * dz)
        after = cw_step(state, total, c)
        if look(state, total, rho, fine, g, world, frames, at, m[9:], row):
            row[CONTACTS] = 1.0
            return
        state, at = after, at + PARTS
        if tick >= world.delay:  # no force has arrived before
            judge(state, seen_at(state, frames, at), g, w, world, row)


@compiled
def look(state, total, rho, fine, g, world, frames, at, true, row):  # type: ignore[no-untyped-def]
    """Look for zone and edge along the path of a tick; return whether it comes to the port."""
    moved = NEAR_M + 2.0 * closing(state)[2] * g.dt_s
    if world.zone_m + moved < rho < world.domain_m - moved:
        return False
    entered = outside = False
    axes = frame_at(true, 0)  # turned against those that are known
    seen = seen_from(seen_at(state, frames, at), axes)
    for part in range(PARTS):
        state = cw_step(state, total, fine)
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


@compiled
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


@compiled
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


@compiled
def fly_many(keys, kinds, ticks, step, fine, g, w, frames, world, drawn, rows):  # type: ignore[no-untyped-def]
    """Fly runs one after the other: keys (n, 2), kinds (n,), drawn (n, 24)."""
    c, parts = unpacked(step, 0, 1), unpacked(fine, 0, 1)
    for i in range(len(kinds)):
        k0, k1 = int(keys[i, 0]), int(keys[i, 1])
        fly_hostile(k0, k1, kinds[i], ticks, c, parts, g, w, frames, world, drawn[i], rows[i])


REACH_M = 60.0
"""Starts are up to so far outside the zone."""

_CHUNK = 1000


@dataclass(frozen=True)
class Result:
    """What became of the runs of one kind of command.

    rows : (n, COLUMNS), from `VIOLATED` to `HARD`
    """

    kind: str
    rows: NDArray[np.float64]

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
    settings = settings_of(scenario)
    proof = proof_of(settings, scenario)
    world = _bounds(settings, scenario, proof)
    frames, lean = np.empty((0, FRAME)), 0.0
    if proof.walls is not None:
        ticks, lean = min(ticks, scenario.ticks), attitude_rad(settings, scenario)
        frames = _axes(scenario, world.delay)
    n, mass, dt = scenario.mean_motion_rad_s, scenario.mass_kg, scenario.dt_s
    step, fine = (np.array(cw.discretise(n, mass, t)) for t in (dt, dt / PARTS))
    kinds = np.arange(runs) % len(KINDS)
    rows = np.zeros((runs, COLUMNS))
    for first in range(0, runs, _CHUNK):
        part = slice(first, min(first + _CHUNK, runs))
        random = np.random.default_rng([seed, first])
        count = len(kinds[part])
        keys = random.integers(0, 2**32, (count, 2))
        off = random.uniform(-1.0, 1.0, (count, 9))
        off *= proof.errors.thrust / np.linalg.norm(off, axis=1, keepdims=True)
        drawn = np.zeros((count, 9 + FRAME))
        drawn[:, :9] = np.eye(3).ravel() + off
        drawn[:, 9:18] = np.eye(3).ravel()
        if lean > 0.0:
            axis = random.normal(size=(count, 3))
            axis *= lean / np.linalg.norm(axis, axis=1, keepdims=True)
            drawn[:, 9:18] = Rotation.from_rotvec(axis).as_matrix().reshape(-1, 9)
        numbers = step, fine, proof.guard, proof.walls or proof.guard, frames, world
        fly_many(keys, kinds[part], ticks, *numbers, drawn, rows[part])
        advance(part.stop)
    return [Result(name, rows[kinds == i]) for i, name in enumerate(KINDS)]


def _axes(scenario: Scenario, delay: int) -> NDArray[np.float64]:
    """Return the axes (n, 15) of the target, as they are known, at parts of the ticks."""
    target, orbit = scenario.target.known, scenario.mean_motion_rad_s
    motion = Motion(target.body(orbit), target.start(orbit), scenario.dt_s / PARTS)
    return motion.frames(PARTS * (scenario.ticks + delay + 2))


def _bounds(settings: Assurance, scenario: Any, proof: Proof) -> Bounds:
    delay = scenario.thrusters.delay_ticks if scenario.thrusters else 0
    if delay > LONGEST_DELAY:
        raise InputError(f'`thrusters.delay_ticks` must be <= {LONGEST_DELAY}; got {delay}')
    wait = delay * scenario.dt_s
    way = settings.corridor
    pushed = 1.01 * proof.errors.disturbance_n / scenario.mass_kg
    return Bounds(
        *(proof.errors.position_m, proof.errors.velocity_m_s),
        push_n=proof.errors.disturbance_n,
        delay=delay,
        zone_m=settings.keep_out_m,
        domain_m=settings.domain_m,
        width_m=way.width_m if way else 0.0,
        contact_m_s=way.closing_m_s if way else 0.0,
        lateral_m_s=way.lateral_m_s if way else 0.0,
        floor_m_s=proof.floor_m_s,
        reach_m=min(REACH_M, 0.9 * (settings.domain_m - settings.keep_out_m)),
        drift_m=0.5 * pushed * wait * wait,
        drift_m_s=pushed * wait,
        slope=way.slope if way else 0.0,
    )
