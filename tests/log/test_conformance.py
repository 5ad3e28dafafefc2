# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A run's log row by row against what MCAP's registry and rosbag2 (Jazzy) ask of it."""

from __future__ import annotations

import re
import zlib
from pathlib import Path

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from kept import assert_kept
from log_runs import TOPICS
from mcap import records as mcap_records
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from rpo_core.wire import interfaces
from rpo_log.tools.repair import repair
from rpo_mcap.errors import LogError
from rpo_mcap.format import rosbag2
from rpo_mcap.write.mcap_file import LIBRARY, PROFILE, McapFile
from rpo_mcap.write.side_file import HealthLogWriter

KEPT = Path(__file__).with_name('metadata.txt')
"""The metadata.yaml of the run, as version 9 of rosbag2 has it."""


class Log:
    """Every record of a log, as the mcap library reads it, checksums checked."""

    def __init__(self, path: Path) -> None:
        self.path = path
        with path.open('rb') as stream:
            self.records = list(StreamReader(stream, validate_crcs=True).records)
        with path.open('rb') as stream:
            self.outer = list(StreamReader(stream, emit_chunks=True).records)
        with path.open('rb') as stream:
            self.summary = make_reader(stream).get_summary()

    def of(self, kind: type) -> list:
        return [record for record in self.records if isinstance(record, kind)]


@pytest.fixture(scope='module')
def records(log) -> Log:
    return Log(log)


def test_header(records):
    header = records.records[0]
    assert header.profile == 'ros2'
    assert header.library == 'rpo_log/1'


def test_schemas(records):
    found = {schema.id: schema for schema in records.of(mcap_records.Schema)}
    types = {interfaces.find(name).type for name in TOPICS}
    assert {schema.name for schema in found.values()} == types
    for schema in found.values():
        assert schema.id != 0
        assert schema.encoding == 'ros2msg'
        text = schema.data.decode()
        assert not text.startswith(('=', 'MSG:'))
        parts = text.split('\n' + 80 * '=' + '\n')
        names = [part.partition('\n')[0] for part in parts[1:]]
        assert all(re.fullmatch(r'MSG: \w+/\w+', name) for name in names)
        assert len(set(names)) == len(names)


def test_channels(records):
    schemas_by_id = {schema.id: schema.name for schema in records.of(mcap_records.Schema)}
    found = {channel.topic: channel for channel in records.of(mcap_records.Channel)}
    assert set(found) == set(TOPICS)
    for name, channel in found.items():
        kind = interfaces.find(name).type
        assert schemas_by_id[channel.schema_id] == kind
        assert channel.message_encoding == 'cdr'
        assert channel.metadata['topic_type_hash'] == rosbag2.definition(kind).type_hash


def test_metadata_yaml_is_that_of_the_list(records, log):
    """Without anchors: not every reader follows them."""
    assert_kept(KEPT, (log.parent / 'metadata.yaml').read_text().splitlines())
    topics = yaml.safe_load(KEPT.read_text())['rosbag2_bagfile_information']
    said = [each['topic_metadata'] for each in topics['topics_with_message_count']]
    profiles = {topic['name']: topic['offered_qos_profiles'] for topic in said}
    for channel in records.of(mcap_records.Channel):
        expected = yaml.safe_dump(profiles[channel.topic], sort_keys=False)
        assert channel.metadata['offered_qos_profiles'] == expected.rstrip('\n')


def test_the_declared_qos_is_what_the_nodes_offer():
    from rpo_ros import qos

    nodes = {
        interfaces.CLOCK: qos.CLOCK,
        interfaces.RELATIVE_STATE: qos.LOCKSTEP,
        interfaces.CONTROL_FORCE: qos.LOCKSTEP,
        interfaces.DISTURBANCE_FORCE: qos.LOCKSTEP,
        interfaces.RUN_STATUS: qos.LATCHED,
    }
    for role, profile in nodes.items():
        declared = interfaces.row_of(role).qos
        assert declared.depth == profile.depth, role
        assert rosbag2.qos_document(declared)['history'] == profile.history.short_key, role
        assert declared.reliability == profile.reliability.short_key, role
        assert declared.durability == profile.durability.short_key, role
    frames = ('target_lvlh', 'chaser')
    assert interfaces.row_of(interfaces.RELATIVE_STATE).frames == frames
    for force in (interfaces.CONTROL_FORCE, interfaces.DISTURBANCE_FORCE):
        assert interfaces.row_of(force).frames == frames[:1]


