# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Attitude controllers are judged: slews and tumbles of a dispersed chaser, flown by the driver.

The chaser turns to the synchronised attitude. A flight has settled once its attitude error stays
within 0.5 deg and its rate error within 0.02 deg/s. Energy is the integral of the squared torque.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import log, radians, sin, sqrt
from typing import Annotated, Any, NamedTuple

import numpy as np

from rpo_core.attitude.attitude_kernels import synchronised
from rpo_core.attitude.chaser import AttitudeStage, Chaser, Wheels, times
from rpo_core.chain.chain import Chain, start_of
from rpo_core.chain.driver import Driver
from rpo_core.control.attitude import AttitudeControl, AttitudeController, Control
from rpo_core.control.attitude_law_kernels import errors
from rpo_core.kernels.arrays import Floats
from rpo_core.kernels.jit import kernel, step_kernel
from rpo_core.kernels.records import prepared
from rpo_core.scenario.scenario import Scenario, load_scenario
from rpo_core.stage import KernelStage, Place
from rpo_core.wire.interfaces import BODY_TORQUE, CHASER_ATTITUDE, NAVIGATION_ATTITUDE

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
ANGLES = 40
"""Slews of each part of the training; so many flights have noise of their own."""


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
    angles = np.linspace(4.5, 180.0, ANGLES)
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


class Limits(NamedTuple):
    """What flights are counted by: a tick [s], rate of LVLH [rad/s], first late tick, limits."""

    dt: float
    orbit: float
    late: int
    angle: float
    rate: float


@kernel
def _count(attitudes: Any, torques: Any, t: Limits) -> Any:
    """Return last tick outside, worst, energy, beyond, largest rate of a flight: see `Outcome`.

    attitudes : (n, 7); torques : (n, 3) [N m]
    """
    last = worst = energy = beyond = fastest = 0.0
    axis = (0.0, 0.0, 0.0)
    for tick in range(len(attitudes)):
        a, torque = attitudes[tick], torques[tick]
        seen = (a[0], a[1], a[2], a[3], a[4], a[5], a[6])
        e = errors(seen, synchronised(t.orbit), (0.0, 0.0, t.orbit), t.dt)
        angle = sqrt(e.ex * e.ex + e.ey * e.ey + e.ez * e.ez)
        rate = sqrt(e.wx * e.wx + e.wy * e.wy + e.wz * e.wz)
        if tick == 0:
            size = angle if angle > 0.0 else 1.0
            axis = (e.ex / size / size, e.ey / size / size, e.ez / size / size)
        beyond = max(beyond, -(e.ex * axis[0] + e.ey * axis[1] + e.ez * axis[2]))
        fastest = max(fastest, rate)
        ratio = max(angle / t.angle, rate / t.rate)
        if ratio > 1.0:
            last = tick + 1.0
        if tick >= t.late:
            worst = max(worst, ratio)
        x, y, z = torque[0], torque[1], torque[2]
        energy += (x * x + y * y + z * z) * t.dt
    return last, worst, energy, beyond, fastest


@dataclass(slots=True)
class Noise:
    """Settings of the kernel `blur`: of each tick, three angles [rad] and three rates [rad/s]."""

    normals: list[list[float]]


@dataclass(slots=True)
class Before:
    """Memory of the kernel `blur`: the attitude a tick ago."""

    attitude: Annotated[list[float], 7]


@step_kernel
def blur(tick: int, u: Any, p: Any, m: Any, y: Any) -> None:
    """Attitude and rate (7,) a tick ago, turned by the noise e: q (e / 2, 1) / |..|, w + e_w."""
    b, e = m.attitude, p.normals[tick]
    if tick == 0:
        for j in range(7):
            b[j] = u[j]
    half = (0.5 * e[0], 0.5 * e[1], 0.5 * e[2], 1.0)
    x, y_, z, c = times((b[0], b[1], b[2], b[3]), half)
    size = sqrt(x * x + y_ * y_ + z * z + c * c)
    y[0], y[1], y[2], y[3] = x / size, y_ / size, z / size, c / size
    for j in range(3):
        y[4 + j] = b[4 + j] + e[3 + j]
    for j in range(7):
        b[j] = u[j]


