# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Node parameters as one table: declaration, validation and documentation from the same rows."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.node import Node
from rclpy.parameter import Parameter

from rpo_core import validation
from rpo_core.validation import InputError

_LARGEST = 1e9
_STANDARD = ('use_sim_time', 'start_type_description_service')


@dataclass(frozen=True)
class Row:
    """One parameter; its type is the type of its default.

    unit : of a number, '' for others
    least, most : range of a number, both included
    choices : the texts allowed; empty: any
    wall : concerns wall time or transport only, so it does not change the flight
    example : a value to show in `--help`; the table's first row needs one
    """

    name: str
    default: bool | float | str
    description: str
    unit: str = ''
    least: float = 0.0
    most: float = _LARGEST
    choices: tuple[str, ...] = ()
    wall: bool = False
    example: str = ''

    def descriptor(self) -> ParameterDescriptor:
        """Return what `ros2 param describe` shows; nothing may change in flight."""
        text = f'{self.description} [{self.unit}]' if self.unit else self.description
        descriptor = ParameterDescriptor(name=self.name, description=text, read_only=True)
        if isinstance(self.default, float):
            descriptor.floating_point_range = [
                FloatingPointRange(from_value=self.least, to_value=self.most, step=0.0)
            ]
        if self.choices:
            descriptor.additional_constraints = f'one of {", ".join(self.choices)}'
        return descriptor

    def summary(self) -> str:
        """Return default, unit and choices in words."""
        if isinstance(self.default, bool):
            default = str(self.default).lower()
        else:
            default = f'{self.default} {self.unit}'.strip() or 'empty'
        return f'default {default}' + (f'; {" or ".join(self.choices)}' if self.choices else '')

    def check(self, value: Any) -> bool | float | str:
        """Return the value of the right type; raises InputError."""
        if isinstance(self.default, bool):
            if not isinstance(value, bool):
                raise InputError(
                    f'`{self.name}` must be true or false; got {validation.shown(value)}'
                )
            return value
        if isinstance(self.default, float):
            return validation.real(self.name, value, self.unit, least=self.least, most=self.most)
        if self.choices:
            return validation.choice(self.name, value, self.choices)
        return validation.text(self.name, value, empty=self.default == '')


def usage(command: str, about: str, rows: Sequence[Row]) -> str:
    """Return the text of `--help`: what a node does, its parameters, an example."""
    lines = [f'usage: {command} [--ros-args -p NAME:=VALUE ...]', '', about, '', 'parameters:']
    for row in rows:
        lines += [f'  {row.name}', f'      {row.description} ({row.summary()})']
    first = rows[0]
    lines += ['', 'example:', f'  {command} --ros-args -p {first.name}:={first.example}']
    return '\n'.join(lines)


def declare(node: Node, rows: Sequence[Row]) -> dict[str, Any]:
    """Declare the table's parameters and return their checked values.

    Warns of overrides that no row declares, which rclpy ignores in silence.

    Raises
    ------
    InputError
        On the first value of a wrong type or out of range.
    """
    # rclpy offers the overrides no other way; they are needed before declaration, since it refuses
    # `real_time_factor:=20` (an int for a double) and says nothing of a misspelt name.
    overrides: dict[str, Parameter] = getattr(node, '_parameter_overrides', {})
    known = [row.name for row in rows]
    for name in overrides:
        if name not in known and name not in _STANDARD and not name.startswith('qos_overrides.'):
            near = difflib.get_close_matches(name, known, n=1)
            hint = f'; did you mean `{near[0]}`?' if near else ''
            node.get_logger().warning(f'parameter `{name}` is not one of this node{hint}')
    values: dict[str, Any] = {}
    for row in rows:
        if row.name in overrides:
            checked = row.check(overrides[row.name].value)
            overrides[row.name] = Parameter(row.name, value=checked)
        try:
            declared = node.declare_parameter(row.name, row.default, row.descriptor())
        except (InvalidParameterTypeException, InvalidParameterValueException) as error:
            raise InputError(f'`{row.name}`: {error}') from None
        values[row.name] = row.check(declared.value)
    return values
