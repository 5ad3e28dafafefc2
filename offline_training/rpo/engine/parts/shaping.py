# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Command shaping side by side: the kernel of `rpo_core.assurance`."""

from __future__ import annotations

import numpy as np

from rpo.engine.lanes import FORCE, PAIRED_LANES, compiled
from rpo.engine.tick import Batch, Kind, Part, register, table_of
from rpo_core.assurance.shaping import Shaping, ShapingStage, shaped
from rpo_core.stage import Place


@compiled
def shape(w, m, t, tick):  # type: ignore[no-untyped-def]
    """Replace row FORCE by the shaped command, which the memory keeps."""
    for s in range(PAIRED_LANES):
        m[s] = w[FORCE + s] = shaped(w[FORCE + s], m[s], tick == 0, t[0], t[1], t[2])


def _part(batch: Batch) -> Part | None:
    settings = batch.base.section(Shaping)
    if settings is None:
        return None
    table = table_of(ShapingStage(settings, batch.base).numbers)
    return Part('shaping', ((Place.SHAPING, shape),), table, np.zeros(PAIRED_LANES))


register(Kind('shaping', _part))
