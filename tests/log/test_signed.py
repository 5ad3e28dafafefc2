# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Signed run folders: what a signature covers, and that nothing else is called signed."""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest
from log_parts import Parts
from log_runs import make_run, record, turned

from rpo_core import files
from rpo_core.files.validation import InputError
from rpo_log import signature
from rpo_log.errors import ExitCode, LogError
from rpo_log.format.run import prepare_folder
from rpo_log.read.records import MAX_REST_BYTES
from rpo_log.read.stream import RunReader
from rpo_log.signature import MAX_FILE_BYTES, sign_run
from rpo_log.verify import verify

NONE = '0' * 64
FILES = ('flown.txt', 'metadata.yaml', 'run.mcap', 'run_info.yaml')


@pytest.fixture
def signed(folder, keys) -> Path:
    sign_run(folder, keys / 'me.pem')
    return folder


@pytest.fixture
def trusted(keys) -> Path:
    return keys / 'trusted'


@pytest.fixture(scope='session')
def other(tmp_path_factory) -> Path:
    """Another run, four seconds."""
    return record(tmp_path_factory.mktemp('other') / 'run', 4.0)


@pytest.fixture(scope='session')
def parts(tmp_path_factory) -> Path:
    """A run whose log is in four files."""
    return record(tmp_path_factory.mktemp('parts') / 'run', split_s=1.0)


def link(path: Path, target: Path) -> None:
    path.unlink(missing_ok=True)
    path.symlink_to(target)


def test_sums_are_on_the_disk_before_they_have_their_name_and_not_too_long(folder, monkeypatch):
    size, synced = len((folder / 'SHA256SUMS').read_bytes()), []
    monkeypatch.setattr(signature, 'MAX_SUMS_BYTES', size)
    monkeypatch.setattr(os, 'fsync', synced.append)
    assert signature.write_sums(folder) == signature.read_sums(folder)[0]
    assert len(synced) == 1
    monkeypatch.setattr(signature, 'MAX_SUMS_BYTES', size - 1)
    with pytest.raises(LogError, match='whole lines'):
        signature.read_sums(folder)
    with pytest.raises(LogError, match='too many'):
        signature.write_sums(folder)


def test_what_is_proven_of_a_folder_and_what_is_not_known(folder):
    found = verify(folder)
    assert found.exit_code == ExitCode.OK
    assert found.recomputed == (
        'phases and figures of run_status', 'records beside the messages, indexes and summary',
        'metadata.yaml',
    )  # fmt: skip
    assert found.digested == ('flown.txt', 'run_info.yaml')
    assert any('texts of events' in what for what in found.unknown)
    text = '\n'.join(found.lines())
    attached = make_run(3.0).attachments['controller.yaml']
    assert f'{hashlib.sha256(attached).hexdigest()}  controller.yaml' in text
    assert 'not signed by a trusted key' in text
    first = text.splitlines()[0]
    assert f'{found.sentence()}. Not judged: texts of events; ' in first
    (folder / 'SHA256SUMS').unlink()
    bare, alone = verify(folder), verify(folder / 'run.mcap')
    assert {'flown.txt', 'run_info.yaml'} <= set(bare.unknown)
    assert 'metadata.yaml' not in alone.recomputed
    for found in (bare, alone):
        assert found.exit_code == ExitCode.OK and found.digested == ()
    path = folder / 'metadata.yaml'
    path.write_text(path.read_text().replace('message_count: 31', 'message_count: 30', 1))
    signature.write_sums(folder)
    found = verify(folder)
    assert found.exit_code == ExitCode.INCOMPLETE
    assert 'metadata.yaml is not that of the log; line' in found.sentence()


def written_anew(path: Path) -> bytes:
    """Return the bytes of a log with the same messages in other chunks: it verifies too."""
    aside = path.with_name('aside')
    found = Parts.of(path)
    found.records = [each for each in found.records if each is not None]
    found.write(aside)
    content = aside.read_bytes()
    aside.unlink()
    assert content != path.read_bytes()
    return content


def sign_some(folder: Path, keys: Path, *without: str) -> None:
    """Sign sums that do not list some files, as those may be that somebody writes by hand."""
    lines = (folder / 'SHA256SUMS').read_text().splitlines(keepends=True)
    kept = ''.join(line for line in lines if line.split()[1] not in without).encode()
    (folder / 'SHA256SUMS').write_bytes(kept)
    signature.sign(folder, kept, signature.load_key(keys / 'me.pem'))


