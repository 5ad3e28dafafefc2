# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""`rpo prove`."""

from __future__ import annotations

import math
import shlex
import time
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from typer import Argument, Option

from rpo.cli.commands import shared
from rpo.cli.commands.shared import NoFail, Output, Resume, Workers, echo, end
from rpo.display import print_table, progress
from rpo_core.files.validation import InputError

if TYPE_CHECKING:
    from rpo.proof.check import Checked
    from rpo.proof.claims import Claim, Range
    from rpo.proof.folder import Folder
    from rpo.proof.problem import Problem


def prove(
    context: typer.Context,
    controller: Annotated[str, Argument(help='shipped name or file')] = '',
    scenario: Annotated[
        str, Option(help='set, whose outermost starts are the box, or flight, its middle')
    ] = 'paper_training',
    position: Annotated[float | None, Option(help='half-width of the box, each axis [m]')] = None,
    velocity: Annotated[float, Option(min=0.0, help='half-width, each axis [m/s]')] = 0.0,
    mass: Annotated[float, Option(help='share by which the mass may differ')] = 0.0,
    disturbance: Annotated[
        float, Option(help="the scenario's at any phase, up to so many times; 0: as it is")
    ] = 0.0,
    any_disturbance: Annotated[float, Option(help='any other, each axis and tick [N]')] = 0.0,
    axes_apart: Annotated[bool, Option('--axes-apart', help='each axis alone')] = False,
    cell: Annotated[float, Option(help='half-width of the first cells, or strips [m]')] = 1.0,
    cell_velocity: Annotated[float, Option(help='half-width of them in velocity [m/s]')] = 0.025,
    claim: Annotated[list[str] | None, Option(help='requirement, repeatable  [all]')] = None,
    output: Output = None,
    resume: Resume = None,
    check: Annotated[Path | None, Option(help='folder of a proof to check independently')] = None,
    publish: Annotated[bool, Option('--publish', help='after --check: in docs/proof.md')] = False,
    cells: Annotated[int, Option(min=0, help='to check of each group, random; 0: all')] = 20,
    flights: Annotated[int, Option(min=0, help='to check against their tubes, random')] = 1000,
    seed: Annotated[int | None, Option(min=0, help='of a check  [another each time]')] = None,
    estimate: Annotated[int, Option(min=0, help='so many first cells: what would all cost')] = 0,
    workers: Workers = 0,
    no_fail: NoFail = False,
) -> None:
    """Prove what the closed loop does from every start of a box, or show a counterexample.

    Finished cells are saved: Ctrl-C stops cleanly, --resume goes on.
    """
    from rpo.door.proof import problem_of
    from rpo.proof import proven
    from rpo.proof.folder import Folder

    if check is not None:
        shared.refuse_beside(context, 'check', 'publish', 'cells', 'flights', 'seed', 'no_fail')
        folder = Folder.open(check)
        drawn = f'--cells {cells} --flights {flights}'
        result = proven.of_folder(folder, drawn) if publish else None
        missed = _check(folder, cells, flights, seed)
        if result is not None:
            proven.publish(result)
        end(missed, no_fail)
        return
    if publish:
        raise InputError('`--publish` goes with `--check FOLDER`')
    if resume is not None:
        shared.refuse_beside(context, 'resume', 'workers', 'no_fail')
        folder = Folder.open(resume)
        folder.refuse_other_code()
        end(_prove(folder, workers), no_fail)
        return
    if not controller:
        raise InputError('say what to prove: a controller, --resume FOLDER or --check FOLDER')
    options = {
        'mass_share': mass,
        'disturbance_share': disturbance,
        'any_n': any_disturbance,
        'axes_apart': axes_apart,
        'cell_m': cell,
        'cell_m_s': cell_velocity,
        'claims': tuple(claim or ()),
    }
    problem = problem_of(scenario, controller, position, velocity, options)
    if estimate:
        _estimate(problem, estimate)
        return
    path = output or Path('runs') / f'proof_{problem.controller.name}'
    end(_prove(Folder.create(path, problem), workers), no_fail)


def _prove(folder: Folder, workers: int) -> bool:
    """Make a proof; return whether a claim is refuted or open."""
    from rpo.door.proof import proven

    problem = folder.problem
    if not problem.controller.system.rules.is_odd:
        echo('The rules are not odd: the whole box is proven, not half of it.', err=True)
    with shared.saved_work(folder.path, 'finished cells', 'rpo', 'prove') as show:
        proof = proven(folder, workers, show)
    _print(problem, proof.claims, proof.outcome.ranges)
    for key in proof.counterexamples:
        flight, _ = folder.flights(key)
        controller = str(folder.path / 'controller.yaml')
        echo(shlex.join(['rpo', 'simulate', str(flight), '--controller', controller]))
    for group, (resumed, every) in proof.outcome.resumed.items():
        if resumed:
            echo(
                f'Not checked: {resumed} of {every} units of {group} cells are of an earlier call, '
                'as the folder says; --check looks at them'
            )
    echo(folder.path)
    return not proof.ok


