# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Topic `decision`: what the controller says is what it does, when it is due, and recorded."""

import math

from diagnostic_msgs.msg import DiagnosticArray
from inside import inside
from nav_msgs.msg import Odometry

from rpo_core.control.controller import load_controller
from rpo_core.files import DEFAULT_CONTROLLER
from rpo_ctrl.controller_node import ControllerNode
from rpo_ctrl.explain import decisions
from rpo_mcap.read.run_log import controller_of, read_decisions, read_run
from rpo_ros import conversions, qos
from rpo_sim.disturbance_injector_node import DisturbanceInjectorNode

EPOCH_NS = 1_767_225_600_000_000_000
STATE = (10.0, 60.0, -40.0, 0.1, -0.2, 0.05)


def heard(bench, rate_hz, ticks, deactivate_at=None):
    """Return the decisions on so many states, 0.1 s apart."""
    node = bench.start(ControllerNode({'decision_rate_hz': rate_hz, 'scenario': 'approach'}))
    said = []
    states = bench.publisher(Odometry, 'relative_state')
    bench.user.create_subscription(DiagnosticArray, 'decision', said.append, qos.LOCKSTEP)
    bench.until(lambda: bench.user.count_publishers('decision'))
    for tick in range(ticks):
        if tick == deactivate_at:
            node.trigger_deactivate()
        for _ in range(2):  # the plant asks again now and then
            states.publish(conversions.to_odometry(EPOCH_NS + tick * 100_000_000, STATE))
            count = node.answered + 1
            bench.until(lambda: node.answered >= count)  # noqa: B023
    due = math.ceil(ticks * rate_hz / 10.0)  # states are 0.1 s apart, each is sent twice
    bench.until(lambda: len(said) >= 2 * due)
    return said


def test_it_says_what_it_does_once_a_period(inner):
    said = heard(inner, 5.0, ticks=11)
    ticks = [(conversions.from_stamp(m.header.stamp) - EPOCH_NS) // 100_000_000 for m in said]
    assert sorted(set(ticks)) == [0, 2, 4, 6, 8, 10]
    node_said = {(s.name, s.message, tuple((v.key, v.value) for v in s.values))
                 for m in said for s in m.status}  # fmt: skip
    expected = {
        (f'decision: {d.axis}', d.strongest, tuple((k, repr(x)) for k, x in d.pairs()))
        for d in decisions(load_controller(DEFAULT_CONTROLLER), STATE)
    }
    assert node_said == expected


def test_inactive_it_says_that_it_commands_zero(inner):
    said = heard(inner, 10.0, ticks=4, deactivate_at=2)
    levels = [m.status[0].level for m in said]
    assert levels[0] == b'\x00' and levels[-1] == b'\x01'
    assert said[-1].status[0].message == 'inactive: commands zero'


def test_off_it_says_nothing(inner):
    assert heard(inner, 0.0, ticks=3) == []


def test_the_log_has_what_was_said_and_it_is_true(ros_env, tmp_path):
    output = tmp_path / 'run'
    with inside(['-p', 'decision_rate_hz:=2.0']) as inner:
        inner.fly(output, 'quick', DisturbanceInjectorNode, controller=DEFAULT_CONTROLLER)
        assert inner.ends() == 0
    log = read_run(output)
    found = list(read_decisions(output / 'decisions.mcap'))
    ticks = [log.base.tick_of(decision.stamp_ns) for decision in found]
    assert ticks == list(range(0, log.base.last_tick + 1, 5))
    controller = controller_of(log)
    for tick, decision in zip(ticks, found, strict=True):
        for axis, expected in zip(
            decision.axes, decisions(controller, log.states[tick].tolist()), strict=True
        ):
            assert axis.message == expected.strongest
            assert list(axis.values) == [(k, repr(x)) for k, x in expected.pairs()]
            assert float(dict(axis.values)['force_n']) == expected.force_n
