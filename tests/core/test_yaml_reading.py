# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Reading files: names, paths, bytes, and the YAML that is refused before it is understood."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rpo_core import files
from rpo_core.control import controller
from rpo_core.files.validation import InputError, printable
from rpo_core.scenario import scenario

LOADERS = {'scenario': scenario.load, 'controller': controller.load_controller}


def refusal(content):
    with pytest.raises(InputError) as error:
        files.parse_yaml(content)
    return str(error.value)


@pytest.mark.parametrize('kind', LOADERS)
def test_what_names_no_file_is_refused(kind):
    """However long it is; an unknown name lists the known ones."""
    known = ', '.join(files.shipped(kind))
    one_of, path = f'`{kind}` must be one of {known}, or a path', ('no file', 'is a folder')
    for said, names in (
        ((one_of,), ['nosuch', 'Paper_Test', 'handmade ', 'x' * 5000, '..', 'a\0b']),
        ((f'`{kind}` must be a shipped name or a path; got',), ['', '   ']),
        (path, ['./nosuch', 'nosuch.yaml', '/', '/dev/null', '/dev/zero', 'a\0b.yaml']),
        (path, ['~nosuchuser/mine.yaml', f'/{"x" * 5000}.yaml', '/etc/passwd/mine.yaml']),
    ):
        for name in names:
            with pytest.raises(InputError) as error:
                LOADERS[kind](name)
            sentence = str(error.value)
            assert any(words in sentence for words in said) and sentence.isprintable(), name
            assert len(sentence) < len(known) + 130


@pytest.mark.parametrize('kind', LOADERS)
def test_files_that_are_no_text_are_refused(kind, tmp_path):
    path = tmp_path / 'mine.yaml'
    for content, words in (
        (b'name: \xff\xfe', 'must be a UTF-8 text'),
        ('name: Müller'.encode('latin-1'), 'must be a UTF-8 text'),
        ('name: mine'.encode('utf-16'), 'must be a UTF-8 text'),
        (os.urandom(1000) + b'\xff', 'must be a UTF-8 text'),
        (b'\0' * 1000, 'special characters are not allowed'),
        (b'', 'must be a mapping'),
        (os.urandom(1 << 16) * 160, 'at most 262144 bytes; it is larger'),
        (b'[' * (10 << 20), 'at most 262144 bytes; it is larger'),
    ):
        path.write_bytes(content)
        with pytest.raises(InputError) as error:
            LOADERS[kind](path)
        assert str(error.value).startswith(f'{path}: ') and words in str(error.value)


def test_a_file_that_may_not_be_read_is_refused(monkeypatch, tmp_path):
    path = tmp_path / 'mine.yaml'
    path.write_text('a: 1')

    def forbidden(*_, **__):
        raise PermissionError(13, 'Permission denied')

    monkeypatch.setattr(os, 'open', forbidden)
    with pytest.raises(InputError, match=r'mine\.yaml: Permission denied'):
        scenario.load(path)


@pytest.mark.timeout(10)
def test_what_is_no_regular_file_is_refused_at_once(tmp_path):
    """A pipe without a writer would wait for ever."""
    os.mkfifo(tmp_path / 'pipe.yaml')
    for path in (tmp_path / 'pipe.yaml', Path('/dev/zero')):
        with pytest.raises(InputError, match='must be a regular file, not a pipe'):
            files.read_text(path)
    with pytest.raises(InputError, match='Is a directory'):
        files.read_text(tmp_path)


def test_a_path_may_be_given_in_every_form(tmp_path, monkeypatch, paper_test):
    content = files.find('scenario', 'paper_test').read_text()
    (tmp_path / 'mine.yaml').write_text(content)
    (tmp_path / 'mine').write_text(content)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv('HOME', str(tmp_path))
    forms = ['mine.yaml', './mine', '~/mine.yaml', str(tmp_path / 'mine'), tmp_path / 'mine.yaml']
    assert all(scenario.load(form) == paper_test for form in forms)


