# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The plant of `plant.py` at the pace of the wall clock: one tick a period, if it was answered.

python paced.py SCENARIO.yaml
"""

import time

import numpy as np
from plant import Plant, fly


class Paced(Plant):
    def __init__(self, text):
        super().__init__(text)
        self.command, self.passed_s, self.late = None, [], 0
        self.create_timer(self.s['dt_s'], self.pass_tick)

    def on_force(self, command):
        self.command = command

    def pass_tick(self):
        before = self.tick
        if self.command is not None:
            super().on_force(self.command)
        if self.phase == 'running':
            self.late += self.tick == before
            self.passed_s.append(time.monotonic())


plant = fly(Paced)
apart_ms = 1e3 * np.diff(plant.passed_s)
off_ms = np.abs(apart_ms - 1e3 * plant.s['dt_s'])
print(
    f'{plant.tick} ticks, {plant.late} without an answer in time; jitter of a tick '
    f'{np.median(off_ms):.2f} ms median, {np.quantile(off_ms, 0.99):.2f} ms 99 %, '
    f'{off_ms.max():.2f} ms most'
)
