# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What is asked of which controller: the one place of the targets Q1 to Q5.

A shipped controller has targets of its own, for what it was made for. It is recognised by its
numbers, not by what its file says of itself; any other controller has those of `ANY`.
"""

from __future__ import annotations

from dataclasses import dataclass

from rpo_core.control.controller import FuzzyController, load_controller
from rpo_judge.evaluation.proven import numbers_of

QUESTIONS = (
    "Q1: every start meets all conditions. Q2: little energy. Q3: the paper's test, held. "
    'Q4: no limit cycle. Q5: rules that a person can read.'
)
"""What the targets are for, where they are shown."""


@dataclass(frozen=True)
class Asked:
    """What is asked of a controller; every start must meet all conditions in any case.

    energy_n2s : Q2, largest mean J over the starts; None: nothing is asked
    margin : Q1, least share of its limit that every condition keeps free
    questions : of Q3, Q4, Q5, those that are asked
    why : in words
    """

    energy_n2s: float | None
    margin: float
    questions: tuple[str, ...]
    why: str


_ALL = ('Q3', 'Q4', 'Q5')

ANY = Asked(3.7, 0.0, _ALL, "what is asked of a controller for the paper's training")
"""Q2's 3.7 N^2 s was set before `trained` was; the least under all conditions is 2.43."""

SHIPPED = {
    'allround': Asked(
        4.0, 0.03, _ALL, 'a margin of 3 % to every condition, and the energy that it shipped with'
    ),
    'trained': Asked(3.7, 0.0, _ALL, 'little energy'),
    'robust': Asked(4.0, 0.0, _ALL, 'the energy that it shipped with'),
    'paper_ga': Asked(None, 0.0, (), "the paper's search, asked for the conditions of the paper"),
    'world': Asked(
        None,
        0.0,
        ('Q5',),
        'trained for its world; the campaigns world_leo and world_leo_stuck judge it',
    ),
}
"""Shipped controller -> what is asked of it. An energy that a controller shipped with was set after
its training: it keeps a later one from being worse."""


def asked_of(controller: FuzzyController) -> tuple[str, Asked]:
    """Return the shipped controller that has these numbers, '' if none, and what is asked."""
    digest = numbers_of(controller)
    for name, asked in SHIPPED.items():
        shipped = load_controller(name)
        if isinstance(shipped, FuzzyController) and numbers_of(shipped) == digest:
            return name, asked
    return '', ANY
