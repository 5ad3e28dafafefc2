# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""`rpo simulate`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rpo_core.files import DEFAULT_CONTROLLER
from rpo_training import outputs

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
        outputs.write_flight(flight, csv)
