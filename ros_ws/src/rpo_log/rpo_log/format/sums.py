# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""SHA256SUMS: the digest of every file of a run folder, in the form of `sha256sum --check`."""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Iterator, Mapping
from pathlib import Path

from rpo_core.files import open_regular
from rpo_core.validation import shown
from rpo_log.errors import Fault, LogError
from rpo_log.format.run import SIGNATURE_FILE, SUMS_FILE, cannot_write, write_whole

MAX_SUMS_BYTES = 1 << 20

_LINE = re.compile(r'([0-9a-f]{64})  ([^\\\n\r]+)')
_BLOCK = 1 << 20


def digest_of(path: Path) -> str:
    """Return the SHA-256 of a file; raises LogError."""
    found = hashlib.sha256()
    try:
        with open_regular(path) as stream:
            while block := stream.read(_BLOCK):
                found.update(block)
    except OSError as error:
        raise LogError(
            Fault.NOT_FOUND, path, f'cannot be read: {error.strerror or error}'
        ) from None
    return found.hexdigest()


def files_below(folder: Path) -> Iterator[str]:
    """Yield the names of the files in a folder and below, but for the sums and their signature.

    Links, and names that a line of the sums cannot hold, are left out.
    """
    for path in sorted(folder.rglob('*')):
        name = path.relative_to(folder).as_posix()
        if name in (SUMS_FILE, SIGNATURE_FILE) or not _LINE.fullmatch(f'{"0" * 64}  {name}'):
            continue
        if path.is_file() and not path.is_symlink():
            yield name


def write_sums(folder: Path, known: Mapping[str, str] | None = None, without: str = '') -> None:
    """Write SHA256SUMS of a run folder, whole or not at all; raises LogError.

    A signature of older sums is removed.

    known : digests that are not computed again
    without : folder below that is not listed
    """
    known = known or {}
    names = [name for name in files_below(folder) if name.partition('/')[0] != without]
    lines = [f'{known.get(name) or digest_of(folder / name)}  {name}\n' for name in names]
    try:
        (folder / SIGNATURE_FILE).unlink(missing_ok=True)
        write_whole(folder / SUMS_FILE, ''.join(lines).encode())
    except OSError as error:
        raise cannot_write(folder / SUMS_FILE, error) from None


def read_sums(folder: Path) -> dict[str, str] | None:
    """Return the digests by file name; None without SHA256SUMS. Raises LogError."""
    data = sums_bytes(folder)
    if data is None:
        return None
    found: dict[str, str] = {}
    for number, line in enumerate(data.decode('utf-8', 'surrogateescape').split('\n')[:-1], 1):
        match = _LINE.fullmatch(line)
        name = match[2] if match else ''
        if match is None or name in found or not _is_inside(name):
            raise LogError(
                Fault.BAD_SUMS,
                folder / SUMS_FILE,
                f'line {number} must be a SHA-256, two spaces and the name of another file of the '
                f'folder; got {shown(line)}',
            )
        found[name] = match[1]
    return found


def sums_bytes(folder: Path) -> bytes | None:
    """Return the content of SHA256SUMS; None if there is none. Raises LogError."""
    path = folder / SUMS_FILE
    if not os.path.lexists(path):
        return None
    try:
        with open_regular(path) as stream:
            data = stream.read(MAX_SUMS_BYTES + 1)
    except OSError as error:
        raise LogError(
            Fault.NOT_FOUND, path, f'cannot be read: {error.strerror or error}'
        ) from None
    if len(data) > MAX_SUMS_BYTES or not data.endswith(b'\n'):
        raise LogError(
            Fault.BAD_SUMS, path, f'must hold whole lines, at most {MAX_SUMS_BYTES} bytes'
        )
    return data


def _is_inside(name: str) -> bool:
    """Return whether a name is that of a file in the folder or below."""
    return not any(part in ('', '.', '..') for part in name.split('/'))
