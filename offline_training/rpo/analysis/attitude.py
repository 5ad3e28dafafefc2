# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Attitude controllers are judged: slews and tumbles of a dispersed chaser, flown by the engine.

The chaser turns to the synchronised attitude. A flight has settled once its attitude error stays
within 0.5 deg and its rate error within 0.02 deg/s. Energy is the integral of the squared torque.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import log, radians, sin, sqrt
from typing import NamedTuple

import numpy as np

from rpo.engine.lanes import (
    QUAT,
    QUAT_W,
    RATE,
    RUNS,
    SEEN_QUAT,
    SEEN_QUAT_W,
    SEEN_RATE,
    TORQUE,
    compiled,
    make_scratch,
)
from rpo.engine.parts.attitude import attitude_in, put_attitude, vector_in
from rpo.engine.parts.attitude_control import HEAD, packed, part_of
from rpo.engine.support import kinds
from rpo.engine.tick import COUNTED, Batch, Part, Runs, fly, table_of
from rpo_core.attitude.attitude_kernels import synchronised
from rpo_core.attitude.chaser import Chaser, Wheels, times
from rpo_core.control.attitude import AttitudeControl, AttitudeController
from rpo_core.control.attitude_law_kernels import errors
from rpo_core.kernels.arrays import Floats
from rpo_core.scenario.scenario import Scenario, load_scenario
from rpo_core.stage import Place

ANGLE_DEG, RATE_DEG_S = 0.5, 0.02
"""A flight has settled within these."""

SETTLED_S, FLIGHT_S = 30.0, 40.0
"""Every flight shall have settled by then, and stay so until its end."""

OVERSHOOT = 0.05
"""A slew from rest shall turn beyond the reference by no more than this share of its angle."""

MOMENT_KG_M2 = 0.15
INERTIA_KG_M2 = ((MOMENT_KG_M2, 0.004, -0.003), (0.004, 0.17, 0.005), (-0.003, 0.005, 0.12))
VEHICLE = Chaser(inertia_kg_m2=INERTIA_KG_M2, wheels=Wheels(torque_nm=0.01, momentum_nms=0.1))
"""The chaser that is flown: 10 kg, a cube of 30 cm with wheels."""

TRAINED_SEED, JUDGED_SEED = 30, 2026


class Draws(NamedTuple):
    """Attitudes (n, 4), rates (n, 3) [deg/s] and inertias (n, 3, 3) [kg m^2] at tick 0."""

    attitudes: Floats
    rates_deg_s: Floats
    inertias: Floats


def _draws(
    rng: np.random.Generator, angles_deg: Floats, rate_deg_s: float, along: float = 0.0
) -> Draws:
    """Return turns by angles (n,), at rates within so much of each axis.

    along : 0: about random axes; the larger, the closer these are to the axes of the body, in turn
    """
    count = len(angles_deg)
    axes = rng.standard_normal((count, 3))
    axes += along * np.resize(np.vstack([np.eye(3), -np.eye(3)]), (count, 3))
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    half = np.radians(angles_deg)[:, None] / 2.0
    rates = rng.uniform(-rate_deg_s, rate_deg_s, (count, 3))
    shares = np.sqrt(rng.uniform(0.9, 1.1, (count, 3)))
    inertias = np.array(INERTIA_KG_M2) * (shares[:, :, None] * shares[:, None, :])
    return Draws(np.hstack([axes * np.sin(half), np.cos(half)]), rates, inertias)


def judged_draws(count: int, seed: int = JUDGED_SEED) -> Draws:
    """Return slews of up to 180 deg: inertia +-10 %, rates of up to 1 deg/s of each axis."""
    rng = np.random.Generator(np.random.PCG64(seed))
    return _draws(rng, rng.uniform(0.0, 180.0, count), 1.0)


def trained_draws(hard: int = 0) -> Draws:
    """Return what training flies: 40 slews from rest, 80 at 1.1 deg/s, 40 tumbles at 3 deg/s.

    hard : slews more, of 150 to 180 deg at 1.1 deg/s, nearly about an axis of the body: one wheel
        has all the work, and the flight settles last
    """
    rng = np.random.Generator(np.random.PCG64(TRAINED_SEED))
    angles = np.linspace(4.5, 180.0, RUNS)
    parts = [_draws(rng, angles, rate) for rate in (0.0, 1.1, 1.1, 3.0)]
    parts.append(_draws(rng, rng.uniform(150.0, 180.0, hard), 1.1, along=5.0))
    return Draws(*map(np.concatenate, zip(*parts, strict=True)))


class Outcome(NamedTuple):
    """What flights did, each (n,).

    settled_s : when they had settled; infinite where they did not
    worst : largest error after the time to settle, in units of its limits
    energy : integral of the squared torque [N^2 m^2 s]
    beyond : of slews from rest, turn beyond the reference, in units of its limit; others have 0
    fastest_deg_s : largest rate
    """

    settled_s: Floats
    worst: Floats
    energy: Floats
    beyond: Floats
    fastest_deg_s: Floats


