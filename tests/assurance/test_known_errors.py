# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A scenario that exceeds what assurance assumes is refused, whatever else it has.

Each source has one error that is known; what it is comes from its stage, flown, or from the drawn
numbers themselves. The assumption is 1 % below. Beside it, there may be any other sections.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rpo_core import stage
from rpo_core.assurance import assurance
from rpo_core.assurance.assumed import limit_n
from rpo_core.assurance.settings import Assurance
from rpo_core.files.validation import InputError
from rpo_core.navigation.estimator import Estimator
from rpo_core.navigation.sensors import Navigation, NavigationStage, Sensor, Sensors
from rpo_core.scenario.scenario import load_scenario
from rpo_core.stage import Place, Section, Stage
from rpo_core.thrusters.table import Failure, ThrusterTable
from rpo_core.thrusters.thrusters import (
    STANDARD_GRAVITY_M_S2,
    Propellant,
    Pulses,
    ThrusterError,
    Thrusters,
    stage_of,
    valve_names,
)
from rpo_core.world.cw import cw_step
from rpo_core.world.disturbance import NONE, Disturbance, Harmonic
from rpo_core.world.dynamics import Drag, Dynamics, OrbitStage

BASE = replace(
    load_scenario('assured'),
    disturbance=NONE,
    sections=(),
    initial_position_m=(0.0, 60.0, 0.0),
    goal_position_m=(0.0, -15.0, 0.0),
    requirements=None,
    zones=None,
)
SURE = Assurance(
    keep_out_m=10.0,
    position_error_m=0.1,
    velocity_error_m_s=0.004,
    disturbance_n=0.05,
    thrust_error=0.05,
)
IDEAL = Pulses(count=6, modulation='sigma_delta', minimum_on_time_s=0.0)
SIDES = np.array(list(product((-1.0, 0.0, 1.0), repeat=3)))
MARGIN = 1.01


@dataclass(frozen=True)
class Foreign:
    """Settings of a stage of somebody else."""


@dataclass(frozen=True)
class ForeignFilter:
    """Settings of an estimator of somebody else."""


class ForeignStage(Stage):
    name, inputs, outputs = 'foreign', ('command',), ('foreign_force',)


FOREIGN = (
    ('foreign', Foreign, Place.LINK),
    ('foreign_filter', ForeignFilter, Place.ESTIMATOR),
)


