# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Proofs per axis: cells of the unknown constants of an axis, strips that cover its starts.

One set that holds every disturbance and mass does not contract; a cell of a few of them does. x and
y together have six unknown constants, each of them alone three or four. The Coriolis coupling of
the other axis is then a disturbance within known bounds:

    The proof of y assumes that x stays in a corridor: that of some flights, and a margin. The proof
    of x uses the bounds proven for y, and shows that x stays in the corridor.

So if all of this holds up to a tick, it holds at the next one. A cell is (r, v, c_1, ..., c_q),
with all starts (r, v) of the axis. Each unknown constant is a share of its range, -1 to 1; the last
one is that of the mass, if it may differ, with 1/m = (1 + inverse_mass_share c_q) / nominal mass.

Trajectories from different starts soon merge, so one tube can cover many starts. Strips of states
move for a stage of a minute, each with its own law at every tick. Strips that have become long are
then covered by new strips. Such a cover forgets how the set depended on the unknown constants,
which widens it; the constants themselves stay those of the cell.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from rpo.proof.enclosure import Table
from rpo.proof.problem import PER_AXIS, Problem
from rpo.proof.slew import Strip
from rpo.proof.tube import (
    MOST,
    ROUND,
    WORTH_S,
    InvariantSet,
    Motion,
    Trace,
    Zonotope,
    fill_slew,
    fly,
    strip_of,
)
from rpo_core.kernels.arrays import Floats, contracted
from rpo_core.scenario.scenario import Scenario
from rpo_core.world import cw
from rpo_core.world.disturbance import Disturbance, Harmonic

ROOM = 2.0**-44
"""Share by which the coupling is widened for its rounding."""


class OtherAxis(NamedTuple):
    """What is known of the axis that an axis is coupled with.

    states : (2, N+1, 2) least and greatest position and velocity of the other one at each tick;
        None: there is no other
    corridor : the same, of this axis: that a tube must not leave; None: it may
    """

    states: Floats | None
    corridor: Floats | None


UNCOUPLED = OtherAxis(None, None)


def coupled(problem: Problem, motion: Motion, group: str, states: Floats) -> Motion:
    """Return a motion with the coupling of the other axis, whose states are in bounds (2, N+1, 2).

    Bounds that are not finite: nothing is known of the coupling, and of this axis.
    """
    if not np.isfinite(states).all():
        return motion._replace(coupling=np.full_like(motion.coupling, np.nan))
    own, other = PER_AXIS[group], PER_AXIS['y' if group == 'x' else 'x']
    a, b = cw.matrices(problem.scenario.step)
    a, b = a[np.ix_(own, other)], b[np.ix_(own, other[:1])][:, 0]
    ticks = len(motion.constant)
    low, high = states[:, :ticks]
    size = np.abs(a) @ np.maximum(np.abs(low), np.abs(high)).T
    strongest = problem.scenario.max_force_n + problem.strongest_n + motion.any_n
    force = np.abs(b) * (1.0 + problem.inverse_mass_share) * strongest
    half = np.abs(a) @ (0.5 * (high - low)).T + force[:, None]
    coupling_half = np.ascontiguousarray((half + ROOM * (half + size)).T)
    coupling = np.ascontiguousarray((a @ (0.5 * (low + high)).T).T)
    return motion._replace(coupling=coupling, coupling_half=coupling_half)


def ranges(problem: Problem, group: str) -> list[tuple[float, float]]:
    """Return the least and the greatest of each unknown constant of an axis."""
    waves = problem.waves(PER_AXIS[group][0])
    bounds = [(-1.0, 1.0)] * sum(2 if isinstance(wave, Harmonic) else 1 for wave in waves)
    share = problem.settings.mass_share
    return [*bounds, (-(1.0 - share) / (1.0 + share), 1.0)] if share > 0.0 else bounds


def is_outside(problem: Problem, group: str, centre: Floats, half: Floats) -> bool:
    """Whether no sinusoid of a cell is as weak as asked for: (a, b) is out of the unit circle."""
    at = len(PER_AXIS[group])
    for wave in problem.waves(PER_AXIS[group][0]):
        if isinstance(wave, Harmonic):
            nearest = np.maximum(np.abs(centre[at : at + 2]) - half[at : at + 2], 0.0)
            if float(nearest @ nearest) > 1.0 + 1e-9:
                return True
            at += 1
        at += 1
    return False


