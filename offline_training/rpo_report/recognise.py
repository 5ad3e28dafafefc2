# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What a report is about: a run, a campaign, a proof or a controller."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Literal

from rpo_core.files.validation import InputError
from rpo_log.format.run import log_files

_CAMPAIGN, _PROOF = 'campaign.yaml', 'proof.yaml'

Subject = Literal['run', 'campaign', 'proof', 'controller']


def subject_of(target: str) -> Subject:
    """Return what a folder, a file or a name is: a controller, if nothing else.

    Raises
    ------
    InputError
        If it is a folder of neither a run nor a campaign nor a proof.
    """
    if target.endswith('.mcap'):
        return 'run'
    if not os.path.isdir(target):  # unlike Path's, never raises on odd names
        return 'controller'
    folder = Path(target)
    if log_files(folder):
        return 'run'
    if (folder / _CAMPAIGN).is_file():
        return 'campaign'
    if (folder / _PROOF).is_file():
        return 'proof'
    raise InputError(
        f'{target}: must be the folder of a run (it holds run.mcap), of a campaign '
        f'({_CAMPAIGN}) or of a proof ({_PROOF}); of a training, give the .yaml of its controller'
    )
