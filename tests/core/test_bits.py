# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Interpreted and compiled kernels: the same bits, each in its own interpreter."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest
from core_oracles import python

from rpo_core.files.validation import InputError
from rpo_kernels import jit

DIGESTS = """
import hashlib
import numpy as np
from rpo_kernels import kernels
from rpo_kernels import jit
from rpo_core.world import cw
from rpo_core.chain.flight import fly
from rpo_core.control.controller import FuzzyController
from rpo_core.control.fuzzy import FuzzySystem
from rpo_core.control.controller import load_controller
from rpo_core.world.dynamics import Drag, Dynamics
from rpo_thrusters import table
from rpo_thrusters.thrusters import Failure, Propellant, Pulses, ThrusterError, Thrusters
from rpo_ctrl.baselines import Mpc, PotentialField
from rpo_core.files.scenario import load_scenario
from rpo_attitude.target import Target
from rpo_guidance.guidance import GuidanceStage
from rpo_guidance.plan import Guidance, Leg

def digest(name, *values):
    joined = b''.join(np.ascontiguousarray(value).tobytes() for value in values)
    print(name, hashlib.sha256(joined).hexdigest())

print('compiled', jit.COMPILED)
textbook = [0.5, 0.0, 0.5, 1.0, 0.5]
rules = [1, 1, 1, 2, 3, 2, 2, 3, 4, 3, 4, 5, 4, 5, 5]
system = FuzzySystem.from_vector([*textbook, *textbook, *textbook, *rules])
flight = fly(load_scenario('paper_test'), FuzzyController('textbook', system, 70.0, 0.9, 0.5))
digest('states', flight.states)
digest('forces', flight.forces_n)
digest('disturbances', flight.disturbances_n)

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
digest('sin_cos', [kernels.sin_cos(float(angle)) for angle in angles])
steps = [cw.discretise(1.16e-3, 10.0, float(dt)) for dt in rng.uniform(1e-6, 1e3, 200)]
digest('steps', steps)
state, track = (10.0, 60.0, -40.0, 0.1, 0.2, -0.3), []
for step, draws in zip(steps, rng.uniform(-1, 1, (200, 6)).tolist()):
    state = kernels.plant_step(state, tuple(draws[:3]), tuple(draws[3:]), 0.5, step)
    track.append(state)
digest('plant', track)

model = {'approach_speed_m_s': 0.8, 'rounding_radius_m': 40.0}
baselines = [Mpc(name='mpc', horizon_s=30.0, least_time_to_go_s=5.0),
          PotentialField(name='apf', switching_gain_n=0.1, boundary_layer_m_s=0.2, **model)]
digest('baselines', [baseline.force_n(state[:3], state[3:], tick) for baseline in baselines
                  for tick, state in enumerate(rng.uniform(-9, 9, (300, 6)).tolist())])

air = Drag(density_kg_m3=2e-11, target_ballistic_coefficient_kg_m2=150.0, scale_height_m=5e4,
           chaser_ballistic_coefficient_kg_m2=110.0, atmosphere_rate_rad_s=7e-5)
world = Dynamics(kind='two_body', eccentricity=0.02, inclination_deg=51.6, j2=True, drag=air)
on = Failure(thruster='x+a', stuck='on', from_s=1.0, until_s=2.0, known=True)
off = Failure(thruster='y-b', stuck='off', from_s=1.5)
askew = ThrusterError(thruster='z+a', magnitude_share=0.02, misalignment_deg=(1.0, 2.0, 3.0))
pulses = Pulses(count=12, modulation='sigma_delta', minimum_on_time_s=0.01, on_time_quantum_s=0.001,
                dead_time_s=0.002, rise_time_s=0.003, errors=(askew,), failures=(on, off))
tank = Propellant(specific_impulse_s=2.0, mass_kg=0.3)
hardware = Thrusters(delay_ticks=1, pulses=pulses, propellant=tank)
for name, section in (('world', world), ('valves', hardware)):
    flown = load_scenario('quick').equipped(section)
    digest(name, fly(flown, load_controller('pd')).states)

body = ((120.0, 0.0, 0.0), (0.0, 150.0, 10.0), (0.0, 10.0, 200.0))
tumble = Target(kind='tumble', rates_deg_s=(0.3, 0.4, 0.8), inertia_kg_m2=body)
mouth = Leg(name='mouth', kind='transfer', frame='target', to_m=(0.0, 18.0, 0.0), duration_s=300.0)
line = Leg(name='line', kind='straight', frame='target', to_m=(0.0, 1.0, 0.0), speed_m_s=0.1)
tumbling = load_scenario('quick').equipped(tumble, Guidance(legs=(mouth, line)))
references = [GuidanceStage(tumbling.section(Guidance), tumbling).rows(tumbling.start, 3300)]
near = Leg(name='mouth', kind='transfer', frame='target', to_m=(9.0, 8.0, 1.0), duration_s=40.0)
for rates in rng.uniform(-3, 3, (8, 3)).tolist():
    tumble = Target(kind='tumble', rates_deg_s=tuple(rates), inertia_kg_m2=body)
    some = tumbling.equipped(tumble, Guidance(legs=(near, line)))
    references.append(GuidanceStage(some.section(Guidance), some).rows(some.start, 600))
digest('turning', *references)

off = table.Failure(thruster='x+a', stuck='off', from_s=1.0, until_s=2.0, known=True)
on = table.Failure(thruster='y-a', stuck='on', from_s=1.5, until_s=1.8, known=True)
for name in ('faces_6', 'pairs_12', 'quads_16', 'corners_24'):
    failures = () if name == 'faces_6' else (off, on)
    valves = table.ThrusterTable(preset=name, force_n=0.2, centre_of_mass_m=(0.1, 0.02, -0.05),
                                 minimum_impulse_bit_n_s=0.001, failures=failures)
    flight = fly(load_scenario('quick').equipped(Thrusters(table=valves)), load_controller('pd'))
    digest(name, flight.states, flight.signals['exerted_torque'])
"""

# Recorded once. A machine, NumPy or Python that differs here cannot replay the logs of the others;
# whoever changes these bits on purpose makes old logs fail `rpo verify`, and says so in CHANGELOG.
RECORDED = Path(__file__).with_name('digests.txt').read_text().splitlines()


@pytest.fixture(scope='module')
def interpreted():
    return python(DIGESTS, RPO_JIT='0').splitlines()


@pytest.fixture(scope='module')
def compiled():
    return python(DIGESTS, RPO_JIT='1').splitlines()


def test_the_switch_switches(interpreted, compiled):
    assert interpreted[0] == 'compiled False'
    assert compiled[0] == 'compiled True'


def test_compiled_kernels_give_the_interpreted_bits(interpreted, compiled):
    assert len(interpreted) == 16
    assert interpreted[1:] == compiled[1:]


def test_bits_are_those_of_every_other_machine(interpreted):
    assert interpreted[1:] == RECORDED


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
from rpo_kernels import jit
print(jit.COMPILED)
"""


def test_without_numba_kernels_are_interpreted():
    assert python(WITHOUT_NUMBA, RPO_JIT='') == 'False\n'
