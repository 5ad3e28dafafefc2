# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Chromosomes of a search, and how they decode to controllers.

Genes are reals in [0, 1], in this order: the two input scales and the time scale (where they are
trained), the paper's p1-p15 (membership functions; position, velocity, force), and the rules. A
foot is placed between its neighbours, so that every chromosome decodes to ordered feet; the range
of a rule gene has equal parts, one per word. Values are rounded to 1e-4: a controller file then
has few digits.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from itertools import product
from math import floor, log10
from typing import Annotated, Any

import numpy as np

from rpo.engine.population import Population, functions_of
from rpo_core.control.controller import FuzzyController
from rpo_core.files.validation import Checked, InputError, choice, flag, real
from rpo_core.kernels.arrays import Floats, Ints

RULES = ('free', 'odd', 'odd-monotone')
"""Rule spaces: the paper's 15 of a transpose-symmetric table; 6 of an odd one; those, monotone."""

FUNCTIONS = 15
_FREE = [(row, column) for column in range(5) for row in range(column, 5)]
_ODD = [(row, column) for row, column in _FREE if row + column < 4]
_DECIMALS = 4
_TIMED = 6  # decimals of what a time scale has changed
_SMALLEST = 0.01  # half-width, centre
_LEAN = 0.99  # share of its bound that a left foot can reach


def _bounds(name: str, value: Any) -> tuple[float, float]:
    """Return (least, most) of a scale; raises InputError."""
    found = [real(name, bound, above=0.0) for bound in value]
    if len(found) != 2 or found[0] > found[1]:
        raise InputError(f'`{name}` must be [least, most]; got {list(value)}')
    return found[0], found[1]


Bounds = Annotated[tuple[float, float], _bounds]


