# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""C of controllers and of chains: compiled by the system, flights and hostile ticks bit for bit."""

from __future__ import annotations

import itertools
import re
import shutil
import subprocess
from dataclasses import dataclass, replace
from math import inf, nan
from typing import Annotated, Any

import numpy as np
import pytest
from landing import rest_at_landing

from rpo.exports import c
from rpo.exports.c_source import Source
from rpo_core.assurance.assurance import AssuranceStage
from rpo_core.assurance.settings import Assurance
from rpo_core.assurance.shaping import Shaping
from rpo_core.chain.chain import Chain, Link
from rpo_core.chain.flight import fly
from rpo_core.control import controller_file
from rpo_core.control.controller import load_controller
from rpo_core.control.family import Family, Mission, family_of
from rpo_core.files.validation import InputError
from rpo_core.kernels.arithmetic import State, Vector
from rpo_core.kernels.calls import ASK
from rpo_core.navigation.sensors import Navigation
from rpo_core.scenario.scenario import load_scenario
from rpo_core.stage import KernelStage, Place
from rpo_core.thrusters.table import Failure
from rpo_core.thrusters.thrusters import Thrusters
from rpo_core.wire.interfaces import (
    ASSURED_FORCE,
    CONTROL_FORCE,
    NAVIGATION_STATE,
    RELATIVE_STATE,
)

pytestmark = pytest.mark.skipif(shutil.which('cc') is None, reason='cc is not installed')

FLAGS = [
    '-std=c99', '-pedantic', '-Wall', '-Wextra', '-Werror', '-Wshadow', '-Wconversion',
    '-Wstrict-prototypes', '-ffp-contract=off',
]  # fmt: skip


def compared(folder, files, optimise='-O2', **changes):
    """Return exit code and last line of the program that flies the ticks again.

    Warnings are errors. changes : text of a file that stands in the place of another
    """
    for name, text in files._replace(**changes)._asdict().items():
        (folder / FILES[name]).write_text(text)
    built = subprocess.run(
        ['cc', *FLAGS, optimise, '-o', 'program', 'exported.c', 'exported_test.c', '-lm'],
        cwd=folder, capture_output=True, text=True, timeout=100,
    )  # fmt: skip
    assert built.returncode == 0, built.stderr
    done = subprocess.run(['./program'], cwd=folder, capture_output=True, text=True, timeout=50)
    return done.returncode, done.stdout.splitlines()[-1]


FILES = {
    'source': 'exported.c', 'header': 'exported.h', 'test': 'exported_test.c',
    'ticks': 'exported_test.txt',
}  # fmt: skip


def equal(ticks):
    """Return what the program answers where nothing differs."""
    return 0, f'{ticks} ticks: every bit is equal'


def begun(name):
    """Return the controller of a family where a search begins."""
    kind = family_of(name)
    start = [gene.start for gene in kind.genes()]
    return kind.of_values(name, start, Mission((1.0, 1.0, 1.0), 0.5, 0.1))


FAMILIES = sorted(n for n, kind in controller_file.kinds().items() if issubclass(kind, Family))
CONTROLLERS = [
    *map(load_controller, ('allround', 'paper_ga', 'lqr', 'mpc', 'apf_smc')), *map(begun, FAMILIES)
]  # fmt: skip


@pytest.mark.parametrize(
    ('controller', 'optimise'),
    list(zip(CONTROLLERS, itertools.cycle(['-O0', '-O2', '-O3']), strict=False)),
    ids=lambda value: getattr(value, 'name', value),
)
def test_a_controller_in_c_has_the_bits(controller, optimise, tmp_path):
    files = c.of_controller(controller, 'exported.c')
    assert compared(tmp_path, files, optimise) == equal(240)
    assert 'position minus goal. Off the target, add the' in ' '.join(files.header.split())


