# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Declare the parameters of a node from its table, and follow their changes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from rpo_core.files.validation import InputError
from rpo_ros.parameter_rows import ParameterRow, Value, unknown
from rpo_ros.rclpy_private import overrides_of


def descriptor(row: ParameterRow) -> ParameterDescriptor:
    """Return the descriptor that `ros2 param describe` prints; the row alone checks values."""
    text = f'{row.description} [{row.unit}]' if row.unit else row.description
    # With dynamic typing `check` finds a wrong type, and its sentence names the parameter.
    return ParameterDescriptor(
        name=row.name,
        description=text,
        additional_constraints=row.range,
        read_only=not row.changeable,
        dynamic_typing=row.changeable,
    )


def declare(node: Node, rows: Sequence[ParameterRow]) -> dict[str, Any]:
    """Declare the parameters of a table and return their checked values.

    Warns of overrides that no row declares: rclpy ignores them without a word. They come from a
    file, which may be for several nodes; `entry_point` refuses those of the command line. The
    returned values follow the changeable parameters: they change between two callbacks, after the
    check.

    Raises
    ------
    InputError
        If a value has a wrong type or is out of range.
    """
    overrides = overrides_of(node)
    known = [row.name for row in rows]
    for sentence in filter(None, (unknown(name, known) for name in overrides)):
        node.get_logger().warning(f'{sentence}; ignored')
    values: dict[str, Any] = {}
    for row in rows:
        given = row.name in overrides
        values[row.name] = row.check(overrides[row.name].value) if given else row.default
        node.declare_parameter(row.name, values[row.name], descriptor(row), ignore_override=True)
    changeable = {row.name: row for row in rows if row.changeable}
    if changeable:
        _follow_changes(node, changeable, values)
    return values


def _follow_changes(node: Node, rows: dict[str, ParameterRow], values: dict[str, Any]) -> None:
    """Check changes in flight, and keep `values` up to date; a request is accepted whole or not.

    The node may refuse a change (`refuse_change`) and is informed of it (`changed`). Parameters
    that are not in the table are ignored.
    """

    def with_types(parameters: list[Parameter]) -> list[Parameter]:
        """Convert a whole number to a real one where the row is real, as at the start."""
        return [
            Parameter(p.name, value=float(p.value))
            if p.name in rows
            and isinstance(rows[p.name].default, float)
            and p.type_ == Parameter.Type.INTEGER
            else p
            for p in parameters
        ]

    def checked(parameters: list[Parameter]) -> dict[str, Value]:
        return {p.name: rows[p.name].check(p.value) for p in parameters if p.name in rows}

    def check(parameters: list[Parameter]) -> SetParametersResult:
        try:
            if wanted := checked(parameters):
                node.refuse_change(wanted)
        except InputError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def apply(parameters: list[Parameter]) -> None:
        if wanted := checked(parameters):
            values.update(wanted)
            node.changed(wanted)

    node.add_pre_set_parameters_callback(with_types)
    node.add_on_set_parameters_callback(check)
    node.add_post_set_parameters_callback(apply)
