# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Words that `rpo` refuses: each in one sentence, with exit code 2, and nothing is written."""

from __future__ import annotations

import shlex
from pathlib import Path

import pytest
from invoking import refused

from rpo_core import files

# Read strictly: a row whose key stands twice would be lost.
REFUSED = files.load(Path(__file__).with_name('refused.yaml'), dict)


@pytest.mark.parametrize('words', REFUSED['words'])
def test_words_that_are_refused(words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert REFUSED['words'][words] in refused(*shlex.split(words))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize('setting', REFUSED['settings'])
def test_settings_of_a_training_that_are_refused(setting):
    sentence = refused('train', '--show', '--set', 'algorithm=cmaes', '--set', setting)
    assert REFUSED['settings'][setting] in sentence


@pytest.mark.parametrize(('changes', 'said'), REFUSED['campaigns'])
def test_campaigns_that_are_refused(write, changes, said):
    assert said in refused('campaign', write(**changes))


@pytest.mark.parametrize(
    ('command', 'kind', 'name'),
    [('simulate', 'campaign', 'docking'), ('campaign', 'scenario', 'quick')],
)
def test_a_file_of_another_kind_is_refused(command, kind, name):
    assert f'this is a {kind} file; expected a ' in refused(command, files.find(kind, name))


@pytest.mark.parametrize('words', ['prove allround -o', 'campaign paper_test -o'])
def test_a_folder_that_holds_other_things_is_left_alone(words, tmp_path):
    (tmp_path / 'letter.txt').write_text('something')
    assert 'it holds other things' in refused(*words.split(), tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ['letter.txt']


@pytest.mark.parametrize('config', ['family.yaml', 'attitude.yaml'])
def test_a_resumed_training_without_pictures_refuses_them(config, tmp_path):
    (tmp_path / config).touch()
    said = refused('train', '--resume', tmp_path, '--plots')
    assert '`--plots` is for a training of the 30 numbers' in said and '`--resume`' in said
