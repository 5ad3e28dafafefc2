# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A campaign on a dask cluster of real processes: lost workers, lost scheduler, the same bytes."""

import os
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from contextlib import contextmanager

import dask
import numpy as np
import pytest
from invoking import invoke
from processes import stopped

from rpo.montecarlo import config, execution, pool
from rpo.montecarlo.store import Store
from rpo_core.files.validation import InputError

CAMPAIGN = """
schema: rpo/campaign/1
name: cluster
scenario: quick
controller: handmade
runs: 12000
dispersions:
  initial_position_m: {uniform: 5.0}
  mass_share: {normal: 0.03}
  navigation_position_noise_m: {white: 0.01}
success: {hold_error_per_axis_m: 100.0}
"""


def _start(*arguments):
    return subprocess.Popen(
        [sys.executable, '-m', 'distributed.cli.' + arguments[0], *arguments[1:]],
        stderr=subprocess.PIPE,
        text=True,
    )


def _drain(process):
    threading.Thread(target=process.stderr.read, daemon=True).start()


LOCAL = ('--host', '127.0.0.1', '--no-dashboard', '--dashboard-address', '127.0.0.1:0')
"""Options of docs/campaigns.md; without the last an HTTP port is open to all."""


@contextmanager
def cluster(workers, folder, *tls):
    """Start a scheduler and workers as processes; yield its address and all of them.

    tls : options of dask, for a cluster that encrypts
    """
    protocol = 'tls' if tls else 'tcp'
    scheduler = _start('dask_scheduler', *LOCAL, '--port', '0', '--protocol', protocol, *tls)
    processes = [scheduler]
    try:
        address = next(
            found.group()
            for line in scheduler.stderr
            if (found := re.search(rf'{protocol}://127.0.0.1:\d+', line))
        )
        _drain(scheduler)
        for _ in range(workers):
            worker = _start(
                *('dask_worker', address, *LOCAL, *tls, '--nthreads', '1', '--no-nanny'),
                *('--local-directory', str(folder)),
            )
            processes.append(worker)
            _drain(worker)
        yield address, processes
    finally:
        for process in processes:
            process.kill()
            process.wait()


@pytest.fixture
def campaign(tmp_path):
    path = tmp_path / 'campaign.yaml'
    path.write_text(CAMPAIGN)
    return config.load(path)


@pytest.fixture(scope='module')
def client():
    """A cluster of two threads of this process."""
    from distributed import Client

    with (
        dask.config.set({'distributed.worker.daemon': False}),
        Client(processes=False, n_workers=1, threads_per_worker=2, dashboard_address=None) as made,
    ):
        yield made


@pytest.fixture
def connected(client, monkeypatch):
    """Let every address be that cluster; return what was asked for."""
    asked = []

    @contextmanager
    def connect(address, workers):
        asked.append((address, workers))
        yield client

    monkeypatch.setattr(pool, 'connected', connect)
    return asked


def failing(kind):
    raise kind('as planted')


def test_calls_come_in_with_their_numbers_a_few_at_a_time(client, monkeypatch):
    begun = []

    def calls():
        for number in range(20):
            begun.append(number)
            yield number, (number, 2)

    found = {}
    for number, result in pool.results(client, pow, calls()):
        found[number] = result
        assert len(begun) <= min(20, len(found) + 2 * pool.AHEAD)
    assert found == {number: number**2 for number in range(20)}
    for kind, said in (
        (ImportError, 'a worker of .* cannot import the work: as planted'),
        (OSError, 'cluster inproc://.* was lost; finished work is saved, go on with --resume'),
    ):
        with pytest.raises(InputError, match=said):
            list(pool.results(client, failing, [(0, (kind,))]))
    here = pool.versions()
    monkeypatch.setattr(pool, 'versions', lambda: dict(here, numpy='1.0') if begun else here)
    monkeypatch.setattr(pool, '_call', lambda function, *_: (here, function(*_)))
    with pytest.raises(InputError, match=r'a worker has .* the same bits need .*1\.0'):
        list(pool.results(client, pow, [(0, (2, 2))]))


def test_a_cluster_gives_the_results_of_one_thread(connected, campaign):
    pending = [1, 0]
    ours = dict(execution.results_of(campaign, pending, 2, 'there'))
    alone = dict(execution.results_of(campaign, pending, 1, ''))
    assert sorted(ours) == [0, 1]
    for unit in pending:
        np.testing.assert_array_equal(ours[unit], alone[unit])
    assert connected == [('there', 2)]


class Work:
    """A campaign in folders; `came` counts the units that have come in."""

    def __init__(self, campaign):
        self.campaign, self.came = campaign, 0

    def run(self, folder, address='', after=lambda came: None):
        """Begin a folder, or go on with it; `after` gets how many units have come in."""
        self.came = 0

        def count(*_):
            self.came += 1
            after(self.came)

        store = Store.open(folder) if folder.exists() else Store.create(folder, self.campaign)
        execution.fly(store, 2, address, count)


def contents(folder):
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


@pytest.fixture
def work(campaign):
    return Work(campaign)


