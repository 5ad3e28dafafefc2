# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Campaigns on disk and by command: the same bytes, interrupted or killed; bad input."""

import io
import os
import re
import resource
import signal
import subprocess
import sys
import time
from types import SimpleNamespace

import numpy as np
import pytest
from campaign_documents import SHORT
from invoking import invoke, refused
from pages import Page
from processes import stopped
from rich.console import Console

from rpo.display import COMPILING, progress
from rpo.montecarlo import config, execution, run_batch
from rpo.montecarlo.pool import versions
from rpo.montecarlo.store import Store
from rpo_core.files.validation import InputError


def test_the_folder_is_the_same_on_any_threads_interrupted_or_not(tmp_path, loaded):
    campaign = loaded(runs=1250)
    for name, workers in (('one', 1), ('two', 2)):
        execution.fly(Store.create(tmp_path / name, campaign), workers)

    class Interrupt(Exception):
        pass

    def stop(runs, successful):
        raise Interrupt

    store = Store.create(tmp_path / 'three', campaign)
    with pytest.raises(Interrupt):
        execution.fly(store, 2, progress=stop)
    assert 0 < len(store.pending()) < 7
    execution.fly(Store.open(tmp_path / 'three'), 1)
    for name in ('results.npz', 'summary.yaml', 'campaign.yaml'):
        contents = {(tmp_path / run / name).read_bytes() for run in ('one', 'two', 'three')}
        assert len(contents) == 1, name
    with np.load(tmp_path / 'one' / 'results.npz') as results:
        assert set(results.files) == set(run_batch.COLUMNS)
        assert results['mass_kg'].shape == (1250,)
    assert not list((tmp_path / 'one').glob('*.part'))


@pytest.mark.slow
def test_a_killed_campaign_goes_on(write, tmp_path):
    folder, path = tmp_path / 'killed', write(runs=20000)
    process, _ = stopped(path, folder, signal.SIGKILL)
    assert process.returncode == -signal.SIGKILL, 'it had ended before'
    assert 0 < len(Store.open(folder).pending()) < 100
    execution.fly(Store.open(folder))
    expected = run_batch.fly_runs(config.load(path), 19990, 10)
    for name in run_batch.COLUMNS:
        np.testing.assert_array_equal(Store.open(folder).column(name)[-10:], expected[name])


@pytest.mark.slow
def test_ctrl_c_stops_cleanly_and_says_how_to_go_on(write, tmp_path):
    folder = tmp_path / 'stopped'
    process, errors = stopped(write(runs=1000000), folder, signal.SIGINT)
    assert process.returncode == 130, errors
    assert 'Traceback' not in errors
    assert f'rpo campaign --resume {folder}' in errors


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_memory_is_flat(tmp_path, write):
    """A million runs need no more than ten thousand, but for columns of 8 MB at the end."""
    scenario = tmp_path / 'blink.yaml'
    scenario.write_text(SHORT.replace('duration_s: 20.0', 'duration_s: 0.1'))
    code = (
        'import resource, sys\n'
        'from pathlib import Path\n'
        'from rpo.montecarlo import config, execution\n'
        'from rpo.montecarlo.store import Store\n'
        'campaign = config.load(sys.argv[1], runs=int(sys.argv[2]))\n'
        'execution.fly(Store.create(Path(sys.argv[3]), campaign), 2)\n'
        'print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)\n'
    )
    path = write(scenario=str(scenario))
    peaks = []
    for runs in (10_000, 1_000_000):
        command = [sys.executable, '-c', code, str(path), str(runs), str(tmp_path / str(runs))]
        peaks.append(int(subprocess.check_output(command)))
    assert peaks[1] - peaks[0] < 64 * 1024  # KiB; all columns are 312 MB


