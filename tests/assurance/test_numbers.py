# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What assurance computes, kept in a list: the constants of its proof, and how it answers.

The tests of lemmas find what is not safe; a bound that is wider than it must be, only this list.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from kept import assert_kept, digits
from vehicles import drawn

from rpo.analysis import attack
from rpo_core.assurance.doubt import doubt_of
from rpo_core.assurance.guard import proof_of
from rpo_core.assurance.kernels import Guard
from rpo_core.assurance.settings import Assurance, Passage
from rpo_core.attitude.target import Target
from rpo_core.chain.chain import Chain
from rpo_core.control.controller import load_controller
from rpo_core.files.validation import InputError
from rpo_core.scenario.scenario import Scenario, load_scenario
from rpo_core.stage import Place
from rpo_core.thrusters.thrusters import Thrusters
from rpo_core.wire.interfaces import RELATIVE_STATE
from rpo_core.world.disturbance import NONE

LIST = Path(__file__).with_name('numbers.txt')
SHIPPED = ('assured', 'docking', 'docking_leo', 'guarded', 'tumbling_docking', 'tumbling_port')
WAY = Passage('+y', 10.0, 1.0, 20.0, width_m=0.2, lateral_m_s=0.034)


def scenarios() -> Iterator[tuple[str, Any]]:
    """Yield names, and functions that return a scenario or raise InputError."""
    for name in SHIPPED:
        yield name, lambda name=name: load_scenario(name)
    for number in range(60):
        yield f'vehicle {number}', lambda i=number: drawn(np.random.default_rng([5, i]))
    for number in range(24):
        yield f'turning {number}', lambda i=number: turned(np.random.default_rng([6, i]))


def turned(random: np.random.Generator) -> Scenario:
    """Return a flight about a target that turns; errors, delay and rate are drawn."""
    axis = random.normal(size=3)
    inertia = ((120.0, 0.0, 0.0), (0.0, 150.0, 0.0), (0.0, 0.0, 200.0))
    rates = tuple((axis / np.linalg.norm(axis) * random.uniform(0.1, 1.0)).tolist())
    known = tuple(random.uniform(-0.8, 0.8, 3).tolist())
    target = Target(kind='tumble', rates_deg_s=rates, inertia_kg_m2=inertia, known_error_deg=known)
    position, velocity, push, thrust = random.uniform(0.0, (0.05, 0.003, 0.02, 0.05)).tolist()
    along = random.choice(['+', '-']) + random.choice([*'xyz'])
    settings = Assurance(
        keep_out_m=10.0,
        domain_m=250.0,
        corridor=replace(WAY, along=along),
        position_error_m=position,
        velocity_error_m_s=velocity,
        disturbance_n=push,
        thrust_error=thrust,
    )
    base = replace(load_scenario('paper_test'), disturbance=NONE, duration_s=60.0)
    return base.equipped(target, settings, Thrusters(delay_ticks=int(random.integers(0, 4))))


def lines() -> Iterator[str]:
    """Yield all lines of the list."""
    yield ' '.join(Guard._fields)
    for name, made in scenarios():
        try:
            found = made()
            settings = found.section(Assurance)
            proof = proof_of(settings, found)
        except InputError as error:
            yield f'{name}: {error}'
            continue
        yield f'{name}: {digits((*proof.guard, *proof.errors, proof.floor_m_s))}'
        if proof.walls:
            yield f'  walls {digits(proof.walls)}'
        yield f'  doubt {digits(doubt_of(settings, found, proof.errors))}'
    for name in ('assured', 'docking', 'tumbling_port'):
        for way in ('least_change', 'simplex'):
            found = load_scenario(name)
            found = found.equipped(replace(found.section(Assurance), filter=way))
            for result in attack.attack(found, 16, 5, 120):
                least, total = result.rows.min(axis=0), result.rows.sum(axis=0)
                yield f'{name} {way} {result.kind}: {digits((*total[:5], *least[5:7], *total[7:]))}'
    for command, tick in (('hold', 300), ('retreat', 300), ('abort', 0), ('abort', 300)):
        yield f'{command} at {tick}: {digits(commanded(command, tick))}'


def commanded(name: str, at: int) -> list[float]:
    """Return the state (6,) 40 s after a command beside the plan of `around`, and its impulse."""
    around, settings = load_scenario('around'), load_scenario('guarded').section(Assurance)
    rows = tuple(row for row in settings.abort.table if row.quantity != 'off_corridor_m')
    found = around.equipped(replace(settings, abort=replace(settings.abort, table=rows)))
    chain = Chain.of(found, load_controller('allround'))
    stage: Any = next(link.stage for link in chain.links if link.place is Place.ASSURANCE)
    signals: dict[str, Any] = {RELATIVE_STATE: found.start}
    stage.take_event(at, name)
    for tick in range(at + 400):
        chain.step(tick, signals)
    return [*signals[RELATIVE_STATE], stage.m.watch.impulse_n_s]


def test_the_numbers_are_those_of_the_list():
    assert_kept(LIST, lines())
