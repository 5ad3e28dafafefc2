# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The parts of the pages of the nodes that come neither from parameter tables nor from nodes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import yaml

from rpo_core.wire import interfaces
from rpo_ros.parameter_rows import ParameterRow, tables

Outcomes = tuple[tuple[str, str], ...]
"""Event -> outcome."""

_WRITTEN = yaml.safe_load(Path(__file__).with_suffix('.yaml').read_text('utf-8'))

MEANINGS: dict[str, str] = {row.topic: row.meaning for row in interfaces.rows()}
MEANINGS |= _WRITTEN['meanings']
"""Topic or service -> what it carries or does."""

_CODES = {0: 'done, or ended by a signal', 2: 'a bad parameter or file'}


@dataclass(frozen=True)
class Card:
    """A node: its module, its start for the page, its failures.

    cls : name of its class in the module <executable>_node
    trial : parameters for its start by `node_pages`, to find its topics
    also : scenarios of other starts, whose topics it has too
    listens : its topics, for a node that needs an optional layer and is not started
    publishes_tf : it does where `tf2_msgs` is installed, which the ROS 2 wheels lack
    """

    package: str
    executable: str
    cls: str
    failures: Outcomes
    exit_codes: Mapping[int, str] = field(default_factory=lambda: _CODES)
    trial: Mapping[str, Any] = field(default_factory=dict)
    also: Sequence[str] = ()
    listens: Sequence[str] = ()
    publishes_tf: bool = False

    @property
    def module(self) -> ModuleType:
        """The node's module."""
        return import_module(f'{self.package}.{self.executable}_node')

    @property
    def parameters(self) -> Sequence[ParameterRow]:
        """The node's table of parameters."""
        return tables(self.package)[self.executable]

    @property
    def command(self) -> str:
        """The command of the node."""
        return f'ros2 run {self.package} {self.executable}'


def _outcomes(rows: Sequence[Any]) -> Outcomes:
    """Return events and outcomes: pairs, and those that several nodes have, by their name."""
    found: list[tuple[str, str]] = []
    for row in rows:
        found += _outcomes(_WRITTEN['shared'][row]) if isinstance(row, str) else row.items()
    return tuple(found)


CARDS = tuple(
    Card(**{**card, 'failures': _outcomes(card['failures'])}) for card in _WRITTEN['nodes']
)
"""Every node of the stack."""
