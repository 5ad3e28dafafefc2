# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Sends hostile messages, calls and parameters to every node of a flight, case by case.

Case i of a seed is a function of (seed, i), of the topics and services that are there, and of the
last genuine message on its topic: nothing else is drawn.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Mapping, Sequence
from random import Random
from typing import Any

import rclpy
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from rclpy.task import Future

from rpo_core.files.scenario import Scenario
from rpo_core.wire import cdr, interfaces
from rpo_core.wire.interfaces import Interface
from rpo_core.wire.statuses import READERS
from rpo_ros import qos
from rpo_ros.parameter_rows import ParameterRow
from rpo_ros.running import keep_to_this_machine, new_executor
from tools.node_processes import NodeProcessError
from tools.trials import messages
from tools.trials.messages import ALWAYS, is_act, is_order, one_wrong, row_for

VOLLEY = 48
"""Cases that are sent before the answers to the calls among them are awaited."""
ANSWER_S = 15.0
"""Longest wait for the answers: a node that does not answer hangs."""
CONNECT_S = 15.0
_RCLPY_SERVICES = frozenset(
    (
        'describe_parameters', 'get_parameter_types', 'get_parameters', 'list_parameters',
        'set_parameters', 'set_parameters_atomically', 'get_type_description',
    )
)  # fmt: skip
"""Each node has at least these."""
_TRIES = 20
_OWN = 'fuzzing'
_STAMPS = (-1, 0, 1, -5, 5000, 10**6, 10**10, -(10**6), -(10**11))
"""Hostile stamps, in ticks from the present one."""


class _Topic:
    """One topic: a publisher, and the last genuine message, as an object and as bytes.

    status : name of the topic if it carries a status that has a reader; '' if not
    """

    def __init__(self, node: Node, name: str, type_name: str, row: Interface | None) -> None:
        self.name, self.row, self.kind = name, row, messages.class_of(type_name)
        self.genuine: Any = self.kind()
        found = interfaces.find(name)
        self.status = found.name if found and found.name in READERS else ''
        self.heard = b''
        self.sent: set[int] = set()
        profile = qos.of(found.qos) if found is not None else qos.LOCKSTEP
        self._publisher = node.create_publisher(self.kind, name, profile)
        node.create_subscription(self.kind, name, self._hear, qos.NEWEST, raw=True)
        self.data = b''

    def _hear(self, data: bytes) -> None:
        if hash(data) not in self.sent:
            self.data = data

    def sample(self) -> Any:
        """Return the last genuine message, or an empty one."""
        if self.data:
            self.genuine = deserialize_message(self.data, self.kind)
            self.heard, self.data = self.data, b''
        return self.genuine

    def publish(self, data: bytes) -> None:
        """Send the bytes of a message, whatever they are."""
        self.sent.add(hash(data))
        self._publisher.publish(data)


