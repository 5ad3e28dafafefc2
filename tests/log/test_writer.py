# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The same bytes in any order of arrival, and no fault of the disk reaches the flight."""

from __future__ import annotations

import hashlib
import shutil
from dataclasses import replace
from pathlib import Path

import messages
import numpy as np
import pytest
import yaml
from landing import rest_at_landing
from log_runs import CLOCK, FORCE, STATE, file_size_limit

from rpo_core import files
from rpo_core.scenario.scenario import load_scenario
from rpo_core.wire import cdr, interfaces
from rpo_core.world.disturbance import NONE
from rpo_log.errors import ExistsAlready, ExitCode, LogError
from rpo_log.format import run as run_format
from rpo_log.manifests import Manifests
from rpo_log.read.run_log import read_run
from rpo_log.read.stream import RunReader
from rpo_log.tools.diff import inspect
from rpo_log.tools.repair import repair
from rpo_log.verify import verify
from rpo_log.write.writer import RunLogWriter


def digests(folder: Path) -> dict[str, str]:
    return {p.name: hashlib.sha256(p.read_bytes()).hexdigest() for p in sorted(folder.iterdir())}


@pytest.mark.parametrize('options', [{}, {'split_s': 7.0}, {'split_bytes': 30_000}])
@pytest.mark.parametrize('seed', rest_at_landing(range(4), quick=2))
def test_the_same_bytes_in_any_order_of_arrival(run, tmp_path, seed, options):
    run.write(tmp_path / 'a', **options)
    summary = run.write(tmp_path / 'b', run.shuffled(seed), **options)
    assert summary.whole
    assert digests(tmp_path / 'a') == digests(tmp_path / 'b')


def test_the_same_bytes_by_the_stamps_alone_and_whatever_the_senders_buffers_held(run, tmp_path):
    """Of an odometry there is a gap before its floats, which the middleware leaves as it was.

    Of a clock, other options in its header, or seconds among its nanoseconds, change no time.
    """
    run.write(tmp_path / 'a')
    writer = RunLogWriter(tmp_path / 'b', run.base, run.topics, run.attachments)
    for name, _, data in run.messages:
        if name == STATE:
            writer.record(name, data[:39] + b'\x7f\x7f\x7f\x7f\x7f' + data[44:])
        elif name == CLOCK:
            seconds, nanoseconds = cdr.STAMP.unpack(data[4:])
            odd = cdr.STAMP.pack(seconds - 1, nanoseconds + 1_000_000_000)
            writer.record(name, b'\x00\x01\x04\x00' + odd)
        writer.record(name, data)
    assert writer.close().whole
    assert digests(tmp_path / 'a') == digests(tmp_path / 'b')


@pytest.mark.parametrize('names', [(STATE, '/odometry'), (STATE, '/beta/relative_state')])
def test_topics_without_or_with_the_same_role_are_refused(short_run, tmp_path, names):
    with pytest.raises(LogError, match='role'):
        RunLogWriter(tmp_path / 'log', short_run.base, names, {})
    assert not (tmp_path / 'log').exists()


def test_summary_counts_what_is_wrong(short_run, tmp_path):
    sent = [m for m in short_run.messages if m[:2] != (FORCE, 20)]  # one is lost
    sent.append(sent[-1])  # one comes twice
    last = short_run.base.last_tick
    other = messages.wrench(short_run.base.stamp_ns(last), 'target_lvlh', [9.0, 9.0, 9.0])
    sent.append((FORCE, last, other))  # one differs
    sent.append((STATE, last + 1, short_run.messages[1][2]))  # one is of no tick
    sent.append((STATE, 3, b'\x00\x01\x00\x00 nonsense'))  # one is no odometry
    sent.append(('/tf', 3, other))  # one is of a topic that is not recorded
    sent.append((FORCE, 20, other))  # one is far too late
    summary = short_run.write(tmp_path, sent)
    assert summary.missing == {FORCE: (1, 20)}
    assert sum(summary.duplicates.values()) == 1
    assert summary.differing == {FORCE: (1, last)}
    assert summary.ignored == {FORCE: 1}
    assert summary.foreign == 3
    assert summary.lost == 0 and summary.failure is None
    assert not summary.whole
    assert f'1 missing on {FORCE}, the first at tick 20' in summary.sentence()
    log = read_run(tmp_path)
    assert log.gaps == (f'1 messages of {FORCE} are missing',)
    assert np.isnan(log.forces_n[20]).all() and not np.isnan(log.forces_n[21]).any()
    assert (log.forces_n[last] == short_run.flight.forces_n[last]).all()  # the first was kept


