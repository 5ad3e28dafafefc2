# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The operator's commands to guidance and to the abort table: nodes as processes, over DDS."""

from __future__ import annotations

import pytest
import yaml
from flights import started, told
from inside import Hand, values_of

from rpo_core import files
from rpo_ctrl.assurance_node import AssuranceNode
from rpo_log.read.run_log import read_run
from rpo_log.verify import verify

NODES = 'rpo_ctrl fuzzy_controller', 'rpo_ctrl guidance', 'rpo_ctrl assurance'


def guarded(folder, duration_s, **abort):
    """Write the shipped scenario, shorter, with other fields of its abort table."""
    document = yaml.safe_load(files.find('scenario', 'guarded').read_text())
    document['duration_s'] = duration_s
    document['assurance']['abort'].update(abort)
    path = folder / 'guarded.yaml'
    path.write_text(yaml.safe_dump(document))
    return str(path)


def states_of(folder, name):
    """Return what the log tells of a stage, each with its tick."""
    return [(state, tick) for stage, state, tick in told(read_run(folder)) if stage == name]


@pytest.mark.every_landing
def test_every_command_is_obeyed_or_refused_logged_and_verified(ros, inner, tmp_path):
    """go, hold, retreat, abort of guidance; arm, inhibit, hold, resume, abort of the table."""
    scenario, folder = guarded(tmp_path, 100.0), tmp_path / 'run'
    hand = Hand(inner)

    def asks(service):
        """Call a service; return why it is refused, '' if it is not."""
        answer = inner.trigger(service)
        return answer.message if not answer.success else ''

    def tick():
        return int(values_of(hand.statuses[-1])['tick'])

    def passes(seconds):
        """Let the paused flight go on for so long: it keeps no time of its own."""
        ticks = round(seconds * 10.0)
        due = tick() + ticks
        assert inner.set('plant', step_ticks=ticks)[0]
        assert hand.trigger('step').success
        inner.until(lambda: tick() == due)

    nodes = started(ros, folder, *NODES, scenario=scenario, real_time_factor=1.0)
    hand.says('flying')
    assert hand.pause().success
    hand.says('paused')
    assert asks('guidance/go').startswith('`dwell_s` = 10 s is not over')
    passes(11.0)
    assert asks('guidance/go') == ''
    passes(5.0)
    assert asks('guidance/go') == '`go` ends a hold; the phase is to_20'
    for command in ('guidance/hold', 'guidance/go', 'assurance/inhibit', 'assurance/arm'):
        assert asks(command) == ''
        passes(2.0)
    assert asks('assurance/resume').startswith('`resume` ends a hold or a retreat')
    for command in ('assurance/hold', 'assurance/resume', 'guidance/retreat'):
        assert asks(command) == ''
        passes(1.0)
    assert asks('assurance/abort') == asks('guidance/abort') == ''
    passes(1.0)
    assert 'the phase is aborting' in asks('assurance/hold')
    assert asks('guidance/go').endswith('an abort is not taken back')
    assert inner.set('plant', real_time_factor=0.0)[0]
    assert hand.pause(False).success
    assert (nodes['plant'].wait(), nodes['recorder'].wait()) == (0, 0), nodes['recorder'].output
    for node in nodes.values():
        assert not node.running or node.stop() == 0, node.output
        assert 'Traceback' not in node.output
    assert [state for state, _ in states_of(folder, 'guidance')] == [
        'go', 'hold', 'go', 'retreat', 'abort',
    ]  # fmt: skip
    states = [state for state, _ in states_of(folder, 'assurance')]
    for command, state in (
        ('inhibit', 'inhibited'), ('arm', 'armed'), ('hold', 'holding'), ('resume', 'resumed'),
        ('abort', 'aborting'),
    ):  # fmt: skip
        assert states.index(command) < states.index(state)
    said = (found := verify(folder)).sentence()
    assert found.exit_code == 0 and 'recomputed: guidance, controller, assurance' in said, said


@pytest.mark.every_landing
def test_a_lost_guidance_is_a_hold_and_then_an_abort(ros, tmp_path):
    """Killed in flight: with it goes the controller's command; assurance flies on alone."""
    scenario, folder = guarded(tmp_path, 25.0, hold_s=3.0, stuck_s=5.0), tmp_path / 'run'
    plant = {'scenario': scenario, 'real_time_factor': 10.0, 'resend_after_s': 0.1}
    nodes = started(ros, folder, *NODES, **plant)
    nodes['plant'].says('flying guarded')
    nodes['guidance'].discard()
    nodes['recorder'].says('waiting for what is missing')
    assert nodes['recorder'].stop() == 1
    assert nodes['plant'].wait() == 0, nodes['plant'].output
    for name in ('fuzzy_controller', 'assurance'):
        assert nodes[name].stop() == 0, nodes[name].output
    states = dict(reversed(states_of(folder, 'assurance')))
    assert list(reversed(states)) == ['without_command', 'holding', 'aborting', 'drifting']
    assert states['holding'] == states['without_command'] + 2
    assert states['aborting'] == states['holding'] + 30
    said = (found := verify(folder)).sentence()
    assert found.exit_code == 3 and 'as computed as far as it goes' in said, said
    assert 'assurance could not be recomputed' not in said


def test_a_table_is_not_commanded_without_one(inner):
    """A scenario without an abort table: each command is refused with the reason."""
    inner.start(AssuranceNode({'scenario': 'assured'}))
    for name in ('arm', 'abort'):
        answer = inner.trigger(f'assurance/{name}')
        assert not answer.success
        assert answer.message == 'no scenario with `assurance.abort` is here'
