# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The parts of the pages of the nodes that come neither from parameter tables nor from nodes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from types import ModuleType
from typing import Any

from rpo_core.wire import interfaces
from rpo_ros import names
from rpo_ros.parameter_rows import ParameterRow

Outcomes = tuple[tuple[str, str], ...]
"""Event -> outcome."""

MEANINGS = {
    **{row.topic: row.meaning for row in interfaces.rows()},
    names.MARKERS: 'target, chaser, thrust, trail, zones, estimate, reference',
    names.TF: 'from target LVLH to the chaser, where `tf2_msgs` is installed'
    f' (namespaces: remap it to `{names.TF[1:]}`)',
    names.CHASER_POSE: 'pose of the chaser in target LVLH',
    f'{names.CONTROL_FORCE}_raw': 'messages of the sender, before the faults (`from_topic`)',
    '~/transition_event': 'each change of the lifecycle state',
    '~/change_state': 'lifecycle: configure, activate, deactivate, cleanup, shutdown',
    '~/get_state': 'lifecycle: the present state',
    '~/get_available_states': 'lifecycle',
    '~/get_available_transitions': 'lifecycle: from the present state',
    '~/get_transition_graph': 'lifecycle',
    '~/pause': 'data true: no tick passes; false: continue',
    '~/step': 'while paused, pass some ticks',
    '~/reset': 'end this run and wait at tick 0 of the next',
    '~/abort': 'plant: end the run as aborted; guidance and assurance: leave, and drift away',
    '~/arm': 'let the abort table react again',
    '~/inhibit': 'let the abort table warn only',
    '~/resume': 'end a hold or a retreat of the abort table: the controller has the command',
    '~/drift': 'command no force from now on',
    '~/go': 'end the hold, if its conditions are met',
    '~/hold': 'brake and stay',
    '~/retreat': 'fly to `retreat_m`',
}
"""Topic or service -> what it carries or does."""

_BAD = 'a bad parameter or file'
_BAD_OUTCOME = (_BAD, 'one sentence that names it; exit code 2; no node is started')
_SIGNAL = ('SIGINT or SIGTERM', 'ends in order, exit code 0')
_UNFIT = (
    'a state in another frame, or not finite',
    'gets no answer; counted on `/diagnostics` as `ignored_<kind>`',
)
_OTHER_SCENARIO = (
    '`scenario` is not the scenario of the plant',
    'it answers nothing; one sentence, exit code 2. Before tick 0 the plant aborts; in flight it '
    'warns and flies on',
)
_NOTHING_TO_DO = ('the scenario has no stage for this node', 'says so and ends, exit code 0')
_LAYER = ('its library is not installed', 'one sentence that says how to install it, exit code 2')
_SEEN = (
    names.RELATIVE_STATE,
    names.CONTROL_FORCE,
    names.DISTURBANCE_FORCE,
    names.DECISION,
    names.RUN_STATUS,
)
_CODES = {0: 'done, or ended by a signal', 2: _BAD}


@dataclass(frozen=True)
class Card:
    """A node: its module, its start for the page, its failures.

    cls : name of its class in the module <executable>_node
    trial : parameters for its start by `node_pages`, to find its topics
    also : scenarios of other starts, whose topics it has too
    listens : its topics, for a node that needs an optional layer and is not started
    publishes_tf : it does where `tf2_msgs` is installed, which the ROS 2 wheels lack
    """

    package: str
    executable: str
    cls: str
    failures: Outcomes
    exit_codes: Mapping[int, str] = field(default_factory=lambda: _CODES)
    trial: Mapping[str, Any] = field(default_factory=dict)
    also: tuple[str, ...] = ()
    listens: tuple[str, ...] = ()
    publishes_tf: bool = False

    @property
    def module(self) -> ModuleType:
        """The node's module."""
        return import_module(f'{self.package}.{self.executable}_node')

    @property
    def parameters(self) -> Sequence[ParameterRow]:
        """The node's table of parameters."""
        tables = import_module(f'{self.package}.parameters')
        rows: Sequence[ParameterRow] = getattr(tables, self.executable.upper())
        return rows

    @property
    def command(self) -> str:
        """The command of the node."""
        return f'ros2 run {self.package} {self.executable}'


