# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Guidance: section `guidance` of a scenario, and the reference that the controller follows.

A plan is a list of legs, flown one after the other. Each leg begins where the one before ended, the
first one at the state of the chaser. After the last leg the reference stays where that one ends. A
plan is flown without errors before a flight: what cannot be flown is refused.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from math import inf
from typing import Annotated, Any, NamedTuple

import numpy as np

from rpo_core.attitude.attitude_kernels import frame_at, moving_with, seen_from, to_lvlh
from rpo_core.attitude.target import known_motion
from rpo_core.files import codec
from rpo_core.files.codec import unless_default
from rpo_core.files.validation import (
    Checked,
    InputError,
    Name,
    choice,
    optional,
    real,
    shown,
    vector3,
)
from rpo_core.guidance.legs import (
    SEGMENTS,
    Coasting,
    Flown,
    FlyingAround,
    Moving,
    Resting,
    Straight,
    Times,
    Transferring,
    Turning,
    Vehicle,
)
from rpo_core.guidance.transfers import Floats, Limits, TooMuch, at_port, bounded, spend
from rpo_core.kernels.arithmetic import State, Vector, norm
from rpo_core.kernels.calls import ASK
from rpo_core.kernels.jit import as_table, kernel, step_kernel
from rpo_core.scenario.scenario import MAX_VELOCITY_M_S, Scenario
from rpo_core.stage import KernelStage, Place, Section, Signal, register
from rpo_core.wire import interfaces
from rpo_core.world import cw
from rpo_core.world.starts import MAX_POSITION_M
from rpo_core.world.zones import NO_CORRIDOR, Corridor, Zone, Zones

TRANSFER, STRAIGHT, FLY_AROUND, HOLD = 'transfer', 'straight', 'fly_around', 'hold'
KINDS = (TRANSFER, STRAIGHT, FLY_AROUND, HOLD)

LVLH, TARGET = FRAMES = ('lvlh', 'target')

AUTO, COMMAND = 'auto', 'command'
"""Who ends a hold: its own conditions, or the command `go` while they are met."""

GO_ON, ABORT = 'go', 'abort'
"""What a hold does when its time is up."""

MAX_LEGS = 50

_position = partial(vector3, unit='m', bound=MAX_POSITION_M)
_velocity = partial(vector3, unit='m/s', bound=MAX_VELOCITY_M_S)
_time = partial(real, unit='s', least=0.0, most=1e6)
_some_time = partial(real, unit='s', above=0.0, most=1e6)
_speed = partial(real, unit='m/s', least=1e-6, most=10.0)
_way = partial(real, unit='m', least=0.0, most=100.0)
_some_mass = partial(real, unit='kg', above=0.0, most=1e6)


Point = Annotated[Vector | None, partial(optional, check=_position)]
Time = Annotated[float | None, partial(optional, check=_some_time)]
Speed = Annotated[float | None, partial(optional, check=_speed)]


@dataclass(frozen=True, kw_only=True)
class Leg(Checked):
    """One leg of a plan.

    kind : `transfer`, least energy in `duration_s`, around the keep-out sphere; with `burn_s` the
        thrusters fire at its two ends only. `straight`, at `speed_m_s`. `fly_around`, on an arc
        about the target, its radius changing evenly. `hold`, at one point
    frame : `lvlh`, or the axes of the `target`, which turn: a line, an arc or a hold is flown in
        them, a transfer to a point that moves with them. A hold is in those of the leg before
    to_m : (3,) where it ends, in its frame
    arrive_m_s : (3,) velocity there, of a transfer, in its frame
    corridor_s : so long before its end a transfer enters the corridor
    ease_s : so long before its end the force of a transfer begins to fall to zero, so that it does
        not end with a step. Such a transfer is planned tick by tick, and around nothing
    end_speed_m_s : of a straight leg, where it ends
    within_m, within_m_s : GO is given only while error and speed are no larger
    dwell_s : least time of a hold; timeout_s : longest, then `on_timeout`
    """

    name: Name
    kind: Annotated[str, partial(choice, known=KINDS)]
    frame: Annotated[str, partial(choice, known=FRAMES)] = unless_default(LVLH)
    to_m: Point = None
    arrive_m_s: Annotated[Vector, _velocity] = (0.0, 0.0, 0.0)
    duration_s: Time = None
    corridor_s: Time = None
    burn_s: Time = None
    ease_s: Time = unless_default(None)
    speed_m_s: Speed = None
    end_speed_m_s: Annotated[float, partial(real, unit='m/s', least=0.0, most=10.0)] = 0.0
    dwell_s: Annotated[float, _time] = 0.0
    go: Annotated[str, partial(choice, known=(AUTO, COMMAND))] = AUTO
    within_m: Annotated[float, partial(real, unit='m', above=0.0, most=1e3)] = 0.5
    within_m_s: Annotated[float, partial(real, unit='m/s', above=0.0, most=10.0)] = 0.05
    timeout_s: Time = None
    on_timeout: Annotated[str, partial(choice, known=(GO_ON, ABORT))] = ABORT

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, kinds in _KINDS_OF.items():
            if getattr(self, name) != _DEFAULTS[name] and self.kind not in kinds:
                raise InputError(
                    f'`{name}` needs a leg of kind {" or ".join(kinds)}; '
                    f'{self.name} is of kind {self.kind}'
                )
        for name in _NEEDED[self.kind]:
            if getattr(self, name) is None:
                raise InputError(f'`{name}` is missing; a leg of kind {self.kind} needs it')
        if self.kind == STRAIGHT and self.speed_m_s and self.end_speed_m_s > self.speed_m_s:
            raise InputError(
                f'`end_speed_m_s` must be at most `speed_m_s` = {self.speed_m_s!r}; '
                f'got {self.end_speed_m_s!r}'
            )
        if self.burn_s and self.duration_s and 2.0 * self.burn_s > self.duration_s:
            raise InputError(
                f'`burn_s` must be at most half of `duration_s` = {self.duration_s!r}; '
                f'got {self.burn_s!r}'
            )
        if self.ease_s and self.duration_s and self.ease_s > self.duration_s:
            raise InputError(
                f'`ease_s` must be at most `duration_s` = {self.duration_s!r}; got {self.ease_s!r}'
            )
        if self.ease_s and self.burn_s:
            raise InputError(f'`ease_s` and `burn_s` exclude each other; {self.name} has both')


