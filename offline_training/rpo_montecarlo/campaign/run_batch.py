# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""From drawn runs to results; a thread or worker flies a unit of 200 runs at a time."""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import NDArray

from rpo_core.files.scenario import Scenario
from rpo_core.judge import metrics
from rpo_core.judge.metrics import row_of, windows_of
from rpo_core.judge.verdicts import verdicts
from rpo_montecarlo.campaign.config import LEVEL, METRICS, THRUSTER_METRICS, Campaign
from rpo_montecarlo.campaign.sampling import PARAMETERS, STRATA, DrawnRuns, draw, parameters_of
from rpo_montecarlo.campaign.single import fly_run, scenario_of_draw
from rpo_montecarlo.engine import counters
from rpo_montecarlo.engine.counters import Trace, counting
from rpo_montecarlo.engine.judged import VALUES, arrival_s, judge, judged_by
from rpo_montecarlo.engine.lanes import PAIRED_LANES, RUNS, paired_lanes
from rpo_montecarlo.engine.parts.control import control_of
from rpo_montecarlo.engine.parts.disturbance import levels_n
from rpo_montecarlo.engine.parts.dynamics import uneven_steps
from rpo_montecarlo.engine.parts.thrusters import spent_of
from rpo_montecarlo.engine.simulator import Scratch
from rpo_montecarlo.engine.support import announce, kinds, why_not
from rpo_montecarlo.engine.tick import Batch, Runs
from rpo_montecarlo.engine.tick import fly as fly_lanes

Floats = NDArray[np.float64]

UNIT = 200
"""Runs of a unit; a whole number of them is one Latin hypercube."""

assert STRATA % UNIT == 0 and UNIT % RUNS == 0

FINAL = tuple(f'final_{name}' for name in ('x_m', 'y_m', 'z_m', 'vx_m_s', 'vy_m_s', 'vz_m_s'))
COLUMNS = (*PARAMETERS, *METRICS, *FINAL)
"""Columns of the results of every campaign: drawn parameters, metrics, final state."""

_FROM_ROW = [list(metrics.UNITS).index(name) for name in METRICS]

_scratch = Scratch(0)


