# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of the node `plant`."""

from __future__ import annotations

from rpo_ros.parameters import Row

LOCKSTEP, FREE_RUNNING = 'lockstep', 'free_running'
MODES = (LOCKSTEP, FREE_RUNNING)

PARAMETERS = (
    Row('scenario', 'approach', 'shipped scenario, or path of a scenario file',
        example='paper_test'),
    Row('mode', LOCKSTEP, 'wait for every answer, or keep the wall clock and hold the last force',
        choices=MODES),
    Row('on_peer_timeout', 'abort', 'when a peer stops answering: end the run or fly on without it '
        '(lockstep)', choices=('abort', 'coast')),
    Row('stale_after_ticks', 10, 'a force that answers an older state than that counts as zero '
        '(free running)', most=1_000_000),
    Row('real_time_factor', 0.0, 'simulated seconds per second; 0: as fast as it goes in lockstep, '
        '1 in free running', most=1e6, wall=True, changeable=True),
    Row('step_ticks', 1, 'ticks that pass for a call of ~/step', least=1, most=1_000_000, wall=True,
        changeable=True),
    Row('resend_after_s', 0.25, 'wall time without an answer before a state is sent again', 's',
        least=1e-3, wall=True),
    Row('peer_timeout_s', 10.0, 'wall time without an answer before a peer is lost (lockstep)', 's',
        least=1e-2, wall=True),
    Row('start_timeout_s', 0.0, 'wall time to wait for peers before tick 0; 0: for ever', 's',
        wall=True),
    Row('wait_for_recorder', False, 'insist on a recorder before tick 0; one in sight is waited '
        'for anyway', wall=True),
    Row('publish_clock', True, 'publish /clock'),
)  # fmt: skip