_OF_KIND = {
    TRANSFER: ('frame', 'arrive_m_s', 'duration_s', 'corridor_s', 'burn_s', 'ease_s'),
    STRAIGHT: ('frame', 'speed_m_s', 'end_speed_m_s'),
    FLY_AROUND: ('frame', 'speed_m_s'),
    HOLD: ('dwell_s', 'go', 'within_m', 'within_m_s', 'timeout_s', 'on_timeout'),
}
_NEEDED = {
    TRANSFER: ('to_m', 'duration_s'),
    STRAIGHT: ('to_m', 'speed_m_s'),
    FLY_AROUND: ('to_m', 'speed_m_s'),
    HOLD: (),
}
_KINDS_OF = {
    name: [kind for kind, names in _OF_KIND.items() if name in names]
    for names in _OF_KIND.values()
    for name in names
}
_DEFAULTS = {name: Leg.__dataclass_fields__[name].default for name in _KINDS_OF}


@dataclass(frozen=True, kw_only=True)
class Guidance(Checked):
    """Settings of guidance.

    keep_out_m, port_m, corridor : as in section `zones`, unless they differ for guidance
    margin_m : by which transfers plan a larger sphere, for the errors of the flight
    retreat_m : (3,) where `retreat` leads
    abort_offset_m : by how much `abort` goes below (ahead of the target) or above (behind it), from
        where relative motion carries the chaser away without a force
    abort_s : time of the transfer there
    force_share : of the thrusters' force that the reference may need
    past_port_m : so far the reference goes on past the port, as it arrived there; 0: it stays
        there. A chaser that has come to the port, within so much, gets no more force: it has docked
    mass_kg : as guidance takes it; None: that of the scenario
    """

    legs: tuple[Leg, ...]
    keep_out_m: Annotated[float, partial(real, unit='m', least=0.0, most=1e4)] = 0.0
    margin_m: Annotated[float, partial(real, unit='m', least=0.0, most=1e3)] = 3.0
    corridor: Corridor = NO_CORRIDOR
    port_m: Annotated[Vector, _position] = (0.0, 0.0, 0.0)
    retreat_m: Point = None
    abort_offset_m: Annotated[float, partial(real, unit='m', above=0.0, most=1e3)] = 40.0
    abort_s: Annotated[float, _some_time] = 300.0
    force_share: Annotated[float, partial(real, unit='', least=1e-6, most=1.0)] = 0.6
    past_port_m: Annotated[float, _way] = unless_default(0.0)
    mass_kg: Annotated[float | None, partial(optional, check=_some_mass)] = unless_default(None)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 1 <= len(self.legs) <= MAX_LEGS:
            raise InputError(f'`legs` must be 1 to {MAX_LEGS} legs; got {shown(list(self.legs))}')
        for leg in self.legs:
            if leg.corridor_s and not self.corridor.from_m:
                raise InputError(f'`corridor_s` of leg {leg.name} needs `corridor.from_m`')
            if leg.ease_s and self.keep_out_m:
                raise InputError(
                    f'`ease_s` of leg {leg.name} needs a plan without a keep-out sphere; '
                    f'got `keep_out_m` = {self.keep_out_m!r}'
                )
        for i, leg in enumerate(self.legs):
            if leg.frame == TARGET and leg.kind != TRANSFER and not (i and self.turns(i - 1)):
                raise InputError(
                    f'`frame` target of leg {leg.name} needs a leg before it that ends in this '
                    'frame, a transfer for one'
                )
            if leg.frame == LVLH and leg.kind in (STRAIGHT, FLY_AROUND) and i and self.turns(i - 1):
                raise InputError(
                    f'leg {leg.name} must be a transfer, or have `frame` target as the leg before'
                )
        names = [leg.name for leg in self.legs]
        for name in names:
            if names.count(name) > 1:
                raise InputError(f'`legs` must have names of their own; {name} is there twice')

    def turns(self, i: int) -> bool:
        """Return whether leg i ends in the axes of the target."""
        while self.legs[i].kind == HOLD and i > 0:
            i -= 1
        return self.legs[i].frame == TARGET

    def zones(self, scenario: Any) -> Zone:
        """Return what views draw: sphere, corridor, holds, retreat; of a target what it sees."""
        points, end_m, lvlh = {}, None, scenario.target is None
        for i, leg in enumerate(self.legs):
            end_m = leg.to_m or end_m
            if leg.kind == HOLD and end_m is not None and (lvlh or self.turns(i)):
                points[leg.name] = end_m
        if self.retreat_m is not None and lvlh:
            points['retreat'] = self.retreat_m
        zones = Zones(keep_out_m=self.keep_out_m, port_m=self.port_m, corridor=self.corridor)
        return zones.zone(points)

    @staticmethod
    def of_zones(_document: Any, zones: Zones) -> Mapping[str, Any]:
        """Return the fields that are as the zones of the scenario, unless the section has them."""
        return codec.to_mapping(zones)


