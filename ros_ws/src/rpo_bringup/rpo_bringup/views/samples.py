# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What the page holds of a flight that is still running: the document of a replay, bit by bit."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from rpo_bringup.views.live import LiveFlight, Vector
from rpo_core.attitude.attitude_kernels import seen_from, synchronised
from rpo_core.attitude.pointing import apart
from rpo_core.control.controller import AnyController
from rpo_core.control.controller_file import received
from rpo_core.scenario.requirements import ROWS
from rpo_core.scenario.scenario import Scenario
from rpo_core.wire import interfaces
from rpo_log.show import replay
from rpo_log.show.replay import MOST_SAMPLES, Moments

_TURNS = (('off reference', '°'), ('turn rate', '°/s'))
_COLUMNS = 'times', 'states', 'forces', 'reference', 'estimate', 'attitudes', 'chaser'
_CORNER = np.tril_indices(3)


class Samples:
    """The flight `number` of a viewer, whose scenario is known, at the moments it was looked at.

    anew : how often a page must begin anew: every second of too many moments was left out, or a
        controller came to be known
    rows : of each moment, its numbers by their names in the document
    """

    def __init__(self, live: LiveFlight, scenario: Scenario) -> None:
        self.number, self.anew, self._scenario = live.flights, 0, scenario
        self._controller: AnyController | None = None
        self._explains = False
        required = scenario.requirements
        self._required = [
            (key, ROWS[key].unit, limit)
            for key, limit in (required.limits if required else {}).items()
            if not ROWS[key].share
        ]
        self._words: dict[str, int] = {}
        self.rows: list[dict[str, Any]] = []
        self._told: list[tuple[Any, int]] = []  # reasons of each moment, and words until then

    @property
    def name(self) -> str:
        """Of this flight, as far as a page may go on with it."""
        return f'{self.number}.{self.anew}'

    def add(self, live: LiveFlight) -> None:
        """Take the newest moment."""
        row, told = self._row(live), self._reasons(live)
        if live.controller is not self._controller:
            self._controller, self._explains = live.controller, told is not None
            self.anew += bool(self.rows)
        self.rows.append(row)
        self._told.append((told, len(self._words)))
        if len(self.rows) > MOST_SAMPLES:
            del self.rows[1::2], self._told[1::2]
            self.anew += 1

    def _row(self, live: LiveFlight) -> dict[str, Any]:
        scenario, signals = self._scenario, live.signals
        state, frame = signals[interfaces.RELATIVE_STATE], live.frame
        seen = state if frame is None else tuple(seen_from(state, frame))
        force = live.force_n or (0.0, 0.0, 0.0)
        shown = tuple(max(-scenario.max_force_n, min(scenario.max_force_n, f)) for f in force)
        row: dict[str, Any] = {
            'times': (live.stamp_ns - scenario.epoch_ns) * 1e-9,
            'states': state,
            'forces': shown,
            'errors': scenario.from_goal(seen),
            'seen': seen,
        }
        if scenario.named('guidance') is not None:
            row['reference'] = signals.get(interfaces.REFERENCE_STATE, state)[:3]
        if scenario.named('estimator') is not None:
            row['estimate'] = _estimate(signals)
        if (attitude := live.attitude) is not None:
            row['attitudes'] = attitude[:4]
        if (turns := live.chaser_attitude) is not None:
            still = synchronised(scenario.mean_motion_rad_s)
            wanted = signals.get(interfaces.REFERENCE_ATTITUDE) or still
            off, _ = apart(np.array(turns), np.array(wanted))
            row['chaser'] = turns[:4]
            row['turns'] = [math.degrees(off), math.degrees(math.hypot(*turns[4:]))]
        return row

    def _reasons(self, live: LiveFlight) -> Any:
        """Return why the controller commands its force; None: it is not known, or says no more."""
        if live.controller is None:
            return None
        signals = {interfaces.REFERENCE_FORCE: (0.0, 0.0, 0.0), **live.signals}
        read = received(self._scenario, signals)[0]
        return replay.reasons(live.controller, read, live.tick, self._words)

    def flight(self, live: LiveFlight, sentence: str, first: int = 0) -> dict[str, Any]:
        """Return the flight from a moment on, as a replay has it."""
        rows, dt_s = self.rows[first:], self._scenario.dt_s
        columns = {name: np.array([row[name] for row in rows]) for name in rows[0]}
        seen, forces = columns['seen'], columns['forces']
        unknown = np.full_like(forces, np.nan)
        at = Moments(columns['errors'], seen[:, 3:], seen[:, :3], forces, unknown)
        limits = replay.limits_of(self._scenario, at, self._required).values()
        turns = zip(_TURNS, columns['turns'].T, strict=True) if 'turns' in columns else ()
        ends = [*(said.tick * dt_s for said in live.acts[1:]), self._scenario.duration_s]
        words = list(self._words)[self._told[first - 1][1] if first else 0 :]
        return {
            'name': self._scenario.name,
            'verdict': sentence,
            'missed': None,
            **{
                name: replay.packed(columns[name]) if name in columns else None for name in _COLUMNS
            },
            'limits': [{**x._asdict(), 'values': replay.packed(x.values)} for x in limits],
            'turns': [[name, unit, replay.packed(values)] for (name, unit), values in turns],
            'phases': [[said.phase, said.reason, said.tick * dt_s] for said in live.phases],
            'acts': [
                [said.constraint, said.tick * dt_s, end_s]
                for said, end_s in zip(live.acts, ends, strict=False)
                if said.constraint
            ],
            'reasons': {'words': words, 'samples': [told for told, _ in self._told[first:]]}
            if self._explains
            else None,
        }

    def document(self, live: LiveFlight, sentence: str) -> dict[str, Any]:
        """Return what a page shows at first, and from where it asks for more."""
        name, end_s = live.controller_name, self._scenario.duration_s
        return {
            'note': f'controller {name}' if name else '',
            'scene': replay.scene_of(self._scenario, self.rows[0]['states'][:3]),
            'flights': [self.flight(live, sentence)],
            'live': {'flight': self.name, 'samples': len(self.rows), 'end': end_s},
        }


def _estimate(signals: dict[str, Vector]) -> list[float]:
    """Return the estimated position and the lower triangle of the factor of its covariance."""
    position = signals.get(interfaces.NAVIGATION_STATE, signals[interfaces.RELATIVE_STATE])[:3]
    covariance = np.reshape(signals.get(interfaces.NAVIGATION_COVARIANCE, (0.0,) * 9)[:9], (3, 3))
    try:
        factor = np.linalg.cholesky(covariance)
    except np.linalg.LinAlgError:  # exact, or foreign
        factor = np.zeros((3, 3))
    return [*position, *factor[_CORNER].tolist()]
