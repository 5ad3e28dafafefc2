# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""`rpo simulate`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rpo_core.controller import DEFAULT_CONTROLLER

if TYPE_CHECKING:
    from rpo_core.closed_loop import Flight

EXAMPLES = """
Examples: `rpo simulate` | `rpo simulate paper_test --controller paper_ga` | `rpo simulate my.yaml
--csv flight.csv`
"""


def simulate(
    scenario: Annotated[str, typer.Argument(help='shipped name or file')] = 'paper_test',
    controller: Annotated[str, typer.Option(help='shipped name or file')] = DEFAULT_CONTROLLER,
    csv: Annotated[Path | None, typer.Option(help='write time, state, force, disturbance')] = None,
) -> None:
    """Fly one scenario without ROS: the bits that the nodes fly, and their figures."""
    from rich.console import Console
    from rich.table import Table

    from rpo_core import metrics
    from rpo_core.closed_loop import fly
    from rpo_core.controller import load_controller
    from rpo_core.scenario import load_scenario

    flight = fly(load_scenario(scenario), load_controller(controller))
    figures = metrics.assess(flight)
    console = Console()
    console.print(
        f'{scenario}, {controller}: J {figures.energy_n2s:.4f} N^2 s; last 30 s mean speed '
        f'{figures.arrival_speed_m_s:.4f} m/s, distance {figures.arrival_distance_m:.4f} m; '
        f'largest slew {figures.slew_n_s:.4f} N/s',
        highlight=False,
        soft_wrap=True,
    )
    table = Table(title="The paper's claims", title_justify='left')
    for heading in ('what', 'paper', 'flown', ''):
        table.add_column(heading, justify='left' if heading == 'what' else 'right')
    for claim in metrics.claims(flight):
        table.add_row(
            claim.statement,
            f'{claim.paper:.4g} {claim.unit}',
            f'{claim.flown:.4g} {claim.unit}',
            'held' if claim.holds else 'MISSED',
        )
    console.print(table)
    if csv:
        _write_csv(flight, csv)


def _write_csv(flight: Flight, path: Path) -> None:
    import numpy as np

    from rpo_core.validation import InputError

    heading = 't_s,x_m,y_m,z_m,vx_m_s,vy_m_s,vz_m_s,fx_n,fy_n,fz_n,dx_n,dy_n,dz_n'
    table = np.column_stack(
        [flight.scenario.times_s, flight.states, flight.forces_n, flight.disturbances_n]
    )
    try:
        np.savetxt(path, table, fmt='%.17g', delimiter=',', header=heading, comments='')
    except OSError as error:
        raise InputError(f'{path}: cannot be written: {error.strerror or error}') from None
