# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Signing a run folder after it was recorded."""

from __future__ import annotations

from pathlib import Path

from rpo_log import signature
from rpo_log.errors import Fault, LogError
from rpo_log.format import sums
from rpo_log.format.run import SIGNATURE_FILE, SUMS_FILE
from rpo_log.read.stream import files_of
from rpo_log.verify.evidence import Digests


def sign_run(folder: Path, key: Path) -> str:
    """Sign the files of a run folder; return one line for people.

    Files that came after the recording, as a report, are added to SHA256SUMS first.

    Raises InputError if the key cannot sign, LogError if a file differs from its digest.
    """
    signer = signature.private_key(key)
    files_of(folder)  # refuses what is no run
    if not folder.is_dir():
        raise LogError(Fault.NOT_FOUND, folder, 'must be the folder of a run')
    digests = Digests.of(folder)
    if faults := digests.faults():
        raise LogError(Fault.BAD_SUMS, folder, f'cannot be signed: {"; ".join(faults)}')
    if digests.unlisted:
        sums.write_sums(folder, sums.read_sums(folder))
    signature.sign(folder, signer)
    number = len(digests.matched) + len(digests.unlisted)
    return f'{folder / SIGNATURE_FILE}: signs {number} files of {SUMS_FILE}'
