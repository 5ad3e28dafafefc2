# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A bound of the work of a search, counted in steps: the same on every machine, however fast."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

_left: ContextVar[list[float] | None] = ContextVar('left', default=None)


class TooMuch(Exception):
    """More work was asked for than is allowed."""


@contextmanager
def bounded(steps: float) -> Iterator[None]:
    """Let what is searched inside take so many steps; raises TooMuch when it takes more."""
    token = _left.set([steps])
    try:
        yield
    finally:
        _left.reset(token)


def spend(steps: float) -> None:
    """Count steps, before they are taken; outside of `bounded` there is no bound."""
    left = _left.get()
    if left is not None:
        left[0] -= steps
        if left[0] < 0.0:
            raise TooMuch
