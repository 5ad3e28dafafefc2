# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The flight by Basilisk (layer `truth`): target and chaser are two of its spacecraft."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from rpo.analysis.truth import World, cross
from rpo_core.kernels.arrays import Floats
from rpo_core.scenario.scenario import Scenario

SUBSTEPS = 100
"""Steps of a tick where Basilisk's thrusters fire: each is on or off for whole steps."""


class _Simulation(NamedTuple):
    """Basilisk's objects.

    force : on the chaser; keep : what Basilisk does not keep alive itself
    valves : message of the on-times of its thrusters, along each axis and against it
    """

    model: Any
    target: Any
    chaser: Any
    force: Any
    keep: list[Any]
    valves: Any = None


def knows(scenario: Scenario) -> bool:
    """Return whether this truth has what acts in a scenario; it has no drag."""
    return scenario.dynamics is None or scenario.dynamics.drag is None


def _spacecraft(scenario: Scenario, state: Floats, mass_kg: float, keep: list[Any]) -> Any:
    """Return a spacecraft at an inertial state (6,), with the gravity of the scenario's body."""
    from Basilisk.simulation import spacecraft, sphericalHarmonicsGravityModel
    from Basilisk.utilities import simIncludeGravBody

    made = spacecraft.Spacecraft()
    made.hub.mHub, made.hub.IHubPntBc_B = mass_kg, np.eye(3).tolist()
    made.hub.r_CN_NInit, made.hub.v_CN_NInit = state[:3].tolist(), state[3:].tolist()
    bodies, body = simIncludeGravBody.gravBodyFactory(), scenario.body
    centre = bodies.createEarth()
    centre.isCentralBody, centre.mu = True, body.mu_m3_s2
    if scenario.dynamics is not None and scenario.dynamics.j2:
        field = sphericalHarmonicsGravityModel.SphericalHarmonicsGravityModel()
        field.muBody, field.radEquator, field.maxDeg = body.mu_m3_s2, body.equator_m, 2
        normalised = -body.j2 / math.sqrt(5.0)
        field.cBar = [[1.0], [0.0, 0.0], [normalised, 0.0, 0.0]]
        field.sBar = [[0.0], [0.0, 0.0], [0.0, 0.0, 0.0]]
        centre.radEquator, centre.gravityModel = body.equator_m, field
        keep.append(field)
    bodies.addBodiesTo(made)
    keep += [bodies, centre]
    return made


def _thrusters(scenario: Scenario, valves: Any, keep: list[Any]) -> Any:
    """Return six of its thrusters through the centre of mass, each of the largest force."""
    from Basilisk.simulation import thrusterDynamicEffector

    made = thrusterDynamicEffector.ThrusterDynamicEffector()
    for direction in (*np.eye(3), *-np.eye(3)):
        one = thrusterDynamicEffector.THRSimConfig()
        one.thrDir_B, one.thrLoc_B = direction[:, None].tolist(), [[0.0]] * 3
        one.MaxThrust, one.steadyIsp, one.MinOnTime = scenario.max_force_n, 100.0, 0.0
        made.addThruster(one)
        keep.append(one)
    made.cmdsInMsg.subscribeTo(valves)
    return made


