# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Judge a learnt agent beside shipped controllers, by draws that no training saw.

    python offline_training/examples/fly_agent.py --runs 1000

The agent is a small network that flies each axis; `learn_agent.py` made its weights (`agent.npz`).
The task `docking` is under runtime assurance, which guards whoever commands.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import rpo
from rpo.montecarlo import config
from rpo.montecarlo.outputs import markdown_table
from rpo.montecarlo.run_batch import fly_runs
from rpo.training.gym_vector import HELD_OUT

Floats = NDArray[np.float64]

TASKS = ('paper_test', 'paper_test_measured', 'docking')
CONTROLLERS = ('allround', 'time_to_go', 'mpc')
WEIGHTS = Path(__file__).with_name('agent.npz')
HOLD_TICKS = 20
"""Ticks for which the agent holds a force: 2 s."""


def features(seen: Floats) -> Any:
    """Return (3 n, 3): position, velocity, time of each axis, from observations (n, 10)."""
    r, v = 100.0 * seen[:, :3], seen[:, 3:6]
    time = np.broadcast_to(seen[:, 9:], r.shape)
    stacked = np.stack([np.arcsinh(r / 0.3), np.arcsinh(v / 0.01), 4.0 * time - 2.0], axis=-1)
    return stacked.reshape(-1, 3).astype(np.float32)


def force_share(outputs: Floats) -> Floats:
    """Return the share of the largest force: fine near zero, where a chaser holds its place."""
    bounded = np.clip(outputs, -1.0, 1.0)
    return bounded * np.abs(bounded)


def act(weights: dict[str, Any], seen: Floats) -> Floats:
    """Return the actions (n, 3) of the agent."""
    x, layers = features(seen), len(weights) // 2
    for i in range(layers):
        x = x @ weights[f'w{i}'].T + weights[f'b{i}']
        x = x if i == layers - 1 else np.tanh(x)
    return force_share(x.reshape(-1, 3).astype(np.float64))


def of_agent(campaign: str, runs: int) -> tuple[Floats, dict[str, Any]]:
    """Return energies (n,) [N²s] of the agent, and limit -> whether it was kept (n,)."""
    env = rpo.DispersedApproach(runs, campaign, HOLD_TICKS)
    seen, _ = env.reset(seed=HELD_OUT, options={'judging': True})
    weights = dict(np.load(WEIGHTS))  # of the file, each item would be read at every step
    ended, infos = np.zeros(runs, np.bool_), dict[str, Any]()
    while not ended.all():
        seen, _, ended, _, infos = env.step(act(weights, seen))
    return infos['energy_n2s'], infos['kept']


def of_controller(campaign: str, runs: int, name: str) -> tuple[Floats, dict[str, Any]]:
    """Return the same of a shipped controller."""
    loaded = config.load(campaign, controller=name, runs=runs, seed=HELD_OUT)
    found = fly_runs(loaded, 0, runs)
    limits = loaded.config.limits(found)
    return found['energy_n2s'], {each: value <= most for each, (value, most) in limits.items()}


def main() -> None:
    """Print a table for each task."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--runs', type=int, default=1000)
    runs = parser.parse_args().runs
    for task in TASKS:
        rows = []
        for name in (*CONTROLLERS, 'agent'):
            energy, kept = (
                of_agent(task, runs) if name == 'agent' else of_controller(task, runs, name)
            )
            shares = (f'{100.0 * np.mean(each):.1f}' for each in kept.values())
            every = 100.0 * np.mean(np.all(list(kept.values()), axis=0))
            rows.append((name, f'{energy.mean():.3f}', *shares, f'{every:.1f}'))
        headings = (task, 'mean J [N²s]', *(f'{each} [%]' for each in kept), 'all [%]')
        print('\n'.join(markdown_table(headings, rows)), end='\n\n')


if __name__ == '__main__':
    main()
