# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Node `recorder`: writes a run to MCAP as the middleware delivers it, and loses nothing."""

from __future__ import annotations

import datetime
import time
from collections.abc import Mapping
from functools import partial
from typing import Any

import yaml
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.serialization import deserialize_message

from rpo_core import files, interfaces, scenario
from rpo_core.chain import signals_of
from rpo_core.validation import InputError
from rpo_log import signature
from rpo_log.errors import Fault, LogError
from rpo_log.format import run as run_log
from rpo_log.format import sums
from rpo_log.parameters import RECORDER as PARAMETERS
from rpo_log.write import run_info
from rpo_log.write.side_file import DecisionLogWriter, HealthLogWriter
from rpo_log.write.writer import RunLogWriter
from rpo_ros import health, names, qos
from rpo_ros.conversions import to_status
from rpo_ros.parameters import declare
from rpo_ros.running import FlightNode, run_node
from rpo_ros.signals import message_class
from rpo_ros.timeout import Timeout

EXIT_INCOMPLETE = 1

_BY_SCENARIO = frozenset(
    (interfaces.NAVIGATION_STATE, interfaces.CONTROL_FORCE, interfaces.DISTURBANCE_FORCE)
)
"""Signals whose nodes may be there in a run that does not need them."""

_FILE, _PARAMETER = 'file.', 'parameter.'
_ABORT_GRACE_S = 0.5
_MOST_EARLY = 100_000
NEVER = 1 << 62
MANIFEST_PATIENCE_S = 5.0
"""A controller heard for so long without a manifest is not one of ours, and has none."""
_LOOK_S = 0.02
_RECORDED = ('running', 'finished', 'aborted')


