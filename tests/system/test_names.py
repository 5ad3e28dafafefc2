# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Names of what ships: listed, completed, found without `env.bash`, and proposed where misspelt."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from invoking import invoke, refused
from typer.testing import CliRunner

from rpo_cli.cli import app
from rpo_core import files

ROOT = Path(__file__).resolve().parents[2]
CAMPAIGNS = ROOT / 'offline_training' / 'campaigns'


@pytest.mark.parametrize(
    ('words', 'said'),
    [
        (('simulate', CAMPAIGNS), 'is a folder'),
        (('simulate', CAMPAIGNS / 'docking.yaml'),
         'this is a campaign file; expected a scenario or a scenario set'),
        (('campaign', files.find('scenario', 'quick')),
         'this is a scenario file; expected a campaign'),
    ],
)  # fmt: skip
def test_a_file_of_another_kind_is_refused(words, said):
    """Misspelt names: tests/training/refused.yaml."""
    assert said in refused(*words)


def test_the_list_has_every_name_once():
    listed = invoke('list').stdout
    first = [line.split()[0] for line in listed.splitlines() if line.startswith('  ')]
    kinds = ('scenario', 'controller', 'attitude_controller', 'campaign')
    shipped = [name for kind in kinds for name in files.shipped(kind)]
    assert sorted(first) == sorted(shipped)
    plans = invoke('list', 'plans').stdout
    assert '  guarded ' in plans and '  quick ' not in plans


@pytest.mark.parametrize(
    ('line', 'names'),
    [
        (
            'rpo simulate paper_t',
            'paper_test paper_test_held paper_test_measured paper_test_phase paper_training',
        ),
        ('rpo evaluate allround pa', 'pace paper_ga'),
        ('rpo safety show gu', 'guarded'),
        ('rpo campaign world_leo_', 'world_leo_ideal world_leo_stuck'),
    ],
)
def test_a_shell_completes_names(line, names):
    words = line.split()
    env = {'_RPO_COMPLETE': 'complete_bash', 'COMP_WORDS': line, 'COMP_CWORD': str(len(words) - 1)}
    done = CliRunner().invoke(app, env=env, prog_name='rpo')
    assert done.stdout.split() == names.split()


def test_the_command_works_in_a_bare_environment(tmp_path):
    """Without `env.bash`: packages and files come from the checkout."""
    bare = {'HOME': os.environ.get('HOME', '/'), 'PATH': '/usr/bin:/bin', 'RPO_JIT': '0'}
    rpo = Path(sys.prefix) / 'bin' / 'rpo'
    for words in (['list', 'campaigns'], ['simulate', 'quick', '--no-fail']):
        done = subprocess.run(
            [rpo, *words], env=bare, cwd=tmp_path, capture_output=True, text=True, timeout=60
        )
        assert done.returncode == 0 and 'allround' in done.stdout, done.stderr
