# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A log is written and read; without mcap, which rosdep cannot install, it is not."""

import pytest

from rpo_core.wire.interfaces import row_of
from rpo_log.format.run import TimeBase
from rpo_log.log_commands import parser

STATES = [(10.0 + tick, 60.0, -40.0, 0.0, 0.1, 0.2) for tick in range(11)]


def test_states_come_back_bit_for_bit(tmp_path):
    """Each state has the tick of its stamp."""
    pytest.importorskip('mcap')
    from rpo_log.read.run_log import read_run
    from rpo_log.write.writer import RunLogWriter

    base = TimeBase(1_000_000_000, 100_000_000, 10)
    log = RunLogWriter(tmp_path, base, ('/relative_state', '/control_force'), {})
    for tick in range(11):
        stamp_ns = base.stamp_ns(tick)
        for name, values in (('relative_state', STATES[tick]), ('control_force', (0.1, 0.0, 0.0))):
            log.write(f'/{name}', tick, row_of(name).layout.encode(stamp_ns, values))
    log.close()
    assert [tuple(state) for state in read_run(tmp_path).states] == STATES


def test_the_options_of_verify_are_read(tmp_path):
    """A run folder, and keys that are trusted."""
    options = parser('verify').parse_args([str(tmp_path), '--trusted', 'keys'])
    assert options.path == tmp_path and str(options.trusted) == 'keys'