@dataclass(frozen=True)
class GeneSpace(Checked):
    """What a search varies.

    rules : one of `RULES`
    position_scale_m, velocity_scale_m_s : (least, most); equal bounds fix the scale, without a gene
    force_scale_n : fixed, but for the time scale
    time_scale : (least, most) of a factor: the loop is slower by it, the velocity scale smaller by
        it, the force scale by its square; all of a law in one gene
    complete : whether neighbouring input functions must overlap, so that some rule fires everywhere
        and the force has no jumps; not required by the paper
    pulls : whether SP of the position begins at 0, so that some force pulls at rest everywhere
    """

    PLACE = 'genes.'

    rules: Annotated[str, partial(choice, known=RULES)] = 'free'
    position_scale_m: Bounds = (100.0, 100.0)
    velocity_scale_m_s: Bounds = (1.0, 1.0)
    force_scale_n: Annotated[float, partial(real, unit='N', above=0.0)] = 0.5
    time_scale: Bounds = (1.0, 1.0)
    complete: Annotated[bool, flag] = False
    pulls: Annotated[bool, flag] = False

    @property
    def _scales(self) -> list[tuple[float, float]]:
        return [self.position_scale_m, self.velocity_scale_m_s, self.time_scale]

    @property
    def free_scales(self) -> int:
        """Number of scales that are genes."""
        return sum(least < most for least, most in self._scales)

    @property
    def size(self) -> int:
        """Genes in a chromosome."""
        return self.free_scales + FUNCTIONS + (15 if self.rules == 'free' else len(_ODD))

    def decode(self, genes: Floats) -> Population:
        """Return the controllers of chromosomes (n, size) in [0, 1]."""
        scales = np.empty((len(genes), 3))
        used = 0
        for column, (least, most) in enumerate(self._scales):
            scales[:, column] = least
            if least < most:
                decimals = max(_DECIMALS, _DECIMALS - floor(log10(most)))  # of a small scale, more
                scales[:, column] += np.round((most - least) * genes[:, used], decimals)
                scales[:, column] = np.round(scales[:, column], decimals)
                used += 1
        time = scales[:, 2].copy()
        scales[:, 2] = self.force_scale_n
        if self.time_scale[0] < self.time_scale[1]:
            scales[:, 1] = np.round(scales[:, 1] / time, _TIMED)
            scales[:, 2] = np.round(scales[:, 2] / (time * time), _TIMED)
        functions = _decode_functions(genes[:, used : used + FUNCTIONS], self.complete)
        if self.pulls:
            functions[:, 1] = 0.0
        return Population(scales, functions, self._decode_rules(genes[:, used + FUNCTIONS :]))

    @property
    def rule_genes(self) -> slice:
        """The rules of a chromosome; they are its last genes."""
        return slice(self.free_scales + FUNCTIONS, self.size)

    def rule_tables(self) -> Floats:
        """Return rule genes (tables, 6) of each distinct table of an odd-monotone space."""
        if self.rules != 'odd-monotone':
            raise InputError(
                f'`genes.rules` must be odd-monotone for a race of rule tables; other spaces have '
                f'too many tables; got {self.rules}'
            )
        genes = (np.array(list(product(range(3), repeat=len(_ODD)))) + 0.5) / 3
        _, first = np.unique(self._decode_rules(genes), axis=0, return_index=True)
        return genes[np.sort(first)]

    def _decode_rules(self, genes: Floats) -> Ints:
        table = np.full((len(genes), 5, 5), 2)
        words = 3 if self.rules == 'odd-monotone' else 5
        codes = np.minimum((genes * words).astype(np.int64), words - 1)
        if self.rules == 'free':
            for k, (row, column) in enumerate(_FREE):
                table[:, row, column] = table[:, column, row] = codes[:, k]
            return table.reshape(-1, 25)
        for k, (row, column) in enumerate(_ODD):
            code = codes[:, k]
            if self.rules == 'odd-monotone':  # never below the neighbours before it
                for before in ((row - 1, column), (row, column - 1)):
                    if min(before) >= 0:
                        code = np.maximum(code, table[:, before[0], before[1]])
            table[:, row, column] = table[:, column, row] = code
            table[:, 4 - row, 4 - column] = table[:, 4 - column, 4 - row] = 4 - code
        return table.reshape(-1, 25)

    def encode(self, controller: FuzzyController) -> Floats:
        """Return a chromosome (size,) that decodes to `controller`, to within the rounding.

        Raises
        ------
        InputError
            If it is outside the space.
        """
        genes: list[float] = []
        values = (*controller.scales[:2], 1.0)  # at the pace of its own
        for value, (least, most) in zip(values, self._scales, strict=True):
            if least < most:
                genes.append((value - least) / (most - least))
        genes += _encode_functions(np.array(functions_of(controller.system)), self.complete)
        words = 3 if self.rules == 'odd-monotone' else 5
        codes = controller.system.rules.codes
        genes += [(codes[cell] + 0.5) / words for cell in (_FREE if self.rules == 'free' else _ODD)]
        chromosome = np.array(genes)
        if chromosome.min() < -1e-9 or chromosome.max() > 1.0 + 1e-9:
            raise InputError(f'controller {controller.name} lies outside the bounds of the search')
        chromosome = np.clip(chromosome, 0.0, 1.0)
        decoded = self.decode(chromosome[None])
        if (decoded.rules[0] != codes.ravel()).any():
            raise InputError(f'the rules of controller {controller.name} are not {self.rules}')
        return chromosome


def _decode_functions(genes: Floats, complete: bool) -> Floats:
    functions = np.empty_like(genes)
    for first in (0, 5, 10):
        overlap = complete and first < 10
        zero, left, centre, right, large = genes[:, first : first + 5].T
        width = np.round(_SMALLEST + (1.0 - _SMALLEST) * zero, _DECIMALS)
        peak = np.round(_SMALLEST + (1.0 - _SMALLEST) * centre, _DECIMALS)
        edge = np.round(peak + (1.0 - peak) * right, _DECIMALS)
        inner = np.minimum(peak, width) if overlap else peak
        outer = edge if overlap else 1.0
        functions[:, first] = width
        functions[:, first + 1] = np.round(_LEAN * inner * left, _DECIMALS)
        functions[:, first + 2] = peak
        functions[:, first + 3] = edge
        functions[:, first + 4] = np.round(_LEAN * outer * large, _DECIMALS)
    return functions


def _encode_functions(functions: Floats, complete: bool) -> list[float]:
    genes: list[float] = []
    for first in (0, 5, 10):
        overlap = complete and first < 10
        zero, left, centre, right, large = functions[first : first + 5].tolist()
        inner = min(centre, zero) if overlap else centre
        outer = right if overlap else 1.0
        genes += [
            (zero - _SMALLEST) / (1.0 - _SMALLEST),
            left / (_LEAN * inner),
            (centre - _SMALLEST) / (1.0 - _SMALLEST),
            (right - centre) / (1.0 - centre) if centre < 1.0 else 0.0,
            large / (_LEAN * outer),
        ]
    return genes
