# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Names of topics beside those of the table of interfaces: absolute ones, and the viewers'."""

from rpo_core.wire import interfaces
from rpo_core.wire.interfaces import CONTROL_FORCE as CONTROL_FORCE
from rpo_core.wire.interfaces import DECISION as DECISION
from rpo_core.wire.interfaces import NODE_MANIFEST as NODE_MANIFEST
from rpo_core.wire.interfaces import RECORDER_STATUS as RECORDER_STATUS
from rpo_core.wire.interfaces import RUN_STATUS as RUN_STATUS

# Not from the table: it loads the rooms, and with them NumPy, which a `--help` does not wait for.
CLOCK, DIAGNOSTICS = f'/{interfaces.CLOCK}', f'/{interfaces.DIAGNOSTICS}'
MARKERS = 'markers'
CHASER_POSE = 'chaser_pose'
TF = '/tf'
