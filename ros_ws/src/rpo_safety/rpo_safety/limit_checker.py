# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Limits of a flight, persistence (n of the last m samples), and fault -> reaction as data.

The scheme is that of NASA's cFS Limit Checker: watchpoints with persistence counters call for a
stored response. The speed limit |v| <= v0 + v1 |r| is the one of run-time assurance for docking
(K. Dunlap et al., arXiv 2110.00447, eq. 11), with v1 given in 1/s instead of mean motions.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import partial
from pathlib import Path
from typing import Annotated, Any, NamedTuple

from rpo_core import files
from rpo_core.files.validation import (
    Checked,
    InputError,
    choice,
    description,
    mapping,
    real,
    schema,
    text,
    vector3,
    whole,
)
from rpo_kernels.kernels import Vector

SCHEMA = 'rpo/monitor/1'

WARN, COAST, ABORT = 'warn', 'coast', 'abort'
REACTIONS = (WARN, COAST, ABORT)
"""Report the fault; also make the controller command zero; also end the run."""

FAULTS = {
    'not_finite': 'a state or a command is not a finite number',
    'out_of_range': 'the chaser is farther from the target than allowed',
    'too_fast': 'the chaser is faster than its range allows',
    'off_corridor': 'the chaser is outside the approach corridor',
    'force_saturated': 'the command is at the limit of the thrusters, or beyond it',
    'force_stale': 'no command came in time',
    'controller_inactive': 'the controller is not active',
}
"""Fault -> what it means."""

_LONGEST = 1_000_000


@dataclass(frozen=True)
class Rule:
    """A fault holds when `count` of the last `window` samples show it; then the reaction."""

    count: int
    window: int
    reaction: str


def _axis(name: str, value: Any) -> Vector:
    """Return a direction; raises InputError."""
    axis = vector3(name, value, 'any unit', bound=1e6)
    if not any(axis):
        raise InputError(f'`{name}` must not be zero; got [0, 0, 0]')
    return axis


_limit = partial(real, least=0.0)


@dataclass(frozen=True)
class Limits(Checked):
    """What is allowed; see the comments of config/monitors/default.yaml.

    corridor_axis : (3,) direction from the target, target LVLH, any length but zero; of a target
        with an attitude, in its axes
    """

    PLACE = 'limits.'

    range_m: Annotated[float, partial(_limit, unit='m', most=1e6)]
    speed_m_s: Annotated[float, partial(_limit, unit='m/s', most=1e4)]
    speed_per_range_1_s: Annotated[float, partial(_limit, unit='1/s', most=1e3)]
    force_n: Annotated[float, partial(_limit, unit='N', most=1e6)]
    force_age_s: Annotated[float, partial(_limit, unit='s', most=1e6)]
    corridor_half_angle_deg: Annotated[float, partial(_limit, unit='deg', most=180.0)]
    corridor_axis: Annotated[Vector, _axis]

    def faults_of_state(
        self, state: Sequence[float], attitude: Sequence[float] = (0.0, 0.0, 0.0, 1.0)
    ) -> dict[str, bool]:
        """Return which faults a state (6,) [m, m/s], target LVLH, shows and which not.

        attitude : quaternion x, y, z, w, from the target's axes to target LVLH
        """
        if not all(map(math.isfinite, state)):
            return {'not_finite': True}
        range_m, speed_m_s = math.hypot(*state[:3]), math.hypot(*state[3:])
        return {
            'not_finite': False,
            'out_of_range': range_m > self.range_m,
            'too_fast': speed_m_s > self.speed_m_s + self.speed_per_range_1_s * range_m,
            'off_corridor': self._angle_deg(state[:3], range_m, attitude)
            > self.corridor_half_angle_deg,
        }

    def faults_of_force(self, force_n: Sequence[float]) -> dict[str, bool]:
        """Return which faults a command (3,) [N] shows and which not."""
        if not all(map(math.isfinite, force_n)):
            return {'not_finite': True}
        return {'force_saturated': max(map(abs, force_n)) >= self.force_n}

    def _angle_deg(
        self, position_m: Sequence[float], range_m: float, attitude: Sequence[float]
    ) -> float:
        (a, b, c), (x, y, z, w) = self.corridor_axis, attitude
        tx, ty, tz = 2.0 * (y * c - z * b), 2.0 * (z * a - x * c), 2.0 * (x * b - y * a)
        axis = (
            a + w * tx + y * tz - z * ty,
            b + w * ty + z * tx - x * tz,
            c + w * tz + x * ty - y * tx,
        )
        along = sum(a * r for a, r in zip(axis, position_m, strict=True))
        size = math.hypot(*axis) * range_m
        return math.degrees(math.acos(max(-1.0, min(1.0, along / size)))) if size else 0.0


