# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Reading YAML strictly, and finding the scenario and controller files that ship."""

from __future__ import annotations

import errno
import os
import re
import stat
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, BinaryIO, TypeVar

import yaml

from rpo_core.files import gone
from rpo_core.files.validation import InputError, near, quoted, shown, within

DEFAULT_CONTROLLER = 'allround'
"""The shipped controller where none is named."""

DEFAULT_SCENARIO = 'approach'
"""The shipped scenario where none is named: plant and controller fly it alone."""

CHANGED = ' (changed)'
"""Ends the name of a scenario or controller that is no longer that of its file."""

MAX_BYTES = 1 << 18
"""A larger file is not one of ours; it is refused before it is parsed."""

MAX_DEPTH = 20
"""Deepest nesting of mappings and lists; ours need 4."""

Parsed = TypeVar('Parsed')

_OURS = Path(__file__).resolve().parents[1] / 'shipped'
SHIPPED = {
    'scenario': _OURS / 'scenarios',
    'controller': _OURS / 'controllers',
    'attitude_controller': _OURS / 'attitude_controllers',
}
"""Kind -> folder of the files that ship; a package above adds its own."""

_NOT_DECIMAL = re.compile(r'.*:|[-+]?0\w')
"""Numbers of YAML 1.1 that surprise: 1:30 is 90, 010 is 8, 0x10 is 16."""


class _Strict(yaml.constructor.SafeConstructor):
    """Refuses a key given twice and numbers that are not decimal."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen: set[str] = set()
        for key_node, _ in node.value:
            key = self.construct_object(key_node, deep=True)
            if not isinstance(key, str):
                raise InputError(f'{_line(key_node)}a key must be a text; got {shown(key)}')
            if key in seen:
                raise InputError(f'{_line(key_node)}{quoted(key)} is given twice')
            seen.add(key)
        return super().construct_mapping(node, deep)

    def construct_number(self, node: yaml.ScalarNode) -> Any:
        if _NOT_DECIMAL.match(node.value):
            raise InputError(f'{_line(node)}a number must be decimal; got {shown(node.value)}')
        if node.tag.endswith(':int'):
            return self.construct_yaml_int(node)
        return self.construct_yaml_float(node)


for _tag in ('int', 'float'):
    _Strict.add_constructor(  # type: ignore[type-var]
        f'tag:yaml.org,2002:{_tag}', _Strict.construct_number
    )


class _PythonLoader(_Strict, yaml.SafeLoader):
    """Says what is wrong in a document."""


class _FastLoader(_Strict, getattr(yaml, 'CSafeLoader', yaml.SafeLoader)):  # type: ignore[misc]
    """Reads several times as fast, where PyYAML has libyaml."""


def _line(place: Any) -> str:
    return f'line {place.start_mark.line + 1}: '


def _check_events(content: str, loader: type[yaml.SafeLoader]) -> None:
    """Refuse aliases, tags and deep nesting; PyYAML's time grows with the square of the depth."""
    depth = 0
    for event in yaml.parse(content, Loader=loader):
        if isinstance(event, yaml.AliasEvent):
            raise InputError(f'{_line(event)}aliases (*name) are not allowed')
        if getattr(event, 'tag', None) is not None:
            raise InputError(f'{_line(event)}tags (!name) are not allowed')
        depth += isinstance(event, yaml.CollectionStartEvent)
        depth -= isinstance(event, yaml.CollectionEndEvent)
        if depth > MAX_DEPTH:
            raise InputError(f'{_line(event)}must be nested at most {MAX_DEPTH} deep')


def _read(content: str, loader: type[yaml.SafeLoader]) -> Any:
    _check_events(content, loader)
    return yaml.load(content, Loader=loader)


def parse_yaml(content: str) -> Any:
    """Return the document in `content`.

    Raises
    ------
    InputError
        If it is not one YAML document, gives a key twice, holds aliases, tags or numbers that are
        not decimal, or is nested deeper than `MAX_DEPTH`.
    """
    with suppress(yaml.YAMLError, ValueError, OverflowError):  # the other loader says what is wrong
        if not {'\t', '?'} & set(content):  # libyaml takes both where PyYAML refuses them
            return _read(content, _FastLoader)
    try:
        return _read(content, _PythonLoader)
    except yaml.YAMLError as error:
        mark = getattr(error, 'problem_mark', None)
        where = f'line {mark.line + 1}: ' if mark else ''
        problem = getattr(error, 'problem', None) or getattr(error, 'reason', None) or 'unreadable'
        raise InputError(f'{where}not valid YAML: {problem}') from None
    except (ValueError, OverflowError) as error:  # PyYAML converts unchecked, as 2026-02-30
        if isinstance(error, InputError):
            raise
        raise InputError(f'not valid YAML: {error}') from None


