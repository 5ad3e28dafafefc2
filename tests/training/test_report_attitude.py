# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A chaser that turns, in report and replay: what is drawn is what was flown."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import yaml
from invoking import invoke
from pages import replayed, unpacked
from scipy.spatial.transform import Rotation
from test_report import check_labels

from rpo.reports import replay, stages
from rpo.reports.logged import logged_flight, until
from rpo.reports.replay import Replayed
from rpo.reports.run import _Stages, _thrusters
from rpo.reports.turned import Panel, in_lvlh, panels_of, turned_of
from rpo_core import files
from rpo_core.attitude.pointing import docking_axis
from rpo_core.chain.flight import fly
from rpo_core.control.controller import load_controller
from rpo_core.scenario import scenario as scenarios
from rpo_core.wire.interfaces import BODY_TORQUE, CHASER_ATTITUDE, EXERTED_FORCE, WHEEL_MOMENTUM
from rpo_log.read.run_log import flight_of, read_run
from rpo_log.show import report, style

INERTIA = [[0.6, 0.02, 0.0], [0.02, 0.7, 0.01], [0.0, 0.01, 0.5]]


def document(**more):
    """Return a scenario of 20 s whose chaser begins 70 degrees off, turning at 2.3 deg/s."""
    found = yaml.safe_load(files.read_text(files.find('scenario', 'approach')))
    body = {
        'inertia_kg_m2': INERTIA,
        'attitude': [0.3, -0.2, 0.5, 0.8],
        'rates_deg_s': [1.0, -0.5, 2.0],
        'wheels': {'torque_nm': 0.02, 'momentum_nms': 0.5, 'start_nms': [0.01, 0.02, -0.03]},
    }
    found |= {'name': 'turning', 'duration_s': 20.0, 'attitude': body}
    found |= {'attitude_control': {'controller': 'attitude_pd'}, 'disturbance': 'none'}
    found['sensors'] = {'units': [{'kind': 'range_bearing', 'field_of_view_rad': 0.4}]}
    return {**found, **more}


NO_TOPIC = 'unloading_torque', WHEEL_MOMENTUM


def flown_of(found):
    return fly(scenarios.parse(found), load_controller('allround'))


@pytest.fixture(scope='module')
def flight():
    return flown_of(document())


@pytest.fixture(scope='module')
def spinning():
    """A flight to a target that spins."""
    spin = {'kind': 'spin', 'axis': [0.2, 1.0, 0.5], 'rate_deg_s': 5.0}
    return flown_of(document(target=spin))


@pytest.fixture(scope='module')
def tumbled():
    """5 s of the shipped docking, whose wheels begin with more than they may keep."""
    found = yaml.safe_load(files.read_text(files.find('scenario', 'tumbling_docking')))
    found['attitude']['wheels']['start_nms'] = [0.07, -0.06, 0.0]
    return flown_of({**found, 'duration_s': 5.0})


@pytest.fixture(scope='module')
def logged(tmp_path_factory):
    folder = tmp_path_factory.mktemp('turning')
    (folder / 'turning.yaml').write_text(yaml.safe_dump(document()))
    out = ['-o', str(folder / 'run'), '--no-fail']
    done = invoke('simulate', folder / 'turning.yaml', *out)
    assert done.exit_code == 0, done.output
    return folder / 'run'


def test_the_wheels_of_a_log_are_those_that_flew(flight, logged):
    """The stage is run again: a log has the torques alone."""
    found, known = turned_of(flight_of(read_run(logged))), turned_of(flight)
    assert WHEEL_MOMENTUM not in flight_of(read_run(logged)).signals
    np.testing.assert_array_equal(found.momenta_nms, flight.signals[WHEEL_MOMENTUM])
    for one, other in zip(found, known, strict=True):
        np.testing.assert_array_equal(one, other)


def test_the_wheels_of_a_log_are_emptied_as_they_were_in_flight(tumbled):
    logged = {k: v for k, v in tumbled.signals.items() if k not in NO_TOPIC}
    found = turned_of(replace(tumbled, signals=logged)).momenta_nms
    assert np.abs(tumbled.signals['unloading_torque']).max() > 0.0
    np.testing.assert_array_equal(found, tumbled.signals[WHEEL_MOMENTUM])