@pytest.fixture
def alone(work, tmp_path):
    """How many results come in on threads, and what the folder then holds."""
    work.run(tmp_path / 'alone')
    return work.came, contents(tmp_path / 'alone')


@pytest.mark.slow
def test_a_killed_worker_changes_no_byte(work, alone, tmp_path):
    with cluster(2, tmp_path) as (address, (_, first, second)):

        def kill(came):
            if came == 5:
                first.send_signal(signal.SIGKILL)

        work.run(tmp_path / 'f', address, kill)
        assert first.wait() == -signal.SIGKILL
        assert second.poll() is None
    assert (work.came, contents(tmp_path / 'f')) == alone


@pytest.mark.slow
def test_a_killed_scheduler_is_one_sentence_and_the_work_goes_on_elsewhere(work, alone, tmp_path):
    with cluster(1, tmp_path) as (address, (scheduler, _)):

        def kill(came):
            if came == 5:
                scheduler.send_signal(signal.SIGKILL)

        with pytest.raises(InputError, match=f'cluster {address} was lost.*--resume'):
            work.run(tmp_path / 'f', address, kill)
    saved = work.came
    work.run(tmp_path / 'f')
    assert saved >= 5 and (saved + work.came, contents(tmp_path / 'f')) == alone


@pytest.mark.slow
@pytest.mark.skipif(shutil.which('openssl') is None, reason='openssl is not installed')
def test_with_tls_only_who_has_the_key_takes_part(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'campaign.yaml').write_text(CAMPAIGN.replace('12000', '600'))
    campaign = config.load('campaign.yaml')
    subprocess.run(
        ['openssl', 'req', '-x509', '-newkey', 'ed25519', '-nodes', '-days', '1', '-subj',
         '/CN=rpo', '-keyout', 'rpo.key', '-out', 'rpo.pem'],
        check=True, capture_output=True,
    )  # fmt: skip
    files = {'ca-file': 'rpo.pem', 'cert': 'rpo.pem', 'key': 'rpo.key'}
    options = [part for name, path in files.items() for part in (f'--tls-{name}', path)]
    names = {'ca-file': 'rpo.pem', 'client.cert': 'rpo.pem', 'client.key': 'rpo.key'}
    own = {f'distributed.comm.tls.{name}': path for name, path in names.items()}
    execution.fly(Store.create(tmp_path / 'alone', campaign))
    monkeypatch.setattr(pool, 'CONNECT_S', 1)
    with cluster(1, tmp_path, *options) as (address, (scheduler, _)):
        listening = subprocess.run(['ss', '-ltnpH'], capture_output=True, text=True).stdout
        mine = [line for line in listening.splitlines() if f'pid={scheduler.pid},' in line]
        assert all('127.0.0.1:' in line for line in mine), mine
        with pytest.raises(InputError, match='needs the certificates in the configuration of dask'):
            execution.fly(Store.create(tmp_path / 'without', campaign), address=address)
        with pytest.raises(InputError, match='scheduler that answers'):
            plain = address.replace('tls', 'tcp')
            execution.fly(Store.create(tmp_path / 'plain', campaign), address=plain)
        monkeypatch.setattr(pool, 'CONNECT_S', 120)  # a handshake on a busy machine took above 10 s
        with dask.config.set(own):
            execution.fly(Store.create(tmp_path / 'together', campaign), address=address)
    alone, together = (
        (tmp_path / run / 'results.npz').read_bytes() for run in ('alone', 'together')
    )
    assert alone == together


@pytest.mark.parametrize(
    'address', ['tcp://127.0.0.1:9', 'nowhere', 'http://127.0.0.1:9', 'tls://127.0.0.1:9']
)
def test_a_cluster_that_does_not_answer_is_one_sentence(address, tmp_path, monkeypatch):
    monkeypatch.setattr(pool, 'CONNECT_S', 1)
    path = tmp_path / 'campaign.yaml'
    path.write_text(CAMPAIGN)
    done = invoke('campaign', path, '-o', tmp_path / 'campaign', '--cluster', address)
    assert done.exit_code == 2 and f'got {address}' in done.stderr.splitlines()[-1]
    assert 'Traceback' not in done.output


def test_without_dask_it_says_what_to_install(campaign, tmp_path, monkeypatch):
    monkeypatch.setattr(pool, 'find_spec', lambda name: None)
    with pytest.raises(InputError, match='make setup LAYERS=campaign'):
        execution.fly(Store.create(tmp_path / 'f', campaign), address='local')


@pytest.mark.slow
def test_ctrl_c_on_a_local_cluster_leaves_no_traceback_and_no_process(tmp_path):
    path, folder = tmp_path / 'campaign.yaml', tmp_path / 'f'
    path.write_text(CAMPAIGN.replace('12000', '1000000'))
    process, errors = stopped(path, folder, signal.SIGINT, '--cluster', 'local', '--workers', '2')
    assert process.returncode == 130, errors
    assert 'Traceback' not in errors
    assert f'Go on with: rpo campaign --resume {folder}' in errors
    with pytest.raises(ProcessLookupError):  # the last of them need a moment
        for _ in range(100):
            os.killpg(process.pid, 0)
            time.sleep(0.1)