def _begin(scenario: Scenario, world: World, thrusters: bool) -> _Simulation:
    from Basilisk.architecture import messaging
    from Basilisk.simulation import extForceTorque
    from Basilisk.utilities import SimulationBaseClass

    model, keep = SimulationBaseClass.SimBaseClass(), list[Any]()
    task = model.CreateNewTask('flight', scenario.dt_ns // (SUBSTEPS if thrusters else 1))
    model.CreateNewProcess('truth').addTask(task)
    valves = messaging.THRArrayOnTimeCmdMsg()
    start = world.target()
    target = _spacecraft(scenario, start, 1.0, keep)
    relative = world.to_inertial(start, np.array(scenario.start))
    chaser = _spacecraft(scenario, start + relative, scenario.mass_kg, keep)
    force = extForceTorque.ExtForceTorque()
    fired = [_thrusters(scenario, valves, keep)] if thrusters else []
    for effector in (force, *fired):
        chaser.addDynamicEffector(effector)
    if scenario.dynamics is None:  # LVLH turns evenly: so does the body, and the force with it
        chaser.hub.omega_BN_BInit = [[0.0], [0.0], [scenario.mean_motion_rad_s]]
    for part in (*fired, target, chaser, force):
        model.AddModelToTask('flight', part)
    model.InitializeSimulation()
    model.ConfigureStopTime(0)
    model.ExecuteSimulation()
    return _Simulation(model, target, chaser, force, [*keep, *fired], valves)


def _state(spacecraft: Any) -> Floats:
    message = spacecraft.scStateOutMsg.read()
    return np.concatenate([message.r_CN_N, message.v_CN_N])


class BasiliskFlight:
    """Target and chaser of a scenario, tick by tick; state : (6,) [m, m/s], target LVLH.

    thrusters : whether the chaser has Basilisk's, too; in an even orbit only
    """

    def __init__(self, scenario: Scenario, thrusters: bool = False) -> None:
        self.scenario, self.tick = scenario, 0
        self.state = np.array(scenario.start)
        self._world = World(scenario)
        self._simulation = _begin(scenario, self._world, thrusters)

    def step(self, force_n: Floats, thrust_n: Floats | None = None) -> Floats:
        """Return the state (6,) after a tick under a force (3,) [N], target LVLH.

        thrust_n : and under Basilisk's thrusters, open for the share of the tick with this mean
        """
        simulation, scenario = self._simulation, self.scenario
        if thrust_n is not None:
            from Basilisk.architecture import messaging

            opened = np.concatenate([thrust_n, -thrust_n]).clip(0.0) / scenario.max_force_n
            on_times = messaging.THRArrayOnTimeCmdMsgPayload()
            on_times.OnTimeRequest = (scenario.dt_s * opened).tolist()
            simulation.valves.write(on_times, self.tick * scenario.dt_ns)
        if scenario.dynamics is None:
            simulation.force.extForce_B = [[component] for component in force_n.tolist()]
        else:
            # The mean of a force that turns with LVLH for the next tick.
            axes, rate = self._world.frame(_state(simulation.target))
            begin, angle = axes @ force_n, scenario.dt_s * rate
            turned = begin + cross(angle, begin) / 2.0 + cross(angle, cross(angle, begin)) / 6.0
            simulation.force.extForce_N = turned[:, None].tolist()
        self.tick += 1
        simulation.model.ConfigureStopTime(self.tick * scenario.dt_ns)
        simulation.model.ExecuteSimulation()
        target = _state(simulation.target)
        self.state = self._world.to_lvlh(target, _state(simulation.chaser) - target)
        return self.state


def attitude_by_basilisk(scenario: Scenario) -> Floats:
    """Return the matrix (3, 3) from the target's axes to inertial ones at the end."""
    from Basilisk.simulation import spacecraft
    from Basilisk.utilities import RigidBodyKinematics, SimulationBaseClass

    model, made = SimulationBaseClass.SimBaseClass(), spacecraft.Spacecraft()
    target = scenario.target
    model.CreateNewProcess('truth').addTask(model.CreateNewTask('attitude', scenario.dt_ns))
    *axis, w = target.attitude
    made.hub.mHub, made.hub.IHubPntBc_B = 1.0, [list(row) for row in target.inertia_kg_m2]
    made.hub.sigma_BNInit = [[x / (1.0 + w)] for x in axis]  # modified Rodrigues parameters
    made.hub.omega_BN_BInit = [[rate] for rate in target.rates_rad_s]
    model.AddModelToTask('attitude', made)
    model.InitializeSimulation()
    model.ConfigureStopTime(scenario.ticks * scenario.dt_ns)
    model.ExecuteSimulation()
    return np.asarray(RigidBodyKinematics.MRP2C(made.scStateOutMsg.read().sigma_BN)).T


def by_basilisk(scenario: Scenario, forces_n: Floats, masses_kg: Floats) -> Floats:
    """Return the states (N + 1, 6) under forces (N, 3).

    Where the mass falls, the forces grow, and the spacecraft stays: gravity does not mind.
    """
    flight = BasiliskFlight(scenario)
    applied = forces_n * (scenario.mass_kg / masses_kg)[:, None]
    return np.array([flight.state, *(flight.step(force) for force in applied)])
