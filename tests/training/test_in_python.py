# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Campaigns and trainings in Python: what a user writes, and the bits of the commands."""

import threading

import numpy as np
import pytest
from invoking import invoke

import rpo


def test_a_campaign_has_the_bits_of_the_command(write, tmp_path):
    path, folder = write(runs=250), tmp_path / 'runs'
    words = ('--seed', '5', '--controller', 'pd', '--set', 'mass_kg=11.0')
    assert invoke('campaign', str(path), '-o', str(folder), *words).exit_code == 0
    runs = rpo.campaign(path, 'pd', runs=None, seed=5, mass_kg=11.0)
    read = rpo.campaign(folder)
    assert list(runs) == list(read) and repr(runs) == repr(read)
    assert all(np.array_equal(runs[name], read[name]) for name in runs)
    assert runs.folder is None and read.folder == folder
    again = rpo.campaign(runs, runs=None, folder=tmp_path / 'same')
    assert again.results.bound == read.results.bound
    rows = runs._repr_html_()
    assert '250 runs' in rows and '<td>success</td>' in rows


def test_a_scenario_is_dispersed():
    short = rpo.scenario('paper_test', duration_s=20.0)
    spread = {'mass_share': {'uniform': 0.2}, 'initial_position_m': {'normal': (1, 2, 3)}}
    limits = {'slew_per_axis_n_s': 0.2}
    runs = rpo.campaign(short, 'pd', runs=20, disperse=spread, success=limits)
    assert runs.definition.config.name == 'paper_test_changed'
    assert np.ptp(runs['mass_kg']) > 3.5
    assert list(runs.rates)[:2] == ['success', 'slew_per_axis_n_s']
    assert runs.scenario(7).mass_kg == runs['mass_kg'][7]
    law = rpo.fly(runs.scenario(7), lambda t, x: -0.01 * x[:3] - 0.3 * x[3:])
    assert law.scenario.name == 'paper_test (changed)_run_7'


def test_a_function_flies_a_campaign_run_after_run():
    flying = []

    def law(t, x):
        flying.append(threading.get_ident())
        return -0.03 * x[:3] - x[3:]

    runs = rpo.campaign('paper_test', law, runs=3, duration_s=20.0)
    assert len(set(flying)) == 1 and repr(runs).startswith('<Campaign paper_test: law, 3 runs, ')
    alone = rpo.fly(runs.scenario(2), law)
    assert (runs.flight(2).x == alone.x).all()
    assert runs['energy_n2s'][2] == alone.metrics['energy_n2s']
    again = rpo.campaign(runs, runs=None, judge='slew')
    assert (again['energy_n2s'] == runs['energy_n2s']).all()

    def forgetful(t, x):
        flying.append(t)
        return [1e-6 * len(flying), 0.0, 0.0]

    with pytest.raises(rpo.InputError, match='other bits: its function has memory'):
        rpo.campaign('paper_test', forgetful, runs=1, duration_s=20.0).flight(0)


@pytest.mark.parametrize(
    ('arguments', 'options', 'sentence'),
    [
        ((3,), {}, 'campaign: name, path or object expected; got 3'),
        (('approach',), {}, 'scenario approach has no dispersions of its own; give some, like'),
        (('paper_tset',), {}, 'did you mean `paper_test`'),
        (('paper_test', 3), {}, 'controller: name, path, object or function .* got 3'),
        (('paper_test', lambda t, x: x), {'folder': 'x'}, 'the function law has no file'),
        (('paper_test', lambda t, x: x), {'runs': 1}, 'must return 3 finite forces'),
        (('paper_test',), {'dispersion': {}}, '`dispersion` is neither .* mean `disperse`'),
        (('paper_test',), {'judges': 'slew'}, 'did you mean `judge`'),
        (('approach',), {'disperse': {'mas_share': {}}}, 'did you mean `mass_share`'),
        (('paper_test',), {'runs': 0}, '`runs` must be'),
        (('paper_test',), {'masss_kg': 3.0}, 'did you mean `mass_kg`'),
        (('paper_test',), {'judge': ['x']}, '`judge` must be one of'),
    ],
)
def test_a_campaign_says_what_it_takes(arguments, options, sentence):
    with pytest.raises(rpo.InputError, match=sentence):
        rpo.campaign(*arguments, **options)


