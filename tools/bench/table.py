# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""P1 to P6 in one run: a table of targets, our results and those of the peers."""

from __future__ import annotations

import datetime
import json
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

from rpo_montecarlo import machine
from rpo_montecarlo.outputs import markdown_table, write_text
from tools.bench import flying, inference, ros

MAX_TRAINING_S, MAX_CAMPAIGN_S = 60.0, 4.0
LEAST_OF_FUZZYLITE, LEAST_OF_SKFUZZY = 100.0, 10_000.0
LEAST_STEPPED = 5e6
"""The targets: wall time, ratios to the peers, ticks per second of one core; see `ros.LOOPS`."""

NAIVE_LOOPS = 216 * 3
"""Axis loops of a controller, without symmetry."""

Progress = Callable[[str, float], None]
"""Gets the name of a measurement, and the share of it that is done."""


HEADINGS = ('', 'what', 'target', 'ours', 'peer, same run', 'ratio', '')


@dataclass(frozen=True)
class Row:
    """A target, its subject, our result and the result of the peer in the same run."""

    target: str
    what: str
    wanted: str
    ours: str
    peer: str
    ratio: str
    holds: bool

    @property
    def cells(self) -> tuple[str, ...]:
        """The row under `HEADINGS`."""
        verdict = 'held' if self.holds else 'MISSED'
        return self.target, self.what, self.wanted, self.ours, self.peer, self.ratio, verdict


@dataclass(frozen=True)
class Bench:
    """One run of all.

    machine : facts, `machine.facts`
    figures : all measured numbers; the names hold the units
    """

    date: str
    machine: dict[str, Any]
    rows: tuple[Row, ...]
    figures: dict[str, float]


Measured = Iterator[tuple[Row, dict[str, float]]]


def run(
    progress: Progress = lambda what, share: None,
    what: str = 'all',
    evaluations: int = flying.PAPER_BUDGET,
    runs: int = flying.CAMPAIGN_RUNS,
    workers: int = 0,
) -> Bench:
    """Measure a part, or all, which takes some minutes; see `rpo bench --help`."""
    parts: dict[str, Callable[[Progress, dict[str, float]], Measured]] = {
        'inference': _inference,
        'training': partial(_training, evaluations=evaluations, workers=workers),
        'campaign': partial(_campaign, runs=runs, workers=workers),
        'learning': _learning,
        'ros': _ros,
    }
    date = datetime.datetime.now(datetime.timezone.utc).strftime('%Y-%m-%d %H:%M:%S UTC')
    facts, rows = machine.facts(), []
    figures: dict[str, float] = {}
    for part in parts.values() if what == 'all' else [parts[what]]:
        for row, measured in part(progress, figures):
            rows.append(row)
            figures.update(measured)
    return Bench(date, facts, tuple(rows), figures)


def _inference(progress: Progress, _: dict[str, float]) -> Measured:
    progress('P1 inference', 0.0)
    ours, *peers = inference.inference()
    progress('P1 inference', 1.0)
    figures = {'inference_per_cpu_s': ours.per_second}
    for peer, least in zip(peers, (LEAST_OF_FUZZYLITE, LEAST_OF_SKFUZZY), strict=True):
        ratio = ours.per_second / peer.per_second
        name = peer.name.partition(',')[0]
        yield (
            Row(
                'P1',
                f'inference, compared with {name}',
                f'≥ {least:g} ×',
                f'{ours.per_second:.2e}/s',
                f'{peer.per_second:.2e}/s',
                f'{ratio:.0f} ×',
                ratio >= least,
            ),
            {**figures, f'{name.replace("-", "_")}_per_cpu_s': peer.per_second},
        )


def _training(
    progress: Progress, figures: dict[str, float], evaluations: int, workers: int
) -> Measured:
    budget = flying.training(evaluations, workers, lambda share: progress('P2 training', share))
    rate, peer, ratio = figures.get('pyfuzzylite_per_cpu_s'), '–', '–'
    if rate is not None:  # where inference is measured too
        peer_s = budget.evaluations * NAIVE_LOOPS * budget.steps / rate
        peer, ratio = f'{peer_s / 3600:.0f} h of CPU', f'{peer_s / budget.cpu_s:.0f} ×'
    yield (
        Row(
            'P2',
            f'training, {budget.evaluations} controllers',
            f'≤ {MAX_TRAINING_S:g} s',
            f'{budget.wall_s:.1f} s ({budget.cpu_s:.0f} s of CPU)',
            peer,
            ratio,
            budget.wall_s <= MAX_TRAINING_S,
        ),
        {'training_wall_s': budget.wall_s, 'training_cpu_s': budget.cpu_s},
    )


