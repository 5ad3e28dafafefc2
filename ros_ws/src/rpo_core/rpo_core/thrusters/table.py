# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Thrusters with places and directions: section `thrusters.table`, and the force that they have.

The body's axes are those of target LVLH. No torque is wanted; what the allocation
(`allocation_kernels`) leaves over acts about the centre of mass. The forces that thrusters can
exert without torque are a convex polytope; its facets come from the same dual simplex method, with
no torque allowed.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from itertools import chain, combinations, permutations, product
from typing import Annotated, NamedTuple

import numpy as np

from rpo_core.files.codec import unless_default
from rpo_core.files.validation import (
    Checked,
    InputError,
    choice,
    flag,
    optional,
    real,
    text,
    vector3,
)
from rpo_core.kernels.arithmetic import Vector, norm
from rpo_core.kernels.arrays import Floats
from rpo_core.kernels.jit import as_table
from rpo_core.stage import ZERO
from rpo_core.thrusters import allocation_kernels
from rpo_core.thrusters.allocation_kernels import MOST_THRUSTERS, ROWS, SCRATCH, Table
from rpo_core.thrusters.pulse_kernels import OFF, ON

PULSE_WIDTH, SIGMA_DELTA = MODULATIONS = ('pulse_width', 'sigma_delta')
FACES_6, PAIRS_12, QUADS_16, CORNERS_24 = PRESETS = (
    'faces_6',
    'pairs_12',
    'quads_16',
    'corners_24',
)
"""One in the middle of each face; two on each face; four groups of four around x; three at each
corner of a cube."""

NEVER_S = 1e9

PENALTY = 1000.0
"""A newton of torque over the lever weighs as much as the propellant of so many newtons."""

_GENERIC = (
    (1.0, 0.81421, 0.66180),
    (1.0, 0.81421, 0.16180),
    (1.0, 0.31421, 0.16180),
    (1.0, 0.11421, 0.06180),
)
"""Directions in no plane of symmetry: their mirror images find the bases to start from."""

_GOLDEN = 0.6180339887498949
_PREFERENCE = 2.0**-24
"""Of thrusters that cost the same the programme prefers some: its optimum is then one."""

IDENTITY = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))

seconds = partial(real, unit='s', least=0.0, most=NEVER_S)
_metres = partial(vector3, unit='m', bound=1e3)
_newtons = partial(real, unit='N', above=0.0, most=1e6)
_optional_newtons = partial(optional, unit='N', above=0.0, most=1e6)
_impulse = partial(real, unit='N s', least=0.0, most=1e6)
_specific = partial(optional, unit='s', least=1.0, most=1e5)


@dataclass(frozen=True, kw_only=True)
class Failure(Checked):
    """A thruster that is stuck for a time.

    stuck : `off` or `on`
    known : whether the allocation knows of it, and lets the other thrusters make up for it
    """

    thruster: Annotated[str, text]
    stuck: Annotated[str, partial(choice, known=('off', 'on'))]
    from_s: Annotated[float, seconds] = unless_default(0.0)
    until_s: Annotated[float, seconds] = unless_default(NEVER_S)
    known: Annotated[bool, flag] = unless_default(False)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.until_s <= self.from_s:
            raise InputError(f'`until_s` must be > `from_s`, {self.from_s!r}; got {self.until_s!r}')


@dataclass(frozen=True, kw_only=True)
class Thruster(Checked):
    """One thruster, body axes.

    position_m : where it pushes; direction : to where it pushes the chaser, of any length
    minimum_impulse_bit_n_s : of a tick; it fires at least that or not at all
    specific_impulse_s : None: that of `propellant`
    """

    name: Annotated[str, text]
    position_m: Annotated[Vector, _metres]
    direction: Annotated[Vector, partial(vector3, unit='1', bound=1e6)]
    force_n: Annotated[float, _newtons]
    minimum_impulse_bit_n_s: Annotated[float, _impulse] = unless_default(0.0)
    specific_impulse_s: Annotated[float | None, _specific] = unless_default(None)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not any(self.direction):
            raise InputError(f'`direction` must not be zero; got {list(self.direction)}')


