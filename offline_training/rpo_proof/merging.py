# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""An axis alone: its set is moved in strips, and other strips cover them again and again.

In the plane of position and velocity all flights of an axis come to one line, that of the approach.
So the tubes of many starts meet. For a stage of a minute strips are moved, each with a law of its
own at every tick; then, if they have become long, other strips cover all of them. What a set had to
do with the unknown constants is forgotten there, and costs width; the constants themselves stay
those of the cell.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rpo_proof.sets import MOST, ROUND, WORTH_S, Rest, strip_of
from rpo_proof.slew import Strip
from rpo_proof.tables import Table
from rpo_proof.tube import Motion, Trace, fill_slew, fly

Floats = NDArray[np.float64]

STAGE_S = 70.0
"""Strips are moved for so long, before others may cover them."""

LONG = 3.0
"""They are covered if one of them has become so many times as long as strips should be."""

SETTLE_S = 60.0
"""So long before the time of hold they are covered for the last time, for what is forgotten then
has to fade: a strip near the target holds states that rest, each, for other constants."""

DEEPEST = 3
"""Halvings of a strip whose set becomes too wide, at most."""

NEVER = Rest(0.0, 1.0, 0.0)
"""A set of rest that no strip comes to."""


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
                for name in ('constant', 'carried', 'pushed', 'shaken')
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
    n, ticks, carried = 2, len(motion.constant), motion.carried.shape[1]
    trace = Trace(
        np.zeros((ticks + 1, n)),
        np.zeros((ticks + 1, n)),
        np.zeros((ticks, 1)),
        np.zeros((ticks, 1)),
        np.full((ticks, 1), np.inf),
        np.zeros((ticks, 1, 6)),
        np.zeros(n + carried),
    )
    c, g, d, m = set_of(strip, carried)
    widest = np.array(limits.widest)
    last, _, m = fly(table, motion, c, g, d, m, m, NEVER, ticks, widest, np.inf, trace)
    if last < ticks:
        return Moved(strip, trace, None)
    if math.isfinite(limits.slew_n_s):
        fill_slew(table, motion, trace, ticks, limits.slew_n_s)
    return Moved(strip, trace, around(c, g, d, m, trace.low[ticks], trace.high[ticks]))


def set_of(strip: Strip, carried: int) -> tuple[Floats, Floats, Floats, int]:
    """Return a strip as a zonotope: centre, generators, box, number of generators."""
    g = np.zeros((2, MOST + 8))
    g[:, carried] = strip.half_m, strip.tilt * strip.half_m
    g[1, carried + 1] = strip.half
    room = ROUND * abs(strip.tilt) * strip.half_m
    return np.array([strip.r, strip.v]), g, np.array([0.0, room]), carried + 2


def around(c: Floats, g: Floats, d: Floats, m: int, low: Floats, high: Floats) -> Strip:
    """Return a strip that holds a zonotope, whose box is known."""
    tilt, half = strip_of(g, d, m, 0, 1)
    half_m = max(high[0] - c[0], c[0] - low[0]) * (1.0 + ROUND)
    return Strip(float(c[0]), float(c[1]), float(half_m), float(tilt), float(half))


def cover(strips: Sequence[Strip], size: tuple[float, float]) -> list[Strip]:
    """Return strips of about a size that hold all of others: columns in r, each divided in v."""
    every = np.array(strips)
    lows, highs = every[:, 0] - every[:, 2], every[:, 0] + every[:, 2]
    low, high = float(lows.min()), float(highs.max())
    count = max(1, math.ceil((high - low) / (2.0 * size[0]) - 1e-9))
    found: list[Strip] = []
    for left, right in pairwise(np.linspace(low, high, count + 1).tolist()):
        some = every[(lows <= right) & (highs >= left)]
        if len(some):
            found += _column(left, right, some, size[1])
    return found


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
    steep = abs(tilt) + float(np.abs(tilts).max())
    room_m = ROUND * (abs(at) + wide_m)
    room = ROUND * (abs(low) + abs(high)) + steep * room_m
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
