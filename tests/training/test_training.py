# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Runs repeat, resume to the same bits, and say plainly what is wrong."""

import os
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
import pytest
import typer
from invoking import invoke

from rpo.cli.commands.shared import interruptible
from rpo.montecarlo.outputs import alone
from rpo.scoring.drawn import HELD_OUT
from rpo.training import config as configs
from rpo.training.family_training import FamilyConfig, FamilyTraining
from rpo.training.run import Checkpoint
from rpo.training.training import Training
from rpo.training.tuning import Tuning, TuningConfig
from rpo_core import files
from rpo_core.control.controller import load_controller
from rpo_core.files.validation import InputError

SMALL = [
    'ga.generations=5',
    'ga.population=12',
    'cmaes.evaluations=80',
    'cmaes.population=10',
    'race.rounds=1',
    'race.entrants=2',
    'race.evaluations=24',
    'race.population=6',
    'genes.rules=odd-monotone',
    'fitness.penalty=graded',
]
STAGED = [
    'fitness.drawn.weight=100',
    'fitness.drawn.campaigns=[random_starts]',
    'fitness.drawn.flights=4',
    'fitness.drawn.pool=40',
    'fitness.drawn.held_out=40',
    'fitness.limit_cycle=0',
    'cmaes.population=4',
    'cmaes.evaluations=8',
    'race.population=4',
    'race.evaluations=4',
    'race.entrants=1',
    'race.rounds=2',
    'race.gain=0',
    'race.stages=true',
]

FAMILY = [
    'cmaes.population=6',
    'cmaes.evaluations=12',
    'staged.stages=2',
    'staged.evaluations=6',
    'fitness.drawn.campaigns=[paper_test]',
    'fitness.drawn.flights=10',
    'fitness.drawn.pool=10',
    'fitness.drawn.held_out=10',
]


def small(algorithm='ga', *more):
    return configs.override(configs.PRESETS['paper'], [f'algorithm={algorithm}', *SMALL, *more])


SEARCHES = {
    **{name: (Training, small(name)) for name in configs.ALGORITHMS},
    'race by stages': (Training, configs.override(configs.PRESETS['best'], STAGED)),
    'family': (FamilyTraining, configs.override(FamilyConfig.of('time_to_go'), FAMILY)),
    'tuning': (Tuning, TuningConfig('pd', 'pd', 2, 40)),
}


def contents(folder):
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


class Interrupted(Exception):
    pass


def interrupted(search, generation):
    """Run a search until it has saved a generation."""

    def stop():
        if search.history[-1]['generation'] == generation:
            raise Interrupted

    with pytest.raises(Interrupted):
        search.run(stop)


@pytest.fixture(scope='module')
def trained(tmp_path_factory):
    """A small training, and its controller."""
    training = Training.create(small(), tmp_path_factory.mktemp('trained') / 'run', 1)
    return training, training.run()


@pytest.fixture(scope='module')
def begun(tmp_path_factory):
    folder = tmp_path_factory.mktemp('begun') / 'run'
    interrupted(Training.create(small(), folder, 1), 2)
    return folder


@pytest.fixture
def halfway(begun, tmp_path):
    """A copy of the folder of a training that was interrupted."""
    return shutil.copytree(begun, tmp_path / 'run')


def test_an_interrupted_run_ends_with_the_bits_of_an_uninterrupted_one(trained, halfway):
    flown = []
    training = Training.resume(halfway, 2)
    training.run(lambda: flown.append(training.history[-1]['generation']))
    assert flown == [3, 4, 5]
    assert contents(halfway) == contents(trained[0].folder)


