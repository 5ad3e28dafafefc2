# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What the engine knows; other flights run one by one through `rpo_core.chain.flight.fly`."""

from __future__ import annotations

import sys
import threading
from collections.abc import Collection

from rpo_core.chain.stage import section_of
from rpo_core.control.controller import Controller, FuzzyController
from rpo_core.files.scenario import Scenario
from rpo_ctrl.baselines import Baseline
from rpo_guidance.plan import HOLD, Guidance
from rpo_safety.settings import Assurance

_announced: set[str] = set()
_lock = threading.Lock()


IN_PAIRS = ('dynamics', 'thrusters', 'sensors', 'estimator', 'guidance', 'assurance')
"""Sections that the engine knows where every run has its own lanes, in campaigns."""


def why_not(scenario: Scenario, controller: Controller, known: Collection[str] = ()) -> str:
    """Return why the engine cannot fly a controller through a scenario; '' if it can.

    The engine knows the errors of thrusters and navigation that campaigns disperse, but of the
    sections of a scenario only those `known`.
    """
    kinds = [kind for kind in (FuzzyController, Baseline) if isinstance(controller, kind)]
    if not kinds or type(controller).stage is not kinds[0].stage:
        return f'controller {controller.name} has a stage of its own'
    names = [section_of(settings).name for settings in scenario.sections]
    for name in names:
        if name not in known:
            return f'scenario {scenario.name} has a section `{name}`'
    plan = scenario.section(Guidance)
    if plan is not None and any(leg.kind == HOLD for leg in plan.legs):
        return f'scenario {scenario.name} has a plan with holds'
    assurance = scenario.section(Assurance)
    if assurance is not None and assurance.abort is not None:
        return f'scenario {scenario.name} has an abort table'
    if assurance is not None and assurance.sigmas > 0.0 and 'estimator' in names:
        return f'scenario {scenario.name} has runtime assurance that follows an estimator'
    return ''


def announce(reason: str) -> None:
    """Print, once in a process, that flights run one by one, and why."""
    with _lock:
        if reason not in _announced:
            _announced.add(reason)
            print(f'{reason}: the engine does not know it; flights run one by one', file=sys.stderr)
