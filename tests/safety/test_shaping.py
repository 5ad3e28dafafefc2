# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The section `shaping`: slew limit and dead zone, in flights and before runtime assurance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import yaml
from hypothesis import given
from hypothesis import strategies as st

from rpo_core.chain.flight import fly
from rpo_core.control.controller import load_controller
from rpo_core.files import scenario
from rpo_core.judge.metrics import LATE_POSITION, SLEW, row_of
from rpo_nav.estimator import Estimator
from rpo_nav.navigation_errors import Navigation
from rpo_safety.assurance import ASSURED_FORCE
from rpo_safety.learning import AXIS, LIMIT
from rpo_safety.settings import Assurance
from rpo_safety.shaping import (
    SHAPED_FORCE,
    HoldLimit,
    Shaping,
    ShapingStage,
    followed,
    largest_ahead,
)

PAPER = scenario.load_scenario('paper_test')
LEARNING = scenario.load_scenario('paper_test_held')
FOLLOWED = replace(
    LEARNING.section(Shaping), hold_share=0.975, hold_within_m=0.35, hold_learns=False
)
HELD = LEARNING.equipped(replace(FOLLOWED, hold_from_s=190.0))
NOISY = PAPER.equipped(Navigation(position_noise_m=0.01, velocity_noise_m_s=5e-4))
forces = st.floats(-1.0, 1.0)


@given(st.lists(st.tuples(forces, forces, forces), min_size=1, max_size=30), st.floats(0.01, 5.0))
def test_a_command_changes_by_the_limit_at_most_and_goes_where_it_was_wanted(commands, slew_n_s):
    stage = ShapingStage(Shaping(slew_n_s, dead_zone_n=0.05), PAPER)
    wanted = np.clip(commands, -0.5, 0.5)
    wanted[np.abs(wanted) <= 0.05] = 0.0
    found = np.array([stage.step(tick, command)[0] for tick, command in enumerate(commands)])
    np.testing.assert_array_equal(found[0], wanted[0])
    step = 0.1 * slew_n_s
    np.testing.assert_allclose(
        found[1:], np.clip(wanted[1:], found[:-1] - step, found[:-1] + step), rtol=0, atol=1e-15
    )
    stage.reset()
    assert stage.step(0, commands[-1])[0] == tuple(wanted[-1].tolist())


def test_it_keeps_the_slew_of_the_paper_under_noise():
    """White noise of navigation alone breaks the limit; the flight arrives all the same."""
    controller = load_controller('allround')
    raw = row_of(fly(NOISY, controller))
    shaped = row_of(fly(NOISY.equipped(Shaping(0.09)), controller))
    assert raw[SLEW] > 0.15
    assert shaped[SLEW] <= 0.0900000001
    assert shaped[LATE_POSITION] < 0.5


def test_assurance_has_the_last_word():
    """What is shaped reaches assurance; its zone is kept though the command cannot turn fast."""
    zone = PAPER.equipped(Shaping(0.02)).equipped(Assurance(keep_out_m=10.0))
    flight = fly(zone, load_controller('trained'))
    shaped, sent = flight.signals[SHAPED_FORCE], flight.signals[ASSURED_FORCE]
    assert np.abs(np.diff(shaped, axis=0)).max() <= 0.002 + 1e-15
    assert (shaped != sent).any(), 'assurance never acted'
    assert np.linalg.norm(flight.positions_m, axis=1).min() >= 10.0


def test_a_limit_that_never_binds_changes_no_bit():
    controller = load_controller('trained')
    plain, shaped = fly(PAPER, controller), fly(PAPER.equipped(Shaping(100.0)), controller)
    np.testing.assert_array_equal(plain.states, shaped.states)


def test_a_file_is_read_back_the_same():
    again = scenario.parse(yaml.safe_load(scenario.dumps(PAPER.equipped(Shaping(0.1, 0.002)))))
    assert again.section(Shaping) == Shaping(0.1, 0.002)


def test_the_fit_is_that_of_least_squares():
    """Values weighed by their sigma, rate and curve by those of a disturbance that changes."""
    gains = HoldLimit.of(HELD.section(Shaping), HELD).gains
    rate, seconds = np.pi * HELD.mean_motion_rad_s, np.arange(60.0)
    values = 0.02 * np.cos(1.3 * rate * seconds + 1.0) + 1e-4 * np.sin(9.0 * seconds)
    fit = (0.0, 0.0, 0.0)
    for number, value in enumerate(values):
        fit = followed(value, fit, number == 0, tuple(gains[number]), 1.0)
    times = seconds[:, None] - 59.0
    rows = np.hstack([times**0, times, times**2 / 2]) / 0.015
    start = np.array([[0.0, 1.0, -59.0], [0.0, 0.0, 1.0]]) / [[rate], [rate**2]]
    sums = np.vstack([rows, start]), np.append(values / 0.015, [0.0, 0.0])
    expected = np.linalg.lstsq(*sums, rcond=None)[0]
    np.testing.assert_allclose(fit, expected, rtol=1e-6, atol=1e-12)


