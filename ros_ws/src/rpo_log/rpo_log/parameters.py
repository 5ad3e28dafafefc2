# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of the nodes of this package, one table for each."""

from __future__ import annotations

from rpo_ros.parameter_rows import ParameterRow as Row

RECORDER = (
    Row('output', '', 'run folder; empty: runs/recording-<date>-<time>', wall=True,
        example='runs/second'),
    Row('overwrite', False, 'replace the run in an existing folder', wall=True),
    Row('sign_key', '', 'Ed25519 private key in PEM, which signs the run folder; empty: not signed',
        wall=True, example='keys/me.pem'),
    Row('split_s', 0.0, 'begin a new file after so much simulated time; 0: one file', 's'),
    Row('split_mb', 0.0, 'begin a new file after so many megabytes; 0: one file', 'MB'),
    Row('grace_s', 3.0, 'wall time to wait for the last messages after the end of a run', 's',
        wall=True),
    Row('plant_timeout_s', 5.0, 'wall time without a message after which the plant is gone; it '
        'publishes once a second even when it is paused', 's', least=2.0, wall=True),
)  # fmt: skip

REPLAY = (
    Row('bag', '', 'run folder, .mcap file or bag', example='runs/first'),
    Row('rate', 1.0, 'simulated seconds per second; 0: as fast as possible', most=1e6,
        smallest=1e-6),
    Row('start_s', 0.0, 'time of the run at which to begin', 's'),
    Row('end_s', 0.0, 'time of the run at which to end; 0: its end', 's'),
    Row('loop', False, 'begin again at the end'),
    Row('paused', False, 'begin paused; ~/pause and ~/step go on'),
    Row('drive', False, 'leave out control_force, wait for a live controller and compare'),
    Row('delay_s', 1.0, 'longest wall time to wait for a subscriber before the first tick', 's'),
    Row('resend_after_s', 0.25, 'wall time without an answer before a state is sent again', 's',
        least=1e-3),
    Row('answer_timeout_s', 10.0, 'wall time without an answer before the replay fails', 's',
        least=1e-2),
)  # fmt: skip
