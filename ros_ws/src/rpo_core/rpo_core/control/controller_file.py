# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What every controller file holds, and the kinds of controller that a file may name.

To add a kind, write a frozen dataclass and one line (`register`) in a module of your own
(`rpo_core.plugins`). Its fields are those of the file.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import partial
from itertools import chain
from operator import sub
from typing import Annotated, Any, ClassVar, NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rpo_core import plugins
from rpo_core.control.blend import Reasons
from rpo_core.files import codec
from rpo_core.files.validation import (
    Checked,
    Description,
    InputError,
    Name,
    Provenance,
    choice,
    real,
    shown,
)
from rpo_core.kernels.arithmetic import State, Vector
from rpo_core.kernels.calls import ASK, call
from rpo_core.kernels.jit import COMPILED, step_kernel
from rpo_core.scenario.scenario import Scenario
from rpo_core.stage import KernelStage, Signal, Stage, has_kernel, places_of
from rpo_core.wire import interfaces

SCHEMA = 'rpo/controller/1'

Units = Mapping[str, tuple[int, int, int]]
"""Field -> powers of metre, second and newton in its unit."""

Scaled = TypeVar('Scaled', bound='ControllerFile')


class Scaling(NamedTuple):
    """Units of length, time and force as multiples of former ones, and the vehicle that is flown.

    The closed loop is similar where the mass is a multiple by force x time^2 / length.
    """

    length: float
    time: float
    force: float
    vehicle: Scenario

    def of(self, value: Any, powers: tuple[int, int, int]) -> Any:
        """Return a number, or tuples of numbers, of a unit with these powers, in the new units.

        By products and quotients alone: the same bits on every machine, and multiples that are
        powers of two change no digit.
        """
        if isinstance(value, tuple):
            return tuple(self.of(item, powers) for item in value)
        for unit, power in zip(self[:3], powers, strict=True):
            for _ in range(abs(power)):
                value = value * unit if power > 0 else value / unit
        return value


class ControllerStage(Stage):
    """A controller in the chain: from the state that it sees to the commanded force."""

    name = 'controller'
    inputs: tuple[str, ...] = (interfaces.STATE,)
    outputs = (interfaces.CONTROL_FORCE,)


_STATES = (interfaces.STATE, interfaces.RELATIVE_STATE, interfaces.NAVIGATION_STATE)


@dataclass(slots=True)
class Following:
    """Settings of the kernel `follow`.

    step, settings, memory : of the controller, as `calls.call` takes them; step 0: it has no kernel
    states : where the states stand in u that the controller reads
    relative : whether it gets them relative to an origin, the goal or the reference
    guided, compensated : whether u has the reference, the disturbance
    force : where its command stands in y
    goal : (9,) state [m, m/s] and force [N] of the goal
    """

    step: int
    settings: int
    memory: int
    states: list[int]
    relative: int
    guided: int
    compensated: int
    force: int
    goal: list[float]


@dataclass(slots=True)
class Followed:
    """Memory of the kernel `follow`.

    inputs : of the controller
    outputs : of one without a kernel; then 1.0 where they are those of this tick
    origin : (9,) state and force of this tick that the controller gets states relative to
    """

    inputs: list[float]
    outputs: list[float]
    origin: Annotated[list[float], 9]


@step_kernel
def follow(tick: int, u: Any, p: Any, m: Any, y: Any) -> int:
    """F = F_law(x - x_o) + F_o - D, for the force F among the outputs y of a controller.

    u : what the controller reads, with states x (6,) [m, m/s]; then, if guided, the reference x_o
        (6,) and the force F_o (3,) [N] that it needs, else those of the goal; then, if compensated,
        the disturbance D (3,) [N]; all of target LVLH
    """
    inputs, outputs, origin = m.inputs, m.outputs, m.origin
    size, width = len(inputs), len(y)
    if p.relative != 0:
        for i in range(9):
            origin[i] = u[size + i] if p.guided != 0 else p.goal[i]
    if outputs[width] == 0.0:
        for i in range(size):
            inputs[i] = u[i]
        if p.relative != 0:
            for k in range(len(p.states)):
                for i in range(6):
                    inputs[p.states[k] + i] -= origin[i]
        if p.step == 0:
            return ASK
        asked = call(p.step, tick, inputs, p.settings, p.memory, y, 0, width)
        if asked != 0:
            return asked
    else:
        outputs[width] = 0.0
        for i in range(width):
            y[i] = outputs[i]
    if p.relative != 0:
        for i in range(3):
            y[p.force + i] += origin[6 + i]
    if p.compensated != 0:
        opposed = size + 9 * p.guided
        for i in range(3):
            y[p.force + i] -= u[opposed + i]
    return 0


