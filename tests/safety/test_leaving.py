# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""From where an abort is clear, as `rpo safety abort` counts it."""

from __future__ import annotations

import numpy as np
import pytest

from rpo_core.control.controller import load_controller
from rpo_core.files import overrides, scenario
from rpo_core.files.validation import InputError
from rpo_judge.safety import counts

GUARDED = scenario.load_scenario('guarded')


def test_each_state_outside_is_counted_once_in_its_band():
    machine = counts.machine_of(GUARDED)
    plan = counts.of_flight(GUARDED, load_controller('allround'))[::5]
    outside = [s for s in plan if np.linalg.norm(s[:3]) > 10.0]
    found = counts.bands(machine, plan)
    assert sum(band.states for band in found) == len(outside)
    assert [band.clear for band in found][2:] == [band.states for band in found][2:]
    assert all(band.clear <= band.states for band in found)
    far = counts.bands(machine, counts.at_random(machine, 36, 3))
    assert [band.states for band in far] == [6] * 6
    assert far[-1].clear == 6


@pytest.mark.every_landing
def test_a_longer_failure_is_harder_to_leave_from():
    states = counts.at_random(counts.machine_of(GUARDED), 60, 4)
    worst = []
    for seconds in ('0', '5', '30'):
        machine = counts.machine_of(
            overrides.load('guarded', [f'assurance.abort.stuck_s={seconds}'])
        )
        worst.append(min(band.margin_m for band in counts.bands(machine, states)))
    assert worst[0] >= worst[1] > worst[2], worst


def test_a_scenario_without_a_table_is_refused():
    with pytest.raises(InputError, match=r'around must have `assurance\.abort` and'):
        counts.machine_of(scenario.load_scenario('around'))
