# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What a scenario requires of its flights: section `requirements`. `verdicts` judges by it.

Requirements change no flight. `per_axis`: the largest absolute value of any axis. `norm`: of the
vector. Errors are positions relative to the goal.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import partial
from pathlib import Path
from typing import Annotated, Any

from rpo_core import files
from rpo_core.files import codec
from rpo_core.files.validation import Checked, InputError, choice, mapping, optional, real
from rpo_core.world.zones import Zones

DIRECTIONS = ('+x', '-x', '+y', '-y', '+z', '-z')
"""Axes of target LVLH, by which a chaser comes in."""

ARRIVAL_WINDOW_S = 30.0
MAX_ARRIVAL_SPEED_M_S = 0.05
MAX_SLEW_N_S = 0.1
MAX_ARRIVAL_DISTANCE_M = 0.5
"""Conditions of the paper's training, and arrival, ours: without it doing nothing is nearly optimal
(the paper says 'to reach the target')."""

MEAN_WINDOW_S = 30.0
"""The means are over the last 30 s, as in the paper, if the file does not say."""


@dataclass(frozen=True)
class Row:
    """One requirement: what the loader, verdicts, campaigns, searches and reports know of it.

    unit : of its value, as tables show it; statement : what it is about, with times and places
    needs : the setting without which it means nothing
    effort : whether it is about what thrusters do; the others are about position and speed
    share : the metric that it is about, where the limit is a share of the largest |disturbance| of
        an axis in the flight
    thrusters : what of these a scenario's thrusters must have, one of them
    attitude : whether the chaser must have one
    """

    unit: str
    statement: str
    needs: str = ''
    effort: bool = False
    share: str = ''
    thrusters: tuple[str, ...] = ()
    attitude: bool = False


_WRITTEN = files.parse_yaml(Path(__file__).with_suffix('.yaml').read_text(encoding='utf-8'))

ROWS = {
    name: Row(**{**row, 'thrusters': tuple(row.get('thrusters', ()))})
    for name, row in _WRITTEN['rows'].items()
}
"""Requirement -> what is known of it, in the order in which they are shown."""

LIMITS = tuple(ROWS)
"""Fields of `Requirements` that are limits; the others say when or where the limits hold."""

THRUST = {name: row.unit for name, row in ROWS.items() if row.thrusters}
"""Requirement -> unit of what thrusters spend, in the order of `rpo_core.chain.flight.Thrust`."""

SHARES = {name: row.share for name, row in ROWS.items() if row.share}
"""Requirement whose limit is a share of the level of the disturbance -> the metric it is about."""

PORT = 'port'
"""Value of `contact_axis` in a file: the axis of the corridor of section `zones`."""

PROFILES: dict[str, dict[str, Any]] = _WRITTEN['profiles']
"""Requirements that a section may name; its other fields override them, or add to them."""

ATTITUDES = tuple(name for name, row in ROWS.items() if row.attitude)
"""Requirements on the chaser's attitude at contact: angle, rate."""

_NEEDS = {
    key: tuple(name for name, row in ROWS.items() if row.needs == key)
    for key in dict.fromkeys(row.needs for row in ROWS.values() if row.needs)
} | {'arrival_time_s': ('arrival_error_per_axis_m', 'arrival_error_norm_m')}
"""Field -> fields that mean nothing without it."""

_BESIDE = {
    'contact_axis': 'contact_range_m',
    'contact_least_closing_speed_m_s': 'contact_range_m',
    'corridor_half_angle_deg': 'contact_axis',
}
"""Setting -> setting that it needs."""


def _limit(name: str, value: Any) -> float | None:
    """Return a limit >= 0, None where there is none."""
    unit = '' if ROWS[name].share else ROWS[name].unit
    number: float | None = optional(name, value, unit=unit, least=0.0, most=1e9)
    return number


Limit = Annotated[float | None, _limit]
Metres = Annotated[float | None, partial(optional, unit='m', least=0.0, most=1e9)]
SomeMetres = Annotated[float | None, partial(optional, unit='m', above=0.0, most=1e9)]
MetresPerSecond = Annotated[float | None, partial(optional, unit='m/s', least=0.0, most=1e9)]
Seconds = Annotated[float | None, partial(optional, unit='s', least=0.0, most=1e9)]
Profile = Annotated[str | None, partial(optional, check=choice, known=PROFILES)]
Direction = Annotated[str | None, partial(optional, check=choice, known=DIRECTIONS)]
Angle = Annotated[float | None, partial(optional, unit='deg', above=0.0, most=60.0)]


