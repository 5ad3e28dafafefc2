# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The replay: flights in three dimensions, to be turned, played and scrubbed, in one HTML page.

`replay.html` has the page, `replay.js` draws; three.js comes from its package and is inlined when
the page is written. The page loads nothing, which its content security policy enforces.
"""

from __future__ import annotations

import base64
import json
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from importlib import resources
from typing import Any, NamedTuple

import numpy as np

from rpo_attitude.target import motion_of
from rpo_core.chain.flight import Flight
from rpo_core.control.controller import AnyController
from rpo_core.control.controller_file import received
from rpo_core.files.scenario import Scenario
from rpo_core.files.validation import InputError
from rpo_core.judge import metrics
from rpo_core.judge.verdicts import verdicts
from rpo_core.judge.zones import Zone, zones_of
from rpo_core.wire.interfaces import REFERENCE_STATE, RELATIVE_STATE
from rpo_ctrl import explain
from rpo_kernels.arrays import Floats
from rpo_log.show import style
from rpo_report.turned import Turned, panels_of, turned_of

LIBRARY = 'jupyter_threejs_sage', 'static/r130/three.min.js'

MOST_SAMPLES = 12_000
"""States of all flights of a page; longer flights are sampled, and drawn by cubics between."""

_REASONS = 4_000
"""Moments of all flights of a page that have the rules of their force."""
_MOST_CAUSES = 3


class Limit(NamedTuple):
    """What is judged at each moment of a flight.

    values : (n,) at the states; limit : the most, or the least where it is `floor`
    from_s : when it begins to count
    """

    name: str
    unit: str
    limit: float
    values: Floats
    from_s: float = 0.0
    floor: bool = False


@dataclass(frozen=True)
class Replayed:
    """One flight of a replay.

    verdict : in words; missed : whether it misses what it is judged by; None: it is not judged
    controller : whose rules are shown, if it is known
    phases : of its plan, each with name, reason and first tick
    acts : of assurance, each with the constraint, the first tick, and the one after the last
    margins : (n, 2) of assurance [m], [m/s]
    estimate : (n, 9) of navigation: position [m], and the lower triangle of the Cholesky factor of
        its covariance, row by row
    """

    name: str
    flight: Flight
    verdict: str
    missed: bool | None
    controller: AnyController | None = None
    phases: Sequence[tuple[str, str, int]] = ()
    acts: Sequence[tuple[str, int, int]] = ()
    margins: Floats | None = None
    estimate: Floats | None = None


def limits_of(
    flight: Flight, margins: Floats | None = None, turns: Turned | None = None
) -> list[Limit]:
    """Return what is judged at each moment: requirements, the thrusters' limit, zones, margins.

    A requirement on a mean is shown at each moment where no other is about the same quantity.
    """
    scenario, required = flight.scenario, flight.scenario.requirements
    error, speed = flight.errors[:, :3], flight.velocities_m_s
    force = np.vstack([flight.saturated_forces_n, np.zeros(3)])
    slew = np.diff(force[:-1], axis=0, prepend=0.0, append=0.0) / scenario.dt_s
    slew[: metrics.first_slew_tick(scenario)] = slew[-1] = 0.0
    series = {  # what a requirement's name has in it -> what it judges
        'error_per_axis': ('position error per axis', _per_axis(error)),
        'error_norm': ('position error', np.linalg.norm(error, axis=1)),
        'speed_per_axis': ('speed per axis', _per_axis(speed)),
        'speed_norm': ('speed', np.linalg.norm(speed, axis=1)),
        'hold_force': ('force per axis', _per_axis(force)),
        'slew': ('slew per axis', _per_axis(slew)),
        'closing_speed': ('closing speed at contact', metrics.closing_speeds_m_s(flight)),
    }
    end_s = scenario.duration_s
    begins = {
        'final': end_s,
        'contact': end_s,
        'hold': 0.0 if required is None else required.hold_from_s,
    }
    begins['mean'] = end_s - (0.0 if required is None else required.mean_window_s)
    found: dict[str, Limit] = {}
    for verdict in sorted(verdicts(flight), key=lambda verdict: verdict.key.startswith('mean')):
        part = next((part for part in series if part in verdict.key), None)
        if part is not None:
            name, values = series[part]
            begin_s = begins.get(verdict.key.split('_')[0], 0.0) or 0.0
            limit = Limit(name, verdict.unit, verdict.limit, values, begin_s)
            found.setdefault(name.split()[0], limit)
    thrusters = Limit('force per axis', 'N', scenario.max_force_n, _per_axis(force))
    found.setdefault('force', thrusters)
    rooms = [_room(zone, flight.positions_m) for zone in zones_of(scenario) if zone.keep_out_m]
    if rooms:
        found['room'] = Limit(
            'clear of the keep-out zone', 'm', 0.0, np.min(rooms, axis=0), floor=True
        )
    for panel in panels_of(turns, scenario) if turns is not None else ():
        if panel.limit is not None:
            found[panel.name] = Limit(panel.name, panel.unit, panel.limit, panel.sizes)
    if margins is not None:
        for name, unit, values in zip(('position', 'speed'), ('m', 'm/s'), margins.T, strict=True):
            found[f'margin of {name}'] = Limit(
                f'assurance: margin of {name}', unit, 0.0, values, floor=True
            )
    return list(found.values())


def _per_axis(vectors: Floats) -> Floats:
    return np.asarray(np.abs(vectors).max(axis=1))


def _room(zone: Zone, positions_m: Floats) -> Floats:
    """Return how far positions (n, 3) are outside a keep-out zone; < 0: how deep inside."""
    depths = zone.depths_m(positions_m)
    away = np.linalg.norm(positions_m, axis=1) - zone.keep_out_m
    return np.where(depths > 0.0, -depths, np.maximum(away, 0.0))


def filled(template: str, **parts: str) -> str:
    """Return a template of this package with its parts in place of their names."""
    page = resources.files('rpo_report').joinpath(template).read_text('utf-8')
    return re.sub(r'\{\{(\w+)\}\}', lambda name: parts[name[1]], page)


def page_of(title: str, flights: Sequence[Replayed], note: str = '') -> str:
    """Return the page; note : what its flights have in common, in a sentence."""
    package, path = LIBRARY
    try:
        library = resources.files(package).joinpath(path).read_text('utf-8')
    except ModuleNotFoundError:
        raise InputError('a replay needs three.js: make setup LAYERS=report') from None
    document = {
        'note': note,
        'scene': _scene(flights[0].flight),
        'flights': [_document(one, len(flights)) for one in flights],
    }
    return filled(
        'replay.html',
        title=escape(title),
        colours=style.variables(),
        library=library,
        data=json.dumps(document, separators=(',', ':')).replace('<', '\\u003c'),
        program=resources.files('rpo_report').joinpath('replay.js').read_text('utf-8'),
    )


def _scene(flight: Flight) -> dict[str, Any]:
    """Return what stands about the target; `ahead` is the way in, for the bodies alone."""
    scenario, zones = flight.scenario, zones_of(flight.scenario)
    cones = [zone.corridor for zone in zones if zone.corridor is not None]
    start = flight.errors[0, :3]
    way = np.where(np.abs(start) == np.abs(start).max(), np.sign(start), 0.0)
    return {
        'goal': list(scenario.goal_position_m),
        'ahead': list(cones[0].ahead if cones else way / max(1.0, float(np.linalg.norm(way)))),
        'max_force': scenario.max_force_n,
        'mate': getattr(scenario.named('pointing'), 'mate', (0.0, 0.0, 0.0, 1.0)),
        'cameras': _cameras(scenario),
        'keep_out': sorted({zone.keep_out_m for zone in zones} - {0.0}),
        'corridors': [
            {'tip': list(c.tip_m), 'end': list(c.end_m), 'near': c.half_width_m,
             'far': c.end_half_width_m, 'lines': c.lines()} for c in cones
        ],
        'points': {name: list(p) for zone in zones for name, p in zone.points_m.items()},
    }  # fmt: skip


def _cameras(scenario: Scenario) -> list[dict[str, Any]]:
    """Return the fields of view of a scenario's sensors: axis (3,), half angle [rad]."""
    sensors: Any = scenario.named('sensors')
    return [
        {'axis': unit.boresight, 'half': unit.field_of_view_rad,
         'turns': getattr(unit, 'body_fixed', False)}
        for unit in (sensors.units if sensors is not None else ())
        if unit.field_of_view_rad < math.pi
    ]  # fmt: skip


