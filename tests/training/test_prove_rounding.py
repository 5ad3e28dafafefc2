# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What a proof is widened by for rounding, in rational numbers.

Each term is by far the largest one in some draws, with either sign; then the widening of a bound is
its share of that term. Surfaces are planes.
"""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from proofs import problem_of

from rpo.proof import check_sets, tube
from rpo.proof.check_sets import UNIT, exact
from rpo.proof.tube import ROUND

NEAR = Fraction(1, 20)
"""A widening may differ by so much from that of the sizes of all terms."""

FAR = 2.0**20
SIDES = pytest.mark.parametrize('side', [-1.0, 1.0])


def drawn(rng, *shape, least=-6.0, most=2.0):
    """Return numbers of either sign and of any size, half of them zero."""
    size = 10.0 ** rng.uniform(least, most, shape)
    return size * rng.choice([-1.0, 0.0, 0.0, 1.0], shape)


def surface(e=(-FAR, FAR), u=None, limit=1e30):
    """Return a table of few cells; its slopes are not known, its bends and its slack are none."""
    w, m, n = (-FAR, FAR), len(e) - 1, 1
    return problem_of('allround').table._replace(
        e=np.array(e), w=np.array(w), u=np.zeros((m + 1, n + 1)) if u is None else u,
        bend=np.zeros((m, n)), slopes=np.tile([-1e300, 1e300], (m, n, 2)),
        division=np.full((m, n), -1, np.int32), part_range=np.empty((0, 1, 1, 2)),
        part_slopes=np.empty((0, 1, 1, 4)), slack=0.0, limit=limit,
        position_m=4.0, velocity_m_s=0.25, force_n=0.5,
    )  # fmt: skip


def is_near(found, size, rounded=0):
    """Whether a widening is of a size, but for what the bound itself may be rounded by."""
    return abs(found - size) <= NEAR * size + 8 * UNIT * abs(rounded)


def largest(low, high):
    return max(abs(Fraction(low)), abs(Fraction(high)))


def moved_by(rng, p):
    """Return any motion of a tick, and a set of 9 generators."""
    n, q = 2 * p, int(rng.integers(3))
    share = float(rng.choice([0.0, 0.05, 0.5])) if q else 0.0
    motion = tube.Motion(
        drawn(rng, n, n, most=0.0), drawn(rng, n, p, most=0.0), 0.1, drawn(rng, 1, p),
        drawn(rng, 1, q, p), share, abs(float(drawn(rng))), drawn(rng, 1, n),
        abs(drawn(rng, 1, n)),
    )  # fmt: skip
    g = np.zeros((n, tube.MOST + 4 * n))
    g[:, :9] = drawn(rng, n, 9, most=0.0) * 10.0 ** rng.uniform(-9.0, 0.0)
    return motion, tube.Zonotope(drawn(rng, n), g, abs(drawn(rng, n, least=-12.0, most=-9.0)))


def plane(rng):
    """Return the table of a plane with any level and slopes."""
    level, along, across = drawn(rng, 3)
    return surface(u=level + FAR * np.array([[-along - across, across - along],
                                             [along - across, along + across]]))  # fmt: skip


@pytest.mark.parametrize('p', [1, 2])
def test_a_tick_is_widened_by_a_share_of_all_its_terms(p):
    """Its set, which holds the exact image too; its strips; its forces, up to the limit."""
    rng, whole = np.random.default_rng(3), Fraction(ROUND)
    for _ in range(80):
        motion, moving = moved_by(rng, p)
        c, g, d = moving
        n, m, table, trace = 2 * p, 9, plane(rng), tube.Trace.empty(1, 2 * p, 0)
        low, high, laws = trace.low[0], trace.high[0], trace.laws[0]
        least, most = trace.force_low[0], trace.force_high[0]
        before = check_sets.Tick(0, c.copy(), g[:, :m].copy(), d.copy(), laws)
        tube.box_of(moving, m, low, high)
        assert tube.step(table, motion, 0, moving, m, trace, 0) == m + p
        after = check_sets.Tick(1, c, g[:, : m + p], d, laws)
        assert not list(check_sets.step_faults(motion, before, after, ''))
        states = [largest(*ends) for ends in zip(low, high, strict=True)]
        c0, g0, d0 = (exact(v.tolist()) for v in (before.c, before.g, before.d))
        a, b, closed = exact(motion.a.tolist()), exact(motion.b.tolist()), exact(motion.a.tolist())
        known, mass, any_n = exact(motion.constant[0].tolist()), *map(exact, motion[5:7])
        carried = exact(motion.carried[0].T.tolist())
        sizes, rho, pulls = [], [], []
        for i in range(p):
            k_r, k_v, k_0, law_rho, tilt, half = exact(laws[i].tolist())
            rows, rests = list(zip(g0[i], g0[p + i], strict=True)), (d0[i], d0[p + i])
            across = rests[1] + abs(tilt) * rests[0]
            terms = across + sum(abs(y) + abs(tilt * x) for x, y in rows) + abs(c0[p + i])
            across += sum(abs(y - tilt * x) for x, y in rows)
            assert is_near(half - across, whole * terms)
            command = k_0 + k_r * c0[i] + k_v * c0[p + i]
            spread = law_rho + abs(k_r) * rests[0] + abs(k_v) * rests[1]
            spread += sum(abs(k_r * x + k_v * y) for x, y in rows)
            sizes.append(abs(k_0) + abs(k_r) * states[i] + abs(k_v) * states[p + i])
            room = whole * (sizes[i] + spread)
            assert is_near(Fraction(most[i]) - command - spread, room)
            assert is_near(command - spread - Fraction(least[i]), room)
            others = sum(map(abs, carried[i])) + any_n
            rho.append(law_rho + any_n + mass * (spread + others))
            pulls.append(mass * (command + known[i]))
            for k in range(n):
                closed[k][i] += b[k][i] * k_r
                closed[k][p + i] += b[k][i] * k_v
        for k in range(n):
            held = Fraction(motion.coupling_half[0, k])
            held += sum(abs(x) * y for x, y in zip(closed[k], d0, strict=True))
            terms = held + abs(Fraction(motion.coupling[0, k]))
            terms += sum(abs(x) * y for x, y in zip(a[k], states, strict=True))
            for i in range(p):
                force = sizes[i] + abs(known[i]) + rho[i] + abs(pulls[i])
                terms += abs(b[k][i]) * (force + sum(map(abs, carried[i])))
            assert is_near(Fraction(d[k]) - held, whole * terms)


@pytest.mark.parametrize(
    ('table', 'widest', 'until', 'most_m'),
    [({}, 0.5, 9, 9.0), ({}, 9.0, 0, 0.5), ({'e': (-0.1, 0.1)}, 9.0, 9, 9.0)],
)
def test_a_set_that_is_given_up_is_in_no_invariant_set(table, widest, until, most_m):
    """Too wide, too far from the target when it must hold, or beyond the table."""
    motion = tube.Motion(np.eye(2), np.zeros((2, 1)), 0.1, np.zeros((9, 1)), np.zeros((9, 0, 1)),
                         0.0, 0.0, np.zeros((9, 2)), np.zeros((9, 2)))  # fmt: skip
    g = np.zeros((2, tube.MOST + 8))
    g[0, 0] = 1.0
    omega, still = tube.InvariantSet(9.0, 1.0, 9.0), tube.Zonotope(np.zeros(2), g, np.zeros(2))
    ends = omega, until, np.full(2, widest), most_m
    found = tube.fly(surface(**table), motion, still, 1, *ends, tube.Trace.empty(9, 2, 0))
    assert found[:2] == (0, -1)


@SIDES
def test_forces_of_a_tick_are_within_the_limit(side):
    table, trace = surface(u=np.full((2, 2), side), limit=0.75), tube.Trace.empty(1, 2, 0)
    motion = tube.Motion(np.eye(2), np.ones((2, 1)), 0.1, np.zeros((1, 1)), np.zeros((1, 0, 1)),
                         0.0, 0.0, np.zeros((1, 2)), np.zeros((1, 2)))  # fmt: skip
    still = tube.Zonotope(np.zeros(2), np.zeros((2, tube.MOST + 8)), np.zeros(2))
    tube.step(table, motion, 0, still, 0, trace, 0)
    least, most = float(trace.force_low[0, 0]), float(trace.force_high[0, 0])
    limited, beyond = (most, least) if side > 0.0 else (least, most)
    assert limited == side * 0.375 and abs(beyond) == pytest.approx(0.5)


def test_the_slew_of_a_tick_holds_all_forces_beside_the_command():
    """Of a plane, whose slew is known: it is that of an end of everything that may differ."""
    rng, dt = np.random.default_rng(6), 2.0**-16
    a, b = np.array([[1.0, dt], [0.0, 1.0]]), np.array([[dt * dt / 2], [dt]]) / 8.0
    for _ in range(60):
        along, across = abs(drawn(rng, 2, least=-2.0)).tolist()
        across += 1e-3
        table = surface()
        table.slopes[:], table.bend[:] = (along, along, across, across), 1e9
        carried, known, any_n = drawn(rng, 1, 2, 1), drawn(rng, 1, 1), abs(float(drawn(rng)))
        mass, f0 = float(rng.choice([0.0, 0.1, 30.0])), float(drawn(rng))
        f1 = f0 + abs(float(drawn(rng)))
        pushed, wide = dt * drawn(rng, 1, 2, most=1.0), dt * abs(drawn(rng, 1, 2, most=1.0))
        motion = tube.Motion(a, b, dt, known, carried, mass, any_n, pushed, wide)
        r, v, tilt = drawn(rng, 3).tolist()
        half_m, half = abs(drawn(rng, 2, most=0.0)).tolist()
        laws, ends = np.array([[[0.0, 0.0, 0.0, 0.0, tilt, half]]]), abs(tilt) * half_m + half
        trace = tube.Trace(
            np.array([[r - half_m, v - ends]]), np.array([[r + half_m, v + ends]]),
            np.array([[f0]]), np.array([[f1]]), np.full((1, 1), np.nan), laws, np.zeros(4),
        )  # fmt: skip
        tube.fill_slew(table, motion, trace, 1, np.inf)
        beside = any_n + abs(carried).sum()
        beside += mass * (beside + max(abs(f0), abs(f1)) + abs(known[0, 0]))
        middle, room = (pushed[0] + b[:, 0] * known[0, 0]) / dt, wide[0] / dt
        bend = abs(middle[0]) + room[0] + 0.5 * dt * (abs(middle[1]) + room[1])
        rates = []
        for sign, force in ((-1.0, f0), (1.0, f1)):
            fast = sign * middle[1] + room[1] + (beside + sign * force) / 8.0
            far = sign * v + ends + bend
            rates.append(along * far / table.position_m + across * fast / table.velocity_m_s)
        need = max(*rates, 0.0) * table.force_n
        assert need <= trace.slew[0, 0] <= 1.02 * need
