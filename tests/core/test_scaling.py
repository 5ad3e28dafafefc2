# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Similarity: a scaled loop flies the same flight in other units."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from rpo_core import files
from rpo_core.chain.flight import fly
from rpo_core.control.controller import dumps, load_controller, parse
from rpo_core.control.controller_file import ControllerFile, Scaling
from rpo_core.files.validation import InputError
from rpo_core.judge import similarity
from rpo_core.judge.similarity import Units
from rpo_core.scenario.scenario import Scenario, load, load_scenario
from rpo_core.thrusters.thrusters import Thrusters

SCALE = [name for name in files.shipped('controller') if name != 'drift']
PAPER = Units(100.0, 200.0, 10.0)
ORBIT_M = 42_164_000.0


def vehicle(length: float, time: float, mass: float, orbit_m: float) -> Scenario:
    """Return the paper's test in other units, its disturbance too, around an orbit."""
    base, force = load_scenario('paper_test'), mass * length / time**2
    harmonics = (
        replace(
            h,
            amplitude_n=h.amplitude_n * force,
            angular_rate_rad_s=h.angular_rate_rad_s / time,
        )
        for h in base.disturbance.harmonics
    )
    x, y, z = base.initial_position_m
    return replace(
        base,
        orbit_radius_m=orbit_m,
        mass_kg=base.mass_kg * mass,
        max_force_n=base.max_force_n * force,
        dt_s=base.dt_s * time,
        duration_s=30.0 * time,
        initial_position_m=(x * length, y * length, z * length),
        disturbance=replace(
            base.disturbance,
            constant_n=tuple(d * force for d in base.disturbance.constant_n),
            harmonics=tuple(harmonics),
        ),
        requirements=None,
    )


def check(name: str, length: float, time: float, mass: float, wider: float, exact: bool) -> None:
    """Fly a controller, and its scaled one in the scaled scenario: the flights are similar.

    wider : radius of the orbit as a multiple, so that the motion of the target is slower by time
    """
    own, force = load_controller(name), mass * length / time**2
    here, there = vehicle(1.0, 1.0, 1.0, ORBIT_M), vehicle(length, time, mass, ORBIT_M * wider)
    own = own.scaled(Scaling(1.0, 1.0, 1.0, here))  # a model of the plant becomes the scenario's
    scaled = own.scaled(Scaling(length, time, force, there))
    assert parse(files.parse_yaml(dumps(scaled))) == scaled
    first, second = fly(here, own), fly(there, scaled)
    speed = length / time
    units = np.array([length] * 3 + [speed] * 3)
    pairs = ((first.states * units, second.states), (first.forces_n * force, second.forces_n))
    for expected, found in pairs:
        if exact:
            np.testing.assert_array_equal(found, expected)
        else:
            np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-10 * abs(expected).max())


@pytest.mark.parametrize('name', SCALE)
def test_powers_of_two_change_no_bit(name):
    """Time eight times as long: an orbit of four times the radius has an eighth of the motion."""
    check(name, 0.5, 8.0, 4.0, 4.0, exact=True)


@settings(max_examples=20, deadline=None, phases=[Phase.explicit, Phase.generate])
@given(
    name=st.sampled_from(SCALE),
    length=st.floats(0.05, 20.0),
    mass=st.floats(0.1, 100.0),
    time=st.sampled_from([0.3, 0.7, 1.3, 2.0, 5.0]),
)
def test_a_scaled_loop_is_similar(name, length, mass, time):
    check(name, length, time, mass, time ** (2.0 / 3.0), exact=False)


def test_the_numbers_of_a_scaled_loop_in_the_scaled_scenario_are_its_own():
    training = load('paper_training')
    made = similarity.numbers(training, PAPER, 0.5)
    assert made[similarity.AUTHORITY] == 20.0 and made['allowed slew T / F'] == 40.0
    assert made == similarity.made_for(load_controller('allround')).numbers
    own = load_controller('allround')
    paper = load('paper_test')
    assert similarity.units_of(paper).time_s == paper.requirements.hold_from_s < paper.duration_s
    provenance = {'scaled': {'trained_for': 'paper_training', 'length': 2, 'time': 4, 'mass': 8}}
    scaled = own.scaled(Scaling(2.0, 4.0, 1.0, training.base))
    found = similarity.made_for(replace(scaled, provenance=provenance))
    assert found.own == Units(200.0, 800.0, 80.0) and found.numbers == made


@pytest.mark.parametrize('ticks', [0, 1, 3])
def test_a_delay_counts_as_ticks_of_the_loop(ticks):
    """A command acts for the tick after the state that it answers, and as many later."""
    late = load_scenario('paper_test').equipped(Thrusters(delay_ticks=ticks))
    made = similarity.numbers(late, PAPER, 0.5)
    assert made.pop('tick and delay / T') == pytest.approx((0.1 + 0.1 * ticks) / 200.0)
    prompt = similarity.numbers(load_scenario('paper_test'), PAPER, 0.5)
    assert made == {name: prompt[name] for name in made}, 'and as nothing else'


def test_a_kind_that_does_not_say_how_it_scales_is_refused():
    drift, scenario = load_controller('drift'), load_scenario('paper_test')
    assert isinstance(drift, ControllerFile)
    with pytest.raises(InputError, match='controller drift cannot be scaled: its kind `drift` has'):
        drift.scaled(Scaling(1.0, 1.0, 1.0, scenario))
    assert similarity.hint(fly(scenario, drift), drift, 'x') == ''


def test_what_starts_at_its_goal_has_no_length_to_scale_by():
    paper = load_scenario('paper_test')
    here = replace(paper, goal_position_m=paper.initial_position_m)
    with pytest.raises(InputError, match='scenario paper_test starts at its goal'):
        similarity.units_of(here)


def test_no_scaled_baseline_commands_more_than_the_vehicle_has():
    scenario = replace(load_scenario('paper_test'), max_force_n=0.2)
    assert load_controller('more_words').scaled(Scaling(1.0, 1.0, 1.0, scenario)).max_force_n == 0.2


@pytest.mark.parametrize(
    ('changes', 'said'),
    [
        ({'mass_kg': 500.0}, 'where authority F T²/(m L) is 20; here it is 0.4. `x` scales it.'),
        ({'initial_position_m': (0.0, 160.0, 0.0)}, 'where start / L is 1; here it is 1.6.'),
        ({}, ''),
    ],
)
def test_a_missed_flight_of_another_vehicle_has_a_hint(changes, said):
    scenario = replace(load_scenario('paper_test'), **changes)
    controller = load_controller('allround')
    line = similarity.hint(fly(scenario, controller), controller, 'x')
    assert said in line and bool(said) == bool(line)


def test_a_controller_that_holds_at_a_port_is_told_of_guidance():
    docking = load_scenario('docking')
    controller = load_controller('allround')
    required = replace(docking.requirements, contact_least_closing_speed_m_s=0.09)
    start = {'initial_position_m': (0.0, 60.0, 0.0), 'sections': (), 'requirements': required}
    line = similarity.hint(fly(replace(docking, **start), controller), controller, 'x')
    assert 'Contact needs a guidance leg' in line and '`arrive_m_s`' in line
    assert similarity.hint(fly(docking, controller), controller, 'x') == ''
