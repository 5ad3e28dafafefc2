# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Verdicts: what a scenario requires (section `requirements`) beside the values of a flight.

A keep-out zone of any of its sections is required too, whoever commands.

The only place where they are computed: `final_approach`, `rpo simulate`, `rpo evaluate`, reports
and campaigns show these.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from rpo_core.chain.flight import Flight
from rpo_core.judge import contact, metrics
from rpo_core.scenario.requirements import ROWS, SHARES, THRUST, Requirements
from rpo_core.scenario.scenario import Scenario
from rpo_core.world.zones import AT_PORT_M, zones_of

HOLDS, MISSED, NOT_JUDGED = 'holds', 'MISSED', 'not flown'
UNBOUNDED = 'NOT judged'
"""The word beside what no requirement bounds."""

_HELD = tuple(name for name, row in ROWS.items() if row.needs == 'hold_from_s')

ZONE_DEPTH = 'zone_depth_m'
"""Key of the verdicts about keep-out zones, one for each zone."""


def number(value: float, unit: str = '', form: str = '.3g') -> str:
    """Return a value with its unit, for people; infinite: it never happens."""
    if math.isinf(value):
        return 'never'
    return '–' if math.isnan(value) else f'{value:{form}} {unit}'.strip()


class Verdict(NamedTuple):
    """A requirement beside the value of a flight.

    Attributes
    ----------
    key : str
        Name of the requirement in the scenario.
    statement : str
        What it is about, in words.
    unit : str
        Unit of limit and value.
    limit : float
        Largest value that holds.
    value : float
        Infinite where the flight never gets there; not a number where it ends too early.

    Examples
    --------
    >>> import rpo
    >>> rpo.fly('paper_test').requirements[-1]
    <slew per axis: 0.0799 of 0.1 N/s, holds>
    """

    key: str
    statement: str
    unit: str
    limit: float
    value: float

    @property
    def holds(self) -> bool | None:
        """Whether the flight keeps it; None where it ends before the requirement begins."""
        return None if math.isnan(self.value) else self.value <= self.limit

    @property
    def word(self) -> str:
        """The verdict as it is shown."""
        return {True: HOLDS, False: MISSED, None: NOT_JUDGED}[self.holds]

    @property
    def reached(self) -> str:
        """The value and the limit, in words."""
        return f'{number(self.value)} of {number(self.limit, self.unit)}'

    def __repr__(self) -> str:
        return f'<{self.statement}: {self.reached}, {self.word}>'


def verdicts(flight: Flight) -> list[Verdict]:
    """Return each requirement of the flight's scenario beside its value; none where none are."""
    required = flight.scenario.requirements
    judged = [] if required is None else _of_requirements(flight, required)
    return judged + _of_zones(flight)


def _of_requirements(flight: Flight, required: Requirements) -> list[Verdict]:
    values, judged = _values(flight.scenario, metrics.counts_of(flight)), []
    for key, limit in required.limits.items():
        if key in SHARES:
            limit *= metrics.disturbance_level_n(flight)
        shown = statement(key, required, flight.scenario.duration_s)
        judged.append(Verdict(key, shown, ROWS[key].unit, limit, values[key]))
    for key, limit in required.unjudged.items():
        shown = f'{ROWS[key].statement}: no section `attitude`'
        judged.append(Verdict(key, shown, ROWS[key].unit, limit, math.nan))
    return judged


def _values(scenario: Scenario, counts: list[float]) -> dict[str, float]:
    """Return requirement -> value of those that a scenario has; infinite where a flight is lost.

    counts : of the flight (`metrics.counts_of`)
    """
    required = scenario.requirements
    names = required.limits if required is not None else ()
    if not math.isfinite(counts[metrics.ENERGY]):
        return dict.fromkeys(names, math.inf)  # not a number in flight: nothing is kept
    values = {name: counts[metrics.COLUMNS[name]] for name in names}
    if (metrics.hold_tick(scenario) or 0) < scenario.ticks:
        return values
    return {name: math.nan if name in _HELD else value for name, value in values.items()}