class Sender:
    """A node beside those of the flight.

    cases : (topic or service) -> cases sent
    asked_again : calls that got no answer in ANSWER_S: ROS 2 may lose one
    unanswered : of these, the calls that got none the second time either: the node hangs
    """

    def __init__(
        self,
        seed: int,
        scenario: Scenario,
        parameters: Mapping[str, Sequence[ParameterRow]],
    ) -> None:
        self._seed, self._scenario = seed, scenario
        self._parameters = {
            name: {row.name: row for row in rows} for name, rows in parameters.items()
        }
        self.cases: Counter[str] = Counter()
        self.asked_again: Counter[str] = Counter()
        self.unanswered: Counter[str] = Counter()
        self.last: list[str] = []
        self.tick = 0
        keep_to_this_machine()
        rclpy.init()
        self._node = Node(_OWN)
        self._executor = new_executor()
        self._executor.add_node(self._node)
        self._pending: list[tuple[str, Any, Future]] = []

    def connect(self, expected: int) -> None:
        """Find the topics and services of all nodes.

        expected : number of nodes

        One that is not found in time gets no calls; NodeProcessError if that is the plant.
        """
        end, nodes = time.monotonic() + CONNECT_S, ()
        # A node that was killed may still be known, without services.
        while len(nodes) < expected and (time.monotonic() < end or 'plant' not in dict(nodes)):
            if time.monotonic() > end + CONNECT_S:
                raise NodeProcessError(f'the plant is not found in {2 * CONNECT_S} s')
            self.spin(0.2)
            known = set(self._node.get_node_names_and_namespaces())
            nodes = [node for node in sorted(known) if node[0] != _OWN and self._services(node)]
        found = {self._node.resolve_topic_name(r.topic): r.type for r in interfaces.rows()}
        services: dict[str, str] = {}
        for node in nodes:
            heard = self._node.get_subscriber_names_and_types_by_node(*node)
            found |= {topic: types[0] for topic, types in heard}
            services |= self._services(node)
        self.topics = [
            _Topic(self._node, name, kind, row_for(name, kind))
            for name, kind in sorted(found.items())
        ]
        self._states = next(t for t in self.topics if t.name.endswith(interfaces.RELATIVE_STATE))
        self.calls = {}
        for name, type_name in sorted(services.items()):
            if name.rpartition('/')[2] not in ALWAYS:
                kind = messages.class_of(type_name, 'srv')
                self.calls[name] = (kind, self._node.create_client(kind, name))
        self._sets = [name for name in self.calls if '/set_parameters' in name]
        self._others = [name for name in self.calls if name not in self._sets]
        self.spin(1.0)

    def _services(self, node: tuple[str, str]) -> dict[str, str]:
        """Return name -> type of the services of a node, when all of rclpy's are found."""
        try:
            found = self._node.get_service_names_and_types_by_node(*node)
        except RuntimeError:  # its name is known, but nothing else yet
            return {}
        services = {service: types[0] for service, types in found}
        own = {service.rpartition('/')[2] for service in services}
        return services if own >= _RCLPY_SERVICES else {}

    def spin(self, seconds: float) -> None:
        """Take what comes for a time."""
        self._executor.spin_until_future_complete(Future(), timeout_sec=seconds)

    def _look(self) -> None:
        state = self._states.data
        if state:
            found = self._scenario.tick_of(cdr.stamp_ns(state))
            self.tick = max(self.tick, found or 0)

    def volley(self, first: int, count: int) -> None:
        """Send some cases and wait for the answers to the calls among them."""
        self.last = []
        for index in range(first, first + count):
            self._look()
            rng = Random(f'{self._seed} {index}')
            share = rng.random()
            if share < 0.7:
                self._send_message(rng, index)
            else:
                self._call(rng, index, self._others if share < 0.85 else self._sets)
            self.spin(0.0)
        self._await()

    def _note(self, index: int, name: str, what: object) -> None:
        self.cases[name] += 1
        self.last.append(f'case {index}: {name}: {str(what)[:300]}')

    def _send_message(self, rng: Random, index: int) -> None:
        topic = rng.choice(self.topics)
        for _ in range(_TRIES):
            kind, message = rng.choice(messages.KINDS), topic.sample()
            if topic.status and rng.random() < 0.5:
                kind = 'one wrong field'
                data = one_wrong(topic.status, topic.heard, rng, self.tick)
            elif hasattr(message, 'header') and rng.random() < 0.5:
                data = messages.spoilt(self._restamped(topic, message, rng), kind, rng)
            else:
                data = messages.spoilt(message, kind, rng)
            if topic.row is None or not is_act(topic.row, data, self.tick, self._scenario):
                break
        else:
            return
        try:
            topic.publish(data)
        except RuntimeError:  # longer than any message of its type: the middleware sends it not
            return
        self._note(index, topic.name, f'{kind}, {len(data)} bytes: {data[:200].hex()}')

    def _restamped(self, topic: _Topic, message: Any, rng: Random) -> Any:
        """Return a message with a hostile stamp, near or far, before or after."""
        copied = deserialize_message(messages.Encoder(rng, 0.0).encode(message), topic.kind)
        tick = self.tick + rng.choice(_STAMPS)
        stamp_ns = self._scenario.epoch_ns + tick * self._scenario.dt_ns
        seconds, copied.header.stamp.nanosec = divmod(stamp_ns, 10**9)
        copied.header.stamp.sec = max(-(2**31), min(seconds, 2**31 - 1))
        return copied

    def _call(self, rng: Random, index: int, among: Sequence[str]) -> None:
        name = rng.choice(among)
        kind, client = self.calls[name]
        rows = self._parameters.get(name.split('/')[-2], {})
        for _ in range(_TRIES):
            request = self._request(kind, rng, rows)
            if not is_order(name, request, rows):
                break
        else:
            return
        if client.service_is_ready():
            self._pending.append((name, request, client.call_async(request)))
            self._note(index, name, request)

    @staticmethod
    def _request(kind: Any, rng: Random, rows: Mapping[str, ParameterRow]) -> Any:
        """Return a hostile request, mostly of parameters that the node has."""
        real = (*messages.ANY_TEXTS, *(row.encode() for row in (*rows, 'use_sim_time')))
        texts = real if rng.random() < 0.7 else messages.TEXTS
        data = messages.Encoder(rng, rng.choice((0.3, 0.6, 1.0)), texts).encode(kind.Request())
        return deserialize_message(data, kind.Request)

    def _await(self) -> None:
        end = time.monotonic() + ANSWER_S
        for name, request, future in self._pending:
            left = max(0.0, end - time.monotonic())
            self._executor.spin_until_future_complete(future, timeout_sec=left)
            if not future.done():
                self.calls[name][1].remove_pending_request(future)
                self.asked_again[name] += 1
                if self.ask(name, request) is None:
                    self.unanswered[name] += 1
        self._pending.clear()

    def ask(self, name: str, request: Any) -> Any:
        """Call a service as an operator does; return the response, None if there is none."""
        future = self.calls[name][1].call_async(request)
        self._executor.spin_until_future_complete(future, timeout_sec=ANSWER_S)
        return future.result() if future.done() else None

    def close(self) -> None:
        """Leave ROS."""
        self._executor.remove_node(self._node)
        self._node.destroy_node()
        rclpy.try_shutdown()
