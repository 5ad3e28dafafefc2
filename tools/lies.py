# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Changes of a signed run folder, by someone who does not have the key. All are drawn at random.

What such a forger has: a key of his own, another run that the same key signed, and every file of
the folder. He changes files, exchanges the log, adds a second one, edits the digests and the
signature.
"""

from __future__ import annotations

import hashlib
import os
import random
import re
import shutil
import stat
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

from rpo_log import signature
from rpo_log.format import sums
from rpo_log.format.run import DECISIONS_FILE, METADATA_FILE, SIGNATURE_FILE, SUMS_FILE
from tools.mutations import change

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
    lies = [rng.choice(LIES)(rng, folder, forger) for _ in range(rng.choice((1, 1, 1, 2)))]
    return '; '.join((*lies, rng.choice(ENDS)(rng, folder, forger)))


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
    at = rng.randrange(len(data))
    flipped = data[:at] + bytes([data[at] ^ 1 << rng.randrange(8)]) + data[at + 1 :]
    ways = (flipped, data[:at], data + b'\0', b'', bytes(64), data.hex().encode(), data * 2)
    data = rng.choice(ways)
    path.write_bytes(data)
    return 'another signature'


def _keep(rng: random.Random, folder: Path, forger: Forger) -> str:
    return 'digests kept'


def _forge(rng: random.Random, folder: Path, forger: Forger) -> str:
    """Write digests that fit, and keep the signature, drop it, or sign with another key."""
    if any(p.is_file() and p.stat().st_size > _MOST_BYTES for p in folder.iterdir()):
        return 'digests kept'
    path = folder / SIGNATURE_FILE
    kept = path.read_bytes() if path.is_file() else b''
    fitting = sums.write_sums(folder)
    way = rng.choice(('old', 'no', "the forger's"))
    if way == 'old':
        path.write_bytes(kept)
    elif way != 'no':
        signature.sign(folder, fitting, signature.private_key(forger.key))
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


LIES: tuple[Lie, ...] = (
    _change, _change, _change, _exchange, _exchange, _stray, _stray, _link, _edit_sums,
    _edit_signature, _replay,
)  # fmt: skip
ENDS: tuple[Lie, ...] = (_keep,) * 5 + (_forge, _forge, _edit_sums, _replay, _remove)