PAPER = load_scenario('paper_test')
ALLROUND = load_controller('allround')
ERRORS = Navigation(
    position_noise_m=0.02, velocity_noise_m_s=0.002, position_bias_m=(0.1, 0.0, -0.05),
    noise_key=(123456789, 4294967295),
)  # fmt: skip
TURNED = Thrusters(matrix=((0.98, 0.1, 0.0), (-0.1, 0.98, 0.0), (0.0, 0.02, 1.0)), delay_ticks=3)
SHAPED = Shaping(slew_n_s=0.4, dead_zone_n=0.002)


def short(name, duration_s):
    """Return the first seconds of a shipped scenario."""
    return replace(load_scenario(name), duration_s=duration_s)


def stuck():
    """Return Apollo with a thruster that is known to be stuck, and one that is not."""
    scenario = short('apollo', 99.0)
    table = scenario.thrusters.table
    failures = (
        Failure(thruster=table.names[2], stuck='on', from_s=2.0, known=True),
        Failure(thruster=table.names[3], stuck='off', from_s=4.0),
    )
    return scenario.equipped(replace(scenario.thrusters, table=replace(table, failures=failures)))


FLIGHTS = {
    'paper_test': (PAPER, 'all', 4000),
    'errors, shaping and late thrusters': (
        replace(PAPER, sections=(ERRORS, SHAPED, TURNED), duration_s=60.0), 'all', 600,
    ),
    'a goal off the target': (
        replace(PAPER, goal_position_m=(7.5, -40.1, 3.3), duration_s=90.0), 'all', 900,
    ),
    'sensors, estimator and shaping': (short('paper_test_measured', 60.0), 'all', 600),
    'assurance': (short('assured', 60.0), 'all', 600),
    'a set that follows the covariance': (short('docking_leo', 60.0), '', 601),
    'attitude and a table of thrusters': (stuck(), 'all', 99),
    'a target that turns, its port in view': (short('tumbling_docking', 60.0), 'all', 600),
    'a target on its orbit': (short('world_moon', 60.0), '', 601),
}  # fmt: skip


@pytest.mark.parametrize(
    ('flown', 'optimise'),
    list(zip(FLIGHTS.values(), itertools.cycle(['-O3', '-O0', '-O2']), strict=False)),
    ids=FLIGHTS,
)
def test_a_flight_in_c_has_the_bits_of_the_logged_one(flown, optimise, tmp_path):
    scenario, stages, ticks = flown
    files = c.of_flight(fly(scenario, ALLROUND), ALLROUND, 'exported.c', stages)
    assert compared(tmp_path, files, optimise) == equal(ticks)


def test_what_is_compared_is_the_log(tmp_path):
    flight = fly(short('paper_test_measured', 60.0), ALLROUND)
    files = c.of_flight(flight, ALLROUND, 'exported.c', 'controller,shaping')
    rows = [line.split() for line in files.ticks.splitlines()]
    numbers = np.array([list(map(float.fromhex, row[1:])) for row in rows])
    log = flight.signals
    logged = np.hstack([log[NAVIGATION_STATE], flight.forces_n, log['shaped_force']])
    assert [row[0] for row in rows] == list(map(str, range(601)))
    assert numbers.tobytes() == logged.tobytes()
    rows[40][-1] = '0x1p-3'
    changed = '\n'.join(map(' '.join, rows))
    assert compared(tmp_path, files, ticks=changed) == (1, 'tick 40: shaped_force differs')
    law = files.source.replace('.scales = {60.5113,', '.scales = {60.5113000001,')
    code, said = compared(tmp_path, files, source=law)
    assert code == 1 and 'control_force differs' in said


@pytest.mark.every_landing
@pytest.mark.parametrize('name', ['docking', 'tumbling_port'])
def test_a_plan_without_holds_is_a_table_until_the_chaser_docks(name, tmp_path):
    flight = fly(load_scenario(name), ALLROUND)
    files = c.of_flight(flight, ALLROUND, 'exported.c')
    code, said = compared(tmp_path, files)
    docked = len(files.ticks.splitlines())
    assert (code, said) == equal(docked) and 4000 < docked < len(flight.states)
    row = files.ticks.splitlines()[-1].split()
    more = f'{docked} {" ".join(row[1:])}\n'
    again = compared(tmp_path, files, ticks=files.ticks + more)
    assert again[0] == 1 and again[1] in (
        f'tick {docked}: stage guidance cannot go on', f'tick {docked}: reference_state differs'
    )  # fmt: skip


