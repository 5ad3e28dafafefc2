# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Families: kinds of controller that `rpo train --family` searches, each in one file.

A family is a kind of controller file (`rpo_core.control.controller_file`) that says which numbers a
search varies, and makes a controller of them. It may live in a module of your own
(`rpo_core.plugins`).
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from math import exp, log
from typing import ClassVar, NamedTuple

from rpo_core.control import controller_file
from rpo_core.control.baselines import Baseline
from rpo_core.files.validation import choice
from rpo_core.kernels.arithmetic import Vector

DIGITS = 4
"""Digits of a number that a search finds: a person reads the file."""


class Gene(NamedTuple):
    """A number that a search varies, in its range for the paper's training: 100 m, 200 s, 10 kg.

    start : where a search begins
    metres, seconds, newtons : powers of its unit, which fit it to another mission
    logarithmic : whether equal steps of a search are equal ratios
    """

    name: str
    least: float
    most: float
    start: float
    metres: int = 0
    seconds: int = 0
    newtons: int = 0
    logarithmic: bool = False

    def fitted(self, units: Vector) -> Gene:
        """Return the gene in other units of length, time and force."""
        metre, second, newton = units
        unit = metre**self.metres * second**self.seconds * newton**self.newtons
        bounds = (self.least * unit, self.most * unit, self.start * unit)
        return Gene(self.name, *bounds, logarithmic=self.logarithmic)

    def value(self, share: float) -> float:
        """Return the number at a share of the range in [0, 1], rounded to `DIGITS` digits."""
        if self.logarithmic:
            number = self.least * exp(share * log(self.most / self.least))
        else:
            number = self.least + (self.most - self.least) * share
        return float(f'{number:.{DIGITS}g}')

    def share(self, value: float) -> float:
        """Return the share of the range at a number, the nearest of [0, 1]."""
        if self.logarithmic:
            share = log(max(value, self.least) / self.least) / log(self.most / self.least)
        else:
            share = (value - self.least) / (self.most - self.least)
        return min(max(share, 0.0), 1.0)


class Mission(NamedTuple):
    """What a family needs of the mission that it is trained for.

    units : length, time and force, as multiples of those of the paper's training
    max_force_n : of an axis
    dt_s : length of a tick
    """

    units: Vector
    max_force_n: float
    dt_s: float


class Table(NamedTuple):
    """Rules as a table that a person reads."""

    title: str
    headings: tuple[str, ...]
    rows: list[tuple[str, ...]]


class Claim(NamedTuple):
    """What is proven or refuted of a controller.

    holds : whether it is proven; needed : whether a certificate fails without it
    """

    name: str
    statement: str
    holds: bool
    needed: bool = True


@dataclass(frozen=True, kw_only=True, repr=False)
class Family(Baseline):
    """A kind of controller that a search can train, and that says in words what it does.

    effort : evaluations for each gene, of a descent from the start and of a stage of drawn flights;
        stages
    drawn : campaigns whose flights a training draws
    masses_kg : further masses with which it flies the starts
    tests : weight of the limits of the paper's test [N²s]
    """

    effort: ClassVar[tuple[int, int, int]] = (300, 80, 3)
    drawn: ClassVar[tuple[str, ...]] = ('paper_test', 'random_starts', 'random_moving_starts')
    masses_kg: ClassVar[tuple[float, ...]] = (9.3, 12.0)
    tests: ClassVar[float] = 20.0

    @classmethod
    @abstractmethod
    def genes(cls) -> tuple[Gene, ...]:
        """Return what a search varies, for the paper's training."""

    @classmethod
    @abstractmethod
    def of_values(cls, name: str, values: Sequence[float], mission: Mission) -> Family:
        """Return the controller of the values of all genes, in their order."""

    @abstractmethod
    def values(self) -> tuple[float, ...]:
        """Return the values of all genes, in their order; a search can begin there."""

    @abstractmethod
    def tables(self) -> list[Table]:
        """Return its rules as tables."""

    @abstractmethod
    def claims(self) -> list[Claim]:
        """Return what is proven of it."""


def families() -> dict[str, type[Family]]:
    """Return name -> family, those of plug-ins too."""
    kinds = sorted(controller_file.kinds().items())
    return {name: kind for name, kind in kinds if issubclass(kind, Family)}


def family_of(name: str) -> type[Family]:
    """Return the family of a name; raises InputError."""
    known = families()
    return known[choice('family', name, known)]
