# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Thrusters that fire in pulses, waste propellant and fail: impulse, allocation, mass."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from rpo_core.chain.flight import OpenLoop, fly
from rpo_core.files.validation import InputError
from rpo_core.scenario import scenario
from rpo_core.thrusters.thrusters import (
    STANDARD_GRAVITY_M_S2,
    Failure,
    Propellant,
    Pulses,
    ThrusterError,
    Thrusters,
    ThrustersStage,
    stage_of,
    valve_names,
)
from rpo_core.wire.interfaces import CHASER_MASS, EXERTED_FORCE
from rpo_core.world.dynamics import Dynamics

BASE = scenario.load_scenario('approach')  # 10 kg, 0.5 N, ticks of 0.1 s
BIT_N_S = 0.5 * 0.01


def pulses(**changes):
    """Return pulses of at least 10 ms, a whole number of milliseconds."""
    usual = {
        'count': 6,
        'modulation': 'sigma_delta',
        'minimum_on_time_s': 0.01,
        'on_time_quantum_s': 0.001,
    }
    return Pulses(**{**usual, **changes})


def exerted(commands, settings=None, base=BASE, **changes):
    """Return the forces (n, 3) that answer commands (n, 3)."""
    flown = base.equipped(settings or Thrusters(pulses=pulses(**changes)))
    stage = stage_of(flown.thrusters, flown)
    return np.array([stage.step(k, tuple(c))[2] for k, c in enumerate(np.array(commands).tolist())])


def test_sigma_delta_conserves_the_impulse_to_the_impulse_bit():
    rng = np.random.default_rng(3)
    commands = np.cumsum(rng.normal(0.0, 0.01, (3000, 3)), axis=0).clip(-0.45, 0.45)
    given = exerted(commands)
    owed = np.cumsum(commands - given, axis=0) * BASE.dt_s
    assert np.abs(owed).max() <= BIT_N_S + 1e-12
    assert np.abs(owed).max() > 0.5 * BIT_N_S
    on_s = np.abs(given) * BASE.dt_s / 0.5
    fired = on_s[on_s > 0.0]
    assert fired.min() >= 0.01 - 1e-12  # no pulse is shorter
    np.testing.assert_allclose(fired / 0.001, np.round(fired / 0.001), atol=1e-9)


def test_one_of_two_valves_fires_alone_where_the_impulse_is_small():
    commands = np.tile([0.0, 0.0, 0.03], (100, 1))
    given = exerted(commands, count=12)[:, 2]
    owed = np.cumsum(0.03 - given) * BASE.dt_s
    assert np.abs(owed).max() <= 0.5 * BIT_N_S + 1e-12
    np.testing.assert_allclose(given, 0.03, rtol=1e-12)  # 12 ms of one; of both 6 ms were too short
    assert not exerted(commands, modulation='pulse_width').any()


def test_pulse_width_loses_what_is_below_the_impulse_bit():
    wanted = np.array([0.047, 0.05, 0.1234, 0.4999, 0.7])
    commands = np.zeros((5, 3))
    commands[:, 1] = -wanted
    given = -exerted(commands, modulation='pulse_width')[:, 1]
    np.testing.assert_allclose(given, [0.0, 0.05, 0.125, 0.5, 0.5], rtol=0, atol=1e-12)
    exact = -exerted(commands, modulation='pulse_width', on_time_quantum_s=0.0)[:, 1]
    np.testing.assert_allclose(exact, [0.0, 0.05, 0.1234, 0.4999, 0.5], rtol=1e-14)


@pytest.mark.parametrize('count', [6, 12])
def test_each_axis_has_thrust_to_both_sides(count):
    commands = [[0.3, -0.2, 0.1], [-0.3, 0.2, -0.1]]
    given = exerted(commands, count=count, on_time_quantum_s=0.0)
    np.testing.assert_allclose(given, commands, rtol=1e-14)
    assert len(valve_names(count)) == count == len(set(valve_names(count)))