@dataclass
class Case:
    """A scenario in the making: its fields, sections and thrusters, and what is exceeded."""

    random: np.random.Generator
    exceeded: str = ''
    error: float = 0.0

    def __post_init__(self) -> None:
        self.fields, self.sections, self.thrusters, self.own = {}, {}, {}, {}

    def add(self, *sections: object) -> None:
        self.sections |= {type(section): section for section in sections}

    def scenario(self, **given: float):
        """Return the scenario with what the section assumes; raises InputError."""
        own = replace(SURE, **self.own | given)
        sections = [*self.sections.values(), own]
        if self.thrusters:
            sections.append(Thrusters(**self.thrusters))
        return replace(BASE, sections=tuple(sections), **self.fields)

    def direction(self, size: float) -> tuple[float, ...]:
        vector = self.random.normal(size=3)
        return tuple((vector * size / np.linalg.norm(vector)).tolist())

    def exerted(self) -> float:
        """Return the largest share by which the thrusters, flown, miss a command held for 30 ticks.

        The error of force that `disturbance_n` covers is not counted.
        """
        own = Thrusters(**self.thrusters)
        made = stage_of(own, replace(BASE, sections=(own,)))
        lost = 0.0
        if own.pulses is not None and own.pulses.modulation == 'pulse_width':
            each = BASE.max_force_n / (own.pulses.count // 6)
            lost = 0.999 * each * own.pulses.minimum_on_time_s / BASE.dt_s
        shares = [0.0]
        for size in (BASE.max_force_n, 0.5 * BASE.max_force_n, lost):
            for side in SIDES[(SIDES != 0.0).all(axis=1) | (np.abs(SIDES).sum(axis=1) == 1.0)]:
                full = np.abs(side).sum() == 3.0
                if size == 0.0 or (not full and size < BASE.max_force_n):
                    continue
                made.reset()
                command = tuple((side * size).tolist())
                forces = np.array([made.step(tick, command)[2] for tick in range(30)])[10:]
                off = np.linalg.norm(forces.mean(axis=0) - command) - SURE.disturbance_n
                off += SURE.disturbance_n * (size == BASE.max_force_n)
                shares.append(off / np.linalg.norm(command))
        return max(shares)


def a_constant_force(c: Case) -> None:
    c.exceeded, c.error = 'disturbance_n', c.random.uniform(0.01, 0.6)
    c.fields['disturbance'] = Disturbance(constant_n=c.direction(c.error))


def harmonics(c: Case) -> None:
    terms = tuple(
        Harmonic(axis, 'sin', c.random.uniform(0.02, 0.2), c.random.uniform(0.05, 0.5))
        for axis in 'xyz'
    )
    c.fields['disturbance'] = Disturbance(c.direction(0.05), terms)
    forces = c.fields['disturbance'].over(range(0, BASE.ticks, 20), BASE.dt_ns)
    c.exceeded, c.error = 'disturbance_n', float(np.linalg.norm(forces, axis=1).max())


def another_orbit(c: Case) -> None:
    """An ellipse, J2, drag: what moves the chaser in the first tick beyond a circular orbit."""
    drag = Drag(
        density_kg_m3=1e-9,
        target_ballistic_coefficient_kg_m2=c.random.uniform(50.0, 100.0),
        chaser_ballistic_coefficient_kg_m2=c.random.uniform(1.0, 5.0),
    )
    own = Dynamics(
        kind='two_body',
        eccentricity=c.random.uniform(0.05, 0.4),
        true_anomaly_deg=c.random.uniform(-180.0, 180.0),
        inclination_deg=c.random.uniform(0.0, 180.0),
        j2=bool(c.random.integers(2)),
        drag=drag,
    )
    c.add(own)
    c.fields |= {'orbit_radius_m': 1.2e7}
    world = replace(BASE, sections=(own,), **c.fields)
    zero = (0.0, 0.0, 0.0)
    (after,) = OrbitStage(own, world).step(0, world.start, zero, zero)
    plain = cw_step(world.start, zero, world.step)
    push = np.subtract(after, plain)[3:] * world.mass_kg / world.dt_s
    c.exceeded, c.error = 'disturbance_n', float(np.linalg.norm(push))


def a_bias_of_navigation(c: Case) -> None:
    c.exceeded, c.error = 'position_error_m', c.random.uniform(0.01, 20.0)
    c.add(Navigation(position_bias_m=c.direction(c.error)))


def a_bias_of_velocity(c: Case) -> None:
    c.exceeded, c.error = 'velocity_error_m_s', c.random.uniform(0.001, 1.0)
    c.add(Navigation(velocity_bias_m_s=c.direction(c.error)))


def noise(c: Case) -> None:
    own = Navigation(position_noise_m=c.random.uniform(0.01, 1.0), noise_key=(7, 9))
    (states,) = NavigationStage(own).steps(np.arange(50), np.zeros((50, 6)))
    c.exceeded, c.error = 'position_error_m', float(np.linalg.norm(states[:, :3], axis=1).max())
    c.add(own)


def biased_sensors(c: Case) -> None:
    """One or two with the same bias, and a wrong scale along the line of sight to the start."""
    bias_m, scale = c.random.uniform(0.05, 20.0), c.random.choice([0.0, 0.02])
    c.exceeded, c.error = 'position_error_m', bias_m + scale * 60.0
    kind = str(c.random.choice(['relative_position', 'range_bearing']))
    unit = Sensor(kind, bias_m=(0.0, bias_m, 0.0), scale_error=float(scale))
    c.add(Sensors((unit,) * int(c.random.integers(1, 3))), Estimator())


def a_biased_camera(c: Case) -> None:
    c.exceeded, c.error = 'position_error_m', c.random.uniform(0.05, 20.0)
    c.add(Sensors((Sensor('relative_position', bias_m=c.direction(c.error)),)), Estimator())


def a_matrix(c: Case) -> None:
    off = c.random.normal(size=(3, 3))
    off *= c.random.uniform(0.01, 2.5) / np.linalg.norm(off, 2)
    matrix = np.eye(3) + off
    c.exceeded, c.error = 'thrust_error', float(np.linalg.norm(off, 2))
    c.thrusters['matrix'] = tuple(map(tuple, matrix.tolist()))


def wrong_valves(c: Case) -> None:
    count = int(c.random.choice([6, 12]))
    names = c.random.choice(valve_names(count), int(c.random.integers(1, count)), replace=False)
    errors = tuple(
        ThrusterError(
            thruster=str(name),
            magnitude_share=c.random.uniform(-1.0, 0.5),
            misalignment_deg=c.direction(c.random.uniform(0.0, 60.0)),
        )
        for name in names
    )
    c.thrusters['pulses'] = replace(IDEAL, count=count, errors=errors)
    if c.random.integers(2):
        a_matrix(c)
    c.exceeded, c.error = 'thrust_error', c.exerted()


def late_valves(c: Case) -> None:
    late = {
        'dead_time_s': c.random.uniform(0.005, 0.03),
        'rise_time_s': c.random.uniform(0.0, 0.02),
    }
    c.thrusters['pulses'] = replace(IDEAL, minimum_on_time_s=0.01, **late)
    c.exceeded, c.error = 'thrust_error', c.exerted()


def coarse_valves(c: Case) -> None:
    """What is too short is lost for ever."""
    c.thrusters['pulses'] = replace(
        IDEAL, modulation='pulse_width', minimum_on_time_s=c.random.uniform(0.02, 0.045)
    )
    c.exceeded, c.error = 'thrust_error', c.exerted()


def burnt_mass(c: Case) -> None:
    """A tank that commands on all axes empty, flown."""
    tank_kg = c.random.uniform(0.2, 3.0)
    impulse = c.random.uniform(1.1, 2.8) * BASE.max_force_n * BASE.duration_s
    isp_s = impulse / tank_kg / STANDARD_GRAVITY_M_S2
    c.thrusters['propellant'] = Propellant(specific_impulse_s=isp_s, mass_kg=tank_kg)
    own = Thrusters(**c.thrusters)
    made, ticks = stage_of(own, replace(BASE, sections=(own,))), BASE.ticks
    masses = [made.step(tick, (0.5, -0.5, 0.5))[3][0] for tick in range(0, ticks)]
    c.exceeded, c.error = 'thrust_error', BASE.mass_kg / masses[-1] - 1.0


def another_mass(c: Case) -> None:
    c.exceeded, c.error = 'thrust_error', c.random.uniform(0.02, 0.9)
    c.own['mass_kg'] = BASE.mass_kg * (1.0 + c.random.choice([-1.0, 1.0]) * c.error)


SOURCES = (
    a_constant_force,
    harmonics,
    another_orbit,
    a_bias_of_navigation,
    a_bias_of_velocity,
    noise,
    biased_sensors,
    a_biased_camera,
    a_matrix,
    wrong_valves,
    late_valves,
    coarse_valves,
    burnt_mass,
    another_mass,
)


def beside(c: Case) -> None:
    """Add other sections, as they please: none of them takes anything of the error away."""
    r = c.random
    if c.exceeded != 'thrust_error' or c.thrusters.keys() == {'matrix'}:
        part = int(r.integers(4))
        if part == 1 and 'pulses' not in c.thrusters:
            c.thrusters['pulses'] = replace(IDEAL, count=int(r.choice([6, 12])))
        elif part == 2 and 'pulses' not in c.thrusters:
            c.thrusters['table'] = ThrusterTable(preset='corners_24', force_n=0.3)
    if r.integers(2):
        c.thrusters['delay_ticks'] = int(r.integers(3))
    if 'propellant' not in c.thrusters and r.integers(2):
        # So much that what is burnt changes nothing.
        c.thrusters['propellant'] = Propellant(specific_impulse_s=3e4, mass_kg=0.5)
    if Dynamics not in c.sections and r.integers(2):
        c.add(Dynamics(kind=str(r.choice(['two_body', 'linear_elliptic', 'clohessy_wiltshire']))))
    if Sensors not in c.sections and r.integers(2):
        ideal = Sensor('relative_position', noise_floor_m=1e-4)
        c.add(Sensors((ideal,)), *([Estimator()] if Navigation not in c.sections else []))
    own = c.sections.get(Navigation)
    if own is not None and own.position_noise_m == 0.0 and r.integers(2):
        c.add(ForeignFilter())
    if r.integers(2):
        c.add(Foreign())


def refusal(c: Case, **given: float) -> str:
    """Return the message; '' where it is accepted."""
    try:
        c.scenario(**given)
    except InputError as error:
        return str(error)
    return ''


def drawn(seed: int, source=None) -> Case:
    """Return a scenario that exceeds one assumption."""
    random = np.random.default_rng(seed)
    c = Case(random)
    (source or SOURCES[random.integers(len(SOURCES))])(c)
    if random.integers(4):
        beside(c)
    return c


def check(c: Case) -> None:
    """Assert that 1 % too little is refused with a value, and that this value is enough."""
    if c.error < 1e-4:
        return
    said = refusal(c, **{c.exceeded: min(c.error / MARGIN, 0.999)})
    if c.exceeded == 'thrust_error' and c.error > 1.0:
        assert '1 at most can be assumed' in said, said
        return
    found = re.search(rf'`assurance\.{c.exceeded}` must be at least (\S+), which', said)
    assert found, (c, c.sections, c.thrusters, c.own, said)
    enough = float(found[1])
    assert c.error * (1.0 - 1e-6) <= enough, (c, c.thrusters)
    if enough <= 1.0 or c.exceeded != 'thrust_error':
        assert f'`assurance.{c.exceeded}`' not in refusal(c, **{c.exceeded: enough})


@pytest.fixture
def foreign(monkeypatch):
    """A stage of somebody else may stand after assurance; no time goes into values that work."""
    for name, kind, place in FOREIGN:
        section = Section(name, kind, place, lambda *_: ForeignStage())
        monkeypatch.setitem(stage.sections(), name, section)
    monkeypatch.setattr(assurance, 'values_that_work', lambda *_: '', raising=False)


SEEDS = st.integers(0, 2**63)


@pytest.mark.usefixtures('foreign')
@pytest.mark.parametrize('source', SOURCES, ids=lambda source: source.__name__)
def test_too_little_is_refused(source):
    for seed in range(3):
        check(drawn(seed, source))


@pytest.mark.usefixtures('foreign')
@given(SEEDS)
@settings(max_examples=30)
def test_too_little_is_refused_beside_anything(seed):
    check(drawn(seed))


def at_60_m(*sections, disturbance=NONE, **given):
    """Return the scenario of the issue; raises InputError."""
    found = [replace(SURE, **given), *sections]
    return replace(BASE, sections=tuple(found), disturbance=disturbance)


CAMERA = Sensors((Sensor('relative_position', bias_m=(0.0, 8.0, 0.0)),))
TANK = Propellant(specific_impulse_s=1.0, mass_kg=0.2)


def test_known_failures_of_pulses_leave_less_force():
    """As those of a table; stuck on, a valve is made up for by those on the other side."""
    twelve = replace(IDEAL, count=12)
    for thruster, how in (('y+a', 'off'), ('y+a', 'on'), ('z-b', 'off')):
        failure = Failure(thruster=thruster, stuck=how, from_s=100.0, known=True)
        for known, share in ((True, 0.5), (False, 1.0)):
            pulses = replace(twelve, failures=(replace(failure, known=known),))
            own = Thrusters(pulses=pulses)
            assert limit_n(replace(BASE, sections=(own,))) == share * BASE.max_force_n
    both = tuple(replace(failure, thruster=name) for name in ('x+a', 'x+b'))
    for failures in (both, (Failure(thruster='x-a', stuck='on', known=True), both[0], both[1])):
        own = Thrusters(pulses=replace(twelve, failures=failures))
        with pytest.raises(InputError, match=r'none to x\+'):
            limit_n(replace(BASE, sections=(own,)))


def test_the_force_that_known_failures_leave_is_exerted():
    """Flown: a command at the limit of assurance, to all corners, with one of twelve stuck."""
    for thruster, how in (('y+a', 'off'), ('x-b', 'on')):
        failure = Failure(thruster=thruster, stuck=how, known=True)
        own = Thrusters(pulses=replace(IDEAL, count=12, failures=(failure,)))
        flown = replace(BASE, sections=(own,))
        made, size = stage_of(own, flown), limit_n(flown)
        for side in product((-1.0, 1.0), repeat=3):
            command = tuple(size * s for s in side)
            made.reset()
            forces = np.array([made.step(tick, command)[2] for tick in range(20)])
            assert np.allclose(forces[5:].mean(axis=0), command, atol=1e-9)


def test_a_tank_that_would_do_does():
    """At full thrust on an axis, to and fro, it is empty at the end and not before."""
    tank = replace(TANK, specific_impulse_s=30.0)
    said = refusal_of(Thrusters(propellant=tank))
    found = re.search(r'`specific_impulse_s` at least (\S+), or `mass_kg` (\S+);', said)
    impulse_s, mass_kg = map(float, found.groups())
    for own, enough in (
        (replace(tank, mass_kg=mass_kg), True),
        (replace(tank, specific_impulse_s=impulse_s), True),
        (replace(tank, mass_kg=0.999 * mass_kg), False),
    ):
        said = refusal_of(Thrusters(propellant=own), thrust_error=0.08)
        assert ('propellant' in said) != enough, said
        thrusters = Thrusters(propellant=own)
        made = stage_of(thrusters, replace(BASE, sections=(thrusters,)))
        forces = [made.step(t, (0.5 * (-1) ** t, 0.0, 0.0))[2][0] for t in range(BASE.ticks)]
        assert (abs(forces[-1]) == 0.5) == enough


def test_sensors_that_differ_have_only_in_common_what_they_share():
    def seen(*biases):
        units = tuple(Sensor('relative_position', bias_m=bias) for bias in biases)
        return refusal_of(Sensors(units), Estimator())

    assert 'at least 3,' in seen((0.0, 3.0, 0.0), (0.0, 5.0, 0.0))
    assert 'at least 3,' in seen((3.0, 4.0, 0.0), (3.0, -4.0, 0.0))
    assert 'at least' not in seen((0.0, 3.0, 0.0), (0.0, -0.1, 0.0))
    assert 'at least' not in seen((0.0, 3.0, 0.0), (0.0, 0.0, 0.0))
    assert 'at least' not in refusal_of(CAMERA)  # nothing reads it


def refusal_of(*sections, **changes):
    """Return the message; '' where the sections are accepted."""
    try:
        at_60_m(*sections, **changes)
    except InputError as error:
        return str(error)
    return ''


def test_a_spread_that_assurance_looks_at_covers_a_bias_within_it():
    loud = Sensors((Sensor('relative_position', bias_m=(0.0, 0.5, 0.0), noise_floor_m=0.2),))
    assert 'at least 0.5,' in refusal_of(loud, Estimator())
    assert 'at least' not in refusal_of(loud, Estimator(), sigmas=3.0)
    assert 'at least 8,' in refusal_of(CAMERA, Estimator(), sigmas=3.0)


def test_all_that_conflicts_is_one_message_and_its_values_work():
    """Sensors without what is assumed of them; a corridor too narrow for what is."""
    found = load_scenario('assured')
    own = found.section(Assurance)
    sections = [s for s in found.sections if not isinstance(s, (Navigation, Assurance))]
    steady = Sensors((Sensor('relative_position', bias_m=(0.0, 0.1, 0.0)),))
    with pytest.raises(InputError) as error:
        replace(found, sections=(*sections, steady, Estimator(), own))
    said = str(error.value)
    assert '`assurance.position_error_m` is missing; section `sensors` needs it' in said
    assert '`assurance.velocity_error_m_s` is missing; section `sensors` needs it' in said
    assert '`assurance.corridor` and the assumed errors exclude each other' in said
    values = dict(re.findall(r'`([\w.]+): ([\d.e+-]+)`', said))
    assert values.keys() == {'position_error_m', 'corridor.width_m'}
    width_m = float(values.pop('corridor.width_m'))
    assert own.corridor.width_m < width_m < 0.3
    own = replace(own, corridor=replace(own.corridor, width_m=width_m))
    own = replace(own, velocity_error_m_s=0.0, position_error_m=float(values['position_error_m']))
    assert replace(found, sections=(*sections, steady, Estimator(), own))
