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

Anything else is ACCEPTED. A case also fails as every case of `tools.mutating`. The forger changes
arrays, figures, texts and whole files. Then he makes the rest fit, as far as he can without new
tubes: digests of the premises, and a summary that follows from his cells.
"""

from __future__ import annotations

import copy
import hashlib
import io
import pickle
import random
import shutil
import sys
import warnings
import zipfile
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from functools import partial
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
from tools.mutating import Case, flipped, judge_all, parser_of, replace_file

Arrays = dict[str, NDArray[Any]]

NUMBERS = (0.0, -0.0, 1e-300, 1e300, float('inf'), -float('inf'), float('nan'), 1.0, -1.0, 1e9)
SHARES = (-1.0, 0.0, 0.5, 0.9, 1.0 - 1e-9, 1.0 + 1e-9, 1.1, 2.0, 1e3, 20.0)
WORDS = (
    'proven', 'refuted', 'undecided', 'allround', 'robust', 'paper_test', 'mm', 'km', 'for ever',
)  # fmt: skip
VERSIONS = 'versions.yaml'
LARGE = 1 << 22
"""A file that is larger is not taken apart."""


def mutate(rng: random.Random, folder: Path) -> str:
    """Change a proof's folder; return what kind of change it was."""
    ways = rng.choices(
        (_arrays, _summary, _premise, _flight, _versions, _bytes, _file),
        (40, 20, 14, 6, 2, 8, 10),
        k=rng.choice((1, 1, 1, 2)),
    )
    with np.errstate(all='ignore'), warnings.catch_warnings():
        warnings.simplefilter('ignore')
        found = [way(rng, folder) for way in ways]
    if rng.random() < 0.7 and set(ways) & {_premise, _versions, _bytes, _file}:
        found.append(_stamp(folder))
    if rng.random() < 0.5:
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
    _write(rng, path, arrays)
    return f'{path.name} {"+".join(names)}'


def _write(rng: random.Random, path: Path, arrays: Arrays) -> None:
    content = io.BytesIO()
    np.savez(content, allow_pickle=True, **arrays)  # type: ignore[arg-type]
    if arrays and rng.random() < 0.02:  # an array twice: the true one, and another
        name, twice = rng.choice(sorted(arrays)), io.BytesIO()
        np.lib.format.write_array(twice, np.zeros_like(arrays[name]))
        with zipfile.ZipFile(content, 'a') as archived:
            archived.writestr(f'{name}.npy', twice.getvalue())
    path.write_bytes(content.getvalue())


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


def _kind(rng: random.Random, arrays: Arrays) -> None:
    """Another type."""
    name = rng.choice(sorted(arrays))
    kind = rng.choice((np.float32, np.int64, complex, '>f8', object, bool, 'U8', np.float16))
    arrays[name] = arrays[name].astype(kind)


def _shape(rng: random.Random, arrays: Arrays) -> None:
    """Another shape."""
    name = rng.choice(sorted(arrays))
    values = arrays[name]
    ways = (
        values.T,
        values[None],
        values.ravel(),
        values[:0],
        values[..., :-1],
        values[:1],
        values[()],
    )
    arrays[name] = rng.choice(ways) if values.ndim else values.reshape(1, 1)


def _missing(rng: random.Random, arrays: Arrays) -> None:
    """Less, more or others."""
    name = rng.choice(sorted(arrays))
    way = rng.randrange(3)
    if way == 0 and len(arrays) > 1:
        del arrays[name]
    elif way == 1:
        arrays['more'] = np.zeros(3)
    else:
        arrays['more' if rng.random() < 0.3 else rng.choice(sorted(arrays))] = arrays[name]


def _pick(rng: random.Random, arrays: Arrays) -> int:
    return rng.randrange(max(1, len(arrays['values'])))


def _rows(arrays: Arrays, order: Any) -> None:
    for name in ('centre', 'half', 'values', 'boxes'):
        arrays[name] = arrays[name][order]


def _swap(rng: random.Random, arrays: Arrays) -> None:
    """Exchange what is known of two cells; or all of them, which is no lie."""
    order = np.arange(len(arrays['values']))
    a, b = _pick(rng, arrays), _pick(rng, arrays)
    order[[a, b]] = order[[b, a]]
    if rng.random() < 0.1:
        _rows(arrays, order)
    else:
        name = rng.choice(('values', 'boxes', 'centre', 'half'))
        arrays[name] = arrays[name][order]


