# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The abort table in flight: which faults hold, who has the command, and where an abort leads.

A function of states, commands and events so far: `rpo verify` decides the same again. A fault holds
when n of its last m samples show it, the scheme of NASA's cFS Limit Checker.

The kernels count and command (`watch`, part of the kernel of assurance). Where a reaction begins
they ask: `AbortMachine` decides, plans, and writes what happens into the memory.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import pi
from typing import Annotated, Any, NamedTuple

from rpo_core.assurance import manoeuvre
from rpo_core.assurance.abort_table import (
    ABORT,
    DRIFT,
    HOLD,
    QUANTITIES,
    REACTIONS,
    RETREAT,
    WARN,
    AbortTable,
    Row,
)
from rpo_core.assurance.guard import Proof
from rpo_core.assurance.kernels import APPROACH, Guard, closing, in_corridor, speed_limit
from rpo_core.assurance.manoeuvre import PathModel, holding, reached, retreating, towards
from rpo_core.attitude.attitude_kernels import moving_with, seen_from, to_lvlh
from rpo_core.attitude.chaser import times
from rpo_core.kernels.arithmetic import State, Vector, norm
from rpo_core.kernels.jit import step_kernel
from rpo_core.kernels.records import rows_of
from rpo_core.stage import WITHOUT_COMMAND
from rpo_core.world import cw
from rpo_core.world.cw import CwStep, cw_step

ARM, INHIBIT, RESUME = 'arm', 'inhibit', 'resume'
COMMANDS = (ARM, INHIBIT, RESUME, HOLD, RETREAT, DRIFT, ABORT)

ARMED, INHIBITED, RESUMED, WARNED = 'armed', 'inhibited', 'resumed', 'warned'
PHASES = {HOLD: 'holding', RETREAT: 'retreating', DRIFT: 'drifting', ABORT: 'aborting'}
"""Reaction -> what `stage_status` says when it begins; nobody reads the controller's command."""

DECISIONS = (ARMED, INHIBITED, RESUMED, WARNED, *PHASES.values())

BURN_S = 90.0
"""An abort burns for at most so long after any thruster was stuck."""

BURN_DONE_M_S = 0.0005
"""The wanted velocity of an abort counts as reached to so much."""

ATTEMPTS = 3
"""A drift that is not clear is followed by another manoeuvre, up to so many in all."""

(
    _RANGE, _SPEED, _CLOSING, _OFF_CORRIDOR, _TRACKING_M, _TRACKING_M_S, _POINTING, _INTERVENTION,
    _SIGMA_M, _SIGMA_M_S, _MISSED, _IMPULSE, _UNEXPLAINED,
) = range(len(QUANTITIES))  # fmt: skip

_NONE, _HOLD, _RETREAT, _DRIFT, _ABORT = range(len(REACTIONS))
"""Reactions by their rank; a warning is none."""

NOTHING, COMMANDED, FAULT, HELD, BURNT, PLANNED = range(6)
"""What the kernel asks: commands came, faults begin to hold, a hold has lasted too long, a burn is
over. PLANNED is the answer to the last one where the chaser shall burn again."""

_DEGREES = 180.0 / pi


def _zeros() -> list[float]:
    return [0.0] * 3


def _still() -> list[float]:
    return [0.0] * 6


class Limit(NamedTuple):
    """A row of the table as the kernel reads it.

    needed : its `count`; first : place of its samples
    """

    quantity: int
    most: float
    needed: int
    window: int
    reaction: int
    first: int


@dataclass(slots=True)
class Counter:
    """Samples of a row: how many of the window show it, the oldest, whether the fault holds."""

    shown: int = 0
    oldest: int = 0
    holds: int = 0
    begins: int = 0


class Event(NamedTuple):
    """A command, its place in COMMANDS, and the tick from which it acts."""

    tick: int
    command: int


@dataclass(slots=True)
class Table:
    """Settings of `watch`; world, step : what paths are computed with, and the step of a tick.

    reference_at, attitude_at : places in u of the reference, and of attitude and its reference; 0:
        there is none
    """

    rows: list[Limit]
    world: PathModel
    step: CwStep
    dt_s: float
    keep_out_m: float
    hold_s: float
    reference_at: int
    attitude_at: int
    reference_attitude_at: int