@dataclass(frozen=True, kw_only=True)
class ThrusterTable(Checked):
    """Thrusters one by one, or a preset of alike ones.

    preset : name; `force_n`, `arm_m`, `minimum_impulse_bit_n_s` are those of its thrusters
    thrusters : instead of a preset; at most 24
    centre_of_mass_m : about which the torque is counted
    modulation : what is below the impulse bit is lost (`pulse_width`), or carried (`sigma_delta`)
    finds_failures : whether the allocation knows of those that a campaign draws
    """

    preset: Annotated[str | None, partial(optional, check=choice, known=PRESETS)] = unless_default(
        None
    )
    force_n: Annotated[float | None, _optional_newtons] = unless_default(None)
    arm_m: Annotated[float, partial(real, unit='m', above=0.0, most=1e3)] = unless_default(1.0)
    minimum_impulse_bit_n_s: Annotated[float, _impulse] = unless_default(0.0)
    thrusters: tuple[Thruster, ...] = unless_default(())
    centre_of_mass_m: Annotated[Vector, _metres] = unless_default(ZERO)
    modulation: Annotated[str, partial(choice, known=MODULATIONS)] = unless_default(SIGMA_DELTA)
    failures: tuple[Failure, ...] = unless_default(())
    finds_failures: Annotated[bool, flag] = unless_default(False)

    def __post_init__(self) -> None:
        super().__post_init__()
        if (self.preset is None) == (not self.thrusters):
            raise InputError('`table` must have one of `preset` and `thrusters`')
        if (self.preset is None) != (self.force_n is None):
            raise InputError('`table.force_n` belongs to a `preset`, which must have it')
        if len(self.thrusters) > MOST_THRUSTERS:
            raise InputError(
                f'`table.thrusters` must be at most {MOST_THRUSTERS}; got {len(self.thrusters)}'
            )
        names = self.names
        if len(set(names)) < len(names):
            raise InputError(f'`table.thrusters` must have different names; got {", ".join(names)}')
        for i, failure in enumerate(self.failures):
            choice(f'failures[{i}].thruster', failure.thruster, names)

    @property
    def each(self) -> tuple[Thruster, ...]:
        """The thrusters, in their order."""
        return self.thrusters or _preset(
            self.preset or '', self.force_n or 0.0, self.arm_m, self.minimum_impulse_bit_n_s
        )

    @property
    def names(self) -> list[str]:
        """Names of the thrusters."""
        return [thruster.name for thruster in self.each]


@lru_cache(maxsize=32)
def _preset(preset: str, force_n: float, arm_m: float, bit_n_s: float) -> tuple[Thruster, ...]:
    """Return alike thrusters; each pushes the chaser to where its name says."""
    found = []
    for axis, sign in product(range(3), (1.0, -1.0)):
        for which, (depth, offsets) in enumerate(_places(preset, axis)):
            position, direction = [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]
            position[axis], direction[axis] = -sign * depth * arm_m, sign
            for other, share in offsets.items():
                position[other] = share * arm_m
            name = 'xyz'[axis] + ('+' if sign > 0.0 else '-')
            found.append(
                Thruster(
                    name=name if preset == FACES_6 else name + 'abcd'[which],
                    position_m=tuple(position),  # type: ignore[arg-type]
                    direction=tuple(direction),  # type: ignore[arg-type]
                    force_n=force_n,
                    minimum_impulse_bit_n_s=bit_n_s,
                )
            )
    return tuple(found)


def _places(preset: str, axis: int) -> list[tuple[float, dict[int, float]]]:
    """Return where the thrusters of one direction are, in arms: behind the middle, and across."""
    one, two = (axis + 1) % 3, (axis + 2) % 3
    sides = (1.0, -1.0)
    if preset == FACES_6:
        return [(1.0, {})]
    if preset == PAIRS_12:
        return [(1.0, {two: side}) for side in sides]
    if preset == CORNERS_24:
        return [(1.0, {one: a, two: b}) for a, b in product(sides, repeat=2)]
    if axis == 0:  # of four groups around x, each with two along x and two across
        return [(0.0, {at: side}) for at, side in product((1, 2), sides)]
    return [(0.0, {3 - axis: side}) for side in sides]


def rows_of(failures: Sequence[Failure], names: Sequence[str], dt_s: float) -> list[list[int]]:
    """Return failures as the kernels read them: rows of thruster, how, ticks, whether known."""

    def tick_of(time_s: float) -> int:
        """Return the first tick at or after a time."""
        return math.ceil(round(time_s / dt_s, 6))

    return [
        [
            names.index(f.thruster),
            ON if f.stuck == 'on' else OFF,
            tick_of(f.from_s),
            tick_of(f.until_s),
            int(f.known),
        ]
        for f in failures
    ]


