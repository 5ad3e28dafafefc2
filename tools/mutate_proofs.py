# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Changes proof folders in every way that it can, and looks whether the checker is deceived.

It makes a small proof of each kind, axes together and per axis, and checks changed copies of
both as `rpo prove --check` does: `python -m tools.mutate_proofs --cases 10000`. A case is drawn
from its number alone. All tubes are made anew (`--cells 0`); the checker's look at its own table
and at single ticks in rational numbers is left out, for no change of a folder touches them.

What is a lie? Not each change: a comment, cells in another order, or a limit that is larger leave
what is printed true. So a case that is accepted (no fault) is judged by what the command prints:

- Where controller, scenario and settings mean what they meant, it must print the claims, figures,
  ranges, box and names that it prints of the true folder. A figure that was flown may be missing.
  A claim that is for ever may have the bound of another invariant set, which the checker has
  shown to be one, if the flights below keep it.
- Where they mean something else, it must name other digests, and not call anything shipped that is
  not. Limits and units must be those of its requirements. Flights from the ends of its box, under
  the ends of its disturbance and mass, flown by `rpo_core.chain.flight` and for twice the time
  where a claim is for ever, must keep every bound and range that is printed.

Anything else is ACCEPTED. A case also fails if anything but one sentence comes out, or if it takes
more than 10 s of CPU time, or the process more than 1 GB.
"""

from __future__ import annotations

import argparse
import hashlib
import random
import resource
import shutil
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from rpo_core.chain.flight import Flight, fly
from rpo_core.control.controller import load_controller
from rpo_core.files.scenario import Scenario, load_set
from rpo_core.files.validation import InputError
from rpo_core.judge import metrics
from rpo_core.judge.requirements import Requirements
from rpo_core.world.disturbance import Disturbance, Harmonic
from rpo_proof import flights, proving
from rpo_proof.check import Checked, Sample, check
from rpo_proof.claims import Claim, values_of
from rpo_proof.folder import TEXTS, Folder, origins
from rpo_proof.problem import Problem, Settings, range_of, title_of
from tools.mutate_runs import MOST_BYTES, MOST_S, add_options, judge_all
from tools.proof_mutations import mutate

KINDS = ('together', 'apart')
SAMPLE = Sample(starts=0, ticks=0, surface=0)
JUDGES = 40
"""Flights that judge what was accepted of other premises."""


def problem_of(kind: str) -> Problem:
    """Return a small problem: axes together, for ever, one claim refuted; or per axis."""
    base, controller = load_set('paper_training').base, load_controller('robust')
    required: dict[str, Any] = {'mean_error_norm_m': 0.5, 'mean_speed_norm_m_s': 0.05}
    required |= {'hold_error_per_axis_m': 0.5, 'mean_window_s': 10.0}
    if kind == 'together':
        half = 0.6, 0.4, 0.2, 0.001, 0.001, 0.001
        required |= {'slew_per_axis_n_s': 0.04, 'hold_from_s': 40.0}
        base = replace(base, duration_s=50.0)
        settings = Settings(centre=(0.0,) * 6, half=half, coarseness=4.0, cell_m=0.3)
    else:
        known = Disturbance((0.0, 0.002, 0.0), (Harmonic('x', 'sin', 0.004, 0.05),))
        required |= {'hold_from_s': 50.0}
        base = replace(
            base, duration_s=60.0, initial_position_m=(0.5, 0.5, -0.5), disturbance=known
        )
        settings = Settings(
            centre=base.start,
            half=(0.2, 0.2, 0.2, 0.01, 0.01, 0.01),
            coarseness=4.0,
            axes_apart=True,
            disturbance_share=1.0,
            cell_m=0.5,
            cell_m_s=0.02,
        )
    named = replace(base, name=f'small_{kind}', requirements=Requirements(**required))
    return Problem.of(controller, named, settings)


def proof_of(kind: str, path: Path) -> Folder:
    """Make the small proof of a kind in a folder."""
    folder = Folder.create(path, problem_of(kind))
    proving.prove(folder, 1, '', lambda *_: None, probes=20)
    return Folder.open(path)


def printed(folder: Folder, found: Checked) -> dict[str, Any]:
    """Return what the command prints of a folder in which it finds no fault."""
    return {
        'title': title_of(folder.problem),
        'range': range_of(folder.problem),
        'claims': found.claims,
        'ranges': found.ranges,
        'origins': origins(folder),
        'whole': found.whole,
    }


class Case:
    """Checks changed copies of one proof's folder.

    true : the true folder, in which the checker finds no fault
    """

    def __init__(self, true: Folder) -> None:
        self.true = true
        found = check(self.true, SAMPLE)
        if found.faults or not found.whole:
            raise InputError(f'the small proof must be right; {found.faults}')
        self.printed = printed(self.true, found)

    def judge(self, seed: int, number: int, scratch: Path) -> tuple[str, str]:
        """Return the outcome of a case: a word, and what was changed."""
        rng, folder = random.Random(f'{seed} {number}'), scratch / 'case' / 'proof'
        shutil.rmtree(scratch / 'case', ignore_errors=True)
        shutil.copytree(self.true.path, folder)
        kind = mutate(rng, folder)
        outcome, took_s = self._timed(folder)
        if took_s > MOST_S:
            outcome = 'TOO SLOW'
        if resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 > MOST_BYTES:
            outcome = 'TOO LARGE'
        return outcome, kind

    def _timed(self, folder: Path) -> tuple[str, float]:
        begun = time.process_time()
        try:
            opened = Folder.open(folder)
            found = check(opened, SAMPLE)
        except InputError as error:
            return 'refused' if '\n' not in str(error) else 'NOT ONE SENTENCE', _since(begun)
        except Exception as error:  # whatever comes out is what this program looks for
            return f'TRACEBACK {type(error).__name__} {error}', _since(begun)
        took_s = _since(begun)
        if found.faults:
            return 'found', took_s
        return self.accepted(opened, printed(opened, found)), took_s

    def accepted(self, folder: Folder, now: dict[str, Any]) -> str:
        """Judge what is printed of a folder that was accepted."""
        lie = next(self._lies(folder, now), '')
        if lie:
            return f'ACCEPTED {lie}'
        same = folder.problem.texts == self.true.problem.texts
        return 'accepted, says the same' if same else 'accepted, says what is true of others'

    def _lies(self, folder: Folder, now: dict[str, Any]) -> Iterator[str]:
        if not now['whole']:
            yield 'without a look at all tubes'
        yield from self._lies_of_names(folder, now['origins'])
        if folder.problem.texts == self.true.problem.texts:
            for name in ('title', 'range', 'ranges'):
                if now[name] != self.printed[name]:
                    yield f'another {name}'
            rest = folder.summary()['rest']
            for ours, theirs in zip(now['claims'], self.printed['claims'], strict=True):
                if 'for ever' in ours.statement and rest and ours.bound >= rest['radius_m']:
                    theirs = replace(theirs, bound=ours.bound)
                if _unflown(ours) != _unflown(theirs):
                    yield 'other claims'
                elif ours.start and ours != theirs:
                    yield 'another flight'
            yield from _broken(folder.problem, now)
        else:
            yield from _broken(folder.problem, now)

    def _lies_of_names(self, folder: Folder, lines: list[str]) -> Iterator[str]:
        """Yield digests that are not those of the files, and names that nothing ships."""
        for name, line in zip(TEXTS, lines, strict=False):
            if hashlib.sha256((folder.path / name).read_bytes()).hexdigest() not in line:
                yield f'a digest that {name} does not have'
        controller, scenario = lines
        robust = folder.problem.controller == load_controller('robust')
        if controller.startswith('controller: means the same') and not robust:
            yield 'another controller under a shipped name'
        if scenario.startswith('scenario: means the same'):
            yield 'a scenario that does not ship'


def _since(begun: float) -> float:
    return time.process_time() - begun


def _unflown(claim: Claim) -> Claim:
    return replace(claim, found=0.0, start=())


def _broken(problem: Problem, now: dict[str, Any]) -> Iterator[str]:
    """Yield what is printed and is not true of a problem: of its requirements, of flights."""
    required, claims = problem.scenario.requirements, {c.key: c for c in now['claims']}
    limits = {} if required is None else required.limits
    for key, claim in claims.items():
        if claim.limit != limits.get(key, 0.5) or claim.unit != metrics.UNITS[key]:
            yield f'another limit of {key}'
    for flight in _flights(problem):
        longer = replace(flight, duration_s=2.0 * flight.duration_s)
        flown = fly(flight, problem.controller)
        for key, value in values_of(problem, flown).items():
            if not value <= claims[key].bound:
                yield f'a bound of {key} that a flight exceeds'
        for key, value in _reached(flown).items():
            if not now['ranges'][key].low <= value <= now['ranges'][key].high:
                yield f'a range of {key} that a flight leaves'
        ever = claims.get('hold_error_per_axis_m')
        if ever is not None and 'for ever' in ever.statement:
            states = fly(longer, problem.controller).states[problem.hold_tick :, :3]
            if not np.abs(states).max() <= ever.bound:
                yield 'a bound for ever that a flight exceeds'


def _reached(flight: Flight) -> dict[str, float]:
    """Return what a flight reaches of the ranges that are printed."""
    forces = flight.saturated_forces_n[:-1]
    return {
        'energy_n2s': float((forces**2).sum()) * flight.scenario.dt_s,
        'force_n': float(np.abs(forces).max()),
        'speed_m_s': float(np.abs(flight.states[:, 3:]).max()),
    }


def _flights(problem: Problem) -> Iterator[Scenario]:
    """Yield flights from the corners of the box and between, under drawn disturbances."""
    rng, settings = np.random.default_rng(1), problem.settings
    centre, half = np.array(settings.centre), np.array(settings.half)
    for number in range(JUDGES):
        share = rng.uniform(-1.0, 1.0, 6)
        share = np.sign(share) if number < JUDGES // 2 else share
        yield flights.vary(problem, rng, centre + half * share)


def run_cases(kinds: tuple[str, ...], seed: int, first: int, last: int) -> Counter[tuple[str, str]]:
    """Judge the cases from `first` to before `last`; return how often each outcome came."""
    found: Counter[tuple[str, str]] = Counter()
    with tempfile.TemporaryDirectory() as scratch:
        cases = [Case(proof_of(kind, Path(scratch) / kind)) for kind in kinds]
        for number in range(first, last):
            outcome, kind = cases[number % len(cases)].judge(seed, number, Path(scratch))
            failed = outcome.split()[0].isupper()
            if failed:
                print(f'case {number}: {outcome}: {kind}', flush=True)
            found[outcome, kind if failed else ''] += 1
    return found


def _work(kinds: tuple[str, ...], seed: int, part: tuple[int, int]) -> Counter[tuple[str, str]]:
    return run_cases(kinds, seed, *part)


def main() -> int:
    """Entry point."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    add_options(parser)
    parser.add_argument('--kind', choices=KINDS, action='append', help='may be repeated  [both]')
    options = parser.parse_args()
    work = partial(_work, tuple(options.kind or KINDS), options.seed)
    return judge_all(work, options, size=500)


if __name__ == '__main__':
    sys.exit(main())
