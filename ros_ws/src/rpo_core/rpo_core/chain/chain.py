# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The chain of stages: the tick of a flight, written once.

    dynamics -truth-> sensor -> estimator -> guidance -> controller -> assurance -> thrusters
       ^------------------------------ force, disturbance <-----------------------------'

At tick k each stage reads signals made before it, in the order of their places; the dynamics make
the true state of tick k + 1. Each place may be empty. `rpo_core.chain.flight.fly` flies a whole
chain, a node a part of it, `rpo verify` each stage on its logged inputs.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cached_property
from typing import NamedTuple

from rpo_core.control.controller import Controller
from rpo_core.control.controller_file import FollowStage
from rpo_core.files.validation import InputError
from rpo_core.scenario.scenario import Scenario
from rpo_core.stage import ZERO, Place, Signal, Stage, section_of, sections
from rpo_core.wire import interfaces
from rpo_core.wire.interfaces import (
    ATTITUDE,
    CHASER_ATTITUDE,
    COMMAND,
    DISTURBANCE,
    NEXT,
    RELATIVE_STATE,
    STATE,
)
from rpo_core.world.disturbance import DisturbanceStage

Signals = dict[str, Signal]

NO_FORCE = ''
"""The signal that is read where nothing carries a force: zero."""


class Link(NamedTuple):
    """A stage in its place, and the names of the signals that it reads."""

    place: Place
    stage: Stage
    reads: tuple[str, ...]


class Chain:
    """Stages in a row.

    links : stages, in the order in which a tick passes them
    remembered : signals that a stage, here or in the rest of the chain, reads one tick later
    """

    def __init__(self, links: Sequence[Link], remembered: Sequence[str] = ()) -> None:
        self.links, self._remembered = tuple(links), tuple(remembered)
        reads = {name for link in links for name in link.reads}
        self._previous = tuple(name for name in reads if interfaces.current(name) != name)
        ends = any(link.place is Place.DYNAMICS for link in links)  # the tick ends here
        self._carried = self._remembered if ends else ()

    @classmethod
    def of(
        cls,
        scenario: Scenario,
        controller: Controller | None = None,
        more: Iterable[tuple[Place, Stage]] = (),
    ) -> Chain:
        """Return the chain of a scenario and a controller.

        more : stages that no section of the scenario names, in their places

        Raises InputError if the controller counts ticks of another length, or a stage reads a
        signal that nothing before it makes.
        """
        unnamed = [s for s in sections().values() if s.always and scenario.named(s.name) is None]
        placed = [(section.place, section.make(None, scenario)) for section in unnamed]
        placed += more
        for settings in scenario.sections:
            section = section_of(settings)
            placed.append((section.place, section.make(settings, scenario)))
        if controller is not None:
            guided = any(place is Place.GUIDANCE for place, _ in placed)
            placed.append((Place.CONTROLLER, _controlling(scenario, controller, guided)))
        if not scenario.disturbance.is_zero:
            stage = DisturbanceStage(scenario.disturbance, scenario.dt_ns)
            placed.append((Place.DISTURBANCE, stage))
        placed.sort(key=lambda pair: pair[0])
        links = _wired(placed, open_loop=controller is None)
        reads = {name for link in links for name in link.reads}
        return cls(links, [interfaces.current(n) for n in reads if interfaces.current(n) != n])

    @property
    def inputs(self) -> tuple[str, ...]:
        """Signals that it reads and does not make, each once; those of NEXT where they are read."""
        made: set[str] = {NO_FORCE}
        made |= {interfaces.previous(name) for name in self._carried}
        names: dict[str, None] = {}
        for link in self.links:
            names.update((name, None) for name in link.reads if name not in made)
            made |= {name for name in link.stage.outputs if name not in NEXT}
        return tuple(names)

    @property
    def outputs(self) -> tuple[str, ...]:
        """Signals that it makes."""
        return tuple(name for link in self.links for name in link.stage.outputs)

    @cached_property
    def memory_ticks(self) -> int | None:
        """How many earlier ticks the outputs depend on; None: all."""
        depths = [link.stage.memory_ticks for link in self.links]
        return None if None in depths else sum(depth or 0 for depth in depths)

    @cached_property
    def counts_ticks(self) -> bool:
        """Whether the outputs depend on the number of the tick."""
        return any(link.stage.counts_ticks for link in self.links)

    def with_controller(self, scenario: Scenario, controller: Controller) -> Chain:
        """Return the same stages with another controller in the place of the scenario's."""
        guided = any(link.place is Place.GUIDANCE for link in self.links)
        stage = _controlling(scenario, controller, guided)
        return self._of(
            [
                link._replace(stage=stage) if link.place is Place.CONTROLLER else link
                for link in self.links
            ]
        )

    def part(self, *places: Place) -> Chain:
        """Return the stages of some places, reading what they read in the whole chain."""
        return self._of([link for link in self.links if link.place in places])

    def before(self, place: Place) -> Chain:
        """Return the stages before a place."""
        return self._of([link for link in self.links if link.place < place])

    def after(self, place: Place) -> Chain:
        """Return the stages after a place."""
        return self._of([link for link in self.links if link.place > place])

    def _of(self, links: Sequence[Link]) -> Chain:
        return Chain(links, self._remembered)

    def reset(self) -> None:
        """Let every stage forget: a flight begins."""
        for link in self.links:
            link.stage.reset()

    def warm_up(self, start: Signal) -> None:
        """Load the kernels before the first tick: a step from the state (6,) that comes first.

        Another state may take long: from the target's centre guidance finds no way out.
        """
        signals: Signals = {}
        for name in self.inputs:
            row = interfaces.row_of(name)
            signals[name] = start if row.carries == STATE else row.rest
        self.step(0, signals)
        self.reset()

    def step(self, tick: int, signals: Signals) -> None:
        """Pass a tick: add to `signals`, which hold the inputs, what the stages make of them.

        Those of NEXT are afterwards of the next tick, if the stages that make them are in the
        chain. What the next tick reads of this one is then kept in `signals` too.
        """
        signals[NO_FORCE] = ZERO
        for name in self._previous:
            signals.setdefault(name, ZERO)
        for _, stage, reads in self.links:
            made = stage.step(tick, *[signals[name] for name in reads])
            signals.update(zip(stage.outputs, made, strict=True))
        for name in self._carried:
            if name in signals:
                signals[interfaces.previous(name)] = signals[name]


