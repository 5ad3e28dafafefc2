# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""C of controllers, of families and of plug-ins: compiled by the system, the bits of the core."""

from __future__ import annotations

import itertools
import re
import shutil
import subprocess
from dataclasses import dataclass, replace
from math import sqrt
from typing import Any, ClassVar, NamedTuple

import numpy as np
import pytest
from c_programs import bits, compiled, driven, states

from rpo.exports import c, c_assured
from rpo.exports.c_source import Source
from rpo.training.config import load_start
from rpo_core.chain.flight import fly
from rpo_core.control import controller_file
from rpo_core.control.baselines import Pd
from rpo_core.control.controller import load_controller
from rpo_core.control.family import Family, Mission, family_of
from rpo_core.files.validation import InputError
from rpo_core.kernels.arithmetic import State, Vector, saturate
from rpo_core.kernels.jit import as_table
from rpo_core.scenario.scenario import load_scenario
from rpo_core.thrusters.allocation_kernels import LIMIT, SCRATCH, THRUST, allocate
from rpo_core.thrusters.table import IDENTITY, ThrusterTable, table_of

pytestmark = pytest.mark.skipif(shutil.which('cc') is None, reason='cc is not installed')

MAIN = """
#include <stdio.h>
#include "exported.h"
int main(void)
{
    int tick;
    double r[3], v[3], f[3];
    if (NAME_self_test() != 0) return 1;
    while (scanf("%d %lf %lf %lf %lf %lf %lf", &tick, r, r+1, r+2, v, v+1, v+2) == 7) {
        NAME_force(r, v, TICKf);
        printf("%.17g %.17g %.17g\\n", f[0], f[1], f[2]);
    }
    return 0;
}
"""


class Bowl(NamedTuple):
    """Tables of the plug-in below."""

    knots: tuple[float, ...]
    words: tuple[int, ...]
    stiff: float


def pull(r: float, v: float, tick: int, bowl: Bowl) -> float:
    """Force of one axis: everything that kernels use, in one place."""
    total = share = 0.0
    for i in range(1, len(bowl.knots)):
        if bowl.words[i] == 0 or not (0.0 <= bowl.knots[i] < 2.0):
            continue
        word = bowl.words[i]
        share += word / 3 * bowl.knots[i]
        if share > 4.0:
            break
    r, v = 0.5 * v - r, -v + 0.25 * r
    while total < 2.0:
        total += 0.75 if tick < 100 else 0.5
    return saturate(bowl.stiff * (r + v) * share / sqrt(1.0 + r * r) - total * v, 0.5)


def bowl_force(state: State, tick: int, bowl: Bowl) -> Vector:
    """Force of the plug-in."""
    x = pull(state[0], state[3], tick, bowl) if bowl.stiff > 0.0 else 1e9
    return x, pull(state[1], state[4], tick, bowl), pull(state[2], state[5], tick, bowl)


@dataclass(frozen=True, kw_only=True)
class Own(Pd):
    """A plug-in with kernels of its own."""

    kind: ClassVar[str] = 'own'
    clock_s: ClassVar[float] = 0.1

    def kernel(self) -> Any:
        return bowl_force, Bowl((0.5, 1.0, 1.5, 2.5), (1, 2, 1, 3), self.position_gain_n_m)

    def stage(self, dt_s: float) -> Any:
        kernel, law = self.kernel()
        stage = super().stage(dt_s)
        stage.step = lambda tick, state: (kernel(state, tick, law),)
        return stage


def begun(name):
    """Return the controller of a family where a search begins."""
    kind = family_of(name)
    start = [gene.start for gene in kind.genes()]
    return kind.of_values(name, start, Mission((1.0, 1.0, 1.0), 0.5, 0.1))


FAMILIES = sorted(n for n, kind in controller_file.kinds().items() if issubclass(kind, Family))
CONTROLLERS = [
    *map(load_controller, ('allround', 'paper_ga', 'lqr', 'mpc', 'apf_smc')),
    *map(begun, FAMILIES),
    Own(name='own', position_gain_n_m=0.01, velocity_gain_n_s_m=0.4),
]


def program(controller, folder, optimise, change=('', '')):
    files = c.files(controller, 'exported.c')
    main = MAIN.replace('NAME', controller.name)
    main = main.replace('TICK', 'tick, ' if 'int tick' in files.header else '')
    return compiled(folder, files._replace(source=files.source.replace(*change)), main, optimise)


@pytest.mark.parametrize(
    ('controller', 'optimise'),
    list(zip(CONTROLLERS, itertools.cycle(['-O0', '-O2', '-O3']), strict=False)),
    ids=lambda value: getattr(value, 'name', value),
)
def test_c99_gives_the_bits(controller, optimise, tmp_path):
    ticks, rows = states()
    stage = controller.stage(0.1)
    expected = [stage.step(t, tuple(s))[0] for t, s in zip(ticks, rows, strict=True)]
    given = [[t, *s] for t, s in zip(ticks, rows, strict=True)]
    assert bits(driven(program(controller, tmp_path, optimise), given)) == bits(expected)


