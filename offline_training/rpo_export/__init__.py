# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A controller in the formats of other tools, and as source code without dependencies.

A format is a function of a controller, and a line in `FORMATS`; `importing` reads some of them
back.
"""

from __future__ import annotations

from collections.abc import Callable

from rpo_core.control.controller import AnyController
from rpo_core.files.validation import choice
from rpo_export import c, formats, python

FORMATS: dict[str, Callable[[AnyController], str]] = {
    'fis': formats.fis,
    'fll': formats.fll,
    'json': formats.json,
    'python': python.text,
    'c': c.text,
}
"""MATLAB, FuzzyLite; JSON; Python and C99 functions with the bits of the kernels."""

SUFFIXES = {name: '.py' if name == 'python' else f'.{name}' for name in FORMATS}
"""File name suffix of each format."""


def text_of(controller: AnyController, name: str) -> str:
    """Return a controller in one of `FORMATS`; raises InputError if that cannot say it."""
    return FORMATS[choice('--to', name, FORMATS)](controller)
