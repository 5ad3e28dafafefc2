# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The node `plant` with Basilisk as its dynamics (layer `truth`), in lockstep, one step a tick.

python docs/foreign/basilisk_plant.py --ros-args -p scenario:=paper_test -p wait_for_recorder:=true

Target and chaser are two of its spacecraft under its gravity; all else is the plant of `rpo_sim`:
thrusters, topics, services. With `--thrusters`, Basilisk's exert the force, by pulses. Verify such
a run with `rpo verify RUN --given relative_state`.
"""

from __future__ import annotations

import argparse
import sys
from importlib.util import find_spec
from typing import Any

import numpy as np
from rclpy.utilities import remove_ros_args

from rpo.analysis.basilisk import BasiliskFlight, knows
from rpo_core.files.validation import InputError
from rpo_core.scenario.scenario import Scenario
from rpo_core.stage import Place, Signal, Stage
from rpo_core.wire.interfaces import RELATIVE_STATE
from rpo_ros.plant_scenario import LOCKSTEP
from rpo_sim.plant_node import PlantNode


class BasiliskStage(Stage):
    """From forces to the next true state: in the place of the dynamics of a chain."""

    name = 'dynamics'
    outputs = (RELATIVE_STATE,)
    memory_ticks = None

    def __init__(self, scenario: Scenario, thrusters: bool) -> None:
        self.flight, self.start_kg = BasiliskFlight(scenario, thrusters), scenario.mass_kg
        self.thrusters = thrusters

    def step(self, tick: int, *inputs: Any) -> tuple[Signal, ...]:
        """Return the state (6,) [m, m/s] one tick later; where the mass falls, forces grow."""
        _state, thrust, disturbance, *mass = inputs
        forces = (disturbance, thrust) if self.thrusters else (np.add(thrust, disturbance),)
        if tick < self.flight.scenario.ticks:  # the command of the last tick moves nothing
            self.flight.step(*np.array(forces) * (self.start_kg / mass[0][0] if mass else 1.0))
        return (tuple(self.flight.state.tolist()),)


class BasiliskPlant(PlantNode):
    """The plant of `rpo_sim` with other dynamics; raises InputError where it cannot fly."""

    thrusters = False

    def _begin_run(self) -> None:
        """Wait at tick 0 of a new run, with new spacecraft."""
        if find_spec('Basilisk') is None:
            raise InputError('Basilisk is missing: `make setup LAYERS=truth` installs it')
        if self.values['mode'] != LOCKSTEP or not knows(self.scenario):
            raise InputError('Basilisk flies in lockstep, and without drag')
        if self.thrusters and self.scenario.dynamics is not None:
            raise InputError('the thrusters of Basilisk fly without a section `dynamics`')
        super()._begin_run()
        stage = BasiliskStage(self.scenario, self.thrusters)
        self.plant.chain.links = tuple(
            link._replace(stage=stage) if link.place is Place.DYNAMICS else link
            for link in self.plant.chain.links
        )


def main() -> int:
    """Entry point."""
    parser = argparse.ArgumentParser(prog='basilisk_plant', description=__doc__)
    parser.add_argument('--thrusters', action='store_true', help="Basilisk's exert the force")
    BasiliskPlant.thrusters = parser.parse_args(remove_ros_args(sys.argv)[1:]).thrusters
    return BasiliskPlant.main()


if __name__ == '__main__':
    raise SystemExit(main())
