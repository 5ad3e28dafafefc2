# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Thrusters in pulses, without ROS."""

from types import SimpleNamespace

from rpo_thrusters.thrusters import Pulses, Thrusters, stage_of

SCENARIO = SimpleNamespace(max_force_n=0.5, dt_s=0.1, mass_kg=10.0, attitude=None)


def test_the_mean_force_of_pulses_is_the_command():
    """A command of half the thrust opens a valve for half of the tick."""
    pulses = Pulses(count=6, modulation='pulse_width', minimum_on_time_s=0.0)
    stage = stage_of(Thrusters(pulses=pulses), SCENARIO)
    stage.reset()
    _, saturated, force = stage.step(0, (0.25, -1.0, 0.0))
    assert saturated == (0.25, -0.5, 0.0)
    assert force == saturated
