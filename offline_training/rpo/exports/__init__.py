# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A controller in the formats of other tools, and as source code without dependencies.

A format is a function of a controller, and a line in `FORMATS`; `formats` reads some of them
back.
"""

from __future__ import annotations

from collections.abc import Callable

from rpo.exports import c, formats
from rpo_core.control.controller import AnyController, dumps
from rpo_core.files.validation import choice

FORMATS: dict[str, Callable[[AnyController], str]] = {
    'fis': formats.fis,
    'fll': formats.fll,
    'json': formats.json,
    'c': lambda controller: c.of_controller(controller, f'{controller.name}.c').source,
    'yaml': dumps,
}
"""MATLAB, FuzzyLite; JSON; C99 with the bits of the kernels; the file that flies."""


def text_of(controller: AnyController, name: str) -> str:
    """Return a controller in one of `FORMATS`; raises InputError if that cannot say it."""
    return FORMATS[choice('--to', name, FORMATS)](controller)
