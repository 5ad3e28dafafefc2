# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""From drawn runs to results; a thread or worker flies a unit of 200 runs at a time."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rpo_core.chain.stage import section_of
from rpo_core.control.controller import AnyController, only_fuzzy
from rpo_core.files.scenario import Scenario
from rpo_core.judge import metrics
from rpo_core.judge.metrics import row_of, windows_of
from rpo_core.judge.verdicts import verdicts
from rpo_ctrl.baselines import Baseline
from rpo_montecarlo.campaign.config import LEVEL, METRICS, THRUSTER_METRICS, Campaign
from rpo_montecarlo.campaign.navigation import estimators_of
from rpo_montecarlo.campaign.sampling import PARAMETERS, STRATA, DrawnRuns, draw, parameters_of
from rpo_montecarlo.campaign.single import fly_run, scenario_of_draw
from rpo_montecarlo.campaign.worlds import firing_of, orbits_of, spent_of, uneven_steps
from rpo_montecarlo.engine import counters, parts, tick
from rpo_montecarlo.engine.judged import VALUES, arrival_s, judge, judged_by, levels, make_trace
from rpo_montecarlo.engine.parts import PAIRED_LANES, RUNS
from rpo_montecarlo.engine.plans import assured_of, guiding_of, seen_at_start
from rpo_montecarlo.engine.population import population_of
from rpo_montecarlo.engine.simulator import Scratch
from rpo_montecarlo.engine.support import IN_PAIRS, announce, why_not

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
    reason = why_not(campaign.scenario, campaign.controller, IN_PAIRS)
    reason = reason or uneven_steps(campaign.scenario, drawn)
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
    plant, control = parts.Plant(scenario.max_force_n, scenario.dt_s), _control(campaign.controller)
    w, judged = _scratch.w, judged_by(scenario) if is_together(campaign) else None
    trace: Any = None if judged is None else make_trace(scenario.ticks, PAIRED_LANES)
    together = np.empty((len(rows), len(VALUES)))
    for first in range(0, len(rows), RUNS):
        some = slice(first, first + RUNS)
        batch = make_batch(campaign, drawn, first)
        tick.fly(batch, control, plant, windows, w, None, trace)
        counters.finish_paired(plant, drawn.masses_kg[some], windows, w, rows[some], final[some])
        if judged is not None:
            lanes_of = parts.paired_lanes(len(rows[some]))
            together[some] = judge(trace[0], lanes_of, scenario, judged)
        spent = spent_of(batch.valves)
        for name in campaign.metrics_of_thrusters:
            more[name][some] = spent[name][: len(rows[some])]
        if LEVEL in more:
            levels(w, batch.waves._replace(times=scenario.times_s), more[LEVEL][some])
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


def _control(controller: AnyController) -> parts.Control:
    if isinstance(controller, Baseline):
        return parts.Control(None, controller.law)
    fuzzy = only_fuzzy(controller)
    return parts.Control(population_of(fuzzy).law(0, fuzzy.system.samples))


def make_batch(campaign: Campaign, drawn: DrawnRuns, first: int) -> parts.Runs:
    """Return up to 40 runs from index `first`; lanes without a run rest at the target."""
    n = min(RUNS, len(drawn.numbers) - first)
    chosen = slice(first, first + n)

    def padded(values: NDArray[Any]) -> NDArray[Any]:
        full = np.zeros((RUNS, *values.shape[1:]), values.dtype)
        full[:n] = values[chosen]
        return full

    starts = padded(drawn.starts)
    keys = np.ascontiguousarray(padded(drawn.keys).T)
    flown = []
    if campaign.scenario.sections:
        flown = [scenario_of_draw(campaign, drawn, i) for i in range(first, first + n)]
    seen = [seen_at_start(s) for s in flown] if {'guidance', 'assurance'} & names_of(flown) else []
    orbits = orbits_of(flown) if flown else None
    return parts.Runs(
        planar=starts[:, [0, 1, 3, 4]].copy(),
        vertical=starts[:, [2, 5]].copy(),
        navigation=parts.Navigation(padded(drawn.biases), _noise(campaign), keys),
        link=_link(campaign, keys),
        thrusters=_thrusters(campaign, drawn, first, n),
        waves=_waves(campaign, drawn.parameters[chosen, 19:22].T),
        steps=None if orbits else _steps(campaign.scenario, drawn, first, n),
        goal=_goal(campaign.scenario, drawn, first, n),
        valves=firing_of(flown) if flown else None,
        orbits=orbits,
        estimators=estimators_of(flown) if flown else None,
        guiding=guiding_of(flown, seen) if seen else None,
        assured=assured_of(flown, seen) if seen else None,
    )


