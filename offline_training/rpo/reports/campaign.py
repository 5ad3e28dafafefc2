# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The report of a campaign: its success, where it ends, what matters, the worst runs."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import norm, spearmanr

from rpo.montecarlo import judging
from rpo.montecarlo.judging import words
from rpo.montecarlo.quantities import QUANTITIES
from rpo.montecarlo.run_batch import fly_run
from rpo.montecarlo.sampling import parameters_of
from rpo.montecarlo.statistics import (
    QUANTILES,
    Rate,
    Spread,
    cells,
    ends_m,
    nevers,
    rates,
    spreads,
    successes,
)
from rpo.montecarlo.store import Store
from rpo.reports.page import Block, File, Picture, Report, Section, Table, Text, picture, plain
from rpo.reports.replay import Replayed
from rpo_core.files.validation import InputError
from rpo_core.judge.metrics import FINAL
from rpo_core.judge.verdicts import number, unbounded
from rpo_core.kernels.arrays import Bools, Floats, Ints
from rpo_core.scenario.requirements import ROWS
from rpo_log.show import report as log_report
from rpo_log.show import style

FALSE_ALARM = 0.01
"""Chance that a dispersion without any effect exceeds `chance_level`."""


class Influence(NamedTuple):
    """Rank correlations of one drawn column with one outcome, in [-1, 1].

    signed : with the deviation; size : with the size of the deviation from the middle
    """

    column: str
    signed: float
    size: float

    @property
    def strength(self) -> float:
        """The larger of both, without sign."""
        return max(abs(self.signed), abs(self.size))


def influences(drawn: Mapping[str, Floats], outcome: Floats) -> list[Influence]:
    """Return the influence of every column (n,) that varies on an outcome (n,); strongest first.

    Empty if the outcome is the same in all runs.
    """
    by_column = []
    for name, values in drawn.items():
        size = np.abs(values - (values.min() + values.max()) / 2.0)
        if _varies(values) and _varies(outcome):
            by_size = spearmanr(size, outcome).statistic if _varies(size) else 0.0
            signed = spearmanr(values, outcome).statistic
            by_column.append(Influence(name, float(signed), float(by_size)))
    return sorted(by_column, key=lambda influence: -influence.strength)


def _varies(values: Floats) -> bool:
    return bool((values != values[0]).any())


def chance_level(runs: int) -> float:
    """Return what |rank correlation| of unrelated columns exceeds in `FALSE_ALARM` of cases.

    By the normal approximation, of variance 1 / (n - 1) (Kendall, *Rank Correlation Methods*).
    """
    return float(norm.isf(FALSE_ALARM / 2.0)) / max(1, runs - 1) ** 0.5


MOST_POINTS = 2000
"""Runs of each kind, successes and failures, that a cloud shows."""

_BINS = 60
_FAR = 2.5
_SMALL_M_S = 0.1
_KEPT, _FAILED = style.LIGHT['x'], style.LIGHT['y']


def clouds(final: Floats, success: Bools, limits: tuple[float | None, float | None]) -> Any:
    """Return the final positions and velocities of runs (n, 6) in two planes each.

    limits : of position [m] and velocity [m/s] of an axis, drawn as a box; not if None, nor if it
        lies so far out that the cloud would be a dot
    """
    figure, panels = style.new_panels(7.6, 2, 2)
    small = np.abs(final[:, 3:]).max() < _SMALL_M_S
    units = (('m', 1.0), ('mm/s', 1e3) if small else ('m/s', 1.0))
    for row, first, (unit, factor), limit in zip(panels, (0, 3), units, limits, strict=True):
        prefix = 'v' if first else ''
        for axes, up in zip(row, (0, 2), strict=True):
            _cloud(axes, factor * final[:, [first + 1, first + up]], success)
            if limit is not None and limit <= _FAR * np.abs(final[:, first : first + 3]).max():
                box = factor * limit * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]])
                axes.plot(*box.T, **style.LIMIT, label='limit of success')
            axes.set(
                xlabel=f'final {prefix}y, V-bar [{unit}]',
                ylabel=f'final {prefix}{"xyz"[up]}, {"RVH"[up]}-bar [{unit}]',
            )
            axes.set_aspect('equal', adjustable='datalim')
            axes.locator_params(nbins=7)
    style.legend_below(figure, panels[0][0])
    return figure


def _cloud(axes: Any, points: Floats, success: Bools) -> None:
    for chosen, colour, name in ((success, _KEPT, 'success'), (~success, _FAILED, 'failure')):
        some = points[chosen][:MOST_POINTS]
        if len(some):
            axes.add_patch(_dots(some, colour))
            axes.update_datalim(some)
        label = f'{name}: {int(chosen.sum())} runs, {len(some)} drawn'
        axes.plot([], [], 'o', color=colour, markersize=4, label=label)
    axes.autoscale_view()


