# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What a report is asked of: a run, a campaign or a controller."""

from __future__ import annotations

import os
from enum import Enum
from pathlib import Path

from rpo_core.validation import InputError
from rpo_log.format.run import log_files

_CAMPAIGN = 'campaign.yaml'


class Subject(Enum):
    """What can be reported."""

    RUN = 'run'
    CAMPAIGN = 'campaign'
    CONTROLLER = 'controller'


def subject_of(target: str) -> Subject:
    """Return what a folder, a file or a name is; a name or file of any other kind: a controller.

    Raises
    ------
    InputError
        If it is a folder of neither a run nor a campaign.
    """
    if target.endswith('.mcap'):
        return Subject.RUN
    if not os.path.isdir(target):  # unlike Path's, never raises on odd names
        return Subject.CONTROLLER
    folder = Path(target)
    if log_files(folder):
        return Subject.RUN
    if (folder / _CAMPAIGN).is_file():
        return Subject.CAMPAIGN
    raise InputError(
        f'{target}: must be the folder of a run (it holds run.mcap) or of a campaign '
        f'({_CAMPAIGN}); of a training, give its .yaml of the controller'
    )
