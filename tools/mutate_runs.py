# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Changes a run folder in every way that it can, and looks whether `rpo verify` is deceived.

Each case takes the records of a run's files apart, changes some of them, puts them together again
with checksums that fit, and verifies the result: `python -m tools.mutate_runs runs/demo`. A case is
drawn from its number alone. It fails if

- the changed folder verifies, proves what the true one proves, rests on the same files, and a
  command shows something else of what is proven;
- anything but one sentence comes out;
- it takes more than 10 s, or the process more than 1 GB.

With `--signed` the folder is signed first, and each case is a lie of someone without the key: a
file that is signed, the digests, the signature or the log that is read is another. It fails if the
folder verifies or is called signed, or if a signed file that differs is not exit code 1.
"""

from __future__ import annotations

import argparse
import multiprocessing
import random
import resource
import shutil
import struct
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from rpo_core.files.validation import InputError
from rpo_log import signature
from rpo_log.errors import ExitCode
from rpo_log.format import sums
from rpo_log.format.run import DECISIONS_FILE, METADATA_FILE, SIGNATURE_FILE, SUMS_FILE
from rpo_log.read.run_log import read_decisions, read_run
from rpo_log.signature import sign_run
from rpo_log.tools.info import inspect
from rpo_log.verify import Verification, verify
from tools.lies import Forger, evidence, lie
from tools.mutations import Parts, mutate

MOST_S = 10.0
MOST_BYTES = 1 << 30

Work = Callable[[tuple[int, int]], Counter[tuple[str, str]]]
"""Judges the cases from a first to before a last; returns how often each outcome came."""

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


class Case:
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

    def judge(self, seed: int, number: int, scratch: Path) -> tuple[str, str]:
        """Return the outcome of a case: a word, and what was changed."""
        rng = random.Random(f'{seed} {number}')
        shutil.rmtree(scratch / 'case', ignore_errors=True)
        (scratch / 'case').mkdir()
        try:
            folder, kind = self.change(rng, scratch / 'case')
        except (struct.error, OverflowError, KeyError, OSError, InputError, UnicodeError) as error:
            return 'not written', type(error).__name__  # the writer refuses such a file
        outcome, took_s = self._timed(folder)
        if took_s > MOST_S and self._timed(folder)[1] > MOST_S:  # twice: not a busy machine
            outcome = 'TOO SLOW'
        if resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 > MOST_BYTES:
            outcome = 'TOO LARGE'
        return outcome, kind

    def _timed(self, folder: Path) -> tuple[str, float]:
        begun = time.monotonic()
        return self._outcome(folder), time.monotonic() - begun

    def _outcome(self, folder: Path) -> str:
        try:
            return self.outcome(folder)
        except InputError as error:
            return 'refused' if '\n' not in str(error) else 'NOT ONE SENTENCE'
        except Exception as error:  # whatever comes out is what this program looks for
            return f'TRACEBACK {type(error).__name__}'

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
        listed = sums.read_sums(self.run).digests
        now = sums.read_sums(folder).digests
        kept = (name for name in found.digested if listed.get(name) == now.get(name))
        return all(sums.digest_of(folder / name) == listed[name] for name in kept)


class SignedCase(Case):
    """Verifies lies about one run folder, which is signed here.

    run : the true folder, which verifies
    other : another run, which the same key signs; by default this one, its log written anew
    scratch : where the signed folders and the keys are kept
    """

    def __init__(self, run: Path, other: Path | None, scratch: Path) -> None:
        signature.make_key(scratch / 'forger.pem')
        self.trusted = signature.make_key(scratch / 'me.pem')
        signed, self._forger = scratch / 'signed', Forger(scratch / 'forger.pem', scratch / 'other')
        shutil.copytree(run, signed)
        shutil.copytree(other or run, self._forger.other)
        if other is None:
            for path in self._forger.other.glob('run*.mcap'):
                Parts.of(path).write(path)
            sums.write_sums(self._forger.other)
        for folder in (signed, self._forger.other):
            sign_run(folder, scratch / 'me.pem')
        super().__init__(signed)
        self._names = verify(signed, self.trusted).signed
        self._true = evidence(signed, self._names)
        self._all = {*self._names, *sums.read_sums(self._forger.other).digests}

    def change(self, rng: random.Random, scratch: Path) -> tuple[Path, str]:
        """Return a changed copy of the folder that is a lie, and what was changed."""
        for attempt in range(_ATTEMPTS):
            place = scratch / str(attempt)
            forger = replace(self._forger, other=place / 'other')
            shutil.copytree(self.run, place / 'run')
            shutil.copytree(self._forger.other, forger.other)
            try:
                kind = lie(rng, place / 'run', forger)
            except (struct.error, OverflowError, KeyError, OSError, InputError, UnicodeError):
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


def run_cases(
    run: Path,
    seed: int,
    first: int,
    last: int,
    signed: bool = False,
    other: Path | None = None,
) -> Counter[tuple[str, str]]:
    """Judge the cases from `first` to before `last`; return how often each outcome came.

    signed, other : whether the folder is signed and the cases are lies, see `SignedCase`
    """
    found: Counter[tuple[str, str]] = Counter()
    with tempfile.TemporaryDirectory() as scratch:
        case = SignedCase(run, other, Path(scratch)) if signed else Case(run)
        for number in range(first, last):
            outcome, kind = case.judge(seed, number, Path(scratch))
            if outcome.split()[0].isupper():
                print(f'case {number}: {outcome}: {kind}', flush=True)
            found[outcome, kind if outcome.split()[0].isupper() else ''] += 1
    return found


def failures(found: Counter[tuple[str, str]]) -> int:
    """Return how many cases failed."""
    return sum(count for (outcome, _), count in found.items() if outcome.split()[0].isupper())


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of a bench: which cases, and on how many processes."""
    parser.add_argument('--cases', type=int, default=1000)
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--first', type=int, default=0, help='number of the first case')
    parser.add_argument('--workers', type=int, default=1, help='processes')


