# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Kill -9 of each node at random moments: what the others do, and how soon they say so."""

import random
import re
import statistics
import time

import pytest
from flights import lasting
from inside import Hand, values_of

from rpo_log.errors import ExitCode
from rpo_log.verify import verify

MODES = ('lockstep', 'free_running')
WARN, ERROR = b'\x01', b'\x02'
SLACK_S = 5.0
"""For a busy machine; health is told once a second."""

moments = pytest.mark.parametrize(
    'moments',
    [
        pytest.param(1, marks=pytest.mark.every_landing),
        pytest.param(8, marks=[pytest.mark.slow, pytest.mark.timeout(1200)]),
    ],
)
PEER_TIMEOUT_S, STALE_TICKS, PLANT_TIMEOUT_S, RECORDER_LEASE_S, SILENT_S = 0.5, 5, 2.0, 5.0, 3.0
TOPICS = {'fuzzy_controller': 'control_force', 'disturbance_injector': 'disturbance_force'}


def phase(status):
    """Return phase and level of a run_status."""
    return values_of(status)['phase'], status.level


class Run:
    """The nodes of a flight, any of which may die and be started anew."""

    def __init__(self, ros, hand, mode, seed):
        self.ros, self.hand, self.mode = ros, hand, mode
        self.chance = random.Random(seed)
        self.count = 0
        self.scenario = lasting(3600.0, ros.folder, 'paper_test')

    def controller(self):
        return self.ros.node('rpo_ctrl', 'fuzzy_controller')

    def injector(self):
        return self.ros.node('rpo_sim', 'disturbance_injector', scenario=self.scenario)

    def recorder(self):
        self.count += 1
        self.output = self.ros.folder / f'run_{self.count}'
        options = {'output': str(self.output), 'plant_timeout_s': PLANT_TIMEOUT_S}
        return self.ros.node('rpo_log', 'recorder', **options)

    def plant(self, **options):
        self.hand.statuses.clear()
        return self.ros.node(
            'rpo_sim', 'plant', scenario=self.scenario, mode=self.mode, real_time_factor=1.0,
            peer_timeout_s=PEER_TIMEOUT_S, stale_after_ticks=STALE_TICKS, **options,
        )  # fmt: skip

    def kill(self, node):
        """Kill a node at a random moment of the flight; return when."""
        self.hand.passes(self.chance.uniform(0.05, 1.0))
        self.hand.statuses.clear()
        self.hand.health.clear()
        node.process.kill()
        node.process.wait()
        return time.time()

    def warned(self, node, text, since_s, within_s):
        """Wait until a node's health says a text, and check how soon."""

        def said():
            return [
                moment
                for moment, status in self.hand.health.get(node, ())
                if status.level != b'\x00'
                and text in f'{status.message} {values_of(status)}'
                and moment >= since_s
            ]

        assert self.hand.until(said)[0] - since_s <= within_s + 1.0 + SLACK_S


@pytest.fixture
def make(ros, inner):
    """Return a maker of runs."""
    return lambda mode, seed: Run(ros, Hand(inner), mode, seed)


@moments
@pytest.mark.parametrize('name', TOPICS)
def test_free_running_survives_each_peer_killed_at_many_moments(make, name, moments):
    """Killed and started anew, again and again, in one flight."""
    run = make('free_running', seed=2)
    peers = {'fuzzy_controller': run.controller, 'disturbance_injector': run.injector}
    nodes = {peer: begin() for peer, begin in peers.items()}
    plant, killed = run.plant(), []
    silent = re.compile(rf'\[(\S+)\] \[plant\]: {name} \(.*\) is silent')
    run.hand.says('flying')
    for _ in range(moments):
        killed_s = run.kill(nodes[name])
        killed.append(killed_s)
        status = run.hand.says(f'from {TOPICS[name]}: zero')
        assert time.time() - killed_s < (STALE_TICKS + 2) * 0.1 + SLACK_S
        assert phase(status) == ('running', WARN)
        run.warned('plant', 'stale_ticks', killed_s, 1.0)
        run.hand.until(lambda: len(silent.findall(plant.output)) == len(killed))
        nodes[name] = peers[name]()
        run.hand.says('forces are back')
    said = silent.findall(plant.output)
    after_s = [float(stamp) - since for stamp, since in zip(said, killed, strict=True)]
    assert 0.0 < statistics.median(after_s) < 1.0
    assert plant.process.poll() is None
    assert run.hand.trigger('abort').success
    assert plant.wait() == 3
    assert not any('Traceback' in node.output for node in run.ros.nodes)


@moments
@pytest.mark.parametrize('name', TOPICS)
def test_lockstep_aborts_when_a_peer_is_killed_at_many_moments(make, name, moments):
    run = make('lockstep', seed=3)
    peers = {'fuzzy_controller': run.controller, 'disturbance_injector': run.injector}
    nodes = {peer: begin() for peer, begin in peers.items()}
    for _ in range(moments):
        plant = run.plant()
        run.hand.says('flying')
        killed_s = run.kill(nodes[name])
        status = run.hand.says(f'from {TOPICS[name]}')
        assert time.time() - killed_s < PEER_TIMEOUT_S + SLACK_S
        assert phase(status) == ('aborted', ERROR)
        assert plant.wait() == 3, plant.output
        nodes[name] = peers[name]()


@moments
@pytest.mark.parametrize('mode', MODES)
def test_a_plant_killed_at_many_moments_is_missed_by_all(make, mode, moments):
    run = make(mode, seed=4)
    controller, injector = run.controller(), run.injector()
    for _ in range(moments):
        recorder, plant = run.recorder(), run.plant(wait_for_recorder='true')
        run.hand.says('flying')
        killed_s = run.kill(plant)
        recorder.says('the plant is gone')
        assert time.time() - killed_s < PLANT_TIMEOUT_S + SLACK_S
        for name in TOPICS:
            run.warned(name, 'the plant is gone', killed_s, SILENT_S)
        assert recorder.wait() == 1
        found = verify(run.output)
        assert found.difference is None
        assert found.exit_code == ExitCode.INCOMPLETE
    assert controller.stop() == 0
    assert injector.stop() == 0
    assert not any('Traceback' in node.output for node in run.ros.nodes)


@moments
@pytest.mark.parametrize('mode', MODES)
def test_a_recorder_killed_at_many_moments_is_missed_by_the_plant(make, mode, moments):
    run = make(mode, seed=5)
    run.controller(), run.injector()
    for _ in range(moments):
        recorder, plant = run.recorder(), run.plant(wait_for_recorder='true')
        run.hand.says('flying')
        log = run.output / 'run.mcap'
        begun = log.stat().st_size
        run.hand.until(lambda: log.stat().st_size > begun)  # noqa: B023
        killed_s = run.kill(recorder)
        status = run.hand.says('the recorder is gone')
        assert time.time() - killed_s < RECORDER_LEASE_S + 1.0 + SLACK_S
        assert phase(status) == ('running', WARN)
        run.warned('plant', 'recorder', killed_s, RECORDER_LEASE_S + 1.0)
        assert run.hand.trigger('abort').success
        assert plant.wait() == 3
        assert verify(run.output).difference is None