GO, STOP, RETREAT = 'go', 'hold', 'retreat'
COMMANDS = (GO, STOP, RETREAT, ABORT)

ARRIVED, STOPPED, RETREATED, ABORTING, DRIFTING, DOCKED = (
    'arrived', 'stopped', 'retreating', 'aborting', 'drifting', 'docked',
)  # fmt: skip
"""Phases beside the legs of the plan, which have the names of the legs."""


CONE_SHARE = 0.7
"""Share of the corridor's width that a transfer plans with; the rest is for the flight."""


class Change(NamedTuple):
    """A phase that begins.

    tick : of the first reference of the phase
    phase : its name
    reason : why it begins
    """

    tick: int
    phase: str
    reason: str


class Drifting:
    """Free drift: the reference is the chaser itself, so that nobody commands a force."""

    ticks = None


FAR = 2**62
"""A tick that never comes."""

BLOCK = 1024
"""Most rows that are computed ahead: a node has them within its tick, interpreted too."""

DUE, OVER, READY, TIMED_OUT, AT_PORT = range(1, 6)
"""Why the kernel asks: a command is due; the rows or the leg end; a hold may end, or its time is
up; the chaser is at the port."""

DWELL, ERROR, SPEED = range(1, 4)
"""What a hold lacks."""

WAITS, MAY_END = 1, 2
"""A hold waits for GO, or for its own conditions alone."""


@dataclass(slots=True)
class Port:
    """Settings of the kernel `guide`: port and its axis, and how far behind it a chaser docks."""

    dt_s: float
    port_m: Vector
    ahead: Vector
    past_port_m: float


@dataclass(slots=True)
class UnderWay:
    """Memory of the kernel `guide`: the phase under way.

    tick, reference : the last, (6,) [m, m/s]; before the first the tick is -1
    state : the last of a hold, and the last that was asked of
    why : why the kernel asks
    begins, first, until : tick at which the phase begins, tick of the first row, tick at which the
        rows end
    commanded : tick of the next command
    holds : 0, WAITS or MAY_END
    dwell_s, within_m, within_m_s, timeout_s : when it may end, as its leg says
    docks : tick from which the chaser docks at the port
    rows : (n, 9) references [m, m/s] and forces [N] tick by tick, the last for the ticks that
        follow; empty: it drifts
    axes : (n, 15) of the target at these ticks, if it turns and the chaser docks
    """

    state: Annotated[list[float], 6]
    reference: Annotated[list[float], 6]
    rows: list[list[float]]
    axes: list[list[float]]
    tick: int = -1
    why: int = 0
    begins: int = 0
    first: int = 0
    until: int = 0
    commanded: int = FAR
    holds: int = 0
    dwell_s: float = 0.0
    within_m: float = 0.0
    within_m_s: float = 0.0
    timeout_s: float = 0.0
    docks: int = FAR


@kernel
def lacking(
    held_s: float, error_m: float, speed_m_s: float,
    dwell_s: float, within_m: float, within_m_s: float,
) -> int:  # fmt: skip
    """Return what a hold lacks to end, 0 if nothing."""
    if held_s < dwell_s:
        return DWELL
    if error_m > within_m:
        return ERROR
    return SPEED if speed_m_s > within_m_s else 0


