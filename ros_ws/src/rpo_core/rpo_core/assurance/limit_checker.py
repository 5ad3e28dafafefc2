# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Persistence of faults: one holds when n of its last m samples show it.

The scheme is that of NASA's cFS Limit Checker: watchpoints with persistence counters.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping

from rpo_core.assurance.abort_table import Row


class LimitChecker:
    """Counts samples; a fault begins to hold once, and again only after a whole window without.

    rows : fault -> row of the table, whose `count` of the last `window` samples must show it
    holding : the faults that hold
    """

    def __init__(self, rows: Mapping[str, Row]) -> None:
        self.rows = rows
        self.clear()

    def sample(self, seen: Mapping[str, bool]) -> list[str]:
        """Take one sample of some faults; return those that begin to hold by it."""
        begins = []
        for fault, shows in seen.items():
            samples = self._samples[fault]
            self._shown[fault] += shows - samples[0]  # the oldest sample drops out
            samples.append(shows)
            if fault in self.holding:
                if not self._shown[fault]:
                    self.holding.discard(fault)
            elif self._shown[fault] >= self.rows[fault].count:
                self.holding.add(fault)
                begins.append(fault)
        return begins

    def clear(self) -> None:
        """Forget all samples: what holds already is found anew."""
        self.holding: set[str] = set()
        self._shown = dict.fromkeys(self.rows, 0)
        self._samples = {
            fault: deque([False] * row.window, maxlen=row.window)
            for fault, row in self.rows.items()
        }
