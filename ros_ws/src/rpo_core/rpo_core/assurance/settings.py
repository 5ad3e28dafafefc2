# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Section `assurance`: what shall never happen, and what the proof may assume."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any

from rpo_core.assurance.abort_table import AbortTable
from rpo_core.files import codec
from rpo_core.files.codec import unless_default
from rpo_core.files.validation import Checked, InputError, choice, optional, real
from rpo_core.scenario.requirements import DIRECTIONS
from rpo_core.world.disturbance import MAX_FORCE_N
from rpo_core.world.starts import MAX_POSITION_M
from rpo_core.world.zones import Cone, Zone, Zones, along_and_across, tangent

LEAST_CHANGE, SIMPLEX = 'least_change', 'simplex'
FILTERS = (LEAST_CHANGE, SIMPLEX)

_metres = partial(real, unit='m', least=0.0, most=MAX_POSITION_M)
_speed = partial(real, unit='m/s', least=0.0, most=1e3)


@dataclass(frozen=True)
class Speed(Checked):
    """Largest speed by range: speed_m_s + per_range_1_s rho + sqrt(2 deceleration_m_s2 rho).

    per_range_mean_motions : per_range_1_s in mean motions of the target, as some sources have it
    """

    speed_m_s: Annotated[float, partial(real, unit='m/s', above=0.0, most=1e3)]
    per_range_1_s: Annotated[float, partial(real, unit='1/s', least=0.0, most=1e3)] = 0.0
    deceleration_m_s2: Annotated[float, partial(real, unit='m/s^2', least=0.0, most=1e3)] = 0.0
    per_range_mean_motions: Annotated[float, partial(real, least=0.0, most=1e3)] = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        given = (self.per_range_1_s, self.deceleration_m_s2, self.per_range_mean_motions)
        if sum(value > 0.0 for value in given) > 1:
            raise InputError(
                '`speed` must grow with the range in one way, `per_range_1_s`, '
                f'`per_range_mean_motions` or `deceleration_m_s2`; got {given}'
            )

    def slope(self, mean_motion_rad_s: float) -> float:
        """Return what the limit gains per metre [1/s]."""
        return self.per_range_1_s + self.per_range_mean_motions * mean_motion_rad_s


SPEEDS = {
    'paper': Speed(0.1, per_range_1_s=0.03),
    'sqrt': Speed(0.12, deceleration_m_s2=0.023),
    'afrl': Speed(0.2, per_range_mean_motions=4.0),
}
"""Presets. `paper` suits the paper's 200 s; `sqrt` is half of what its thrusters can brake, and its
flights keep it; `afrl` is that of K. Dunlap et al., arXiv 2110.00447, eq. 14."""


def _speed_of(name: str, value: Any) -> Speed:
    if isinstance(value, Speed):
        return value
    if isinstance(value, str):
        return SPEEDS[choice(name, value, SPEEDS)]
    return codec.from_mapping(Speed, name, value)


@dataclass(frozen=True)
class Passage(Checked):
    """The way to the port through the keep-out sphere: a pyramid in a cone about an axis.

    along : axis from the target to the port, of target LVLH
    half_angle_deg : of the cone; port_m : distance of the port from the target's centre
    outer_m : range where the corridor begins
    width_m : half-width at the port: the largest lateral misalignment per axis
    closing_m_s, lateral_m_s : largest speeds at contact, along the axis and per axis across
    """

    along: Annotated[str, partial(choice, known=DIRECTIONS)]
    half_angle_deg: Annotated[float, partial(real, unit='deg', above=0.0, most=45.0)]
    port_m: Annotated[float, _metres]
    outer_m: Annotated[float, _metres]
    width_m: Annotated[float, partial(real, unit='m', above=0.0, most=100.0)] = 0.07
    closing_m_s: Annotated[float, partial(real, unit='m/s', above=0.0, most=10.0)] = 0.1
    lateral_m_s: Annotated[float, partial(real, unit='m/s', above=0.0, most=10.0)] = 0.028

    @property
    def slope(self) -> float:
        """What the half-width gains per metre: the pyramid lies in the cone."""
        return tangent(self.half_angle_deg) / math.sqrt(2.0)


def _corridor_of(name: str, value: Any) -> Passage | None:
    if value is None or isinstance(value, Passage):
        return value
    return codec.from_mapping(Passage, name, value)


Metres = Annotated[float | None, partial(optional, unit='m', least=0.0, most=MAX_POSITION_M)]
MetresPerSecond = Annotated[float | None, partial(optional, unit='m/s', least=0.0, most=1e3)]
Newtons = Annotated[float | None, partial(optional, unit='N', least=0.0, most=MAX_FORCE_N)]
Slew = Annotated[float | None, partial(optional, unit='N/s', above=0.0, most=MAX_FORCE_N)]
Share = Annotated[float | None, partial(optional, least=0.0, most=1.0)]
Degrees = Annotated[float | None, partial(optional, unit='deg', least=0.0, most=45.0)]
Kilograms = Annotated[float | None, partial(optional, unit='kg', above=0.0, most=1e6)]


