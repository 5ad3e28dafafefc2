# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Approach plans: section `guidance` of a scenario.

A plan is a list of legs, flown one after the other. Each leg begins where the one before ended, the
first one at the state of the chaser. After the last leg the reference stays where that one ends.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any

from rpo_core.files import codec
from rpo_core.files.codec import unless_default
from rpo_core.files.validation import (
    Checked,
    InputError,
    Name,
    choice,
    optional,
    real,
    shown,
    vector3,
)
from rpo_core.kernels.arithmetic import Vector
from rpo_core.scenario.scenario import MAX_VELOCITY_M_S
from rpo_core.world.starts import MAX_POSITION_M
from rpo_core.world.zones import NO_CORRIDOR, Corridor, Zone, Zones

TRANSFER, STRAIGHT, FLY_AROUND, HOLD = 'transfer', 'straight', 'fly_around', 'hold'
KINDS = (TRANSFER, STRAIGHT, FLY_AROUND, HOLD)

LVLH, TARGET = FRAMES = ('lvlh', 'target')

AUTO, COMMAND = 'auto', 'command'
"""Who ends a hold: its own conditions, or the command `go` while they are met."""

GO_ON, ABORT = 'go', 'abort'
"""What a hold does when its time is up."""

MAX_LEGS = 50

_position = partial(vector3, unit='m', bound=MAX_POSITION_M)
_velocity = partial(vector3, unit='m/s', bound=MAX_VELOCITY_M_S)
_time = partial(real, unit='s', least=0.0, most=1e6)
_some_time = partial(real, unit='s', above=0.0, most=1e6)
_speed = partial(real, unit='m/s', least=1e-6, most=10.0)
_way = partial(real, unit='m', least=0.0, most=100.0)
_some_mass = partial(real, unit='kg', above=0.0, most=1e6)


Point = Annotated[Vector | None, partial(optional, check=_position)]
Time = Annotated[float | None, partial(optional, check=_some_time)]
Speed = Annotated[float | None, partial(optional, check=_speed)]


@dataclass(frozen=True, kw_only=True)
class Leg(Checked):
    """One leg of a plan.

    kind : `transfer`, least energy in `duration_s`, around the keep-out sphere; with `burn_s` the
        thrusters fire at its two ends only. `straight`, at `speed_m_s`. `fly_around`, on an arc
        about the target, its radius changing evenly. `hold`, at one point
    frame : `lvlh`, or the axes of the `target`, which turn: a line, an arc or a hold is flown in
        them, a transfer to a point that moves with them. A hold is in those of the leg before
    to_m : (3,) where it ends, in its frame
    arrive_m_s : (3,) velocity there, of a transfer, in its frame
    corridor_s : so long before its end a transfer enters the corridor
    ease_s : so long before its end the force of a transfer begins to fall to zero, so that it does
        not end with a step. Such a transfer is planned tick by tick, and around nothing
    end_speed_m_s : of a straight leg, where it ends
    within_m, within_m_s : GO is given only while error and speed are no larger
    dwell_s : least time of a hold; timeout_s : longest, then `on_timeout`
    """

    name: Name
    kind: Annotated[str, partial(choice, known=KINDS)]
    frame: Annotated[str, partial(choice, known=FRAMES)] = unless_default(LVLH)
    to_m: Point = None
    arrive_m_s: Annotated[Vector, _velocity] = (0.0, 0.0, 0.0)
    duration_s: Time = None
    corridor_s: Time = None
    burn_s: Time = None
    ease_s: Time = unless_default(None)
    speed_m_s: Speed = None
    end_speed_m_s: Annotated[float, partial(real, unit='m/s', least=0.0, most=10.0)] = 0.0
    dwell_s: Annotated[float, _time] = 0.0
    go: Annotated[str, partial(choice, known=(AUTO, COMMAND))] = AUTO
    within_m: Annotated[float, partial(real, unit='m', above=0.0, most=1e3)] = 0.5
    within_m_s: Annotated[float, partial(real, unit='m/s', above=0.0, most=10.0)] = 0.05
    timeout_s: Time = None
    on_timeout: Annotated[str, partial(choice, known=(GO_ON, ABORT))] = ABORT

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, kinds in _KINDS_OF.items():
            if getattr(self, name) != _DEFAULTS[name] and self.kind not in kinds:
                raise InputError(
                    f'`{name}` needs a leg of kind {" or ".join(kinds)}; '
                    f'{self.name} is of kind {self.kind}'
                )
        for name in _NEEDED[self.kind]:
            if getattr(self, name) is None:
                raise InputError(f'`{name}` is missing; a leg of kind {self.kind} needs it')
        if self.kind == STRAIGHT and self.speed_m_s and self.end_speed_m_s > self.speed_m_s:
            raise InputError(
                f'`end_speed_m_s` must be at most `speed_m_s` = {self.speed_m_s!r}; '
                f'got {self.end_speed_m_s!r}'
            )
        if self.burn_s and self.duration_s and 2.0 * self.burn_s > self.duration_s:
            raise InputError(
                f'`burn_s` must be at most half of `duration_s` = {self.duration_s!r}; '
                f'got {self.burn_s!r}'
            )
        if self.ease_s and self.duration_s and self.ease_s > self.duration_s:
            raise InputError(
                f'`ease_s` must be at most `duration_s` = {self.duration_s!r}; got {self.ease_s!r}'
            )
        if self.ease_s and self.burn_s:
            raise InputError(f'`ease_s` and `burn_s` exclude each other; {self.name} has both')