def test_a_log_that_lost_a_command_in_the_chasers_axes_is_shown_up_to_it(logged):
    """Else its energy would be no number, and its thrusters would seem to have spent less."""
    log = read_run(logged)
    values = {name: found.copy() for name, found in log.values.items()}
    values['body_force'][100] = values[BODY_TORQUE][100] = np.nan
    shown = logged_flight(replace(log, values=values, gaps=('one is missing',)))
    assert shown.flight.scenario.duration_s == 9.9
    expected = until(flight_of(read_run(logged)), 99)
    assert shown.flight.thrust.delta_v_m_s == expected.thrust.delta_v_m_s > 0.0
    np.testing.assert_array_equal(turned_of(shown.flight).momenta_nms, turned_of(expected)[-1])


def test_a_free_running_log_that_ends_early_is_shown_to_its_end(logged):
    """Also where an answer was missing; and no angle is said of a command that may be older."""
    log = read_run(logged)
    values = {name: found[:151].copy() for name, found in log.values.items()}
    applied = {
        'applied_body_force': 0.5 * values['body_force'],
        'applied_torque': values[BODY_TORQUE].copy(),
    }
    for name in ('control_force', 'body_force', BODY_TORQUE):
        values[name][20] = np.nan
    gaps = ('it ends',)
    log = replace(log, values=values | applied, ticks=log.ticks[:151], gaps=gaps)
    flight = logged_flight(log).flight
    assert flight.scenario.duration_s == 15.0
    np.testing.assert_array_equal(flight.sent_forces_n, applied['applied_body_force'])
    found = turned_of(flight)
    assert found.theta_deg is None and np.isfinite(found.momenta_nms).all()


def test_the_limit_of_the_torque_is_that_of_the_controller(tumbled):
    """Wheels of 0.13 N m, of which what empties them takes 0.04 and the section leaves 0.06."""
    (found,) = (p for p in panels_of(turned_of(tumbled), tumbled.scenario) if p.label == 'torque')
    assert found.limit == 0.06


def test_a_report_names_the_stages_that_it_cannot_run_again(flight, tumbled):
    (said,) = _Stages([], None, None).lacking(tumbled)
    assert said.text.startswith('No figures of guidance, assurance, estimator: ')
    assert not _Stages([], None, None).lacking(flight)


def test_the_torque_of_the_thrusters_is_drawn_about_the_axes_of_the_chaser(tumbled):
    """Their force is in LVLH; and where they steer it, their torque is nothing left over."""
    (section,) = _thrusters(tumbled)
    picture = section.blocks[0]
    assert 'torque that they give about the axes of the chaser' in picture.caption
    assert picture.figure.axes[2].get_ylabel().endswith("chaser's axes")


@pytest.mark.parametrize('late', [0, 3])
def test_theta_is_the_angle_between_command_and_body(flight, late):
    """Against SciPy: the body turns on for half a tick, by its rate against LVLH."""
    if late:
        flight = flown_of(document(thrusters={'delay_ticks': late}))
    found, dt = turned_of(flight), flight.scenario.dt_s
    attitudes = flight.signals[CHASER_ATTITUDE]
    body, orbit = Rotation.from_quat(attitudes[:, :4]), [0, 0, flight.scenario.mean_motion_rad_s]
    against = attitudes[:, 4:] - body.inv().apply(np.tile(orbit, (len(attitudes), 1)))
    command = body * Rotation.from_rotvec(0.5 * dt * against)
    last = len(attitudes) - 1 - late
    ends = [(command[:last].inv() * body[k : k + last]).magnitude() for k in (late, late + 1)]
    expected = np.degrees(np.max(ends, axis=0))
    np.testing.assert_allclose(found.theta_deg[late:-1], expected, atol=1e-6)
    assert expected.max() > 0.1 * (1 + 2 * late)
    off = Rotation.from_quat(attitudes[:, :4]).magnitude()
    np.testing.assert_allclose(found.off_reference_deg, np.degrees(off), atol=1e-9)


