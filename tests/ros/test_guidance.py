# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Guidance as a node, beside every other stage: flown, commanded by its services, verified."""

from __future__ import annotations

from functools import partial

import pytest
import yaml
from diagnostic_msgs.msg import DiagnosticStatus
from std_srvs.srv import Trigger

from rpo_core import files
from rpo_core.files import scenario
from rpo_core.wire import cdr, interfaces
from rpo_core.wire.statuses import READERS
from rpo_guidance.guidance_node import GuidanceNode
from rpo_guidance.operator_node import OperatorNode
from rpo_log.verify import verify
from rpo_mcap.read.run_log import read_run
from rpo_nav.navigation_node import NavigationNode
from rpo_ros import conversions, qos
from rpo_safety.assurance_node import AssuranceNode

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
    options = {'controller': 'trained', 'real_time_factor': real_time_factor}
    inner.fly(folder / 'run', str(path), *STAGES, **options)


def test_a_plan_is_flown_beside_all_other_stages_and_obeys(inner, tmp_path):
    """The controller could not take several inputs: every guided flight on ROS broke."""
    phases: list[str] = []

    def hear(status: DiagnosticStatus) -> None:
        phases.append(conversions.values_of(status)['phase'])

    def call(name):
        answer = inner.call(Trigger, f'/guidance/{name}', Trigger.Request())
        return answer.success, answer.message

    topic = interfaces.GUIDANCE_STATUS
    inner.user.create_subscription(DiagnosticStatus, topic, hear, qos.LATCHED_QUEUE)
    fly(inner, tmp_path, 15.0)
    inner.until(lambda: 'wait' in phases and inner.plant.tick > 0)
    success, message = call('go')
    assert not success and '`dwell_s` = 5 s is not over' in message
    inner.reaches(80)
    assert call('go')[0]
    inner.until(lambda: phases[-1] == 'in')
    assert call('hold')[0]
    inner.until(lambda: phases[-1] == 'stopped')
    assert call('retreat')[0]
    inner.until(lambda: phases[-1] == 'retreating')
    assert inner.ends() == 0
    log = read_run(tmp_path / 'run')
    told = [e.values['state'] for e in log.events if e.values.get('stage') == 'guidance']
    assert told == ['go', 'hold', 'retreat']
    found = verify(tmp_path / 'run')
    assert found.exit_code == 0, found.sentence()
    assert all(name in found.sentence() for name in ('estimator', 'guidance', 'assurance'))


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
    events = [e.values for e in read_run(tmp_path / 'run').events if e.values.get('stage')]
    told = [(e['state'], int(e['tick'])) for e in events if e['stage'] == 'guidance']
    assert [name for name, _ in told] == ['go', 'abort']
    assert told[0][1] >= 50, 'not before `dwell_s`'
    assert verify(tmp_path / 'run').exit_code == 0


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
    recorder, stages = inner.recorder, [n for n in inner.nodes if isinstance(n, STAGES)]
    for node in stages:
        for label in ('deactivate', 'activate'):
            at = recorder.log.next_tick if recorder.log is not None else 0
            inner.until(lambda: recorder.log is not None and recorder.log.next_tick > at + 20)  # noqa: B023
            assert inner.transition(f'/{node.get_name()}', label)
            assert node.health()[2]['state'] == ('inactive', 'active')[label == 'activate']
            if label == 'deactivate' and node is stages[1]:
                response = inner.call(Trigger, '/guidance/go', Trigger.Request())
                assert (response.success, response.message) == (False, 'guidance is inactive')
    inner.ends()
    assert heard >= {'run_status', 'stage_status', 'node_manifest', 'recorder_status'}
    log = read_run(tmp_path / 'run')
    said = [
        (e.values['stage'], e.values['state']) for e in log.events if e.signal == 'stage_status'
    ]
    stages = ('sensors', 'estimator'), ('guidance',), ('assurance',)
    assert said == [(s, state) for some in stages for state in ('inactive', 'active') for s in some]
    found = verify(tmp_path / 'run')
    assert found.exit_code == 0, found.sentence()