@step_kernel
def why_asked(tick: int, u: Any, p: Any, m: Any) -> int:
    """Return why the stage must plan before a tick; 0 if it need not."""
    if tick >= m.commanded:
        return DUE
    if tick >= m.until:
        return OVER
    if m.holds != 0:
        held_s = (tick - m.begins) * p.dt_s
        if held_s >= m.timeout_s:
            return TIMED_OUT
        if m.holds != WAITS and m.tick >= 0:
            r = m.reference
            error = norm(u[0] - r[0], u[1] - r[1], u[2] - r[2])
            speed = norm(u[3] - r[3], u[4] - r[4], u[5] - r[5])
            if lacking(held_s, error, speed, m.dwell_s, m.within_m, m.within_m_s) == 0:
                return READY
    if tick >= m.docks:
        port = p.port_m[0], p.port_m[1], p.port_m[2]
        ahead = p.ahead[0], p.ahead[1], p.ahead[2]
        if len(m.axes) > 0:
            axes = frame_at(m.axes[tick - m.first])
            port, ahead = to_lvlh(port, axes), to_lvlh(ahead, axes)
        px, py, pz = port
        ax, ay, az = ahead
        if at_port(u[0], u[1], u[2], px, py, pz, ax, ay, az, p.past_port_m):
            return AT_PORT
    return 0


@step_kernel
def guide(tick: int, u: Any, p: Any, m: Any, y: Any) -> int:
    """Row (tick - first) of the phase under way: from a state u (6,) [m, m/s], target LVLH.

    y (9,) : reference [m, m/s] and the force [N] that it needs, target LVLH

    ASK where a command is due, the rows or the leg end, a hold may end (error and speed against the
    reference of the tick before), or the chaser is at the port.
    """
    why = why_asked(tick, u, p, m)
    if why != 0:
        m.why = why
        return ASK
    i, last = tick - m.first, len(m.rows) - 1
    if last < 0:
        y[0], y[1], y[2], y[3], y[4], y[5] = u[0], u[1], u[2], u[3], u[4], u[5]
        y[6], y[7], y[8] = 0.0, 0.0, 0.0
    else:
        row = m.rows[i if i < last else last]
        y[0], y[1], y[2], y[3], y[4], y[5] = row[0], row[1], row[2], row[3], row[4], row[5]
        y[6], y[7], y[8] = row[6], row[7], row[8]
    r = m.reference
    r[0], r[1], r[2], r[3], r[4], r[5] = y[0], y[1], y[2], y[3], y[4], y[5]
    if m.holds != 0:
        s = m.state
        s[0], s[1], s[2], s[3], s[4], s[5] = u[0], u[1], u[2], u[3], u[4], u[5]
    m.tick = tick
    return 0