def _drop(rng: random.Random, arrays: Arrays) -> None:
    _rows(arrays, np.delete(np.arange(len(arrays['values'])), _pick(rng, arrays)))


def _repeat(rng: random.Random, arrays: Arrays) -> None:
    _rows(arrays, [*range(len(arrays['values'])), _pick(rng, arrays)])


def _wide(rng: random.Random, arrays: Arrays) -> None:
    """Make a cell, or all, wider or narrower, or put it elsewhere."""
    at: Any = rng.choice((_pick(rng, arrays), slice(None)))
    if rng.random() < 0.7:
        arrays['half'][at] *= rng.choice(SHARES)
    else:
        arrays['centre'][at] += rng.choice((1e-9, -1e-3, 0.1, 1.0))


def _low(rng: random.Random, arrays: Arrays) -> None:
    """Lower bounds, of a cell or of all."""
    at: Any = rng.choice((_pick(rng, arrays), slice(None)))
    column: Any = rng.choice((slice(3, None), rng.randrange(3, len(VALUES))))
    arrays['values'][at, column] *= rng.choice((0.0, 0.5, 0.99, 1.0 - 1e-12))


def _earlier(rng: random.Random, arrays: Arrays) -> None:
    """Other times, or boxes of other times."""
    if rng.random() < 0.3:
        arrays['boxes'] = np.roll(arrays['boxes'], rng.choice((-1, 1)), axis=1)
        return
    column = VALUES.index(rng.choice(('last_s', 'inside_s', 'arrival_s')))
    arrays['values'][_pick(rng, arrays), column] += rng.choice((-0.1, 0.1, -1e3, 10.0, 1e-9))


def _unseen(rng: random.Random, arrays: Arrays) -> None:
    """Let a cell not be looked at: no tube, empty, or not a number."""
    at = _pick(rng, arrays)
    arrays['values'][at, VALUES.index('last_s')] = rng.choice((float('nan'), 0.0, -0.1, -1.0, -0.0))
    if rng.random() < 0.6:
        arrays['values'][at, VALUES.index('inside_s')] = rng.choice((float('inf'), 0.0))
        arrays['values'][at, 3:] = rng.choice((0.0, float('nan'), float('inf'), -1.0))


def _closer(rng: random.Random, arrays: Arrays) -> None:
    """Less that is reached, or norms that are smaller."""
    name = rng.choice(('tail', 'reach'))
    arrays[name] = arrays[name] * rng.choice((0.0, 0.5, 0.999, 1.0 - 1e-12, -1.0))


CELLS: tuple[Change, ...] = (
    _number, _number, _number, _swap, _drop, _repeat, _wide, _wide, _low, _low, _earlier, _unseen,
    _unseen, _closer,
)  # fmt: skip
ANY: tuple[Change, ...] = (_number, _number, _kind, _shape, _missing)


