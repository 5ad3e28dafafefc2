# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The data of a run for the live views: plain numbers and texts, no ROS."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

from rpo_attitude.target import in_lvlh, motion_of
from rpo_attitude.turns import docking_axis, turned
from rpo_core import files
from rpo_core.control import controller as controllers
from rpo_core.control.blend import Reasons
from rpo_core.control.controller import AnyController
from rpo_core.files import scenario as scenarios
from rpo_core.files.scenario import Scenario
from rpo_core.files.validation import MOST_NAME, InputError, printable
from rpo_core.judge.metrics import MAX_ARRIVAL_DISTANCE_M
from rpo_core.judge.zones import Zone, zones_of
from rpo_core.wire.statuses import ENDED, Manifest, RunStatus
from rpo_ctrl import explain
from rpo_kernels.attitude_kernels import Attitude, Frame, seen_from
from rpo_thrusters.thrusters import STANDARD_GRAVITY_M_S2

Vector = tuple[float, ...]

_NANOSECONDS = 1_000_000_000
_AXES = ('x', 'y', 'z')
_MOST_RULES = 25
"""Rules of a table; what claims more is shown no further."""

_LARGEST = 1e100
"""A larger number of a foreign message is not shown: its square is beyond all floats."""

SILENCE_S = 3.0
"""A run in progress without a state for so long is silent."""


@dataclass(frozen=True)
class AxisDecision:
    """The reason of the commanded force on one axis.

    reasons : the force, and all rules that make it; of an unknown controller, what it published
    rules : (position word, velocity word, force word, strength), the strongest first
    """

    reasons: Reasons
    rules: tuple[tuple[str, str, str, float], ...] = ()

    @classmethod
    def of(
        cls, sentence: str, values: Mapping[str, str], controller: AnyController | None
    ) -> AxisDecision:
        """Return the decision in a status of topic `decision`; skip values that are no rules."""
        rules, published = [], {}
        for key, value in values.items():
            kind, *words = key.split('.')
            found = _number(value)
            if not math.isfinite(found):
                continue
            published[key] = found
            if kind == 'rule' and len(words) == 3:
                p, v, force = (printable(word, MOST_NAME) for word in words)
                rules.append((p, v, force, found))
        rules.sort(key=lambda rule: -rule[3])
        said = explain.in_words(controller, printable(sentence), published)
        return cls(said, tuple(rules[:_MOST_RULES]))


def _number(text: str) -> float:
    """Return a number; not a number where the text is something else."""
    try:
        return float(text)
    except ValueError:
        return math.nan


class Trail:
    """Positions (n, 3) [m], target LVLH, n <= most; from the first to the last.

    A position is kept if it is `spacing_m` away from the last one kept. If there are too many,
    every second one is deleted and the spacing doubles: the path stays complete, but coarser.
    """

    def __init__(self, most: int = 2000, spacing_m: float = 0.02) -> None:
        self._most, self._first_spacing_m = most, spacing_m
        self.clear()

    def clear(self) -> None:
        """Delete all points."""
        self.points: list[tuple[float, float, float]] = []
        self.spacing_m = self._first_spacing_m

    def add(self, position_m: Sequence[float]) -> bool:
        """Take a position (3,); return whether it was kept."""
        x, y, z = position_m
        if self.points and math.dist(self.points[-1], (x, y, z)) < self.spacing_m:
            return False
        self.points.append((x, y, z))
        if len(self.points) > self._most:
            del self.points[1::2]
            self.spacing_m *= 2.0
        return True


