# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Names of topics: those of the table of interfaces, and those of the viewers."""

from rpo_core.wire import interfaces
from rpo_core.wire.interfaces import (
    APPLIED_DISTURBANCE,
    APPLIED_FORCE,
    CHASER_FRAME,
    CONTROL_FORCE,
    DECISION,
    DISTURBANCE_FORCE,
    LVLH_FRAME,
    NAVIGATION_STATE,
    NODE_MANIFEST,
    PLANT_TICK,
    RECORDER_STATUS,
    RELATIVE_STATE,
    RUN_STATUS,
    STAGE_STATUS,
)

# Not from the table: it loads the rooms, and with them NumPy, which a `--help` does not wait for.
CLOCK, DIAGNOSTICS = f'/{interfaces.CLOCK}', f'/{interfaces.DIAGNOSTICS}'
MARKERS = 'markers'
CHASER_POSE = 'chaser_pose'
TF = '/tf'

__all__ = [
    'APPLIED_DISTURBANCE',
    'APPLIED_FORCE',
    'CHASER_FRAME',
    'CHASER_POSE',
    'CLOCK',
    'CONTROL_FORCE',
    'DECISION',
    'DIAGNOSTICS',
    'DISTURBANCE_FORCE',
    'LVLH_FRAME',
    'MARKERS',
    'NAVIGATION_STATE',
    'NODE_MANIFEST',
    'PLANT_TICK',
    'RECORDER_STATUS',
    'RELATIVE_STATE',
    'RUN_STATUS',
    'STAGE_STATUS',
    'TF',
]
