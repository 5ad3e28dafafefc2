# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The report of a campaign: its success, where it ends, what matters, the worst runs."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import norm, rankdata

from rpo_core.files.validation import InputError
from rpo_core.judge.requirements import ROWS
from rpo_kernels.arrays import Bools, Floats
from rpo_log.show import report as log_report
from rpo_log.show import style
from rpo_montecarlo.campaign import judging
from rpo_montecarlo.campaign.judging import words
from rpo_montecarlo.campaign.quantities import QUANTITIES
from rpo_montecarlo.campaign.run_batch import FINAL
from rpo_montecarlo.campaign.sampling import parameters_of
from rpo_montecarlo.campaign.single import fly_run
from rpo_montecarlo.campaign.statistics import QUANTILES, Rate, Spread, rates, spreads, successes
from rpo_montecarlo.campaign.store import Store
from rpo_report.page import Block, File, Fold, Picture, Report, Section, Table, Text, picture
from rpo_report.replay import Replayed

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
    ranks = _standard_ranks(outcome)
    if ranks is None:
        return []
    found = []
    for name, values in drawn.items():
        deviation = values - (values.min() + values.max()) / 2.0
        signed, size = _standard_ranks(deviation), _standard_ranks(np.abs(deviation))
        if signed is not None:
            by_size = 0.0 if size is None else float(ranks @ size)
            found.append(Influence(name, float(ranks @ signed), by_size))
    return sorted(found, key=lambda influence: -influence.strength)


def _standard_ranks(values: Floats) -> Floats | None:
    """Return ranks of mean 0 and norm 1; None where all values are equal."""
    ranks = rankdata(values)
    ranks -= ranks.mean()
    size = float(np.linalg.norm(ranks))
    return ranks / size if size > 0.0 else None


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


