# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The attitude that a chaser shall have: section `pointing` of a scenario.

Near the port its axes are those of the docked attitude. Farther away its docking axis, and the
camera along it, looks at the port. The target's attitude is the known one.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from math import radians
from typing import Annotated, Any

from rpo_core.attitude.attitude_kernels import Attitude, Frame, synchronised
from rpo_core.attitude.chaser_kernels import turn
from rpo_core.attitude.pointing_kernels import Aim, begun, point
from rpo_core.attitude.target import ALIGNED, Quaternion, known_motion, of_vector, quaternion
from rpo_core.files.validation import Checked, InputError, real, vector3
from rpo_core.kernels.arithmetic import Vector, norm
from rpo_core.stage import Place, Section, Signal, Stage, register
from rpo_core.wire import interfaces
from rpo_core.wire.interfaces import ATTITUDE, STATE
from rpo_core.world.zones import Zones

LVLH = Frame(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, *(0.0,) * 6)
"""The frame of a target without attitude."""

NOWHERE: Quaternion = (0.0, 0.0, 0.0, 0.0)
"""The turn of the tick before the first one."""


@dataclass(frozen=True, kw_only=True)
class Pointing(Checked):
    """Where the chaser looks.

    mate : quaternion x, y, z, w from the chaser's axes to the target's when docked
    docking_axis : (3,) of the chaser, towards the port when docked
    align_within_m : distance of the port within which the attitude is the docked one; from twice
        as far on the axis looks at the port, by the smallest turn
    most_deg_s : largest rate of the docking axis against the target, and about it
    port_m : (3,) in the target's axes; as in section `zones`, unless it differs
    """

    mate: Annotated[Quaternion, quaternion] = ALIGNED
    docking_axis: Annotated[Vector, partial(vector3, unit='', bound=1e3)] = (0.0, -1.0, 0.0)
    align_within_m: Annotated[float, partial(real, unit='m', above=0.0, most=1e4)] = 5.0
    most_deg_s: Annotated[float, partial(real, unit='deg/s', above=0.0, most=90.0)] = 2.0
    port_m: Annotated[Vector, partial(vector3, unit='m', bound=1e4)] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if norm(*self.docking_axis) < 1e-6:
            raise InputError(
                f'`docking_axis` must be at least 1e-06 long; got {list(self.docking_axis)!r}'
            )

    def aim(self, dt_s: float) -> Aim:
        """Return the section as the kernels read it."""
        size = norm(*self.docking_axis)
        x, y, z = (a / size for a in self.docking_axis)
        # across it: less its part along the axis of the chaser that it is farthest from
        i = min(range(3), key=lambda j: abs((x, y, z)[j]))
        across = [(float(j == i)) - (x, y, z)[i] * a for j, a in enumerate((x, y, z))]
        size = norm(*across)
        a, b, c = (part / size for part in across)
        rate = radians(self.most_deg_s)
        return Aim(
            self.port_m,
            turn((x, y, z), self.mate),
            turn((a, b, c), self.mate),
            self.mate,
            (x, y, z),
            self.align_within_m,
            self.align_within_m,
            rate,
            of_vector((rate * dt_s, 0.0, 0.0))[0],
            dt_s,
        )

    @staticmethod
    def of_zones(_document: Any, zones: Zones) -> dict[str, Any]:
        """Return the fields that are as the zones of the scenario, unless the section has them."""
        return {'port_m': list(zones.port_m)}


class PointingStage(Stage):
    """The reference attitude of a tick; it remembers where it looked the tick before.

    It begins with the attitude of the chaser, where it has one.
    """

    name = 'pointing'
    outputs = (interfaces.REFERENCE_ATTITUDE,)
    memory_ticks = None

    def __init__(self, settings: Pointing, scenario: Any) -> None:
        self.aim, self._motion = settings.aim(scenario.dt_s), known_motion(scenario)
        n = scenario.mean_motion_rad_s
        self._still = synchronised(n), LVLH
        self.inputs = (STATE, ATTITUDE) if scenario.attitude else (STATE,)
        self.reset()

    def reset(self) -> None:
        """Forget where it looked."""
        self._before = NOWHERE

    def target(self, tick: int) -> tuple[Attitude, Frame]:
        """Return the known attitude of the target, and its frame; without, those of LVLH."""
        motion = self._motion
        return self._still if motion is None else (motion.attitude(tick), motion.frame(tick))

    def step(self, tick: int, *inputs: Any) -> tuple[Signal, ...]:
        """Return quaternion and rate (7,) to have."""
        target, f = self.target(tick)
        if self._before == NOWHERE and len(inputs) > 1:
            self._before = begun(inputs[1][:4], target)
        attitude, self._before = point(inputs[0][:6], target, f, self._before, self.aim)
        return (attitude,)


def _check(settings: Pointing, scenario: Any) -> None:
    """Raise InputError where a docked chaser would look away from the port."""
    zones = scenario.zones
    if zones is None or not zones.corridor.from_m:
        return
    axis, ahead = settings.aim(scenario.dt_s).axis, zones.corridor.ahead
    if sum(a * b for a, b in zip(axis, ahead, strict=True)) > 0.0:
        raise InputError(
            '`pointing.docking_axis`, turned by `mate`, must point against `corridor.axis`; '
            f'got {[round(a, 6) for a in axis]}'
        )


register(
    Section('pointing', Pointing, Place.POINTING, PointingStage, _check, of_zones=Pointing.of_zones)
)
