# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The starts of a set of scenarios: the same list on three axes, a grid, or a box."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any

import numpy as np

from rpo_core.files import codec
from rpo_core.files.validation import Checked, InputError, real, shown, vector3, whole
from rpo_core.kernels.arithmetic import Vector
from rpo_core.kernels.arrays import Floats
from rpo_core.kernels.noise import philox

MAX_POSITION_M = 100_000.0
MAX_POSITIONS = 100
"""Positions per axis: a million starts."""


def positions(name: str, value: Any) -> tuple[float, ...]:
    """Return the positions [m] on an axis; raises InputError."""
    if not isinstance(value, (list, tuple)) or not 0 < len(value) <= MAX_POSITIONS:
        raise InputError(
            f'`{name}` must be a list of 1 to {MAX_POSITIONS} positions in m; got {shown(value)}'
        )
    bounds = {'least': -MAX_POSITION_M, 'most': MAX_POSITION_M}
    return tuple(real(f'{name}[{i}]', item, 'm', **bounds) for i, item in enumerate(value))


@dataclass(frozen=True)
class Grid(Checked):
    """All combinations of the positions [m] on each axis, z fastest."""

    x: Annotated[tuple[float, ...], positions]
    y: Annotated[tuple[float, ...], positions]
    z: Annotated[tuple[float, ...], positions]

    @classmethod
    def cube(cls, axis: tuple[float, ...]) -> Grid:
        """Return the grid of the same positions [m] on the three axes."""
        return cls(axis, axis, axis)

    @property
    def positions_m(self) -> Floats:
        """Starts (n, 3) [m], target LVLH."""
        return np.array(list(itertools.product(self.x, self.y, self.z)))


_corner = partial(vector3, unit='m', bound=MAX_POSITION_M)


@dataclass(frozen=True)
class Box(Checked):
    """The corners of a box, and random starts in it.

    least, most : (3,) [m], target LVLH
    random : number of random starts, uniform in the box; they follow from `seed` alone
    """

    least: Annotated[Vector, _corner]
    most: Annotated[Vector, _corner]
    random: Annotated[int, partial(whole, least=0, most=MAX_POSITIONS**3)] = 0
    seed: Annotated[int, partial(whole, least=0, most=2**32 - 1)] = 1

    def __post_init__(self) -> None:
        super().__post_init__()
        if any(a > b for a, b in zip(self.least, self.most, strict=True)):
            raise InputError(
                f'`least` must not be beyond `most`; got {list(self.least)} and {list(self.most)}'
            )

    @property
    def positions_m(self) -> Floats:
        """Starts (n, 3) [m], target LVLH: corners that differ, z fastest; then the random ones."""
        sides = [sorted({a, b}) for a, b in zip(self.least, self.most, strict=True)]
        words = [philox(i, 0, 0, 0, self.seed, 0)[:3] for i in range(self.random)]
        shares = (np.array(words, dtype=np.float64).reshape(-1, 3) + 0.5) / 2.0**32
        least, most = np.array(self.least), np.array(self.most)
        corners = np.array(list(itertools.product(*sides)))
        return np.vstack([corners, least + shares * (most - least)])


Starts = Grid | Box

FIELDS = ('initial_position_axis_m', 'initial_position_grid_m', 'initial_position_box_m')
"""Fields of a set that say its starts; it has one of them."""


def field_of(document: Any) -> str:
    """Return the field that says the starts of a set; raises InputError if there are several."""
    given = [name for name in FIELDS if isinstance(document, Mapping) and name in document]
    if len(given) > 1:
        raise InputError(f'`{given[0]}` must be the only starts of a set; got `{given[1]}` too')
    return given[0] if given else FIELDS[0]


def parse(name: str, value: Any) -> Starts:
    """Return the starts of a field of `FIELDS`; raises InputError."""
    if name == FIELDS[0]:
        return Grid.cube(positions(name, value))
    kind: type[Grid] | type[Box] = Grid if name == FIELDS[1] else Box
    return codec.from_mapping(kind, name, value)
