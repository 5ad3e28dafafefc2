# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Sensors and estimator as a node: a command that is lost, late or foreign."""

import pytest
from flights import assert_flown, told, verified
from inside import inside
from nav_scenarios import LIDAR, make

from rpo_core.chain.flight import fly
from rpo_core.control.controller import load_controller
from rpo_core.scenario import scenario as scenarios
from rpo_ctrl.navigation_node import NavigationNode
from rpo_log.read.run_log import read_run
from rpo_ros import stage_node
from rpo_ros.signals import Outlet
from rpo_ros.stage_node import WITHOUT_COMMAND
from rpo_sim.fault_injector_node import FaultInjectorNode

LATE = {**LIDAR, 'latency_ticks': 3, 'dropout_share': 0.1}
SLOW = {
    'kind': 'relative_position', 'noise_floor_m': 0.5, 'velocity_floor_m_s': 0.02,
    'period_ticks': 10,
}  # fmt: skip


def written(folder, **changes):
    flown = make([LATE, SLOW], **changes)
    path = folder / 'navigated.yaml'
    path.write_text(scenarios.dumps(flown))
    return flown, path


@pytest.mark.parametrize(
    ('heard', 'wait_s'),
    [('control_force_heard', 3600.0), pytest.param('nobody', 0.1, marks=pytest.mark.every_landing)],
)
def test_a_command_that_is_lost_is_sent_again_or_gone_without(
    ros_env, tmp_path, monkeypatch, heard, wait_s
):
    """Half or none of them reach navigation; answers to repeated states bring the rest again."""
    monkeypatch.setattr(stage_node, 'LEAST_WAIT_S', wait_s)
    flown, path = written(tmp_path, ticks=20)
    with inside(['-r', f'navigation:control_force:={heard}']) as inner:
        injector = inner.start(
            FaultInjectorNode(
                {'from_topic': 'control_force', 'to_topic': 'control_force_heard', 'drop': 0.5}
            )
        )
        inner.fly(tmp_path / 'run', str(path), NavigationNode, resend_after_s=0.02)
        assert inner.ends() == 0
    assert injector.link.counts['drop'] > 5
    if heard == 'nobody':
        without = [('estimator', WITHOUT_COMMAND, tick) for tick in range(1, 21)]
        assert told(verified(tmp_path / 'run')) == without
    else:
        assert not told(read_run(tmp_path / 'run'))
        assert_flown(tmp_path / 'run', fly(flown, load_controller('handmade')))


def test_copies_of_an_input_far_ahead_are_stray_and_a_row_is_not(monkeypatch):
    """While a flight stands, three copies made a stage that remembers deaf to its present."""
    now_s = [0.0]
    monkeypatch.setattr(stage_node.time, 'monotonic', lambda: now_s[0])
    dt_ns, waits = 100_000_000, stage_node.InputTimeout()
    assert not waits.is_stray(5000 * dt_ns)  # nothing was answered yet
    waits.answered(50 * dt_ns, dt_ns)
    waits.answered(0, dt_ns)  # a state before changes nothing
    assert all(waits.is_stray(5000 * dt_ns) for _ in range(10))
    assert all(waits.is_stray((5000 + 300 * i) * dt_ns) for i in range(10))
    found = [waits.is_stray((9000 + 2 * i) * dt_ns) for i in range(stage_node.ROW)]
    assert found == [True, True, False]
    assert not waits.is_stray(150 * dt_ns)
    now_s[0] = 2.0 * stage_node.LONELY_S  # nothing else came: the plant went on without this node
    assert [waits.is_stray(5000 * dt_ns) for _ in range(3)] == [True, True, False]


def test_copies_of_a_state_do_not_shorten_the_wait_for_a_command(inner, tmp_path, monkeypatch):
    """Anybody can send them: on a busy machine they let a filter go on without a late command."""
    flown, path = written(tmp_path, ticks=5)
    monkeypatch.setattr(stage_node, 'LEAST_WAIT_S', 3600.0)
    node = inner.start(NavigationNode({'scenario': str(path)}))
    states = Outlet(inner.user, 'relative_state')
    inner.until(lambda: states.publisher.get_subscription_count())
    state = tuple(map(float, flown.start))
    states.publish(flown.stamp_ns(0), state)
    inner.until(lambda: node.last_tick == 0)
    for _ in range(2 * stage_node.MOST_REPEATS):
        states.publish(flown.stamp_ns(1), state)
    inner.until(lambda: node._input_timeout._repeats > stage_node.MOST_REPEATS)
    assert node.last_tick == 0
    monkeypatch.setattr(stage_node, 'LEAST_WAIT_S', 0.0)
    states.publish(flown.stamp_ns(1), state)
    inner.until(lambda: node.last_tick == 1)


def test_a_command_that_waits_is_not_replaced_and_answers_cause_no_answers(inner, tmp_path):
    """A foreign command drove out the one before, and each repeated one made a whole new tick."""
    flown, path = written(tmp_path, ticks=5)
    node = inner.start(NavigationNode({'scenario': str(path)}))
    states, commands = (Outlet(inner.user, name) for name in ('relative_state', 'control_force'))
    inner.until(lambda: all(x.publisher.get_subscription_count() for x in (states, commands)))
    state = tuple(map(float, flown.start))
    states.publish(flown.stamp_ns(0), state)
    inner.until(lambda: node.answered == 1)
    for shift_ns in (0, 1, -flown.dt_ns):
        commands.publish(flown.stamp_ns(0) + shift_ns, (0.1, 0.0, 0.0))
    inner.until(lambda: len(node._waiting) == 2)
    states.publish(flown.stamp_ns(1), state)
    inner.until(lambda: node.last_tick == 1)
    for _ in range(5):
        commands.publish(flown.stamp_ns(0), (0.1, 0.0, 0.0))
    states.publish(flown.stamp_ns(0), state)
    inner.until(lambda: node.ignored['late'])
    assert node.answered == 2
