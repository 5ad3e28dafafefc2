# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""`rpo campaign`."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer import Argument, Option

from rpo.cli.commands import shared
from rpo.cli.commands.shared import Cluster, NoFail, Output, Resume, Set, Workers, echo, end
from rpo.display import print_table, progress
from rpo.montecarlo import outputs
from rpo_core.files.validation import InputError

if TYPE_CHECKING:
    from rpo.montecarlo.config import Campaign as Definition
    from rpo.montecarlo.store import Store

FAULT_RUNS = 400
"""Flights per share of `--faults`, if `--runs` does not say."""


def campaign(
    context: typer.Context,
    source: Annotated[str, Argument(help='campaign (shipped name or file), or folder of one')] = '',
    output: Output = None,
    resume: Resume = None,
    run: Annotated[int | None, Option(min=0, help='fly this run alone, bit for bit')] = None,
    export: Annotated[Path | None, Option(help='with --run: its scenario for ROS nodes')] = None,
    runs: Annotated[int | None, Option(help="instead of the file's")] = None,
    seed: Annotated[int | None, Option(help="instead of the file's")] = None,
    controller: Annotated[str | None, Option(help="instead of the file's")] = None,
    judge: Annotated[list[str] | None, Option(help='limit to judge by, repeatable  [all]')] = None,
    sets: Set = None,
    faults: Annotated[bool, Option('--faults', help='success over messages lost or late')] = False,
    least: Annotated[float | None, Option(min=0.0, max=100.0, help='that must succeed [%]')] = None,
    workers: Workers = 0,
    cluster: Cluster = '',
    no_fail: NoFail = False,
) -> None:
    """Fly dispersed closed loops, and print how many succeed, with confidence intervals.

    Results are saved as they come in: Ctrl-C stops cleanly, --resume goes on. It judges each run;
    the campaign as a whole only with --least. Exit code 1: fewer runs than that succeed.
    """
    from rpo.montecarlo.store import Store

    own = {name: n for name, n in {'runs': runs, 'seed': seed}.items() if n is not None}
    if workers and cluster not in ('', 'local'):
        raise InputError(
            '`--workers` goes with threads or `--cluster local`; '
            f'the scheduler {cluster} has workers of its own'
        )
    if resume is not None:
        shared.refuse_beside(context, 'resume', 'workers', 'cluster', 'least', 'no_fail')
        end(_fly(Store.open(resume), workers, cluster, least), no_fail)
        return
    if not source:
        raise InputError('a campaign file, the folder of a campaign, or --resume FOLDER is needed')
    if export is not None and run is None:
        raise InputError('`--export` writes one run: give --run too')
    if least is not None and (faults or run is not None):
        raise InputError('`--least` judges a whole campaign: no `--run` and no `--faults`')
    chosen, store = _of_source(source, controller, own, sets or [], judge or [])
    if run is not None:
        _show_run(chosen, store, run)
        _for_ros(chosen, source, run, export, sets or [])
    elif store is not None:
        end(_print(store, least), no_fail)
    elif faults:
        _faults(chosen, runs or min(chosen.config.runs, FAULT_RUNS))
    else:
        folder = output or Path('runs') / f'{chosen.config.name}_{chosen.config.seed}'
        end(_fly(Store.create(folder, chosen), workers, cluster, least), no_fail)


def _faults(chosen: Definition, runs: int) -> None:
    from rpo.montecarlo.execution import FAULTS, PERCENTS, SweepPoint, sweep
    from rpo.montecarlo.faults import Faults
    from rpo.montecarlo.judging import sentence

    config, base = chosen.config, chosen.config.faults or Faults()
    found: dict[str, list[SweepPoint]] = {kind: [] for kind in FAULTS}
    with progress() as show:
        for done, kind in enumerate(FAULTS):
            for point in sweep(chosen, runs, kind):
                found[kind].append(point)
                flown = done * len(PERCENTS) + len(found[kind])
                show('flights with message faults', flown, len(FAULTS) * len(PERCENTS))
    typer.echo(
        f'{config.name}: {config.controller}, free running; % of {runs} flights that succeed,\n'
        f'dispersed and alone; states and forces lost, or late by {base.late_by_ticks} ticks;\n'
        f'a force counts for {base.stale_after_ticks} ticks'
    )
    echo(f'success: {sentence(chosen)}')
    table = []
    for rows in zip(*found.values(), strict=True):
        cells = [str(rows[0].percent)]
        for _, d, alone in rows:
            cells.append(f'{100 * d.kept / d.runs:.1f}')
            cells.append(f'{100 * d.low:.1f} to {100 * d.high:.1f}')
            cells.append(f'{100 * alone.kept / alone.runs:.1f}')
        table.append(cells)
    headings = (heading for kind in FAULTS for heading in (kind, 'Wilson 95 %', 'alone'))
    print_table(('share %', *headings), table, left=0)


