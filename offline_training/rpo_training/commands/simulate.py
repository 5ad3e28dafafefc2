# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""`rpo simulate`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rpo_core.files import DEFAULT_CONTROLLER

if TYPE_CHECKING:
    from rpo_core.flight import Flight

EXAMPLES = """
Examples: `rpo simulate` | `rpo simulate paper_test --controller paper_ga` | `rpo simulate my.yaml
--csv flight.csv`
"""


def simulate(
    scenario: Annotated[str, typer.Argument(help='shipped name or file')] = 'paper_test',
    controller: Annotated[str, typer.Option(help='shipped name or file')] = DEFAULT_CONTROLLER,
    csv: Annotated[Path | None, typer.Option(help='write time, state, force, disturbance')] = None,
) -> None:
    """Fly one scenario without ROS: the bits that the nodes fly, and their metrics."""
    from rpo_core.controller import load_controller
    from rpo_core.flight import fly
    from rpo_core.scenario import load_scenario
    from rpo_log.show.report import print_table

    flight = fly(load_scenario(scenario), load_controller(controller))
    print_table(flight, f'{scenario}, controller {controller}')
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
