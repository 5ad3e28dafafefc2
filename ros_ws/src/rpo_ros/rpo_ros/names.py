# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Names of topics beside those of the table of interfaces: absolute ones, and the viewers'."""

from rpo_core.wire import interfaces

# Not from the table: it loads the rooms, and with them NumPy, which a `--help` does not wait for.
CLOCK, DIAGNOSTICS = f'/{interfaces.CLOCK}', f'/{interfaces.DIAGNOSTICS}'
MARKERS = 'markers'
CHASER_POSE = 'chaser_pose'
TF = '/tf'
