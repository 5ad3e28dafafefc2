# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""`rpo plan`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rpo_core.validation import InputError
from rpo_training.commands.shared import Set

EXAMPLES = """
Examples: `rpo plan around` | `rpo plan hold_points --picture plan.png` | `rpo plan around --set
initial_position_m=[80,60,0]` | `rpo plan runs/docking_1 --sample 100`
"""


def plan(
    scenario: Annotated[str, typer.Argument(help='shipped name or file, or folder of a campaign')],
    changes: Set = None,
    picture: Annotated[Path | None, typer.Option(help='write the plan as a picture')] = None,
    sample: Annotated[int, typer.Option(min=1, help='runs of a campaign that are compared')] = 100,
) -> None:
    """Print the legs of a plan, and its energy beside the least that its zones allow.

    For the folder of a campaign: the energy that its runs flew, beside the least.
    """
    from rpo_core import overrides
    from rpo_guidance.plan import Guidance
    from rpo_training.display import print_table
    from rpo_training.evaluation import plan_bound

    if Path(scenario).is_dir():
        _compare(Path(scenario), sample)
        return
    chosen = overrides.load(scenario, changes or [])
    settings = chosen.section(Guidance)
    if settings is None:
        raise InputError(f'scenario {chosen.name} has no section `guidance`')
    found, energies = plan_bound.bound(settings, chosen)
    print_table(
        ('phase', 'begins, s', 'ends, s', 'J, N^2 s', 'range, m', '|f|, N', 'why'),
        plan_bound.rows(found, chosen),
        title=f'Plan of {chosen.name}',
    )
    typer.echo(
        f'{energies.duration_s:g} s: the plan needs {energies.plan:.4f} N^2 s, '
        f'{energies.plan / energies.least:.3f} times the least in its zones '
        f'({energies.least:.4f}, a local optimum); no flight needs less than {energies.free:.4f}'
    )
    if picture is not None:
        from rpo_training.report.plan_picture import draw

        draw(found, energies, settings, picture)
        typer.echo(picture)


def _compare(folder: Path, sample: int) -> None:
    """Print how the flown energy of some runs compares with the least in their zones."""
    import numpy as np

    from rpo_training.campaign.store import Store
    from rpo_training.display import print_table, progress
    from rpo_training.evaluation.plan_ratio import ratios

    store = Store.open(folder)
    if not store.finished:
        raise InputError(f'{folder}: is not finished: go on with `rpo campaign --resume`')
    with progress() as show:
        found = ratios(store, sample, lambda n: show('runs', n, sample))
    rows = []
    for name in ('flown', 'plan'):
        shares = np.array([getattr(r, name) / r.least for r in found])
        worst = found[int(shares.argmax())].run
        numbers = (*np.quantile(shares, (0.0, 0.5, 0.95)), shares.max())
        within = f'{int((shares <= 1.5).sum())} / {len(shares)}'
        rows.append((name, *(f'{x:.3f}' for x in numbers), str(worst), within))
    print_table(
        ('energy, over the least', 'least', '50 %', '95 %', 'worst', 'run', 'within 1.5'),
        rows,
        title=f'{store.campaign.config.name}: {len(found)} of {store.campaign.config.runs} runs',
    )
