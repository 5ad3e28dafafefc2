# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What a forger does to any value, to rows, to a document and to a file."""

from __future__ import annotations

import copy
import os
import pickle
import random
import shutil
import struct
from pathlib import Path
from typing import Any

NUMBERS = (0.0, -0.0, 1e-300, 1e300, float('inf'), -float('inf'), float('nan'), 1.0, -1.0, 1e9)
SHARES = (-1.0, 0.0, 0.5, 0.9, 1.0 - 1e-9, 1.0 + 1e-9, 1.1, 2.0, 1e3, 20.0)
WORDS = (
    'proven', 'refuted', 'undecided', 'allround', 'robust', 'paper_test', 'mm', 'km', 'for ever',
    'x', '', '\x1b[2J', '9' * 5000, '²',
)  # fmt: skip
TEXTS = ('.yaml', '')
"""Suffixes of files of lines."""


def other(rng: random.Random, value: Any) -> Any:
    """Return something else in the place of a number, a text, bytes, a mapping or nothing."""
    if isinstance(value, bool):
        return not value
    if isinstance(value, int):
        beside = max(0, value + rng.choice((1, -1, 10**8, -(10**8))))
        return rng.choice((0, beside, beside, rng.randrange(9), 1 << 31))
    if isinstance(value, float):
        near = [value * share for share in SHARES]
        return rng.choice((*near, *near, *NUMBERS, int(min(abs(value), 1e9)), 1 << 70))
    if isinstance(value, bytes):
        return spoilt(rng, value)
    if isinstance(value, dict) and value:
        key = rng.choice(sorted(value))
        kept = {name: inner for name, inner in value.items() if name != key}
        return rng.choice((kept, {**value, f'{key}x': '1'}, {**kept, key: other(rng, value[key])}))
    if isinstance(value, str):
        text = spoilt(rng, value.encode()).decode('utf-8', 'replace')
        return rng.choice((text, text, f'{value} ', value.upper(), value * 2, *WORDS))
    return rng.choice(WORDS)


def spoilt(rng: random.Random, data: bytes) -> bytes:
    """Return bytes with a bit, a number, a letter or a part of them changed, or cut short."""
    at, size = rng.randrange(len(data) + 1), rng.randrange(1, 9)
    way = rng.choice(('bit', 'cut', 'more', 'zeros', 'letter', 'number', 'length'))
    if way == 'cut':
        return data[:at]
    if way == 'more':
        return data[:at] + rng.randbytes(size) + data[at:]
    if way == 'zeros':
        return data[:at] + bytes(size) + data[at + 8 :]
    if way in ('number', 'length'):  # a number of a message; a length that asks for too much
        at -= (at - 4) % 8 if way == 'number' and at >= 4 else 0
        number = struct.pack('<d', rng.choice(NUMBERS))
        length = struct.pack('<Q', 1 << rng.randrange(64))
        return data[:at] + (number if way == 'number' else length) + data[at + 8 :]
    places = [i for i, byte in enumerate(data) if chr(byte).isascii() and chr(byte).isalnum()]
    if way == 'letter' and places:
        at = rng.choice(places)
        return data[:at] + rng.choice(b'0123456789aeiou').to_bytes(1, 'big') + data[at + 1 :]
    at = min(at, len(data) - 1)
    return data[:at] + bytes([data[at] ^ 1 << rng.randrange(8)]) + data[at + 1 :] if data else b''


def reordered(rng: random.Random, count: int) -> list[int]:
    """Return places of rows: one is left out, or twice, or is exchanged with another, or next."""
    places, a, b = list(range(count)), rng.randrange(count), rng.randrange(count)
    way = rng.choice(('drop', 'repeat', 'swap', 'move'))
    if way == 'drop':
        places.pop(a)
    elif way == 'repeat':
        places.insert(rng.choice((a, b)), a)
    else:
        b = b if way == 'swap' else min(a + 1, count - 1)
        places[a], places[b] = places[b], places[a]
    return places


def _leaves(document: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Return the places of a document: of values, lists and mappings."""
    pairs: Any = document.items() if isinstance(document, dict) else ()
    pairs = enumerate(document) if isinstance(document, list) else pairs
    found = [path] if path else []
    return [*found, *(leaf for key, value in pairs for leaf in _leaves(value, (*path, key)))]


def edit(rng: random.Random, document: Any) -> str:
    """Change one value of a document, or leave out, repeat or exchange it; return its place."""
    place = rng.choice(_leaves(document))
    holder = document
    for key in place[:-1]:
        holder = holder[key]
    key, value, what = place[-1], holder[place[-1]], rng.randrange(10)
    if what == 0 and isinstance(holder, dict):
        del holder[key]
    elif what == 1 and isinstance(holder, dict):
        holder[f'{key}x'] = copy.deepcopy(value)
    elif what == 2:
        holder[key] = rng.choice(([value], {'x': value}, [], {}, None, str(value), True))
    else:
        holder[key] = other(rng, value)
    return '.'.join(map(str, place))


def spoil(rng: random.Random, path: Path) -> str:
    """Change bytes of a file, or a line: a comment behind it is no lie."""
    data = path.read_bytes()
    if path.suffix not in TEXTS or rng.random() < 0.5:
        path.write_bytes(spoilt(rng, data))
        return 'bytes'
    lines = data.split(b'\n')
    at = rng.randrange(len(lines))
    edits = {
        'twice': [lines[at]] * 2,
        'dropped': [],
        'letter': [spoilt(rng, lines[at])],
        'comment': [lines[at] + b' # ' + rng.choice(WORDS).encode()],
        'list': [b'- ' + line for line in lines],
        'tag': [lines[at].replace(b': ', b': !!python/object/apply:os.getcwd ', 1)],
    }
    way = rng.choice(sorted(edits))
    path.write_bytes(b'\n'.join([*lines[:at], *edits[way], *lines[at + 1 :]]))
    return f'line {way}'


WAYS = (
    'remove', 'swap', 'rename', 'empty', 'link', 'link aside', 'pipe', 'folder', 'more', 'sparse',
    'pickle',
)  # fmt: skip


def displace(rng: random.Random, path: Path, names: tuple[str, ...]) -> str:
    """Let something else be in the place of a file, or its copy beside it, under one of names."""
    beside = (p for p in path.parent.iterdir() if p.is_file() and not p.is_symlink())
    neighbour, way = rng.choice(sorted(beside)), rng.choice(WAYS)
    content, aside = path.read_bytes(), path.parent.parent / 'aside'
    if way == 'more':
        shutil.copy(path, path.parent / rng.choice(names))
    elif way == 'swap':
        path.write_bytes(neighbour.read_bytes())
        neighbour.write_bytes(content)
    elif way == 'rename':
        path.rename(neighbour)
    elif way == 'sparse':
        os.truncate(path, rng.choice((1 << 36, 1 << 30)))
    elif way in ('empty', 'pickle'):
        path.write_bytes(pickle.dumps({'values': [1.0]}) if way == 'pickle' else b'')
    else:
        path.unlink()
        aside.write_bytes(content)
        if way.startswith('link'):
            path.symlink_to(aside if way == 'link aside' else neighbour.name)
        elif way == 'pipe':
            os.mkfifo(path)
        elif way == 'folder':
            path.mkdir()
    return f'file {way}'
