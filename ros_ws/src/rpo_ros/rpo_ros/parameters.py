# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Node parameters as one table: declaration, validation and documentation from the same rows."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.node import Node
from rclpy.parameter import Parameter

from rpo_core import validation
from rpo_core.validation import InputError

_LARGEST = 1e9
_STANDARD = ('use_sim_time', 'start_type_description_service')

Value = bool | int | float | str | tuple[float, ...]


@dataclass(frozen=True)
class Row:
    """One parameter; its type is the type of its default.

    default : a tuple stands for an array of that many numbers
    unit : of a number, '' for others
    least, most : range of a number, or of each of an array, both included
    choices : the texts allowed; empty: any
    wall : concerns wall time or transport only, so it does not change the flight
    changeable : may change in flight; the node may still refuse at a wrong moment
    example : a value to show in `--help`; the table's first row needs one
    """

    name: str
    default: Value
    description: str
    unit: str = ''
    least: float = 0.0
    most: float = _LARGEST
    choices: tuple[str, ...] = ()
    wall: bool = False
    changeable: bool = False
    example: str = ''

    @property
    def kind(self) -> str:
        """The type in words."""
        if isinstance(self.default, tuple):
            return f'{len(self.default)} numbers'
        kinds = {bool: 'true or false', int: 'whole number', float: 'number', str: 'text'}
        return kinds[type(self.default)]

    @property
    def range(self) -> str:
        """What is allowed, in words; '' for anything of its kind."""
        if self.choices:
            return ' or '.join(self.choices)
        if isinstance(self.default, (bool, str)):
            return ''
        return f'{self.least:g} to {self.most:g}'

    @property
    def shown_default(self) -> str:
        """The default as a user would type it, with its unit."""
        if isinstance(self.default, bool):
            return str(self.default).lower()
        if isinstance(self.default, tuple):
            return f'{list(self.default)} {self.unit}'.strip()
        return f'{self.default} {self.unit}'.strip() or 'empty'

    def descriptor(self) -> ParameterDescriptor:
        """Return what `ros2 param describe` shows."""
        text = f'{self.description} [{self.unit}]' if self.unit else self.description
        # Dynamic typing leaves the type to `check`, whose sentences name the parameter.
        descriptor = ParameterDescriptor(
            name=self.name,
            description=text,
            read_only=not self.changeable,
            dynamic_typing=self.changeable,
        )
        if isinstance(self.default, float):
            descriptor.floating_point_range = [
                FloatingPointRange(from_value=self.least, to_value=self.most, step=0.0)
            ]
        elif isinstance(self.default, int) and not isinstance(self.default, bool):
            descriptor.integer_range = [
                IntegerRange(from_value=int(self.least), to_value=int(self.most), step=1)
            ]
        if self.choices:
            descriptor.additional_constraints = f'one of {", ".join(self.choices)}'
        elif isinstance(self.default, tuple):
            descriptor.additional_constraints = f'{self.kind}, each {self.range}'
        return descriptor

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
            return validation.real(self.name, value, self.unit, least=self.least, most=self.most)
        if isinstance(self.default, tuple):
            return self._numbers(value)
        if self.choices:
            return validation.choice(self.name, value, self.choices)
        return validation.text(self.name, value, empty=self.default == '')

    def _numbers(self, value: Any) -> tuple[float, ...]:
        size = len(self.default) if isinstance(self.default, tuple) else 0
        if hasattr(value, 'tolist'):  # rclpy hands an array.array
            value = value.tolist()
        if not isinstance(value, (list, tuple)) or len(value) != size:
            raise InputError(
                f'`{self.name}` must be a list of {size} numbers; got {validation.shown(value)}'
            )
        return tuple(
            validation.real(
                f'{self.name}[{i}]', number, self.unit, least=self.least, most=self.most
            )
            for i, number in enumerate(value)
        )


def usage(command: str, about: str, rows: Sequence[Row]) -> str:
    """Return the text of `--help`: what a node does, its parameters, an example."""
    lines = [f'usage: {command} [--ros-args -p NAME:=VALUE ...]', '', about, '', 'parameters:']
    for row in rows:
        lines += [f'  {row.name}', f'      {row.description} ({row.summary()})']
    first = rows[0]
    lines += ['', 'example:', f'  {command} --ros-args -p {first.name}:={first.example}']
    return '\n'.join(lines)


def _to_parameter(name: str, value: Value) -> Parameter:
    return Parameter(name, value=list(value) if isinstance(value, tuple) else value)


def declare(node: Node, rows: Sequence[Row]) -> dict[str, Any]:
    """Declare the table's parameters and return their checked values.

    Warns of overrides that no row declares, which rclpy ignores in silence. Where a row is
    changeable, the values returned follow it: between two callbacks, after the check.

    Raises
    ------
    InputError
        On the first value of a wrong type or out of range.
    """
    # rclpy offers the overrides no other way; they are needed before declaration, since it refuses
    # `real_time_factor:=20` (an int for a double) and says nothing of a misspelt name.
    overrides: dict[str, Parameter] = getattr(node, '_parameter_overrides', {})
    _warn_of_strangers(node, list(overrides), [row.name for row in rows])
    values: dict[str, Any] = {}
    for row in rows:
        if row.name in overrides:
            overrides[row.name] = _to_parameter(row.name, row.check(overrides[row.name].value))
        default = list(row.default) if isinstance(row.default, tuple) else row.default
        try:
            declared = node.declare_parameter(row.name, default, row.descriptor())
        except (InvalidParameterTypeException, InvalidParameterValueException) as error:
            raise InputError(f'`{row.name}`: {error}') from None
        values[row.name] = row.check(declared.value)
    changeable = {row.name: row for row in rows if row.changeable}
    if changeable:
        _follow_changes(node, changeable, values)
    return values


def _warn_of_strangers(node: Node, given: Sequence[str], known: Sequence[str]) -> None:
    for name in given:
        if name not in known and name not in _STANDARD and not name.startswith('qos_overrides.'):
            near = difflib.get_close_matches(name, known, n=1)
            hint = f'; did you mean `{near[0]}`?' if near else ''
            node.get_logger().warning(f'parameter `{name}` is not one of this node{hint}')


def _follow_changes(node: Node, rows: dict[str, Row], values: dict[str, Any]) -> None:
    """Check changes in flight, all of a request or none, and keep `values` true.

    The node may refuse them (`refuse_change`) and learns of them (`changed`). Parameters that are
    not in the table are nobody's business here.
    """

    def with_types(parameters: list[Parameter]) -> list[Parameter]:
        """Make a whole number given for a real one real, as at the start."""
        return [
            Parameter(p.name, value=float(p.value))
            if p.name in rows
            and isinstance(rows[p.name].default, float)
            and p.type_ == Parameter.Type.INTEGER
            else p
            for p in parameters
        ]

    def check(parameters: list[Parameter]) -> SetParametersResult:
        try:
            asked = {p.name: rows[p.name].check(p.value) for p in parameters if p.name in rows}
            if asked:
                node.refuse_change(asked)
        except InputError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def apply(parameters: list[Parameter]) -> None:
        asked = {p.name: rows[p.name].check(p.value) for p in parameters if p.name in rows}
        if asked:
            values.update(asked)
            node.changed(asked)

    node.add_pre_set_parameters_callback(with_types)
    node.add_on_set_parameters_callback(check)
    node.add_post_set_parameters_callback(apply)