def test_an_existing_log_is_never_overwritten_without_being_asked_to(short_run, tmp_path):
    short_run.write(tmp_path)
    (tmp_path / 'notes.txt').write_text('mine')
    before = digests(tmp_path)
    with pytest.raises(ExistsAlready, match='holds a log already') as found:
        short_run.write(tmp_path)
    assert '`--overwrite`' in str(found.value) and '-p overwrite:=true' in str(found.value)
    assert digests(tmp_path) == before
    short_run.write(tmp_path, split_s=2.0, overwrite=True)
    assert sorted(digests(tmp_path)) == [
        'metadata.yaml', 'notes.txt', 'run_0.mcap', 'run_1.mcap', 'run_2.mcap',
    ]  # fmt: skip


def test_messages_after_the_end_are_counted(short_run, tmp_path):
    writer = short_run.fed(tmp_path)
    first = writer.close()
    writer.write(*short_run.messages[0])
    assert writer.close().lost == first.lost + 1


@pytest.mark.parametrize('size', [20_000, 40_001, 70_003])
def test_a_full_disk_ends_the_log_and_not_the_flight(run, tmp_path, size):
    with file_size_limit(size):
        summary = run.write(tmp_path)
    assert summary.failure == 'File too large'
    assert summary.lost + sum(summary.messages.values()) == len(run.messages)
    assert not summary.whole
    assert 'File too large' in summary.sentence()
    log = read_run(tmp_path)
    assert log.damage
    logged = sum(len(present) for present in (log.ticks,)) * 4 + len(log.statuses)
    assert logged == sum(summary.messages.values())
    np.testing.assert_array_equal(log.states, run.flight.states[: len(log.ticks)])


def test_a_disk_that_is_full_when_the_log_ends(short_run, tmp_path):
    writer = short_run.fed(tmp_path)
    with file_size_limit((tmp_path / 'run.mcap').stat().st_size + 10):
        summary = writer.close()
    assert summary.failure == 'File too large'
    assert summary.lost == 0  # only the index lacks
    assert len(read_run(repair(tmp_path).output).ticks) == 51


@pytest.mark.parametrize('moved', [False, True])
def test_a_folder_that_vanishes_is_noticed_and_one_that_is_renamed_is_no_loss(run, tmp_path, moved):
    folder, half = tmp_path / 'log', len(run.messages) // 2
    writer = run.fed(folder, run.messages[:half])
    assert writer.failure is None
    folder.rename(tmp_path / 'moved') if moved else shutil.rmtree(folder)
    for message in run.messages[half:]:
        writer.write(*message)
    summary = writer.close()
    assert not folder.exists()
    if moved:
        assert summary.failure == 'No such file or directory'  # metadata.yaml has no place
        assert sum(summary.messages.values()) == len(run.messages)
        assert not read_run(tmp_path / 'moved').damage
    else:
        assert summary.failure == 'the file was deleted' and summary.lost > 0


def test_of_two_controllers_the_first_answer_is_logged_and_the_other_named(run, tmp_path):
    """By the recorder, in the log, and by whoever reads it; the messages are the same."""
    run.write(tmp_path / 'a')
    sent = []
    for name, tick, data in run.messages:
        sent.append((name, tick, data))
        if name == FORCE and tick >= 100:
            other = messages.wrench(run.base.stamp_ns(tick), 'target_lvlh', (0.4, -0.4, 0.4))
            sent.append((name, tick, other))
    summary = run.write(tmp_path / 'b', sent)
    line = f'301 messages of {FORCE} differ from the first of their tick, from tick 100 on'
    assert summary.differing_lines() == [line] and line in summary.sentence()
    assert not summary.whole
    logs = [RunReader(tmp_path / name) for name in 'ab']
    assert list(logs[0].messages()) == list(logs[1].messages())
    found = verify(tmp_path / 'b')
    assert (found.exit_code, found.gaps) == (ExitCode.INCOMPLETE, (line,))
    assert inspect(tmp_path / 'b').gaps == (line,)
    assert repair(tmp_path / 'b').exit_code == ExitCode.OK
    assert verify(tmp_path / 'b-repaired').gaps == (line,)
    assert verify(tmp_path / 'a').exit_code == ExitCode.OK
    at = next(i for i, (name, tick, _) in enumerate(sent) if (name, tick) == (FORCE, 200))
    sent[at], sent[at + 1] = sent[at + 1], sent[at]  # the recorder heard the other one first
    run.write(tmp_path / 'c', sent)
    found = verify(tmp_path / 'c')
    assert found.difference.tick == 200 and found.sentence().endswith(f'(controller); {line}')


