# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Guidance as a node, beside every other stage: flown, commanded by its services, verified."""

from __future__ import annotations

from functools import partial
from types import SimpleNamespace

import pytest
import yaml
from diagnostic_msgs.msg import DiagnosticStatus
from flights import told, verified

from rpo_core import files
from rpo_core.scenario import scenario
from rpo_core.wire import cdr
from rpo_core.wire.statuses import READERS
from rpo_ctrl.assurance_node import AssuranceNode
from rpo_ctrl.guidance_node import GuidanceNode
from rpo_ctrl.navigation_node import NavigationNode
from rpo_ctrl.operator_node import OperatorNode
from rpo_ros import qos
from rpo_ros.place_node import PlaceNode

LEGS = [
    {'name': 'wait', 'kind': 'hold', 'dwell_s': 5.0, 'go': 'command', 'within_m': 3.0,
     'within_m_s': 0.3},
    {'name': 'in', 'kind': 'straight', 'to_m': [0.0, -20.0, 0.0], 'speed_m_s': 0.2},
]  # fmt: skip
ASSURANCE = {
    'keep_out_m': 10.0, 'position_error_m': 0.2, 'velocity_error_m_s': 0.02,
    'disturbance_n': 0.05, 'thrust_error': 0.1,
}  # fmt: skip


def written(path, duration_s=60.0):
    """Write a scenario with a section for every place of the chain."""
    plan = yaml.safe_load(files.read_text(files.find('scenario', 'hold_points')))
    world = yaml.safe_load(files.read_text(files.find('scenario', 'world_leo')))
    plan['guidance'] |= {'legs': LEGS, 'retreat_m': [0.0, -40.0, 0.0]}
    plan |= {name: world[name] for name in ('thrusters', 'sensors', 'estimator')}
    plan |= {'initial_position_m': [0.0, -30.0, 0.0], 'duration_s': duration_s}
    plan |= {'assurance': ASSURANCE}
    del plan['requirements']
    path.write_text(yaml.safe_dump(plan))
    return scenario.load_scenario(path)


STAGES = (NavigationNode, GuidanceNode, AssuranceNode)


def fly(inner, folder, real_time_factor, duration_s=30.0):
    """Start all nodes of that scenario."""
    path = folder / 'whole.yaml'
    written(path, duration_s)
    options = {'controller': 'allround', 'real_time_factor': real_time_factor}
    inner.fly(folder / 'run', str(path), *STAGES, **options)


@pytest.mark.every_landing
def test_an_operator_waits_for_its_phase_and_says_go_until_it_is_followed(inner, tmp_path):
    go = inner.start(OperatorNode({'command': 'go', 'phase': 'wait'}))
    abort = inner.start(OperatorNode({'command': 'abort', 'phase': 'in'}))
    early = inner.start(OperatorNode({'command': 'go', 'phase': 'never'}))
    impatient = inner.start(OperatorNode({'patience_s': 0.1}))
    inner.until(lambda: impatient.done)
    fly(inner, tmp_path, 15.0, duration_s=45.0)
    inner.until(lambda: inner.recorder.done and go.done and abort.done and early.done)
    assert (go.exit_code, abort.exit_code, early.exit_code, impatient.exit_code) == (0, 0, 1, 1)
    said = [event for event in told(verified(tmp_path / 'run')) if event[0] == 'guidance']
    assert [state for _, state, _ in said] == ['go', 'abort']
    assert said[0][2] >= 50, 'not before `dwell_s`'


def test_each_node_is_switched_off_and_on_in_flight_logged_and_verified(inner, tmp_path):
    """And says so; an inactive guidance takes no command."""
    heard = set()

    def hear(topic, status):
        """Hold what nodes say against the contract."""
        said = cdr.decode_status(status)
        READERS[topic].of(said)
        known = [key.name.partition('<')[0] for key in READERS[topic].contract.keys]
        assert all(key.startswith(tuple(known)) for key, _ in said.values), said
        heard.add(topic)

    for topic in READERS:
        take = partial(hear, topic)
        inner.user.create_subscription(DiagnosticStatus, topic, take, qos.LATCHED_QUEUE, raw=True)
    fly(inner, tmp_path, 20.0)
    recorder, controller = inner.recorder, inner.controller
    for node in (n for n in inner.nodes if isinstance(n, (*STAGES, type(controller)))):
        for label, state in (('deactivate', 'inactive'), ('activate', 'active')):
            at = recorder.log.next_tick if recorder.log is not None else 0
            inner.until(lambda: recorder.log is not None and recorder.log.next_tick > at + 20)  # noqa: B023
            assert inner.transition(f'/{node.get_name()}', label)
            assert node.health()[2]['state'] == state
            if state == 'inactive' and isinstance(node, GuidanceNode):
                response = inner.trigger('/guidance/go')
                assert (response.success, response.message) == (False, 'guidance is inactive')
    inner.ends()
    assert heard >= {'run_status', 'stage_status', 'node_manifest', 'recorder_status'}
    log = verified(tmp_path / 'run')
    said = told(log)
    together = ('controller',), ('sensors', 'estimator'), ('guidance',), ('assurance',)
    assert [(stage, state) for stage, state, _ in said] == [
        (stage, state) for some in together for state in ('inactive', 'active') for stage in some
    ]
    off, on = said[0][2], said[1][2]
    assert off < on and not log.forces_n[off:on].any() and log.forces_n[on:].any()


def test_a_new_run_that_begins_as_the_one_before_is_said_again(monkeypatch):
    """A run that ended in its first leg was followed by one whose first phase nobody heard of."""
    monkeypatch.setattr(PlaceNode, 'new_run', lambda node: None)
    monkeypatch.setattr(GuidanceNode, 'listener', SimpleNamespace(changes=['begun']))
    node = object.__new__(GuidanceNode)
    node._said = 0
    assert (node.begun(), node.begun()) == (['begun'], [])
    node.new_run()
    assert node.begun() == ['begun']
