# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""C of a chain from the kernels of its stages: compiled by the system, a flight bit for bit."""

from __future__ import annotations

import itertools
import shutil
import subprocess
from dataclasses import dataclass, replace
from math import nan
from typing import Annotated, Any, NamedTuple

import pytest
from c_programs import bits, compiled, driven

from rpo.exports import c_stages
from rpo_core.assurance.shaping import Shaping
from rpo_core.chain.chain import Chain, Link, start_of
from rpo_core.chain.driver import Driver
from rpo_core.chain.flight import fly
from rpo_core.control.controller import load_controller
from rpo_core.files.validation import InputError
from rpo_core.kernels.calls import ASK
from rpo_core.navigation.sensors import Navigation
from rpo_core.scenario.scenario import load_scenario
from rpo_core.stage import KernelStage, Place, section_of
from rpo_core.thrusters.thrusters import Thrusters
from rpo_core.wire.interfaces import CONTROL_FORCE, NEXT, RELATIVE_STATE

pytestmark = pytest.mark.skipif(shutil.which('cc') is None, reason='cc is not installed')

MAIN = """
#include <stdio.h>
#include "exported.h"
static void print(const double *s)
{
    for (int i = 0; i < NAME_SIGNALS; i++) printf("%.17g ", s[i]);
}
int main(void)
{
    static double begun[NAME_SIGNALS], s[NAME_SIGNALS];
    long ticks;
    name_memory m;
    if (scanf("%ld", &ticks) != 1) return 1;
    for (int i = 0; i < NAME_SIGNALS; i++) if (scanf("%lf", &begun[i]) != 1) return 1;
    for (int flight = 0; flight < 2; flight++) {
        for (int i = 0; i < NAME_SIGNALS; i++) s[i] = begun[i];
        name_start(&m);
        for (int64_t tick = 0; tick <= ticks; tick++) {
            if (flight == 1) print(s);
            const int asking = name_tick(tick, &m, s);
            if (asking != 0) return 10 + asking;
            if (flight == 1) print(s);
        }
    }
    return 0;
}
"""
"""Flies twice, and prints the signals of the second flight before and after each tick."""


ONBOARD = """
#include <stdio.h>
#include "exported.h"
int main(void)
{
    static double s[FLIGHT_SIGNALS];
    double *x = &s[FLIGHT_RELATIVE_STATE], *f = &s[FLIGHT_SHAPED_FORCE];
    flight_memory m;
    long tick;
    flight_start(&m);
    while (scanf("%ld %lf %lf %lf %lf %lf %lf", &tick, x, x+1, x+2, x+3, x+4, x+5) == 7) {
        if (flight_tick(tick, &m, s) != 0) return 1;
        printf("%.17g %.17g %.17g\\n", f[0], f[1], f[2]);
    }
    return 0;
}
"""
"""From true states to the commands of what is onboard."""


def program(chain, folder, optimise='-O2', main=MAIN):
    """Return the program that flies a chain."""
    files = c_stages.files('flight', chain, 'exported.c')
    main = main.replace('NAME', 'FLIGHT').replace('name_', 'flight_')
    return compiled(folder, files, main, optimise)


def flown(chain, start, ticks, folder, optimise='-O2'):
    """Return the signals (ticks + 1, width) that a chain makes in C."""
    places = Driver(chain).places
    row = [0.0] * max(place.stop for place in places.values())
    for name, values in start.items():
        row[places[name]] = values
    printed = driven(program(chain, folder, optimise), [[ticks, *row]])
    printed = printed.reshape(ticks + 1, 2, len(row))
    return {n: printed[:, 0 if n in NEXT else 1, places[n]] for n in chain.outputs}


PAPER = load_scenario('paper_test')
ALLROUND = load_controller('allround')
ERRORS = Navigation(
    position_noise_m=0.02, velocity_noise_m_s=0.002, position_bias_m=(0.1, 0.0, -0.05),
    noise_key=(123456789, 4294967295),
)  # fmt: skip
TURNED = Thrusters(matrix=((0.98, 0.1, 0.0), (-0.1, 0.98, 0.0), (0.0, 0.02, 1.0)), delay_ticks=3)
SHAPED = Shaping(slew_n_s=0.4, dead_zone_n=0.002)
MORE = replace(PAPER, sections=(ERRORS, SHAPED, TURNED), duration_s=60.0)


def unguided(name, duration_s):
    """Return a scenario without guidance and goal: a controller that follows them is no kernel."""
    scenario = load_scenario(name)
    others = tuple(s for s in scenario.sections if section_of(s).place is not Place.GUIDANCE)
    goal = (0.0, 0.0, 0.0)
    return replace(scenario, sections=others, goal_position_m=goal, duration_s=duration_s)


FLIGHTS = {
    'paper_test': PAPER,
    'errors, shaping and late thrusters': MORE,
    'sensors, estimator and shaping': unguided('paper_test_measured', 60.0),
    'assurance': unguided('assured', 60.0),
    'attitude and a table of thrusters': unguided('apollo', 20.0),
    'a target on its orbit': unguided('world_moon', 60.0),
}


@pytest.mark.parametrize(
    ('scenario', 'optimise'),
    list(zip(FLIGHTS.values(), itertools.cycle(['-O3', '-O0', '-O2']), strict=False)),
    ids=FLIGHTS,
)
def test_a_flight_in_c_has_the_bits_of_the_logged_one(scenario, optimise, tmp_path):
    flight, chain = fly(scenario, ALLROUND), Chain.of(scenario, ALLROUND)
    signals = flown(chain, start_of(scenario), scenario.ticks, tmp_path, optimise)
    assert bits(signals['relative_state']) == bits(flight.states)
    assert bits(signals['control_force']) == bits(flight.forces_n)
    if 'disturbance_force' in signals:
        assert bits(signals['disturbance_force']) == bits(flight.disturbances_n)
    assert signals.keys() >= flight.signals.keys() and len(flight.signals) >= 3
    for name, values in flight.signals.items():
        assert bits(signals[name]) == bits(values), name