def _of_source(
    source: str, controller: str | None, own: dict[str, Any], sets: list[str], judge: list[str]
) -> tuple[Definition, Store | None]:
    from rpo.door.campaign import defined
    from rpo.montecarlo.store import Store
    from rpo_core.scenario import overrides

    if not Path(source).is_dir():
        return defined(source, controller, own, overrides.read(sets), judge=judge), None
    given = {**own, 'controller': controller, 'set': sets, 'judge': judge}
    for name in (name for name, value in given.items() if value not in (None, [])):
        raise InputError(f'`--{name}` cannot change a campaign that has results')
    store = Store.open(Path(source))
    if not store.finished:
        raise InputError(f'{source}: is not finished: go on with --resume')
    return store.campaign, store


def _fly(store: Store, workers: int, cluster: str, least: float | None) -> bool:
    """Fly what is missing of a campaign and print it; return whether too few runs succeed."""
    from rpo.door.campaign import flown
    from rpo.montecarlo import in_python

    if not store.finished and (sentence := in_python.sentence(store.campaign)):
        echo(sentence, err=True)
    with shared.saved_work(store.folder, 'finished runs', 'rpo', 'campaign') as show:
        flown(store, workers, cluster, show)
    missed = _print(store, least)
    echo(store.folder / 'results.npz')
    return missed


def _print(store: Store, least: float | None) -> bool:
    """Print a campaign; return whether fewer percent of its runs succeed than `least`."""
    from rpo.montecarlo import judging
    from rpo.montecarlo.statistics import QUANTILES, cells, nevers, rates, rows, spreads

    config = store.campaign.config
    title = f'{config.name}: {config.controller}, {config.scenario}, seed {config.seed}'
    print_table(('', 'runs', 'share', 'Wilson 95 %'), rows(store), title)
    echo(f'success: {judging.sentence(store.campaign)}')
    shown = spreads(store, judging.figures(store.campaign))
    numbers = [(s.name, *cells(s)) for s in shown]
    print_table(('', 'mean', *(f'{100 * q:g} %' for q in QUANTILES), 'worst', 'run'), numbers)
    for line in nevers(shown, config.runs):
        echo(line)
    if least is None:
        return False
    rate = rates(store)[0]
    holds = 100 * rate.kept >= least * rate.runs
    typer.echo(f'success of at least {least:g} % of the runs: {"held" if holds else "MISSED"}')
    return not holds


def _show_run(chosen: Definition, store: Store | None, number: int) -> None:
    """Print a run, flown by the core too: the bits must be the same, and those of its folder."""
    from rpo.montecarlo import judging
    from rpo.montecarlo.config import METRICS
    from rpo.montecarlo.execution import fly_again
    from rpo_core.judge import verdicts

    if number >= chosen.config.runs:
        raise InputError(f'`--run` must be at most {chosen.config.runs - 1}; got {number}')
    columns, _ = fly_again(chosen, number, store)
    asked = judging.figures(chosen)
    rows = [
        (name, verdicts.number(value, chosen.metrics.get(name, ''), '.6g'))
        for name, (value,) in columns.items()
        if name not in METRICS or name in asked
    ]
    print_table(('', 'value'), rows, f'{chosen.config.name}, run {number}')
    print_table(('judged', 'value', 'limit', ''), judging.of_run(chosen, columns))
    echo(f'success: {judging.sentence(chosen)}')
    what = 'the core' if store is None else 'the core and of the campaign'
    typer.echo(f'The bits are those of {what}.')


def _for_ros(
    chosen: Definition, source: str, number: int, export: Path | None, sets: list[str]
) -> None:
    """Write the scenario of a run, if asked to; print the command that flies it on ROS 2."""
    from rpo.montecarlo.run_batch import scenario_of
    from rpo_core.scenario import scenario

    if chosen.config.faults is not None:
        if export is not None:
            raise InputError('`--export` writes a scenario; message faults are not part of one')
        return
    path = export or Path(f'run_{number}.yaml')
    if export is None:
        again = ['rpo', 'campaign', str(source), '--run', str(number), '--export', str(path)]
        again += [part for change in sets for part in ('--set', change)]
        echo(f'On ROS 2: {shlex.join(again)}')
    else:
        outputs.write_text(path, scenario.dumps(scenario_of(chosen, number)))
    flown = Path(source, 'controller.yaml')
    controller = str(flown) if flown.is_file() else chosen.config.controller
    fly = ['--scenario', str(path), '--controller', controller]
    echo(shlex.join(['ros2', 'run', 'rpo_bringup', 'final_approach', *fly]))