GUARDED = load_scenario('guarded')


@pytest.mark.parametrize(
    ('stages', 'message'),
    [
        (
            '',
            r'stage `guidance` cannot be C: leg \w+ is a hold: .*; `--stages controller,assurance`',
        ),
        ('controller,assurance', 'stage `assurance` cannot be C: `assurance.abort` decides in fl'),
        ('law', '`--stages` must be one of guidance, controller, assurance'),
    ],
)
def test_a_stage_that_plans_in_flight_is_refused(stages, message):
    flight = fly(replace(GUARDED, duration_s=5.0), ALLROUND)
    with pytest.raises(InputError, match=message):
        c.of_flight(flight, ALLROUND, 'exported.c', stages)
    with pytest.raises(InputError, match='stage `controller` got commands in flight'):
        events = {'controller': [(3, 'off')]}
        c.of_flight(replace(flight, events=events), ALLROUND, 'exported.c', 'controller')
    with pytest.raises(InputError, match='the log must have `reference_state`'):
        c.of_flight(replace(flight, signals={}), ALLROUND, 'exported.c', 'controller')


def test_only_what_the_header_declares_has_a_name_outside(tmp_path):
    """Two exported chains can be linked into one program."""
    flight = fly(short('assured', 2.0), ALLROUND)
    files = c.of_flight(flight, ALLROUND, 'exported.c', 'all')
    (tmp_path / 'exported.c').write_text(files.source)
    subprocess.run(['cc', '-std=c99', '-c', 'exported.c'], cwd=tmp_path, check=True, timeout=50)
    listed = subprocess.run(
        ['nm', '-g', '--defined-only', '-P', 'exported.o'],
        cwd=tmp_path, check=True, capture_output=True, text=True, timeout=50,
    )  # fmt: skip
    names = {line.split()[0] for line in listed.stdout.splitlines()}
    declared = re.findall(r'^(?:void|int) (\w+)\(', files.header, re.M)
    declared += re.findall(r'^extern const \w+ (\w+);', files.header, re.M)
    assert names >= set(declared) and all(name.startswith('exported_') for name in names)


def hostile(seed, count=4000):
    """Return states (count, 6) about the zone, the corridor and the port, and commands (.., 3)."""
    draw = np.random.default_rng(seed)
    states = draw.normal(size=(count, 6)) * [12, 12, 12, 0.2, 0.2, 0.2]
    way = states[::2]
    way[:, 1] = draw.uniform(0.5, 22.0, len(way))
    way[:, [0, 2]] = draw.normal(size=(len(way), 2)) * 0.02 * way[:, 1:2]
    way[:, 3:] = draw.normal(size=(len(way), 3)) * [0.01, 0.05, 0.01]
    commands = draw.uniform(-0.7, 0.7, (count, 3))
    states[::401, 2], commands[::307, 1], commands[::503, 0] = nan, inf, -1e200
    return states, commands


PLAIN = PAPER.equipped(Assurance(keep_out_m=10.0))
LATE = PAPER.equipped(
    Thrusters(delay_ticks=3),
    Assurance(keep_out_m=5.0, filter='simplex', speed='paper', slew_n_s=0.4),
)
SOME = 20  # ticks of a hostile flight


@pytest.mark.parametrize(
    ('scenario', 'seed'),
    rest_at_landing([(load_scenario('assured'), 1), (PLAIN, 2), (LATE, 3)]),
    ids=['assured', 'plain', 'late'],
)
def test_hostile_commands_are_answered_with_the_bits_of_the_stage(scenario, seed, tmp_path):
    states, commands = hostile(seed)
    ticks, stage = [i % SOME for i in range(len(states))], None
    forces, acted = [], set()
    for tick, state, command in zip(ticks, states.tolist(), commands.tolist(), strict=True):
        if tick == 0:
            stage = AssuranceStage(scenario.section(Assurance), scenario)
        forces.append(stage.step(tick, tuple(state), tuple(command))[0])
        acted.add(stage.decision.constraint)
    assert len(acted) >= 4  # several constraints were at work
    chain = Chain([Link(Place.ASSURANCE, stage, (RELATIVE_STATE, CONTROL_FORCE))])
    signals = {RELATIVE_STATE: states, CONTROL_FORCE: commands, ASSURED_FORCE: np.array(forces)}
    files = c.files(['hostile commands'], chain, 'exported.c', c.Flown(ticks, signals))
    assert compared(tmp_path, files, '-O3') == equal(len(states))


