# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What to say where the one library is missing that rosdep cannot install: mcap."""

from __future__ import annotations

import sys

_MODULES = ('mcap', 'zstandard', 'lz4')
"""The library reads logs; the other two are compression, and come with it."""


def sentence(module: str | None) -> str | None:
    """Return how to install a missing module; None if it is not one of mcap.

    module : its full name, as ModuleNotFoundError has it
    """
    top = (module or '').partition('.')[0]
    if top not in _MODULES:
        return None
    # Outside a virtual environment Debian and Ubuntu refuse pip. `--user` touches nothing of apt.
    options = '' if sys.prefix != sys.base_prefix else '--user --break-system-packages '
    return (
        f'the Python library {top} is missing: `python3 -m pip install {options}mcap` installs it'
    )