def test_a_stuck_valve_takes_half_of_twelve_and_all_of_six():
    commands = np.tile([0.4, 0.0, 0.0], (10, 1))
    off = Failure(thruster='x+a', stuck='off', from_s=0.5)
    given = exerted(
        commands, count=12, failures=(off,), modulation='pulse_width', on_time_quantum_s=0.0
    )
    np.testing.assert_allclose(given[:, 0], [0.4] * 5 + [0.2] * 5, rtol=1e-14)
    six = replace(off, thruster='x+')
    np.testing.assert_allclose(exerted(commands, failures=(six,))[:, 0], [0.4] * 5 + [0.0] * 5)
    # the other side is whole
    np.testing.assert_allclose(exerted(-commands, failures=(six,))[:, 0], -0.4)


def test_the_allocation_makes_up_for_a_failure_it_knows():
    small, large = np.tile([0.2, 0.0, 0.0], (10, 1)), np.tile([0.4, 0.0, 0.0], (10, 1))
    known = {'count': 12, 'modulation': 'pulse_width', 'on_time_quantum_s': 0.0}
    off = Failure(thruster='x+a', stuck='off', known=True)
    np.testing.assert_allclose(exerted(small, **known, failures=(off,)), small, rtol=1e-14)
    np.testing.assert_allclose(exerted(large, **known, failures=(off,))[:, 0], 0.25, rtol=1e-14)
    on = Failure(thruster='x+a', stuck='on', from_s=0.3, until_s=0.6, known=True)
    known['minimum_on_time_s'] = 0.0
    for wanted in (small, large, -small, 0.0 * small):
        np.testing.assert_allclose(exerted(wanted, **known, failures=(on,)), wanted, atol=1e-15)


def test_a_valve_stuck_on_pushes_for_its_time_only():
    on = Failure(thruster='z-', stuck='on', from_s=0.3, until_s=0.6)
    given = exerted(np.zeros((10, 3)), failures=(on,))
    np.testing.assert_allclose(given[:, 2], [0.0] * 3 + [-0.5] * 3 + [0.0] * 4)
    assert not given[:, :2].any()


def test_dead_and_rise_time_cost_impulse_at_the_start_of_a_pulse_only():
    late = {'modulation': 'pulse_width', 'dead_time_s': 0.004, 'rise_time_s': 0.02}
    commands = np.zeros((7, 3))
    # 10, 50, 100, 100, 50 ms, and nothing of a pulse that ends within the dead time
    commands[:, 0] = [0.05, 0.25, 0.5, 0.5, 0.25, 0.0, 0.015]
    late |= {'minimum_on_time_s': 0.0, 'on_time_quantum_s': 0.0}
    given = exerted(commands, **late)[:, 0] * BASE.dt_s / 0.5
    full = 0.05 - 0.004 - 0.01
    expected = [0.006**2 / 0.04, full, full + 0.05, 0.1, 0.05, 0.0, 0.0]  # the fifth goes on
    np.testing.assert_allclose(given, expected, rtol=1e-12)