class GuidanceStage(KernelStage):
    """Flies a plan: phase by phase, with the commands go, hold, retreat and abort.

    The kernel follows the leg under way and asks where one ends: the stage plans the next.

    changes : the phases so far
    """

    name = 'guidance'
    inputs = (interfaces.STATE,)
    outputs = (interfaces.REFERENCE_STATE, interfaces.REFERENCE_FORCE)
    memory_ticks = None
    kernel = guide

    def __init__(self, settings: Guidance, scenario: Scenario) -> None:
        self.settings = settings
        n, mass_kg, dt_s = scenario.mean_motion_rad_s, settings.mass_kg, scenario.dt_s
        step = scenario.step if mass_kg is None else cw.discretise(n, mass_kg, dt_s)
        limit_n = settings.force_share * scenario.max_force_n
        self._vehicle = Vehicle(n, mass_kg or scenario.mass_kg, dt_s, limit_n, step)
        self._motion = known_motion(scenario)
        self._radius_m = settings.keep_out_m and settings.keep_out_m + settings.margin_m
        goal = scenario.goal
        self._goal = (scenario.goal_state, goal.force_n if goal is not None else ())
        port = Port(dt_s, settings.port_m, settings.corridor.ahead, settings.past_port_m)
        super().__init__(port, UnderWay([0.0] * 6, [0.0] * 6, [], []))
        self.reset()

    def passes_on(self) -> tuple[int | Signal, ...]:
        """Return the goal of the scenario, as a controller without guidance has it.

        Of a target that turns the goal turns too: then the chaser itself, which needs no force.
        """
        return self._goal if self._motion is None else (0, ())

    def reset(self) -> None:
        """Begin the plan anew."""
        super().reset()
        self.commands: dict[int, str] = {}
        self.changes: list[Change] = []
        self._next = 0  # leg that follows
        self._leg: Leg | None = None
        self._flown: Flown | Drifting | None = None
        self._since = 0
        self._obeyed = -1  # tick up to which commands were obeyed
        self._go = False

    def command(self, name: str) -> str:
        """Take a command for the next tick; return why it is refused, '' if it is not."""
        reason = self.refusal(name)
        if not reason:
            self.take_event(self.next_tick, name)
        return reason

    @property
    def next_tick(self) -> int:
        """The tick that comes."""
        return int(self.m.tick) + 1

    def take_event(self, tick: int, state: str) -> None:
        """Take a command that a log tells of."""
        if state in COMMANDS:
            self.commands[tick] = state
            self._announce()

    def _announce(self) -> None:
        """Let the kernel know the tick of the next command."""
        self.m.commanded = min((t for t in self.commands if t > self._obeyed), default=FAR)

    def refusal(self, name: str) -> str:
        """Return why a command cannot be followed now; '' if it can."""
        phase = self.changes[-1].phase if self.changes else 'waiting'
        if phase in (ABORTING, DRIFTING):
            return f'guidance is {phase}: an abort is not taken back'
        if phase == DOCKED:
            return 'the chaser has docked'
        if name == RETREAT and self.settings.retreat_m is None:
            return 'the plan has no `retreat_m`'
        if name != GO:
            return ''
        if self._leg is not None and self._leg.kind == HOLD:
            return self._unready(self._leg)
        return '' if phase in (STOPPED, RETREATED) else f'`go` ends a hold; the phase is {phase}'

    def answer(self, tick: int, u: Any) -> None:
        """Follow a command or what ends the phase under way, and write the rows that follow."""
        self.m.state = u[:6]
        if self._flown is None:
            self._begin_leg(tick, self._seen, 'the flight begins')
        elif self.m.why == DUE:
            self._obeyed = tick
            if tick in self.commands:
                self._obey(tick, self.commands[tick])
        elif self.m.why == AT_PORT:
            self._enter(tick, DOCKED, 'the chaser is at the port', Drifting())
        elif self.m.why != OVER or self._is_over(tick):
            self._follow(tick)
        self._announce()
        self._write(tick)

    def answer_ahead(self, ticks: int, u: Any) -> None:
        """Plan all legs, from the state of tick 0 on; it ends where the chaser docks."""
        waits = [leg.name for leg in self.settings.legs if leg.kind == HOLD]
        if waits:
            raise InputError(f'leg {waits[0]} is a hold: when it ends follows from the flight')
        m, docks, rows = self.m, FAR, np.empty((ticks + 1, 9))
        x, y, z, vx, vy, vz = map(float, u)
        for tick, count, flown, _ in self.phases((x, y, z, vx, vy, vz), ticks):
            docks = min(docks, tick) if self._docks else FAR
            flown.fill(rows[tick : tick + count])
        m.rows, m.docks, m.until = as_table(rows), docks, FAR if self.rests else ticks + 1
        if docks < FAR and self._motion is not None:
            m.axes, m.until = as_table(self._motion.frames(ticks + 1)), ticks + 1

    def _write(self, tick: int) -> None:
        """Write the phase under way into the memory of the kernel, from a tick on."""
        m, flown, leg = self.m, self._flown, self._leg
        m.first, m.begins, m.until = tick, self._since, FAR
        m.rows, m.axes, m.holds, m.docks = [], [], 0, tick if self._docks else FAR
        if leg is not None and leg.kind == HOLD:
            m.holds = MAY_END if leg.go == AUTO or self._go else WAITS
            m.dwell_s, m.within_m, m.within_m_s = leg.dwell_s, leg.within_m, leg.within_m_s
            m.timeout_s = inf if leg.timeout_s is None else leg.timeout_s
        if flown is None or isinstance(flown, Drifting):
            return
        behind, ticks = tick - self._since, BLOCK
        if flown.ticks is not None:
            ticks = min(ticks, flown.ticks - behind)
        rests = isinstance(flown, Resting)
        rows = as_table(np.empty((1 if rests else ticks, 9)))
        flown.fill(rows, behind)
        m.rows = rows
        if not rests:
            m.until = tick + ticks
        if self._docks and self._motion is not None:
            m.axes, m.until = as_table(self._motion.frames(tick + ticks)[tick:]), tick + ticks

    @property
    def _seen(self) -> State:
        """The state of the last tick."""
        x, y, z, vx, vy, vz = map(float, self.m.state)
        return x, y, z, vx, vy, vz

    @property
    def _reference(self) -> State | None:
        """The reference of the last tick; None before the first."""
        if self.m.tick < 0:
            return None
        x, y, z, vx, vy, vz = map(float, self.m.reference)
        return x, y, z, vx, vy, vz

    @property
    def rests(self) -> bool:
        """Whether all legs are flown, and the reference stays as it is."""
        return isinstance(self._flown, Resting) and self.changes[-1].phase == ARRIVED

    @property
    def _docks(self) -> bool:
        """Whether the last leg is flown, or over, and docking ends it."""
        if not self.settings.past_port_m or self._next < len(self.settings.legs):
            return False
        return self._leg is not None or self.changes[-1].phase == ARRIVED

    def port(self, tick: int) -> tuple[float, ...]:
        """Return where port [m] and axis of the corridor point at a tick (6,), target LVLH."""
        port_m, ahead = self.settings.port_m, self.settings.corridor.ahead
        if self._motion is None:
            return (*port_m, *ahead)
        frame = self._motion.frame(tick)
        return (*to_lvlh(port_m, frame), *to_lvlh(ahead, frame))

    def phases(self, start: State, ticks: int) -> Iterator[tuple[int, int, Any, bool]]:
        """Yield the phases of a plan without holds and commands, up to a tick.

        They do not depend on the flight, but for its start as guidance sees it, and until it docks.
        Of each its first tick, its ticks, how it is flown, and whether all legs but it are flown.
        """
        tick = 0
        self.reset()
        self._begin_leg(0, start, '')
        while tick <= ticks:
            while self._is_over(tick):
                self._follow(tick)
            flown: Any = self._flown
            left = ticks + 1 - tick
            count = left if flown.ticks is None else min(flown.ticks, left)
            yield tick, count, flown, self._next == len(self.settings.legs)
            tick += count

    def rows(self, start: State, ticks: int) -> Floats:
        """Return the references and forces (ticks + 1, 9) of `phases`."""
        rows = np.empty((ticks + 1, 9))
        for tick, count, flown, _ in self.phases(start, ticks):
            flown.fill(rows[tick : tick + count])
        return rows

    def _is_over(self, tick: int) -> bool:
        """Return whether the leg has no more ticks."""
        ticks = self._flown.ticks if self._flown is not None else None
        return ticks is not None and tick - self._since >= ticks

    def _unready(self, leg: Leg) -> str:
        """Return why a hold cannot end; '' if it can."""
        m = self.m
        if m.tick < 0:
            return 'no state has come'
        held_s = (m.tick - self._since) * self.p.dt_s
        miss = [s - r for s, r in zip(m.state, m.reference, strict=True)]
        error, speed = norm(*miss[:3]), norm(*miss[3:])
        found = lacking(held_s, error, speed, leg.dwell_s, leg.within_m, leg.within_m_s)
        return {
            DWELL: f'`dwell_s` = {leg.dwell_s:g} s is not over: {held_s:g} s',
            ERROR: f'the error is {error:.3g} m, more than `within_m` = {leg.within_m:g} m',
            SPEED: f'the speed is {speed:.3g} m/s, more than `within_m_s` = {leg.within_m_s:g} m/s',
        }.get(found, '')

    def _follow(self, tick: int) -> None:
        """Begin what follows the phase that is over."""
        leg = self._leg
        if self.changes[-1].phase == ABORTING:
            self._enter(tick, DRIFTING, 'clear of the target', Drifting())
        elif leg is not None and leg.kind == HOLD:
            timed_out = self.m.why == TIMED_OUT
            if timed_out and leg.on_timeout == ABORT:
                self._obey(tick, ABORT, f'{leg.name} took `timeout_s` = {leg.timeout_s:g} s')
            else:
                self._begin_leg(tick, None, 'time is up' if timed_out else 'GO')
        elif leg is None:  # stopped, or back at the retreat
            turns = isinstance(self._flown, Turning)
            at = self._start_of(tick, None, turns)
            self._flown = self._fly(tick, turns, Resting, at[:3], self._vehicle)
            self._since = tick
        else:
            self._begin_leg(tick, None, f'{leg.name} is flown')

    def _end(self, tick: int) -> State:
        """Return the reference where the phase ends."""
        if isinstance(self._flown, (Drifting, type(None))):
            return self._reference or (0.0,) * 6
        ticks = self._flown.ticks
        return self._flown.at(tick - self._since if ticks is None else ticks)[0]

    def _begin_leg(self, tick: int, start: State | None, reason: str) -> None:
        """Begin the leg that follows; start : None, where the phase before ends."""
        settings = self.settings
        if self._next == len(settings.legs):
            turns = settings.turns(self._next - 1)
            start = self._start_of(tick, start, turns)
            flown = self._fly(tick, turns, Resting, start[:3], self._vehicle)
            if settings.past_port_m and norm(*start[3:]) > 0.0:
                past_m = settings.past_port_m
                flown = self._fly(tick, turns, Coasting, start, self._vehicle, past_m)
            self._enter(tick, ARRIVED, reason, flown)
            return
        leg = settings.legs[self._next]
        self._next += 1
        self._enter(tick, leg.name, reason, self._flying(tick, leg, start))
        self._leg = leg

    def _start_of(self, tick: int, state: State | None, turns: bool) -> State:
        """Return the reference (6,) with which a phase begins, in the target's axes if it turns.

        What was planned in these axes has its own bits there, not those by way of LVLH.
        state : None, that in which the phase before ends
        """
        if not turns or self._motion is None:
            return state or self._end(tick)
        if isinstance(self._flown, Turning):
            return self._flown.seen(tick - self._since)
        leg = self._leg
        if leg is not None and leg.kind == TRANSFER and leg.to_m is not None:
            return (*leg.to_m, *leg.arrive_m_s)
        return seen_from(state or self._end(tick), self._motion.frame(tick))

    def _fly(self, tick: int, turns: bool, kind: type[Moving], *args: Any) -> Flown:
        """Return a leg under way, in the target's axes if it turns."""
        if not turns or self._motion is None:
            return kind(*args)
        return Turning(self._motion, tick, self._vehicle, kind, *args)

    def _flying(self, tick: int, leg: Leg, start: State | None) -> Flown:
        """Return a leg under way."""
        turns = self.settings.turns(self._next - 1)
        if leg.kind == TRANSFER:
            start = start or self._end(tick)
            end = (*(leg.to_m or start[:3]), *leg.arrive_m_s)
            times = Times(leg.duration_s or 0.0, leg.corridor_s, leg.burn_s, leg.ease_s)
            return self._transfer(tick, start, end, turns, times)
        start = self._start_of(tick, start, turns)
        to_m = leg.to_m if leg.to_m is not None else start[:3]
        fly, speed = partial(self._fly, tick, turns), leg.speed_m_s or 0.0
        if leg.kind == STRAIGHT:
            return fly(Straight, start, to_m, self._vehicle, speed, leg.end_speed_m_s)
        if leg.kind == FLY_AROUND:
            return fly(FlyingAround, start, to_m, self._vehicle, speed)
        return fly(Resting, to_m, self._vehicle)

    def _transfer(
        self, tick: int, start: State, end: State, turns: bool, times: Times
    ) -> Transferring:
        settings, corridor = self.settings, self.settings.corridor
        radius = self._radius_m
        # what begins or ends in the sphere passes through it; but to the corridor it comes no
        # nearer than it is
        range_m = begins = norm(*start[:3])
        if self._motion is not None and begins < radius:
            # its corridor turns away: the way out comes no nearer than where it can have stopped
            range_m, begins = range_m - self._stopping_m(start), inf
        free = times.corridor_s is None and min(begins, norm(*end[:3])) <= radius
        zones = Limits(
            0.0 if free else min(radius, range_m),
            None,
            ((*settings.port_m, *corridor.ahead),),
            corridor.slope * CONE_SHARE,
            corridor.from_m - norm(*settings.port_m),
        )

        def end_after(ticks: int) -> State:
            if not turns or self._motion is None:
                return end
            return moving_with(end, self._motion.frame(tick + ticks))

        def port_after(ticks: int) -> tuple[float, ...]:
            return self.port(tick + ticks)

        turning = port_after if self._motion is not None else None
        return Transferring(start, end_after, self._vehicle, times, zones, turning)

    def _stopping_m(self, state: State) -> float:
        """Return how much nearer [m] to the target a state comes before it can have stopped."""
        x, y, z, vx, vy, vz = state
        closing = max(-(x * vx + y * vy + z * vz) / norm(x, y, z), 0.0)
        return closing * closing / (2.0 * self._vehicle.acceleration_m_s2)

    def _obey(self, tick: int, command: str, reason: str = '') -> None:
        """Follow a command at a tick."""
        reason = reason or f'command `{command}`'
        now = self._reference or self._seen
        if command == GO:
            if self._leg is not None and self._leg.kind == HOLD:
                self._go = True
            else:
                self._begin_leg(tick, now, reason)
        elif command == STOP:
            turns = isinstance(self._flown, Turning)
            self._interrupt()
            self._enter(tick, STOPPED, reason, self._braking(tick, now, turns))
        elif command == RETREAT:
            self._interrupt()
            while self._next > 0 and self._begins_turning(self._next):
                self._next -= 1
            to_m = self.settings.retreat_m or now[:3]
            end: State = (*to_m, 0.0, 0.0, 0.0)
            flown = self._transfer(tick, now, end, False, Times(self.settings.abort_s))
            self._enter(tick, RETREATED, reason, flown)
        else:
            end = self._way_out(now)
            flown = self._transfer(tick, now, end, False, Times(self.settings.abort_s))
            self._enter(tick, ABORTING, reason, flown)

    def _interrupt(self) -> None:
        """Let `go` fly the leg under way again."""
        if self._leg is not None and self._leg.kind != HOLD:
            self._next -= 1

    def _begins_turning(self, i: int) -> bool:
        """Return whether leg i, or what follows the last one, begins in the target's axes."""
        legs = self.settings.legs
        if i < len(legs) and legs[i].kind == TRANSFER:
            return False
        return self._motion is not None and self.settings.turns(min(i, len(legs) - 1))

    def _braking(self, tick: int, now: State, turns: bool) -> Flown:
        x, y, z, vx, vy, vz = now = self._start_of(tick, now, turns)
        speed = norm(vx, vy, vz)
        if speed == 0.0:
            return self._fly(tick, turns, Resting, (x, y, z), self._vehicle)
        way = speed / (2.0 * self._vehicle.acceleration_m_s2)  # along v, so that v^2 / (2 a)
        to_m = (x + way * vx, y + way * vy, z + way * vz)
        return self._fly(tick, turns, Straight, now, to_m, self._vehicle, speed, 0.0)

    def _way_out(self, now: State) -> State:
        """Return a state (6,) from which relative motion carries the chaser away.

        Below the target an orbit is faster: ahead of it the chaser leaves forward. Behind the
        target it leaves backward, above it. vy = -3/2 n x keeps x as it is. Out of a corridor that
        turns it leaves on the side on which it is.
        """
        x, y, _, _, _, _ = now
        below = y >= 0.0
        if self._motion is not None and norm(*now[:3]) < self._radius_m:
            below = x < 0.0
        x = -self.settings.abort_offset_m if below else self.settings.abort_offset_m
        return x, y, 0.0, 0.0, -1.5 * self._vehicle.mean_motion_rad_s * x, 0.0

    def _enter(self, tick: int, phase: str, reason: str, flown: Flown | Drifting) -> None:
        self.changes.append(Change(tick, phase, reason))
        self._leg, self._flown, self._since, self._go = None, flown, tick, False