@dataclass(frozen=True, kw_only=True)
class Requirements(Checked):
    """Upper limits; None: no requirement.

    profile : one of `PROFILES`, whose limits these are but for what a file changes
    final : at the last state
    mean : means over the last `mean_window_s`
    hold : at all states after `hold_from_s`, not judged where the flight ends earlier;
        `force_per_disturbance` is the largest |force| of an axis as a share of the largest
        |disturbance| of an axis over the flight
    arrival : the error stays within the limit from a time on, at most `arrival_time_s`
    contact : at the first state within `contact_range_m` of the goal; closing along the line of
        sight, lateral across it. With `contact_axis`, that of the port outward: at the first such
        state that has come to the port's plane, along the axis and across it. Slower than
        `contact_least_closing_speed_m_s` nothing catches, and there is no contact. Angles: between
        the attitude and `mate` of section `pointing`, each 2 sin(half of the turn) along an axis
    keep_out_depth : how far, before the contact, inside the sphere of `keep_out_m` about the target
        and beside the cone of `corridor_half_angle_deg` about `contact_axis`, which at the goal
        is as wide as `contact_range_m` to each side
    delta_v_axis_sum : integral of |f_x| + |f_y| + |f_z| over the mass
    thruster_delta_v, propellant, valve_openings : what thrusters with `pulses` or `propellant`
        spent in the flight, waste included
    """

    profile: Profile = None
    final_error_per_axis_m: Limit = None
    final_error_norm_m: Limit = None
    final_speed_per_axis_m_s: Limit = None
    final_speed_norm_m_s: Limit = None
    mean_window_s: Annotated[float, partial(real, unit='s', above=0.0, most=1e9)] = MEAN_WINDOW_S
    mean_error_norm_m: Limit = None
    mean_speed_norm_m_s: Limit = None
    hold_from_s: Seconds = None
    hold_error_per_axis_m: Limit = None
    hold_error_norm_m: Limit = None
    hold_speed_per_axis_m_s: Limit = None
    hold_speed_norm_m_s: Limit = None
    hold_force_per_axis_n: Limit = None
    hold_force_per_disturbance: Limit = None
    arrival_time_s: Limit = None
    arrival_error_per_axis_m: Metres = None
    arrival_error_norm_m: Metres = None
    contact_range_m: SomeMetres = None
    contact_axis: Direction = None
    contact_least_closing_speed_m_s: MetresPerSecond = None
    contact_closing_speed_m_s: Limit = None
    contact_lateral_speed_m_s: Limit = None
    contact_angle_deg: Limit = None
    contact_rate_deg_s: Limit = None
    keep_out_m: SomeMetres = None
    corridor_half_angle_deg: Angle = None
    keep_out_depth_m: Limit = None
    slew_per_axis_n_s: Limit = None
    energy_n2s: Limit = None
    delta_v_axis_sum_m_s: Limit = None
    thruster_delta_v_m_s: Limit = None
    propellant_kg: Limit = None
    valve_openings: Limit = None

    def __post_init__(self) -> None:
        super().__post_init__()
        for key, limits in _NEEDS.items():
            given = [name for name in limits if getattr(self, name) is not None]
            if given and getattr(self, key) is None:
                raise InputError(f'`{key}` is missing; `{given[0]}` needs it')
            if not given and getattr(self, key) is not None:
                raise InputError(f'`{key}` must go with one of {", ".join(limits)}; got none')
        for key, other in _BESIDE.items():
            if getattr(self, key) is not None and getattr(self, other) is None:
                raise InputError(f'`{other}` is missing; `{key}` needs it')
        if not self.limits:
            raise InputError(f'`requirements` must have a limit, like `{LIMITS[0]}`; got none')
        if self.arrival_error_per_axis_m is not None and self.arrival_error_norm_m is not None:
            raise InputError(
                '`arrival_time_s` must go with `arrival_error_per_axis_m` or '
                '`arrival_error_norm_m`; got both'
            )

    def check_scenario(self, thrusters: Any, attitude: Any) -> None:
        """Raise InputError where they limit what a scenario's sections do not spend or have."""
        for name, row in ROWS.items():
            if getattr(self, name) is None:
                continue
            if row.attitude and attitude is None:
                raise InputError(f'`requirements.{name}` needs section `attitude`; got none')
            has = any(getattr(thrusters, part, None) is not None for part in row.thrusters)
            if row.thrusters and not has:
                what = ' or '.join(f'`{part}`' for part in row.thrusters)
                raise InputError(f'`requirements.{name}` needs thrusters with {what}; got none')

    @property
    def limits(self) -> dict[str, float]:
        """Name -> limit of what is required, in the order of the fields."""
        values = {name: getattr(self, name) for name in LIMITS}
        return {name: limit for name, limit in values.items() if limit is not None}

    @property
    def unjudged(self) -> dict[str, float]:
        """Limits of the profile that it leaves out, for the scenario has no attitude."""
        profile = PROFILES.get(self.profile or '', {})
        return {n: v for n, v in profile.items() if n in ROWS and n not in self.limits}

    def to_document(self) -> dict[str, float | str]:
        """Return the section as `parse` reads it."""
        values = {f.name: getattr(self, f.name) for f in fields(self)}
        profile = PROFILES.get(self.profile or '', {})
        return {n: v for n, v in values.items() if v is not None and v != profile.get(n)}


def of_zones(document: Mapping[str, Any], zones: Zones) -> dict[str, Any]:
    """Return the fields that are as the zones of the scenario, unless the section has them."""
    if 'keep_out_depth_m' not in document:
        return {}
    fields_of_zones: dict[str, Any] = {'keep_out_m': zones.keep_out_m}
    if zones.corridor.from_m and 'contact_axis' in document:
        fields_of_zones['corridor_half_angle_deg'] = zones.corridor.half_angle_deg
    return fields_of_zones


def parse(value: Any, zones: Zones | None = None, attitude: bool = False) -> Requirements:
    """Return the section `requirements` of a scenario file; raises InputError.

    zones : section `zones`, where the file has it; attitude : whether the chaser has one
    """
    if isinstance(value, Mapping) and value.get('profile') in list(PROFILES):
        profile = dict(PROFILES[value['profile']])
        if zones is None or not zones.corridor.from_m:
            del profile['contact_axis']
        for name in () if attitude else ATTITUDES:
            profile.pop(name, None)
        value = {**profile, **value}
    names = [f.name for f in fields(Requirements)]
    if zones is not None and isinstance(value, Mapping):
        value = {**of_zones(value, zones), **value}
        if value.get('contact_axis') == PORT:
            value['contact_axis'] = zones.corridor.along
    for name, item in mapping('requirements', value, (), names).items():
        if item is None:
            raise InputError(f'`requirements.{name}` must be a number; got nothing')
    return codec.from_mapping(Requirements, 'requirements', value)
