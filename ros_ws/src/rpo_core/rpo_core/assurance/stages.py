# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What this folder adds to scenarios and to the table of interfaces (`rpo_core.plugins`)."""

from __future__ import annotations

from rpo_core.assurance.assurance import (
    ASSURANCE_STATUS,
    ASSURED_FORCE,
    AssuranceStage,
    check_start,
)
from rpo_core.assurance.settings import Assurance
from rpo_core.assurance.shaping import SHAPED_FORCE, Shaping, ShapingStage, check
from rpo_core.stage import Place, Section, register
from rpo_core.wire import interfaces
from rpo_core.wire.interfaces import Interface

interfaces.add(
    Interface(
        SHAPED_FORCE,
        interfaces.FORCE_TYPE,
        'command after shaping, target LVLH, stamp of the state it answers',
        interfaces.COMMAND,
    ),
    before=interfaces.DISTURBANCE_FORCE,
)
interfaces.add(
    Interface(
        ASSURED_FORCE,
        interfaces.FORCE_TYPE,
        'command after runtime assurance, target LVLH, stamp of the state it answers',
        interfaces.COMMAND,
    ),
    before=interfaces.DISTURBANCE_FORCE,
)
interfaces.add(
    Interface(
        ASSURANCE_STATUS,
        interfaces.STATUS_TYPE,
        'each intervention of runtime assurance: constraint, margins, force before and after',
        due=interfaces.EVENT,
        qos=interfaces.Qos(durability='transient_local'),
        beside=ASSURED_FORCE,
    ),
    before=interfaces.RUN_STATUS,
)
register(Section('shaping', Shaping, Place.SHAPING, ShapingStage, check))
register(
    Section(
        'assurance',
        Assurance,
        Place.ASSURANCE,
        AssuranceStage,
        check_start,
        zones=Assurance.zones,
        of_zones=Assurance.of_zones,
    )
)
