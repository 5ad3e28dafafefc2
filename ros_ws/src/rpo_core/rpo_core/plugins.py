# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Modules that add stages, controllers and topics, imported when the first is asked for.

This module knows none of them: a package names its own (`MODULES`), the environment those of other
people, never a scenario, a controller file or a log.
"""

from __future__ import annotations

import importlib
import os

MODULES: list[str] = []
"""Names of modules that register something; `rpo_core` names its own."""

VARIABLE = 'RPO_PLUGINS'
"""Environment variable: names of modules, separated by commas."""

_loaded = False


def load() -> None:
    """Import the modules, once; raises InputError if `RPO_PLUGINS` names one that is not there."""
    global _loaded
    if _loaded:
        return
    _loaded = True
    for name in MODULES:
        importlib.import_module(name)
    for name in filter(None, os.environ.get(VARIABLE, '').split(',')):
        try:
            importlib.import_module(name.strip())
        except ModuleNotFoundError as error:
            from rpo_core.files.validation import InputError

            raise InputError(f'environment variable `{VARIABLE}`: {error}') from None
