# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The report of a run: what its log shows, beside what is required and the best possible."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from rpo_core.chain.flight import Flight
from rpo_core.control.controller import AnyController, FuzzyController
from rpo_core.control.controller_file import received
from rpo_core.files.scenario import Scenario
from rpo_core.files.validation import InputError
from rpo_core.judge import metrics
from rpo_core.judge.verdicts import ZONE_DEPTH, missed, verdicts
from rpo_core.judge.zones import zones_of
from rpo_core.wire.interfaces import RELATIVE_STATE
from rpo_ctrl.explain import decisions
from rpo_judge.evaluation import optimal
from rpo_log.bag import open_run
from rpo_log.show import report as log_report
from rpo_log.show import style
from rpo_mcap.errors import LogError
from rpo_mcap.format.run import INFO_FILE
from rpo_mcap.read.run_log import RunLog, controller_of, read_run
from rpo_report import assured, guided, navigation, run_plots
from rpo_report.logged import LoggedFlight, logged_flight
from rpo_report.page import Block, File, Picture, Report, Section, Table, Text
from rpo_report.run_plots import (
    CORRIDOR_HALF_ANGLE_DEG,
    KEEP_OUT_RADIUS_M,
    Aids,
    passage,
    zone_passage,
)

MOST_TICKS = 20_000
"""Longest flight whose optimum is computed: half a minute."""

_AIDS = (
    f'The cone of {CORRIDOR_HALF_ANGLE_DEG:g}° about the axis of approach and the sphere of '
    f'{KEEP_OUT_RADIUS_M:g} m around the target are aids to the eye, not conditions of the flight.'
)


_ZONES = 'Keep-out sphere, corridor and the points of the plan are those of the scenario.'


@dataclass(frozen=True)
class _Optima:
    """Flights of least energy from the same start, by name; why others are missing."""

    flights: dict[str, Flight]
    missing: tuple[str, ...]


def report_of(path: Path, scenario: str = '') -> tuple[Report, LoggedFlight]:
    """Return the report of a run folder, .mcap file or bag, and what it is about; LogError.

    scenario : of a bag that does not carry it, name or file
    """
    log = read_run(open_run(path, scenario))
    shown = logged_flight(log)
    flight, optima = shown.flight, _optima(shown)
    controller: AnyController | None
    try:
        controller, why = controller_of(log), ''
    except LogError as error:
        controller, why = None, str(error)
    phases, acted = guided.phases_of(log, flight), assured.decided(log, flight)
    with style.applied():
        sections = [
            Section('Figures', tuple(_tables(shown))),
            Section('Time histories', (_histories(flight, phases),)),
            Section('Approach', tuple(_approach(flight, optima))),
            *guided.sections(flight, phases),
            *assured.sections(flight, acted, phases),
            Section('Energy', tuple(_energy(flight, optima))),
            Section('Force and slew', (_limits(flight),)),
            *_thrusters(flight),
            *_disturbance(flight),
            *navigation.sections(log, flight),
            *_control(flight, controller, why),
            Section('Files', tuple(_files(log))),
        ]
    title = log_report.title_of(log)
    judged = shown.whole and missed(flight)
    return Report(title, _summary(shown, log), tuple(sections), judged), shown


def _optima(shown: LoggedFlight) -> _Optima:
    scenario = shown.planned
    arrived = metrics.arrival_time_s(shown.flight) if shown.whole else None
    if scenario.ticks > MOST_TICKS:
        return _Optima({}, (f'Optima are computed for at most {MOST_TICKS} ticks.',))
    durations = [scenario.duration_s]
    if arrived is not None:
        early = arrived + metrics.ARRIVAL_WINDOW_S
        if early < scenario.duration_s - scenario.dt_s:
            durations.append(round(early / scenario.dt_s) * scenario.dt_s)
    flights, missing = {}, []
    for duration in durations:
        name = f'optimum in {duration:g} s'
        try:
            ideal = replace(scenario, duration_s=round(duration, 9), sections=())
            flights[name] = optimal.constrained(ideal)
        except InputError as error:
            missing.append(f'No {name}: {error}.')
    return _Optima(flights, tuple(missing))


