# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What rosbag2 wants beside the messages: its metadata, version 9, and definitions of ROS types."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from rpo_core.wire.interfaces import Qos
from rpo_log.errors import LogError
from rpo_log.format.run import METADATA_FILE, write_whole
from rpo_log.topics import SIGNAL, Topic

VERSION = 9
ROS_DISTRO = 'jazzy'
RECORD = 'rosbag2'
"""Name of the MCAP metadata record."""

INFINITE = {'sec': 9223372036, 'nsec': 854775807}
"""rmw's infinite duration, as rosbag2 writes it."""


class BagFile(NamedTuple):
    """One file of a bag: messages per topic, first and last stamp [ns]; zeros if it has none."""

    path: str
    counts: Sequence[int]
    first_ns: int = 0
    last_ns: int = 0


def qos_document(qos: Qos) -> dict[str, Any]:
    """Return a quality of service in the form of rosbag2's metadata."""
    return {
        'history': 'keep_last',
        'depth': qos.depth,
        'reliability': qos.reliability,
        'durability': qos.durability,
        'deadline': INFINITE,
        'lifespan': INFINITE,
        'liveliness': 'automatic',
        'liveliness_lease_duration': INFINITE,
        'avoid_ros_namespace_conventions': False,
    }


def channel_metadata(topic: Topic) -> dict[str, str]:
    """Return the metadata of a topic's MCAP channel; LogError if its type is not installed."""
    return {
        'offered_qos_profiles': _to_yaml([qos_document(topic.row.qos)]).rstrip('\n'),
        'topic_type_hash': definition(topic.type).type_hash,
    } | ({SIGNAL: topic.signal} if topic.remapped else {})


def metadata(topics: Sequence[Topic], files: Sequence[BagFile]) -> dict[str, Any]:
    """Return the content of `rosbag2_bagfile_information` for a whole bag; raises LogError."""
    filled = [file for file in files if any(file.counts)]
    first = min((file.first_ns for file in filled), default=0)
    last = max((file.last_ns for file in filled), default=0)
    return {
        'version': VERSION,
        'storage_identifier': 'mcap',
        'duration': {'nanoseconds': last - first},
        'starting_time': {'nanoseconds_since_epoch': first},
        'message_count': sum(sum(file.counts) for file in files),
        'topics_with_message_count': [
            {
                'topic_metadata': {
                    'name': topic.name,
                    'type': topic.type,
                    'serialization_format': 'cdr',
                    'offered_qos_profiles': [qos_document(topic.row.qos)],
                    'type_description_hash': definition(topic.type).type_hash,
                },
                'message_count': sum(file.counts[index] for file in files),
            }
            for index, topic in enumerate(topics)
        ],
        'compression_format': '',
        'compression_mode': '',
        'relative_file_paths': [file.path for file in files],
        'files': [
            {
                'path': file.path,
                'starting_time': {'nanoseconds_since_epoch': file.first_ns},
                'duration': {'nanoseconds': file.last_ns - file.first_ns},
                'message_count': sum(file.counts),
            }
            for file in files
        ],
        'custom_data': None,
        'ros_distro': ROS_DISTRO,
    }


def _to_yaml(document: Any) -> str:
    """Return a document as YAML without anchors, which not every reader follows."""
    copied = json.loads(json.dumps(document))  # nothing in it is there twice
    return yaml.safe_dump(copied, sort_keys=False, width=1000)


def record_values(topics: Sequence[Topic], file: BagFile) -> dict[str, str]:
    """Return the values of the MCAP metadata record `rosbag2` of a file."""
    return {'serialized_metadata': _to_yaml(metadata(topics, [file]))}


def metadata_text(topics: Sequence[Topic], files: Sequence[BagFile]) -> str:
    """Return the content of `metadata.yaml`."""
    return _to_yaml({'rosbag2_bagfile_information': metadata(topics, files)})


def write_metadata(folder: Path, topics: Sequence[Topic], files: Sequence[BagFile]) -> None:
    """Write `metadata.yaml`, whole or not at all; raises OSError."""
    write_whole(folder / METADATA_FILE, metadata_text(topics, files).encode())


class Definition(NamedTuple):
    """A ROS type as an MCAP schema needs it.

    text : `ros2msg` text, the type first, then each dependency once
    type_hash : RIHS01 hash
    """

    text: str
    type_hash: str


def _find(type_name: str, suffix: str) -> Path:
    """Return an installed file of a type; raises LogError."""
    listed = os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)
    prefixes = list(dict.fromkeys([*filter(None, listed), sys.prefix]))
    for prefix in prefixes:
        path = Path(prefix, 'share', f'{type_name}.{suffix}')
        if path.is_file():
            return path
    raise LogError(
        type_name,
        f'no {type_name}.{suffix} under share of {", ".join(prefixes)}; is the ROS environment '
        'sourced? Without ROS 2, the wheel `rpo[log]` brings them',
    )


@cache
def definition(type_name: str) -> Definition:
    """Return schema text and hash of a type like nav_msgs/msg/Odometry; raises LogError."""
    path = _find(type_name, 'json')
    document = json.loads(path.read_text())
    described = document['type_description_msg']
    fields = {
        one['type_name']: [field['type']['nested_type_name'] for field in one['fields']]
        for one in (described['type_description'], *described['referenced_type_descriptions'])
    }
    texts: dict[str, str] = {}
    queue = [type_name]
    while queue:
        name = queue.pop(0)
        if name and name not in texts:
            texts[name] = _find(name, 'msg').read_text().rstrip('\n')
            queue = [*fields[name], *queue]
    first = texts.pop(type_name)
    parts = [f'MSG: {name.replace("/msg/", "/")}\n{text}' for name, text in texts.items()]
    hashes = {entry['type_name']: entry['hash_string'] for entry in document['type_hashes']}
    if type_name not in hashes:
        raise LogError(path, f'holds no hash of {type_name}')
    return Definition(f'\n{"=" * 80}\n'.join([first, *parts]) + '\n', hashes[type_name])
