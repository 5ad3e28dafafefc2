# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A hold that has learnt the thrust of the chaser, and gives way before the disturbance peaks.

Each second a Kalman filter per axis takes the mean of the velocities that were measured, less what
the commands and the orbit gave: the impulse of the disturbance, plus shares of the impulses that
were commanded. It has eight states: that impulse [N s], the disturbance [N], its rate and the rate
of that, the error of thrust over mass, the shares of the other axes' commands, and a delay [s]. All
forces are those of a chaser with the mass and the thrusters that it knows.

The mass follows from the three errors. So the largest disturbance, and how hard the chaser must
push, are known to about 1 %. Where it has to push harder than it may, it pushes as hard as it may
so early that it drifts through the peak, from one side of the target to the other.

What is remembered is a flat table m of `NUMBERS`, the settings are a flat table t.
"""

from __future__ import annotations

from math import sqrt
from typing import Any

from rpo_kernels.jit import as_table, inlined, kernel
from rpo_kernels.kernels import Vector, sin_cos

N, AXIS = 8, 8 + 8 * 8
"""States of an axis; they and their covariance follow each other in the memory, axis by axis."""

IMPULSE, ORBIT, BEFORE, SUMS = (3 * AXIS + i for i in (0, 3, 6, 12))
COUNT, LARGEST, LIMIT, PUSH, SIDE, NEED = (SUMS + i for i in (9, 10, 11, 12, 15, 18))
PULLS, STEPS, STEP_S = SUMS + 21, 40, 5.0
NUMBERS = PULLS + 3 * (STEPS + 1)
"""Places in the memory: impulse [N s] of commands, and of the orbit, so far; state of the tick
before; sums of a second: impulse of commands, commands, impulse measured; their count; the largest
disturbance so far; the limit [N]; of each axis, how far it pushes towards the limit (0 to 1), the
side to which it is pulled (1, -1), the force [N] that balances the pull; pulls of as many steps
ahead."""

DT, MASS, RATE, PERIOD, BEGIN, ACT, END, SHARE, WITHIN = range(9)
SIN, COS, NOISE, VARIANCE, TURN = range(9, 14)
"""Places in the settings: tick [s]; mass [kg]; mean motion [rad/s]; ticks of a second, of the first
push, of the first limit, of the end; as in `Shaping`; sine and cosine of the disturbance's phase of
a second; variances that a second adds to the last rate, and of a measured impulse; the rate [rad/s]
of that phase."""

_MASS_SHARE, _THRUST_SHARE, _MISALIGNED, _DELAY_S = 0.03, 0.02, 0.018, 0.15
_STARTS_N_S, _LEVEL_N = 10.0, 0.02
"""Sigmas at the start: of mass, of a thruster, of a misalignment [rad], of the delay; of the
impulse that the first velocity is, and of the disturbance."""
_OF_MASS = _MASS_SHARE**2 / (3.0 * _MASS_SHARE**2 + _THRUST_SHARE**2)
"""Part of the sum of three errors of thrust over mass that is the mass's, by least squares."""

LOOK_S, SURE, SURE_AHEAD = 100.0, 1.0, 0.5
"""So far ahead a largest disturbance is looked for, less so many sigmas; sigmas by which a pull is
taken as smaller."""
_AIM_M, _SOFT_M, _FAST_M_S, _SOFT_M_S = 0.15, 0.1, 0.0085, 0.002
"""It pushes as hard as it may where it would drift farther, or faster; less hard, up to as much
before that."""
_EXTRA, _NEAR_M, _NEAR_M_S = 0.15, 0.6, 0.03
"""Before the limit acts, the push is by this share stronger, so near the target and so slow."""
_BACK_N, _MARGIN_M, _STIFF_N_M, _AWAY_M_S, _DAMP_N_S_M = 0.002, 0.03, 0.02, 0.007, 2.0
"""Against the pull, it moves up to such a margin of where it may be, and so fast; the command is
less than what balances the pull by this force at most, or more of it beyond place and speed."""
_BRAKE_N_S_M, _TOO_FAST_M_S = 5.0, 0.0092
"""The limit opens beyond such a speed: the requirement of speed comes first."""


