# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The parameters of the nodes, without ROS."""

import pytest

from rpo_ctrl import commands
from rpo_ros.parameter_rows import tables

NODES = [name for name in vars(commands) if name in tables('rpo_ctrl')]


@pytest.mark.parametrize('node', NODES)
def test_a_node_has_a_table_of_parameters(node):
    """Each row says what it is for."""
    assert all(row.description for row in tables('rpo_ctrl')[node])


def test_they_are_here():
    """The controller and the stages around it are among them."""
    assert {'fuzzy_controller', 'navigation', 'guidance', 'assurance'} <= set(NODES)
