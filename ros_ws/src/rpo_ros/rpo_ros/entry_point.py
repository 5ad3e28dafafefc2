# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The first lines that a command runs: a signal during its imports ends it, in order and at once.

Imports take most of a second. It must itself import next to nothing.
"""

from __future__ import annotations

import gc
import os
import signal
from importlib import import_module
from types import FrameType


def _leave(_number: int, _frame: FrameType | None) -> None:
    os._exit(0)  # nothing is started yet


def start(module: str) -> int:
    """Return the exit code of a module's `main`; `rpo_ros.running` then takes over the signals."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _leave)
    code: int = import_module(module).main()
    gc.freeze()  # or the interpreter collects all that numba made, for seconds on a busy machine
    return code
