# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Attitude controllers are judged by flights of the chain, and their training repeats itself."""

from dataclasses import replace

import numpy as np
import pytest
from invoking import invoke
from processes import rpo

from rpo.analysis import attitude as judge
from rpo.training import config as configs
from rpo.training.attitude_training import PRESETS, AttitudeConfig, AttitudeTraining
from rpo_core import files
from rpo_core.chain.flight import OpenLoop, fly
from rpo_core.control import attitude
from rpo_core.control.attitude import AttitudeControl

pytestmark = pytest.mark.filterwarnings('ignore:this process computes with forms')

SHORT = ('ga.elites=1', 'ga.population=4', 'ga.generations=2')


@pytest.fixture
def paced(monkeypatch):
    """Fewer flights find the pace at which controllers are compared."""
    drawn = judge.judged_draws
    few = {400: 40}
    monkeypatch.setattr(judge, 'judged_draws', lambda n, *seed: drawn(few.get(n, n), *seed))


@pytest.mark.parametrize('name', sorted(files.shipped('attitude_controller')))
def test_a_flight_that_is_judged_is_that_of_the_chain(name):
    draws, angles_deg = judge.judged_draws(42), (judge.ANGLE_DEG, 0.02, 1e-4)
    flights = judge.Flights(draws)
    settings = AttitudeControl(controller=name, time_scale=1.0 if 'fuzzy' in name else 0.25)
    found = flights.fly(settings)
    others = [judge.Flights(draws, angle_deg=a).fly(settings) for a in angles_deg[1:]]
    settled_s = [flown.settled_s for flown in (found, *others)]
    for index in (0, 41):
        scenario = flights.scenario(index)
        assumed = replace(settings, inertia_kg_m2=judge.VEHICLE.inertia_kg_m2)
        ticks = round(judge.FLIGHT_S / scenario.dt_s)
        flight = fly(scenario.equipped(assumed), OpenLoop(np.zeros((scenario.ticks + 1, 3))))
        energy = 0.0
        for x, y, z in flight.signals['body_torque'][:ticks].tolist():
            energy += (x * x + y * y + z * z) * scenario.dt_s
        assert found.energy[index] == energy
        seen = flight.signals['chaser_attitude'][:ticks]
        n = scenario.mean_motion_rad_s
        angles = np.degrees(2.0 * np.arcsin(np.linalg.norm(seen[:, :3], axis=1)))
        x, y, z, w = seen[:, :4].T
        orbit = n * np.stack([2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)])
        rates = np.degrees(np.linalg.norm(seen[:, 4:] - orbit.T, axis=1))
        for angle_deg, settled in zip(angles_deg, settled_s, strict=True):
            outside = (angles > angle_deg) | (rates > judge.RATE_DEG_S)
            last = np.flatnonzero(outside)[-1] + 1
            assert settled[index] == (last * scenario.dt_s if last < ticks else np.inf)
        assert np.isclose(found.fastest_deg_s[index], rates.max(), rtol=1e-9)


def test_the_command_trains_and_a_resumed_training_has_its_bytes(tmp_path):
    given = ['train', '--attitude', '--workers', '1', *(f'--set={s}' for s in SHORT)]
    shown = invoke(*given, '--show')
    config = AttitudeConfig.parse(files.parse_yaml(shown.stdout))
    assert config.ga.population == 4
    done = invoke(*given, '-o', tmp_path / 'run', '--no-fail')
    assert done.exit_code == 0 and 'of 200 flights miss: settling' in done.stdout
    best = attitude.load(tmp_path / 'run' / 'run.yaml')
    assert best.provenance['command'].startswith('rpo train --attitude --config run.yaml')
    assert best.provenance['evaluations'] == 4 + 2 * 3
    stopped = AttitudeTraining.create(replace(config, name='run'), tmp_path / 'parts', 1)

    def stop():
        if stopped.history[-1]['generation'] == 1:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        stopped.run(stop)
    again = invoke('train', '--resume', tmp_path / 'parts', '--workers', 2)
    assert again.exit_code == 1 and 'of 200 flights miss: settling' in again.stdout
    for name in ('run.yaml', 'history.csv'):
        assert len({(tmp_path / run / name).read_bytes() for run in ('run', 'parts')}) == 1
    preset = configs.override(PRESETS['best'], ['name=other', 'seed=3'])
    assert preset.command == 'rpo train --attitude --preset best --seed 3'


@pytest.mark.parametrize('runs', [300, pytest.param(10_000, marks=pytest.mark.slow)])
def test_the_fuzzy_controller_settles_with_less_energy_than_others_at_its_pace(runs, paced):
    names = ('attitude_fuzzy', 'attitude_pd', 'attitude_lqr')
    fuzzy, *others = judge.compared([attitude.load(n) for n in names], judge.judged_draws(runs))
    assert fuzzy.share >= 0.999
    for other in others:
        assert abs(other.mean_s - fuzzy.mean_s) < 1.0
        assert fuzzy.energy_mn2m2s < 0.5 * other.energy_mn2m2s


def test_a_controller_that_is_never_so_fast_is_judged_at_its_own_best(paced):
    """It was judged at the least time scale, where it settled in no flight."""
    slow = replace(attitude.load('attitude_pd'), damping=0.3)
    first, row = judge.compared([attitude.load('attitude_fuzzy'), slow], judge.judged_draws(40))
    assert row.slower and not first.slower and 'its fastest' in row.cells[1]
    assert row.mean_s > first.mean_s + 3.0
    few = judge.Flights(judge.judged_draws(400, judge.JUDGED_SEED + 1))
    best = judge._settling_s(few, slow, row.time_scale)
    assert best < judge.FLIGHT_S - 1.0
    assert all(best < judge._settling_s(few, slow, row.time_scale * s) + 0.1 for s in (0.5, 2.0))


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_the_training_gives_the_bytes_that_ship(tmp_path):
    shipped = files.find('attitude_controller', 'attitude_fuzzy')
    words = attitude.load(shipped).provenance['command'].split()[1:]
    rpo(*words, '-o', tmp_path / 'attitude_fuzzy', limit_s=1700)
    made = tmp_path / 'attitude_fuzzy' / 'attitude_fuzzy.yaml'
    assert made.read_bytes() == shipped.read_bytes()