@dataclass
class Knot:
    """A record in a list."""

    at: float
    weights: list[list[float]]


@dataclass
class Bowl:
    """Settings of the kernel below; places : of any length."""

    knots: list[Knot]
    places: list[int]
    nothing: list[float]


@dataclass
class Rolled:
    """Memory of the kernel below."""

    table: Annotated[list[list[float]], 3, 2]
    line: list[list[float]]
    word: int


def roll(tick: int, u: Any, p: Any, m: Any, y: Any) -> int:
    """Whole numbers below zero, and lists in records, of which flights show less."""
    if len(p.nothing) > 0:
        return ASK
    block, at = (tick - 40) // 7, (tick - 40) % 7
    m.word = (0xD2511F53 * (m.word ^ 0x9E3779B9) >> 5) & 0xFFFFFFFF
    total = abs(block) / 3
    for k in range(len(p.knots) - 1, -1, -1):
        total += p.knots[k].weights[at % 2][0] * p.knots[k].at
    m.table[1][0] += total * u[p.places[at % len(p.places)]]
    last = m.line[tick % len(m.line)]
    y[0] = y[1] = last[0] if last[0] - last[0] == 0.0 else nan
    y[2] = float(block) + m.table[1][0] + (m.word & 0xFFFF) * 1e-3
    last[0], last[1] = m.table[1][0], y[2]
    return 0


class RollStage(KernelStage):
    """A stage of the kernel above."""

    name, inputs, outputs, kernel = 'roll', (RELATIVE_STATE,), (CONTROL_FORCE,), roll


def rolling(*nothing):
    knots = [Knot(0.5 * i, [[0.1 * i, 1.0], [-0.7, 0.3]]) for i in range(4)]
    line = [[0.125, float(i)] for i in range(5)]
    memory = Rolled([[1.0, 2.0], [3.0, -0.0], [5.0, 6.0]], line, 99)
    return Bowl(knots, [5, 0, 3], list(nothing)), memory


ROLLING = Chain([Link(Place.CONTROLLER, RollStage(*rolling()), (RELATIVE_STATE,))])


def test_what_kernels_of_stages_use_has_the_bits_in_c(tmp_path):
    settings, memory = rolling()
    state, expected, force = [0.3, -0.2, 0.7, 0.1, -0.9, 0.4], [], [0.0] * 3
    for tick in range(101):
        assert roll(tick, state, settings, memory, force) == 0
        expected.append(list(force))
    assert len({tuple(row) for row in expected}) == 101
    signals = {RELATIVE_STATE: np.array([state] * 101), CONTROL_FORCE: np.array(expected)}
    files = c.files(['roll'], ROLLING, 'exported.c', c.Flown(range(101), signals))
    assert compared(tmp_path, files) == equal(101)
    assert compared(tmp_path, files, ticks=2 * files.ticks) == equal(202)  # a second flight
    asking = Chain([Link(Place.CONTROLLER, RollStage(*rolling(1.0)), (RELATIVE_STATE,))])
    asks = c.files(['roll'], asking, 'exported.c', c.Flown(range(101), signals))
    assert compared(tmp_path, asks) == (1, 'tick 0: stage roll cannot go on')


def power(state: State, tick: int, gain: Bowl) -> Vector:
    """Kernel with an operation that differs between machines."""
    return state[0] ** 0.5, 0.0, 0.0


def test_what_c_does_not_get_is_refused():
    with pytest.raises(InputError, match=r'`power` must have .* got state\[0\] \*\* 0.5'):
        Source().function(power, (('double',) * 6, 'int', 'double'))
