# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Flights of every node under hostile messages, calls and parameters, one after the other.

The verdict of each, and a table: all nodes alive, same bits, log verified.
"""

from __future__ import annotations

import os
import re
import signal
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import yaml
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters

from rpo_core import files
from rpo_core.chain.flight import fly
from rpo_core.control.controller import load_controller
from rpo_core.files.scenario import Scenario, load_scenario
from rpo_core.files.validation import InputError
from rpo_log.verify import verify
from rpo_mcap.errors import LogError
from rpo_mcap.format.run import TimeBase
from rpo_mcap.read.run_log import read_flight
from rpo_mcap.write.writer import RunLogWriter
from tools.node_pages import CARDS
from tools.node_processes import (
    NodeProcess,
    NodeProcessError,
    NodeProcesses,
    node_processes,
)
from tools.trials import links
from tools.trials.sender import VOLLEY, Sender

PACE = 2.0
HURRY = 40.0
"""Simulated seconds per second while hostile messages come, and after them: not as fast as it goes,
because on a busy machine the recorder then loses messages."""
_CONTROLLER, _RIVAL, _REPLAYED = 'handmade', 'lqr', '/replayed'
MOST_WARNINGS = 200
"""Lines of warning of a node in a flight; it warns of the 1st, 10th, 100th time of each kind."""
_CASE_S = 0.06
"""Simulated time for a case."""
_END_S = 90.0
_TABLE = ('range_m', 'closing_excess_m_s', 'intervention')
_ASSURANCE = {
    'keep_out_m': 10.0, 'position_error_m': 0.5, 'velocity_error_m_s': 0.02, 'disturbance_n': 0.05,
    'thrust_error': 0.1,
}  # fmt: skip
_SHOWN = 2000
"""Most characters of a fault's stack lines."""
_FAULT = re.compile(r'Traceback|terminate called|Segmentation|Fatal Python|Exception')
_WARNING = re.compile(r'^\[(?:WARN|ERROR|FATAL)\]', re.MULTILINE)
LOOP = (
    'plant', 'fuzzy_controller', 'disturbance_injector', 'navigation', 'guidance', 'assurance',
    'recorder',
)  # fmt: skip
NODES = tuple(card.executable for card in CARDS)
_ENDS = {'operator': (0, 1), 'recorder': (0, 1)}
"""Node -> its exit codes, if others than 0: the phase for which the operator waits never comes; the
recorder says of messages that contradict each other. Whether its log is right, `verify` says."""


@dataclass
class Verdict:
    """What came of a flight.

    drawn, cases : cases that were drawn, and that were sent: some draws give a valid act only
    asked_again : calls that were answered only the second time
    deaths : a sentence for each node that ended or hung
    faults : other sentences: stack lines, changed bits, a log that does not verify
    warnings : node -> lines of warning and error
    """

    drawn: int = 0
    cases: int = 0
    asked_again: int = 0
    deaths: list[str] = field(default_factory=list)
    faults: list[str] = field(default_factory=list)
    changed_bits: bool = False
    verified: bool = False
    recorded: bool = False
    warnings: dict[str, int] = field(default_factory=dict)

    @property
    def of_the_log(self) -> str:
        """What the log shows."""
        if not self.recorded:
            return 'bits not compared: nothing was recorded'
        if not self.verified:
            return 'bits not compared: the log does NOT VERIFY'
        return f'{"CHANGED" if self.changed_bits else "same"} bits, log verified'