_CONTROLLER: Outcomes = (
    ('a bad file at start', 'one sentence, exit code 2, no node is started'),
    ('a bad file at `configure`, later', 'one sentence; the node stays unconfigured'),
    ('before its first activation', 'it answers no state; the plant waits'),
    (
        'deactivated, cleaned up',
        'answers every state with zero force, warns, and is `inactive` on `decision` and '
        '`/diagnostics`',
    ),
    ('`controller` set while active', 'refused with a sentence; deactivate first'),
    ('the same state again', 'gets the same answer, whatever was changed in between'),
    ('an error inside the controller', 'logged with its cause; the node deactivates itself'),
    _OTHER_SCENARIO,
    _UNFIT,
    ('shutdown transition', 'ends the process, exit code 0'),
    _SIGNAL,
)

_MANAGED: Outcomes = (
    ('before its first activation', 'it answers no state; the plant waits'),
    ('deactivated, cleaned up', 'answers every tick as if its stages were not in the chain, warns, '
     'and says so on `stage_status` and `/diagnostics`'),
    ('an error inside a stage', 'logged with its cause; the node deactivates itself'),
    ('shutdown transition', 'ends the process, exit code 0'),
)  # fmt: skip

SIX = 'tumbling_docking'
"""The scenario in six degrees of freedom."""

