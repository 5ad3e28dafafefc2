# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Proofs under attack: what `rpo prove --check` says of changed copies of a proof's folder.

A small proof of each kind is made, axes together and per axis. All tubes are made anew (`--cells
0`); the checker's look at its own table and at single ticks in rational numbers is left out, for no
change of a folder touches them.

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

Anything else is ACCEPTED. The forger changes arrays, figures, texts and whole files. Then he makes
the rest fit, as far as he can without new tubes: digests of the premises, and a summary that
follows from his cells.
"""

from __future__ import annotations

import hashlib
import io
import random
import shutil
import warnings
import zipfile
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from rpo_core.chain.flight import Flight, fly
from rpo_core.control.controller import dumps, load_controller
from rpo_core.files.scenario import Scenario, load_set
from rpo_core.files.validation import InputError
from rpo_core.judge import metrics
from rpo_core.judge.requirements import Requirements
from rpo_core.world.disturbance import Disturbance, Harmonic
from rpo_montecarlo.outputs import digest_of
from rpo_proof import flights, proving
from rpo_proof.cells import VALUES
from rpo_proof.check import Checked, Sample, WrittenSummary, check, recompute
from rpo_proof.claims import Claim, summary_of, values_of
from rpo_proof.folder import SUMMARY, TEXTS, Folder, origins
from rpo_proof.problem import Problem, Settings, range_of, title_of
from tools.attack.cases import Case
from tools.attack.edits import NUMBERS, SHARES, displace, edit, reordered, spoil

Arrays = dict[str, NDArray[Any]]

VERSIONS = 'versions.yaml'
LARGE = 1 << 22
"""A file that is larger is not taken apart."""


def _summary(rng: random.Random, folder: Path) -> str:
    return _edit(rng, folder / SUMMARY)


def _versions(rng: random.Random, folder: Path) -> str:
    return _edit(rng, folder / VERSIONS)


def mutate(rng: random.Random, folder: Path) -> str:
    """Change a proof's folder; return what kind of change it was."""
    ways = rng.choices(
        (_arrays, _summary, _premise, _flight, _versions, _file),
        (40, 20, 14, 6, 2, 18),
        k=rng.choice((1, 1, 1, 2)),
    )
    with np.errstate(all='ignore'), warnings.catch_warnings():
        warnings.simplefilter('ignore')
        found = [way(rng, folder) for way in ways]
    if rng.random() < 0.7 and set(ways) & {_premise, _versions, _file}:
        found.append(_stamp(folder))
    if rng.random() < 0.7:
        found.append(_summarise(folder))
    return '; '.join(filter(None, found))


def _text(path: Path) -> str:
    """Return a text; raises OSError where there is none, or none of ours."""
    if not path.is_file() or path.stat().st_size > LARGE:
        raise OSError(f'{path}: must be a small file')
    return path.read_text()


def _stamp(folder: Path) -> str:
    """Write the digest that fits controller, scenario and settings."""
    try:
        problem = Problem.of_texts([_text(folder / name) for name in TEXTS])
        recorded = yaml.safe_load(_text(folder / VERSIONS))
        recorded['files_sha256'] = digest_of(*problem.texts)
    except (OSError, ValueError, TypeError, yaml.YAMLError):
        return ''
    (folder / VERSIONS).write_text(yaml.safe_dump(recorded))
    return 'digest fits'


def _summarise(folder: Path) -> str:
    """Write the summary that follows from the cells, and from flights as they are said to be."""
    try:
        found = Folder.open(folder)
        problem, written = found.problem, WrittenSummary.of(found)
        groups = {group: found.cells(group) for group in problem.groups}
        follows = recompute(problem, groups, written, written.flown)
        document = summary_of(follows.claims, written.omega, follows.ranges, groups)
    except (InputError, OverflowError):
        return ''
    (folder / SUMMARY).write_text(yaml.safe_dump(document, sort_keys=False))
    return 'summary fits'


