# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Fuzzy controllers as arrays, from a search to the engine."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rpo.engine.lanes import Law, make_law
from rpo_core.control.controller import FuzzyController
from rpo_core.control.fuzzy import FuzzySystem, MembershipFunctions, RuleTable
from rpo_core.kernels.arrays import Floats, Ints


class Population(NamedTuple):
    """Controllers as arrays.

    scales : (n, 3) position [m], velocity [m/s], force [N]
    functions : (n, 15) p1-p15
    rules : (n, 25) codes 0..4 = LN..LP, row by row
    """

    scales: Floats
    functions: Floats
    rules: Ints

    def controller(self, index: int, name: str) -> FuzzyController:
        """Return one member as a controller without provenance."""
        feet = self.functions[index].reshape(3, 5).tolist()
        position, velocity, force = (MembershipFunctions(*row) for row in feet)
        rules = RuleTable.from_codes(self.rules[index].reshape(5, 5))
        scales = self.scales[index].tolist()
        return FuzzyController(name, FuzzySystem(position, velocity, force, rules), *scales)

    def is_odd(self, index: int) -> bool:
        """Return whether a member's rules are odd."""
        rules = self.rules[index]
        return bool((rules[::-1] == 4 - rules).all())

    def law(self, index: int, samples: int) -> Law:
        """Return one member as the kernels read it."""
        return make_law(samples, self.scales[index], self.functions[index], self.rules[index])


def population_of(*controllers: FuzzyController) -> Population:
    """Return controllers as arrays."""
    return Population(
        np.array([c.scales for c in controllers]),
        np.array([functions_of(c.system) for c in controllers]),
        np.array([c.system.rules.codes.ravel() for c in controllers]),
    )


def functions_of(system: FuzzySystem) -> list[float]:
    """Return the 15 numbers p1-p15 of a system."""
    return [
        value
        for part in (system.position, system.velocity, system.force)
        for value in (part.z_half_width, part.sp_left, part.sp_centre, part.sp_right, part.lp_left)
    ]
