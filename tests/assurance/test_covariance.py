# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Assurance behind an estimator: a growing covariance shrinks the set, and the table sees it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rpo_core.assurance.abort_table import AbortTable, Row
from rpo_core.assurance.assumed import ahead
from rpo_core.assurance.assurance import AssuranceStage
from rpo_core.assurance.doubt import Doubt, doubt_of, doubted, unless_unsure
from rpo_core.assurance.filters import margins
from rpo_core.assurance.guard import guard_of, proof_of
from rpo_core.assurance.kernels import APPROACH, OPEN, backup_open
from rpo_core.assurance.manoeuvre import RETREAT_M_S
from rpo_core.assurance.settings import Assurance, Passage
from rpo_core.attitude.attitude_kernels import LVLH
from rpo_core.chain.chain import Chain
from rpo_core.control.controller import load_controller
from rpo_core.navigation.sensors import Sensors
from rpo_core.scenario import scenario
from rpo_core.scenario.requirements import DIRECTIONS
from rpo_core.stage import Place
from rpo_core.thrusters.thrusters import Thrusters
from rpo_core.wire.interfaces import CHASER_ATTITUDE, RELATIVE_STATE
from rpo_core.world.cw import cw_step

WORLD = scenario.load_scenario('world_leo')
SETTINGS = Assurance(
    keep_out_m=15.0,
    position_error_m=0.5,
    velocity_error_m_s=0.02,
    disturbance_n=0.02,
    thrust_error=0.1,
    sigmas=4.0,
)
ASSURED = WORLD.equipped(SETTINGS)
STATE = (0.0, 22.0, 0.0, 0.0, -0.25, 0.0)


def blind(outages, settings=SETTINGS):
    """Return the world with a lidar that is silent for some times."""
    sensors = WORLD.section(Sensors)
    units = tuple(replace(unit, outages_s=outages) for unit in sensors.units)
    return WORLD.equipped(replace(sensors, units=units), settings)


def fly(chosen, ticks=4000):
    """Fly `pd`, which wants the target; return the stage and the true ranges."""
    chain = Chain.of(chosen, load_controller('pd'))
    stage = next(link.stage for link in chain.links if link.place is Place.ASSURANCE)
    signals, ranges, acted = {RELATIVE_STATE: chosen.start}, [], []
    for tick in range(ticks):
        ranges.append(float(np.linalg.norm(signals[RELATIVE_STATE][:3])))
        chain.step(tick, signals)
        acted.append(stage.decision.constraint)
    return stage, np.array(ranges), acted


def covariance(sigma_m, sigma_m_s):
    """Return covariances (18,) whose traces have these roots."""
    three = np.eye(3).ravel() / 3.0
    return (*(sigma_m**2 * three).tolist(), *(sigma_m_s**2 * three).tolist())


def test_a_worse_estimate_never_has_more_room():
    stage, room = AssuranceStage(SETTINGS, ASSURED), []
    for sigma in (0.12, 0.13, 0.15, 0.18):
        stage.step(0, STATE, (0.0, 0.0, 0.0), covariance(sigma, sigma / 20.0))
        g = stage.guard
        room.append(margins(STATE, OPEN, g.next_m, g.next_m_s, g))
    assert room == sorted(room, reverse=True)
    assert len(set(room)) == 4


@given(st.floats(0.0, 2.0), st.floats(0.0, 0.2), st.integers(0, 4))
def test_the_errors_are_those_of_a_section_that_assumes_the_spread(sigma_m, sigma_m_s, delay):
    delayed = ASSURED.equipped(Thrusters(delay_ticks=delay))
    guard, errors, _, _ = proof_of(SETTINGS, delayed)
    found = doubted(guard, doubt_of(SETTINGS, delayed, errors), 0.0, sigma_m, sigma_m_s)
    worse = errors._replace(
        position_m=max(0.5, 4.0 * sigma_m), velocity_m_s=max(0.02, 4.0 * sigma_m_s)
    )
    expected = (*ahead(worse, delayed, delay), *ahead(worse, delayed, delay + 1))
    seen = (found.here_m, found.here_m_s, found.next_m, found.next_m_s)
    assert seen == pytest.approx(expected, rel=1e-12)
    assert found._replace(here_m=0.0, here_m_s=0.0, next_m=0.0, next_m_s=0.0) == guard._replace(
        here_m=0.0, here_m_s=0.0, next_m=0.0, next_m_s=0.0
    )


