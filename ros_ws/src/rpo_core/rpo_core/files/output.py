# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What commands write: files whole or not at all, and a standard output that says what it lost."""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any

from rpo_core.files.validation import InputError

EXIT_UNWRITTEN = 2


def write_aside(path: Path, write: Callable[[IO[bytes]], object]) -> None:
    """Write a file beside `path` and rename it into place: the old one stays whole until then.

    A pipe or a device is written as it is.

    Raises
    ------
    InputError
        If it cannot be written, as on a full disk; `path` is then as it was.
    """
    special = path.exists() and not path.is_file()
    target = Path(os.path.realpath(path))
    written = path if special else target.with_name(f'.{target.name}.new')
    try:
        with written.open('wb') as file:
            write(file)
            file.flush()
            if not special:
                os.fsync(file.fileno())
        if not special:
            written.replace(target)
    except BaseException as error:
        if not special:
            with suppress(OSError):
                written.unlink()
        if isinstance(error, OSError):
            raise InputError(f'{path}: cannot be saved: {error.strerror or error}') from None
        raise


def write_text(path: Path, content: str) -> None:
    """Write a text file, as `write_aside` does."""
    write_aside(path, lambda file: file.write(content.encode()))


class _Output(io.FileIO):
    """Standard output, or standard error: where it cannot be written, what comes after is lost.

    Of standard output, the command then ends with one sentence.
    """

    lost = False

    def write(self, data: Any) -> int:
        """Write, or end the command."""
        if not self.lost:
            try:
                return super().write(data) or 0
            except OSError as error:
                self.lost = True
                if self.fileno() == 1:
                    raise _refused(f'standard output cannot be written: {error.strerror}') from None
        return len(data)


def _refused(why: str) -> SystemExit:
    """Say why a command ends, and return what ends it."""
    print(f'{Path(sys.argv[0]).name}: {why}', file=sys.stderr, flush=True)
    return SystemExit(EXIT_UNWRITTEN)


def _replaced(stream: Any, errors: str) -> Any:
    """Return a stream in the place of a standard one; one that a test has put there stays."""
    if stream not in (sys.__stdout__, sys.__stderr__) or not isinstance(stream, io.TextIOWrapper):
        return stream
    stream.flush()
    raw: Any = _Output(stream.fileno(), 'w', closefd=False)
    return io.TextIOWrapper(
        raw if stream.write_through else io.BufferedWriter(raw),  # as with PYTHONUNBUFFERED
        stream.encoding,
        errors,
        line_buffering=stream.line_buffering,
        write_through=stream.write_through,
    )


@contextmanager
def standard_output() -> Iterator[None]:
    """Run a command: one sentence and exit code 2 where its standard output cannot be written.

    Letters that its encoding lacks are replaced. A path that no file can have is one sentence too.
    """
    for number in range(3):  # a closed one would become the next file that is opened
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)
    before = sys.stdout, sys.stderr
    nowhere = open(2, 'w', closefd=False) if before[1] is None else before[1]  # noqa: SIM115
    sys.stderr = _replaced(nowhere, 'backslashreplace')
    if before[0] is None:
        raise _refused('standard output is closed')
    sys.stdout = _replaced(before[0], 'replace')
    try:
        yield
    except UnicodeEncodeError as error:
        around = error.object[max(0, error.start - 20) : error.end + 20]
        raise _refused(
            f'a path, or a text that names one, must be in letters of {error.encoding}; '
            f'got {around!a}'
        ) from None
    finally:
        with suppress(ValueError):  # closed by whoever ran
            sys.stdout.flush()
            sys.stderr.flush()
        buffer = getattr(sys.stdout, 'buffer', None)
        if getattr(getattr(buffer, 'raw', buffer), 'lost', False):  # it may be in another thread
            raise SystemExit(EXIT_UNWRITTEN)
        sys.stdout, sys.stderr = before
