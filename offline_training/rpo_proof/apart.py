# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Each axis alone: cells of the unknown constants of its disturbance, and of mass.

A set that holds every disturbance and mass at once does not contract; a cell that holds some does.
x and y together would have six constants. Alone they have three or four, and what the other axis
does is a push in known bounds:

    x is assumed to stay in a corridor, that of some flights and a margin. Under this y is proven,
    and under what is proven of y, x; and x does stay in the corridor.

So none of the three can fail first: if all hold up to a tick, then they hold at the next. A cell is
(r, v, c_1, ..., c_q), with all starts (r, v) of the axis (`merging`). Each unknown constant is a
share of its range, -1 to 1; the last one is that of the mass, if it may differ, with
1/m = (1 + lightness c_q) / nominal mass.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rpo_core.files.scenario import Scenario
from rpo_core.world import cw
from rpo_core.world.disturbance import Disturbance, Harmonic
from rpo_proof.problem import APART, Problem
from rpo_proof.tube import Motion

Floats = NDArray[np.float64]

ROOM = 2.0**-44
"""Share by which a push is widened for its rounding."""


class Beside(NamedTuple):
    """What is known of the axis that an axis is coupled with.

    states : (2, N+1, 2) least and greatest position and velocity of the other one at each tick;
        None: there is no other
    corridor : the same, of this axis: that a tube must not leave; None: it may
    """

    states: Floats | None
    corridor: Floats | None


ALONE = Beside(None, None)


def coupled(problem: Problem, motion: Motion, group: str, states: Floats) -> Motion:
    """Return a motion that the other axis pushes; its states are in bounds (2, N+1, 2).

    Bounds that are not finite: nothing is known of the push, and of this axis.
    """
    if not np.isfinite(states).all():
        return motion._replace(pushed=np.full_like(motion.pushed, np.nan))
    own, other = APART[group], APART['y' if group == 'x' else 'x']
    a, b = cw.matrices(problem.scenario.step)
    a, b = a[np.ix_(own, other)], b[np.ix_(own, other[:1])][:, 0]
    ticks = len(motion.constant)
    low, high = states[:, :ticks]
    size = np.abs(a) @ np.maximum(np.abs(low), np.abs(high)).T
    strongest = problem.scenario.max_force_n + problem.strongest_n + motion.any_n
    push = np.abs(b) * (1.0 + problem.lightness) * strongest
    half = np.abs(a) @ (0.5 * (high - low)).T + push[:, None]
    shaken = np.ascontiguousarray((half + ROOM * (half + size)).T)
    pushed = np.ascontiguousarray((a @ (0.5 * (low + high)).T).T)
    return motion._replace(pushed=pushed, shaken=shaken)


def ranges(problem: Problem, group: str) -> list[tuple[float, float]]:
    """Return the least and the greatest of each unknown constant of an axis."""
    waves = problem.waves(APART[group][0])
    found = [(-1.0, 1.0)] * sum(2 if isinstance(wave, Harmonic) else 1 for wave in waves)
    share = problem.settings.mass_share
    return [*found, (-(1.0 - share) / (1.0 + share), 1.0)] if share > 0.0 else found


def is_outside(problem: Problem, group: str, centre: Floats, half: Floats) -> bool:
    """Whether no sinusoid of a cell is as weak as asked for: (a, b) is out of the unit circle."""
    at = len(APART[group])
    for wave in problem.waves(APART[group][0]):
        if isinstance(wave, Harmonic):
            least = np.maximum(np.abs(centre[at : at + 2]) - half[at : at + 2], 0.0)
            if float(least @ least) > 1.0 + 1e-9:
                return True
            at += 1
        at += 1
    return False


def motion_of(problem: Problem, motion: Motion, centre: Floats, half: Floats) -> Motion:
    """Return the motion of a cell: the middle of its constants is known, the rest is carried."""
    c, h = centre[len(motion.a) :], half[len(motion.a) :]
    middle = motion.constant + np.einsum('kji,j->ki', motion.carried, c)
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
    axis, share = APART[group][0], problem.settings.disturbance_share
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
    mass = problem.scenario.mass_kg / (1.0 + problem.lightness * left[0]) if left else None
    return replace(
        scenario,
        disturbance=Disturbance((x, y, z), tuple(harmonics)),
        mass_kg=mass or scenario.mass_kg,
    )
