# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""`rpo scale`: a controller for another vehicle, without training."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml
from typer.testing import CliRunner

from rpo_cli.cli import app
from rpo_core.control.controller import load_controller
from rpo_core.files import overrides
from rpo_core.files.scenario import ScenarioSet, load
from rpo_core.files.starts import Box
from rpo_core.files.validation import InputError
from rpo_core.judge.verdicts import Verdict
from rpo_ctrl.similarity import AUTHORITY, made_for
from rpo_training import scaling
from rpo_training.fitting import around

MISSIONS = Path(__file__).resolve().parents[2] / 'offline_training' / 'examples' / 'missions'
GEO = str(MISSIONS / 'geo_servicer.yaml')


@pytest.fixture
def few(monkeypatch):
    """A few scalings: the search flies 65."""
    monkeypatch.setattr(scaling, 'LENGTHS', (0.6, 1.0))
    monkeypatch.setattr(scaling, 'TIMES', (1.0, 3.0))
    monkeypatch.setattr(scaling, 'STEPS', ())


def invoked(*words: str) -> tuple[int, str]:
    """Return exit code and output; the lines of a table may be wrapped."""
    done = CliRunner().invoke(app, list(words))
    sentence = str(done.exception) if isinstance(done.exception, InputError) else ''
    return done.exit_code, done.output + sentence


def test_a_servicer_in_geo_is_flown_without_training(few, tmp_path):
    """Unscaled, the same controller ends 86 m off."""
    file = tmp_path / 'geo.yaml'
    code, said = invoked('simulate', GEO)
    command = f'rpo scale allround --scenario {GEO}'
    assert code == 1 and f'{AUTHORITY} is 20; here it is 0.4. `{command}` scales it' in said
    code, said = invoked('scale', 'allround', '--scenario', GEO, '-o', str(file))
    assert code == 0 and 'MISSED' not in said and str(file) in said
    assert 'it must rest closer' in said and 'Why' not in said
    made = load_controller(file)
    assert made.name == 'geo' and made.provenance['command'] == command
    found = made_for(made)
    assert found.name == 'paper_training' and found.own.mass_kg == pytest.approx(500.0)
    assert made.force_scale_n == pytest.approx(20.0 * found.own.force_n)
    assert invoked('evaluate', str(file))[0] == 0  # judged by the scenario that it was scaled for


@pytest.mark.slow
@pytest.mark.parametrize('mission', ['geo_servicer', 'lunar_logistics', 'weak_thrusters'])
def test_the_example_missions_are_flown_without_training_and_back(mission, tmp_path):
    file, again = tmp_path / 'made.yaml', tmp_path / 'again.yaml'
    scenario = str(MISSIONS / f'{mission}.yaml')
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


@pytest.mark.parametrize(
    ('controller', 'words', 'message'),
    [
        ('drift', ['paper_test'], 'controller drift cannot be scaled: its kind `drift` has no'),
        ('pd', ['quick'], 'scenario quick has no requirements to scale for'),
        ('pd', ['paper_test', '--set', 'initial_position_m=[0,0,0]'], 'starts at its goal'),
        ('pd', ['nowhere.yaml'], 'there is no file'),
        ('nobody', ['paper_test'], '`controller` must be one of'),
    ],
)
def test_bad_input_is_one_sentence(controller, words, message, tmp_path):
    file = tmp_path / 'x.yaml'
    code, said = invoked('scale', controller, '--scenario', *words, '-o', str(file))
    assert code != 0 and message in said and not file.exists()


def test_what_it_was_trained_for_must_be_there(few, tmp_path):
    document = yaml.safe_load((MISSIONS / 'geo_servicer.yaml').read_text())
    document['duration_s'] = 20.0
    document['requirements'] = {'mean_error_norm_m': 1000.0}
    mine, file = tmp_path / 'mine.yaml', tmp_path / 'made.yaml'
    mine.write_text(yaml.safe_dump(document))
    assert invoked('scale', 'pd', '--scenario', str(mine), '-o', str(file))[0] == 0
    text = file.read_text().replace('paper_training', str(tmp_path / 'gone.yaml'))
    file.write_text(text)
    code, said = invoked('scale', str(file), '--scenario', str(mine), '-o', str(file))
    assert code != 0 and 'there is no file' in said and file.read_text() == text


def test_a_set_is_flown_from_its_outermost_starts():
    found = load('paper_training')
    few = scaling._starts(found)
    assert isinstance(few, ScenarioSet) and few.starts.x == few.starts.z == (-100.0, 5.0, 100.0)
    box = ScenarioSet(found.base, Box((-1.0, 0.0, 0.0), (1.0, 2.0, 0.0), random=500))
    assert len(scaling._starts(box).initial_positions_m) == 4 + 19
    one = load(GEO)
    assert scaling._starts(one).initial_positions_m.tolist() == around(one).positions_m.tolist()
    assert scaling._starts(load('docking')) == load('docking')  # it has sections


def test_scalings_are_ranked_by_misses_then_by_the_largest_shares():
    def flown(*values: float) -> scaling.Flown:
        worst = [Verdict('', '', '', 10.0, value) for value in values]
        return scaling.Flown(load_controller('pd'), scaling.Units(1.0, 1.0, 1.0), worst)

    order = [(9.001, 3.0, 8.0), (9.0, 4.0, 8.0), (9.9, 0.0, 0.0), (10.1, 0.0, 0.0)]
    order += [(10.1, float('inf'), 0.0)]
    ranks = [flown(*values).rank for values in order]
    assert ranks == sorted(ranks) and [rank[0] for rank in ranks] == [0, 0, 0, 1, 2]
    assert scaling._share(Verdict('', '', '', 0.0, 0.1)) == float('inf')
    assert scaling._share(Verdict('', '', '', 0.0, 0.0)) == 0.0
    assert scaling._share(Verdict('', '', '', 1.0, float('nan'))) == 0.0
