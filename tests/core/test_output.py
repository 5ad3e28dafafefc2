# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A file is written whole or not at all; a standard output that cannot be written is said."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from rpo_core.files.output import write_aside, write_text
from rpo_core.files.validation import InputError, missing_library
from rpo_log.format.run import write_whole

COMMAND = """
import sys
from rpo_core.files.output import standard_output
from pathlib import Path
sys.argv[0] = '/bin/command'

@standard_output()
def main():
    {}
    sys.exit(1)

main()
"""


def run(shell: str, body: str, **env: str) -> subprocess.CompletedProcess[bytes]:
    """Run a command whose own exit code is 1, by a line of the shell in which it is `"$@"`."""
    words = [sys.executable, '-c', COMMAND.format(body)]
    return subprocess.run(
        ['bash', '-c', f'set -o pipefail; {shell}', '-', *words],
        capture_output=True, env={**os.environ, **env}, timeout=60,
    )  # fmt: skip


CANNOT = 'command: standard output cannot be written: '


@pytest.mark.parametrize(
    ('shell', 'body', 'said'),
    [
        ('"$@" >/dev/full', "print('a')", f'{CANNOT}No space left on device\n'),
        ('"$@" >/dev/full', "print('a', flush=True)", f'{CANNOT}No space left on device\n'),
        ('"$@" >/dev/full', "print('a' * 100_000)", f'{CANNOT}No space left on device\n'),
        (
            '"$@" >/dev/full',
            'import threading; t = threading.Thread(target=print, args=("a",), kwargs={"flush": 1})'
            '; t.start(); t.join()',
            f'{CANNOT}No space left on device\n',
        ),
        ('"$@" | true', "import time; time.sleep(0.5); print('a')", f'{CANNOT}Broken pipe\n'),
        ('"$@" >&-', "print('a')", 'command: standard output is closed\n'),
        (
            '"$@"',
            "open('\\ud800', 'w')",
            'command: a path, or a text that names one, must be in letters of utf-8; got '
            "'\\ud800'\n",
        ),
    ],
)
def test_what_cannot_be_written_is_one_sentence_and_exit_code_2(shell, body, said):
    """A traceback, or exit code 1 or 120, is a requirement that is missed, or nothing known."""
    for unbuffered in '', '1':
        done = run(shell, body, PYTHONUNBUFFERED=unbuffered)
        assert (done.returncode, done.stderr.decode()) == (2, said), unbuffered


def test_letters_that_an_encoding_lacks_are_replaced_and_the_exit_code_is_true():
    done = run('"$@"', "print('≤ 2 ²')", PYTHONIOENCODING='latin-1')
    assert (done.returncode, done.stdout, done.stderr) == (1, b'? 2 \xb2\n', b'')


@pytest.mark.parametrize('shell', ['"$@" 2>/dev/full', '"$@" 2>&-', '"$@" <&- 2>&-'])
def test_without_standard_error_the_exit_code_is_true(shell, tmp_path):
    """A file that is opened then would become standard error."""
    path = tmp_path / 'file'
    body = f"""print('a'); print('b', file=sys.stderr, flush=True)
    with open({str(path)!r}, 'w') as file: print(file.fileno(), file=file)"""
    done = run(shell, body)
    assert (done.returncode, done.stdout) == (1, b'a\n')
    assert int(path.read_text()) > 2


@pytest.mark.every_landing
def test_commands_say_that_they_cannot_write(tmp_path):
    words = {
        'rpo list > /dev/full': 'rpo: standard output cannot be written: No space left on device',
        'rpo export allround --to json -o /dev/full': (
            'rpo: /dev/full: cannot be saved: No space left on device'
        ),
        'ros2 run rpo_sim plant --help > /dev/full': (
            'plant: standard output cannot be written: No space left on device'
        ),
    }
    for line, said in words.items():
        done = subprocess.run(['bash', '-c', line], capture_output=True, text=True, timeout=60)
        assert (done.returncode, done.stderr, done.stdout) == (2, f'{said}\n', '')
    env = {**os.environ, 'PYTHONIOENCODING': 'latin-1', 'RPO_JIT': '0'}
    done = subprocess.run(['rpo', 'simulate', 'quick'], capture_output=True, env=env, timeout=60)
    assert done.returncode == 0 and not done.stderr


def failing(file):
    file.write(b'half')
    raise OSError(28, 'No space left on device')


@pytest.mark.parametrize('before', [None, 'old'])
def test_a_file_that_could_not_be_written_whole_is_not_left(tmp_path, before):
    path = tmp_path / 'file'
    if before:
        path.write_text(before)
    with pytest.raises(InputError, match='cannot be saved: No space left on device'):
        write_aside(path, failing)
    with pytest.raises(UnicodeEncodeError):
        write_text(path, 'x\udcff')
    assert [entry.read_text() for entry in tmp_path.iterdir()] == ([before] if before else [])


def test_what_is_no_file_is_written_as_it_is(tmp_path):
    """A device was about to be replaced by a file."""
    with pytest.raises(InputError, match='/dev/full: cannot be saved: No space'):
        write_text(Path('/dev/full'), 'a')
    assert Path('/dev/full').is_char_device()
    (tmp_path / 'link').symlink_to(tmp_path / 'file')
    write_text(tmp_path / 'link', 'a')
    assert (tmp_path / 'link').is_symlink() and (tmp_path / 'file').read_text() == 'a'


def test_a_draft_of_a_run_folder_is_not_left(tmp_path, monkeypatch):
    def full(_):
        raise OSError(28, 'No space left on device')

    monkeypatch.setattr(os, 'fsync', full)
    with pytest.raises(OSError, match='No space'):
        write_whole(tmp_path / 'SHA256SUMS', b'a')
    assert not list(tmp_path.iterdir())


def test_it_is_said_how_to_install_the_one_library_that_rosdep_has_not(monkeypatch):
    said = missing_library('mcap.reader')
    assert said.startswith('the Python library mcap is missing: `python3 -m pip install ')
    assert missing_library('rosbags.rosbag2').endswith('rosbags` installs it')
    assert missing_library('rclpy') is None and missing_library(None) is None
    for prefix, options in (('/own', 'install mcap'), ('/usr', '--break-system-packages mcap')):
        monkeypatch.setattr(sys, 'prefix', prefix)
        monkeypatch.setattr(sys, 'base_prefix', '/usr')
        assert f'{options}`' in missing_library('mcap')
