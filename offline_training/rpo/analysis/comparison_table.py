# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A comparison as a table: for the terminal, Markdown and JSON."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path

from rpo.analysis.comparison import OPEN_N, OPENED_RUNS, RANDOM, WORLD, WORLD_RUNS, Row
from rpo.analysis.robustness import COLUMNS, CROSSED, DRAWN, RUNS, SEED, cells
from rpo.montecarlo.config import Campaign
from rpo.montecarlo.judging import NOT_JUDGED, motion, sentence, words
from rpo.montecarlo.outputs import markdown_table, write_text
from rpo.montecarlo.statistics import rate
from rpo.training.scoring.conditions import LABELS
from rpo_core.judge.metrics import CLAIM_WINDOW_S
from rpo_log.provenance import machine_facts

Table = list[tuple[str, ...]]
"""Headings, then a line for each controller; all texts."""

Column = str | Callable[[Row], str]
"""A cell: format of the figures of a controller, or a function of them."""

_OVERVIEW: dict[str, Column] = {
    'controller': '{name}',
    'mean J [N²s]': '{mean_energy_n2s:.3f}',
    '× least': lambda row: f'{row["ratio"]:.3f}' if row['met'] else '–',
    'starts that meet all': '{met} of {starts}',
    'arrival error, mean (worst) [m]': '{distance_m:.3g} ({worst_distance_m:.3g})',
    'slew [N/s]': '{slew_per_axis_n_s:.3g}',
    'dispersed: position and speed [%]': lambda row: _share(row['moving']),
    'dispersed: all limits [%]': lambda row: _share(row),
    'its training saw these': '{saw}',
    'command [µs]': '{command_us:.1f}',
}
_ROBUSTNESS: dict[str, Column] = {
    'controller': '{name}',
    'random starts missed: at rest [%]': lambda row: _missed(row, RANDOM[0]),
    'moving [%]': lambda row: _missed(row, RANDOM[1]),
    'smallest margin [%]': lambda row: (
        f'{100 * row["margin"]:.1f}' if row['margin'] >= 0.0 else 'missed'
    ),
    'of': lambda row: str(LABELS.get(row['margin_of'], row['margin_of'])).replace('_', ' '),
    'thrust starts per axis': '{openings:.1f}',
    'valve openings': '{valve_openings:.0f}',
    'propellant [g]': lambda row: f'{1e3 * row["propellant_kg"]:.1f}',
    'speed at 1 m, largest (median) [m/s]': lambda row: (
        '–'
        if row['contact_m_s'] is None
        else '{contact_m_s:.3f} ({contact_median_m_s:.3f})'.format_map(row)
    ),
    'proof': '{proof}',
}
"""Heading -> cell: of the main table, and of random starts, margins, thrusters, contact, proof."""


_TESTS: dict[str, Column] = {
    f"the paper's test, largest of an axis in the last {CLAIM_WINDOW_S:g} s; J over 400 s": (
        '{name}'
    ),
    'offset: ∣r∣ [m]': '{tests[paper_test][position_m]:.3g}',
    'offset: ∣v∣ [mm/s]': lambda row: _speed(row, 'paper_test'),
    'offset: J [N²s]': '{tests[paper_test][energy_n2s]:.3f}',
    'phase: ∣r∣ [m]': '{tests[paper_test_phase][position_m]:.3g}',
    'phase: ∣v∣ [mm/s]': lambda row: _speed(row, 'paper_test_phase'),
    'phase: J [N²s]': '{tests[paper_test_phase][energy_n2s]:.3f}',
}


def _speed(row: Row, test: str) -> str:
    return f'{1e3 * row["tests"][test]["velocity_m_s"]:.3g}'


def _share(found: Row | None) -> str:
    """Return a share of the dispersed runs with its interval; a dash where no limit is such."""
    if found is None:
        return '–'
    shares = (100 * x for x in (found['kept'] / found['runs'], found['low'], found['high']))
    return '{:.2f} ({:.2f}…{:.2f})'.format(*shares)


def _missed(row: Row, name: str) -> str:
    """Return a share of the random starts with its interval; a dash where none flew."""
    if name not in row['random_missed']:
        return '–'
    found = rate('missed', row['random_missed'][name], row['random_runs'])
    return f'{found.percent} ({found.interval.replace(" to ", "…")})'


def _table(columns: Mapping[str, Column], rows: Sequence[Row]) -> Table:
    def cell(column: Column, row: Row) -> str:
        return column.format_map(row) if isinstance(column, str) else column(row)

    return [tuple(columns), *(tuple(cell(c, row) for c in columns.values()) for row in rows)]


