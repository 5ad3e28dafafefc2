# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What this room adds to scenarios (`rpo_core.files.plugins`)."""

from __future__ import annotations

from rpo_core.chain.stage import Place, Section, register
from rpo_guidance.guidance import GuidanceStage
from rpo_guidance.plan import Guidance
from rpo_guidance.rehearsal import check

register(
    Section(
        'guidance',
        Guidance,
        Place.GUIDANCE,
        GuidanceStage,
        rehearse=check,
        zones=Guidance.zones,
        of_zones=Guidance.of_zones,
    )
)
