# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What to say where a library is missing: mcap, rosbags for bags, cryptography for signatures."""

from __future__ import annotations

import sys

_INSTALLED_BY = {
    **dict.fromkeys(('mcap', 'zstandard', 'lz4'), 'mcap'),
    'rosbags': 'rosbags',
    'cryptography': 'cryptography',
}
"""What brings a module: mcap brings the libraries of compression too."""


def sentence(module: str | None) -> str | None:
    """Return how to install a missing module; None if it is none of these.

    module : its full name, as ModuleNotFoundError has it
    """
    top = (module or '').partition('.')[0]
    if top not in _INSTALLED_BY:
        return None
    # Outside a virtual environment Debian and Ubuntu refuse pip. `--user` touches nothing of apt.
    options = '' if sys.prefix != sys.base_prefix else '--user --break-system-packages '
    install = f'python3 -m pip install {options}{_INSTALLED_BY[top]}'
    return f'the Python library {top} is missing: `{install}` installs it'
