# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""No torque gets past the limits of rate, pointing cone and wheels (docs/safety.md, lemma 7)."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from math import radians, sqrt

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rpo_core.attitude.chaser import Craft, chaser_tick, times, unit, unloaded
from rpo_core.attitude.target import body_of
from rpo_core.control.attitude_law_kernels import errors
from rpo_core.control.attitude_limits import (
    LIMITED,
    NONE,
    PASSED,
    AttitudeLimits,
    bounds_of,
    numbers_of,
    within_limits,
)
from rpo_core.files.validation import InputError
from rpo_core.kernels.jit import kernel

TORQUE, MOMENTUM, DT = 0.1, 1.0, 0.1
INERTIA = np.array([[0.9, 0.05, -0.04], [0.05, 1.1, 0.06], [-0.04, 0.06, 1.3]])
LIMITS = AttitudeLimits(
    rate_deg_s=2.0,
    angle_deg=4.0,
    known_deg=0.05,
    known_deg_s=0.01,
    disturbance_nm=0.001,
    reference_deg_s2=0.05,
)
KINDS = 5
BODY = body_of(tuple(map(tuple, INERTIA.tolist())), 0.0)
CRAFT = Craft(BODY, 0.0, TORQUE, MOMENTUM, 0.0, 0.0, 0.0)


def numbers(limits=LIMITS, **changes):
    """Return the numbers of limits."""
    given = {'torque_nm': TORQUE, 'start_nms': 0.12, 'dt_s': DT, 'duration_s': 60.0, **changes}
    full = min(limits.momentum_nms or MOMENTUM, MOMENTUM)
    found = bounds_of(limits, BODY, **given)
    return numbers_of(limits, found, BODY, given['torque_nm'], full, DT)


