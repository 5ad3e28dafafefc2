# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A run's log row by row against what MCAP's registry and rosbag2 (Jazzy) ask of it."""

from __future__ import annotations

import io
import itertools
import re
import textwrap
from pathlib import Path

import pytest
import yaml
from kept import assert_kept
from log_runs import STATUS, TOPICS
from mcap.records import SummaryOffset
from mcap.stream_reader import StreamReader
from mcap.writer import Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from rpo_core.wire import interfaces
from rpo_log.errors import LogError
from rpo_log.format import rosbag2

KEPT = Path(__file__).with_name('metadata.txt')
"""The metadata.yaml of the run, as version 9 of rosbag2 has it."""


def test_metadata_yaml_is_that_of_the_list(log):
    """Without anchors: not every reader follows them."""
    assert_kept(KEPT, (log.parent / 'metadata.yaml').read_text().splitlines())


def test_a_log_is_what_the_library_writes(log, run):
    """Byte for byte: the records in their order, each chunk where the rule ends it."""
    closing = textwrap.dedent(KEPT.read_text().partition('\n')[2])
    opening = re.sub(r'(message_count|nanoseconds\w*): \d+', r'\1: 0', closing)
    base, content = run.base, io.BytesIO()
    writer = Writer(content, chunk_size=1 << 62, enable_data_crcs=True)
    writer.start('ros2', 'rpo_log/1')
    writer.add_metadata('rosbag2', {'serialized_metadata': opening})
    ticks = {'epoch_ns': base.epoch_ns, 'dt_ns': base.dt_ns, 'last_tick': base.last_tick}
    writer.add_metadata('rpo_run', {name: str(value) for name, value in ticks.items()})
    for name, data in sorted(run.attachments.items()):
        writer.add_attachment(base.epoch_ns, base.epoch_ns, name, 'application/yaml', data)
    schemas, channels = {}, {}
    for entry in yaml.safe_load(closing)['topics_with_message_count']:
        topic = entry['topic_metadata']
        kind, profiles = topic['type'], topic['offered_qos_profiles']
        if kind not in schemas:
            text = rosbag2.definition(kind).text.encode()
            schemas[kind] = writer.register_schema(kind, 'ros2msg', text)
        metadata = {
            'offered_qos_profiles': yaml.safe_dump(profiles, sort_keys=False).rstrip('\n'),
            'topic_type_hash': topic['type_description_hash'],
        }
        name = topic['name']
        channels[name] = writer.register_channel(name, 'cdr', schemas[kind], metadata)
    assert tuple(channels) == TOPICS
    waiting = 0
    for tick, messages in itertools.groupby(run.messages, key=lambda message: message[1]):
        stamp = base.stamp_ns(tick)
        waiting += 1
        for name, _, data in messages:
            if name == STATUS:
                writer.flush()
            writer.add_message(channels[name], stamp, data, stamp, tick)
        if name == STATUS or waiting >= min((tick + 1) // 25, 10):
            writer.flush()
            waiting = 0
    writer.add_metadata('rosbag2', {'serialized_metadata': closing})
    writer.finish()
    assert log.read_bytes() == content.getvalue()


def test_no_group_of_the_summary_is_empty(log):
    """An empty one is an error to `mcap doctor`."""
    with log.open('rb') as stream:
        records = list(StreamReader(stream, validate_crcs=True).records)
    groups = [record for record in records if isinstance(record, SummaryOffset)]
    assert len(groups) == 6 and all(group.group_length for group in groups)


STORE = get_typestore(Stores.ROS2_JAZZY)
TYPES = sorted({row.type for row in interfaces.rows()})


@pytest.mark.parametrize('name', TYPES)
def test_hash_and_text_define_the_type_and_what_it_needs(name):
    found = rosbag2.definition(name)
    assert found.type_hash == STORE.hash_rihs01(name)
    parsed = get_types_from_msg(found.text, name)
    wanted = get_types_from_msg(STORE.generate_msgdef(name, ros_version=2)[0], name)
    assert parsed.keys() == wanted.keys()
    for dependency, (_, fields) in wanted.items():
        assert parsed[dependency][1] == fields
    headings = re.findall(r'^={80}\nMSG: (.*)$', found.text, re.MULTILINE)
    assert len(headings) == len(set(headings)) == len(wanted) - 1


def test_says_where_it_looked(monkeypatch, tmp_path):
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(tmp_path))
    monkeypatch.setattr('sys.prefix', str(tmp_path / 'prefix'))
    rosbag2.definition.cache_clear()
    with pytest.raises(LogError, match=r'Clock\.json.*ROS environment') as found:
        rosbag2.definition('rosgraph_msgs/msg/Clock')
    rosbag2.definition.cache_clear()
    assert str(tmp_path) in str(found.value)
