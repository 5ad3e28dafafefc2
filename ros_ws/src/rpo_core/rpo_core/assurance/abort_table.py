# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The abort table, `assurance.abort`: which quantities interrupt a flight, and how."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any

from rpo_core.files.codec import unless_default
from rpo_core.files.validation import (
    Checked,
    InputError,
    choice,
    flag,
    optional,
    real,
    vector3,
    whole,
)
from rpo_core.kernels.arithmetic import Vector
from rpo_core.stage import Place, section_of
from rpo_core.world.starts import MAX_POSITION_M

WARN, HOLD, RETREAT, DRIFT, ABORT = 'warn', 'hold', 'retreat', 'drift', 'abort'
REACTIONS = (WARN, HOLD, RETREAT, DRIFT, ABORT)
"""From the mildest on. Say so; stop and stay; fly back to `retreat_m`; no force; leave, on a path
that is clear of the keep-out sphere."""

QUANTITIES = {
    'range_m': 'range of the target [m]',
    'speed_m_s': 'speed [m/s]',
    'closing_excess_m_s': 'closing speed above the limit of `speed` at that range [m/s]',
    'off_corridor_m': 'distance outside the corridor, within its outer end [m]',
    'tracking_error_m': 'distance to the reference of guidance [m]',
    'tracking_error_m_s': 'difference of its velocity [m/s]',
    'pointing_error_deg': "angle of the chaser's attitude off its reference [deg]",
    'intervention': '1 where the filter changed the command of the tick before',
    'sigma_m': 'root of the trace of the covariance of the estimated position [m]',
    'sigma_m_s': 'the same of the velocity [m/s]',
    'missed': '1 where no command came in time',
    'impulse_n_s': 'impulse commanded so far, sum of all axes [N s]',
    'unexplained_n': 'force that the last change of velocity needed beside the commanded one [N]',
}
"""Quantity -> its meaning. All of them: the larger, the worse."""

_NEEDS = {
    'tracking_error_m': Place.GUIDANCE,
    'tracking_error_m_s': Place.GUIDANCE,
    'pointing_error_deg': Place.POINTING,
    'sigma_m': Place.ESTIMATOR,
    'sigma_m_s': Place.ESTIMATOR,
}
_LONGEST = 1_000_000


@dataclass(frozen=True, kw_only=True)
class Row(Checked):
    """A row of the table: a fault holds when `count` of the last `window` ticks exceed `most`."""

    quantity: Annotated[str, partial(choice, known=QUANTITIES)]
    most: Annotated[float, partial(real, least=0.0, most=1e9)]
    reaction: Annotated[str, partial(choice, known=REACTIONS)]
    count: Annotated[int, partial(whole, least=1, most=_LONGEST)] = 1
    window: Annotated[int, partial(whole, least=1, most=_LONGEST)] = 1

    def __post_init__(self) -> None:
        super().__post_init__()
        whole('count', self.count, least=1, most=self.window)


_retreat = partial(optional, check=vector3, unit='m', bound=MAX_POSITION_M)


@dataclass(frozen=True, kw_only=True)
class AbortTable(Checked):
    """When a flight is interrupted, and how.

    table : rows; where several begin to hold at once, the last of REACTIONS acts
    armed : whether the table reacts from the start; if not, it warns only
    retreat_m : (3,) target LVLH, where `retreat` leads
    hold_s : a hold by the table that lasts so long becomes an abort
    drag_m_s2, stuck_s, orbits : an abort is chosen so that its path is clear for so many orbits,
        with an acceleration along the orbit of at most so much either way, and one thruster stuck
        on for so long
    """

    table: tuple[Row, ...]
    armed: Annotated[bool, flag] = True
    retreat_m: Annotated[Vector | None, _retreat] = unless_default(None)
    hold_s: Annotated[float, partial(real, unit='s', above=0.0, most=1e6)] = 120.0
    drag_m_s2: Annotated[float, partial(real, unit='m/s^2', least=0.0, most=1.0)] = 1.2e-6
    stuck_s: Annotated[float, partial(real, unit='s', least=0.0, most=1e3)] = 30.0
    orbits: Annotated[float, partial(real, least=0.0, most=100.0)] = 2.0

    @property
    def watches_pointing(self) -> bool:
        """Whether a row looks at the attitude of the chaser."""
        return any(row.quantity == 'pointing_error_deg' for row in self.table)

    def __post_init__(self) -> None:
        super().__post_init__()
        names = [row.quantity + row.reaction for row in self.table]
        for row, name in zip(self.table, names, strict=True):
            if names.count(name) > 1:
                raise InputError(
                    f'`table` must have one row for {row.quantity} with reaction {row.reaction}; '
                    f'got {names.count(name)}'
                )
            if row.reaction == RETREAT and self.retreat_m is None:
                raise InputError(f'`retreat_m` is missing; the row of {row.quantity} needs it')


def check_table(table: AbortTable, scenario: Any, keep_out_m: float, corridor: Any) -> None:
    """Raise InputError if a scenario lacks what a row looks at, or the retreat is in the zone."""
    places = {section_of(s).place: section_of(s).name for s in scenario.sections}
    for row in table.table:
        needed = _NEEDS.get(row.quantity)
        if needed is not None and needed not in places:
            raise InputError(
                f'`assurance.abort.table` must look at what the scenario has: {row.quantity} needs '
                f'section `{needed.name.lower()}`; got {", ".join(places.values())}'
            )
        if row.quantity == 'off_corridor_m' and corridor is None:
            raise InputError('`assurance.corridor` is missing; row off_corridor_m needs it')
    if table.watches_pointing and scenario.attitude is None:
        raise InputError('`attitude` is missing; row pointing_error_deg needs it')
    if table.retreat_m is not None:
        distance = sum(r * r for r in table.retreat_m) ** 0.5
        if distance <= keep_out_m:
            raise InputError(
                '`assurance.abort.retreat_m` and `keep_out_m` exclude each other: it is '
                f'{distance:.6g} m from the target, inside the sphere of {keep_out_m:.6g} m'
            )