def _summary(shown: LoggedFlight, log: RunLog) -> str:
    flight = shown.flight
    figures, arrived = metrics.of_flight(flight), metrics.arrival_time_s(flight)
    when = f'every axis within {metrics.MAX_ARRIVAL_DISTANCE_M:g} m ' + (
        'never for good' if arrived is None else f'after {arrived:.1f} s'
    )
    if not shown.whole:
        when = f'the log does not reach the end at {shown.planned.duration_s:g} s'
    start = ', '.join(f'{r:g}' for r in flight.scenario.initial_position_m)
    return (
        f'{flight.scenario.duration_s:g} s from [{start}] m; {when}; '
        f'J = {figures.energy_n2s:.4g} N²s. Log: {"; ".join((log.path.name, *log.lacks))}.'
    )


def _tables(shown: LoggedFlight) -> list[Block]:
    flight, scenario = shown.flight, shown.planned
    found: list[tuple[str, ...]] = []
    entered = {v.statement for v in verdicts(flight) if v.key == ZONE_DEPTH and not v.holds}
    for section, rows in log_report.rows(flight).items():
        # Of a part of a flight, one verdict is sure: a zone that was entered.
        found += [
            (section,),
            *(row if shown.whole or row[0] in entered else (*row[:3], '') for row in rows),
        ]
    facts = [
        ('orbit radius', f'{scenario.orbit_radius_m / 1e3:.8g} km'),
        ('mean motion', f'{scenario.mean_motion_rad_s:.6e} rad/s'),
        ('chaser mass', f'{scenario.mass_kg:g} kg'),
        ('largest force of an axis', f'{scenario.max_force_n:g} N'),
        ('initial position', f'{_vector(scenario.initial_position_m)} m'),
        ('initial velocity', f'{_vector(scenario.initial_velocity_m_s)} m/s'),
        ('duration', f'{scenario.duration_s:g} s, {scenario.ticks} ticks of {scenario.dt_s:g} s'),
        ("disturbance's level", f'{metrics.disturbance_level_n(flight):.4g} N'),
        ('thrusters', 'as in the scenario' if scenario.thrusters else 'perfect'),
        ('navigation', 'as in the scenario' if _navigated(scenario) else 'perfect'),
    ]
    cut = f'The log shows {flight.scenario.duration_s:g} s only: {"; ".join(shown.gaps)}.'
    return [
        *([] if shown.whole else [Text(cut)]),
        Table('The flight and its limits', log_report.COLUMNS, tuple(found)),
        Table('Scenario', ('quantity', 'value'), tuple(facts)),
    ]


def _navigated(scenario: Scenario) -> bool:
    return any(scenario.named(name) is not None for name in ('navigation', 'estimator'))


def _vector(values: tuple[float, ...]) -> str:
    return '[' + ', '.join(f'{value:g}' for value in values) + ']'


def _histories(flight: Flight, phases: list[guided.Phase]) -> Picture:
    figure = log_report.time_histories(flight)
    guided.mark(figure, phases, flight)
    begin_s = log_report.close_up_s(flight.scenario)
    last = metrics.window(flight, flight.scenario.duration_s - begin_s)
    return Picture(
        Path(log_report.PICTURE).stem,
        figure,
        'Relative position, velocity and control force in LVLH; right, the end close up.'
        + (' Vertical lines: a phase of the plan begins.' if phases else ''),
        f'Time histories of the three axes. At the end every position is within '
        f'{last.position_m:.3g} m and every velocity within {last.velocity_m_s:.3g} m/s.',
    )