def _controlling(scenario: Scenario, controller: Controller, guided: bool) -> Stage:
    """Return a controller as a stage that follows guidance, or flies to the goal of a scenario.

    It opposes the disturbance that is estimated, where the scenario says so. One that reads nothing
    commands forces that were computed before, and is left alone.
    """
    stage, goal = controller.stage(scenario.dt_s), None
    if not guided and scenario.goal is not None:
        goal = scenario.goal_state, scenario.goal.force_n
    as_it_is = goal is None and not guided and not scenario.compensated
    if as_it_is or not stage.inputs:
        return stage
    return FollowStage(stage, goal, guided, scenario.compensated)


def _wired(placed: Sequence[tuple[Place, Stage]], open_loop: bool) -> list[Link]:
    """Return stages with the names of the signals that they read.

    open_loop : commands come from outside, under the name of the controller's
    """
    last = {STATE: RELATIVE_STATE, DISTURBANCE: NO_FORCE, ATTITUDE: CHASER_ATTITUDE}
    if open_loop:
        last[COMMAND] = interfaces.CONTROL_FORCE
    if not any(CHASER_ATTITUDE in stage.outputs for _, stage in placed):
        del last[ATTITUDE]
    made, links = {RELATIVE_STATE, *last.values()}, []
    last[interfaces.PREVIOUS_COMMAND] = interfaces.previous(_command(placed))
    made.add(last[interfaces.PREVIOUS_COMMAND])
    for place, stage in placed:
        reads = tuple(last.get(name, name) for name in stage.inputs)
        for name in reads:
            if name not in made:
                known = ', '.join(sorted(n for n in made if n and interfaces.current(n) == n))
                raise InputError(
                    f'stage `{stage.name}` must read a signal made before it, {known}; got {name!r}'
                )
        links.append(Link(place, stage, reads))
        for name in stage.outputs:
            made.add(name)
            carried = interfaces.row_of(name).carries
            if carried and name not in NEXT:
                last[carried] = name
    return links


def _command(placed: Sequence[tuple[Place, Stage]]) -> str:
    """Return the name of the last command that is sent; a link comes after it."""
    sent = [
        name
        for place, stage in placed
        for name in stage.outputs
        if place < Place.DISTURBANCE and interfaces.row_of(name).carries == COMMAND
    ]
    return sent[-1] if sent else interfaces.CONTROL_FORCE


def start_of(scenario: Scenario) -> Signals:
    """Return the truth at tick 0."""
    signals: Signals = {RELATIVE_STATE: tuple(map(float, scenario.start))}
    if scenario.attitude is not None:
        signals[CHASER_ATTITUDE] = scenario.attitude.start(scenario.mean_motion_rad_s)
    return signals


def signals_of(scenario: Scenario) -> tuple[str, ...]:
    """Return the signals of a scenario's flights, whatever the controller; the truth first."""
    chain = Chain.of(scenario)
    made = (RELATIVE_STATE, interfaces.CONTROL_FORCE, *chain.outputs)
    return tuple(dict.fromkeys(made))
