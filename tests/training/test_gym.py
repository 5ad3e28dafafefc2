# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The Gymnasium environment: its checker, the core's bits, the paper's fitness, and bad input."""

from __future__ import annotations

import importlib
import os
import subprocess
import sys
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import rpo.training.gym
import rpo.training.gym_vector
from rpo.montecarlo import config
from rpo.montecarlo.run_batch import fly_runs
from rpo.training.gym_vector import HELD_OUT
from rpo_core.chain.flight import Flight, fly
from rpo_core.control.baselines import Pd
from rpo_core.control.controller import load_controller
from rpo_core.files.validation import InputError
from rpo_core.judge.metrics import of_flight
from rpo_core.judge.verdicts import verdicts
from rpo_core.navigation.sensors import Navigation
from rpo_core.scenario.scenario import Scenario, load_scenario
from rpo_core.thrusters.thrusters import Thrusters
from rpo_core.wire.interfaces import RELATIVE_STATE

REAL = Thrusters(((0.9, 0.01, 0.0), (0.0, 1.1, 0.0), (0.0, -0.02, 1.0)), delay_ticks=2)
NOISY = Navigation((0.1, 0.0, -0.1), position_noise_m=0.02, velocity_noise_m_s=0.001)


def make(**options: Any) -> Any:
    return gymnasium.make(rpo.training.gym.ENVIRONMENT, **options).unwrapped


def played(env: Any, controller: str, **options: Any) -> tuple[float, dict[str, Any]]:
    """Let a controller play one episode; return its return and the last info."""
    chosen = load_controller(controller)
    _, info = env.reset(seed=1, options=options)
    total, over = 0.0, False
    while not over:
        seen = info['seen'].tolist()
        force = chosen.force_n(seen[:3], seen[3:], info['tick'])
        _, reward, over, truncated, info = env.step(np.array(force) / env.scenario.max_force_n)
        assert not truncated
        total += reward
    return total, info


def bits(flight: Flight) -> tuple[bytes, bytes]:
    return flight.states.tobytes(), flight.forces_n[:-1].tobytes()


@pytest.mark.parametrize('options', [{}, {'scenario': 'quick', 'render_mode': 'ansi'}])
def test_the_checker_has_nothing_to_say(options):
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        check_env(make(**options))


SHORT = replace(load_scenario('paper_test'), duration_s=20.0)


@pytest.mark.parametrize(
    'scenario',
    [
        SHORT,
        SHORT.equipped(REAL, NOISY),
        replace(SHORT, initial_velocity_m_s=(0.3, -0.4, 0.5), disturbance=SHORT.disturbance),
    ],
    ids=['ideal', 'real hardware', 'moving start'],
)
def test_a_policy_that_plays_a_controller_flies_its_bits(scenario: Scenario):
    env = make(scenario=scenario)
    total, info = played(env, 'allround')
    flight = fly(scenario, load_controller('allround'))
    assert bits(env.flight) == bits(flight)
    expected, found = of_flight(flight), verdicts(flight)
    missed = sum(verdict.holds is False for verdict in found)
    assert info['figures']['energy_n2s'] == expected.energy_n2s
    assert info['fitness_n2s'] == expected.energy_n2s + 100.0 * missed
    assert info['requirements'] == {v.key: v.holds is not False for v in found}
    assert total == pytest.approx(-info['fitness_n2s'], rel=1e-12)
    assert missed, 'the return must hold a penalty'


def test_observation_is_normalised_and_saturates():
    env = make(scenario='approach')
    observation, info = env.reset(options={'start': [-50.0, 25.0, 99_000.0, 0.5, 0.0, -2.0]})
    assert observation.tolist() == [-0.5, 0.25, 100.0, 0.5, 0.0, -2.0, 0.0, 0.0, 0.0, 0.0]
    assert info['state'][2] == 99_000.0
    observation, reward, *_ = env.step(np.array([1.0, -1.0, 7.0]))
    assert observation[6:].tolist() == [1.0, -1.0, 1.0, 1 / 4000]
    assert reward == pytest.approx(-3 * 0.5**2 * 0.1)


@pytest.mark.parametrize(
    ('options', 'message'),
    [
        ({'sart': 3}, 'did you mean `options.start`|did you mean `start`'),
        ({'start': 216}, '`start` must be a whole number >= 0 and <= 215; got 216'),
        ({'start': [1.0, 2.0]}, 'or 3 or 6 numbers; got'),
        ({'start': [1.0, 2.0, float('nan')]}, r'`start\[2\]` must be a finite number'),
        ({'scenario': 'nowhere'}, '`scenario` must be one of'),
    ],
)
def test_bad_options_are_one_sentence(options, message):
    with pytest.raises(InputError, match=message):
        make().reset(options=options)