_ENERGY, _OUTSIDE, _WORST, _BEYOND, _FASTEST, _AXIS = 0, 1, 2, 3, 4, 5
_DT, _ORBIT, _LATE, _ANGLE, _RATE = range(5)


@compiled
def _count(w, m, t, tick):  # type: ignore[no-untyped-def]
    """Count the errors of a tick, and its torque."""
    n = RUNS
    for s in range(n):
        seen = attitude_in(w, QUAT, QUAT_W, RATE, s)
        wanted = synchronised(t[_ORBIT])
        e = errors(seen, wanted, (0.0, 0.0, t[_ORBIT]), t[_DT])
        angle = sqrt(e.ex * e.ex + e.ey * e.ey + e.ez * e.ez)
        rate = sqrt(e.wx * e.wx + e.wy * e.wy + e.wz * e.wz)
        if tick == 0:
            size = angle if angle > 0.0 else 1.0
            m[_AXIS * n + s], m[(_AXIS + 1) * n + s] = e.ex / size / size, e.ey / size / size
            m[(_AXIS + 2) * n + s] = e.ez / size / size
        beyond = -(e.ex * m[_AXIS * n + s] + e.ey * m[(_AXIS + 1) * n + s]
                   + e.ez * m[(_AXIS + 2) * n + s])  # fmt: skip
        m[_BEYOND * n + s] = max(m[_BEYOND * n + s], beyond)
        m[_FASTEST * n + s] = max(m[_FASTEST * n + s], rate)
        ratio = max(angle / t[_ANGLE], rate / t[_RATE])
        if ratio > 1.0:
            m[_OUTSIDE * n + s] = tick + 1.0
        if tick >= t[_LATE]:
            m[_WORST * n + s] = max(m[_WORST * n + s], ratio)
        x, y, z = vector_in(w, TORQUE, s)
        m[_ENERGY * n + s] += (x * x + y * y + z * z) * t[_DT]


@compiled
def _blur(w, m, t, tick):  # type: ignore[no-untyped-def]
    """Fill rows SEEN with the attitude a tick ago and noise, numbers (ticks, 6, 40)."""
    for s in range(RUNS):
        i, n = 6 * RUNS * tick + s, RUNS
        now = attitude_in(w, QUAT, QUAT_W, RATE, s)
        for j in range(7):
            m[(7 + j) * n + s] = now[j] if tick == 0 else m[j * n + s]
            m[j * n + s] = now[j]
        k = 7 * n + s
        half = (0.5 * t[i], 0.5 * t[i + n], 0.5 * t[i + 2 * n], 1.0)
        x, y, z, c = times((m[k], m[k + n], m[k + 2 * n], m[k + 3 * n]), half)
        size, i, k = sqrt(x * x + y * y + z * z + c * c), i + 3 * n, k + 4 * n
        p, q, r = m[k] + t[i], m[k + n] + t[i + n], m[k + 2 * n] + t[i + 2 * n]
        seen = (x / size, y / size, z / size, c / size, p, q, r)
        put_attitude(w, SEEN_QUAT, SEEN_QUAT_W, SEEN_RATE, s, seen)


class Flights:
    """Draws in the engine, which controllers fly one after the other.

    keep : share of all limits that is allowed; angle_deg : where a flight has settled
    noise : of the attitude [deg] and the rate [deg/s], each axis and tick; with it, both are seen
        a tick late
    """

    def __init__(
        self,
        draws: Draws,
        keep: float = 1.0,
        noise: Sequence[float] = (),
        angle_deg: float = ANGLE_DEG,
    ) -> None:
        self.base = load_scenario('approach').equipped(VEHICLE)
        self.draws, self._keep, self.count = draws, keep, len(draws.attitudes)
        self._parts = [self._part(first) for first in range(0, self.count, RUNS)]
        dt, n = self.base.dt_s, self.base.mean_motion_rad_s
        self.ticks = round(FLIGHT_S / dt)
        limits = 2.0 * sin(radians(keep * angle_deg) / 2.0), radians(keep * RATE_DEG_S)
        table = table_of(dt, n, round(keep * SETTLED_S / dt), limits)
        self._others = [Part('count', ((COUNTED, _count),), table, np.zeros(8 * RUNS))]
        self._seen = (QUAT, QUAT_W, RATE)
        if noise:
            rng = np.random.Generator(np.random.PCG64(TRAINED_SEED))
            normals = rng.standard_normal((self.ticks + 1, 2, 3 * RUNS))
            normals *= np.radians(noise)[:, None]
            steps, memory = ((Place.ATTITUDE_SENSOR, _blur),), np.zeros(14 * RUNS)
            self._others.append(Part('noise', steps, normals.ravel(), memory))
            self._seen = (SEEN_QUAT, SEEN_QUAT_W, SEEN_RATE)

    def scenario(self, index: int) -> Scenario:
        """Return the scenario of a flight; its controller is not used."""
        attitude, rates, inertia = (values[index].tolist() for values in self.draws)
        chaser = replace(VEHICLE, attitude=attitude, rates_deg_s=rates, inertia_kg_m2=inertia)
        return self.base.equipped(chaser, AttitudeControl(controller='attitude_pd'))

    def _part(self, first: int) -> Part:
        """Return the part of some chasers."""
        count = min(RUNS, self.count - first)
        starts, keys = np.zeros((count, 6)), np.zeros((count, 2), np.int64)
        made = [self.scenario(first + i) for i in range(count)]
        batch = Batch(made[0], starts, lambda: made, {}, keys, {})
        found = next(kind for kind in kinds() if kind.section == 'attitude').make(batch)
        assert found is not None
        return found

    def fly(self, settings: AttitudeControl) -> Outcome:
        """Return what a controller does with all of them."""
        law = packed(*settings.law_of(self.base.equipped(VEHICLE)))
        control = part_of(law, np.tile(law[:HEAD], (RUNS, 1)), np.zeros((3, RUNS)), self._seen)
        w, counted = make_scratch(), []
        for part in self._parts:
            runs = Runs(np.zeros((RUNS, 4)), np.zeros((RUNS, 2)), (part, control, *self._others))
            counted.append(fly(runs, (), self.ticks, w)['count'].reshape(8, RUNS))
        energy, last, worst, beyond, fastest = np.hstack(counted)[:_AXIS, : self.count]
        settled = np.where(last >= self.ticks, np.inf, last * self.base.dt_s)
        at_rest = np.abs(self.draws.rates_deg_s).max(axis=1) == 0.0
        beyond = np.where(at_rest, beyond / (self._keep * OVERSHOOT), 0.0)
        return Outcome(settled, worst, energy, beyond, np.degrees(fastest))