def tables(
    world: tuple[float, float, float],
    ticks: tuple[int, int, int, int],
    limit: tuple[float, float],
    velocity_sigma_m_s: float,
    rate_rad_s: float,
) -> tuple[Any, Any]:
    """Return settings, and the memory before tick 0.

    world : tick [s], mass [kg], mean motion [rad/s]
    ticks : of a second, of the first push, of the first limit, of the end
    limit : share and distance [m] of `Shaping`
    velocity_sigma_m_s : of a measurement; rate_rad_s : of the disturbance, about
    """
    second = ticks[0] * world[0]
    sine, cosine = sin_cos(rate_rad_s * second)
    noise = 30.0 * (rate_rad_s * rate_rad_s * rate_rad_s * _LEVEL_N) ** 2 * second
    variance = (world[1] * velocity_sigma_m_s) ** 2 / ticks[0]
    sigmas = [_STARTS_N_S, _LEVEL_N, _LEVEL_N * rate_rad_s, _LEVEL_N * rate_rad_s * rate_rad_s]
    sigmas += [sqrt(_MASS_SHARE**2 + _THRUST_SHARE**2), _MISALIGNED, _MISALIGNED, _DELAY_S]
    m = [0.0] * NUMBERS
    for axis in range(3):
        for i, sigma in enumerate(sigmas):
            m[AXIS * axis + N + (N + 1) * i] = sigma * sigma
    settings = [*world, *ticks, *limit, sine, cosine, noise, variance, rate_rad_s]
    return as_table(settings), as_table(m)


@inlined
def _moved(m: Any, at: int, step: int, t: Any) -> None:
    """Move four numbers, `step` apart, by a second: impulse, pull, its rate, the rate of that."""
    h, w, s, c = t[PERIOD] * t[DT], t[TURN], t[SIN], t[COS]
    i, j, k = at + step, at + 2 * step, at + 3 * step
    d, v, a = m[i], m[j], m[k]
    m[at] += h * (d + h * (0.5 * v + h * a / 6.0))
    m[i] = d + s / w * v + (1.0 - c) / (w * w) * a
    m[j], m[k] = c * v + s / w * a, c * a - w * s * v


@kernel
def _update(m: Any, axis: int, measured: float, h: tuple[float, ...], t: Any) -> None:
    """Take the impulse of a second: h . (impulse, error, share, share, delay) plus noise."""
    x, p = AXIS * axis, AXIS * axis + N
    _moved(m, x, 1, t)
    for i in range(N):
        _moved(m, p + i, N, t)
    for i in range(N):
        _moved(m, p + N * i, 1, t)
    m[p + 3 * (N + 1)] += t[NOISE]
    gap, spread = measured - m[x], t[VARIANCE]
    for i in range(N):
        row, j = p + N * i, PULLS + i
        m[j] = m[row]
        for k in range(1, 5):
            m[j] += h[k] * m[row + 3 + k]
    for k in range(1, 5):
        gap -= h[k] * m[x + 3 + k]
        spread += h[k] * m[PULLS + 3 + k]
    spread += m[PULLS]
    for i in range(N):
        gain = m[PULLS + i] / spread
        m[x + i] += gain * gap
        for k in range(i, N):
            value = m[p + N * i + k] - gain * m[PULLS + k]
            m[p + N * i + k] = value
            m[p + N * k + i] = value


@kernel
def learn(tick: int, command: Vector, r: Vector, v: Vector, seen: Vector, m: Any, t: Any) -> None:
    """Take a tick.

    command : (3,) [N] of the tick before; r, v : (3,) as the estimator knows them
    seen : (3,) [m/s] measured velocity
    """
    n, b, kick = t[RATE], BEFORE, t[DT] * t[MASS]
    if tick > 0:
        m[ORBIT] += kick * n * (3.0 * n * m[b] + 2.0 * m[b + 4])
        m[ORBIT + 1] -= kick * n * 2.0 * m[b + 3]
        m[ORBIT + 2] -= kick * n * n * m[b + 2]
        for i in range(3):
            m[IMPULSE + i] += t[DT] * command[i]
    for i in range(3):
        m[BEFORE + i], m[BEFORE + 3 + i] = r[i], v[i]
        m[SUMS + i] += m[IMPULSE + i]
        m[SUMS + 3 + i] += command[i]
        m[SUMS + 6 + i] += t[MASS] * seen[i] - m[ORBIT + i] - m[IMPULSE + i]
    m[COUNT] += 1.0
    if m[COUNT] < t[PERIOD]:
        return
    for i in range(3):
        s, j, k = m[COUNT], (i + 1) % 3, (i + 2) % 3
        own, one, other = m[SUMS + i] / s, m[SUMS + j] / s, m[SUMS + k] / s
        _update(m, i, m[SUMS + 6 + i] / s, (1.0, own, one, other, m[SUMS + 3 + i] / s), t)
    for i in range(10):
        m[SUMS + i] = 0.0


@inlined
def _share(value: float) -> float:
    return min(1.0, max(0.0, value))


@inlined
def _pull(m: Any, axis: int, s: float, c: float) -> float:
    """Return the pull [N] of an axis some time t from the newest second.

    s, c : sin(w t) / w and (1 - cos(w t)) / w^2
    """
    x = AXIS * axis + 1
    return float(m[x] + s * m[x + 1] + c * m[x + 2])


