# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The chaser as a rigid body, against SciPy's Rotation and DOP853."""

from __future__ import annotations

import math
from dataclasses import replace
from importlib.util import find_spec
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from rpo_core.attitude.chaser import Chaser, Unloading, Wheels
from rpo_core.attitude.pointing import apart, docking_axis, too_fast, turned
from rpo_core.chain.flight import Flight, OpenLoop, fly
from rpo_core.control.attitude import AttitudeControl
from rpo_core.control.controller import load_controller
from rpo_core.kernels.arrays import Floats
from rpo_core.scenario.scenario import Scenario, load_scenario
from rpo_core.stage import Place, Stage
from rpo_core.thrusters.table import ThrusterTable
from rpo_core.thrusters.thrusters import Thrusters
from rpo_core.wire import interfaces
from rpo_core.world.cw import Body
from rpo_core.world.disturbance import NONE
from rpo_core.world.zones import Cone

INERTIA = ((0.6, 0.02, 0.0), (0.02, 0.7, 0.01), (0.0, 0.01, 0.5))
PUSH = (1e-5, 0.0, 2e-5)


class Torques(Stage):
    """Commands torques that are a function of the tick, and passes the force on."""

    name = 'attitude_control'
    inputs = (interfaces.COMMAND,)
    outputs = (interfaces.BODY_FORCE, interfaces.BODY_TORQUE)

    def __init__(self, torques):
        self._torques = torques

    def step(self, tick, *inputs):
        """Return force and torque."""
        return inputs[0], tuple(self._torques[tick])


def scenario_of(ticks, **fields):
    base = load_scenario('paper_test')
    chaser = Chaser(inertia_kg_m2=INERTIA, **fields)
    table = ThrusterTable(preset='corners_24', force_n=0.17, arm_m=0.3)
    base = replace(base, duration_s=ticks * base.dt_s, requirements=None)
    return base.equipped(chaser, Thrusters(table=table))