OFF_TARGET = replace(
    load_scenario('paper_test'), goal_position_m=(7.5, -40.1, 3.3), duration_s=90.0
)


@pytest.mark.parametrize('name', ['allround', 'time_to_go'])
def test_a_flight_to_a_goal_off_the_target_has_the_bits_of_the_chain(name, tmp_path):
    """The header said `a finite relative state`: that flew to the centre of the target."""
    controller, (goal_m, hold_n) = load_controller(name), OFF_TARGET.goal
    flight = fly(OFF_TARGET, controller)
    states = flight.states - [*goal_m, 0.0, 0.0, 0.0]
    rows = [[tick, *row] for tick, row in enumerate(states.tolist())]
    made = driven(program(controller, tmp_path, '-O2'), rows)
    mass_kg, n = OFF_TARGET.mass_kg, OFF_TARGET.mean_motion_rad_s
    by_hand = mass_kg * n**2 * np.array([-3.0, 0.0, 1.0]) * goal_m
    assert np.allclose(hold_n, by_hand, rtol=1e-14, atol=0.0) and hold_n[0] < -1e-5
    assert bits(made + hold_n) == bits(flight.forces_n)
    header = ' '.join((tmp_path / 'exported.h').read_text().split())
    assert 'position minus goal. Off the target, add the force' in header


@pytest.mark.parametrize('kind', ['plain', 'assured'])
def test_only_what_the_header_declares_has_a_name_outside(kind, tmp_path):
    """Two exported controllers can be linked into one program."""
    scenario = load_scenario('assured')
    files = {
        'plain': lambda: c.files(load_controller('allround'), 'exported.c'),
        'assured': lambda: c_assured.files(load_controller('allround'), scenario, 'exported.c'),
    }[kind]()
    (tmp_path / 'exported.c').write_text(files.source)
    subprocess.run(['cc', '-std=c99', '-c', 'exported.c'], cwd=tmp_path, check=True, timeout=50)
    listed = subprocess.run(
        ['nm', '-g', '--defined-only', '-P', 'exported.o'],
        cwd=tmp_path, check=True, capture_output=True, text=True, timeout=50,
    )  # fmt: skip
    names = {line.split()[0] for line in listed.stdout.splitlines()}
    assert names == set(re.findall(r'^(?:void|int|double) (\w+)\(', files.header, re.M))


def test_the_self_test_finds_another_arithmetic(tmp_path):
    found = program(load_start('trained'), tmp_path, '-O0', ('0.122', '0.1220000000001'))
    assert subprocess.run([found], input='', text=True, timeout=50).returncode == 1


def power(state: State, tick: int, gain: Bowl) -> Vector:
    """Kernel with an operation that differs between machines."""
    return state[0] ** 0.5, 0.0, 0.0


def test_what_c_does_not_get_is_refused():
    with pytest.raises(InputError, match=r'`power` must have .* got state\[0\] \*\* 0.5'):
        Source().function(power)


ALLOCATION = """
#include <stdio.h>
#include "exported.h"
int main(void)
{
    double d[6], most[16], u[16];
    if (quads_16_self_test() != 0) return 1;
    for (int i = 0; i < 16; i++) most[i] = i == 9 ? 0.0 : 0.25;
    while (scanf("%lf %lf %lf %lf %lf %lf", d, d+1, d+2, d+3, d+4, d+5) == 6) {
        printf("%.17g", quads_16_allocate(d, d + 3, most, u));
        for (int i = 0; i < 16; i++) printf(" %.17g", u[i]);
        printf("\\n");
    }
    return 0;
}
"""


def test_the_allocation_of_thrusters_in_c_gives_the_bits(tmp_path):
    table = ThrusterTable(preset='quads_16', force_n=0.25, centre_of_mass_m=(0.05, 0.0, -0.02))
    files = c.allocation_files('quads_16', table, 'exported.c')
    demands = np.random.default_rng(4).normal(size=(300, 6)) * [0.4, 0.4, 0.4, 0.1, 0.1, 0.1]
    made, work = table_of(table, 1.0, 0.0, None, IDENTITY), as_table(np.zeros(SCRATCH))
    expected = []
    for demand in demands.tolist():
        for i in range(16):
            work[LIMIT + i] = 0.0 if i == 9 else 0.25
        wanted = [*demand[:3], *(value / made.lever for value in demand[3:])]
        share, _ = allocate(as_table(wanted), made, work)
        expected.append([share, *work[THRUST : THRUST + 16]])
    found = driven(compiled(tmp_path, files, ALLOCATION, '-O3'), demands.tolist())
    assert bits(found) == bits(expected)
    assert '_MOST_PIVOTS = 100' in files.source
    other = files.source.replace('_MOST_PIVOTS = 100', '_MOST_PIVOTS = 1')
    wrong = compiled(tmp_path, files._replace(source=other), ALLOCATION, '-O0')
    assert subprocess.run([wrong], input='', text=True, timeout=50).returncode == 1
