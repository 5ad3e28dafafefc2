# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Node `attitude_controller`: the torque, and the force in the axes of a chaser that turns.

A node of its own: it answers the command that runtime assurance has passed, so it cannot be in the
node of the force controller, which assurance answers.
"""

from __future__ import annotations

from rpo_ros.place_node import PLACES, PlaceNode


class AttitudeControllerNode(PlaceNode):
    """Answers each command with the force in the chaser's axes, and the torque."""

    node_name = 'attitude_controller'
    package = 'rpo_ctrl'
    places = PLACES['rpo_ctrl attitude_controller']
    what = ('steering', 'attitude control')
    off = 'neither force nor torque'


main = AttitudeControllerNode.main
