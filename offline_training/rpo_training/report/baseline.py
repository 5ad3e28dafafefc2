# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The report of a controller without rules: how it flies, and its force where that is a surface."""

from __future__ import annotations

from rpo_core.controller import AnyController
from rpo_core.flight import fly
from rpo_core.scenario import load_scenario
from rpo_log.show import report as log_report
from rpo_log.show import style
from rpo_training.report.blocks import Picture, Report, Section, Table
from rpo_training.report.surface_plots import axis_forces

SCENARIOS = ('paper_test', 'paper_test_phase', 'approach')


def of(controller: AnyController) -> Report:
    """Return the report of any controller, without its provenance."""
    flights = {name: fly(load_scenario(name), controller) for name in SCENARIOS}
    rows: list[tuple[str, ...]] = []
    for name, flight in flights.items():
        for section, lines in log_report.rows(flight).items():
            rows += [(f'{name}: {section}',), *lines]
    with style.applied():
        histories = Picture(
            'time_histories',
            log_report.time_histories(flights[SCENARIOS[0]]),
            f'{SCENARIOS[0]}: relative position, velocity and control force in LVLH.',
            f'Time histories of {SCENARIOS[0]}; the table above has its figures.',
        )
        surfaces = Picture(
            'surface',
            axis_forces(controller),
            'The force of an axis over its position and velocity at t = 0, the other two axes at '
            'rest at the target. Controllers that plan answer otherwise later.',
            'Force over position and velocity of each axis.',
        )
    columns = ('figure', 'flown', 'limit', 'verdict')
    return Report(
        f'Controller {controller.name}',
        controller.description,
        (
            Section('How it flies', (Table('Flights', columns, tuple(rows)), histories)),
            Section('Force', (surfaces,)),
        ),
    )