def distributions(columns: Mapping[str, Floats], success: Bools) -> Any:
    """Return histograms of metrics; columns : label with unit -> values (n,).

    Runs whose value is infinite, what they never did, are not drawn.
    """
    rows = -(-len(columns) // 2)
    figure, panels = style.new_panels(2.3 * rows, rows, 2, squeeze=False)
    for axes in panels.ravel()[len(columns) :]:
        axes.set_axis_off()
    for axes, (label, values) in zip(panels.flat, columns.items(), strict=False):
        known = np.isfinite(values)
        span = _span(values[known]) if known.any() else (0.0, 1.0)
        axes.hist(
            [values[success & known], values[~success & known]],
            bins=_BINS,
            range=span,
            stacked=True,
            color=[_KEPT, _FAILED],
            label=['success', 'failure'],
        )
        if known.any():
            axes.axvline(np.median(values[known]), **style.LIMIT, label='median')
        axes.set(xlabel=label, ylabel='number of runs', xlim=span)
        axes.grid(axis='x', visible=False)
    style.legend_below(figure, panels[0][0])
    return figure


def _span(values: Floats) -> tuple[float, float]:
    low, high = float(values.min()), float(np.quantile(values, 0.9995))
    return (low, high) if high > low else (low - 0.5, low + 0.5)


def sensitivity(found: Mapping[str, Sequence[Influence]], level: float) -> Any:
    """Return the influences of each column on each outcome, as bars; weak ones within `level`."""
    columns = [i.column for i in next(iter(found.values()))]
    height = 0.5 + 0.27 * len(columns)
    figure, (panels,) = style.new_panels(height, 1, len(found), sharey=True, squeeze=False)
    places = np.arange(len(columns))
    for axes, (outcome, influences) in zip(panels, found.items(), strict=True):
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


def draw_rates(found: Sequence[Rate]) -> Any:
    """Return success rates with their intervals."""
    shares = np.array([rate.kept / rate.runs for rate in found])
    below = shares - [rate.low for rate in found]
    above = [rate.high for rate in found] - shares
    figure, axes = style.new_panels(0.9 + 0.36 * len(found))
    places = np.arange(len(found))
    axes.errorbar(
        100.0 * shares,
        places,
        xerr=100.0 * np.array([below, above]),
        fmt='o',
        color=_KEPT,
        capsize=4,
        markersize=5,
        label='share of runs, Wilson 95 %',
    )
    axes.set_yticks(places, [rate.name for rate in found])
    axes.set(xlabel='runs that keep it [%]', ylim=(len(found) - 0.5, -0.5))
    style.legend_below(figure, axes)
    return figure


WORST_FAILURES = 5
REPLAYED = 20
"""Runs in the replay of a campaign."""

_SHOWN = {
    'energy_n2s': 'energy J [N²s]',
    'arrival_time_s': 'arrival within 0.5 m [s]',
    'slew_per_axis_n_s': 'slew per axis [N/s]',
    'delta_v_axis_sum_m_s': 'Δv (sum of the axes) [m/s]',
    'hold_error_per_axis_m': 'hold: position error per axis [m]',
    'hold_speed_per_axis_m_s': 'hold: speed per axis [m/s]',
}
"""Metrics whose distributions are drawn."""


def report_of(folder: Path) -> Report:
    """Return the report of a finished campaign's folder; raises InputError."""
    store = Store.open(folder)
    if not store.finished:
        raise InputError(f'{folder}: is not finished: go on with rpo campaign --resume')
    config = store.campaign.config
    success = successes(config, {name: store.column(name) for name in config.judging})
    found_rates, found_spreads = rates(store), spreads(store)
    found_rates = [rate._replace(name=_condition(rate)) for rate in found_rates]
    found_spreads = [s._replace(name=words(s.name, unit=False)) for s in found_spreads]
    with style.applied():
        sections = (
            Section('Success', tuple(_success(store, found_rates))),
            Section('Figures', tuple(_figures(store, found_spreads, success))),
            Section('Where it ends', (_clouds(store, success),)),
            Section('What matters', tuple(_what_matters(store, success))),
            Section('Worst runs', tuple(_worst(store, found_spreads, success))),
            Section('Configuration', tuple(_configuration(store))),
        )
    kept = found_rates[0]
    return Report(
        f'Campaign {config.name}: {store.campaign.scenario.name}, controller '
        f'{store.campaign.controller.name}',
        f'{kept.runs} runs, seed {config.seed}; success {_percent(kept)}. '
        f'Success: {judging.sentence(store.campaign)}.{_moving(found_rates)}',
        sections,
        flights=_worst_flights(store, success),
        note=f'The runs of {kept.runs} that come closest to a limit, or are farthest beyond one.',
    )


def _condition(rate: Rate) -> str:
    """Return what a rate counts: success, or that a limit is kept."""
    name, keeps, limit = rate.name.partition(' <= ')
    return f'{words(name, unit=False)} ≤ {_unit(limit)}' if keeps else name


def _shown(name: str, limit: float) -> str:
    """Return a limit for people."""
    return f'{words(name, unit=False)} ≤ {limit:g} {_unit(judging.unit_of(name))}'.rstrip()


def _unit(ascii_unit: str) -> str:
    return ascii_unit.replace('N^2 s', 'N²s')


def _percent(rate: Rate) -> str:
    return f'{rate.percent} % ({rate.interval} %, Wilson 95 %)'


def _moving(found: list[Rate]) -> str:
    """Return the sentence on position and speed alone, where more is judged."""
    share = next((rate for rate in found if rate.name == judging.MOTION), None)
    return f' By {judging.MOTION} alone: {_percent(share)}.' if share else ''


def _success(store: Store, found: list[Rate]) -> list[Block]:
    rows: list[tuple[str, ...]] = [
        (rate.name, f'{rate.kept} / {rate.runs}', f'{rate.percent} %', f'{rate.interval} %')
        for rate in found
    ]
    rows += [
        (_shown(name, store.campaign.required[name]), judging.NOT_JUDGED, '', '')
        for name in judging.not_judged(store.campaign)
    ]
    return [
        picture(
            'success',
            draw_rates(found),
            success=judging.sentence(store.campaign),
            rates='; '.join(f'{rate.name}: {_percent(rate)}' for rate in found),
        ),
        Table('Rates', ('condition', 'runs', 'share', 'Wilson 95 %'), tuple(rows)),
    ]


def _figures(store: Store, found: list[Spread], success: Bools) -> list[Block]:
    drawn = {label: store.column(name) for name, label in _SHOWN.items()}
    heads = ('figure', 'unit', 'mean', *(f'{100 * q:g} %' for q in QUANTILES), 'worst', 'run')
    rows = tuple(
        (
            s.name,
            _unit(s.unit),
            *(f'{x:.3g}' for x in (s.mean, *s.quantiles, s.worst)),
            str(s.worst_run),
        )
        for s in found
    )
    medians = (f'{s.name}: median {s.quantiles[0]:.3g} {_unit(s.unit)}' for s in found)
    return [
        picture('distributions', distributions(drawn, success), medians='; '.join(medians)),
        Table('Mean, quantiles and the worst run', heads, rows),
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
    outcomes = {
        'failing': (~success).astype(np.float64),
        'energy J': store.column('energy_n2s'),
        'arrival time': store.column('arrival_time_s'),
    }
    found = {
        name: found_influences
        for name, values in outcomes.items()
        if (found_influences := influences(drawn, values))
    }
    if not found:
        return [Text('No dispersion was drawn, or every run came out the same.')]
    level = chance_level(store.campaign.config.runs)
    first = next(iter(found))
    strongest = ', '.join(i.column for i in found[first][:3])
    white = [
        n for n in store.campaign.config.dispersions if QUANTITIES[n].distributions == ('white',)
    ]
    unseen = ', '.join(words(name, unit=False) for name in white)
    note = f' Not shown: {unseen}, new at each tick.' if white else ''
    return [
        picture(
            'sensitivity',
            sensitivity(found, level),
            first=first,
            strongest=strongest,
            percent=100 * (1 - FALSE_ALARM),
            note=note,
        ),
        Fold('Correlations as numbers', (_influence_table(found, level),)),
    ]


def _influence_table(found: dict[str, list[Influence]], level: float) -> Table:
    rows: list[tuple[str, ...]] = []
    for outcome, influences in found.items():
        rows.append((outcome,))
        rows += [
            (i.column, f'{i.signed:+.3f}', f'{i.size:+.3f}')
            for i in influences[:5]
            if i.strength > level
        ]
    heads = ('drawn', 'of the deviation', 'of its size')
    return Table(f'Strongest rank correlations; beyond chance is {level:.3f}', heads, tuple(rows))


def _worst(store: Store, found: list[Spread], success: Bools) -> list[Block]:
    rows: list[tuple[str, ...]] = [('worst of each figure',)]
    rows += [
        (
            s.name,
            f'{s.worst:.4g} {_unit(s.unit)}',
            _verdict(success, s.worst_run),
            _again(store, s.worst_run),
        )
        for s in found
    ]
    failures = np.flatnonzero(~success)
    if failures.size:
        rows.append((f'farthest beyond the limits, of {failures.size} failures',))
        excess = _excess(_judged(store))
        for run in failures[np.argsort(-excess[failures])][:WORST_FAILURES].tolist():
            share = f'{excess[run]:.3g} × the limit'
            rows.append((f'run {run}', share, 'failure', _again(store, run)))
    heads = ('figure', 'value', 'run', 'to fly it again')
    return [
        Text('Each command flies one run again with the same bits; --csv writes its flight.'),
        Table('Runs to look at', heads, tuple(rows)),
    ]


def _worst_flights(store: Store, success: Bools) -> tuple[Replayed, ...]:
    """Fly the runs again that come closest to a limit, or are farthest beyond one."""
    campaign, found, judged = store.campaign, [], _judged(store)
    for run in np.argsort(-_excess(judged), kind='stable')[:REPLAYED].tolist():
        share, said = 0.0, 'Nothing is judged'
        for name, (values, limits, shares) in judged.items():
            if limits[run] > 0.0 and shares[run] >= share:
                share, unit = shares[run], ROWS[name].unit
                what = words(name, unit=False)
                said = f'{what}: {values[run]:.3g} of {limits[run]:.3g} {unit}'.rstrip()
        verdict = f'{_verdict(success, run).capitalize()}. Largest beside its limit: {said}.'
        flown, missed = fly_run(campaign, run), not success[run]
        found.append(Replayed(f'run {run}', flown, verdict, bool(missed), campaign.controller))
    return tuple(found)


def _judged(store: Store) -> dict[str, Floats]:
    """Return limit -> (3, n): a metric of each run, its limit there, and their ratio, 0 of none."""
    config = store.campaign.config
    columns, found = {name: store.column(name) for name in config.judging}, {}
    for name, (values, limits) in config.limits(columns).items():
        each = np.broadcast_to(np.asarray(limits, dtype=np.float64), values.shape)
        shares = np.divide(values, each, out=np.zeros(config.runs), where=each > 0.0)
        found[name] = np.stack([values, each, shares])
    return found


def _excess(judged: Mapping[str, Floats]) -> Floats:
    """Return the largest ratio (n,) of a metric to its limit, of each run."""
    return np.asarray(np.max([shares for _, _, shares in judged.values()], axis=0))


def _verdict(success: Bools, run: int) -> str:
    return 'success' if success[run] else 'failure'


def _again(store: Store, run: int) -> str:
    return shlex.join(['rpo', 'campaign', str(store.folder), '--run', str(run)])


def _configuration(store: Store) -> list[Block]:
    config = store.campaign.config
    rows = tuple(
        (
            words(name, unit=False),
            dispersion.distribution,
            ', '.join(f'{s:g}' for s in sorted(set(dispersion.spread))),
            QUANTITIES[name].unit,
        )
        for name, dispersion in config.dispersions.items()
    )
    limits = tuple(
        (words(name, unit=False), f'≤ {limit:g} {_unit(judging.unit_of(name))}'.rstrip())
        for name, limit in config.success.items()
    )
    names = ('campaign.yaml', 'scenario.yaml', 'controller.yaml')
    return [
        Fold(
            'Dispersions and limits',
            (
                Table('Dispersions', ('quantity', 'distribution', 'spread', 'unit'), rows),
                Table('Success', ('figure', 'limit'), limits),
            ),
        ),
        *(File(name, text) for name, text in zip(names, store.campaign.texts, strict=True)),
    ]