def table_of(
    settings: ThrusterTable,
    dt_s: float,
    bound_n: float,
    specific_impulse_s: float | None,
    matrix: Sequence[Sequence[float]],
) -> Table:
    """Return a table as the kernels read it, without failures.

    bound_n : largest |force| of an axis that is carried
    specific_impulse_s : of thrusters that have none of their own
    matrix : 3 rows of 3, errors of all thrusters, force exerted = matrix x force of the table
    """
    found = _programme(
        settings.each, settings.centre_of_mass_m, settings.modulation, specific_impulse_s
    )
    arms, units = _arms(settings.each, settings.centre_of_mass_m)
    x, y, z = np.array(matrix).T
    acting = units[:, :1] * x + units[:, 1:2] * y + units[:, 2:] * z
    acts = as_table(np.hstack([acting, np.cross(arms, acting)]).ravel())
    return found._replace(dt=dt_s, bound=bound_n, acts=acts)


@lru_cache(maxsize=32)
def _programme(
    each: tuple[Thruster, ...], centre: Vector, modulation: str, specific_impulse_s: float | None
) -> Table:
    """Return what does not depend on errors, and the bases to start from."""
    reference = specific_impulse_s or max((t.specific_impulse_s or 1.0) for t in each)
    burns = [reference / (t.specific_impulse_s or reference) for t in each]
    arms, units = _arms(each, centre)
    # the largest distance of a thruster's line from the centre of mass; 1 m without
    lever_m = max(norm(*row) for row in np.cross(arms, units).tolist()) or 1.0
    found = Table(
        number=len(each),
        carries=int(modulation == SIGMA_DELTA),
        dt=1.0,
        bound=0.0,
        penalty=PENALTY * max(burns),
        lever=lever_m,
        columns=as_table(np.hstack([units, np.cross(arms, units) / lever_m]).ravel()),
        most=as_table([t.force_n for t in each]),
        cost=as_table([b * (1.0 + _PREFERENCE * (i * _GOLDEN % 1)) for i, b in enumerate(burns)]),
        burns=as_table(burns),
        bits=as_table([t.minimum_impulse_bit_n_s for t in each]),
        acts=as_table(np.zeros(ROWS * len(each))),
        bases=as_table(at_rest()),
    )
    return found._replace(bases=as_table(_bases(found)))


def _arms(each: tuple[Thruster, ...], centre: Vector) -> tuple[Floats, Floats]:
    """Return from the centre of mass to each thruster (n, 3) [m], and its direction (n, 3)."""
    arms = np.array([t.position_m for t in each]) - np.array(centre)
    return arms, np.array([np.divide(t.direction, norm(*t.direction)) for t in each])


def at_rest() -> Floats:
    """Return the basis of no force: all that must stay zero."""
    kept = MOST_THRUSTERS + ROWS + np.arange(ROWS)
    return np.concatenate([np.zeros(ROWS), kept, np.eye(ROWS).ravel()])


def _bases(table: Table) -> Floats:
    """Return bases to start from: those of forces in all directions, each once."""
    found = [at_rest()]
    work = as_table(np.zeros(allocation_kernels.SCRATCH))
    for order in chain.from_iterable(map(permutations, _GENERIC)):
        for signs in product((1.0, -1.0), repeat=3):
            wanted = [s * v for s, v in zip(signs, order, strict=True)] + [0.0] * 3
            for i in range(table.number):
                work[allocation_kernels.LIMIT + i] = allocation_kernels.LARGEST
            allocation_kernels.allocate(as_table(wanted), table, work)
            row = np.array(work)
            dual, inverse = (
                row[allocation_kernels.DUAL :][:ROWS],
                row[allocation_kernels.INVERSE :][: ROWS**2],
            )
            start = np.concatenate([dual, row[allocation_kernels.BASIS :][:ROWS], inverse])
            if not any(np.array_equal(start[ROWS : 2 * ROWS], o[ROWS : 2 * ROWS]) for o in found):
                found.append(start)
    return np.concatenate(found)


FULL, PARTIAL, NONE = LEFT = ('full', 'partial', 'none')

_NOTHING_N = 1e-9
_LOOKS = 20
_SIDES = tuple(np.array(side, float) for side in product((-1.0, 0.0, 1.0), repeat=3) if any(side))


