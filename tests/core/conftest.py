# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What the tests of the core share: shipped files, flights, and how hard hypothesis looks."""

from __future__ import annotations

import pytest
from hypothesis import HealthCheck, settings

from rpo_core.scenario.scenario import Scenario, load_scenario

# Derandomised: the same examples on every run, so that a failure is a change of ours.
settings.register_profile(
    'quick',
    max_examples=25,
    deadline=None,
    derandomize=True,
    database=None,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.filter_too_much],
)
settings.load_profile('quick')


@pytest.fixture(scope='session')
def paper_test() -> Scenario:
    return load_scenario('paper_test')