def test_messages_carry_simulated_time_and_tick(records, run):
    found = records.of(mcap_records.Message)
    assert len(found) == len(run.messages)
    for message in found:
        stamp = run.base.stamp_ns(message.sequence)
        assert (message.log_time, message.publish_time) == (stamp, stamp)
        assert message.data[:4] == b'\x00\x01\x00\x00'


def test_messages_are_ordered_by_tick_then_topic(records, run):
    names = {channel.id: channel.topic for channel in records.of(mcap_records.Channel)}
    found = [(names[m.channel_id], m.sequence, m.data) for m in records.of(mcap_records.Message)]
    assert found == run.messages


def test_rosbag2_record_at_open_and_at_close(records, log, run):
    said = [r.metadata for r in records.of(mcap_records.Metadata) if r.name == 'rosbag2']
    assert len(said) == 2
    opened, closed = (yaml.safe_load(values['serialized_metadata']) for values in said)
    assert list(opened) == list(closed)
    assert (opened['version'], opened['message_count']) == (9, 0)
    on_disk = yaml.safe_load((log.parent / 'metadata.yaml').read_text())
    assert {'rosbag2_bagfile_information': closed} == on_disk


def test_statistics(records, run):
    statistics = records.summary.statistics
    assert statistics.message_count == len(run.messages)
    assert statistics.message_start_time == run.base.epoch_ns
    assert statistics.message_end_time == run.base.stamp_ns(run.base.last_tick)
    assert statistics.chunk_count == len(records.summary.chunk_indexes) > 0
    assert statistics.attachment_count == 3
    assert statistics.metadata_count == 3
    assert statistics.channel_count == len(records.summary.channels) == 5
    assert statistics.schema_count == len(records.summary.schemas) == 4
    assert sum(statistics.channel_message_counts.values()) == len(run.messages)


def test_chunks_are_zstd_with_checksums_and_indexes(records):
    found = [record for record in records.outer if isinstance(record, mcap_records.Chunk)]
    indexes = records.summary.chunk_indexes
    assert [chunk.compression for chunk in found] == ['zstd'] * len(indexes)
    for chunk, index in zip(found, indexes, strict=True):
        assert chunk.uncompressed_crc != 0
        inside = breakup_chunk(chunk, validate_crc=True)
        times = [m.log_time for m in inside if isinstance(m, mcap_records.Message)]
        assert (min(times), max(times)) == (index.message_start_time, index.message_end_time)
        assert index.message_index_offsets
    at = [index.chunk_start_offset for index in indexes]
    assert at == sorted(at)


def test_message_indexes_point_at_the_messages(records):
    content = records.path.read_bytes()
    index = records.summary.chunk_indexes[-2]
    for channel_id, offset in index.message_index_offsets.items():
        assert content[offset] == 0x07
        length = int.from_bytes(content[offset + 1 : offset + 9], 'little')
        entries = content[offset + 15 : offset + 9 + length]
        assert int.from_bytes(content[offset + 9 : offset + 11], 'little') == channel_id
        assert len(entries) % 16 == 0 and entries


def test_whole_file_checksums(records):
    content = records.path.read_bytes()
    end = next(record for record in records.outer if isinstance(record, mcap_records.DataEnd))
    start = records.outer[-1].summary_start
    assert end.data_section_crc == zlib.crc32(content[: start - 13]) != 0
    assert records.outer[-1].summary_crc != 0


def test_no_group_of_the_summary_is_empty(log, tmp_path):
    """An empty one is an error to `mcap doctor`: the files beside the log name no groups."""
    for name, messages in (('empty', 0), ('filled', 3)):
        (tmp_path / name).mkdir()
        health = HealthLogWriter(tmp_path / name)
        for stamp_ns in range(messages):
            health.write(stamp_ns, bytes(12))
        health.close()
    (tmp_path / 'cut.mcap').write_bytes((tmp_path / 'filled/health.mcap').read_bytes()[:-9])
    repair(tmp_path / 'cut.mcap', tmp_path / 'mended.mcap')
    beside = [tmp_path / name for name in ('empty/health.mcap', 'filled/health.mcap')]
    for path in (log, *beside, tmp_path / 'mended.mcap'):
        groups = Log(path).of(mcap_records.SummaryOffset)
        assert len(groups) == (6 if path.name == 'run.mcap' else 0)
        assert all(group.group_length for group in groups)


