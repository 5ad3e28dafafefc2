# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Files of commands: written complete or not at all, locked, read back with damage noticed."""

from __future__ import annotations

import fcntl
import hashlib
import math
import os
import re
import zipfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, NamedTuple

import yaml

from rpo_core import files
from rpo_core.files.output import write_aside as write_aside
from rpo_core.files.output import write_text as write_text
from rpo_core.files.validation import InputError, shown, text

if TYPE_CHECKING:
    from numpy.typing import NDArray

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


MAX_ARRAY_BYTES = 1 << 31
"""Arrays that are read at once have at most so many bytes."""

MAX_EXPANSION = 64
"""Ours deflate to a half, and not to less than this share."""

_SMALL_BYTES = 1 << 24


class ArrayHeader(NamedTuple):
    """What an array of an .npz file is said to be, before it is read."""

    shape: tuple[int, ...]
    dtype: Any


def read_arrays(
    path: Path,
    *names: str,
    check: Callable[[Mapping[str, ArrayHeader]], object] = lambda headers: None,
) -> dict[str, NDArray[Any]]:
    """Return arrays of an .npz file, all if none is named.

    check : raises InputError for headers that are not as expected; nothing large is read before

    Raises
    ------
    InputError
        If it is missing, no regular file, damaged in any way, or larger than memory should hold.
    """
    from numpy.lib import format as npy

    try:
        with files.open_regular(path) as file, zipfile.ZipFile(file) as archive:
            headers, sizes = {}, {}
            for entry in archive.infolist():
                name = entry.filename.removesuffix('.npy')
                if name in headers:
                    raise ValueError('it holds an array twice')
                with archive.open(entry) as member:
                    headers[name] = _header_of(member, entry.file_size)
                sizes[name] = entry.file_size
            check(headers)
            found: dict[str, NDArray[Any]] = {}
            total = sum(sizes[name] for name in names or sizes)
            most = max(_SMALL_BYTES, MAX_EXPANSION * os.fstat(file.fileno()).st_size)
            most = min(most, MAX_ARRAY_BYTES)
            if total > most:
                raise InputError(f'{path}: must hold arrays of at most {most} bytes; got {total}')
            for name in names or headers:
                with archive.open(f'{name}.npy') as member:
                    found[name] = npy.read_array(member, allow_pickle=False)
            return found
    except OSError as error:
        raise InputError(f'{path}: cannot be read: {error.strerror or error}') from None
    except InputError:
        raise
    except Exception as error:  # zipfile and NumPy raise all kinds of them for damaged bytes
        raise InputError(f'{path}: is damaged: {error}') from None


def _header_of(member: IO[bytes], size: int) -> ArrayHeader:
    """Read the header of an array; raises ValueError if it does not fit the size of its file."""
    from numpy.lib import format as npy

    if npy.read_magic(member) != (1, 0):  # a header of later ones may be gigabytes long
        raise ValueError('an array is not in version 1.0 of the format')
    shape, _, dtype = npy.read_array_header_1_0(member)
    numbers = math.prod(shape) * dtype.itemsize
    if dtype.hasobject or not dtype.itemsize or numbers != size - member.tell():
        raise ValueError(f'an array has {size - member.tell()} bytes for {dtype} of shape {shape}')
    return ArrayHeader(shape, dtype)


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


def put(page: Path, name: str, content: str) -> None:
    """Replace the text between the two markers of a name; a page without them gets them at its end.

    Raises
    ------
    InputError
        If the page has not one marker of the beginning before one of the end.
    """
    begin, end = f'<!-- {name}: begin -->', f'<!-- {name}: end -->'
    text = files.read_text(page) if page.exists() else ''
    if begin not in text and end not in text:
        text = f'{text.rstrip()}\n\n{begin}{end}\n'.lstrip()
    before, _, rest = text.partition(begin)
    _, last, after = rest.partition(end)
    if not last or begin in rest or end in before or end in after:
        raise InputError(f'{page}: must have one line `{begin}` and, below it, one `{end}`')
    write_text(page, f'{before}{begin}\n\n{content.strip()}\n\n{end}{after}')
