# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Modules of other people that add stages, controllers and topics: `RPO_PLUGINS` names them.

The environment says which code is loaded, never a scenario, a controller file or a log.
"""

from __future__ import annotations

import importlib
import os

from rpo_core.validation import InputError

VARIABLE = 'RPO_PLUGINS'
"""Environment variable: names of modules, separated by commas."""

_loaded = False


def load() -> None:
    """Import the modules, once; raises InputError if there is none of a name."""
    global _loaded
    if _loaded:
        return
    _loaded = True
    for name in filter(None, os.environ.get(VARIABLE, '').split(',')):
        try:
            importlib.import_module(name.strip())
        except ModuleNotFoundError as error:
            raise InputError(f'environment variable `{VARIABLE}`: {error}') from None
