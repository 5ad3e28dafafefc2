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
initial_position_m=[80,60,0]`
"""


def plan(
    scenario: Annotated[str, typer.Argument(help='shipped name or file, with guidance')],
    changes: Set = None,
    picture: Annotated[Path | None, typer.Option(help='write the plan as a picture')] = None,
) -> None:
    """Print the legs of a plan, and its energy beside the least that its zones allow."""
    from rpo_core import overrides
    from rpo_guidance.plan import Guidance
    from rpo_training.display import print_table
    from rpo_training.evaluation import plan_bound

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
