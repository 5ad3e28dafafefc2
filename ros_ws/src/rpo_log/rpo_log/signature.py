# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Ed25519 signatures over SHA256SUMS, as OpenSSL makes and checks them.

A signature says that who holds the key had these files: nobody has changed them since. It does not
say that they are true.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rpo_core.files import open_regular
from rpo_core.files.validation import InputError, printable
from rpo_mcap.errors import LogError, NotARun, cannot_write
from rpo_mcap.format.run import SIGNATURE_FILE, SUMS_FILE, write_whole
from rpo_mcap.format.sums import Digests, Sums, write_sums
from rpo_mcap.read.stream import files_of

if TYPE_CHECKING:
    from cryptography.hazmat.primitives.asymmetric.ed25519 import (
        Ed25519PrivateKey,
        Ed25519PublicKey,
    )

MAX_KEY_BYTES = 1 << 14


def make_key(path: Path) -> Path:
    """Write a new private key to `path` and its public key beside it; return the public one.

    The public key ends in `.pub.pem`. Raises InputError if either is there already.
    """
    _, serialization, ed25519 = _library()
    key = ed25519.Ed25519PrivateKey.generate()
    private = key.private_bytes(
        serialization.Encoding.PEM,
        serialization.PrivateFormat.PKCS8,
        serialization.NoEncryption(),
    )
    public = key.public_key().public_bytes(
        serialization.Encoding.PEM, serialization.PublicFormat.SubjectPublicKeyInfo
    )
    target = path.with_name(f'{path.stem}.pub.pem')
    for place, data, mode in ((path, private, 0o600), (target, public, 0o644)):
        try:
            with open(os.open(place, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode), 'wb') as stream:
                stream.write(data)
        except OSError as error:
            raise InputError(f'{place}: {error.strerror or error}') from None
    return target


def private_key(path: Path) -> Ed25519PrivateKey:
    """Return the private key of a PEM file; raises InputError."""
    exceptions, serialization, ed25519 = _library()
    try:
        key = serialization.load_pem_private_key(_read(path), password=None)
    except (ValueError, TypeError, exceptions.UnsupportedAlgorithm):
        key = None
    if not isinstance(key, ed25519.Ed25519PrivateKey):
        raise InputError(
            f'{path}: must be an Ed25519 private key in PEM without a password, as `rpo keygen` '
            'or `openssl genpkey -algorithm ed25519` writes it'
        )
    return key


def sign(folder: Path, sums: Sums, key: Ed25519PrivateKey) -> None:
    """Sign the sums of a run folder: write SHA256SUMS.sig; raises LogError."""
    if sums.content is None:
        raise NotARun(folder, f'holds no {SUMS_FILE} to sign')
    path = folder / SIGNATURE_FILE
    try:
        write_whole(path, key.sign(sums.content))
    except OSError as error:
        raise cannot_write(path, error) from None


def signer(folder: Path, sums: Sums, trusted: Path) -> str | None:
    """Return the file name of the trusted key that signed the sums; None if none did.

    folder : that holds the signature
    trusted : a public key in PEM, or a folder of them (`*.pem`); raises InputError
    """
    exceptions = _library()[0]
    keys = list(_public_keys(trusted))
    path = folder / SIGNATURE_FILE
    if sums.content is None or not os.path.lexists(path):
        return None
    signature = _read(path)
    for name, key in keys:
        try:
            key.verify(signature, sums.content)
        except exceptions.InvalidSignature:
            continue
        return name
    return None


def _public_keys(trusted: Path) -> Iterator[tuple[str, Ed25519PublicKey]]:
    exceptions, serialization, ed25519 = _library()
    paths = sorted(trusted.glob('*.pem')) if trusted.is_dir() else [trusted]
    if not paths:
        raise InputError(f'{trusted}: must hold public keys, *.pem; it holds none')
    for path in paths:
        try:
            key = serialization.load_pem_public_key(_read(path))
        except (ValueError, exceptions.UnsupportedAlgorithm):
            key = None
        if not isinstance(key, ed25519.Ed25519PublicKey):
            raise InputError(f'{path}: must be an Ed25519 public key in PEM')
        yield path.name, key


def _read(path: Path) -> bytes:
    try:
        with open_regular(path) as stream:
            return stream.read(MAX_KEY_BYTES)
    except OSError as error:
        raise InputError(f'{path}: {error.strerror or error}') from None


def _library() -> tuple[Any, Any, Any]:
    """Return the modules of cryptography that signatures need; raises InputError."""
    try:
        from cryptography import exceptions
        from cryptography.hazmat.primitives import serialization
        from cryptography.hazmat.primitives.asymmetric import ed25519
    except ImportError:
        raise InputError(
            'signatures need the Python package `cryptography` (rosdep: python3-cryptography; '
            'pip: cryptography)'
        ) from None
    return exceptions, serialization, ed25519


def sign_run(folder: Path, key: Path) -> str:
    """Sign the files of a run folder; return one line for people, which names them.

    Files that came after the recording, as a report, are added to SHA256SUMS first.

    Raises InputError if the key cannot sign, LogError if a file differs from its digest, or if the
    folder holds what SHA256SUMS cannot list: that would not be signed.
    """
    private = private_key(key)
    files_of(folder)  # refuses what is no run
    if not folder.is_dir():
        raise NotARun(folder, 'must be the folder of a run')
    digests = Digests.of(folder)
    faults = [*digests.faults, *(f'{name} {what}' for name, what in digests.others.items())]
    if faults:
        raise LogError(folder, f'cannot be signed: {"; ".join(faults)}')
    listed = digests.sums
    if digests.unlisted:
        listed = write_sums(folder, digests.matched)
    sign(folder, listed, private)
    names = ', '.join(listed.digests)
    return f'{folder / SIGNATURE_FILE}: signs {len(listed.digests)} files: {printable(names)}'
