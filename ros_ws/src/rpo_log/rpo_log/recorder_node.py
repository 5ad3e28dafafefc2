# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Node `recorder`: writes a run to MCAP as the middleware delivers it, and loses nothing."""

from __future__ import annotations

import datetime
import time
import uuid
from bisect import bisect_right
from collections import Counter
from collections.abc import Iterator, Mapping
from functools import partial
from operator import itemgetter
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.duration import Duration
from rclpy.subscription import Subscription

from rpo_core import files
from rpo_core.chain.chain import signals_of
from rpo_core.files.validation import InputError
from rpo_core.scenario.scenario import Scenario
from rpo_core.wire import cdr, interfaces
from rpo_core.wire.interfaces import MOST_AHEAD_TICKS, PROGRESS_TICKS
from rpo_core.wire.statuses import FINISHED, READERS, WAITING, Manifest, RunStatus
from rpo_log import provenance, signature
from rpo_log.errors import ExistsAlready, LogError
from rpo_log.format import run as run_log
from rpo_log.manifests import CONTROLLER, PLANT, Manifests
from rpo_log.topics import Topic
from rpo_log.write.orderer import NEVER
from rpo_log.write.writer import RunLogWriter
from rpo_ros import health, qos
from rpo_ros.heartbeat import Timeout, Watch
from rpo_ros.plant_scenario import ANEW_S
from rpo_ros.running import FlightNode
from rpo_ros.signals import hear, message_class, texts_of

EXIT_INCOMPLETE = 1

_ABORT_GRACE_S = 0.5
_MOST_EARLY, _MOST_TAKEN = 100_000, 1000
MANIFEST_PATIENCE_S = 5.0
"""A controller heard for so long without a manifest is not one of ours, and has none."""
_TAKE_S, _LOOK_S, _SAY_S = 0.002, 0.02, 4.0
_REST_S, _IDLE_S, _IDLE_TAKES = 0.005, 0.02, 50
"""After so many looks into empty queues it looks, and wakes up, less often: that costs 0.1 ms."""
_HELD_S = 6.0
"""A plant that waits so long for the log, as none of ours does, waits for what will not come."""
_LAST_WORD_S = 0.5
"""How long to wait until it was heard that the log is closed: the plant stays until then."""

_Taken = tuple[int, str, bytes]
"""When a message came, by the machine's clock [ns]; its topic; its CDR."""
_MOMENT = itemgetter(0)


