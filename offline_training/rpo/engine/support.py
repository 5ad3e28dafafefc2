# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What the engine knows; other flights run one by one through `rpo_core.chain.flight.fly`."""

from __future__ import annotations

import sys
import threading
from collections.abc import Collection
from importlib import import_module
from pkgutil import iter_modules

from rpo.engine import parts
from rpo.engine.parts import control
from rpo.engine.tick import KINDS, Kind
from rpo_core import plugins
from rpo_core.control.controller import Controller
from rpo_core.scenario.scenario import Scenario
from rpo_core.stage import section_of

for _module in sorted(module.name for module in iter_modules(parts.__path__)):
    import_module(f'{parts.__name__}.{_module}')  # it registers itself

_announced: set[str] = set()
_lock = threading.Lock()


def kinds() -> list[Kind]:
    """Return all that is registered; loads the plug-ins first."""
    plugins.load()
    return KINDS


def why_not(
    scenario: Scenario, controller: Controller, known: Collection[str] | None = None
) -> str:
    """Return why the engine cannot fly a controller through a scenario; '' if it can.

    known : sections that are flown; None: all that are registered, as in campaigns
    """
    if not control.is_known(controller):
        return f'controller {controller.name} has a stage of its own'
    registered = {kind.section: kind for kind in kinds()}
    for settings in scenario.sections:
        name = section_of(settings).name
        if name not in (registered if known is None else known):
            return f'scenario {scenario.name} has a section `{name}`'
        if reason := registered[name].refuse(scenario):
            return f'scenario {scenario.name} has {reason}'
    return ''


def announce(reason: str) -> None:
    """Print, once in a process, that flights run one by one, and why."""
    with _lock:
        if reason not in _announced:
            _announced.add(reason)
            print(f'{reason}: the engine does not know it; flights run one by one', file=sys.stderr)
