# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""`rpo evaluate` and `rpo compare`: controllers judged, one by one or side by side."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer import Argument, Option

from rpo.cli.commands.shared import NoFail, Workers, draw, echo, end, interruptible
from rpo.display import print_table, progress
from rpo_core.files.validation import InputError

if TYPE_CHECKING:
    from rpo.analysis.judgement import Assessment
    from rpo_core.control.controller import AnyController
    from rpo_core.scenario.scenario import Scenario, ScenarioSet

WORLD_RUNS = 100
"""Flights that judge an estimator as its world is, at most: each takes a third of a second."""

_HEADING = 11  # longest word of a heading


def evaluate(
    controllers: Annotated[list[str] | None, Argument(help='shipped names or files')] = None,
    scenario: Annotated[
        str,
        Option(
            help='judge by the requirements of this scenario or set (name or file)  [those of the '
            'scenario of its training; for paper_training the targets Q1 to Q5]'
        ),
    ] = '',
    everywhere: Annotated[bool, Option('--everywhere', help='fly 50 000 drawn runs')] = False,
    robustness: Annotated[
        bool, Option('--robustness', help='margins: gain, thrust, delay, mass, bias; nothing else')
    ] = False,
    seed: Annotated[int | None, Option(help='of the draws of --everywhere  [2026]')] = None,
    estimator: Annotated[str, Option(help='judge the estimator of this scenario instead')] = '',
    runs: Annotated[int, Option(help='flights that judge an estimator', min=2)] = 1000,
    workers: Workers = 0,
    no_fail: NoFail = False,
) -> None:
    """Judge controllers by the requirements of a mission, or by the targets of paper_training.

    The mission is --scenario, or else the scenario of the training. A fuzzy controller of
    paper_training has the targets Q1 to Q5: conditions from every start, energy, the paper's test,
    no limit cycle, readable rules. With --estimator, a filter is judged by the errors of its
    estimates over many flights with the noise that it assumes; those in its world are reported.

    Exit code 1: something that was judged is missed.
    """
    from rpo.analysis.judgement import PAPER, assess, trained_for
    from rpo_core.control.controller import FuzzyController, load_controller
    from rpo_core.scenario.scenario import load

    if bool(estimator) == bool(controllers):
        raise InputError('`controllers` or `--estimator` must be given, and not both')
    if seed is not None and not everywhere:
        raise InputError('`--seed` needs `--everywhere`')
    if robustness and (estimator or scenario or everywhere):
        raise InputError('`--robustness` takes controllers, `--workers` and no more')
    missed = _judge_estimator(estimator, runs) if estimator else False
    for name in controllers or ():
        loaded = load_controller(name)
        of = scenario or trained_for(loaded) or PAPER
        if robustness:
            missed |= _robustness(loaded, workers)
        elif not scenario and of == PAPER and isinstance(loaded, FuzzyController):
            missed |= _print_targets(assess(loaded, workers))
            if everywhere:
                missed |= _everywhere(loaded, seed, workers)
        elif everywhere:
            raise InputError(
                '`--everywhere` needs a controller that is judged by the targets; '
                f'{name} is judged by {of}'
            )
        else:
            missed |= judge_by(loaded, name, load(of))
    end(missed, no_fail)


def judge_by(controller: AnyController, name: str, found: Scenario | ScenarioSet) -> bool:
    """Print how a controller keeps the requirements of a scenario; return whether it misses any."""
    from rpo.analysis.judgement import HEADINGS, judge, rows_of
    from rpo_core.judge.verdicts import HOLDS

    with progress() as show:
        judged = judge(controller, found, show)
    print_table(HEADINGS, rows_of(judged), f'{name}: requirements of {found.name}')
    held, flights = sum(j.word == HOLDS for j in judged.judgements), judged.judgements[0].flights
    typer.echo(
        f'{held} of {len(judged.judgements)} requirements of {found.name} hold; '
        f'mean J {judged.mean_energy_n2s:.4f} N²s, {flights} flight{"s" * (flights > 1)}'
    )
    return any(j.missed for j in judged.judgements)