def margins(rows: Sequence[Row]) -> Table:
    """Return how far the loop of each controller may be off."""
    headings = ('controller', *COLUMNS, CROSSED[1], CROSSED[4])
    return [headings, *((row['name'], *cells(row['margins'])) for row in rows)]


TABLES = (
    partial(_table, _OVERVIEW),
    partial(_table, _ROBUSTNESS),
    margins,
    partial(_table, _TESTS),
)


def notes(rows: Sequence[Row], least: float, campaign: Campaign) -> list[str]:
    """Return what the columns mean, with the numbers behind them."""
    moving = ', '.join(words(name, unit=False) for name in motion(campaign.config.success))
    facts = machine_facts()
    runs, first = sorted({row['runs'] for row in rows}), rows[0]
    return [
        f'J, conditions, arrival error and slew: {first["starts"]} training starts, 200 s. Least: '
        f'{least:.4f} N²s, the mean of the optima under all conditions. Arrival error: mean '
        'distance over the last 30 s. Slew: the largest.',
        f'Dispersed: campaign `{campaign.config.name}`, {" or ".join(map(str, runs))} runs, with '
        f"Wilson's 95 % interval. All limits: {sentence(campaign)}. Position and speed: of these "
        f'{moving or "none"}. Its training saw these: what its training, by the command in its '
        'file, flew of this campaign (with other seeds).',
        f'Random starts: {first["random_runs"]} in the box of the training (±100 m on each axis) '
        'at rest, and as many with up to ±0.05 m/s, judged by its three conditions. Smallest '
        "margin: to any condition, over the training starts and the paper's tests. Thrust starts: "
        f'how often an axis goes beyond {1e3 * OPEN_N:g} mN or changes sides, mean of '
        f'{OPENED_RUNS} dispersed runs. Valve openings, propellant: of 400 s with sensors, filter '
        f'and pulses, mean of {WORLD_RUNS} runs of the campaign `{WORLD}`. Speed at 1 m: at the '
        'first state within 1 m of the target, over the training starts. Proof: of the three '
        'conditions from every start at rest in the box, undisturbed '
        '(`offline_training/proofs/proven.yaml`, from checked folders; of a family, its own '
        'claims).',
        'Gain to bias: the largest checked at which, and up to which, all training starts meet '
        f'their conditions, and {RUNS} flights of `{DRAWN}` (seed {SEED}) keep the limits that '
        'they keep when nothing is off; each alone. Gain: of the command, before it is saturated. '
        'Mass: the controller is not told. Bias: of navigation or sensor, on all axes, both signs. '
        f'!: holds again beyond. –: a start misses already. {_not_judged(rows)} Crossing: of the '
        'describing function of an axis, where its delay margin is least.',
        f'Command: processor time of one call from Python on {facts["processor"]}, Python '
        f'{facts["python"]}.',
    ]


def _not_judged(rows: Sequence[Row]) -> str:
    """Return which limits the drawn flights of which controllers are not judged by."""
    groups: dict[str, list[str]] = {}
    for row in rows:
        if limits := row['margins'].get('not_judged'):
            groups.setdefault(limits, []).append(row['name'])
    texts = [f'{limits} ({", ".join(names)})' for limits, names in groups.items()]
    return f'{NOT_JUDGED} in these flights: {"; ".join(texts) or "nothing"}.'


def markdown(
    rows: Sequence[Row],
    least: float,
    campaign: Campaign,
    tables: Sequence[Callable[[Sequence[Row]], Table]] = TABLES,
) -> str:
    """Return some tables and their notes as Markdown."""
    parts = [markdown_table(head, lines) for head, *lines in (table(rows) for table in tables)]
    parts.append([f'- {note}' for note in notes(rows, least, campaign)])
    return '\n\n'.join('\n'.join(part) for part in parts) + '\n'


def write(rows: Sequence[Row], least: float, campaign: Campaign, folder: Path) -> list[Path]:
    """Write compare.md and compare.json; return their paths."""
    document = {
        'least_mean_energy_n2s': least,
        'campaign': campaign.config.name,
        'success': sentence(campaign),
        'machine': machine_facts(),
        'controllers': list(rows),
    }
    texts = {
        'compare.md': markdown(rows, least, campaign),
        'compare.json': json.dumps(document, indent=1) + '\n',
    }
    for name, text in texts.items():
        write_text(folder / name, text)
    return [folder / name for name in texts]
