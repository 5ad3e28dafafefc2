# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The replay: what the page of `rpo_log.show.replay` shows of flights that are over."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rpo.analysis.turned import Turned, panels_of, turned_of
from rpo_core.attitude.target import motion_of
from rpo_core.chain.flight import Flight
from rpo_core.control.controller import AnyController
from rpo_core.control.controller_file import received
from rpo_core.judge import metrics
from rpo_core.judge.verdicts import verdicts
from rpo_core.kernels.arrays import Floats
from rpo_core.wire.interfaces import REFERENCE_STATE, RELATIVE_STATE
from rpo_log.show import replay as page
from rpo_log.show.replay import MOST_SAMPLES, Limit, Moments, packed, scene_of

_REASONS = 4_000
"""Moments of all flights of a page that have the rules of their force."""


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
    """Return what is judged at each moment: requirements, the thrusters' limit, zones, margins."""
    scenario = flight.scenario
    force = np.vstack([flight.saturated_forces_n, np.zeros(3)])
    slew = np.diff(force[:-1], axis=0, prepend=0.0, append=0.0) / scenario.dt_s
    slew[: metrics.first_slew_tick(scenario)] = slew[-1] = 0.0
    at = Moments(flight.errors, flight.velocities_m_s, flight.positions_m, force, slew)
    required = [(verdict.key, verdict.unit, verdict.limit) for verdict in verdicts(flight)]
    limits = page.limits_of(scenario, at, required)
    for panel in panels_of(turns, scenario) if turns is not None else ():
        if panel.limit is not None:
            limits[panel.name] = Limit(panel.name, panel.unit, panel.limit, panel.sizes)
    if margins is not None:
        for name, unit, values in zip(('position', 'speed'), ('m', 'm/s'), margins.T, strict=True):
            limits[f'margin of {name}'] = Limit(
                f'assurance: margin of {name}', unit, 0.0, values, floor=True
            )
    return list(limits.values())


def page_of(title: str, flights: Sequence[Replayed], note: str = '') -> str:
    """Return the page; note : what its flights have in common, in a sentence."""
    first = flights[0].flight
    document = {
        'note': note,
        'scene': scene_of(first.scenario, first.errors[0, :3].tolist()),
        'flights': [_document(one, len(flights)) for one in flights],
    }
    return page.page_of(title, document)


def _document(shown: Replayed, flights: int) -> dict[str, Any]:
    """Return a flight, one of so many; its arrays are base64 of little-endian float32."""
    flight, last = shown.flight, len(shown.flight.states) - 1
    ticks = np.linspace(0, last, min(last + 1, max(2, MOST_SAMPLES // flights))).round().astype(int)
    thrusters, turns = flight.scenario.thrusters, turned_of(flight)
    exerted = turns is not None or (thrusters is not None and thrusters.fires)
    forces = flight.thrust.forces_n if exerted else flight.saturated_forces_n
    mean = np.add.reduceat(forces, ticks[:-1]) / np.diff(ticks)[:, None]
    reference = flight.signals.get(REFERENCE_STATE)
    times, target, attitudes = flight.scenario.times_s, flight.scenario.target, None
    if target is not None:
        motion = motion_of(target, flight.scenario)
        attitudes = packed([motion.attitude(tick)[:4] for tick in ticks.tolist()])
    return {
        'name': shown.name,
        'verdict': shown.verdict,
        'missed': shown.missed,
        'times': packed(times[ticks]),
        'states': packed(flight.states[ticks]),
        'forces': packed(np.vstack([mean, np.zeros(3)])),
        'reference': None if reference is None else packed(reference[ticks, :3]),
        'estimate': None if shown.estimate is None else packed(shown.estimate[ticks]),
        'limits': [_limit(limit, ticks) for limit in limits_of(flight, shown.margins, turns)],
        'phases': [[name, why, float(times[min(at, last)])] for name, why, at in shown.phases],
        'attitudes': attitudes,
        'chaser': None if turns is None else packed(turns.attitudes[ticks, :4]),
        'turns': [] if turns is None else _turns(turns, ticks),
        'acts': [[name, *times[np.minimum(at, last)].tolist()] for name, *at in shown.acts],
        'reasons': _reasons(flight, shown.controller, _REASONS // flights),
    }


def _turns(turns: Turned, ticks: Any) -> list[tuple[str, str, str]]:
    """Return name, unit and values (n,) of what is said of a chaser that turns."""
    rates = np.linalg.norm(turns.rates_deg_s, axis=1)
    lines = [('off reference', '°', turns.off_reference_deg), ('turn rate', '°/s', rates)]
    if turns.theta_deg is not None:
        lines.append(('θ of the command', '°', turns.theta_deg))
    return [(name, unit, packed(values[ticks])) for name, unit, values in lines]


def _limit(limit: Limit, ticks: Any) -> dict[str, Any]:
    """Return a limit whose values are the worst between the samples."""
    worst = (np.fmin if limit.floor else np.fmax).reduceat(limit.values, ticks)
    return {**limit._asdict(), 'values': packed(worst)}


def seen(flight: Flight, tick: int) -> Sequence[float]:
    """Return the state (6,) that the controller received, relative to reference or goal."""
    signals = {name: values[tick].tolist() for name, values in flight.signals.items()}
    return received(flight.scenario, {**signals, RELATIVE_STATE: flight.states[tick].tolist()})[0]


def _reasons(flight: Flight, controller: AnyController | None, limit: int) -> dict[str, Any] | None:
    """Return at some ticks, for each axis, the force in words and the shares of its causes.

    None where a controller has no more to say than its force.
    """
    if controller is None:
        return None
    last, words = len(flight.states) - 1, dict[str, int]()
    samples = []
    ticks = np.linspace(0, last, max(2, min(limit, round(flight.scenario.duration_s) + 1)))
    for tick in ticks.round().astype(int).tolist():
        row = page.reasons(controller, seen(flight, tick), tick, words)
        if row is None:
            return None
        samples.append(row)
    return {'words': list(words), 'samples': samples}
