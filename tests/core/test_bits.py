# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Interpreted and compiled kernels: the same bits, each in its own interpreter."""

from __future__ import annotations

import importlib.util

import pytest
from core_oracles import python

from rpo_core import jit
from rpo_core.validation import InputError

DIGESTS = """
import hashlib
import numpy as np
from rpo_core import cw, jit, kernels
from rpo_core.closed_loop import fly
from rpo_core.controller import load_controller
from rpo_core.fuzzy import FuzzySystem
from rpo_core.scenario import load_scenario

def digest(name, *values):
    joined = b''.join(np.ascontiguousarray(value).tobytes() for value in values)
    print(name, hashlib.sha256(joined).hexdigest())

print('compiled', jit.COMPILED)
flight = fly(load_scenario('paper_test'), load_controller('handmade'))
digest('states', flight.states)
digest('forces', flight.forces_n)
digest('disturbances', flight.disturbances_n)

rng = np.random.default_rng(11)
outputs = []
for _ in range(150):
    parts = [[rng.uniform(0.01, 1), *np.sort(rng.uniform(0, 1, 3)), rng.uniform(0, 0.99)]
             for _ in range(3)]
    system = FuzzySystem.from_vector([*sum(parts, []), *rng.integers(1, 6, 15)],
                                     samples=int(2 * rng.integers(1, 150) + 1))
    outputs += [system.output(*point) for point in rng.uniform(-1.1, 1.1, (30, 2))]
digest('outputs', outputs)

angles = [*rng.uniform(-1e6, 1e6, 2000), *rng.uniform(-9, 9, 2000), 0.0, -0.0]
digest('sin_cos', [kernels.sin_cos(float(angle)) for angle in angles])
steps = [cw.discretise(1.16e-3, 10.0, float(dt)) for dt in 10 ** rng.uniform(-6, 3, 200)]
digest('steps', steps)
state, track = (10.0, 60.0, -40.0, 0.1, 0.2, -0.3), []
for step, command, push in zip(steps, rng.normal(size=(200, 3)), rng.normal(size=(200, 3))):
    state = kernels.plant_step(state, tuple(command.tolist()), tuple(push.tolist()), 0.5, step)
    track.append(state)
digest('plant', track)
"""


@pytest.fixture(scope='module')
def interpreted():
    return python(DIGESTS, RPO_JIT='0').splitlines()


@pytest.fixture(scope='module')
def compiled():
    return python(DIGESTS, RPO_JIT='1').splitlines()


def test_the_switch_switches(interpreted, compiled):
    assert interpreted[0] == 'compiled False'
    assert compiled[0] == 'compiled True'


@pytest.mark.parametrize(
    'line',
    range(1, 8),
    ids=['states', 'forces', 'disturbances', 'outputs', 'sin_cos', 'steps', 'plant'],
)
def test_compiled_kernels_give_the_interpreted_bits(line, interpreted, compiled):
    assert interpreted[line] == compiled[line]


def test_unset_takes_numba_where_it_is():
    installed = importlib.util.find_spec('numba') is not None
    assert python('from rpo_core import jit; print(jit.COMPILED)', RPO_JIT='') == f'{installed}\n'


WITHOUT_NUMBA = """
import importlib.util
find_spec = importlib.util.find_spec
importlib.util.find_spec = lambda name: None if name == 'numba' else find_spec(name)
from rpo_core.validation import InputError
try:
    from rpo_core import jit
    print(jit.COMPILED)
except InputError as error:
    print(error)
"""


def test_without_numba_kernels_are_interpreted_or_refused():
    assert python(WITHOUT_NUMBA, RPO_JIT='') == 'False\n'
    assert python(WITHOUT_NUMBA, RPO_JIT='1').endswith('but numba is not installed\n')


def test_the_switch_takes_no_other_word(monkeypatch):
    monkeypatch.setenv('RPO_JIT', 'yes')
    with pytest.raises(InputError, match="`RPO_JIT` must be 0, 1 or unset; got 'yes'"):
        jit._wanted()
