# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What is proven of a log and the folder around it, beside the flight itself.

Some files follow from the flight and are recomputed, some have the digest that they had, and of
some nothing is known.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping, Sequence
from pathlib import Path

from rpo_core import files
from rpo_log import signature
from rpo_log.errors import Fault, LogError
from rpo_log.format import rosbag2
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
from rpo_log.verify.digests import Digests
from rpo_log.verify.form import Form, records_of_run
from rpo_log.verify.statuses import Statuses
from rpo_log.verify.verification import Verification
from rpo_log.write.bag_file import bag_topics

MAX_METADATA_BYTES = 1 << 22


def metadata_fault(reader: RunReader) -> tuple[str, str]:
    """Return why metadata.yaml is not that of the log, empty if it is, and its SHA-256.

    The digest is that of the bytes compared, and empty if there are more. Raises LogError.
    """
    path = reader.path / METADATA_FILE
    counts, bag = [0] * len(reader.topics), []
    for file in reader.files:
        found, first_ns, last_ns = reader.extent_of(file)
        counts = [sum(pair) for pair in zip(counts, found, strict=True)]
        bag.append(BagFile(file.name, first_ns, last_ns, sum(found)))
    expected = rosbag2.metadata_text(bag_topics(reader.topics, counts), bag)
    try:
        with files.open_regular(path) as stream:
            content = stream.read(MAX_METADATA_BYTES + 1)
    except OSError as error:
        raise LogError(
            Fault.NOT_FOUND, path, f'cannot be read: {error.strerror or error}'
        ) from None
    digest = _sha256(content) if len(content) <= MAX_METADATA_BYTES else ''
    if content == expected.encode():
        return '', digest
    lines = zip(content.decode(errors='replace').split('\n'), expected.split('\n'), strict=False)
    number = next((n for n, (a, b) in enumerate(lines, 1) if a != b), 'the last')
    return f'{METADATA_FILE} is not that of the log; line {number} differs', digest


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
        self._read: dict[str, str] = {}  # digests of the files that were read, by name
        self._recomputed: list[str] = []
        self._digested: tuple[str, ...] = ()
        self._unknown: list[str] = []
        self._premises: dict[str, str] = {}
        self._signed_by: str | None = None
        self._signed: Mapping[str, str] = {}

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
        self._read[DECISIONS_FILE] = decisions.digest

    def of_folder(self, trusted: Path | None) -> None:
        """Judge the other files of the folder, and its signature."""
        folder = self._reader.path
        if not folder.is_dir():
            if trusted is not None:
                self._gaps.append('a single file has no signature')
            return
        if not self._reader.damage and os.path.lexists(folder / METADATA_FILE):
            gap, self._read[METADATA_FILE] = metadata_fault(self._reader)
            self._take(gap, METADATA_FILE)
        logs = {path.name: digest for path, digest in self._reader.digests.items()}
        self._read.update(logs)
        digests = Digests.of(folder, self._read)
        self._faults = digests.faults
        proven = {*self._recomputed, *logs}
        self._digested = tuple(name for name in digests.matched if name not in proven)
        self._unknown += [name for name in digests.unlisted if name not in proven]
        self._unknown += [f'{name} {what}' for name, what in digests.others.items()]
        self._judge_signature(folder, trusted, digests)

    def _judge_signature(self, folder: Path, trusted: Path | None, digests: Digests) -> None:
        """Say who signed the folder, if all that was read to verify it is as it was signed."""
        unsigned = ', '.join(name for name in self._read if name not in digests.sums.digests)
        if trusted is None:
            if os.path.lexists(folder / SIGNATURE_FILE):
                self._unknown.append(f'{SIGNATURE_FILE}, which was not checked: no key is trusted')
            if digests.sums.content is not None and unsigned:
                self._unknown.append(f'{SUMS_FILE} does not list {unsigned}')
            return
        signer = signature.signer(folder, digests.sums, trusted)
        if signer is None:
            self._gaps.append(f'no key of {trusted} has signed it')
        elif unsigned:
            self._gaps.append(f'{signer} has not signed {unsigned}: {SUMS_FILE} does not list it')
        elif not digests.faults:
            self._signed_by, self._signed = signer, digests.matched

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
            self._signed_by, self._signed, controllers,
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
