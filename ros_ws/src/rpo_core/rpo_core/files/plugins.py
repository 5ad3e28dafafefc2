# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Modules that add stages, controllers and topics: those of our rooms, and those of other people.

The environment says which code is loaded, never a scenario, a controller file or a log: a room of
ours is loaded where it is installed, other modules where `RPO_PLUGINS` names them.
"""

from __future__ import annotations

import importlib
import os

from rpo_core.files.validation import InputError

ROOMS = (
    'rpo_core.world',
    'rpo_core.thrusters',
    'rpo_core.control',
    'rpo_core.navigation',
    'rpo_core.attitude',
    'rpo_core.guidance',
    'rpo_core.assurance',
)
"""Rooms of this stack with a module `stages`, which registers their sections or kinds."""

VARIABLE = 'RPO_PLUGINS'
"""Environment variable: names of modules, separated by commas."""

_loaded = False


def load() -> None:
    """Import the modules, once; raises InputError if `RPO_PLUGINS` names one that is not there."""
    global _loaded
    if _loaded:
        return
    _loaded = True
    for room in ROOMS:
        importlib.import_module(f'{room}.stages')
    for name in filter(None, os.environ.get(VARIABLE, '').split(',')):
        try:
            importlib.import_module(name.strip())
        except ModuleNotFoundError as error:
            raise InputError(f'environment variable `{VARIABLE}`: {error}') from None