def test_the_force_of_a_valve_has_its_own_errors():
    error = ThrusterError(thruster='y-', magnitude_share=-0.1, misalignment_deg=(0.0, 0.0, 90.0))
    commands = [[0.0, -0.5, 0.0], [0.0, 0.5, 0.0]]
    given = exerted(commands, errors=(error,))
    np.testing.assert_allclose(given, [[0.45, 0.0, 0.0], [0.0, 0.5, 0.0]], atol=1e-15)
    doubled = ((2.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    turned = Thrusters(doubled, pulses=pulses(errors=(error,)))
    np.testing.assert_allclose(exerted(commands, turned)[0], [0.9, 0.0, 0.0], atol=1e-15)


@pytest.mark.parametrize('fires', [True, False])
def test_the_mass_falls_and_the_speed_grows_by_the_rocket_equation(fires):
    """Far from any body: v = w ln(m0 / m)."""
    settings = Thrusters(
        pulses=pulses() if fires else None,
        propellant=Propellant(specific_impulse_s=2.0, mass_kg=9.0),
    )
    still = {'initial_position_m': (0.0, 0.0, 0.0), 'orbit_radius_m': 1e9, 'duration_s': 300.0}
    flown = replace(BASE, **still).equipped(settings)
    push = np.tile([0.4, 0.0, 0.0], (flown.ticks + 1, 1))
    for dynamics in ((), (Dynamics(kind='two_body'),)):
        flight = fly(flown.equipped(*dynamics), OpenLoop(push))
        exhaust = 2.0 * STANDARD_GRAVITY_M_S2
        last = 10.0 - 0.4 * 300.0 / exhaust
        expected = exhaust * math.log(10.0 / last)
        assert flight.states[-1, 3] == pytest.approx(expected, rel=1e-6)
        assert flight.thrust.delta_v_m_s == pytest.approx(expected, rel=1e-6)
        assert flight.thrust.propellant_kg == pytest.approx(10.0 - last, rel=1e-12)
        assert flight.signals[CHASER_MASS][0, 0] < 10.0
        np.testing.assert_array_equal(flight.thrust.masses_kg, flight.signals[CHASER_MASS][:-1, 0])


def test_an_empty_tank_gives_no_thrust():
    tank = Propellant(specific_impulse_s=1.0, mass_kg=0.25)
    settings = Thrusters(pulses=pulses(), propellant=tank)
    flown = replace(BASE, duration_s=20.0).equipped(settings)
    flight = fly(flown, OpenLoop(np.tile([0.5, 0.0, 0.0], (flown.ticks + 1, 1))))
    given = flight.signals[EXERTED_FORCE]
    impulse = 0.25 * STANDARD_GRAVITY_M_S2
    assert given[:-1].sum() * 0.1 == pytest.approx(impulse, rel=1e-12)
    assert given[:49, 0].min() == pytest.approx(0.5) and not given[60:].any()
    assert flight.thrust.propellant_kg == 0.25


def test_short_pulses_waste_propellant():
    """A valve uses propellant while it is open, thrust or not."""
    late = pulses(dead_time_s=0.008, on_time_quantum_s=0.0)
    tank = Propellant(specific_impulse_s=200.0, mass_kg=1.0)
    flown = BASE.equipped(Thrusters(pulses=late, propellant=tank))
    flight = fly(flown, OpenLoop(np.tile([0.05, 0.0, 0.0], (flown.ticks + 1, 1))))
    impulse = flight.thrust.forces_n.sum() * BASE.dt_s
    wasted = flight.thrust.propellant_kg * 200.0 * STANDARD_GRAVITY_M_S2 / impulse
    assert wasted == pytest.approx(5.0, rel=1e-3)  # 10 ms open, 2 ms thrust
    assert flight.thrust.openings == pytest.approx(flown.ticks, abs=1)


def test_a_reset_stage_has_forgotten():
    flown = BASE.equipped(Thrusters(delay_ticks=1, pulses=pulses()))
    stage = stage_of(flown.thrusters, flown)
    assert isinstance(stage, ThrustersStage) and stage.memory_ticks is None
    assert 'needs a scenario with `thrusters.table`' in stage.refusal('x+ off')
    commands = [(0.013, -0.3, 0.2)] * 20
    first = [stage.step(k, c) for k, c in enumerate(commands)]
    assert first[0][2] == (0.0, 0.0, 0.0)  # the delay
    stage.reset()
    assert [stage.step(k, c) for k, c in enumerate(commands)] == first


def test_pulses_may_fill_a_tick_and_no_more():
    """Ticks last 0.1 s."""
    for times in (
        {'minimum_on_time_s': 0.1},
        {'on_time_quantum_s': 0.1},
        {'dead_time_s': 0.025, 'rise_time_s': 0.075},
    ):
        assert BASE.equipped(Thrusters(pulses=pulses(**times))).thrusters.fires
        for name in times:
            with pytest.raises(InputError, match='at most `dt_s`'):
                BASE.equipped(Thrusters(pulses=pulses(**{**times, name: times[name] + 1e-6})))