@pytest.mark.parametrize(
    'line',
    [
        'nothing', '', f'{NONE}  ../run.mcap', f'{NONE}  /etc/passwd', f'{NONE} run.mcap',
        f'{NONE}  ./run.mcap', f'{NONE}  a//b', f'{NONE}  run.mcap', f'{NONE}  a\r',
        f'\\{NONE}  a', f'{NONE}  a\\nb', f'{NONE}  SHA256SUMS', f'{NONE}  SHA256SUMS.sig',
        f'{"A" * 64}  a',
    ],
)  # fmt: skip
def test_sums_that_are_none(folder, line):
    """The second of run.mcap too: a file is listed once."""
    before = (folder / 'SHA256SUMS').read_bytes()
    (folder / 'SHA256SUMS').write_bytes(before + f'{line}\n'.encode())
    with pytest.raises(LogError, match='SHA256SUMS: line 5 must be a SHA-256'):
        verify(folder)
    for cut_short in (b'', before[:-1]):
        (folder / 'SHA256SUMS').write_bytes(cut_short)
        with pytest.raises(LogError, match='SHA256SUMS: must hold whole lines'):
            verify(folder)


def test_a_signed_run_and_each_way_in_which_it_is_not(folder, keys):
    assert sign_run(folder, keys / 'me.pem').endswith(f'signs 4 files: {", ".join(FILES)}')
    found = verify(folder, keys / 'trusted')
    assert (found.exit_code, found.signed_by) == (ExitCode.OK, 'me.pub.pem')
    assert dict(found.signed) == {name: signature.digest_of(folder / name) for name in FILES}
    lines = list(found.lines())
    assert '; signed by me.pub.pem. Not judged: ' in lines[0]
    at = lines.index('  signed by me.pub.pem (SHA-256):')
    assert [line.split()[-1] for line in lines[at + 1 : at + 5]] == list(FILES)
    assert verify(folder).exit_code == ExitCode.OK and dict(verify(folder).signed) == {}

    other = verify(folder, keys / 'other.pub.pem')
    assert other.exit_code == ExitCode.INCOMPLETE and 'has signed it' in other.sentence()
    (folder / 'run_info.yaml').write_text('run: {end: aborted}\n')
    assert verify(folder, keys / 'trusted').exit_code == ExitCode.DIFFERENT
    signature.write_sums(folder)  # takes the signature away
    assert not (folder / 'SHA256SUMS.sig').exists()
    assert verify(folder, keys / 'trusted').exit_code == ExitCode.INCOMPLETE
    single = verify(folder / 'run.mcap', keys / 'trusted')
    assert single.exit_code == ExitCode.INCOMPLETE


def test_what_came_later_is_signed_too_and_what_changed_is_not(folder, keys):
    (folder / 'report').mkdir()
    (folder / 'report' / 'index.html').write_text('fine')
    assert 'report/index.html' in verify(folder).unknown
    assert 'signs 5 files' in sign_run(folder, keys / 'me.pem')
    assert 'report/index.html' in verify(folder, keys / 'trusted').digested
    (folder / 'report' / 'index.html').write_text('better')
    with pytest.raises(LogError, match=r'cannot be signed: report/index\.html is not the file'):
        sign_run(folder, keys / 'me.pem')


def test_openssl_agrees(folder, keys):
    sign_run(folder, keys / 'me.pem')
    command = ['openssl', 'pkeyutl', '-verify', '-pubin', '-rawin', '-in', 'SHA256SUMS']
    command += ['-sigfile', 'SHA256SUMS.sig', '-inkey', str(keys / 'trusted' / 'me.pub.pem')]
    if shutil.which('openssl') is None:
        pytest.skip('openssl is not installed')
    assert subprocess.run(command, cwd=folder, check=False).returncode == 0


@pytest.mark.parametrize('content', [b'', b'no key', None])
def test_keys_that_are_none(folder, tmp_path, keys, content):
    path = tmp_path / 'bad.pem'
    if content is not None:
        path.write_bytes(content)
    for use in (lambda: sign_run(folder, path), lambda: verify(folder, path)):
        with pytest.raises(InputError, match=r'bad\.pem'):
            use()
    with pytest.raises(InputError, match='must be an Ed25519 private key'):
        sign_run(folder, keys / 'trusted' / 'me.pub.pem')


