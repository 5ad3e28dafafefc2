# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""How the chaser of a flight turned: off its reference, off its estimate; torque and wheels.

A log has no momentum of the wheels: the stage `attitude` is run again on the logged torques.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from rpo_core.attitude.attitude_kernels import synchronised
from rpo_core.attitude.chaser import AttitudeStage
from rpo_core.attitude.pointing import apart, errors, turned
from rpo_core.attitude.target import product
from rpo_core.chain.flight import Flight
from rpo_core.kernels.arrays import Floats
from rpo_core.scenario.scenario import Scenario
from rpo_core.wire.interfaces import (
    APPLIED_BODY_FORCE,
    BODY_TORQUE,
    CHASER_ATTITUDE,
    EXERTED_TORQUE,
    NAVIGATION_ATTITUDE,
    REFERENCE_ATTITUDE,
    THRUST,
    WHEEL_MOMENTUM,
)


class Turned(NamedTuple):
    """How the chaser turned, at the ticks of a flight.

    attitudes : (n, 7) true
    off_deg : (n, 3) attitude less its reference, each twice the vector part of the quaternion
    off_reference_deg : (n,) angle between them
    unknown_deg : (n, 3) estimate less the attitude; None where there is no estimate
    theta_deg : (n,) largest angle in a tick between the turn of the command and the true attitude
        that exerts it; None where no section turns the command, or an older one may act
    rates_deg_s : (n, 3) against inertial space, axes of the chaser
    torques_nm : (n, 3) commanded, or what a table of thrusters exerts; None where there is neither
    momenta_nms : (n, 3) of the wheels; None: there are none
    """

    attitudes: Floats
    off_deg: Floats
    off_reference_deg: Floats
    unknown_deg: Floats | None
    theta_deg: Floats | None
    rates_deg_s: Floats
    torques_nm: Floats | None
    momenta_nms: Floats | None


def turned_of(flight: Flight) -> Turned | None:
    """Return how the chaser turned; None where the scenario gives it no attitude."""
    scenario, signals = flight.scenario, flight.signals
    if scenario.attitude is None or CHASER_ATTITUDE not in signals:
        return None
    attitudes = signals[CHASER_ATTITUDE]
    references = signals.get(REFERENCE_ATTITUDE)
    if references is None:
        references = np.broadcast_to(synchronised(scenario.mean_motion_rad_s), attitudes.shape)
    steered = scenario.named('attitude_control') is not None
    seen = signals.get(NAVIGATION_ATTITUDE)
    torques = signals.get(BODY_TORQUE if steered else EXERTED_TORQUE)
    return Turned(
        attitudes,
        np.degrees(2.0 * errors(attitudes, references)[:, :3]),
        np.degrees(apart(attitudes, references)[:, 0]),
        None if seen is None else np.degrees(2.0 * errors(seen, attitudes)[:, :3]),
        theta_deg(flight) if steered and APPLIED_BODY_FORCE not in signals else None,
        np.degrees(attitudes[:, 4:]),
        torques,
        _momenta_nms(flight, attitudes) if scenario.attitude.wheels else None,
    )


def theta_deg(flight: Flight) -> Floats:
    """Return the largest angle (n,) by which the force of each tick is turned wrongly.

    The contract between attitude and translation bounds it (docs/safety.md, lemma 6). A command is
    turned by the attitude seen, ahead at the rate seen to the middle of the tick in which it acts.
    The last tick is not flown: its angle is as before it.
    """
    scenario, attitudes = flight.scenario, flight.signals[CHASER_ATTITUDE]
    late = scenario.thrusters.delay_ticks if scenario.thrusters else 0
    half_s = 0.5 * (late + 0.5) * scenario.dt_s
    seen = flight.signals.get(NAVIGATION_ATTITUDE, attitudes)
    orbit = turned([0.0, 0.0, scenario.mean_motion_rad_s], seen[:, :4] * (-1.0, -1.0, -1.0, 1.0))
    half: Any = np.column_stack([half_s * (seen[:, 4:] - orbit), np.ones(len(seen))]).T
    of: Any = seen[:, :4].T
    turns = np.zeros_like(attitudes)  # rates do not count here
    turns[:, :4] = np.stack(product(of, half / np.linalg.norm(half, axis=0)), axis=1)
    sent = turns[: len(turns) - 1 - late]
    angles_deg = np.zeros(len(seen))
    for end in (0, 1):
        angles = apart(attitudes[late + end :][: len(sent)], sent)[:, 0]
        angles_deg[late:-1] = np.maximum(angles_deg[late:-1], np.degrees(angles))
    angles_deg[-1] = angles_deg[-2]
    return angles_deg


