# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Node parameters as one table: declaration, validation and documentation from the same rows.

The rows of a node are in `parameters.yaml` of its package. Without ROS, so that `--help` is quick.
"""

from __future__ import annotations

import difflib
import itertools
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from importlib import resources
from typing import Any

from rpo_core import files
from rpo_core.files import gone, validation
from rpo_core.files.validation import InputError

_LARGEST = 1e9

Value = bool | int | float | str

_ROS_NAME = re.compile(r'(~/|/)?[A-Za-z_]\w*(/[A-Za-z_]\w*)*', re.ASCII)


@dataclass(frozen=True)
class ParameterRow:
    """One parameter; its type is the type of its default.

    unit : of a number, '' for others
    least, most : range of a number, both included
    smallest : of a real number that is not zero; 0: any
    choices : the allowed texts; empty: any text
    ros_name : the text is the name of a node or of a topic
    wall : concerns only wall time or transport, so it does not change the flight
    changeable : may change in flight; the node may refuse a change at a wrong moment
    example : a value for `--help`; the first row of a table needs one
    """

    name: str
    default: Value
    description: str
    unit: str = ''
    least: float = 0.0
    most: float = _LARGEST
    smallest: float = 0.0
    choices: tuple[str, ...] = ()
    ros_name: bool = False
    wall: bool = False
    changeable: bool = False
    example: str = ''

    @property
    def kind(self) -> str:
        """The type in words."""
        kinds = {bool: 'true or false', int: 'whole number', float: 'number', str: 'text'}
        return kinds[type(self.default)]

    @property
    def range(self) -> str:
        """The allowed values in words; '': any value of its kind."""
        if self.choices:
            return ' or '.join(self.choices)
        if isinstance(self.default, (bool, str)):
            return ''
        if self.smallest:
            return f'0, or {self.smallest:g} to {self.most:g}'
        return f'{self.least:g} to {self.most:g}'

    @property
    def shown_default(self) -> str:
        """The default as a user types it, with its unit."""
        if isinstance(self.default, bool):
            return str(self.default).lower()
        return f'{self.default} {self.unit}'.strip() or 'empty'

    def summary(self) -> str:
        """Return default, unit and choices in words."""
        choices = f'; {self.range}' if self.choices else ''
        return f'default {self.shown_default}{choices}'

    def check(self, value: Any) -> Value:
        """Return the value of the right type; raises InputError."""
        if isinstance(self.default, bool):
            if not isinstance(value, bool):
                raise InputError(
                    f'`{self.name}` must be true or false; got {validation.shown(value)}'
                )
            return value
        if isinstance(self.default, int):
            return validation.whole(self.name, value, least=int(self.least), most=int(self.most))
        if isinstance(self.default, float):
            number = validation.real(self.name, value, self.unit, least=self.least, most=self.most)
            if 0.0 < number < self.smallest:
                raise InputError(f'`{self.name}` must be {self.range}; got {number!r}')
            return number
        if self.choices:
            return validation.choice(self.name, value, self.choices)
        if value == self.default == '':
            return ''
        if self.ros_name and not (isinstance(value, str) and _ROS_NAME.fullmatch(value)):
            raise InputError(
                f'`{self.name}` must be a name in ROS, like {self.default} or '
                f'/one/{self.default}; got {validation.shown(value)}'
            )
        return validation.text(self.name, value, most=validation.MOST_PATH)


_STANDARD = ('use_sim_time', 'start_type_description_service')


def unknown(name: str, names: Sequence[str], node: str = 'this node') -> str:
    """Return the sentence that a node has no such parameter, '' if it or ROS itself has it."""
    if name in names or name in _STANDARD or name.startswith('qos_overrides.'):
        return ''
    if said := gone.answer('parameter', name):
        return f'parameter `{name}` of {node} is {said}'
    near = difflib.get_close_matches(name, names, n=3)
    hint = f'; did you mean {" or ".join(f"`{other}`" for other in near)}?' if near else ''
    return f'{node} has no parameter `{name}`{hint}'


def refusal(arguments: Sequence[str], rows: Sequence[ParameterRow], command: str) -> str:
    """Return why `-p NAME:=VALUE` of a command line is refused; '' if each name is known.

    `-p NODE:NAME:=VALUE` is not looked at: it may be for another node.
    """
    names = [row.name for row in rows]
    for option, rule in itertools.pairwise(arguments):
        name, is_rule, _ = rule.partition(':=')
        if option not in ('-p', '--param') or not is_rule or ':' in name:
            continue
        if sentence := unknown(name, names, command.split()[-1]):
            see = ' See' if sentence.endswith('?') else '; see'
            return f'{sentence}{see} `{command} --help`'
    return ''


SCENARIO = ParameterRow(
    'scenario', '', 'scenario that the plant must have; empty: any scenario', wall=True,
    example='paper_test',
)  # fmt: skip
"""Parameter of each node that takes the scenario from the plant."""

AUTOSTART = ParameterRow(
    'autostart', True,
    'configure and activate at the start; false: wait for `ros2 lifecycle set`', wall=True,
)  # fmt: skip
"""Parameter of each managed node."""

_BOUNDS = ('least', 'most', 'smallest')
_SHARED = {row.name: row for row in (SCENARIO, AUTOSTART)}


@cache
def tables(package: str) -> Mapping[str, tuple[ParameterRow, ...]]:
    """Return node -> its parameters, of the nodes of a package.

    In the file, a row without a description is that of `SCENARIO` or `AUTOSTART`, or of its name in
    a node before, but for the fields that it has.
    """
    source = resources.files(package) / 'parameters.yaml'
    shared: dict[str, ParameterRow] = dict(_SHARED)
    rows_by_node = {}
    for node, written in files.parse_yaml(source.read_text(encoding='utf-8')).items():
        rows_by_node[node] = tuple(_row(name, fields, shared) for name, fields in written.items())
        shared = {row.name: row for row in rows_by_node[node]} | shared
    return rows_by_node


def _row(name: str, fields: Mapping[str, Any], shared: Mapping[str, ParameterRow]) -> ParameterRow:
    """Return a row as the file has it."""
    values = {key: float(v) if key in _BOUNDS else v for key, v in fields.items()}
    if 'choices' in values:
        values['choices'] = tuple(values['choices'])
    if 'description' in values:
        return ParameterRow(name, **values)
    return replace(shared[name], **values)


def usage(command: str, about: str, rows: Sequence[ParameterRow]) -> str:
    """Return the text of `--help`: what a node does, its parameters, an example."""
    lines = [f'usage: {command} [--ros-args -p NAME:=VALUE ...]', '', about, '', 'parameters:']
    for row in rows:
        lines += [f'  {row.name}', f'      {row.description} ({row.summary()})']
    first = rows[0]
    lines += ['', 'example:', f'  {command} --ros-args -p {first.name}:={first.example}']
    return '\n'.join(lines)
