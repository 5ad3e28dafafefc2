# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What to say where a library is missing."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager

from rpo_core.kernels.errors import InputError

_INSTALLED_BY = {
    **dict.fromkeys(('mcap', 'zstandard', 'lz4'), 'mcap'),
    **{name: name for name in ('rosbags', 'cryptography', 'matplotlib', 'pandas', 'xarray')},
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


@contextmanager
def reported() -> Iterator[None]:
    """Make the import of a missing library inside an InputError that says how to install it."""
    try:
        yield
    except ModuleNotFoundError as error:
        if (text := sentence(error.name)) is None:
            raise
        raise InputError(text) from None