class BlurStage(KernelStage):
    """The attitude is seen a tick late, and with noise."""

    name, inputs, outputs = 'blur', (CHASER_ATTITUDE,), (NAVIGATION_ATTITUDE,)
    kernel = blur

    def __init__(self, normals: Floats) -> None:
        super().__init__(Noise(normals.tolist()), Before([0.0] * 7))


class _Turning(threading.local):
    """The chain of a thread: noise, a controller and the chaser; flights differ in settings."""

    def __init__(self, scenario: Scenario, noise: Sequence[Any], ticks: int) -> None:
        more = [(Place.ATTITUDE_SENSOR, BlurStage(np.zeros((1, 6))))] if noise else []
        places = Place.ATTITUDE_SENSOR, Place.STEERING, Place.ATTITUDE
        chain = Chain.of(scenario, more=more).part(*places)
        stages: list[Any] = [link.stage for link in chain.links]
        *self.noisy, self.control, self.chaser = stages
        self.driver = Driver(chain, (CHASER_ATTITUDE, BODY_TORQUE))
        self.room = self.driver.room(ticks)


class Flights:
    """Draws that controllers fly one after the other.

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
        scenarios, dt = [self.scenario(index) for index in range(self.count)], self.base.dt_s
        self._starts = [{CHASER_ATTITUDE: start_of(s)[CHASER_ATTITUDE]} for s in scenarios]
        self._chasers = [AttitudeStage(s.attitude, s).p for s in scenarios]
        self.ticks, late = round(FLIGHT_S / dt), round(keep * SETTLED_S / dt)
        limits = 2.0 * sin(radians(keep * angle_deg) / 2.0), radians(keep * RATE_DEG_S)
        self._limits = Limits(dt, self.base.mean_motion_rad_s, late, *limits)
        self._noise = []
        if noise:
            rng = np.random.Generator(np.random.PCG64(TRAINED_SEED))
            normals = rng.standard_normal((self.ticks + 1, 2, 3 * ANGLES))
            normals *= np.radians(noise)[:, None]
            each = normals.reshape(self.ticks + 1, 6, ANGLES)
            self._noise = [BlurStage(each[:, :, i]).p for i in range(ANGLES)]
        self._turning = _Turning(scenarios[0], self._noise, self.ticks - 1)

    def scenario(self, index: int) -> Scenario:
        """Return the scenario of a flight; its controller is not used."""
        attitude, rates, inertia = (values[index].tolist() for values in self.draws)
        chaser = replace(VEHICLE, attitude=attitude, rates_deg_s=rates, inertia_kg_m2=inertia)
        return self.base.equipped(chaser, AttitudeControl(controller='attitude_pd'))

    def fly(self, settings: AttitudeControl) -> Outcome:
        """Return what a controller does with all of them; threads may call it."""
        self._turning.control.take_settings(
            prepared(Control(*settings.law_of(self.base.equipped(VEHICLE)), 0))
        )
        counts = [self._flown(index) for index in range(self.count)]
        last, worst, energy, beyond, fastest = np.array(counts).T
        settled = np.where(last >= self.ticks, np.inf, last * self.base.dt_s)
        at_rest = np.abs(self.draws.rates_deg_s).max(axis=1) == 0.0
        beyond = np.where(at_rest, beyond / (self._keep * OVERSHOOT), 0.0)
        return Outcome(settled, worst, energy, beyond, np.degrees(fastest))

    def _flown(self, index: int) -> Any:
        """Return the counts of a flight."""
        turning = self._turning
        turning.chaser.take_settings(self._chasers[index])
        for stage in turning.noisy:
            stage.take_settings(self._noise[index % ANGLES])
        turning.driver.begin(self._starts[index], self.ticks - 1, turning.room)
        turning.driver.go_on()
        signals = turning.driver.flown()
        return _count(signals[CHASER_ATTITUDE], signals[BODY_TORQUE], self._limits)


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
