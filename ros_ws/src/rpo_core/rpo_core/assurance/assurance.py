# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Stage `assurance`: between any controller and the thrusters."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from math import sqrt
from typing import Annotated, Any, NamedTuple

from rpo_core.assurance import abort, filters, kernels
from rpo_core.assurance.abort import AbortMachine, Table, Watch
from rpo_core.assurance.abort_table import check_table
from rpo_core.assurance.assumed import ahead, compared, known, short_tank, upwards
from rpo_core.assurance.doubt import Doubt, doubt_of, doubted, unless_unsure
from rpo_core.assurance.guard import proof_of
from rpo_core.assurance.kernels import APPROACH, CONTACT, OPEN, Guard
from rpo_core.assurance.settings import Assurance
from rpo_core.assurance.working import values_that_work
from rpo_core.attitude.attitude_kernels import LVLH, Frame, seen_from
from rpo_core.attitude.target import known_motion
from rpo_core.files.validation import InputError
from rpo_core.kernels.arithmetic import State, norm
from rpo_core.kernels.calls import ASK
from rpo_core.kernels.jit import kernel, step_kernel
from rpo_core.kernels.records import as_rows
from rpo_core.stage import (
    ZERO,
    KernelStage,
    Place,
    Section,
    Signal,
    register,
    section_of,
    width_of,
)
from rpo_core.wire import interfaces
from rpo_core.world import cw
from rpo_core.world.cw import CwStep, cw_step

UNKNOWN = -1
"""Mode before the first state: the state decides."""

MODES = {OPEN: 'open', APPROACH: 'approach', CONTACT: 'contact'}
CONSTRAINTS = {
    filters.NOTHING: '',
    filters.FORCE: 'force',
    filters.SLEW: 'slew',
    filters.SPEED: 'speed',
    filters.KEEP_OUT: 'keep_out',
    filters.CORRIDOR: 'corridor',
    filters.NOT_FINITE: 'not_finite',
    filters.DOMAIN: 'domain',
}
COVARIANCE, UNSURE = 'covariance', len(CONSTRAINTS)
"""Constraint of a stop because an estimate became worse than any admissible set allows for."""
_ACTED = {**CONSTRAINTS, UNSURE: COVARIANCE}

_WIDTHS = {interfaces.STATE: 6, interfaces.COMMAND: 3, interfaces.ATTITUDE: 7}

FRAMES_AHEAD = 512
"""Ticks for which a kernel gets the axes of the target at once, at least."""


class Decision(NamedTuple):
    """What became of a command.

    constraint : '' if it was passed on as it came
    margin_m, margin_m_s : that the command as it came would leave one tick later
    before_n, after_n : (3,) the command and the force
    """

    mode: str
    constraint: str
    margin_m: float
    margin_m_s: float
    before_n: Signal
    after_n: Signal

    @property
    def sentence(self) -> str:
        """The intervention in words."""
        if not self.constraint:
            return 'the command passes'
        return f'the command would break `{self.constraint}`: changed'

    def values(self, tick: int) -> list[tuple[str, object]]:
        """Return what `assurance_status` says of the intervention."""
        return [
            ('tick', tick),
            ('mode', self.mode),
            ('constraint', self.constraint),
            ('margin_m', float(self.margin_m)),
            ('margin_m_s', float(self.margin_m_s)),
            *((f'before_n.{a}', float(f)) for a, f in zip('xyz', self.before_n, strict=True)),
            *((f'after_n.{a}', float(f)) for a, f in zip('xyz', self.after_n, strict=True)),
        ]


def step_of(settings: Assurance, scenario: Any) -> CwStep:
    """Return the step by which the filter predicts."""
    if settings.mass_kg is None:
        step: CwStep = scenario.step
        return step
    return cw.discretise(scenario.mean_motion_rad_s, settings.mass_kg, scenario.dt_s)


@dataclass(slots=True)
class Numbers:
    """Settings of the kernel `assure_tick`.

    walls, turns : numbers of the corridor in the axes of a target that turns, and 1 where it does;
        else those of `guard`
    step : by which it predicts
    covariance_at : place in u of the covariances; 0: they are not looked at
    watches : 1 where there is an abort table
    frames : axes of the target, tick by tick, as far as they were asked for; of one that does not
        turn those of LVLH
    """

    guard: Guard
    walls: Guard
    doubt: Doubt
    step: CwStep
    covariance_at: int
    turns: int
    watches: int
    table: Table
    frames: list[Frame]