NO_TABLE = Table([], PathModel(*(0.0,) * 9), CwStep(*(0.0,) * 26), 0.0, 0.0, 0.0, 0, 0, 0)


@dataclass(slots=True)
class Watch:
    """Memory of the table.

    armed : 1 where it reacts; reaction : that has the command, its rank; since : its first tick
    by_table : 1 where the table began it
    state, has_state : of the tick before; applied_n : force since then, as far as is known
    has_point, point_m : where a hold or a retreat leads; burns, wanted_m_s : velocity of an abort
    ahead : (6,) when a force of now acts; enclosed : 1 inside the corridor, within the sphere
    outward : along the corridor, target LVLH
    obeyed, sampled : 1 where that is done in this tick; question : what was asked last
    """

    armed: int
    samples: list[int]
    counters: list[Counter]
    reaction: int = _NONE
    since: int = 0
    by_table: int = 0
    tick: int = -1
    has_state: int = 0
    state: Annotated[list[float], 6] = field(default_factory=_still)
    impulse_n_s: float = 0.0
    applied_n: Annotated[list[float], 3] = field(default_factory=_zeros)
    has_point: int = 0
    point_m: Annotated[list[float], 3] = field(default_factory=_zeros)
    burns: int = 0
    wanted_m_s: Annotated[list[float], 3] = field(default_factory=_zeros)
    attempts: int = 0
    ahead: Annotated[list[float], 6] = field(default_factory=_still)
    enclosed: int = 0
    outward: Annotated[list[float], 3] = field(default_factory=_zeros)
    obeyed: int = 0
    sampled: int = 0
    question: int = NOTHING
    commands: list[Event] = field(default_factory=list)
    missed: list[int] = field(default_factory=list)


@step_kernel
def is_missed(tick: int, w: Any) -> bool:
    """Return whether no command came at a tick."""
    found = False
    for i in range(len(w.missed)):
        found = found or w.missed[i] == tick
    return found


@step_kernel
def look_ahead(tick: int, state: State, p: Any, m: Any) -> None:
    """Fill what a reaction needs: the state when a force of now acts, and the corridor then."""
    w, g = m.watch, p.guard
    near = norm(state[0], state[1], state[2]) < g.keep_out_m
    w.enclosed = 1 if m.mode == APPROACH and near else 0
    outward = (
        g.side if g.axis == 0 else 0.0,
        g.side if g.axis == 1 else 0.0,
        g.side if g.axis == 2 else 0.0,
    )
    if p.turns == 1:
        outward = to_lvlh(outward, p.frames[tick + len(m.line_n)])
    now = w.ahead
    now[0], now[1], now[2], now[3], now[4], now[5] = state
    w.outward[0], w.outward[1], w.outward[2] = outward


@step_kernel
def difference(u: Any, i: int, j: int, first: int) -> float:
    """Return the length of the difference of two vectors of u, from places i + first, j + first."""
    i, j = i + first, j + first
    return norm(u[i] - u[j], u[i + 1] - u[j + 1], u[i + 2] - u[j + 2])


@step_kernel
def off_corridor_m(tick: int, state: State, p: Any) -> float:
    """Return how far [m] a state is outside the corridor; 0.0 beyond its outer end."""
    g = p.guard
    if g.side == 0.0 or norm(state[0], state[1], state[2]) >= g.outer_m:
        return 0.0
    if p.turns == 1:
        state = seen_from(state, p.frames[tick])
    d, _, along, across, _, _ = in_corridor(state, g)
    along, across = abs(along), abs(across)
    return (across if across > along else along) - (g.width_m + g.slope * (d if d > 0.0 else 0.0))


@step_kernel
def pointing_error_deg(u: Any, t: Any) -> float:
    """Return the angle off the reference, twice the sine of half of it; 0.0 where unknown."""
    i, j = t.attitude_at, t.reference_attitude_at
    if i == 0:
        return 0.0
    x, y, z, _ = times(
        (-u[i], -u[i + 1], -u[i + 2], u[i + 3]), (u[j], u[j + 1], u[j + 2], u[j + 3])
    )
    return 2.0 * norm(x, y, z) * _DEGREES


