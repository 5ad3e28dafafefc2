# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The report of a run: what its log shows, beside what is required and the best possible."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from rpo.analysis import optimal
from rpo.reports import run_plots, stages
from rpo.reports.logged import LoggedFlight, logged_flight, until, verdict_of
from rpo.reports.page import Block, File, Fold, Picture, Report, Section, Table, Text, picture
from rpo.reports.replay import Replayed
from rpo.reports.run_plots import zone_passage
from rpo_core.chain.flight import Flight
from rpo_core.control.controller import AnyController, FuzzyController
from rpo_core.files.validation import InputError
from rpo_core.judge import metrics
from rpo_core.judge.contact import docked_at
from rpo_core.judge.verdicts import UNBOUNDED, ZONE_DEPTH, missed, number, unbounded, verdicts
from rpo_core.scenario.requirements import ARRIVAL_WINDOW_S, MAX_ARRIVAL_DISTANCE_M
from rpo_core.world.zones import zones_of
from rpo_log.bag import open_run
from rpo_log.errors import LogError
from rpo_log.format.run import INFO_FILE
from rpo_log.read.run_log import RunLog, controller_of, read_run
from rpo_log.show import report as log_report
from rpo_log.show import style

MOST_TICKS = 20_000
"""Longest flight whose optimum is computed: half a minute."""


class _Stages(NamedTuple):
    """What the stages of a run did, computed again; empty or None where it has none."""

    guidance: list[stages.Phase]
    assurance: stages.Decided | None
    estimator: stages.Filtered | None

    @classmethod
    def of(cls, log: RunLog, flight: Flight) -> _Stages:
        """Run the stages of a run again."""
        decided, filtered = stages.decided(log, flight), stages.filtered(log, flight)
        return cls(stages.phases_of(log, flight), decided, filtered)

    def lacking(self, flight: Flight) -> list[Text]:
        """Say which stages of the scenario could not be run again."""
        names = [n for n, shown in self._asdict().items() if not shown and flight.scenario.named(n)]
        why = 'the log lacks what they read at some ticks, or they were switched off'
        return [Text(f'No figures of {", ".join(names)}: {why}.')] if names else []


def report_of(path: Path, scenario: str = '') -> tuple[Report, LoggedFlight]:
    """Return the report of a run folder, .mcap file or bag, and what it is about; LogError.

    scenario : of a bag that does not carry it, name or file
    """
    log = read_run(open_run(path, scenario))
    shown = logged_flight(log)
    flight, (optimum, why_not) = shown.flight, _optimum(shown)
    controller, why = _controller(log)
    phases, acted, estimated = ran = _Stages.of(log, flight)
    with style.applied():
        sections = [
            Section('Limits and path', tuple(_limits_and_path(shown, optimum))),
            Section('Time histories', (_histories(flight, phases), *ran.lacking(flight))),
            *stages.guidance_sections(flight, phases),
            *stages.assurance_sections(flight, acted, phases),
            Section('Energy', tuple(_energy(flight, optimum, why_not))),
            Section('Force and slew', (_force_and_slew(flight),)),
            *stages.attitude_sections(flight),
            *_thrusters(flight),
            *_disturbance(flight),
            *stages.navigation_sections(flight, estimated),
            Section('Phase planes', tuple(_phase_planes(flight, controller, why))),
            Section('Details', tuple(_details(shown, log))),
        ]
    replayed = _replayed(path.name, shown, controller, ran)
    summary = _summary(shown, log)
    title, judged = log_report.title_of(log), bool(replayed.missed)
    made = Report(title, summary, tuple(sections), judged, replayed.verdict, (replayed,))
    return made, shown


def compared(paths: Sequence[Path], scenario: str = '') -> tuple[Report, list[LoggedFlight]]:
    """Return the report of several runs beside each other, and what it is about."""
    logs = [read_run(open_run(path, scenario)) for path in paths]
    every = [logged_flight(log) for log in logs]
    names = [path.name for path in paths]
    names = names if len(set(names)) == len(names) else [str(path) for path in paths]
    flights = tuple(
        _replayed(name, shown, _controller(log)[0], _Stages.of(log, shown.flight))
        for name, shown, log in zip(names, every, logs, strict=True)
    )
    others = {one.name: one.flight for one in flights[1:]}
    rows: dict[str, list[str]] = {}
    for place, shown in enumerate(every):
        for lines in log_report.rows(shown.flight).values():
            for statement, value, _, word in lines:
                row = rows.setdefault(statement, [''] * len(every))
                row[place] = f'{value} {word}'.strip() if shown.whole else value
    table = Table(
        'The flights beside each other', ('metric', *names), tuple((n, *r) for n, r in rows.items())
    )
    first = flights[0]
    with style.applied():
        zones, count = zones_of(first.flight.scenario), len(flights)
        paths = run_plots.approach(first.flight, others, zones, first.name)
        energies = run_plots.energy(first.flight, others, first.name)
        where = _where(first.flight)
        approaches = picture('approach, of several', paths, where=where, flights=count)
        energy = picture('energy, of several', energies, flights=count)
    title = ', '.join(names)
    verdict = ' '.join(f'{one.name}: {one.verdict}' for one in flights)
    bad = any(one.missed for one in flights)
    sections = (Section('Paths', (approaches,)), Section('Figures', (table, energy)))
    return Report(title, f'{len(names)} flights.', sections, bad, verdict, flights), every


