# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Changes a run folder in every way that it can, and looks whether `rpo verify` is deceived.

Each case takes the records of a run's files apart, changes some of them, puts them together again
with checksums that fit, and verifies the result: `python tools/mutate_runs.py runs/demo`. A case is
drawn from its number alone. It fails if

- the changed folder verifies, proves what the true one proves, rests on the same files, and a
  command shows something else of what is proven;
- anything but one sentence comes out;
- it takes more than 10 s, or the process more than 1 GB.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import random
import resource
import shutil
import struct
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from mcap.records import Attachment, Channel, Chunk, Header, McapRecord, Metadata, Schema
from mcap.writer import CompressionType, Writer

from rpo_core.validation import InputError
from rpo_log.errors import ExitCode
from rpo_log.format import sums
from rpo_log.format.run import DECISIONS_FILE, METADATA_FILE, SUMS_FILE
from rpo_log.read.decisions import read_decisions
from rpo_log.read.records import FileRecords, RawMessage, message_at
from rpo_log.read.run_log import read_run
from rpo_log.tools.info import inspect
from rpo_log.verify import Verification, verify

MOST_S = 10.0
MOST_BYTES = 1 << 30
_NUMBERS = (0.0, -0.0, 1e-300, 1e308, float('inf'), float('nan'), 1.0, -1.0)


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
            writer = Writer(stream, chunk_size=1 << 40, compression=self.compression)
            head = next((r for r in self.records if isinstance(r, Header)), Header('', ''))
            writer.start(profile=head.profile, library=head.library)
            schemas: dict[int, int] = {}
            channels: dict[int, int] = {}
            for record in self.records:
                _put(writer, record, schemas, channels)
            writer.finish()


