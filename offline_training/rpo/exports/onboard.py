# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What is C of a controller, and of a scenario: the stages that a chaser has on board."""

from __future__ import annotations

import numpy as np

from rpo.exports import c, formats
from rpo_core.chain.chain import Chain, Link
from rpo_core.chain.flight import Flight
from rpo_core.control.controller import AnyController
from rpo_core.files.validation import InputError, choice
from rpo_core.scenario.scenario import Scenario
from rpo_core.stage import Place
from rpo_core.wire.interfaces import CONTROL_FORCE, DISTURBANCE_FORCE, RELATIVE_STATE, STATE

ALL = 'all'
"""In the place of names of stages: the whole flight."""

_ONBOARD = (
    Place.ATTITUDE_ESTIMATOR, Place.ESTIMATOR, Place.GUIDANCE, Place.POINTING, Place.CONTROLLER,
    Place.SHAPING, Place.ASSURANCE, Place.STEERING, Place.UNLOADING,
)  # fmt: skip

_STATES = 240


def of_controller(controller: AnyController, file: str) -> c.Files:
    """Return the C of a controller alone; raises InputError.

    file : name of the source file
    """
    stage = controller.stage(controller.clock_s or 1.0)
    if stage.inputs != (STATE,):
        raise InputError(f'{controller.name} reads more than a state: export its scenario')
    draw = np.random.default_rng(1)
    states = np.round(draw.normal(size=(_STATES, 6)) * [30, 30, 30, 0.4, 0.4, 0.4], 3)
    ticks = np.arange(_STATES) * 17
    (forces,) = stage.steps(ticks, states)
    flown = c.Flown(ticks.tolist(), {RELATIVE_STATE: states, CONTROL_FORCE: forces})
    chain = Chain([Link(Place.CONTROLLER, stage, (RELATIVE_STATE,))])
    about = [*formats.facts(controller), *formats.GOAL]
    return c.files(about, chain, file, flown)


def of_flight(flight: Flight, controller: AnyController, file: str, stages: str = '') -> c.Files:
    """Return the C of stages of a flight, which the program flies again; raises InputError.

    stages : names, separated by commas; `ALL`; '': those on board
    """
    scenario, chain = flight.scenario, Chain.of(flight.scenario, controller)
    if stages != ALL:
        named = _named(stages, chain, scenario)
        chain = Chain([link for link in chain.links if link.stage.name in named])
    names = [link.stage.name for link in chain.links]
    for name in names:
        if flight.events.get(name):
            raise InputError(f'stage `{name}` got commands in flight; C gets none')
    signals = {
        **flight.signals, RELATIVE_STATE: flight.states, CONTROL_FORCE: flight.forces_n,
        DISTURBANCE_FORCE: flight.disturbances_n,
    }  # fmt: skip
    about = [f'{scenario.name} with {controller.name}: {", ".join(names)}', scenario.description]
    flown = c.Flown(list(range(len(flight.states))), signals)
    return c.files(about, chain, file, flown)


def _named(stages: str, chain: Chain, scenario: Scenario) -> list[str]:
    """Return the names of stages; '': those on board, of thrusters the allocation of a table."""
    if stages:
        known = [link.stage.name for link in chain.links]
        return [choice('--stages', name.strip(), known) for name in stages.split(',')]
    table = scenario.thrusters is not None and scenario.thrusters.table is not None
    places = (*_ONBOARD, Place.THRUSTERS) if table else _ONBOARD
    return [link.stage.name for link in chain.links if link.place in places]
