# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The plan in the chain: phases, commands, refusals, and what a bad plan is told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import yaml
from landing import rest_at_landing
from references import follow

from rpo_core import files
from rpo_core.chain.flight import fly
from rpo_core.control.controller import load_controller
from rpo_core.files.validation import InputError
from rpo_core.guidance import guidance, transfers
from rpo_core.scenario import scenario
from rpo_core.wire.interfaces import REFERENCE_STATE
from rpo_core.world import cw

WAITING = {'go': guidance.COMMAND, 'timeout_s': None}
BEGUN, HOLD = (0, 'fly_around'), (5405, 'hold_60')
FOLLOWED = (
    ('hold_points', {'go': guidance.COMMAND}, {}, 9700,
     [BEGUN, HOLD, (6605, 'aborting'), (9605, 'drifting')]),
    ('hold_points', WAITING, {}, 15_000, [BEGUN, HOLD]),
    ('hold_points', WAITING, {6000: 'go'}, 6200, [BEGUN, HOLD, (6000, 'to_20')]),
    ('around', {}, {1000: 'hold', 2500: 'go'}, 3000,
     [(0, 'to_the_port'), (1000, 'stopped'), (2500, 'to_the_port')]),
    ('around', {}, {1000: 'retreat', 2500: 'go'}, 3000,
     [(0, 'to_the_port'), (1000, 'retreating'), (2500, 'to_the_port')]),
)  # fmt: skip
"""Plans, how their holds are changed, commands, up to which tick they are followed, phases."""
KEEP_OUT_M, PORT_M = 10.0, np.array([0.0, 1.0, 0.0])


@pytest.fixture(scope='module')
def around():
    return scenario.load_scenario('around')


@pytest.fixture(scope='module')
def hold_points():
    return scenario.load_scenario('hold_points')


@pytest.mark.parametrize('controller', rest_at_landing(['allround', 'pd']))
def test_around_the_target_and_in_by_the_corridor(around, controller):
    flight = fly(around, load_controller(controller))
    contact = int(np.argmax(np.linalg.norm(flight.positions_m - PORT_M, axis=1) < 0.1))
    position = flight.positions_m[: contact + 1]
    inside = np.linalg.norm(position, axis=1) < KEEP_OUT_M
    off_axis = np.hypot(position[:, 0], position[:, 2])
    assert (off_axis[inside] <= (position[inside, 1] - 1.0) * np.tan(np.radians(10.0))).all()
    errors = position - flight.signals[REFERENCE_STATE][: contact + 1, :3]
    assert np.abs(errors).max() < 0.1
    assert 0.05 <= -flight.velocities_m_s[contact, 1] <= 0.1
    assert np.abs(flight.velocities_m_s[contact, [0, 2]]).max() <= 0.04


def test_a_hold_says_why_it_cannot_end(hold_points):
    begun = 5405
    stage, _ = follow(hold_points, begun + 1)
    assert stage.changes[-1][:2] == (begun, 'hold_60')
    leg, wanted = stage._leg, np.array(stage._reference)
    late = begun + round(leg.dwell_s / hold_points.dt_s)
    for miss, said in (
        ((leg.within_m * 1.01, 0.0), 'the error is 0.505 m, more than `within_m` = 0.5 m'),
        ((0.0, leg.within_m_s * 1.01), 'the speed is 0.0505 m/s, more than `within_m_s` = 0.05'),
        ((leg.within_m * 0.99, leg.within_m_s * 0.99), ''),
    ):
        stage.m.tick, stage.m.state = late, wanted + np.array([0, 0, miss[0], 0, miss[1], 0])
        assert stage.command('go').startswith(said) and bool(stage.command('go')) == bool(said)
    stage.m.tick = late - 1
    assert stage.command('go').startswith(f'`dwell_s` = {leg.dwell_s:g} s is not over: ')
    stage.m.tick = -1
    assert stage.command('go') == 'no state has come'


def test_a_command_that_a_log_tells_of_is_followed_and_other_words_are_not(around):
    stage, _ = follow(around, 1000)
    stage.take_event(1000, 'hold')
    stage.take_event(1000, 'waiting')
    assert stage.commands == {1000: 'hold'} and stage.next_tick == 1000


