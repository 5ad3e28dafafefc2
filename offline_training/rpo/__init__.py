# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The door: fly, judge, train, disperse, prove and report, by name.

    import rpo

    flight = rpo.fly('paper_test', 'allround', mass_kg=12.0)
    flight.metrics, flight.requirements, flight.plot()

Scenarios, controllers and campaigns are names of what ships, paths of files, or objects. Any
function `law(t, x)` is a controller. A wrong input raises an `InputError` of one sentence.
"""

from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rpo_core import files
from rpo_core.files.validation import InputError as InputError

if TYPE_CHECKING:
    from rpo.door.flight import Explanation as Explanation
    from rpo.door.flight import Flight as Flight
    from rpo.door.flight import Replay as Replay
    from rpo.door.flight import fly as fly
    from rpo.door.subjects import Catalogue as Catalogue
    from rpo.door.subjects import campaigns as campaigns
    from rpo.door.subjects import controller as controller
    from rpo.door.subjects import controllers as controllers
    from rpo.door.subjects import scenario as scenario
    from rpo.door.subjects import scenarios as scenarios

files.SHIPPED['campaign'] = Path(__file__).parent / 'shipped' / 'campaigns'

_MODULES = {
    'Catalogue': 'subjects',
    'Explanation': 'flight',
    'Flight': 'flight',
    'Replay': 'flight',
    'campaigns': 'subjects',
    'controller': 'subjects',
    'controllers': 'subjects',
    'fly': 'flight',
    'scenario': 'subjects',
    'scenarios': 'subjects',
}
"""Name -> its module of `rpo.door`, imported as the name is asked for."""

__all__ = ['InputError', *_MODULES]


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f'module `rpo` has no attribute `{name}`; it has {", ".join(__all__)}')
    value = getattr(import_module(f'rpo.door.{_MODULES[name]}'), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
