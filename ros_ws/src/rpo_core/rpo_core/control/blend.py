# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A force as a blend of rules: the share of each in it, in words.

The output of a Mamdani system (min, max, centroid) is no sum over its rules. But each sample y of
the output set belongs to the word whose clipped membership is the greatest there, in equal parts to
words that tie. So each word has a part of the set, with an area and a centroid of its own. The
share of a word is its part of the area: shares add up to 1, and the output is the sum of share
times centroid. The part of a word is decided by its strongest rule alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from rpo_core.control.inference import FisTables, Five

LEAST_SHARE = 0.05
"""A sentence sums up what contributes less."""


class Part(NamedTuple):
    """What a word contributes to the output.

    share : of the area of the output set, in [0, 1]
    centroid : of its part of the set, in [-1, 1]; 0 where it has none
    """

    share: float
    centroid: float


def parts(strengths: Five, fis: FisTables) -> tuple[Part, ...]:
    """Return the parts of the five words, LN..LP, for their strengths; shares of 0 if all is 0."""
    half = np.asarray(fis.samples)
    z, sp, lp = (np.asarray(grades) for grades in (fis.z, fis.sp, fis.lp))
    none = np.zeros(len(half) + 1)
    mirrored = [np.concatenate([grades[::-1], none]) for grades in (lp, sp)]
    grades = np.array(
        [
            *mirrored,
            np.concatenate([z[::-1], [1.0], z]),
            *(side[::-1] for side in reversed(mirrored)),
        ]
    )
    clipped = np.minimum(np.array(strengths)[:, None], grades)
    height = clipped.max(axis=0)
    greatest = clipped == height
    owned = np.where(greatest, height / greatest.sum(axis=0), 0.0)
    middle = len(half)
    mirrored_pairs = owned[:, middle + 1 :] - owned[:, :middle][:, ::-1]
    areas, moments = owned.sum(axis=1), (mirrored_pairs * half).sum(axis=1)
    total = areas.sum()
    return tuple(
        Part(float(area / total), float(moment / area)) if area > 0.0 else Part(0.0, 0.0)
        for area, moment in zip(areas, moments, strict=True)
    )


class Cause(NamedTuple):
    """A part of a force.

    share : in [0, 1]; those of all causes add up to 1
    what : it commands, in words; why : the rule that commands it, in words
    """

    share: float
    what: str
    why: str


class Reasons(NamedTuple):
    """A force in words, and what makes it; without causes the words say it all.

    numbers : of the decision, with their names
    """

    force: str
    causes: Sequence[Cause] = ()
    numbers: Sequence[tuple[str, float]] = ()

    @property
    def sentence(self) -> str:
        """The force, and for each cause its share, what it commands, and why.

        The greatest cause is first; those below `LEAST_SHARE` are summed up.
        """
        ordered = sorted(self.causes, key=lambda cause: -cause.share)
        said = [cause for cause in ordered if cause.share >= LEAST_SHARE]
        texts = [f'{100.0 * c.share:.0f} % from {c.what}, because {c.why}' for c in said]
        rest = sum(cause.share for cause in ordered[len(said) :])
        if rest >= 0.005:
            texts.append(f'{100.0 * rest:.0f} % others')
        return f'{self.force}: {"; ".join(texts)}' if texts else self.force


def newtons(force_n: float) -> str:
    """Return a force with its sign, in words; zero has none."""
    return f'{force_n:+.3g} N' if force_n else '0 N'
