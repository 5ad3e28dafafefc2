# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Message definitions and type hashes of ROS types, from the installed interface packages."""

from __future__ import annotations

import json
import os
import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from rpo_log.errors import Fault, LogError

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
        Fault.NO_DEFINITIONS,
        f'{package}/msg/{name}',
        f'no {name}.{suffix} under share/{package}'
        f'/msg of {", ".join(map(str, prefixes))}; is the ROS environment sourced?',
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
    raise LogError(Fault.NO_DEFINITIONS, path, f'holds no hash of {type_name}')
