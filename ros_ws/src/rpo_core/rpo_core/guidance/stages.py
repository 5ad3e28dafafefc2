# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What this folder adds to scenarios (`rpo_core.plugins`)."""

from __future__ import annotations

from rpo_core.guidance.guidance import GuidanceStage
from rpo_core.guidance.plan import Guidance
from rpo_core.guidance.rehearsal import check
from rpo_core.stage import Place, Section, register

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
