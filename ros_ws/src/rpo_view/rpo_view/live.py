# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What the live views know of a run: plain numbers and texts, no ROS."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from rpo_core import files, scenario
from rpo_core.validation import InputError
from rpo_view.trail import Trail

Vector = tuple[float, ...]

_NANOSECONDS = 1_000_000_000
SILENCE_S = 3.0
"""Without a state for so long a run that is under way counts as silent."""


@dataclass(frozen=True)
class AxisDecision:
    """Why the controller commands what it commands on one axis.

    rules : (position word, velocity word, force word, strength), the strongest first
    """

    sentence: str
    rules: tuple[tuple[str, str, str, float], ...] = ()

    @classmethod
    def of(cls, sentence: str, values: Mapping[str, str]) -> AxisDecision:
        """Return what a status of the topic `decision` says; a pair that is no rule is left out."""
        rules = []
        for key, value in values.items():
            kind, *words = key.split('.')
            strength = _number(value)
            if kind == 'rule' and len(words) == 3 and strength is not None:
                rules.append((words[0], words[1], words[2], strength))
        return cls(sentence, tuple(sorted(rules, key=lambda rule: -rule[3])))


def _number(text: str) -> float | None:
    """Return a finite number, or None where the text is something else."""
    try:
        number = float(text)
    except ValueError:
        return None
    return number if math.isfinite(number) else None


@dataclass
class LiveRun:
    """The run as far as it was heard; None where nothing was.

    position_m, velocity_m_s, force_n, disturbance_n : (3,), target LVLH
    flights : how many runs were seen to begin
    clock : wall time [s]
    """

    clock: Callable[[], float] = time.monotonic
    trail: Trail = field(default_factory=Trail)
    flown: scenario.Scenario | None = None
    controller: str = ''
    phase: str = ''
    reason: str = ''
    figures: dict[str, float] = field(default_factory=dict)
    position_m: Vector | None = None
    velocity_m_s: Vector | None = None
    force_n: Vector | None = None
    disturbance_n: Vector | None = None
    decisions: dict[str, AxisDecision] = field(default_factory=dict)
    flights: int = 0
    _stamp_ns: int = 0
    _first_ns: int = 0
    _heard_s: float | None = None

    def on_state(self, stamp_ns: int, state: Sequence[float]) -> None:
        """Take in x, y, z [m], vx, vy, vz [m/s], target LVLH."""
        if self.position_m is None or stamp_ns < self._stamp_ns:
            self._begin(stamp_ns)
        self._stamp_ns, self._heard_s = stamp_ns, self.clock()
        self.position_m, self.velocity_m_s = tuple(state[:3]), tuple(state[3:])
        self.trail.add(self.position_m)

    def _begin(self, stamp_ns: int) -> None:
        self.flights += 1
        self._first_ns = stamp_ns
        self.trail.clear()
        self.decisions.clear()
        self.force_n = self.disturbance_n = None

    def on_status(self, message: str, values: Mapping[str, str]) -> None:
        """Take in run_status."""
        self.phase, self.reason = values.get('phase', ''), message
        numbers = {key: _number(value) for key, value in values.items()}
        self.figures = {key: number for key, number in numbers.items() if number is not None}

    def on_manifest(self, values: Mapping[str, str]) -> None:
        """Take in what a node runs with."""
        role = values.get('role')
        if role == 'controller':
            self.controller = values.get('parameter.controller', '')
        if role != 'plant':
            return
        try:
            found = files.loads(values.get('file.scenario.yaml', ''), scenario.parse, 'scenario')
        except InputError:
            return  # another make of plant: what it flies stays unknown
        self.flown = found if isinstance(found, scenario.Scenario) else None

    def on_decision(self, axis: str, sentence: str, values: Mapping[str, str]) -> None:
        """Take in why the controller commands what it commands on an axis."""
        self.decisions[axis] = AxisDecision.of(sentence, values)

    @property
    def time_s(self) -> float:
        """Simulated time since the start of the run."""
        begun_ns = self.flown.epoch_ns if self.flown is not None else self._first_ns
        return (self._stamp_ns - begun_ns) / _NANOSECONDS

    @property
    def silent_s(self) -> float | None:
        """Wall time since a run that is under way was last heard, if that is long; else None."""
        if self._heard_s is None or self.phase in ('finished', 'aborted'):
            return None
        silence_s = self.clock() - self._heard_s
        return silence_s if silence_s > SILENCE_S else None

    def sentence(self, topic: str) -> str:
        """Return in a sentence where the run stands; `topic` is where states are listened for."""
        if self.position_m is None:
            if self.phase:
                return f'{self.phase}: {self.reason}'
            return f'nothing on {topic} yet: is a plant running, in this namespace and domain?'
        if self.silent_s is not None:
            return f'nothing on {topic} for {self.silent_s:.0f} s'
        return f'{self.phase or "running"}: {self.reason}' if self.reason else 'running'

    def snapshot(self, topic: str) -> dict[str, Any]:
        """Return everything but the trail, ready for JSON; None for what is not known."""
        position, velocity = self.position_m, self.velocity_m_s
        return {
            'topic': topic,
            'sentence': self.sentence(topic),
            'phase': self.phase,
            'flights': self.flights,
            'scenario': self.flown.name if self.flown else None,
            'controller': self.controller or None,
            'duration_s': self.flown.duration_s if self.flown else None,
            'max_force_n': self.flown.max_force_n if self.flown else None,
            'time_s': self.time_s if position else None,
            'position_m': position,
            'velocity_m_s': velocity,
            'range_m': math.hypot(*position) if position else None,
            'speed_m_s': math.hypot(*velocity) if velocity else None,
            'force_n': self.force_n,
            'disturbance_n': self.disturbance_n,
            'figures': self.figures,
            'decisions': {
                axis: {'sentence': decision.sentence, 'rules': decision.rules}
                for axis, decision in sorted(self.decisions.items())
            },
        }
