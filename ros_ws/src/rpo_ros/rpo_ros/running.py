# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Clean start and stop of nodes: one line for a bad input, exit code 0 on a signal.

ROS's discovery range LOCALHOST keeps a node from looking outside this machine. It does not keep
others out: a node elsewhere that names this machine as a static peer gets in. So a node that the
environment does not open listens on the loopback interface only.
"""

from __future__ import annotations

import faulthandler
import gc
import os
import signal
import sys
import time
import weakref
from collections import Counter
from collections.abc import Callable, Mapping, MutableMapping, Sequence
from pathlib import Path
from types import FrameType
from typing import Any, ClassVar

import rclpy
from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.exceptions import NameValidationException
from rclpy.executors import Executor, SingleThreadedExecutor
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.serialization import deserialize_message
from rclpy.service import Service
from rclpy.signals import SignalHandlerOptions
from rclpy.subscription import Subscription
from rclpy.timer import Timer
from rosgraph_msgs.msg import Clock as ClockMessage

from rpo_core.files.validation import InputError, shown
from rpo_core.wire.cdr import CdrError
from rpo_ros import parameter_rows
from rpo_ros.entry_point import EXIT_BAD_INPUT, end_in_time, stop_signals
from rpo_ros.parameter_rows import ParameterRow, Value, unknown
from rpo_ros.rclpy_private import Pending, RCLError, overrides_of


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
    names = [row.name for row in rows]
    for sentence in filter(None, (unknown(name, names) for name in overrides)):
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


LONGEST_S = 1e9
"""Longest period of a timer: 32 years. rclpy's nanoseconds overflow at 292."""

_POLL_S = 0.02
"""Time between two checks of the stop signal and of whether the work is done."""

_LAST_WORDS_S = 2.0
"""Longest time from a signal to the end: `ros2 launch` kills after 5 s."""

RANGE, PEERS = 'ROS_AUTOMATIC_DISCOVERY_RANGE', 'ROS_STATIC_PEERS'
PROFILES = ('FASTDDS_DEFAULT_PROFILES_FILE', 'FASTRTPS_DEFAULT_PROFILES_FILE')
LOOPBACK = tuple(map(Path(__file__).with_name, ('loopback_3.xml', 'loopback.xml')))
"""For Fast DDS 3 and 2, which refuse each other's names of times."""


def keep_to_this_machine(env: MutableMapping[str, str] = os.environ) -> None:
    """Bind Fast DDS to the loopback interface if the environment opens no other; before rclpy.init.

    A profile of the user stays as it is.
    """
    if env.get(RANGE) != 'LOCALHOST' or env.get(PEERS) or any(env.get(name) for name in PROFILES):
        return
    old = env.get('ROS_DISTRO', 'jazzy') in ('humble', 'jazzy')  # Fast DDS 2; 3 warns of it
    env[PROFILES[old]] = str(LOOPBACK[old])


