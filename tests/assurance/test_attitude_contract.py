# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The contract between attitude and translation: docs/safety.md, lemma 6."""

from __future__ import annotations

from dataclasses import replace
from math import radians, sin, sqrt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from rpo_core.assurance.abort_table import AbortTable, Row
from rpo_core.assurance.assumed import errors_of, limit_n
from rpo_core.assurance.guard import guard_of, proof_of
from rpo_core.assurance.settings import Assurance
from rpo_core.attitude.chaser import Chaser, Wheels
from rpo_core.attitude.pointing import Pointing
from rpo_core.chain.chain import Chain
from rpo_core.chain.flight import start_of
from rpo_core.control.attitude import AttitudeControl
from rpo_core.control.attitude_limits import AttitudeLimits
from rpo_core.control.controller import load_controller
from rpo_core.files.validation import InputError
from rpo_core.scenario import overrides, scenario
from rpo_core.stage import Place
from rpo_core.thrusters.table import ThrusterTable, known_authority
from rpo_core.thrusters.thrusters import Thrusters

ASSURED = replace(scenario.load_scenario('assured'), max_force_n=1.0)
INERTIA = ((0.6, 0.02, 0.0), (0.02, 0.7, 0.01), (0.0, 0.01, 0.5))
CHASER = Chaser(inertia_kg_m2=INERTIA, wheels=Wheels(torque_nm=0.05, momentum_nms=1.0))

STEERED = AttitudeControl(controller='attitude_pd')


def turning(*more, **fields):
    """Return the scenario with a chaser that turns, and changed fields of `assurance`."""
    own = replace(ASSURED.section(Assurance), **fields)
    return ASSURED.equipped(*{type(s): s for s in (CHASER, STEERED, own, *more)}.values())


def test_the_proof_counts_the_turned_force_and_the_ball():
    found = turning(chaser_attitude_error_deg=2.9, thrust_error=0.05)
    errors = errors_of(found.section(Assurance), found)
    assert errors.thrust == pytest.approx(0.05 + 2.0 * sin(radians(1.45)))
    assert limit_n(found) == pytest.approx(found.max_force_n / sqrt(3.0))
    guard = guard_of(found.section(Assurance), found)
    assert guard.limit_n == limit_n(found)
    synchronised = guard_of(ASSURED.section(Assurance), ASSURED)
    assert guard.authority_m_s2 < synchronised.authority_m_s2 / sqrt(3.0)


def test_a_table_has_its_ball_beside_the_torque_that_keeps_limits_of_the_attitude():
    """The table gives the force first: at all of it the limits of the torque would hold nothing."""
    table = ThrusterTable(preset='pairs_12', force_n=0.6, arm_m=0.3)
    own = {'chaser_attitude_error_deg': 2.0, 'thrust_error': 0.1}
    found = turning(Thrusters(table=table), **own)
    assert limit_n(found) == pytest.approx(min(known_authority(table).least_n, 1.0) / sqrt(3.0))
    control = replace(STEERED, limit_nm=0.1, limits=AttitudeLimits(rate_deg_s=2.0))
    found = turning(Thrusters(table=table), replace(CHASER, wheels=None), control, **own)
    least = known_authority(table, 0.1).least_n
    assert 0.0 < least < 0.9 * min(known_authority(table).least_n, found.max_force_n)
    assert limit_n(found) == pytest.approx(least / sqrt(3.0))


LOOSE = turning(chaser_attitude_error_deg=2.0)


@given(st.integers(0, 2**32 - 1), st.floats(0.0, 20.0), st.floats(0.0, 0.2), st.booleans())
def test_a_force_in_the_wrong_axes_is_off_by_the_sum(seed, degrees, share, in_target):
    """Against SciPy: never saturated, never farther from the command than lemma 6 says."""
    random = np.random.default_rng(seed)
    settings = replace(LOOSE.section(Assurance), chaser_attitude_error_deg=degrees)
    errors = errors_of(replace(settings, thrust_error=None), LOOSE)
    force = random.uniform(-1.0, 1.0, 3)
    force *= limit_n(LOOSE) / np.abs(force).max()  # at the edge of the cube, to its corners
    if in_target:
        force = Rotation.random(random_state=seed).apply(force)
    known_as = Rotation.random(random_state=seed + 1)
    axis = random.normal(size=3)
    true = known_as * Rotation.from_rotvec(axis / np.linalg.norm(axis) * radians(degrees))
    body = known_as.inv().apply(force)
    assert np.abs(body).max() <= LOOSE.max_force_n * (1.0 + 1e-12)
    off = random.normal(size=(3, 3))
    off *= share / np.linalg.norm(off)
    exerted = true.apply(body + off @ body)
    size = np.linalg.norm(force)
    bound = share + errors.thrust
    assert np.linalg.norm(exerted - force) <= bound * size * (1.0 + 1e-9) + 1e-15


def test_the_turn_of_a_tick_is_counted():
    """Half a tick at 2 deg/s about each axis, the error, and what torque does in its delay."""
    limits = AttitudeLimits(rate_deg_s=2.0, known_deg=0.1)
    control = replace(STEERED, limits=limits)
    with pytest.raises(InputError, match=r'must be at least 0\.463337, which'):
        turning(control, chaser_attitude_error_deg=0.46)
    assert turning(control, chaser_attitude_error_deg=0.47)


@pytest.mark.parametrize(('most', 'states'), [(4.0, ['holding']), (25.0, [])])
def test_a_chaser_that_points_elsewhere_holds(most, states):
    """It turns, and the reference does not: the table allows it that, or not."""
    row = Row(quantity='pointing_error_deg', most=most, count=2, window=3, reaction='hold')
    chaser, looking = replace(CHASER, rates_deg_s=(9.0, 0.0, 0.0)), Pointing(align_within_m=60.0)
    own = {'chaser_attitude_error_deg': 2.0, 'abort': AbortTable(table=(row,))}
    found = turning(chaser, looking, **own)
    chain, signals = Chain.of(found, load_controller('pd')), start_of(found)
    chain.reset()
    for tick in range(30):
        chain.step(tick, signals)
    stage = next(x.stage for x in chain.links if x.place is Place.ASSURANCE)
    assert [change.state for change in stage.abort.changes] == states
    with pytest.raises(InputError, match='needs section `pointing`'):
        turning(**own)


def test_all_corners_of_a_turning_corridor_are_in_the_ball():
    port = overrides.load('tumbling_port', ['max_force_n=1.0', 'thrusters.table.force_n=0.34'])
    own = replace(port.section(Assurance), chaser_attitude_error_deg=2.0)
    found = port.equipped(CHASER, STEERED, own)
    proof = proof_of(own, found)
    assert proof.walls is not None
    assert proof.walls.limit_n * sqrt(3.0) <= known_authority(found.thrusters.table).least_n
    assert proof.walls.limit_n == pytest.approx(proof.guard.limit_n)


def test_limits_of_a_torque_without_an_attitude_are_refused_in_words():
    """Sections of other scenarios, mixed: it was an AttributeError of assurance."""
    docking = scenario.load_scenario('tumbling_docking')
    kept = tuple(map(docking.named, ('thrusters', 'assurance', 'attitude_control')))
    with pytest.raises(InputError, match='needs section `attitude`'):
        replace(docking, sections=kept, requirements=None)
