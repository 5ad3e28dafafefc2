# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Nobody leads a chaser into its keep-out zone: the edge of the domain, late forces, the port."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from vehicles import drawn

from rpo.analysis import attack
from rpo_core.assurance.assurance import AssuranceStage
from rpo_core.assurance.guard import guard_of
from rpo_core.assurance.kernels import approach_margins, at_port
from rpo_core.assurance.settings import Assurance, Passage
from rpo_core.chain.flight import OpenLoop, fly
from rpo_core.files.validation import InputError
from rpo_core.judge.verdicts import ZONE_DEPTH, missed, verdicts
from rpo_core.scenario import scenario
from rpo_core.thrusters.thrusters import Thrusters
from rpo_core.world.disturbance import Disturbance
from rpo_sim.plant import Plant

PAPER = scenario.load_scenario('paper_test')
DRIFT = {
    'armed': True,
    'retreat_m': [0.0, 12.0, 0.0],
    'table': [{'quantity': 'range_m', 'most': 1.0, 'count': 1, 'window': 1, 'reaction': 'drift'}],
}
LIMITS = (attack.VIOLATED, attack.INFEASIBLE, attack.TOO_FAST, attack.OUTSIDE, attack.HARD)


def weak(position_m, **more):
    """Return a chaser of 100 kg with 0.03 N, which the tide beats from 80 m on."""
    document = scenario.to_document(replace(PAPER, requirements=None, disturbance=scenario.NONE))
    document |= {
        'mass_kg': 100.0,
        'max_force_n': 0.03,
        'dt_s': 2.0,
        'duration_s': 9000.0,
        'initial_position_m': list(position_m),
        'initial_velocity_m_s': [0.0, 0.0, 0.0],
    }
    sure = {'keep_out_m': 5.0, 'domain_m': 18.0, 'speed': {'speed_m_s': 0.4}}
    return scenario.parse(document | {'assurance': sure | more})


@pytest.mark.parametrize('more', [{}, {'abort': DRIFT}], ids=['commanded', 'drift'])
@pytest.mark.parametrize('start', [(17.0, 0.0, 0.0), (0.0, 17.0, 0.0), (10.0, 10.0, 3.0)])
def test_a_weak_chaser_stays_between_the_zone_and_the_edge(start, more):
    """It left for 160 km, where nothing brakes what comes back."""
    found = weak(start, **more)
    forces = np.tile(0.03 * np.sign(start), (found.ticks, 1))
    forces[1500:] *= -1.0
    flight = fly(found, OpenLoop(forces))
    ranges = np.linalg.norm(flight.positions_m, axis=1)
    assert ranges.min() >= 5.0 and ranges.max() <= 18.0
    assert [v.holds for v in verdicts(flight)] == [True]


def test_vehicles_that_are_not_refused_keep_all_limits():
    """Weak thrusters, small domains, large errors, every kind of hostile command."""
    accepted = 0
    for number in range(120):
        random = np.random.default_rng([5, number])
        try:
            vehicle = drawn(random)
            results = attack.attack(vehicle, len(attack.KINDS), int(random.integers(2**31)), 300)
        except InputError:
            continue
        accepted += 1
        assert sum(len(result.rows) for result in results) == len(attack.KINDS)
        assert not any(result.total(column) for result in results for column in LIMITS), vehicle
    assert accepted > 15


def plant_of(flight):
    """Fly a plant by the commands of a flight; return it, and at which tick it was in a zone."""
    plant, first = Plant(flight.scenario, ()), None
    for force in flight.forces_n.tolist():
        plant.fly(dict.fromkeys(plant.inputs, (0.0, 0.0, 0.0)) | {'control_force': tuple(force)})
        first = plant.tick if first is None and plant.entered else first
    return plant, first


def into_the_zone():
    """Return a flight that a plan's zone does not keep off: nobody assures it."""
    plan = replace(scenario.load_scenario('hold_points'), duration_s=400.0)
    return fly(plan, OpenLoop(np.tile([0.0, 0.02, 0.0], (plan.ticks, 1))))


def test_a_zone_that_is_entered_is_a_verdict_whoever_commands():
    flight = into_the_zone()
    (verdict,) = (v for v in verdicts(flight) if v.key == ZONE_DEPTH)
    assert verdict.word == 'MISSED' and 'of `zones`' in verdict.statement
    # 1.4 m from the target, from the other side; its corridor ends 4.5 m behind the target
    assert verdict.value == pytest.approx(5.5, abs=0.01)
    # without the requirements of the scenario too
    bare = replace(flight, scenario=replace(flight.scenario, requirements=None))
    assert [v.key for v in verdicts(bare)] == [ZONE_DEPTH] and missed(bare)


def test_the_plant_says_what_the_verdict_says():
    flight = into_the_zone()
    plant, first = plant_of(flight)
    (verdict,) = (v for v in verdicts(flight) if v.key == ZONE_DEPTH)
    assert list(plant.depths_m.values()) == [pytest.approx(verdict.value, abs=0.5)]
    ranges = np.linalg.norm(flight.positions_m, axis=1)
    assert abs(first - int(np.argmax(ranges < 10.0))) <= 20
    assert plant.entered.endswith('inside the keep-out sphere of 10 m of `zones`, beside its '
                                  'corridor')  # fmt: skip


