# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Which files of a run folder are those that SHA256SUMS lists."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from rpo_log.errors import LogError
from rpo_log.format import sums
from rpo_log.format.run import SUMS_FILE
from rpo_log.format.sums import Contents, Sums
from rpo_log.read.records import FileRecords

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
        listed, there = sums.read_sums(folder), Contents.of(folder)
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
    return sums.digest_of(folder / name, MAX_BESIDE_BYTES)


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
