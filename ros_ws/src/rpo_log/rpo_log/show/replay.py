# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The page that shows flights in three dimensions, to be turned, played and scrubbed.

`rpo.reports.replay` writes it of flights that are over, `rpo_bringup.views` of one that still runs:
that page asks its server for what has been flown since. `replay.html` has the page, `replay.js`
draws; three.js comes from its package and is inlined. The page loads nothing else, which its
content security policy enforces.
"""

from __future__ import annotations

import base64
import json
import math
import re
from collections.abc import Iterable, Sequence
from html import escape
from importlib import resources
from typing import Any, NamedTuple

import numpy as np

from rpo_core.control import explain
from rpo_core.control.controller import AnyController
from rpo_core.files.validation import InputError
from rpo_core.kernels.arrays import Floats
from rpo_core.scenario.scenario import Scenario
from rpo_core.world.zones import Zone, zones_of
from rpo_log.show import style

LIBRARY = 'jupyter_threejs_sage', 'static/r130/three.min.js'

MOST_SAMPLES = 12_000
"""States of all flights of a page; longer flights are sampled, and drawn by cubics between."""

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


class Moments(NamedTuple):
    """A flight at some moments, in the axes of the target.

    errors : (n, 6) from the goal; speeds : (n, 3) velocities; places : (n, 3) positions
    forces_n, slews_n_s : (n, 3) that the thrusters took, and their slew; not a number: not known
    """

    errors: Floats
    speeds: Floats
    places: Floats
    forces_n: Floats
    slews_n_s: Floats


def limits_of(
    scenario: Scenario, at: Moments, required: Iterable[tuple[str, str, float]]
) -> dict[str, Limit]:
    """Return what is judged at each moment: requirements, the thrusters' limit, zones.

    A requirement on a mean is shown at each moment where no other is about the same quantity.

    required : name, unit and limit of each requirement
    """
    error, requirements = at.errors[:, :3], scenario.requirements
    distances = np.linalg.norm(error, axis=1)
    toward = -(error * at.errors[:, 3:]).sum(axis=1)
    closing = np.divide(toward, distances, out=np.zeros_like(toward), where=distances > 0.0)
    series = {  # what a requirement's name has in it -> what it judges
        'error_per_axis': ('position error per axis', _per_axis(error)),
        'error_norm': ('position error', distances),
        'speed_per_axis': ('speed per axis', _per_axis(at.speeds)),
        'speed_norm': ('speed', np.linalg.norm(at.speeds, axis=1)),
        'hold_force': ('force per axis', _per_axis(at.forces_n)),
        'slew': ('slew per axis', _per_axis(at.slews_n_s)),
        'closing_speed': ('closing speed at contact', closing),
    }
    end_s = scenario.duration_s
    begins = {
        'final': end_s,
        'contact': end_s,
        'hold': 0.0 if requirements is None else requirements.hold_from_s,
        'mean': end_s - (0.0 if requirements is None else requirements.mean_window_s),
    }
    limits: dict[str, Limit] = {}
    for key, unit, limit in sorted(required, key=lambda row: row[0].startswith('mean')):
        part = next((part for part in series if part in key), None)
        if part is not None:
            name, values = series[part]
            begin_s = begins.get(key.split('_')[0], 0.0) or 0.0
            limits.setdefault(name.split()[0], Limit(name, unit, limit, values, begin_s))
    thrusters = Limit('force per axis', 'N', scenario.max_force_n, _per_axis(at.forces_n))
    limits.setdefault('force', thrusters)
    rooms = [_room(zone, at.places) for zone in zones_of(scenario) if zone.keep_out_m]
    if rooms:
        limits['room'] = Limit(
            'clear of the keep-out zone', 'm', 0.0, np.min(rooms, axis=0), floor=True
        )
    return limits


def _per_axis(vectors: Floats) -> Floats:
    return np.asarray(np.abs(vectors).max(axis=1))


def _room(zone: Zone, positions_m: Floats) -> Floats:
    """Return how far positions (n, 3) are outside a keep-out zone; < 0: how deep inside."""
    depths = zone.depths_m(positions_m)
    away = np.linalg.norm(positions_m, axis=1) - zone.keep_out_m
    return np.where(depths > 0.0, -depths, np.maximum(away, 0.0))


def filled(package: str, template: str, **parts: str) -> str:
    """Return a template of a package with its parts in place of their names."""
    page = resources.files(package).joinpath(template).read_text('utf-8')
    return re.sub(r'\{\{(\w+)\}\}', lambda name: parts[name[1]], page)


def library() -> str:
    """Return three.js."""
    package, path = LIBRARY
    try:
        return resources.files(package).joinpath(path).read_text('utf-8')
    except ModuleNotFoundError:
        raise InputError(
            'the page needs three.js: make setup LAYERS=report, or pip install jupyter-threejs-sage'
        ) from None


def page_of(title: str, document: dict[str, Any]) -> str:
    """Return the page of a document: `scene`, `flights`, a `note`; `live` of one that runs."""
    return filled(
        'rpo_log.show',
        'replay.html',
        title=escape(title),
        kind='live' if 'live' in document else 'replay',
        connect="; connect-src 'self'" if 'live' in document else '',
        colours=style.variables(),
        library=library(),
        data=json.dumps(document, separators=(',', ':')).replace('<', '\\u003c'),
        program=resources.files('rpo_log.show').joinpath('replay.js').read_text('utf-8'),
    )


def scene_of(scenario: Scenario, start_error_m: Sequence[float]) -> dict[str, Any]:
    """Return what stands about the target; `ahead` is the way in, for the bodies alone."""
    zones = zones_of(scenario)
    cones = [zone.corridor for zone in zones if zone.corridor is not None]
    start = np.array(start_error_m)
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


def packed(values: Any) -> str:
    """Return numbers as base64 of little-endian float32."""
    return base64.b64encode(np.asarray(values, dtype='<f4').tobytes()).decode()


def reasons(
    controller: AnyController, read: Sequence[float], tick: int, words: dict[str, int]
) -> list[Any] | None:
    """Return for each axis the force in words and the shares of its causes.

    None where a controller has no more to say than its force.

    read : (6,) state that it received; words : text -> number; new ones are added
    """
    row = []
    for reason in explain.reasons(controller, read, tick):
        causes = sorted(reason.causes, key=lambda cause: -cause.share)
        causes = [cause for cause in causes if cause.share >= 0.01][:_MOST_CAUSES]
        texts = [(round(100.0 * c.share), c.what.partition(' (')[0], c.why) for c in causes]
        number = words.setdefault
        number_n, _, force = reason.force.partition(' N, ')
        force = force.partition(' (')[0] or number_n
        row.append([
            number(force, len(words)),
            [[p, number(what, len(words)), number(why, len(words))] for p, what, why in texts],
        ])  # fmt: skip
    return row or None