def _dots(points: Floats, colour: str) -> Any:
    """Return one path of round dots: a third of the bytes of as many markers."""
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path

    ends = points + 1e-9 * np.ptp(points)
    vertices = np.stack([points, ends], axis=1).reshape(-1, 2)
    path = Path(vertices, np.tile([Path.MOVETO, Path.LINETO], len(points)))
    path.should_simplify = False
    return PathPatch(path, edgecolor=colour, facecolor='none', linewidth=2.2, capstyle='round')


PANEL_IN = 2.3
"""Height of a row of histograms."""


def distributions(columns: Mapping[str, Floats], success: Bools) -> Any:
    """Return a figure of the histograms of metrics, see `histograms`."""
    rows = -(-len(columns) // 2)
    figure, panels = style.new_panels(PANEL_IN * rows, rows, 2, squeeze=False)
    histograms(panels, columns, success)
    style.legend_below(figure, panels[0][0])
    return figure


def histograms(panels: Any, columns: Mapping[str, Floats], success: Bools) -> None:
    """Draw histograms of metrics into panels (rows, 2); columns : label with unit -> values (n,).

    Runs whose value is infinite, what they never did, are not drawn.
    """
    for axes in panels.ravel()[len(columns) :]:
        axes.set_axis_off()
    for axes, (label, values) in zip(panels.flat, columns.items(), strict=False):
        finite = np.isfinite(values)
        low, high = 0.0, 1.0
        if finite.any():
            low, high = values[finite].min(), np.quantile(values[finite], 0.9995)
        span = (low, high) if high > low else (low - 0.5, low + 0.5)
        axes.hist(
            [values[success & finite], values[~success & finite]],
            bins=_BINS,
            range=span,
            stacked=True,
            color=[_KEPT, _FAILED],
            label=['success', 'failure'],
        )
        if finite.any():
            axes.axvline(np.median(values[finite]), **style.LIMIT, label='median')
        axes.set(xlabel=label, ylabel='number of runs', xlim=span)
        axes.grid(axis='x', visible=False)


def sensitivity(by_outcome: Mapping[str, Sequence[Influence]], level: float) -> Any:
    """Return the influences of each column on each outcome, as bars; weak ones within `level`."""
    columns = [i.column for i in next(iter(by_outcome.values()))]
    height = 0.5 + 0.27 * len(columns)
    figure, (panels,) = style.new_panels(height, 1, len(by_outcome), sharey=True, squeeze=False)
    places = np.arange(len(columns))
    for axes, (outcome, influences) in zip(panels, by_outcome.items(), strict=True):
        by_name = {i.column: i for i in influences}
        signed = [by_name[name].signed for name in columns]
        size = [by_name[name].size for name in columns]
        axes.axvspan(-level, level, color=style.LIGHT['grid'], linewidth=0, label='chance')
        axes.hlines(places, 0.0, signed, color=_KEPT, linewidth=1.2)
        axes.plot(signed, places, 'o', color=_KEPT, markersize=5, label='of the deviation')
        hollow = {'markerfacecolor': 'none', 'markeredgecolor': _FAILED, 'markersize': 5}
        axes.plot(size, places, 'D', **hollow, label='of its size')
        axes.set(title=outcome, xlabel='rank correlation', xlim=(-1.0, 1.0))
        axes.set_xticks([-0.5, 0.0, 0.5])
        axes.axvline(0.0, color=style.LIGHT['muted'], linewidth=0.8)
    panels[0].set_yticks(places, columns)
    panels[0].invert_yaxis()
    style.legend_below(figure, panels[0])
    return figure


WORST_FAILURES = 5
REPLAYED = 20
"""Runs in the replay of a campaign."""


def report_of(folder: Path) -> Report:
    """Return the report of a finished campaign's folder; raises InputError."""
    store = Store.open(folder)
    if not store.finished:
        raise InputError(f'{folder}: is not finished: go on with rpo campaign --resume')
    config = store.campaign.config
    success = successes(config, {name: store.column(name) for name in config.judging})
    asked = judging.figures(store.campaign)
    found_rates, found_spreads = rates(store), spreads(store, asked)
    never = nevers(found_spreads, config.runs)
    # Runs that dock go on past that: where they end is not asked.
    ends = any(name.startswith(('final', 'mean', 'hold_error', 'arrival')) for name in asked)
    for place, rate in enumerate(found_rates):
        name, keeps, limit = rate.name.partition(' <= ')
        if keeps:
            found_rates[place] = rate._replace(name=f'{words(name, unit=False)} ≤ {plain(limit)}')
    found_spreads = [s._replace(name=words(s.name, unit=False)) for s in found_spreads]
    names = 'campaign.yaml', 'scenario.yaml', 'controller.yaml'
    files_of = tuple(map(File, names, store.campaign.texts))
    with style.applied():
        sections = (
            Section('Success', tuple(_success(store, found_rates))),
            Section('Figures', tuple(_figures(store, found_spreads, never, success))),
            *([Section('Where it ends', (_clouds(store, success),))] if ends else []),
            Section('What matters', tuple(_what_matters(store, success))),
            Section('Worst runs', tuple(_worst(store, found_spreads, success))),
            Section('Configuration', files_of),
        )
    kept = found_rates[0]
    shares = [_percent(rate) for rate in found_rates if rate.name == judging.MOTION]
    moving = f' By {judging.MOTION} alone: {shares[0]}.' if shares else ''
    return Report(
        f'Campaign {config.name}: {store.campaign.scenario.name}, controller '
        f'{store.campaign.controller.name}',
        f'{kept.runs} runs, seed {config.seed}; success {_percent(kept)}. '
        f'Success: {judging.sentence(store.campaign)}.{moving}',
        sections,
        flights=_worst_flights(store, success),
        note=f'The runs of {kept.runs} that come closest to a limit, or are farthest beyond one.',
    )


def _limit(name: str, limit: float) -> str:
    """Return a limit for people."""
    return f'{words(name, unit=False)} ≤ {limit:g} {plain(judging.unit_of(name))}'.rstrip()


def _percent(rate: Rate) -> str:
    return f'{rate.percent} % ({rate.interval} %, Wilson 95 %)'


def _success(store: Store, success_rates: list[Rate]) -> list[Block]:
    rows: list[tuple[str, ...]] = [rate.cells for rate in success_rates]
    rows += [
        (_limit(name, store.campaign.required[name]), judging.NOT_JUDGED, '', '')
        for name in judging.not_judged(store.campaign)
    ]
    caption = f'Success: {judging.sentence(store.campaign)}'
    return [Table(caption, ('condition', 'runs', 'share', 'Wilson 95 %'), tuple(rows))]


def _figures(store: Store, figures: list[Spread], never: list[str], success: Bools) -> list[Block]:
    drawn = {words(name): store.column(name) for name in judging.figures(store.campaign)}
    heads = ('figure', 'unit', 'mean', *(f'{100 * q:g} %' for q in QUANTILES), 'worst', 'run')
    rows = tuple((s.name, plain(s.unit), *cells(s)) for s in figures)
    medians = (f'{s.name}: median {number(s.quantiles[0], plain(s.unit))}' for s in figures)
    return [
        picture('distributions', distributions(drawn, success), medians='; '.join(medians)),
        Table('Mean, quantiles and the worst run', heads, rows),
        *(Text(f'{line}.') for line in never),
    ]


def _clouds(store: Store, success: Bools) -> Picture:
    final = np.column_stack([store.column(name) for name in FINAL])
    final[:, :3] -= store.campaign.scenario.goal_position_m
    limits = store.campaign.config.success
    held_s = log_report.close_up_s(store.campaign.scenario)
    bounds = limits.get('hold_error_per_axis_m'), limits.get('hold_speed_per_axis_m_s')
    return picture(
        'final_states',
        clouds(final, success, bounds),
        points=MOST_POINTS,
        held_s=held_s,
        farthest_m=np.linalg.norm(final[:, :3], axis=1).max(),
    )


def _what_matters(store: Store, success: Bools) -> list[Block]:
    drawn = {words(name): store.column(name) for name in parameters_of(store.campaign.config)}
    outcomes = {'failing': (~success).astype(np.float64)}
    asked = judging.figures(store.campaign)
    names = [name for name in ('energy_n2s', 'arrival_time_s') if name in asked]
    outcomes |= {words(name, unit=False): store.column(name) for name in names}
    by_outcome = {name: influences(drawn, values) for name, values in outcomes.items()}
    by_outcome = {name: some for name, some in by_outcome.items() if some}
    if not by_outcome:
        return [Text('No dispersion was drawn, or every run came out the same.')]
    level = chance_level(store.campaign.config.runs)
    first = next(iter(by_outcome))
    strongest = ', '.join(i.column for i in by_outcome[first][:3])
    dispersed = store.campaign.config.dispersions
    white = [words(n, unit=False) for n in dispersed if QUANTITIES[n].distributions == ('white',)]
    note = f' Not shown: {", ".join(white)}, new at each tick.' if white else ''
    return [
        picture(
            'sensitivity',
            sensitivity(by_outcome, level),
            first=first,
            strongest=strongest,
            percent=100 * (1 - FALSE_ALARM),
            note=note,
        ),
    ]


def _worst(store: Store, figures: list[Spread], success: Bools) -> list[Block]:
    rows: list[tuple[str, ...]] = [('worst of each figure',)]
    rows += [
        (
            s.name,
            number(s.worst, plain(s.unit), '.4g'),
            _verdict(success, s.worst_run),
            _again(store, s.worst_run),
        )
        for s in figures
    ]
    judged, ends, count = _judged(store), ends_m(store), int((~success).sum())
    for name, runs in _first_missed(judged).items():
        what = f'miss first: {words(name, unit=False)}'
        if np.isinf(judged[name][0, runs]).all():
            what = judging.never(name, len(runs))
        rows.append((f'{len(runs)} of {count} failures {what}',))
        for run in _farthest_first(judged[name], ends, runs)[:WORST_FAILURES].tolist():
            said = _beside(name, judged[name][:, run], ends[run])
            rows.append((f'run {run}', said, 'failure', _again(store, run)))
    heads = ('figure', 'value', 'run', 'to fly it again')
    return [
        Text('Each command flies one run again with the same bits.'),
        Text('Failures are by what they miss first, in the order in which a flight comes to it.'),
        Table('Runs to look at', heads, tuple(rows)),
    ]


def _first_missed(judged: Mapping[str, Floats]) -> dict[str, Ints]:
    """Return limit -> runs of which it is the first one missed, in the order of a flight."""
    runs, left = {}, np.array(True)
    for name in judging.in_flight(judged):
        values, limits, _ = judged[name]
        missed = ~(values <= limits)
        if (missed & left).any():
            runs[name] = np.flatnonzero(missed & left)
        left = left & ~missed
    return runs


def _farthest_first(judged: Floats, ends: Floats, runs: Ints) -> Ints:
    """Return runs by how far they are beyond a limit; of those that never are, by where they end.

    judged : (3, n) metric, limit, share of it
    """
    values, _, shares = judged
    values = np.where(np.isinf(values), ends, values)
    return runs[np.lexsort((-values[runs], -shares[runs]))]


def _beside(name: str, judged: Floats, end_m: float) -> str:
    """Return the metric of a run beside its limit, in words.

    judged : (3,) metric, limit, share of it; end_m : distance from the goal at the end
    """
    value, limit, _ = judged.tolist()
    if np.isinf(value):
        return f'{judging.never(name)}, ends {end_m:.3g} m from the goal'
    return f'{words(name, unit=False)}: {value:.3g} of {limit:.3g} {ROWS[name].unit}'.rstrip()


def _worst_flights(store: Store, success: Bools) -> tuple[Replayed, ...]:
    """Fly the runs again that come closest to a limit, or are farthest beyond one."""
    campaign, flights, judged = store.campaign, [], _judged(store)
    lax = unbounded(campaign.scenario, campaign.config.success)
    ends, nearest = ends_m(store), np.max([shares for _, _, shares in judged.values()], axis=0)
    for run in np.lexsort((-ends, -nearest))[:REPLAYED].tolist():
        beside = {name: rows[:, run] for name, rows in judged.items()}
        missed = [n for n in judging.in_flight(judged) if not beside[n][0] <= beside[n][1]]
        title = 'Missed, in the order of a flight' if missed else 'Largest beside its limit'
        largest = list(beside)[int(np.argmax([share for _, _, share in beside.values()]))]
        shown = missed or [largest]
        said = dict.fromkeys(_beside(name, beside[name], ends[run]) for name in shown)
        verdict = f'{_verdict(success, run).capitalize()}. {title}: {"; ".join(said)}.'
        flown, bad = fly_run(campaign, run), None if lax and success[run] else not success[run]
        flights.append(Replayed(f'run {run}', flown, verdict, bad, campaign.controller))
    return tuple(flights)


def _judged(store: Store) -> dict[str, Floats]:
    """Return limit -> (3, n): a metric of each run, its limit there, and their ratio."""
    config = store.campaign.config
    columns, judged = {name: store.column(name) for name in config.judging}, {}
    for name, (values, limits) in config.limits(columns).items():
        each = np.broadcast_to(np.asarray(limits, dtype=np.float64), values.shape)
        none = np.where(values > 0.0, np.inf, 0.0)
        shares = np.divide(values, each, out=none, where=each > 0.0)
        judged[name] = np.stack([values, each, shares])
    return judged


def _verdict(success: Bools, run: int) -> str:
    return 'success' if success[run] else 'failure'


def _again(store: Store, run: int) -> str:
    return shlex.join(['rpo', 'campaign', str(store.folder), '--run', str(run)])