def units(runs: int) -> int:
    """Return the number of units of a campaign."""
    return -(-runs // UNIT)


def columns_of(campaign: Campaign) -> tuple[str, ...]:
    """Return the columns of results: those of every campaign, then what else is known of its runs.

    Those are the metrics of its thrusters, what it judges by, and the draws of its world.
    """
    drawn = parameters_of(campaign.config)[len(PARAMETERS) :]
    return (*COLUMNS, *campaign.more, *drawn)


def fly_unit(campaign: Campaign, unit: int) -> Floats:
    """Return the results (columns, n) of the runs of a unit."""
    first = unit * UNIT
    return _fly(campaign, draw(campaign, first, min(UNIT, campaign.config.runs - first)))


def fly_runs(campaign: Campaign, first: int, count: int) -> dict[str, Floats]:
    """Return the results of some runs, column by column (count,)."""
    results = _fly(campaign, draw(campaign, first, count))
    return dict(zip(columns_of(campaign), results, strict=True))


def _fly(campaign: Campaign, drawn: DrawnRuns) -> Floats:
    rows = np.empty((len(drawn.numbers), counters.COLUMNS))
    final = np.empty((len(rows), 6))
    more: dict[str, Floats] = {name: np.empty(len(rows)) for name in campaign.more}
    reason = why_not(campaign.scenario, campaign.controller)
    reason = reason or uneven_steps(campaign.scenario, drawn.column('orbit_radius_m'))
    if reason:
        announce(reason)
        _fly_singly(campaign, drawn, rows, final, more)
    else:
        _fly_side_by_side(campaign, drawn, rows, final, more)
    known, own = np.split(drawn.parameters, [len(PARAMETERS)], axis=1)
    table = [known, rows[:, _FROM_ROW], final, *(more[n][:, None] for n in more), own]
    return np.ascontiguousarray(np.hstack(table).T)


def _fly_singly(
    campaign: Campaign, drawn: DrawnRuns, rows: Floats, final: Floats, more: dict[str, Floats]
) -> None:
    """Fly run after run through `rpo_core.chain.flight.fly`."""
    for i, number in enumerate(drawn.numbers.tolist()):
        flight = fly_run(campaign, number)
        rows[i] = row_of(flight)
        final[i] = flight.states[-1]
        values = {verdict.key: verdict.value for verdict in verdicts(flight)}
        values[LEVEL] = metrics.disturbance_level_n(flight)
        if campaign.metrics_of_thrusters:
            values |= zip(THRUSTER_METRICS, flight.thrust[2:], strict=True)
        for name, column in more.items():
            column[i] = values[name]
        rows[i, metrics.ARRIVAL_TIME] = values.get('arrival_time_s', rows[i, metrics.ARRIVAL_TIME])


def _fly_side_by_side(
    campaign: Campaign, drawn: DrawnRuns, rows: Floats, final: Floats, more: dict[str, Floats]
) -> None:
    scenario, windows = campaign.scenario, windows_within(campaign.scenario)
    control, masses_kg = control_of(campaign.controller), drawn.column('mass_kg')
    w, judged = _scratch.w, judged_by(scenario) if is_together(campaign) else None
    trace = None if judged is None else Trace(scenario.ticks, PAIRED_LANES)
    together = np.empty((len(rows), len(VALUES)))
    for first in range(0, len(rows), RUNS):
        some = slice(first, first + RUNS)
        runs = make_batch(campaign, drawn.some(some))
        own = [control.part(runs), counting(runs, windows, None)]
        own += [trace.part] if trace else []
        memories = fly_lanes(runs, own, windows.horizon, w)
        counters.finish_paired(
            scenario.dt_s, masses_kg[some], windows.tail, w, rows[some], final[some]
        )
        count = len(rows[some])
        if judged is not None and trace is not None:
            together[some] = judge(trace.states, paired_lanes(count), scenario, judged)
        for name, values in spent_of(memories.get('thrusters')).items():
            if name in more:
                more[name][some] = values[:count]
        if LEVEL in more:
            more[LEVEL][some] = levels_n(runs, memories, w)[:count]
    for place, name in enumerate(VALUES):
        if name in more:
            more[name][:] = together[:, place]
    _set_arrival(scenario, rows, together)


def windows_within(scenario: Scenario) -> metrics.Windows:
    """Return the windows of a flight; an axis has arrived within what the scenario requires."""
    windows, required = windows_of(scenario), scenario.requirements
    if required is None or required.arrival_error_per_axis_m is None:
        return windows
    return windows._replace(arrival_m=required.arrival_error_per_axis_m)


def is_together(campaign: Campaign) -> bool:
    """Return whether what the scenario requires of the axes together is in the results."""
    required = campaign.scenario.requirements
    by_norm = required is not None and required.arrival_error_norm_m is not None
    return by_norm or bool(set(campaign.config.more) & set(VALUES))


def _set_arrival(scenario: Scenario, rows: Floats, together: Floats) -> None:
    """Write the arrival that a scenario requires, infinite where a run never arrives."""
    required = scenario.requirements
    if required is None or required.arrival_time_s is None:
        return
    if required.arrival_error_norm_m is not None:
        rows[:, metrics.ARRIVAL_TIME] = together[:, VALUES.index('arrival_time_s')]
    else:
        outside = np.rint(rows[:, metrics.ARRIVAL_TIME] / scenario.dt_s)
        rows[:, metrics.ARRIVAL_TIME] = arrival_s(scenario, outside)


def make_batch(campaign: Campaign, drawn: DrawnRuns) -> Runs:
    """Return up to 40 runs; lanes without a run rest at the target."""
    config = campaign.config
    batch = Batch(
        campaign.scenario,
        drawn.starts,
        partial(scenario_of_draw, campaign, drawn),
        dict(zip(drawn.names, drawn.parameters.T, strict=True)),
        drawn.keys,
        {name: dispersion.spread for name, dispersion in config.dispersions.items()},
        config.faults.fates if config.faults else None,
    )
    starts = np.zeros((RUNS, 6))
    starts[: len(drawn.numbers)] = drawn.starts
    parts = [part for kind in kinds() if (part := kind.make(batch)) is not None]
    return Runs(starts[:, [0, 1, 3, 4]], starts[:, [2, 5]], tuple(parts))
