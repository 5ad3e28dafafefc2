# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Command shaping: a slew limit with memory, a dead zone, a limit of the hold. Section `shaping`.

It stands between the controller and runtime assurance: assurance has the last word. Each axis is
shaped by itself, so the direction of a large change of force may turn.

The limit of the hold keeps the command below the largest disturbance of the flight, which is not
known before its end. So a quadratic in time is fitted to the disturbance that is estimated, axis
by axis, by a Kalman filter (its gains depend on time alone); the largest is that of all axes so
far, or that of the quadratics ahead. At the peak the chaser then gives way, by some decimetres,
instead of pushing back as hard. Farther from the target than it may, the limit opens with distance,
like a spring: a command that jumps there would break the limit of speed.

With `hold_learns` it learns the thrust too, and gives way before the peak: `rpo_safety.learning`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Annotated, Any

import numpy as np

from rpo_core.chain.stage import ZERO, Signal, Stage
from rpo_core.files.codec import unless_default
from rpo_core.files.validation import Checked, InputError, flag, real
from rpo_core.wire import interfaces
from rpo_kernels.arrays import Floats
from rpo_kernels.jit import kernel
from rpo_kernels.kernels import Vector, saturate
from rpo_safety.learning import foresee, given_way, learn, tables

SHAPED_FORCE = 'shaped_force'

AHEAD_S, SETTLING_S, PERIOD_S = 60.0, 5.0, 1.0
"""Limit of the hold: how far it looks ahead; how long the fit runs before the limit acts; how often
a value is taken."""
PUSH_S = 15.0
"""How long it may push harder before the limit acts, where it learns."""
MEASURED = 'measurement'
"""Signal of the sensor from which it learns."""

_NOISE_SHARE = 0.015
"""Sigma of a value that is taken, as a share of the disturbance's."""

_above = partial(real, above=0.0, most=1e6)
_least = partial(real, least=0.0, most=1e6)


@dataclass(frozen=True)
class Shaping(Checked):
    """What becomes of the command of a controller.

    slew_n_s : largest change of a command per second, each axis; the first command of a flight is
        not limited, as the paper does not count that step
    dead_zone_n : a command of at most so much becomes zero, each axis; 0: none
    hold_share : in the hold, an axis commands at most this share of the largest disturbance that
        is estimated so far or foreseen; 0: no such limit. The flight ends at `duration_s`
    hold_within_m : so far the chaser may give way, each axis, as it knows it; from there the limit
        opens, once more with each fifth of it
    hold_from_s : from then on the disturbance is followed; the limit acts 5 s later
    hold_learns : whether it learns the thrust from the measured velocity, and gives way before the
        disturbance peaks; `hold_from_s` is then the begin of that, and the limit acts 15 s later
    """

    slew_n_s: Annotated[float, partial(_above, unit='N/s')]
    dead_zone_n: Annotated[float, partial(_least, unit='N')] = 0.0
    hold_share: Annotated[float, partial(real, least=0.0, most=10.0)] = unless_default(0.0)
    hold_within_m: Annotated[float, partial(_least, unit='m')] = unless_default(0.0)
    hold_from_s: Annotated[float, partial(_least, unit='s')] = unless_default(0.0)
    hold_learns: Annotated[bool, flag] = unless_default(False)


@kernel
def shaped(
    command: float, before: float, first: bool, step_n: float, zone: float, most: float
) -> float:
    """Return the shaped command [N] of an axis.

    before : shaped command [N] of the tick before; first : there is none
    step_n : largest change in a tick [N]; zone : dead zone [N]; most : limit of the thrusters [N]
    """
    wanted = saturate(command, most)
    if -zone <= wanted <= zone:
        wanted = 0.0
    if first:
        return wanted
    if wanted > before + step_n:
        return before + step_n
    if wanted < before - step_n:
        return before - step_n
    return wanted


@kernel
def followed(value: float, fit: Vector, first: bool, gains: Vector, step_s: float) -> Vector:
    """Return value, rate and rate of the rate of a fit with one more value, `step_s` later."""
    p, v, a = fit
    if first:
        return value, 0.0, 0.0
    p, v = p + (v + 0.5 * a * step_s) * step_s, v + a * step_s
    gap = value - p
    return p + gains[0] * gap, v + gains[1] * gap, a + gains[2] * gap