@dataclass(frozen=True)
class MonitorTable:
    """A monitor file: limits, and for each fault when it holds and what to do."""

    name: str
    limits: Limits
    rules: Mapping[str, Rule]


class Detection(NamedTuple):
    """A fault that has just begun to hold."""

    fault: str
    reaction: str

    @property
    def sentence(self) -> str:
        """The fault and what is done about it, in words."""
        return f'{FAULTS[self.fault]} ({self.fault}): {self.reaction}'


class LimitChecker:
    """Counts samples; a fault begins to hold once, and again only after a whole window without.

    The monitor and the abort table (`rpo_safety.abort`) count with it.

    holding : the faults that hold
    detected : how often each began to
    """

    def __init__(self, rules: Mapping[str, Rule]) -> None:
        self.rules = rules
        self.holding: set[str] = set()
        self.detected: dict[str, int] = dict.fromkeys(rules, 0)
        self._samples = {
            fault: deque([False] * rule.window, maxlen=rule.window) for fault, rule in rules.items()
        }
        self._shown = dict.fromkeys(rules, 0)

    def sample(self, seen: Mapping[str, bool]) -> list[Detection]:
        """Take one sample of some faults; return those that begin to hold by it."""
        detections = []
        for fault, shows in seen.items():
            samples, rule = self._samples[fault], self.rules[fault]
            self._shown[fault] += shows - samples[0]  # the oldest sample drops out
            samples.append(shows)
            if fault in self.holding:
                if not self._shown[fault]:
                    self.holding.discard(fault)
            elif self._shown[fault] >= rule.count:
                self.holding.add(fault)
                self.detected[fault] += 1
                detections.append(Detection(fault, rule.reaction))
        return detections

    def clear(self, faults: Iterable[str]) -> None:
        """Forget the samples of some faults: their cause is over by design."""
        for fault in faults:
            rule = self.rules[fault]
            self._samples[fault].extend([False] * rule.window)
            self._shown[fault] = 0
            self.holding.discard(fault)


def parse(document: Any) -> MonitorTable:
    """Return the monitor table of a parsed YAML document; raises InputError."""
    schema(document, SCHEMA)
    data = mapping('', document, ['schema', 'name', 'limits', 'faults'], ['description'])
    limits = mapping('limits', data['limits'], [field.name for field in fields(Limits)])
    faults = mapping('faults', data['faults'], FAULTS)
    description('description', data.get('description', ''))
    return MonitorTable(
        text('name', data['name']),
        Limits(**limits),
        {fault: _rule(f'faults.{fault}', faults[fault]) for fault in FAULTS},
    )


def _rule(name: str, value: Any) -> Rule:
    data = mapping(name, value, ['count', 'window', 'reaction'])
    window = whole(f'{name}.window', data['window'], least=1, most=_LONGEST)
    return Rule(
        whole(f'{name}.count', data['count'], least=1, most=window),
        window,
        choice(f'{name}.reaction', data['reaction'], REACTIONS),
    )


def load_monitor(name: str | Path) -> MonitorTable:
    """Return the monitor table of a shipped name or a path; raises InputError."""
    return files.load(files.find('monitor', str(name)), parse)
