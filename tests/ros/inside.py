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
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from lifecycle_msgs.srv import ChangeState, GetState
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.executors import Executor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions
from std_srvs.srv import SetBool, Trigger

from rpo_core.wire import interfaces
from rpo_ctrl.fuzzy_controller_node import ControllerNode
from rpo_log.recorder_node import RecorderNode
from rpo_ros import qos
from rpo_ros.running import FlightNode, new_executor
from rpo_sim.plant_node import PlantNode

DEADLINE_S = 240.0
"""A busy machine is no failure; pytest ends a test after 300 s."""


def values_of(status: DiagnosticStatus) -> dict[str, str]:
    """Return the values of a status by key."""
    return {pair.key: pair.value for pair in status.values}


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
        """Start recorder and plant, which are attributes then.

        options : those of the plant; a peer that gets no processor is not lost
        """
        self.recorder = self.start(RecorderNode({'output': str(folder)}))
        patient = {'wait_for_recorder': True, 'peer_timeout_s': DEADLINE_S}
        options = {'scenario': scenario, **patient, **options}
        self.plant = self.start(plant(options))

    def reaches(self, tick: int) -> None:
        """Wait until the plant is beyond a tick."""
        self.until(lambda: self.plant.tick > tick)

    def ends(self) -> int:
        """Wait until plant and recorder are done; return the exit code of the recorder."""
        self.until(lambda: self.plant.done and self.recorder.done)
        return self.recorder.exit_code

    def until(self, condition: Callable[[], Any]) -> Any:
        """Spin until the condition holds; return what it returned."""
        end = time.monotonic() + DEADLINE_S
        while not (found := condition()):
            assert time.monotonic() < end, 'the deadline passed'
            self.executor.spin_once(timeout_sec=0.02)
        return found

    def passes(self, seconds: float) -> None:
        """Spin for a time."""
        end = time.monotonic() + seconds
        self.until(lambda: time.monotonic() > end)

    def publisher(self, kind: type, topic: str, profile: Any = qos.LOCKSTEP) -> Any:
        """Return a publisher of the user, once somebody listens."""
        made = self.user.create_publisher(kind, topic, profile)
        self.until(made.get_subscription_count)
        return made

    def call(self, kind: type, service: str, request: Any) -> Any:
        """Call a service and return its response."""
        client = self.user.create_client(kind, service)
        try:
            self.until(client.service_is_ready)
        except AssertionError as error:
            error.add_note(f'no {service}; there are {self.user.get_node_names_and_namespaces()}')
            raise
        future = client.call_async(request)
        self.until(future.done)
        self.user.destroy_client(client)
        return future.result()

    def trigger(self, service: str) -> Any:
        """Call a service without arguments; return its response."""
        return self.call(Trigger, service, Trigger.Request())

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


class Hand:
    """A hand on a plant that flies here or elsewhere, and an ear for what the nodes say.

    statuses : the messages of run_status as they came
    health : node -> its statuses on /diagnostics as they came, each with its wall time [s]
    """

    def __init__(self, inner: Inside) -> None:
        self.inner, self.until, self.passes = inner, inner.until, inner.passes
        self.statuses: list[DiagnosticStatus] = []
        self.health: dict[str, list[tuple[float, DiagnosticStatus]]] = {}
        inner.user.create_subscription(
            DiagnosticStatus, interfaces.RUN_STATUS, self.statuses.append, qos.LATCHED_QUEUE
        )
        inner.user.create_subscription(
            DiagnosticArray, '/diagnostics', self._on_health, qos.LOCKSTEP
        )

    def _on_health(self, array: DiagnosticArray) -> None:
        said_s = array.header.stamp.sec + 1e-9 * array.header.stamp.nanosec
        for status in array.status:
            name = status.name.partition(':')[0]
            self.health.setdefault(name, []).append((said_s, status))

    def says(self, text: str) -> DiagnosticStatus:
        """Wait until run_status gives a reason; return the newest status with it."""
        return self.until(lambda: [said for said in self.statuses if text in said.message])[-1]

    def trigger(self, name: str) -> Any:
        """Call ~/step, ~/reset or ~/abort of the plant."""
        return self.inner.trigger(f'plant/{name}')

    def pause(self, data: bool = True) -> Any:
        """Pause the plant, or let it go on."""
        return self.inner.call(SetBool, 'plant/pause', SetBool.Request(data=data))


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