class RecorderNode(FlightNode):
    """Begins when the manifests are there, ends when run_status says that the run has."""

    def __init__(self, overrides: Mapping[str, Any] | None = None) -> None:
        super().__init__('recorder', overrides)
        self.values = declare(self, PARAMETERS)
        now = datetime.datetime.now().strftime('%Y%m%d-%H%M%S')
        self.folder = files.expanded('output', self.values['output'] or f'runs/recording-{now}')
        key = self.values['sign_key']
        self._key = signature.private_key(files.expanded('sign_key', key)) if key else None
        self.log: RunLogWriter | None = None
        self._scenario: scenario.Scenario | None = None
        self._plant: dict[str, str] = {}
        self._manifests: dict[str, DiagnosticStatus] = {}
        self._early: list[tuple[str, bytes]] = []
        self._commanded_s: float | None = None
        self._force_topic = self.resolve_topic_name(names.CONTROL_FORCE)
        self._status_topic = self.resolve_topic_name(names.RUN_STATUS)
        self._expected: list[str] = []
        self._events: set[str] = set()
        self._recorded: set[str] = set()
        self._end: tuple[str, int, float] | None = None
        self._heard: set[str] = set()
        self._ready = self._running = False
        self._timeout = Timeout()
        self._interrupted = False
        self._health_log: HealthLogWriter | None = None
        self._decisions: DecisionLogWriter | None = None
        self._decision_topic = self.resolve_topic_name(names.DECISION)
        self._begun = time.time()
        self._rate = health.Rate()
        try:
            run_log.prepare_folder(self.folder, self.values['overwrite'])
        except LogError as error:
            name = 'overwrite' if error.fault == Fault.EXISTS else 'output'
            raise InputError(f'{error} (parameter `{name}`)') from None
        self._status = self.create_publisher(DiagnosticStatus, names.RECORDER_STATUS, qos.LATCHED)
        self._announce('waiting')
        self._subscribe()
        health.publish_health(self, self._health)
        self.every(_LOOK_S, self._look)
        self.every(health.PERIOD_S, self._publish_status)

    def _subscribe(self) -> None:
        for row in (*interfaces.rows(logged=True), interfaces.row_of(interfaces.DECISION)):
            name, kind = self.resolve_topic_name(row.topic), message_class(row.type)
            on_raw, profile = partial(self._on_raw, name), qos.RECORDING
            if row.due == interfaces.EVENT and row.logged:
                profile = qos.LATCHED_QUEUE
                if row.name == interfaces.RUN_STATUS:
                    on_raw = self._on_status
                else:
                    self._events.add(name)
            self.create_subscription(kind, row.topic, on_raw, profile, raw=True)
        self.create_subscription(
            DiagnosticArray, names.DIAGNOSTICS, self._on_diagnostics, qos.DIAGNOSTICS, raw=True
        )
        self.create_subscription(
            DiagnosticStatus, names.NODE_MANIFEST, self._on_manifest, qos.LATCHED_QUEUE
        )

    def _on_raw(self, name: str, data: bytes) -> None:
        self._timeout.broken()
        if self._commanded_s is None and name == self._force_topic:
            self._commanded_s = time.monotonic()
        if not self._ready:
            self._heard.add(name)
        if self.log is not None:
            if name in self._recorded:
                self.log.record(name, data)
            elif self._decisions is not None and name == self._decision_topic:
                self._decisions.record(data)
        elif len(self._early) < _MOST_EARLY:
            self._early.append((name, data))

    def _on_status(self, data: bytes) -> None:
        values = _values(deserialize_message(data, DiagnosticStatus))
        phase = values.get('phase', '')
        if phase == 'waiting' and self._running:
            self._lose_plant('the plant was started anew')
        if phase not in _RECORDED or 'resumed' in values:
            return
        self._running = True
        self._on_raw(self._status_topic, data)
        if phase != 'running':
            self._end = (phase, int(values['tick']), time.monotonic())

    def _on_diagnostics(self, data: bytes) -> None:
        if self._health_log is not None:
            self._health_log.write(time.time_ns(), data)

    def _on_manifest(self, manifest: DiagnosticStatus) -> None:
        values = _values(manifest)
        self._manifests[values.get('role', '')] = manifest
        if values.get('role') == 'plant':
            self._timeout.broken()
        if values.get('role') == 'plant' and self._scenario is None:
            try:
                found = files.loads(values[_FILE + run_log.SCENARIO], scenario.parse, 'scenario')
            except (InputError, KeyError) as error:
                self.get_logger().error(
                    f'the manifest of the plant has no usable scenario: {error}'
                )
                return
            if isinstance(found, scenario.Scenario):
                self._scenario, self._plant = found, values

    def _topics(self, found: scenario.Scenario, plant: Mapping[str, str]) -> list[str]:
        """Return the full names of the topics with a message at every tick.

        They are those of the scenario's stages; and any other that a node publishes, unless the
        scenario alone decides about it.
        """
        made = {*signals_of(found)}
        for row in interfaces.rows(logged=True):
            if row.due == interfaces.EACH_TICK and row.name not in _BY_SCENARIO:
                made |= {row.name} if self.count_publishers(row.topic) else set()
        if plant.get(f'{_PARAMETER}publish_clock') == 'True':
            made.add(interfaces.CLOCK)
        if plant.get(f'{_PARAMETER}mode') == 'free_running':
            made.add(interfaces.APPLIED_FORCE)
            if not found.disturbance.is_zero:
                made.add(interfaces.APPLIED_DISTURBANCE)
        return [
            self.resolve_topic_name(row.topic)
            for row in interfaces.rows(logged=True)
            if row.name in made
        ]

    def _look(self) -> None:
        if self.log is None and not self._interrupted:
            self._begin()
        if not self._ready and self.log is not None and self._heard >= self._awaited:
            self._ready = True
            self._announce('ready')
        if self._end is not None:
            phase, tick, moment = self._end
            grace = self.values['grace_s'] if phase == 'finished' else _ABORT_GRACE_S
            if self._complete(tick) or time.monotonic() - moment > grace:
                self._finish()
        elif self._ready:
            self._watch_plant()

    def _complete(self, tick: int) -> bool:
        """Return whether all is there up to the last tick of the flight."""
        if self._decisions is not None and self._decisions.expects(tick):
            return False
        return self.log is not None and self.log.next_tick > tick

    def _watch_plant(self) -> None:
        gone = not self.count_publishers(names.RELATIVE_STATE)
        if self._timeout.look() > self.values['plant_timeout_s'] or gone:
            self._lose_plant('the plant is gone')

    def _lose_plant(self, reason: str) -> None:
        if self._end is None:
            self.get_logger().error(reason)
            self._end = ('aborted', NEVER, time.monotonic())
            self.exit_code = EXIT_INCOMPLETE

    def _begin(self) -> None:
        """Open the log when the scenario is known, and the manifests are there or will not come."""
        if self._scenario is None:
            return
        roles = (
            ['controller'] if self._scenario.disturbance.is_zero else ['controller', 'disturbance']
        )
        if any(role not in self._manifests for role in roles) and self._patient():
            return
        base = run_log.TimeBase(self._scenario.epoch_ns, self._scenario.dt_ns, self._scenario.ticks)
        self._expected = self._topics(self._scenario, self._plant)
        self._recorded = {*self._expected, *self._events, self._status_topic}
        try:
            self.log = RunLogWriter(
                self.folder, base, self._recorded, self._attachments(),
                split_s=self.values['split_s'], split_bytes=round(self.values['split_mb'] * 1e6),
                overwrite=self.values['overwrite'])  # fmt: skip
        except LogError as error:
            self.get_logger().error(str(error))
            self.exit_code, self.done = EXIT_INCOMPLETE, True
            return
        self._health_log = HealthLogWriter(self.folder)
        self._awaited = set(self._expected)
        rate_hz = self._decision_rate_hz()
        if rate_hz > 0.0:
            self._awaited.add(self._decision_topic)
            self._decisions = DecisionLogWriter(self.folder, self._decision_topic, base, rate_hz)
        for name, data in self._early:
            self._on_raw(name, data)
        self._early.clear()
        self.get_logger().info(f'recording {self._scenario.name} to {self.folder}')

    def _patient(self) -> bool:
        """Return whether manifests may still come, by the wall clock and not by the messages.

        A plant that waits sends the first state again and again, and on a slow machine any number
        of them may be here before the manifest of the node that answers.
        """
        if self._end is not None and self._end[0] == 'finished':
            return False
        since = self._commanded_s
        return since is None or time.monotonic() - since < MANIFEST_PATIENCE_S

    def _decision_rate_hz(self) -> float:
        """Return how often the controller publishes decisions, by its manifest; 0: never."""
        manifest = self._manifests.get('controller')
        try:
            return float(_values(manifest)[f'{_PARAMETER}decision_rate_hz']) if manifest else 0.0
        except (KeyError, ValueError):
            return 0.0

    def _attachments(self) -> dict[str, bytes]:
        """Return what the nodes run with: their files, and a file of all their parameters."""
        found: dict[str, bytes] = {}
        parameters: dict[str, dict[str, Any]] = {
            'recorder': {row.name: self.values[row.name] for row in PARAMETERS if not row.wall}
        }
        for manifest in self._manifests.values():
            values = _values(manifest)
            for key, value in values.items():
                if key.startswith(_FILE):
                    found[key.removeprefix(_FILE)] = value.encode()
            parameters[manifest.name] = {
                key.removeprefix(_PARAMETER): _parsed(value)
                for key, value in values.items()
                if key.startswith(_PARAMETER)
            }
        found[run_log.PARAMETERS] = yaml.safe_dump(parameters, sort_keys=True).encode()
        return found

    def _finish(self) -> None:
        if self.log is None or self.done:
            return
        summary = self.log.close()
        self._write_run_info(summary)
        self._seal()
        sentence = f'{summary.sentence()}: {self.folder}'
        if summary.whole:
            self.get_logger().info(sentence)
        else:
            self.exit_code = EXIT_INCOMPLETE
            self.get_logger().error(sentence)
        self._announce('closed')
        self.done = True

    def _write_run_info(self, summary: run_log.RunSummary) -> None:
        """Write what depends on the wall clock and the machine, apart from the run's log."""
        if self._health_log is not None:
            self._health_log.close()
        if self._decisions is not None:
            self._decisions.close()
        phase, tick = self._end[:2] if self._end else ('interrupted', NEVER)
        facts = {
            'recorded_from': _utc(self._begun),
            'recorded_to': _utc(time.time()),
            'run': {'end': phase, 'last_tick': None if tick == NEVER else tick},
            'messages': dict(summary.messages),
            'decisions': self._decisions.messages if self._decisions is not None else None,
            'resent_and_dropped': dict(summary.duplicates),
            'faults': None if summary.whole else summary.sentence(),
        }
        try:
            run_info.write_run_info(self.folder, facts)
        except LogError as error:
            self.get_logger().error(str(error))

    def _seal(self) -> None:
        """Write the digest of every file of the folder, and sign them."""
        try:
            sums.write_sums(self.folder)
            if self._key is not None:
                signature.sign(self.folder, self._key)
        except LogError as error:
            self.exit_code = EXIT_INCOMPLETE
            self.get_logger().error(str(error))

    def _announce(self, message: str) -> None:
        self._last_status = to_status(health.OK, self.get_name(), message, [])
        self._publish_status()

    def _publish_status(self) -> None:
        """Publish the status again: for the plant, a recorder without messages is gone."""
        self._status.publish(self._last_status)

    def _health(self) -> health.Health:
        if self.log is None:
            values = {'messages': 0, 'backlog': len(self._early), 'lost': 0}
            return health.OK, 'waiting for a run', values
        summary = self.log.summary
        failures = [summary.failure, *(f.failure for f in (self._health_log, self._decisions) if f)]
        failure = next(filter(None, failures), '')
        messages = sum(summary.messages.values())
        values = {
            'messages': messages,
            'rate_hz': self._rate.per_s(messages),
            'backlog': self.log.waiting,
            'lost': summary.lost,
            'missing': sum(count for count, _ in summary.missing.values()),
            'decisions': self._decisions.messages if self._decisions else 0,
        }
        level = health.ERROR if failure else health.WARN if not summary.whole else health.OK
        return level, failure or 'recording', values

    def interrupt(self, reason: str) -> None:
        """Wait a moment for the last messages; an interruption is no fault of the log."""
        self._interrupted = True
        self.done = self.done or self.log is None
        if self._end is None:
            self._end = ('interrupted', NEVER, time.monotonic())

    def close(self) -> None:
        """Close the log."""
        self._finish()
        if self._interrupted:
            self.exit_code = 0


def _parsed(text: str) -> Any:
    """Return the value of a parameter in a manifest; the text itself where it is no YAML."""
    try:
        return yaml.safe_load(text)
    except (yaml.YAMLError, ValueError):
        return text


def _values(status: DiagnosticStatus) -> dict[str, str]:
    return {pair.key: pair.value for pair in status.values}


def _utc(moment_s: float) -> str:
    return datetime.datetime.fromtimestamp(moment_s, datetime.timezone.utc).isoformat()


def main() -> int:
    """Entry point of `ros2 run rpo_log recorder`."""
    return run_node(RecorderNode)