def names_of(scenarios: list[Scenario]) -> set[str]:
    """Return the names of the sections that add stages."""
    return {section_of(settings).name for settings in scenarios[0].sections} if scenarios else set()


def _steps(scenario: Scenario, drawn: DrawnRuns, first: int, n: int) -> Floats:
    """Return the fields (40, 26) of the exact step of each run."""
    steps = [drawn.step(i, scenario) for i in range(first, first + n)]
    return np.vstack([np.array(steps).reshape(n, 26), np.zeros((RUNS - n, 26))])


def _goal(scenario: Scenario, drawn: DrawnRuns, first: int, n: int) -> parts.Goal | None:
    """Return the goal, and for each run the force that holds its mass there on its orbit."""
    if scenario.goal is None:
        return None
    forces = np.zeros((3, RUNS))
    for s in range(n):
        forces[:, s] = drawn.holding_force_n(first + s, scenario)
    return parts.Goal(np.repeat(scenario.goal_position_m, RUNS), forces.ravel())


def _noise(campaign: Campaign) -> Floats:
    names = ('navigation_position_noise_m', 'navigation_velocity_noise_m_s')
    return np.array([campaign.config.spread(name)[0] for name in names])


def _link(campaign: Campaign, keys: NDArray[np.int64]) -> parts.Link | None:
    if campaign.config.faults is None:
        return None
    fates = campaign.config.faults.fates
    depth = 2 * fates.late_by + 1
    return parts.Link(
        fates,
        keys,
        past=np.empty((depth, PAIRED_LANES)),
        lateness=np.empty((depth, RUNS), np.int64),
        latest=np.empty(RUNS, np.int64),
        held=np.empty(PAIRED_LANES),
    )


def _thrusters(campaign: Campaign, drawn: DrawnRuns, first: int, n: int) -> parts.Thrusters:
    delays, matrix = np.zeros(RUNS, np.int64), np.zeros((RUNS, 9))
    delays[:n] = drawn.delays[first : first + n]
    for s in range(n):
        matrix[s] = drawn.thrust(first + s).ravel()
    return parts.Thrusters(delays, matrix, np.empty((campaign.config.most_delay + 1, PAIRED_LANES)))


def _waves(campaign: Campaign, drawn: Floats) -> parts.Waves:
    """Return the disturbance of runs whose share, phase and frequency (3, n) were drawn."""
    scenario, (share, phase, frequency) = campaign.scenario, drawn
    n, harmonics = len(share), scenario.disturbance.harmonics
    constant, waves = np.zeros((3, RUNS)), np.zeros((len(harmonics), 3, RUNS))
    for axis, nominal in enumerate(scenario.disturbance.constant_n):
        constant[axis, :n] = nominal * (1.0 + share)
    for wave, h in zip(waves, harmonics, strict=True):
        wave[0, :n] = h.amplitude_n * (1.0 + share)
        wave[1, :n] = h.angular_rate_rad_s * (1.0 + frequency)
        wave[2, :n] = h.phase_rad + phase
    return parts.Waves(
        scenario.times_s[:-1],
        constant,
        waves,
        np.array(['xyz'.index(h.axis) for h in harmonics], np.int64),
        np.array([h.function == 'sin' for h in harmonics], np.bool_),
    )
