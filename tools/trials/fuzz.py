# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Hostile messages, calls and parameters against every node, flight after flight, as a table."""

from __future__ import annotations

import os
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from rpo_core.files.validation import InputError
from tools.fuzzing import flight
from tools.fuzzing.flight import Flight, Verdict
from tools.node_processes import node_processes
from tools.trials import links

NODES = flight.ALL
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
