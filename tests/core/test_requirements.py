# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Requirements of a scenario: what a file may say, and the verdicts of made-up flights."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from core_documents import document

from rpo_core import files
from rpo_core.chain.flight import Flight
from rpo_core.files.validation import InputError
from rpo_core.judge import contact, metrics
from rpo_core.judge.verdicts import missed, unbounded, values_of, verdicts
from rpo_core.scenario.requirements import LIMITS, THRUST, Requirements
from rpo_core.scenario.scenario import dumps, load, load_scenario, parse
from rpo_core.thrusters.thrusters import Propellant, Thrusters
from rpo_core.world.disturbance import Disturbance


def required(**limits):
    """Return the scenario `quick`, of 5 s, with requirements."""
    return parse({**document('scenario', 'quick'), 'requirements': limits})


def test_what_thrusters_spend_is_judged():
    """One newton second of the x axis, at 10 kg and 2 s of specific impulse; no propellant else."""
    limits = {'thruster_delta_v_m_s': 0.1, 'propellant_kg': 0.05}
    tank = Thrusters(propellant=Propellant(specific_impulse_s=2.0, mass_kg=1.0))
    quick = load_scenario('quick').equipped(tank)
    forces = np.zeros((quick.ticks + 1, 3))
    forces[:10, 0] = 0.5 if quick.dt_s == 0.2 else 0.1 / quick.dt_s
    flown = replace(quick, requirements=Requirements(**limits))
    states = np.zeros((quick.ticks + 1, 6))
    found = {v.key: v for v in verdicts(Flight(flown, states, forces, np.zeros_like(forces)))}
    impulse = np.clip(forces[:-1], -quick.max_force_n, quick.max_force_n).sum() * quick.dt_s
    spent = found['propellant_kg']
    assert spent.value == pytest.approx(impulse / (2.0 * 9.80665), rel=1e-12)
    assert found['thruster_delta_v_m_s'].value == pytest.approx(
        2.0 * 9.80665 * math.log(quick.mass_kg / (quick.mass_kg - spent.value)), rel=1e-6
    )
    assert spent.unit == 'kg' and spent.holds == (spent.value <= 0.05)


def test_a_section_is_written_and_read_back_and_changes_no_flight():
    limits = {'hold_from_s': 2.5, 'hold_error_norm_m': 0.1, 'slew_per_axis_n_s': 0.2}
    scenario = required(**limits)
    again = files.loads(dumps(scenario), parse, 'written')
    assert again.requirements == scenario.requirements == Requirements(**limits)
    assert scenario == load_scenario('quick'), 'equal: both fly the same'
    assert 'requirements' not in dumps(load_scenario('quick'))


def made_up(**limits):
    """Return a flight of 4 ticks of 1 s along y to the target, and then past it along z."""
    push = Disturbance((0.0, 0.0, -0.02))
    base = replace(load_scenario('quick'), dt_s=1.0, duration_s=4.0, disturbance=push)
    scenario = replace(base, requirements=Requirements(**limits))
    states = np.array(
        [
            (0, 8, 0, 0, -4, 0),
            (3, 4, 0, 0, -2, 0),
            (0, 0.5, 0, 0.1, -0.3, 0.2),
            (0, 0, 0.3, 0, 0, -0.1),
            (0, 0, -0.4, 0.03, 0, 0.04),
        ]
    )
    forces = [(0.1, 0, 0), (0, 0.3, -0.4), (0, 0, 0.03), (0.01, 0, 0), (9, 9, 9)]
    return Flight(
        scenario, states, np.array(forces), push.over(range(scenario.ticks + 1), scenario.dt_ns)
    )


EVERYTHING = {
    'final_error_per_axis_m': 0.4,
    'final_error_norm_m': 0.4,
    'final_speed_per_axis_m_s': 0.04,
    'final_speed_norm_m_s': 0.05,
    'mean_error_norm_m': (0.3 + 0.4) / 2,
    'mean_speed_norm_m_s': (0.1 + 0.05) / 2,
    'hold_error_per_axis_m': 0.4,
    'hold_error_norm_m': 0.4,
    'hold_speed_per_axis_m_s': 0.1,
    'hold_speed_norm_m_s': 0.1,
    'hold_force_per_axis_n': 0.03,
    'hold_force_per_disturbance': 0.03,
    'arrival_time_s': 1.0,
    'contact_closing_speed_m_s': 0.3,
    'contact_lateral_speed_m_s': math.hypot(0.1, 0.2),
    'keep_out_depth_m': 0.5,
    'slew_per_axis_n_s': 0.43,
    'energy_n2s': 0.01 + 0.25 + 0.0009 + 0.0001,
    'delta_v_axis_sum_m_s': (0.1 + 0.7 + 0.03 + 0.01) / 10,
}
"""The values of the flight, by hand. The disturbance is 0.02 N."""