def _momenta_nms(flight: Flight, attitudes: Floats) -> Floats:
    """Return the momentum (n, 3) of the wheels, which the force of the thrusters does not turn."""
    if WHEEL_MOMENTUM in flight.signals:
        return flight.signals[WHEEL_MOMENTUM]
    stage = AttitudeStage(flight.scenario.attitude, flight.scenario)
    nothing = np.zeros((len(attitudes), 3))
    inputs = (nothing if name == THRUST else flight.signal(name) for name in stage.inputs)
    return stage.steps(np.arange(len(nothing)), *inputs)[stage.outputs.index(WHEEL_MOMENTUM)]


def in_lvlh(flight: Flight, forces_n: Floats) -> Floats:
    """Return forces (n, 3) of ticks, in the thrusters' axes, in target LVLH; about."""
    if CHASER_ATTITUDE not in flight.signals:
        return forces_n
    q = flight.signals[CHASER_ATTITUDE][: len(forces_n) + 1, :4]
    return np.asarray(0.5 * (turned(forces_n, q[:-1]) + turned(forces_n, q[1:])))


class Panel(NamedTuple):
    """What is shown of a chaser that turned: a row of the picture, and of the table.

    values : (n, 3) by axis, or (n,); limit : of each, None without
    once : whether the limit counts once it is reached
    """

    name: str
    label: str
    unit: str
    values: Floats
    limit: float | None = None
    once: bool = False

    @property
    def sizes(self) -> Floats:
        """Largest size (n,) of the axes; not a number before a limit counts."""
        sizes = np.abs(self.values)
        sizes = sizes if sizes.ndim == 1 else sizes.max(axis=1)
        if not self.once or self.limit is None:
            return sizes
        return np.where(np.maximum.accumulate(sizes <= self.limit), sizes, np.nan)


def panels_of(turns: Turned, scenario: Scenario) -> list[Panel]:
    """Return what is shown of a chaser that turned, beside its limits."""
    control: Any = scenario.named('attitude_control')
    assurance: Any = scenario.named('assurance')
    limits, wheels = getattr(control, 'limits', None), scenario.attitude.wheels
    angle, rate, error = (
        (limits.angle_deg, limits.rate_deg_s, limits.known_deg) if limits else (None,) * 3
    )
    off = turns.off_deg
    panels = [Panel('off the reference, per axis', 'off reference', 'deg', off, angle, once=True)]
    if (seen := turns.unknown_deg) is not None:
        panels.append(Panel('estimate off the truth, per axis', 'estimate off', 'deg', seen, error))
    if turns.theta_deg is not None:
        bound = getattr(assurance, 'chaser_attitude_error_deg', None)
        panels.append(Panel('θ, force turned wrongly by', 'θ', 'deg', turns.theta_deg, bound))
    panels.append(Panel('rate, per axis', 'rate', 'deg/s', turns.rates_deg_s, rate))
    if turns.torques_nm is not None:
        what = 'torque exerted' if control is None else 'torque commanded'
        most = control.limit_of(scenario) if wheels and control is not None else None
        panels.append(Panel(f'{what}, per axis', 'torque', 'N m', turns.torques_nm, most))
    if turns.momenta_nms is not None:
        most = (limits and limits.momentum_nms) or wheels.momentum_nms
        panels.append(Panel('momentum of a wheel', 'momentum', 'N m s', turns.momenta_nms, most))
    return panels