def motion_of(problem: Problem, motion: Motion, centre: Floats, half: Floats) -> Motion:
    """Return the motion of a cell: the middle of its constants is known."""
    c, h = centre[len(motion.a) :], half[len(motion.a) :]
    middle = motion.constant + contracted('kji,j->ki', motion.carried, c)
    carried = motion.carried * h[:, None]
    if not motion.mass:
        return motion._replace(constant=middle, carried=carried)
    light = 1.0 + motion.mass * float(c[-1])
    return motion._replace(
        b=motion.b * light,
        constant=middle,
        carried=carried,
        mass=motion.mass * float(h[-1]) / light,
    )


def scenario_in(problem: Problem, group: str, constants: Floats, scenario: Scenario) -> Scenario:
    """Return a scenario with the unknown constants of an axis."""
    axis, share = PER_AXIS[group][0], problem.settings.disturbance_share
    left = constants.tolist()
    constant = list(scenario.disturbance.constant_n)
    harmonics = list(scenario.disturbance.harmonics)
    if share > 0.0:
        harmonics = [h for h in harmonics if 'xyz'.index(h.axis) != axis]
    for wave in problem.waves(axis):
        if not isinstance(wave, Harmonic):
            constant[axis] = share * abs(wave) * left.pop(0)
            continue
        a, b = left.pop(0), left.pop(0)
        phase = np.arctan2(a, b) if wave.function == 'sin' else np.arctan2(-b, a)
        size = share * abs(wave.amplitude_n) * float(np.hypot(a, b))
        rate = wave.angular_rate_rad_s
        harmonics.append(Harmonic(wave.axis, wave.function, size, rate, float(phase)))
    x, y, z = constant
    mass = problem.scenario.mass_kg / (1.0 + problem.inverse_mass_share * left[0]) if left else None
    return replace(
        scenario,
        disturbance=Disturbance((x, y, z), tuple(harmonics)),
        mass_kg=mass or scenario.mass_kg,
    )


STAGE_S = 70.0
"""Strips are moved for so long, before others may cover them."""

LONG = 3.0
"""They are covered if one of them has become so many times as long as strips should be."""

SETTLE_S = 60.0
"""So long before the time of hold they are covered for the last time, for what is forgotten then
has to fade: a strip near the target holds the equilibria of all constants."""

DEEPEST = 3
"""Halvings of a strip whose set becomes too wide, at most."""

NEVER = InvariantSet(0.0, 1.0, 0.0)
"""An invariant set that no strip enters."""


class Moved(NamedTuple):
    """A strip, its tube, and a strip that holds its set at the end; None: it did not last."""

    strip: Strip
    trace: Trace
    end: Strip | None


class Stage(NamedTuple):
    """Strips that hold every state at tick `first`, moved."""

    first: int
    moved: list[Moved]

    @property
    def last(self) -> int:
        """The tick at which the stage ends."""
        return self.first + len(self.moved[0].trace.slew)

    @property
    def ends(self) -> list[Strip]:
        """What the strips have become; not all of them where the stage does not last."""
        return [one.end for one in self.moved if one.end is not None]

    @property
    def lasts(self) -> bool:
        """Whether every strip has come to the end."""
        return len(self.ends) == len(self.moved)


class Limits(NamedTuple):
    """Half-widths (2,) of strips [m], [m/s]; those at which a set is given up; slew [N/s]."""

    size: tuple[float, float]
    widest: tuple[float, float]
    slew_n_s: float


def stages(
    table: Table, motion: Motion, start: Strip, hold_tick: int, limits: Limits
) -> Iterator[Stage]:
    """Yield the stages of a flight from a strip; no more after one that does not last.

    Strips are covered anew where one has become long; else they fly on, as they began.
    """
    ticks, every = len(motion.constant), round(STAGE_S / motion.dt)
    merged = range(every, hold_tick - round(SETTLE_S / motion.dt) + 1, every)
    first, strips = 0, cover([start], limits.size)
    for last in [*(tick for tick in merged if tick < ticks), ticks]:
        part = motion._replace(
            **{
                name: getattr(motion, name)[first:last]
                for name in ('constant', 'carried', 'coupling', 'coupling_half')
            }
        )
        stage = Stage(first, list(_moved(table, part, strips, limits)))
        longest = max((end.half_m for end in stage.ends), default=0.0)
        if stage.lasts and last < ticks and longest <= LONG * limits.size[0]:
            continue
        yield stage
        if not stage.lasts:
            return
        first, strips = last, cover(stage.ends, limits.size)