def _judge_estimator(name: str, runs: int) -> bool:
    """Print how consistent the estimator of a scenario is; return whether a mean is out of bounds.

    With the sensors as they are, and with a tenth of the measurements lost and 0.3 s late; of an
    attitude filter, with an outage of the star tracker too: this is what is asked. Then, as the
    world is: this is reported.
    """
    from rpo.analysis import consistency
    from rpo.analysis.consistency import OUTAGE, attitude_consistency
    from rpo_core.control.controller import load_controller
    from rpo_core.files import DEFAULT_CONTROLLER
    from rpo_core.navigation.attitude_estimator import AttitudeEstimator
    from rpo_core.navigation.estimator import Estimator
    from rpo_core.scenario.scenario import load_scenario

    scenario = load_scenario(name)
    positions = scenario.section(Estimator) is not None
    attitudes = scenario.section(AttitudeEstimator) is not None
    cases: dict[str, Any] = {}
    if positions or not attitudes:
        worse = {'dropout_share': 0.1, 'latency_ticks': round(0.3 / scenario.dt_s)}
        for what, changes in (('', {}), (', 10 % lost, 0.3 s late', worse)):
            sensed = consistency.as_configured(scenario, **changes)
            cases[f'noise as the filter assumes{what}'] = partial(consistency.consistency, sensed)
    if attitudes:
        turning, (begin, end_) = partial(attitude_consistency, scenario), OUTAGE
        cases['attitude, noise as the filter assumes'] = turning
        blind = f'attitude, star tracker out from {100 * begin:.0f} to {100 * end_:.0f} %'
        cases[blind] = partial(turning, outage=True)
    missed = False
    for case, fly in cases.items():
        with progress() as show:
            found = fly(runs=runs, show=show)
        title = f'{scenario.name}, {case}: {runs} flights'
        print_table(consistency.HEADINGS, consistency.rows_of(found), title)
        missed |= not found.holds
    if not positions:
        return missed
    controller, count = load_controller(DEFAULT_CONTROLLER), min(runs, WORLD_RUNS)
    with progress() as show:
        world = consistency.in_its_world(scenario, controller, count, show)
    title = f'{scenario.name}, as its world is, {controller.name}: {count} flights'
    print_table(consistency.HEADINGS, consistency.rows_in_its_world(world, count), title)
    off = {what: consistency.size_of(nees) for what, nees in world.items()}
    typer.echo(
        f'As its world is, errors of position are {off["position"]} than the filter says, '
        f'those of velocity {off["velocity"]} (root of the mean NEES over 3). This is '
        'reported, not asked: the filter does not model all of its world.'
    )
    if attitudes:
        typer.echo(f'Errors of attitude are {off["attitude"]} than the filter says.')
    return missed


def _print_targets(found: Assessment) -> bool:
    """Print the figures of a controller beside its targets; return whether it misses one."""
    from rpo.analysis.judgement import PAPER, QUESTIONS
    from rpo_core.judge.metrics import ARRIVAL_DISTANCE, ARRIVAL_SPEED, ENERGY, SLEW

    targets, name = found.targets(), found.controller.name
    rows = [target.cells() for target in targets]
    title = f'{name}: targets of {PAPER}'
    print_table(('', 'what', 'limit', 'reached', ''), rows, title, left=2)
    bindings, worst, least = found.binding, found.metrics.max(axis=0), float(found.least.mean())
    counts = ', '.join(f'{name} {bindings.count(name)}' for name in sorted(set(bindings)))
    farthest = found.metrics[-1, ENERGY]
    typer.echo(
        f'{QUESTIONS}\n{found.verdict()}.\n'
        f'mean J {found.mean_energy_n2s:.4f} N²s = {found.mean_energy_n2s / least:.2f} x the '
        f'least to rest in 200 s without conditions ({least:.3f}); from [100, 100, 100] m '
        f'{farthest:.3f} = {farthest / found.least[-1]:.2f} x\n'
        f'worst start: speed {worst[ARRIVAL_SPEED]:.4f} m/s, slew {worst[SLEW]:.4f} N/s, '
        f'distance {worst[ARRIVAL_DISTANCE]:.4f} m; smallest margin '
        f'{100 * found.margin:.1f} %; condition nearest its limit: {counts}'
    )
    return not all(target.holds for target in targets)


