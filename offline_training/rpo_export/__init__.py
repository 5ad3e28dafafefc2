# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A controller in the formats of other tools, and as source code without dependencies.

A format is a module with `text`, and a line in `FORMATS`; `importing` reads some of them back.
"""

from __future__ import annotations

from collections.abc import Callable

from rpo_core.control.controller import AnyController, FuzzyController, only_fuzzy
from rpo_core.files.validation import choice
from rpo_ctrl.family import Family
from rpo_export import c, family, fcl, fis, fll, json, python

FORMATS: dict[str, Callable[[FuzzyController], str]] = {
    'fis': fis.text,
    'fll': fll.text,
    'fcl': fcl.text,
    'json': json.text,
    'python': python.text,
    'c': c.text,
}
"""MATLAB, FuzzyLite, IEC 61131-7; JSON; Python and C99 functions with the bits of the kernels.

C99 of any controller that answers by a kernel."""

SUFFIXES = {'python': '.py', **{name: f'.{name}' for name in FORMATS if name != 'python'}}
"""File name suffix of each format."""


def text_of(controller: AnyController, name: str) -> str:
    """Return a controller in one of `FORMATS`, of a family in some of them; raises InputError."""
    if isinstance(controller, Family):
        return family.text(controller, name)
    if name == 'c':
        return c.text(controller)
    return FORMATS[choice('--to', name, FORMATS)](only_fuzzy(controller))
