# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Which of several messages of a topic acted, where no computation tells it."""

import pytest

from rpo_core.files.scenario import load_scenario
from rpo_core.wire.interfaces import row_of
from rpo_log.topics import Topic
from rpo_log.write.acting import Acting

SIGNALS = (
    'relative_state', 'navigation_state', 'estimated_disturbance', 'control_force', 'exerted_force'
)  # fmt: skip


@pytest.mark.parametrize(
    ('signal', 'numbers'),
    [('estimated_disturbance', 3), ('exerted_force', 3), ('navigation_state', 24)],
)
def test_a_message_with_nothing_else_in_it_is_the_one_of_our_nodes(signal, numbers):
    row = row_of(signal)
    plain, other = (row.layout.encode(0, (value,) * numbers) for value in (1.0, 2.0))
    forged = bytearray(plain)
    forged[-1] = 0x7F  # of the torque, of the covariance of the rates
    acting = Acting(load_scenario('world_leo'), [Topic(name, row_of(name)) for name in SIGNALS])
    index = SIGNALS.index(signal)
    for found in ([bytes(forged), plain], [plain, bytes(forged)]):
        assert acting.acted(index, 7, lambda *_, found=found: found) == plain
    assert acting.acted(index, 7, lambda *_: [plain, other]) is None