class Authority(NamedTuple):
    """Forces [N] without torque.

    axes_n : x+, x-, y+, y-, z+, z-, along the axis alone
    box_n : that all three axes have at once, whatever their signs
    least_n : in the worst of all directions
    """

    axes_n: tuple[float, ...]
    box_n: float
    least_n: float

    def left(self, limit_n: float) -> str:
        """Return what is left of an authority of `limit_n` on all axes: FULL, PARTIAL or NONE."""
        if self.least_n <= _NOTHING_N:
            return NONE
        return FULL if self.box_n >= limit_n * (1.0 - 1e-9) else PARTIAL


class _Reach:
    """How far a table reaches, when some thrusters are stuck."""

    def __init__(
        self, settings: ThrusterTable, stuck: Mapping[str, str], torque_nm: Vector = ZERO
    ) -> None:
        whole = table_of(settings, 1.0, 0.0, None, IDENTITY)
        self._table: Table = whole._replace(
            penalty=allocation_kernels.LARGEST, bases=as_table(at_rest())
        )
        columns, most = np.array(whole.columns).reshape(-1, ROWS), np.array(whole.most)
        self._far = 2.0 * float(most.sum())
        self._against = np.concatenate([np.zeros(3), torque_nm]) / whole.lever
        for name, how in stuck.items():
            at = settings.names.index(name)
            if how == 'on':
                self._against -= most[at] * columns[at]
            most[at] = 0.0
        self._most = most
        self._work = as_table(np.zeros(SCRATCH))

    def along(self, direction: Floats) -> tuple[float, Floats]:
        """Return the largest multiple of a force (3,) [N], and the normal (3,) of its facet.

        Thrusters that are stuck on are made up for first; where they cannot be, it is 0.
        """
        allocation_kernels.start(0, self._table, self._work)
        for i, value in enumerate(self._most.tolist()):
            self._work[allocation_kernels.LIMIT + i] = value
        if self._against.any() and self._advance(self._against)[0] < 1.0:
            return 0.0, direction
        share, row = self._advance(np.concatenate([direction * self._far, np.zeros(3)]))
        at = allocation_kernels.INVERSE + ROWS * row
        normal = np.array(self._work[at : at + 3])
        normal = normal if normal @ direction > 0.0 else -normal
        size = float(np.linalg.norm(normal))
        return share * self._far, normal / size if size > 0.0 else direction

    def _advance(self, aim: Floats) -> tuple[float, int]:
        for i, value in enumerate(aim.tolist()):
            self._work[allocation_kernels.AIM + i] = value
        found: tuple[float, int] = allocation_kernels.advance(self._table, self._work)
        return found

    def least(self) -> float:
        """Return the least distance of a facet: from each side, facet after facet."""
        least = self._far
        for side in _SIDES:
            direction, before = side / np.linalg.norm(side), self._far
            for _ in range(_LOOKS):
                far, normal = self.along(direction)
                least = min(least, far * float(normal @ direction))
                if far >= before * (1.0 - 1e-12):
                    break
                direction, before = normal, far
        return least


def authority(
    settings: ThrusterTable, stuck: Mapping[str, str], torque_nm: Vector = ZERO
) -> Authority:
    """Return what a table has without torque, or with one.

    stuck : thruster -> `off` or `on`, as the allocation knows
    """
    reach = _Reach(settings, stuck, torque_nm)
    axes = (sign * unit for unit in np.eye(3) for sign in (1.0, -1.0))
    box = min(reach.along(np.array(c))[0] for c in product((1.0, -1.0), repeat=3))
    return Authority(tuple(reach.along(axis)[0] for axis in axes), box, reach.least())


@lru_cache(maxsize=32)
def known_authority(settings: ThrusterTable, torque_nm: float = 0.0) -> Authority:
    """Return what a table has when all failures that are known have come.

    torque_nm : which it gives about each axis at the same time, to any side
    """
    stuck = {f.thruster: f.stuck for f in settings.failures if f.known}
    sides = {torque_nm, -torque_nm}
    rows = [authority(settings, stuck, side) for side in product(sides, sides, sides)]
    axes = tuple(map(min, zip(*(row.axes_n for row in rows), strict=True)))
    return Authority(axes, min(row.box_n for row in rows), min(row.least_n for row in rows))


def failures(settings: ThrusterTable, pairs: bool) -> Iterator[dict[str, str]]:
    """Yield each thruster stuck off and stuck on; or any two that are."""
    single = list(product(settings.names, ('off', 'on')))
    for some in combinations(single, 2) if pairs else ((one,) for one in single):
        if len(dict(some)) == len(some):
            yield dict(some)
