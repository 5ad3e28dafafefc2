# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The node that runs the stages that a scenario has at some places of the chain."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rpo_core.chain.chain import Chain
from rpo_core.chain.stage import Place
from rpo_core.files.scenario import Scenario
from rpo_ros import health
from rpo_ros.managed_node import ManagedNode


class PlaceNode(ManagedNode):
    """Runs the stages that a scenario has at some places of the chain.

    node_name : of the node
    places : of the chain
    what : the work of the stages in a word, and their product
    role : in the manifest; '' for its name, and no parameters
    """

    node_name = ''
    places: tuple[Place, ...] = ()
    what = ('', '')
    role = ''

    def __init__(self, overrides: Mapping[str, Any] | None = None) -> None:
        super().__init__(self.node_name, overrides)
        self.start()

    def part(self, scenario: Scenario) -> Chain | None:
        """Return the stages of its places; without any, the node ends."""
        chain = Chain.of(scenario).part(*self.places)
        does, makes = self.what
        if not chain.links:
            # No error: one launch file serves every scenario.
            self.get_logger().info(f'{scenario.name} has no {makes}: nothing to do')
            self.done = True
            return None
        self.manifest = self.manifest or health.Manifest(self, self.role or self.node_name)
        self.manifest.publish({'scenario': scenario.name} if self.role else {}, {})
        self.get_logger().info(f'{does} as in {scenario.name}')
        return chain