def test_attachments_are_the_bytes_given(records, run):
    found = {record.name: record for record in records.of(mcap_records.Attachment)}
    assert {name: record.data for name, record in found.items()} == run.attachments
    for record in found.values():
        assert record.media_type == 'application/yaml'
        assert (record.log_time, record.create_time) == (run.base.epoch_ns, run.base.epoch_ns)
    # before the first chunk: a file that is cut short has them
    kinds = [type(record) for record in records.outer]
    assert max(i for i, k in enumerate(kinds) if k is mcap_records.Attachment) < kinds.index(
        mcap_records.Chunk
    )


def test_the_run_record_holds_the_ticks(records, run):
    (record,) = [r for r in records.of(mcap_records.Metadata) if r.name == 'rpo_run']
    assert record.metadata == {
        'epoch_ns': str(run.base.epoch_ns),
        'dt_ns': str(run.base.dt_ns),
        'last_tick': str(run.base.last_tick),
    }


STORE = get_typestore(Stores.ROS2_JAZZY)
TYPES = sorted({row.type for row in interfaces.rows()})


@pytest.mark.parametrize('name', TYPES)
def test_hash_is_that_of_the_type(name):
    assert rosbag2.definition(name).type_hash == STORE.hash_rihs01(name)


@pytest.mark.parametrize('name', TYPES)
def test_text_defines_the_type_and_what_it_needs(name):
    text = rosbag2.definition(name).text
    parsed = get_types_from_msg(text, name)
    theirs, _ = STORE.generate_msgdef(name, ros_version=2)
    wanted = get_types_from_msg(theirs, name)
    assert parsed.keys() == wanted.keys()
    for dependency, (_, fields) in wanted.items():
        assert parsed[dependency][1] == fields
    headings = re.findall(r'^={80}\nMSG: (.*)$', text, re.MULTILINE)
    assert len(headings) == len(set(headings)) == len(wanted) - 1


def test_says_where_it_looked(monkeypatch, tmp_path):
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(tmp_path))
    monkeypatch.setattr('sys.prefix', str(tmp_path / 'prefix'))
    rosbag2.definition.cache_clear()
    with pytest.raises(LogError, match=r'Clock\.msg.*ROS environment') as found:
        rosbag2.definition('rosgraph_msgs/msg/Clock')
    rosbag2.definition.cache_clear()
    assert str(tmp_path) in str(found.value)


@given(
    st.lists(
        st.tuples(
            st.lists(st.tuples(st.sampled_from([1, 2]), st.binary(max_size=40)), max_size=4),
            st.integers(0, 99),
            st.booleans(),
        ),
        max_size=12,
    )
)
def test_messages_and_chunks_are_written_as_by_the_library(tmp_path_factory, added):
    """Ours packs them by itself; in any order of stamps, and a chunk wherever it ends."""
    folder = tmp_path_factory.mktemp('mcap')
    ours, theirs = McapFile(folder / 'ours.mcap'), (folder / 'theirs.mcap').open('wb')
    other = Writer(theirs, chunk_size=1 << 62, enable_data_crcs=True)
    other.start(profile=PROFILE, library=LIBRARY)
    assert ours.register_schema('a', 'b', b'c') == other.register_schema('a', 'b', b'c') == 1
    for topic in ('/x', '/y'):
        ours.register_channel(topic, 'cdr', 1, {})
        other.register_channel(topic, 'cdr', 1, {})
    for sequence, (messages, stamp_ns, ends) in enumerate(added):
        if messages:
            ours.add_messages(stamp_ns, sequence, messages)
        for channel, data in messages:
            other.add_message(channel, stamp_ns, data, stamp_ns, sequence)
        if ends:
            ours.flush()
            other.flush()
    ours.finish()
    ours.close()
    other.finish()
    theirs.close()
    assert (folder / 'ours.mcap').read_bytes() == (folder / 'theirs.mcap').read_bytes()
