# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""C of controllers, of families and of plug-ins: compiled by the system, the bits of the core."""

from __future__ import annotations

import shutil
import subprocess
from dataclasses import dataclass
from math import sqrt
from typing import Any, ClassVar, NamedTuple

import numpy as np
import pytest
from c_programs import bits, compiled, driven, states

from rpo_core.control import controller_file
from rpo_core.control.controller import load_controller
from rpo_core.files.validation import InputError
from rpo_ctrl.baselines import Pd
from rpo_ctrl.family import Family, Mission, family_of
from rpo_export import c, c_allocation, text_of
from rpo_export.c_source import Source
from rpo_kernels.jit import as_table
from rpo_kernels.kernels import State, Vector, saturate
from rpo_thrusters.allocation_kernels import LIMIT, SCRATCH, THRUST, allocate
from rpo_thrusters.table import IDENTITY, ThrusterTable, table_of

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


def family_names():
    return sorted(n for n, kind in controller_file.kinds().items() if issubclass(kind, Family))


def program(controller, folder, optimise, change=('', '')):
    header = c.header(controller, 'exported.c')
    main = MAIN.replace('NAME', controller.name)
    main = main.replace('TICK', 'tick, ' if 'int tick' in header else '')
    return compiled(folder, text_of(controller, 'c').replace(*change), header, main, optimise)


def check_bits(controller, folder, optimise):
    ticks, rows = states()
    stage = controller.stage(0.1)
    expected = [stage.step(t, tuple(s))[0] for t, s in zip(ticks, rows, strict=True)]
    found = driven(
        program(controller, folder, optimise),
        [[t, *s] for t, s in zip(ticks, rows, strict=True)],
    )
    assert bits(found) == bits(expected)


@pytest.mark.parametrize(
    ('name', 'optimise'),
    [('trained', '-O0'), ('paper_ga', '-O2'), ('pace', '-O2'), ('time_to_go', '-O3'),
     ('lqr', '-O2'), ('mpc', '-O0'), ('apf_smc', '-O2')],
)  # fmt: skip
def test_c99_gives_the_bits(name, optimise, tmp_path):
    check_bits(load_controller(name), tmp_path, optimise)


@pytest.mark.parametrize('name', family_names())
def test_every_family_is_c_where_a_search_begins(name, tmp_path):
    kind = family_of(name)
    start = [gene.start for gene in kind.genes()]
    check_bits(kind.of_values(name, start, Mission((1.0, 1.0, 1.0), 0.5, 0.1)), tmp_path, '-O2')


def test_the_self_test_finds_another_arithmetic(tmp_path):
    found = program(load_controller('trained'), tmp_path, '-O2', ('0.122', '0.1220000000001'))
    assert subprocess.run([found], input='', text=True, timeout=50).returncode == 1


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


def test_a_plug_in_with_its_own_kernels_has_its_bits(tmp_path):
    check_bits(Own(name='own', position_gain_n_m=0.01, velocity_gain_n_s_m=0.4), tmp_path, '-O2')


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


@pytest.mark.parametrize('optimise', ['-O0', '-O3'])
def test_the_allocation_of_thrusters_in_c_gives_the_bits(tmp_path, optimise):
    table = ThrusterTable(preset='quads_16', force_n=0.25, centre_of_mass_m=(0.05, 0.0, -0.02))
    source = c_allocation.text('quads_16', table)
    header = c_allocation.header('quads_16', table, 'exported.c')
    found = compiled(tmp_path, source, header, ALLOCATION, optimise)
    demands = np.random.default_rng(4).normal(size=(300, 6)) * [0.4, 0.4, 0.4, 0.1, 0.1, 0.1]
    made, work = table_of(table, 1.0, 0.0, None, IDENTITY), as_table(np.zeros(SCRATCH))
    expected = []
    for demand in demands.tolist():
        for i in range(16):
            work[LIMIT + i] = 0.0 if i == 9 else 0.25
        wanted = [*demand[:3], *(value / made.lever for value in demand[3:])]
        share, _ = allocate(as_table(wanted), made, work)
        expected.append([share, *work[THRUST : THRUST + 16]])
    assert bits(driven(found, demands.tolist())) == bits(expected)
    assert '_MOST_PIVOTS = 100' in source
    other = source.replace('_MOST_PIVOTS = 100', '_MOST_PIVOTS = 1')
    wrong = compiled(tmp_path, other, header, ALLOCATION, optimise)
    assert subprocess.run([wrong], input='', text=True, timeout=50).returncode == 1