def test_what_differs_is_read_as_one_line_each(short_run, tmp_path):
    """Anybody may have written it."""
    run = replace(short_run, attachments={**short_run.attachments, 'differing.yaml': b'- a\x1bb\n'})
    run.write(tmp_path)
    assert read_run(tmp_path).lacks == ('a\\x1bb',)


def test_a_manifest_without_a_usable_controller_is_not_attached_in_flight():
    good = files.read_text(files.find('controller', 'handmade'))
    found = Manifests()
    values = {'role': 'controller', 'file.controller.yaml': good}
    texts = {'parameter.a': f'[{"1" * 998}]', 'parameter.b': f'[{"1" * 999}]'}  # at most 1000
    assert found.take('a', values | texts) == ''
    attached = found.attachments({})
    assert attached['controller.yaml'] == good.encode()
    told = yaml.safe_load(attached['parameters.yaml'])['a']
    assert told == {'a': [int('1' * 998)], 'b': texts['parameter.b']}
    for text in ('', '[', good.replace('z_half_width', '\ufffdz_half_width')):
        said = found.take('b', {**values, 'file.controller.yaml': text})
        assert said == 'b has no usable controller file' and found.another_controller() is None
    assert found.take('a', values) == ''


def test_the_first_plant_is_that_of_the_run():
    text = files.read_text(files.find('scenario', 'paper_test'))
    values, found = {'role': 'plant', 'run': 'a', 'file.scenario.yaml': text}, Manifests()
    assert found.missing == ['plant'] and found.run_id == ''
    for bad, why in (('[', 'no usable scenario'), (None, 'no usable scenario')):
        said = found.take('b', {**values, 'file.scenario.yaml': bad} if bad else {'role': 'plant'})
        assert why in said
    training = files.read_text(files.find('scenario', 'paper_training'))
    assert 'a set of scenarios' in found.take('b', {**values, 'file.scenario.yaml': training})
    assert found.scenario is None
    assert found.take('a', values) == '' == found.take('a again', values)
    assert found.scenario == load_scenario('paper_test') and found.run_id == 'a'
    said = found.take('b', {**values, 'run': 'b'})
    assert said == 'b is a second plant: the log is that of the first'
    assert found.missing == ['controller', 'disturbance']
    good = files.read_text(files.find('controller', 'handmade'))
    for i in range(30):
        assert found.take(f'n{i}', {'role': f'r{i}'}) == ''
    assert found.take('c', {'role': 'controller', 'file.controller.yaml': good}) == ''
    assert found.take('more', {'role': 'more'}) == 'more has a role too many'
    assert found.take('n0', {'role': 'r0'}) == ''
    assert found.missing == ['disturbance']
    assert found.another_controller() == (run_format.CONTROLLER, good.encode())
    other = good.replace('handmade', 'other')
    assert found.take('d', {'role': 'controller', 'file.controller.yaml': other}) == ''
    assert found.another_controller() == (run_format.controller_name(2), other.encode())
    assert found.another_controller() is None


@pytest.mark.parametrize(('name', 'disturbed'), [('paper_test', True), ('tumbling_docking', False)])
def test_due_each_tick_is_what_the_scenario_makes_and_what_else_is_published(name, disturbed):
    """A node that a scenario does not need may run, and need not answer.

    In free running, what was applied is due too.
    """
    chosen, found = load_scenario(name), Manifests()
    chosen = chosen if disturbed else replace(chosen, disturbance=NONE)
    plain, among = ({row.name for row in found.due_each_tick(chosen, lambda _, n=n: n)}
                    for n in (0, 1))  # fmt: skip
    assert {interfaces.RELATIVE_STATE, interfaces.CONTROL_FORCE} <= plain < among
    assert interfaces.REFERENCE_STATE in among
    assert (interfaces.NAVIGATION_STATE in among) == (chosen.attitude is not None)
    values = {'role': 'plant', 'file.scenario.yaml': files.read_text(files.find('scenario', name))}
    values |= {'parameter.mode': 'free_running', 'parameter.publish_clock': 'True'}
    assert found.take('plant', values) == ''
    more = {row.name for row in found.due_each_tick(chosen, lambda _: 0)} - plain
    force = interfaces.APPLIED_BODY_FORCE if chosen.attitude else interfaces.APPLIED_FORCE
    assert more == {interfaces.CLOCK, force, *[interfaces.APPLIED_DISTURBANCE] * disturbed}
