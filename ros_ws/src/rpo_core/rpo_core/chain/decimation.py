# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""When an output that is not due at each tick is due, from stamps alone."""

from __future__ import annotations

from dataclasses import dataclass

_NANOSECONDS = 1_000_000_000


@dataclass(frozen=True)
class Decimation:
    """Periods counted from 1970: the first stamp in each is due.

    So the sender, which knows no tick, and the reader of its log agree on what is due.

    rate_hz : periods per second; 0: nothing is ever due
    """

    rate_hz: float

    def period(self, stamp_ns: int) -> int:
        """Return the number of the period that a stamp is in."""
        length_ns = max(1, round(_NANOSECONDS / self.rate_hz)) if self.rate_hz else 0
        return stamp_ns // length_ns if length_ns else 0

    def due(self, stamp_ns: int, before_ns: int | None) -> bool:
        """Return whether a stamp is the first of its period, given the one before it."""
        if not self.rate_hz:
            return False
        return before_ns is None or self.period(stamp_ns) != self.period(before_ns)
