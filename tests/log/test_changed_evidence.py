# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A forger changes a run, a signed run or a proof: no checker takes a lie for the truth.

Whatever it is, the answer is a verdict or one sentence, within 10 s of CPU time and 1 GB.
"""

from __future__ import annotations

import os
import resource
import shutil
import stat
import time
import zipfile
from contextlib import suppress
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
import yaml
from hostile import other, spoilt
from hypothesis import given, reject, settings
from hypothesis import strategies as st
from log_runs import Parts, record
from mcap.writer import CompressionType
from proofs import KINDS, SAMPLE, problem_of_kind, proof_of

from rpo.montecarlo.outputs import digest_of
from rpo.proof import check, flights
from rpo.proof.claims import summary_of, values_of
from rpo.proof.folder import SUMMARY, TEXTS, Folder, origins
from rpo.proof.problem import Problem, range_of, title_of
from rpo_core.chain.flight import fly
from rpo_core.control.controller import dumps, load_controller
from rpo_core.files.validation import InputError
from rpo_log import signature
from rpo_log.errors import ExitCode
from rpo_log.format.run import SIGNATURE_FILE, SUMS_FILE
from rpo_log.read.run_log import read_run
from rpo_log.tools.diff import inspect
from rpo_log.verify import verify

READ = 'run.mcap', 'run_0.mcap', 'run_1.mcap', 'metadata.yaml'
STRAY = *READ, 'run_².mcap', 'notes\n.txt', 'q.npz'
NOT_WRITTEN = Exception
"""Whatever a writer raises that refuses a change: it is no lie."""
RNG = st.randoms(use_true_random=False)


def displace(rng, folder, path):
    """Let something else be in the place of a file, or its copy beside it, under another name."""
    aside = folder.parent / 'aside'
    beside = rng.choice(sorted(p for p in folder.iterdir() if p.is_file()))
    shutil.copy(path, aside)
    way = rng.choice(('copy', 'other', 'long', 'remove', 'link', 'link', 'pipe', 'folder'))
    if way in ('copy', 'other'):
        shutil.copy(*(path, folder / rng.choice(STRAY)) if way == 'copy' else (beside, path))
    elif way == 'long':
        os.truncate(path, rng.choice((1 << 36, 1 << 30)))
    else:
        path.unlink()
        if way == 'link':
            path.symlink_to(rng.choice((aside, beside)))
        elif way != 'remove':
            (os.mkfifo if way == 'pipe' else os.mkdir)(path)


def records(rng, path):
    """Change a record of a log, the rare ones as often as messages, or its place."""
    parts = Parts.of(path)
    found = parts.records
    kind = rng.choice(sorted({type(record) for record in found}, key=str))
    at = rng.choice([at for at, record in enumerate(found) if type(record) is kind])
    one = found.pop(at)
    changed = one and other(rng, one)
    at = rng.choice((at, at, at, rng.randrange(len(found))))
    found[at:at] = rng.choice(([changed], [changed], [changed], [one], [one, one], []))
    parts.compression = rng.choice(list(CompressionType))
    parts.write(path)


def arrays(rng, path):
    """Change an array of cells; now and then one is there twice."""
    with np.load(path, allow_pickle=False) as saved:
        found = other(rng, {name: saved[name] for name in saved.files})
    np.savez(path, allow_pickle=True, **found)
    if rng.random() < 0.05:
        with zipfile.ZipFile(path, 'a') as archive:
            archive.writestr(f'{rng.choice(sorted(found))}.npy', b'')


def change(rng, folder):
    """Change a file: what it holds, its bytes, or what is in its place."""
    path = rng.choice(sorted(path for path in folder.iterdir() if path.is_file()))
    inside, way = {'.mcap': records, '.npz': arrays}.get(path.suffix), rng.random()
    if way < 0.1:
        displace(rng, folder, path)
    elif inside is not None and way < 0.8:
        inside(rng, path)
    elif path.suffix == '.yaml' and way < 0.8:
        document = other(rng, yaml.safe_load(path.read_text()))
        more = rng.choice(('', '', '# x\n', '- x\n'))
        path.write_text(yaml.safe_dump(document, sort_keys=False) + more)
    else:
        path.write_bytes(spoilt(rng, path.read_bytes()))


def change_run(rng, folder):
    """Change a run; then its digests are kept, fit, or lack."""
    change(rng, folder)
    way = rng.choice(('kept', 'fit', 'fit', 'lack'))
    if way == 'fit' and all(path.stat().st_size < 1 << 28 for path in folder.iterdir()):
        signature.write_sums(folder)
    elif way == 'lack':
        (folder / SUMS_FILE).unlink()


def lie(rng, folder, another, key):
    """Change a signed run; `another` is signed with the same key, `key` is the forger's own."""
    way = rng.choice(('change', 'change', 'exchange', 'exchange', 'sums', 'signature', 'forge'))
    another = shutil.copytree(another, folder.parent / 'another')
    if way == 'change':
        change(rng, folder)
    elif way == 'exchange':  # files of the other run, or its log beside the true one
        there = sorted(path.name for path in another.iterdir() if path.is_file())
        logs, seals = [name for name in there if 'run' in name], [SUMS_FILE, SIGNATURE_FILE]
        for name in rng.choice((logs, [rng.choice(there)], seals, seals[:1], seals[1:])):
            target = folder / rng.choice((name, name, *STRAY))
            target.unlink(missing_ok=True)
            rng.choice((shutil.copy, os.link, os.symlink))(another / name, target)
    elif way == 'sums':
        lines = (folder / SUMS_FILE).read_text().splitlines()
        at = rng.randrange(len(lines))
        digest, _, name = lines[at].partition('  ')
        ways = (
            [], [lines[at]] * 2, [lines[at], f'{"0" * 64}  {name}'], [f'{digest}  {name}.old'],
            [f'{digest.upper()}  {name}'], [f'{lines[at]}\r'], [f'{digest} *{name}'],
            [f' {lines[at]}'], [f'{digest}  ./{name}'], [f'{digest}  {folder.absolute()}/{name}'],
            [f'\\{lines[at]}'], [f'# {lines[at]}'], [lines[at], f'{digest}  {SUMS_FILE}'],
        )  # fmt: skip
        text = '\n'.join([*lines[:at], *rng.choice(ways), *lines[at + 1 :]])
        (folder / SUMS_FILE).write_text(text + rng.choice(('\n', '', '\n\n', '\0\n')))
    elif way == 'signature':
        found = (folder / SIGNATURE_FILE).read_bytes()
        ways = spoilt(rng, found), found + b'\0', b'', bytes(64), found.hex().encode(), found * 2
        (folder / SIGNATURE_FILE).write_bytes(rng.choice(ways))
    if way == 'forge' or (way == 'change' and rng.random() < 0.3):
        kept, fitting = (folder / SIGNATURE_FILE).read_bytes(), signature.write_sums(folder)
        if rng.random() < 0.5:
            signature.sign(folder, fitting, signature.load_key(key))
        elif rng.random() < 0.5:
            (folder / SIGNATURE_FILE).write_bytes(kept)


