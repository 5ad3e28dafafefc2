# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A chaser with wheels and thrusters by Basilisk (layer `truth`)."""

from __future__ import annotations

import math

import numpy as np

from rpo_core.chain.flight import Flight
from rpo_core.kernels.arrays import Floats

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
