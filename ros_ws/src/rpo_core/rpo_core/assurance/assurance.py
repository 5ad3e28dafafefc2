# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Stage `assurance`: between any controller and the thrusters."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from math import degrees, sqrt
from typing import Any, NamedTuple

from rpo_core.assurance import filters, kernels
from rpo_core.assurance.abort import DECISIONS, AbortMachine, Seen
from rpo_core.assurance.abort_table import check_table
from rpo_core.assurance.assumed import ahead, compared, known, short_tank, upwards
from rpo_core.assurance.doubt import doubt_of, doubted, unless_unsure, unless_unsure_turning
from rpo_core.assurance.filters import Filter
from rpo_core.assurance.guard import proof_of
from rpo_core.assurance.kernels import APPROACH, CONTACT, OPEN, Guard
from rpo_core.assurance.settings import Assurance
from rpo_core.assurance.working import values_that_work
from rpo_core.attitude.attitude_kernels import moving_with, seen_from, to_lvlh
from rpo_core.attitude.chaser import times
from rpo_core.attitude.target import known_motion
from rpo_core.files.validation import InputError
from rpo_core.kernels.arithmetic import State, Vector, norm
from rpo_core.stage import ZERO, Place, Section, Signal, Stage, register, section_of
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
COVARIANCE = 'covariance'
"""Constraint of a stop because an estimate became worse than any admissible set allows for."""


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


