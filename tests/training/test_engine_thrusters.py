# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Tables of thrusters in lanes have the bits of the kernel that the chain flies."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rpo_core.files import scenario
from rpo_kernels.jit import as_table
from rpo_kernels.pulse_kernels import DELTA_V, MEMORY, OPENINGS, SPENT
from rpo_montecarlo.engine import lanes
from rpo_montecarlo.engine.parts import thrusters
from rpo_montecarlo.engine.tick import Batch
from rpo_thrusters.allocation_kernels import SCRATCH, fire
from rpo_thrusters.table import MODULATIONS, Failure, ThrusterTable, rows_of
from rpo_thrusters.thrusters import Propellant, Thrusters, table_for, tank_of

PLAIN = replace(scenario.load_scenario('approach'), duration_s=8.0)
TICKS = 40


def runs(table, propellant):
    """Return scenarios whose thrusters differ in errors, failure, mass and tank."""
    draw, found = np.random.default_rng(5), []
    for i in range(lanes.RUNS):
        failure = Failure(
            thruster=table.names[i % len(table.names)],
            stuck='on' if i % 3 == 0 else 'off',
            from_s=0.5 * (i % 4) * PLAIN.dt_s,
            until_s=(10 + i) * PLAIN.dt_s,
            known=i % 2 == 0,
        )
        own = Thrusters(
            table=replace(table, failures=(failure,)),
            matrix=tuple(map(tuple, (np.eye(3) + 0.02 * draw.normal(size=(3, 3))).tolist())),
            propellant=Propellant(mass_kg=2e-4 + 2e-3 * (i % 3), specific_impulse_s=70.0)
            if propellant
            else None,
        )
        found.append(replace(PLAIN, mass_kg=10.0 + i).equipped(own))
    return found


def one_by_one(flown, forces, torques):
    """Return force, torque and mass (7,) of each tick and run, and what the runs have spent."""
    results, spent = np.empty((TICKS, lanes.RUNS, 7)), []
    for s, one in enumerate(flown):
        settings = one.thrusters
        rows = rows_of(settings.table.failures, settings.table.names, one.dt_s)
        table = table_for(settings, one)._replace(failures=as_table(np.ravel(rows), np.int64))
        memory, scratch = as_table(np.zeros(MEMORY)), as_table(np.zeros(SCRATCH))
        for tick in range(TICKS):
            given = tuple(forces[tick, s].tolist()), tuple(torques[tick, s].tolist())
            force, torque, mass = fire(tick, *given, memory, table, tank_of(settings, one), scratch)
            results[tick, s] = (*force, *torque, mass)
        spent.append([memory[at] for at in (DELTA_V, SPENT, OPENINGS)])
    return results, np.array(spent).T


@pytest.mark.parametrize('modulation', MODULATIONS)
@pytest.mark.parametrize('propellant', [False, True])
def test_lanes_have_the_bits_of_the_kernel(modulation, propellant):
    """Of small demands, of such that no table can meet, of none, and of tanks that get empty."""
    table = ThrusterTable(
        preset='corners_24', force_n=0.2, minimum_impulse_bit_n_s=0.02, modulation=modulation
    )
    flown = runs(table, propellant)
    part = thrusters._part(Batch(flown[0], np.zeros((lanes.RUNS, 6)), flown.copy, {}, None, {}))
    draw = np.random.default_rng(6)
    sizes = draw.choice([0.0, 0.05, 0.3, 2.0], size=(2, TICKS, lanes.RUNS, 1))
    forces, torques = sizes * draw.normal(size=(2, TICKS, lanes.RUNS, 3))
    expected, spent = one_by_one(flown, forces, torques)
    w, memory, found = lanes.make_scratch(), part.memory.copy(), np.empty_like(expected)
    for tick in range(TICKS):
        for row, values in ((lanes.FORCE, forces), (lanes.UNLOADING, torques)):
            w[row : row + lanes.PAIRED_LANES] = values[tick].T.ravel()
        ((_, kernel),) = part.steps
        kernel(w, memory, part.table, tick)
        for at, row in ((0, lanes.FORCE), (3, lanes.EXERTED_TORQUE)):
            found[tick, :, at : at + 3] = w[row : row + lanes.PAIRED_LANES].reshape(3, -1).T
        found[tick, :, 6] = w[lanes.MASS : lanes.MASS + lanes.RUNS]
    assert found.tobytes() == expected.tobytes()
    counted = thrusters.spent_of({part.name: memory})
    assert np.array(list(counted.values())).tobytes() == spent.tobytes()
    tanks = np.array([s.thrusters.propellant.mass_kg for s in flown] if propellant else [1.0])
    assert (spent[2] > 10).all() and (not propellant or (spent[1] == tanks).sum() > 5)
