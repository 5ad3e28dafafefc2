# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What `rpo bench` does: measure a part, or all, and print it."""

from __future__ import annotations

import sys
from pathlib import Path

from rpo_cli.display import print_table, progress
from rpo_montecarlo import machine, outputs
from tools.bench import flying, inference, ros, table


def run(
    what: str, evaluations: int, runs: int, workers: int, output: Path, write: Path | None
) -> bool:
    """Measure and print; return whether a target is missed. See `rpo bench --help`."""
    print(machine.machine())
    load = machine.load_per_core()
    if load > machine.BUSY:
        print(
            f'Load {load:.1f} per core: other work slows this machine, and wall times include it.',
            file=sys.stderr,
        )
    if what == 'all':
        return not _all(output, write)
    if what == 'inference':
        _inference()
    elif what == 'training':
        _training(evaluations, workers)
    elif what == 'campaign':
        _campaign(runs, workers)
    elif what == 'learning':
        found = flying.environments()
        peer = '' if found.peer is None else f', safe-autonomy-simulation {found.peer:.3g}'
        print(f'side by side {found.together:.3g} ticks/s of a core, alone {found.alone:.3g}{peer}')
    else:
        _ros()
    return False


def _all(output: Path, page: Path | None) -> bool:
    """Measure all; return whether every target is held."""
    with progress() as show:
        found = table.run(lambda what, share: show(what, 100.0 * share, 100.0))
    print_table(table.HEADINGS, [row.cells for row in found.rows], left=3)
    print(table.save(found, output))
    if page is not None:
        outputs.put(page, 'rpo bench --write', table.markdown(found))
        print(page)
    return all(row.holds for row in found.rows)


def _inference() -> None:
    rates = inference.inference()
    for rate in rates:
        print(
            f'{rate.name:26s} {rate.per_second:12.4g} inferences/s of one core   '
            f'ours {rates[0].per_second / rate.per_second:9.4g} x   '
            f'outputs differ by {rate.difference:.1e}'
        )


def _training(evaluations: int, workers: int) -> None:
    budget = flying.training(evaluations, workers)
    print(
        f'{budget.evaluations} controllers x 216 starts x {budget.steps} steps on {budget.workers} '
        f'threads: {budget.wall_s:.1f} s ({budget.cpu_s:.1f} s of CPU); '
        f'{budget.loops_per_evaluation} axis loops a controller instead of 648, '
        f'{budget.inferences_per_cpu_s:.3g} inferences per CPU second'
    )


def _campaign(runs: int, workers: int) -> None:
    found = flying.campaign(runs, workers)
    print(
        f'{found.runs} runs x {found.ticks} steps: {found.wall_s:.1f} s ({found.cpu_s:.1f} s of '
        f'CPU); the core alone, run by run: {found.core_s_per_run:.3g} s of CPU a run'
    )


def _ros() -> None:
    for _, name, fly, _ in ros.LOOPS:
        loop, trips, ratio = ros.in_turns(fly)
        print(
            f'{name}: {loop.ticks_per_s:.0f} ticks/s, {loop.real_time_factor:.0f} x real time; '
            f'two bare rclpy processes: {trips:.0f} round trips/s; ratio {ratio:.2f}'
        )
