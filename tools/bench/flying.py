# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""P2, P3, P6: the paper's budget, 10 000 dispersed runs, environments for learning."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from rpo_core.files.scenario import load_set
from rpo_montecarlo.campaign import config, run_batch, single
from rpo_montecarlo.campaign.execution import fly
from rpo_montecarlo.campaign.store import Store
from rpo_montecarlo.engine.cases import case_of_set
from rpo_montecarlo.engine.simulator import Simulator
from rpo_training.genes import GeneSpace

PAPER_BUDGET = 60 * 301
"""Evaluations of the paper's genetic algorithm: 60 controllers in the first and 300 generations."""

CAMPAIGN = Path(__file__).parents[2] / 'offline_training' / 'campaigns' / 'paper_test.yaml'
CAMPAIGN_RUNS = 10_000


class Stepped(NamedTuple):
    """Ticks per CPU second of the vectorised environment, of the single one, and of a peer.

    peer : the simulator of safe-autonomy-simulation; None: it is not installed
    """

    together: float
    alone: float
    peer: float | None


def environments(runs: int = 4000, steps: int = 100) -> Stepped:
    """Step environments of the paper's test by a spring and a damper, so many runs side by side."""
    from rpo_training.gym import FinalApproach
    from rpo_training.gym_vector import DispersedApproach

    def per_s(env: Any, count: int, steps: int) -> float:
        """Return ticks per CPU second, the best of three; the first steps compile."""
        best = 0.0
        for _ in range(3):
            seen, _ = env.reset(seed=1)
            seen, *_ = env.step(np.zeros(env.action_space.shape))
            began = time.process_time()
            for _ in range(steps):
                seen, *_ = env.step(-2.0 * seen[..., :3] - 6.0 * seen[..., 3:6])
            best = max(best, steps * count / (time.process_time() - began))
        return best

    alone = per_s(FinalApproach('paper_test'), 1, 10 * steps)
    return Stepped(per_s(DispersedApproach(runs), runs, steps), alone, _peer_steps(10 * steps))


def _peer_steps(steps: int) -> float | None:
    """Step the peer's Clohessy-Wiltshire spacecraft by the same law."""
    if find_spec('safe_autonomy_simulation') is None:
        return None
    from safe_autonomy_simulation import Simulator
    from safe_autonomy_simulation.sims.spacecraft.point_model import CWHSpacecraft

    chaser = CWHSpacecraft('chaser', np.array([10.0, 60.0, -40.0]), np.zeros(3), m=10, n=1.157e-3)
    simulator = Simulator(frame_rate=10.0, entities=[chaser])
    simulator.reset()
    began = time.process_time()
    for _ in range(steps):
        chaser.add_control(np.clip(-0.01 * chaser.state[:3] - 0.3 * chaser.state[3:6], -0.5, 0.5))
        simulator.step()
    return steps / (time.process_time() - began)


class Budget(NamedTuple):
    """Wall and CPU time [s] of a training budget, and its sizes."""

    evaluations: int
    wall_s: float
    cpu_s: float
    steps: int


def training(
    evaluations: int = PAPER_BUDGET,
    workers: int = 0,
    progress: Callable[[float], None] = lambda share: None,
    seed: int = 1,
) -> Budget:
    """Simulate the training budget of the paper: free rule tables, 216 starts, 2000 steps each.

    progress : gets the share that is done
    """
    case = case_of_set(load_set('paper_training'))
    space = GeneSpace('free')
    rng = np.random.default_rng(seed)
    with Simulator([case], workers) as simulator:
        simulator.fly(space.decode(rng.random((2, space.size))))  # compiles
        began, cpu = time.perf_counter(), time.process_time()
        for first in range(0, evaluations, 60):
            count = min(60, evaluations - first)
            simulator.fly(space.decode(rng.random((count, space.size))))
            progress((first + count) / evaluations)
        wall, cpu = time.perf_counter() - began, time.process_time() - cpu
        return Budget(evaluations, wall, cpu, case.windows.horizon)


class Dispersed(NamedTuple):
    """Wall and CPU time [s] of a campaign; and CPU time [s] of a single run in the core."""

    runs: int
    ticks: int
    wall_s: float
    cpu_s: float
    core_s_per_run: float


def campaign(
    runs: int = CAMPAIGN_RUNS,
    workers: int = 0,
    progress: Callable[[float], None] = lambda share: None,
) -> Dispersed:
    """Run the shipped campaign, every dispersion on; then a few of its runs one by one.

    progress : gets the share that is done
    """
    chosen = config.load(CAMPAIGN, runs=runs)
    run_batch.fly_runs(chosen, 0, 1)  # compiles
    single.fly_run(chosen, 0)
    done = 0

    def add(count: int, _successful: int) -> None:
        nonlocal done
        done += count
        progress(done / runs)

    with tempfile.TemporaryDirectory() as folder:
        store = Store.create(Path(folder) / 'campaign', chosen)
        began, cpu = time.perf_counter(), time.process_time()
        fly(store, workers, progress=add)
        wall, cpu = time.perf_counter() - began, time.process_time() - cpu
    few, began = 10, time.process_time()
    for number in range(few):
        single.fly_run(chosen, number)
    each = (time.process_time() - began) / few
    return Dispersed(runs, chosen.scenario.ticks, wall, cpu, each)
