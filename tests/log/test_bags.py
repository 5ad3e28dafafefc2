# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Ordinary bags of a run's topics, as another library writes them: read as a log, gaps named."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import messages
import pytest
from log_parts import WALL_NS, Raw, joined, packed, write_bag
from log_runs import CLOCK, FORCE, STATE, Run, flipped
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Channel, Chunk, Message
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2.enums import CompressionMode

from rpo.reports import page
from rpo.reports.logged import logged_flight
from rpo_core.files.validation import InputError
from rpo_core.wire import cdr
from rpo_log.bag import open_run
from rpo_log.errors import ExitCode, LogError
from rpo_log.read.run_log import read_run
from rpo_log.tools.diff import diff, inspect
from rpo_log.tools.export import export
from rpo_log.verify import verify


def manifests(
    run: Run, plant: dict[str, str] | None = None, controller: dict[str, str] | None = None
) -> list[tuple[str, int, bytes]]:
    """What the nodes say of themselves, without tick; more of the plant and the controller."""
    files = {name: text.decode() for name, text in run.attachments.items()}
    plant, controller = plant or {}, controller or {}
    values = (
        {'role': 'plant', 'run': 'a', 'file.scenario.yaml': files['scenario.yaml'], **plant},
        {'role': 'controller', 'file.controller.yaml': files['controller.yaml'],
         **controller},
        {'role': 'disturbance'},
    )  # fmt: skip
    return [('/node_manifest', 0, cdr.encode_status(0, v['role'], '', 'none', v)) for v in values]


