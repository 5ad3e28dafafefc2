# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Lockstep through fault injectors: whatever happens to the messages, the bits stay the same."""

import pytest
from flights import lasting
from inside import inside
from landing import rest_at_landing
from mcap.reader import make_reader

from rpo_core.world.link import CORRUPTIONS
from rpo_sim.disturbance_injector_node import DisturbanceInjectorNode
from rpo_sim.fault_injector_node import FaultInjectorNode

KINDS = ('drop', 'freeze', 'repeat', 'delay', 'reorder')
THROUGH = [
    '-r', 'fuzzy_controller:relative_state:=relative_state_faulty',
    '-r', 'fuzzy_controller:control_force:=control_force_raw',
]  # fmt: skip
STATES = {'from_topic': 'relative_state', 'to_topic': 'relative_state_faulty'}


def messages(folder):
    """Return what was recorded; remapped topics are an attachment, which only one log has."""
    with (folder / 'run.mcap').open('rb') as stream:
        found = make_reader(stream).iter_messages(log_time_order=False)
        return [(channel.topic, message.log_time, message.data) for _, channel, message in found]


@pytest.mark.parametrize(
    ('counted', 'faults'),
    rest_at_landing(
        [
            (KINDS, dict.fromkeys(KINDS, 0.2)),
            (CORRUPTIONS, {'corrupt': 0.3}),
            *(([kind], {'corrupt': 0.3, 'corruption': kind}) for kind in CORRUPTIONS),
        ]
    ),
)
def test_lost_repeated_reordered_or_spoilt_messages_leave_the_same_bytes(
    straight, ros_env, tmp_path, counted, faults
):
    """In both directions; a lost one comes again."""
    with inside(THROUGH) as inner:
        injectors = [
            inner.start(FaultInjectorNode({'seed': seed, **topics, **faults}))
            for seed, topics in ((1, STATES), (2, {}))
        ]
        scenario = lasting(20.0, tmp_path, 'paper_test')
        inner.fly(tmp_path / 'run', scenario, DisturbanceInjectorNode, resend_after_s=0.01)
        assert inner.ends() == 0
    for injector in injectors:
        assert all(injector.link.counts[kind] > 10 for kind in counted), injector.link.counts
    assert messages(tmp_path / 'run') == messages(straight)