@pytest.mark.parametrize(('name', 'holds', 'commands', 'until', 'phases'), FOLLOWED)
def test_a_plan_is_left_and_taken_up_by_commands_and_time(name, holds, commands, until, phases):
    chosen = scenario.load_scenario(name)
    settings = chosen.section(guidance.Guidance)
    legs = [replace(leg, **holds) if leg.kind == guidance.HOLD else leg for leg in settings.legs]
    stage, references = follow(
        chosen.equipped(replace(settings, legs=tuple(legs))), until, commands
    )
    assert [change[:2] for change in stage.changes] == phases
    most = 2.0 * chosen.dt_s * chosen.max_force_n / chosen.mass_kg
    assert np.abs(np.diff(references[:, 3:], axis=0)).max() < most, 'the reference does not jump'


@pytest.mark.parametrize(
    ('name', 'command', 'said'),
    [
        ('around', 'go', '`go` ends a hold; the phase is to_the_port'),
        ('tumbling_docking', 'retreat', 'the plan has no `retreat_m`'),
    ],
)
def test_a_command_that_fits_no_phase_says_why(name, command, said):
    assert follow(scenario.load_scenario(name), 300)[0].command(command) == said


def test_after_an_abort_the_drift_leads_away_for_two_orbits(around):
    """From any moment beyond the gate, without force, the chaser stays out for two orbits."""
    n = around.mean_motion_rad_s
    step = cw.discretise(n, around.mass_kg, 1.0)
    for moment in (500, 2000, 3500):
        stage, _ = follow(around, moment + 5000, {moment: 'abort'})
        assert stage.changes[-1].phase == guidance.DRIFTING
        state = stage.step(moment + 5000, stage._reference)[0]
        nearest = np.inf
        for _ in range(round(2.0 * 2.0 * np.pi / n)):
            state = cw.cw_step(state, (0.0, 0.0, 0.0), step)
            nearest = min(nearest, float(np.linalg.norm(state[:3])))
        assert nearest > KEEP_OUT_M
        assert stage.command('go') == 'guidance is drifting: an abort is not taken back'


def test_a_leg_may_burn_all_the_time_and_ease_as_long_and_keep_its_speed():
    whole = {'kind': 'transfer', 'to_m': (0.0, 5.0, 0.0), 'duration_s': 60.0}
    assert guidance.Leg(name='burns', burn_s=30.0, **whole).burn_s == 30.0
    assert guidance.Leg(name='eases', ease_s=60.0, **whole).ease_s == 60.0
    line = guidance.Leg(
        name='line', kind='straight', to_m=(0.0, 20.0, 0.0), speed_m_s=0.2, end_speed_m_s=0.2
    )
    assert line.end_speed_m_s == line.speed_m_s


def test_the_search_of_a_plan_is_bounded_by_its_work(monkeypatch):
    """Counted, not timed: the same on every machine. What ships takes far less than the bound."""
    data, spent = yaml.safe_load(files.find('scenario', 'around').read_text()), []
    guidance.check.cache_clear()
    for module in (guidance, transfers):
        monkeypatch.setattr(module, 'spend', spent.append)
    scenario.parse(data)
    assert 1e5 < sum(spent) < 0.1 * guidance.MOST_WORK
    monkeypatch.undo()
    monkeypatch.setattr(guidance, 'MOST_WORK', 2.0 * sum(spent))
    guidance.check.cache_clear()
    assert scenario.parse(data)
    guidance.check.cache_clear()
    monkeypatch.setattr(guidance, 'MOST_WORK', 0.5 * sum(spent))
    with pytest.raises(InputError, match='`guidance` must have a plan that is found in'):
        scenario.parse(data)


@pytest.mark.parametrize('sign', [-1.0, 1.0])
def test_a_plan_needs_no_more_than_its_share_of_the_force(hold_points, monkeypatch, sign):
    """One of its axes at one of its ticks, by a thousandth less and more."""
    settings = hold_points.section(guidance.Guidance)
    found, most = guidance.nominal(settings, hold_points, to_rest=True), hold_points.max_force_n
    for share, refused in ((0.999, False), (1.001, True)):
        guidance.check.cache_clear()
        forces = [(0.0, 0.0, 0.0)] * len(found.forces)
        forces[70] = (0.0, sign * share * settings.force_share * most, 0.0)
        pushed = found._replace(forces=forces)
        monkeypatch.setattr(guidance, 'nominal', lambda *_, made=pushed, **__: made)
        if not refused:
            guidance.check(settings, hold_points)
            continue
        with pytest.raises(InputError, match=r'must need at most `force_share` = .* 7 s: '):
            guidance.check(settings, hold_points)
