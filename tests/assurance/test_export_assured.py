# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""C of a controller and the assurance filter: the bits of the chain, for hostile commands too."""

from __future__ import annotations

import math
import shutil

import numpy as np
import pytest
from c_programs import bits, compiled, driven
from landing import rest_at_landing

from rpo.exports import c_assured
from rpo.training.config import load_start
from rpo_core.assurance.assurance import CONSTRAINTS, AssuranceStage
from rpo_core.assurance.settings import Assurance
from rpo_core.assurance.shaping import Shaping
from rpo_core.chain.flight import fly
from rpo_core.control.controller import load_controller
from rpo_core.scenario.scenario import load_scenario
from rpo_core.thrusters.thrusters import Thrusters
from rpo_core.wire import interfaces
from rpo_core.wire.interfaces import ASSURED_FORCE

pytestmark = pytest.mark.skipif(shutil.which('cc') is None, reason='cc is not installed')

MAIN = """
#include <stdio.h>
#include "exported.h"
int main(void)
{
    NAME_memory memory;
    int tick, hostile;
    double r[3], v[3], u[3], f[3], reference[6], push[3];
    if (NAME_self_test() != 0) return 1;
    NAME_start(&memory);
    while (scanf("%d %d %lf %lf %lf %lf %lf %lf %lf %lf %lf %lf %lf %lf %lf %lf %lf %lf %lf %lf",
        &tick, &hostile, r, r+1, r+2, v, v+1, v+2, u, u+1, u+2, reference, reference+1, reference+2,
        reference+3, reference+4, reference+5, push, push+1, push+2) == 20) {
        if (hostile == 2) NAME_start(&memory);
        int acted = hostile ? NAME_assure(&memory, r, v, u, f) : NAME_step(&memory, r, v, MOREu, f);
        printf("%.17g %.17g %.17g %.17g %.17g %.17g %d\\n", f[0], f[1], f[2], u[0], u[1], u[2],
            acted);
    }
    return 0;
}
"""

SOME = 20  # ticks of a hostile flight
ASSURED = load_scenario('assured')
PAPER = load_scenario('paper_test')


def program(controller, scenario, folder, optimise='-O2'):
    """Return the compiled driver."""
    files = c_assured.files(controller, scenario, 'exported.c')
    more = 'tick, ' if 'int tick' in files.header else ''
    more += 'reference, push, ' if 'reference_force_n' in files.header else ''
    main = MAIN.replace('NAME', controller.name).replace('MORE', more)
    return compiled(folder, files, main, optimise)


@pytest.mark.parametrize(
    ('name', 'flown', 'ticks'),
    rest_at_landing(
        [
            ('paper_ga', ASSURED, 4000),
            ('time_to_go', load_scenario('docking'), 6080),
            (
                'allround',
                PAPER.equipped(Shaping(0.02, 0.001)).equipped(Assurance(keep_out_m=10.0)),
                4000,
            ),
        ]
    ),
)
def test_a_flight_has_the_bits_of_the_chain(name, flown, ticks, tmp_path):
    controller = load_controller(name)
    flight = fly(flown, controller)
    states = flight.signals.get(interfaces.NAVIGATION_STATE, flight.states)
    unread = np.zeros((len(states), 9))
    if interfaces.REFERENCE_STATE in flight.signals:
        signals = (interfaces.REFERENCE_STATE, interfaces.REFERENCE_FORCE)
        unread = np.hstack([flight.signals[signal] for signal in signals])
    rows = np.hstack([states, np.zeros((len(states), 3)), unread]).tolist()
    found = driven(program(controller, flown, tmp_path), [[k, 0, *r] for k, r in enumerate(rows)])
    assert len(found) == ticks + 1
    assert bits(found[:, :3]) == bits(flight.signals[ASSURED_FORCE])
    assert bits(found[:, 3:6]) == bits(flight.forces_n)


def hostile(seed, count=4000):
    """Return states (count, 6) about the zone, the corridor and the port, and commands (.., 3)."""
    draw = np.random.default_rng(seed)
    states = draw.normal(size=(count, 6)) * [12, 12, 12, 0.2, 0.2, 0.2]
    way = states[::2]
    way[:, 1] = draw.uniform(0.5, 22.0, len(way))
    way[:, [0, 2]] = draw.normal(size=(len(way), 2)) * 0.02 * way[:, 1:2]
    way[:, 3:] = draw.normal(size=(len(way), 3)) * [0.01, 0.05, 0.01]
    commands = draw.uniform(-0.7, 0.7, (count, 3))
    states[::401, 2], commands[::307, 1], commands[::503, 0] = math.nan, math.inf, -1e200
    return states, commands


PLAIN = PAPER.equipped(Assurance(keep_out_m=10.0))
LATE = PAPER.equipped(
    Thrusters(delay_ticks=3),
    Assurance(keep_out_m=5.0, filter='simplex', speed='paper', slew_n_s=0.4),
)


@pytest.mark.parametrize(
    ('scenario', 'seed'),
    rest_at_landing([(ASSURED, 1), (PLAIN, 2), (LATE, 3)]),
    ids=['assured', 'plain', 'late'],
)
def test_hostile_commands_are_answered_with_the_bits_of_the_stage(scenario, seed, tmp_path):
    states, commands = hostile(seed)
    rows = np.hstack([states, commands, np.zeros((len(states), 9))]).tolist()
    found = driven(
        program(load_start('trained'), scenario, tmp_path, '-O3'),
        [[k, 1 if k % SOME else 2, *row] for k, row in enumerate(rows)],
    )
    stage, numbers = (
        AssuranceStage(scenario.section(Assurance), scenario),
        {name: number for number, name in CONSTRAINTS.items()},
    )
    forces, acted = [], []
    for tick, (state, command) in enumerate(zip(states.tolist(), commands.tolist(), strict=True)):
        if tick % SOME == 0:
            stage.reset()
        forces.append(stage.step(tick, tuple(state), tuple(command))[0])
        acted.append(numbers[stage.decision.constraint])
    assert bits(found[:, :3]) == bits(forces)
    assert found[:, 6].tolist() == acted
    assert len(set(acted)) >= 4  # several constraints were at work