def _scenario(folder: Path, duration_s: float, wanted: Sequence[str]) -> str:
    """Write a scenario in which each wanted node has a part; return its path.

    It stays at the first hold point: nobody says go. The abort table warns only, for a machine
    that is busy may be too late with a command.
    """
    guarded, world = (
        files.parse_yaml(files.read_text(files.find('scenario', name)))
        for name in ('guarded', 'world_leo')
    )
    table = [row for row in guarded['assurance']['abort']['table'] if row['quantity'] in _TABLE]
    sections = {
        'navigation': {name: world[name] for name in ('sensors', 'estimator')},
        'guidance': {'guidance': guarded['guidance']},
        'disturbance_injector': {'disturbance': 'paper_offset'},
        'assurance': {
            'assurance': {
                **_ASSURANCE,
                'abort': {'table': [{**row, 'reaction': 'warn'} for row in table]},
            }
        },
    }
    guarded['guidance']['legs'][0]['timeout_s'] = 10.0 * duration_s
    plain = {name: guarded[name] for name in guarded if name not in ('guidance', 'assurance')}
    plain |= {'thrusters': world['thrusters'], 'duration_s': duration_s}
    for name, section in sections.items():
        plain |= section if name in wanted else {}
    path = folder / 'hostile.yaml'
    path.write_text(yaml.safe_dump(plain))
    return str(path)


def _replayed(folder: Path) -> tuple[Path, str]:
    """Write a log for the replay; return it, and the path of its scenario."""
    path = links.scenario(folder, 'approach', duration_s=20.0)
    flown = load_scenario(path)
    flight = fly(flown, load_controller(_RIVAL))
    texts = {
        'scenario.yaml': Path(path).read_bytes(),
        'controller.yaml': files.read_text(files.find('controller', _RIVAL)).encode(),
    }
    signals = {'relative_state': flight.states, 'control_force': flight.forces_n}
    base = TimeBase(flown.epoch_ns, flown.dt_ns, flown.ticks)
    names = {name: f'{_REPLAYED}/{name}' for name in signals}
    writer = RunLogWriter(folder / 'bag', base, names.values(), texts)
    layouts = {topic.signal: topic.row.layout for topic in writer.topics}
    for tick in range(flown.ticks + 1):
        for name, rows in signals.items():
            data = layouts[name].encode(base.stamp_ns(tick), rows[tick].tolist())
            writer.write(names[name], tick, data)
    writer.close()
    return folder / 'bag', path