@dataclass(slots=True)
class Memory:
    """Memory of the kernel `assure_tick`.

    mode, lost : set in which the chaser is; 1 where no admissible set allows for the estimate
    oldest, line_n : forces on their way to delayed thrusters, and the place of the oldest one
    acted, margin_m, margin_m_s, command_n, force_n : of the last decision; see `Decision`
    spread_m, spread_m_s : roots of the traces of the last covariances
    """

    line_n: list[list[float]]
    command_n: Annotated[list[float], 3]
    force_n: Annotated[list[float], 3]
    watch: Watch
    mode: int = UNKNOWN
    lost: int = 0
    oldest: int = 0
    acted: int = filters.NOTHING
    margin_m: float = 0.0
    margin_m_s: float = 0.0
    spread_m: float = 0.0
    spread_m_s: float = 0.0


@kernel
def mode_at(state: State, in_axes: State, g: Guard, walls: Guard) -> int:
    """Return the mode in which a flight begins; in_axes, walls : as APPROACH has them."""
    zone, slower = kernels.open_margins(state, 0.0, 0.0, g)
    return OPEN if zone >= 0.0 and slower >= 0.0 else filters.first_mode(in_axes, walls)


@step_kernel
def acting_state(u: Any, p: Any, m: Any) -> State:
    """Return the state (6,) [m, m/s] in which a force of now acts: after those on their way."""
    state, count = (u[0], u[1], u[2], u[3], u[4], u[5]), len(m.line_n)
    for i in range(count):
        at = (m.oldest + i) % count
        force = (m.line_n[at][0], m.line_n[at][1], m.line_n[at][2])
        state = cw_step(state, force, p.step)
    return state


@step_kernel
def spread_at(u: Any, i: int) -> float:
    """Return the root of the trace of a covariance (9,) of u."""
    trace = u[i] + u[i + 4] + u[i + 8]
    return sqrt(trace if trace > 0.0 else 0.0)


@step_kernel
def assure_tick(tick: int, u: Any, p: Any, m: Any, y: Any) -> int:
    """Return ASK where the stage must plan, else 0: y = F(phi(x), u).

    F lets a force pass, or changes it (`assurance.filters`); phi predicts the state over the ticks
    of the thrusters' delay, with the forces on their way. A reaction of the abort table, or what
    acts on an unsure estimate, comes instead of the command. All in target LVLH.

    u : state (6,) [m, m/s], command (3,) [N]; then, where a scenario has them, the reference
        (6,), the attitude (7,) and its reference, the covariances (18,) of the estimate
    y : force (3,) [N]
    """
    i = tick + len(m.line_n)  # in which the force acts
    if p.turns == 1 and i + 1 >= len(p.frames):
        return ASK
    state, command = acting_state(u, p, m), (u[6], u[7], u[8])
    if p.covariance_at > 0:
        m.spread_m = spread_at(u, p.covariance_at)
        m.spread_m_s = spread_at(u, p.covariance_at + 9)
    g = doubted(p.guard, p.doubt, 0.0, m.spread_m, m.spread_m_s)
    w = doubted(p.walls, p.doubt, p.doubt.turns_rad_s, m.spread_m, m.spread_m_s)
    at = i if p.turns == 1 else 0
    now, following = p.frames[at], p.frames[at + p.turns]
    if m.mode == UNKNOWN:
        m.mode = mode_at(state, seen_from(state, now) if p.turns == 1 else state, g, w)
    lost, safe = unless_unsure(state, command, m.mode, p.turns, now, g, w, p.doubt, m.spread_m)
    m.lost = 1 if lost else 0
    if p.watches == 1:
        abort.look_ahead(tick, state, p, m)
        if abort.asks(tick, u, p, m):
            return ASK
        if m.watch.reaction > 0:
            over, command = abort.reaction_n(tick, p, m)
            if over:
                return ASK
            lost = False
        elif abort.is_missed(tick, m.watch):
            command, lost = (0.0, 0.0, 0.0), False
    if lost:
        command = safe
    last = (m.force_n[0], m.force_n[1], m.force_n[2])
    fx, fy, fz, mode, acted, metres, speed = filters.assure(
        state, command, last, m.mode, p.turns, now, following, p.step, g, w
    )
    force = (fx, fy, fz)
    if lost and mode == APPROACH:
        force = command
    m.mode, m.acted, m.margin_m, m.margin_m_s = mode, acted, metres, speed
    if lost:
        m.acted = UNSURE
    m.command_n[0], m.command_n[1], m.command_n[2] = command
    m.force_n[0], m.force_n[1], m.force_n[2] = force
    y[0], y[1], y[2] = force
    if p.watches == 1:
        abort.remember(tick, u, p, m)
    if len(m.line_n) > 0:
        line = m.line_n[m.oldest]
        line[0], line[1], line[2] = force
        m.oldest = (m.oldest + 1) % len(m.line_n)
    return 0


