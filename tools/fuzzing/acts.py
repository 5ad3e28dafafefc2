# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Valid acts of the moment: what a node must obey, whoever sends it.

ROS 2 without SROS2 knows no sender. A finite force in the right frame with the stamp of the present
tick is an answer, `deactivate` is an order of an operator, a `run_status` that says `finished` ends
a run. The bench sends everything but these. The rules follow from the table of interfaces and from
the tables of parameters, not from the nodes.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from rpo_core import files
from rpo_core.files import scenario as scenarios
from rpo_core.files.scenario import Scenario
from rpo_core.files.validation import InputError
from rpo_core.wire import cdr, interfaces, statuses
from rpo_core.wire.cdr import CdrError
from rpo_core.wire.interfaces import Interface
from rpo_ros.parameter_rows import ParameterRow

FAR_TICKS = 200
"""A message for a tick so far ahead comes long before its tick: it is no answer."""

_ROLES = ('controller', 'disturbance')
_FROM_ACTIVE = {'deactivate': 4, 'shutdown': 7}
"""Transitions of the lifecycle that are possible in `active`."""
_LABELS = ('unconfigured', 'inactive', 'active', 'finalized')
"""States of the lifecycle, in the health of a controller."""

ALWAYS = (
    'reset', 'abort', 'go', 'hold', 'retreat', 'drift', 'resume', 'arm', 'inhibit',
)  # fmt: skip
"""Services without a field, of the plant, of guidance and of assurance: each call is an order."""


def row_for(topic: str, type_name: str) -> Interface | None:
    """Return the row of a topic, else one of its type; None if the table has neither."""
    rows = interfaces.rows()
    return interfaces.find(topic) or next((row for row in rows if row.type == type_name), None)


def is_act(row: Interface, data: bytes, tick: int, scenario: Scenario) -> bool:
    """Return whether a message is a valid act while the flight is at `tick` or a little later.

    One that lacks up to three bytes arrives with zeros: the middleware sends words of four.
    """
    data += bytes(-len(data) % 4)
    try:
        if row.columns:
            stamp_ns, values, right_frame = row.layout.decode(data)
            finite = all(map(math.isfinite, values))
            return right_frame and finite and _is_due(scenario, stamp_ns, tick)
        if row.type == interfaces.ARRAY_TYPE:
            return _array_acts(row, data, tick, scenario)
        return row.type == interfaces.STATUS_TYPE and _status_acts(row, cdr.decode_status(data))
    except CdrError:
        return False


def _is_due(scenario: Scenario, stamp_ns: int, tick: int) -> bool:
    found = scenario.tick_of(stamp_ns)  # an estimator reads the command of the tick before
    return found is not None and tick - 1 <= found < tick + FAR_TICKS


def _array_acts(row: Interface, data: bytes, tick: int, scenario: Scenario) -> bool:
    stamp_ns, found = cdr.decode_array(data)
    if row.name == interfaces.DECISION:
        return _is_due(scenario, stamp_ns, tick)
    return any(dict(status.values).get('state') in _LABELS for status in found)


def _status_acts(row: Interface, status: cdr.Status) -> bool:
    """Return whether a status is whole; in flight, a refusal is none of the moment."""
    try:
        said = statuses.READERS[row.name].of(status) if row.name in statuses.READERS else None
        if isinstance(said, statuses.StageStatus):
            return said.state != statuses.REFUSED
        if isinstance(said, statuses.Manifest) and said.role == 'plant':
            text = said.values.get('file.scenario.yaml', '')
            files.loads(text, scenarios.parse, 'scenario')
        elif isinstance(said, statuses.Manifest):
            return said.role in _ROLES
    except InputError:
        return False
    return True


def is_order(service: str, request: Any, rows: Mapping[str, ParameterRow]) -> bool:
    """Return whether a call is a valid order.

    rows : name -> row of the node's parameters
    """
    name = service.rpartition('/')[2]
    if name == 'pause':
        return bool(request.data)
    if name == 'change_state':
        asked = request.transition
        if asked.label:
            return asked.label in _FROM_ACTIVE
        return asked.id in _FROM_ACTIVE.values()
    if name.startswith('set_parameters'):
        return any(_is_set(parameter, rows) for parameter in request.parameters)
    return False


def _is_set(parameter: Any, rows: Mapping[str, ParameterRow]) -> bool:
    """Return whether a parameter that may change in flight is set to a value that it may have."""
    from rclpy.parameter import parameter_value_to_python

    row = rows.get(parameter.name)
    if row is None or not row.changeable:
        return False
    try:
        row.check(parameter_value_to_python(parameter.value))
    except (InputError, RuntimeError):  # a type that is none
        return False
    return True
