# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The one exception of this package, and what the exit codes of log commands mean."""

from __future__ import annotations

from enum import IntEnum
from pathlib import Path

from rpo_core.files import open_regular
from rpo_core.files.validation import InputError, printable


class ExitCode(IntEnum):
    """Exit codes of the commands that read logs."""

    OK = 0
    DIFFERENT = 1  # the logs differ, or the flight is not the one the log claims
    BAD_INPUT = 2  # not a readable log of a run
    INCOMPLETE = 3  # readable, and equal as far as it goes, but cut short or with holes
    GIVEN = 4  # whole and as computed, from signals that the caller declared given


class LogError(InputError):
    """A log that cannot be written or read, said in one sentence.

    path : Path, the file or folder concerned
    sentence : what is wrong, without the path
    """

    exit_code = ExitCode.BAD_INPUT

    def __init__(self, path: str | Path, sentence: str) -> None:
        super().__init__(f'{path}: {sentence}')
        self.sentence = printable(sentence)
        self.path = Path(path)


class NotARun(LogError):
    """There is no log of a run: nothing, nothing that can be read, or somebody else's file."""


class ExistsAlready(LogError):
    """The output is there already."""


def cannot_read(path: Path, error: OSError) -> LogError:
    """Return the LogError of a file that cannot be read."""
    return NotARun(path, f'cannot be read: {error.strerror or error}')


def cannot_write(path: Path, error: OSError) -> LogError:
    """Return the LogError of a place that takes no log."""
    return LogError(path, f'cannot hold a log: {error.strerror or error}')


def exists(path: Path, what: str = 'a log is never overwritten') -> LogError:
    """Return the LogError of an output that is there already."""
    return ExistsAlready(path, f'exists already; {what}')


def read_at_most(path: Path, most: int) -> bytes:
    """Return the first bytes of a regular file; raises LogError."""
    try:
        with open_regular(path) as stream:
            return stream.read(most)
    except OSError as error:
        raise cannot_read(path, error) from None
