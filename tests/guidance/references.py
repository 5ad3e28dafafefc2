# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Plans that are followed exactly, and the chaser of the tests of legs."""

from __future__ import annotations

from types import MappingProxyType

import numpy as np

from rpo_core.guidance.guidance import Guidance, GuidanceStage
from rpo_core.guidance.legs import Vehicle
from rpo_core.world import cw

N_RAD_S = cw.mean_motion(6_678_000.0)
VEHICLE = Vehicle(N_RAD_S, 10.0, 0.1, 0.3, cw.discretise(N_RAD_S, 10.0, 0.1))


def stage_of(scenario):
    return GuidanceStage(scenario.section(Guidance), scenario)


def follow(scenario, until, commands=MappingProxyType({})):
    """Fly the reference exactly up to a tick, with a command at some.

    Return the stage and its references (until, 6).
    """
    stage, state, references = stage_of(scenario), scenario.start, []
    for tick in range(until):
        if tick in commands:
            assert not stage.command(commands[tick])
        state = stage.step(tick, state)[0]
        references.append(state)
    return stage, np.array(references)


def assert_bits_of_the_stage(settings, scenario):
    """Assert that table and stage give the same bits; return when the last leg begins."""
    rows = GuidanceStage(settings, scenario).rows(scenario.start, scenario.ticks)
    phases = GuidanceStage(settings, scenario).phases(scenario.start, scenario.ticks)
    last = next(tick for tick, _, _, is_last in phases if is_last)
    stage = GuidanceStage(settings, scenario)
    stepped = [stage.step(tick, scenario.start) for tick in range(scenario.ticks + 1)]
    np.testing.assert_array_equal(rows, [(*r, *f) for r, f in stepped])
    starts = {change.phase: change.tick for change in stage.changes}
    assert last == starts[settings.legs[-1].name]
    return last, rows