class AssuranceStage(KernelStage):
    """From the state as it is known and a command to a force that keeps the assured sets.

    It remembers the forces that are on their way to delayed thrusters, the last force (slew limit),
    its mode (corridor) and what the abort table counts; without these it has no memory.

    errors : what the numbers of the filter assume
    prediction : step by which it predicts
    delay_ticks : of the thrusters
    motion : of a target with which the corridor turns, as it is known; None: it does not
    abort : the abort table in flight; None: there is none
    """

    name = 'assurance'
    inputs: tuple[str, ...] = (interfaces.STATE, interfaces.COMMAND)
    outputs = (interfaces.ASSURED_FORCE,)
    decides = abort.DECISIONS
    counts_ticks = False
    kernel = assure_tick

    def __init__(self, settings: Assurance, scenario: Any) -> None:
        places = {section_of(s).place for s in scenario.sections}
        looks = settings.sigmas > 0.0 or settings.abort is not None
        estimated = looks and Place.ESTIMATOR in places
        self._proof = proof_of(settings, scenario)
        guard, self.errors, _, walls = self._proof
        self.doubt = doubt_of(settings, scenario, self.errors)
        self.prediction = step_of(settings, scenario)
        self.motion = known_motion(scenario) if walls is not None else None
        self.counts_ticks = self.motion is not None
        self.delay_ticks = scenario.thrusters.delay_ticks if scenario.thrusters else 0
        self.abort: AbortMachine | None = None
        table, watch = abort.NO_TABLE, Watch(0, [], [])
        if settings.abort is not None:
            self.abort = machine = AbortMachine(
                settings.abort, self._proof, settings.keep_out_m, scenario, self
            )
            self.inputs += (interfaces.REFERENCE_STATE,) if Place.GUIDANCE in places else ()
            if settings.abort.watches_pointing:
                self.inputs += (interfaces.ATTITUDE, interfaces.REFERENCE_ATTITUDE)
            self.may_miss, self.counts_ticks = self.inputs[1:], True
            places_in_u = (
                self._place(interfaces.REFERENCE_STATE), self._place(interfaces.ATTITUDE),
                self._place(interfaces.REFERENCE_ATTITUDE),
            )  # fmt: skip
            table, watch = machine.numbers(*places_in_u), machine.memory()
        self.inputs += (interfaces.NAVIGATION_COVARIANCE,) if estimated else ()
        remembers = self.delay_ticks or guard.slew_n > 0.0 or guard.side != 0.0
        self.memory_ticks = None if remembers or self.abort else 0
        p = Numbers(
            guard, walls or guard, self.doubt, self.prediction,
            self._place(interfaces.NAVIGATION_COVARIANCE), int(self.motion is not None),
            int(self.abort is not None), table, [LVLH] if self.motion is None else [],
        )  # fmt: skip
        line = [[0.0] * 3 for _ in range(self.delay_ticks)]
        super().__init__(p, Memory(line, [0.0] * 3, [0.0] * 3, watch))

    def _place(self, name: str) -> int:
        """Return the place in u of an input; 0 if it is none."""
        if name not in self.inputs:
            return 0
        before = self.inputs[: self.inputs.index(name)]
        return sum(_WIDTHS[n] if n in _WIDTHS else width_of(n) for n in before)

    def reset(self) -> None:
        """Forget all earlier ticks."""
        super().reset()
        if self.abort is not None:
            self.abort.changes.clear()

    def answer(self, tick: int, u: Sequence[float]) -> None:
        """Give the kernel the axes of the target, or decide for the abort table."""
        count, last = len(self.p.frames), tick + self.delay_ticks + 1
        if self.motion is not None and last >= count:
            frames = self.motion.frames(max(last + FRAMES_AHEAD, 2 * count))
            self.p.frames = as_rows(frames, Frame)
        elif self.abort is not None:
            self.abort.answer(tick)

    def answer_ahead(self, ticks: int, u: Sequence[float]) -> None:
        """Give the kernel the axes of the target in a flight."""
        if self.abort is not None:
            raise InputError('`assurance.abort` decides in flight; take it out of the scenario')
        if self.motion is not None:
            self.p.frames = as_rows(self.motion.frames(ticks + self.delay_ticks + 2), Frame)

    def take_event(self, tick: int, state: str) -> None:
        """Take a command to the abort table, or word of a missing one."""
        if self.abort is not None:
            self.abort.take_event(tick, state)

    def decided(self) -> list[tuple[int, str]]:
        """Return what the abort table decided: tick and state of each change."""
        changes = self.abort.changes if self.abort is not None else []
        return [(change.tick, change.state) for change in changes]

    def goes_without(self, tick: int) -> bool:
        """Return whether it steps without a command: none came, or nobody would read it."""
        return self.abort is not None and (self.abort.missed(tick) or self.abort.alone(tick))

    def trouble(self) -> str:
        """Return what is wrong: the estimate is worse than any speed is safe with."""
        if not self.m.lost:
            return ''
        return (
            'the covariance of the estimate is larger than any admissible set allows for: stopping'
        )

    @property
    def decision(self) -> Decision | None:
        """What became of the last command; None before the first tick."""
        m = self.m
        if m.mode == UNKNOWN:
            return None
        before, after = (tuple(float(f) for f in force) for force in (m.command_n, m.force_n))
        return Decision(MODES[m.mode], _ACTED[m.acted], m.margin_m, m.margin_m_s, before, after)

    @property
    def guard(self) -> Guard:
        """Numbers of the filter, with the errors that the last estimate has."""
        return self._doubted(self._proof.guard, 0.0)

    @property
    def walls(self) -> Guard | None:
        """Those of the corridor in the axes of a target that turns; None: as `guard` has them."""
        walls = self._proof.walls
        return None if walls is None else self._doubted(walls, self.doubt.turns_rad_s)

    def _doubted(self, guard: Guard, turns_rad_s: float) -> Guard:
        return doubted(guard, self.doubt, turns_rad_s, self.m.spread_m, self.m.spread_m_s)

    def ahead(self, state: Signal) -> State:
        """Return the state (6,) [m, m/s] in which the first force acts."""
        x, y, z, vx, vy, vz = state
        predicted: State = (x, y, z, vx, vy, vz)
        for _ in range(self.delay_ticks):
            predicted = cw_step(predicted, ZERO, self.prediction)
        return predicted

    def mode_of(self, state: State, tick: int = 0) -> int:
        """Return the mode in which a flight begins; tick : in which its first force acts."""
        in_axes, walls = self.view(state, APPROACH, tick)
        return mode_at(state, in_axes, self.guard, walls)

    def view(self, state: State, mode: int, tick: int) -> tuple[State, Guard]:
        """Return a state as the set of a mode has it, in the target's axes, and its numbers."""
        walls = self.walls
        if mode != APPROACH or self.motion is None or walls is None:
            return state, self.guard
        return seen_from(state, self.motion.frame(tick)), walls