SMALL = {'ga__population': 12, 'algorithm': 'ga-cmaes', 'cmaes__evaluations': 32}


def test_twenty_generations_become_a_controller(monkeypatch):
    monkeypatch.setenv('MPLBACKEND', 'Agg')
    pandas = pytest.importorskip('pandas')
    search = rpo.train('paper', generations=20, seed=4, ga__population=12)
    assert len(search.history) == len(pandas.DataFrame(search.history)) == 21
    assert search.history[-1]['best_fitness'] == search.best.provenance['fitness_n2s']
    flight = rpo.fly('paper_test', search.best)
    assert flight.metrics['energy_n2s'] > 1.0 and search.folder is None
    assert search.plot().get_ylabel() == 'fitness, J [N²s]'
    text = 'Trained from paper_ga, 20 generations, seed 4.'
    assert search.best.description == text and len(search.history[5:]) == 16
    assert repr(search).startswith('<Training paper_ga_20_generations_seed_4: 1')


def test_a_training_has_the_bits_of_the_command(tmp_path):
    settings = {'ga__generations': 3, **SMALL}
    words = [('--set', f'{key.replace("__", ".")}={value}') for key, value in settings.items()]
    folder = tmp_path / 'mine'
    flat = [word for pair in words for word in pair]
    done = invoke('train', '--preset', 'paper', '--seed', 4, *flat, '-o', folder, '--no-plots')
    assert done.exit_code == 0, done.output
    again = tmp_path / 'again'
    search = rpo.train('paper', generations=3, seed=4, folder=again, name='mine', **SMALL)
    for name in ('config.yaml', 'mine.yaml', 'history.csv'):
        assert (folder / name).read_bytes() == (again / name).read_bytes()
    assert rpo.train('paper', 3, 4, name='mine', **SMALL).best == search.best
    assert rpo.train('paper', 3, 4, folder=folder, **SMALL).best == search.best
    assert search.ok
    with pytest.raises(rpo.InputError, match='holds a run already'):
        rpo.train('paper', 3, 5, folder=folder, **SMALL)


@pytest.mark.parametrize(
    ('name', 'options', 'kind'),
    [
        ('lqr', {'evaluations': 20}, 'Lqr'),
        ('paper', {'attitude': True, 'ga__population': 8, 'generations': 1}, 'FuzzyAttitude'),
    ],
)
def test_other_controllers_are_trained(name, options, kind):
    search = rpo.train(name, **options)
    assert type(search.best).__name__ == kind and list(search.scores[3]) and repr(search)


@pytest.mark.parametrize(
    ('arguments', 'options', 'sentence'),
    [
        ((3,), {}, 'configuration: name, path or object expected; got 3'),
        (('papr',), {}, 'did you mean `paper`'),
        (('best', 20), {}, 'is no genetic algorithm; limit its evaluations, like cmaes__eval'),
        (('pd', 20), {}, 'limit its evaluations, like evaluations=2000'),
        (('paper', 0), {}, '`generations` must be'),
        (('paper',), {'ga__populaton': 3}, 'did you mean `population`'),
        (('paper',), {'generation': 3}, 'did you mean `generations`'),
        (('paper',), {'attitude': True, 'scenario': 'quick'}, 'the configuration says which'),
        (('nowhere.yaml',), {}, 'nowhere.yaml: '),
    ],
)
def test_a_training_says_what_it_takes(arguments, options, sentence):
    with pytest.raises(rpo.InputError, match=sentence):
        rpo.train(*arguments, **options)
