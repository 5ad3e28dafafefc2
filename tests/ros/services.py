# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Calling a service of a node under test."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.node import Node


def call(node: Node, until: Callable[..., Any], kind: type, service: str, request: Any) -> Any:
    """Call a service and return its response; `until` spins the node until a condition holds."""
    client = node.create_client(kind, service)
    try:
        until(client.service_is_ready)
    except AssertionError as error:
        error.add_note(f'no {service}; there are {node.get_node_names_and_namespaces()}')
        raise
    future = client.call_async(request)
    until(future.done)
    node.destroy_client(client)
    return future.result()
