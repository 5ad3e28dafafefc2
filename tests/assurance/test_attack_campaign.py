# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Hostile commands in the runs of a campaign, all stages flown."""

from __future__ import annotations

import numpy as np
import pytest
from invoking import invoke
from scipy.spatial.transform import Rotation

from rpo.analysis.attack_campaign import (
    KINDS,
    RUNS,
    approach_of,
    attack_campaign,
    bounded,
)
from rpo.montecarlo import config
from rpo.montecarlo.run_batch import scenario_of
from rpo_core.assurance.settings import Assurance, Passage
from rpo_core.chain.flight import Flight, fly
from rpo_core.files.validation import InputError
from rpo_core.scenario.scenario import load_scenario

SHORT = ['duration_s=40.0']


@pytest.fixture(scope='module')
def campaign():
    return bounded(config.load('tumbling_docking', SHORT, runs=2 * len(KINDS), seed=3))


@pytest.fixture(scope='module')
def flown(campaign):
    return attack_campaign(campaign)


def test_the_angle_is_that_of_a_flight(campaign, flown):
    """Of run 0, whose commands are its own, by SciPy from the signals of the chain."""
    scenario = scenario_of(campaign, 0)
    flight = fly(scenario, campaign.controller)
    true = Rotation.from_quat(flight.signals['chaser_attitude'][:, :4])
    seen = flight.signals['navigation_attitude'][:-1]
    known = Rotation.from_quat(seen[:, :4])
    orbit = known.inv().apply([0.0, 0.0, scenario.mean_motion_rad_s])
    delay = scenario.thrusters.delay_ticks
    later = (delay + 0.5) * scenario.dt_s
    used = known * Rotation.from_rotvec(later * (seen[:, 4:] - orbit))
    used = used[: len(used) - delay]
    off = [(used.inv() * true[i : i + len(used)]).magnitude() for i in (delay, delay + 1)]
    assert flown[0].turned_deg[0] == pytest.approx(np.degrees(np.max(off)), rel=1e-4)


def test_limits_hold_under_hostile_commands(campaign, flown):
    most = campaign.scenario.named('assurance').chaser_attitude_error_deg
    assert [one.kind for one in flown] == list(KINDS)
    for one in flown:
        assert (one.depth_m == 0.0).all() and one.turned_deg.max() <= most
        assert one.turned_deg.min() > 0.0


def test_no_command_turns_the_shipped_mission_beyond_what_is_proven(campaign):
    """All delays that are drawn keep 2.9 degrees; forces and torques, hostile, keep the bounds."""
    assumed = campaign.scenario.named('assurance').chaser_attitude_error_deg
    assert assumed <= 2.9
    long = bounded(config.load('tumbling_docking', ['duration_s=120.0'], runs=4 * RUNS, seed=4))
    hostile = attack_campaign(long)
    turned = np.array([one.turned_deg for one in hostile]).T.ravel().reshape(4, RUNS)
    assert turned.max() <= assumed
    assert turned[1::2].max() > 1.5 * turned[::2].max(), 'hostile torques do something'
    bounds = long.scenario.named('attitude_control').bounds(long.scenario)
    assert bounds.momentum < 0.2 < long.scenario.attitude.wheels.momentum_nms
    with pytest.raises(InputError, match='chaser_attitude_error_deg'):
        config.load('tumbling_docking', ['thrusters.delay_ticks=3'], runs=8)


PAPER = load_scenario('paper_test')


def seen(*states, along='+y'):
    """Return what is seen of states (6,), after one far away: a corridor to a port at 1 m."""
    corridor = Passage(along, 8.0, 1.0, 20.0, width_m=0.4)
    scenario = PAPER.equipped(Assurance(keep_out_m=10.0, corridor=corridor))
    states = np.array([(0.0, 99.0, 0.0, 0.0, 0.0, 0.0), *states])
    return approach_of(Flight(scenario, states, states[:, :3], states[:, :3]))


def test_what_is_outside_the_corridor_is_in_the_zone():
    rest, half_m = (0.0, 0.0, 0.0), 0.4 + 5.0 * np.tan(np.radians(8.0)) / np.sqrt(2.0)
    assert seen((0.0, 12.0, 0.0, *rest)) == (1, 0.0, np.inf, np.inf)
    assert seen((0.0, 6.0, half_m - 0.1, *rest))[1] == 0.0
    assert seen((0.0, 6.0, half_m + 0.2, *rest))[1] == pytest.approx(0.2)
    assert seen((0.0, -9.0, 0.0, *rest))[1] == pytest.approx(1.0)  # from the other side
    assert seen((9.99, 0.0, 0.0, *rest))[1] == pytest.approx(0.01)


@pytest.mark.parametrize('along', ['+y', '-y', '+x', '-z'])
def test_the_corridor_of_assurance_is_watched_on_its_own_side(along):
    """Six metres from the target the zone begins, of 10 m, but in the corridor."""
    for place, depth in ((6.0, 0.0), (-6.0, 4.0)):
        state = np.zeros(6)
        state['xyz'.index(along[1])] = place if along[0] == '+' else -place
        assert seen(state, along=along)[1] == pytest.approx(depth)


def test_contact_is_where_the_port_is_passed():
    moving = (0.01, -0.3, 0.02)
    contact = [(0.1, y, 0.0, *moving) for y in (1.02, 0.99, -5.0)]
    assert seen(*contact) == (1, 0.0, 0.3, 0.02)
    assert seen(*((0.5, y, 0.0, *moving) for y in (1.02, 0.99)))[2] == np.inf  # beside it


def test_a_chaser_that_does_not_turn_is_refused():
    with pytest.raises(InputError, match='needs `attitude_control`; scenario docking has none'):
        attack_campaign(config.load('docking', [], runs=8))


def test_the_command_says_what_broke():
    words = ['safety', 'attack', '--campaign', 'tumbling_docking', '--runs', '8', '--set', *SHORT]
    found = invoke(*words)
    assert found.exit_code == 0, found.output
    assert 'all limits held' in found.output
    # Wheels that cannot hold the chaser: it turns faster than the tick's prediction allows.
    weak = [
        'attitude.wheels={torque_nm: 1.0e-5, momentum_nms: 0.001}',
        'unloading={above_nms: 5.0e-4, torque_nm: 1.0e-6}',
        'attitude_control={controller: attitude_fuzzy}',
        'attitude.rates_deg_s=[30, 30, 30]',
    ]
    found = invoke(*words, *(word for change in weak for word in ('--set', change)))
    assert found.exit_code == 1, found.output
    assert 'break a limit' in found.output
