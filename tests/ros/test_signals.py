# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A signal at any moment, any node: exit code 0, no traceback, the log readable.

Moments are drawn by a seed. One start of a system serves several nodes, each with a moment of its
own, so some end while the others fly on.
"""

import random
import signal
import time
from pathlib import Path

import pytest
from landing import rest_at_landing
from node_pages import CARDS, tiny_log

from rpo_log.errors import LogError
from rpo_log.read.run_log import read_run

LONGEST_S = 2.0
SPEED = 40.0
SIGNALS = [signal.SIGINT, signal.SIGTERM, signal.SIGHUP]

trials = pytest.mark.parametrize('trial', rest_at_landing(range(8), quick=0, landing=1))
signals = pytest.mark.parametrize('number', SIGNALS, ids=lambda number: number.name)


def check_log(folder: Path) -> None:
    """The log of a run is closed and readable, or was never begun."""
    if not (folder / 'run.mcap').exists():
        return
    try:
        log = read_run(folder)
    except LogError as error:
        assert 'holds no message' in str(error) or 'only statuses' in str(error), error
        return
    assert not log.damage and (folder / 'metadata.yaml').exists()


def end_each_at_its_moment(nodes, number, trial, code=0):
    """Send a signal to each node at a moment of its own; check how it ended."""
    rng = random.Random(f'{trial} {number}')
    moments = sorted((rng.uniform(0.0, LONGEST_S), i) for i in range(len(nodes)))
    begun = time.monotonic()
    for moment, i in moments:
        time.sleep(max(0.0, begun + moment - time.monotonic()))
        if nodes[i].process.poll() is None:
            nodes[i].process.send_signal(number)
    for node in nodes:
        assert node.wait() == code, node.output
        assert 'Traceback' not in node.output, node.output


def four(ros, output):
    """Start the four processes of a run; return what each says then."""
    flown = {'scenario': 'paper_test', 'real_time_factor': SPEED, 'wait_for_recorder': 'true'}
    ros.node('rpo_sim', 'plant', **flown)
    ros.node('rpo_sim', 'disturbance_injector', scenario='paper_test')
    ros.node('rpo_ctrl', 'fuzzy_controller')
    ros.node('rpo_log', 'recorder', output=str(output))
    return ('[plant]', 'disturbing', 'controlling', 'recording')


def one(ros, output):
    """Start all nodes in one process; return what it says then."""
    ros.node(
        'rpo_bringup', 'final_approach', '--scenario', 'paper_test', '--output', str(output),
        '--real-time-factor', str(SPEED), '--no-report',
    )  # fmt: skip
    return ('[plant]',)


@trials
@signals
@pytest.mark.parametrize(('begin', 'code'), [(four, 0), (one, 130)])
def test_the_nodes_of_a_run(ros, number, trial, begin, code):
    output = ros.folder / 'run'
    for node, word in zip(ros.nodes, begin(ros, output), strict=True):
        node.says(word)
    end_each_at_its_moment(ros.nodes, number, trial, code)
    check_log(output)


OTHERS = {
    'navigation': ('navigating', {'scenario': 'world_leo'}),
    'guidance': ('guiding', {'scenario': 'hold_points'}),
    'operator': ('waiting to say', {'remap': {'__ns': '/apart'}}),  # else the replay's run ends it
    'assurance': ('', {'scenario': 'assured'}),
    'attitude_controller': ('steering', {'scenario': 'tumbling_docking'}),
    'fault_injector': ('faults between', {}),
    'rival_controller': ('controlling', {}),
    'replay': ('', {'rate': 1.0e-3}),
    'visualizer': ('showing', {}),
    'web': ('is shown at', {'port': 0}),
}


@trials
@signals
def test_all_other_nodes(ros, number, trial):
    packages = {card.executable: card.package for card in CARDS}
    bag = {'replay': {'bag': str(tiny_log(ros.folder / 'log'))}}
    for name, (_, parameters) in OTHERS.items():
        ros.node(packages[name], name, **parameters, **bag.get(name, {}))
    for node, (word, _) in zip(ros.nodes, OTHERS.values(), strict=True):
        node.says(word, deadline_s=90.0)  # many starts at once
    time.sleep(1.0)  # the replay says nothing at its start
    end_each_at_its_moment(ros.nodes, number, trial)
