# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Files of commands: written complete or not at all, locked, read back with damage noticed."""

from __future__ import annotations

import fcntl
import hashlib
import os
import re
import zipfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import yaml

from rpo_core import files
from rpo_core.files.validation import InputError, shown, text

if TYPE_CHECKING:
    from numpy.typing import NDArray

END = '<!-- end -->'

VERSIONS = 'versions.yaml'
"""Of resumable work in a folder: versions of the libraries, and digests."""


def identifier(text: str) -> str:
    """Return a name that every language, and every file system, takes."""
    name = re.sub(r'\W', '_', text, flags=re.ASCII)
    return name if name[:1].isalpha() else f'rpo_{name}'


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Turn an OSError inside into an InputError: `path` cannot be written."""
    try:
        yield
    except OSError as error:
        raise InputError(f'{path}: cannot be written: {error.strerror or error}') from None


@contextmanager
def alone(path: Path, doing: str) -> Iterator[None]:
    """Lock a file; raises InputError if another process holds it, and is `doing` the same."""
    with ExitStack() as stack:
        with writing(path):
            file = stack.enter_context(path.open('r+b', buffering=0))
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise InputError(f'{path.parent}: another process {doing}') from None
        yield


def read_arrays(path: Path, *names: str) -> dict[str, NDArray[Any]]:
    """Return arrays of an .npz file, all if none is named.

    Raises
    ------
    InputError
        If it is missing, no regular file, or damaged in any way.
    """
    import numpy as np

    try:
        with files.open_regular(path) as file, np.load(file, allow_pickle=False) as saved:
            if len(set(saved.files)) < len(saved.files):
                raise ValueError('it holds an array twice')
            return {name: saved[name] for name in names or saved.files}
    except OSError as error:
        raise InputError(f'{path}: cannot be read: {error.strerror or error}') from None
    except Exception as error:  # zipfile and NumPy raise all kinds of them for damaged bytes
        raise InputError(f'{path}: is damaged: {error}') from None


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


def write_arrays(
    path: Path, arrays: Iterable[tuple[str, Any]], compression: int = zipfile.ZIP_STORED
) -> None:
    """Write an .npz, array by array, without times of files: the same bytes each time."""
    import numpy as np

    def write(file: IO[bytes]) -> None:
        with zipfile.ZipFile(file, 'w') as archive:
            for name, values in arrays:
                entry = zipfile.ZipInfo(f'{name}.npy')
                entry.compress_type = compression
                large = compression == zipfile.ZIP_STORED
                with archive.open(entry, 'w', force_zip64=large) as member:
                    np.lib.format.write_array(member, np.asarray(values), allow_pickle=False)

    write_aside(path, write)


def begin_folder(folder: Path, texts: Mapping[str, str], versions: Mapping[str, str]) -> None:
    """Write what resumable work in a folder follows from; with the last text, it is begun.

    versions : of the libraries, and digests, of when it is begun
    """
    write_text(folder / VERSIONS, yaml.safe_dump(dict(versions)))
    for name, content in texts.items():
        write_text(folder / name, content)


def require_free(folder: Path, marker: str, what: str, hint: Callable[[], str]) -> None:
    """Raise InputError if a folder holds such work, which `marker` shows, or other files."""
    if not folder.exists() or (folder.is_dir() and not any(folder.iterdir())):
        return
    if (folder / marker).is_file():
        raise InputError(f'{folder}: holds a {what} already{hint()}')
    raise InputError(f'{folder}: must be a new or empty folder; it holds other things')


def digest_of(*texts: str) -> str:
    """Return the SHA-256 of texts, in hexadecimal."""
    return hashlib.sha256('\0'.join(texts).encode()).hexdigest()


def markdown_table(headings: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """Return the lines of a Markdown table; a cell may hold a `|`."""
    escaped = ([cell.replace('|', '\\|') for cell in cells] for cells in (headings, *rows))
    lines = [f'| {" | ".join(cells)} |' for cells in escaped]
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
    page_text = files.read_text(page) if page.is_file() else ''
    if begin not in page_text:
        page_text = f'{page_text.rstrip()}\n\n{begin}\n{END}\n'.lstrip()
    before, _, rest = page_text.partition(begin)
    after = rest.partition(END)[2]
    write_text(page, f'{before}{begin}\n{content}{END}{after}')
