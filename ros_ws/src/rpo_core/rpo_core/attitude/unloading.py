# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Thrusters that empty the wheels: section `unloading` of a scenario.

While a wheel has more than a momentum, the thrusters exert a torque against it, which the wheel
takes up: the chaser does not feel it. docs/safety.md, lemma 9, has what that bounds.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any

from rpo_core.attitude.chaser_kernels import unloaded, wheels_after
from rpo_core.files.validation import Checked, InputError, real
from rpo_core.kernels.arithmetic import Vector
from rpo_core.stage import Place, Section, Signal, Stage, register
from rpo_core.wire import interfaces


@dataclass(frozen=True, kw_only=True)
class Unloading(Checked):
    """When the thrusters empty the wheels.

    above_nms : momentum of a wheel above which they do
    torque_nm : of the thrusters about each axis
    """

    above_nms: Annotated[float, partial(real, unit='N m s', least=0.0, most=1e6)]
    torque_nm: Annotated[float, partial(real, unit='N m', above=0.0, most=1e6)]


class UnloadingStage(Stage):
    """The torque that empties the wheels; memory: their momentum, by the commands."""

    name = 'unloading'
    inputs = (interfaces.BODY_TORQUE,)
    outputs = (interfaces.UNLOADING_TORQUE,)
    memory_ticks = None
    counts_ticks = False

    def __init__(self, settings: Unloading, scenario: Any) -> None:
        self._wheels_as, self._dt_s = scenario.attitude.wheels, scenario.dt_s
        self._settings = settings
        self.reset()

    def reset(self) -> None:
        """Begin with the wheels as at tick 0."""
        self._wheels: Vector = self._wheels_as.start_nms

    def step(self, tick: int, *inputs: Any) -> tuple[Signal, ...]:
        """Return the torque (3,) [N m], axes of the chaser."""
        own, dt_s = self._settings, self._dt_s
        torque, spun = unloaded(self._wheels, own.above_nms, own.torque_nm, dt_s)
        self._wheels = wheels_after(spun, inputs[0], dt_s, self._wheels_as.momentum_nms)
        return (torque,)


def _check(settings: Unloading, scenario: Any) -> None:
    """Raise InputError where there is nothing to unload, or to unload with."""
    wheels = scenario.attitude.wheels if scenario.attitude else None
    table = scenario.thrusters.table if scenario.thrusters else None
    if wheels is None or table is None or scenario.named('attitude_control') is None:
        raise InputError(
            '`unloading` needs `attitude.wheels`, `attitude_control` and `thrusters.table`'
        )
    for name, most in (('above_nms', wheels.momentum_nms), ('torque_nm', wheels.torque_nm)):
        if getattr(settings, name) >= most:
            raise InputError(
                f'`unloading.{name}` must be below that of the wheels, {most!r}; '
                f'got {getattr(settings, name)!r}'
            )


register(Section('unloading', Unloading, Place.UNLOADING, UnloadingStage, _check))
