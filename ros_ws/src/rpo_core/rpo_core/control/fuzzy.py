# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The paper's fuzzy inference system: two inputs, one output, five words, 30 parameters.

Inputs are the position error e = -r and velocity error -v of an axis, each divided by a scale and
saturated to [-1, 1]; the output in [-1, 1] is a share of the maximum force. Mamdani inference:
AND min, implication min, aggregation max, centroid over equally spaced samples of [-1, 1].
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple, dataclass
from functools import cached_property, partial
from typing import Annotated, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rpo_core.control import inference
from rpo_core.files.validation import Checked, InputError, choice, real, shown, store, whole, within
from rpo_core.kernels import arithmetic
from rpo_core.kernels.jit import as_table

WORDS = ('LN', 'SN', 'Z', 'SP', 'LP')
"""Large negative, small negative, zero, small positive, large positive."""

PARAMETERS = 30
"""Length of the vector p: p1-p5 position, p6-p10 velocity, p11-p15 force, p16-p30 rules."""

DEFAULT_SAMPLES = 101
"""Samples of the output range, as MATLAB's `evalfis`."""

_LOWER_TRIANGLE = [(row, column) for column in range(5) for row in range(column, 5)]


@dataclass(frozen=True)
class MembershipFunctions(Checked):
    """Five triangles LN, SN, Z, SP, LP on [-1, 1]; the negative side mirrors the positive.

    z_half_width : Z is (-z_half_width, 0, z_half_width); in (0, 1]
    sp_left, sp_centre, sp_right : feet and peak of SP, ordered, in [0, 1], centre > 0
    lp_left : LP is (lp_left, 1, ...), peak at the edge of the range; in [0, 1)
    """

    z_half_width: Annotated[float, partial(real, above=0.0, most=1.0)]
    sp_left: Annotated[float, partial(real, least=0.0, most=1.0)]
    sp_centre: Annotated[float, partial(real, above=0.0, most=1.0)]
    sp_right: Annotated[float, partial(real, above=0.0, most=1.0)]
    lp_left: Annotated[float, partial(real, least=0.0, below=1.0)]

    def __post_init__(self) -> None:
        super().__post_init__()
        feet = (self.sp_left, self.sp_centre, self.sp_right)
        if not (feet[0] <= feet[1] <= feet[2] and feet[0] < feet[2]):
            raise InputError(
                '`sp_left`, `sp_centre`, `sp_right` must ascend, the feet apart; '
                f'got {", ".join(map(repr, feet))}'
            )

    def grades(self, x: ArrayLike) -> NDArray[np.float64]:
        """Return the memberships (..., 5) of x (...) in [-1, 1], in the order of `WORDS`."""
        points = np.asarray(x, dtype=np.float64)
        table = [inference.memberships(float(point), astuple(self)) for point in points.ravel()]
        return np.array(table).reshape(*points.shape, 5)


@dataclass(frozen=True, repr=False)
class RuleTable:
    """The 5 x 5 rule table; `words[row][column]`, row = velocity error, column = position error."""

    words: tuple[tuple[str, ...], ...]

    def __post_init__(self) -> None:
        rows = tuple(tuple(row) for row in self.words)
        if len(rows) != 5 or any(len(row) != 5 for row in rows):
            raise InputError(f'`rules` must be 5 rows of 5 words; got {shown(rows)}')
        for name, row in zip(WORDS, rows, strict=True):
            for column, word in zip(WORDS, row, strict=True):
                choice(f'rules.{name}[{column}]', word, WORDS)
        store(self, words=rows)

    def __repr__(self) -> str:
        names = 'position error', *(f'velocity error {word}' for word in WORDS)
        rows = zip(names, (WORDS, *self.words), strict=True)
        return '\n'.join('{:18}{:>4}{:>4}{:>4}{:>4}{:>4}'.format(name, *row) for name, row in rows)

    @cached_property
    def codes(self) -> NDArray[np.int64]:
        """The consequents as (5, 5) int, 0..4 = LN..LP."""
        return np.array([[WORDS.index(word) for word in row] for row in self.words])

    @classmethod
    def from_codes(cls, codes: ArrayLike) -> RuleTable:
        """Return the table of (5, 5) ints 0..4 = LN..LP."""
        table = np.asarray(codes)
        if table.shape != (5, 5) or not np.isin(table, range(5)).all():
            raise InputError(f'`codes` must be (5, 5) whole numbers 0..4; got {shown(codes)}')
        return cls(tuple(tuple(WORDS[int(code)] for code in row) for row in table))

    @property
    def is_transpose_symmetric(self) -> bool:
        """Whether rule(i, j) = rule(j, i), as in the paper."""
        return bool((self.codes == self.codes.T).all())

    @property
    def is_odd(self) -> bool:
        """Whether f(-e, -v) = -f(e, v)."""
        return bool((self.codes[::-1, ::-1] == 4 - self.codes).all())

    @property
    def is_monotone(self) -> bool:
        """Whether the consequent never falls from one word of an error to the next.

        The inferred force may still dip a little between two peaks: a centroid of clipped triangles
        is not monotone.
        """
        return all(bool((np.diff(self.codes, axis=axis) >= 0).all()) for axis in (0, 1))