CARDS = (
    Card('rpo_sim', 'plant', 'PlantNode', (
        _BAD_OUTCOME,
        ('a wrong answer: late, early, repeated, foreign stamp, not finite, wrong frame',
         'changes nothing; counted on `/diagnostics`'),
        ('no answer in time (lockstep)', 'the state is sent again every `resend_after_s`; after '
         '`peer_timeout_s` the run is aborted, or goes on with zero force (`on_peer_timeout`)'),
        ('no fresh force (free running)', 'the last one is held for `stale_after_ticks`, then '
         'zero; a warning on `run_status`'),
        ('a peer is missing at the start', 'waits and names it; `start_timeout_s` limits the wait'),
        ('the recorder dies', 'flies on and warns'),
        ('SIGINT or SIGTERM', 'publishes `aborted`, lets the recorder close its log, exit code 0'),
    ), {**_CODES, 0: 'flown to the end, or ended by a signal', 3: 'aborted'},
         {'scenario': 'paper_test', 'mode': 'free_running', 'real_time_factor': 1.0},
         also=(SIX, 'assured', 'paper_test_measured')),
    Card('rpo_nav', 'navigation', 'NavigationNode', (
        _BAD_OUTCOME, _OTHER_SCENARIO, _NOTHING_TO_DO, _UNFIT, *_MANAGED, _SIGNAL),
         trial={'scenario': SIX}, also=('paper_test_measured', 'world_leo')),
    Card('rpo_sim', 'disturbance_injector', 'DisturbanceInjectorNode', (
        _BAD_OUTCOME, ('a stamp that is no tick of the scenario', 'is not answered; counted as '
                       '`ignored_foreign_stamp`'),
        _OTHER_SCENARIO, _NOTHING_TO_DO, _UNFIT, *_MANAGED, _SIGNAL),
         trial={'scenario': 'paper_test'}),
    Card('rpo_sim', 'fault_injector', 'FaultInjectorNode', (
        _BAD_OUTCOME, ('both topics the same', 'refused'),
        ('SIGINT or SIGTERM', 'prints how many messages it changed; exit code 0'))),
    Card('rpo_guidance', 'guidance', 'GuidanceNode', (
        _BAD_OUTCOME, ('a plan that cannot be flown', 'one sentence with the number that fails, '
                       'exit code 2'),
        ('`go` without its conditions', 'refused with the reason'),
        _OTHER_SCENARIO, _NOTHING_TO_DO, _UNFIT, *_MANAGED, _SIGNAL),
         trial={'scenario': 'hold_points'}, also=(SIX,)),
    Card('rpo_guidance', 'operator', 'OperatorNode', (
        _BAD_OUTCOME, ('`go` is refused', 'says it again until its conditions are met'),
        ('another command is refused', 'one sentence with the reason, exit code 1'),
        ('the phase does not come, or the run ends', 'one sentence, exit code 1'), _SIGNAL),
         {**_CODES, 1: 'the command was not followed'}),
    Card('rpo_safety', 'assurance', 'AssuranceNode', (
        _BAD_OUTCOME, _OTHER_SCENARIO, _NOTHING_TO_DO, _UNFIT,
        ('a command that would break a limit', 'is changed as little as the limit needs, or '
         'replaced by the backup law (`filter`); `assurance_status` says so'),
        ('a command that is not finite', 'never arrives: the plant waits for another'),
        ('with an abort table, no command', 'after 3 repeats of a state it answers without, says '
         'so on `stage_status`, and the table counts it'),
        ('the scenario begins outside of what can be assured', 'one sentence with the numbers, '
         'exit code 2'),
        *_MANAGED, _SIGNAL), trial={'scenario': 'assured'}, also=(SIX,)),
    Card('rpo_ctrl', 'attitude_controller', 'AttitudeControllerNode', (
        _BAD_OUTCOME, _OTHER_SCENARIO, _NOTHING_TO_DO, *_MANAGED, _SIGNAL),
         also=(SIX,)),
    Card('rpo_ctrl', 'fuzzy_controller', 'ControllerNode', _CONTROLLER, also=(SIX,)),
    Card('rpo_ctrl', 'rival_controller', 'ControllerNode', _CONTROLLER, also=(SIX,)),
    Card('rpo_log', 'recorder', 'RecorderNode', (
        _BAD_OUTCOME,
        ('a run in the folder already', 'refused, unless `overwrite`'),
        ('the disk is full or gone', 'the log ends, the flight continues; an error on '
         '`/diagnostics`, exit code 1'),
        ('the log cannot begin', 'one sentence, also on `recorder_status`; exit code 1'),
        ('a manifest or a topic does not come', 'says every 4 s what it waits for; ended before '
         'anything is recorded: one sentence, exit code 1'),
        ('a message that the plant ignores, or of somebody else', 'ignored and counted '
         '(`/diagnostics`, `run_info.yaml`), one warning of each kind'),
        ('several nodes answer a state', 'the log has the answer that acted, by the state that '
         'follows'),
        ('another controller file in flight', 'attached as `controller-2.yaml`, and so on'),
        ('a second plant', 'one warning; the log stays that of the first'),
        ('a message is missing', 'counted and reported at the end, exit code 1'),
        ('the plant dies', 'noticed after `plant_timeout_s`; the log is closed, exit code 1'),
        ('`kill -9`', 'at least 95 % of the run so far is readable; `rpo repair`'),
        ('SIGINT or SIGTERM', 'waits a moment for the last messages, closes the log, exit code 0'),
    ), {**_CODES, 1: 'the log is not whole, or nothing was recorded'}),
    Card('rpo_log', 'replay', 'ReplayNode', (
        _BAD_OUTCOME,
        ('a driven controller answers otherwise than the log',
         'prints the first difference, exit code 1'),
        ('no answer in `answer_timeout_s`', 'exit code 3'), _SIGNAL,
    ), {**_CODES, 1: 'answers differ', 3: 'no answer'}),
    Card('rpo_bringup', 'monitor', 'MonitorNode', (
        _BAD_OUTCOME,
        ('a fault holds for n of m samples', 'its reaction, once: warn; coast: the controller is '
         'deactivated; abort: the plant ends the run with exit code 3'),
        ('the node that must react is missing',
         'the request is sent as soon as it is there; an error on `/diagnostics`'),
        ('the reaction is refused', 'logged as a warning'), _SIGNAL)),
    Card('rpo_view', 'visualizer', 'VisualizerNode', (
        _BAD_OUTCOME, ('`tf2_msgs` is not installed', 'says so; `/tf` is not published'),
        ('messages faster than `rate_hz`', 'only the latest is shown'), _SIGNAL),
         publishes_tf=True),
    Card('rpo_view', 'web', 'WebNode', (
        _BAD_OUTCOME, ('the port is taken', 'one sentence, exit code 2'), _SIGNAL),
         trial={'port': 0}),
    Card('rpo_view', 'foxglove', 'FoxgloveNode', (
        _BAD_OUTCOME, _LAYER, ('the port is taken', 'one sentence, exit code 2'), _SIGNAL),
         listens=(*_SEEN, names.MARKERS)),
    Card('rpo_view', 'watch', 'WatchNode', (
        _BAD_OUTCOME, _LAYER, ('no message arrives', 'shows that, and waits'), _SIGNAL),
         {**_CODES, 1: 'the run was aborted (`until_end`)'}, listens=(*_SEEN, names.NODE_MANIFEST)),
)  # fmt: skip
"""Every node of the stack."""