SETTINGS = {
    'mean_window_s': 2.0,
    'hold_from_s': 2.0,
    'arrival_error_norm_m': 0.5,
    'contact_range_m': 0.5,
    'keep_out_m': 5.5,
}


def test_every_value_by_hand():
    found = verdicts(made_up(**SETTINGS, **dict.fromkeys(EVERYTHING, 0.01)))
    assert [verdict.key for verdict in found] == list(EVERYTHING)
    others = {*THRUST, 'contact_angle_deg', 'contact_rate_deg_s'}
    assert [name for name in LIMITS if name not in others] == list(EVERYTHING)
    for verdict in found:
        assert verdict.value == pytest.approx(EVERYTHING[verdict.key], abs=1e-15), verdict.key
        assert verdict.word == 'MISSED', verdict.key
        assert verdict.unit and '{' not in verdict.statement
    told = [verdict.statement for verdict in found]
    for words in ('last 2 s', 'after 2 s', 'within 0.5 m', 'at 0.5 m', 'sphere of 5.5 m'):
        assert any(words in statement for statement in told), words
    shares = {v.key: v.limit for v in found if v.limit != 0.01}
    assert shares == {'hold_force_per_disturbance': 0.01 * 0.02}


def test_a_value_at_its_limit_holds():
    exact = {v.key: v.value for v in verdicts(made_up(**SETTINGS, **EVERYTHING))}
    exact['hold_force_per_disturbance'] = 1.5
    flight = made_up(**SETTINGS, **exact)
    assert all(v.holds for v in verdicts(flight)) and not missed(flight)
    assert missed(made_up(**SETTINGS, **{**exact, 'final_error_norm_m': 0.39}))


def test_what_never_happens_is_missed_and_what_is_not_flown_is_not_judged():
    limits = {'arrival_time_s': 9.0, 'arrival_error_per_axis_m': 0.1, 'hold_from_s': 4.0}
    limits |= {'contact_range_m': 0.1, 'contact_closing_speed_m_s': 1.0, 'hold_error_norm_m': 9.0}
    found = {v.key: v for v in verdicts(made_up(**limits))}
    assert found['hold_error_norm_m'].word == 'not flown'
    assert found['arrival_time_s'].value == math.inf and not found['arrival_time_s'].holds
    assert found['contact_closing_speed_m_s'].word == 'MISSED'
    lost = made_up(**SETTINGS, **EVERYTHING)
    lost.states[3] = math.nan
    assert all(v.word == 'MISSED' for v in verdicts(lost))


def test_what_a_campaign_keeps_are_metrics_and_values_of_requirements():
    flight = made_up(**SETTINGS, **EVERYTHING)
    kept, judged = values_of(flight), {v.key: v.value for v in verdicts(flight)}
    counted = dict(zip(metrics.UNITS, metrics.row_of(flight).tolist(), strict=True))
    final = dict(zip(metrics.FINAL, flight.states[-1].tolist(), strict=True))
    assert kept == counted | judged | final | {metrics.LEVEL: 0.02}
    assert counted['arrival_time_s'] == judged['arrival_time_s'] == 1.0
    never = {**SETTINGS, **EVERYTHING, 'arrival_error_norm_m': 0.1}
    assert values_of(made_up(**never))['arrival_time_s'] == math.inf
    flight.states[3, 1] = math.nan
    kept = values_of(flight)
    assert all(math.isnan(kept[name]) for name in metrics.UNITS if name != 'arrival_time_s')
    assert all(kept[name] == math.inf for name in {*EVERYTHING} - {*metrics.UNITS})
    assert kept['arrival_time_s'] == math.inf


def touching(**limits):
    """Return the values of the flight for a port whose axis points along +y."""
    given = {'contact_range_m': 0.5, 'contact_axis': '+y', 'contact_closing_speed_m_s': 1.0}
    given |= {'contact_lateral_speed_m_s': 1.0, **limits}
    return {v.key: v.value for v in verdicts(made_up(**given))}


def test_a_contact_by_its_axis_is_at_the_plane_of_the_port():
    """The third state is half a metre before it: the fourth, beside the port, is the contact."""
    found = touching()
    assert found['contact_closing_speed_m_s'] == 0.0
    assert found['contact_lateral_speed_m_s'] == 0.1
    assert touching(contact_range_m=0.2)['contact_closing_speed_m_s'] == math.inf, 'too far beside'


