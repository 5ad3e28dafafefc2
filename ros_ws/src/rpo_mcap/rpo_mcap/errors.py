# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The one exception of this package, and what the exit codes of log commands mean."""

from __future__ import annotations

from enum import Enum, IntEnum
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


class Fault(str, Enum):
    """What is wrong with a log or with the place it should go."""

    EXISTS = 'exists'  # the output is there already
    CANNOT_WRITE = 'cannot write'
    NO_DEFINITIONS = 'no message definitions'
    NOT_FOUND = 'not found'
    NOT_MCAP = 'not MCAP'
    NOT_A_RUN = 'not a run'  # MCAP, but not written by this recorder
    NEWER = 'newer format'
    TRUNCATED = 'truncated'
    CORRUPT = 'corrupt'
    EMPTY = 'no messages'
    MISSING_TOPIC = 'missing topic'
    WRONG_TYPE = 'wrong type'
    MISSING_ATTACHMENT = 'missing attachment'
    BAD_ATTACHMENT = 'bad attachment'
    DUPLICATE_TICK = 'duplicate tick'
    TIME_BACKWARDS = 'time backwards'
    BAD_STAMP = 'bad stamp'
    BAD_MESSAGE = 'bad message'
    BAD_SUMS = 'bad sums'


class LogError(InputError):
    """A log that cannot be written or read: one sentence, and which fault it is.

    fault : Fault
    path : Path, the file or folder concerned
    sentence : what is wrong, without the path
    tick : of the message that is wrong; None if it is not one message
    """

    exit_code = ExitCode.BAD_INPUT

    def __init__(
        self, fault: Fault, path: str | Path, sentence: str, tick: int | None = None
    ) -> None:
        super().__init__(f'{path}: {sentence}')
        self.fault = fault
        self.sentence = printable(sentence)
        self.tick = tick
        self.path = Path(path)


def cannot_read(path: Path, error: OSError) -> LogError:
    """Return the LogError of a file that cannot be read."""
    return LogError(Fault.NOT_FOUND, path, f'cannot be read: {error.strerror or error}')


def cannot_write(path: Path, error: OSError) -> LogError:
    """Return the LogError of a place that takes no log."""
    return LogError(Fault.CANNOT_WRITE, path, f'cannot hold a log: {error.strerror or error}')


def exists(path: Path, what: str = 'a log is never overwritten') -> LogError:
    """Return the LogError of an output that is there already."""
    return LogError(Fault.EXISTS, path, f'exists already; {what}')


def read_at_most(path: Path, most: int) -> bytes:
    """Return the first bytes of a regular file; raises LogError."""
    try:
        with open_regular(path) as stream:
            return stream.read(most)
    except OSError as error:
        raise cannot_read(path, error) from None