@step_kernel
def unexplained_n(state: State, p: Any, w: Any) -> float:
    """Return the force [N] that the last change of velocity needed beside the commanded one."""
    if w.has_state == 0:
        return 0.0
    before = (w.state[0], w.state[1], w.state[2], w.state[3], w.state[4], w.state[5])
    force = (w.applied_n[0], w.applied_n[1], w.applied_n[2])
    _, _, _, vx, vy, vz = cw_step(before, force, p.table.step)
    change = norm(state[3] - vx, state[4] - vy, state[5] - vz)
    return change * p.guard.mass_kg / p.table.dt_s


@step_kernel
def quantity_of(tick: int, quantity: int, u: Any, p: Any, m: Any) -> float:
    """Return a quantity of QUANTITIES, by its place."""
    w, t = m.watch, p.table
    if quantity == _INTERVENTION:
        return 1.0 if m.acted != 0 else 0.0
    if quantity == _SIGMA_M:
        return m.spread_m
    if quantity == _SIGMA_M_S:
        return m.spread_m_s
    if quantity == _IMPULSE:
        return w.impulse_n_s
    if quantity == _MISSED:
        return 1.0 if is_missed(tick, w) else 0.0
    if quantity in (_TRACKING_M, _TRACKING_M_S):
        known = t.reference_at > 0 and not is_missed(tick, w)
        return difference(u, 0, t.reference_at, 3 * (quantity - _TRACKING_M)) if known else 0.0
    if quantity == _POINTING:
        return pointing_error_deg(u, t)
    state = (u[0], u[1], u[2], u[3], u[4], u[5])
    if quantity == _OFF_CORRIDOR:
        return off_corridor_m(tick, state, p)
    if quantity == _UNEXPLAINED:
        return unexplained_n(state, p, w)
    rho, closes, speed = closing(state)
    if quantity == _RANGE:
        return rho
    return speed if quantity == _SPEED else closes - speed_limit(rho, p.guard)


@step_kernel
def counted(shows: bool, row: Any, counter: Any, samples: Any) -> bool:
    """Take a sample of a row; return whether the fault begins to hold by it.

    It begins once `needed` of the last `window` samples show it, and again only after a whole
    window without.
    """
    now, place = 1 if shows else 0, row.first + counter.oldest
    counter.shown += now - samples[place]  # the oldest sample drops out
    samples[place] = now
    counter.oldest = (counter.oldest + 1) % row.window
    counter.begins = 0
    if counter.holds == 1:
        if counter.shown == 0:
            counter.holds = 0
    elif counter.shown >= row.needed:
        counter.holds = counter.begins = 1
    return counter.begins == 1


@step_kernel
def sample(tick: int, u: Any, p: Any, m: Any) -> bool:
    """Look at the quantity of each row; return whether a fault begins to hold.

    While the controller's command is not read, nor are quantities of it.
    """
    w, begin = m.watch, False
    for i in range(len(p.table.rows)):
        row = p.table.rows[i]
        q = row.quantity
        of_command = q in (_MISSED, _TRACKING_M, _TRACKING_M_S, _POINTING)
        w.counters[i].begins = 0
        if not (w.reaction != _NONE and of_command):
            shows = quantity_of(tick, q, u, p, m) > row.most
            begin = counted(shows, row, w.counters[i], w.samples) or begin
    return begin


@step_kernel
def asks(tick: int, u: Any, p: Any, m: Any) -> bool:
    """Return whether commands came, faults begin to hold, or a hold has lasted too long."""
    w = m.watch
    for i in range(len(w.commands)):
        if w.obeyed == 0 and w.commands[i].tick == tick:
            w.question = COMMANDED
            return True
    if w.sampled == 0:
        w.sampled = 1
        if sample(tick, u, p, m):
            w.question = FAULT
            return True
    holds = w.reaction == _HOLD and w.by_table == 1 and w.armed == 1
    if holds and (tick - w.since) * p.table.dt_s >= p.table.hold_s:
        w.question = HELD
        return True
    return False