def _arrays(rng: random.Random, folder: Path) -> str:
    """Change an array of cells, or now and then of the table."""
    paths = sorted(path for path in folder.glob('*.npz') if path.stat().st_size < LARGE)
    if not paths:
        return ''
    path = rng.choices(paths, [1 if path.stem == 'table' else 8 for path in paths])[0]
    try:
        with np.load(path, allow_pickle=False) as saved:
            arrays: Arrays = {name: saved[name] for name in saved.files}
    except (ValueError, OSError, zipfile.BadZipFile, EOFError, KeyError):
        return ''
    if not arrays:
        return ''
    names = []
    changes = CELLS if 'half' in arrays and rng.random() < 0.7 else ANY
    for _ in range(rng.choice((1, 1, 2))):
        change = rng.choice(changes)
        with suppress(KeyError, IndexError, ValueError, TypeError):  # changed already, out of shape
            change(rng, arrays)
            names.append(change.__name__)
    content = io.BytesIO()
    np.savez(content, allow_pickle=True, **arrays)
    if arrays and rng.random() < 0.02:  # an array twice: the true one, and another
        name, twice = rng.choice(sorted(arrays)), io.BytesIO()
        np.lib.format.write_array(twice, np.zeros_like(arrays[name]))
        with zipfile.ZipFile(content, 'a') as archived:
            archived.writestr(f'{name}.npy', twice.getvalue())
    path.write_bytes(content.getvalue())
    return f'{path.name} {"+".join(names)}'


Change = Callable[[random.Random, Arrays], None]


def _number(rng: random.Random, arrays: Arrays) -> None:
    """Another number somewhere, in a column, or everywhere."""
    name = rng.choice(sorted(arrays))
    values = np.array(arrays[name], copy=True)
    if values.dtype != object and values.size:
        at: Any = np.unravel_index(rng.randrange(values.size), values.shape)
        at = rng.choice((at, at, at[-1:] and (..., at[-1]), at[:1], ...))
        number, share = rng.choice(NUMBERS), rng.choice(SHARES)
        scaled = rng.random() < 0.6
        if values.dtype.kind in 'iu' and not (scaled or abs(number) < 2.0**31):
            values = values.astype(np.float64)  # integers have no infinity
        values[at] = values[at] * share if scaled else number
    arrays[name] = values


def _form(rng: random.Random, arrays: Arrays) -> None:
    """Another type or shape; fewer arrays, more or others."""
    name, another = rng.choice(sorted(arrays)), rng.choice((*sorted(arrays), 'more'))
    values, kinds = arrays[name], (np.float32, np.int64, complex, '>f8', object, bool, 'U8')
    ways: list[Callable[[], Any]] = [
        lambda: {name: values.astype(rng.choice(kinds))},
        lambda: {name: rng.choice((values.T, values[None], values.ravel(), values[()]))},
        lambda: {name: rng.choice((values[:0], values[..., :-1], values[:1]))},
        lambda: {another: rng.choice((values, np.zeros(3)))},
    ]
    if len(arrays) > 1 and rng.random() < 0.1:
        del arrays[name]
    else:
        arrays |= rng.choice(ways)()


def _rows(rng: random.Random, arrays: Arrays) -> None:
    """Other cells, which may be no lie, or what is known of them in another order."""
    order = reordered(rng, len(arrays['values']))
    names = ('centre', 'half', 'values', 'boxes')
    for name in names if rng.random() < 0.6 else (rng.choice(names),):
        arrays[name] = arrays[name][order]


LOWER = (0.0, 0.5, 0.99, 1.0 - 1e-12)
"""Shares to which a bound is lowered."""


def _cells(rng: random.Random, arrays: Arrays) -> None:
    """Other places, sizes, bounds and times of a cell or of all; a cell that is not looked at."""
    at: Any = rng.choice((rng.randrange(max(1, len(arrays['values']))), slice(None)))
    kinds = 'half', 'centre', 'bounds', 'bounds', 'times', 'unseen'
    what, values = rng.choice(kinds), arrays['values']
    if what == 'half':
        arrays['half'][at] *= rng.choice(SHARES)
    elif what == 'centre':
        arrays['centre'][at] += rng.choice((1e-9, -1e-3, 0.1, 1.0))
    elif what == 'bounds':
        column: Any = rng.choice((slice(3, None), rng.randrange(3, len(VALUES))))
        values[at, column] *= rng.choice(LOWER)
    elif what == 'times':
        column = VALUES.index(rng.choice(('last_s', 'inside_s', 'arrival_s')))
        values[at, column] += rng.choice((-0.1, 0.1, -1e3, 10.0, 1e-9))
    else:
        values[at, VALUES.index('last_s')] = rng.choice((float('nan'), 0.0, -0.1, -1.0, -0.0))
        if rng.random() < 0.6:
            values[at, VALUES.index('inside_s')] = rng.choice((float('inf'), 0.0))
            values[at, 3:] = rng.choice((0.0, float('nan'), float('inf'), -1.0))


