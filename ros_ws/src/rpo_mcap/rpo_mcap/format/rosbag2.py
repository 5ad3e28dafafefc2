# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What rosbag2 wants beside the messages: its metadata, version 9, and definitions of ROS types."""

from __future__ import annotations

import json
import os
import re
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

import yaml

from rpo_core.files import parse_yaml, read_text
from rpo_core.files.validation import InputError
from rpo_core.wire.interfaces import Qos
from rpo_mcap.errors import LogError
from rpo_mcap.format.run import METADATA_FILE, write_whole
from rpo_mcap.topics import SIGNAL

VERSION = 9
ROS_DISTRO = 'jazzy'
RECORD = 'rosbag2'
"""Name of the MCAP metadata record."""


INFINITE = {'sec': 9223372036, 'nsec': 854775807}
"""rmw's infinite duration, as rosbag2 writes it."""


def qos_document(qos: Qos) -> dict[str, Any]:
    """Return a quality of service in the form of rosbag2's metadata."""
    return {
        'history': 'keep_last',
        'depth': qos.depth,
        'reliability': qos.reliability,
        'durability': qos.durability,
        'deadline': dict(INFINITE),
        'lifespan': dict(INFINITE),
        'liveliness': 'automatic',
        'liveliness_lease_duration': dict(INFINITE),
        'avoid_ros_namespace_conventions': False,
    }


@dataclass(frozen=True)
class BagTopic:
    """One topic as rosbag2 describes it; `signal`: what it carries, if it is remapped."""

    name: str
    type: str
    type_hash: str
    qos: Sequence[Mapping[str, Any]]
    messages: int = 0
    signal: str = ''

    @classmethod
    def of(
        cls, name: str, type_name: str, qos: Qos, messages: int = 0, signal: str = ''
    ) -> BagTopic:
        """Return a topic of an installed type; raises LogError."""
        type_hash = definition(type_name).type_hash
        return cls(name, type_name, type_hash, [qos_document(qos)], messages, signal)

    @property
    def channel_metadata(self) -> dict[str, str]:
        """Metadata of the topic's MCAP channel; the profiles are a YAML sequence, version 9."""
        profiles = yaml.safe_dump(list(self.qos), sort_keys=False).rstrip('\n')
        found = {'offered_qos_profiles': profiles, 'topic_type_hash': self.type_hash}
        return found | ({SIGNAL: self.signal} if self.signal else {})

    def to_document(self) -> dict[str, Any]:
        """Return the entry of the list `topics_with_message_count`."""
        return {
            'topic_metadata': {
                'name': self.name,
                'type': self.type,
                'serialization_format': 'cdr',
                'offered_qos_profiles': [dict(profile) for profile in self.qos],
                'type_description_hash': self.type_hash,
            },
            'message_count': self.messages,
        }


@dataclass(frozen=True)
class BagFile:
    """One file of a bag: first and last stamp [ns], messages; zeros if it has none."""

    path: str
    first_ns: int = 0
    last_ns: int = 0
    messages: int = 0

    def to_document(self) -> dict[str, Any]:
        """Return the entry of the list `files`."""
        return {
            'path': self.path,
            'starting_time': {'nanoseconds_since_epoch': self.first_ns},
            'duration': {'nanoseconds': self.last_ns - self.first_ns},
            'message_count': self.messages,
        }


def metadata(topics: Iterable[BagTopic], files: Sequence[BagFile]) -> dict[str, Any]:
    """Return the content of `rosbag2_bagfile_information` for a whole bag."""
    filled = [file for file in files if file.messages]
    first = min((file.first_ns for file in filled), default=0)
    last = max((file.last_ns for file in filled), default=0)
    return {
        'version': VERSION,
        'storage_identifier': 'mcap',
        'duration': {'nanoseconds': last - first},
        'starting_time': {'nanoseconds_since_epoch': first},
        'message_count': sum(file.messages for file in files),
        'topics_with_message_count': [topic.to_document() for topic in topics],
        'compression_format': '',
        'compression_mode': '',
        'relative_file_paths': [file.path for file in files],
        'files': [file.to_document() for file in files],
        'custom_data': None,
        'ros_distro': ROS_DISTRO,
    }


class _NoAliases(yaml.SafeDumper):
    """Writes equal values out in full: not every YAML reader follows anchors."""

    def ignore_aliases(self, data: Any) -> bool:
        return True


def to_yaml(document: dict[str, Any]) -> str:
    """Return a document in the one form that this writer gives it."""
    return _dumped(json.dumps(document))