def _controller(log: RunLog) -> tuple[AnyController | None, str]:
    """Return the controller of a run; None and why, if the log does not have it."""
    try:
        return controller_of(log), ''
    except LogError as error:
        return None, str(error)


def _replayed(
    name: str, shown: LoggedFlight, controller: AnyController | None, ran: _Stages
) -> Replayed:
    phases, acted, estimated = ran
    return Replayed(
        name,
        shown.flight,
        verdict_of(shown.flight, shown.gaps),
        _missed(shown),
        controller,
        [(phase.name, phase.reason, phase.begin) for phase in phases],
        stages.interventions(acted.constraints) if acted else (),
        acted.margins if acted else None,
        estimated.estimates if estimated else None,
    )


def _missed(shown: LoggedFlight) -> bool | None:
    """Return whether a flight misses a requirement; None: none is missed, but not all is judged."""
    flight = shown.flight
    if not shown.whole or not verdicts(flight):
        return None
    return missed(flight) or (None if unbounded(flight.scenario) else False)


def _optimum(shown: LoggedFlight) -> tuple[dict[str, Flight], str]:
    """Return name -> optimum that ends 30 s after the arrival of a flight, or with it if it never.

    Where there is none, the text says why.
    """
    scenario = shown.planned
    if scenario.ticks > MOST_TICKS:
        return {}, f'The optimum is computed for at most {MOST_TICKS} ticks.'
    if log_report.turns(scenario):
        return {}, 'The optimum is computed where neither chaser nor target turns.'
    arrived = metrics.arrival_time_s(shown.flight) if shown.whole else None
    ticks = scenario.ticks
    if arrived is not None:
        ticks = min(ticks, round((arrived + ARRIVAL_WINDOW_S) / scenario.dt_s))
    name = f'optimum in {scenario.time_s(ticks):g} s'
    try:
        ideal = replace(scenario, duration_s=scenario.time_s(ticks), sections=())
        return {name: optimal.constrained(ideal)}, ''
    except InputError as error:
        return {}, f'No optimum is shown: {error}.'


def _summary(shown: LoggedFlight, log: RunLog) -> str:
    flight = shown.flight
    figures, arrived = metrics.of_flight(flight), metrics.arrival_time_s(flight)
    when = f'every axis stays within {MAX_ARRIVAL_DISTANCE_M:g} m after {arrived or 0.0:.1f} s'
    docked = docked_at(flight)
    if docked is not None:
        when = f'contact at {flight.scenario.time_s(docked):.1f} s'
    elif arrived is None:
        when = f'it does not stay within {MAX_ARRIVAL_DISTANCE_M:g} m of its goal'
    if not shown.whole:
        when = f'the log does not show all of its {shown.planned.duration_s:g} s'
    start = ', '.join(f'{r:g}' for r in flight.scenario.initial_position_m)
    return (
        f'{flight.scenario.duration_s:g} s from [{start}] m; {when}; '
        f'J = {figures.energy_n2s:.4g} N²s. Log: {"; ".join((log.path.name, *log.lacks))}.'
    )


def _limits_and_path(shown: LoggedFlight, optimum: dict[str, Flight]) -> list[Block]:
    flight = shown.flight
    zones = zones_of(flight.scenario)
    shows = f'{flight.scenario.duration_s:g} of {shown.planned.duration_s:g} s'
    cut = f'The log shows {shows}: {"; ".join(shown.gaps)}.'
    rows: list[tuple[str, ...]] = []
    for v in verdicts(flight):
        margin = '–'
        if v.limit > 0.0 and np.isfinite(v.value):
            margin = f'{100.0 * (1.0 - v.value / v.limit):.0f} %'
        judged = shown.whole or (v.key == ZONE_DEPTH and not v.holds)
        value, limit = (number(x, v.unit) for x in (v.value, v.limit))
        rows.append((v.statement, value, f'≤ {limit}', *((margin, v.word) if judged else ('', ''))))
    if rows:
        rows += [(name, '–', 'none', '–', UNBOUNDED) for name in unbounded(flight.scenario)]
    least_m = np.linalg.norm(flight.positions_m, axis=1).min()
    near = bool(zones) and least_m < run_plots.reach_m(zones)
    columns = ('requirement', 'value', 'limit', 'margin', 'verdict')
    return [
        *([] if shown.whole else [Text(cut)]),
        *([Table('Limits and margins', columns, tuple(rows))] if rows else []),
        picture(
            'approach',
            run_plots.approach(flight, optimum, zones),
            where=_where(flight),
            mark_s=run_plots.MARK_S,
        ),
        *([picture('zones', run_plots.near(flight, zones))] if near else []),
    ]


def _where(flight: Flight) -> str:
    """Return in which axes a path is drawn."""
    if flight.scenario.target is not None:
        return 'as the target sees it, in two planes of its axes'
    return 'in LVLH: in the orbital plane, and from above'