class RecorderNode(FlightNode):
    """Begins when the manifests are there, ends when run_status says that the run has."""

    package = 'rpo_log'
    rest_s = _REST_S

    def __init__(self, overrides: Mapping[str, Any] | None = None) -> None:
        super().__init__('recorder', overrides)
        now = datetime.datetime.now().strftime('%Y%m%d-%H%M%S')
        self.folder = files.expanded('output', self.values['output'] or f'runs/recording-{now}')
        key = self.values['sign_key']
        self._key = signature.load_key(files.expanded('sign_key', key)) if key else None
        self.log: RunLogWriter | None = None
        self._id = uuid.uuid4().hex
        self._manifests = Manifests()
        self._ignored: Counter[str] = Counter()
        self._early: list[tuple[str, bytes]] = []
        self._commanded_s: float | None = None
        self._force_topic, self._status_topic = map(
            self.resolve_topic_name, (interfaces.CONTROL_FORCE, interfaces.RUN_STATUS)
        )
        self._expected: list[str] = []
        self._events: list[interfaces.Interface] = []
        self._recorded: dict[str, Topic] = {}
        self._end: tuple[str, int] | None = None
        self._still, self._reached = Timeout(), -1
        self._heard: set[str] = set()
        self._queues: dict[Subscription, str] = {}
        self._held: list[_Taken] = []
        self._empty_takes = 0
        self._ready, self._running, self._anew, self._newest = False, False, False, -1
        self._reported = 0
        self._timeout, self._held_up, self._held_at = Timeout(), Timeout(), -1
        self._interrupted = False
        self._begun = time.time()
        self._rate = health.Rate()
        try:
            run_log.prepare_folder(self.folder, self.values['overwrite'])
        except ExistsAlready:
            raise
        except LogError as error:
            raise InputError(f'{error} (parameter `output`)') from None
        self._status = self.create_publisher(
            DiagnosticStatus, interfaces.RECORDER_STATUS, qos.LATCHED
        )
        self._announce('waiting')
        self._subscribe()
        health.publish_health(self, self._health)
        self._taking = self.every(_TAKE_S, self._take)
        self.every(_LOOK_S, self._look)
        self.every(_SAY_S, self._say_what_it_wants)
        self.every(health.PERIOD_S, self._publish_status)

    def _subscribe(self) -> None:
        for row in interfaces.rows(logged=True):
            if row.due == interfaces.EVENT:
                take = partial(self._on_event, row)
                take = self._on_status if row.name == interfaces.RUN_STATUS else take
                self._events.append(row)
                kind = message_class(row.type)
                self.create_subscription(kind, row.topic, take, qos.LATCHED_QUEUE, raw=True)
            else:
                self._record_from(row, row.topic)
        hear(self, Manifest, self._on_manifest)
        self._watch = Watch(self, lambda: self._running and self._end is None)

    def _record_from(self, row: interfaces.Interface, topic: str) -> None:
        name, kind = self.resolve_topic_name(topic), message_class(row.type)
        take = partial(self._on_raw, name)
        made = self.create_subscription(kind, topic, take, qos.RECORDING, raw=True)
        self._queues[made] = name

    @property
    def subscriptions(self) -> Iterator[Subscription]:
        """Those whose messages the executor takes; the others wait for `_take`."""
        return (made for made in super().subscriptions if made not in self._queues)

    def _take(self) -> None:
        """Take what waits: as events of the executor, messages cost twice as much."""
        if self.done:
            return
        taken = self._take_until_empty_or(_MOST_TAKEN)
        for _, name, data in taken:
            self._on_raw(name, data)
        self._empty_takes = 0 if taken else self._empty_takes + 1
        idle = self._empty_takes >= _IDLE_TAKES
        if idle != (self.rest_s == _IDLE_S):
            self.rest_s = _IDLE_S if idle else _REST_S
            self._taking.timer_period_ns = round((_IDLE_S if idle else _TAKE_S) * 1e9)

    def _take_until_empty_or(self, most: int) -> list[_Taken]:
        """Return what waits in the order in which it came, states first of what came at one time.

        What is there before its state may be somebody else's. Anybody can publish faster than it is
        written: of a topic, `most` are taken. What came after the last of these is held until the
        rest of the topic is there.
        """
        taken, end = self._held, NEVER
        for queue, name in self._queues.items():
            queue_taken: list[_Taken] = []
            moment = 0
            for _ in range(most):
                message = queue.handle.take_message(queue.msg_type, True)
                if message is None:
                    break
                came = message[1]['received_timestamp']
                if came > moment:  # the machine's clock may be set back: a topic stays in order
                    moment = came
                queue_taken.append((moment, name, message[0]))
            else:
                end = min(end, moment)
            taken = queue_taken + taken if queue_taken else taken
        taken.sort(key=_MOMENT)
        count = bisect_right(taken, end, key=_MOMENT)
        self._held = taken[count:]
        return taken[:count]

    def _topic(self, name: str) -> str:
        """Return where a signal is recorded: where the run has it, unless this node is remapped."""
        topic = interfaces.row_of(name).topic
        here = self.resolve_topic_name(topic)
        there = self._manifests.topic_of(name)
        return there if there and here == self.resolve_topic_name(topic, only_expand=True) else here

    def _on_raw(self, name: str, data: bytes) -> None:
        if self._commanded_s is None and name == self._force_topic:
            self._commanded_s = time.monotonic()
        if not self._ready:
            self._heard.add(name)
        if self.log is not None:
            if name in self._recorded:
                self.log.record(name, data)
                self._report_progress(self.log)
        elif len(self._early) < _MOST_EARLY:
            self._early.append((name, data))

    def _report_progress(self, log: RunLogWriter) -> None:
        """Publish how far the log is, so that the plant does not run away."""
        if log.next_tick >= self._reported + PROGRESS_TICKS:
            self._reported = log.next_tick
            self._announce('ready' if self._ready else 'waiting')

    def refused(self, topic: str, reason: str) -> None:
        """Count a message with a wrong content, as others that are not of this run."""
        name = topic.rpartition('/')[2]
        self._ignore(name, f'a {name} with a wrong content: {reason}')

    def _ignore(self, kind: str, sentence: str) -> None:
        """Count a message that is not of this run, and warn of the first of its kind."""
        self._ignored[kind] += 1
        if self._ignored[kind] == 1:
            self.get_logger().warning(f'ignored from now on, and counted: {sentence}')

    def _on_status(self, data: bytes) -> None:
        status = RunStatus.of(cdr.decode_status(data))
        if status.phase == WAITING and self._running:
            self._anew = True
        if status.logged:
            self._on_phase(status, data)

    def _on_event(self, row: interfaces.Interface, data: bytes) -> None:
        """Take the word of a node that is there."""
        status = cdr.decode_status(data)
        if row.name in READERS:
            READERS[row.name].of(status)
        if status.name in self.get_node_names():
            self._on_raw(self.resolve_topic_name(row.topic), data)
        else:
            self._ignore(row.name, f'a {row.name} of no node that is here')

    def _on_phase(self, status: RunStatus, data: bytes) -> None:
        """Take the word of the plant that the run goes on or has ended."""
        if self.log is None:
            self._on_raw(self._status_topic, data)
            return
        last, tick = self.log.base.last_tick, status.tick
        if tick > last or (status.phase == FINISHED and tick < last):
            self._ignore('run_status', 'a run_status of no tick of this run')
            return
        if status.ended and tick > 0 and self.log.latest < 0:
            # It comes again to who begins to listen, as after the service `reset`.
            self._ignore('run_status', 'a run_status that ends a run of which no state came')
            return
        self._running = True
        self.log.record(self._status_topic, data)
        if status.ended and self._end is None:
            self._end_at(status.phase, tick)
            self.log.end(tick)

    def _on_manifest(self, manifest: Manifest) -> None:
        fault = self._manifests.take(manifest.node, manifest.values)
        if fault:
            self._ignore('node_manifest', fault)
        elif manifest.role == PLANT:
            self._timeout.broken()
        elif manifest.role == CONTROLLER and self.log is not None:
            another = self._manifests.another_controller()
            if another is not None:
                self.log.attach(*another)
                self.get_logger().info(f'another controller in flight, attached as {another[0]}')

    @property
    def _wants(self) -> str:
        """What it waits for; '' while it records and nothing is overdue."""
        if self.log is None:
            roles = ' and of the '.join(self._manifests.missing) or 'nodes before the controller'
            topic = self.resolve_topic_name(interfaces.NODE_MANIFEST)
            return f'the manifest of the {roles} on {topic}'
        if self._end is not None and self._end[0] == 'finished':
            return f'what is missing from tick {self.log.next_tick} on; the flight has ended'
        silent = self._awaited - self._heard
        return '' if self._ready else f'messages on {", ".join(sorted(silent))}'

    def _say_what_it_wants(self) -> None:
        if self._wants and not self.done:
            self.get_logger().info(f'waiting for {self._wants}')

    def _look(self) -> None:
        if self.log is None and not self._interrupted and not self.done:
            self._begin()
        if not self._ready and self.log is not None and self._heard >= self._awaited:
            self._ready = True
            self._announce('ready')
        if self._end is not None:
            phase, tick = self._end
            grace_s = self.values['grace_s'] if phase == 'finished' else _ABORT_GRACE_S
            if self._complete(tick) or self._still_s(phase) > grace_s:
                self._finish()
        elif self._ready and self.log is not None:
            self._watch_plant(self.log)

    def _end_at(self, phase: str, tick: int = NEVER) -> None:
        self._end = phase, tick
        self._still = Timeout()

    def _still_s(self, phase: str) -> float:
        """Return how long nothing of the flight came; of an ended one, since its end.

        DDS repairs a loss in steps of 3 s, and what repairs it may be lost too.
        """
        if self.log is not None and phase == 'finished' and self.log.next_tick != self._reached:
            self._reached = self.log.next_tick
            self._still.broken()
        return self._still.look()

    def _complete(self, tick: int) -> bool:
        """Return whether all is there up to the last tick of the flight."""
        return self.log is not None and self.log.next_tick > tick

    def _watch_plant(self, log: RunLogWriter) -> None:
        if log.latest != self._newest:
            self._newest = log.latest
            self._timeout.broken()
        silent_s = self._timeout.look()
        gone = not self.count_publishers(self._state_topic)
        if self._anew and silent_s > ANEW_S:
            self._lose_plant('the plant was started anew')
        elif silent_s > self.values['plant_timeout_s'] or gone:
            self._lose_plant('the plant is gone')
        else:
            self._go_on_where_the_plant_waits(log)
            self._report_progress(log)

    def _go_on_where_the_plant_waits(self, log: RunLogWriter) -> None:
        """Pass over what is missing where the plant passes no tick before it is in the log."""
        waits = log.latest - self._reported >= MOST_AHEAD_TICKS
        if not waits or log.next_tick != self._held_at:
            self._held_at = log.next_tick
            self._held_up.broken()
        if self._held_up.look() > _HELD_S:
            self._held_up.broken()
            missing = f'what is missing at tick {log.next_tick} is passed over'
            self.get_logger().warning(f'the plant waits for the log: {missing}')
            log.pass_over()

    def _lose_plant(self, reason: str) -> None:
        if self._end is None:
            self.get_logger().error(reason)
            self._end_at('aborted')
            self.exit_code = EXIT_INCOMPLETE

    def _begin(self) -> None:
        """Open the log when the scenario is known, and the manifests are there or will not come."""
        flown = self._manifests.scenario
        if flown is None or (self._unknown(flown) and self._patient()):
            return
        try:
            self._open(flown)
        except LogError as error:
            self.get_logger().error(str(error))
            self._announce('failed', str(error))
            self.exit_code, self.done = EXIT_INCOMPLETE, True
            return
        early, self._early = self._early, []
        for name, data in early:
            take = self._on_status if name == self._status_topic else partial(self._on_raw, name)
            take(data)
        self.get_logger().info(f'recording {flown.name} to {self.folder}')

    def _unknown(self, flown: Scenario) -> bool:
        """Return whether a manifest is missing that says what flies, or where a signal is."""
        rows = (row for row in interfaces.rows(logged=True) if row.due == interfaces.EACH_TICK)
        others = {*signals_of(flown)} - {interfaces.CONTROL_FORCE, interfaces.DISTURBANCE_FORCE}
        others &= {row.name for row in rows}
        found_all = (
            self._manifests.topic_of(name) or self.count_publishers(self._topic(name))
            for name in others
        )  # fmt: skip
        return bool(self._manifests.missing) or not all(found_all)

    def _open(self, flown: Scenario) -> None:
        """Open the files of the log; raises LogError."""
        base = run_log.TimeBase.of(flown)
        due = self._manifests.due_each_tick(
            flown, lambda row: self.count_publishers(self._topic(row.name))
        )
        self._recorded = {self._topic(row.name): Topic(self._topic(row.name), row) for row in due}
        self._expected = list(self._recorded)
        self._state_topic = self._topic(interfaces.RELATIVE_STATE)
        for topic in self._recorded.values():
            if topic.name != self.resolve_topic_name(topic.row.topic):
                self._record_from(topic.row, topic.name)
        # States are taken last, so that none is missing whose answers are there.
        own = self._state_topic
        self._queues = dict(sorted(self._queues.items(), key=lambda queue: queue[1] == own))
        for row in self._events:
            if not row.beside or self._topic(row.beside) in self._expected:
                name = self.resolve_topic_name(row.topic)
                self._recorded[name] = Topic(name, row)
        own = {row.name: self.values[row.name] for row in self.rows if not row.wall}
        self.log = RunLogWriter(
            self.folder, base, self._recorded.values(), self._manifests.attachments(own),
            split_s=self.values['split_s'], split_bytes=round(self.values['split_mb'] * 1e6),
            overwrite=self.values['overwrite'])  # fmt: skip
        self._awaited = set(self._expected)

    def _patient(self) -> bool:
        """Return whether manifests may still come, by the wall clock: states come any number."""
        since = self._commanded_s
        return since is None or time.monotonic() - since < MANIFEST_PATIENCE_S

    def _finish(self) -> None:
        if self.log is None or self.done:
            return
        for _, name, data in (*self._take_until_empty_or(_MOST_TAKEN), *self._held):
            self._on_raw(name, data)
        for name, data in self._manifests.remaps(self._recorded.values()).items():
            self.log.attach(name, data)
        summary = self.log.close()
        faults = []
        for step in (partial(self._write_run_info, summary), self._seal):
            try:
                step()
            except LogError as error:
                faults.append(str(error))
        log, sentence = self.get_logger(), f'{summary.sentence()}: {self.folder}'
        log.info(sentence) if summary.whole else log.error(sentence)
        for fault in faults:
            log.error(fault)
        if not summary.whole or faults:
            self.exit_code = EXIT_INCOMPLETE
        self._announce('closed', '; '.join(summary.differing_lines()))
        self.done = True

    def _write_run_info(self, summary: run_log.RunSummary) -> None:
        """Write what depends on the wall clock and the machine; raises LogError."""
        phase, tick = self._end if self._end else ('interrupted', NEVER)
        facts = {
            'recorded_from': provenance.utc(self._begun),
            'recorded_to': provenance.utc(time.time()),
            'run': {'end': phase, 'last_tick': None if tick == NEVER else tick},
            'messages': dict(summary.messages),
            'resent_and_dropped': dict(summary.duplicates),
            'ignored': {**summary.ignored, **dict(self._ignored)},
            'faults': None if summary.whole else summary.sentence(),
        }
        provenance.write_run_info(self.folder, facts)

    def _seal(self) -> None:
        """Write the digest of every file of the folder, sign them; raises LogError."""
        written = signature.write_sums(self.folder, without=run_log.REPORT)
        if self._key is not None:
            signature.sign(self.folder, written, self._key)

    def _announce(self, message: str, reason: str = '') -> None:
        values = {'recorder': self._id, 'run': self._manifests.run_id, 'reason': reason}
        if self.log is not None:
            values['next_tick'] = self._reported
        status = (health.ERROR if reason else health.OK)[0], self.get_name(), message, 'none'
        self._last_status = cdr.encode_status(*status, texts_of(values.items()))
        self._publish_status()

    def _publish_status(self) -> None:
        """Publish the status again: for the plant, a recorder without messages is gone."""
        self._status.publish(self._last_status)

    def _health(self) -> health.Health:
        if self.log is None:
            values = {'messages': 0, 'backlog': len(self._early), 'lost': 0}
            return health.OK, f'waiting for {self._wants}', values
        summary = self.log.summary
        failure = summary.failure or ''
        messages = sum(summary.messages.values())
        values = {
            'messages': messages,
            'rate_hz': self._rate.per_s(messages),
            'backlog': self.log.orderer.waiting,
            'lost': summary.lost,
            'missing': sum(count for count, _ in summary.missing.values()),
            'ignored': sum(summary.ignored.values()) + sum(self._ignored.values()),
        }
        if summary.ignored:
            text = f'ignored and counted: messages that do not act, {dict(summary.ignored)}'
            self.get_logger().warning(text, once=True)
        level = health.ERROR if failure else health.WARN if not summary.whole else health.OK
        return level, failure or 'recording', values

    def interrupt(self, reason: str) -> None:
        """Wait a moment for the last messages; an interruption in flight is no fault of the log."""
        self.done = self.done or self.log is None
        if self._end is None:
            self._interrupted = True
            self._end_at('interrupted')

    def close(self) -> None:
        """Close the log; to be ended before anything is recorded is no success."""
        wants = self._wants
        self._finish()
        self._status.wait_for_all_acked(Duration(seconds=_LAST_WORD_S))
        if not self._interrupted:
            return
        empty = self.log is None or not any(self.log.summary.messages.values())
        self.exit_code = EXIT_INCOMPLETE if empty else 0
        if empty:
            self.get_logger().error(
                f'nothing was recorded: it waited for {wants or "the first tick"}'
            )


main = RecorderNode.main
