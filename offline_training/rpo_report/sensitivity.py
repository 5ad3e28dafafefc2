# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Which dispersion matters: Spearman's rank correlation of what was drawn with what came out.

A deviation to either side may do the same harm, so that its correlation is near 0; the size of the
deviation then tells. Both are computed. White noise is drawn anew at each tick and has no column.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm, rankdata

Floats = NDArray[np.float64]

FALSE_ALARM = 0.01
"""Chance that a dispersion without any effect exceeds `chance_level`."""


class Influence(NamedTuple):
    """Rank correlations of one drawn column with one outcome, in [-1, 1].

    signed : with the deviation; size : with the size of the deviation from the middle
    """

    column: str
    signed: float
    size: float

    @property
    def strength(self) -> float:
        """The larger of both, without sign."""
        return max(abs(self.signed), abs(self.size))


def influences(drawn: Mapping[str, Floats], outcome: Floats) -> list[Influence]:
    """Return the influence of every column (n,) that varies on an outcome (n,); strongest first.

    Empty if the outcome is the same in all runs.
    """
    ranks = _standard_ranks(outcome)
    if ranks is None:
        return []
    found = []
    for name, values in drawn.items():
        deviation = values - (values.min() + values.max()) / 2.0
        signed, size = _standard_ranks(deviation), _standard_ranks(np.abs(deviation))
        if signed is not None:
            by_size = 0.0 if size is None else float(ranks @ size)
            found.append(Influence(name, float(ranks @ signed), by_size))
    return sorted(found, key=lambda influence: -influence.strength)


def _standard_ranks(values: Floats) -> Floats | None:
    """Return ranks of mean 0 and norm 1; None where all values are equal."""
    ranks = rankdata(values)
    ranks -= ranks.mean()
    size = float(np.linalg.norm(ranks))
    return ranks / size if size > 0.0 else None


def chance_level(runs: int) -> float:
    """Return what |rank correlation| of unrelated columns exceeds in `FALSE_ALARM` of cases.

    By the normal approximation, of variance 1 / (n - 1) (Kendall, *Rank Correlation Methods*).
    """
    return float(norm.isf(FALSE_ALARM / 2.0)) / max(1, runs - 1) ** 0.5
