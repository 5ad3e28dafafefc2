# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Hostile commands in the runs of a campaign, all stages flown."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from invoking import invoke
from scipy.spatial.transform import Rotation

from rpo.analysis.attack import NOT_FINITE, wanted
from rpo.analysis.attack_campaign import (
    BEFORE,
    CLOSING,
    KINDS,
    LATERAL,
    USED,
    _watched,
    attack_campaign,
    bounded,
    command,
    watch,
)
from rpo.engine.lanes import FORCE, KNOWN_R, KNOWN_V, RUNS, STRIDE, R, V, make_scratch
from rpo.engine.tick import table_of
from rpo.montecarlo import config
from rpo.montecarlo.run_batch import scenario_of
from rpo_core.assurance.settings import Assurance
from rpo_core.chain.flight import fly
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


def test_each_run_has_the_hostile_commands_of_its_kind():
    """Those of `wanted`, from what it knows and from its command of the tick before."""
    random, w, m = np.random.default_rng(2), make_scratch(), np.zeros(3 * RUNS)
    kinds, words = np.arange(RUNS) % len(KINDS) - 1, random.integers(0, 2**31, (2, RUNS))
    t = table_of(0.5, *(2 + np.arange(RUNS) % 3), *kinds, *words.ravel())
    held = np.zeros((RUNS, 3))
    for tick in range(9):
        for row in (KNOWN_R, KNOWN_V, FORCE):
            w[row : row + 3 * RUNS] = random.normal(size=3 * RUNS)
        rows = [w[row : row + 3 * RUNS].reshape(3, RUNS).T.copy() for row in (KNOWN_R, KNOWN_V)]
        expected = w[FORCE : FORCE + 3 * RUNS].reshape(3, RUNS).T.copy()
        command(w, m, t, tick)
        for s in range(RUNS):
            since, state = tick - 2 - s % 3, (*rows[0][s], *rows[1][s])
            if kinds[s] >= 0 and since >= 0:
                own = (int(words[0, s]), int(words[1, s]))
                expected[s] = wanted(int(kinds[s]), since, *own, state, tuple(held[s]), 0.5)
                odd = kinds[s] == NOT_FINITE
                held[s] = (0.25, -0.5, 0.5) if odd else expected[s]
        np.testing.assert_array_equal(w[FORCE : FORCE + 3 * RUNS].reshape(3, RUNS).T, expected)


def watched(states):
    """Return the memory of `watch` after states (n, 6) of one run, corridor along +y."""
    w, m = make_scratch(), np.zeros(USED)
    m[CLOSING:BEFORE] = np.inf
    t = table_of(0.1, 0.0, 0, 0, 0, R, V, 10.0, 1.0, 1.0, 1.0, 0.4, 0.1)
    for state in states:
        for axis in range(3):
            w[R + axis * RUNS], w[V + axis * RUNS] = state[axis], state[3 + axis]
        watch(w, m, t, 0)
    return m[0], m[CLOSING], m[LATERAL], m[BEFORE]


def test_what_is_outside_the_corridor_is_in_the_zone():
    assert STRIDE > RUNS
    rest = (0.0, 0.0, 0.0)
    assert watched([(0.0, 12.0, 0.0, *rest)])[0] == 0.0
    assert watched([(0.0, 6.0, 0.8, *rest)])[0] == 0.0  # 0.9 m wide there
    assert watched([(0.0, 6.0, 1.1, *rest)])[0] == pytest.approx(0.2)
    assert watched([(0.0, -9.0, 0.0, *rest)])[0] == pytest.approx(1.0)  # from the other side
    assert watched([(9.99, 0.0, 0.0, *rest)])[0] == pytest.approx(0.01)


@pytest.mark.parametrize('along', ['+y', '-y', '+x', '-z'])
def test_the_corridor_of_assurance_is_watched_on_its_own_side(along):
    """Six metres from the target the zone begins, of 10 m, but in the corridor."""
    docking = load_scenario('docking')
    settings = docking.section(Assurance)
    settings = replace(settings, corridor=replace(settings.corridor, along=along))
    axis, sign = 'xyz'.index(along[1]), 1.0 if along[0] == '+' else -1.0
    for place, depth in ((6.0 * sign, 0.0), (-6.0 * sign, 4.0)):
        part = _watched(docking.equipped(settings), np.array([1.0, 3.0]))
        w, m = make_scratch(), part.memory.copy()
        w[R + axis * RUNS : R + (axis + 1) * RUNS] = place
        watch(w, m, part.table, 0)
        np.testing.assert_allclose(m[:RUNS], depth)
    assert part.table[-RUNS:].tolist() == [1.0, 3.0, *[0.0] * (RUNS - 2)]


def test_contact_is_where_the_port_is_passed():
    moving = (0.01, -0.3, 0.02)
    depth, closing, lateral, _ = watched([(0.1, y, 0.0, *moving) for y in (1.02, 0.99, -5.0)])
    assert (depth, closing, lateral) == (0.0, 0.3, 0.02)
    assert watched([(0.5, y, 0.0, *moving) for y in (1.02, 0.99)])[1] == np.inf  # beside it


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