class FollowStage(KernelStage):
    """A controller that was made for the target, and flies to a goal or follows a reference.

    It gets the state relative to the goal or the reference. Its command gets the force on top that
    a chaser at rest at the goal, or on the reference, needs: off V-bar, relative gravity would
    otherwise push the chaser off the goal. It may oppose the disturbance that is estimated.

    Its kernel calls that of the controller; a controller without one answers as Python, once a
    tick.

    inner : the controller
    goal : state (6,) [m, m/s] and force (3,) [N], target LVLH; None: those of the signals of
        guidance, if `guided`, or none
    compensated : whether the disturbance [N] estimated at a tick is taken from its command
    """

    kernel = follow

    def __init__(
        self, inner: Stage, goal: tuple[State, Vector] | None, guided: bool, compensated: bool
    ) -> None:
        self.inner = inner
        self.name, self.outputs = inner.name, inner.outputs
        followed = (interfaces.REFERENCE_STATE, interfaces.REFERENCE_FORCE) if guided else ()
        opposed = (interfaces.ESTIMATED_DISTURBANCE,) if compensated else ()
        self.inputs = (*inner.inputs, *followed, *opposed)
        self.memory_ticks, self.counts_ticks = inner.memory_ticks, inner.counts_ticks
        self._read, made = places_of(inner.inputs), places_of(inner.outputs)
        states = [self._read[i].start for i, n in enumerate(inner.inputs) if n in _STATES]
        force = made[inner.outputs.index(interfaces.CONTROL_FORCE)].start
        flags = int(guided or goal is not None), int(guided), int(compensated)
        numbers = [x for values in goal or () for x in values]
        super().__init__(
            Following(0, 0, 0, states, *flags, force, numbers),
            Followed([0.0] * self._read[-1].stop, [0.0] * (made[-1].stop + 1), [0.0] * 9),
        )

    @property
    def row(self) -> tuple[Any, Any, Any]:
        """The kernel, its settings and its memory; the settings have those of the controller."""
        if self._row is None and has_kernel(self.inner):
            self.p.step, self.p.settings, self.p.memory = self.inner.row
        return super().row

    def reset(self) -> None:
        """Forget all earlier ticks."""
        super().reset()
        self.inner.reset()

    def answer_ahead(self, ticks: int, u: Any) -> None:
        """Do nothing: the controller is asked itself."""

    def answer(self, tick: int, u: Any) -> None:
        """Let the controller plan, or answer itself if it has no kernel."""
        given = self.m.inputs
        if has_kernel(self.inner):
            self.inner.answer(tick, given)
            return
        given = given.tolist() if COMPILED else given
        outputs = self.inner.step(tick, *[tuple(given[place]) for place in self._read])
        self.m.outputs[:] = [*chain.from_iterable(outputs), 1.0]


def received(scenario: Any, signals: Mapping[str, Any]) -> tuple[Signal, Signal]:
    """Return the state (6,) that a controller was given at a tick, and the force on top of its law.

    The state is that of navigation where there is one, and relative to the reference of guidance
    or else to the goal.

    signals : those of the tick, each a sequence of numbers
    """
    state = signals.get(interfaces.NAVIGATION_STATE, signals[interfaces.RELATIVE_STATE])
    if interfaces.REFERENCE_STATE in signals:
        seen = tuple(map(sub, state, signals[interfaces.REFERENCE_STATE]))
        return seen, tuple(signals[interfaces.REFERENCE_FORCE])
    force_n = (0.0, 0.0, 0.0) if scenario.goal is None else scenario.goal.force_n
    return tuple(scenario.from_goal(state)), force_n