def _document(shown: Replayed, flights: int) -> dict[str, Any]:
    """Return a flight, one of so many; its arrays are base64 of little-endian float32."""
    flight, last = shown.flight, len(shown.flight.states) - 1
    ticks = np.linspace(0, last, min(last + 1, max(2, MOST_SAMPLES // flights))).round().astype(int)
    own, turns = flight.scenario.thrusters, turned_of(flight)
    exerted = turns is not None or (own is not None and own.fires)
    forces = flight.thrust.forces_n if exerted else flight.saturated_forces_n
    mean = np.add.reduceat(forces, ticks[:-1]) / np.diff(ticks)[:, None]
    reference = flight.signals.get(REFERENCE_STATE)
    times = flight.scenario.times_s
    return {
        'name': shown.name,
        'verdict': shown.verdict,
        'missed': shown.missed,
        'times': _packed(times[ticks]),
        'states': _packed(flight.states[ticks]),
        'forces': _packed(np.vstack([mean, np.zeros(3)])),
        'reference': None if reference is None else _packed(reference[ticks, :3]),
        'estimate': None if shown.estimate is None else _packed(shown.estimate[ticks]),
        'limits': [_limit(limit, ticks) for limit in limits_of(flight, shown.margins, turns)],
        'phases': [[name, why, float(times[min(at, last)])] for name, why, at in shown.phases],
        'attitudes': _attitudes(flight, ticks),
        'chaser': None if turns is None else _packed(turns.attitudes[ticks, :4]),
        'turns': [] if turns is None else _turns(turns, ticks),
        'acts': [[name, *times[np.minimum(at, last)].tolist()] for name, *at in shown.acts],
        'reasons': _reasons(flight, shown.controller, _REASONS // flights),
    }


def _attitudes(flight: Flight, ticks: Any) -> str | None:
    """Return the quaternions (n, 4) of a target that has an attitude."""
    scenario = flight.scenario
    if scenario.target is None:
        return None
    motion = motion_of(scenario.target, scenario)
    return _packed([motion.attitude(tick)[:4] for tick in ticks.tolist()])


def _turns(turns: Turned, ticks: Any) -> list[tuple[str, str, str]]:
    """Return name, unit and values (n,) of what is said of a chaser that turns."""
    rates = np.linalg.norm(turns.rates_deg_s, axis=1)
    found = [('off reference', '°', turns.off_reference_deg), ('turn rate', '°/s', rates)]
    if turns.theta_deg is not None:
        found.append(('θ of the command', '°', turns.theta_deg))
    return [(name, unit, _packed(values[ticks])) for name, unit, values in found]


def _packed(values: Any) -> str:
    return base64.b64encode(np.asarray(values, dtype='<f4').tobytes()).decode()


def _limit(limit: Limit, ticks: Any) -> dict[str, Any]:
    """Return a limit whose values are the worst between the samples."""
    worst = (np.fmin if limit.floor else np.fmax).reduceat(limit.values, ticks)
    return {**limit._asdict(), 'values': _packed(worst)}


def seen(flight: Flight, tick: int) -> Sequence[float]:
    """Return the state (6,) that the controller received, relative to reference or goal."""
    signals = {name: values[tick].tolist() for name, values in flight.signals.items()}
    return received(flight.scenario, {**signals, RELATIVE_STATE: flight.states[tick].tolist()})[0]


def _reasons(flight: Flight, controller: AnyController | None, most: int) -> dict[str, Any] | None:
    """Return at some ticks, for each axis, the force in words and the shares of its causes.

    None where a controller has no more to say than its force.
    """
    if controller is None:
        return None
    last, words = len(flight.states) - 1, dict[str, int]()
    samples = []
    ticks = np.linspace(0, last, max(2, min(most, round(flight.scenario.duration_s) + 1)))
    for tick in ticks.round().astype(int).tolist():
        said = explain.reasons(controller, seen(flight, tick), flight.forces_n[tick].tolist(), tick)
        if all(len(pairs) < 2 for _, pairs in said):
            return None
        row = []
        for sentence, pairs in said:
            found = explain.in_words(controller, sentence, dict(pairs))
            causes = sorted(found.causes, key=lambda cause: -cause.share)
            causes = [cause for cause in causes if cause.share >= 0.01][:_MOST_CAUSES]
            texts = [(round(100.0 * c.share), c.what.partition(' (')[0], c.why) for c in causes]
            number = words.setdefault
            number_n, _, force = found.force.partition(' N, ')
            force = force.partition(' (')[0] or number_n
            row.append([
                number(force, len(words)),
                [[p, number(what, len(words)), number(why, len(words))] for p, what, why in texts],
            ])  # fmt: skip
        samples.append(row)
    return {'words': list(words), 'samples': samples}
