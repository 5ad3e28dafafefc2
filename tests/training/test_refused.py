# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Words that `rpo` refuses: each in one sentence, with exit code 2, and nothing is written."""

from __future__ import annotations

import shlex

import pytest
from invoking import refused

from rpo_training.tuning import BUDGET

REFUSED = {
    'bench inferense': '`what` must be one of all, inference',
    'bench ros --write x.md': '`--write` writes the whole table',
    'compare nobody': '`controller` must be one of allround, apf_smc, drift',
    'compare missing.yaml': 'rpo: `controller` must be a file',
    'compare pd pd': 'can be compared once',
    'compare pd --runs 0': '`runs` must be a whole number >= 1',
    'evaluate robust --seed 7': '`--seed` needs `--everywhere`',
    'evaluate trained --estimator world_moon': '`controllers` or `--estimator` must be given',
    'evaluate trained --scenario quick': 'scenario quick has no requirements',
    'evaluate pd -o x': '`--output` needs `--robustness`',
    'evaluate trained --robustness --starts': '`--robustness` takes controllers',
    'explain nobody': '`controller` must be one of',
    'explain --state 1,2,3': '`state` must be 6 finite numbers x,y,z,vx,vy,vz',
    'explain --state 1,2,3,4,5,six': '`state` must be 6 finite numbers',
    'explain --state 1e9,0,0,0,0,0': '`x` must be a finite number >= -100000 and <= 100000 m',
    'explain --state 1,2,3,0,0,0 --at 3': '`--state` needs no `--at`',
    'explain trained --state 1,2,3,0,0,0 --controller handmade': 'give one controller',
    'explain trained --at 5': '`--at` needs a run, a folder or a .mcap file; got trained. To',
    'explain --at 3': 'got allround',
    'explain /no/such/run --at 3': '`--at` needs a run, a folder or a .mcap file; got /no/such',
    'explain pace --state=1,0,0,0,0,0 --at 5': 'has no clock',
    'explain attitude_lqr': 'must be fuzzy here',
    'export handmade --to xml': '`--to` must be one of fis, fll, json, python, c',
    'export nobody --to fis': '`controller` must be one of',
    'export handmade --to c -o /dev/null/place.c': 'cannot be made',
    'export attitude_fuzzy --to fis': 'needs `--to c`',
    'import /no/such.fis -o x.yaml': '/no/such.fis: No such file or directory',
    'optimal --start 100,100': '`--start` must be',
    'optimal --start 100,100,up': '`--start` must be',
    'optimal --start 1,2,3 --duration 0.1': 'at least 2 ticks',
    'prove': 'say what to prove',
    'prove robust --scenario paper_test': '`--scenario` names a single flight: give `--position`',
    'prove --check .': '.: must be the folder of a proof',
    'prove --resume none': 'none: must be the folder of a proof',
    'prove lqr --estimate 1': 'of kind lqr',
    'prove robust --scenario paper_test --position 1 --claim hold_force_per_disturbance':
        '`claim` must be one of hold_error_per_axis_m',
    'report nobody': 'must be one of',
    'report no/where.mcap': 'does not exist',
    'report no/where.yaml': 'there is no file',
    "report ''": 'must be a shipped name or a path',
    'report attitude_fuzzy': '--set attitude_control.controller=attitude_fuzzy` flies it',
    'report runs/none --video a.gif': 'runs/none is a controller',
    'report a.mcap b.mcap --video a.gif': '`--video` is of one run',
    'report a.mcap --video a.avi': "must end in .gif or .mp4; got 'a.avi'",
    'report a.mcap trained': 'several targets must be runs; a.mcap is a run, trained a contr',
    'scale drift --scenario paper_test -o x.yaml': 'drift cannot be scaled: its kind `drift` has',
    'scale pd --scenario quick -o x.yaml': 'scenario quick has no requirements to scale for',
    'scale pd --scenario paper_test --set initial_position_m=[0,0,0] -o x.yaml':
        'starts at its goal',
    'scale pd --scenario nowhere.yaml -o x.yaml': 'there is no file',
    'scale nobody --scenario paper_test -o x.yaml': '`controller` must be one of',
    'simulate --sweep mass_kg=8': 'must be KEY=FROM:TO:NUMBER, like mass_kg=8:12:5',
    'simulate --sweep mass_kg=8:12:1': 'whole number >= 2',
    'simulate --sweep mass=8:12:2': 'did you mean `mass_kg`?',
    'simulate --sweep mass_kg=8:12:2 --csv x.csv': 'no `--csv`',
    'train --attitude --preset robust': '`--preset` must be one of paper, best',
    'train --attitude --scenario approach': '`--attitude` takes no `--scenario`',
    'train --attitude --family pace': '`--family` takes no',
    'train --attitude --set genes.rules=x': '`genes.rules` must be one of',
    'train --family neural -o x': '`family` must be one of',
    'train --family pace --preset best -o x': '`--family` takes no `--preset`',
    'train --family pace --set cmaes.sigma=0 -o x': '`cmaes.sigma` must be',
    'train --family pace --set staged.stages=0 -o x': '`staged.stages` must be',
    'train --family pace --set start=trained -o x': '`start` must be of the family pace',
    'train --set scenario=approach -o x': 'use `--scenario`',
    'truth nowhere': '`scenario` must be one of',
    'tune neural': "`kind` must be one of pd, lqr, mpc, apf_smc; got 'neural'",
    'tune pd --evaluations 1000000': f'>= 20 and <= {BUDGET}; got 1000000',
    'tune': 'say what to tune',
    'tune --resume nowhere': 'nowhere/tuning.yaml: No such file',
}  # fmt: skip