def test_the_same_command_passes_with_a_good_estimate_and_not_with_a_bad_one():
    stage = AssuranceStage(SETTINGS, ASSURED)
    near, seen = (0.0, 16.3, 0.0, 0.0, -0.2, 0.0), []
    for sigma in (0.01, 0.125, 0.18, 0.2, 5.0):
        stage.step(0, near, (0.0, -0.1, 0.0), covariance(sigma, 0.001))
        seen.append(stage.decision.constraint)
    assert seen[:3] == ['', '', 'keep_out']
    assert all(seen[2:])
    assert stage.trouble().startswith('the covariance of the estimate is larger')
    # four sigmas are the error that the section names: nothing changes up to there
    stage.step(0, STATE, (0.0, -0.1, 0.0), covariance(0.125, 0.005))
    assert stage.guard == proof_of(SETTINGS, ASSURED).guard and stage.trouble() == ''


@pytest.mark.parametrize('seed', range(6))
def test_the_zone_is_kept_while_the_error_changes_within_the_spread(seed):
    """Lemma 8: the error is at the edge of what the spread of the tick says, and so are forces."""
    rng = np.random.default_rng(seed)
    stage, step = AssuranceStage(SETTINGS, ASSURED), ASSURED.step
    state, nearest, off, sizes = np.array(STATE), np.inf, np.zeros(6), np.zeros(2)
    for tick in range(1500):
        if tick % 40 == 0:
            way = rng.normal(size=(2, 3)) - 2.0 * np.array([state[:3], state[3:]])
            way /= np.linalg.norm(way, axis=1, keepdims=True)
            sizes = rng.uniform(0.0, [0.75, 0.08]) if rng.uniform() < 0.7 else sizes
            off = (way * np.maximum(sizes, (0.5, 0.02))[:, None]).ravel()
        spread = covariance(*(sizes / 4.0))
        (force,) = stage.step(tick, tuple(state + off), (*(-0.5 * state[:3]),), spread)
        force = np.array(force) * (1.0 + 0.1 * rng.choice([-1.0, 1.0]))
        pushed = force - 0.02 * state[:3] / np.linalg.norm(state[:3])
        state = np.array(cw_step(tuple(state), tuple(pushed), step))
        nearest = min(nearest, np.linalg.norm(state[:3]))
    assert 15.0 <= nearest < 17.0
    assert not stage.trouble()


def test_with_measurements_the_zone_is_kept():
    _, ranges, acted = fly(blind(()))
    assert ranges.min() >= 15.0
    assert ranges[-1] < 20.0 and 'keep_out' in acted


def test_without_measurements_the_table_leaves_in_time():
    """The lidar falls silent at 40 s. The filter alone stops, blind; the table aborts."""
    row = Row(quantity='sigma_m', most=0.6, count=5, window=5, reaction='abort')
    settings = replace(SETTINGS, abort=AbortTable(table=(row,), armed=False))
    dark = ((40.0, 400.0),)
    stage, _, acted = fly(blind(dark, settings), 1000)
    assert [change.state for change in stage.abort.changes][-1] == 'warned'
    assert acted[-1] == 'covariance' and stage.trouble()
    found = blind(dark, replace(SETTINGS, abort=AbortTable(table=(row,))))
    stage, ranges, _ = fly(found, 2500)
    assert stage.abort.changes[0].state == 'aborting'
    assert ranges.min() > 15.0


def within(start, at):
    """Return the docking with a target that tumbles, from a place before its port.

    Its camera is blind from a time on.
    """
    found = scenario.load_scenario('tumbling_docking')
    sensors, guidance = found.section(Sensors), found.named('guidance')
    units = tuple(replace(unit, outages_s=((at, 80.0),)) for unit in sensors.units)
    first, last = guidance.legs
    legs = (replace(first, to_m=(0.0, 3.5, 0.0), duration_s=12.0), last)
    return replace(
        found.equipped(
            replace(sensors, units=units), replace(guidance, legs=legs),
            replace(found.attitude, attitude=(0.0, 0.0, 0.0, 1.0)),
        ),
        initial_position_m=start, duration_s=60.0,
        initial_velocity_m_s=tuple(np.cross(np.radians([0.3, 0.4, 0.85]), start).tolist()),
    )  # fmt: skip