def judge_all(work: Work, options: argparse.Namespace, size: int) -> int:
    """Judge the cases of a bench, print what came out; return its exit code.

    work : gets the first case of a part and the one behind its last
    size : cases of a part, each a task of a process
    """
    begun, end = time.monotonic(), options.first + options.cases
    parts = [(first, min(first + size, end)) for first in range(options.first, end, size)]
    found: Counter[tuple[str, str]] = Counter()
    with multiprocessing.Pool(options.workers) as pool:
        for part in pool.imap(work, parts):
            found += part
            print(f'{found.total()} of {options.cases} cases, {failures(found)} failures, '
                  f'{time.monotonic() - begun:.0f} s', file=sys.stderr, flush=True)  # fmt: skip
    outcomes: Counter[str] = Counter()
    for (outcome, _), count in found.items():
        outcomes[outcome] += count
    for outcome, count in outcomes.most_common():
        print(f'{count:8d}  {outcome}')
    print(f'{failures(found)} failures in {options.cases} cases of seed {options.seed}')
    return 1 if failures(found) else 0


def _work(
    run: Path, seed: int, signed: bool, other: Path | None, part: tuple[int, int]
) -> Counter[tuple[str, str]]:
    return run_cases(run, seed, *part, signed, other)


def main() -> int:
    """Entry point."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument('run', type=Path, help='run folder that verifies')
    add_options(parser)
    parser.add_argument('--signed', action='store_true', help='sign the run; each case is a lie')
    parser.add_argument('--other', type=Path, help='run folder from which lies take files')
    options = parser.parse_args()
    work = partial(_work, options.run, options.seed, options.signed, options.other)
    return judge_all(work, options, size=250)


if __name__ == '__main__':
    sys.exit(main())
