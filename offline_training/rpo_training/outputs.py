# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Files that commands write: complete or not at all, and parts of pages between two markers."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import IO, TYPE_CHECKING

from rpo_core.validation import InputError, shown, text

if TYPE_CHECKING:
    from rpo_core.flight import Flight

END = '<!-- end -->'


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Turn an OSError inside into an InputError: `path` cannot be written."""
    try:
        yield
    except OSError as error:
        raise InputError(f'{path}: cannot be written: {error.strerror or error}') from None


def write_flight(flight: Flight, path: Path) -> None:
    """Write time, state, force and disturbance of every tick as CSV; raises InputError."""
    import numpy as np

    heading = 't_s,x_m,y_m,z_m,vx_m_s,vy_m_s,vz_m_s,fx_n,fy_n,fz_n,dx_n,dy_n,dz_n'
    columns = flight.scenario.times_s, flight.states, flight.forces_n, flight.disturbances_n
    with writing(path):
        np.savetxt(
            path,
            np.column_stack(columns),
            fmt='%.17g',
            delimiter=',',
            header=heading,
            comments='',
        )


def write_aside(path: Path, write: Callable[[IO[bytes]], object]) -> None:
    """Write a file beside `path` and rename it into place: the old one stays whole until then.

    Raises
    ------
    InputError
        If it cannot be written, as on a full disk; `path` is then as it was.
    """
    aside = path.with_name(f'.{path.name}.new')
    try:
        with aside.open('wb') as file:
            write(file)
            file.flush()
            os.fsync(file.fileno())
        aside.replace(path)
    except BaseException as error:
        aside.unlink(missing_ok=True)
        if isinstance(error, OSError):
            raise InputError(f'{path}: cannot be saved: {error.strerror or error}') from None
        raise


def markdown_table(headings: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """Return the lines of a Markdown table."""
    lines = [f'| {" | ".join(cells)} |' for cells in (headings, *rows)]
    return [lines[0], '|' + '---|' * len(headings), *lines[1:]]


def write_text(path: Path, content: str) -> None:
    """Write a text file, as `write_aside` does."""
    write_aside(path, lambda file: file.write(content.encode()))


def make_folder(folder: Path) -> None:
    """Make a folder, with its parents, where there is none; raises InputError."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f'{folder}: cannot be made: {error.strerror or error}') from None


def check_name(name: str, what: str) -> None:
    """Raise InputError if a `name` cannot name a file or a folder, as `what` says."""
    text('name', name)
    if not name.replace('_', '').replace('-', '').isalnum():
        raise InputError(
            f'`name` must be letters, digits, - and _, to name {what}; got {shown(name)}'
        )


def put(page: Path, command: str, content: str) -> None:
    """Replace the text between the marker of a command and END; add both to a page without."""
    begin = f'<!-- printed by `{command}` -->'
    page_text = page.read_text() if page.is_file() else ''
    if begin not in page_text:
        page_text = f'{page_text.rstrip()}\n\n{begin}\n{END}\n'.lstrip()
    before, _, rest = page_text.partition(begin)
    after = rest.partition(END)[2]
    write_text(page, f'{before}{begin}\n{content}{END}{after}')