@pytest.mark.slow
@pytest.mark.parametrize('name', SEARCHES)
def test_a_search_that_was_interrupted_in_the_middle_ends_with_the_same_bits(name, tmp_path):
    kind, chosen = SEARCHES[name]
    whole = kind.create(chosen, tmp_path / 'whole', 1)
    best, parts = whole.run(), tmp_path / 'parts'
    stages = {row['stage'] for row in whole.history}
    assert (stages == {HELD_OUT, 1, 2, 3}) == (name == 'race by stages')
    interrupted(kind.create(chosen, parts, 2), (len(whole.history) - 1) // 2)
    assert kind.resume(parts, 1).run() == best
    assert contents(parts) == contents(tmp_path / 'whole')
    with pytest.raises(InputError, match='holds a run already'):
        kind.create(chosen, parts)


def test_the_command_trains_a_family_and_goes_on(tmp_path):
    mine, settings = tmp_path / 'mine', (*FAMILY, 'cmaes.sigma=0.01')
    words = [word for setting in settings for word in ('--set', setting)]
    done = invoke('train', '--family', 'more_words', '--workers', 1, '-o', mine, *words)
    assert done.exit_code in (0, 1), done.output
    found = load_controller(mine / 'mine.yaml')
    made = found.provenance
    assert found.kind == 'more_words' and made['command'].startswith('rpo train --config')
    assert made['evaluations'] - (1 + 12 + 2 * (1 + 6)) in (1, 2)  # finalists
    assert made['held_out_that_miss'].keys() == {'paper_test'}
    assert invoke('train', '--resume', mine).exit_code == done.exit_code


def test_a_configuration_is_read_back_whole():
    for config in (*configs.PRESETS.values(), replace(FamilyConfig.of('more_words'), seed=3)):
        assert type(config).parse(files.parse_yaml(config.dumps())) == config
    assert config.command == 'rpo train --family more_words --seed 3'
    older = {'disturbance': 0.0, 'drawn': {'at_limit': 0.1, 'openings': 0.0, 'propellant': 0.0}}
    document = {'schema': 'rpo/training/1', 'fitness': older}
    assert configs.TrainingConfig.parse(document) == configs.PRESETS['paper']
    older['drawn']['openings'] = 0.01
    with pytest.raises(InputError, match=r'`fitness\.drawn\.openings` is gone in 0\.2'):
        configs.TrainingConfig.parse(document)


def spoil(folder, how):
    path, config = folder / 'checkpoint.npz', folder / 'config.yaml'
    if how == 'configuration':
        config.write_text(config.read_text().replace('seed: 1', 'seed: 2'))
    elif how == 'version':
        np.savez(path, **{**np.load(path), 'versions': np.array(['cma 0.0'])})
    elif isinstance(how, bytes):
        path.write_bytes(how)
    else:
        (folder / how).unlink()
        os.mkfifo(folder / how)


DAMAGES = [
    ('configuration', 'is of another configuration'),
    ('version', 'was written with .*cma 0.0'),
    (b'', 'checkpoint'),
    (b'PK\x03\x04 torn', 'checkpoint'),
    ('checkpoint.npz', 'must be a regular file'),
    ('config.yaml', 'must be a regular file'),
]


@pytest.mark.timeout(20)
@pytest.mark.parametrize(('damage', 'said'), DAMAGES)
def test_a_checkpoint_that_cannot_be_gone_on_from_is_refused(halfway, damage, said):
    spoil(halfway, damage)
    with pytest.raises(InputError, match=said):
        Training.resume(halfway)


def test_a_search_that_no_longer_repeats_is_noticed(halfway, monkeypatch):
    other = replace(small(), ga=replace(small().ga, mutation_scale=0.2))
    text = (halfway / 'config.yaml').read_text()
    monkeypatch.setattr(configs.TrainingConfig, 'load', lambda path: other)
    monkeypatch.setattr(configs.TrainingConfig, 'dumps', lambda config: text)
    with pytest.raises(InputError, match='generation 1 does not repeat'):
        Training.resume(halfway)


def test_a_checkpoint_is_bound_to_what_the_configuration_names(tmp_path):
    """The scenario or a start could change between two halves of one training."""
    scenario, start = tmp_path / 'mine.yaml', tmp_path / 'start.yaml'
    scenario.write_text(files.find('scenario', 'paper_training').read_text())
    start.write_text(files.find('controller', 'handmade').read_text())
    config = replace(small(), scenario=str(scenario), start=(str(start),))
    interrupted(Training.create(config, tmp_path / 'run', 1), 0)
    for path in (scenario, start):
        text = path.read_text()
        path.write_text(f'{text}# another\n')
        with pytest.raises(InputError, match='another content of the scenario or of a start'):
            Training.resume(tmp_path / 'run')
        path.write_text(text)
    assert len(Training.resume(tmp_path / 'run').checkpoint.scores) == 1


def test_two_processes_cannot_go_on_with_one_run(halfway):
    with (
        alone(halfway / 'config.yaml', 'holds it'),
        pytest.raises(InputError, match='another process goes on with this run'),
    ):
        Training.resume(halfway).run()


def test_a_flipped_bit_of_a_checkpoint_is_one_sentence(halfway):
    """One in six hundred was a traceback: zipfile and NumPy raise all kinds of errors."""
    path = halfway / 'checkpoint.npz'
    whole, text = path.read_bytes(), (halfway / 'config.yaml').read_text()
    kept = Checkpoint.load(path, text, Training.resume(halfway).inputs())
    for place in range(0, 8 * len(whole), 307):
        spoiled = bytearray(whole)
        spoiled[place // 8] ^= 1 << place % 8
        path.write_bytes(spoiled)
        try:
            found = Checkpoint.load(path, text, kept.inputs)
        except InputError as error:
            assert 'checkpoint.npz' in str(error)
        else:
            assert found.digests == kept.digests
            assert all(map(np.array_equal, found.scores, kept.scores))


def test_a_full_disk_leaves_the_last_checkpoint_whole(halfway, monkeypatch):
    before = (halfway / 'checkpoint.npz').read_bytes()
    training = Training.resume(halfway)
    monkeypatch.setattr(os, 'fsync', lambda _: (_ for _ in ()).throw(OSError(28, 'No space left')))
    with pytest.raises(InputError, match='cannot be saved: No space left'):
        training.run()
    monkeypatch.undo()
    assert (halfway / 'checkpoint.npz').read_bytes() == before
    assert not list(halfway.glob('.*'))
    Training.resume(halfway).run()


def start_rpo_train(folder, *settings):
    """Start `rpo train` as a process, and wait for its first checkpoint."""
    command = [
        sys.executable,
        '-c',
        'from rpo.cli.cli import app; app(prog_name="rpo")',
        *('train', '--no-plots', '--workers', '1', '-o', str(folder)),
        *(part for setting in (*SMALL, *settings) for part in ('--set', setting)),
    ]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + 60.0
    while not (folder / 'checkpoint.npz').exists():
        assert process.poll() is None, process.communicate()[1]
        assert time.monotonic() < deadline
        time.sleep(0.02)
    return process


def test_a_closed_terminal_interrupts_but_not_under_nohup(capsys):
    with pytest.raises(typer.Exit) as ended, interruptible(lambda: 'stopped'):
        os.kill(os.getpid(), signal.SIGHUP)
    assert ended.value.exit_code == 130
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    with interruptible(lambda: 'stopped'):
        os.kill(os.getpid(), signal.SIGHUP)
    assert capsys.readouterr().err == 'stopped\n'


@pytest.mark.every_landing
@pytest.mark.parametrize(
    'number', [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.slow)]
)
def test_a_signal_stops_a_run_cleanly(number, tmp_path):
    process = start_rpo_train(tmp_path / 'run', 'ga.generations=4000', 'ga.stall=4000')
    process.send_signal(number)
    _, errors = process.communicate(timeout=30.0)
    assert process.returncode == 130
    assert 'Go on with: rpo train --resume' in errors
    assert 'Traceback' not in errors
    assert len(Training.resume(tmp_path / 'run').checkpoint.scores) >= 1


@pytest.mark.slow
def test_a_killed_run_goes_on_to_the_same_bits(tmp_path):
    settings = ('name=one', 'ga.generations=60', 'ga.stall=60')
    process = start_rpo_train(tmp_path / 'killed', *settings)
    process.kill()
    process.communicate(timeout=30.0)
    Training.resume(tmp_path / 'killed', 2).run()
    Training.create(small('ga', *settings), tmp_path / 'whole', 2).run()
    assert contents(tmp_path / 'killed') == contents(tmp_path / 'whole')


def test_a_thread_that_dies_ends_the_run_and_loses_nothing(halfway, monkeypatch):
    before = (halfway / 'checkpoint.npz').read_bytes()
    training = Training.resume(halfway)

    def die(*_):
        raise MemoryError('no room')

    monkeypatch.setattr(training.fitness.simulator, '_fly', die)
    with pytest.raises(MemoryError, match='no room'):
        training.run()
    assert (halfway / 'checkpoint.npz').read_bytes() == before
