# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The report of a campaign: its success, where it ends, what matters, the worst runs."""

from __future__ import annotations

import shlex
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rpo_core.files.validation import InputError
from rpo_log.show import report as log_report
from rpo_log.show import style
from rpo_montecarlo.campaign import judging
from rpo_montecarlo.campaign.judging import words
from rpo_montecarlo.campaign.quantities import QUANTITIES
from rpo_montecarlo.campaign.run_batch import FINAL
from rpo_montecarlo.campaign.sampling import parameters_of
from rpo_montecarlo.campaign.statistics import QUANTILES, Rate, Spread, rates, spreads, successes
from rpo_montecarlo.campaign.store import Store
from rpo_report import campaign_plots, sensitivity
from rpo_report.blocks import Block, File, Picture, Report, Section, Table, Text

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

WORST_FAILURES = 5

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
        Picture(
            'success',
            campaign_plots.rates(found),
            'Share of runs that succeed, and that keep each condition alone. Success: '
            f'{judging.sentence(store.campaign)}.',
            '; '.join(f'{rate.name}: {_percent(rate)}' for rate in found) + '.',
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
    return [
        Picture(
            'distributions',
            campaign_plots.distributions(drawn, success),
            'How the figures are distributed; the last 0.05 % are beyond the right edge.',
            '; '.join(f'{s.name}: median {s.quantiles[0]:.3g} {_unit(s.unit)}' for s in found)
            + '.',
        ),
        Table('Mean, quantiles and the worst run', heads, rows),
    ]


def _clouds(store: Store, success: Bools) -> Picture:
    final = np.column_stack([store.column(name) for name in FINAL])
    final[:, :3] -= store.campaign.scenario.goal_position_m
    limits = store.campaign.config.success
    held_s = log_report.close_up_s(store.campaign.scenario)
    bounds = limits.get('hold_error_per_axis_m'), limits.get('hold_speed_per_axis_m_s')
    return Picture(
        'final_states',
        campaign_plots.clouds(final, success, bounds),
        f'Position from the goal and velocity at the end of each run; of each kind the first '
        f'{campaign_plots.MOST_POINTS}. Holding is judged after {held_s:g} s, not at the end '
        'alone, so a failure may end within the limit. A limit far outside of the cloud is not '
        'drawn.',
        f'Final states: the farthest is {np.linalg.norm(final[:, :3], axis=1).max():.3g} m from '
        'the goal.',
    )


def _what_matters(store: Store, success: Bools) -> list[Block]:
    drawn = {words(name): store.column(name) for name in parameters_of(store.campaign.config)}
    outcomes = {
        'failing': (~success).astype(np.float64),
        'energy J': store.column('energy_n2s'),
        'arrival time': store.column('arrival_time_s'),
    }
    found = {
        name: influences
        for name, values in outcomes.items()
        if (influences := sensitivity.influences(drawn, values))
    }
    if not found:
        return [Text('No dispersion was drawn, or every run came out the same.')]
    level = sensitivity.chance_level(store.campaign.config.runs)
    first = next(iter(found))
    strongest = ', '.join(i.column for i in found[first][:3])
    white = [
        n for n in store.campaign.config.dispersions if QUANTITIES[n].distributions == ('white',)
    ]
    unseen = ', '.join(words(name, unit=False) for name in white)
    note = f' Not shown: {unseen}, new at each tick.' if white else ''
    return [
        Picture(
            'sensitivity',
            campaign_plots.sensitivity(found, level),
            'Rank correlation (Spearman) of what was drawn with what came out, strongest on '
            f'{first} first. Within the grey band a dispersion without effect falls in '
            f'{100 * (1 - sensitivity.FALSE_ALARM):g} % of cases. The diamonds tell where a '
            f'deviation to either side does the same.{note}',
            f'Most correlated with {first}: {strongest}.',
        ),
        _influence_table(found, level),
    ]


def _influence_table(found: dict[str, list[sensitivity.Influence]], level: float) -> Table:
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
        excess = _excess(store)
        for run in failures[np.argsort(-excess[failures])][:WORST_FAILURES].tolist():
            share = f'{excess[run]:.3g} × the limit'
            rows.append((f'run {run}', share, 'failure', _again(store, run)))
    heads = ('figure', 'value', 'run', 'to fly it again')
    return [
        Text('Each command flies one run again with the same bits; --csv writes its flight.'),
        Table('Runs to look at', heads, tuple(rows)),
    ]


def _excess(store: Store) -> Floats:
    """Return the largest ratio (n,) of a metric to its limit, of each run."""
    config = store.campaign.config
    columns = {name: store.column(name) for name in config.judging}
    found = np.zeros(config.runs)
    for values, limits in (config.limit(name, columns) for name in config.success):
        share = np.divide(values, limits, out=np.zeros(config.runs), where=np.asarray(limits) > 0.0)
        found = np.maximum(found, share)
    return found


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
        Table('Dispersions', ('quantity', 'distribution', 'spread', 'unit'), rows),
        Table('Success', ('figure', 'limit'), limits),
        *(File(name, text) for name, text in zip(names, store.campaign.texts, strict=True)),
    ]
