# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Node `replay`: publishes a log back onto its topics, or drives a live controller with it."""

from __future__ import annotations

import itertools
import struct
import time
from collections.abc import Iterator, Mapping
from typing import Any

from geometry_msgs.msg import WrenchStamped
from rclpy.time import Time

from rpo_core import files
from rpo_core.files.validation import InputError
from rpo_core.wire import interfaces
from rpo_log.bag import open_run
from rpo_log.errors import LogError
from rpo_log.read.decode import Message
from rpo_ros import qos
from rpo_ros.heartbeat import Timeout
from rpo_ros.running import FlightNode
from rpo_ros.signals import message_class

EXIT_DIFFERENT = 1
EXIT_NO_ANSWER = 3

_FASTEST_S, _LOOK_S = 1e-4, 0.02
"""Between two ticks of a replay as fast as possible; between two looks at a driven controller,
which needs the processor too: its answers bring the ticks."""
_SETTLED_S, _PATIENCE_S = 0.5, 1.0
"""Topics of a listener are found one by one; after so long without a new one, all are found. For a
first one it waits a little longer."""
_RESEND_S = 0.25
"""Time without an answer before a state is sent again."""

_SAY_EVERY_S = 2.0
"""A replay that is under way, or waits, says so as often."""

Tick = list[Message]


class ReplayNode(FlightNode):
    """Publishes the messages of one tick together, as the bytes that were logged."""

    package = 'rpo_log'

    def __init__(self, overrides: Mapping[str, Any] | None = None) -> None:
        super().__init__('replay', overrides)
        try:
            self._reader = open_run(files.expanded('bag', self.values['bag']))
        except LogError as error:
            raise InputError(f'`bag` {error}') from None
        self._current: Tick = []
        self._logged_force: tuple[float, ...] | None = None
        self._awaited_ns: int | None = None
        self._sent = self._begun = self._found_s = time.monotonic()
        self._silence = Timeout()
        self._said = time.monotonic()
        self._found = 0
        self._played = 0
        self.differences = 0
        self._connect()
        self._left = self._ticks()
        rate, dt_s = self.values['rate'], self._reader.base.dt_ns / 1e9
        fastest = _LOOK_S if self.values['drive'] else _FASTEST_S
        self.every(dt_s / rate if rate else fastest, self._on_time)

    def _connect(self) -> None:
        left_out = interfaces.CONTROL_FORCE if self.values['drive'] else ''
        self._outlets = {
            topic.signal: self.create_publisher(
                message_class(topic.type), topic.row.topic, qos.of(topic.row.qos)
            )
            for topic in self._reader.topics
            if topic.signal != left_out
        }
        if self.values['drive']:
            self.create_subscription(
                WrenchStamped, interfaces.CONTROL_FORCE, self._on_answer, qos.LOCKSTEP
            )

    def _ticks(self) -> Iterator[Tick]:
        for _, messages in itertools.groupby(self._reader.messages(), lambda m: m.tick):
            yield list(messages)

    def _on_time(self) -> None:
        if self.done:
            return
        if not self._played and not self._has_listeners():
            self._say(
                f'waiting for {interfaces.CONTROL_FORCE if self.values["drive"] else "listeners"}'
            )
            if self._silence.look() > self.values['answer_timeout_s']:
                self._end(f'no answer from {interfaces.CONTROL_FORCE}', EXIT_NO_ANSWER)
            return
        if not self._played:
            self._silence.broken()  # only now it can be asked: its start is no silence
        if self._awaited_ns is None:
            self._play_next()
        else:
            self._wait()

    def _has_listeners(self) -> bool:
        if self.values['drive']:
            return bool(self.count_publishers(self.resolve_topic_name(interfaces.CONTROL_FORCE)))
        now_s = time.monotonic()
        listeners = sum(outlet.get_subscription_count() for outlet in self._outlets.values())
        if listeners != self._found:
            self._found, self._found_s = listeners, now_s
        settled = listeners > 0 and now_s - self._found_s > _SETTLED_S
        return settled or now_s - self._begun > _PATIENCE_S

    def _play_next(self) -> None:
        try:
            self._current = next(self._left, [])
        except LogError as error:
            self._end(f'{error}', EXIT_DIFFERENT)
            return
        if not self._current:
            self._end(f'{self._played} ticks replayed', 0)
            return
        self._played += 1
        self._say(f'tick {self._current[0].tick} of {self._reader.base.last_tick}')
        self._send()

    def _say(self, sentence: str) -> None:
        """Log how it goes, now and then."""
        if time.monotonic() - self._said > _SAY_EVERY_S:
            self._said = time.monotonic()
            self.get_logger().info(sentence)

    def _send(self) -> None:
        for message in self._current:
            if message.topic.signal in self._outlets:
                self._outlets[message.topic.signal].publish(message.data)
            else:
                self._awaited_ns = self._reader.base.stamp_ns(message.tick)
                self._logged_force = message.topic.row.layout.decode(message.data)[1]
        self._sent = time.monotonic()

    def _wait(self) -> None:
        """Send the state again, or give up, when a driven controller does not answer."""
        waited = time.monotonic() - self._sent
        if self._silence.look() > self.values['answer_timeout_s']:
            tick = self._current[0].tick
            self._end(f'no answer to tick {tick} from {interfaces.CONTROL_FORCE}', EXIT_NO_ANSWER)
        elif waited > _RESEND_S:
            self._send()

    def _on_answer(self, message: WrenchStamped) -> None:
        if Time.from_msg(message.header.stamp).nanoseconds != self._awaited_ns:
            return
        force = (message.wrench.force.x, message.wrench.force.y, message.wrench.force.z)
        if _bits(force) != _bits(self._logged_force or ()):  # -0.0 is not 0.0 here
            self.differences += 1
            if self.differences == 1:
                self.get_logger().error(
                    f'tick {self._current[0].tick}: logged {self._logged_force}, answered {force}'
                )
        self._awaited_ns = None
        self._silence.broken()
        if not self.values['rate']:
            self._play_next()

    def _end(self, sentence: str, code: int) -> None:
        if self.values['drive'] and code == 0:
            code = EXIT_DIFFERENT if self.differences else 0
            sentence += f'; {self.differences} answers differ from the log'
        if self._reader.damage:
            sentence += f'; the log is cut short: {self._reader.damage}'
        log = self.get_logger()
        log.error(sentence) if code else log.info(sentence)
        self.exit_code, self.done = code, True


def _bits(force: tuple[float, ...]) -> bytes:
    return struct.pack(f'<{len(force)}d', *force)


main = ReplayNode.main
