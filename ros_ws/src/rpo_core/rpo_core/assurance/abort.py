# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The abort table in flight: which faults hold, who has the command, and where an abort leads.

A function of states, commands and events so far: `rpo verify` decides the same again. A fault holds
when n of its last m samples show it, the scheme of NASA's cFS Limit Checker.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from math import pi
from typing import Any, NamedTuple

from rpo_core.assurance import manoeuvre
from rpo_core.assurance.abort_table import (
    ABORT,
    DRIFT,
    HOLD,
    REACTIONS,
    RETREAT,
    WARN,
    AbortTable,
    Row,
)
from rpo_core.assurance.guard import Proof
from rpo_core.assurance.kernels import Guard, closing, in_corridor, speed_limit
from rpo_core.assurance.manoeuvre import PathModel
from rpo_core.kernels.arithmetic import State, Vector, norm
from rpo_core.stage import WITHOUT_COMMAND, Signal
from rpo_core.world import cw
from rpo_core.world.cw import cw_step


class LimitChecker:
    """Counts samples; a fault begins to hold once, and again only after a whole window without.

    rows : fault -> row of the table, whose `count` of the last `window` samples must show it
    holding : the faults that hold
    """

    def __init__(self, rows: Mapping[str, Row]) -> None:
        self.rows = rows
        self.clear()

    def sample(self, seen: Mapping[str, bool]) -> list[str]:
        """Take one sample of some faults; return those that begin to hold by it."""
        begins = []
        for fault, shows in seen.items():
            samples = self._samples[fault]
            self._shown[fault] += shows - samples[0]  # the oldest sample drops out
            samples.append(shows)
            if fault in self.holding:
                if not self._shown[fault]:
                    self.holding.discard(fault)
            elif self._shown[fault] >= self.rows[fault].count:
                self.holding.add(fault)
                begins.append(fault)
        return begins

    def clear(self) -> None:
        """Forget all samples: what holds already is found anew."""
        self.holding: set[str] = set()
        self._shown = dict.fromkeys(self.rows, 0)
        self._samples = {
            fault: deque([False] * row.window, maxlen=row.window)
            for fault, row in self.rows.items()
        }


ARM, INHIBIT, RESUME = 'arm', 'inhibit', 'resume'
COMMANDS = (ARM, INHIBIT, RESUME, HOLD, RETREAT, DRIFT, ABORT)

ARMED, INHIBITED, RESUMED, WARNED = 'armed', 'inhibited', 'resumed', 'warned'
PHASES = {HOLD: 'holding', RETREAT: 'retreating', DRIFT: 'drifting', ABORT: 'aborting'}
"""Reaction -> what `stage_status` says when it begins; nobody reads the controller's command."""

DECISIONS = (ARMED, INHIBITED, RESUMED, WARNED, *PHASES.values())

OF_THE_COMMAND = ('missed', 'tracking_error_m', 'tracking_error_m_s', 'pointing_error_deg')
"""Quantities that are not looked at while the controller's command is not read."""

BURN_S = 90.0
"""An abort burns for at most so long after any thruster was stuck."""

BURN_DONE_M_S = 0.0005
"""The wanted velocity of an abort counts as reached to so much."""

ATTEMPTS = 3
"""A drift that is not clear is followed by another manoeuvre, up to so many in all."""


class Change(NamedTuple):
    """Something that `stage_status` tells: from a tick on, and why."""

    tick: int
    state: str
    reason: str