def check_start(settings: Assurance, scenario: Any) -> None:
    """Refuse what cannot be assured, and a flight that begins outside the assured sets.

    Raises InputError with all that conflicts, and values that work if trials find some.
    """
    conflicts, changed = _conflicts(settings, scenario)
    if conflicts:
        least = {name: bound for name, (bound, _, _) in known(settings, scenario).items()}

        def works(section: Assurance) -> bool:
            return not _conflicts(section, scenario)[0]

        start_m = scenario.initial_position_m
        would_do = values_that_work(settings, changed, least, start_m, works)
        raise InputError('; '.join(conflicts) + would_do)


def _conflicts(settings: Assurance, scenario: Any) -> tuple[list[str], dict[str, Any]]:
    """Return what a section and its scenario refuse of each other, and what it must assume.

    Where it assumes too little, the rest is looked at with what is known at least.
    """
    conflicts, changed = compared(settings, known(settings, scenario))
    conflicts += filter(None, [short_tank(scenario)])
    if settings.abort is not None:
        with _noted(conflicts):
            check_table(settings.abort, scenario, settings.keep_out_m, settings.corridor)
    if changed.get('thrust_error', 0.0) > 1.0:
        return conflicts, changed
    with _noted(conflicts):
        stage = AssuranceStage(replace(settings, **changed), scenario)
        state = stage.ahead(scenario.start)
        mode = stage.mode_of(state, stage.delay_ticks)
        rho = max(kernels.closing(state)[0], norm(*scenario.initial_position_m))
        if rho > settings.domain_m:
            conflicts.append(
                f'`assurance.domain_m` must be at least the range of the start, {upwards(rho)} m; '
                f'got {settings.domain_m!r}'
            )
        for check in (_check_speed, _check_sets, _check_first_ticks):
            with _noted(conflicts):
                check(stage, scenario, state, mode)
    return conflicts, changed