def test_speeds_of_a_contact_are_the_velocity_along_and_across_a_direction():
    """Against NumPy, in any place: at the port's axis, or along the line of sight."""
    random = np.random.default_rng(5)
    axes = {
        f'{"-+"[side > 0]}{"xyz"[i]}': side * np.eye(3)[i] for i in range(3) for side in (-1, 1)
    }
    for r, v in random.uniform(-1.0, 1.0, (40, 2, 3)):
        for axis, outward in {**axes, None: r / np.linalg.norm(r)}.items():
            required = Requirements(
                contact_range_m=9.0, contact_closing_speed_m_s=1.0, contact_axis=axis
            )
            port = contact.port_of(required, (0.0, 0.0, 0.0))
            closing, lateral = contact.contact_speeds(*r, *v, port._replace(least_m_s=-math.inf))
            along = v @ outward
            assert closing == pytest.approx(-along, abs=1e-12), axis
            assert lateral == pytest.approx(np.linalg.norm(v - along * outward), abs=1e-12), axis


def test_a_contact_that_is_too_slow_for_the_latches_is_none():
    assert touching(contact_least_closing_speed_m_s=0.01) == {
        'contact_closing_speed_m_s': math.inf,
        'contact_lateral_speed_m_s': math.inf,
    }


@pytest.mark.parametrize(
    ('angle_deg', 'depth_m'),
    [
        (30.0, 2.5 - 4.0 * math.tan(math.radians(30.0))),  # beside the cone, where the range is 5 m
        (32.1, 0.0),  # 2.5 / 4 is the tangent of 32.01 deg: inside
        (1.0, 0.5),  # nearer to the edge of the sphere than to the cone
    ],
)
def test_the_way_through_the_zone_is_by_the_corridor(angle_deg, depth_m):
    found = touching(keep_out_m=5.5, corridor_half_angle_deg=angle_deg, keep_out_depth_m=0.0)
    assert found['keep_out_depth_m'] == pytest.approx(depth_m, abs=1e-12)


@pytest.mark.parametrize('turn', [0, 1, 2])
@pytest.mark.parametrize(
    ('angle_deg', 'depth_m'), [(1.0, 0.5), (30.0, 2.5 - 3.75 * math.tan(math.radians(30.0)))]
)
def test_all_axes_are_judged_alike(turn, angle_deg, depth_m):
    """x, y and z change their names. The port is before the target, the sphere about it."""
    settings = {'contact_range_m': 0.5, 'keep_out_m': 5.5, 'corridor_half_angle_deg': angle_deg}
    keys = ('contact_closing_speed_m_s', 'contact_lateral_speed_m_s', 'keep_out_depth_m')
    settings |= {'contact_axis': f'+{"yzx"[turn]}', **dict.fromkeys(keys, 1.0)}
    flight, port = made_up(**settings), tuple(np.roll((0.0, 0.25, 0.0), turn).tolist())
    states = np.roll(flight.states.reshape(-1, 2, 3), turn, axis=2).reshape(-1, 6)
    scenario = replace(flight.scenario, goal_position_m=port)
    found = {v.key: v.value for v in verdicts(replace(flight, scenario=scenario, states=states))}
    assert [found[key] for key in keys] == pytest.approx([0.0, 0.1, depth_m], abs=1e-12)


IDSS = {
    'contact_closing_speed_m_s': 0.1,
    'contact_lateral_speed_m_s': 0.04,
    'contact_angle_deg': 4.0,
    'contact_rate_deg_s': 0.2,
}
INERTIA = [[1.0, 0.0, 0.0], [0.0, 1.2, 0.0], [0.0, 0.0, 1.5]]


def with_profile(attitude=True, **more):
    """Return the scenario `docking` without assurance, which requires a profile."""
    docking = document('scenario', 'docking')
    del docking['assurance']
    body = {'attitude': {'inertia_kg_m2': INERTIA}} if attitude else {}
    required = {'requirements': {'profile': 'idss', **more}}
    return parse({**docking, **body, **required})


def test_a_profile_requires_what_the_standard_does():
    found = with_profile().requirements
    assert found.limits == IDSS and found.unjudged == {}
    assert (found.contact_range_m, found.contact_axis) == (0.1, '+y')
    assert found.contact_least_closing_speed_m_s == 0.05
    changed = with_profile(contact_angle_deg=1.0, keep_out_depth_m=0.0).requirements
    assert changed.limits == {**IDSS, 'contact_angle_deg': 1.0, 'keep_out_depth_m': 0.0}
    for scenario in (with_profile(), with_profile(energy_n2s=9.0, contact_angle_deg=1.0)):
        text = dumps(scenario)
        assert 'contact_lateral_speed_m_s' not in text, 'the profile says it'
        assert files.loads(text, parse, 'written').requirements == scenario.requirements
    without_zones = parse(
        {**document('scenario', 'quick'), 'requirements': {'profile': 'idss'}}
    ).requirements
    assert without_zones.contact_axis is None, 'along the line of sight'


