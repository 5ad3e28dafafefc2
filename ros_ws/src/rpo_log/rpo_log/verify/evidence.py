# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What is proven of a log and the folder around it, beside the flight itself.

Some files follow from the flight and are recomputed, some have the digest that they had, and of
some nothing is known.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path

from rpo_core import files
from rpo_log import signature
from rpo_log.errors import Fault, LogError
from rpo_log.format import rosbag2, sums
from rpo_log.format.rosbag2 import BagFile
from rpo_log.format.run import (
    DECISIONS_FILE,
    METADATA_FILE,
    MOST_CONTROLLERS,
    PARAMETERS,
    SIGNATURE_FILE,
    SUMS_FILE,
)
from rpo_log.read.run_log import parameters_of
from rpo_log.read.stream import RunReader
from rpo_log.verify.decisions import Decisions
from rpo_log.verify.form import Form, records_of_run
from rpo_log.verify.statuses import Statuses
from rpo_log.verify.verification import Verification
from rpo_log.write.bag_file import bag_topics

MAX_METADATA_BYTES = 1 << 22
MAX_BESIDE_BYTES = 1 << 28

_LOG = re.compile(r'run(_[0-9]+)?\.mcap')


@dataclass(frozen=True)
class Digests:
    """What SHA256SUMS says of a run folder.

    matched, changed, missing : files that it lists
    unlisted : files that it does not
    """

    matched: tuple[str, ...] = ()
    changed: tuple[str, ...] = ()
    missing: tuple[str, ...] = ()
    unlisted: tuple[str, ...] = ()

    @classmethod
    def of(cls, folder: Path, without: Collection[str] = ()) -> Digests:
        """Compare the files of a folder with SHA256SUMS, if there is one; raises LogError.

        without : names of files that are passed over
        """
        listed = sums.read_sums(folder)
        if listed is not None:
            listed = {name: digest for name, digest in listed.items() if name not in without}
        there = [name for name in sums.files_below(folder) if name not in without]
        if listed is None:
            return cls(unlisted=tuple(there))
        missing = tuple(name for name in listed if name not in there)
        same = {n: _digest(folder / n) == listed[n] for n in there if n in listed}
        return cls(
            tuple(name for name, equal in same.items() if equal),
            tuple(name for name, equal in same.items() if not equal),
            missing,
            tuple(name for name in there if name not in listed),
        )

    def faults(self) -> list[str]:
        """Return what is not as listed, for people."""
        found = [f'{name} is not the file that {SUMS_FILE} lists' for name in self.changed]
        return found + [f'{name} is missing, which {SUMS_FILE} lists' for name in self.missing]


def _digest(path: Path) -> str:
    """Return the SHA-256 of a file; empty if it is longer than a file beside a log can be."""
    is_log = _LOG.fullmatch(path.name) is not None
    return sums.digest_of(path) if is_log or path.stat().st_size <= MAX_BESIDE_BYTES else ''


def metadata_fault(reader: RunReader) -> str:
    """Return why metadata.yaml is not that of the log; empty if it is. Raises LogError."""
    path = reader.path / METADATA_FILE
    counts, bag = [0] * len(reader.topics), []
    for file in reader.files:
        found, first_ns, last_ns = reader.extent_of(file)
        counts = [sum(pair) for pair in zip(counts, found, strict=True)]
        bag.append(BagFile(file.name, first_ns, last_ns, sum(found)))
    expected = rosbag2.metadata_text(bag_topics(reader.topics, counts), bag)
    try:
        with files.open_regular(path) as stream:
            content = stream.read(MAX_METADATA_BYTES)
    except OSError as error:
        raise LogError(
            Fault.NOT_FOUND, path, f'cannot be read: {error.strerror or error}'
        ) from None
    if content == expected.encode():
        return ''
    lines = zip(content.decode(errors='replace').split('\n'), expected.split('\n'), strict=False)
    number = next((n for n, (a, b) in enumerate(lines, 1) if a != b), 'the last')
    return f'{METADATA_FILE} is not that of the log; line {number} differs'