def test_what_is_onboard_answers_the_true_states_of_a_log(tmp_path):
    flight = fly(MORE, ALLROUND)
    onboard = Chain.of(MORE, ALLROUND).part(Place.SENSOR, Place.CONTROLLER, Place.SHAPING)
    rows = [[tick, *state] for tick, state in enumerate(flight.states.tolist())]
    commands = driven(program(onboard, tmp_path, main=ONBOARD), rows)
    assert bits(commands) == bits(flight.signals['shaped_force'])


class Sum(NamedTuple):
    """A record that a kernel makes."""

    total: float
    count: int


@dataclass
class Knot:
    """A record in a list."""

    at: float
    weights: list[list[float]]


@dataclass
class Bowl:
    """Settings of the kernel below; places : of any length."""

    limits: tuple[float, float]
    knots: list[Knot]
    pair: Annotated[list[Knot], 2]
    places: list[int]
    nothing: list[float]


@dataclass
class Rolled:
    """Memory of the kernel below."""

    total: float
    count: int
    table: Annotated[list[list[float]], 3, 2]
    line: list[list[float]]
    word: int


def added(sum_: Sum, value: float) -> tuple[tuple[float, float], Sum]:
    """Return two numbers, and the record that follows."""
    first, second = sum_
    return (value, first), Sum(first + value, int(second + 1))


def swapped(row: Any, wide: bool, block: int = -6) -> None:
    """Exchange both numbers of a row; not in some blocks."""
    if not wide or block in (-6, 1):
        return
    row[0], row[1] = row[1], row[0]


def roll(tick: int, u: Any, p: Any, m: Any, y: Any) -> int:
    """Everything that kernels of stages use, in one place."""
    if len(p.nothing) > 0:
        return ASK
    block, at = (tick - 40) // 7, (tick - 40) % 7
    m.word = (0xD2511F53 * (m.word ^ 0x9E3779B9) >> 5) & 0xFFFFFFFF
    total, lost = 0.0, nan
    for k in range(len(p.knots) - 1, -1, -1):
        knot = p.knots[k]
        row = knot.weights[at % 2]
        total += row[0] * knot.at + abs(block) / 3 + p.pair[k % 2].weights[1][1]
    begun = Sum(m.total, m.count)
    (value, before), after = added(begun, total * u[p.places[at % len(p.places)]])
    m.total, m.count = after
    for i in range(len(y)):
        swapped(m.table[i], bool(at > i), block)
        swapped(m.table[i], True)
        m.table[i][0] += value
    last = m.line[tick % len(m.line)]
    y[0] = y[1] = last[0] if last[0] - last[0] == 0.0 else lost
    y[2] = float(block) * p.limits[0] + m.table[2][1] + before + (m.word & 0xFFFF) * p.limits[1]
    last[0], last[1] = m.table[1][0], y[2]
    return 0


class RollStage(KernelStage):
    """A stage of the kernel above."""

    name, inputs, outputs, kernel = 'roll', (RELATIVE_STATE,), (CONTROL_FORCE,), roll


def rolling(*nothing):
    knots = [Knot(0.5 * i, [[0.1 * i, 1.0], [-0.7, 0.3]]) for i in range(4)]
    settings = Bowl((0.25, 1e-3), knots, knots[1:3], [5, 0, 3], list(nothing))
    line = [[0.125, float(i)] for i in range(5)]
    return settings, Rolled(0.5, 7, [[1.0, 2.0], [3.0, -0.0], [5.0, 6.0]], line, 99)


def test_what_kernels_of_stages_use_has_the_bits_in_c(tmp_path):
    chain = Chain([Link(Place.CONTROLLER, RollStage(*rolling()), (RELATIVE_STATE,))])
    settings, memory = rolling()
    state, expected, force = [0.3, -0.2, 0.7, 0.1, -0.9, 0.4], [], [0.0] * 3
    for tick in range(101):
        assert roll(tick, state, settings, memory, force) == 0
        expected.append(list(force))
    assert len({tuple(row) for row in expected}) == 101
    signals = flown(chain, {RELATIVE_STATE: state}, 100, tmp_path)
    assert bits(signals[CONTROL_FORCE]) == bits(expected)


def test_a_tick_says_which_stage_asks(tmp_path):
    chain = Chain([Link(Place.CONTROLLER, RollStage(*rolling(1.0)), (RELATIVE_STATE,))])
    numbers = '10' + ' 0' * 12
    done = subprocess.run([program(chain, tmp_path)], input=numbers, text=True, timeout=50)
    assert done.returncode == 11


def test_a_stage_alone_is_a_chain_of_one():
    chain = Chain.of(PAPER, ALLROUND).part(Place.CONTROLLER)
    source, header = c_stages.files('law', chain, 'law.c')
    assert 'int law_controller_step(int64_t tick, const double *u, const FuzzyLaw *p' in header
    assert 'const FuzzyLaw law_controller_p = {.scales = {60.5113, 1.044, 0.5}' in source
    assert 'LAW_CONTROL_FORCE = 0' in header


def test_a_stage_without_a_kernel_is_refused():
    chain = Chain.of(PAPER, load_controller('pd'))
    with pytest.raises(InputError, match=r'stage `controller` must have a kernel to be C'):
        c_stages.files('pd', chain, 'pd.c')
