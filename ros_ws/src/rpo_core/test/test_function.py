# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A flight as one function, and the files that ship."""

import numpy as np
import pytest

from rpo_core.chain.flight import OpenLoop, fly
from rpo_core.control.controller import load_controller
from rpo_core.files import shipped
from rpo_core.scenario import scenario


def test_without_a_force_the_chaser_drifts():
    """It stays more than 1 m from the target; its commands are zero."""
    flight = fly(scenario.load_scenario('approach'), OpenLoop(np.zeros((0, 3))))
    assert flight.states.shape == (4001, 6)
    assert np.linalg.norm(flight.positions_m, axis=1).min() > 1.0
    assert not flight.forces_n.any()


@pytest.mark.parametrize('name', shipped('scenario'))
def test_a_shipped_file_is_a_scenario(name):
    """It is one without an error, and has the name of its file."""
    assert scenario.load(name).name == name


@pytest.mark.parametrize('name', shipped('controller'))
def test_a_shipped_file_is_a_controller(name):
    """It is one without an error, and has the name of its file."""
    assert load_controller(name).name == name


def test_they_are_here():
    """The paper's test, the default and the paper's own controller are among them."""
    assert {'paper_test', 'quick'} <= set(shipped('scenario'))
    assert {'allround', 'paper_ga'} <= set(shipped('controller'))
