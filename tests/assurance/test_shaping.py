# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The section `shaping`: slew limit and dead zone, in flights and before runtime assurance."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from rpo.training.config import load_start
from rpo_core.assurance.settings import Assurance
from rpo_core.assurance.shaping import Shaping, ShapingStage
from rpo_core.chain.flight import fly
from rpo_core.control.controller import load_controller
from rpo_core.judge.metrics import LATE_POSITION, SLEW, row_of
from rpo_core.navigation.sensors import Navigation
from rpo_core.scenario import scenario
from rpo_core.wire.interfaces import ASSURED_FORCE, SHAPED_FORCE

PAPER = scenario.load_scenario('paper_test')
NOISY = PAPER.equipped(Navigation(position_noise_m=0.01, velocity_noise_m_s=5e-4))
forces = st.floats(-1.0, 1.0)


@given(st.lists(st.tuples(forces, forces, forces), min_size=1, max_size=30), st.floats(0.01, 5.0))
def test_a_command_changes_by_the_limit_at_most_and_goes_where_it_was_wanted(commands, slew_n_s):
    stage = ShapingStage(Shaping(slew_n_s, dead_zone_n=0.05), PAPER)
    wanted = np.clip(commands, -0.5, 0.5)
    wanted[np.abs(wanted) <= 0.05] = 0.0
    found = np.array([stage.step(tick, command)[0] for tick, command in enumerate(commands)])
    np.testing.assert_array_equal(found[0], wanted[0])
    step = 0.1 * slew_n_s
    np.testing.assert_allclose(
        found[1:], np.clip(wanted[1:], found[:-1] - step, found[:-1] + step), rtol=0, atol=1e-15
    )
    stage.reset()
    assert stage.step(0, commands[-1])[0] == tuple(wanted[-1].tolist())


def test_it_keeps_the_slew_of_the_paper_under_noise():
    """White noise of navigation alone breaks the limit; the flight arrives all the same."""
    controller = load_controller('allround')
    raw = row_of(fly(NOISY, controller))
    shaped = row_of(fly(NOISY.equipped(Shaping(0.09)), controller))
    assert raw[SLEW] > 0.15
    assert shaped[SLEW] <= 0.0900000001
    assert shaped[LATE_POSITION] < 0.5


def test_assurance_has_the_last_word():
    """What is shaped reaches assurance; its zone is kept though the command cannot turn fast."""
    zone = PAPER.equipped(Shaping(0.02)).equipped(Assurance(keep_out_m=10.0))
    flight = fly(zone, load_start('trained'))
    shaped, sent = flight.signals[SHAPED_FORCE], flight.signals[ASSURED_FORCE]
    assert np.abs(np.diff(shaped, axis=0)).max() <= 0.002 + 1e-15
    assert (shaped != sent).any(), 'assurance never acted'
    assert np.linalg.norm(flight.positions_m, axis=1).min() >= 10.0
