# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""CMA-ES in stages: each descends from the best so far, with drawn flights of its own.

At the beginning of a stage its flights are drawn, hard ones for the best so far, which is judged by
them anew. At the end, draws that are held out decide among the best of all stages
(`rpo_judge.scoring.drawn`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rpo_core.files.validation import real, whole
from rpo_judge.scoring.drawn import HELD_OUT
from rpo_training.algorithms import Best, CmaSearch, CmaSettings, Script, ScriptedSearch, Stage

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class StagedSettings:
    """Options of the stages.

    stages : the first with the settings of CMA-ES
    sigma, evaluations : of each later one
    """

    stages: int = 3
    sigma: float = 0.01
    evaluations: int = 1500

    def __post_init__(self) -> None:
        whole('staged.stages', self.stages, least=1, most=1000)
        real('staged.sigma', self.sigma, above=0.0, most=1.0)
        whole('staged.evaluations', self.evaluations, least=1)


class StagedSearch(ScriptedSearch):
    """CMA-ES in stages.

    best : of the present stage; stage : what is drawn
    """

    def __init__(
        self, settings: StagedSettings, descent: CmaSettings, seed: int, start: Floats
    ) -> None:
        self.settings, self.descent, self.seed = settings, descent, seed
        self._finalists: list[Floats] = []
        self._begin(start, f'{settings.stages} stages')

    @property
    def left(self) -> int:
        """Generations left, at most."""
        own, size = self.settings, self.descent.population
        most = self.descent.evaluations + (own.stages - 1) * own.evaluations
        return max(0, -(-(most - self.evaluations) // size))

    def _run(self) -> Script:
        """Yield chromosomes; each yield returns their fitness."""
        own = self.settings
        later = replace(self.descent, sigma=own.sigma, evaluations=own.evaluations)
        for number in range(1, own.stages + 1):
            self.stage, self.phase = Stage(number, self.best.genes), f'stage {number}'
            self.best = Best(self.best.genes)
            yield self.best.genes[None]
            descent = self.descent if number == 1 else later
            search = CmaSearch(descent, self.seed, self.best.genes, number)
            while not search.stopped:
                values = yield search.ask()
                search.tell(values)
            self._finalists.append(np.array(self.best.genes))
        self.stage, self.phase = Stage(HELD_OUT, self.best.genes), 'held-out flights'
        self.best = Best(self.best.genes)
        yield np.unique(self._finalists, axis=0)