def change_proof(rng, folder):
    """Change a proof; then make digest and summary fit, as far as it goes without new tubes."""
    if rng.random() < 0.05:
        (folder / TEXTS[0]).write_text(dumps(replace(load_controller('handmade'), name='allround')))
    else:
        change(rng, folder)
    with suppress(NOT_WRITTEN):
        problem = Problem.of_texts([(folder / name).read_text() for name in TEXTS])
        stated = yaml.safe_load((folder / 'versions.yaml').read_text())
        stated['files_sha256'] = digest_of(*problem.texts)
        if rng.random() < 0.7:
            (folder / 'versions.yaml').write_text(yaml.safe_dump(stated))
        found = Folder.open(folder)
        groups = {group: found.cells(group) for group in found.problem.groups}
        written = check.WrittenSummary.of(found)
        follows = check.recompute(found.problem, groups, written, written.flown)
        document = summary_of(follows.claims, written.omega, follows.ranges, groups)
        if rng.random() < 0.7:
            (folder / SUMMARY).write_text(yaml.safe_dump(document, sort_keys=False))


def answer(rng, true, ways, ask, *more):
    """Change a copy of a folder; return it, and what a checker answers, None for a refusal."""
    folder = true.parent / 'scratch' / 'case'
    shutil.rmtree(folder.parent, ignore_errors=True)
    shutil.copytree(true, folder)
    try:
        with np.errstate(all='ignore'):
            ways(rng, folder, *more)
    except NOT_WRITTEN:
        reject()
    peak = max(1 << 20, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
    began, found = time.process_time(), None
    try:
        found = ask(folder)
    except InputError as error:
        assert '\n' not in str(error)
    assert time.process_time() - began < 10.0
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss <= peak
    return folder, found


def shown(folder):
    """Return what commands show of a run."""
    log = read_run(folder)
    values = sorted((name, array.tobytes()) for name, array in log.values.items())
    facts = log.base, log.topics, log.ticks.tobytes(), log.gaps, log.events, log.attachments
    info = inspect(folder)
    return (*facts, values, info.lines()[len(info.files) :])


def evidence(folder, names):
    """Return what a folder has in the place of some files: bytes; of a link or pipe, what it is."""
    found = {}
    for path in (folder / name for name in (*names, *READ)):
        is_there = os.path.lexists(path) and path.lstat()
        small = is_there and stat.S_ISREG(is_there.st_mode) and is_there.st_size < 1 << 28
        found[path.name] = path.read_bytes() if small else is_there and is_there.st_mode
    return found


cases = pytest.mark.parametrize('count', [8, pytest.param(2000, marks=pytest.mark.slow)])
pytestmark = [pytest.mark.every_landing, pytest.mark.timeout(2400)]


@cases
def test_a_changed_run_is_not_verified_unless_it_shows_the_same(recorded, count):
    true, premises = shown(recorded), dict(verify(recorded).premises)

    def one(rng):
        folder, found = answer(rng, recorded, change_run, verify)
        if found is not None and found.exit_code == ExitCode.OK:
            assert dict(found.premises) != premises or shown(folder) == true

    settings(max_examples=count)(given(rng=RNG)(one))()


@cases
def test_a_lie_about_a_signed_run_is_not_accepted(recorded, keys, tmp_path_factory, count):
    base = tmp_path_factory.mktemp('signed')
    mine, another = base / 'mine', record(base / 'another', 4.0)
    shutil.copytree(recorded, mine)
    for folder in (mine, another):
        signature.sign_run(folder, keys / 'me.pem')
    trusted, forger = keys / 'trusted', keys / 'other.pem'
    names = (*verify(mine, trusted).signed, SUMS_FILE, SIGNATURE_FILE)

    def one(rng):
        check_it = partial(verify, trusted=trusted)
        folder, found = answer(rng, mine, lie, check_it, another, forger)
        now, was = evidence(folder, names), evidence(mine, names)
        if now in (was, evidence(another, names)):
            return  # no lie
        assert found is None or (found.exit_code != ExitCode.OK and not found.signed_by)
        sealed = all(now[name] == was[name] for name in (SUMS_FILE, SIGNATURE_FILE))
        if sealed and any(now[name] != was[name] for name in names):
            assert found is not None and found.exit_code == ExitCode.DIFFERENT

    settings(max_examples=count)(given(rng=RNG)(one))()


@cases
@pytest.mark.parametrize('kind', KINDS)
def test_a_changed_proof_is_wrong_unless_what_it_says_is_true(kind, tmp_path_factory, count):
    true = proof_of(problem_of_kind(kind), tmp_path_factory.mktemp(kind) / 'proof')
    wanted = printed(true, ask(true.path))

    def one(rng):
        folder, checked = answer(rng, true.path, change_proof, ask)
        if checked is None or checked.faults:
            return
        opened = Folder.open(folder)
        now = printed(opened, checked)
        if opened.problem.texts == true.problem.texts:
            assert now == wanted
        else:
            assert now['origins'] != wanted['origins']
        problem, bounds = opened.problem, {claim.key: claim.bound for claim in checked.claims}
        centre, half = np.array(problem.settings.centre), np.array(problem.settings.half)
        drawn = np.random.default_rng(1)
        for _ in range(10):
            start = centre + half * np.sign(drawn.uniform(-1.0, 1.0, 6))
            flown = fly(flights.vary(problem, drawn, start), problem.controller)
            assert all(value <= bounds[key] for key, value in values_of(problem, flown).items())

    settings(max_examples=count)(given(rng=RNG)(one))()


def ask(path):
    """Return what the checker finds, all tubes looked at."""
    return check.check(Folder.open(path), SAMPLE)


def printed(folder, found):
    """Return what the command prints of a proof; a figure that was flown may be missing."""
    claims = [replace(claim, found=0.0, start=()) for claim in found.claims]
    named = {'origins': origins(folder), 'title': title_of(folder.problem)}
    return named | {'claims': claims, 'ranges': found.ranges, 'of': range_of(folder.problem)}
