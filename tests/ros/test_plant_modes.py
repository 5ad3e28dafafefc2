# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Lockstep and free running without ROS: stamps decide; what is held or late; the pace of ticks."""

import math
import random
from dataclasses import replace

import pytest

from rpo_core.control.controller import load_controller
from rpo_core.scenario.scenario import load_scenario
from rpo_sim import plant as kinds
from rpo_sim.loop_health import MOST_CATCH_UP, Durations, LoopHealth, Pace
from rpo_sim.plant import FreeRunningPlant, LockstepPlant

FORCE, DISTURBANCE = 'control_force', 'disturbance_force'
MS = 1_000_000


@pytest.fixture
def scenario():
    return load_scenario('quick')


def test_lockstep_takes_the_first_answer_to_its_state_alone(scenario):
    flown, dt_ns = [], scenario.dt_ns
    for others in (False, True):
        plant = LockstepPlant(scenario, [FORCE, DISTURBANCE])
        for before in (kinds.FOREIGN, kinds.LATE):
            wrong = {dt_ns: kinds.EARLY, -dt_ns: before, 1: kinds.FOREIGN, 10**16: kinds.FOREIGN}
            assert plant.missing == [FORCE, DISTURBANCE]
            for shift_ns, kind in wrong.items() if others else ():
                assert plant.answer(FORCE, plant.stamp_ns + shift_ns, (9.0,) * 3) == kind
            assert plant.answer(FORCE, plant.stamp_ns, (0.1, 0.2, 0.3)) == kinds.ACCEPTED
            if others:
                assert plant.answer(FORCE, plant.stamp_ns, (0.4,) * 3) == kinds.REPEATED
            assert plant.missing == [DISTURBANCE]
            assert plant.answer(DISTURBANCE, plant.stamp_ns, (0.0,) * 3) == kinds.ACCEPTED
            plant.advance()
        flown.append((plant.tick, plant.state))
    assert flown[0] == flown[1] and flown[0][0] == 2
    assert plant.ignored == {'foreign_stamp': 5, 'early': 2, 'late': 1, 'repeated': 2}


def test_a_dropped_peer_counts_as_zero_force(scenario):
    plant = LockstepPlant(scenario, [FORCE, DISTURBANCE])
    plant.answer(DISTURBANCE, plant.stamp_ns, (0.01, 0.0, 0.0))
    assert plant.drop_missing() == [FORCE]
    plant.advance()
    drifting = LockstepPlant(scenario, [FORCE, DISTURBANCE])
    drifting.answer(DISTURBANCE, drifting.stamp_ns, (0.01, 0.0, 0.0))
    drifting.answer(FORCE, drifting.stamp_ns, (0.0, 0.0, 0.0))
    drifting.advance()
    assert plant.state == drifting.state
    assert plant.answer(FORCE, plant.stamp_ns, (0.1,) * 3) == kinds.DROPPED


# Free running.


def at_tick(scenario, tick, stale_after_ticks=3):
    """Return a plant that was commanded at tick 0 and has drifted to a later tick."""
    plant = FreeRunningPlant(scenario, [FORCE], stale_after_ticks)
    plant.answer(FORCE, plant.stamp_ns, (0.1, 0.2, 0.3))
    for _ in range(tick):
        plant.advance()
    return plant


def test_a_force_is_held_and_then_cut_off(scenario):
    flown = [at_tick(scenario, tick, stale_after_ticks=3).applied(FORCE) for tick in range(6)]
    assert flown == [(0.1, 0.2, 0.3)] * 4 + [(0.0, 0.0, 0.0)] * 2
    plant = at_tick(scenario, 6)
    assert (plant.held_ticks, plant.stale_ticks) == (5, 2)
    assert plant.stale == (FORCE,)


@pytest.mark.parametrize('flown', [3, 6])
def test_a_held_force_is_flown_like_a_repeated_one_and_then_it_drifts(scenario, flown):
    held, told = at_tick(scenario, flown), at_tick(scenario, 0)
    for tick in range(flown):
        told.answer(FORCE, told.stamp_ns, (0.1, 0.2, 0.3) if tick <= 3 else (0.0,) * 3)
        told.advance()
    assert held.state == told.state
    assert held.figures() == told.figures()