class Seen(NamedTuple):
    """What the table looks at in a tick.

    state : (6,) [m, m/s] as it is known; ahead : (6,) when a force of now acts
    reference : (6,) [m, m/s], empty without guidance
    sigma_m, sigma_m_s : of the estimate, 0.0 without an estimator
    intervened : whether the filter changed the command of the tick before
    applied_n : (3,) force [N] that the chaser had since the tick before, as far as is known
    enclosed : whether the chaser is inside the corridor
    guard : numbers of the filter, with the errors that the estimate has now
    in_axes : (6,) the state in the axes of the corridor
    outward : (3,) along the corridor, target LVLH
    carried_m_s : (3,) velocity of a corridor that turns where the chaser is; empty: it stands
    pointing_deg : angle between the attitude and its reference; 0.0: nobody looks at it
    """

    state: State
    ahead: State
    reference: Signal
    sigma_m: float
    sigma_m_s: float
    intervened: bool
    applied_n: Vector
    enclosed: bool
    guard: Guard
    in_axes: State
    outward: Vector
    carried_m_s: Signal = ()
    pointing_deg: float = 0.0


class AbortMachine:
    """Counts faults, and takes the command from the controller where the table says so.

    changes : what happened so far
    guard : numbers of the filter, with the errors that the scenario assumes
    armed : whether the table reacts
    reaction : that has the command; '' : the controller has it
    """

    def __init__(self, table: AbortTable, proof: Proof, keep_out_m: float, scenario: Any) -> None:
        guard, disturbance_n = proof.guard, proof.errors.disturbance_n
        self.table, self.guard, self.keep_out_m = table, guard, keep_out_m
        self._dt_s, n = scenario.dt_s, scenario.mean_motion_rad_s
        self._step, self._long = (
            cw.discretise(n, guard.mass_kg, seconds) for seconds in (self._dt_s, manoeuvre.STEP_S)
        )
        self._burn_error_m_s = disturbance_n / guard.mass_kg * manoeuvre.RESPONSE_S + BURN_DONE_M_S
        self._world = PathModel(
            n, guard.mass_kg, guard.limit_n, table.stuck_s, table.stuck_s + BURN_S,
            table.orbits * 2.0 * pi / n, table.drag_m_s2, 0.0, BURN_DONE_M_S,
        )  # fmt: skip
        self._rows = {f'{row.quantity} {row.reaction}': row for row in table.table}
        self.reset()

    def reset(self) -> None:
        """Forget the flight before."""
        self._checker = LimitChecker(self._rows)
        self._commands: dict[int, list[str]] = {}
        self._missed: set[int] = set()
        self.changes: list[Change] = []
        self.armed, self.reaction = self.table.armed, ''
        self._tick, self._since = -1, 0
        self._by_table = False
        self._before: State | None = None
        self._impulse_n_s = 0.0
        self._to: Vector | None = None
        self._wanted: Vector | None = None
        self._attempts = 0

    def ready(self) -> None:
        """Load the kernels of an abort before it is needed."""
        manoeuvre.choose((0.0, 100.0, 0.0, 0.0, 0.0, 0.0), 0.0, self._long, self._world)

    def take_event(self, tick: int, state: str) -> None:
        """Take a command, or word of a missing one, that a log or a node tells of."""
        if state in COMMANDS:
            self._commands.setdefault(tick, []).append(state)
        elif state == WITHOUT_COMMAND:
            self._missed.add(tick)

    @property
    def next_tick(self) -> int:
        """The tick that comes."""
        return self._tick + 1

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
            holding = [k for k in self._checker.holding if self._rows[k].reaction != WARN]
            return f'a fault holds: {", ".join(sorted(holding))}' if holding else ''
        if name == RETREAT and self.table.retreat_m is None:
            return 'section `assurance.abort` has no `retreat_m`'
        if name in PHASES and self._rank(name) <= self._rank(self.reaction):
            return f'the phase is {self.phase}: `{name}` would do less'
        return ''

    @property
    def phase(self) -> str:
        """What goes on, in a word."""
        return PHASES[self.reaction] if self.reaction else 'following the controller'

    @staticmethod
    def _rank(reaction: str) -> int:
        return REACTIONS.index(reaction) if reaction else 0

    def step(self, tick: int, seen: Seen) -> Vector | None:
        """Return the force (3,) [N] instead of the command; None: the command stands."""
        self._tick = tick
        for name in self._commands.get(tick, ()):
            self._obey(tick, name, seen)
        self._sample(tick, seen)
        self._time_out(tick, seen)
        self._before = seen.state
        return self._force(tick, seen)

    def missed(self, tick: int) -> bool:
        """Return whether no command came at a tick."""
        return tick in self._missed

    def alone(self, tick: int) -> bool:
        """Return whether the controller's command is not read at a tick."""
        return bool(self.reaction) and RESUME not in self._commands.get(tick, ())

    def spend(self, force: Vector) -> None:
        """Add a force [N] of a tick to the impulse."""
        self._impulse_n_s += (abs(force[0]) + abs(force[1]) + abs(force[2])) * self._dt_s

    def _sample(self, tick: int, seen: Seen) -> None:
        """Look at each quantity, and react to the worst fault that begins."""
        quantities = self._quantities(tick, seen)
        over = {
            key: quantities[row.quantity] > row.most
            for key, row in self._rows.items()
            if not (self.reaction and row.quantity in OF_THE_COMMAND)
        }
        worst, reason = '', ''
        for fault in self._checker.sample(over):
            row = self._rows[fault]
            reaction = row.reaction
            why = f'{row.quantity} above {row.most:g} in {row.count} of {row.window} ticks'
            if reaction == WARN or not self.armed:
                inhibited = '' if reaction == WARN else f'; inhibited: no {reaction}'
                self.changes.append(Change(tick, WARNED, why + inhibited))
            elif self._rank(reaction) > self._rank(worst):
                worst, reason = reaction, why
        if self._rank(worst) > self._rank(self.reaction):
            self._begin(tick, worst, reason, seen, by_table=True)

    def _quantities(self, tick: int, seen: Seen) -> dict[str, float]:
        state, guard = seen.state, self.guard
        rho, closes, speed = closing(state)
        miss = [a - b for a, b in zip(state, seen.reference, strict=False)] or [0.0] * 6
        return {
            'range_m': rho,
            'speed_m_s': speed,
            'closing_excess_m_s': closes - speed_limit(rho, guard),
            'off_corridor_m': self._off_corridor_m(seen.in_axes, rho),
            'tracking_error_m': norm(*miss[:3]),
            'tracking_error_m_s': norm(*miss[3:]),
            'pointing_error_deg': seen.pointing_deg,
            'intervention': float(seen.intervened),
            'sigma_m': seen.sigma_m,
            'sigma_m_s': seen.sigma_m_s,
            'missed': float(self.missed(tick)),
            'impulse_n_s': self._impulse_n_s,
            'unexplained_n': self._unexplained_n(seen),
        }

    def _off_corridor_m(self, state: State, rho: float) -> float:
        guard = self.guard
        if guard.side == 0.0 or rho >= guard.outer_m:
            return 0.0
        d, _, p, q, _, _ = in_corridor(state, guard)
        return max(abs(p), abs(q)) - (guard.width_m + guard.slope * max(d, 0.0))

    def _unexplained_n(self, seen: Seen) -> float:
        if self._before is None:
            return 0.0
        expected = cw_step(self._before, seen.applied_n, self._step)
        change = [a - b for a, b in zip(seen.state[3:], expected[3:], strict=True)]
        return norm(*change) * self.guard.mass_kg / self._dt_s

    def _time_out(self, tick: int, seen: Seen) -> None:
        """Let a hold by the table become an abort."""
        held_s = (tick - self._since) * self._dt_s
        holds = self.reaction == HOLD and self._by_table and self.armed
        if holds and held_s >= self.table.hold_s:
            why = f'a hold lasts `hold_s` = {self.table.hold_s:g} s'
            self._begin(tick, ABORT, why, seen, by_table=True)

    def _obey(self, tick: int, name: str, seen: Seen) -> None:
        reason = f'command `{name}`'
        if name in (ARM, INHIBIT):
            self.armed = name == ARM
            self._checker.clear()
            self.changes.append(Change(tick, ARMED if self.armed else INHIBITED, reason))
        elif name == RESUME:
            self.reaction = ''
            self._checker.clear()
            self.changes.append(Change(tick, RESUMED, reason))
        else:
            self._begin(tick, name, reason, seen, by_table=False)

    def _begin(self, tick: int, reaction: str, reason: str, seen: Seen, *, by_table: bool) -> None:
        self.reaction, self._since, self._by_table = reaction, tick, by_table
        self._to = self.table.retreat_m if reaction == RETREAT else None
        if reaction == ABORT:
            self._attempts = 0
            reason = f'{reason}; {self._plan(tick, seen)}'
        self.changes.append(Change(tick, PHASES[reaction], reason))

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

    def _plan(self, tick: int, seen: Seen) -> str:
        """Choose a manoeuvre; return how clear its path is, in words."""
        inside = closing(seen.ahead)[0] <= self.keep_out_m
        only = seen.outward if inside and seen.enclosed else None
        choice = self.way_out(seen.ahead, seen.guard, only)
        self._wanted, self._since = choice.velocity_m_s, tick
        self._attempts += 1
        size = f'{abs(choice.margin_m):.3g} m'
        clear = f'clear by {size}' if choice.margin_m >= 0.0 else f'not clear: {size} in the zone'
        radius = seen.guard.port_m if inside else self.keep_out_m
        return f'to {norm(*choice.velocity_m_s):.2g} m/s, {clear} of {radius:g} m at the worst'

    def _known(self, guard: Guard) -> PathModel:
        """Return what a path is computed with: the velocity is known as well as it is now."""
        return self._world._replace(error_m_s=guard.here_m_s + self._burn_error_m_s)

    def _force(self, tick: int, seen: Seen) -> Vector | None:
        """Return the force of the phase."""
        if not self.reaction:
            return None
        if self.reaction == HOLD:
            if self._to is None and norm(*seen.ahead[3:]) <= manoeuvre.AT_REST_M_S:
                self._to = seen.ahead[:3]
            return manoeuvre.holding(seen.ahead, self._to, self._world)
        if self.reaction == RETREAT and self._to is not None:
            radius = self.keep_out_m
            return manoeuvre.retreating(seen.ahead, self._to, radius, self._world, self.guard)
        if self.reaction == ABORT and self._wanted is not None:
            wanted = self._wanted
            if seen.enclosed and seen.carried_m_s:  # outward is elsewhere by now
                (x, y, z), (a, b, c), out = seen.carried_m_s, seen.outward, norm(*wanted)
                wanted = x + out * a, y + out * b, z + out * c
            return self._burning(tick, seen, wanted)
        return 0.0, 0.0, 0.0

    def _burning(self, tick: int, seen: Seen, wanted: Vector) -> Vector:
        """Return the force of an abort; at its end, look whether the drift is clear."""
        burnt_s = (tick - self._since) * self._dt_s
        there = manoeuvre.reached(seen.ahead, wanted, BURN_DONE_M_S)
        there = there and closing(seen.ahead)[0] > self.keep_out_m
        if burnt_s < self._world.stuck_s or (burnt_s < self._world.burn_s and not there):
            return manoeuvre.towards(seen.ahead, wanted, manoeuvre.RESPONSE_S, self._world)
        near = manoeuvre.drift_margin(seen.ahead, self._known(seen.guard), 0.0) - seen.guard.here_m
        radius = self.keep_out_m if closing(seen.ahead)[0] > self.keep_out_m else 0.0
        if near < radius and self._attempts < ATTEMPTS:
            why = f'the drift would come to {near:.3g} m'
            self.changes.append(Change(tick, PHASES[ABORT], f'{why}; {self._plan(tick, seen)}'))
            return self._burning(tick, seen, self._wanted or wanted)
        self._wanted = None
        text = f'at least {near:.3g} m from the target for {self.table.orbits:g} orbits'
        self.changes.append(Change(tick, PHASES[DRIFT], text))
        return 0.0, 0.0, 0.0