def _campaign(progress: Progress, _: dict[str, float], runs: int, workers: int) -> Measured:
    found = flying.campaign(runs, workers, lambda share: progress('P3 campaign', share))
    peer_s = found.core_s_per_run * found.runs
    yield (
        Row(
            'P3',
            f'campaign, {found.runs} runs',
            f'≤ {MAX_CAMPAIGN_S:g} s',
            f'{found.wall_s:.1f} s ({found.cpu_s:.1f} s of CPU)',
            f'{peer_s:.0f} s of CPU',
            f'{peer_s / found.cpu_s:.0f} ×',
            found.wall_s <= MAX_CAMPAIGN_S,
        ),
        {
            'campaign_wall_s': found.wall_s,
            'campaign_cpu_s': found.cpu_s,
            'core_run_cpu_s': found.core_s_per_run,
        },
    )


def _learning(progress: Progress, _: dict[str, float]) -> Measured:
    progress('P6 environments', 0.0)
    found = flying.environments()
    progress('P6 environments', 1.0)
    peer, name = found.alone, 'one at a time'
    if found.peer is not None:
        peer, name = found.peer, 'safe-autonomy-simulation'
    yield (
        Row(
            'P6',
            'environments for learning, 4000 side by side',
            f'≥ {LEAST_STEPPED:.0e} ticks/s',
            f'{found.together:.2e}/s',
            f'{peer:.2e}/s, {name}',
            f'{found.together / peer:.0f} ×',
            found.together >= LEAST_STEPPED,
        ),
        {
            'stepped_together_per_cpu_s': found.together,
            'stepped_alone_per_cpu_s': found.alone,
            **({} if found.peer is None else {'stepped_peer_per_cpu_s': found.peer}),
        },
    )


def _ros(progress: Progress, _: dict[str, float]) -> Measured:
    progress('P4, P5 ROS loop', 0.0)
    for number, (target, name, fly, least, than) in enumerate(ros.LOOPS):
        progress('P4, P5 ROS loop', (number + 1) / (len(ros.LOOPS) + 1))
        loop, trips, ratios = ros.in_turns(fly, ros.TURNS.get(target, ros.LEAST_TURNS))
        factor, key = loop.real_time_factor, name.partition(', ')[2].replace(' ', '_')
        yield (
            Row(
                target,
                name,
                f'≥ {least:g} × {than}',
                f'{factor:.0f} × ({loop.ticks_per_s:.0f} ticks/s)',
                f'{trips:.0f} round trips/s',
                f'{median(ratios):.2f} × ({ratios[0]:.2f} to {ratios[-1]:.2f})',
                (median(ratios) if than == ros.PEER else factor) >= least,
            ),
            {
                f'{key}_ticks_per_s': loop.ticks_per_s,
                f'{key}_ping_pong_per_s': trips,
                f'{key}_least_ratio': ratios[0],
                f'{key}_ratio': median(ratios),
            },
        )
    progress('P4, P5 ROS loop', 1.0)


def markdown(bench: Bench) -> str:
    """Return the table as Markdown for the documentation."""
    facts = bench.machine
    versions = ', '.join(f'{name} {facts[name]}' for name in ('python', *machine.PACKAGES))
    lines = [
        f'Measured {bench.date} on {facts["processor"]}, {facts["cores"]} cores, load per core '
        f'{facts["load_per_core"]:g} at the start. {versions}.',
        '',
        *markdown_table(HEADINGS, [row.cells for row in bench.rows]),
    ]
    if facts['load_per_core'] > machine.BUSY:
        lines += ['', 'The machine was busy with other work, which lengthens wall times.']
    return '\n'.join(lines) + '\n'


def save(bench: Bench, folder: Path) -> Path:
    """Write the run as JSON, named by its date; return the file."""
    folder.mkdir(parents=True, exist_ok=True)
    name = bench.date.replace(' UTC', '').replace(':', '').replace(' ', '-')
    path = folder / f'{name}.json'
    write_text(path, json.dumps(asdict(bench), indent=2) + '\n')
    return path
