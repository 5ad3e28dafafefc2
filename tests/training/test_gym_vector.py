# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The vectorised environment: the campaign's flights, whoever commands; its reward, bad input."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

import rpo_training.gym_vector
from rpo_core.files.validation import InputError
from rpo_ctrl.baselines import Pd
from rpo_montecarlo.campaign import config
from rpo_montecarlo.campaign.run_batch import fly_runs
from rpo_montecarlo.engine.lanes import R
from rpo_training.gym_vector import HELD_OUT

EXAMPLES = Path(__file__).parents[2] / 'offline_training' / 'examples'
LAW = {'position_gain_n_m': 0.02, 'velocity_gain_n_s_m': 0.6}


def make(n: int = 3, **options: Any) -> Any:
    return gymnasium.make_vec(rpo_training.gym_vector.ENVIRONMENT, n, **options)


def played(env: Any, seed: int) -> tuple[np.ndarray, dict[str, Any]]:
    """Let a spring and a damper play one episode each; return returns and the last infos."""
    seen, _ = env.reset(seed=seed)
    limit, total, over = env.scenario.max_force_n, np.zeros(env.num_envs), False
    while not over:
        r, v = 100.0 * seen[:, :3], seen[:, 3:6]
        force = -(LAW['position_gain_n_m'] * r + LAW['velocity_gain_n_s_m'] * v)
        seen, rewards, ended, truncated, infos = env.step(force / limit)
        over = ended.all()
        assert over == ended.any() and not truncated.any()
        total += rewards
    return total, infos


@pytest.mark.parametrize('campaign', ['paper_test', 'paper_test_measured', 'docking'])
def test_a_controller_that_plays_flies_as_in_its_campaign(campaign):
    env = make(campaign=campaign)
    total, infos = played(env, seed=5)
    own = config.load(config.find(campaign), controller='handmade', seed=5)
    limit = own.scenario.max_force_n
    pd = Pd(name='pd', max_force_n=limit, **LAW)
    found = fly_runs(config.Campaign(own.config, own.scenario, pd, own.texts), 0, 3)
    assert infos['energy_n2s'] == pytest.approx(found['energy_n2s'], rel=1e-9)
    for name, kept in infos['kept'].items():
        value, most = own.config.limit(name, found)
        assert infos['values'][name] == pytest.approx(value, rel=1e-7, abs=1e-9), name
        assert kept.tolist() == (value <= most).tolist(), name
    missed = sum(~kept for kept in infos['kept'].values())
    assert total == pytest.approx(-(found['energy_n2s'] + 100.0 * missed), rel=1e-9)
    assert (missed.sum() > 0) == (campaign != 'docking')  # both ends of the penalty are flown


def test_assurance_keeps_runs_away_from_the_sphere_whoever_commands():
    env = make(campaign='docking', ticks_per_step=10)
    env.reset(seed=3)
    nearest, ended = np.inf, np.zeros(3, np.bool_)
    while not ended.all():
        r = env.stepping.vectors(R)
        nearest = min(nearest, np.linalg.norm(r, axis=1).min())
        _, _, ended, _, infos = env.step(-r / np.abs(r).max(axis=1, keepdims=True))
    assert 10.0 < nearest < 11.0  # the sphere's radius, and how near full thrust comes
    assert infos['kept']['keep_out_depth_m'].all()


def test_the_next_step_begins_the_next_runs_and_a_seed_the_first():
    env = make(ticks_per_step=4000)
    first, _ = env.reset(seed=7)
    still = np.zeros((3, 3))
    seen, rewards, ended, _, infos = env.step(still)
    assert ended.all() and seen[:, 9].tolist() == [1.0] * 3 and infos['fitness_n2s'].min() > 100.0
    later, rewards, ended, _, infos = env.step(still)
    assert not ended.any() and not rewards.any() and infos == {}
    assert not (later[:, :6] == first[:, :6]).any()
    assert (env.reset(seed=7)[0] == first).all()
    assert not (env.reset()[0][:, :6] == first[:, :6]).any()


def test_there_are_more_runs_than_the_campaign_has(monkeypatch):
    env = make(40, campaign='paper_test_measured')
    env.reset(seed=1)
    env.unwrapped._first = env.campaign.config.runs - 60
    env.reset()
    with pytest.raises(InputError, match='with another seed'):
        env.reset()
    monkeypatch.setattr(env.unwrapped, '_first', 10_000)
    assert np.isfinite(env.reset()[0]).all()


def test_an_action_is_held_saturated_and_seen():
    held, ticked = make(ticks_per_step=10), make()
    push = np.array([[2.0, -0.5, 0.0]] * 3)
    for env in (held, ticked):
        env.reset(seed=1)
    seen, reward, *_ = held.step(push)
    parts = [ticked.step(push) for _ in range(10)]
    assert (seen == parts[-1][0]).all() and reward == pytest.approx(sum(part[1] for part in parts))
    assert seen[0, 6:9].tolist() == [1.0, -0.5, 0.0]
    assert seen in held.observation_space and seen[:, 9].tolist() == [10 / 4000] * 3


def test_bad_input_is_refused():
    with pytest.raises(InputError, match='for judging'):
        make().reset(seed=HELD_OUT)
    make().reset(seed=HELD_OUT, options={'judging': True})
    env = make()
    env.reset(seed=1)
    for bad in (np.zeros(3), np.full((3, 3), np.nan)):
        with pytest.raises(InputError, match='3 x 3 finite numbers'):
            env.step(bad)
    with pytest.raises(InputError, match='num_envs'):
        make(0)


def test_the_agent_that_ships_flies_what_it_never_saw(monkeypatch):
    monkeypatch.syspath_prepend(str(EXAMPLES))
    fly_agent = importlib.import_module('fly_agent')
    energy, kept = fly_agent.of_agent('paper_test_measured', 10)
    assert 6.0 < energy.mean() < 10.0
    assert all(each.all() for name, each in kept.items() if name != 'hold_force_per_disturbance')
    _, kept = fly_agent.of_controller('paper_test_measured', 10, 'allround')
    assert kept['slew_per_axis_n_s'].all()