@pytest.mark.slow
def test_runs_that_never_arrive_are_infinite_and_reported(tmp_path, write):
    limits = {'arrival_time_s': 9.0, 'arrival_error_norm_m': 1.0, 'final_error_norm_m': 70.0}
    limits |= {'contact_range_m': 1.0, 'contact_closing_speed_m_s': 1.0}
    path, folder = write(required=limits, runs=12, success=None), tmp_path / 'f'
    done = invoke('campaign', path, '-o', folder)
    assert done.exit_code == 0 and 'final_error_norm_m <= 70 m' in done.output
    assert not re.search(r'\b(nan|inf)\b', done.output)
    assert '12 of 12 never arrive' in done.output and '12 of 12 never touch' in done.output
    assert 'hold_error' not in done.output, 'nobody asked'
    done = invoke('report', folder)
    assert done.exit_code == 0, done.output
    page = (folder / 'report' / 'report.html').read_text()
    assert 'contact closing speed' in page and not re.search(
        r'\b(nan|inf)\b', Page(page).all('main')[0].text
    )
    assert '12 of 12 failures never touch' in page


def test_a_folder_of_another_campaign_is_left_alone(write, tmp_path, loaded):
    folder = tmp_path / 'f'
    campaign = loaded()
    Store.create(folder, campaign)
    with pytest.raises(InputError, match='of this campaign: go on with --resume'):
        Store.create(folder, campaign)
    with pytest.raises(InputError, match='of another configuration'):
        Store.create(folder, config.load(write(), seed=4))
    with pytest.raises(InputError, match='must be the folder of a campaign'):
        Store.open(tmp_path)
    with (
        Store.open(folder).alone(),
        pytest.raises(InputError, match='another process flies this campaign'),
    ):
        execution.fly(Store.open(folder))
    with (folder / 'done.part').open('ab') as file:
        file.write(b'\1')
    with pytest.raises(InputError, match='results are damaged'):
        Store.open(folder).pending()


def numbers(campaign, unit, is_stopped=None):
    """Return what a unit might have as results, without flying it."""
    size = min(run_batch.UNIT, campaign.config.runs - unit * run_batch.UNIT)
    return np.random.default_rng(unit).random((len(run_batch.COLUMNS), size))


@pytest.fixture
def begun(tmp_path, monkeypatch, loaded):
    """Return the folder of a campaign with three of seven units done."""
    monkeypatch.setattr(execution, 'fly_unit', numbers)
    store = Store.create(tmp_path / 'begun', loaded(runs=1250, seed=1))
    for unit in (0, 3, 6):
        store.put(unit, numbers(store.campaign, unit))
    assert Store.open(store.folder).pending() == [1, 2, 4, 5]
    return store.folder


@pytest.mark.parametrize('name', ['campaign.yaml', 'scenario.yaml', 'controller.yaml'])
def test_results_of_two_configurations_are_never_mixed(begun, name):
    text = (begun / name).read_text()
    changed = text.replace('seed: 1', 'seed: 2') if name == 'campaign.yaml' else f'{text}# so\n'
    assert changed != text
    (begun / name).write_text(changed)
    with pytest.raises(InputError, match='must be as they were when the campaign began'):
        Store.open(begun)
    bound = begun / 'versions.yaml'
    bound.write_text(re.sub('files_sha256: .*', '', bound.read_text()))
    with pytest.raises(InputError, match='must be as they were'):
        Store.open(begun)
    (begun / name).write_text(text)


def test_results_of_two_versions_are_never_mixed(begun, monkeypatch):
    other = dict.fromkeys(versions(), '0.1')
    monkeypatch.setattr('rpo.montecarlo.store.versions', lambda: other)
    with pytest.raises(InputError, match=r'begun with .* requires the same versions, not .*0\.1'):
        Store.open(begun)


