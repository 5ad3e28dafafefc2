# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Topics (relative, so that two runs live in two namespaces) and frames."""

RELATIVE_STATE = 'relative_state'
NAVIGATION_STATE = 'navigation_state'
CONTROL_FORCE = 'control_force'
DISTURBANCE_FORCE = 'disturbance_force'
APPLIED_FORCE = 'applied_force'
APPLIED_DISTURBANCE = 'applied_disturbance'
RUN_STATUS = 'run_status'
DECISION = 'decision'
NODE_MANIFEST = 'node_manifest'
RECORDER_STATUS = 'recorder_status'
CLOCK = '/clock'
DIAGNOSTICS = '/diagnostics'
MARKERS = 'markers'
CHASER_POSE = 'chaser_pose'
TF = '/tf'

LVLH_FRAME = 'target_lvlh'
"""Target-centred: x R-bar outward, y V-bar along the velocity, z H-bar along angular momentum."""

CHASER_FRAME = 'chaser'
"""Chaser body; its axes are parallel to LVLH, attitude being synchronised."""
