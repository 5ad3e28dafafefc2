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

from rpo.analysis.turned import turned_of
from rpo.reports import replay
from rpo.reports.logged import logged_flight, until
from rpo.reports.replay import Replayed
from rpo_core import files
from rpo_core.chain.flight import fly
from rpo_core.control.controller import load_controller
from rpo_core.scenario import scenario as scenarios
from rpo_core.wire.interfaces import BODY_TORQUE, CHASER_ATTITUDE, WHEEL_MOMENTUM
from rpo_log.read.run_log import flight_of, read_run

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


def flown_of(found):
    return fly(scenarios.parse(found), load_controller('allround'))


@pytest.fixture(scope='module')
def flight():
    return flown_of(document())


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


@pytest.mark.parametrize('late', [0, 3])
def test_theta_is_the_angle_between_command_and_body(flight, late):
    """Against SciPy: to the middle of the tick in which it acts, by its rate against LVLH."""
    if late:
        flight = flown_of(document(thrusters={'delay_ticks': late}))
    found, dt = turned_of(flight), flight.scenario.dt_s
    attitudes = flight.signals[CHASER_ATTITUDE]
    body, orbit = Rotation.from_quat(attitudes[:, :4]), [0, 0, flight.scenario.mean_motion_rad_s]
    against = attitudes[:, 4:] - body.inv().apply(np.tile(orbit, (len(attitudes), 1)))
    command = body * Rotation.from_rotvec((late + 0.5) * dt * against)
    last = len(attitudes) - 1 - late
    ends = [(command[:last].inv() * body[k : k + last]).magnitude() for k in (late, late + 1)]
    expected = np.degrees(np.max(ends, axis=0))
    np.testing.assert_allclose(found.theta_deg[late:-1], expected, atol=1e-4)
    assert expected.max() > 0.1
    off = Rotation.from_quat(attitudes[:, :4]).magnitude()
    np.testing.assert_allclose(found.off_reference_deg, np.degrees(off), atol=1e-9)


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