MOST_WORK = 4e8
"""Steps of work (`transfers.spend`) that the search of a plan may take; shipped plans take 4e6."""

PER_TICK = 400
"""Steps for each tick of a plan, about: so it may have a million ticks under way."""


class Rehearsal(NamedTuple):
    """A plan, flown without errors.

    references : (n, 6) [m, m/s]; forces : (n, 3) [N]; changes : its phases
    """

    references: list[State]
    forces: list[Vector]
    changes: list[Change]


def nominal(settings: Guidance, scenario: Scenario, *, to_rest: bool = False) -> Rehearsal:
    """Return the reference of a chaser that follows it exactly, each hold ended when it may be.

    to_rest : up to where it stays at the end of the plan; else to the end of the flight
    """
    legs = tuple(replace(leg, go=AUTO) if leg.kind == HOLD else leg for leg in settings.legs)
    stage = GuidanceStage(replace(settings, legs=legs), scenario)
    references: list[State] = []
    forces: list[Vector] = []
    state = scenario.start
    for tick in range(scenario.ticks + 1):
        spend(PER_TICK)
        reference, force = stage.step(tick, state)
        references.append(reference)  # type: ignore[arg-type]
        forces.append(force)  # type: ignore[arg-type]
        state = reference  # type: ignore[assignment]
        if to_rest and stage.rests:
            break
    return Rehearsal(references, forces, stage.changes)


