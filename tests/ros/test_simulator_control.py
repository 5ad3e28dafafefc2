# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Pause, step, reset, speed: a hand on the simulator changes when things happen, never what."""

import signal

import pytest
from scenarios import lasting
from steering import steering

from rpo_log.verify import verify
from rpo_mcap.read.run_log import read_run

pytestmark = pytest.mark.slow


@pytest.fixture
def hand(ros_env):
    with steering() as found:
        yield found


@pytest.fixture
def scenario(tmp_path):
    """`approach` cut to 20 s."""
    return lasting(20.0, tmp_path)


def start(ros, scenario, output, **parameters):
    """Start controller, recorder and plant; return them."""
    return (
        ros.node('rpo_ctrl', 'fuzzy_controller', controller='handmade'),
        ros.node('rpo_log', 'recorder', output=str(output)),
        ros.node(
            'rpo_sim', 'plant', scenario=scenario, wait_for_recorder='true', **parameters
        ),
    )  # fmt: skip


def test_a_flight_paused_stepped_and_sped_up_leaves_the_same_bytes(ros, hand, scenario):
    controller, recorder, plant = start(
        ros, scenario, ros.folder / 'steered', real_time_factor=5.0, peer_timeout_s=0.5
    )
    hand.says('flying')
    assert 'not paused' in hand.trigger('step').message
    assert hand.pause().success
    tick = int(hand.says('paused')['tick'])
    controller.process.send_signal(signal.SIGSTOP)
    hand.passes(0.8)  # longer than the plant waits for a peer
    controller.process.send_signal(signal.SIGCONT)
    assert hand.set('plant', step_ticks=3) == ['']
    assert hand.trigger('step').success
    hand.until(lambda: int(hand.statuses[-1][3]['tick']) == tick + 3)
    hand.passes(0.2)
    assert hand.statuses[-1][0] == 'paused'
    assert int(hand.statuses[-1][3]['tick']) == tick + 3
    assert 'real_time_factor' in hand.set('plant', real_time_factor=-1.0)[0]
    assert hand.set('plant', real_time_factor=0) == ['']
    assert hand.pause(False).success
    assert plant.wait() == 0, plant.output
    assert recorder.wait() == 0, recorder.output
    assert controller.stop() == 0
    options = ('--scenario', scenario, '--controller', 'handmade', '--no-report')
    straight = ros.node('rpo_bringup', 'final_approach', *options, '--output', f'{ros.folder}/run')
    assert straight.wait() == 0, straight.output
    steered = (ros.folder / 'steered/run.mcap').read_bytes()
    assert steered == (ros.folder / 'run/run.mcap').read_bytes()


def test_reset_closes_the_log_and_flies_again_from_tick_0(ros, hand, scenario):
    _, recorder, plant = start(ros, scenario, ros.folder / 'first', real_time_factor=5.0)
    hand.says('flying')
    hand.passes(0.5)
    assert hand.trigger('reset').success
    assert recorder.wait() == 0, recorder.output
    log = read_run(ros.folder / 'first')
    assert dict(log.statuses[-1][1].values)['phase'] == 'aborted'
    assert verify(ros.folder / 'first').difference is None
    assert 0 < log.ticks[-1] < 200
    second = ros.node('rpo_log', 'recorder', output=str(ros.folder / 'second'))
    assert plant.wait() == 0, plant.output
    assert second.wait() == 0, second.output
    assert verify(ros.folder / 'second').exit_code == 0


@pytest.mark.parametrize('mode', ['lockstep', 'free_running'])
def test_abort_ends_the_run_and_says_so(ros, hand, scenario, mode):
    _, recorder, plant = start(ros, scenario, ros.folder / 'run', real_time_factor=5.0, mode=mode)
    hand.says('flying')
    hand.passes(0.3)
    assert hand.trigger('abort').success
    assert plant.wait() == 3
    assert recorder.wait() == 0, recorder.output
    hand.says('abort requested')
    assert dict(read_run(ros.folder / 'run').statuses[-1][1].values)['phase'] == 'aborted'


def test_a_pause_in_free_running_makes_no_force_stale(ros, hand, scenario):
    _, recorder, plant = start(
        ros, scenario, ros.folder / 'run', mode='free_running', real_time_factor=5.0
    )
    hand.says('flying')
    hand.passes(0.3)
    assert hand.pause().success
    hand.passes(1.0)
    assert hand.set('plant', step_ticks=5) == ['']
    tick = int(hand.says('paused')['tick'])
    assert hand.trigger('step').success
    hand.until(lambda: int(hand.statuses[-1][3]['tick']) == tick + 5)
    assert hand.pause(False).success
    assert plant.wait() == 0, plant.output
    assert recorder.wait() == 0, recorder.output
    assert hand.says('reached the last tick')['stale_ticks'] == '0'
    assert verify(ros.folder / 'run').exit_code == 0
