# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Runs under attack: what `rpo verify` says of changed copies of a run folder.

Each case takes the records of a run's files apart, changes some of them, puts them together again
with checksums that fit, and verifies the result. It fails if the changed folder verifies, proves
what the true one proves, rests on the same files, and a command shows something else of what is
proven.

A signed run is attacked by lies of someone without the key. Such a forger has a key of his own,
another run that the same key signed, and every file of the folder. He changes files, exchanges the
log, adds a second one, edits the digests and the signature. A case fails if the folder verifies or
is called signed, or if a signed file that differs is not exit code 1.
"""

from __future__ import annotations

import hashlib
import os
import random
import re
import shutil
import stat
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.serialization import (
    Encoding,
    NoEncryption,
    PrivateFormat,
    PublicFormat,
)
from mcap.records import Attachment, Channel, Chunk, Header, McapRecord, Metadata, Schema
from mcap.writer import CompressionType, Writer

from rpo_core.files.validation import InputError
from rpo_log import signature
from rpo_log.signature import sign_run
from rpo_log.tools.info import inspect
from rpo_log.verify import Verification, verify
from rpo_mcap.errors import ExitCode
from rpo_mcap.format.run import DECISIONS_FILE, METADATA_FILE, SIGNATURE_FILE, SUMS_FILE
from rpo_mcap.read.records import FileRecords, RawMessage, message_at
from rpo_mcap.read.run_log import read_decisions, read_run
from tools.attack.cases import NOT_WRITTEN, Case
from tools.attack.edits import displace, other, reordered, spoil, spoilt


@dataclass
class Parts:
    """An MCAP file taken apart: its records, and where each chunk of messages ends."""

    records: list[McapRecord | RawMessage | None]
    compression: CompressionType = CompressionType.ZSTD

    @classmethod
    def of(cls, path: Path) -> Parts:
        """Take a file apart; None stands for the end of a chunk."""
        found: list[McapRecord | RawMessage | None] = []
        records = FileRecords(path)
        for record in records:
            if isinstance(record, Chunk):
                data = records.content_of(record)
                inner = records.messages_in(data, found.append)
                found += [message_at(data, at) for at in inner]
                found.append(None)
            elif isinstance(record, Header | Metadata | Attachment):
                found.append(record)
        return cls(found)

    def write(self, path: Path) -> None:
        """Put the file together again, all checksums and indexes right."""
        with path.open('wb') as stream:
            writer = Writer(
                stream, chunk_size=1 << 40, compression=self.compression, enable_data_crcs=True
            )
            head = next((r for r in self.records if isinstance(r, Header)), Header('', ''))
            writer.start(profile=head.profile, library=head.library)
            schemas: dict[int, int] = {}
            channels: dict[int, int] = {}
            for record in self.records:
                _add(writer, record, schemas, channels)
            writer.finish()


def _add(
    writer: Writer,
    record: McapRecord | RawMessage | None,
    schemas: dict[int, int],
    channels: dict[int, int],
) -> None:
    if record is None:
        writer.flush()
    elif isinstance(record, Metadata):
        writer.add_metadata(record.name, record.metadata)
    elif isinstance(record, Attachment):
        writer.add_attachment(
            record.create_time, record.log_time, record.name, record.media_type, record.data
        )
    elif isinstance(record, Schema):
        schemas[record.id] = writer.register_schema(record.name, record.encoding, record.data)
    elif isinstance(record, Channel):
        channels[record.id] = writer.register_channel(
            record.topic, record.message_encoding, schemas.get(record.schema_id, 0), record.metadata
        )
    elif isinstance(record, RawMessage):
        writer.add_message(
            channels.get(record.channel, 0), record.log_ns, record.data, record.publish_ns,
            record.sequence,
        )  # fmt: skip


def _edited(rng: random.Random, record: Any) -> Any:
    """Return a record with another value in one of its fields."""
    plain = record._asdict() if isinstance(record, RawMessage) else vars(record)
    name = rng.choice([name for name in plain if name != 'crc'])
    changed = {name: other(rng, plain[name])}
    return (
        record._replace(**changed) if isinstance(record, RawMessage) else replace(record, **changed)
    )


def _change_records(rng: random.Random, path: Path) -> str:
    """Change records of a file, the rare ones as often as messages, or their order."""
    parts, edits = Parts.of(path), []
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        edits.append(rng.choice(('edited', 'reordered')))
        if edits[-1] == 'reordered':
            places = reordered(rng, len(parts.records))
            parts.records = [parts.records[at] for at in places]
            continue
        kinds = {type(record) for record in parts.records if record is not None}
        kind = rng.choice(sorted(kinds, key=lambda kind: kind.__name__))
        at = rng.choice([i for i, record in enumerate(parts.records) if type(record) is kind])
        parts.records[at] = _edited(rng, parts.records[at])
    parts.compression = rng.choice((CompressionType.ZSTD,) * 8 + tuple(CompressionType))
    parts.write(path)
    return f'records {"+".join(sorted(set(edits)))}'


STRAY = ('run_1.mcap', 'run_².mcap', 'notes\n.txt', 'x.mcap', 'run_0.mcap')
"""Names of files that are put beside those of a run."""


def change(rng: random.Random, folder: Path) -> tuple[Path, str]:
    """Change a file of a run folder; return which, and what kind of change it was."""
    paths = sorted(path for path in folder.iterdir() if path.is_file())
    weights = [12 if p.name == 'run.mcap' else 4 if p.suffix == '.mcap' else 1 for p in paths]
    path, way = rng.choices(paths, weights)[0], rng.random()
    if path.suffix == '.mcap' and way < 0.8:
        return path, _change_records(rng, path)
    return path, spoil(rng, path) if way < 0.95 else displace(rng, path, STRAY)


def mutate(rng: random.Random, folder: Path) -> str:
    """Change a run folder, and perhaps its digests; return what kind of change it was."""
    path, kind = change(rng, folder)
    digests = rng.choice(('kept', 'kept', 'forged', 'forged', 'removed'))
    if path.name != SUMS_FILE and digests == 'forged' and not kind.endswith('sparse'):
        signature.write_sums(folder)
    elif digests == 'removed':
        (folder / SUMS_FILE).unlink(missing_ok=True)
    return f'{path.name}: {kind}; digests {digests}'


_READ = re.compile(r'run(_[0-9]+)?\.mcap|decisions\.mcap|metadata\.yaml')
_MOST_BYTES = 1 << 28


@dataclass(frozen=True)
class Forger:
    """What a forger has.

    key : file of a private key that nobody trusts
    other : folder of another run, signed with the key that is trusted
    """

    key: Path
    other: Path


Lie = Callable[[random.Random, Path, Forger], str]


def evidence(folder: Path, names: Iterable[str]) -> dict[str, object]:
    """Return what a folder shows of some files, of its digests and of what is read as a log.

    A file is its bytes; a link, a pipe, a folder is only what it is. Of the digests and their
    signature only the bytes count: they prove themselves.
    """
    read = [entry.name for entry in folder.iterdir() if _READ.fullmatch(entry.name)]
    found = {name: _shown(folder / name) for name in {*names, *read}}
    return found | {name: _shown((folder / name).resolve()) for name in (SUMS_FILE, SIGNATURE_FILE)}


def _shown(path: Path) -> object:
    try:
        found = path.lstat()
    except OSError:
        return 'nothing'
    if not stat.S_ISREG(found.st_mode) or found.st_size > _MOST_BYTES:
        return stat.S_IFMT(found.st_mode), found.st_size
    linked = any(parent.is_symlink() for parent in path.parents[:-1])
    return linked, hashlib.sha256(path.read_bytes()).digest()


def lie(rng: random.Random, folder: Path, forger: Forger) -> str:
    """Change a signed folder, then its digests and signature; return what kind of change it was."""
    lies: list[str] = []
    for _ in range(rng.choice((1, 1, 1, 2))):
        lies.append(rng.choice(LIES)(rng, folder, forger))
        if _has_a_long_file(folder.parent):  # which no later lie could read or copy
            return '; '.join((*lies, rng.choice((_kept, _remove))(rng, folder, forger)))
    return '; '.join((*lies, rng.choice(ENDS)(rng, folder, forger)))


def _has_a_long_file(place: Path) -> bool:
    files = (path for path in place.rglob('*') if path.is_file())
    return any(path.stat().st_size > _MOST_BYTES for path in files)


def _change(rng: random.Random, folder: Path, forger: Forger) -> str:
    path, kind = change(rng, folder)
    return f'{path.name}: {kind}'


def _put(rng: random.Random, source: Path, target: Path) -> str:
    """Let a file take the place of another: its bytes, or a link to them."""
    if target.is_dir() and not target.is_symlink():
        shutil.rmtree(target)
    target.unlink(missing_ok=True)
    way = rng.choice(('copy', 'copy', 'link', 'hard link', 'link to a copy'))
    if way == 'copy':
        shutil.copy(source, target)
    elif way == 'link':
        target.symlink_to(source.resolve())
    elif way == 'hard link':
        os.link(source.resolve(), target)
    else:
        aside = target.with_name(f'{target.stem}.old')
        shutil.copy(source, aside)
        target.symlink_to(aside.name)
    return way


def _exchange(rng: random.Random, folder: Path, forger: Forger) -> str:
    """Put files of the other run in the place of those of this one; most often the log."""
    there = sorted(path.name for path in forger.other.glob('*.*') if path.name != SIGNATURE_FILE)
    logs = [name for name in there if name.startswith('run') and name.endswith('.mcap')]
    chosen = rng.choice((logs, logs, [*logs, METADATA_FILE, DECISIONS_FILE], [rng.choice(there)]))
    ways = {_put(rng, forger.other / name, folder / name) for name in chosen if name in there}
    return f'exchange {"+".join(chosen)} by {"+".join(sorted(ways))}'


def _stray(rng: random.Random, folder: Path, forger: Forger) -> str:
    """Put a log, or another file that is read, beside those of the run."""
    logs = sorted(forger.other.glob('run*.mcap'))
    parts = len(list(folder.glob('run_*.mcap')))
    names = ('run.mcap', 'run_0.mcap', f'run_{parts}.mcap', DECISIONS_FILE, METADATA_FILE)
    name = rng.choice(names)
    if name in (DECISIONS_FILE, METADATA_FILE):
        return f'stray {name} by {_put(rng, forger.other / name, folder / name)}'
    if not (folder / name).exists() or rng.random() < 0.5:
        return f'stray {name} by {_put(rng, rng.choice(logs), folder / name)}'
    free = rng.choice(('run.mcap', 'run_0.mcap', 'old/run.mcap', 'run.mcap.old'))
    (folder / free).parent.mkdir(exist_ok=True)
    (folder / name).rename(folder / free)
    return f'{name} moved to {free}; {_put(rng, rng.choice(logs), folder / name)} in its place'


def _link(rng: random.Random, folder: Path, forger: Forger) -> str:
    """Move a file, or a folder, away; leave a link, to the same bytes or to others."""
    path = rng.choice(sorted(path for path in folder.iterdir() if not path.is_symlink()))
    aside = folder.parent / f'aside-{path.name}'
    if aside.is_dir():
        shutil.rmtree(aside)
    path.rename(aside)
    path.symlink_to(aside)
    if aside.is_dir() and rng.random() < 0.5:
        for found in aside.rglob('*.*'):
            found.write_bytes(b'better')
    return f'{path.name} is a link'


def _edit_sums(rng: random.Random, folder: Path, forger: Forger) -> str:
    """Change a line of the digests, or how it is written."""
    path = folder / SUMS_FILE
    lines = path.read_text(errors='surrogateescape').splitlines() or ['']
    at = rng.randrange(len(lines))
    digest, _, name = lines[at].partition('  ')
    edits: dict[str, list[str]] = {
        'dropped': [],
        'twice': [lines[at], lines[at]],
        'twice, another digest': [lines[at], f'{"0" * 64}  {name}'],
        'of another name': [f'{digest}  {name}.old'],
        'upper case': [f'{digest.upper()}  {name}'],
        'CRLF': [f'{lines[at]}\r'],
        'a path': [f'{digest}  {rng.choice(("./", "../", "/", "report/../", "//"))}{name}'],
        'absolute': [f'{digest}  {(folder / name).absolute()}'],
        'binary mark': [f'{digest} *{name}'],
        'escaped': [f'\\{digest}  {name}'],
        'space': [f' {lines[at]}'],
        'comment': [f'# {lines[at]}'],
        'of itself': [lines[at], f'{digest}  {SUMS_FILE}'],
        'moved': [],
    }
    way = rng.choice(sorted(edits))
    changed = [*lines[:at], *edits[way], *lines[at + 1 :], *([lines[at]] if way == 'moved' else [])]
    text = '\n'.join(changed) + rng.choice(('\n',) * 6 + ('', '\n\n', '\0\n'))
    path.write_bytes(text.encode(errors='surrogateescape'))
    return f'a line {way}'


def _edit_signature(rng: random.Random, folder: Path, forger: Forger) -> str:
    path = folder / SIGNATURE_FILE
    data = path.read_bytes() or b'\0'
    ways = spoilt(rng, data), data + b'\0', b'', bytes(64), data.hex().encode(), data * 2
    path.write_bytes(rng.choice(ways))
    return 'another signature'


def _forge(rng: random.Random, folder: Path, forger: Forger) -> str:
    """Write digests that fit, and keep the signature, drop it, or sign with another key."""
    path = folder / SIGNATURE_FILE
    kept = path.read_bytes() if path.is_file() else b''
    fitting = signature.write_sums(folder)
    way = rng.choice(('old', 'no', "the forger's"))
    if way == 'old':
        path.write_bytes(kept)
    elif way != 'no':
        signature.sign(folder, fitting, signature.load_key(forger.key))
    return f'digests forged, {way} signature'


def _replay(rng: random.Random, folder: Path, forger: Forger) -> str:
    """Take digests and signature from the other run, or one of them."""
    names = rng.choice(((SUMS_FILE, SIGNATURE_FILE), (SUMS_FILE,), (SIGNATURE_FILE,)))
    ways = {_put(rng, forger.other / name, folder / name) for name in names}
    return f'{"+".join(names)} of the other run by {"+".join(sorted(ways))}'


def _remove(rng: random.Random, folder: Path, forger: Forger) -> str:
    name = rng.choice((SUMS_FILE, SIGNATURE_FILE))
    (folder / name).unlink(missing_ok=True)
    return f'no {name}'


def _kept(rng: random.Random, folder: Path, forger: Forger) -> str:
    return 'digests kept'


LIES: tuple[Lie, ...] = (
    _change, _change, _change, _exchange, _exchange, _stray, _stray, _link, _edit_sums,
    _edit_signature, _replay,
)  # fmt: skip
ENDS: tuple[Lie, ...] = (_kept,) * 5 + (
    _forge,
    _forge,
    _edit_sums,
    _replay,
    _remove,
)


_WORDS = {ExitCode.DIFFERENT: 'different', ExitCode.INCOMPLETE: 'incomplete'}
_ATTEMPTS = 100


def shown(folder: Path, proven: Verification) -> Iterator[Any]:
    """Yield what commands show of the parts of a run folder that are proven."""
    log = read_run(folder)
    yield log.base, log.topics, log.ticks.tobytes(), log.gaps
    yield sorted((name, values.tobytes()) for name, values in log.values.items())
    yield log.events, log.missing, log.attachments
    info = inspect(folder)
    yield info.lines()[len(info.files) :]
    if DECISIONS_FILE in proven.recomputed:
        yield list(read_decisions(folder / DECISIONS_FILE))
    if METADATA_FILE in proven.recomputed:
        yield (folder / METADATA_FILE).read_bytes()


class RunCase(Case):
    """Verifies changed copies of one run folder.

    run : the true folder, which verifies
    """

    def __init__(self, run: Path) -> None:
        self.run = run
        self.true = verify(run)
        if self.true.exit_code != ExitCode.OK:
            raise InputError(f'{run}: must verify; {self.true.sentence()}')

    def change(self, rng: random.Random, scratch: Path) -> tuple[Path, str]:
        """Return a changed copy of the folder, and what was changed."""
        folder = scratch / 'run'
        shutil.copytree(self.run, folder, ignore=shutil.ignore_patterns('report'))
        return folder, mutate(rng, folder)

    def outcome(self, folder: Path) -> str:
        """Verify a changed folder; return what came out, in capitals if it must not."""
        found = verify(folder)
        if found.exit_code != ExitCode.OK:
            return _WORDS[found.exit_code]
        if dict(found.premises) != dict(self.true.premises):
            return 'verified, rests on other files'
        return 'verified' if self._is_same(folder, found) else 'FALSE PROOF'

    def _is_same(self, folder: Path, found: Verification) -> bool:
        if list(shown(folder, found)) != list(shown(self.run, found)):
            return False
        listed = signature.read_sums(self.run)[1]
        now = signature.read_sums(folder)[1]
        kept = (name for name in found.digested if listed.get(name) == now.get(name))
        return all(signature.digest_of(folder / name) == listed[name] for name in kept)


def make_key(path: Path) -> Path:
    """Write a private key and beside it the public one, `*.pub.pem`, as OpenSSL does."""
    key = Ed25519PrivateKey.generate()
    pem, secret = Encoding.PEM, NoEncryption()
    path.write_bytes(key.private_bytes(pem, PrivateFormat.PKCS8, secret))
    target = path.with_name(f'{path.stem}.pub.pem')
    form = PublicFormat.SubjectPublicKeyInfo
    target.write_bytes(key.public_key().public_bytes(pem, form))
    return target


class SignedCase(RunCase):
    """Verifies lies about one run folder, which is signed here.

    run : the true folder, which verifies
    other : another run, which the same key signs; by default this one, its log written anew
    scratch : where the signed folders and the keys are kept
    """

    def __init__(self, run: Path, other: Path | None, scratch: Path) -> None:
        make_key(scratch / 'forger.pem')
        self.trusted = make_key(scratch / 'me.pem')
        signed, self._forger = scratch / 'signed', Forger(scratch / 'forger.pem', scratch / 'other')
        shutil.copytree(run, signed)
        shutil.copytree(other or run, self._forger.other)
        if other is None:
            for path in self._forger.other.glob('run*.mcap'):
                Parts.of(path).write(path)
            signature.write_sums(self._forger.other)
        for folder in (signed, self._forger.other):
            sign_run(folder, scratch / 'me.pem')
        super().__init__(signed)
        self._names = verify(signed, self.trusted).signed
        self._true = evidence(signed, self._names)
        self._all = {*self._names, *signature.read_sums(self._forger.other)[1]}

    def change(self, rng: random.Random, scratch: Path) -> tuple[Path, str]:
        """Return a changed copy of the folder that is a lie, and what was changed."""
        for attempt in range(_ATTEMPTS):
            place = scratch / str(attempt)
            forger = replace(self._forger, other=place / 'other')
            shutil.copytree(self.run, place / 'run')
            shutil.copytree(self._forger.other, forger.other)
            try:
                kind = lie(rng, place / 'run', forger)
            except NOT_WRITTEN:
                continue  # a change of a file that is not there any more
            if not self._is_true(place / 'run'):
                return place / 'run', kind
        raise InputError(f'no lie in {_ATTEMPTS} attempts')

    def _is_true(self, folder: Path) -> bool:
        """Return whether a folder shows what one of the two signed folders shows."""
        if evidence(folder, self._names) == self._true:
            return True
        return evidence(folder, self._all) == evidence(self._forger.other, self._all)

    def outcome(self, folder: Path) -> str:
        """Verify a changed folder; return what came out, in capitals if it must not."""
        now = evidence(folder, self._names)
        sealed = all(now[name] == self._true[name] for name in (SUMS_FILE, SIGNATURE_FILE))
        differs = any(now[name] != self._true[name] for name in self._names)
        try:
            found = verify(folder, self.trusted)
        except InputError:
            if sealed and differs:
                return 'NOT EXIT CODE 1'
            raise
        if found.exit_code == ExitCode.OK:
            return 'ACCEPTED'
        if found.signed_by or f'signed by {self.trusted.name}' in '\n'.join(found.lines()):
            return 'CALLED SIGNED'
        if sealed and differs and found.exit_code != ExitCode.DIFFERENT:
            return 'NOT EXIT CODE 1'
        return _WORDS[found.exit_code]


def cases_of(
    scratch: Path, run: Path, signed: bool = False, other: Path | None = None
) -> list[RunCase]:
    """Return the case of a run; signed, other : whether its cases are lies, see `SignedCase`."""
    return [SignedCase(run, other, scratch) if signed else RunCase(run)]
