# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What 0.2 no longer has is refused in one sentence that says what to use instead."""

from __future__ import annotations

import sys

import pytest
from invoking import refused

from rpo_core import files
from rpo_core.files import gone, validation
from rpo_core.files.validation import InputError
from rpo_ros import parameter_rows


def _sentence(subject: str, name: str, monkeypatch, capsys) -> str:
    """Return what is said where a user meets the name."""
    if subject in ('command', 'option'):
        return refused(*name.split())
    if subject == 'executable':
        monkeypatch.setattr(sys, 'argv', [f'/opt/lib/package/{name}'])
        assert gone.executable() == 2
        return capsys.readouterr().err
    if subject == 'parameter':
        return parameter_rows.unknown(name, [])
    section, _, field = name.rpartition('.')
    with pytest.raises(InputError) as caught:
        if subject in files.SHIPPED:
            files.find(subject, name)
        elif subject == 'field':
            validation.mapping(section, {field: 1}, [])
        elif subject == 'schema':
            validation.schema({'schema': name}, 'rpo/scenario/1')
        else:
            validation.choice(subject, name, ['other'])
    return str(caught.value)


@pytest.mark.parametrize('subject', gone.GONE)
def test_what_is_gone_says_what_to_use(subject, monkeypatch, capsys):
    last = ', and 0.1 is the last version that reads it' * (subject in ('field', 'kind', 'schema'))
    for name, instead in gone.GONE[subject].items():
        said = _sentence(subject, name, monkeypatch, capsys)
        assert f'is gone in 0.2{last}; use {instead}' in said and name in said, (subject, name)


def test_a_name_that_never_was_is_not_gone():
    assert gone.answer('controller', 'nobody') == gone.answer('nothing', 'x') == ''
    assert gone.answer('controller', 3) == gone.answer('controller', ['pd']) == ''
