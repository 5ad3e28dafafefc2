# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What a proof is widened by for rounding, in rational numbers.

Each term is by far the largest one in some draws, with either sign; then the widening of a bound is
its share of that term. Surfaces are planes, or flat but for one cell, which a set just reaches.
"""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from proofs import problem_of

from rpo.proof import check_sets, enclosure, slew, tube
from rpo.proof.check_sets import UNIT, exact
from rpo.proof.enclosure import TINY
from rpo.proof.slew import Drift, Strip
from rpo.proof.tube import ROUND

NEAR = Fraction(1, 20)
"""A widening may differ by so much from that of the sizes of all terms."""

FAR = 2.0**20
SIDES = pytest.mark.parametrize('side', [-1.0, 1.0])


def drawn(rng, *shape, least=-6.0, most=2.0):
    """Return numbers of either sign and of any size, half of them zero."""
    size = 10.0 ** rng.uniform(least, most, shape)
    return size * rng.choice([-1.0, 0.0, 0.0, 1.0], shape)


def surface(e=(-FAR, FAR), w=(-FAR, FAR), u=None, limit=1e30, scales=(4.0, 0.25, 0.5)):
    """Return a table of few cells; its slopes are not known, its bends and its slack are none."""
    m, n = len(e) - 1, len(w) - 1
    return problem_of('allround').table._replace(
        e=np.array(e), w=np.array(w), u=np.zeros((m + 1, n + 1)) if u is None else u,
        bend=np.zeros((m, n)), slopes=np.tile([-1e300, 1e300], (m, n, 2)),
        division=np.full((m, n), -1, np.int32), part_range=np.empty((0, 1, 1, 2)),
        part_slopes=np.empty((0, 1, 1, 4)), slack=0.0, limit=limit,
        position_m=scales[0], velocity_m_s=scales[1], force_n=scales[2],
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


def test_the_drift_of_a_tick_is_widened_by_a_share_of_all_its_terms():
    """From a double integrator on, where but rounding is left, to motions of any other kind."""
    rng, tiny = np.random.default_rng(4), 8 * Fraction(TINY)
    for number in range(80):
        p = 1 + number % 2
        n, axis, dt = 2 * p, int(rng.integers(p)), 0.125
        a, b = np.eye(n), np.zeros((n, p))
        for i in range(p):
            a[i, p + i], b[i, i], b[p + i, i] = dt, dt * dt / 2, dt
        if number % 3:
            a, b = a + dt * drawn(rng, n, n, most=0.0), b + dt * drawn(rng, n, p, most=0.0)
        low, f0 = drawn(rng, n), drawn(rng, p)
        high, f1, other = low + abs(drawn(rng, n)), f0 + abs(drawn(rng, p)), abs(float(drawn(rng)))
        found = slew.drift_of(a, b, axis, dt, low, high, f0, f1, other)
        assert (found.dt_s, found.push) == (dt, b[p + axis, axis] / dt)
        step, v, beside = Fraction(dt), p + axis, Fraction(other)
        bend = least = most = room = Fraction(0)
        for i in range(n):
            size, rows = largest(low[i], high[i]), (Fraction(a[axis, i]), Fraction(a[v, i]))
            turn = (rows[0] - (i == axis)) / step - (rows[1] + (i == v)) / 2
            ends = [(rows[1] - (i == v)) / step * Fraction(x) for x in (low[i], high[i])]
            bend, least, most = bend + abs(turn) * size, least + min(ends), most + max(ends)
            room += tiny * size
        fast_room = room / step
        for i in range(p):
            size, rows = largest(f0[i], f1[i]), (Fraction(b[axis, i]), Fraction(b[v, i]))
            bend += abs(rows[0] / step - rows[1] / 2) * (size + beside)
            room += tiny * (size + beside)
            outside = abs(rows[1]) / step * (beside + (i != axis) * size)
            least, most = least - outside, most + outside
            fast_room += tiny * abs(rows[1]) / step * (size + beside)
        assert is_near(Fraction(found.bend_m_s) - bend, room)
        assert is_near(Fraction(found.high) - most, fast_room, most)
        assert is_near(least - Fraction(found.low), fast_room, least)


def test_a_coupling_adds_to_a_drift_no_less_than_it_is():
    rng, tiny = np.random.default_rng(5), Fraction(TINY)
    for _ in range(80):
        far, fast = drawn(rng, 2).tolist()
        half_m, half = abs(drawn(rng, 2)).tolist()
        found = slew.coupled_drift(Drift(0.0, 0.0, 0.0, 0.25, 0.125), far, half_m, fast, half)
        r, v, wide_m, wide, dt = exact([abs(far), fast, half_m, half, 0.125])
        bend, room = (r + wide_m) / dt + (abs(v) + wide) / 2, tiny * (abs(v) + wide) / dt
        assert is_near(Fraction(found.bend_m_s) - bend, tiny * bend)
        assert is_near(Fraction(found.high) - (v + wide) / dt, room)
        assert is_near((v - wide) / dt - Fraction(found.low), room)
        assert (found.push, found.dt_s) == (0.25, 0.125)


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


@SIDES
def test_a_slew_is_rounded_outward_where_all_else_is_exact(side):
    """Of a state whose position error alone changes, and of an output that is nearly known."""
    table, speed = surface()._replace(slack=2.0**-20), 2**15
    table.slopes[:], table.bend[:] = (1.0, 1.0, 0.0, 0.0), 1e9
    still, state = Drift(0.0, 0.0, 0.0, 0.0, 0.125), Strip(0.0, side * speed, 0.0, 0.0, 0.0)
    exactly = (Fraction(speed, 4) + 16 * Fraction(2.0**-20)) / 2
    bound = Fraction(slew.slew_of(table, still, state, -1.0, 1.0, 0.0))
    assert is_near(bound - exactly, 2 * Fraction(TINY) * exactly)


@SIDES
@pytest.mark.parametrize(
    ('e', 'w', 'half_e', 'tilt', 'by'),
    [
        (0.0, 0.0, 0.0, 0.0, 'e'), (3000.0, 0.0, 0.0, 0.0, 'e'), (-3000.0, 1.0, 2.0, 0.0, 'e'),
        (0.0, 0.0, 0.0, 0.0, 'w'), (0.0, -3000.0, 0.0, 0.0, 'w'), (0.0, 3000.0, 0.0, 0.0, 'w'),
        (3000.0, 0.0, 0.0, -2.0, 'w'), (-3000.0, 0.0, 0.0, 2.0, 'w'), (0.0, 0.0, 3e3, -2.0, 'w'),
    ],
)  # fmt: skip
def test_a_slew_looks_at_cells_as_far_as_rounding_goes(side, e, w, half_e, tilt, by):
    """The surface is flat but for the cells beyond an edge, which it reaches, or just does not."""
    scales, dt = (4.0, 0.25, 0.5), 0.125
    strip = Strip(-e * 4.0, -w * 0.25, half_e * 4.0, tilt * 0.25 / 4.0, 0.0)
    drift = Drift(0.0, 2.0**-20, 2.0**-20, 0.0, dt)
    change_v, tilted = Fraction(dt) * Fraction(2.0**-20), abs(exact(strip.tilt))
    change_r = Fraction(dt) * (abs(exact(strip.v)) + tilted * exact(strip.half_m) + change_v)
    ends = exact(half_e) + change_r / 4, (change_v + tilted * change_r) * 4
    room = exact(TINY) * (1 + abs(exact(e)))
    if by == 'w':
        across = exact(TINY) * (1 + abs(exact(w)) + abs(exact(tilt)) * (abs(exact(e)) + ends[0]))
        ends, room = (0, ends[1] + abs(exact(tilt)) * (ends[0] + room)), across
    place = exact(w if by == 'w' else e)
    for share, reached in ((0.9, True), (1.1, False)):
        edge = float(place + exact(side) * (ends[by == 'w'] + exact(share) * room))
        edges = {'e': (-FAR, FAR), 'w': (-FAR, FAR), by: (-FAR, edge, FAR)}
        table = surface(**edges, scales=scales)
        table.slopes[:] = 0.0
        beyond = -1 if side > 0.0 else 0
        (table.slopes[:, beyond] if by == 'w' else table.slopes[beyond])[..., 1::2] = 1.0
        bound = slew.slew_of(table, drift, strip, -1.0, 1.0, np.inf)
        assert (bound > 0.0) == reached
        if side * place >= 0:
            table = surface(**{by: (-abs(edge), abs(edge))}, scales=scales)
            assert (slew.slew_of(table, drift, strip, -1.0, 1.0, np.inf) == 1e300) == reached


@SIDES
@pytest.mark.parametrize(
    ('e', 'w', 'half_e', 'tilt', 'half_w', 'by'),
    [
        (3000.0, 0.0, 0.0, 0.0, 0.0, 'e'), (-3000.0, 1.0, 2.0, 0.0, 1.0, 'e'),
        (0.0, -3000.0, 0.0, 0.0, 0.0, 'w'), (0.0, 3000.0, 0.0, 0.0, 1.0, 'w'),
        (0.0, 0.0, 0.0, 0.0, 3000.0, 'w'), (3000.0, 0.0, 0.0, -2.0, 0.0, 'w'),
        (-3000.0, 0.0, 0.0, 2.0, 0.0, 'w'), (0.0, 0.0, 3e3, -2.0, 0.0, 'w'),
    ],
)  # fmt: skip
def test_a_law_holds_on_cells_as_far_as_rounding_goes(side, e, w, half_e, tilt, half_w, by):
    """The surface is flat; cells beyond an edge are bent, which it reaches, or just does not."""
    scales = (4.0, 0.25, 0.5)
    ends = exact(half_e), exact(half_w)
    room = exact(TINY) * abs(exact(e) + exact(side) * ends[0])
    if by == 'w':
        sizes = abs(exact(w)) + 2 * abs(exact(tilt)) * ends[0] + abs(exact(tilt * e)) + ends[1]
        tilted = abs(exact(tilt))
        ends, room = (0, ends[1] + tilted * ends[0]), exact(TINY) * sizes
        room += tilted * exact(TINY) * (abs(exact(e)) + exact(half_e))
    place = exact(w if by == 'w' else e)
    for share, reached in ((0.9, True), (1.1, False)):
        edge = float(place + exact(side) * (ends[by == 'w'] + exact(share) * room))
        edges = {'e': (-FAR, FAR), 'w': (-FAR, FAR), by: (-FAR, edge, FAR)}
        table = surface(**edges, scales=scales)
        beyond = -1 if side > 0.0 else 0
        (table.bend[:, beyond] if by == 'w' else table.bend[beyond])[...] = 1.0
        strip = (-(e + half_e) * 4.0, -(e - half_e) * 4.0, -w * 0.25, tilt * 0.25 / 4.0)
        law = enclosure.law_of(table, *strip, half_w * 0.25)
        assert (law.rho > 0.1) == reached and law.rho >= 0.0
        if side * place >= 0:
            table = surface(**{by: (-abs(edge), abs(edge))}, scales=scales)
            assert (enclosure.law_of(table, *strip, half_w * 0.25).rho < 0.0) == reached


def test_a_law_of_errors_is_widened_by_a_share_of_all_its_terms():
    rng = np.random.default_rng(8)
    for _ in range(80):
        a, b, c = drawn(rng, 3).tolist()
        rho, e, w, slack = abs(drawn(rng, 4)).tolist()
        law = enclosure._physical(surface()._replace(slack=slack), a, b, c, rho, e, w)
        assert law[:3] == (-0.5 * a / 4.0, -0.5 * b / 0.25, 0.5 * c)
        along, across = abs(exact(a)) * exact(e), abs(exact(b)) * exact(w)
        room = 1 + 2 * (along + across + exact(rho)) + abs(exact(c))
        held = exact(rho) + exact(slack)
        assert is_near(2 * exact(law.rho) - held, exact(TINY) * room, held)


def test_halves_of_a_part_overlap_by_a_share_of_its_terms():
    rng, tiny = np.random.default_rng(9), Fraction(TINY)
    for number in range(40):
        part = Strip(*drawn(rng, 2).tolist(), abs(float(drawn(rng))), float(drawn(rng)),
                     abs(float(drawn(rng))))  # fmt: skip
        made = [slew.half_of(part, bool(number % 2), side) for side in (-1.0, 1.0)]
        assert check_sets.is_covered(part, made)
        r, v, half_m, tilt, half = map(abs, exact(list(part)))
        for one in made:
            assert one.tilt == part.tilt
            whole = (half_m / 2, half) if number % 2 else (half_m, half / 2)
            rooms = tiny * (r + half_m), tiny * (v + half + tilt * (r + half_m))
            assert is_near(exact(one.half_m) - whole[0], rooms[0], whole[0])
            assert is_near(exact(one.half) - whole[1], rooms[1], whole[1])


@SIDES
def test_a_part_is_empty_where_its_law_says_so_but_for_rounding(side):
    """The forces of the tube begin a little before the end of those of the part, or after it."""
    rng, drift, found = np.random.default_rng(10), Drift(0.0, 1.0, 1.0, 0.0, 0.125), []
    for _ in range(60):
        table = plane(rng)
        part = Strip(*drawn(rng, 2).tolist(), abs(float(drawn(rng))), float(drawn(rng)),
                     abs(float(drawn(rng))))  # fmt: skip
        law = enclosure.law_of(table, part.r - part.half_m, part.r + part.half_m, part.v,
                               part.tilt, part.half)  # fmt: skip
        k_r, k_v, k_0, rho = exact(list(law))
        r, v, half_m, tilt, half = exact(list(part))
        middle = k_0 + k_r * r + k_v * v
        spread = rho + abs(k_r + k_v * tilt) * half_m + abs(k_v) * half
        size = abs(k_0) + abs(k_r) * (abs(r) + half_m)
        size += abs(k_v) * (abs(v) + half + abs(tilt) * half_m) + spread
        for share, some in ((0.9, True), (1.1, False)):
            force = float(middle + exact(side) * (spread + exact(share * TINY) * size))
            ends = (force, 1e30) if side > 0.0 else (-1e30, force)
            bound = slew._bound_of_part(table, drift, part, *ends, np.inf)
            found.append((bound > 0.0) == some)
    assert all(found)


@SIDES
@pytest.mark.parametrize('sign', [-1.0, 1.0])
@pytest.mark.parametrize('by', ['e', 'w'])
def test_parts_of_a_divided_cell_are_looked_at_as_far_as_rounding_goes(by, sign, side):
    """A cell is steep in one of its halves; a state beside that half is near it, or just not."""
    ends = sorted((sign * 2048.0, sign * 4096.0))
    edges = {'e': (-FAR, FAR), 'w': (-FAR, FAR), by: (-FAR, *ends, FAR)}
    slopes, steep = np.zeros((1, 2, 2, 4)), int(side < 0.0)
    (slopes[:, steep] if by == 'e' else slopes[:, :, steep])[..., 1] = 1.0
    table = surface(**edges)._replace(
        division=np.zeros((3, 3), np.int32), part_slopes=slopes,
        part_range=np.tile([-1.0, 1.0], (1, 2, 2, 1)),
    )  # fmt: skip
    still, reach = Drift(0.0, 0.0, 0.0, 0.0, 0.125), slew.Reach(-1e9, 1e9, 1.0, 1e3)
    for share, reached in ((0.9, True), (1.1, False)):
        at = sign * 3072.0 + side * share * TINY * abs(ends[int(side > 0.0)])
        e, w = (at, 1.0) if by == 'e' else (1.0, at)
        path = slew.Path(e, w, 0.0, 0.0, 0.0)
        i, j = (1, 0) if by == 'e' else (0, 1)
        assert (slew._rate_of_parts(table, still, i, j, path, reach, 0.0) > 0.0) == reached
