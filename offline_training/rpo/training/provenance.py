# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What the training of a controller saw of a campaign, by the command in its file.

The command names a preset or a family, whose configuration says what is flown. A controller that
was trained from another one saw what that one saw.
"""

from __future__ import annotations

import shlex
from itertools import pairwise
from pathlib import Path

from rpo.scoring.fitness import FitnessSettings
from rpo.training.config import PRESETS, load_start
from rpo.training.family_training import FamilyConfig
from rpo.training.tuning import TUNING_SPACES
from rpo_core.control.controller import AnyController
from rpo_core.files.validation import InputError
from rpo_core.judge.similarity import PAPER

NOTHING, NOT_KNOWN = 'no', 'not known'
DRAWN, CORNERS = 'drawn flights', 'corner flights'

_TEST = 'paper_test'
"""The campaign whose corners `search.corners` flies, and its scenario."""


def saw(controller: AnyController, campaign: str) -> str:
    """Return what the training of a controller saw of a campaign (name)."""
    provenance = controller.provenance
    drawn = provenance.get('drawn_flights_judged_by')
    if isinstance(drawn, dict) and campaign in drawn:
        return DRAWN
    if provenance.get('method') == 'by hand':
        return NOTHING
    try:
        return _of_command(shlex.split(str(provenance.get('command', ''))), campaign)
    except (ValueError, InputError):
        return NOT_KNOWN  # the file's own text is no command of this version


def _of_command(words: list[str], campaign: str) -> str:
    options = dict(pairwise(words))
    if words[:2] != ['rpo', 'train']:
        return NOT_KNOWN
    scenario = options.get('--scenario', '')
    if any(word in TUNING_SPACES for word in words[2:3]):
        return NOTHING
    if '--family' in options:
        config = FamilyConfig.of(options['--family'], scenario=scenario or PAPER)
        return _of_settings(config.fitness, campaign)
    if options.get('--preset') not in PRESETS:
        return NOT_KNOWN
    preset = PRESETS[options['--preset']]
    found = NOTHING if scenario else _of_settings(preset.fitness, campaign)
    return found if found != NOTHING else _of_starts(preset.start, campaign)


def _of_settings(settings: FitnessSettings, campaign: str) -> str:
    drawn = settings.drawn
    if drawn.weight and campaign in (Path(name).stem for name in drawn.campaigns):
        return DRAWN
    return CORNERS if campaign == _TEST and settings.robustness else NOTHING


def _of_starts(starts: tuple[str, ...], campaign: str) -> str:
    """Return what the controllers that a search begins from saw."""
    for name in starts:
        seen = saw(load_start(name), campaign)
        if seen != NOTHING:
            return f'{seen}, by its start {name}'
    return NOTHING