class AssuranceStage(Stage):
    """From the state as it is known and a command to a force that keeps the assured sets.

    It remembers the forces that are on their way to delayed thrusters, the last force (slew limit),
    its mode (corridor) and what the abort table counts; without these it has no memory.

    guard, errors : numbers of the filter, and what they assume
    walls : numbers of the corridor in the axes of a target that turns; None: as `guard` has them
    prediction, numbers : step by which it predicts; (58,) or (90,) of `rpo_core.assurance.filters`
    delay_ticks : of the thrusters
    motion : of a target with which the corridor turns, as it is known; None: it does not
    decision : of the last tick
    abort : the abort table in flight; None: there is none
    """

    name = 'assurance'
    inputs: tuple[str, ...] = (interfaces.STATE, interfaces.COMMAND)
    outputs = (interfaces.ASSURED_FORCE,)
    decides = DECISIONS
    counts_ticks = False

    def __init__(self, settings: Assurance, scenario: Any) -> None:
        places = {section_of(s).place for s in scenario.sections}
        looks = settings.sigmas > 0.0 or settings.abort is not None
        self._estimated = looks and Place.ESTIMATOR in places
        self._proof = proof_of(settings, scenario)
        self.guard, self.errors, _, self.walls = self._proof
        self.doubt = doubt_of(settings, scenario, self.errors)
        self.prediction = step_of(settings, scenario)
        self.motion = known_motion(scenario) if self.walls is not None else None
        self.counts_ticks = self.motion is not None
        self._filter = Filter(self.prediction, self.guard, self.walls, self.motion)
        self.numbers = self._filter.table
        self.delay_ticks = scenario.thrusters.delay_ticks if scenario.thrusters else 0
        self.abort, self._pointed = None, 0
        if settings.abort is not None:
            self.abort = AbortMachine(settings.abort, self._proof, settings.keep_out_m, scenario)
            self.inputs += (interfaces.REFERENCE_STATE,) if Place.GUIDANCE in places else ()
            if settings.abort.watches_pointing:
                self._pointed = len(self.inputs)
                self.inputs += (interfaces.ATTITUDE, interfaces.REFERENCE_ATTITUDE)
            self.may_miss, self.counts_ticks = self.inputs[1:], True
        self.inputs += (interfaces.NAVIGATION_COVARIANCE,) if self._estimated else ()
        remembers = self.delay_ticks or self.guard.slew_n > 0.0 or self.guard.side != 0.0
        self.memory_ticks = None if remembers or self.abort else 0
        self.reset()

    def reset(self) -> None:
        """Forget the forces on their way: a flight begins."""
        self._line: deque[Vector] = deque([ZERO] * self.delay_ticks)
        self._last: Vector = ZERO
        self._applied: Vector = ZERO  # what the chaser got in the tick before
        self._mode = UNKNOWN
        self._lost = False  # the state is known worse than any admissible set allows for
        self.decision: Decision | None = None
        if self.abort is not None:
            self.abort.reset()

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
        if not self._lost:
            return ''
        return (
            'the covariance of the estimate is larger than any admissible set allows for: stopping'
        )

    def ahead(self, state: Signal) -> State:
        """Return the state (6,) [m, m/s] in which a force of now acts: after those on their way."""
        x, y, z, vx, vy, vz = state
        predicted: State = (x, y, z, vx, vy, vz)
        for force in self._line:
            predicted = cw_step(predicted, force, self.prediction)
        return predicted

    def mode_of(self, state: State, tick: int = 0) -> int:
        """Return the mode in which a flight begins, or goes on after a gap.

        tick : in which a force of now acts, as in what follows
        """
        if min(kernels.open_margins(state, 0.0, 0.0, self.guard)) >= 0.0:
            return OPEN
        return filters.first_mode(*self.view(state, APPROACH, tick))

    def view(self, state: State, mode: int, tick: int) -> tuple[State, Guard]:
        """Return a state as the set of a mode has it, in the target's axes, and its numbers."""
        if mode != APPROACH or self.motion is None or self.walls is None:
            return state, self.guard
        return seen_from(state, self.motion.frame(tick)), self.walls

    def step(self, tick: int, *inputs: Any) -> tuple[Signal, ...]:
        """Return the assured force (3,) [N]."""
        spreads = _spreads(inputs[-1]) if self._estimated else (0.0, 0.0)
        state, command = self.ahead(inputs[0]), inputs[1]
        acts = tick + self.delay_ticks
        if self._mode == UNKNOWN:
            self._mode = self.mode_of(state, acts)
        safe = self._safe(state, command, acts, *spreads)
        interruption = self._interrupted(tick, state, inputs, spreads)
        if interruption is not None:
            command = interruption
        elif self._lost:
            command = safe
        answer = self._filter(state, command, self._last, self._mode, acts)
        fx, fy, fz, mode, acted, metres, speed = answer
        force: Vector = (fx, fy, fz)
        if interruption is None and self._lost and mode == APPROACH:
            force = command
        if self.abort is not None:
            self.abort.spend(force)
            self._applied = self._line[0] if self.delay_ticks else force
        if self.memory_ticks is None:
            self._mode, self._last = mode, force
            if self.delay_ticks:
                self._line.append(force)
                self._line.popleft()
        constraint = COVARIANCE if self._lost and interruption is None else CONSTRAINTS[acted]
        self.decision = Decision(MODES[mode], constraint, metres, speed, command, force)
        return (force,)

    def _safe(
        self, state: State, command: Vector, tick: int, spread_m: float, spread_m_s: float
    ) -> Vector:
        """Take the spread of an estimate, with which errors grow; return what acts by it [N]."""
        d, (guard, _, _, walls), mode = self.doubt, self._proof, self._mode
        if d.sigmas == 0.0:
            return command
        self.guard = doubted(guard, d, 0.0, spread_m, spread_m_s)
        if walls is None or self.motion is None:
            answer = unless_unsure(state, command, mode, self.guard, d, spread_m)
        else:
            self.walls = walls = doubted(walls, d, d.turns_rad_s, spread_m, spread_m_s)
            now = self.motion.frame(tick)
            answer = unless_unsure_turning(
                state, command, mode, now, self.guard, walls, d, spread_m
            )
        self._filter.use(self.guard, self.walls)
        self._lost, force = answer
        return force

    def _interrupted(
        self, tick: int, state: State, inputs: tuple[Any, ...], sigmas: tuple[float, float]
    ) -> Signal | None:
        """Return the force of the abort table instead of the command; None: the command stands."""
        machine, decision = self.abort, self.decision
        if machine is None:
            return None
        reference = inputs[2] if interfaces.REFERENCE_STATE in self.inputs else ()
        enclosed = self._mode == APPROACH and norm(*state[:3]) < self.guard.keep_out_m
        side, axis = self.guard.side, self.guard.axis
        outward: Any = tuple(side if i == axis else 0.0 for i in range(3))
        in_axes: Any = inputs[0]
        carried: Signal = ()
        if self.motion is not None:
            frame = self.motion.frame(tick + self.delay_ticks)
            in_axes = seen_from(in_axes, self.motion.frame(tick))
            outward = to_lvlh(outward, frame)
            carried = moving_with((*seen_from(state, frame)[:3], 0.0, 0.0, 0.0), frame)[3:]
        missed = machine.missed(tick)
        seen = Seen(
            inputs[0], state, () if missed else reference, *sigmas,
            decision is not None and bool(decision.constraint), self._applied, enclosed, self.guard,
            in_axes, outward, carried, self._pointing_deg(inputs),
        )  # fmt: skip
        interruption = machine.step(tick, seen)
        return ZERO if interruption is None and missed else interruption

    def _pointing_deg(self, inputs: tuple[Any, ...]) -> float:
        """Return the angle off the reference, twice the sine of half of it; 0.0 where unknown."""
        if not self._pointed:
            return 0.0
        (x, y, z, w, *_), wanted = inputs[self._pointed : self._pointed + 2]
        return degrees(2.0 * norm(*times((-x, -y, -z, w), wanted[:4])[:3]))


def _spreads(covariance: Signal) -> tuple[float, float]:
    """Return the roots of the traces [m], [m/s] of the covariances (18,) of an estimate."""
    c = covariance
    return sqrt(max(c[0] + c[4] + c[8], 0.0)), sqrt(max(c[9] + c[13] + c[17], 0.0))


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


register(
    Section(
        'assurance',
        Assurance,
        Place.ASSURANCE,
        AssuranceStage,
        check_start,
        zones=Assurance.zones,
        of_zones=Assurance.of_zones,
    )
)
