# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Interpreted and compiled kernels: the same bits, each in its own interpreter."""

from __future__ import annotations

import importlib.util

import pytest
from core_oracles import python

from rpo_core.files.validation import InputError
from rpo_core.kernels import jit

DIGESTS = """
import hashlib
import numpy as np
from rpo_core.kernels import arithmetic, jit
from rpo_core.world import cw
from rpo_core.chain.flight import fly
from rpo_core.control.fuzzy import FuzzySystem
from rpo_core.control.controller import load_controller
from rpo_core.scenario.scenario import load_scenario
from rpo_core.thrusters import table
from rpo_core.thrusters.thrusters import Failure, Propellant, Pulses, ThrusterError, Thrusters

def digest(name, *values):
    joined = b''.join(np.ascontiguousarray(value).tobytes() for value in values)
    print(name, hashlib.sha256(joined).hexdigest())

print('compiled', jit.COMPILED)
rng = np.random.default_rng(11)  # uniform draws only: no power, no logarithm of the C library
outputs = []
for _ in range(150):
    parts = [[rng.uniform(0.01, 1), *np.sort(rng.uniform(0, 1, 3)), rng.uniform(0, 0.99)]
             for _ in range(3)]
    system = FuzzySystem.from_vector([*sum(parts, []), *rng.integers(1, 6, 15)],
                                     samples=int(2 * rng.integers(1, 150) + 1))
    outputs += [system.output(*point) for point in rng.uniform(-1.1, 1.1, (30, 2))]
digest('outputs', outputs)

angles = [*rng.uniform(-1e6, 1e6, 2000), *rng.uniform(-9, 9, 2000), 0.0, -0.0]
digest('sin_cos', [arithmetic.sin_cos(float(angle)) for angle in angles])
steps = [cw.discretise(1.16e-3, 10.0, float(dt)) for dt in rng.uniform(1e-6, 1e3, 200)]
digest('steps', steps)
state, track = (10.0, 60.0, -40.0, 0.1, 0.2, -0.3), []
for step, draws in zip(steps, rng.uniform(-1, 1, (200, 6)).tolist()):
    pushed = (arithmetic.saturate(f, 0.5) + d for f, d in zip(draws[:3], draws[3:], strict=True))
    state = cw.cw_step(state, tuple(pushed), step)
    track.append(state)
digest('plant', track)

on = Failure(thruster='x+a', stuck='on', from_s=1.0, until_s=2.0, known=True)
askew = ThrusterError(thruster='z+a', magnitude_share=0.02, misalignment_deg=(1.0, 2.0, 3.0))
pulses = Pulses(count=12, modulation='sigma_delta', minimum_on_time_s=0.01, on_time_quantum_s=0.001,
                dead_time_s=0.002, rise_time_s=0.003, errors=(askew,), failures=(on,))
tank = Propellant(specific_impulse_s=2.0, mass_kg=0.3)
hardware = [Thrusters(delay_ticks=1, pulses=pulses, propellant=tank)]
off = table.Failure(thruster='x+a', stuck='off', from_s=1.0, until_s=2.0, known=True)
on = table.Failure(thruster='y-a', stuck='on', from_s=1.5, until_s=1.8, known=True)
for name in table.PRESETS:
    hardware.append(Thrusters(table=table.ThrusterTable(
        preset=name, force_n=0.2, centre_of_mass_m=(0.1, 0.02, -0.05),
        minimum_impulse_bit_n_s=0.001, failures=() if name == 'faces_6' else (off, on))))
for number, thrusters in enumerate(hardware):
    flight = fly(load_scenario('quick').equipped(thrusters), load_controller('pd'))
    digest(f'hardware {number}', flight.states, *flight.signals.values())
"""


def test_compiled_kernels_give_the_interpreted_bits():
    """Of drawn inputs, and of hardware that does not ship; what ships is in `tests/digests`."""
    interpreted, compiled = (python(DIGESTS, RPO_JIT=choice).splitlines() for choice in '01')
    assert (interpreted[0], compiled[0]) == ('compiled False', 'compiled True')
    assert len(interpreted) > 9 and interpreted[1:] == compiled[1:]


def test_numba_is_taken_where_it_is_unless_somebody_says_so(monkeypatch):
    monkeypatch.delenv('RPO_JIT', raising=False)
    assert jit._wanted() == (importlib.util.find_spec('numba') is not None)
    monkeypatch.setattr(importlib.util, 'find_spec', lambda name: None)
    for word, said in (
        ('1', '`RPO_JIT=1` needs compiled kernels, but numba is not installed'),
        ('yes', "`RPO_JIT` must be 0, 1 or unset; got 'yes'"),
    ):
        monkeypatch.setenv('RPO_JIT', word)
        with pytest.raises(InputError, match=said):
            jit._wanted()


WITHOUT_NUMBA = """
import importlib.util
find_spec = importlib.util.find_spec
importlib.util.find_spec = lambda name: None if name == 'numba' else find_spec(name)
from rpo_core.kernels import jit
print(jit.COMPILED)
"""


def test_without_numba_kernels_are_interpreted():
    assert python(WITHOUT_NUMBA, RPO_JIT='') == 'False\n'