def test_only_what_is_wholly_listed_is_signed(folder, keys, tmp_path):
    def refused(what: str, path: Path) -> None:
        with pytest.raises(LogError, match=f'cannot be signed: .*{what}'):
            sign_run(folder, keys / 'me.pem')
        assert not (folder / 'SHA256SUMS.sig').exists()
        path.unlink()

    for name in ('report', 'SHA256SUMS.sig.part'):
        link(folder / name, tmp_path / 'else')
        refused(f'{name} is a link', folder / name)
    os.mkfifo(folder / 'pipe')
    refused('pipe is no regular file', folder / 'pipe')
    (folder / 'a\nb').touch()
    refused('has a name with', folder / 'a\nb')
    shutil.move(folder / 'run.mcap', tmp_path / 'log')
    link(folder / 'run.mcap', tmp_path / 'log')
    refused('run.mcap, which SHA256SUMS lists, is a link', folder / 'SHA256SUMS')
    refused('run.mcap is a link', folder / 'run.mcap')
    shutil.move(tmp_path / 'log', folder / 'run.mcap')
    sign_run(folder, keys / 'me.pem')
    assert not (tmp_path / 'else').exists()


READ = ('run.mcap', 'metadata.yaml')


@pytest.mark.parametrize(
    ('names', 'way'),
    [(names, way) for names in (READ[:1], READ[1:], READ) for way in ('kept', 'link')]
    + [(READ, 'exchanged')],
)
def test_what_is_read_and_not_listed_is_not_signed(folder, keys, trusted, other, names, way):
    sign_some(folder, keys, *names)
    for name in names if way == 'link' else ():
        shutil.move(folder / name, folder.parent / name)
        link(folder / name, folder.parent / name)
    for name in names if way == 'exchanged' else ():
        shutil.copy(other / name, folder / name)
    found = verify(folder, trusted)
    assert (found.exit_code, found.signed_by) == (ExitCode.INCOMPLETE, None)
    assert 'signed by me' not in '\n'.join(found.lines())
    assert 'me.pub.pem has not signed ' in found.sentence()
    assert all(name in found.sentence() for name in names)
    alone = verify(folder)
    assert alone.exit_code == ExitCode.OK
    said = next(what for what in alone.unknown if what.startswith('SHA256SUMS does not list'))
    assert all(name in said for name in names)


