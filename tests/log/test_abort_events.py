# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What an abort table says in a log: decided again, and compared."""

from __future__ import annotations

from dataclasses import replace

import pytest
from log_runs import chain_run

from rpo_core.chain.chain import Chain
from rpo_core.control.controller import load_controller
from rpo_core.files import scenario
from rpo_core.wire import cdr
from rpo_core.wire.interfaces import RELATIVE_STATE
from rpo_core.world.disturbance import NONE
from rpo_log.verify import verify
from rpo_mcap.errors import ExitCode
from rpo_safety.abort_table import AbortTable, Row
from rpo_safety.assurance import ASSURED_FORCE
from rpo_safety.settings import Assurance

TOPIC = '/stage_status'


def said(state, tick, stage='assurance'):
    """Return what the node says, and of which tick."""
    values = {'stage': stage, 'state': state, 'tick': str(tick), 'reason': 'test'}
    return TOPIC, tick, cdr.encode_status(1, stage, state, 'none', values)


@pytest.fixture(scope='module')
def flown():
    """Twenty seconds; the table holds the chaser after a few."""
    rows = (Row(quantity='speed_m_s', most=0.1, count=3, window=5, reaction='hold'),)
    table = Assurance(abort=AbortTable(table=rows))
    base = replace(scenario.load_scenario('paper_test'), disturbance=NONE, duration_s=20.0)
    return base.equipped(table)


@pytest.fixture(scope='module')
def held(flown):
    """Tick of the hold."""
    chain, signals = Chain.of(flown, load_controller('trained')), {RELATIVE_STATE: flown.start}
    for tick in range(flown.ticks + 1):
        chain.step(tick, signals)
    stage = next(link.stage for link in chain.links if link.stage.name == 'assurance')
    ((tick, state),) = stage.decided()
    assert state == 'holding' and 5 < tick < 150
    return tick


def written(flown, folder, *events):
    """Write the log of the flight with some events, and verify it."""
    run = chain_run(flown, load_controller('trained'), events=events)
    run.write(folder)
    return verify(folder)


def test_a_hold_that_the_table_decides_verifies(blocks, flown, held, tmp_path):
    found = written(flown, tmp_path, said('holding', held))
    assert found.exit_code == ExitCode.OK, found.sentence()
    assert 'assurance' in found.stages


@pytest.mark.parametrize('state', ['aborting', 'resumed', 'warned'])
def test_a_decision_that_the_table_does_not_make_is_a_difference(flown, held, tmp_path, state):
    found = written(flown, tmp_path, said('holding', held), said(state, held + 7)).difference
    assert (found.tick, found.field, found.logged, found.check) == (
        held + 7, 'state', state, 'assurance',
    )  # fmt: skip


def test_a_decision_at_another_tick_is_a_difference(flown, held, tmp_path):
    assert written(flown, tmp_path, said('holding', held - 1)).difference.tick == held - 1


def test_a_decision_that_is_not_told_is_a_gap(flown, held, tmp_path):
    found = written(flown, tmp_path, said('armed', 199, 'nobody'))
    assert found.exit_code == ExitCode.INCOMPLETE
    assert f'does not say that assurance is holding from tick {held}' in found.sentence()


@pytest.mark.parametrize('command', ['inhibit', 'abort', 'without_command'])
def test_a_command_that_was_not_given_is_a_difference(flown, held, tmp_path, command):
    """The table that gets it decides otherwise than the log."""
    at = held - 2
    found = written(flown, tmp_path, said(command, at), said('holding', held)).difference
    assert found.topic == f'/{ASSURED_FORCE}' and found.check == 'assurance'
    assert found.tick >= at
