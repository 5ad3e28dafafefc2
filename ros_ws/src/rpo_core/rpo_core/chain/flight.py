# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A flight without ROS: the whole chain, tick by tick, with the bits that the nodes fly."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from rpo_core.chain.chain import Chain, start_of
from rpo_core.chain.driver import Driver
from rpo_core.control.controller import Controller
from rpo_core.control.controller_file import ControllerStage
from rpo_core.kernels.arrays import Floats
from rpo_core.scenario.scenario import Scenario, ScenarioSet
from rpo_core.stage import Place, Signal, Stage, sections
from rpo_core.wire.interfaces import (
    APPLIED_FORCE,
    CHASER_ATTITUDE,
    CHASER_MASS,
    COMMAND,
    CONTROL_FORCE,
    DISTURBANCE_FORCE,
    DUE_FORCE,
    EXERTED_FORCE,
    RELATIVE_STATE,
    SATURATED_FORCE,
    TARGET_ATTITUDE,
    THRUST_FORCE,
    UNLOADING_TORQUE,
    row_of,
)

_TAKEN = (DUE_FORCE, SATURATED_FORCE)
"""Commands that the thrusters have taken."""


JUDGED = (
    RELATIVE_STATE, CHASER_ATTITUDE, TARGET_ATTITUDE, CONTROL_FORCE, APPLIED_FORCE,
    DISTURBANCE_FORCE, SATURATED_FORCE,
)  # fmt: skip
"""Signals by which a flight is judged."""


class Thrust(NamedTuple):
    """What thrusters made of the commands of a flight.

    forces_n : (N, 3) mean force of each tick, target LVLH
    masses_kg : (N,) of the chaser in the middle of each tick
    delta_v_m_s : sum over the thrusters of thrust x time / mass
    propellant_kg : spent, 0 where the scenario has none
    openings : times that a valve opened
    """

    forces_n: Floats
    masses_kg: Floats
    delta_v_m_s: float
    propellant_kg: float
    openings: int


@dataclass(frozen=True, repr=False, eq=False)
class Flight:
    """One flight, sampled at ticks 0..N.

    states : (N+1, 6) x, y, z [m], vx, vy, vz [m/s], target LVLH
    forces_n : (N+1, 3) commanded force; the thrusters never took that of the last state
    disturbances_n : (N+1, 3) disturbance force, held for the tick
    signals : name -> (N+1, width) of the other signals of the chain, where they are known
    events : stage -> tick and state of what it got in flight
    spent : delta-v [m/s], propellant [kg], openings of valves up to the last state, where known
    """

    scenario: Scenario
    states: Floats
    forces_n: Floats
    disturbances_n: Floats
    signals: Mapping[str, Floats] = field(default_factory=dict)
    events: Mapping[str, Sequence[tuple[int, str]]] = field(default_factory=dict)
    spent: tuple[float, float, int] | None = None

    def __repr__(self) -> str:
        return f'<Flight {self.scenario.name}: {self.scenario.duration_s:g} s>'

    @cached_property
    def seen(self) -> Floats:
        """States (N+1, 6) as the target sees them; as they are where it has no attitude."""
        return self.scenario.seen(self.states)

    @cached_property
    def errors(self) -> Floats:
        """`seen` (N+1, 6) relative to the goal; metrics and requirements are about these."""
        return self.seen - np.array(self.scenario.goal_state)

    @property
    def positions_m(self) -> Floats:
        """Relative positions (N+1, 3) as the target sees them."""
        return self.seen[:, :3]

    @property
    def velocities_m_s(self) -> Floats:
        """Relative velocities (N+1, 3) as the target sees them."""
        return self.seen[:, 3:]

    @property
    def sent_forces_n(self) -> Floats:
        """Commands (N+1, 3) on their way to the thrusters: what assurance made of them."""
        sent = [n for n in self.signals if row_of(n).carries == COMMAND and n not in _TAKEN]
        return self.signals[sent[-1]] if sent else self.forces_n

    @cached_property
    def saturated_forces_n(self) -> Floats:
        """Commands (N, 3) that the thrusters took: late where they are, saturated."""
        if SATURATED_FORCE in self.signals:
            return self.signals[SATURATED_FORCE][:-1]
        stage = self._thrusters()
        made = stage.steps(np.arange(len(self.forces_n) - 1), *self._taken_by(stage))
        return made[stage.outputs.index(SATURATED_FORCE)]

    def _thrusters(self) -> Stage:
        stage = sections()['thrusters'].make(self.scenario.thrusters, self.scenario)
        stage.reset()
        for tick, state in self.events.get(stage.name, ()):
            stage.take_event(tick, state)
        return stage

    def _taken_by(self, thrusters: Stage) -> list[Floats]:
        """Return the inputs (N, 3) of the thrusters: the command as sent, and the torque if any."""
        others = (self.signal(name)[:-1] for name in thrusters.inputs[1:])
        return [self.sent_forces_n[:-1], *others]

    def signal(self, name: str) -> Floats:
        """Return a signal (N+1, width); a log lacks what empties the wheels: computed again.

        KeyError where it is not known.
        """
        if name in self.signals or name != UNLOADING_TORQUE:
            return self.signals[name]
        section = sections()['unloading']
        stage = section.make(self.scenario.named(section.name), self.scenario)
        return stage.steps(np.arange(len(self.forces_n)), *map(self.signal, stage.inputs))[0]

    @cached_property
    def thrust(self) -> Thrust:
        """What the thrusters made of the commands; computed again where that is not known."""
        scenario, spent, ticks = self.scenario, self.spent, len(self.forces_n) - 1
        known = dict(self.signals)
        if spent is None or not known.keys() & {EXERTED_FORCE, THRUST_FORCE}:
            stage = self._thrusters()
            made = stage.steps(np.arange(ticks), *self._taken_by(stage))
            known |= zip(stage.outputs, made, strict=True)
            spent = stage.spent()
        # Of a chaser with an attitude, what its thrusters make is in its own axes.
        forces_n = known[EXERTED_FORCE if EXERTED_FORCE in known else THRUST_FORCE][:ticks]
        masses_kg = np.full(ticks, scenario.mass_kg)
        if CHASER_MASS in known:
            masses_kg = known[CHASER_MASS][:ticks, 0]
        if spent is None:
            impulse = np.abs(self.saturated_forces_n).sum() * scenario.dt_s
            spent = float(impulse) / scenario.mass_kg, 0.0, 0
        return Thrust(forces_n, masses_kg, *spent)


