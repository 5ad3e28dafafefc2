# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Training for a mission of one's own: what it starts from, what judges it, what it says."""

from __future__ import annotations

import os
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from invoking import invoke

from rpo.engine.population import population_of
from rpo.scoring.conditions import conditions_of
from rpo.scoring.fitness import Fitness, FitnessSettings
from rpo.training import config as configs
from rpo.training import scaling
from rpo.training.config import load_start
from rpo.training.tuning import Tuning, TuningConfig
from rpo_core import files
from rpo_core.chain.flight import fly
from rpo_core.control.controller import dumps, load_controller
from rpo_core.files.validation import InputError
from rpo_core.judge.similarity import AUTHORITY, made_for
from rpo_core.judge.verdicts import verdicts
from rpo_core.scenario import overrides
from rpo_core.scenario import scenario as scenarios
from rpo_core.scenario.scenario import load
from rpo_core.world.starts import Grid

ROOT = Path(__file__).resolve().parents[2]
MISSIONS = 'offline_training/examples/missions'
GEO = str(ROOT / MISSIONS / 'geo_servicer.yaml')
FEW = ['race.entrants=1', 'race.evaluations=14', 'race.population=14', 'cmaes.evaluations=20']


def written(path: Path, base: str = 'paper_training', **changes: object) -> str:
    """Write a shipped scenario with some fields changed; return its path."""
    document = yaml.safe_load(files.find('scenario', base).read_text()) | changes
    document = {key: value for key, value in document.items() if value is not None}
    path.write_text(yaml.safe_dump(document))
    return str(path)


def invoked(*words: str) -> tuple[int, str]:
    done = invoke(*words)
    return done.exit_code, done.output


def test_the_search_sees_what_the_verdicts_say():
    """Each requirement, by its exact value."""
    base = replace(load(GEO), duration_s=60.0, dt_s=0.5)
    required = {
        'mean_error_norm_m': 60.0, 'mean_speed_norm_m_s': 1.0, 'slew_per_axis_n_s': 2.0,
        'arrival_time_s': 30.0, 'arrival_error_per_axis_m': 50.0, 'hold_from_s': 40.0,
        'hold_error_per_axis_m': 60.0, 'hold_speed_per_axis_m_s': 1.2, 'hold_error_norm_m': 90.0,
        'final_error_per_axis_m': 20.0, 'final_speed_norm_m_s': 0.9, 'energy_n2s': 3000.0,
        'delta_v_axis_sum_m_s': 1.5, 'hold_force_per_axis_n': 7.0, 'final_error_norm_m': 25.0,
        'contact_range_m': 30.0, 'contact_closing_speed_m_s': 0.8,
        'contact_lateral_speed_m_s': 0.1, 'hold_speed_norm_m_s': 1.0,
    }  # fmt: skip
    base = replace(base, requirements=scenarios.requirements.parse(required))
    starts = scenarios.ScenarioSet(base, Grid((0.0, 20.0), (20.0, 60.0, 90.0), (0.0, 10.0)))
    controller = replace(load_start('trained'), force_scale_n=20.0)
    conditions, fitness = conditions_of(base), Fitness(starts, FitnessSettings(), 1)
    assert set(conditions.keys) == set(base.requirements.limits)
    with fitness.simulator:
        seen = fitness.score(population_of(controller)).failures[0]
    exact = [verdicts(fly(scenario, controller)) for scenario in starts.scenarios()]
    missed = {v.key: sum(row[i].holds is False for row in exact) for i, v in enumerate(exact[0])}
    for key, count in zip(conditions.keys, seen.tolist(), strict=True):
        assert count == missed[key], key
    assert any(missed.values()) and not all(missed.values())


def test_the_papers_training_fits_itself_and_scales_follow_from_range_time_and_force(tmp_path):
    copy = written(tmp_path / 'copy.yaml')
    for name in ('paper', 'best'):
        known = configs.PRESETS[name]
        found = configs.fitted(known, copy)
        assert (found.genes, found.fitness.penalty_n2s) == (known.genes, 100.0), name
    assert configs.fitted(configs.PRESETS['mission'], GEO).genes.force_scale_n < 20.0
    # twice as far in the same time with the same authority: the same flight, in other units
    far = written(tmp_path / 'far.yaml', initial_position_axis_m=[-200.0, 200.0], max_force_n=1.0)
    found = configs.fitted(configs.PRESETS['best'], far)
    assert found.genes.position_scale_m == (40.0, 400.0)
    assert found.genes.velocity_scale_m_s == (0.6, 6.0)
    assert found.genes.force_scale_n == 1.0 and found.fitness.penalty_n2s == 400.0


