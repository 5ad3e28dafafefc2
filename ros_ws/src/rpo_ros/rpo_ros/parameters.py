# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Declares the parameters of a node from its table, and follows their changes."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
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

from rpo_core.validation import InputError
from rpo_ros.parameter_rows import ParameterRow, Value

_STANDARD = ('use_sim_time', 'start_type_description_service')


def descriptor(row: ParameterRow) -> ParameterDescriptor:
    """Return what `ros2 param describe` shows."""
    text = f'{row.description} [{row.unit}]' if row.unit else row.description
    # Dynamic typing leaves the type to `check`, whose sentences name the parameter.
    descriptor = ParameterDescriptor(
        name=row.name,
        description=text,
        read_only=not row.changeable,
        dynamic_typing=row.changeable,
    )
    if isinstance(row.default, float):
        descriptor.floating_point_range = [
            FloatingPointRange(from_value=row.least, to_value=row.most, step=0.0)
        ]
    elif isinstance(row.default, int) and not isinstance(row.default, bool):
        descriptor.integer_range = [
            IntegerRange(from_value=int(row.least), to_value=int(row.most), step=1)
        ]
    if row.choices:
        descriptor.additional_constraints = f'one of {", ".join(row.choices)}'
    elif isinstance(row.default, tuple):
        descriptor.additional_constraints = f'{row.kind}, each {row.range}'
    return descriptor


def _to_parameter(name: str, value: Value) -> Parameter:
    return Parameter(name, value=list(value) if isinstance(value, tuple) else value)


def declare(node: Node, rows: Sequence[ParameterRow]) -> dict[str, Any]:
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
            declared = node.declare_parameter(row.name, default, descriptor(row))
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


def _follow_changes(node: Node, rows: dict[str, ParameterRow], values: dict[str, Any]) -> None:
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