def _closer(rng: random.Random, arrays: Arrays) -> None:
    """Less that is reached, norms that are smaller, boxes of other times."""
    name = rng.choice(('tail', 'reach', 'boxes'))
    if name == 'boxes':
        arrays[name] = np.roll(arrays[name], rng.choice((-1, 1)), axis=1)
    else:
        arrays[name] = arrays[name] * rng.choice((*LOWER, -1.0))


CELLS: tuple[Change, ...] = (
    _number,
    _number,
    _rows,
    _rows,
    _cells,
    _cells,
    _cells,
    _cells,
    _closer,
)
ANY: tuple[Change, ...] = (_number, _form)


def _edit(rng: random.Random, path: Path) -> str:
    """Change a value of a YAML file, or a line of it."""
    try:
        document = yaml.safe_load(_text(path))
        if rng.random() < 0.1:
            return f'{path.name} {spoil(rng, path)}'
        place = edit(rng, document)
    except (OSError, ValueError, IndexError, yaml.YAMLError):
        return ''
    path.write_text(yaml.safe_dump(document, sort_keys=False))
    return f'{path.name} {place}'


def _premise(rng: random.Random, folder: Path) -> str:
    """Change controller, scenario or settings; or put another controller under the same name."""
    if rng.random() < 0.1:
        another = replace(load_controller(rng.choice(('trained', 'handmade'))), name='robust')
        (folder / TEXTS[0]).write_text(dumps(another))
        return 'another controller'
    return _edit(rng, folder / rng.choice(TEXTS))


def _flight(rng: random.Random, folder: Path) -> str:
    """Change a flight of a claim."""
    paths = sorted([*folder.glob('counterexample_*.yaml'), *folder.glob('flown_*.yaml')])
    return _edit(rng, rng.choice(paths)) if paths else ''


def _file(rng: random.Random, folder: Path) -> str:
    """Change bytes or a line of a file, or let something else be in its place."""
    paths = sorted(p for p in folder.iterdir() if p.is_file() and not p.is_symlink())
    path = rng.choice(paths)
    if rng.random() < 0.4 and path.stat().st_size < LARGE:
        return f'{path.name} {spoil(rng, path)}'
    return f'{path.name} {displace(rng, path, STRAY)}'


STRAY = ('notes\n.txt', 'q.npz', 'counterexample_peace.yaml', 'counterexample_planar.npz')
"""Names of files that are put beside those of a proof."""

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


class ProofCase(Case):
    """Checks changed copies of one proof's folder.

    true : the true folder, in which the checker finds no fault
    """

    def __init__(self, true: Folder) -> None:
        self.true = true
        found = check(self.true, SAMPLE)
        if found.faults or not found.whole:
            raise InputError(f'the small proof must be right; {found.faults}')
        self.printed = printed(self.true, found)

    def change(self, rng: random.Random, scratch: Path) -> tuple[Path, str]:
        """Return a changed copy of the folder, and what was changed."""
        folder = scratch / 'proof'
        shutil.copytree(self.true.path, folder)
        return folder, mutate(rng, folder)

    def outcome(self, folder: Path) -> str:
        """Check a changed folder; return what came out, in capitals if it must not."""
        opened = Folder.open(folder)
        found = check(opened, SAMPLE)
        return 'found' if found.faults else self.accepted(opened, printed(opened, found))

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


def cases_of(scratch: Path, kinds: tuple[str, ...] = KINDS) -> list[ProofCase]:
    """Return a case for the proof of each kind, which is made in a folder of scratch."""
    return [ProofCase(proof_of(kind, scratch / kind)) for kind in kinds]