def test_too_little_force_is_said_before_the_search(tmp_path):
    weak = written(tmp_path / 'weak.yaml', max_force_n=0.02)
    code, said = invoked('train', '--scenario', weak, '-o', str(tmp_path / 'run'))
    assert code != 0 and 'no controller can do what scenario paper_training requires' in said
    assert not (tmp_path / 'run').exists()


@pytest.mark.every_landing
def test_a_search_that_misses_says_so_and_writes_the_file(tmp_path):
    """One start, a limit that is out of reach; the controller has the name of its folder."""
    document = yaml.safe_load(Path(GEO).read_text())
    document |= {'duration_s': 400.0, 'dt_s': 0.5}
    document['requirements'] = {'energy_n2s': 1.0, 'mean_error_norm_m': 0.5}
    (tmp_path / 'mine.yaml').write_text(yaml.safe_dump(document))
    settings = [word for setting in FEW for word in ('--set', setting)]
    folder = tmp_path / 'first_try'
    words = ['--scenario', str(tmp_path / 'mine.yaml'), '-o', str(folder), '--no-plots']
    code, said = invoked('train', *words, *settings)
    assert code == 1 and 'misses conditions of' in said and 'of 27 starts' in said
    assert invoked('train', '--resume', str(folder), '--no-plots', '--no-fail')[0] == 0
    assert not list(folder.glob('*.png'))
    found = load_controller(folder / 'first_try.yaml')
    assert found.name == 'first_try'
    assert found.provenance['scenario'] == str(tmp_path / 'mine.yaml')
    code, said = invoked('evaluate', str(folder / 'first_try.yaml'))
    assert code == 1 and 'requirements of geo_servicer' in said and 'MISSED' in said
    (tmp_path / 'mine.yaml').unlink()
    code, said = invoked('evaluate', str(folder / 'first_try.yaml'))
    assert code != 0 and 'there is no file' in said


def test_a_baseline_is_tuned_for_a_scenario_and_its_body(tmp_path):
    moon = str(ROOT / MISSIONS / 'lunar_logistics.yaml')
    tuning = Tuning(TuningConfig('mpc', 'mpc', evaluations=20, scenario=moon), tmp_path / 'run', 1)
    made = tuning.make(np.full(2, 0.5))
    assert made.model.body == load(moon).body and made.max_force_n == 40.0
    assert made.model.mean_motion_rad_s == load(moon).mean_motion_rad_s
    again = tmp_path / 'mpc.yaml'
    again.write_text(dumps(made))
    assert load_controller(again) == made
    document = yaml.safe_load(again.read_text())
    document['model']['body'] = 'moon'
    again.write_text(yaml.safe_dump(document))
    assert load_controller(again) == made
    document['model']['body'] = 'pluto'
    again.write_text(yaml.safe_dump(document))
    with pytest.raises(InputError, match='`body` must be one of earth, moon, mars'):
        load_controller(again)


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.parametrize(
    ('mission', 'flight'),
    [
        ('weak_thrusters', 'weak_thrusters_test'),
        ('geo_servicer', 'geo_servicer'),
        ('lunar_logistics', 'lunar_logistics'),
    ],
)
def test_a_mission_is_trained_dispersed_reported_flown_and_verified(
    mission, flight, ros_env, tmp_path
):
    for name in ('offline_training', 'ros_ws'):
        (tmp_path / name).symlink_to(ROOT / name)
    env = {key: value for key, value in (os.environ | ros_env).items() if key != 'RPO_JIT'}
    file, scenario = f'runs/{mission}/{mission}.yaml', f'{MISSIONS}/{flight}.yaml'
    fly_it = f'ros2 run rpo_bringup final_approach --scenario {scenario} --controller {file}'
    for command in (
        f'rpo train --scenario {MISSIONS}/{mission}.yaml -o runs/{mission}',
        f'rpo evaluate {file}',
        f'rpo campaign {MISSIONS}/{mission}_campaign.yaml -o runs/campaign',
        f'rpo report {file}',
        'rpo report runs/campaign',
        f'{fly_it} --output runs/flight',
        'rpo verify runs/flight',
        'rpo report runs/flight',
    ):
        done = subprocess.run(
            ['bash', '-c', command], cwd=tmp_path, env=env, capture_output=True, text=True
        )
        assert done.returncode == 0, f'{command}\n{done.stdout[-3000:]}{done.stderr[-3000:]}'
    summary = yaml.safe_load((tmp_path / 'runs/campaign/summary.yaml').read_text())
    assert summary['rates']['success']['share'] >= 0.99, 'G5'