def _moved(
    table: Table, motion: Motion, strips: Sequence[Strip], limits: Limits
) -> Iterator[Moved]:
    """Yield strips that were moved, halved where they are too wide; one that fails is the last."""
    todo = [(strip, 0) for strip in reversed(strips)]
    while todo:
        strip, depth = todo.pop()
        one = moved(table, motion, strip, limits)
        if one.end is None and depth < DEEPEST:
            todo += [(half, depth + 1) for half in reversed(halves(strip))]
            continue
        yield one
        if one.end is None:
            return


def moved(table: Table, motion: Motion, strip: Strip, limits: Limits) -> Moved:
    """Move a strip for all ticks of a motion."""
    ticks, carried = len(motion.constant), motion.carried.shape[1]
    trace = Trace.empty(ticks, 2, carried)
    z, m = set_of(strip, carried)
    widest = np.array(limits.widest)
    last, _, m = fly(table, motion, z, m, NEVER, ticks, widest, np.inf, trace)
    if last < ticks:
        return Moved(strip, trace, None)
    if math.isfinite(limits.slew_n_s):
        fill_slew(table, motion, trace, ticks, limits.slew_n_s)
    return Moved(strip, trace, around(z, m, trace.low[ticks], trace.high[ticks]))


def set_of(strip: Strip, carried: int) -> tuple[Zonotope, int]:
    """Return a strip as a zonotope, and the number of its generators."""
    g = np.zeros((2, MOST + 8))
    g[:, carried] = strip.half_m, strip.tilt * strip.half_m
    g[1, carried + 1] = strip.half
    room = ROUND * abs(strip.tilt) * strip.half_m
    z = Zonotope(np.array([strip.r, strip.v]), g, np.array([0.0, room]))
    return z, carried + 2


def around(z: Zonotope, m: int, low: Floats, high: Floats) -> Strip:
    """Return a strip that holds a zonotope, whose box is known."""
    tilt, half = strip_of(z, m, 0, 1)
    half_m = max(high[0] - z.c[0], z.c[0] - low[0]) * (1.0 + ROUND)
    return Strip(float(z.c[0]), float(z.c[1]), float(half_m), float(tilt), float(half))


def cover(strips: Sequence[Strip], size: tuple[float, float]) -> list[Strip]:
    """Return strips of about a size that hold all of others: columns in r, each divided in v."""
    every = np.array(strips)
    lows, highs = every[:, 0] - every[:, 2], every[:, 0] + every[:, 2]
    low, high = float(lows.min()), float(highs.max())
    count = max(1, math.ceil((high - low) / (2.0 * size[0]) - 1e-9))
    covering: list[Strip] = []
    for left, right in pairwise(np.linspace(low, high, count + 1).tolist()):
        some = every[(lows <= right) & (highs >= left)]
        if len(some):
            covering += _column(left, right, some, size[1])
    return covering


def _column(left: float, right: float, strips: Floats, size_m_s: float) -> Iterator[Strip]:
    """Yield strips that hold all of others (k, 5) from r = left to r = right."""
    r, v, half_m, tilts, half = strips.T
    at, wide_m = 0.5 * (left + right), 0.5 * (right - left)
    ends = np.stack([np.maximum(r - half_m, left), np.minimum(r + half_m, right)])
    middle, away = v + tilts * (ends - r), ends - at
    off = away - away.mean()
    square = float((off**2).sum())
    tilt = float((off * middle).sum()) / square if square > 0.0 else 0.0
    level = middle - tilt * away
    low, high = float((level - half).min()), float((level + half).max())
    count = max(1, math.ceil((high - low) / (2.0 * size_m_s) - 1e-9))
    wide = 0.5 * (high - low) / count
    slope = abs(tilt) + float(np.abs(tilts).max())
    room_m = ROUND * (abs(at) + wide_m)
    room = ROUND * (abs(low) + abs(high)) + slope * room_m
    for k in range(count):
        yield Strip(at, low + (2 * k + 1) * wide, wide_m + room_m, tilt, wide + room)


def halves(strip: Strip) -> tuple[Strip, Strip]:
    """Return both halves of a strip, which overlap by what may be rounded."""
    r, v, half_m, tilt, half = strip
    room_m, room = ROUND * (abs(r) + half_m), ROUND * (abs(v) + abs(tilt) * half_m + half)
    along = half_m > WORTH_S * half
    away, up = (0.5 * half_m, tilt * 0.5 * half_m) if along else (0.0, 0.5 * half)
    new_m, new = (away + room_m, half + room) if along else (half_m, up + room)
    return Strip(r - away, v - up, new_m, tilt, new), Strip(r + away, v + up, new_m, tilt, new)