class ControllerBase(Checked):
    """What every controller of a file can do: answer a state, or many, without a flight.

    alike : whether each axis has the same law, of its own position and velocity
    """

    kind: ClassVar[str]
    alike: ClassVar[bool] = False
    name: str
    description: str

    @property
    def clock_s(self) -> float | None:
        """Length of the ticks that it counts; None if it counts none."""
        return None

    def stage(self, dt_s: float) -> Stage:
        """Return the controller as a stage of the chain; with memory, one for each flight.

        Raises InputError if it counts ticks of another length than `dt_s`.
        """
        raise NotImplementedError

    def force_n(
        self, position_m: Sequence[float], velocity_m_s: Sequence[float], tick: int = 0
    ) -> tuple[float, float, float]:
        """Return the force (3,) [N] that it commands in a relative state, target LVLH, at a tick.

        The state must be finite; callers at the edge check it.
        """
        stage = self.stage(self.clock_s or 1.0)
        x, y, z = stage.step(tick, tuple(map(float, (*position_m, *velocity_m_s))))[0]
        return x, y, z

    def __repr__(self) -> str:
        return f'<{type(self).__name__} {self.name}: {self.description or self.kind}>'

    def __call__(
        self,
        t: float = 0.0,
        x: ArrayLike | None = None,
        *,
        position: ArrayLike | None = None,
        velocity: ArrayLike | None = None,
    ) -> NDArray[np.float64]:
        """Return the force that it commands: of states, or of one axis.

        `law(t, x)` answers states, `law(position=..., velocity=...)` positions and velocities of
        an axis; both broadcast over arrays. The bits are those of a flight.

        Parameters
        ----------
        t : float
            Time since the start [s]; only a controller with a clock reads it.
        x : array_like, shape (..., 6), optional
            States x, y, z [m], vx, vy, vz [m/s], target LVLH, relative to the goal.
        position, velocity : array_like, optional
            Of the chaser on an axis [m], [m/s]; they are broadcast against each other.

        Returns
        -------
        ndarray
            Forces (..., 3) [N] of states; those of the axis [N] in the shape of the broadcast.

        Raises
        ------
        InputError
            If neither form is given, a number is not finite, or the controller has no such form.

        Examples
        --------
        >>> import rpo
        >>> law = rpo.controller('allround')
        >>> law(0.0, [10.0, 0.0, 0.0, 0.0, 0.0, 0.0]).shape
        (3,)
        >>> law(position=[-10.0, 0.0, 10.0], velocity=0.0).shape
        (3,)
        """
        if x is not None and position is None and velocity is None:
            return self._forces(t, _numbers('x', x, 6))
        if x is not None or position is None or velocity is None:
            raise InputError(
                f'controller {self.name}: law(t, x) or law(position=..., velocity=...) expected'
            )
        if not self.alike:
            raise InputError(
                f'controller {self.name} answers whole states, not one axis: use law(t, x)'
            )
        r, v = _numbers('position', position), _numbers('velocity', velocity)
        try:
            r, v = np.broadcast_arrays(r, v)
        except ValueError:
            raise InputError(
                f'`position` and `velocity` must broadcast; got shapes {r.shape} and {v.shape}'
            ) from None
        states = np.zeros((*r.shape, 6))
        states[..., 0], states[..., 3] = r, v
        return self._forces(t, states)[..., 0][()]

    def _forces(self, t: float, states: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the forces (..., 3) [N] that answer states (..., 6), each for itself."""
        clock_s = self.clock_s
        stage = self.stage(clock_s or 1.0)
        if stage.memory_ticks != 0 or stage.inputs != (interfaces.STATE,):
            raise InputError(f'controller {self.name} answers in a flight only: it has memory')
        stage.reset()
        rows = states.reshape(-1, 6)
        ticks = np.full(len(rows), round(t / clock_s) if clock_s else 0)
        return stage.steps(ticks, rows)[0].reshape(*states.shape[:-1], 3)

    def with_rule(self, position: str, velocity: str, force: str) -> Any:
        """Return the controller with another rule: see `FuzzyController.with_rule`."""
        raise InputError(self._without_rules())

    def with_membership(self, variable: str, **numbers: float) -> Any:
        """Return it with another membership: see `FuzzyController.with_membership`."""
        raise InputError(self._without_rules())

    def _without_rules(self) -> str:
        return (
            f'controller {self.name} is of kind {self.kind}, without a table of rules; '
            'a fuzzy one, like allround, has one'
        )


def _numbers(name: str, value: ArrayLike, last: int = 0) -> NDArray[np.float64]:
    """Return finite numbers, with a `last` axis of that length if it is not 0."""
    try:
        numbers = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f'`{name}` must be numbers; got {shown(value)}') from None
    if last and numbers.shape[-1:] != (last,):
        raise InputError(f'`{name}` must have shape (..., {last}); got {numbers.shape}')
    if not np.isfinite(numbers).all():
        raise InputError(f'`{name}` must be finite; got {shown(value)}')
    return numbers


@dataclass(frozen=True, kw_only=True, repr=False)
class ControllerFile(ControllerBase):
    """A controller of a kind that names itself.

    units : of the numbers that `scaled` multiplies; None: the kind does not say how it scales
    max_force_n : largest |f| of an axis that is commanded
    provenance : how its parameters came to be; free text and numbers, not read by the control
    """

    units: ClassVar[Units | None] = None

    name: Name
    description: Description = field(default='', compare=False)
    max_force_n: Annotated[float, partial(real, unit='N', above=0.0, most=1e6)] = 0.5
    provenance: Provenance = field(default_factory=dict, compare=False)

    def scaled(self: Scaled, scaling: Scaling, **also: Any) -> Scaled:
        """Return the controller of the similar loop; `also`: fields that change otherwise.

        It commands no more than the force of the vehicle. Raises InputError where its kind does not
        say how it scales, or the numbers are out of range.
        """
        if self.units is None:
            raise InputError(
                f'controller {self.name} cannot be scaled: its kind `{self.kind}` has no `units`'
            )
        most_n = min(scaling.of(self.max_force_n, (0, 0, 1)), scaling.vehicle.max_force_n)
        found = {name: scaling.of(getattr(self, name), by) for name, by in self.units.items()}
        return replace(self, max_force_n=most_n, **{**found, **also})

    def reasons(self, state: State, tick: int) -> Sequence[Reasons]:
        """Return why x, y, z get the force that answers a state; empty: it has no more to say."""
        return ()

    def refuse_other_ticks(self, dt_s: float) -> None:
        """Raise InputError if it counts ticks of another length than `dt_s`."""
        if self.clock_s is not None and self.clock_s != dt_s:
            raise InputError(
                f'controller {self.name} counts ticks of {self.clock_s:g} s; '
                f'the scenario has {dt_s:g} s'
            )


Kind = TypeVar('Kind', bound=type[ControllerFile])

_KINDS: dict[str, type[ControllerFile]] = {}


def register(kind: Kind) -> Kind:
    """Let controller files be of a kind; raises InputError if there is one of that name."""
    if kind.kind in _KINDS:
        raise InputError(f'controller kind `{kind.kind}` must be registered once; it is already')
    _KINDS[kind.kind] = kind
    return kind


def kinds() -> Mapping[str, type[ControllerFile]]:
    """Return name -> class of all kinds that a file may name; loads the plug-ins first."""
    plugins.load()
    return _KINDS


def parse(document: Mapping[str, Any]) -> ControllerFile:
    """Return the controller of a document that names its kind; raises InputError."""
    kind = kinds()[choice('kind', document['kind'], kinds())]
    needed = {f.name for f in fields(kind)} - {'description', 'provenance'}
    body = {key: value for key, value in document.items() if key not in ('schema', 'kind')}
    return codec.from_mapping(kind, '', body, needed=needed)


def to_document(controller: ControllerFile) -> dict[str, Any]:
    """Return the fields of a controller as `parse` reads them, without the schema."""
    found = codec.to_mapping(controller)
    name, provenance = found.pop('name'), found.pop('provenance')
    return {'name': name, 'kind': controller.kind, **found, 'provenance': provenance}
