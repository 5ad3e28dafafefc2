# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What the page holds of a flight that is still running: the document of a replay, bit by bit."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from rpo_attitude.turns import apart
from rpo_core.control.controller import AnyController
from rpo_core.control.controller_file import received
from rpo_core.files.scenario import Scenario
from rpo_core.judge.requirements import ROWS
from rpo_core.wire.interfaces import (
    CONTROL_FORCE,
    NAVIGATION_COVARIANCE,
    NAVIGATION_STATE,
    REFERENCE_ATTITUDE,
    REFERENCE_FORCE,
    REFERENCE_STATE,
    RELATIVE_STATE,
)
from rpo_kernels.attitude_kernels import seen_from, synchronised
from rpo_log.show import replay
from rpo_log.show.replay import MOST_SAMPLES, Limit, Moments
from rpo_view.live import LiveFlight, Vector

_TURNS = (('off reference', '°'), ('turn rate', '°/s'))
_CORNER = np.tril_indices(3)
_UNKNOWN = (math.nan,) * 3


class Samples:
    """The flight `number` of a viewer, whose scenario is known, at the moments it was looked at.

    anew : how often a page must begin anew: every second of too many moments was left out, or a
        controller came to be known
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
        self._rows: list[dict[str, Any]] = []
        self._limits: list[Limit] = []

    def __len__(self) -> int:
        """Return the number of moments."""
        return len(self._rows)

    @property
    def name(self) -> str:
        """Of this flight, as far as a page may go on with it."""
        return f'{self.number}.{self.anew}'

    def add(self, live: LiveFlight) -> None:
        """Take the newest moment."""
        row = self._row(live)
        if live.controller is not self._controller:
            self._controller, self._explains = live.controller, row['reasons'] is not None
            self.anew += bool(self._rows)
        self._rows.append(row)
        if len(self._rows) > MOST_SAMPLES:
            del self._rows[1::2]
            self.anew += 1

    def _row(self, live: LiveFlight) -> dict[str, Any]:
        scenario, signals = self._scenario, live.signals
        state, frame = signals[RELATIVE_STATE], live.frame
        seen = state if frame is None else tuple(seen_from(state, frame))
        force = live.force_n or (0.0, 0.0, 0.0)
        shown = tuple(max(-scenario.max_force_n, min(scenario.max_force_n, f)) for f in force)
        parts = scenario.from_goal(seen), seen[3:], seen[:3], shown, _UNKNOWN
        at = Moments(*(np.array([part]) for part in parts))
        self._limits = list(replay.limits_of(scenario, at, self._required).values())
        row: dict[str, Any] = {
            'times': (live.stamp_ns - scenario.epoch_ns) * 1e-9,
            'states': state,
            'forces': shown,
            'limits': [float(limit.values[0]) for limit in self._limits],
            'reference': signals.get(REFERENCE_STATE, state)[:3],
            'estimate': _estimate(signals),
            'turns': [],
            'reasons': None,
        }
        if (attitude := live.attitude) is not None:
            row['attitudes'] = attitude[:4]
        if (turns := live.chaser_attitude) is not None:
            wanted = signals.get(REFERENCE_ATTITUDE) or synchronised(scenario.mean_motion_rad_s)
            off, _ = apart(np.array(turns), np.array(wanted))
            row['chaser'] = turns[:4]
            row['turns'] = [math.degrees(off), math.degrees(math.hypot(*turns[4:]))]
        if live.controller is not None:
            read = received(scenario, {REFERENCE_FORCE: (0.0, 0.0, 0.0), **signals})[0]
            answer = signals.get(CONTROL_FORCE, (0.0, 0.0, 0.0))
            row['reasons'] = replay.reasons(live.controller, read, answer, live.tick, self._words)
        row['words'] = len(self._words)
        return row

    def flight(self, live: LiveFlight, sentence: str, first: int = 0) -> dict[str, Any]:
        """Return the flight from a moment on, as a replay has it."""
        rows, known = self._rows[first:], {*self._rows[0]}
        dt_s = self._scenario.dt_s

        def column(name: str, there: bool = True) -> str | None:
            return replay.packed([row[name] for row in rows]) if there and name in known else None

        limits = np.array([row['limits'] for row in rows]).T
        turns = np.array([row['turns'] for row in rows]).T
        ends = [*(said.tick * dt_s for said in live.acts[1:]), self._scenario.duration_s]
        acts = [
            [said.constraint, said.tick * dt_s, end_s]
            for said, end_s in zip(live.acts, ends, strict=False)
            if said.constraint
        ]
        words = list(self._words)[self._rows[first - 1]['words'] if first else 0 :]
        return {
            'name': self._scenario.name,
            'verdict': sentence,
            'missed': None,
            'times': column('times'),
            'states': column('states'),
            'forces': column('forces'),
            'reference': column('reference', self._scenario.named('guidance') is not None),
            'estimate': column('estimate', self._scenario.named('estimator') is not None),
            'attitudes': column('attitudes'),
            'chaser': column('chaser'),
            'limits': [
                {**limit._asdict(), 'values': replay.packed(values)}
                for limit, values in zip(self._limits, limits, strict=True)
            ],
            'turns': [
                [name, unit, replay.packed(values)]
                for (name, unit), values in zip(_TURNS, turns, strict=False)
            ],
            'phases': [[said.phase, said.reason, said.tick * dt_s] for said in live.phases],
            'acts': acts,
            'reasons': {'words': words, 'samples': [row['reasons'] for row in rows]}
            if self._explains
            else None,
        }

    def document(self, live: LiveFlight, sentence: str) -> dict[str, Any]:
        """Return what a page shows at first, and from where it asks for more."""
        start = replay.scene_of(self._scenario, self._rows[0]['states'][:3])
        controller = live.controller_name
        return {
            'note': f'controller {controller}' if controller else '',
            'scene': start,
            'flights': [self.flight(live, sentence)],
            'live': {
                'flight': self.name,
                'samples': len(self),
                'end': self._scenario.duration_s,
            },
        }


def _estimate(signals: dict[str, Vector]) -> list[float]:
    """Return the estimated position and the lower triangle of the factor of its covariance."""
    position = signals.get(NAVIGATION_STATE, signals[RELATIVE_STATE])[:3]
    covariance = np.reshape(signals.get(NAVIGATION_COVARIANCE, (0.0,) * 9)[:9], (3, 3))
    try:
        factor = np.linalg.cholesky(covariance)
    except np.linalg.LinAlgError:  # exact, or foreign
        factor = np.zeros((3, 3))
    return [*position, *factor[_CORNER].tolist()]