@step_kernel
def reaction_n(tick: int, p: Any, m: Any) -> tuple[bool, Vector]:
    """Return whether a burn is over and must be judged, and the force [N] of the reaction."""
    w, t = m.watch, p.table
    ahead = (w.ahead[0], w.ahead[1], w.ahead[2], w.ahead[3], w.ahead[4], w.ahead[5])
    if w.reaction == _HOLD:
        if w.has_point == 0 and norm(ahead[3], ahead[4], ahead[5]) <= manoeuvre.AT_REST_M_S:
            w.has_point = 1
            for i in range(3):
                w.point_m[i] = ahead[i]
        if w.has_point == 0:
            return False, towards(ahead, (0.0, 0.0, 0.0), manoeuvre.RECOVERY_S, t.world)
    point = (w.point_m[0], w.point_m[1], w.point_m[2])
    if w.reaction == _HOLD:
        return False, holding(ahead, point, t.world)
    if w.reaction == _RETREAT and w.has_point == 1:
        return False, retreating(ahead, point, t.keep_out_m, t.world, p.guard)
    if w.reaction != _ABORT or w.burns == 0:
        return False, (0.0, 0.0, 0.0)
    wanted = (w.wanted_m_s[0], w.wanted_m_s[1], w.wanted_m_s[2])
    if w.enclosed == 1 and p.turns == 1 and w.question != PLANNED:  # outward is elsewhere by now
        frame = p.frames[tick + len(m.line_n)]
        out = norm(wanted[0], wanted[1], wanted[2])
        x, y, z, _, _, _ = seen_from(ahead, frame)
        _, _, _, vx, vy, vz = moving_with((x, y, z, 0.0, 0.0, 0.0), frame)
        wanted = (vx + out * w.outward[0], vy + out * w.outward[1], vz + out * w.outward[2])
    burnt_s = (tick - w.since) * t.dt_s
    there = reached(ahead, wanted, BURN_DONE_M_S) and closing(ahead)[0] > t.keep_out_m
    if burnt_s < t.world.stuck_s or (burnt_s < t.world.burn_s and not there):
        return False, towards(ahead, wanted, manoeuvre.RESPONSE_S, t.world)
    w.question = BURNT
    return True, (0.0, 0.0, 0.0)


@step_kernel
def remember(tick: int, u: Any, p: Any, m: Any) -> None:
    """End a tick: fill what the next one looks back at."""
    w = m.watch
    force, before = (m.force_n[0], m.force_n[1], m.force_n[2]), w.state
    w.impulse_n_s += (abs(force[0]) + abs(force[1]) + abs(force[2])) * p.table.dt_s
    if len(m.line_n) > 0:
        line = m.line_n[m.oldest]
        force = (line[0], line[1], line[2])
    w.applied_n[0], w.applied_n[1], w.applied_n[2] = force
    before[0], before[1], before[2] = u[0], u[1], u[2]
    before[3], before[4], before[5] = u[3], u[4], u[5]
    w.tick, w.has_state = tick, 1
    w.obeyed = w.sampled = 0
    w.question = NOTHING


class Change(NamedTuple):
    """Something that `stage_status` tells: from a tick on, and why."""

    tick: int
    state: str
    reason: str


