# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Flights have the same bits by the driver, step by step, interpreted, and beside each other."""

from __future__ import annotations

import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from os import environ

import mixtures
import pytest
from mixtures import by_driver, by_steps, digest, mixture

from rpo_core.attitude import target
from rpo_core.chain.chain import Chain, start_of
from rpo_core.chain.driver import Driver
from rpo_core.chain.flight import JUDGED
from rpo_core.control.controller import load_controller
from rpo_core.guidance import legs, transfers
from rpo_core.scenario.scenario import load_scenario
from rpo_core.stage import Place, Stage

MIXTURES = [pytest.param(0, 6), pytest.param(6, 2000, marks=pytest.mark.slow)]


@pytest.mark.parametrize(('first', 'end'), MIXTURES)
def test_mixed_sections_fly_the_same_bits_in_every_form(first, end):
    program = [sys.executable, mixtures.__file__, str(first), str(end)]
    with subprocess.Popen(
        program, env={**environ, 'RPO_JIT': '0'}, stdout=subprocess.PIPE, text=True
    ) as interpreted:
        for number in range(first, end):
            flown = mixture(number)
            made, stepped = by_driver(*flown), by_steps(*flown)
            assert [name for name in made if made[name] != stepped[name]] == [], number
            assert by_driver(*flown, JUDGED).items() <= made.items(), number
            assert interpreted.stdout.readline() == f'{number} {digest(made)}\n', flown


class Operator(Stage):
    """Gives commands to stages of its chain at ticks; passes the controller's command on."""

    name, inputs, outputs, memory_ticks = 'operator', ('command',), ('control_force',), None

    def __init__(self, commands):
        self.commands, self.links = commands, ()

    def step(self, tick, *inputs):
        for link in self.links:
            if command := self.commands.get((tick, link.stage.name)):
                assert link.stage.take_event(tick + 1, command) is None
        return inputs


def flown_on_command(job):
    """Return the signals, and what guidance and assurance did, with commands in flight."""
    name, duration_s, go, hold = job
    scenario, operator = replace(load_scenario(name), duration_s=duration_s), Operator(
        {(go, 'guidance'): 'go', (hold, 'assurance'): 'hold', (hold + 90, 'assurance'): 'resume'}
    )  # fmt: skip
    chain = Chain.of(scenario, load_controller('allround'), [(Place.SHAPING, operator)])
    operator.links = chain.links
    rows = Driver(chain).fly(start_of(scenario), scenario.ticks)
    stages = {link.stage.name: link.stage for link in chain.links}
    changes = [str(stages['guidance'].changes), str(stages['assurance'].decided())]
    return {name: content.tobytes() for name, content in rows.items()}, changes


JOBS = [
    ('guarded', 130.0, 150, 700), ('guarded', 130.0, 400, 500),
    ('tumbling_docking', 80.0, 0, 0), ('tumbling_port', 80.0, 0, 0), ('on_command', 90.0, 0, 0),
]  # fmt: skip
"""Scenario, duration, ticks of GO and of a hold."""


def test_flights_beside_each_other_share_nothing_that_changes():
    """With GO, holds of the abort table, and targets whose motion is computed as it is asked."""
    alone = [flown_on_command(job) for job in JOBS]
    assert [len(changes) for _, changes in alone] == [2] * len(JOBS)
    assert 'to_20' in alone[0][1][0] and 'holding' in alone[0][1][1] and alone[0] != alone[1]
    for tables in (legs._tables, transfers._planned):
        tables.clear()
    target._motion.cache_clear()
    with ThreadPoolExecutor(2 * len(JOBS)) as pool:
        assert list(pool.map(flown_on_command, JOBS * 2)) == alone * 2
