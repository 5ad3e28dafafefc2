# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Shipped flights in six degrees of freedom keep what they require."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from rpo.training.scaling import scaled_to
from rpo_core.chain.flight import fly
from rpo_core.control.controller import load_controller
from rpo_core.judge import similarity
from rpo_core.judge.similarity import Units
from rpo_core.judge.verdicts import verdicts
from rpo_core.scenario.scenario import load_scenario

APOLLO = load_scenario('apollo')


def test_apollo_turns_around_and_docks():
    """By the controller of `rpo scale pd --scenario apollo`."""
    pd = load_controller('pd')
    _, _, own, _ = similarity.made_for(pd)
    flight = fly(APOLLO, scaled_to(pd, own, Units(95.52, 215.2, APOLLO.mass_kg), APOLLO))
    found = verdicts(flight)
    assert len(found) == 6 and all(verdict.holds for verdict in found), found
    noses = Rotation.from_quat(flight.signals['chaser_attitude'][:, :4]).apply([1.0, 0.0, 0.0])
    assert noses[0, 0] > 0.98 and noses[-1, 0] < -0.999, 'it looked away, and turned around'


def test_its_thrusters_are_where_they_are():
    """Four quads 83.56 in from the axis of the hull; canted by 10 deg away from it."""
    each = APOLLO.thrusters.table.each
    hull = np.array([0.0, -5.0, -4.7]) * 0.0254
    out = np.array([t.position_m for t in each]) - hull
    out[:, 0] = 0.0
    sizes = np.linalg.norm(out, axis=1)
    np.testing.assert_allclose(sizes, 83.56 * 0.0254, rtol=1e-3)
    inward = -(out * [t.direction for t in each]).sum(axis=1) / sizes
    np.testing.assert_allclose(np.degrees(np.arcsin(inward)), 10.0, atol=2.2)


def test_the_docked_attitude_brings_the_ports_together():
    """The port of the chaser, 176.35 in ahead of its centre of mass, lies at that of the target."""
    port = np.array([176.35, -5.0, -4.7]) * 0.0254
    docked = Rotation.from_quat(APOLLO.named('pointing').mate).apply(port)
    np.testing.assert_allclose(docked + APOLLO.goal_position_m, 0.0, atol=1e-3)
