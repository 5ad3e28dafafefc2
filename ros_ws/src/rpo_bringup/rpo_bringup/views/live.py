# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A flight that is still running, as far as messages came: plain numbers and texts, no ROS."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from typing import TypeVar

from rpo_core import files
from rpo_core.attitude.attitude_kernels import Attitude, Frame
from rpo_core.attitude.pointing import docking_axis, turned
from rpo_core.attitude.target import Motion, in_lvlh, motion_of
from rpo_core.control import controller as controllers
from rpo_core.control.controller import AnyController
from rpo_core.files.validation import MOST_NAME, InputError, printable
from rpo_core.scenario import scenario as scenarios
from rpo_core.scenario.scenario import Scenario
from rpo_core.wire import interfaces
from rpo_core.wire.statuses import (
    ABORTED,
    ENDED,
    PAUSED,
    WAITING,
    AssuranceStatus,
    GuidanceStatus,
    Manifest,
    RunStatus,
)
from rpo_core.world.zones import Zone, zones_of

Vector = tuple[float, ...]
Said = TypeVar('Said', GuidanceStatus, AssuranceStatus)

_LARGEST = 1e100
"""A larger number of a foreign message is not shown: its square is beyond all floats."""

_MOST_SAID = 200
"""Statuses of guidance, and of assurance, that are kept."""

SILENCE_S = 3.0
"""A run in progress without a state for so long is silent."""


class Trail:
    """Positions (n, 3) [m], target LVLH, n <= most; from the first to the last.

    A position is kept if it is `spacing_m` away from the last one kept. If there are too many,
    every second one is deleted and the spacing doubles: the path stays complete, but coarser.
    """

    def __init__(self, most: int = 1000) -> None:
        self.most = most
        self.points: list[Vector] = []
        self.spacing_m = 0.02

    def add(self, position_m: Vector) -> None:
        """Take a position (3,)."""
        if self.points and math.dist(self.points[-1], position_m) < self.spacing_m:
            return
        self.points.append(position_m)
        if len(self.points) > self.most:
            del self.points[1::2]
            self.spacing_m *= 2.0