@given(st.tuples(forces, forces, forces), st.floats(0.0, 10.0))
def test_the_largest_ahead_is_that_of_all_moments(fit, span_s):
    times = np.linspace(0.0, span_s, 2001)
    values = np.abs(fit[0] + fit[1] * times + 0.5 * fit[2] * times**2)
    found = largest_ahead(fit, span_s)
    assert values.max() <= found * (1.0 + 1e-12)
    assert found <= values.max() + (span_s / 4000.0) ** 2


def test_in_the_hold_the_force_stays_below_the_disturbance():
    """Thrusters that are 2 % too weak need more than the largest disturbance, at the end."""
    harmonic = {'axis': 'y', 'function': 'sin', 'amplitude_n': 0.02, 'angular_rate_rad_s': 0.004}
    changed = {
        'disturbance': {'constant_n': [0.0, 0.0, 0.0], 'harmonics': [harmonic]},
        'initial_position_m': [0.0, 5.0, 0.0],
        'thrusters': {'matrix': np.diag([0.98] * 3).tolist()},
    }
    base = scenario.parse(yaml.safe_load(scenario.dumps(HELD)) | changed)
    controller, hold = load_controller('allround'), slice(2000, None)
    largest = {}
    for share in (0.0, 0.96):
        flown = base.equipped(replace(HELD.section(Shaping), hold_share=share))
        flight = fly(flown, controller)
        largest[share] = np.abs(flight.signals[SHAPED_FORCE][hold]).max()
        assert np.abs(flight.positions_m[hold]).max() < 0.5
    assert largest[0.0] > 0.02 > largest[0.96] > 0.019
    # farther away than it may be, the limit opens
    far = replace(HELD.section(Shaping), hold_share=0.5, hold_within_m=0.1)
    flight = fly(base.equipped(far), controller)
    assert 0.1 < np.abs(flight.positions_m[hold]).max() < 0.2


WEAK = {'matrix': np.diag([0.99, 0.985, 1.02]).tolist(), 'delay_ticks': 2}
PEAK = {'axis': 'y', 'function': 'cos', 'amplitude_n': 0.02, 'angular_rate_rad_s': 0.0036}


def peaked():
    """Return a flight of a chaser whose mass and thrust are others than it knows.

    The disturbance of y is largest at 280 s.
    """
    harmonics = [{**PEAK, 'phase_rad': -280.0 * PEAK['angular_rate_rad_s']}]
    changed = {
        'disturbance': {'constant_n': [0.002, 0.005, -0.004], 'harmonics': harmonics},
        'thrusters': WEAK,
        'mass_kg': 9.8,
    }
    known = replace(LEARNING.section(Estimator), mass_kg=10.0)
    return scenario.parse(yaml.safe_load(scenario.dumps(LEARNING.equipped(known))) | changed)


def test_it_learns_thrust_over_mass_and_the_disturbance():
    flight = fly(peaked(), load_controller('allround'))
    stage = ShapingStage(flight.scenario.section(Shaping), flight.scenario)
    signals, made = flight.signals, []
    for tick in range(1801):
        inputs = (flight.forces_n, signals['navigation_state'], signals['measurement'])
        made.append(stage.step(tick, *(tuple(rows[tick]) for rows in inputs))[0])
    np.testing.assert_array_equal(made, signals[SHAPED_FORCE][:1801])
    memory = np.asarray(stage._learnt[0])
    errors = [memory[AXIS * axis + 4] for axis in range(3)]
    np.testing.assert_allclose(errors, np.diag(WEAK['matrix']) / 0.98 - 1.0, atol=0.003)
    pulls = [memory[AXIS * axis + 1] for axis in range(3)]
    np.testing.assert_allclose(pulls, flight.disturbances_n[1795] / 0.98, atol=2e-4)
    # the mass: a share of the sum of the errors
    assert 0.95 < memory[LIMIT] / (0.98 * 0.025) < 1.02


def test_it_drifts_through_the_peak_with_less_force_than_the_disturbance():
    """It was on one side of the target before; without what is learnt the force exceeds it."""
    base, controller, hold = peaked(), load_controller('allround'), slice(2000, None)
    learnt = fly(base, controller)
    followed = fly(base.equipped(HELD.section(Shaping)), controller)
    most = [np.abs(flight.signals[SHAPED_FORCE][hold]).max() for flight in (learnt, followed)]
    assert most[0] < np.abs(learnt.disturbances_n).max() < most[1]
    y = learnt.positions_m[hold, 1]
    assert y.min() < 0.0 < 0.1 < y.max() and np.abs(learnt.positions_m[hold]).max() < 0.45
    assert np.abs(learnt.states[hold, 3:]).max() < 0.01