@contextmanager
def _noted(conflicts: list[str]) -> Iterator[None]:
    """Note an InputError instead of raising it."""
    try:
        yield
    except InputError as error:
        conflicts.append(str(error))


def _check_speed(stage: AssuranceStage, scenario: Any, state: State, mode: int) -> None:
    g, (rho, _, speed) = stage.guard, kernels.closing(state)
    in_axes, numbers = stage.view(state, mode, stage.delay_ticks)
    doubt = _drift(stage, scenario, stage.delay_ticks)
    doubt = (numbers.here_m, numbers.here_m_s) if g.side != 0.0 else doubt
    if filters.margins(in_axes, mode, *doubt, numbers)[1] < 0.0:
        raise InputError(
            f'`assurance.speed` must allow the start: {kernels.speed_limit(rho, g):.6g} m/s at '
            f'{rho:.6g} m; got {speed:.6g} m/s, known to {doubt[1]:.6g} m/s'
        )


def _check_sets(stage: AssuranceStage, scenario: Any, state: State, mode: int) -> None:
    begins, numbers = stage.view(scenario.start, mode, 0)
    _check_room(begins, mode, (0.0, 0.0), numbers)
    in_axes, numbers = stage.view(state, mode, stage.delay_ticks)
    _check_room(in_axes, mode, (numbers.here_m, numbers.here_m_s), numbers)


def _check_first_ticks(stage: AssuranceStage, scenario: Any, _state: State, mode: int) -> None:
    state = scenario.start
    for tick in range(stage.delay_ticks):
        off_m = _drift(stage, scenario, tick)[0]
        if _clear_m(*stage.view(state, mode, tick), mode, off_m) < 0.0:
            raise InputError(
                '`assurance.keep_out_m` and the start exclude each other: before the first force '
                f'acts, after {tick} ticks, it may come to {kernels.closing(state)[0] - off_m:.6g} '
                'm from the target'
            )
        state = cw_step(state, ZERO, stage.prediction)


def _drift(stage: AssuranceStage, scenario: Any, ticks: int) -> tuple[float, float]:
    """Return what the disturbance does [m], [m/s] in the first ticks, before a force acts."""
    disturbed = stage.errors._replace(position_m=0.0, velocity_m_s=0.0, thrust=0.0)
    return ahead(disturbed, scenario, ticks)


def _clear_m(state: State, g: Guard, mode: int, off_m: float) -> float:
    """Return how far [m] a state without forces is clear of the zone, or of the walls."""
    if mode == APPROACH:
        return filters.margins(state, mode, off_m, 0.0, g)[0]
    return kernels.closing(state)[0] - off_m - g.keep_out_m


def _check_room(state: State, mode: int, errors: tuple[float, float], g: Guard) -> None:
    """Refuse a state that may be outside of its set within the errors [m], [m/s]."""
    metres = filters.margins(state, mode, *errors, g)[0]
    if metres >= 0.0:
        return
    rho, closing, _ = kernels.closing(state)
    if mode == OPEN and kernels.both_margins(state, *errors, g)[0] >= 0.0:
        left, way = g.domain_m - rho, f'{-closing:.6g} m/s away from the target'
        name = 'domain_m'
    else:
        left, way = rho - g.keep_out_m, f'{closing:.6g} m/s towards the target'
        name = 'keep_out_m'
    raise InputError(
        f'`assurance.{name}` and the start exclude each other: at {way} it takes '
        f'{left - metres:.6g} m to stop, errors of {errors[0]:.6g} m and {errors[1]:.6g} m/s '
        f'included, and {left:.6g} m are left'
    )


register(Section('assurance', Assurance, Place.ASSURANCE, AssuranceStage, check_start))