def pushes(ticks):
    """Return forces (ticks + 1, 3) that are held for 50 ticks each."""
    forces = np.random.default_rng(4).uniform(-0.5, 0.5, (ticks // 50 + 1, 3))
    return np.repeat(forces, 50, axis=0)[: ticks + 1]


def off_from_oracle(scenario, flight):
    """Return how far the last attitude [rad] and position [m] are from DOP853."""
    n, mass, j = scenario.mean_motion_rad_s, scenario.mass_kg, np.array(INERTIA)
    inverse, disturbances = np.linalg.inv(j), scenario.disturbances_n
    wheels = flight.signals['wheel_momentum']
    q = flight.signals['chaser_attitude'][0]
    y = np.concatenate([flight.states[0], q])

    def change(t, y, force, torque, wheel, spun, push):
        r, v, q, w = y[:3], y[3:6], y[6:10], y[10:]
        turn = Rotation.from_quat(q).as_matrix()
        f = turn @ force + push
        cw = [
            3 * n * n * r[0] + 2 * n * v[1] + f[0] / mass,
            -2 * n * v[0] + f[1] / mass,
            -n * n * r[2] + f[2] / mass,
        ]
        relative = w - turn.T @ [0.0, 0.0, n]
        dq = 0.5 * np.array(
            [
                q[3] * relative[0] + q[1] * relative[2] - q[2] * relative[1],
                q[3] * relative[1] + q[2] * relative[0] - q[0] * relative[2],
                q[3] * relative[2] + q[0] * relative[1] - q[1] * relative[0],
                -q[0] * relative[0] - q[1] * relative[1] - q[2] * relative[2],
            ]
        )
        up = turn.T @ [1.0, 0.0, 0.0]
        total = torque - spun + np.array(PUSH) + 3 * n * n * np.cross(up, j @ up)
        dw = inverse @ (total - np.cross(w, j @ w + wheel + spun * t))
        return np.concatenate([v, cw, dq, dw])

    for tick in range(len(flight.states) - 1):
        given = (
            flight.signals['thrust_force'][tick],
            flight.signals['exerted_torque'][tick],
            wheels[tick],
            (wheels[tick + 1] - wheels[tick]) / scenario.dt_s,
            disturbances[tick],
        )
        found = solve_ivp(
            change, (0, scenario.dt_s), y, 'DOP853', rtol=1e-11, atol=1e-13, args=given
        )
        y = found.y[:, -1]
        y[6:10] /= np.linalg.norm(y[6:10])
    ours = Rotation.from_quat(flight.signals['chaser_attitude'][-1][:4])
    angle = (ours.inv() * Rotation.from_quat(y[6:10])).magnitude()
    return angle, float(np.abs(flight.states[-1][:3] - y[:3]).max())


def steered(scenario, ticks, monkeypatch):
    """Return a flight whose wheels and thrusters are commanded at random."""
    named = Scenario.named
    monkeypatch.setattr(
        Scenario, 'named', lambda self, name: name == 'attitude_control' or named(self, name)
    )
    torques = np.random.default_rng(5).uniform(-0.02, 0.02, (ticks + 1, 3))
    return fly(scenario, OpenLoop(pushes(ticks)), [(Place.STEERING, Torques(torques))])


WHEELED = {
    'rates_deg_s': (1.0, -0.5, 2.0),
    'wheels': Wheels(torque_nm=0.01, momentum_nms=0.05, start_nms=(0.01, 0.02, -0.03)),
    'disturbance_torque_nm': PUSH,
}


@pytest.mark.parametrize('ticks', [150, pytest.param(4000, marks=pytest.mark.slow)])
@pytest.mark.parametrize('fields', [{**WHEELED, 'wheels': None}, WHEELED], ids=['free', 'wheels'])
def test_it_turns_and_flies_as_dop853_has_it(fields, ticks, monkeypatch):
    scenario = scenario_of(ticks, **fields)
    if fields['wheels']:
        flight = steered(scenario, ticks, monkeypatch)
        momenta = flight.signals['wheel_momentum']
        assert np.abs(momenta).max() <= 0.05 + 1e-12
        assert np.abs(np.diff(momenta, axis=0)).max() <= 0.001 + 1e-12  # the torque is limited
    else:
        flight = fly(scenario, OpenLoop(pushes(ticks)))
    angle, distance = off_from_oracle(scenario, flight)
    assert angle < 1e-8 and distance < (1e-8 if ticks < 1000 else 1e-6)


WHEEL_KG_M2 = 1e-3
"""Inertia of each of Basilisk's wheels about its axis; the chaser's is without it."""


def turned_by_basilisk(flight: Flight) -> tuple[Floats, Floats]:
    """Return position (3,) [m] and axes (3, 3) of a chaser at the end, without gravity.

    Forces and torques of the thrusters and of the wheels are those of the flight, tick by tick.
    """
    from Basilisk.architecture import messaging
    from Basilisk.simulation import extForceTorque, reactionWheelStateEffector, spacecraft
    from Basilisk.utilities import RigidBodyKinematics, SimulationBaseClass, simIncludeRW

    scenario, model = flight.scenario, SimulationBaseClass.SimBaseClass()
    model.CreateNewProcess('truth').addTask(model.CreateNewTask('turning', scenario.dt_ns // 4))
    x, y, z, w, *rate = flight.signals['chaser_attitude'][0].tolist()
    momenta = flight.signals['wheel_momentum']
    made, pushed = spacecraft.Spacecraft(), extForceTorque.ExtForceTorque()
    made.hub.mHub = scenario.mass_kg
    inertia = np.array(scenario.attitude.inertia_kg_m2) + WHEEL_KG_M2 * np.eye(3)
    made.hub.IHubPntBc_B = inertia.tolist()
    made.hub.sigma_BNInit = [[v / (1.0 + w)] for v in (x, y, z)]
    made.hub.omega_BN_BInit = [[r] for r in rate]
    made.hub.r_CN_NInit, made.hub.v_CN_NInit = scenario.start[:3], scenario.start[3:]
    factory, wheels = (
        simIncludeRW.rwFactory(),
        reactionWheelStateEffector.ReactionWheelStateEffector(),
    )
    for axis, h, r in zip(np.eye(3).tolist(), momenta[0].tolist(), rate, strict=True):
        rpm = (h / WHEEL_KG_M2 - r) * 30.0 / math.pi  # momentum is against inertial space
        factory.create('custom', axis, Js=WHEEL_KG_M2, Omega=rpm, useMaxTorque=False, Omega_max=1e9)
    factory.addToSpacecraft('wheels', wheels, made)
    motors = messaging.ArrayMotorTorqueMsg()
    wheels.rwMotorCmdInMsg.subscribeTo(motors)
    made.addDynamicEffector(pushed)
    for part in (pushed, wheels, made):
        model.AddModelToTask('turning', part)
    model.InitializeSimulation()
    spun = np.diff(momenta, axis=0) / scenario.dt_s
    outside = flight.signals['exerted_torque'] + scenario.attitude.disturbance_torque_nm
    for tick in range(scenario.ticks):
        pushed.extForce_B = flight.signals['thrust_force'][tick][:, None].tolist()
        pushed.extTorquePntB_B = outside[tick][:, None].tolist()
        command = messaging.ArrayMotorTorqueMsgPayload(motorTorque=spun[tick].tolist())
        motors.write(command, tick * scenario.dt_ns)
        model.ConfigureStopTime((tick + 1) * scenario.dt_ns)
        model.ExecuteSimulation()
    found = made.scStateOutMsg.read()
    return np.array(found.r_CN_N), np.asarray(RigidBodyKinematics.MRP2C(found.sigma_BN)).T


@pytest.mark.slow
def test_400_s_with_wheels_and_thrusters_as_basilisk_has_them(monkeypatch):
    if find_spec('Basilisk') is None:
        pytest.skip('Basilisk (layer truth) is not installed')
    far = {'body': Body(1e-3, 1e5), 'orbit_radius_m': 4e8, 'disturbance': NONE}  # no gravity
    scenario = replace(scenario_of(4000, **WHEELED), **far)
    flight = steered(scenario, 4000, monkeypatch)
    position_m, axes = turned_by_basilisk(flight)
    ours = Rotation.from_quat(flight.signals['chaser_attitude'][-1][:4]).as_matrix()
    assert np.abs(position_m).max() > 100.0
    assert np.abs(flight.states[-1][:3] - position_m).max() < 1e-6
    assert Rotation.from_matrix(axes.T @ ours).magnitude() < 1e-8


def unloading(wheels=None, **fields):
    """Return a scenario whose wheels begin full and are emptied by ideal thrusters."""
    wheels = wheels or Wheels(torque_nm=0.05, momentum_nms=0.5, start_nms=(0.3, -0.2, 0.04))
    found = scenario_of(300, wheels=wheels, gravity_gradient=False)
    control = AttitudeControl(controller='attitude_pd', limit_nm=0.02)
    return found.equipped(control, Unloading(**{'above_nms': 0.05, 'torque_nm': 0.02, **fields}))


def test_thrusters_empty_the_wheels_and_the_chaser_does_not_feel_it():
    scenario = unloading()
    flight = fly(scenario, OpenLoop(np.zeros((1, 3))))
    wheels, torque = flight.signals['wheel_momentum'], flight.signals['unloading_torque']
    assert np.abs(wheels[-1]).max() <= 0.05 + 0.002 + 1e-3
    assert np.array_equal(torque[0], [-0.02, 0.02, 0.0])
    np.testing.assert_allclose(flight.signals['exerted_torque'], torque, atol=1e-12)
    logged = {k: v for k, v in flight.signals.items() if k != 'unloading_torque'}
    found, known = replace(flight, signals=logged, spent=None).thrust, flight.thrust
    assert np.array_equal(found.forces_n, known.forces_n) and found[2:] == known[2:]
    kept = tuple(s for s in scenario.sections if not isinstance(s, Unloading))
    alone = fly(replace(scenario, sections=kept), OpenLoop(np.zeros((1, 3))))
    assert np.abs(alone.signals['wheel_momentum'][-1]).max() > 0.25
    for one in (flight, alone):  # by SciPy: both hold the attitude of the orbit
        turned = Rotation.from_quat(one.signals['chaser_attitude'][:, :4]).magnitude()
        assert turned.max() < 2e-3


# How far attitudes are apart, against SciPy's rotations.

RANDOM = np.random.default_rng(30)


def test_angles_and_rate_errors_are_those_of_scipy():
    a, b = (Rotation.random(500, random_state=seed) for seed in (1, 2))
    rates = RANDOM.normal(size=(2, 500, 3))
    signs = RANDOM.choice([-1.0, 1.0], 500)[:, None]  # q and -q are one attitude
    found = apart(np.hstack([signs * a.as_quat(), rates[0]]), np.hstack([b.as_quat(), rates[1]]))
    np.testing.assert_allclose(found[:, 0], (b.inv() * a).magnitude(), atol=1e-12)
    seen = (a.inv() * b).apply(rates[1])
    np.testing.assert_allclose(found[:, 1], np.linalg.norm(rates[0] - seen, axis=1), atol=1e-12)
    np.testing.assert_allclose(turned(rates[0], a.as_quat()), a.apply(rates[0]), atol=1e-12)
    assert apart([0, 0, 0, 1, 0, 0, 1e-3], [0, 0, 0, -1, 0, 0, 0]).tolist() == [0.0, 1e-3]


@pytest.mark.parametrize(('torque_nm', 'says'), [(0.005, ''), (0.021, 'NOT exact from tick 10 on')])
def test_a_flight_that_turns_faster_than_its_method_follows_says_from_when(torque_nm, says):
    """1.05 rad/s^2 is 0.105 rad in a tick of 0.1 s after 1 s; a quarter of that is not."""
    ball = np.diag([0.02] * 3).tolist()
    chaser = Chaser(inertia_kg_m2=ball, disturbance_torque_nm=(torque_nm, 0.0, 0.0))
    flown = replace(load_scenario('approach'), duration_s=3.0).equipped(chaser)
    flight = fly(flown, OpenLoop(np.zeros((31, 3))))
    found = too_fast(flight.signals['chaser_attitude'], 0.1)
    assert found.startswith(says) and bool(found) == bool(says)


def test_the_docking_axis_is_that_of_pointing_or_against_the_corridor(monkeypatch):
    port = load_scenario('tumbling_docking')
    pointing = port.named('pointing')
    others = [settings for settings in port.sections if settings is not pointing]
    tilted = replace(port, sections=(*others, replace(pointing, docking_axis=(0.0, -3.0, 4.0))))
    assert docking_axis(tilted) == pytest.approx((0.0, -0.6, 0.8))
    assert docking_axis(load_scenario('docking')) == (-0.0, -1.0, -0.0)
    assert docking_axis(load_scenario('paper_test')) == (-0.0, -1.0, -0.0)
    way = SimpleNamespace(corridor=Cone((0.0, 0.0, -1.0), (0.0, 0.0, -1.0), 0.2, 9.0))
    empty = SimpleNamespace(corridor=None)
    monkeypatch.setattr('rpo_core.attitude.pointing.zones_of', lambda scenario: [empty, way])
    assert docking_axis(load_scenario('docking')) == (-0.0, -0.0, 1.0)


def test_the_twist_of_a_chaser_that_turns_is_as_the_page_says():
    """In `relative_state`: linear in target LVLH, angular in body axes against inertial space.

    Against differences of the positions and of the attitudes, by SciPy. Read as Odometry defines
    it, in the child frame, the velocity is another one.
    """
    columns = interfaces.row_of(interfaces.RELATIVE_STATE).columns
    riding = interfaces.row_of(interfaces.CHASER_ATTITUDE).columns
    assert columns[3:] == tuple(f'twist.twist.linear.{axis}' for axis in 'xyz')
    assert riding[4:] == tuple(f'twist.twist.angular.{axis}' for axis in 'xyz')
    scenario = replace(load_scenario('tumbling_docking'), duration_s=20.0)
    flight = fly(scenario, load_controller('allround'))
    attitudes = flight.signals[interfaces.CHASER_ATTITUDE]
    turns, dt_s = Rotation.from_quat(attitudes[:, :4]), scenario.dt_s
    moved = np.gradient(flight.states[:, :3], dt_s, axis=0)[1:-1]
    linear = flight.states[1:-1, 3:]
    assert np.abs(moved - linear).max() < 1e-4
    assert np.abs(moved - turns[1:-1].apply(linear)).max() > 0.1
    turned = (turns[:-1].inv() * turns[1:]).as_rotvec() / dt_s
    orbit = turns[:-1].inv().apply([0.0, 0.0, scenario.mean_motion_rad_s])
    angular = (attitudes[:-1, 4:] + attitudes[1:, 4:]) / 2.0
    assert np.abs(turned - (angular - orbit)).max() < 1e-5
    assert np.abs(turned - angular).max() > 1e-3