def _approach(flight: Flight, optima: _Optima) -> list[Block]:
    zones = zones_of(flight.scenario)
    if zones:
        drawn = run_plots.Drawn(zones)
        each = [(zone.name, row) for zone in zones for row in zone_passage(flight, zone)]
        said = [f'{name}: {what}' if len(zones) > 1 else what for name, (what, _) in each]
        found = [(what, value) for what, (_, (_, value)) in zip(said, each, strict=True)]
        caption = 'Passage of the zones'
    else:
        aids = Aids.of(flight)
        drawn, found = run_plots.Drawn([aids.zones], ' (aid)'), passage(flight, aids)
        caption = 'Passage of the drawn aids'
    return [
        Picture(
            'approach',
            run_plots.approach(flight, optima.flights, drawn),
            f'The approach in LVLH: in space, in the orbital plane, and from above. Dots every '
            f'{run_plots.MARK_S:g} s. {_ZONES if zones else _AIDS}',
            'The path of the chaser to the target: ' + '; '.join(': '.join(f) for f in found) + '.',
        ),
        *([_near(flight, drawn)] if zones and _comes_near(flight, drawn) else []),
        Table(caption, ('what', 'value'), tuple(found)),
        Picture(
            'closing',
            run_plots.closing(flight),
            'Closing speed, the range rate with the opposite sign, over the range; the chaser '
            'comes in from the left.',
            f'Closing speed over range: at most '
            f'{metrics.closing_speeds_m_s(flight).max():.3g} m/s.',
        ),
    ]


def _comes_near(flight: Flight, drawn: run_plots.Drawn) -> bool:
    return bool(np.linalg.norm(flight.positions_m, axis=1).min() < run_plots.reach_m(drawn))


def _near(flight: Flight, drawn: run_plots.Drawn) -> Picture:
    return Picture(
        'zones',
        run_plots.near(flight, drawn),
        'The zones from near, in the orbital plane and from above.',
        'The path of the chaser through the zones about the target.',
    )


def _energy(flight: Flight, optima: _Optima) -> list[Block]:
    spent_n2s = metrics.of_flight(flight).energy_n2s
    rows = [_energy_row('this flight', flight, spent_n2s)]
    rows += [_energy_row(n, f, spent_n2s) for n, f in optima.flights.items()]
    columns = (
        'flight',
        'J [N²s]',
        'flight / this',
        'force per axis [N]',
        'slew per axis [N/s]',
        'mean speed (norm), last 30 s [m/s]',
        'mean distance (norm), last 30 s [m]',
    )
    return [
        Picture(
            'energy',
            run_plots.energy(flight, optima.flights),
            'Energy spent so far, J = ∫ f·f dt. An optimum is the least J from the same start '
            'under the limit of force and all conditions of training; it knows the disturbance, '
            'and its thrusters and navigation are perfect. One optimum takes the whole time; the '
            'other ends 30 s after the arrival of this flight.',
            f'Energy over time; the flight ends at {spent_n2s:.4g} N²s.',
        ),
        Table('Beside the best possible', columns, tuple(rows)),
        *map(Text, optima.missing),
    ]


def _energy_row(name: str, flight: Flight, flown_n2s: float) -> tuple[str, ...]:
    f = metrics.of_flight(flight)
    peak = float(np.abs(flight.saturated_forces_n).max())
    numbers = (peak, f.slew_per_axis_n_s, f.mean_speed_norm_m_s, f.mean_error_norm_m)
    ratio = f'{flown_n2s / f.energy_n2s:.3g}' if f.energy_n2s > 0.0 else '–'
    return (name, f'{f.energy_n2s:.4g}', ratio, *(f'{x:.3g}' for x in numbers))


def _limits(flight: Flight) -> Picture:
    peak = float(np.abs(flight.saturated_forces_n).max())
    slew = metrics.of_flight(flight).slew_per_axis_n_s
    return Picture(
        'limits',
        run_plots.limits(flight),
        'Force against the limit of the thrusters, and its rate against the requirement, if there '
        'is one. The step from rest to the first command that acts is no slew.',
        f'Force and slew over time, per axis: at most {peak:.3g} N of '
        f'{flight.scenario.max_force_n:g} N, and {slew:.3g} N/s.',
    )