@pytest.mark.parametrize('words', REFUSED)
def test_words_that_are_refused(words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert REFUSED[words] in refused(*shlex.split(words))
    assert not list(tmp_path.iterdir())


SETTINGS = {
    'fitness.penalty=steep': '`fitness.penalty` must be one of flat, graded',
    'fitness.margin=1.0': '`fitness.margin` must be below 1',
    'fitness.limit_cycle=-1.0': '`fitness.limit_cycle` must be a finite number >= 0 N^2 s',
    'fitness.mass_kg=[0.0]': '`fitness.mass_kg[0]` must be a finite number > 0 kg',
    'fitness.between=41': '`fitness.between` must be a whole number >= 0 and <= 40',
    'fitness.arrival=maybe': '`fitness.arrival` must be true or false',
    'fitness.drawn.weight=-1.0': '`fitness.drawn.weight` must be a finite number >= 0',
    'fitness.drawn.flights=0': '`fitness.drawn.flights` must be a whole number >= 1',
    'fitness.drawn.campaigns=[""]': '`fitness.drawn.campaigns[0]` must be a text',
    'fitness.drawn.judged=[paper_test]': '`fitness.drawn.judged` must be a mapping',
    'fitness.drawn.judged={paper_test: []}': '`fitness.drawn.judged.paper_test` must be a list',
    'fitness.drawn.judged={paper_test: [slew]}': 'slew_per_axis_n_s',
    'fitness.drawn.openings=-1': '`fitness.drawn.openings` must be a finite number >= 0',
    'fitness.drawn.propellant=-1': '`fitness.drawn.propellant` must be a finite number >= 0',
    'genes.position_scale_m=[100, 50]': '`genes.position_scale_m` must be [least, most]',
    'genes.position_scale_m=[0, 1]': '`genes.position_scale_m` must be a finite number > 0',
    'genes.position_scale_m=[1]': '`genes.position_scale_m` must be [least, most]',
    'genes.position_scale_m=[a, b]': '`genes.position_scale_m` must be a finite number > 0',
    'genes.position_scale_m=90': '`genes.position_scale_m` must be a list',
    'ga.population=0': '`ga.population` must be a whole number >= 4',
    'ga.populaton=9': 'did you mean `population`',
    'ga.elites=60': '`ga.elites` must leave room',
    'algorithm=magic': '`algorithm` must be one of',
    'seed=-1': '`seed` must be',
    'name=a/b': '`name` must be letters',
    'start=[]': '`start` must name a controller',
    'nonsense': '`--set` must be like',
}


@pytest.mark.parametrize('setting', SETTINGS)
def test_settings_of_a_training_that_are_refused(setting):
    sentence = refused('train', '--show', '--set', 'algorithm=cmaes', '--set', setting)
    assert SETTINGS[setting] in sentence


@pytest.mark.parametrize('words', ['prove robust -o', 'campaign paper_test -o'])
def test_a_folder_that_holds_other_things_is_left_alone(words, tmp_path):
    (tmp_path / 'letter.txt').write_text('something')
    assert 'it holds other things' in refused(*words.split(), tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ['letter.txt']
