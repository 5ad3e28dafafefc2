# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What is proven of a run folder: its files recomputed or compared by digest."""

from __future__ import annotations

import hashlib
import shutil
from pathlib import Path

import pytest
from log_parts import Parts
from log_runs import STATUS, make_run

from rpo_core.wire import cdr
from rpo_log.errors import ExitCode
from rpo_log.signature import sign_run, write_sums
from rpo_log.tools.repair import repair
from rpo_log.verify import Verification, verify


def test_it_says_what_is_recomputed_compared_and_unknown(recorded):
    found = verify(recorded)
    assert found.exit_code == ExitCode.OK
    assert found.recomputed == (
        'phases and figures of run_status', 'records beside the messages, indexes and summary',
        'metadata.yaml',
    )  # fmt: skip
    assert found.digested == ('flown.txt', 'run_info.yaml')
    assert any('texts of events' in what for what in found.unknown)
    text = '\n'.join(found.lines())
    attached = make_run(3.0).attachments['controller.yaml']
    assert f'{hashlib.sha256(attached).hexdigest()}  controller.yaml' in text
    assert 'not signed by a trusted key' in text


def test_a_log_alone_proves_its_flight_and_says_so(recorded, tmp_path):
    shutil.copy(recorded / 'run.mcap', tmp_path)
    found = verify(tmp_path / 'run.mcap')
    assert found.exit_code == ExitCode.OK and found.digested == ()
    assert 'metadata.yaml' not in found.recomputed


def test_without_digests_the_other_files_are_not_known(folder):
    (folder / 'SHA256SUMS').unlink()
    found = verify(folder)
    assert found.exit_code == ExitCode.OK and found.digested == ()
    assert {'flown.txt', 'run_info.yaml'} <= set(found.unknown)


def test_a_log_written_anew_is_not_the_recorded_one(folder):
    """Its messages are the same, its chunks are not; test_signed has other changes of each file."""
    parts = Parts.of(folder / 'run.mcap')
    parts.records = [record for record in parts.records if record is not None]
    parts.write(folder / 'run.mcap')
    found = verify(folder)
    assert found.exit_code == ExitCode.DIFFERENT
    assert 'run.mcap' in found.sentence() and 'SHA256SUMS' in found.sentence()


def test_forged_metadata_with_fitting_digests(folder):
    path = folder / 'metadata.yaml'
    path.write_text(path.read_text().replace('message_count: 31', 'message_count: 30', 1))
    write_sums(folder)
    found = verify(folder)
    assert found.exit_code == ExitCode.INCOMPLETE
    assert 'metadata.yaml is not that of the log; line' in found.sentence()


def run_status(folder: Path, change) -> Verification:
    """Verify a log whose run_status was changed."""
    run = make_run(3.0)
    sent = [(n, t, change(t, d) if n == STATUS else d) for n, t, d in run.messages]
    run.write(folder, [message for message in sent if message[2]])
    return verify(folder)


@pytest.mark.parametrize(
    ('name', 'value', 'field'),
    [
        ('phase', 'aborted', 'level'), ('phase', 'landed', 'phase'),
        ('energy_n2s', '-0.0', 'energy_n2s'), ('tick', '29', 'tick'),
        ('distance_m', None, 'distance_m'), ('distance_m', 'near', 'distance_m'),
        ('saturated_ticks', '1', 'saturated_ticks'), ('time_s', '3.00', 'time_s'),
        ('speed_m_s', 'nan', 'speed_m_s'), ('more', '1', 'values'),
        ('energy_n2s', 'its last digit', 'energy_n2s'),
    ],
)  # fmt: skip
def test_run_status_says_nothing_that_was_not_so(tmp_path, name, value, field):
    def change(tick, data):
        if tick == 0:
            return data
        status = cdr.decode_status(data)
        values = dict(status.values)
        last = '1' if values['energy_n2s'][-1] != '1' else '2'
        values[name] = values['energy_n2s'][:-1] + last if value == 'its last digit' else value
        kept = {key: text for key, text in values.items() if text is not None}
        return cdr.encode_status(*status[:4], kept)

    found = run_status(tmp_path, change).difference
    assert (found.tick, found.topic, found.field) == (30, STATUS, field)


@pytest.mark.parametrize('tick', [0, 30])
def test_a_flight_that_says_neither_begin_nor_end_is_not_whole(tmp_path, tick):
    found = run_status(tmp_path, lambda t, d: None if t == tick else d)
    assert found.exit_code == ExitCode.INCOMPLETE


def test_a_repaired_run_has_new_digests(folder, keys):
    sign_run(folder, keys / 'me.pem')
    data = (folder / 'run.mcap').read_bytes()
    (folder / 'run.mcap').write_bytes(data[: len(data) * 3 // 4])
    assert verify(folder).exit_code == ExitCode.DIFFERENT or verify(folder).gaps
    output = repair(folder).output
    found = verify(output)
    assert not found.faults and 'run_info.yaml' in found.digested
    assert not (output / 'SHA256SUMS.sig').exists()
