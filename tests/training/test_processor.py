# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The arithmetic of a search: pinned whatever the processor and the environment say, and told."""

import ast
import hashlib

import numpy as np
import pytest
import yaml
from processes import ANOTHER, python, rpo

from rpo.training import config as configs
from rpo.training import processor
from rpo.training.training import Training

OLD = {'OPENBLAS_CORETYPE': 'Nehalem', 'OPENBLAS_NUM_THREADS': '2'}
"""Kernels of a processor without AVX."""

HOSTILE = {
    **ANOTHER,
    'OPENBLAS_NUM_THREADS': '2',
    'OPENBLAS_L2_SIZE': '128',
    'NPY_DISABLE_CPU_FEATURES': '',
    'NPY_ENABLE_CPU_FEATURES': 'X86_V3',
    'GLIBC_TUNABLES': 'glibc.malloc.check=0:glibc.cpu.hwcaps=-SSE4_2',
}
READ = 'from rpo.training import processor; print(processor.in_use())'
PIN = f'from rpo.training import processor; processor.restart_pinned(); import scipy.linalg; {READ}'

ON_A_WORKER = """
from rpo.training import processor
processor.restart_pinned()
from rpo.montecarlo import pool
with pool.connected('local', 1) as client:
    print(client.submit(processor.in_use).result(40))
"""

SHORT = ['cmaes.evaluations=4800', 'cmaes.population=16', 'cmaes.patience=100000', 'name=short']
SEARCH = ['train', '--scenario', 'quick', '--algorithm', 'cmaes', '--no-plots']
UNPINNED = """
import sys
from pathlib import Path
from rpo.training import config, training
chosen = config.override(config.fitted(config.PRESETS['mission'], 'quick'), sys.argv[2:])
training.Training.create(chosen, Path(sys.argv[1]), 1).run()
"""


def said(done):
    """Return what a process computes with, as it says."""
    assert done.returncode == 0, done.stderr
    return ast.literal_eval(done.stdout)


@pytest.mark.every_landing
def test_a_process_is_pinned_whatever_its_environment_asks_for():
    """Read from the libraries of the process; without a warning of NumPy."""
    free = said(python(READ, environment=OLD))
    assert free['openblas'].startswith('Nehalem, ') and free['pinned'] is False
    for environment in (HOSTILE, OLD):
        done = python(PIN, environment=environment)
        found = said(done)
        assert found['pinned'] is True and done.stderr == ''
        assert found['openblas'] == 'Prescott, 1 thread'
        assert found['libm'].endswith('without FMA')
        features = np.show_config(mode='dicts')['SIMD Extensions']
        assert found['numpy'] == ' '.join(features['baseline'])


@pytest.mark.slow
def test_the_processes_of_a_local_cluster_are_pinned():
    found = said(python(ON_A_WORKER, environment=OLD))
    assert found['pinned'] is True and found['openblas'] == 'Prescott, 1 thread'


def test_each_part_that_is_not_pinned_is_told():
    pins = processor.environment({}, said_features())
    for name, wrong in (
        ('OPENBLAS_CORETYPE', 'Nehalem'),
        ('NPY_DISABLE_CPU_FEATURES', ''),
        ('GLIBC_TUNABLES', ''),
    ):
        assert said(python(READ, environment={**pins, name: wrong}))['pinned'] is False, name
    assert said(python(READ, environment=pins))['pinned'] is True


def said_features():
    """Return the features that this build of NumPy dispatches by."""
    features = np.show_config(mode='dicts')['SIMD Extensions']
    return [*features.get('found', ()), *features.get('not found', ())]


def test_other_tunables_and_variables_stay():
    found = processor.environment({**HOSTILE, 'HOME': '/h'}, ['A', 'B'])
    assert found['GLIBC_TUNABLES'].startswith('glibc.malloc.check=0:glibc.cpu.hwcaps=-AVX2,')
    assert found['GLIBC_TUNABLES'].count('hwcaps') == 1
    assert found['NPY_DISABLE_CPU_FEATURES'] == 'A B' and found['HOME'] == '/h'
    assert 'NPY_ENABLE_CPU_FEATURES' not in found
    assert processor.environment(found, ['A', 'B']) == found


def test_a_search_in_a_process_that_is_not_pinned_says_so(tmp_path, monkeypatch):
    """As in a notebook, where NumPy is loaded before this package."""
    told = {'openblas': 'Zen, 4 threads', 'numpy': 'X', 'libm': 'L', 'pinned': False}
    monkeypatch.setattr(processor, 'in_use', lambda: told)
    processor.warn_unless_pinned.cache_clear()  # it warns once in a process
    settings = ['cmaes.population=4', 'cmaes.evaluations=8', 'algorithm=cmaes']
    chosen = configs.override(configs.fitted(configs.PRESETS['mission'], 'quick'), settings)
    with pytest.warns(UserWarning, match='forms that its processor chose, OpenBLAS Zen, 4 threads'):
        found = Training.create(chosen, tmp_path / 'run', 1).run()
    assert found.provenance['arithmetic'] == told


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_the_pin_gives_the_same_search_on_another_processor(tmp_path):
    """300 generations: without the pin their chromosomes differ, with it they are the same bits."""

    def digest(name):
        saved = np.load(tmp_path / name / 'checkpoint.npz')
        assert len(saved['digests']) >= 300
        return hashlib.sha256(saved['digests'].tobytes() + saved['marks'].tobytes()).hexdigest()

    for name, environment in (('another', ANOTHER), ('old', OLD)):
        done = python(UNPINNED, tmp_path / name, *SHORT, environment=environment, limit_s=400)
        assert done.returncode == 0, done.stderr
        assert 'UserWarning' in done.stderr
        made = yaml.safe_load((tmp_path / name / 'short.yaml').read_text())['provenance']
        assert made['arithmetic']['pinned'] is False
    assert digest('another') != digest('old')

    settings = [word for setting in SHORT for word in ('--set', setting)]
    files = []
    for name, environment in (('a', HOSTILE), ('b', OLD)):
        done = rpo(*SEARCH, *settings, '-o', tmp_path / name, environment=environment, limit_s=400)
        assert done.returncode == 1 and 'UserWarning' not in done.stderr, done.stderr
        files.append((tmp_path / name / 'short.yaml').read_bytes())
    assert digest('a') == digest('b')
    assert files[0] == files[1]
    assert yaml.safe_load(files[0])['provenance']['arithmetic']['pinned'] is True
