# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The error of a value that a user gave: one sentence that is safe on a terminal."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

MOST_SHOWN = 2000
"""Characters of a foreign text that are shown; a field of a log may have as many as it likes."""


def printable(text: object, most: int = MOST_SHOWN) -> str:
    r"""Return a foreign text as one line that is safe on a terminal and in a log.

    Escape sequences, newlines and marks that turn the direction of writing become escapes like
    `\x1b`; of a longer text, the first `most` characters stay. What is printable stays as it is.
    """
    line = str(text)
    line = line if len(line) <= most else f'{line[: most - 3]}...'
    return line if line.isprintable() else ''.join(map(_escaped, line))


def _escaped(character: str) -> str:
    return character if character.isprintable() else repr(character)[1:-1]


class InputError(ValueError):
    """A value from a user is not usable; the message is one printable sentence."""

    def __init__(self, sentence: object) -> None:
        super().__init__(printable(sentence))


def shown(value: Any, limit: int = 60) -> str:
    """Return `value` as it is quoted in an error, cut to `limit` characters."""
    text = repr(value)
    return text if len(text) <= limit else f'{text[: limit - 3]}...'


def quoted(name: str) -> str:
    """Return a name from a file as an error quotes it: in backticks, if short and printable."""
    return f'`{name}`' if name.isprintable() and len(name) <= 80 else shown(name)


@contextmanager
def within(place: str) -> Iterator[None]:
    """Prefix an InputError raised inside with its place: a file, or a field of one."""
    try:
        yield
    except InputError as error:
        raise InputError(f'{place}: {error}') from None
