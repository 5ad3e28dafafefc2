# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Train an agent by PPO (stable-baselines3) in `rpo/DispersedApproach-v0`, and write its weights.

    pip install stable-baselines3
    python offline_training/examples/learn_agent.py agent.npz

One small network flies each axis: from position, velocity and time of an axis to its force. It
learns from a graded reward, in two stages (a quarter of an hour of CPU time), and is judged by the
limits of the campaign (`fly_agent.py`).
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium
import numpy as np
import torch
from fly_agent import HOLD_TICKS, features, force_share
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecEnv

import rpo

CAMPAIGN = 'paper_test_measured'
SETTLED_M, SETTLED_M_S = 0.3, 0.01
"""Where errors begin to count fully in the graded reward; the limits are 0.5 m and 0.01 m/s."""


class Stage(NamedTuple):
    """Runs side by side, iterations, first seed of the draws; numbers of PPO.

    effort : weight of the squared force; rate : of learning, at first; spread : log of the sigma of
    the actions, at first; planned : iterations over which the rate would fall to zero
    """

    runs: int
    iterations: int
    planned: int
    seed: int
    discount: float
    effort: float
    rate: float
    spread: float


STAGES = (
    Stage(20, 490, 900, 1, 0.97, 20.0, 3e-3, -1.0),
    Stage(30, 500, 500, 3, 0.98, 8.0, 1.5e-3, -1.8),
)


class Axes(VecEnv):
    """Three agents a run, one for each axis, all of the same network."""

    def __init__(self, stage: Stage) -> None:
        self.stage, self.agents = stage, 3 * stage.runs
        self.flights = rpo.DispersedApproach(stage.runs, CAMPAIGN, HOLD_TICKS)
        seen = gymnasium.spaces.Box(-20.0, 20.0, (3,), np.float32)
        super().__init__(self.agents, seen, gymnasium.spaces.Box(-1.0, 1.0, (1,), np.float32))

    def reset(self) -> Any:
        """Begin the runs of the seed."""
        self.seen, _ = self.flights.reset(seed=self.stage.seed)
        return features(self.seen)

    def step_async(self, actions: Any) -> None:
        """Keep the actions."""
        self.actions = force_share(np.asarray(actions, np.float64).reshape(-1, 3))

    def step_wait(self) -> Any:
        """Fly; return what is seen, graded rewards and ends."""
        seen, _, over, _, _ = self.flights.step(self.actions)
        r, v = 100.0 * np.abs(seen[:, :3]), np.abs(seen[:, 3:6])
        cost = np.arcsinh(r / SETTLED_M) + 0.2 * np.arcsinh(v / SETTLED_M_S)
        cost += self.stage.effort * self.actions**2
        rewards = -0.05 * cost.ravel().astype(np.float32)
        infos: list[dict[str, Any]] = [{} for _ in range(self.agents)]
        if over.all():
            for info, last in zip(infos, features(seen), strict=True):
                info['terminal_observation'] = last
            seen, *_ = self.flights.step(np.zeros_like(self.actions))
        self.seen = seen
        return features(seen), rewards, np.repeat(over, 3), infos

    def close(self) -> None:
        """Nothing is open."""

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Return an attribute for each agent."""
        return [getattr(self, attr_name, None)] * self.num_envs

    set_attr = env_method = env_is_wrapped = None  # agents share everything


def layers_of(model: Any) -> list[Any]:
    """Return the layers of the policy."""
    hidden = [m for m in model.policy.mlp_extractor.policy_net if hasattr(m, 'weight')]
    return [*hidden, model.policy.action_net]


def learn(stage: Stage, output: Path, begin: Path | None) -> None:
    """Train, and write the weights after every tenth iteration; begin : weights to go on from."""
    env = Axes(stage)
    steps = env.flights.unwrapped.scenario.ticks // HOLD_TICKS
    model = PPO(
        'MlpPolicy', env, n_steps=steps, batch_size=2000, n_epochs=6, gamma=stage.discount,
        gae_lambda=0.95, learning_rate=lambda left: stage.rate * left + 5e-5, ent_coef=0.0,
        policy_kwargs={'net_arch': [32, 32], 'log_std_init': stage.spread}, seed=stage.seed,
        device='cpu',
    )  # fmt: skip
    layers = layers_of(model)
    if begin is not None:
        weights = np.load(begin)
        for i, layer in enumerate(layers):
            layer.weight.data = torch.tensor(weights[f'w{i}'])
            layer.bias.data = torch.tensor(weights[f'b{i}'])
    for i in range(stage.iterations):
        model._current_progress_remaining = 1.0 - i / stage.planned
        model.learn(steps * env.num_envs, reset_num_timesteps=i == 0)
        if i % 10 == 9:
            found = {f'w{i}': layer.weight.detach().numpy() for i, layer in enumerate(layers)}
            found |= {f'b{i}': layer.bias.detach().numpy() for i, layer in enumerate(layers)}
            np.savez_compressed(output, **found)
            returns = model.rollout_buffer.rewards.sum(axis=0).mean()
            print(f'iteration {i + 1}: mean graded return {returns:.3f}', file=sys.stderr)


def main() -> None:
    """Train stage after stage."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('output', type=Path)
    output = parser.parse_args().output
    torch.set_num_threads(1)
    for i, stage in enumerate(STAGES):
        learn(stage, output, output if i else None)


if __name__ == '__main__':
    main()