@pytest.mark.parametrize(
    ('tick', 'kind'),
    [
        (5, kinds.ACCEPTED),
        (3, kinds.REPEATED),
        (2, kinds.LATE),
        (6, kinds.EARLY),
        (5.01, kinds.FOREIGN),
        (-1, kinds.FOREIGN),
    ],
)
def test_only_a_newer_answer_replaces_the_held_one(scenario, tick, kind):
    plant = at_tick(scenario, 5)
    plant.answer(FORCE, scenario.stamp_ns(3), (0.4, 0.0, 0.0))
    stamp_ns = scenario.epoch_ns + round(tick * scenario.dt_ns)
    assert plant.answer(FORCE, stamp_ns, (0.5, 0.0, 0.0)) == kind
    assert plant.applied(FORCE)[0] == (0.5 if kind == kinds.ACCEPTED else 0.4)
    assert plant.ignored == ({} if kind == kinds.ACCEPTED else {kind: 1})


def test_ticks_are_due_by_the_clock_without_drift_and_a_stall_is_not_made_up_for():
    pace = Pace()
    pace.restart(0, 0.01)
    assert [pace.due(now * MS) for now in (9, 10, 11, 20, 45)] == [0, 1, 0, 1, 2]
    assert (pace.overruns, pace.stalls) == (1, 0)  # the tick of 30 ms began at 45 ms
    assert (pace.lateness.count, pace.lateness.largest_s) == (4, 0.015)
    assert sum(pace.due(now * MS) for now in range(46, 10_001)) == 1000 - 4
    assert (pace.due(20_000 * MS), pace.stalls) == (MOST_CATCH_UP, 1)
    assert [pace.due(now * MS) for now in (20_005, 20_010)] == [0, 1]


def test_durations_are_of_the_last_ones_and_the_largest_of_all():
    durations = Durations()
    assert set(durations.figures('x').values()) == {0.0}
    for duration_s in (9.0, *[0.001] * 9_400, *[0.002] * 600):
        durations.add(duration_s)
    assert durations.figures('x') == {'x_p50_ms': 1.0, 'x_p95_ms': 2.0, 'x_max_ms': 9000.0}


def test_latency_counts_from_the_first_time_a_state_was_sent_and_forgets():
    health = LoopHealth(FreeRunningPlant(load_scenario('quick'), [FORCE], 3), dict)
    for tick in range(5000):
        health.sent(tick, float(tick))
        health.sent(tick, tick + 0.9)  # sent again
    health.commanded(4999, 4999.25)
    health.commanded(17, 6000.0)  # long forgotten
    health.commanded(None, 6000.0)
    assert (health.latency.count, health.latency.largest_s) == (1, 0.25)


def test_losses_cost_only_what_is_cut_off():
    """At 20 % random losses a force is rarely older than two ticks, and the flight still docks."""
    scenario, controller = load_scenario('paper_test'), load_controller('allround')
    plant = FreeRunningPlant(scenario, [FORCE, DISTURBANCE], 10)
    chance = random.Random(1)
    for tick in range(scenario.ticks):
        force = controller.force_n(plant.state[:3], plant.state[3:])
        disturbance = tuple(scenario.disturbances_n[tick].tolist())
        for name, value in ((FORCE, force), (DISTURBANCE, disturbance)):
            if not tick or chance.random() > 0.2:
                plant.answer(name, plant.stamp_ns, value)
        plant.advance()
    assert plant.stale_ticks == 0
    assert 0.3 < plant.held_ticks / scenario.ticks < 0.42  # 1 - 0.8 * 0.8 = 0.36
    assert plant.figures()['distance_m'] < 0.5


def test_the_end_is_told_from_the_goal():
    scenario = replace(load_scenario('quick'), initial_position_m=(0.0, 13.0, 4.0))
    ending = FreeRunningPlant(scenario, [FORCE], 10).ending()
    assert ending == '13.6 m from the target and 0 m/s (norms), J = 0 N²s'
    goal = replace(scenario, goal_position_m=(0.0, 10.0, 0.0))
    plant = FreeRunningPlant(goal, [FORCE], 10)
    assert plant.ending() == '5 m from the goal and 0 m/s (norms), J = 0 N²s'
    assert plant.figures()['distance_m'] == pytest.approx(math.hypot(13.0, 4.0)), 'to the target'
