# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Signing a run folder after it was recorded."""

from __future__ import annotations

from pathlib import Path

from rpo_core.files.validation import printable
from rpo_log import signature
from rpo_log.errors import Fault, LogError
from rpo_log.format import sums
from rpo_log.format.run import SIGNATURE_FILE
from rpo_log.read.stream import files_of
from rpo_log.verify.digests import Digests


def sign_run(folder: Path, key: Path) -> str:
    """Sign the files of a run folder; return one line for people, which names them.

    Files that came after the recording, as a report, are added to SHA256SUMS first.

    Raises InputError if the key cannot sign, LogError if a file differs from its digest, or if the
    folder holds what SHA256SUMS cannot list: that would not be signed.
    """
    signer = signature.private_key(key)
    files_of(folder)  # refuses what is no run
    if not folder.is_dir():
        raise LogError(Fault.NOT_FOUND, folder, 'must be the folder of a run')
    digests = Digests.of(folder)
    faults = [*digests.faults, *(f'{name} {what}' for name, what in digests.others.items())]
    if faults:
        raise LogError(Fault.BAD_SUMS, folder, f'cannot be signed: {"; ".join(faults)}')
    listed = digests.sums
    if digests.unlisted:
        listed = sums.write_sums(folder, digests.matched)
    signature.sign(folder, listed, signer)
    names = ', '.join(listed.digests)
    return f'{folder / SIGNATURE_FILE}: signs {len(listed.digests)} files: {printable(names)}'
