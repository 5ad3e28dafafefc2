# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The first minute of shipped flights, for the lists beside the tests: a flight keeps its bits."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
from kept import digits

from rpo_core.chain.flight import fly
from rpo_core.control.controller import load_controller
from rpo_core.files.scenario import load_scenario
from rpo_core.files.validation import InputError
from rpo_ctrl.family import Family, Mission

TICKS = 600
WITH_ATTITUDE = ('apollo', 'tumbling_docking', 'tumbling_port')
MEASURED = ('docking_leo', 'paper_test_measured', 'world_elliptic', 'world_leo', 'world_moon')
CONTROLLERS = [
    path.stem
    for path in sorted(Path(__file__).parents[1].glob('ros_ws/src/rpo_ctrl/config/controllers/*'))
]
LISTS = {
    'attitude': [(name, 'allround') for name in WITH_ATTITUDE],
    'ctrl': [('paper_test', name) for name in CONTROLLERS],
    'nav': [(name, 'allround') for name in MEASURED],
}
"""Room of the tests -> scenarios and controllers."""


def lines(room: str) -> Iterator[str]:
    """Yield, for each signal of each flight, the sum of sizes and the last value of each column."""
    for name, controller in LISTS[room]:
        scenario = load_scenario(name)
        some = min(TICKS, scenario.ticks) * scenario.dt_s
        flight = fly(replace(scenario, duration_s=some), load_controller(controller))
        found = {'states': flight.states, 'forces': flight.forces_n, **flight.signals}
        for signal, rows in found.items():
            rows = np.asarray(rows).reshape(len(rows), -1)
            values = [*np.abs(rows).sum(axis=0), *rows[-1]]
            yield f'{name} {controller} {signal} {len(rows)}: {digits(values)}'
    if room == 'ctrl':
        yield from said_of_families()


def said_of_families() -> Iterator[str]:
    """Yield genes of the families; tables and claims of what ships, and of drawn values."""
    mission = Mission((1.0, 1.0, 1.0), 0.5, 0.1)
    for shipped in map(load_controller, CONTROLLERS):
        if not isinstance(shipped, Family):
            continue
        genes, made = type(shipped).genes(), [shipped]
        for gene in genes:
            said = (f'{x:.7g}' if isinstance(x, float) else str(x) for x in gene)
            yield f'{shipped.name} gene {" ".join(said)}'
        for number in range(6):
            shares = np.random.default_rng(number).random(len(genes))
            values = [gene.value(x) for gene, x in zip(genes, shares, strict=True)]
            with suppress(InputError):  # peaks that do not ascend
                made.append(type(shipped).of_values(f'{shipped.name} {number}', values, mission))
        for controller in made:
            yield from (f'{controller.name} {claim}' for claim in controller.claims())
            yield from (f'{controller.name} {table}' for table in controller.tables())
