# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Persistence of faults: one holds when n of its last m samples show it.

The scheme is that of NASA's cFS Limit Checker: watchpoints with persistence counters.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Rule:
    """A fault holds when `count` of the last `window` samples show it."""

    count: int
    window: int


class LimitChecker:
    """Counts samples; a fault begins to hold once, and again only after a whole window without.

    holding : the faults that hold
    """

    def __init__(self, rules: Mapping[str, Rule]) -> None:
        self.rules = rules
        self.holding: set[str] = set()
        self._samples = {
            fault: deque([False] * rule.window, maxlen=rule.window) for fault, rule in rules.items()
        }
        self._shown = dict.fromkeys(rules, 0)

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
            elif self._shown[fault] >= self.rules[fault].count:
                self.holding.add(fault)
                begins.append(fault)
        return begins

    def clear(self, faults: Iterable[str]) -> None:
        """Forget the samples of some faults: their cause is over by design."""
        for fault in faults:
            self._samples[fault].extend([False] * self.rules[fault].window)
            self._shown[fault] = 0
            self.holding.discard(fault)