_OF_KIND = {
    TRANSFER: ('frame', 'arrive_m_s', 'duration_s', 'corridor_s', 'burn_s', 'ease_s'),
    STRAIGHT: ('frame', 'speed_m_s', 'end_speed_m_s'),
    FLY_AROUND: ('frame', 'speed_m_s'),
    HOLD: ('dwell_s', 'go', 'within_m', 'within_m_s', 'timeout_s', 'on_timeout'),
}
_NEEDED = {
    TRANSFER: ('to_m', 'duration_s'),
    STRAIGHT: ('to_m', 'speed_m_s'),
    FLY_AROUND: ('to_m', 'speed_m_s'),
    HOLD: (),
}
_KINDS_OF = {
    name: [kind for kind, names in _OF_KIND.items() if name in names]
    for names in _OF_KIND.values()
    for name in names
}
_DEFAULTS = {name: Leg.__dataclass_fields__[name].default for name in _KINDS_OF}


@dataclass(frozen=True, kw_only=True)
class Guidance(Checked):
    """Settings of guidance.

    keep_out_m, port_m, corridor : as in section `zones`, unless they differ for guidance
    margin_m : by which transfers plan a larger sphere, for the errors of the flight
    retreat_m : (3,) where `retreat` leads
    abort_offset_m : by how much `abort` goes below (ahead of the target) or above (behind it), from
        where relative motion carries the chaser away without a force
    abort_s : time of the transfer there
    force_share : of the thrusters' force that the reference may need
    past_port_m : so far the reference goes on past the port, as it arrived there; 0: it stays
        there. A chaser that has come to the port, within so much, gets no more force: it has docked
    mass_kg : as guidance takes it; None: that of the scenario
    """

    legs: tuple[Leg, ...]
    keep_out_m: Annotated[float, partial(real, unit='m', least=0.0, most=1e4)] = 0.0
    margin_m: Annotated[float, partial(real, unit='m', least=0.0, most=1e3)] = 3.0
    corridor: Corridor = NO_CORRIDOR
    port_m: Annotated[Vector, _position] = (0.0, 0.0, 0.0)
    retreat_m: Point = None
    abort_offset_m: Annotated[float, partial(real, unit='m', above=0.0, most=1e3)] = 40.0
    abort_s: Annotated[float, _some_time] = 300.0
    force_share: Annotated[float, partial(real, unit='', least=1e-6, most=1.0)] = 0.6
    past_port_m: Annotated[float, _way] = unless_default(0.0)
    mass_kg: Annotated[float | None, partial(optional, check=_some_mass)] = unless_default(None)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 1 <= len(self.legs) <= MAX_LEGS:
            raise InputError(f'`legs` must be 1 to {MAX_LEGS} legs; got {shown(list(self.legs))}')
        for leg in self.legs:
            if leg.corridor_s and not self.corridor.from_m:
                raise InputError(f'`corridor_s` of leg {leg.name} needs `corridor.from_m`')
            if leg.ease_s and self.keep_out_m:
                raise InputError(
                    f'`ease_s` of leg {leg.name} needs a plan without a keep-out sphere; '
                    f'got `keep_out_m` = {self.keep_out_m!r}'
                )
        for i, leg in enumerate(self.legs):
            if leg.frame == TARGET and leg.kind != TRANSFER and not (i and self.turns(i - 1)):
                raise InputError(
                    f'`frame` target of leg {leg.name} needs a leg before it that ends in this '
                    'frame, a transfer for one'
                )
            if leg.frame == LVLH and leg.kind in (STRAIGHT, FLY_AROUND) and i and self.turns(i - 1):
                raise InputError(
                    f'leg {leg.name} must be a transfer, or have `frame` target as the leg before'
                )
        names = [leg.name for leg in self.legs]
        for name in names:
            if names.count(name) > 1:
                raise InputError(f'`legs` must have names of their own; {name} is there twice')

    def turns(self, i: int) -> bool:
        """Return whether leg i ends in the axes of the target."""
        while self.legs[i].kind == HOLD and i > 0:
            i -= 1
        return self.legs[i].frame == TARGET

    def zones(self, scenario: Any) -> Zone:
        """Return what views draw: sphere, corridor, holds, retreat; of a target what it sees."""
        points, end_m, lvlh = {}, None, scenario.target is None
        for i, leg in enumerate(self.legs):
            end_m = leg.to_m or end_m
            if leg.kind == HOLD and end_m is not None and (lvlh or self.turns(i)):
                points[leg.name] = end_m
        if self.retreat_m is not None and lvlh:
            points['retreat'] = self.retreat_m
        zones = Zones(keep_out_m=self.keep_out_m, port_m=self.port_m, corridor=self.corridor)
        return zones.zone(points)

    @staticmethod
    def of_zones(_document: Any, zones: Zones) -> Mapping[str, Any]:
        """Return the fields that are as the zones of the scenario, unless the section has them."""
        return codec.to_mapping(zones)