def _details(shown: LoggedFlight, log: RunLog) -> list[Block]:
    flight = shown.flight
    others = tuple(row[:2] for row in log_report.rows(flight)[log_report.METRICS])
    passages = [
        (f'`{zone.name}`: {what}', value)
        for zone in zones_of(shown.planned)
        for what, value in zone_passage(flight, zone)
    ]
    tables = [Table('Other metrics', ('metric', 'value'), others)]
    if passages:
        tables.append(Table('Passage of the zones', ('what', 'value'), tuple(passages)))
    return [
        *(Fold(table.caption, (table,)) for table in tables),
        Text('The files of the log; rpo verify computes the flight again from them.'),
        *_files(log),
    ]


def _histories(flight: Flight, phases: list[stages.Phase]) -> Picture:
    figure = log_report.time_histories(flight)
    stages.mark(figure, phases, flight)
    begin_s = log_report.close_up_s(flight.scenario)
    last = metrics.window(flight, flight.scenario.duration_s - begin_s)
    where = '' if log_report.turns(flight.scenario) else ' in LVLH'
    lines = ' Vertical lines: a phase of the plan begins.' if phases else ''
    return picture(Path(log_report.PICTURE).stem, figure, where=where, phases=lines, last=last)


def _energy(flight: Flight, optimum: dict[str, Flight], why_not: str) -> list[Block]:
    spent_n2s = metrics.of_flight(flight).energy_n2s
    figure = run_plots.energy(flight, optimum)
    if not optimum:
        return [picture('energy', figure, spent_n2s=spent_n2s), Text(why_not)]
    ((name, ideal),) = optimum.items()
    least_n2s, until_s = metrics.of_flight(ideal).energy_n2s, ideal.scenario.duration_s
    rows = []
    flown = until(flight, ideal.scenario.ticks)
    for label, one in ((f'this flight, {until_s:g} s', flown), (name, ideal)):
        f = metrics.of_flight(one)
        peak = float(np.abs(one.saturated_forces_n).max())
        ratio = f'{f.energy_n2s / least_n2s:.3g} ×' if least_n2s > 0.0 else '–'
        numbers = f'{f.energy_n2s:.4g}', ratio, f'{peak:.3g}', f'{f.slew_per_axis_n_s:.3g}'
        rows.append((label, *numbers))
    columns = ('flight', 'J [N²s]', 'of the optimum', 'force per axis [N]', 'slew per axis [N/s]')
    shown = picture('energy, beside the optimum', figure, spent_n2s=spent_n2s)
    return [shown, Table('Beside the best possible', columns, tuple(rows))]


def _force_and_slew(flight: Flight) -> Picture:
    peak = float(np.abs(flight.saturated_forces_n).max())
    slew = metrics.of_flight(flight).slew_per_axis_n_s
    limit = flight.scenario.max_force_n
    figure = run_plots.limits(flight)
    return picture('limits', figure, peak_n=peak, limit_n=limit, slew_n_s=slew)


def _thrusters(flight: Flight) -> list[Section]:
    """Return what the thrusters made of the commands, where they fire in pulses or spend mass."""
    settings = flight.scenario.thrusters
    if settings is None or not (settings.fires or settings.propellant):
        return []
    shown = picture(
        'pulses',
        run_plots.pulses(flight),
        torque=', the torque that they give about the axes of the chaser' * bool(settings.table),
        propellant=', the propellant spent' * bool(settings.propellant),
        spent=flight.thrust,
    )
    return [Section('Thrusters', (shown,))]


def _disturbance(flight: Flight) -> list[Section]:
    if not flight.disturbances_n.any():
        return []
    level_n = metrics.disturbance_level_n(flight)
    shown = picture('disturbance', run_plots.disturbance(flight), level_n=level_n)
    return [Section('Disturbance', (shown,))]


def _phase_planes(flight: Flight, controller: AnyController | None, why: str) -> list[Block]:
    fuzzy = controller if isinstance(controller, FuzzyController) else None
    missing = ''
    if controller is None:
        missing = f'No control surface: {why}.'
    elif fuzzy is None:
        missing = f'No control surface: {controller.name} is not a fuzzy controller.'
    errors, follows = stages.errors_of(flight), stages.follows(flight)
    if follows and np.abs(errors).max() < stages.EXACT:
        return [Text('The chaser is on its reference: its phase planes would be points.')]
    planes = picture(
        'phase_planes',
        run_plots.phase_planes(flight, errors, fuzzy),
        origin='the reference' if follows else 'the goal',
        surface=", on the controller's force at that position and velocity" if fuzzy else '',
        where=' on the control surface' if fuzzy else '',
    )
    return [planes, *([Text(missing)] if missing else [])]


def _files(log: RunLog) -> list[Block]:
    texts = {name: data.decode('utf-8', 'replace') for name, data in log.attachments.items()}
    info = (log.path if log.path.is_dir() else log.path.parent) / INFO_FILE
    if info.is_file():
        texts[INFO_FILE] = info.read_text('utf-8', 'replace')
    return [File(name, text) for name, text in texts.items()]