@inlined
def _sigma(m: Any, axis: int, s: float, c: float) -> float:
    """Return the sigma [N] of that pull."""
    p = AXIS * axis + N + N + 1
    q = p + N
    spread = m[p] + 2.0 * (s * m[p + 1] + c * (m[p + 2] + s * m[q + 2]))
    return sqrt(abs(spread + s * s * m[q + 1] + c * c * m[q + N + 2]))


@kernel
def _foresee_pulls(tick: int, h: float, steps: int, m: Any, t: Any) -> None:
    """Fill the pulls of each axis, `steps` of h [s] ahead, and the limit."""
    w = t[TURN]
    late = 0.5 * (t[PERIOD] + 1.0) * t[DT]  # the newest second is so old
    back = int(tick * t[DT] / STEP_S) if tick <= t[BEGIN] else 0
    for k in range(back + 1):  # what has been
        sine, cosine = sin_cos(w * (late - STEP_S * k))
        s, c = sine / w, (1.0 - cosine) / (w * w)
        for i in range(3):
            size = abs(_pull(m, i, s, c)) - SURE * _sigma(m, i, s, c)
            m[LARGEST] = max(m[LARGEST], size)
    largest = m[LARGEST]
    for k in range(steps + 1):  # what will be
        sine, cosine = sin_cos(w * (late + h * k))
        s, c = sine / w, (1.0 - cosine) / (w * w)
        for i in range(3):
            pull, sigma, a = _pull(m, i, s, c), _sigma(m, i, s, c), AXIS * i + 5
            if h * k <= LOOK_S:
                largest = max(largest, abs(pull) - SURE * sigma)
            # the other axes balance their pulls, and push this one with it
            pull -= m[a] * _pull(m, (i + 1) % 3, s, c) + m[a + 1] * _pull(m, (i + 2) % 3, s, c)
            weak = max(0.0, abs(pull) - SURE_AHEAD * sigma)
            m[PULLS + (STEPS + 1) * i + k] = weak if pull > 0.0 else -weak
    errors = m[4] + m[AXIS + 4] + m[2 * AXIS + 4]
    m[LIMIT] = t[SHARE] * largest / (1.0 + _OF_MASS * errors)


@kernel
def foresee(tick: int, r: Vector, v: Vector, m: Any, t: Any) -> None:
    """Fill limit, push, side and need of each axis, for a state (r, v)."""
    span = min(STEP_S * STEPS, max(0.0, (t[END] - tick) * t[DT]))
    steps = min(STEPS, int(span / STEP_S) + 1)
    h = span / steps
    _foresee_pulls(tick, h, steps, m, t)
    for i in range(3):
        p, thrust, largest = PULLS + (STEPS + 1) * i, 1.0 + m[AXIS * i + 4], 0.0
        for k in range(steps + 1):
            if abs(m[p + k]) > abs(largest):
                largest = m[p + k]
        side = -1.0 if largest < 0.0 else 1.0
        x, speed, most = side * r[i], side * v[i], thrust * m[LIMIT]
        far, fast = x, speed
        for k in range(steps):
            mean = 0.5 * side * (m[p + k] + m[p + k + 1])
            after = speed + (mean - most) / t[MASS] * h
            x, speed = x + 0.5 * (speed + after) * h, after
            far, fast = max(far, x), max(fast, speed)
        room = min((_AIM_M - far) / _SOFT_M, (_FAST_M_S - fast) / _SOFT_M_S)
        m[PUSH + i], m[SIDE + i] = _share(1.0 - room), side
        m[NEED + i] = side * m[p] / thrust


@kernel
def given_way(acts: bool, command: float, r: float, v: float, axis: int, m: Any, t: Any) -> float:
    """Return the command [N] of an axis at r [m], v [m/s]; acts : whether the limit does."""
    side, limit, need, within = m[SIDE + axis], m[LIMIT], m[NEED + axis], t[WITHIN]
    force, x, speed = -side * command, side * r, side * v
    room, slow = x + within - _MARGIN_M, speed + _AWAY_M_S
    share = m[PUSH + axis] * _share(room / 0.05) * _share(slow / 0.002)
    least = need - _BACK_N + _STIFF_N_M * min(0.0, room) + _DAMP_N_S_M * min(0.0, slow - 0.001)
    if not acts:
        if m[PUSH + axis] == 0.0 or abs(x) > _NEAR_M or abs(speed) > _NEAR_M_S:
            return command
        limit = (1.0 + _EXTRA) * limit
    else:
        most = limit * (1.0 + 5.0 * max(0.0, abs(x) - within) / within)
        most += _BRAKE_N_S_M * max(0.0, speed - _TOO_FAST_M_S)
        force = min(most, max(-most, force))
    return -side * max(force, (1.0 - share) * min(least, limit) + share * limit)