@pytest.mark.parametrize('least_m_s, judged', [(0.05, False), (0.2, True)])
def test_a_docked_chaser_is_in_no_zone(least_m_s, judged):
    """After the contact it drifts through the sphere; where nothing caught it, that counts."""
    docking = scenario.load_scenario('docking')
    required = replace(docking.requirements, contact_least_closing_speed_m_s=least_m_s)
    drifting = replace(
        docking,
        sections=(),
        duration_s=120.0,
        initial_position_m=(0.0, docking.goal_position_m[1] + 0.3, 0.0),
        initial_velocity_m_s=(0.0, -0.1, 0.0),
        requirements=required,
    )
    forces = np.tile([0.05, 0.0, 0.0], (drifting.ticks, 1))  # out of the corridor
    flight = fly(drifting, OpenLoop(forces))
    (verdict,) = (v for v in verdicts(flight) if v.key == ZONE_DEPTH)
    assert verdict.holds is not judged
    assert bool(plant_of(flight)[0].entered) is judged


@pytest.mark.parametrize('start_m', [50.05, 50.8, 51.0, 51.2, 52.0, 60.0])
def test_what_comes_before_the_first_force_is_counted(start_m):
    """20 ticks of 1 s under 0.05 N, 1 m nearer: starts were taken that came to 48.94 m of 50 m."""
    found = replace(
        PAPER,
        dt_s=1.0,
        max_force_n=1.0,
        duration_s=200.0,
        initial_position_m=(0.0, start_m, 0.0),
        initial_velocity_m_s=(0.0, 0.0, 0.0),
        disturbance=Disturbance((0.0, -0.05, 0.0)),
    )
    thrusters, settings = Thrusters(delay_ticks=20), Assurance(keep_out_m=50.0)
    passing = {'initial_position_m': (0.0, 50.2, -12.0), 'initial_velocity_m_s': (0.0, 0.0, 1.2)}
    if start_m < 50.1:  # nearest after 10 ticks, 0.25 m nearer; at the first force it is away again
        with pytest.raises(InputError, match=r'before the first force acts, after \d+ ticks'):
            replace(found, **passing).equipped(thrusters, settings)
    if start_m < 51.1:
        with pytest.raises(InputError, match=r'`assurance.keep_out_m` and the start exclude'):
            found.equipped(thrusters, settings)
        return
    flight = fly(found.equipped(thrusters, settings), OpenLoop(np.tile([0.0, -1.0, 0.0], (200, 1))))
    assert np.linalg.norm(flight.positions_m, axis=1).min() >= 50.0


WAY = Passage('+y', 10.0, 1.0, 20.0, width_m=0.2)


def docking(**errors):
    return PAPER.equipped(Assurance(keep_out_m=10.0, corridor=WAY, **errors))


def test_one_state_beyond_the_port_is_no_contact_for_the_rest_of_the_flight():
    found = docking()
    assured = AssuranceStage(found.section(Assurance), found)
    command, far = (0.0, -0.5, 0.0), (3.0, 10.0, 0.0, 0.0, -0.3, 0.0)
    assured.step(0, (0.0, 1.05, 0.0, 0.0, -0.05, 0.0), command)
    assured.step(1, (0.0, 0.95, 0.0, 0.0, -0.05, 0.0), command)
    assert assured.decision.mode == 'contact'
    assured.step(2, far, command)
    assert assured.decision.mode != 'contact' and assured.decision.constraint


def test_contact_is_where_all_true_states_are_at_the_port():
    """Within the error of the estimate it may still be before it."""
    found = docking(position_error_m=0.02)
    assured = AssuranceStage(found.section(Assurance), found)
    assured.step(0, (0.0, 1.05, 0.0, 0.0, -0.05, 0.0), (0.0, 0.0, 0.0))
    assured.step(1, (0.0, 0.99, 0.0, 0.0, -0.05, 0.0), (0.0, -0.5, 0.0))
    assert assured.decision.mode == 'approach'
    assured.step(2, (0.0, 0.97, 0.0, 0.0, -0.05, 0.0), (0.0, 0.0, 0.0))
    assert assured.decision.mode == 'contact'


def test_no_true_speed_at_the_port_is_above_its_limit():
    """By the estimate alone it was 0.107 m/s of 0.1 m/s."""
    found = docking(position_error_m=0.02, velocity_error_m_s=0.002)
    close = replace(found, initial_position_m=(0.0, 12.0, 0.0))
    results = attack.attack(close, 2 * len(attack.KINDS) * 40, 2, 1500)
    assert sum(r.total(attack.CONTACTS) for r in results) > 3
    assert sum(r.total(attack.HARD) for r in results) == 0


def test_the_corridor_ends_behind_the_port_in_the_middle_of_the_sphere():
    """Half way to its other side: who comes from there is in the zone, and at no port."""
    found = docking()
    guard = guard_of(found.section(Assurance), found)
    end = guard.port_m - 0.5 * (guard.keep_out_m + guard.port_m)
    for y, inside in ((end + 1e-9, True), (end - 1e-9, False)):
        state = (0.0, y, 0.0, 0.0, 0.0, 0.0)
        assert at_port(state, 0.0, guard) == inside
        assert (approach_margins(state, 0.0, 0.0, guard)[0] >= 0.0) == inside
    before = (0.0, guard.port_m + 1e-9, 0.0, 0.0, 0.0, 0.0)
    assert not at_port(before, 0.0, guard) and at_port(before, -2e-9, guard)
    wide = guard.width_m + guard.here_m
    for off, inside in ((wide - 1e-9, True), (wide + 1e-9, False)):
        assert at_port((off, 0.9 * guard.port_m, -off, 0.0, 0.0, 0.0), 0.0, guard) == inside
        assert at_port((0.0, 0.9 * guard.port_m, off, 0.0, 0.0, 0.0), 0.0, guard) == inside
