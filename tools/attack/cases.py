# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Cases of an attack: each changes a copy of a true folder, and judges what the checker says of it.

A case is drawn from its seed and number alone. An outcome in capitals is a failure: something false
was accepted, anything but one sentence came out, or it took more than 10 s of CPU time, or made
the process larger than 1 GB and than it ever was.
"""

from __future__ import annotations

import multiprocessing
import random
import resource
import shutil
import struct
import sys
import tempfile
import time
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from rpo_core.files.validation import InputError

MOST_S = 10.0
MOST_BYTES = 1 << 30
PART = 250
"""Cases of a task of a process."""

Outcomes = Counter[tuple[str, str]]
"""How often an outcome came; of a failure, with what was changed."""

Making = Callable[[Path], 'Sequence[Case]']
"""Makes the cases of some true folders, which it may keep in a folder of scratch."""

NOT_WRITTEN = (struct.error, OverflowError, KeyError, OSError, InputError, UnicodeError)
"""What a writer raises that refuses a change."""


def peak_bytes() -> int:
    """Return the largest size that this process ever had, as Linux counts it."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


class Case(ABC):
    """Judges changed copies of one true folder."""

    @abstractmethod
    def change(self, rng: random.Random, scratch: Path) -> tuple[Path, str]:
        """Return a changed copy of the folder, and what was changed."""

    @abstractmethod
    def outcome(self, folder: Path) -> str:
        """Check a changed folder; return what came out, in capitals if it must not."""

    def judge(self, seed: int, number: int, scratch: Path) -> tuple[str, str]:
        """Return the outcome of a case: a word, and what was changed."""
        rng = random.Random(f'{seed} {number}')
        shutil.rmtree(scratch / 'case', ignore_errors=True)
        (scratch / 'case').mkdir()
        try:
            folder, kind = self.change(rng, scratch / 'case')
        except NOT_WRITTEN as error:
            return 'not written', type(error).__name__
        begun, largest = time.process_time(), max(MOST_BYTES, peak_bytes())
        try:
            outcome = self.outcome(folder)
        except InputError as error:
            outcome = 'refused' if '\n' not in str(error) else 'NOT ONE SENTENCE'
        except Exception as error:  # whatever comes out is what these programs look for
            outcome = f'TRACEBACK {type(error).__name__} {error}'
        if time.process_time() - begun > MOST_S:
            outcome = 'TOO SLOW'
        if peak_bytes() > largest:
            outcome = 'TOO LARGE'
        return outcome, kind


def _failed(outcome: str) -> bool:
    return outcome.split()[0].isupper()


def judge_cases(make: Making, seed: int, first: int, last: int) -> Outcomes:
    """Judge the cases from `first` to before `last`, in turn of each true folder."""
    found = Outcomes()
    with tempfile.TemporaryDirectory() as name:
        scratch = Path(name)
        cases = make(scratch)
        for number in range(first, last):
            outcome, kind = cases[number % len(cases)].judge(seed, number, scratch)
            if _failed(outcome):
                print(f'case {number}: {outcome}: {kind}', flush=True)
            found[outcome, kind if _failed(outcome) else ''] += 1
    return found


def _judge_part(make: Making, seed: int, part: tuple[int, int]) -> Outcomes:
    return judge_cases(make, seed, *part)


def failures(found: Outcomes) -> int:
    """Return how many cases failed."""
    return sum(count for (outcome, _), count in found.items() if _failed(outcome))


def judge_all(make: Making, seed: int, first: int, count: int, workers: int) -> int:
    """Judge some cases in processes, print what came out; return the exit code."""
    begun, end = time.monotonic(), first + count
    parts = [(at, min(at + PART, end)) for at in range(first, end, PART)]
    found = Outcomes()
    with multiprocessing.Pool(workers) as pool:
        for part in pool.imap(partial(_judge_part, make, seed), parts):
            found += part
            print(f'{found.total()} of {count} cases, {failures(found)} failures, '
                  f'{time.monotonic() - begun:.0f} s', file=sys.stderr, flush=True)  # fmt: skip
    outcomes: Counter[str] = Counter()
    for (outcome, _), number in found.items():
        outcomes[outcome] += number
    for outcome, number in outcomes.most_common():
        print(f'{number:8d}  {outcome}')
    print(f'{failures(found)} failures in {count} cases of seed {seed}')
    return 1 if failures(found) else 0