class FlightNode(Node):
    """A node that knows when it is done.

    rest_s : how long its messages may wait, to be taken many at a time: each wake-up costs as much
        as a message
    done : the node sets it at the end of its work
    exit_code : of the process; 0 unless the node changes it
    newest : name of the logger of the node that was made last: if it cannot be made, it says why
    alive : the nodes of this process, also those that did not get ready
    executor_kind : of the executor that runs it alone; None: the fastest that rclpy has
    package : whose `parameters.yaml` has the parameters of the node; '' for none
    rows, values : its parameters, and their checked values
    """

    executor_kind: ClassVar[Callable[[], Executor] | None] = None
    package: ClassVar[str] = ''
    rest_s = 0.0
    newest = ''
    alive: ClassVar[weakref.WeakSet[FlightNode]] = weakref.WeakSet()

    def __init__(self, name: str, overrides: Mapping[str, Any] | None = None) -> None:
        self._complaints: Counter[str] = Counter()
        super().__init__(
            name,
            parameter_overrides=[
                Parameter(key, value=value) for key, value in (overrides or {}).items()
            ],
        )
        FlightNode.newest = self.get_logger().name
        FlightNode.alive.add(self)
        self.done = False
        self.exit_code = 0
        self.rows = parameter_rows.tables(self.package).get(name, ()) if self.package else ()
        self.values = declare(self, self.rows) if self.package else {}

    @classmethod
    def main(cls) -> int:
        """Run the node alone, as its command does; return the exit code."""
        return run(lambda: [cls()], executor_kind=cls.executor_kind or new_executor)

    def create_service(
        self, srv_type: Any, srv_name: str, callback: Callable[[Any, Any], Any], **options: Any
    ) -> Service:
        """Offer a service that no request ends; rclpy would end the process with an error.

        For a request that breaks the callback, the response is an empty one.
        """

        def guarded(request: Any, response: Any) -> Any:
            try:
                return callback(request, response)
            except Exception as error:  # rclpy checks no request, not even for its own services
                self.complain(f'a request to {srv_name} was refused: {shown(str(error))}')
                return srv_type.Response()

        return super().create_service(srv_type, srv_name, guarded, **options)

    def create_subscription(
        self,
        msg_type: Any,
        topic: str,
        callback: Callable[[Any], None],
        qos_profile: Any,
        *,
        raw: bool = False,
        **options: Any,
    ) -> Subscription:
        """Listen to a topic; what is no message of its type, or has a wrong content, is refused.

        The callback raises InputError for a wrong content, before it acts on any of it. The
        middleware refuses bytes that are no message too, but prints ten lines for each.
        """

        def take(data: bytes) -> None:
            try:
                callback(data if raw else message_of(data, msg_type))
            except (InputError, CdrError) as error:
                self.refused(topic, str(error))

        return super().create_subscription(msg_type, topic, take, qos_profile, raw=True, **options)

    def refused(self, topic: str, reason: str) -> None:
        """React to a message that was refused."""
        self.complain(f'a message on {topic} was refused: {reason}')

    def complain(self, sentence: str) -> None:
        """Warn of something that others do; the 10th, 100th, ... time again, with the number."""
        kind = sentence.partition(':')[0]
        self._complaints[kind] += 1
        times = self._complaints[kind]
        if str(times).strip('0') == '1':
            self.get_logger().warning(sentence if times == 1 else f'{sentence} ({times} times)')

    def every(self, period_s: float, callback: Callable[[], None]) -> Timer:
        """Call back in steady wall time: the clock of a node stops with the clock of the system."""
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        return self.create_timer(min(period_s, LONGEST_S), callback, clock=steady)

    def refuse_change(self, wanted: Mapping[str, Any]) -> None:
        """Raise InputError if these checked parameters may not change now; change nothing."""

    def changed(self, applied: Mapping[str, Any]) -> None:
        """React to changed parameters; the values of `declare` hold them already."""

    def interrupt(self, reason: str) -> None:
        """React to a signal; a node that still has something to publish sets `done` after it."""
        self.done = True

    def close(self) -> None:
        """Release resources, just before the node is destroyed."""


def message_of(data: bytes, kind: Any) -> Any:
    """Return a message; raises InputError.

    A negative time is refused: with `use_sim_time`, rclpy itself listens to /clock, and its times
    cannot be negative.
    """
    try:
        message = deserialize_message(data, kind)
    except (RuntimeError, ValueError):
        raise InputError(f'it is no {kind.__name__}') from None
    if kind is ClockMessage and message.clock.sec < 0:
        raise InputError('it is a time before 1970')
    return message


class StopSignal:
    """Remembers SIGINT, SIGTERM and SIGHUP, so that nodes can still publish and close their files.

    pending : completed by a signal, so that whoever spins until then stops at once
    """

    def __init__(self) -> None:
        self.name = ''
        self.pending = Pending()
        self._numbers = stop_signals()
        for number in self._numbers:
            signal.signal(number, self._remember)

    def _remember(self, number: int, _frame: FrameType | None) -> None:
        self.name = signal.Signals(number).name
        self.pending.set_result(None)

    def ignore(self) -> None:
        """Ignore further signals: the process ends already, and Python's defaults would kill it."""
        for number in self._numbers:
            signal.signal(number, signal.SIG_IGN)