@kernel
def largest_ahead(fit: Vector, span_s: float) -> float:
    """Return the largest |value| of a fit from now to `span_s` later."""
    p, v, a = fit
    most = max(abs(p), abs(p + (v + 0.5 * a * span_s) * span_s))
    if -v * a > 0.0 and abs(v) < abs(a) * span_s:
        most = max(most, abs(p - 0.5 * v * v / a))
    return most


@kernel
def held(command: float, most: float, r: float, within: float) -> float:
    """Return the command [N] of an axis at r [m] under the limit of the hold."""
    beyond = abs(r) - within
    if beyond > 0.0:
        most = most * (1.0 + 5.0 * beyond / within)
    return saturate(command, most)


@dataclass(frozen=True)
class HoldLimit:
    """Numbers of the limit of the hold.

    share, within_m : as in `Shaping`
    begin, act : ticks of the first value, and of the first command that is limited
    period : ticks between values
    end : last tick of the flight
    gains : (values, 3) of the fit, per second each
    learnt : settings and first memory of `rpo_safety.learning`, where it learns
    """

    share: float
    within_m: float
    begin: int
    act: int
    period: int
    end: int
    gains: Floats
    learnt: tuple[Any, Any] | None = None

    @classmethod
    def of(cls, settings: Shaping, scenario: Any) -> HoldLimit | None:
        """Return that of a scenario; None where it has none."""
        if settings.hold_share == 0.0:
            return None
        dt_s, begin = scenario.dt_s, round(settings.hold_from_s / scenario.dt_s)
        period = max(1, round(PERIOD_S / dt_s))
        rate = math.pi * scenario.mean_motion_rad_s  # of the paper's disturbance
        count = 0 if settings.hold_learns else max(1, (scenario.ticks - begin) // period + 1)
        act = begin + math.ceil((PUSH_S if settings.hold_learns else SETTLING_S) / dt_s)
        share, within_m = settings.hold_share, settings.hold_within_m
        ticks, gains, learnt = scenario.ticks, _gains(count, period * dt_s, rate), None
        if settings.hold_learns:
            known, sensor = scenario.named('estimator'), scenario.named('sensors').units[0]
            world = (dt_s, known.mass_kg or scenario.mass_kg, scenario.mean_motion_rad_s)
            sigma = sensor.velocity_floor_m_s * known.noise_scale
            learnt = tables(world, (period, begin, act, ticks), (share, within_m), sigma, rate)
        return cls(share, within_m, begin, act, period, ticks, gains, learnt)


@lru_cache(maxsize=64)
def _gains(count: int, step_s: float, rate_rad_s: float) -> Floats:
    """Return the Kalman gains (count, 3) of a quadratic that changes at about a rate.

    The first value, whose row is not used, is the start; sigmas are shares of the disturbance's.
    """
    covariance = np.diag([_NOISE_SHARE**2, rate_rad_s**2, rate_rad_s**4])
    step = np.array([[1.0, step_s, 0.5 * step_s**2], [0.0, 1.0, step_s], [0.0, 0.0, 1.0]])
    gains = np.zeros((count, 3))
    for row in gains[1:]:
        covariance = step @ covariance @ step.T
        row[:] = covariance[0] / (covariance[0, 0] + _NOISE_SHARE**2)
        covariance = covariance - np.outer(row, covariance[0])
    return gains


class ShapingStage(Stage):
    """From the command of the controller to the shaped command; it remembers the last one.

    numbers : (3,) largest change in a tick, dead zone, limit of the thrusters [N]
    hold : the limit of the hold, if any; it reads the disturbance that is estimated, and the state
    """

    name = 'shaping'
    inputs: tuple[str, ...] = (interfaces.COMMAND,)
    outputs = (SHAPED_FORCE,)
    memory_ticks = None
    counts_ticks = False

    def __init__(self, settings: Shaping, scenario: Any) -> None:
        self.numbers = (
            settings.slew_n_s * scenario.dt_s,
            settings.dead_zone_n,
            float(scenario.max_force_n),
        )
        self.hold = HoldLimit.of(settings, scenario)
        self.dt_s = float(scenario.dt_s)
        if self.hold is not None:
            self.inputs = (
                interfaces.COMMAND,
                interfaces.ESTIMATED_DISTURBANCE,
                interfaces.STATE,
            )
            if self.hold.learnt is not None:
                self.inputs = (interfaces.COMMAND, interfaces.STATE, MEASURED)
            self.counts_ticks = True
        self.reset()

    def reset(self) -> None:
        """Forget the last command: a flight begins."""
        self._before: Signal = ZERO
        self._first = True
        self._fits: list[Vector] = [ZERO] * 3
        self._largest_n, self._ahead_n = 0.0, 0.0
        learnt = self.hold.learnt if self.hold is not None else None
        self._learnt: Any = None if learnt is None else (learnt[1].copy(), learnt[0])

    def step(self, tick: int, *inputs: Any) -> tuple[Signal, ...]:
        """Return the shaped command (3,) [N]."""
        wanted = inputs[0]
        if self._learnt is not None:
            wanted = self._given_way(self.hold, tick, *inputs)
        elif self.hold is not None:
            wanted = self._held(self.hold, tick, *inputs)
        pairs = zip(wanted, self._before, strict=True)
        self._before = tuple(shaped(u, b, self._first, *self.numbers) for u, b in pairs)
        self._first = False
        return (self._before,)

    def _held(
        self, hold: HoldLimit, tick: int, command: Signal, found: Signal, state: Signal
    ) -> Signal:
        number, rest = divmod(tick - hold.begin, hold.period)
        if number >= 0 and rest == 0:
            gains, step_s = tuple(hold.gains[number].tolist()), hold.period * self.dt_s
            pairs = zip(found, self._fits, strict=True)
            self._fits = [followed(d, fit, number == 0, gains, step_s) for d, fit in pairs]
            span_s = min(AHEAD_S, (hold.end - tick) * self.dt_s)
            self._largest_n = max(self._largest_n, *(abs(fit[0]) for fit in self._fits))
            self._ahead_n = max(largest_ahead(fit, span_s) for fit in self._fits)
        if tick < hold.act:
            return command
        most = hold.share * max(self._largest_n, self._ahead_n)
        axes = zip(command, state, strict=False)  # the positions come first
        return tuple(held(u, most, r, hold.within_m) for u, r in axes)

    def _given_way(
        self, hold: Any, tick: int, command: Signal, state: Signal, measured: Signal
    ) -> Signal:
        (memory, table), before = self._learnt, self._before
        x, y, z, vx, vy, vz = state[:6]
        r, v, seen = (x, y, z), (vx, vy, vz), (measured[3], measured[4], measured[5])
        learn(tick, (before[0], before[1], before[2]), r, v, seen, memory, table)
        if tick < hold.begin:
            return command
        if (tick - hold.begin) % hold.period == 0:
            foresee(tick, r, v, memory, table)
        acts, axes = tick >= hold.act, zip(command, r, v, range(3), strict=True)
        return tuple(given_way(acts, *axis, memory, table) for axis in axes)


def check(settings: Shaping, scenario: Any) -> None:
    """Raise InputError if the dead zone leaves no command, or nothing tells the hold's limit."""
    if settings.dead_zone_n >= scenario.max_force_n:
        raise InputError(
            f'`shaping.dead_zone_n` must be below max_force_n = {scenario.max_force_n!r} N; '
            f'got {settings.dead_zone_n!r}'
        )
    if settings.hold_share > 0.0:
        if settings.hold_within_m == 0.0:
            raise InputError('`shaping.hold_within_m` must be > 0 m with `hold_share`; got 0')
        if getattr(scenario.named('estimator'), 'disturbance_sigma_n', 0.0) == 0.0:
            raise InputError(
                '`shaping.hold_share` needs an `estimator` with `disturbance_sigma_n` > 0 N: the '
                'limit is a share of the disturbance that is estimated'
            )
        if settings.hold_learns:
            _check_sensor(scenario)
        if scenario.goal is not None or scenario.named('guidance') is not None:
            raise InputError(
                '`shaping.hold_share` is for a hold at the target; got a goal elsewhere'
            )


def _check_sensor(scenario: Any) -> None:
    """Raise InputError if it cannot learn from the first sensor, or from its own commands."""
    unit = scenario.named('sensors').units[0]
    misses = unit.latency_ticks or unit.dropout_share or unit.outages_s or unit.outlier_share
    seldom = misses or unit.period_ticks > 1 or unit.field_of_view_rad < math.pi
    if seldom or unit.velocity_floor_m_s == 0.0:
        raise InputError(
            '`shaping.hold_learns` needs a first sensor that measures velocity at each tick, '
            'without latency, losses and outliers'
        )
    if scenario.named('assurance') is not None:
        raise InputError('`shaping.hold_learns` needs its own commands; got `assurance` after it')
