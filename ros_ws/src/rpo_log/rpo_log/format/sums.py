# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""SHA256SUMS: the digest of every file of a run folder, in the form of `sha256sum --check`."""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from rpo_core.files import open_regular
from rpo_core.files.validation import shown
from rpo_log.errors import Fault, LogError
from rpo_log.format.run import SIGNATURE_FILE, SUMS_FILE, cannot_write, write_whole

MAX_SUMS_BYTES = 1 << 20

_LINE = re.compile(r'([0-9a-f]{64})  ([^\\\n\r]+)')
_BLOCK = 1 << 20


@dataclass(frozen=True)
class Sums:
    """SHA256SUMS, read once: what is compared is what is signed.

    content : its bytes; None: there is no such file
    digests : SHA-256 by the name of the file
    """

    content: bytes | None = None
    digests: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Contents:
    """What is in a folder and below, but for the sums and their signature.

    files : names of the regular files, sorted
    others : what the sums cannot list, by name, and what it is: a link, a pipe, ...
    """

    files: tuple[str, ...]
    others: Mapping[str, str]

    @classmethod
    def of(cls, folder: Path) -> Contents:
        """Look into a folder; follow no link."""
        files: list[str] = []
        others: dict[str, str] = {}
        waiting = ['']
        while waiting:
            below = waiting.pop()
            try:
                with os.scandir(folder / below) as found:
                    entries = list(found)
            except OSError as error:
                others[below] = f'cannot be read: {error.strerror or error}'
                continue
            for entry in entries:
                name = f'{below}{entry.name}'
                if entry.is_dir(follow_symlinks=False):
                    waiting.append(f'{name}/')
                elif what := _why_not_listed(entry, name):
                    others[name] = what
                elif name not in (SUMS_FILE, SIGNATURE_FILE):
                    files.append(name)
        return cls(tuple(sorted(files)), dict(sorted(others.items())))


def _why_not_listed(entry: os.DirEntry[str], name: str) -> str:
    """Return why the sums cannot list an entry of a folder; empty if they can."""
    if entry.is_symlink():
        return 'is a link'
    if not entry.is_file(follow_symlinks=False):
        return 'is no regular file'
    return '' if _LINE.fullmatch(f'{"0" * 64}  {name}') else 'has a name with \\ or a line break'


def digest_of(path: Path, most: int | None = None) -> str:
    """Return the SHA-256 of a file, empty if it has more than `most` bytes; raises LogError."""
    found = hashlib.sha256()
    try:
        with open_regular(path) as stream:
            if most is not None and os.fstat(stream.fileno()).st_size > most:
                return ''
            while block := stream.read(_BLOCK):
                found.update(block)
    except OSError as error:
        raise LogError(
            Fault.NOT_FOUND, path, f'cannot be read: {error.strerror or error}'
        ) from None
    return found.hexdigest()


def write_sums(folder: Path, known: Mapping[str, str] | None = None, without: str = '') -> Sums:
    """Write SHA256SUMS of a run folder, whole or not at all; return it. Raises LogError.

    A signature of older sums is removed.

    known : digests that are not computed again
    without : folder below that is not listed
    """
    known = known or {}
    names = [name for name in Contents.of(folder).files if name.partition('/')[0] != without]
    digests = {name: known.get(name) or digest_of(folder / name) for name in names}
    text = ''.join(f'{digest}  {name}\n' for name, digest in digests.items())
    content = text.encode('utf-8', 'surrogateescape')
    if len(content) > MAX_SUMS_BYTES:
        raise LogError(
            Fault.BAD_SUMS,
            folder,
            f'has {len(names)} files, too many for {SUMS_FILE}: at most {MAX_SUMS_BYTES} bytes',
        )
    try:
        (folder / SIGNATURE_FILE).unlink(missing_ok=True)
        write_whole(folder / SUMS_FILE, content)
    except OSError as error:
        raise cannot_write(folder / SUMS_FILE, error) from None
    return Sums(content, digests)


def read_sums(folder: Path) -> Sums:
    """Return SHA256SUMS of a run folder; raises LogError."""
    content = _content(folder / SUMS_FILE)
    if content is None:
        return Sums()
    digests: dict[str, str] = {}
    for number, line in enumerate(content.decode('utf-8', 'surrogateescape').split('\n')[:-1], 1):
        match = _LINE.fullmatch(line)
        name = match[2] if match else ''
        if match is None or name in digests or not _is_inside(name):
            raise LogError(
                Fault.BAD_SUMS,
                folder / SUMS_FILE,
                f'line {number} must be a SHA-256, two spaces and the name of another file of the '
                f'folder; got {shown(line)}',
            )
        digests[name] = match[1]
    return Sums(content, digests)


def _content(path: Path) -> bytes | None:
    """Return the bytes of SHA256SUMS; None if there is none. Raises LogError."""
    if not os.path.lexists(path):
        return None
    try:
        with open_regular(path) as stream:
            content = stream.read(MAX_SUMS_BYTES + 1)
    except OSError as error:
        raise LogError(
            Fault.NOT_FOUND, path, f'cannot be read: {error.strerror or error}'
        ) from None
    if len(content) > MAX_SUMS_BYTES or not content.endswith(b'\n'):
        raise LogError(
            Fault.BAD_SUMS, path, f'must hold whole lines, at most {MAX_SUMS_BYTES} bytes'
        )
    return content


def _is_inside(name: str) -> bool:
    """Return whether a name is that of a file in the folder or below, which sums can list."""
    apart = name in (SUMS_FILE, SIGNATURE_FILE)
    return not apart and not any(part in ('', '.', '..') for part in name.split('/'))
