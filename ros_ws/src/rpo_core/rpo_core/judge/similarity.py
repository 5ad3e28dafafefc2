# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Similarity: a closed loop and a scenario as numbers without units.

With L as unit of length, T of time and m L / T^2 of force, m r'' = F(r, v) + d is the same equation
for every vehicle. Loops whose similarity numbers agree fly the same flight, in other units. What a
controller was made for says its provenance: the scenario of its training, or for a scaled one
(`rpo scale`) the units too.
"""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from rpo_core.chain.flight import Flight
from rpo_core.control.controller import AnyController, FuzzyController
from rpo_core.control.controller_file import Scaling
from rpo_core.files.validation import InputError, real
from rpo_core.judge.verdicts import unbounded, verdicts
from rpo_core.scenario.scenario import Scenario, ScenarioSet, load

PAPER = 'paper_training'
"""What a controller was made for whose provenance names no scenario."""

SCALED = 'scaled'
"""Field of the provenance of a scaled controller: `trained_for`, and multiples of these units."""

MUCH = 1.5
"""Factor by which a number differs much."""

AUTHORITY, START, TIME = 'authority F T²/(m L)', 'start / L', 'time allowed / T'

HARDER = {
    AUTHORITY: (-1, 'the force saturates where it did not'),
    'orbital coupling n T': (1, 'the orbit bends the flight more'),
    'tick and delay / T': (1, 'the command comes later'),
    'disturbance / F': (1, 'the disturbance pushes farther off'),
    START: (1, 'it starts farther away than it was made for'),
    TIME: (-1, 'less time to come to rest'),
    'allowed error / L': (-1, 'it must rest closer'),
    'allowed speed T / L': (-1, 'it must rest slower'),
    'allowed slew T / F': (-1, 'its force must change more slowly'),
}
"""Similarity number -> whether more (1) or less (-1) of it is harder, and what that means."""


class Units(NamedTuple):
    """Length, time and mass: the units in which a loop has its similarity numbers."""

    length_m: float
    time_s: float
    mass_kg: float

    @property
    def force_n(self) -> float:
        """Unit of force."""
        return self.mass_kg * self.length_m / (self.time_s * self.time_s)


class MadeFor(NamedTuple):
    """What a controller was made for.

    name, trained : scenario of its training, and the units of that
    own : the units in which the controller has the numbers that the training had
    numbers : similarity numbers of the training
    """

    name: str
    trained: Units
    own: Units
    numbers: dict[str, float | None]


def base_of(asked: Scenario | ScenarioSet) -> Scenario:
    """Return what the members of a set share, or the scenario itself."""
    return asked.base if isinstance(asked, ScenarioSet) else asked


def range_m(asked: Scenario | ScenarioSet) -> float:
    """Return the largest distance of an axis between a start and the goal."""
    base = base_of(asked)
    starts = asked.initial_positions_m if isinstance(asked, ScenarioSet) else base.start[:3]
    return float(np.abs(np.array(starts) - np.array(base.goal_position_m)).max())


def time_s(base: Scenario) -> float:
    """Return the time until which a flight must be at its goal."""
    required = base.requirements
    times = [base.duration_s]
    if required is not None:
        times += [t for t in (required.arrival_time_s, required.hold_from_s) if t]
    return min(times)


def units_of(asked: Scenario | ScenarioSet) -> Units:
    """Return the units of what a scenario asks; raises InputError where it starts at its goal."""
    if range_m(asked) == 0.0:
        raise InputError(f'scenario {asked.name} starts at its goal; scaling needs another start')
    base = base_of(asked)
    return Units(range_m(asked), time_s(base), base.mass_kg)


def force_of(controller: AnyController) -> float:
    """Return the largest force of an axis that a controller commands [N]."""
    if isinstance(controller, FuzzyController):
        return controller.force_scale_n
    return controller.max_force_n


def numbers(asked: Scenario | ScenarioSet, units: Units, force_n: float) -> dict[str, float | None]:
    """Return the similarity numbers of a loop in a scenario, in its units; None: not limited.

    force_n : largest force that the controller commands on an axis; the vehicle may have less
    """
    base = base_of(asked)
    length, time, mass = units
    force = min(force_n, base.max_force_n)
    limits = {} if base.requirements is None else base.requirements.limits
    least = {
        part: min((limit for key, limit in limits.items() if part in key), default=None)
        for part in ('_error_', '_speed_', 'slew')
    }
    pushed = np.abs(base.disturbances_n).max(initial=0.0)
    ticks = 1 + getattr(base.thrusters, 'delay_ticks', 0)
    values = (
        force * time * time / (mass * length),
        base.mean_motion_rad_s * time,
        ticks * base.dt_s / time,
        float(pushed) / force,
        range_m(asked) / length,
        time_s(base) / time,
        None if least['_error_'] is None else least['_error_'] / length,
        None if least['_speed_'] is None else least['_speed_'] * time / length,
        None if least['slew'] is None else least['slew'] * time / force,
    )
    return dict(zip(HARDER, values, strict=True))


def made_for(controller: AnyController) -> MadeFor:
    """Return what a controller was made for; raises InputError where that cannot be loaded."""
    provenance = controller.provenance
    scaled = provenance.get(SCALED)
    scaled = scaled if isinstance(scaled, Mapping) else {}
    name = str(scaled.get('trained_for', provenance.get('scenario', PAPER)))
    asked = load(name)
    length, time, mass = (
        real(f'{SCALED}.{key}', scaled.get(key, 1.0), above=0.0)
        for key in ('length', 'time', 'mass')
    )
    trained = units_of(asked)
    own = Units(trained.length_m * length, trained.time_s * time, trained.mass_kg * mass)
    force_n = force_of(controller) / own.force_n * trained.force_n
    return MadeFor(name, trained, own, numbers(asked, trained, force_n))


def factor(name: str, made: float | None, here: float | None) -> float | None:
    """Return how many times harder a number is; None where either is not limited, or 0."""
    if not made or not here:
        return None
    return here / made if HARDER[name][0] > 0 else made / here


def command(controller: str, scenario: str, changes: Sequence[str] = ()) -> str:
    """Return the command that scales a controller for a scenario with fields changed."""
    words = ['rpo', 'scale', controller, '--scenario', scenario]
    return shlex.join([*words, *(word for change in changes for word in ('--set', change))])


def hint(flight: Flight, controller: AnyController, scale: str) -> str:
    """Return a line that says what a flight lacks: scaling, or a guidance leg; '' if neither.

    scale : the `command`
    """
    lost = [verdict.key for verdict in verdicts(flight) if verdict.holds is False]
    if lost and (line := _scale_hint(flight.scenario, controller, scale)):
        return line
    contact = any(key.startswith('contact_') for key in lost)
    contact |= 'contact' in unbounded(flight.scenario)
    if not contact or flight.scenario.named('guidance') is not None:
        return ''
    return (
        f'{controller.name} holds at its goal, so nothing sets its speed at the port. Contact '
        'needs a guidance leg: add a section `guidance` whose last leg ends at the port with the '
        'velocity `arrive_m_s` (docs/guidance.md).'
    )


def _scale_hint(scenario: Scenario, controller: AnyController, scale: str) -> str:
    """Return a line that names the command `scale` where scaling may help; else ''."""
    try:
        controller.scaled(Scaling(1.0, 1.0, 1.0, scenario))  # whether it says how it scales
        name, _, own, made = made_for(controller)
        units_of(scenario)  # whether it starts away from its goal
    except InputError:
        return ''
    here = numbers(scenario, own._replace(mass_kg=scenario.mass_kg), force_of(controller))
    for key in (AUTHORITY, *(() if scenario.sections else (START, TIME))):
        by = factor(key, made[key], here[key]) or 1.0
        if by > MUCH or (key == AUTHORITY and by < 1.0 / MUCH):
            return (
                f'{controller.name} was made for {name}, where {key} is {made[key]:.3g}; here it '
                f'is {here[key]:.3g}. `{scale}` scales it.'
            )
    return ''