@lru_cache(maxsize=64)
def _dumped(document: str) -> str:
    """Return a JSON document as YAML, which takes PyYAML some milliseconds."""
    return yaml.dump(json.loads(document), Dumper=_NoAliases, sort_keys=False, width=1000)


def record_values(topics: Iterable[BagTopic], file: BagFile) -> dict[str, str]:
    """Return the values of the MCAP metadata record `rosbag2` of a file."""
    return {'serialized_metadata': to_yaml(metadata(topics, [file]))}


def metadata_text(topics: Iterable[BagTopic], files: Sequence[BagFile]) -> str:
    """Return the content of `metadata.yaml`."""
    return to_yaml({'rosbag2_bagfile_information': metadata(topics, files)})


def write_metadata(folder: Path, topics: Iterable[BagTopic], files: Sequence[BagFile]) -> None:
    """Write `metadata.yaml`, whole or not at all; raises OSError."""
    write_whole(folder / METADATA_FILE, metadata_text(topics, files).encode())


def files_in(folder: Path) -> list[Path]:
    """Return the MCAP files that `metadata.yaml` of a folder names, in their order.

    Empty if there are none, or if one of them is no MCAP file in this folder.
    """
    try:
        document = parse_yaml(read_text(folder / METADATA_FILE))
        names = document['rosbag2_bagfile_information']['relative_file_paths']
        paths = [folder / name for name in names if Path(name).name == name]
    except (InputError, LookupError, TypeError):
        return []
    whole = len(paths) == len(names) and all(p.suffix == '.mcap' and p.is_file() for p in paths)
    return paths if whole else []


SEPARATOR = '=' * 80
"""Line between the definitions of a `ros2msg` schema."""

_PRIMITIVE = re.compile(r'bool|byte|char|w?string|float(32|64)|u?int(8|16|32|64)')
_FIELD = re.compile(r'^([A-Za-z][\w/]*)(?:<=\d+)?(?:\[[^\]]*\])?\s+[A-Za-z]\w*')


@dataclass(frozen=True)
class Definition:
    """A ROS type as an MCAP schema needs it.

    name : like nav_msgs/msg/Odometry
    text : `ros2msg` text, the type first, then each dependency once
    type_hash : RIHS01 hash
    """

    name: str
    text: str
    type_hash: str


def _prefixes() -> list[Path]:
    listed = [p for p in os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep) if p]
    return [Path(p) for p in dict.fromkeys([*listed, sys.prefix])]


def _find(package: str, name: str, suffix: str) -> Path:
    prefixes = _prefixes()
    for prefix in prefixes:
        path = prefix / 'share' / package / 'msg' / f'{name}.{suffix}'
        if path.is_file():
            return path
    raise LogError(
        f'{package}/msg/{name}',
        f'no {name}.{suffix} under share/{package}'
        f'/msg of {", ".join(map(str, prefixes))}; is the ROS environment '
        'sourced? Without ROS 2, the wheel `rpo[log]` brings them',
    )


def _dependencies(package: str, text: str) -> Iterator[tuple[str, str]]:
    """Yield (package, name) of each type that the fields of a definition use."""
    for line in text.splitlines():
        match = _FIELD.match(line.split('#', 1)[0].strip())
        if match is None or _PRIMITIVE.fullmatch(match[1]):
            continue
        *owner, name = match[1].split('/')
        yield (owner[0] if owner else package), name


@cache
def definition(type_name: str) -> Definition:
    """Return schema text and hash of a type like nav_msgs/msg/Odometry; raises LogError."""
    package, _, name = type_name.split('/')
    text = _find(package, name, 'msg').read_text()
    parts = [text.rstrip('\n')]
    seen = {(package, name)}
    queue = list(_dependencies(package, text))
    while queue:
        dependency = queue.pop(0)
        if dependency in seen:
            continue
        seen.add(dependency)
        text = _find(*dependency, 'msg').read_text()
        parts.append('MSG: {}/{}\n{}'.format(*dependency, text.rstrip('\n')))
        queue = list(_dependencies(dependency[0], text)) + queue
    return Definition(type_name, f'\n{SEPARATOR}\n'.join(parts) + '\n', _type_hash(type_name))


def _type_hash(type_name: str) -> str:
    package, _, name = type_name.split('/')
    path = _find(package, name, 'json')
    for entry in json.loads(path.read_text())['type_hashes']:
        if entry['type_name'] == type_name:
            return str(entry['hash_string'])
    raise LogError(path, f'holds no hash of {type_name}')