@dataclass(frozen=True)
class Assurance(Checked):
    """What shall never happen, and what the proof may assume of the world.

    filter : the command with the least change, or the backup law where it would break a limit
    speed : preset or own limit of the speed by range
    keep_out_m : radius of the sphere about the target, as in section `zones`; 0: none
    corridor : the way in, as in section `zones`; None: there is none
    slew_n_s : largest change of an axis per second, kept as long as the sets allow it; None: any
    position_error_m, velocity_error_m_s : largest norm of the error of the state that it sees
    disturbance_n : largest norm of the force from outside
    thrust_error : largest norm of the thrust's error, as a share of the commanded force
    attitude_error_deg : largest angle by which the axes of section `target` are known wrong
    chaser_attitude_error_deg : with section `attitude`, largest angle between the chaser's attitude
        by which a force is turned, and the true one at any time of the tick in which it acts
    domain_m : largest range for which the constants hold
    mass_kg : as the filter takes it; where the scenario has another, that is a thrust error
    sigmas : with an estimator, an error of the state counts as at least so many of its sigmas; 0:
        its covariance is not looked at
    abort : table of faults that interrupt the flight; None: there is none
    None: as the scenario's own sections have it, so that its flights never break the assumption
    """

    filter: Annotated[str, partial(choice, known=FILTERS)] = LEAST_CHANGE
    speed: Annotated[Any, _speed_of] = 'sqrt'
    keep_out_m: Annotated[float, _metres] = 0.0
    corridor: Annotated[Any, _corridor_of] = unless_default(None)
    slew_n_s: Slew = unless_default(None)
    position_error_m: Metres = unless_default(None)
    velocity_error_m_s: MetresPerSecond = unless_default(None)
    disturbance_n: Newtons = unless_default(None)
    thrust_error: Share = unless_default(None)
    attitude_error_deg: Degrees = unless_default(None)
    chaser_attitude_error_deg: Degrees = unless_default(None)
    domain_m: Annotated[float, partial(real, unit='m', above=0.0, most=1e5)] = 500.0
    mass_kg: Kilograms = unless_default(None)
    sigmas: Annotated[float, partial(real, least=0.0, most=100.0)] = unless_default(0.0)
    abort: AbortTable | None = unless_default(None)

    def __post_init__(self) -> None:
        super().__post_init__()
        zone, way = self.keep_out_m, self.corridor
        if way is not None and not way.port_m < zone < way.outer_m <= self.domain_m:
            raise InputError(
                '`corridor` must lead through the zone, port_m < keep_out_m < outer_m <= domain_m; '
                f'got {way.port_m!r}, {zone!r}, {way.outer_m!r}, {self.domain_m!r}'
            )
        if way is not None and way.width_m >= 0.5 * zone:
            raise InputError(
                f'`corridor.width_m` must be below half of `keep_out_m`, {0.5 * zone!r} m; '
                f'got {way.width_m!r}'
            )
        if zone >= self.domain_m:
            raise InputError(f'`keep_out_m` must be < domain_m = {self.domain_m!r} m; got {zone!r}')

    def zones(self, _scenario: Any) -> Zone:
        """Return what views draw: sphere and corridor."""
        way, cone = self.corridor, None
        if way is not None:
            sign, axis = (1.0 if way.along[0] == '+' else -1.0), 'xyz'.index(way.along[1])
            ahead = tuple(sign if i == axis else 0.0 for i in range(3))
            tip = tuple(way.port_m * a for a in ahead)
            length_m = way.outer_m - way.port_m
            cone = Cone(tip, ahead, way.slope, length_m, way.width_m, square=True)
        return Zone(self.keep_out_m, cone)

    @staticmethod
    def of_zones(document: Any, zones: Zones) -> Mapping[str, Any]:
        """Return the fields that are as the zones of the scenario, unless the section has them.

        Raises InputError where it needs their corridor, and that is along no axis of LVLH.
        """
        fields: dict[str, Any] = {'keep_out_m': zones.keep_out_m}
        corridor_document = document.get('corridor') if isinstance(document, Mapping) else None
        if not isinstance(corridor_document, Mapping):
            return fields
        corridor = zones.corridor
        along, off = along_and_across(zones.port_m, (0.0, 0.0, 0.0), corridor.ahead)
        of_corridor = {
            'along': corridor.along,
            'half_angle_deg': corridor.half_angle_deg,
            'port_m': along,
            'outer_m': corridor.from_m,
        }
        if corridor.from_m and corridor.along and not any(off):
            fields['corridor'] = of_corridor
        elif of_corridor.keys() - corridor_document.keys():
            raise InputError(
                '`assurance.corridor` needs a `zones.corridor` with `from_m`, along an axis of '
                f'LVLH through the target and `port_m`; got {corridor!r}, {list(zones.port_m)!r}'
            )
        return fields