def cut(data: bytes) -> bytes:
    return data[: len(data) * 3 // 4]


def more(data: bytes) -> bytes:
    return data + bytes(9)


def spoilt(data: bytes) -> bytes:
    """Change a byte in the middle, in a chunk: its checksum does not fit."""
    return turned(data, len(data) // 2)


@pytest.mark.parametrize('name', FILES)
@pytest.mark.parametrize('change', [cut, more, spoilt, lambda _: b'', lambda _: None])
def test_a_signed_file_that_differs_is_a_difference_damaged_or_not(signed, trusted, name, change):
    data = change((signed / name).read_bytes())
    (signed / name).unlink() if data is None else (signed / name).write_bytes(data)
    for found in (verify(signed, trusted), verify(signed)):
        assert found.exit_code == ExitCode.DIFFERENT
        assert f'{name} is missing, which' in found.sentence() or (
            f'{name} is not the file that SHA256SUMS lists' in found.sentence()
        )
        assert found.signed_by is None


def test_a_damaged_log_that_was_signed_so_is_signed_and_not_whole(folder, keys, trusted):
    (folder / 'SHA256SUMS').unlink()
    (folder / 'run.mcap').write_bytes(cut((folder / 'run.mcap').read_bytes()))
    sign_run(folder, keys / 'me.pem')
    found = verify(folder, trusted)
    assert (found.exit_code, found.signed_by) == (ExitCode.INCOMPLETE, 'me.pub.pem')
    assert 'it is cut short' in found.sentence()
    (folder / 'run.mcap').write_bytes(spoilt((folder / 'run.mcap').read_bytes()))
    assert verify(folder, trusted).exit_code == ExitCode.DIFFERENT


@pytest.mark.parametrize('name', ['run.mcap', 'run_0.mcap'])
def test_a_folder_has_one_log(folder, parts, other, tmp_path, keys, name):
    if name == 'run.mcap':
        folder = Path(shutil.copytree(parts, tmp_path / 'parts'))
    sign_run(folder, keys / 'me.pem')
    shutil.copy(other / 'run.mcap', folder / name)
    for use in (verify, RunReader, lambda path: sign_run(path, keys / 'me.pem')):
        with pytest.raises(LogError, match=r'must hold one log, run\.mcap or run_0\.mcap'):
            use(folder)
    prepare_folder(folder, overwrite=True)
    assert not list(folder.glob('run*.mcap'))


class Exchange:
    """Lets a file be another from its n-th opening on; says which of the two was read."""

    def __init__(self, path: Path, true: bytes, first: bytes, second: bytes, at: int) -> None:
        self.path, self.true, self.second, self.at = path, true, second, at
        self.read: list[bool] = []
        path.write_bytes(first)

    def opener(self, real: Callable[[str, int], int]) -> Callable[[str, int], int]:
        def opened(name: str, flags: int) -> int:
            if Path(name) == self.path:
                if len(self.read) == self.at:
                    aside = self.path.with_name('aside')
                    aside.write_bytes(self.second)
                    aside.replace(self.path)
                self.read.append(self.path.read_bytes() == self.true)
            return real(name, flags)

        return opened


@pytest.mark.parametrize('name', ['run.mcap', 'SHA256SUMS'])
@pytest.mark.parametrize('back', [False, True])
def test_what_was_verified_is_what_was_hashed(signed, trusted, monkeypatch, name, back):
    path = signed / name
    true = path.read_bytes()
    if name == 'SHA256SUMS':  # the forged ones fit another file beside
        lines = true.splitlines(keepends=True)
        assert lines[-1].endswith(b'  run_info.yaml\n')
        (signed / 'run_info.yaml').write_text('run: {end: better}\n')
        digest = signature.digest_of(signed / 'run_info.yaml').encode()
        forged = b''.join((*lines[:-1], digest, lines[-1][64:]))
    else:
        forged = written_anew(path)
    real, openings = files._open_if_regular, 0
    for at in range(5):
        exchange = Exchange(path, true, *((forged, true) if back else (true, forged)), at)
        monkeypatch.setattr(files, '_open_if_regular', exchange.opener(real))
        try:
            accepted = verify(signed, trusted).signed_by is not None
        except LogError as error:
            assert 'was changed while it was read' in str(error)
            accepted = False
        openings = max(openings, len(exchange.read))
        assert accepted == (all(exchange.read) and name != 'SHA256SUMS'), (at, exchange.read)
    assert 1 <= openings < 5


def test_what_came_later_is_not_known_whatever_it_is(signed, trusted, tmp_path):
    (signed / 'notes.txt').touch()
    (signed / 'a\nb').touch()
    link(signed / 'link', tmp_path)
    os.mkfifo(signed / 'pipe')
    found = verify(signed, trusted)
    assert (found.exit_code, tuple(found.signed)) == (ExitCode.OK, FILES)
    assert {'notes.txt', 'link is a link', 'pipe is no regular file'} <= set(found.unknown)
    assert any(what.startswith('a\nb has a name') for what in found.unknown)


def test_a_name_that_is_no_text_is_signed(folder, keys, trusted):
    odd = os.fsdecode(b'\xff \xc3\xa9*.txt')
    (folder / odd).write_text('x')
    sign_run(folder, keys / 'me.pem')
    assert odd in verify(folder, trusted).signed
    done = subprocess.run(['sha256sum', '--check', 'SHA256SUMS'], cwd=folder, check=False)
    assert done.returncode == 0


@pytest.mark.parametrize(
    ('name', 'size'), [('flown.txt', MAX_FILE_BYTES + 1), ('run.mcap', MAX_REST_BYTES * 200)]
)
def test_a_file_that_is_too_long_is_no_recorded_one(signed, trusted, name, size):
    os.truncate(signed / name, size)
    found = verify(signed, trusted)
    assert found.exit_code == ExitCode.DIFFERENT
    assert f'{name} is too long to be compared with SHA256SUMS' in found.sentence()