@pytest.mark.parametrize('along', DIRECTIONS)
def test_who_is_unsure_of_the_port_backs_out_of_a_still_corridor(along):
    """A tick takes the speed across, and sets the one outwards. In the open it stops."""
    settings = Assurance(
        keep_out_m=15.0, corridor=Passage(along, half_angle_deg=20.0, port_m=1.0, outer_m=25.0)
    )
    guard = guard_of(settings, scenario.load_scenario('paper_test'))._replace(next_m=5.0)
    axis, side = 'xyz'.index(along[1]), 1.0 if along[0] == '+' else -1.0
    place, speed, doubt = np.zeros(3), np.array([0.002, -0.003, 0.001]), Doubt(*(1.0,) * 13)
    place[axis] = 6.0 * side
    speed[axis] += RETREAT_M_S * side
    given = (*place.tolist(), *speed.tolist()), (9.0, 9.0, 9.0)
    unsure, force = unless_unsure(*given, APPROACH, 0, LVLH, guard, guard, doubt, 1e3)
    after = speed + np.array(force) * guard.dt_s / guard.mass_kg
    after[axis] -= RETREAT_M_S * side
    assert unsure and np.abs(after).max() < 1e-12
    found = unless_unsure(*given, OPEN, 0, LVLH, guard, guard, doubt, 1e3)
    assert found == (True, backup_open(given[0], guard)) != (True, force)


def test_who_loses_the_port_in_the_corridor_leaves_it_backwards():
    flown = within((0.0, 4.0, 0.0), 15.0)
    chain = Chain.of(flown, load_controller('allround'))
    stage = next(link.stage for link in chain.links if link.place is Place.ASSURANCE)
    signals = {
        RELATIVE_STATE: flown.start,
        CHASER_ATTITUDE: flown.attitude.start(flown.mean_motion_rad_s),
    }
    states, lost = [], []
    for tick in range(flown.ticks):
        states.append(signals[RELATIVE_STATE])
        chain.step(tick, signals)
        lost.append(bool(stage.trouble()))
    seen = flown.target.seen(np.array(states), flown)
    first = lost.index(True)
    assert 160 < first < 400
    ends = seen[first:]
    assert ends[-1, 1] > ends[0, 1] + 0.5
    assert ends[100:, 4] == pytest.approx(RETREAT_M_S, abs=0.05)
    assert np.abs(seen[:, [0, 2]]).max() < 0.4


@pytest.mark.parametrize('distance_m', [-0.5, 0.2, 3.0, 9.0])
@pytest.mark.parametrize('closing_m_s', [-0.2, 0.1])
def test_a_corridor_is_lost_where_the_walls_leave_too_little_room(distance_m, closing_m_s):
    """Lemma 8: twice the way to stop across, between walls that come nearer."""
    settings = Assurance(
        keep_out_m=15.0, corridor=Passage('+y', half_angle_deg=20.0, port_m=1.0, outer_m=25.0)
    )
    plain = guard_of(settings, scenario.load_scenario('paper_test'))
    doubt, state = Doubt(*(1.0,) * 13), (0.0, 1.0 + distance_m, 0.0)

    def is_lost(error_m):
        guard = plain._replace(here_m=0.01, next_m=error_m, next_m_s=0.004)
        moving = (*state, 0.0, -closing_m_s, 0.0)
        numbers = 0, LVLH, guard, guard, doubt, 0.0
        return unless_unsure(moving, (0.0, 0.0, 0.0), APPROACH, *numbers)[0]

    slope = plain.slope
    half = plain.width_m + slope * max(distance_m - 0.01, 0.0)
    narrow = slope * (max(closing_m_s, 0.0) + 0.004) + 2.0 * 0.004
    most = (half - narrow**2 / plain.wall_m_s2) / (1.0 + slope)
    assert most > 0.0 and not is_lost(most * (1.0 - 1e-9)) and is_lost(most * (1.0 + 1e-9))