def _estimate(problem: Problem, count: int) -> None:
    from rpo.proof.problem import title_of
    from rpo.proof.proving import estimate

    with progress() as show:
        found = estimate(problem, count, show)
    limits, sampled = problem.limits, found.sampled
    rows = [
        (key, f'{limits[key]:g}', f'{bound:.4g}', f'{found.flown[key]:.4g}', f'{n} of {sampled}')
        for (key, bound), n in zip(found.bounds.items(), found.open_cells.values(), strict=True)
    ]
    print_table(('claim', 'limit', 'bound', 'flown', 'open first cells'), rows, title_of(problem))
    echo(
        f'{found.never_inside} of {sampled} first cells do not enter the invariant set. '
        f'{found.tubes / sampled:.1f} tubes and {found.seconds / sampled:.2f} s of CPU time each; '
        f'all {found.cells}: about {found.hours:.2g} hours of one core'
    )


def _check(folder: Folder, cells: int, flights: int, seed: int | None) -> bool:
    """Check a proof, end at a wrong one; return whether a claim is refuted or open."""
    from rpo.door.proof import checked
    from rpo.proof.certificate import PROVEN
    from rpo.proof.claims import worst
    from rpo.proof.folder import code_digest, origins

    if folder.recorded['code_sha256'] != code_digest():
        echo(
            'The folder says that it was made with other code: '
            'its bounds may differ in the last bits.',
            err=True,
        )
    began = time.perf_counter()
    with progress() as show:
        found = checked(folder, cells, flights, seed, show)
    for fault in found.faults:
        echo(f'WRONG: {fault}')
    if found.faults:
        raise typer.Exit(1)
    _print(folder.problem, found.claims, found.ranges, found)
    for line in origins(folder):
        echo(line)
    echo(f'checked by code of SHA-256 {code_digest()}')
    drawn = ', '.join(f'{some} of {every} {g}' for g, (some, every) in found.drawn.items())
    echo(
        'Checked: that the cells cover the starts, and what follows from all of them; flights of '
        f'claims, flown again; the table of the surface; tubes of {drawn} cells, '
        f'{found.sample.ticks} ticks of each in rational numbers; {flights} flights from cells of '
        f'each kind at every tick; drawn by --seed {found.sample.seed}'
    )
    for left in _not_checked(folder, found):
        echo(f'Not checked: {left}')
    echo(f'Nothing wrong was found in {time.perf_counter() - began:.0f} s')
    return worst(found.claims) != PROVEN


def _not_checked(folder: Folder, found: Checked) -> Iterable[str]:
    """Yield what of a folder the checker did not look at."""
    for group, (some, every) in found.drawn.items():
        if some < every:
            yield f'the tubes of {every - some} {group} cells, whose bounds are as the folder says'
    for claim in found.claims:
        if not claim.start:
            yield f'what was flown for {claim.key}: its flight is not in the folder'
    yield f'what versions.yaml says: {", ".join(map(" ".join, sorted(folder.recorded.items())))}'
    yield from folder.others()


def _print(
    problem: Problem,
    claims: Iterable[Claim],
    ranges: dict[str, Range],
    checked: Checked | None = None,
) -> None:
    """Print what was computed in this call."""
    from rpo.proof.claims import lower, row_of, unknown, upper
    from rpo.proof.problem import range_of, title_of

    rows = [row_of(claim) for claim in claims]
    whole = checked is None or checked.whole
    verdict = '' if whole else 'if the cells that were not drawn are right'
    columns = 'claim', 'limit', 'proven', 'flown', 'open cells', verdict
    print_table(columns, rows, title_of(problem))
    echo(range_of(problem))
    for found in ranges.values():
        if math.isinf(found.high):
            continue
        least = f'{lower(found.low)} to ' if found.low else 'at most '
        echo(f'{found.statement}: {least}{upper(found.high)} {found.unit}')
    for key in unknown(problem):
        echo(f'{key}: the proof says nothing about it')
    for key in problem.all_limits.keys() - problem.limits.keys():
        echo(f'{key}: not asked for, and not judged')
