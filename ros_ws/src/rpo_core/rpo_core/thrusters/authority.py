# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The force that a table of thrusters has without torque, whole and with failures.

The forces that thrusters can exert without torque are a convex polytope; its facets come from the
same dual simplex method that allocates (`allocation_kernels`), here with no torque allowed.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import lru_cache
from itertools import combinations, product
from typing import NamedTuple

import numpy as np

from rpo_core.kernels.arithmetic import Vector
from rpo_core.kernels.arrays import Floats
from rpo_core.kernels.jit import as_table
from rpo_core.stage import ZERO
from rpo_core.thrusters import allocation_kernels as simplex
from rpo_core.thrusters.allocation_kernels import ROWS, SCRATCH, Table
from rpo_core.thrusters.table import IDENTITY, ThrusterTable, at_rest, table_of

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
        self._table: Table = whole._replace(penalty=simplex.LARGEST, bases=as_table(at_rest()))
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
        simplex.start(0, self._table, self._work)
        for i, value in enumerate(self._most.tolist()):
            self._work[simplex.LIMIT + i] = value
        if self._against.any() and self._advance(self._against)[0] < 1.0:
            return 0.0, direction
        share, row = self._advance(np.concatenate([direction * self._far, np.zeros(3)]))
        at = simplex.INVERSE + ROWS * row
        normal = np.array(self._work[at : at + 3])
        normal = normal if normal @ direction > 0.0 else -normal
        size = float(np.linalg.norm(normal))
        return share * self._far, normal / size if size > 0.0 else direction

    def _advance(self, aim: Floats) -> tuple[float, int]:
        for i, value in enumerate(aim.tolist()):
            self._work[simplex.AIM + i] = value
        found: tuple[float, int] = simplex.advance(self._table, self._work)
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
def known(settings: ThrusterTable, torque_nm: float = 0.0) -> Authority:
    """Return what a table has when all failures that are known have come.

    torque_nm : which it gives about each axis at the same time, to any side
    """
    stuck = {f.thruster: f.stuck for f in settings.failures if f.known}
    sides = {torque_nm, -torque_nm}
    found = [authority(settings, stuck, side) for side in product(sides, sides, sides)]
    axes = tuple(map(min, zip(*(one.axes_n for one in found), strict=True)))
    return Authority(axes, min(one.box_n for one in found), min(one.least_n for one in found))


def failures(settings: ThrusterTable, pairs: bool) -> Iterator[dict[str, str]]:
    """Yield each thruster stuck off and stuck on; or any two that are."""
    single = list(product(settings.names, ('off', 'on')))
    for some in combinations(single, 2) if pairs else ((one,) for one in single):
        if len(dict(some)) == len(some):
            yield dict(some)