class Evidence:
    """Gathers what is proven beside the flight, what it rests on, and what is not known.

    reader : its records are looked at while its blocks are read
    """

    def __init__(self, reader: RunReader) -> None:
        self._reader = reader
        most = 2 * len(reader.topics) + len(reader.attachments) + MOST_CONTROLLERS + 8
        self._forms = {path: Form(path, most) for path in reader.files}
        reader.witness = lambda path, record: self._forms[path].take(record)
        self._gaps: list[str] = []
        self._faults: tuple[str, ...] = ()
        self._recomputed: list[str] = []
        self._digested: tuple[str, ...] = ()
        self._unknown: list[str] = []
        self._premises: dict[str, str] = {}
        self._signed_by: str | None = None

    def of_log(self, statuses: Statuses, free: bool) -> None:
        """Judge run_status, and the records of the log that are not messages."""
        self._recomputed.append('phases and figures of run_status')
        self._unknown.append('texts of events')
        if free:
            self._unknown.append('when forces came')
        carried = self._reader.attachments
        self._premises = {name: _sha256(data) for name, data in sorted(carried.items())}
        self._premises['events'] = statuses.said
        self._unknown.append(f'whether {PARAMETERS} is what the nodes ran with')
        if self._reader.damage:
            return
        found = [f.deviation(records_of_run(self._reader, p)) for p, f in self._forms.items()]
        self._take(next(filter(None, found), ''), 'records beside the messages')
        self._unknown.append('indexes and chunks of the files, which only speed up other readers')

    def of_decisions(self, decisions: Decisions | None, last_tick: int, free: bool) -> None:
        """Judge the decisions beside the log; free running may be without some.

        last_tick : at which the controller still answered
        """
        rate_hz = None if free else decision_rate_hz(self._reader)
        if decisions is None:
            if rate_hz and self._reader.path.is_dir():
                self._gaps.append(f'{DECISIONS_FILE} is missing')
            return
        self._take('; '.join(decisions.gaps(rate_hz, last_tick)), DECISIONS_FILE)

    def of_folder(self, trusted: Path | None) -> None:
        """Judge the other files of the folder, and its signature."""
        folder = self._reader.path
        if not folder.is_dir():
            if trusted is not None:
                self._gaps.append('a single file has no signature')
            return
        if not self._reader.damage and (folder / METADATA_FILE).exists():
            self._take(metadata_fault(self._reader), METADATA_FILE)
        broken = [path.name for path in self._reader.files] if self._reader.damage else []
        digests = Digests.of(folder, broken)
        self._faults = tuple(digests.faults())
        proven = {*self._recomputed, *(path.name for path in self._reader.files)}
        self._digested = tuple(name for name in digests.matched if name not in proven)
        self._unknown += [name for name in digests.unlisted if name not in proven]
        self._judge_signature(folder, trusted)

    def _judge_signature(self, folder: Path, trusted: Path | None) -> None:
        if trusted is not None:
            self._signed_by = signature.signer(folder, trusted)
            if self._signed_by is None:
                self._gaps.append(f'no key of {trusted} has signed it')
        elif (folder / SIGNATURE_FILE).exists():
            self._unknown.append('who signed it: no key is trusted')

    def _take(self, gap: str, what: str) -> None:
        if gap:
            self._gaps.append(gap)
        else:
            self._recomputed.append(what)

    def verification(
        self,
        ticks: int,
        gaps: Sequence[str],
        free: bool,
        stages: tuple[str, ...],
        controllers: tuple[str, ...],
    ) -> Verification:
        """Return all of it as the outcome of a flight without difference."""
        return Verification(
            self._reader.path, ticks, None, (*gaps, *self._gaps), free, stages, self._faults,
            tuple(self._recomputed), self._digested, tuple(self._unknown), self._premises,
            self._signed_by, controllers,
        )  # fmt: skip


def decision_rate_hz(reader: RunReader) -> float | None:
    """Return how often the controller of a log published decisions; None if that is not known."""
    try:
        rates = [
            float(node['decision_rate_hz'])
            for node in parameters_of(reader).values()
            if 'decision_rate_hz' in node
        ]
    except (TypeError, ValueError):
        return None
    return rates[0] if len(rates) == 1 and 0.0 <= rates[0] < 1e6 else None


def _sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()