@pytest.mark.parametrize('action', [[0.0, 0.0], [0.0, np.nan, 0.0], [0.0, np.inf, 0.0]])
def test_bad_actions_are_refused(action):
    env = make(scenario='quick')
    env.reset()
    with pytest.raises(InputError, match='`action` must be'):
        env.step(np.array(action))


def test_a_flight_that_is_over_must_be_reset():
    env = make(scenario='quick')
    env.reset()
    with pytest.raises(InputError, match='not over'):
        _ = env.flight
    for _ in range(50):
        *_, over, _, _ = env.step(np.zeros(3))
    assert over
    with pytest.raises(InputError, match='call `reset`'):
        env.step(np.zeros(3))


def test_it_is_found_by_its_module_and_needs_the_core_alone():
    code = (
        'import sys, gymnasium\n'
        'for name in ("numba", "scipy", "cma", "pymoo", "typer"): sys.modules[name] = None\n'
        'env = gymnasium.make("rpo.training.gym:rpo/FinalApproach-v0", scenario="quick")\n'
        'env.reset(seed=1)\n'
        'print(env.step(env.action_space.sample())[1] < 0.0)\n'
    )
    done = subprocess.run(
        [sys.executable, '-c', code],
        capture_output=True,
        text=True,
        timeout=50,
        env={**os.environ, 'RPO_JIT': '0'},
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, 'True\n', '')


# The vectorised environment: the campaign's flights, whoever commands; its reward, bad input.

EXAMPLES = Path(__file__).parents[2] / 'offline_training' / 'examples'
LAW = {'position_gain_n_m': 0.02, 'velocity_gain_n_s_m': 0.6}


def make_many(n: int = 3, **options: Any) -> Any:
    return gymnasium.make_vec(rpo.training.gym_vector.ENVIRONMENT, n, **options)


def played_together(env: Any, seed: int) -> tuple[np.ndarray, dict[str, Any]]:
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
    env = make_many(campaign=campaign, workers=2)
    total, infos = played_together(env, seed=5)
    own = config.load(campaign, controller='handmade', seed=5)
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
    env = make_many(campaign='docking', ticks_per_step=10)
    env.reset(seed=3)
    nearest, ended = np.inf, np.zeros(3, np.bool_)
    while not ended.all():
        r = env.flights.signals[:, env.flights.places[RELATIVE_STATE]][:, :3]
        nearest = min(nearest, np.linalg.norm(r, axis=1).min())
        _, _, ended, _, infos = env.step(-r / np.abs(r).max(axis=1, keepdims=True))
    assert 10.0 < nearest < 11.0  # the sphere's radius, and how near full thrust comes
    assert infos['kept']['keep_out_depth_m'].all()


def test_a_shield_names_the_limit_for_which_it_changed_an_action():
    env, named = make(scenario=rpo.scenario('paper_test', assurance={'keep_out_m': 10.0})), set()
    _, info = env.reset(seed=1)
    for _ in range(600):
        r = info['seen'][:3]
        info = env.step(-r / np.abs(r).max())[-1]
        named.add(info['constraint'])
    assert named == {'', 'keep_out', 'speed'} and np.linalg.norm(info['state'][:3]) > 10.0


def test_the_next_step_begins_the_next_runs_and_a_seed_the_first():
    env = make_many(ticks_per_step=4000)
    first, _ = env.reset(seed=7)
    still = np.zeros((3, 3))
    seen, rewards, ended, _, infos = env.step(still)
    assert ended.all() and seen[:, 9].tolist() == [1.0] * 3 and infos['fitness_n2s'].min() > 100.0
    later, rewards, ended, _, infos = env.step(still)
    assert not ended.any() and not rewards.any() and infos == {}
    assert not (later[:, :6] == first[:, :6]).any()
    assert (env.reset(seed=7)[0] == first).all()
    assert not (env.reset()[0][:, :6] == first[:, :6]).any()


def test_an_action_is_held_saturated_and_seen_by_any_number_of_threads():
    held, ticked = make_many(ticks_per_step=10, workers=2), make_many()
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
        make_many().reset(seed=HELD_OUT)
    make_many().reset(seed=HELD_OUT, options={'judging': True})
    env = make_many()
    env.reset(seed=1)
    for bad in (np.zeros(3), np.full((3, 3), np.nan)):
        with pytest.raises(InputError, match='3 x 3 finite numbers'):
            env.step(bad)
    with pytest.raises(InputError, match='num_envs'):
        make_many(0)


def test_the_agent_that_ships_flies_what_it_never_saw(monkeypatch):
    monkeypatch.syspath_prepend(str(EXAMPLES))
    fly_agent = importlib.import_module('fly_agent')
    energy, kept = fly_agent.of_agent('paper_test_measured', 10)
    assert 6.0 < energy.mean() < 10.0
    assert all(each.all() for name, each in kept.items() if name != 'hold_force_per_disturbance')
    _, kept = fly_agent.of_controller('paper_test_measured', 10, 'allround')
    assert kept['slew_per_axis_n_s'].all()