def _thrusters(flight: Flight) -> list[Section]:
    """Return what the thrusters made of the commands, where they fire in pulses or spend mass."""
    settings = flight.scenario.thrusters
    if settings is None or not (settings.pulses or settings.propellant):
        return []
    spent = flight.thrust
    picture = Picture(
        'pulses',
        run_plots.pulses(flight),
        'Mean force that the thrusters exert in each tick, the impulse that they owe the command, '
        'and the propellant spent.',
        f'The thrusters spend {spent.delta_v_m_s:.3g} m/s and {spent.propellant_kg:.3g} kg, in '
        f'{spent.openings} openings of valves.',
    )
    return [Section('Thrusters', (picture,))]


def _disturbance(flight: Flight) -> list[Section]:
    if not flight.disturbances_n.any():
        return []
    picture = Picture(
        'disturbance',
        run_plots.disturbance(flight),
        'The disturbance, and the sum of control and disturbance; the latter is cut where control '
        'brakes.',
        f'Disturbance of at most {metrics.disturbance_level_n(flight):.3g} N over time.',
    )
    return [Section('Disturbance', (picture,))]


def _control(flight: Flight, controller: AnyController | None, why: str) -> list[Section]:
    fuzzy = controller if isinstance(controller, FuzzyController) else None
    missing = ''
    if controller is None:
        missing = f'No control surface and no decisions: {why}.'
    elif fuzzy is None:
        missing = f'No control surface and no rules: {controller.name} is not a fuzzy controller.'
    picture = Picture(
        'phase_planes',
        run_plots.phase_planes(flight, guided.errors_of(flight), fuzzy),
        'Velocity over position of each axis, relative to '
        + ('the reference' if guided.follows(flight) else 'the goal')
        + (", on the controller's force at that position and velocity" if fuzzy else '')
        + '. The chaser comes from the large dot; it is where it should be, at rest, at 0 and 0.',
        'Phase planes of the three axes' + (' on the control surface.' if fuzzy else '.'),
    )
    planes = Section('Phase planes', (picture, *([Text(missing)] if missing else [])))
    if fuzzy is None:
        return [planes]
    return [planes, Section('Decisions', (_decisions(flight, fuzzy),))]


def _decisions(flight: Flight, controller: FuzzyController) -> Table:
    rows: list[tuple[str, ...]] = []
    for tick in _instants(flight):
        rows.append((f'{flight.scenario.time_s(tick):g} s',))
        for d in decisions(controller, _seen(flight, tick)):
            numbers = (f'{x:.3g}' for x in (d.position_m, d.velocity_m_s, d.force_n))
            rows.append((d.axis, *numbers, d.reasons.sentence))
    columns = ('axis', 'position [m]', 'velocity [m/s]', 'force [N]', 'rules and their shares')
    return Table('Why the controller fired, from the state it received', columns, tuple(rows))


def _seen(flight: Flight, tick: int) -> Sequence[float]:
    """Return the state (6,) that the controller received, relative to reference or goal."""
    signals = {name: values[tick].tolist() for name, values in flight.signals.items()}
    return received(flight.scenario, {**signals, RELATIVE_STATE: flight.states[tick].tolist()})[0]


def _instants(flight: Flight) -> list[int]:
    """Return ticks from the start to the arrival, equally spaced, and the last."""
    arrived = metrics.arrival_time_s(flight)
    until = flight.scenario.duration_s if arrived is None else arrived
    ticks = np.linspace(0.0, until / flight.scenario.dt_s, 5).round().astype(int)
    return sorted({*ticks.tolist(), flight.scenario.ticks})


def _files(log: RunLog) -> list[Block]:
    found = {name: data.decode('utf-8', 'replace') for name, data in log.attachments.items()}
    info = (log.path if log.path.is_dir() else log.path.parent) / INFO_FILE
    if info.is_file():
        found[INFO_FILE] = info.read_text('utf-8', 'replace')
    return [
        Text('The files of the log; rpo verify computes the flight again from them.'),
        *(File(name, text) for name, text in found.items()),
    ]