def new_executor() -> Executor:
    """Return the events executor if rclpy has it (three times faster), else the stock one."""
    try:
        from rclpy.experimental import EventsExecutor
    except ImportError:
        return SingleThreadedExecutor()
    return EventsExecutor()


def spin(
    nodes: Sequence[FlightNode],
    until: Callable[[], bool],
    stop: StopSignal,
    executor_kind: Callable[[], Executor] = new_executor,
) -> str:
    """Run nodes until `until()`; return the name of the signal that ended them earlier, or ''."""
    executor = executor_kind()
    for node in nodes:
        executor.add_node(node)
    one_by_one = isinstance(executor, SingleThreadedExecutor)
    gc.freeze()  # what is there now stays: collections in flight need not look at it
    # EventsExecutor.spin() of rclpy 7.1.6 runs no callback in the wheels, and spin_once returns to
    # Python after each callback, which costs a third of a tick.
    while not until() and not stop.name:
        rest_s = 0.0 if one_by_one else min(node.rest_s for node in nodes)
        stop.pending = Pending()  # a new one: the executor adds a callback to it each time
        time.sleep(rest_s)
        if not stop.name:
            executor.spin_until_future_complete(stop.pending, 0.0 if rest_s else _POLL_S)
    ended_by = '' if until() else stop.name
    if ended_by:
        for node in nodes:
            node.interrupt(stop.name)
        deadline = time.monotonic() + _LAST_WORDS_S
        while not all(node.done for node in nodes) and time.monotonic() < deadline:
            executor.spin_once(timeout_sec=_POLL_S)
    for node in nodes:
        node.close()
    end_in_time()
    for node in nodes:
        executor.remove_node(node)
    executor.shutdown(timeout_sec=1.0)
    return ended_by


def _begin(
    make: Callable[[], Sequence[FlightNode]], args: Sequence[str] | None
) -> Sequence[FlightNode]:
    """Make nodes; an error of the middleware becomes one sentence, as for a bad input."""
    keep_to_this_machine()
    try:
        rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
        return make()
    except RCLError as error:
        reason = str(error).partition('\n')[0].partition(', at /')[0]
        secured = os.environ.get('ROS_SECURITY_ENABLE') == 'true'
        hint = '; ROS_SECURITY_ENABLE is set, see docs/faults.md#access-control' if secured else ''
        raise InputError(f'ROS 2 does not start: {reason}{hint}') from None
    except NameValidationException as error:
        raise InputError(str(error).partition('\n   ')[0].replace('\n ', '')) from None


def run(
    make: Callable[[], Sequence[FlightNode]],
    args: Sequence[str] | None = None,
    until: Callable[[Sequence[Any]], bool] | None = None,
    executor_kind: Callable[[], Executor] = new_executor,
    interrupted: int | None = None,
) -> int:
    """Make nodes, run them to their end and return the exit code of the process.

    until : returns from the nodes whether to end; by default when the first is done
    executor_kind : SingleThreadedExecutor for nodes that need callback groups
    interrupted : exit code where a signal ends them; None: that of the nodes
    """
    stop = StopSignal()  # first: loading and compiling take seconds
    FlightNode.newest = Path(sys.argv[0]).stem or 'rpo'
    others = set(FlightNode.alive)
    nodes: Sequence[FlightNode] = ()
    try:
        nodes = _begin(make, args)
        ended = spin(nodes, lambda: until(nodes) if until else nodes[0].done, stop, executor_kind)
        if ended and interrupted is not None:
            return interrupted
        return next((node.exit_code for node in nodes if node.exit_code), 0)
    except InputError as error:
        if rclpy.ok():
            get_logger(FlightNode.newest).error(str(error))
        else:
            print(error, file=sys.stderr)
        return EXIT_BAD_INPUT
    finally:
        end_in_time()
        # Also those that did not get ready: destroyed by Python at its end, they may crash it.
        for node in set(FlightNode.alive) - others:
            node.destroy_node()
        rclpy.try_shutdown()
        faulthandler.cancel_dump_traceback_later()  # a caller may have more to do
        stop.ignore()
