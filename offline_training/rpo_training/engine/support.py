# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What the engine knows; other flights run one by one through `rpo_core.flight.fly`."""

from __future__ import annotations

import sys
import threading

from rpo_core.baselines import Baseline
from rpo_core.controller import Controller, FuzzyController
from rpo_core.scenario import Scenario
from rpo_core.stage import section_of

_announced: set[str] = set()
_lock = threading.Lock()


def why_not(scenario: Scenario, controller: Controller) -> str:
    """Return why the engine cannot fly a controller through a scenario; '' if it can.

    The engine knows the errors of thrusters and navigation that campaigns disperse, but no section
    of a scenario.
    """
    known = [kind for kind in (FuzzyController, Baseline) if isinstance(controller, kind)]
    if not known or type(controller).stage is not known[0].stage:
        return f'controller {controller.name} has a stage of its own'
    if scenario.sections:
        name = section_of(scenario.sections[0]).name
        return f'scenario {scenario.name} has a section `{name}`'
    return ''


def announce(reason: str) -> None:
    """Print, once in a process, that flights run one by one, and why."""
    with _lock:
        if reason not in _announced:
            _announced.add(reason)
            print(f'{reason}: the engine does not know it; flights run one by one', file=sys.stderr)
