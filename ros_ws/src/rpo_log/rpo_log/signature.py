# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""SHA256SUMS of a run folder, as `sha256sum --check` reads it, and its Ed25519 signature.

A signature says who had these files, not that they are true; OpenSSL makes and checks the same.
"""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

from rpo_core.files import open_regular
from rpo_core.files.validation import InputError, printable, shown
from rpo_log.errors import LogError, cannot_read, cannot_write, read_at_most
from rpo_log.format.run import SIGNATURE_FILE, SUMS_FILE, write_whole
from rpo_log.read.stream import files_of

MAX_SUMS_BYTES = _BLOCK = 1 << 20
MAX_FILE_BYTES = 1 << 34
"""A longer file is not hashed: it may be sparse, and have terabytes."""

_LINE = re.compile(r'([0-9a-f]{64})  ([^\\\n\r]+)')


def contents(folder: Path) -> tuple[list[str], dict[str, str]]:
    """Return the files in a folder and below, and why others cannot be listed; raises LogError."""

    def refuse(error: OSError) -> None:
        raise cannot_read(Path(error.filename), error)

    files, others = list[str](), dict[str, str]()
    for place, below, names in os.walk(folder, onerror=refuse):
        for path in map(Path(place).joinpath, (*below, *names)):
            listed = path.relative_to(folder).as_posix()
            if path.is_symlink():
                others[listed] = 'is a link'
            elif path.is_dir():
                continue
            elif not path.is_file():
                others[listed] = 'is no regular file'
            elif not _LINE.fullmatch(f'{"0" * 64}  {listed}'):
                others[listed] = 'has a name with \\ or a line break'
            elif listed not in (SUMS_FILE, SIGNATURE_FILE):
                files.append(listed)
    return sorted(files), others


def digest_of(path: Path) -> str:
    """Return the SHA-256 of a file, empty if it is too long; raises LogError."""
    try:
        with open_regular(path) as stream:
            if os.fstat(stream.fileno()).st_size > MAX_FILE_BYTES:
                return ''
            digest = hashlib.sha256()
            while block := stream.read(_BLOCK):
                digest.update(block)
    except OSError as error:
        raise cannot_read(path, error) from None
    return digest.hexdigest()


def write_sums(folder: Path, known: Mapping[str, str] = {}, without: str = '') -> bytes:
    """Write SHA256SUMS, remove the signature of older ones; return its bytes. Raises LogError.

    known : digests that are not computed again; without : folder that is not listed
    """
    names = [name for name in contents(folder)[0] if name.partition('/')[0] != without]
    digests = [known.get(name) or digest_of(folder / name) for name in names]
    content = ''.join(map('{}  {}\n'.format, digests, names)).encode('utf-8', 'surrogateescape')
    if len(content) > MAX_SUMS_BYTES or not all(digests):
        raise LogError(folder, f'has too many or too long files for {SUMS_FILE}')
    try:
        (folder / SIGNATURE_FILE).unlink(missing_ok=True)
        write_whole(folder / SUMS_FILE, content)
    except OSError as error:
        raise cannot_write(folder / SUMS_FILE, error) from None
    return content


def read_sums(folder: Path) -> tuple[bytes, dict[str, str]]:
    """Return SHA256SUMS and what it lists, empty if there is none; raises LogError."""
    path, digests = folder / SUMS_FILE, dict[str, str]()
    if not os.path.lexists(path):
        return b'', digests
    content = read_at_most(path, MAX_SUMS_BYTES + 1)
    if len(content) > MAX_SUMS_BYTES or not content.endswith(b'\n'):
        raise LogError(path, f'must hold whole lines, at most {MAX_SUMS_BYTES} bytes')
    for number, line in enumerate(content.decode('utf-8', 'surrogateescape').split('\n')[:-1], 1):
        match = _LINE.fullmatch(line)
        name = match[2] if match else ''
        elsewhere = {'', '.', '..'} & {*name.split('/')} or name in (SUMS_FILE, SIGNATURE_FILE)
        if match is None or elsewhere or name in digests:
            what = 'a SHA-256, two spaces and the name of another file of the folder'
            raise LogError(path, f'line {number} must be {what}; got {shown(line)}')
        digests[name] = match[1]
    return content, digests


class Digests(NamedTuple):
    """A run folder beside its SHA256SUMS.

    content : of SHA256SUMS; empty: there is none
    listed, unlisted : files that it names, and those that it does not
    matched : digests of files that are as listed; faults : what is not
    others : what it cannot list, and why
    """

    content: bytes
    listed: tuple[str, ...]
    matched: Mapping[str, str]
    faults: tuple[str, ...]
    unlisted: tuple[str, ...]
    others: Mapping[str, str]

    @classmethod
    def of(cls, folder: Path, read: Mapping[str, str] = {}) -> Digests:
        """Compare the files with SHA256SUMS, if there is one; raises LogError.

        read : SHA-256 of what came of files that were read; empty if one was too long
        """
        (content, listed), (files, others) = read_sums(folder), contents(folder)
        matched, faults = {}, []
        for name, wanted in listed.items():
            if name in others:
                faults.append(f'{name}, which {SUMS_FILE} lists, {others[name]}')
            elif name not in files:
                faults.append(f'{name} is missing, which {SUMS_FILE} lists')
            elif not (digest := read[name] if name in read else digest_of(folder / name)):
                faults.append(f'{name} is too long to be compared with {SUMS_FILE}')
            elif digest != wanted:
                faults.append(f'{name} is not the file that {SUMS_FILE} lists')
            else:
                matched[name] = digest
        unlisted = tuple(name for name in files if name not in listed)
        return cls(content, tuple(listed), matched, tuple(faults), unlisted, others)


def load_key(path: Path, part: str = 'private') -> Any:
    """Return the private or the public Ed25519 key of a PEM file; raises InputError."""
    from cryptography.exceptions import UnsupportedAlgorithm
    from cryptography.hazmat.primitives import serialization
    from cryptography.hazmat.primitives.asymmetric import ed25519

    load, content = getattr(serialization, f'load_pem_{part}_key'), read_at_most(path, _BLOCK)
    try:
        key = load(content, *([None] if part == 'private' else []))
    except (ValueError, TypeError, UnsupportedAlgorithm):
        key = None
    if not isinstance(key, getattr(ed25519, f'Ed25519{part.title()}Key')):
        raise InputError(f'{path}: must be an Ed25519 {part} key in PEM, without a password')
    return key


def sign(folder: Path, sums: bytes, key: Any) -> None:
    """Write SHA256SUMS.sig of the content of SHA256SUMS; raises LogError."""
    try:
        write_whole(folder / SIGNATURE_FILE, key.sign(sums))
    except OSError as error:
        raise cannot_write(folder / SIGNATURE_FILE, error) from None


def signer(folder: Path, sums: bytes, trusted: Path) -> str | None:
    """Return the name of the key, in a file or folder of `*.pem`, that signed the sums, or None."""
    from cryptography.exceptions import InvalidSignature

    paths = sorted(trusted.glob('*.pem')) if trusted.is_dir() else [trusted]
    if not paths:
        raise InputError(f'{trusted}: must hold public keys, *.pem; it holds none')
    keys = {path.name: load_key(path, 'public') for path in paths}
    if not sums or not os.path.lexists(folder / SIGNATURE_FILE):
        return None
    signature = read_at_most(folder / SIGNATURE_FILE, _BLOCK)
    for name, key in keys.items():
        with suppress(InvalidSignature):
            key.verify(signature, sums)
            return name
    return None


def sign_run(folder: Path, key: Path) -> str:
    """Sign the files of a run folder, later ones too; return one line for people, which names them.

    Raises InputError if the key cannot sign, LogError if a file is not as listed, or cannot be.
    """
    private = load_key(key)
    files_of(folder)  # refuses what is no run
    digests = Digests.of(folder)
    faults = [*digests.faults, *(f'{name} {what}' for name, what in digests.others.items())]
    if faults:
        raise LogError(folder, f'cannot be signed: {"; ".join(faults)}')
    sign(folder, write_sums(folder, digests.matched), private)
    names = sorted((*digests.listed, *digests.unlisted))
    return f'{folder / SIGNATURE_FILE}: signs {len(names)} files: {printable(", ".join(names))}'
