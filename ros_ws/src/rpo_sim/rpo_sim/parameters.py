# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of the nodes of this package, one table for each."""

from __future__ import annotations

from dataclasses import replace

from rpo_core.link import CORRUPTIONS
from rpo_ros import names
from rpo_ros.parameter_rows import SCENARIO
from rpo_ros.parameter_rows import ParameterRow as Row

LOCKSTEP, FREE_RUNNING = 'lockstep', 'free_running'
MODES = (LOCKSTEP, FREE_RUNNING)
ANY, AUTO, STATE, FORCE = 'any', 'auto', 'state', 'force'
LAST_TICK = 1_000_000_000

PLANT = (
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

NAVIGATION = (replace(SCENARIO, example='path/to/mine.yaml'),)

DISTURBANCE_INJECTOR = (SCENARIO,)

FAULT_INJECTOR = (
    Row('from_topic', f'{names.CONTROL_FORCE}_raw', 'topic to listen to',
        example='control_force_raw -p drop:=0.2 -p repeat:=0.2'),
    Row('to_topic', names.CONTROL_FORCE, 'topic to pass messages on to'),
    Row('message', AUTO, 'what the topics carry; auto: told from their names',
        choices=(AUTO, STATE, FORCE)),
    Row('seed', 0, 'of the random numbers'),
    Row('drop', 0.0, 'share of the messages lost', most=1.0),
    Row('freeze', 0.0, 'share replaced by the message passed on before', most=1.0),
    Row('corrupt', 0.0, 'share spoilt', most=1.0),
    Row('delay', 0.0, 'share passed on later', most=1.0),
    Row('reorder', 0.0, 'share passed on after its successor', most=1.0),
    Row('repeat', 0.0, 'share passed on twice', most=1.0),
    Row('corruption', ANY, 'how a message is spoilt', choices=(ANY, *CORRUPTIONS)),
    Row('delay_messages', 2, 'how many messages later a delayed one goes out', least=1),
    Row('delay_s', 0.0, 'wall time that a delayed one is held instead; 0: count messages', 's',
        most=60.0),
    Row('from_tick', 0, 'first tick with faults', most=LAST_TICK),
    Row('to_tick', LAST_TICK, 'last tick with faults', most=LAST_TICK),
    SCENARIO,
)  # fmt: skip
