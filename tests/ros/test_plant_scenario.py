# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The scenario of a plant does not change while it is there, nor within its run."""

import pytest

from rpo_core import files
from rpo_core.wire.statuses import Manifest
from rpo_ros import plant_scenario
from rpo_ros.plant_scenario import PlantScenario

QUICK, DOCKING = (files.read_text(files.find('scenario', n)) for n in ('quick', 'docking'))


def manifest(run: str, text: str, mode: str = 'lockstep') -> Manifest:
    values = {plant_scenario.SCENARIO_FILE: text, 'parameter.mode': mode}
    return Manifest('plant', 'plant', run, values)


@pytest.mark.parametrize('silent_s', [0.0, 10.0])
@pytest.mark.parametrize(
    'forged',
    [manifest('one', QUICK, 'free_running'), manifest('one', DOCKING), manifest('one', QUICK, '')],
)
def test_within_a_run_nothing_changes(forged, silent_s, monkeypatch):
    now, taken, refused = [100.0], [], []
    monkeypatch.setattr(plant_scenario, 'hear', lambda *_: None)
    monkeypatch.setattr(plant_scenario.time, 'monotonic', lambda: now[0])
    heard = PlantScenario(None, '', taken.append, refused.append)
    heard._on_manifest(manifest('one', QUICK))
    assert [found.name for found in taken] == ['quick'] and not heard.free_running
    now[0] += silent_s
    heard._on_manifest(forged)
    heard._on_manifest(manifest('one', QUICK))
    assert len(taken) == 1 and not heard.free_running and not refused


def test_another_plant_is_followed_once_the_first_is_silent(monkeypatch):
    now, taken = [100.0], []
    monkeypatch.setattr(plant_scenario, 'hear', lambda *_: None)
    monkeypatch.setattr(plant_scenario.time, 'monotonic', lambda: now[0])
    heard = PlantScenario(None, '', taken.append, print)
    for silent_s, found in ((0.0, manifest('one', QUICK)), (1.0, manifest('two', DOCKING)),
                            (1.0, manifest('two', QUICK, 'free_running'))):  # fmt: skip
        now[0] += silent_s
        heard._on_manifest(found)
    assert [found.name for found in taken] == ['quick'] and not heard.free_running
    now[0] += 10.0
    heard._on_manifest(manifest('two', DOCKING))
    assert [found.name for found in taken] == ['quick', 'docking']