@lru_cache(maxsize=64)
def check(settings: Guidance, scenario: Scenario) -> None:
    """Raise InputError if the plan of a scenario cannot be flown, with the number that fails."""
    try:
        with bounded(MOST_WORK):
            found = nominal(settings, scenario, to_rest=True)
    except TooMuch:
        raise InputError(
            f'`guidance` must have a plan that is found in {MOST_WORK:g} steps of work; got one '
            'that takes more: too many ticks, too little time or force (`duration_s`, '
            '`force_share`), or zones without a way between them'
        ) from None
    _check_durations(settings, scenario, found)
    cone = settings.corridor.cone(settings.port_m)
    mass_kg = settings.mass_kg or scenario.mass_kg
    seen = np.array(found.references)
    if scenario.target is not None:
        seen = scenario.target.known.seen(seen, scenario)
    starts = [change.tick for change in found.changes]
    for tick, (state, force) in enumerate(zip(seen.tolist(), found.forces, strict=True)):
        phase = found.changes[bisect_right(starts, tick) - 1].phase
        at = f'leg {phase}, {tick * scenario.dt_s:g} s'
        largest = max(abs(f) for f in force)
        if largest > settings.force_share * scenario.max_force_n * (1.0 + 1e-9):
            raise InputError(
                f'`guidance` must need at most `force_share` = {settings.force_share:g} of '
                f'`max_force_n` = {scenario.max_force_n:g} N; {at}: {largest:.4g} N, '
                f'{largest / mass_kg:.3g} m/s^2'
            )
        position, sphere = tuple(state[:3]), settings.keep_out_m
        distance = norm(*position)
        if distance >= sphere or (settings.past_port_m and phase in (ARRIVED, DOCKED)):
            continue
        if not settings.corridor.from_m:
            raise InputError(
                f'`guidance` must keep out of the sphere of `keep_out_m` = {sphere:g} m '
                f'without `corridor.from_m`; {at}: {distance:.4g} m from the target'
            )
        outside = cone.outside_m(position)
        if outside > 1e-9:
            raise InputError(
                f'`guidance` must keep out of the sphere of `keep_out_m` = {sphere:g} m but for '
                f'`corridor` to `port_m`; {at}: {distance:.4g} m from the target, {outside:.3g} m '
                'off it'
            )


def _check_durations(settings: Guidance, scenario: Scenario, found: Rehearsal) -> None:
    """Raise InputError if a transfer needs more force than it may, and so takes longer."""
    ends = [*(change.tick for change in found.changes[1:]), scenario.ticks + 1]
    for change, end in zip(found.changes, ends, strict=True):
        for leg in settings.legs:
            if leg.name == change.phase and leg.duration_s is not None:
                taken = (end - change.tick) * scenario.dt_s
                if taken > leg.duration_s * (1.0 + 1.0 / SEGMENTS) + scenario.dt_s:
                    limit = settings.force_share * scenario.max_force_n
                    raise InputError(
                        f'`duration_s` of leg {leg.name} must be about {taken:g} s for a force of '
                        f'at most {limit:g} N; got {leg.duration_s:g}'
                    )


register(Section('guidance', Guidance, Place.GUIDANCE, GuidanceStage, rehearse=check))
