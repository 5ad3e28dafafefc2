# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The attitude of the chaser: section `attitude` of a scenario.

With the section the chaser is a rigid body whose thrusters turn with it. Without it its axes are
those of target LVLH.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from math import radians
from typing import Annotated, Any

from rpo_core.attitude.attitude_kernels import Attitude, frame_of
from rpo_core.attitude.chaser_kernels import Craft, chaser_tick, turned_force, unit
from rpo_core.attitude.target import (
    ALIGNED,
    Quaternion,
    body_of,
    check_turning,
    inertia,
    quaternion,
)
from rpo_core.files.codec import unless_default
from rpo_core.files.validation import Checked, InputError, flag, optional, real, vector3
from rpo_core.kernels.arithmetic import Vector, norm
from rpo_core.kernels.jit import kernel
from rpo_core.stage import ZERO, Place, Section, Signal, Stage, register
from rpo_core.wire import interfaces

_torque = partial(real, unit='N m', above=0.0, most=1e6)
_momentum = partial(real, unit='N m s', above=0.0, most=1e6)
_torques = partial(vector3, unit='N m', bound=1e6)
_momenta = partial(vector3, unit='N m s', bound=1e6)
_rates = partial(optional, check=vector3, unit='deg/s', bound=360.0)


@dataclass(frozen=True, kw_only=True)
class Wheels(Checked):
    """Three wheels, one along each axis of the chaser.

    torque_nm, momentum_nms : largest of each, momentum against inertial space
    start_nms : (3,) momentum at tick 0
    """

    torque_nm: Annotated[float, _torque]
    momentum_nms: Annotated[float, _momentum]
    start_nms: Annotated[Vector, _momenta] = unless_default(ZERO)

    def __post_init__(self) -> None:
        super().__post_init__()
        if max(map(abs, self.start_nms)) > self.momentum_nms:
            raise InputError(
                f'`start_nms` must be at most `momentum_nms`, {self.momentum_nms!r} N m s; '
                f'got {list(self.start_nms)!r}'
            )


@dataclass(frozen=True, kw_only=True)
class Chaser(Checked):
    """The chaser as a rigid body.

    inertia_kg_m2 : (3, 3) about its centre of mass, its axes
    Commands are turned into its axes by section `attitude_control`; without it they are in them.

    attitude : quaternion x, y, z, w at tick 0, from its axes to target LVLH
    rates_deg_s : (3,) at tick 0, its axes, against inertial space; None: it turns with target LVLH
    wheels : None: torque is that of `thrusters.table`
    gravity_gradient : whether gravity turns it
    disturbance_torque_nm : (3,) constant, its axes
    """

    inertia_kg_m2: Annotated[Any, inertia]
    attitude: Annotated[Quaternion, quaternion] = ALIGNED
    rates_deg_s: Annotated[Vector | None, _rates] = unless_default(None)
    wheels: Wheels | None = unless_default(None)
    gravity_gradient: Annotated[bool, flag] = unless_default(True)
    disturbance_torque_nm: Annotated[Vector, _torques] = unless_default(ZERO)

    def craft(self, orbit_rad_s: float) -> Craft:
        """Return the chaser as the kernels read it."""
        wheels, n = self.wheels, orbit_rad_s
        return Craft(
            body_of(self.inertia_kg_m2, n),
            3.0 * n * n if self.gravity_gradient else 0.0,
            wheels.torque_nm if wheels else 0.0,
            wheels.momentum_nms if wheels else 0.0,
            *map(float, self.disturbance_torque_nm),
        )

    def start(self, orbit_rad_s: float) -> Attitude:
        """Return quaternion and rate at tick 0."""
        n = orbit_rad_s
        if self.rates_deg_s is not None:
            p, q, r = map(radians, self.rates_deg_s)
        else:
            f = frame_of((*self.attitude, 0.0, 0.0, 0.0), body_of(self.inertia_kg_m2, n))
            p, q, r = n * f.zx, n * f.zy, n * f.zz
        found: Attitude = unit((*self.attitude, p, q, r))
        return found


@kernel
def _tick(  # type: ignore[no-untyped-def]
    a, wheels, force: Vector, wanted: Vector, outside: Vector, dt: float, c: Craft
):
    middle, end, wheels = chaser_tick(a, wheels, wanted, outside, dt, c)
    mean, shift = turned_force(force, a, middle, end, dt, c.body.orbit)
    return end, wheels, mean, shift


class AttitudeStage(Stage):
    """The chaser turns by a tick, and its thrust with it.

    memory : momentum of the wheels
    """

    name = 'attitude'
    outputs = (
        interfaces.EXERTED_FORCE,
        interfaces.THRUST_SHIFT,
        interfaces.WHEEL_MOMENTUM,
        interfaces.CHASER_ATTITUDE,
    )
    memory_ticks = None
    counts_ticks = False

    def __init__(self, settings: Chaser, scenario: Any) -> None:
        self._craft, self._dt_s = settings.craft(scenario.mean_motion_rad_s), scenario.dt_s
        self._start = settings.wheels.start_nms if settings.wheels else ZERO
        steered = scenario.named('attitude_control') is not None
        self._commanded = steered and settings.wheels is not None
        self._fired = getattr(scenario.thrusters, 'table', None) is not None
        self.inputs = (
            interfaces.CHASER_ATTITUDE,
            interfaces.THRUST,
            *([interfaces.BODY_TORQUE] if self._commanded else []),
            *([interfaces.EXERTED_TORQUE] if self._fired else []),
            *([interfaces.UNLOADING_TORQUE] if scenario.named('unloading') else []),
        )
        self.reset()

    def reset(self) -> None:
        """Begin with the wheels as at tick 0."""
        self._wheels: Vector = tuple(map(float, self._start))  # type: ignore[assignment]

    def step(self, tick: int, *inputs: Any) -> tuple[Signal, ...]:
        """Return mean force (3,) [N], LVLH, its shift (6,), the wheels, and the next attitude."""
        attitude, force, *torques = inputs
        wanted = torques[0] if self._commanded else ZERO
        outside = torques[self._commanded] if self._fired else ZERO
        if len(torques) > 2:  # the wheels take up what empties them
            wanted = tuple(a - b for a, b in zip(wanted, torques[2], strict=True))
        now = self._wheels
        following, self._wheels, mean, shift = _tick(
            attitude, now, force, wanted, outside, self._dt_s, self._craft
        )
        return mean, shift, now, following


def _check(settings: Chaser, scenario: Any) -> None:
    """Raise InputError where a scenario does not allow a chaser that turns."""
    rates = settings.start(scenario.mean_motion_rad_s)[4:]
    check_turning('attitude', norm(*rates), scenario)
    if scenario.named('estimator') is not None and scenario.named('attitude_control') is None:
        raise InputError(
            '`attitude_control` is missing: `estimator` takes commands to act as they are in LVLH'
        )


register(Section('attitude', Chaser, Place.ATTITUDE, AttitudeStage, _check))