@pytest.fixture(scope='module')
def bags(short_run: Run, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """One flight as four bags: in both formats, in a namespace, without manifests."""
    folder = tmp_path_factory.mktemp('bags')
    told, bare = manifests(short_run), short_run.shuffled(5, spread=3.0)
    return {
        'sqlite3': write_bag(folder / 'any name', told + bare, plugin=StoragePlugin.SQLITE3),
        'mcap': write_bag(folder / 'run', told + bare, pressed=CompressionMode.MESSAGE),
        'namespace': write_bag(
            folder / 'spaced', told + bare, '/a/b', pressed=CompressionMode.FILE
        ),
        'bare': write_bag(folder / 'bare', bare),
        'log': short_run.write(folder / 'log') and folder / 'log',
    }


@pytest.mark.parametrize('kind', ['sqlite3', 'mcap', 'namespace'])
def test_a_bag_with_manifests_is_as_good_as_a_log(bags, kind, short_run):
    found = verify(bags[kind])
    assert found.exit_code == ExitCode.OK, found.sentence()
    assert found.ticks == 51 and 'controller' in found.stages
    assert not [what for what in found.recomputed if 'records beside' in what]
    assert any('records of the bag' in unknown for unknown in found.unknown)
    if kind != 'namespace':
        differs = diff(bags[kind], bags['log'])
        assert not differs.first and differs.remarks == ['parameters.yaml differs']


def test_a_remapped_topic_of_a_bag_is_found_where_its_nodes_say(short_run, tmp_path):
    moved = [('/truth/pose' if n == STATE else n, t, d) for n, t, d in short_run.messages]
    where = {'publishes.relative_state': '/truth/pose', 'hears.control_force': FORCE}
    heard = {'hears.relative_state': '/truth/pose', 'publishes.control_force': FORCE}
    bag = write_bag(tmp_path / 'bag', [*manifests(short_run, where, heard), *moved])
    assert verify(bag).exit_code == ExitCode.OK, verify(bag).sentence()


@pytest.mark.parametrize('kind', ['sqlite3', 'bare'])
def test_every_reader_takes_a_bag(bags, kind, tmp_path):
    path, scenario = bags[kind], 'paper_test' if kind == 'bare' else ''
    export(path, tmp_path / 'bag.csv')
    export(bags['log'], tmp_path / 'log.csv')
    assert (tmp_path / 'bag.csv').read_bytes() == (tmp_path / 'log.csv').read_bytes()
    info = inspect(path / 'metadata.yaml')
    assert info.files[0][0].parent == path and info.ticks == (0, 50)
    assert page.subject_of(str(path)) == page.subject_of(str(info.files[0][0])) == 'run'
    shown = logged_flight(read_run(open_run(path, scenario)))
    # the shipped scenario is longer than what was flown
    assert len(shown.flight.states) == 51 and shown.whole != bool(scenario)


def test_a_table_of_a_bag_has_the_attitude_and_torques_of_its_messages(turning, tmp_path):
    """Also of one that carries no scenario, whose table lacked them in silence."""
    with (turning / 'run.mcap').open('rb') as file:
        found = [(c.topic, 0, m.data) for _, c, m in make_reader(file).iter_messages()]
    export(write_bag(tmp_path / 'bag', found), tmp_path / 'bag.csv')
    export(turning, tmp_path / 'log.csv')
    of_log = (tmp_path / 'log.csv').read_bytes()
    assert (tmp_path / 'bag.csv').read_bytes() == of_log
    names = of_log.split(b'\r\n')[0].decode().split(',')
    some = {'chaser_attitude_qw', 'body_tx_nm', 'exerted_tx_nm', 'attitude_y_z_rad2'}
    assert some <= set(names) and len(set(names)) == len(names)


def test_what_a_bag_lacks_is_named_and_can_be_given(bags, tmp_path, short_run):
    info = inspect(bags['bare'])
    assert info.exit_code == ExitCode.INCOMPLETE
    assert info.gaps[0] == 'it has no manifest of the plant'
    assert 'every 0.1 s' in info.gaps[1] and len(info.gaps) == 2
    with pytest.raises(LogError, match=r'must carry scenario.yaml.*--scenario'):
        verify(bags['bare'])
    flown = tmp_path / 'flown.yaml'
    flown.write_bytes(short_run.attachments['scenario.yaml'])
    found = verify(bags['bare'], scenario=str(flown), controller='handmade')
    assert found.exit_code == ExitCode.INCOMPLETE and found.difference is None
    assert all(word in found.sentence() for word in ('no manifest', 'controller', 'is given'))
    other = verify(bags['bare'], scenario=str(flown), controller='pd')
    assert other.difference is not None and other.difference.check == 'controller'
    for path in (bags['sqlite3'], bags['log']):
        with pytest.raises(InputError, match='for a bag that does not carry them'):
            verify(path, scenario='paper_test')


def test_holes_and_contradictions_in_a_bag_are_gaps(short_run, tmp_path):
    lost = [m for m in short_run.messages if m[:2] != (STATE, 20)]
    change = flipped(FORCE, 30)
    at = next(i for i, m in enumerate(lost) if m[:2] == (FORCE, 30))
    lost.insert(at + 1, (FORCE, 30, change(*lost[at])))
    bag = write_bag(tmp_path / 'bag', [*manifests(short_run), *lost])
    found = verify(bag)
    assert found.exit_code == ExitCode.INCOMPLETE, found.sentence()
    assert f'1 messages of {STATE} are missing' in found.sentence()
    assert f'1 messages of {FORCE} differ from the first of their tick' in found.sentence()
    forged = [(n, t, change(n, t, d)) for n, t, d in short_run.messages]
    bag = write_bag(tmp_path / 'forged', [*manifests(short_run), *forged])
    assert (bad := verify(bag).difference) is not None and bad.tick == 30


def test_a_chunk_that_rosbags_does_not_show_and_others_do_is_named(short_run, tmp_path):
    """rosbags follows the index of a bag; whoever reads it from its begin sees all chunks."""
    bag = write_bag(tmp_path / 'bag', [*manifests(short_run), *short_run.messages])
    file = next(bag.glob('*.mcap'))
    raw = Raw(file.read_bytes())
    channel = next(one for _, one in raw.records(Channel) if one.topic == STATE)
    lie = joined(packed(Message(channel.id, WALL_NS, short_run.messages[1][2], WALL_NS, 0)))
    raw.data.append(packed(Chunk('', lie, WALL_NS, WALL_NS, 0, len(lie))))
    unused = Raw(file.read_bytes())
    at = next(at for at, _ in unused.records(Channel))
    unused.summary.insert(at, packed(replace(channel, id=77, topic='/a_topic_without_messages')))
    file.write_bytes(unused.bytes())
    assert verify(bag).exit_code == ExitCode.OK  # as rosbag2 writes it
    file.write_bytes(raw.bytes())
    found = verify(bag)
    assert found.exit_code == ExitCode.INCOMPLETE and found.difference is None
    assert f'{file.name}: the chunk index records of its summary do not lead' in found.sentence()
    raw.data[-1] = (Opcode.CHUNK, bytes(7))
    file.write_bytes(raw.bytes())
    assert f'the indexes of {file.name} were not compared' in verify(bag).sentence()


def test_what_is_no_bag_of_one_run_is_refused(short_run, tmp_path):
    others = [(f'/b{name}', tick, data) for name, tick, data in short_run.messages]
    states, clock = ([m for m in short_run.messages if m[0] == of] for of in (STATE, CLOCK))
    jitter = [(n, t, messages.odometry(t * t * 17 + 3, 'target_lvlh', 'chaser', [0.0] * 6))
              for n, t, _ in states]  # fmt: skip
    forces = [m for m in short_run.messages if m[0] == FORCE]
    broken = write_bag(tmp_path / 'broken', short_run.messages)
    file = next(broken.glob('*.mcap'))
    file.write_bytes(file.read_bytes()[:-100])
    cases = {
        write_bag(tmp_path / 'two', [*short_run.messages, *others]): 'several runs',
        write_bag(tmp_path / 'open', [*states, *clock]): 'control_force; it has /clock, /relative',
        write_bag(tmp_path / 'jitter', [*jitter, *forces]): 'no length of a tick',
        broken: 'cannot be read as a bag',
    }
    for path, sentence in cases.items():
        with pytest.raises(LogError, match=sentence):
            open_run(path)