def _put(
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


Change = Callable[[random.Random, list[Any]], None]


def _drop(rng: random.Random, records: list[Any]) -> None:
    records.pop(rng.randrange(len(records)))


def _repeat(rng: random.Random, records: list[Any]) -> None:
    at = rng.randrange(len(records))
    records.insert(rng.choice((at, rng.randrange(len(records)))), records[at])


def _swap(rng: random.Random, records: list[Any]) -> None:
    a, b = rng.randrange(len(records)), rng.randrange(len(records))
    records[a], records[b] = records[b], records[a]


def _move_on(rng: random.Random, records: list[Any]) -> None:
    at = rng.randrange(len(records))
    records[at : at + 2] = records[at : at + 2][::-1]


def _edit(rng: random.Random, records: list[Any]) -> None:
    """Change one record; the rare ones as often as messages."""
    kinds = {type(record) for record in records if record is not None}
    kind = rng.choice(sorted(kinds, key=lambda kind: kind.__name__))
    at = rng.choice([i for i, record in enumerate(records) if type(record) is kind])
    records[at] = _edited(rng, records[at])


def _edited(rng: random.Random, record: Any) -> Any:
    if isinstance(record, RawMessage):
        return _edited_message(rng, record)
    fields = [name for name in vars(record) if name not in ('crc',)]
    name = rng.choice(fields)
    value = getattr(record, name)
    if isinstance(value, dict):
        value = dict(value)
        key = rng.choice(sorted(value)) if value else 'key'
        what = rng.randrange(3)
        if what == 0:
            value.pop(key, None)
        elif what == 1:
            value[key + 'x'] = '1'
        else:
            value[key] = _text(rng, value.get(key, ''))
    elif isinstance(value, bytes):
        value = _bytes(rng, value)
    elif isinstance(value, str):
        value = _text(rng, value)
    else:
        value = rng.choice((0, value + 1, max(0, value - 1), rng.randrange(8)))
    return replace(record, **{name: value})


def _edited_message(rng: random.Random, message: RawMessage) -> RawMessage:
    what = rng.randrange(8)
    if what == 0:
        return message._replace(channel=rng.randrange(9))
    if what == 1:
        return message._replace(sequence=rng.choice((0, message.sequence + 1, 1 << 31)))
    if what == 2:
        step = rng.choice((1, -1, 100_000_000))
        return message._replace(log_ns=max(0, message.log_ns + step))
    if what == 3:
        return message._replace(publish_ns=message.publish_ns + 1)
    if what == 4 and len(message.data) >= 20:
        at = 4 + 8 * rng.randrange((len(message.data) - 4) // 8)
        number = struct.pack('<d', rng.choice(_NUMBERS))
        return message._replace(data=message.data[:at] + number + message.data[at + 8 :])
    if what == 5:
        return message._replace(data=_text_of(rng, message.data))
    return message._replace(data=_bytes(rng, message.data))


def _text_of(rng: random.Random, data: bytes) -> bytes:
    """Change a digit or a letter that stands in the bytes."""
    places = [i for i, byte in enumerate(data) if chr(byte).isascii() and chr(byte).isalnum()]
    if not places:
        return data
    at = rng.choice(places)
    return data[:at] + rng.choice(b'0123456789aeiou').to_bytes(1, 'big') + data[at + 1 :]


def _bytes(rng: random.Random, data: bytes) -> bytes:
    what, at = rng.randrange(5), rng.randrange(len(data) + 1)
    if what == 0 and at < len(data):
        return data[:at] + bytes([data[at] ^ (1 << rng.randrange(8))]) + data[at + 1 :]
    if what == 1:
        return data[:at]
    if what == 2:
        return data[:at] + rng.randbytes(rng.randrange(1, 9)) + data[at:]
    if what == 3:
        return data[:at] + bytes(rng.randrange(1, 9)) + data[at + 8 :]
    return _text_of(rng, data)


def _text(rng: random.Random, text: str) -> str:
    changed = _bytes(rng, text.encode()).decode('utf-8', 'replace')
    return rng.choice((changed, text + ' ', text.upper(), '', '9' * 5000, '²', text * 2))


CHANGES: tuple[Change, ...] = (_drop, _repeat, _swap, _move_on, _edit, _edit, _edit, _edit)


def _mutate_records(rng: random.Random, path: Path) -> str:
    parts = Parts.of(path)
    names = []
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        change = rng.choice(CHANGES)
        change(rng, parts.records)
        names.append(change.__name__)
    parts.compression = rng.choice((CompressionType.ZSTD,) * 8 + tuple(CompressionType))
    parts.write(path)
    return f'records{"".join(sorted(set(names)))}'


def _mutate_bytes(rng: random.Random, path: Path) -> str:
    data = path.read_bytes()
    what = rng.randrange(4)
    if what == 0 and data:  # a length that asks for more than there is
        at = rng.randrange(len(data))
        data = data[:at] + struct.pack('<Q', 1 << rng.randrange(64)) + data[at + 8 :]
    elif what == 1 and path.suffix in ('.yaml', '') and data:
        lines = data.split(b'\n')
        at = rng.randrange(len(lines))
        lines[at : at + 1] = rng.choice(([], [lines[at]] * 2, [_text_of(rng, lines[at])]))
        data = b'\n'.join(lines)
    else:
        data = _bytes(rng, data)
    path.write_bytes(data)
    return 'bytes'


def _mutate_files(rng: random.Random, path: Path) -> str:
    what = rng.choice(('remove', 'swap', 'empty', 'link', 'pipe', 'folder', 'more', 'sparse'))
    others = sorted(p for p in path.parent.iterdir() if p.is_file() and p != path)
    other = rng.choice(others)
    if what == 'more':
        names = ('run_1.mcap', 'run_².mcap', 'notes\n.txt', 'x.mcap', 'run_0.mcap')
        shutil.copy(path, path.parent / rng.choice(names))
    elif what == 'empty':
        path.write_bytes(b'')
    elif what == 'swap':
        content = path.read_bytes()
        shutil.copy(other, path)
        other.write_bytes(content)
    elif what == 'sparse':
        os.truncate(path, rng.choice((1 << 36, 1 << 30)))
    else:
        path.unlink()
        if what == 'link':
            path.symlink_to(other.name)
        elif what == 'pipe':
            os.mkfifo(path)
        elif what == 'folder':
            path.mkdir()
    return f'file {what}'


def mutate(rng: random.Random, folder: Path) -> str:
    """Change a run folder; return what kind of change it was."""
    paths = sorted(path for path in folder.iterdir() if path.is_file())
    weights = [12 if p.name == 'run.mcap' else 4 if p.suffix == '.mcap' else 1 for p in paths]
    path = rng.choices(paths, weights)[0]
    way = rng.random()
    if path.suffix == '.mcap' and way < 0.8:
        kind = _mutate_records(rng, path)
    elif way < 0.95:
        kind = _mutate_bytes(rng, path)
    else:
        kind = _mutate_files(rng, path)
    digests = rng.choice(('kept', 'kept', 'forged', 'forged', 'removed'))
    if path.name != SUMS_FILE and digests == 'forged' and not kind.endswith('sparse'):
        sums.write_sums(folder)
    elif digests == 'removed':
        (folder / SUMS_FILE).unlink(missing_ok=True)
    return f'{path.name}: {kind}; digests {digests}'


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


class Case:
    """Verifies changed copies of one run folder.

    run : the true folder, which verifies
    """

    def __init__(self, run: Path) -> None:
        self.run = run
        self.true = verify(run)
        if self.true.exit_code != ExitCode.OK:
            raise InputError(f'{run}: must verify; {self.true.sentence()}')

    def judge(self, seed: int, number: int, scratch: Path) -> tuple[str, str]:
        """Return the outcome of a case: a word, and what was changed."""
        rng = random.Random(f'{seed} {number}')
        folder = scratch / 'run'
        shutil.rmtree(folder, ignore_errors=True)
        shutil.copytree(self.run, folder, ignore=shutil.ignore_patterns('report'))
        try:
            kind = mutate(rng, folder)
        except (struct.error, OverflowError, KeyError, OSError, InputError, UnicodeError) as error:
            return 'not written', type(error).__name__  # the writer refuses such a file
        begun = time.monotonic()
        outcome = self._outcome(folder)
        took_s = time.monotonic() - begun
        if took_s > MOST_S:
            outcome = 'TOO SLOW'
        if resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 > MOST_BYTES:
            outcome = 'TOO LARGE'
        return outcome, kind

    def _outcome(self, folder: Path) -> str:
        try:
            found = verify(folder)
        except InputError as error:
            return 'refused' if '\n' not in str(error) else 'NOT ONE SENTENCE'
        except Exception as error:  # whatever comes out is what this program looks for
            return f'TRACEBACK {type(error).__name__}'
        if found.exit_code != ExitCode.OK:
            return 'different' if found.exit_code == ExitCode.DIFFERENT else 'incomplete'
        if dict(found.premises) != dict(self.true.premises):
            return 'verified, rests on other files'
        return 'verified' if self._is_same(folder, found) else 'FALSE PROOF'

    def _is_same(self, folder: Path, found: Verification) -> bool:
        if list(shown(folder, found)) != list(shown(self.run, found)):
            return False
        listed = sums.read_sums(self.run) or {}
        now = sums.read_sums(folder) or {}
        kept = (name for name in found.digested if listed.get(name) == now.get(name))
        return all(sums.digest_of(folder / name) == listed[name] for name in kept)


def run_cases(run: Path, seed: int, first: int, last: int) -> Counter[tuple[str, str]]:
    """Judge the cases from `first` to before `last`; return how often each outcome came."""
    case = Case(run)
    found: Counter[tuple[str, str]] = Counter()
    with tempfile.TemporaryDirectory() as scratch:
        for number in range(first, last):
            outcome, kind = case.judge(seed, number, Path(scratch))
            if outcome.split()[0].isupper():
                print(f'case {number}: {outcome}: {kind}', flush=True)
            found[outcome, kind if outcome.split()[0].isupper() else ''] += 1
    return found


def failures(found: Counter[tuple[str, str]]) -> int:
    """Return how many cases failed."""
    return sum(count for (outcome, _), count in found.items() if outcome.split()[0].isupper())


def _work(arguments: tuple[Path, int, int, int]) -> Counter[tuple[str, str]]:
    return run_cases(*arguments)


def main() -> int:
    """Entry point."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument('run', type=Path, help='run folder that verifies')
    parser.add_argument('--cases', type=int, default=1000)
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--first', type=int, default=0, help='number of the first case')
    parser.add_argument('--workers', type=int, default=1, help='processes')
    options = parser.parse_args()
    begun = time.monotonic()
    size = 250
    parts = [
        (options.run, options.seed, first, min(first + size, options.first + options.cases))
        for first in range(options.first, options.first + options.cases, size)
    ]
    found: Counter[tuple[str, str]] = Counter()
    with multiprocessing.Pool(options.workers) as pool:
        for done, part in enumerate(pool.imap(_work, parts), 1):
            found += part
            print(f'{min(done * size, options.cases)} of {options.cases} cases, '
                  f'{failures(found)} failures, {time.monotonic() - begun:.0f} s',
                  file=sys.stderr, flush=True)  # fmt: skip
    outcomes: Counter[str] = Counter()
    for (outcome, _), count in found.items():
        outcomes[outcome] += count
    for outcome, count in outcomes.most_common():
        print(f'{count:8d}  {outcome}')
    print(f'{failures(found)} failures in {options.cases} cases of seed {options.seed}')
    return 1 if failures(found) else 0


if __name__ == '__main__':
    sys.exit(main())