HEADINGS = (
    'controller', 'time scale', 'settled in time', 'mean settling [s]', '99.9 % settled by [s]',
    'mean energy [mN² m² s]', 'largest rate [deg/s]',
)  # fmt: skip
SENTENCE = (
    f'Settled: within {ANGLE_DEG:g} deg and {RATE_DEG_S:g} deg/s from {SETTLED_S:g} s to '
    f'{FLIGHT_S:g} s. Inertia +-10 %, rates of up to 1 deg/s each axis, limited wheels; energy is '
    'the integral of the squared torque. The time scales give all the mean settling of the first; '
    'a controller that is not so fast at any has its fastest.'
)
"""What `compared` shows."""


class Compared(NamedTuple):
    """How a controller flew: the columns of `HEADINGS`."""

    name: str
    time_scale: float
    slower: bool
    share: float
    mean_s: float
    late_s: float
    energy_mn2m2s: float
    fastest_deg_s: float

    @property
    def cells(self) -> tuple[str, ...]:
        """The row as text."""
        return (
            self.name, f'{self.time_scale:.4g}' + ' (its fastest)' * self.slower,
            f'{100.0 * self.share:.2f} %',
            f'{self.mean_s:.1f}', f'{self.late_s:.1f}', f'{self.energy_mn2m2s:.1f}',
            f'{self.fastest_deg_s:.1f}',
        )  # fmt: skip


def compared(controllers: Sequence[AttitudeController], draws: Draws) -> list[Compared]:
    """Return a row of each controller over the same draws, all at the pace of the first."""
    flights, few = Flights(draws), Flights(judged_draws(400, JUDGED_SEED + 1))
    pace_s, rows = _settling_s(few, controllers[0], 1.0), []
    for controller in controllers:
        scale, slower = 1.0, False
        if controller is not controllers[0]:
            scale, slower = _paced(few, controller, pace_s)
        o = flights.fly(AttitudeControl(controller=controller, time_scale=scale))
        settled = np.minimum(o.settled_s, FLIGHT_S)
        numbers = (
            (o.worst <= 1.0).mean(), settled.mean(), np.quantile(settled, 0.999),
            1e6 * o.energy.mean(), o.fastest_deg_s.max(),
        )  # fmt: skip
        rows.append(Compared(controller.name, scale, slower, *map(float, numbers)))
    return rows


def _paced(few: Flights, controller: AttitudeController, pace_s: float) -> tuple[float, bool]:
    """Return the time scale of a mean settling, and whether it is the fastest, which is slower."""

    def between(low: float, high: float) -> float:
        scale = low
        while high / low > 1.001:
            scale = sqrt(low * high)
            slow = _settling_s(few, controller, scale) > pace_s
            low, high = (low, scale) if slow else (scale, high)
        return scale

    scale = between(0.02, 50.0)
    if _settling_s(few, controller, scale) <= 1.01 * pace_s:
        return scale, False
    # Faster is not sooner settled for ever: a law that is too fast overshoots.
    scales = np.geomspace(0.02, 50.0, 35).tolist()
    paces = [(_settling_s(few, controller, s), abs(log(s)), s) for s in scales]
    mean_s, _, best = min(paces)  # if it settles at none, its own
    return (best, True) if mean_s > pace_s else (between(best, 50.0), False)


def _settling_s(flights: Flights, controller: AttitudeController, scale: float) -> float:
    settings = AttitudeControl(controller=controller, time_scale=scale)
    return float(np.minimum(flights.fly(settings).settled_s, FLIGHT_S).mean())