def values_of(flight: Flight) -> dict[str, float]:
    """Return what a campaign keeps of a flight: name -> value.

    The metrics; the values of what its scenario requires and of what its thrusters spend; the final
    state; the level of the disturbance. The time of arrival is the required one, if one is.
    """
    counts = metrics.counts_of(flight)
    counted = dict(zip(metrics.UNITS, counts, strict=False))
    judged = _values(flight.scenario, counts)
    arrival_s = judged.get(metrics.ARRIVAL, counted[metrics.ARRIVAL])
    values = {**judged, **counted, metrics.ARRIVAL: arrival_s}
    if metrics.spends(flight.scenario):
        values |= zip(THRUST, counts[-len(THRUST) :], strict=True)
    values |= zip(metrics.FINAL, flight.states[-1].tolist(), strict=True)
    values[metrics.LEVEL] = metrics.disturbance_level_n(flight)
    return values


def missed(flight: Flight) -> bool:
    """Return whether a requirement that the flight is judged by is missed."""
    return any(verdict.holds is False for verdict in verdicts(flight))


def unbounded(scenario: Scenario, limits: Iterable[str] = ()) -> list[str]:
    """Return which of arrival, contact and end state no requirement bounds: nobody judges those.

    A contact is an arrival and an end; an error that stays within a limit up to the end is both.

    limits : names of limits by which it is judged too
    """
    required = scenario.requirements
    names = [*limits, *(required.limits if required else ())]
    if any(name.startswith('contact_') for name in names):
        return []
    found = ['contact'] if _docks(scenario) else []
    if any(name.startswith(('arrival_time', 'mean_error', 'hold_error')) for name in names):
        return found
    if not any(name.startswith('final_error') for name in names):
        return ['arrival', *found, 'end state']
    slow = any(name.startswith(('final_speed', 'mean_speed', 'hold_speed')) for name in names)
    return found if slow else [*found, 'end state']


def _docks(scenario: Scenario) -> bool:
    """Return whether a flight is to end at a port: of its guidance, or where its corridor leads."""
    tips = [zone.corridor.tip_m for zone in zones_of(scenario) if zone.corridor is not None]
    goal_m = scenario.goal_position_m
    at_tip = any(math.dist(tip, goal_m) <= AT_PORT_M for tip in tips)
    return at_tip or contact.dock_of(scenario) is not None


def _of_zones(flight: Flight) -> list[Verdict]:
    """Return how deep a flight comes into each keep-out zone of its scenario, beside none.

    Up to the contact: a docked chaser is where it shall be.
    """
    scenario, states = flight.scenario, flight.seen
    finite = bool(np.isfinite(states).all())
    docked = contact.caught_at(flight.errors, scenario.requirements, scenario.goal_position_m)
    states = states if docked is None else states[: docked + 1]
    return [
        Verdict(
            ZONE_DEPTH,
            f'depth inside {zones.keep_out}',
            'm',
            limit=0.0,
            value=zones.deepest_m(states, scenario.dt_s) if finite else math.inf,
        )
        for zones in zones_of(scenario)
        if zones.keep_out_m
    ]


def statement(key: str, required: Requirements, duration_s: float) -> str:
    """Return what a requirement is about, with its times and places."""
    axis, norm = required.arrival_error_per_axis_m, required.arrival_error_norm_m
    arrival = f'within {axis:g} m per axis' if axis is not None else f'within {norm or 0.0:g} m'
    least, angle = required.contact_least_closing_speed_m_s, required.corridor_half_angle_deg
    return ROWS[key].statement.format(
        mean=min(required.mean_window_s, duration_s),
        hold=required.hold_from_s or 0.0,
        arrival=arrival,
        contact=required.contact_range_m or 0.0,
        least='' if least is None else f', at least {least:g} m/s',
        zone=required.keep_out_m or 0.0,
        cone='' if angle is None else f', beside the corridor of {angle:g}°',
    )
