# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Runtime assurance as a node: the flight is that of the core, logged and verified."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from flights import assert_flown

from rpo_core.chain.flight import fly
from rpo_core.control.controller import load_controller
from rpo_core.files import scenario
from rpo_core.judge import metrics
from rpo_mcap.read.run_log import flight_of, read_run
from rpo_safety.assurance import ASSURANCE_STATUS, ASSURED_FORCE
from rpo_safety.assurance_node import AssuranceNode
from rpo_safety.settings import Assurance
from rpo_sim.disturbance_injector_node import DisturbanceInjectorNode


def test_a_controller_that_wants_the_target_is_stopped_recorded_and_verified(inner, tmp_path):
    found = scenario.load_scenario('paper_test').equipped(Assurance(keep_out_m=66.0))
    found = replace(found, duration_s=20.0)
    path = tmp_path / 'zone.yaml'
    path.write_text(scenario.dumps(found))
    others = (AssuranceNode, DisturbanceInjectorNode)
    inner.fly(tmp_path / 'run', str(path), *others, controller='allround')
    assert inner.ends() == 0
    log, flight = read_run(tmp_path / 'run'), fly(found, load_controller('allround'))
    assert_flown(tmp_path / 'run', flight, 'assurance')
    assert metrics.of_flight(flight_of(log)) == metrics.of_flight(flight)  # of what was flown
    changed = (log.values[ASSURED_FORCE] != flight.forces_n).any(axis=1)
    assert changed.any()
    events = [event for event in log.events if event.signal == ASSURANCE_STATUS]
    first = events[0].values
    assert first['constraint'] == 'keep_out'
    assert int(first['tick']) == np.flatnonzero(changed)[0]
    assert float(first['after_n.y']) == log.values[ASSURED_FORCE][int(first['tick']), 1]


@pytest.mark.every_landing
def test_the_covariance_of_an_estimate_reaches_assurance(together, tmp_path):
    """It travels in `navigation_state`; where it is large, the node decides as the core does."""
    sure = Assurance(
        keep_out_m=15.0,
        position_error_m=0.5,
        velocity_error_m_s=0.02,
        disturbance_n=0.02,
        thrust_error=0.1,
        sigmas=4.0,
    )
    found = replace(scenario.load_scenario('world_leo').equipped(sure), duration_s=5.0)
    path = tmp_path / 'world.yaml'
    path.write_text(scenario.dumps(found))
    run, flight = together(path, '--controller', 'pd'), fly(found, load_controller('pd'))
    assert_flown(run, flight, 'assurance')
    assured = read_run(run).values[ASSURED_FORCE]
    assert (assured != flight.forces_n).any(axis=1)[:2].all()  # the first estimates are poor