def test_a_force_of_the_thrusters_turns_into_the_one_that_was_exerted(flight):
    found = in_lvlh(flight, flight.saturated_forces_n)
    np.testing.assert_allclose(found, flight.signals[EXERTED_FORCE][:-1], atol=1e-5)
    assert np.abs(found - flight.saturated_forces_n).max() > 0.1


def test_a_run_is_explained_with_its_attitude(logged, flight):
    done = invoke('explain', logged, '--at', '5')
    assert done.exit_code == 0 and 'The logged force is the same, bit for bit.' in done.output
    off = turned_of(flight).off_reference_deg[50]
    torque = ', '.join(f'{value:.3g}' for value in flight.signals[BODY_TORQUE][50])
    assert f'is {off:.3g} deg and' in done.output and f'torque [{torque}] N m' in done.output


def test_a_limit_counts_once_it_is_reached():
    values = np.array([[9.0, 0.0, 0.0], [0.0, -2.0, 1.0], [0.0, 7.0, 0.0]])
    assert np.isnan(Panel('', '', 'deg', values, 5.0, once=True).sizes).tolist() == [1, 0, 0]
    assert Panel('', '', 'deg', values, 5.0).sizes.tolist() == [9.0, 2.0, 7.0]


def test_the_page_shows_angles_rates_and_wheels(logged):
    with style.applied():
        (section,) = stages.attitude_sections(flight_of(read_run(logged)))
    rows = {row[0]: row[1:] for row in section.blocks[0].rows}
    assert set(rows) == {
        'off the reference, per axis', 'θ, force turned wrongly by', 'rate, per axis',
        'torque commanded, per axis', 'momentum of a wheel',
    }  # fmt: skip
    assert rows['momentum of a wheel'][-1] == '≤ 0.5 N m s'
    check_labels(section.blocks[1])


def test_the_replay_turns_the_chaser(flight):
    found = replayed(replay.page_of('', [Replayed('', flight, '', None)]))
    (flown,) = found['flights']
    quaternions = unpacked(flown['chaser'], 4)
    known = Rotation.from_quat(flight.signals[CHASER_ATTITUDE][:, :4])
    assert (known.inv() * Rotation.from_quat(quaternions)).magnitude().max() < 1e-6
    assert [name for name, *_ in flown['turns']] == [
        'off reference', 'turn rate', 'θ of the command',
    ]  # fmt: skip
    names = [limit['name'] for limit in flown['limits']]
    assert 'momentum of a wheel' in names and 'torque commanded, per axis' in names
    assert found['scene']['cameras'] == [{'axis': [0.0, 1.0, 0.0], 'half': 0.4, 'turns': False}]


def test_a_flight_without_attitude_says_nothing_of_it():
    flight = fly(
        replace(scenarios.load_scenario('paper_test'), duration_s=2.0), load_controller('allround')
    )
    assert turned_of(flight) is None
    assert docking_axis(flight.scenario) == (0.0, -1.0, 0.0)
    text = replay.page_of('', [Replayed('', flight, '', None)])
    assert '"chaser":null,"turns":[]' in text and '"cameras":[]' in text


@pytest.mark.every_landing
def test_the_report_names_axes_that_turn_and_no_optimum(logged, tmp_path):
    done = invoke('report', logged, '-o', tmp_path, '--no-fail')
    assert done.exit_code == 0, done.output
    text = (tmp_path / 'report.html').read_text()
    assert 'The optimum is computed where neither chaser nor target turns.' in text
    assert 'velocity and control force; right' in text
    flight = flight_of(read_run(logged))
    drawn = report.time_histories(flight).axes[0].get_legend_handles_labels()[1]
    assert drawn == ['x', 'y', 'z']
    still = fly(scenarios.load_scenario('quick'), load_controller('allround'))
    drawn = report.time_histories(still).axes[0].get_legend_handles_labels()[1]
    assert drawn == list(style.AXIS_NAMES)
