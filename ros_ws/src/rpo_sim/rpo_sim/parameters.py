# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of the nodes of this package, one table for each."""

from __future__ import annotations

from rpo_core.world.link import CORRUPTIONS
from rpo_ros import names
from rpo_ros.parameter_rows import AUTOSTART, SCENARIO
from rpo_ros.parameter_rows import ParameterRow as Row

LOCKSTEP, FREE_RUNNING = 'lockstep', 'free_running'
MODES = (LOCKSTEP, FREE_RUNNING)
ANY, AUTO, STATE, FORCE = 'any', 'auto', 'state', 'force'
LAST_TICK = 1_000_000_000

PLANT = (
    Row('scenario', 'approach', 'shipped scenario, or path of a scenario file',
        example='paper_test'),
    Row('mode', LOCKSTEP, 'wait for every answer, or follow the wall clock and hold the last force',
        choices=MODES),
    Row('on_peer_timeout', 'abort', 'when a peer stops answering: end the run, or go on without it '
        '(lockstep)', choices=('abort', 'coast')),
    Row('stale_after_ticks', 10, 'a force older than so many ticks counts as zero (free running)',
        most=1_000_000),
    Row('real_time_factor', 0.0, 'simulated seconds per second; 0: as fast as it goes in lockstep, '
        '1 in free running', most=1e6, smallest=1e-6, wall=True, changeable=True),
    Row('step_ticks', 1, 'ticks that pass for a call of ~/step', least=1, most=1_000_000, wall=True,
        changeable=True),
    Row('resend_after_s', 0.25, 'wall time without an answer before a state is sent again', 's',
        least=1e-3, wall=True),
    Row('peer_timeout_s', 10.0, 'wall time without an answer before a peer is lost (lockstep)', 's',
        least=1e-2, wall=True),
    Row('start_timeout_s', 0.0, 'wall time to wait for peers before tick 0; 0: for ever', 's',
        wall=True),
    Row('wait_for_recorder', False, 'do not start without a recorder; for one that is there the '
        'plant waits anyway', wall=True),
    Row('publish_clock', True, 'publish /clock'),
    Row('thruster', '', 'switch a thruster of a table from this tick on: its name, then off, on or '
        'ready; `stage_status` has it', wall=True, changeable=True),
)  # fmt: skip

DISTURBANCE_INJECTOR = (SCENARIO, AUTOSTART)

FAULT_INJECTOR = (
    Row('from_topic', f'{names.CONTROL_FORCE}_raw', 'topic to listen to', ros_name=True,
        example='control_force_raw -p drop:=0.2 -p repeat:=0.2'),
    Row('to_topic', names.CONTROL_FORCE, 'topic to send messages to', ros_name=True),
    Row('message', AUTO, 'type of the messages; auto: from the names of the topics',
        choices=(AUTO, STATE, FORCE)),
    Row('seed', 0, 'seed of the random numbers'),
    Row('drop', 0.0, 'share of the messages lost', most=1.0),
    Row('freeze', 0.0, 'share replaced by the message before', most=1.0),
    Row('corrupt', 0.0, 'share corrupted', most=1.0),
    Row('delay', 0.0, 'share sent later', most=1.0),
    Row('reorder', 0.0, 'share sent after the next message', most=1.0),
    Row('repeat', 0.0, 'share sent twice', most=1.0),
    Row('corruption', ANY, 'how a message is corrupted', choices=(ANY, *CORRUPTIONS)),
    Row('delay_messages', 2, 'delay of a delayed message, in messages', least=1),
    Row('delay_s', 0.0, 'wall time of the delay instead; 0: count messages', 's',
        most=60.0),
    Row('from_tick', 0, 'first tick with faults', most=LAST_TICK),
    Row('to_tick', LAST_TICK, 'last tick with faults', most=LAST_TICK),
    SCENARIO,
)  # fmt: skip
