# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Real nodes in the test's own process: started in a second's fraction, over the same DDS."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import rclpy
from lifecycle_msgs.srv import ChangeState, GetState
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.executors import Executor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions

from rpo_ctrl.controller_node import ControllerNode
from rpo_log.recorder_node import RecorderNode
from rpo_ros.running import FlightNode, new_executor
from rpo_sim.plant_node import PlantNode

DEADLINE_S = 20.0


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


class Inside:
    """Nodes under test, and one node that talks to them as a user would."""

    def __init__(self, executor: Executor) -> None:
        self.user = Node('user')
        self.executor = executor
        self.executor.add_node(self.user)
        self.nodes: list[FlightNode] = []

    def start(self, node: FlightNode) -> Any:
        """Add a node that was made."""
        self.nodes.append(node)
        self.executor.add_node(node)
        return node

    def fly(
        self,
        folder: Path,
        scenario: str,
        *others: type[FlightNode],
        controller: str = 'handmade',
        **options: Any,
    ) -> None:
        """Start a controller, other nodes by their classes, and what `record_and_fly` starts."""
        self.controller = self.start(ControllerNode({'controller': controller}))
        for other in others:
            self.start(other({}))
        self.record_and_fly(folder, scenario, **options)

    def record_and_fly(
        self, folder: Path, scenario: str, plant: type[FlightNode] = PlantNode, **options: Any
    ) -> None:
        """Start recorder and plant, which are attributes then; options : those of the plant."""
        self.recorder = self.start(RecorderNode({'output': str(folder)}))
        options = {'scenario': scenario, 'wait_for_recorder': True, **options}
        self.plant = self.start(plant(options))

    def reaches(self, tick: int) -> None:
        """Wait until the plant is beyond a tick."""
        self.until(lambda: self.plant.tick > tick)

    def ends(self) -> int:
        """Wait until plant and recorder are done; return the exit code of the recorder."""
        self.until(lambda: self.plant.done and self.recorder.done, 60.0)
        return self.recorder.exit_code

    def until(self, condition: Callable[[], Any], deadline_s: float = DEADLINE_S) -> Any:
        """Spin until the condition holds; return what it returned."""
        end = time.monotonic() + deadline_s
        while not (found := condition()):
            assert time.monotonic() < end, 'the deadline passed'
            self.executor.spin_once(timeout_sec=0.02)
        return found

    def call(self, kind: type, service: str, request: Any) -> Any:
        """Call a service and return its response."""
        return call(self.user, self.until, kind, service, request)

    def transition(self, node: str, label: str) -> bool:
        """Ask for a lifecycle transition, as `ros2 lifecycle set` does; return its success."""
        request = ChangeState.Request()
        request.transition.label = label
        return self.call(ChangeState, f'{node}/change_state', request).success

    def state(self, node: str) -> str:
        """Return the lifecycle's state, as `ros2 lifecycle get` does."""
        return self.call(GetState, f'{node}/get_state', GetState.Request()).current_state.label

    def set(self, node: str, **parameters: Any) -> Any:
        """Set parameters at one time, as `ros2 param load` does; return (successful, reason)."""
        request = SetParametersAtomically.Request(
            parameters=[Parameter(k, value=v).to_parameter_msg() for k, v in parameters.items()]
        )
        result = self.call(
            SetParametersAtomically, f'{node}/set_parameters_atomically', request
        ).result
        return result.successful, result.reason


@contextmanager
def inside(
    args: Sequence[str] = (), executor: Callable[[], Executor] = new_executor
) -> Iterator[Inside]:
    """Yield an Inside; all its nodes are gone at the end."""
    rclpy.init(
        args=['--ros-args', *args] if args else None,
        signal_handler_options=SignalHandlerOptions.NO,
    )
    bench = Inside(executor())
    try:
        yield bench
    finally:
        for node in bench.nodes:
            node.close()
        for node in (*bench.nodes, bench.user):
            bench.executor.remove_node(node)
            node.destroy_node()
        bench.executor.shutdown(timeout_sec=1.0)
        rclpy.try_shutdown()