def _leaves(document: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Return the places of a document: of values, lists and mappings."""
    found = [path] if path else []
    pairs: Any = ()
    if isinstance(document, dict):
        pairs = document.items()
    elif isinstance(document, list):
        pairs = enumerate(document)
    return [*found, *(leaf for key, value in pairs for leaf in _leaves(value, (*path, key)))]


def _edit(rng: random.Random, path: Path) -> str:
    """Change a value of a YAML file, or a line of it."""
    try:
        text = _text(path)
        document = yaml.safe_load(text)
    except (OSError, ValueError, yaml.YAMLError):
        return ''
    places = _leaves(document)
    if not places or rng.random() < 0.1:
        return f'{path.name} {_line(rng, path, text)}'
    place = rng.choice(places)
    holder = document
    for key in place[:-1]:
        holder = holder[key]
    value = holder[place[-1]]
    what = rng.randrange(10)
    if what == 0 and isinstance(holder, dict):
        del holder[place[-1]]
    elif what == 1 and isinstance(holder, dict):
        holder[f'{place[-1]}x'] = copy.deepcopy(value)
    elif what == 2:
        holder[place[-1]] = rng.choice(([value], {'x': value}, [], {}, None, str(value), True))
    elif isinstance(value, bool):
        holder[place[-1]] = not value
    elif isinstance(value, (int, float)):
        near = [value * share for share in SHARES]
        holder[place[-1]] = rng.choice((*near, *near, *NUMBERS, int(abs(value)), 1 << 70))
    else:
        holder[place[-1]] = rng.choice((*WORDS, 'x', '', '\x1b[2J', '9' * 5000))
    path.write_text(yaml.safe_dump(document, sort_keys=False))
    return f'{path.name} {".".join(map(str, place))}'


def _line(rng: random.Random, path: Path, text: str) -> str:
    """Change a line: twice, not at all, or a comment behind it, which is no lie."""
    lines = text.split('\n')
    at = rng.randrange(len(lines))
    way = rng.choice(('twice', 'dropped', 'comment', 'list', 'tag'))
    lines[at : at + 1] = {
        'twice': [lines[at]] * 2,
        'dropped': [],
        'comment': [f'{lines[at]} # {rng.choice(WORDS)}'],
        'list': [f'- {line}' for line in lines],
        'tag': [lines[at].replace(': ', ': !!python/object/apply:os.getcwd ', 1)],
    }[way]
    path.write_text('\n'.join(lines))
    return f'line {way}'


def _summary(rng: random.Random, folder: Path) -> str:
    return _edit(rng, folder / SUMMARY)


def _premise(rng: random.Random, folder: Path) -> str:
    """Change controller, scenario or settings; or put another controller under the same name."""
    if rng.random() < 0.1:
        other = replace(load_controller(rng.choice(('trained', 'handmade'))), name='robust')
        (folder / TEXTS[0]).write_text(dumps(other))
        return 'another controller'
    return _edit(rng, folder / rng.choice(TEXTS))


def _versions(rng: random.Random, folder: Path) -> str:
    return _edit(rng, folder / VERSIONS)


def _flight(rng: random.Random, folder: Path) -> str:
    """Change a flight of a claim, or let it be that of another claim."""
    paths = sorted([*folder.glob('counterexample_*.yaml'), *folder.glob('flown_*.yaml')])
    paths = [path for path in paths if path.is_file()]
    if not paths:
        return ''
    path, other = rng.choice(paths), rng.choice(paths)
    if rng.random() < 0.2:
        replace_file(rng, 'swap', path, other, other)
        return f'{path.name} exchanged'
    return _edit(rng, path)


def _bytes(rng: random.Random, folder: Path) -> str:
    """Change bytes of a file, or cut it short."""
    paths = sorted(p for p in folder.iterdir() if p.is_file() and 0 < p.stat().st_size < LARGE)
    path = rng.choice(paths)
    data = path.read_bytes()
    at = rng.randrange(len(data))
    changed = flipped(rng, data, at)
    path.write_bytes(rng.choice((changed, changed, data[:at], data[:at] + b'\0' + data[at:], b'')))
    return f'{path.name} bytes'


def _file(rng: random.Random, folder: Path) -> str:
    """Remove, exchange, rename or add a file, or put in its place what is none."""
    paths = sorted(p for p in folder.iterdir() if p.is_file() and not p.is_symlink())
    path, other = rng.choice(paths), rng.choice(paths)
    what = rng.choice(
        ('remove', 'swap', 'rename', 'link', 'pipe', 'folder', 'more', 'pickle', 'sparse')
    )
    if what == 'more':
        shutil.copy(
            path, folder / rng.choice(('notes\n.txt', 'q.npz', f'counterexample_{path.name}'))
        )
    elif what == 'pickle':
        path.write_bytes(pickle.dumps({'values': [1.0]}))
    elif what == 'rename':
        path.rename(other)
    else:
        if what == 'link':
            (folder.parent / 'aside').write_bytes(path.read_bytes())
        replace_file(rng, what, path, other, folder.parent / 'aside')
    return f'{path.name} {what}'


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


def main() -> int:
    """Entry point."""
    parser = parser_of(__doc__)
    parser.add_argument('--kind', choices=KINDS, action='append', help='may be repeated  [both]')
    options = parser.parse_args()
    return judge_all(partial(cases_of, kinds=tuple(options.kind or KINDS)), options, size=500)


if __name__ == '__main__':
    sys.exit(main())