@dataclass
class Effort:
    """Impulse and arrival, of what a viewer sees: it skips messages, so both are approximate.

    impulse_n_s : integral of |f_x| + |f_y| + |f_z|, each force held until the next one seen
    seconds : over which it is counted; inside_s : since then within 0.5 m per axis, None outside
    """

    impulse_n_s: float = 0.0
    seconds: float = 0.0
    inside_s: float | None = None
    _last_s: float | None = None

    @property
    def known(self) -> bool:
        """Whether there is an impulse; foreign forces may add up beyond all floats."""
        return self.seconds > 0.0 and math.isfinite(self.impulse_n_s)

    def add(self, time_s: float, error_m: Vector, force_n: Vector | None) -> None:
        """Take the position from the goal at a time, and the force since the time before."""
        if self._last_s is not None and force_n is not None and time_s > self._last_s:
            self.impulse_n_s += sum(map(abs, force_n)) * (time_s - self._last_s)
            self.seconds += time_s - self._last_s
        self._last_s = time_s
        if max(map(abs, error_m)) > MAX_ARRIVAL_DISTANCE_M:
            self.inside_s = None
        elif self.inside_s is None:
            self.inside_s = time_s


@dataclass
class LiveRun:
    """The run as far as messages came; None where none came. Foreign texts are printable here.

    position_m, velocity_m_s, disturbance_n : (3,), target LVLH
    force_n : (3,) as the controller commands it; views show `command_n`
    exerted_n : (3,) mean force of pulses in a tick, where thrusters fire in pulses
    chaser_attitude : (7,) true quaternion and rate of a chaser that has one
    zones : about the target, as the scenario has them
    flights : number of runs since the start of the viewer
    clock : wall time [s]
    """

    clock: Callable[[], float] = time.monotonic
    trail: Trail = field(default_factory=Trail)
    scenario: Scenario | None = None
    controller: str = ''
    phase: str = ''
    reason: str = ''
    position_m: Vector | None = None
    velocity_m_s: Vector | None = None
    force_n: Vector | None = None
    disturbance_n: Vector | None = None
    exerted_n: Vector | None = None
    decisions: dict[str, AxisDecision] = field(default_factory=dict)
    effort: Effort = field(default_factory=Effort)
    chaser_attitude: Vector | None = None
    zones: list[Zone] = field(default_factory=list)
    flights: int = 0
    _text: str = ''
    _law: AnyController | None = None
    _law_text: str = ''
    _stamp_ns: int = 0
    _first_ns: int = 0
    _heard_s: float | None = None

    def on_state(
        self, stamp_ns: int, state: Sequence[float], attitude: Vector | None = None
    ) -> None:
        """Take a state x, y, z [m], vx, vy, vz [m/s], target LVLH; ignore one beyond all floats.

        attitude : (7,) of the chaser, where the message says one
        """
        if not math.isfinite(math.hypot(*state[:3]) + math.hypot(*state[3:])):
            return
        if self.position_m is None or stamp_ns < self._stamp_ns:
            self._begin(stamp_ns)
        self._stamp_ns, self._heard_s = stamp_ns, self.clock()
        self.position_m, self.velocity_m_s = tuple(state[:3]), tuple(state[3:])
        self.trail.add(self.position_m)
        turns = self.scenario is not None and self.scenario.attitude
        if attitude is not None and turns and all(abs(q) < _LARGEST for q in attitude):
            self.chaser_attitude = attitude
        self.effort.add(self.time_s, self.errors[:3], self.force_n)

    def _begin(self, stamp_ns: int) -> None:
        self.flights += 1
        self._first_ns = stamp_ns
        self.trail.clear()
        self.decisions.clear()
        self.force_n = self.disturbance_n = self.exerted_n = None
        self.effort, self.chaser_attitude = Effort(), None

    def on_status(self, status: RunStatus) -> None:
        """Take a run_status."""
        self.phase, self.reason = status.phase, status.reason

    def on_manifest(self, manifest: Manifest) -> None:
        """Take the manifest of a node."""
        if manifest.role == 'controller':
            name = manifest.values.get('parameter.controller', '')
            self.controller = printable(name, MOST_NAME)
            self._take_law(manifest.values.get('file.controller.yaml', ''))
        if manifest.role != 'plant':
            return
        text = manifest.values.get('file.scenario.yaml', '')
        if text == self._text:  # said again each second
            return
        self._text, self.scenario, self.zones = text, None, []
        try:
            found = files.loads(text, scenarios.parse, 'scenario')
        except InputError:
            return  # another kind of plant: its scenario stays unknown
        if isinstance(found, Scenario):
            self.scenario, self.zones = found, zones_of(found)

    def _take_law(self, text: str) -> None:
        """Take the file of the controller; of another kind it stays unknown."""
        if text != self._law_text:  # said again each second
            self._law_text, self._law = text, None
            with suppress(InputError):
                self._law = files.loads(text, controllers.parse, 'controller')

    def on_decision(self, axis: str, sentence: str, values: Mapping[str, str]) -> None:
        """Take the decision of the controller on an axis."""
        if axis in _AXES:
            self.decisions[axis] = AxisDecision.of(sentence, values, self._law)

    @property
    def stamp_ns(self) -> int:
        """Stamp of the newest state."""
        return self._stamp_ns

    @property
    def time_s(self) -> float:
        """Simulated time since the start of the run."""
        begun_ns = self.scenario.epoch_ns if self.scenario is not None else self._first_ns
        return (self._stamp_ns - begun_ns) / _NANOSECONDS

    @property
    def tick(self) -> int:
        """Tick of the newest state; without a scenario, one beyond all ticks."""
        if self.scenario is None:
            return sys.maxsize
        return (self._stamp_ns - self.scenario.epoch_ns) // self.scenario.dt_ns

    @property
    def errors(self) -> Vector:
        """State (6,) from the goal [m, m/s], in the axes of the target; empty if none came."""
        state = (*(self.position_m or ()), *(self.velocity_m_s or ()))
        if self.scenario is None or not state:
            return state
        f = self.frame
        return self.scenario.from_goal(state if f is None else seen_from(state, f))

    @property
    def _flown_tick(self) -> int:
        """Tick of the newest state; the nearest of the flight where it has another stamp."""
        last = self.scenario.ticks if self.scenario is not None else 0
        return min(max(0, self.tick), last)

    @property
    def attitude(self) -> Attitude | None:
        """Quaternion and rate of the target at the newest state; None where it has no attitude."""
        if self.scenario is None or self.scenario.target is None:
            return None
        return motion_of(self.scenario.target, self.scenario).attitude(self._flown_tick)

    @property
    def docking_axis(self) -> Vector | None:
        """Unit vector (3,) of the chaser's docking axis, target LVLH; None: it has no attitude."""
        if self.scenario is None or self.chaser_attitude is None:
            return None
        axis = turned(docking_axis(self.scenario), self.chaser_attitude[:4])
        return tuple(axis.tolist())

    @property
    def frame(self) -> Frame | None:
        """The same as a frame."""
        if self.scenario is None or self.scenario.target is None:
            return None
        return motion_of(self.scenario.target, self.scenario).frame(self._flown_tick)

    @property
    def zones_now(self) -> list[Zone]:
        """The zones at the newest state, target LVLH."""
        f = self.frame
        return self.zones if f is None else [in_lvlh(zone, f) for zone in self.zones]

    @property
    def range_m(self) -> float:
        """Distance from the goal."""
        return math.hypot(*self.errors[:3])

    @property
    def range_rate_m_s(self) -> float:
        """How fast the distance from the goal grows; negative: it closes."""
        errors, range_m = self.errors, self.range_m
        if range_m == 0.0:
            return 0.0
        return sum(r / range_m * v for r, v in zip(errors[:3], errors[3:], strict=True))

    @property
    def delta_v_m_s(self) -> float | None:
        """Velocity change commanded so far, the sum of the axes, about; None if not known."""
        if self.scenario is None or not self.effort.known:
            return None
        return self.effort.impulse_n_s / self.scenario.mass_kg

    @property
    def propellant_kg(self) -> float | None:
        """Propellant spent so far, of the velocity change commanded; None if not known."""
        thrusters = self.scenario.thrusters if self.scenario is not None else None
        if self.scenario is None or thrusters is None or not thrusters.propellant:
            return None
        exhaust_m_s = thrusters.propellant.specific_impulse_s * STANDARD_GRAVITY_M_S2
        spent_m_s = self.delta_v_m_s
        if spent_m_s is None:
            return None
        return self.scenario.mass_kg * -math.expm1(-spent_m_s / exhaust_m_s)

    @property
    def command_n(self) -> Vector | None:
        """Commanded force (3,), target LVLH, to which the attitude may have to turn it."""
        found, attitude = self.force_n, self.chaser_attitude
        if found is None or attitude is None or self.scenario is None:
            return found
        if self.scenario.named('attitude_control') is not None:
            return found
        return tuple(turned(found, attitude[:4]).tolist())

    @property
    def pulses_n(self) -> Vector | None:
        """Mean force (3,) of pulses of each axis; None where the axes turn with the chaser."""
        return None if self.scenario is not None and self.scenario.attitude else self.exerted_n

    @property
    def duty(self) -> float | None:
        """Mean |force| as a share of the limit, of all axes, about; None if not known."""
        if self.scenario is None or not self.effort.known:
            return None
        most_n_s = 3.0 * self.scenario.max_force_n * self.effort.seconds
        return self.effort.impulse_n_s / most_n_s

    @property
    def silent_s(self) -> float | None:
        """Wall time since the last state of a run in progress, if it is long; else None."""
        if self._heard_s is None or self.phase in ENDED:
            return None
        silence_s = self.clock() - self._heard_s
        return silence_s if silence_s > SILENCE_S else None

    def sentence(self, topic: str) -> str:
        """Return the status of the run in a sentence; `topic` is the topic of its states."""
        if self.position_m is None:
            if self.phase:
                return f'{self.phase}: {self.reason}'
            return f'no message on {topic} yet: is a plant running, in this namespace and domain?'
        if self.silent_s is not None:
            return f'no message on {topic} for {self.silent_s:.0f} s'
        return f'{self.phase or "running"}: {self.reason}' if self.reason else 'running'

    def snapshot(self, topic: str) -> dict[str, Any]:
        """Return all data but the trail, ready for JSON; None for unknown data."""
        position, velocity = self.position_m, self.velocity_m_s
        return {
            'topic': topic,
            'sentence': self.sentence(topic),
            'phase': self.phase,
            'flights': self.flights,
            'scenario': self.scenario.name if self.scenario else None,
            'controller': self.controller or None,
            'duration_s': self.scenario.duration_s if self.scenario else None,
            'max_force_n': self.scenario.max_force_n if self.scenario else None,
            'time_s': self.time_s if position else None,
            'position_m': position,
            'velocity_m_s': velocity,
            'docking_axis': self.docking_axis,
            'range_m': self.range_m if position else None,
            'range_rate_m_s': self.range_rate_m_s if position else None,
            'of_goal': self.scenario is not None and self.scenario.goal is not None,
            'delta_v_m_s': self.delta_v_m_s,
            'propellant_kg': self.propellant_kg,
            'duty': self.duty,
            'inside_s': self.effort.inside_s,
            'speed_m_s': math.hypot(*velocity) if velocity else None,
            'force_n': self.command_n,
            'disturbance_n': self.disturbance_n,
            'exerted_n': self.pulses_n,
            'decisions': {
                axis: {'sentence': decision.reasons.sentence, 'rules': decision.rules}
                for axis, decision in sorted(self.decisions.items())
            },
            'zones': [_drawn(zones) for zones in self.zones_now],
        }


def _drawn(zones: Zone) -> dict[str, Any]:
    """Return zones, ready for JSON; a corridor by its edges in both planes of the page."""
    corridor = zones.corridor
    return {
        'keep_out_m': zones.keep_out_m,
        'points_m': dict(zones.points_m),
        'port_m': corridor and corridor.tip_m,
        'edges_m': {str(up): corridor.edges(1, up) for up in (0, 2)} if corridor else {},
    }