def test_a_profile_says_what_it_did_not_judge():
    scenario = with_profile(attitude=False)
    assert list(scenario.requirements.limits) == list(IDSS)[:2]
    rest = np.zeros((scenario.ticks + 1, 6))
    found = verdicts(Flight(scenario, rest, rest[:, :3], rest[:, :3]))
    unjudged = {v.key: v for v in found if v.holds is None}
    assert list(unjudged) == list(IDSS)[2:]
    assert unjudged['contact_angle_deg'].statement.endswith(': no section `attitude`')
    assert unjudged['contact_angle_deg'].limit == 4.0
    assert files.loads(dumps(scenario), parse, 'written').requirements == scenario.requirements


def test_angles_need_an_attitude():
    with pytest.raises(InputError, match=r'`requirements.contact_angle_deg` needs section `att'):
        with_profile(attitude=False, contact_angle_deg=1.0)
    with pytest.raises(InputError, match=r'`profile` must be one of idss; got .* did you mean'):
        with_profile(profile='ids')


@pytest.mark.parametrize(('first', 'angle_deg'), [(3, 3.0), (4, 1.0)])
def test_angles_are_judged_at_the_first_contact(first, angle_deg):
    """The chaser turns by degrees about z, as many as states are left; its axes were LVLH's."""
    whole = with_profile()
    scenario = replace(whole, duration_s=5 * whole.dt_s)
    rest = np.zeros((6, 6))
    rest[:, 1] = [2.0, 1.0, 0.5, 0.05, -0.01, -0.1]
    rest[:, 1] += [0.0, 0.0, 0.0, -0.06 if first == 3 else 0.0, 0.0, 0.0]
    rest += scenario.goal_state
    rest[:, 4] = -0.07
    half = np.radians([9.0, 8.0, 7.0, 3.0, 1.0, 0.5]) / 2.0
    n = scenario.mean_motion_rad_s
    turned = np.column_stack(
        [half * 0.0, half * 0.0, np.sin(half), np.cos(half), half * 0, half * 0, half * 0.01 + n]
    )
    flight = Flight(scenario, rest, rest[:, :3], rest[:, :3], {'chaser_attitude': turned})
    found = {v.key: v.value for v in verdicts(flight)}
    assert found['contact_angle_deg'] == pytest.approx(
        math.degrees(2.0 * math.sin(math.radians(angle_deg) / 2.0)), rel=1e-12
    )
    assert found['contact_rate_deg_s'] == pytest.approx(angle_deg / 200.0, rel=1e-9)
    assert found['contact_closing_speed_m_s'] == 0.07
    unknown = verdicts(replace(flight, signals={}))
    assert {v.key for v in unknown if v.holds is None} == set(IDSS) - set(list(IDSS)[:2])


CONTACT = {'contact_range_m': 0.1, 'contact_closing_speed_m_s': 0.1}


@pytest.mark.parametrize(
    ('limits', 'rest'),
    [
        ({'slew_per_axis_n_s': 1.0, 'energy_n2s': 9.0}, ['arrival', 'contact', 'end state']),
        ({'final_speed_norm_m_s': 0.1}, ['arrival', 'contact', 'end state']),
        ({'mean_speed_norm_m_s': 0.1}, ['arrival', 'contact', 'end state']),
        ({'final_error_norm_m': 0.1}, ['contact', 'end state']),
        ({'final_error_norm_m': 0.1, 'mean_speed_norm_m_s': 0.1}, ['contact']),
        ({'mean_error_norm_m': 0.1}, ['contact']),
        ({'hold_from_s': 1.0, 'hold_error_norm_m': 0.1}, ['contact']),
        ({'hold_from_s': 1.0, 'hold_speed_norm_m_s': 0.1}, ['arrival', 'contact', 'end state']),
        ({'arrival_time_s': 1.0, 'arrival_error_norm_m': 0.1}, ['contact']),
        (CONTACT, []),
    ],
)
def test_what_no_requirement_bounds_is_named(limits, rest):
    """Of a scenario that docks; of one without a port nobody asks for a contact."""
    docking = replace(load_scenario('docking'), requirements=Requirements(**limits))
    assert unbounded(docking) == rest
    assert unbounded(required(**limits)) == [name for name in rest if name != 'contact']
    assert unbounded(docking, CONTACT) == []


def test_of_the_shipped_scenarios_one_leaves_something_open():
    """It is about what an abort table keeps."""
    known = {name: load(path) for name, path in files.shipped('scenario').items()}
    judged = {n: s for n, s in known.items() if getattr(s, 'requirements', None) is not None}
    assert len(judged) > 15 and {n for n, s in judged.items() if unbounded(s)} == set()
    assert unbounded(known['guarded']) == ['arrival', 'contact', 'end state']