# `rpo scale`: a controller for another vehicle, without training.


@pytest.fixture
def few(monkeypatch):
    """A few scalings: the search flies 65."""
    monkeypatch.setattr(scaling, 'LENGTHS', (0.6, 1.0))
    monkeypatch.setattr(scaling, 'TIMES', (1.0, 3.0))
    monkeypatch.setattr(scaling, 'STEPS', ())


def test_a_servicer_in_geo_is_flown_without_training(few, tmp_path):
    """Unscaled, the same controller ends 86 m off."""
    file = tmp_path / 'geo.yaml'
    code, said = invoked('simulate', GEO)
    command = f'rpo scale allround --scenario {GEO}'
    assert code == 1 and f'{AUTHORITY} is 20; here it is 0.4. `{command}` scales it' in said
    code, said = invoked('scale', 'allround', '--scenario', GEO, '-o', str(file))
    assert code == 0 and 'MISSED' not in said and str(file) in said
    assert 'it must rest closer' in said and 'Why' not in said
    assert 'Of 5 pairs of L and T, each flown from 27 starts, this pair misses' in said
    assert 'N of the 20 N of an axis: F follows from L, T and m' in said
    made = load_controller(file)
    assert made.name == 'geo' and made.provenance['command'] == command
    assert made.description == f'`allround`, scaled for `{GEO}`.'  # C said `trained with ...`
    found = made_for(made)
    assert found.name == 'paper_training' and found.own.mass_kg == pytest.approx(500.0)
    assert made.force_scale_n == pytest.approx(20.0 * found.own.force_n)
    assert invoked('evaluate', str(file))[0] == 0  # judged by the scenario that it was scaled for


@pytest.mark.slow
@pytest.mark.parametrize('mission', ['geo_servicer', 'lunar_logistics', 'weak_thrusters'])
def test_the_example_missions_are_flown_without_training_and_back(mission, tmp_path):
    file, again = tmp_path / 'made.yaml', tmp_path / 'again.yaml'
    scenario = str(ROOT / MISSIONS / f'{mission}.yaml')
    code, said = invoked('scale', 'allround', '--scenario', scenario, '-o', str(file))
    assert code == 0 and 'MISSED' not in said and 'Why' not in said
    code, said = invoked('scale', str(file), '--scenario', 'paper_test', '-o', str(again))
    assert code == 0 and made_for(load_controller(again)).name == 'paper_training'


@pytest.mark.every_landing
def test_what_scaling_cannot_do_is_said(few, tmp_path):
    """500 kg within the slew limit of 10 kg; the scenario that was changed is kept."""
    file, words = tmp_path / 'heavy.yaml', ['--set', 'mass_kg=500', '--set', 'max_force_n=25']
    given = ['scale', 'allround', '--scenario', 'paper_test', *words, '-o', str(file)]
    code, said = invoked(*given)
    assert code == 1 and 'its force must change more slowly' in said
    assert 'Why: slew per axis: with L = ' in said and 'it holds, but then' in said
    scenario = tmp_path / 'heavy_scenario.yaml'
    assert f'rpo train --scenario {scenario}' in said
    changed = overrides.load('paper_test', ['mass_kg=500', 'max_force_n=25'])
    assert load(scenario) == changed
    assert load_controller(file).provenance['scenario'] == str(scenario)
    assert invoked(*given, '--no-fail')[0] == 0
