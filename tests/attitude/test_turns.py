# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""How far attitudes are apart, against SciPy's rotations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rpo_attitude.chaser import Chaser
from rpo_attitude.turns import apart, too_fast, turned
from rpo_core.chain.flight import OpenLoop, fly
from rpo_core.files.scenario import load_scenario

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
    found = too_fast(fly(flown, OpenLoop(np.zeros((31, 3)))))
    assert found.startswith(says) and bool(found) == bool(says)