@pytest.mark.parametrize(
    ('content', 'words'),
    [
        ('a: 1\nb: 2\na: 3', 'line 3: `a` is given twice'),
        ('a: {b: 1, "b": 2}', 'line 1: `b` is given twice'),
        ('a: &x [1]\nb: *x', 'line 2: aliases (*name) are not allowed'),
        ('a: *x', 'line 1: aliases (*name) are not allowed'),
        ('<<: {a: 1}', 'line 1: not valid YAML'),
        ('1: a', 'line 1: a key must be a text; got 1'),
        ('yes: a', 'line 1: a key must be a text; got True'),
        ('? [a]\n: b', "line 1: a key must be a text; got ['a']"),
        ('a: [1, 2', 'line 1: not valid YAML'),
        ('a: b: c', 'line 1: not valid YAML: mapping values are not allowed here'),
        ('a: 1\n  b: 2', 'line 2: not valid YAML'),
        ('a: 1\n\tb: 2', 'line 2: not valid YAML'),
        ('a: 1\n---\nb: 2', 'line 2: not valid YAML'),
        ('a: "\\U00110000"', 'not valid YAML'),
        ('a: 2026-02-30', 'not valid YAML: day is out of range'),
        (f'a: {"9" * 5000}', 'not valid YAML'),
        ('a: 010', "line 1: a number must be decimal; got '010'"),
        ('a: 0x10', "line 1: a number must be decimal; got '0x10'"),
        ('a: 0b11', "line 1: a number must be decimal; got '0b11'"),
        ('a: 1:30', "line 1: a number must be decimal; got '1:30'"),
        ('a: 1:30.5', "line 1: a number must be decimal; got '1:30.5'"),
        ('a: !!python/object/apply:os.getcwd []', 'line 1: tags (!name) are not allowed'),
        ('a: !!timestamp noon', 'line 1: tags (!name) are not allowed'),
        ('a: !!int ""', 'line 1: tags (!name) are not allowed'),
        ('a: !mine 1', 'line 1: tags (!name) are not allowed'),
        ('%YAML 9.9\n---\na: 1', 'line 1: not valid YAML'),
    ],
)
def test_yaml_is_read_strictly(content, words):
    assert words in refusal(content)


@pytest.mark.parametrize('opening', ['[', '{', '- ', '? ', '[a: ', '{a: '])
@pytest.mark.timeout(10)
def test_deep_nesting_is_refused_at_once(opening):
    """Plain PyYAML takes minutes, or the stack, for a file of brackets."""
    message = refusal(opening * (files.MAX_BYTES // len(opening)))
    assert 'must be nested at most 20 deep' in message


def test_decimal_numbers_are_read():
    content = 'a: [0, -7, +3, 1_000, 0.5, -0.25, 1.0e-3, 1.0e+3, .5, 5., -0, 0.0]'
    expected = [0, -7, 3, 1000, 0.5, -0.25, 1e-3, 1e3, 0.5, 5.0, 0, 0.0]
    assert files.parse_yaml(content) == {'a': expected}


def test_nesting_up_to_the_limit_is_read():
    depth = files.MAX_DEPTH
    assert files.parse_yaml('[' * depth + ']' * depth) is not None
    assert 'nested' in refusal('[' * (depth + 1) + ']' * (depth + 1))


@given(
    st.text() | st.lists(st.sampled_from('\x1b[2J\n\r\t\x07‮\ud800\x9b]0;'), max_size=9).map(''.join)
)
def test_an_error_is_one_printable_line_whatever_it_quotes(words):
    for shown in (printable(words), str(InputError(words)), str(InputError(InputError(words)))):
        assert shown.isprintable()
        assert shown == words or not words.isprintable()


def test_a_long_text_is_cut():
    assert printable('a\x1b[2Jb\n') == r'a\x1b[2Jb\n'
    assert printable('x' * 200_000) == 'x' * 1997 + '...'
    assert printable('abcdef', 5) == 'ab...'
