# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Events of a run: stages switched off, signals that are no longer expected."""

from __future__ import annotations

from rpo_core.wire import cdr, interfaces, statuses

ACTIVE, INACTIVE = 'active', 'inactive'
"""Values `state` of a stage_status: from its `tick` on, the stage is switched on or off."""


def dropped(status: cdr.Status) -> dict[str, int]:
    """Return the signals that the plant goes on without, by a run_status, and from which tick."""
    values = dict(status.values)
    tick = tick_of(status)
    if tick is None:
        return {}
    rows = [interfaces.find(name) for name in values.get('dropped', '').split()]
    return {row.name: tick for row in rows if row is not None}


def tick_of(status: cdr.Status) -> int | None:
    """Return the first tick that an event holds for; None if it has none."""
    return statuses.tick_of(dict(status.values))