def _everywhere(controller: AnyController, seed: int | None, workers: int) -> bool:
    """Print how a controller does in draws of this seed; return whether it misses a target."""
    from rpo.analysis.judgement import SEED, everywhere
    from rpo.training.provenance import saw

    seed, rows = SEED if seed is None else seed, []
    with progress() as show:
        outcomes = everywhere(controller, seed, workers, show)
    for o in outcomes:
        asked = '' if o.least is None else f'{100 * o.least:g} %'
        verdict = 'not asked' if o.least is None else 'held' if o.holds else 'MISSED'
        s = o.success
        shares = f'{s.kept} / {s.runs}', f'{s.percent} %', f'{s.interval} %'
        rows.append((o.campaign, s.name, *shares, asked, verdict))
    headings = ('campaign', 'judged', 'runs that keep it', 'share', 'Wilson 95 %', 'least', '')
    print_table(headings, rows, f'{controller.name}: draws of seed {seed}', left=2)
    for o in outcomes:
        typer.echo(f'{o.campaign}, {o.success.name}: {o.judged}')
    for name in dict.fromkeys(o.campaign for o in outcomes):
        typer.echo(f'its training and {name}: {saw(controller, name)}')
    return not all(o.holds for o in outcomes)


def _robustness(controller: AnyController, workers: int) -> bool:
    """Print the margins of a controller; return whether a start misses a condition."""
    from rpo.analysis import robustness

    with progress() as show:
        found = robustness.margins_of(controller, workers, show)
    typer.echo(f'{controller.name}: {found.headline()}.')
    if found.margins:
        print_table(robustness.HEADINGS, robustness.rows_of(found))
    if found.crossings:
        rows = map(robustness.crossing_row, found.crossings)
        print_table(robustness.CROSSED, rows, 'describing function of an axis')
    return found.starts_missed > 0


def compare(
    controllers: Annotated[
        list[str] | None, Argument(help='names or files  [the fuzzy ones and all baselines]')
    ] = None,
    campaign: Annotated[str, Option(help='what is dispersed, and its limits')] = 'paper_test',
    runs: Annotated[int | None, Option(help="of the campaign, instead of the file's")] = None,
    random: Annotated[
        int, Option(min=0, max=1_000_000, help='random starts, at rest and as many moving')
    ] = 2000,
    picture: Annotated[Path | None, Option(help='energy against runs kept, and time')] = None,
    output: Annotated[
        Path, Option('--output', '-o', help='folder that keeps what was computed')
    ] = Path('runs/compare'),
    write: Annotated[Path | None, Option(help='page to put the table into')] = None,
    attitude: Annotated[bool, Option('--attitude', help='of attitude, dispersed slews')] = False,
    workers: Workers = 0,
) -> None:
    """Compare controllers: energy, conditions, tests, limits kept under dispersion, proofs.

    Results are kept: Ctrl-C stops cleanly, the same command goes on.
    """
    from rpo.analysis import comparison
    from rpo.montecarlo.outputs import put
    from rpo.reports.training import draw_comparison
    from rpo.training.provenance import saw

    if attitude:
        _attitudes(controllers, 10_000 if runs is None else runs)
        return
    names = controllers or comparison.CONTROLLERS
    sentence = 'Interrupted; what was computed is kept: the same command goes on.'
    with interruptible(lambda: sentence), progress() as show:
        compared = comparison.Comparison(
            names, output, campaign, saw, runs, workers, show, random_runs=random
        )
        least, rows = compared.least(), compared.rows()
    flown = compared.campaigns[0]
    for headings, *lines in (table(rows) for table in comparison.TABLES):
        columns = zip(headings, *lines, strict=True)
        widths = (max(_HEADING, *map(len, cells)) for _, *cells in columns)
        print_table([fill(*pair) for pair in zip(headings, widths, strict=True)], lines)
    for note in comparison.notes(rows, least, flown):
        echo(f'- {note}')
    for path in comparison.write(rows, least, flown, output):
        echo(path)
    if picture is not None:
        draw(picture, draw_comparison, rows)
    if write is not None:
        text = comparison.markdown(rows, least, flown, comparison.ON_PAGE)
        put(write, 'rpo compare', text)
        echo(write)


def _attitudes(names: list[str] | None, runs: int) -> None:
    """Print how controllers of attitude fly the same slews, which no training has flown."""
    from rpo.analysis.attitude import HEADINGS, SENTENCE, compared, judged_draws
    from rpo_core import files
    from rpo_core.control import attitude

    if runs < 1:
        raise InputError(f'`--runs` must be at least 1; got {runs}')
    loaded = [attitude.load(name) for name in names or files.shipped('attitude_controller')]
    rows = [row.cells for row in compared(loaded, judged_draws(runs))]
    print_table(HEADINGS, rows, f'{runs} slews of up to 180 deg')
    typer.echo(SENTENCE)
