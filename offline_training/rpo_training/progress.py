# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The progress of a training run, as it is shown."""

from __future__ import annotations

import math

from rpo_montecarlo.display import Display
from rpo_training.run import Progress


class TrainingDisplay(Display):
    """Shows a training run while it is entered."""

    def show(self, progress: Progress) -> None:
        """Show the state of the run, and the longest time that the present phase can still take."""
        missed = ' '.join(f'{c} {n}' for c, n in progress.failures.items())
        left_s, rate = math.inf, ''
        if progress.evaluated:
            each_s = progress.seconds / progress.evaluated
            left_s = each_s * progress.left * progress.evaluations / (progress.generation + 1)
            rate = f'  {1.0 / max(each_s, 1e-9):.0f} controllers/s'
        self.draw(
            progress.phase,
            progress.generation,
            progress.generation + progress.left,
            left_s,
            f'best {progress.best:.4f} (J {progress.energy:.4f}; misses {missed}) '
            f'mean {progress.mean:.1f} ± {progress.spread:.1f}{rate}',
        )
