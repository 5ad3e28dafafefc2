# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Assurance behind an estimator: a growing covariance shrinks the set, and the table sees it."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from rpo_core.chain.chain import Chain
from rpo_core.chain.stage import Place
from rpo_core.control.controller import load_controller
from rpo_core.files import scenario
from rpo_core.wire.interfaces import NAVIGATION_COVARIANCE, RELATIVE_STATE
from rpo_nav.sensors import Sensors
from rpo_safety.abort_table import AbortTable, Row
from rpo_safety.assurance import AssuranceStage
from rpo_safety.filters import margins
from rpo_safety.guard import grown
from rpo_safety.kernels import OPEN
from rpo_safety.settings import Assurance

WORLD = scenario.load_scenario('world_leo')
SETTINGS = Assurance(
    keep_out_m=15.0,
    position_error_m=0.5,
    velocity_error_m_s=0.02,
    disturbance_n=0.02,
    thrust_error=0.1,
    sigmas=4.0,
)
ASSURED = WORLD.equipped(SETTINGS)
STATE = (0.0, 22.0, 0.0, 0.0, -0.25, 0.0)


def blind(outages, settings=SETTINGS):
    """Return the world with a lidar that is silent for some times."""
    sensors = WORLD.section(Sensors)
    units = tuple(replace(unit, outages_s=outages) for unit in sensors.units)
    return WORLD.equipped(replace(sensors, units=units), settings)


def fly(chosen, ticks=4000):
    """Fly `pd`, which wants the target; return the stage and the true ranges."""
    chain = Chain.of(chosen, load_controller('pd'))
    stage = next(link.stage for link in chain.links if link.place is Place.ASSURANCE)
    signals, ranges, acted = {RELATIVE_STATE: chosen.start}, [], []
    for tick in range(ticks):
        ranges.append(float(np.linalg.norm(signals[RELATIVE_STATE][:3])))
        chain.step(tick, signals)
        acted.append(stage.decision.constraint)
    return stage, np.array(ranges), acted


def covariance(sigma_m, sigma_m_s):
    """Return covariances (18,) whose traces have these roots."""
    three = np.eye(3).ravel() / 3.0
    return (*(sigma_m**2 * three).tolist(), *(sigma_m_s**2 * three).tolist())


def test_the_stage_reads_the_covariance():
    stage = AssuranceStage(SETTINGS, ASSURED)
    assert stage.inputs[-1] == NAVIGATION_COVARIANCE


def test_a_worse_estimate_never_has_more_room():
    proofs = grown(SETTINGS, ASSURED)
    assert len(proofs) > 5
    for before, after in pairwise(proofs):
        assert after.errors.position_m == pytest.approx(1.25 * before.errors.position_m)
        room = [
            margins(STATE, OPEN, p.guard.next_m, p.guard.next_m_s, p.guard) for p in (before, after)
        ]
        assert room[1][0] < room[0][0] and room[1][1] < room[0][1]


def test_the_same_command_passes_with_a_good_estimate_and_not_with_a_bad_one():
    stage = AssuranceStage(SETTINGS, ASSURED)
    seen = []
    for sigma in (0.01, 0.125, 0.2, 0.4, 0.9, 5.0):
        stage.step(0, STATE, (0.0, -0.1, 0.0), covariance(sigma, 0.001))
        seen.append(stage.decision.constraint)
    assert seen[:2] == ['', ''] and 'keep_out' in seen
    first = seen.index('keep_out')
    assert all(seen[first:])
    assert stage.trouble().startswith('the covariance of the estimate is larger')
    # four sigmas are the error that the section names: nothing changes up to there
    stage.step(0, STATE, (0.0, -0.1, 0.0), covariance(0.125, 0.005))
    assert stage.guard == grown(SETTINGS, ASSURED)[0].guard and stage.trouble() == ''


def test_with_measurements_the_zone_is_kept():
    _, ranges, acted = fly(blind(()))
    assert ranges.min() >= 15.0
    assert ranges[-1] < 20.0 and 'keep_out' in acted


def test_without_measurements_the_table_leaves_in_time():
    """The lidar falls silent at 40 s. The filter alone stops, blind; the table aborts."""
    row = Row(quantity='sigma_m', most=0.6, count=5, window=5, reaction='abort')
    settings = replace(SETTINGS, abort=AbortTable(table=(row,), armed=False))
    dark = ((40.0, 400.0),)
    stage, _, acted = fly(blind(dark, settings), 1000)
    assert [change.state for change in stage.abort.changes][-1] == 'warned'
    assert acted[-1] == 'covariance' and stage.trouble()
    found = blind(dark, replace(SETTINGS, abort=AbortTable(table=(row,))))
    stage, ranges, _ = fly(found)
    assert stage.abort.changes[0].state == 'aborting'
    assert ranges.min() > 15.0