@kernel
def fly(kind, drawn, start, ref, wheels, noise, push, empties, lim, c, worst):  # type: ignore[no-untyped-def]
    """Fly under hostile torques; fill `worst` with the largest rate, angle and wheel momentum.

    drawn (n, 3) in [-1, 1]; noise (n, 6) of angle and rate; push (n, 3) [N m]; empties : momentum
    above which thrusters empty a wheel, and their torque
    """
    dt, true = lim.dt, start
    before = (ref[4], ref[5], ref[6])
    still = Craft(c.body, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    free = (0.0, 0.0, 0.0)
    for i in range(len(drawn)):
        x, y, z, w, p, q, r = true
        n, d = noise[i], drawn[i]
        tilt = unit((0.5 * n[0], 0.5 * n[1], 0.5 * n[2], 1.0, 0.0, 0.0, 0.0))
        a = times((x, y, z, w), (tilt[0], tilt[1], tilt[2], tilt[3]))
        seen = (a[0], a[1], a[2], a[3], p + n[3], q + n[4], r + n[5])
        e = errors(seen, ref, before, dt)
        if kind == 0:
            wanted = (3.0 * TORQUE * d[0], 3.0 * TORQUE * d[1], 3.0 * TORQUE * d[2])
        elif kind == 1:  # bang-bang
            wanted = (
                TORQUE if d[0] > 0.0 else -TORQUE,
                TORQUE if d[1] > 0.0 else -TORQUE,
                TORQUE if d[2] > 0.0 else -TORQUE,
            )
        elif kind == 2:  # faster and faster
            wanted = (1e3 * p, 1e3 * q, 1e3 * r)
        elif kind == 3:  # to the wall, at full torque
            wanted = (1e3 * e.ex, 1e3 * e.ey, 1e3 * e.ez)
        else:  # constant, one axis
            wanted = (TORQUE * (1.0 + d[0]), -TORQUE, 0.0)
        u, spun = unloaded(wheels, empties[0], empties[1], dt)
        rate, angle = (seen[4], seen[5], seen[6]), (e.ex, e.ey, e.ez)
        against, ahead = (e.wx, e.wy, e.wz), (e.ax, e.ay, e.az)
        tx, ty, tz, _ = within_limits(wanted, rate, angle, against, ahead, spun, lim)
        outside = (push[i, 0] + u[0], push[i, 1] + u[1], push[i, 2] + u[2])
        torque = (tx - u[0], ty - u[1], tz - u[2])
        _, true, wheels = chaser_tick(true, wheels, torque, outside, dt, c)
        before = (ref[4], ref[5], ref[6])
        _, ref, _ = chaser_tick(ref, free, free, free, dt, still)
        e = errors(true, ref, before, dt)
        for v in (true[4], true[5], true[6]):
            worst[0] = max(worst[0], abs(v))
        for v in (e.ex, e.ey, e.ez):
            worst[1] = max(worst[1], abs(v))
        for v in wheels:
            worst[2] = max(worst[2], abs(v))


def worst_of(
    run, limits=LIMITS, ticks=600, excess=1.0, slow=1.0, lim=None, craft=CRAFT, empties=(0.0, 0.0)
):
    """Return largest rate [rad/s], angle [rad] and wheel momentum [N m s] of a hostile flight."""
    random, lim = np.random.default_rng([7, run]), lim or numbers(limits)
    rate = radians(limits.rate_deg_s)
    turn = random.normal(size=3)
    turn *= 0.7 * slow * rate / np.linalg.norm(turn)
    start = (0.0, 0.0, 0.0, 1.0, *turn.tolist())
    bounds = [radians(limits.known_deg)] * 3 + [radians(limits.known_deg_s)] * 3
    noise = np.where(random.uniform(size=(ticks, 6)) < 0.5, -1.0, 1.0) * bounds
    push = np.where(random.uniform(size=(ticks, 3)) < 0.5, -1.0, 1.0) * limits.disturbance_nm
    if run % 2:  # errors and disturbance that stay
        noise[:], push[:] = noise[0], push[0]
    wheels = random.uniform(-1.0, 1.0, 3) * 0.05
    worst, drawn = np.zeros(3), random.uniform(-1.0, 1.0, (ticks, 3))
    fly(run % KINDS, drawn, start, start, tuple(wheels.tolist()), excess * noise, excess * push,
        empties, lim, craft, worst)  # fmt: skip
    return worst


def test_hostile_torques_stay_within_all_limits():
    """Errors and disturbance at the corners of their bounds."""
    found = np.array([worst_of(run) for run in range(100)])
    rate, angle, momentum = found.max(axis=0)
    assert rate <= radians(LIMITS.rate_deg_s)
    assert angle <= radians(LIMITS.angle_deg)
    assert momentum <= MOMENTUM
    # and they are reached: it is not the filter of a chaser that is held still
    assert rate > 0.9 * radians(LIMITS.rate_deg_s) and angle > 0.7 * radians(LIMITS.angle_deg)


def test_no_cone_that_is_accepted_is_left():
    """Of random chasers, ticks and errors: a wall that needs what the other forbids is refused."""
    random, shares = np.random.default_rng(6), []
    for _ in range(1000):
        moments = np.sort(10.0 ** random.uniform(-1.3, 1.0) * random.uniform(0.5, 1.0, 3))
        axes = Rotation.random(random_state=int(random.integers(2**31))).as_matrix()
        inertia = (axes * moments) @ axes.T
        inertia = 0.5 * (inertia + inertia.T)
        dt = float(random.choice([0.05, 0.1, 0.25]))
        limits = AttitudeLimits(
            rate_deg_s=random.uniform(0.3, 6.0), angle_deg=random.uniform(1.0, 15.0),
            known_deg=float(random.choice([0.0, 0.05, 0.3])),
            known_deg_s=float(random.choice([0.0, 0.01, 0.1])),
            disturbance_nm=float(random.choice([0.0, 0.001])), reference_deg_s2=0.0,
        )  # fmt: skip
        body = body_of(tuple(map(tuple, inertia.tolist())), 0.0)
        try:
            found = bounds_of(limits, body, TORQUE, 0.0, dt, 300 * dt)
            lim = numbers_of(limits, found, body, TORQUE, MOMENTUM, dt)
        except InputError:
            continue
        noise = [radians(limits.known_deg)] * 3 + [radians(limits.known_deg_s)] * 3
        for kind in (0, 3, 4):
            worst, rest = np.zeros(3), (0.0, 0.0, 0.0)
            stays = np.where(random.uniform(size=(300, 6)) < 0.5, -1.0, 1.0)[:1].repeat(300, 0)
            still = (*rest, 1.0, *rest)
            fly(kind, random.uniform(-1.0, 1.0, (300, 3)), still, still, rest, stays * noise,
                stays[:, :3] * limits.disturbance_nm, (0.0, 0.0), lim,
                CRAFT._replace(body=body), worst)  # fmt: skip
            shares.append(worst[:2] / np.radians([limits.rate_deg_s, limits.angle_deg]))
    rate, angle = np.max(shares, axis=0)
    assert len(shares) > 1000, 'most are not refused'
    assert 0.99 < rate <= 1.0 + 1e-9 and 0.99 < angle <= 1.0 + 1e-9


EMPTIES = (0.1, 0.03)
FREE = AttitudeLimits(
    rate_deg_s=2.0, known_deg_s=0.01, disturbance_nm=0.01, inertia_share=0.15
)  # fmt: skip


@pytest.mark.parametrize('share', [-0.15, 0.0, 0.15])
def test_wheels_that_are_emptied_never_fill(share):
    """An hour of disturbances that stay and hostile torques, with another inertia than assumed."""
    given = {'torque_nm': TORQUE - 0.03, 'start_nms': 0.12, 'dt_s': DT, 'unloading': EMPTIES}
    kept = bounds_of(FREE, BODY, duration_s=1e9, **given)
    assert kept.momentum < 0.3
    lim = numbers_of(FREE, kept, BODY, TORQUE - 0.03, MOMENTUM, DT)
    heavier = tuple(map(tuple, ((1.0 + share) * INERTIA).tolist()))
    craft = CRAFT._replace(body=body_of(heavier, 0.0))
    hard = partial(worst_of, limits=FREE, ticks=36_000, lim=lim, craft=craft)
    found = np.array([hard(run, empties=EMPTIES) for run in range(1, 11)])
    body = 1.15 * sum(abs(INERTIA[2])) * radians(2.0) * sqrt(3.0)
    assert found[:, 0].max() <= radians(FREE.rate_deg_s)
    assert found[:, 2].max() <= kept.momentum + body
    assert found[:, 2].max() > EMPTIES[0], 'they were needed'
    # left alone, the wheels fill up, and then nothing holds the chaser
    alone = np.array([hard(run) for run in (1, 3)])
    assert alone[:, 2].max() > 0.99 * MOMENTUM and alone[:, 0].max() > radians(FREE.rate_deg_s)


@pytest.mark.parametrize(
    ('limits', 'changes', 'said'),
    [
        (replace(FREE, disturbance_nm=0.02), {'unloading': EMPTIES},
         '`unloading.torque_nm` must be above .* 0.034641'),
        (FREE, {'unloading': (0.05, 0.03)}, '`unloading.above_nms` must be at least 0.064325'),
        (replace(LIMITS, angle_deg=1.0, known_deg_s=1.0), {},
         'angle_deg` must leave room to brake in'),
        (replace(LIMITS, momentum_nms=0.1), {}, 'limits` and the wheels exclude each other'),
        (replace(LIMITS, rate_deg_s=40.0), {}, 'limits` must leave torque to brake with'),
    ],
)  # fmt: skip
def test_limits_that_nothing_keeps_are_refused(limits, changes, said):
    with pytest.raises(InputError, match=said):
        numbers(limits, **changes)


SEEN = (0.0, 0.0, 0.0, 1.0, 0.01, -0.01, 0.005)
REFERENCE = (0.001, 0.0, 0.002, sqrt(1.0 - 5e-6), 0.0, 0.0, 0.0)


def kept(torque, lim, seen=SEEN, reference=REFERENCE, wheels=(0.1, -0.1, 0.2)):
    """Return what becomes of a torque."""
    e = errors(seen, reference, reference[4:], DT)
    return within_limits(torque, seen[4:], e[:3], e[3:6], e[6:], wheels, lim)


def test_a_torque_within_the_limits_keeps_its_bits():
    torque = (0.0123456789, -0.03, 0.001)
    assert kept(torque, numbers()) == (*torque, PASSED)
    assert kept((9.0, 9.0, 9.0), NONE) == (9.0, 9.0, 9.0, PASSED)


def test_a_wheel_near_its_limit_takes_no_more():
    lim = numbers(replace(LIMITS, momentum_nms=0.32))
    x, y, z, acted = kept((-0.05, -0.05, -0.05), lim, wheels=(0.319, 0.0, 0.0))
    assert acted == LIMITED != PASSED
    assert 0.319 - x * DT <= 0.32 * (1.0 + 1e-12)
    assert (y, z) == (-0.05, -0.05)


def test_what_is_beyond_its_wall_by_an_error_may_come_back_as_it_does():
    lim = numbers()
    half = 0.25 * (lim.angle + lim.within)
    seen = (np.sin(half), 0.0, 0.0, np.cos(half), -radians(0.5), 0.0, 0.0)
    back = kept((0.05, 0.0, 0.0), lim, seen, (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    assert back == (0.05, 0.0, 0.0, PASSED)


def test_what_is_off_its_reference_is_free_to_come():
    """Beyond the cone only the rate is limited: a slew is no fault."""
    half = radians(30.0) / 2.0
    far = (np.sin(half), 0.0, 0.0, np.cos(half), 0.0, 0.0, 0.0)
    assert kept((-0.05, 0.0, 0.0), numbers(), seen=far) == (-0.05, 0.0, 0.0, PASSED)
    near = (*far[:4], -radians(2.0), 0.0, 0.0)
    assert kept((-0.05, 0.0, 0.0), numbers(), seen=near)[0] >= 0.0
