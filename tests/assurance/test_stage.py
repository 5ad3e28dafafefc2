# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The section `assurance`, its stage in the chain, and what is refused."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import yaml
from scipy import optimize

from rpo.training.config import load_start
from rpo_core.assurance import filters
from rpo_core.assurance.assurance import AssuranceStage
from rpo_core.assurance.guard import guard_of
from rpo_core.assurance.kernels import OPEN, backup_open, open_margins
from rpo_core.assurance.settings import Assurance
from rpo_core.attitude.attitude_kernels import LVLH
from rpo_core.chain.flight import fly
from rpo_core.judge import metrics
from rpo_core.scenario import scenario
from rpo_core.thrusters.thrusters import Pulses, Thrusters
from rpo_core.wire.interfaces import ASSURED_FORCE, EXERTED_FORCE
from rpo_core.world.cw import cw_step

PAPER = scenario.load_scenario('paper_test')
ASSURED = scenario.load_scenario('assured')
SURE = Assurance(keep_out_m=10.0)


def test_a_file_is_read_back_the_same():
    again = scenario.parse(yaml.safe_load(scenario.dumps(ASSURED)))
    assert again == ASSURED
    assert again.section(Assurance) == ASSURED.section(Assurance)
    assert again.section(Assurance).corridor.port_m == ASSURED.zones.port_m[1] == 1.0


def test_what_is_not_finite_becomes_a_stop():
    stage = AssuranceStage(SURE, PAPER)
    state = (0.0, 60.0, 0.0, 0.0, -0.1, 0.0)
    for bad in (math.nan, math.inf, -math.inf, 1e200):
        (force,) = stage.step(0, state, (0.1, bad, 0.0))
        assert force == (0.0, 0.0, 0.0)
        assert stage.decision.constraint == 'not_finite'
    (force,) = stage.step(0, (math.nan, *state[1:]), (0.1, 0.0, 0.0))
    assert force == (0.0, 0.0, 0.0)


@pytest.mark.parametrize('errors', [{}, {'position_error_m': 0.1, 'velocity_error_m_s': 0.003}])
@pytest.mark.parametrize('limit', [filters.KEEP_OUT, filters.DOMAIN])
def test_the_least_change_is_the_projection(limit, errors):
    """Beside a solver: nothing in the box that keeps the next state in the set is nearer."""
    guard = guard_of(Assurance(keep_out_m=10.0, domain_m=70.0, **errors), PAPER)
    random, gap, off = np.random.default_rng(5), 0.5, guard.here_m
    inwards = limit == filters.KEEP_OUT
    range_m = guard.keep_out_m + gap + off if inwards else guard.domain_m - gap - off
    fastest = math.sqrt(2 * gap * (guard.authority_m_s2 if inwards else guard.edge_m_s2))
    doubt = guard.here_m_s + fastest * off / (range_m - off)
    acted = 0
    for _ in range(150):
        e = random.normal(size=3)
        e /= np.linalg.norm(e)
        r = e * range_m
        v = e * (-1.0 if inwards else 1.0) * (fastest * random.uniform(0.9, 0.99) - doubt)
        state, command = tuple(np.concatenate([r, v])), tuple(random.uniform(-0.5, 0.5, 3))
        *force, _, constraint, _, _ = filters.assure(
            state, command, (0.0,) * 3, OPEN, 0, LVLH, LVLH, PAPER.step, guard, guard
        )
        if constraint != limit:
            continue
        acted += 1

        def margin(f, state=state):
            after = cw_step(state, tuple(f), PAPER.step)
            return open_margins(after, guard.next_m, guard.next_m_s, guard)[0] * 1e3

        best = optimize.minimize(
            lambda f, command=command: ((f - np.array(command)) ** 2).sum(),
            np.array(force),
            bounds=[(-0.5, 0.5)] * 3,
            constraints={'type': 'ineq', 'fun': margin},
        )
        ours = np.linalg.norm(np.subtract(force, command))
        assert ours <= math.sqrt(best.fun) * 1.01 + 2e-3
    assert acted > 20


def test_at_rest_and_without_a_zone_there_is_nothing_to_stop():
    guard = guard_of(Assurance(), PAPER)
    assert backup_open((0.0, 60.0, 0.0, 0.0, 0.0, 0.0), guard) == (0.0, 0.0, 0.0)


def test_the_slew_limit_is_kept_while_nothing_else_asks():
    stage = AssuranceStage(Assurance(keep_out_m=10.0, slew_n_s=0.1), PAPER)
    last = np.zeros(3)
    for tick in range(20):
        (force,) = stage.step(tick, (0.0, 60.0, 0.0, 0.0, 0.0, 0.0), (0.5, -0.5, 0.02))
        assert np.abs(np.subtract(force, last)).max() <= 0.01 + 1e-12
        last = np.array(force)
    assert last == pytest.approx([0.2, -0.2, 0.02])


def test_a_late_thruster_is_part_of_the_stage():
    late = PAPER.equipped(Thrusters(delay_ticks=3))
    stage = AssuranceStage(SURE, late)
    assert stage.memory_ticks is None
    assert AssuranceStage(SURE, PAPER).memory_ticks == 0


def test_thrusters_fire_what_was_assured_and_metrics_are_of_it():
    """They were of the command before assurance: of a force that nobody exerted."""
    found = PAPER.equipped(
        Assurance(keep_out_m=66.0, thrust_error=0.1),
        Thrusters(pulses=Pulses(count=6, modulation='sigma_delta', minimum_on_time_s=0.01)),
    )
    flight = fly(replace(found, duration_s=20.0), load_start('trained'))
    assert (flight.signals[ASSURED_FORCE] != flight.forces_n).any()
    np.testing.assert_array_equal(flight.thrust.forces_n, flight.signals[EXERTED_FORCE][:-1])
    logged = {name: flight.signals[name] for name in (ASSURED_FORCE, EXERTED_FORCE)}
    assert metrics.of_flight(replace(flight, signals=logged)) == metrics.of_flight(flight)
    unassured = metrics.of_flight(replace(flight, signals={}))
    assert unassured.energy_n2s != metrics.of_flight(flight).energy_n2s  # else nothing is shown
