# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The contract between attitude and translation: docs/safety.md, lemma 6."""

from __future__ import annotations

from dataclasses import replace

import pytest

from rpo_attitude.chaser import Chaser, Wheels
from rpo_core.files import scenario
from rpo_core.files.validation import InputError
from rpo_safety.settings import Assurance

ASSURED = replace(scenario.load_scenario('assured'), max_force_n=1.0)
INERTIA = ((0.6, 0.02, 0.0), (0.02, 0.7, 0.01), (0.0, 0.01, 0.5))
CHASER = Chaser(inertia_kg_m2=INERTIA, wheels=Wheels(torque_nm=0.05, momentum_nms=1.0))


def test_a_force_that_nobody_turns_is_refused():
    own = replace(ASSURED.section(Assurance), chaser_attitude_error_deg=1.0)
    with pytest.raises(InputError, match='needs section `attitude_control`'):
        ASSURED.equipped(CHASER, own)
    with pytest.raises(InputError, match='needs section `attitude`'):
        ASSURED.equipped(own)