def odd_samples(name: str, value: Any) -> int:
    """Return an odd number of output samples, so that 0 is one of them; raises InputError."""
    if whole(name, value, least=3, most=100_001) % 2 == 0:
        raise InputError(f'`{name}` must be odd, so that 0 is a sample; got {value}')
    return int(value)


@dataclass(frozen=True)
class FuzzySystem(Checked):
    """A complete fuzzy inference system, normalised.

    samples : odd number of output samples in the centroid
    """

    position: MembershipFunctions
    velocity: MembershipFunctions
    force: MembershipFunctions
    rules: RuleTable
    samples: Annotated[int, odd_samples] = DEFAULT_SAMPLES

    @cached_property
    def tables(self) -> inference.FisTables:
        """What the kernels read."""
        half = (self.samples - 1) // 2
        samples = np.arange(1, half + 1) / half
        grades = self.force.grades(samples)
        return inference.FisTables(
            position=astuple(self.position),
            velocity=astuple(self.velocity),
            rules=as_table(self.rules.codes.ravel(), np.int64),
            samples=as_table(samples),
            z=as_table(grades[:, inference.Z]),
            sp=as_table(grades[:, inference.SP]),
            lp=as_table(grades[:, inference.LP]),
        )

    def output(self, position_error: ArrayLike, velocity_error: ArrayLike) -> Any:
        """Return the force in [-1, 1] of finite errors, which are saturated to [-1, 1].

        The errors are broadcast; of two numbers it is a float.
        """
        errors = np.broadcast_arrays(position_error, velocity_error)
        pairs = zip(*(each.ravel().tolist() for each in errors), strict=True)
        outputs = [
            float(
                inference.infer(
                    arithmetic.saturate(float(e), 1.0),
                    arithmetic.saturate(float(v), 1.0),
                    self.tables,
                )
            )
            for e, v in pairs
        ]
        return np.array(outputs).reshape(errors[0].shape) if errors[0].shape else outputs[0]

    def to_vector(self) -> NDArray[np.float64]:
        """Return p (30,) of the paper; rules as 1..5.

        Raises
        ------
        InputError
            If the rule table is not transpose-symmetric: p holds its lower triangle only.
        """
        if not self.rules.is_transpose_symmetric:
            raise InputError('`rules` must be transpose-symmetric to be a 30-vector; they are not')
        functions = [
            value for part in (self.position, self.velocity, self.force) for value in astuple(part)
        ]
        rules = [float(self.rules.codes[index] + 1) for index in _LOWER_TRIANGLE]
        return np.array([*functions, *rules])

    @classmethod
    def from_vector(
        cls, p: Sequence[float] | NDArray[np.float64], samples: int = DEFAULT_SAMPLES
    ) -> FuzzySystem:
        """Return the system of p (30,); rules must be whole numbers 1..5."""
        if len(p) != PARAMETERS:
            raise InputError(f'`p` must have {PARAMETERS} elements; got {len(p)}')
        values = [float(value) for value in p]
        codes = np.empty((5, 5), dtype=np.int64)
        rules = zip(_LOWER_TRIANGLE, values[15:], strict=True)
        for number, ((row, column), value) in enumerate(rules, 16):
            if value not in (1.0, 2.0, 3.0, 4.0, 5.0):
                raise InputError(f'`p{number}` must be 1, 2, 3, 4 or 5; got {value!r}')
            codes[row, column] = codes[column, row] = int(value) - 1
        parts = {}
        for name, first in (('position', 0), ('velocity', 5), ('force', 10)):
            with within(f'p{first + 1}-p{first + 5} ({name})'):
                parts[name] = MembershipFunctions(*values[first : first + 5])
        return cls(**parts, rules=RuleTable.from_codes(codes), samples=samples)