class Flight:
    """The nodes of one flight, as processes.

    nodes : starts them, in a ROS domain of their own
    wanted : names of executables, of `NODES`
    count : cases that it is for; it may end before them on a slow machine
    """

    def __init__(self, nodes: NodeProcesses, wanted: Sequence[str], count: int) -> None:
        self.folder = nodes.folder
        duration_s = 60.0 + round(count * _CASE_S)
        self.path = _scenario(nodes.folder, duration_s, wanted)
        self.scenario: Scenario = load_scenario(self.path)
        self.verdict = Verdict()
        self._nodes, self._wanted = nodes, wanted
        self.processes: dict[str, NodeProcess] = {}
        # The plant last: who starts after it would hear only the repeated manifests.
        for card in sorted(CARDS, key=lambda card: card.executable == 'plant'):
            if card.executable in wanted:
                self._start(card.package, card.executable)

    def _start(self, package: str, name: str) -> None:
        given: dict[str, object] = {
            'plant': {
                'scenario': self.path,
                'wait_for_recorder': 'recorder' in self._wanted,
                'real_time_factor': PACE,
                'peer_timeout_s': 30.0,
                'start_timeout_s': 60.0,
                'resend_after_s': 1.0,
            },
            'operator': {'phase': 'never', 'patience_s': 1e6},
            'fuzzy_controller': {'controller': _CONTROLLER},
            'recorder': {'output': self.folder / 'run', 'plant_timeout_s': 30.0},
            'web': {'port': 0},
        }.get(name, {})  # type: ignore[assignment]
        remap = {}
        if name in ('replay', 'rival_controller'):
            remap = {'__ns': _REPLAYED}
            bag, scenario = _replayed(self.folder) if name == 'replay' else (None, None)
            if name == 'replay':
                given = {'bag': bag, 'drive': True, 'loop': True, 'answer_timeout_s': 60.0}
                self._nodes.node(
                    'rpo_ctrl',
                    'rival_controller',
                    remap=remap,
                    controller=_RIVAL,
                    scenario=scenario,
                )
                self.processes['rival_controller'] = self._nodes.nodes[-1]
            else:
                return
        self.processes[name] = self._nodes.node(package, name, remap=remap, **given)

    def endure(self, seed: int, first: int, count: int) -> Counter[str]:
        """Send cases while the flight flies, to its end or to a death; return them by target."""
        self.processes['plant'].says('flying', 60.0)
        cards = {card.executable: card.parameters for card in CARDS}
        sender = Sender(seed, self.scenario, cards)
        try:
            sender.connect(len(self.processes))
            last = self.scenario.ticks - 10 * round(PACE / self.scenario.dt_s)
            done = 0
            while done < count and sender.tick < last and not self._dead(sender.last):
                size = min(VOLLEY, count - done)
                sender.volley(first + done, size)
                done += size
                self.verdict.drawn = done
            self.verdict.cases = sum(sender.cases.values())
            self.verdict.asked_again = sender.asked_again.total()
            for name, number in sender.unanswered.items():
                self.verdict.deaths.append(f'{name}: {number} calls without an answer')
            if not self.verdict.deaths:
                self._hurry(sender)
        finally:
            sender.close()
        return sender.cases

    def _dead(self, sent: Sequence[str]) -> bool:
        ended = [name for name, node in self.processes.items() if not node.running]
        for name in ended:
            code = self.processes[name].wait()
            self.verdict.deaths.append(f'{name} ended with exit code {code}')
        if ended:
            (self.folder / 'last_volley.txt').write_text('\n'.join(sent), encoding='utf-8')
        return bool(ended)

    @staticmethod
    def _hurry(sender: Sender) -> None:
        """Let what was sent arrive, then fly the rest faster."""
        sender.spin(1.0)
        fast = ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=HURRY)
        request = SetParameters.Request(parameters=[Parameter(name='real_time_factor', value=fast)])
        sender.ask('/plant/set_parameters', request)

    def judge(self) -> Verdict:
        """Wait for the end, and compare."""
        verdict = self.verdict
        ends = ('plant', 'recorder') if not verdict.deaths else ()
        waits = [name for name in ends if name in self.processes]
        # The others answer the plant until it has ended.
        for name in (*waits, *(name for name in self.processes if name not in waits)):
            node = self.processes[name]
            try:
                code = node.wait(_END_S) if name in waits else node.stop(signal.SIGINT)
            except NodeProcessError:
                verdict.deaths.append(f'{name} does not end')
                node.discard()
                continue
            known = any(said.startswith(f'{name} ended') for said in verdict.deaths)
            if code not in _ENDS.get(name, (0,)) and not known:
                verdict.deaths.append(f'{name} ended with exit code {code}')
        for name, node in self.processes.items():
            said = node.output
            verdict.warnings[name] = len(_WARNING.findall(said))
            if verdict.warnings[name] > MOST_WARNINGS:
                verdict.faults.append(f'{name} printed {verdict.warnings[name]} warnings: a flood')
            found = _FAULT.search(said)
            if found:
                verdict.faults.append(f'{name} printed: {said[found.start() :][:_SHOWN]}')
        verdict.recorded = 'recorder' in self.processes
        if verdict.recorded:
            self._compare()
        return verdict

    def _compare(self) -> None:
        verdict = self.verdict
        try:
            found = verify(self.folder / 'run')
            verdict.verified = found.exit_code == 0
            if not verdict.verified:
                verdict.faults.append(found.sentence())
                return
            flown = read_flight(self.folder / 'run')
        except (LogError, InputError) as error:
            verdict.faults.append(str(error))
            return
        expected = fly(self.scenario, load_controller(_CONTROLLER))
        for name in ('states', 'forces_n', 'disturbances_n'):
            logged, computed = getattr(flown, name), getattr(expected, name)
            if not np.array_equal(logged, computed):
                verdict.changed_bits = True
                verdict.faults.append(f'{name} differ from those of the flight without ROS')


