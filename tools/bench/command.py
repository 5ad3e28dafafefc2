# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What `rpo bench` does: measure a part, or all, and print it."""

from __future__ import annotations

import sys
from pathlib import Path

from rpo_cli.display import print_table, progress
from rpo_montecarlo import machine, outputs
from tools.bench import table


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
    with progress() as show:
        found = table.run(
            lambda part, share: show(part, 100.0 * share, 100.0), what, evaluations, runs, workers
        )
    lines = [table.HEADINGS, *(row.cells for row in found.rows)]
    if what != 'all':  # only the whole table judges
        lines = [(target, subject, *figures) for target, subject, _, *figures, _ in lines]
    print_table(lines[0], lines[1:], left=2)
    if what != 'all':
        return False
    print(table.save(found, output))
    if write is not None:
        outputs.put(write, 'rpo bench --write', table.markdown(found))
        print(write)
    return not all(row.holds for row in found.rows)