class AbortMachine:
    """Takes the command from the controller where the table says so.

    guard : numbers of the filter, with the errors that the scenario assumes
    changes : what happened in the flight so far
    """

    def __init__(
        self, table: AbortTable, proof: Proof, keep_out_m: float, scenario: Any, stage: Any
    ) -> None:
        guard, disturbance_n = proof.guard, proof.errors.disturbance_n
        self.table, self.guard, self.keep_out_m = table, guard, keep_out_m
        self.changes: list[Change] = []
        self._stage, self._dt_s, n = stage, scenario.dt_s, scenario.mean_motion_rad_s
        self._step, self._long = (
            cw.discretise(n, guard.mass_kg, seconds) for seconds in (self._dt_s, manoeuvre.STEP_S)
        )
        self._burn_error_m_s = disturbance_n / guard.mass_kg * manoeuvre.RESPONSE_S + BURN_DONE_M_S
        self._world = PathModel(
            n, guard.mass_kg, guard.limit_n, table.stuck_s, table.stuck_s + BURN_S,
            table.orbits * 2.0 * pi / n, table.drag_m_s2, 0.0, BURN_DONE_M_S,
        )  # fmt: skip

    def numbers(self, reference_at: int, attitude_at: int, reference_attitude_at: int) -> Table:
        """Return the table as the kernel reads it, with the places of its inputs in u."""
        rows, names, first = [], list(QUANTITIES), 0
        for row in self.table.table:
            rank = REACTIONS.index(row.reaction)
            rows.append(
                Limit(names.index(row.quantity), row.most, row.count, row.window, rank, first)
            )
            first += row.window
        return Table(
            rows, self._world, self._step, self._dt_s, self.keep_out_m, self.table.hold_s,
            reference_at, attitude_at, reference_attitude_at,
        )  # fmt: skip

    def memory(self) -> Watch:
        """Return the memory before a flight."""
        rows = self.table.table
        samples = [0] * sum(row.window for row in rows)
        return Watch(int(self.table.armed), samples, [Counter() for _ in rows])

    @property
    def m(self) -> Any:
        """The memory of the flight, a `Watch`."""
        return self._stage.m.watch

    @property
    def armed(self) -> bool:
        """Whether the table reacts."""
        return bool(self.m.armed)

    @property
    def reaction(self) -> str:
        """What has the command; '' : the controller has it."""
        return REACTIONS[self.m.reaction] if self.m.reaction else ''

    def ready(self) -> None:
        """Load the kernels of an abort before it is needed."""
        manoeuvre.choose((0.0, 100.0, 0.0, 0.0, 0.0, 0.0), 0.0, self._long, self._world)

    def take_event(self, tick: int, state: str) -> None:
        """Take a command, or word of a missing one, that a log or a node tells of."""
        m = self.m
        if state in COMMANDS:
            kept = [event for event in rows_of(m.commands, Event) if event.tick >= m.tick]
            m.commands = [*kept, Event(tick, COMMANDS.index(state))]
        elif state == WITHOUT_COMMAND:
            m.missed = [*(int(t) for t in m.missed if t >= m.tick), tick]

    @property
    def next_tick(self) -> int:
        """The tick that comes."""
        return int(self.m.tick) + 1

    def command(self, name: str) -> str:
        """Take a command for the next tick; return why it is refused, '' if it is not."""
        reason = self.refusal(name)
        if not reason:
            self.take_event(self.next_tick, name)
        return reason

    def refusal(self, name: str) -> str:
        """Return why a command cannot be followed now; '' if it can."""
        if name == RESUME:
            if self.reaction not in (HOLD, RETREAT):
                return f'`resume` ends a hold or a retreat; the phase is {self.phase}'
            pairs = zip(self.table.table, self.m.counters, strict=True)
            holding = [
                f'{r.quantity} {r.reaction}' for r, c in pairs if c.holds and r.reaction != WARN
            ]
            return f'a fault holds: {", ".join(sorted(holding))}' if holding else ''
        if name == RETREAT and self.table.retreat_m is None:
            return 'section `assurance.abort` has no `retreat_m`'
        if name in PHASES and REACTIONS.index(name) <= self.m.reaction:
            return f'the phase is {self.phase}: `{name}` would do less'
        return ''

    @property
    def phase(self) -> str:
        """What goes on, in a word."""
        return PHASES[self.reaction] if self.reaction else 'following the controller'

    def missed(self, tick: int) -> bool:
        """Return whether no command came at a tick."""
        return tick in self.m.missed

    def alone(self, tick: int) -> bool:
        """Return whether the controller's command is not read at a tick."""
        return bool(self.m.reaction) and RESUME not in self._commands(tick)

    def _commands(self, tick: int) -> list[str]:
        events = rows_of(self.m.commands, Event)
        return [COMMANDS[event.command] for event in events if event.tick == tick]

    def answer(self, tick: int) -> None:
        """Decide what the kernel asks, and write it into the memory."""
        question = self.m.question
        if question == COMMANDED:
            self.m.obeyed = 1
            for name in self._commands(tick):
                self._obey(tick, name)
        elif question == FAULT:
            self._react(tick)
        elif question == HELD:
            why = f'a hold lasts `hold_s` = {self.table.hold_s:g} s'
            self._begin(tick, ABORT, why, by_table=True)
        else:
            self._judge(tick)

    def _react(self, tick: int) -> None:
        """React to the worst fault that begins."""
        m, worst = self.m, None
        for row, counter in zip(self.table.table, m.counters, strict=True):
            if not counter.begins:
                continue
            if row.reaction == WARN or not m.armed:
                inhibited = '' if row.reaction == WARN else f'; inhibited: no {row.reaction}'
                self.changes.append(Change(tick, WARNED, _shown(row) + inhibited))
            elif worst is None or _rank(row) > _rank(worst):
                worst = row
        if worst is not None and _rank(worst) > m.reaction:
            self._begin(tick, worst.reaction, _shown(worst), by_table=True)

    def _obey(self, tick: int, name: str) -> None:
        m, why = self.m, f'command `{name}`'
        if name not in (ARM, INHIBIT, RESUME):
            self._begin(tick, name, why, by_table=False)
            return
        state = RESUMED
        if name == RESUME:
            m.reaction = _NONE
        else:
            m.armed = int(name == ARM)
            state = ARMED if name == ARM else INHIBITED
        m.samples = [0] * len(m.samples)
        m.counters = [Counter() for _ in m.counters]
        self.changes.append(Change(tick, state, why))

    def _begin(self, tick: int, reaction: str, why: str, *, by_table: bool) -> None:
        m, point = self.m, self.table.retreat_m if reaction == RETREAT else None
        m.reaction, m.since, m.by_table = REACTIONS.index(reaction), tick, int(by_table)
        m.has_point, m.point_m = int(point is not None), list(point or m.point_m)
        if reaction == ABORT:
            m.attempts = 0
            why += self._plan(tick)
        self.changes.append(Change(tick, PHASES[reaction], why))

    def way_out(self, state: State, guard: Guard, only: Vector | None) -> manoeuvre.Choice:
        """Return the manoeuvre that leads away from a state (6,) [m, m/s].

        guard : numbers of the filter as they are now
        only : the one direction (3,) in which it may go; None: any
        """
        rho = closing(state)[0]
        radius = self.keep_out_m if rho > self.keep_out_m else guard.port_m
        limit = 0.9 * speed_limit(rho, guard)
        path_model = self._known(guard)
        return manoeuvre.choose(state, radius + guard.here_m, self._long, path_model, limit, only)

    def _plan(self, tick: int) -> str:
        """Choose a manoeuvre; return the words for it, and for how clear its path is."""
        m, guard = self.m, self._stage.guard
        ahead, outward = _numbers(m.ahead), _numbers(m.outward)
        inside = closing(ahead)[0] <= self.keep_out_m
        choice = self.way_out(ahead, guard, outward if inside and m.enclosed else None)
        m.burns, m.wanted_m_s, m.since = 1, list(choice.velocity_m_s), tick
        m.attempts += 1
        speed, radius = norm(*choice.velocity_m_s), guard.port_m if inside else self.keep_out_m
        size = f'{abs(choice.margin_m):.3g} m'
        clear = f'clear by {size}' if choice.margin_m >= 0.0 else f'not clear: {size} in the zone'
        return f'; to {speed:.2g} m/s, {clear} of {radius:g} m at the worst'

    def _known(self, guard: Guard) -> PathModel:
        """Return what a path is computed with: the velocity is known as well as it is now."""
        return self._world._replace(error_m_s=guard.here_m_s + self._burn_error_m_s)

    def _judge(self, tick: int) -> None:
        """At the end of a burn, look whether the drift is clear; if not, plan another one."""
        m, guard = self.m, self._stage.guard
        ahead = _numbers(m.ahead)
        near = manoeuvre.drift_margin(ahead, self._known(guard), 0.0) - guard.here_m
        radius = self.keep_out_m if closing(ahead)[0] > self.keep_out_m else 0.0
        if near < radius and m.attempts < ATTEMPTS:
            why = f'the drift would come to {near:.3g} m'
            self.changes.append(Change(tick, PHASES[ABORT], why + self._plan(tick)))
            m.question = PLANNED
            return
        m.burns = 0
        why = f'at least {near:.3g} m from the target for {self.table.orbits:g} orbits'
        self.changes.append(Change(tick, PHASES[DRIFT], why))


def _shown(row: Row) -> str:
    """Return what a row has seen."""
    return f'{row.quantity} above {row.most:g} in {row.count} of {row.window} ticks'


def _rank(row: Row) -> int:
    return REACTIONS.index(row.reaction)


def _numbers(values: Any) -> Any:
    """Return numbers of a memory as a tuple of floats."""
    return tuple(map(float, values))