@dataclass
class LiveFlight:
    """The flight as far as messages came. Foreign texts are printable here.

    scenario, controller : by their manifests; None where they are not known, or of another kind
    signals : name -> numbers, of the newest tick, or of the last one that had them
    zones : about the target, as the scenario has them
    phases, acts : what guidance and assurance said, in its order
    flights : number of flights since the start of the viewer
    clock : wall time [s]
    """

    clock: Callable[[], float] = time.monotonic
    trail: Trail = field(default_factory=Trail)
    scenario: Scenario | None = None
    controller: AnyController | None = None
    controller_name: str = ''
    zones: list[Zone] = field(default_factory=list)
    phase: str = ''
    reason: str = ''
    stamp_ns: int = 0
    signals: dict[str, Vector] = field(default_factory=dict)
    phases: list[GuidanceStatus] = field(default_factory=list)
    acts: list[AssuranceStatus] = field(default_factory=list)
    flights: int = 0
    _texts: dict[str, str] = field(default_factory=dict)
    _heard_s: float = 0.0

    def on_signals(self, stamp_ns: int, signals: Mapping[str, Vector]) -> bool:
        """Take signals of a tick, its state among them; return whether they are shown.

        Numbers beyond all floats, and a state that was taken already, are not.
        """
        if any(abs(x) > _LARGEST for values in signals.values() for x in values):
            return False
        if not self.signals or stamp_ns < self.stamp_ns:
            self.flights += 1
            self.trail = Trail()
            self.signals, self.stamp_ns = {}, stamp_ns - 1
            # What guidance and assurance say at once may be there before the first state.
            self.phases, self.acts = self.phases[-1:], self.acts[-1:]
        if stamp_ns == self.stamp_ns:
            return False
        self.stamp_ns, self._heard_s = stamp_ns, self.clock()
        self.signals = {**self.signals, **signals}
        self.trail.add(self.position_m)
        return True

    def on_status(self, status: RunStatus) -> None:
        """Take a run_status."""
        self.phase, self.reason = status.phase, status.reason

    def on_guidance(self, status: GuidanceStatus) -> None:
        """Take a guidance_status."""
        self.phases = _then(self.phases, status)

    def on_assurance(self, status: AssuranceStatus) -> None:
        """Take an assurance_status."""
        self.acts = _then(self.acts, status)

    def on_manifest(self, manifest: Manifest) -> None:
        """Take the manifest of a node; of plant and controller the files, where they are ours."""
        role, values = manifest.role, manifest.values
        file = {'plant': 'scenario', 'controller': 'controller'}.get(role)
        text = values.get(f'file.{file}.yaml', '')
        if file is None or self._texts.get(role) == text:
            return  # said again each second
        self._texts[role] = text
        if role == 'controller':
            name = values.get('parameter.controller', '')
            self.controller, self.controller_name = None, printable(name, MOST_NAME)
            with suppress(InputError):
                self.controller = files.loads(text, controllers.parse, 'controller')
            return
        self.scenario, self.zones = None, []
        with suppress(InputError):
            found = files.loads(text, scenarios.parse, 'scenario')
            if isinstance(found, Scenario):
                self.scenario, self.zones = found, zones_of(found)

    @property
    def position_m(self) -> Vector:
        """Position (3,) of the newest state, target LVLH; empty if none came."""
        return self.signals.get(interfaces.RELATIVE_STATE, ())[:3]

    @property
    def chaser_attitude(self) -> Vector | None:
        """Quaternion and rate (7,) of a chaser that has an attitude; None where it has none."""
        turns = self.scenario is not None and self.scenario.attitude is not None
        return self.signals.get(interfaces.CHASER_ATTITUDE) if turns else None

    @property
    def tick(self) -> int:
        """Tick of the newest state; the nearest of the flight where it has another stamp."""
        if self.scenario is None:
            return 0
        tick = (self.stamp_ns - self.scenario.epoch_ns) // self.scenario.dt_ns
        return min(max(0, tick), self.scenario.ticks)

    @property
    def motion(self) -> Motion | None:
        """How the target turns; None where it has no attitude."""
        if self.scenario is None or self.scenario.target is None:
            return None
        return motion_of(self.scenario.target, self.scenario)

    @property
    def attitude(self) -> Attitude | None:
        """Quaternion and rate of the target at the newest state; None where it has no attitude."""
        return self.motion.attitude(self.tick) if self.motion is not None else None

    @property
    def frame(self) -> Frame | None:
        """The same as a frame."""
        return self.motion.frame(self.tick) if self.motion is not None else None

    @property
    def zones_now(self) -> list[Zone]:
        """The zones at the newest state, target LVLH."""
        f = self.frame
        return self.zones if f is None else [in_lvlh(zone, f) for zone in self.zones]

    @property
    def docking_axis(self) -> Vector | None:
        """Unit vector (3,) of the chaser's docking axis, target LVLH; None: it has no attitude."""
        attitude = self.chaser_attitude
        if self.scenario is None or attitude is None:
            return None
        return tuple(turned(docking_axis(self.scenario), attitude[:4]).tolist())

    @property
    def force_n(self) -> Vector | None:
        """Force (3,), target LVLH: exerted where it is published, else commanded; None: neither."""
        if (exerted := self.signals.get(interfaces.EXERTED_FORCE)) is not None:
            return exerted
        rows = interfaces.rows_so_far()
        said = [r.name for r in rows if r.carries == interfaces.COMMAND and r.name in self.signals]
        return self.signals[said[-1]] if said else None

    def sentence(self, topic: str) -> str:
        """Return the status of the run in a sentence; `topic` is the topic of its states."""
        if not self.signals and not self.phase:
            return f'no message on {topic} yet: is a plant running, in this namespace and domain?'
        silence_s = self.clock() - self._heard_s
        if self.signals and self.phase not in (*ENDED, PAUSED) and silence_s > SILENCE_S:
            return f'no message on {topic} for {silence_s:.0f} s'
        return f'{self.phase or "running"}: {self.reason}' if self.reason else 'running'

    def card(self, topic: str) -> str:
        """Return what stands before the picture; '' where the flight goes on or has finished."""
        said = self.sentence(topic)
        if self.signals and self.scenario is None:
            away_m = math.hypot(*self.position_m)
            return (
                f'A flight of another kind of plant, {away_m:.1f} m from the target: '
                f'its manifest has no scenario that this page can draw ({said}).'
            )
        halted = self.phase in (WAITING, PAUSED, ABORTED) or said.startswith('no message')
        return f'{said[:1].upper()}{said[1:]}' if halted else ''


def _then(before: list[Said], status: Said) -> list[Said]:
    """Return statuses with one more; one of another flight is the first."""
    if before and status.tick < before[-1].tick:
        return [status]
    return [*before, status][-_MOST_SAID:]
