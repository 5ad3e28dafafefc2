# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Learn two small policies in the Gymnasium environment, and compare them with `trained`.

    python offline_training/examples/learn_policy.py --seed 1

CMA-ES (the library `cma`) searches each policy, a few minutes on one core. It minimises the fitness
with graded penalties over six of the 216 training starts. The program prints the fitness of the
paper over all 216 starts, and the results of its test, for learnt policies and shipped controllers.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import cma
import gymnasium
import numpy as np
from numpy.typing import NDArray

import rpo_training.gym
from rpo_core.control.controller import load_controller
from rpo_core.judge.metrics import PENALTY, window
from rpo_judge.scoring.fitness import AT_LIMIT, LIMITS, TEST_WINDOW_S, excess

Floats = NDArray[np.float64]
Policy = Callable[[Floats, dict[str, Any]], Floats]
"""Observation and info to action."""

STARTS = 6
FARTHEST = 215  # [100, 100, 100] m, always among the six
POPULATION = 8

HEADINGS = (
    'policy',
    'flights learnt from',
    'learnt in [s of CPU]',
    'mean J [N²s]',
    'mean fitness [N²s]',
    'starts of 216 that meet all',
    'test: \\|position\\| [m]',
    'test: \\|velocity\\| [mm/s]',
)


def report(text: str) -> None:
    """Print the progress; only the table goes to standard output."""
    print(text, file=sys.stderr, flush=True)


def linear(parameters: Floats) -> Policy:
    """Proportional-derivative: f = -kp r - kd v on each axis; parameters are log10 of kp, kd."""
    kp, kd = 10.0**parameters
    return lambda seen, _: -kp * seen[:3] - kd * seen[3:6]


def profile(parameters: Floats) -> Policy:
    """Speed profile: f = k (-v_max tanh(r / L) - v); parameters are log10 of k, v_max, L."""
    k, v_max, length = 10.0**parameters
    return lambda seen, _: k * (-v_max * np.tanh(seen[:3] / length) - seen[3:6])


POLICIES = {
    # first guess: units are those of the observation, 100 m, 1 m/s, maximum force
    'linear': (linear, [0.0, 0.0]),
    'profile': (profile, [0.5, 0.0, 0.0]),
}


def shipped(name: str, max_force_n: float) -> Policy:
    """Return a shipped controller as a policy; it reads the exact state."""
    controller = load_controller(name)

    def policy(_: Floats, info: dict[str, Any]) -> Floats:
        seen = info['seen'].tolist()
        return np.array(controller.force_n(seen[:3], seen[3:], info['tick'])) / max_force_n

    return policy


def fly(env: Any, policy: Policy, **options: Any) -> dict[str, Any]:
    """Run one episode; return the last info, with the metrics of the flight."""
    observation, info = env.reset(options=options)
    over = False
    while not over:
        observation, _, over, _, info = env.step(policy(observation, info))
    return info


def graded(info: dict[str, Any]) -> float:
    """Return the fitness with the graded penalties of the training."""
    figures = info['figures']
    columns = ('mean_speed_norm_m_s', 'slew_per_axis_n_s', 'mean_error_norm_m')
    values = np.array([figures[name] for name in columns])
    missed = (values > LIMITS) * (AT_LIMIT + (1.0 - AT_LIMIT) * excess(values, LIMITS))
    return float(figures['energy_n2s'] + PENALTY * missed.sum())


class Learnt(NamedTuple):
    """A policy, and the effort of its search."""

    policy: Policy
    flights: int
    cpu_s: float
    parameters: Floats


def learn(env: Any, name: str, seed: int, generations: int) -> Learnt:
    """Search the parameters of a policy."""
    make, guess = POLICIES[name]
    others = np.random.default_rng(seed).choice(FARTHEST, STARTS - 1, replace=False).tolist()
    starts = [*others, FARTHEST]
    options = {'seed': seed, 'popsize': POPULATION, 'verbose': -9}
    search = cma.CMAEvolutionStrategy(guess, 0.5, options)
    began = time.process_time()
    for generation in range(1, generations + 1):
        asked = search.ask()
        values = [
            np.mean([graded(fly(env, make(parameters), start=start)) for start in starts])
            for parameters in asked
        ]
        search.tell(asked, values)
        report(f'{name}: generation {generation} of {generations}, best {min(values):.4f}')
    best = np.asarray(search.result.xbest)
    flights = generations * POPULATION * STARTS
    return Learnt(make(best), flights, time.process_time() - began, 10.0**best)


def evaluate(env: Any, policy: Policy) -> list[str]:
    """Return the metrics of a policy: all training starts, and the paper's test."""
    infos = [fly(env, policy, scenario='paper_training', start=i) for i in range(FARTHEST + 1)]
    energy = np.mean([info['figures']['energy_n2s'] for info in infos])
    fitness = np.mean([info['fitness_n2s'] for info in infos])
    met = sum(all(info['conditions']) for info in infos)
    fly(env, policy, scenario='paper_test')
    test = window(env.flight, TEST_WINDOW_S)
    env.reset(options={'scenario': 'paper_training'})
    return [
        f'{energy:.3f}',
        f'{fitness:.3f}',
        f'{met}',
        f'{test.position_m:.3f}',
        f'{1e3 * test.velocity_m_s:.2f}',
    ]


def main() -> None:
    """Learn, evaluate, print."""
    parser = argparse.ArgumentParser(
        description=__doc__.splitlines()[0],
        epilog='example: python offline_training/examples/learn_policy.py --seed 1',
    )
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--generations', type=int, default=20)
    arguments = parser.parse_args()
    env: Any = gymnasium.make(rpo_training.gym.ENVIRONMENT, disable_env_checker=True).unwrapped
    rows = []
    for name in POLICIES:
        found = learn(env, name, arguments.seed, arguments.generations)
        report(f'{name}: parameters {np.array2string(found.parameters, precision=4)}')
        row = evaluate(env, found.policy)
        rows.append([f'`{name}`', f'{found.flights}', f'{found.cpu_s:.0f}', *row])
    for name in ('handmade', 'paper_ga', 'trained'):
        report(f'{name}: evaluated')
        flights = load_controller(name).provenance.get('evaluations', 0) * (FARTHEST + 1)
        row = evaluate(env, shipped(name, env.scenario.max_force_n))
        rows.append([f'`{name}`', f'{flights or "–"}', '–', *row])
    for row in (HEADINGS, ['---', *['---:'] * (len(HEADINGS) - 1)], *rows):
        print('|', ' | '.join(row), '|')


if __name__ == '__main__':
    main()