def expanded(name: str, path: str) -> Path:
    """Return a path with its home folder, `~` or `~user`; InputError if there is no such user."""
    try:
        return Path(path).expanduser()
    except RuntimeError:
        raise InputError(
            f'`{name}` must be a path; got {shown(path)}, and there is no such home folder'
        ) from None


def open_regular(path: Path | str) -> BinaryIO:
    """Return a file opened for reading, as `open(path, 'rb')` does; use it for every path given.

    Raises
    ------
    OSError
        Also where it is no regular file: a pipe without a writer would wait for ever, a device
        may never end.
    """
    return open(path, 'rb', opener=_open_if_regular)


def _open_if_regular(path: str, flags: int) -> int:
    file = os.open(path, flags | os.O_NONBLOCK)  # a pipe opens without waiting for its writer
    kind = os.fstat(file).st_mode
    if stat.S_ISREG(kind) or stat.S_ISDIR(kind):  # Python itself refuses a folder
        return file
    os.close(file)
    raise OSError(errno.EINVAL, 'must be a regular file, not a pipe, a socket or a device')


def read_text(path: Path) -> str:
    """Return a UTF-8 file's text; InputError if missing, unreadable, too large or not text."""
    try:
        with open_regular(path) as file:
            content = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise InputError(f'{path}: {error.strerror or error}') from None
    if len(content) > MAX_BYTES:
        raise InputError(f'{path}: must be a YAML file of at most {MAX_BYTES} bytes; it is larger')
    try:
        return content.decode()
    except UnicodeDecodeError:
        raise InputError(f'{path}: must be a UTF-8 text; it holds other bytes') from None


def load(path: Path, parse: Callable[[Any], Parsed]) -> Parsed:
    """Return `parse(document)` of a YAML file; an InputError names the file."""
    content = read_text(path)
    return loads(content, parse, str(path))


def loads(content: str, parse: Callable[[Any], Parsed], source: str) -> Parsed:
    """Return `parse(document)` of YAML text; an InputError names `source`."""
    with within(source):
        return parse(parse_yaml(content))


def shipped(kind: str) -> dict[str, Path]:
    """Return name -> file of what ships of a kind: scenario, controller or campaign."""
    return {path.stem: path for path in sorted(SHIPPED[kind].glob('*.yaml'))}


def described(kind: str) -> dict[str, tuple[str, Any]]:
    """Return name -> what it is, in a line, and the document, of what ships of a kind."""
    documents = {name: parse_yaml(read_text(path)) for name, path in shipped(kind).items()}
    return {name: (_description(document), document) for name, document in documents.items()}


def _description(document: dict[str, Any]) -> str:
    if 'runs' in document:
        return '{runs} runs of {controller} in {scenario}'.format_map(document)
    return str(document.get('description') or 'no description')


def find(kind: str, name: str) -> Path:
    """Return the file of a shipped name, or of a path (it has a slash or ends in .yaml).

    Raises
    ------
    InputError
        If there is none; lists the shipped names, and says what else has this name.
    """
    if not isinstance(name, str) or not name.strip():
        raise InputError(f'`{kind}` must be a shipped name or a path; got {shown(name)}')
    if os.sep in name or name.endswith(('.yaml', '.yml')):
        path = os.path.expanduser(name)
        if not os.path.isfile(path):  # unlike Path's, neither raises on unusual names
            what = f'{quoted(name)} is a folder' if os.path.isdir(path) else (
                f'there is no file {quoted(name)}'
            )  # fmt: skip
            raise InputError(f'`{kind}` must be a file or a shipped name; {what}')
        return Path(path)
    paths = shipped(kind)
    if name not in paths:
        if answer := gone.answer(kind, name):
            raise InputError(f'`{kind}` {name} is {answer}')
        others = [other for other in SHIPPED if name in shipped(other)]
        what = others[0].replace('_', ' ') if others else ''
        article = 'an' if what.startswith('a') else 'a'
        hint = f', which is {article} {what}' if others else near(name, paths)
        hint += ', for section `attitude_control`' if what.startswith('attitude') else ''
        raise InputError(
            f'`{kind}` must be one of {", ".join(paths)}, or a path to a .yaml file; '
            f'got {shown(name)}{hint}'
        )
    return paths[name]
