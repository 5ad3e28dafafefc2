# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Scenarios whose sections come from any that ship, with dispersions at their edges, by number.

As a program it prints a digest of each flight by the driver, from one number to another.
"""

from __future__ import annotations

import hashlib
import sys
from collections import defaultdict
from collections.abc import Collection, Mapping
from dataclasses import replace
from functools import cache
from typing import Any
from unittest import mock

import numpy as np

from rpo.montecarlo import config, run_batch, sampling
from rpo_core import files
from rpo_core.chain.chain import Chain, start_of
from rpo_core.chain.driver import Driver
from rpo_core.control.controller import AnyController, load_controller
from rpo_core.files.validation import InputError
from rpo_core.scenario.scenario import Scenario, load
from rpo_core.stage import section_of
from rpo_core.wire.interfaces import NEXT

CONTROLLERS = ('allround', 'more_words', 'time_to_go', 'mpc', 'lqr', 'pd', 'apf_smc', 'drift')
EDGES = (0.0, 0.5, 1.0 - 2.0**-53)
"""Draws in [0, 1): the least, the nominal, the largest."""


@cache
def sections() -> Mapping[str, list[Any]]:
    """Return the settings of each section, of all scenarios that ship."""
    found = defaultdict(list)
    for name in files.shipped('scenario'):
        member = load(name)
        base = member if isinstance(member, Scenario) else member.base
        for settings in base.sections:
            found[section_of(settings).name].append(settings)
    return found


@cache
def campaigns() -> list[Any]:
    """Return the campaigns that ship."""
    return [config.load(name, [], runs=2) for name in sorted(files.shipped('campaign'))]


def drawn(random: np.random.Generator) -> Scenario:
    """Return a run of a campaign, each of whose draws is at an edge."""
    campaign = campaigns()[random.integers(len(campaigns()))]

    def edges(_campaign: Any, numbers: Any, width: int, _name: str = '') -> Any:
        return random.choice(EDGES, (len(numbers), width))

    with mock.patch.object(sampling, '_unit_draws', edges):
        runs = sampling.draw(campaign, 0, 1)
    return run_batch.scenarios_of(campaign, runs)[0]


def mixed(scenario: Scenario, random: np.random.Generator) -> Scenario:
    """Return a scenario with some sections from elsewhere, and without some."""
    settings = {section_of(s).name: s for s in scenario.sections}
    for name, choices in sections().items():
        chance = random.uniform()
        if chance < 0.12:
            settings[name] = choices[random.integers(len(choices))]
        elif chance > 0.93:
            settings.pop(name, None)
    ticks = int(random.integers(5, 60))
    return replace(
        scenario,
        sections=tuple(settings.values()),
        requirements=None,
        duration_s=ticks * scenario.dt_ns / 1e9,
    )


def mixture(number: int) -> tuple[Scenario, AnyController]:
    """Return a scenario that is not refused, and a controller that fits."""
    random = np.random.default_rng([45, number])
    while True:
        try:
            controller = load_controller(CONTROLLERS[random.integers(len(CONTROLLERS))])
            scenario = mixed(drawn(random), random)
            controller.stage(scenario.dt_s)
            return scenario, controller
        except InputError:
            continue


def by_driver(
    scenario: Scenario, controller: AnyController, kept: Collection[str] | None = None
) -> dict[str, bytes]:
    """Return the signals of a flight by the driver: those that are kept, or all."""
    flown = Driver(Chain.of(scenario, controller), kept).fly(start_of(scenario), scenario.ticks)
    return {name: np.ascontiguousarray(rows).tobytes() for name, rows in flown.items()}


def by_steps(scenario: Scenario, controller: AnyController) -> dict[str, bytes]:
    """Return the signals of a flight by the steps of its chain."""
    chain, signals = Chain.of(scenario, controller), start_of(scenario)
    rows: dict[str, list[Any]] = {name: [] for name in chain.outputs}
    chain.reset()
    for tick in range(scenario.ticks + 1):
        truth = {name: signals[name] for name in NEXT if name in signals}
        chain.step(tick, signals)
        for name, values in rows.items():
            values.append((signals | truth)[name])
    return {name: np.array(values).tobytes() for name, values in rows.items()}


def digest(flown: Mapping[str, bytes]) -> str:
    """Return a digest of signals."""
    made = hashlib.sha256()
    for name, content in sorted(flown.items()):
        made.update(name.encode() + content)
    return made.hexdigest()[:16]


if __name__ == '__main__':
    for i in range(int(sys.argv[1]), int(sys.argv[2])):
        print(i, digest(by_driver(*mixture(i))), flush=True)