MOST_CASES = 10_000
"""Of one flight."""
MOST_DEATHS = 10
"""After so many the trial ends: each death costs a flight."""
DOMAIN = '101'
"""ROS domain, unless ROS_DOMAIN_ID names one: hostile messages must not reach other flights."""


@dataclass(frozen=True)
class Plan:
    """What to send.

    cases : how many; first : number of the first one
    nodes : executables of the nodes that fly
    minutes : after which no new flight begins
    keep : folder for logs and outputs; '' keeps none
    """

    cases: int
    first: int = 0
    seed: int = 1
    nodes: Sequence[str] = NODES
    minutes: float = 1e4
    keep: str = ''

    def __post_init__(self) -> None:
        if self.cases < 1 or self.first < 0:
            raise InputError(
                f'`cases` must be 1 or more and `first` 0 or more; got {self.cases}, {self.first}'
            )
        if 'plant' not in self.nodes:
            raise InputError(f'`nodes` must name the plant; got {", ".join(self.nodes)}')


def _fly(plan: Plan, first: int, count: int) -> tuple[Verdict, Counter[str]]:
    """Send some cases in one flight; return its verdict, and the cases by topic and service."""
    with tempfile.TemporaryDirectory(prefix='rpo_fuzz_') as name:
        folder = Path(plan.keep, f'from_{first}') if plan.keep else Path(name)
        folder.mkdir(parents=True, exist_ok=True)
        env = {'RPO_JIT': '0', 'ROS_DOMAIN_ID': os.environ['ROS_DOMAIN_ID']}
        with node_processes(env, folder) as nodes:
            one = Flight(nodes, plan.nodes, count)
            cases = one.endure(plan.seed, first, count)
            return one.judge(), cases


def run(plan: Plan) -> int:
    """Send the cases, print what they did, and return the exit code: 1 if anything is wrong."""
    os.environ.setdefault('ROS_DOMAIN_ID', DOMAIN)
    begun = time.monotonic()
    print(links.machine(), flush=True)
    sent: Counter[str] = Counter()
    verdicts: list[Verdict] = []
    at, end = plan.first, plan.first + plan.cases
    while at < end and time.monotonic() - begun < 60.0 * plan.minutes:
        verdict, counts = _fly(plan, at, min(MOST_CASES, end - at))
        verdicts.append(verdict)
        sent += counts
        print('\n  '.join((_line(at, verdict), *verdict.deaths, *verdict.faults)), flush=True)
        at += max(verdict.drawn, 1)
        if sum(len(verdict.deaths) for verdict in verdicts) >= MOST_DEATHS:
            break
    print('| topic, service | cases |\n|---|---|')
    for name, number in sorted(sent.items()):
        print(f'| {name} | {number} |')
    return _sum_up(verdicts, sum(sent.values()), time.monotonic() - begun)


def _line(first: int, verdict: Verdict) -> str:
    warnings = ', '.join(f'{name} {n}' for name, n in verdict.warnings.items() if n)
    return (
        f'flight from case {first}: {verdict.cases} cases, {len(verdict.deaths)} deaths, '
        f'{verdict.of_the_log}; {verdict.asked_again} calls asked again; '
        f'lines of warning: {warnings or "none"}'
    )


def _sum_up(verdicts: Sequence[Verdict], cases: int, wall_s: float) -> int:
    deaths = sum(len(verdict.deaths) for verdict in verdicts)
    changed = sum(verdict.changed_bits for verdict in verdicts)
    unverified = sum(verdict.recorded and not verdict.verified for verdict in verdicts)
    again = sum(verdict.asked_again for verdict in verdicts)
    print(
        f'{cases} cases in {len(verdicts)} flights, {wall_s:.0f} s: {deaths} deaths, '
        f'{changed} flights with changed bits, {unverified} logs that do not verify; '
        f'{again} calls asked again'
    )
    return int(any(verdict.deaths or verdict.faults for verdict in verdicts))
