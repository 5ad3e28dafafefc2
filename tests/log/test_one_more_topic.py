# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""One row in the table of interfaces is one more topic in the log, and in every tool."""

from __future__ import annotations

import numpy as np
import pytest
from log_runs import TOPICS, Run, changed, forge, make_run

from rpo_core.files.validation import InputError
from rpo_core.wire import cdr, interfaces
from rpo_core.wire.interfaces import Interface
from rpo_log.tools.diff import diff
from rpo_log.tools.export import export
from rpo_log.verify import verify
from rpo_mcap.errors import ExitCode
from rpo_mcap.read.run_log import read_run
from rpo_mcap.read.stream import RunReader

TOY_STATE, TOY_FORCE = '/toy_state', '/ns/toy_force'


class ToyRun(Run):
    """A run in which a node says two more signals."""

    def of_tick(self, tick):
        stamp = self.base.stamp_ns(tick)
        toy = cdr.encode_wrench(stamp, 'target_lvlh', (float(tick), -0.0, 1e-300))
        yield from super().of_tick(tick)
        yield TOY_FORCE, toy
        yield TOY_STATE, cdr.encode_odometry(stamp, 'target_lvlh', 'chaser', [tick + 0.5] * 6)


@pytest.fixture
def toy(monkeypatch):
    """Two more topics, and a run that has them."""
    monkeypatch.setattr(interfaces, '_TABLE', dict(interfaces._TABLE))
    interfaces.add(
        Interface('toy_state', interfaces.STATE_TYPE, 'a toy'), before=interfaces.CONTROL_FORCE
    )
    interfaces.add(Interface('toy_force', interfaces.FORCE_TYPE, 'another'))
    run = make_run(5.0)
    return ToyRun(run.flight, run.attachments, (*TOPICS, TOY_STATE, TOY_FORCE))


def test_it_is_logged_in_its_place_and_comes_back(toy, tmp_path):
    assert toy.write(tmp_path, toy.shuffled(3)).whole
    names = [topic.name for topic in RunReader(tmp_path).topics]
    assert names == [
        '/clock', '/relative_state', TOY_STATE, '/control_force', '/disturbance_force',
        '/run_status', TOY_FORCE,
    ]  # fmt: skip
    log = read_run(tmp_path)
    assert log.complete and log.non_canonical == ()
    assert log.values['toy_force'][7].tolist() == [7.0, -0.0, 1e-300]
    np.testing.assert_array_equal(log.values['toy_state'][:, 3], np.arange(51) + 0.5)
    again = [(m.topic.name, m.tick, m.data) for m in RunReader(tmp_path).messages()]
    assert sorted(again) == sorted(toy.messages)


def test_it_is_verified_compared_and_exported(toy, tmp_path):
    toy.write(tmp_path / 'a')
    assert verify(tmp_path / 'a').exit_code == ExitCode.OK
    lost = forge(tmp_path / 'a/run.mcap', tmp_path / 'b', changed(TOY_FORCE, 9, None))
    assert f'1 messages of {TOY_FORCE} are missing' in verify(lost).sentence()
    other = cdr.encode_wrench(toy.base.stamp_ns(12), 'target_lvlh', (0.0, 0.0, 0.0))
    forged = forge(tmp_path / 'a/run.mcap', tmp_path / 'c', changed(TOY_FORCE, 12, other))
    assert diff(tmp_path / 'a', forged).first == {'toy_force': (12, 'wrench.force.x', 12.0, 0.0)}
    export(tmp_path / 'a', tmp_path / 'a.npz')
    with np.load(tmp_path / 'a.npz') as table:
        assert table['toy_fx_n'].tolist() == list(range(51))
        assert table['toy_vz_m_s'][3] == 3.5


def test_a_row_that_no_log_can_hold_is_refused(toy):
    with pytest.raises(InputError, match=r'`picture` must be .* to be logged'):
        interfaces.add(Interface('picture', 'sensor_msgs/msg/Image', 'a picture'))
