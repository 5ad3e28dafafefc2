# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""SHA256SUMS: the digest of every file of a run folder, in the form of `sha256sum --check`."""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from rpo_core.files import open_regular
from rpo_core.files.validation import shown
from rpo_mcap.errors import LogError, cannot_read, cannot_write, read_at_most
from rpo_mcap.format.run import SIGNATURE_FILE, SUMS_FILE, write_whole
from rpo_mcap.read.records import FileRecords

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
        raise cannot_read(path, error) from None
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
    content = read_at_most(path, MAX_SUMS_BYTES + 1)
    if len(content) > MAX_SUMS_BYTES or not content.endswith(b'\n'):
        raise LogError(path, f'must hold whole lines, at most {MAX_SUMS_BYTES} bytes')
    return content


def _is_inside(name: str) -> bool:
    """Return whether a name is that of a file in the folder or below, which sums can list."""
    apart = name in (SUMS_FILE, SIGNATURE_FILE)
    return not apart and not any(part in ('', '.', '..') for part in name.split('/'))


MAX_BESIDE_BYTES = 1 << 28
"""A longer file beside a log is not hashed: ours have at most some megabytes."""

_LOG = re.compile(r'run(_[0-9]+)?\.mcap')


@dataclass(frozen=True)
class Digests:
    """What SHA256SUMS says of a run folder.

    sums : SHA256SUMS
    matched : files that it lists and that have the digest
    faults : what is not as listed, for people
    unlisted : files that it does not list
    others : what it cannot list, by name, and what that is
    """

    sums: Sums
    matched: Mapping[str, str]
    faults: tuple[str, ...]
    unlisted: tuple[str, ...]
    others: Mapping[str, str]

    @classmethod
    def of(cls, folder: Path, read: Mapping[str, str] | None = None) -> Digests:
        """Compare the files of a folder with SHA256SUMS, if there is one; raises LogError.

        read : per file that was read before, SHA-256 of the bytes that came; empty if the file was
            too long to be hashed. The others are read here.
        """
        listed, there = read_sums(folder), Contents.of(folder)
        found = {name: _digest(folder, name, read or {}) for name in there.files
                 if name in listed.digests}  # fmt: skip
        matched = {name: digest for name, digest in found.items() if digest == listed.digests[name]}
        unlisted = tuple(name for name in there.files if name not in listed.digests)
        faults = _faults(listed.digests, found, there.others)
        return cls(listed, matched, tuple(faults), unlisted, there.others)


def _digest(folder: Path, name: str, read: Mapping[str, str]) -> str:
    """Return the SHA-256 of a file; empty if it is too long: beside a log, or behind its end."""
    if name in read:
        return read[name]
    if _LOG.fullmatch(name):
        records = FileRecords(folder / name, tolerant=True)
        try:
            for _ in records:
                pass
            return '' if records.unread else records.sha256.hexdigest()
        except LogError:  # no MCAP file: it is as any other
            pass
    return digest_of(folder / name, MAX_BESIDE_BYTES)


def _faults(
    listed: Mapping[str, str], found: Mapping[str, str], others: Mapping[str, str]
) -> Iterator[str]:
    """Yield what is not as listed."""
    for name, digest in listed.items():
        if name in others:
            yield f'{name}, which {SUMS_FILE} lists, {others[name]}'
        elif name not in found:
            yield f'{name} is missing, which {SUMS_FILE} lists'
        elif not found[name]:
            yield f'{name} is too long to be compared with {SUMS_FILE}'
        elif found[name] != digest:
            yield f'{name} is not the file that {SUMS_FILE} lists'