def test_a_damaged_part_is_flown_again(begun):
    """Zeros, as after a power cut, were taken for results."""
    part, done = (begun / 'results.part').read_bytes(), (begun / 'done.part').read_bytes()
    (begun / 'results.part').write_bytes(bytes(len(part)))
    assert Store.open(begun).pending() == list(range(7))
    (begun / 'results.part').write_bytes(part)
    (begun / 'done.part').write_bytes(b'\1' * len(done))
    assert Store.open(begun).pending() == list(range(7))
    (begun / 'done.part').write_bytes(done)
    flipped = bytearray(part)
    flipped[8 * 1250 * 5 + 8 * 3 * run_batch.UNIT] ^= 1  # column 5, the first run of unit 3
    (begun / 'results.part').write_bytes(flipped)
    store = Store.open(begun)
    assert store.pending() == [1, 2, 3, 4, 5]
    execution.fly(store, 1)
    columns = dict(zip(run_batch.COLUMNS, numbers(store.campaign, 3), strict=True))
    mass = store.column('mass_kg')[3 * run_batch.UNIT : 4 * run_batch.UNIT]
    np.testing.assert_array_equal(mass, columns['mass_kg'])


@pytest.mark.timeout(20)
@pytest.mark.parametrize('name', ['results.part', 'done.part', 'versions.yaml', 'scenario.yaml'])
def test_a_pipe_in_a_folder_is_refused_at_once(begun, name):
    (begun / name).unlink()
    os.mkfifo(begun / name)
    with pytest.raises(InputError, match=f'{name}: must be a regular file'):
        Store.open(begun).pending()


def test_damaged_results_are_one_sentence(begun):
    store = Store.open(begun)
    execution.fly(store, 1)
    whole = (begun / 'results.npz').read_bytes()
    for place in (*range(0, 60, 3), *range(len(whole) - 2000, len(whole), 9)):
        spoiled = bytearray(whole)
        spoiled[place] ^= 8
        (begun / 'results.npz').write_bytes(spoiled)
        try:
            store.column(run_batch.COLUMNS[-1])
        except InputError as error:
            assert 'results.npz: ' in str(error)
    np.savez(begun / 'results.npz', **{name: np.zeros(3) for name in run_batch.COLUMNS})
    with pytest.raises(InputError, match='must have 1250 numbers of mass_kg'):
        store.column('mass_kg')


def test_a_disk_that_is_too_small_says_so_at_once(tmp_path, loaded):
    campaign = loaded(runs=1_000_000)
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    ignored = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1 << 20, before[1]))
    try:
        with pytest.raises(InputError, match=r'results.part: cannot reserve 312000000 bytes'):
            Store.create(tmp_path / 'f', campaign)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, ignored)
    Store.create(tmp_path / 'f', loaded())  # nothing is in the way


def test_the_command_flies_repeats_and_refuses(write, tmp_path):
    path, folder = str(write()), str(tmp_path / 'out')
    flown = invoke('campaign', path, '-o', folder)
    assert flown.exit_code == 0, flown.output
    assert ' / 90 ' in flown.output
    again = invoke('campaign', folder, '--run', '7')
    assert again.exit_code == 0, again.output
    assert 'The bits are those of the core and of the campaign.' in again.output
    for arguments, said in (
        ([path, '--run', '90'], '`--run` must be at most 89'),
        ([folder, '--seed', '2'], '`--seed` cannot change'),
        ([folder, '--set', 'mass_kg=9.0'], '`--set` cannot change'),
        ([path, '-o', folder], 'holds a campaign already'),
        ([], 'is needed'),
        ([path, '--export', 'x.yaml'], 'give --run too'),
    ):
        assert said in refused('campaign', *arguments)


def test_progress_counts_no_compiling(monkeypatch, tmp_path):
    """It showed 15 runs/s, and minutes left, while the kernels were compiled."""
    now, out = [100.0], io.StringIO()
    monkeypatch.setattr('rpo.display.time', SimpleNamespace(monotonic=lambda: now[0]))
    monkeypatch.setattr('rpo.display.EVERY_S', -1.0)
    monkeypatch.setattr('rpo.display.PATIENCE_S', 0.01)
    with progress(tmp_path, Console(file=out, width=200)) as show:
        while COMPILING not in out.getvalue():
            time.sleep(0.01)
        for now[0], done in ((130.0, 200), (132.0, 400)):
            show('runs', done, 900, '50.00 % succeed')
    assert out.getvalue().splitlines()[-2:] == [
        'runs 200/900  50.00 % succeed',
        'runs 400/900  50.00 % succeed  100/s  0:05 left',
    ]