class _CommandedForces(ControllerStage):
    """Commands that are known before the flight; they are not relative to a goal."""

    inputs = ()

    def __init__(self, forces_n: Floats) -> None:
        self._forces = forces_n.tolist()

    def step(self, tick: int, *inputs: Any) -> tuple[Signal, ...]:
        """Return the commanded force (3,) [N] of a tick; zero after the last one."""
        return (tuple(self._forces[tick]) if tick < len(self._forces) else (0.0, 0.0, 0.0),)


@dataclass(frozen=True)
class OpenLoop:
    """A controller that commands forces (n, 3) [N], one a tick, whatever the state is."""

    forces_n: Floats
    name: str = 'open loop'
    provenance: Mapping[str, Any] = field(default_factory=dict)

    def stage(self, dt_s: float) -> Stage:
        """Return the controller as a stage of the chain; its forces are held for any tick."""
        return _CommandedForces(self.forces_n)


def fly(
    scenario: Scenario,
    controller: Controller,
    more: Iterable[tuple[Place, Stage]] = (),
    kept: Collection[str] | None = None,
) -> Flight:
    """Return the flight of a controller through a scenario.

    more : stages that no section of the scenario names, in their places
    kept : signals that the flight keeps; None: all

    Raises InputError if the chain cannot be put together (`rpo_core.chain.chain.Chain.of`).
    """
    return fly_chain(scenario, Chain.of(scenario, controller, more), kept)


def fly_chain(scenario: Scenario, chain: Chain, kept: Collection[str] | None = None) -> Flight:
    """Return the flight of the whole chain of a scenario."""
    driver = Driver(chain, kept)
    return flight_of(scenario, driver.fly(start_of(scenario), scenario.ticks), driver.spent)


def flight_of(
    scenario: Scenario, signals: dict[str, Floats], spent: tuple[float, float, int] | None
) -> Flight:
    """Return a flight by its signals (N+1, width) and what it spent."""
    disturbances = signals.pop(DISTURBANCE_FORCE, None)
    return Flight(
        scenario,
        signals.pop(RELATIVE_STATE),
        signals.pop(CONTROL_FORCE),
        np.zeros((scenario.ticks + 1, 3)) if disturbances is None else disturbances,
        signals,
        spent=spent,
    )


def flights_of(controller: Controller, flown: Scenario | ScenarioSet) -> Iterator[Flight]:
    """Yield the flight of a controller through a scenario, or through each member of a set."""
    for scenario in [flown] if isinstance(flown, Scenario) else flown.scenarios():
        yield fly(scenario, controller)
