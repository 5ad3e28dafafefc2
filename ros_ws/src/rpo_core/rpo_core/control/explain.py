# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Why the controller fires: one axis's decision in tables and words."""

from __future__ import annotations

from bisect import bisect
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from operator import attrgetter
from typing import NamedTuple

from rpo_core.control import blend, inference
from rpo_core.control.controller import AnyController, FuzzyController
from rpo_core.control.fuzzy import WORDS, FuzzySystem
from rpo_core.files.validation import real
from rpo_core.kernels import arithmetic
from rpo_core.scenario.scenario import MAX_VELOCITY_M_S
from rpo_core.world.starts import MAX_POSITION_M

SPOKEN = {
    'LN': 'large negative',
    'SN': 'small negative',
    'Z': 'zero',
    'SP': 'small positive',
    'LP': 'large positive',
}
"""The words as a sentence says them."""

_ABOUT = 0.25
"""An output so much of the way from the peak of a word to the next is still called by it."""


class FiredRule(NamedTuple):
    """If the velocity error is `velocity` and the position error is `position`, force is `force`.

    position_grade, velocity_grade : memberships of the errors in these words
    strength : the lesser of the two grades, in (0, 1]
    decides : whether no rule with the same consequent is stronger
    """

    position: str
    position_grade: float
    velocity: str
    velocity_grade: float
    force: str
    strength: float
    decides: bool

    @property
    def condition(self) -> str:
        """When the rule fires, in words."""
        position, velocity = SPOKEN[self.position], SPOKEN[self.velocity]
        return f'position error is {position} and velocity error is {velocity}'


@dataclass(frozen=True)
class Decision:
    """What the controller decided on one axis.

    position_m, velocity_m_s : of the chaser, target LVLH
    position_error, velocity_error : normalised, saturated to [-1, 1]
    position_saturated, velocity_saturated : whether the error was beyond its scale
    rules : that fire, the strongest first
    strengths : (5,) of the output words, in the order of `WORDS`
    output : normalised force
    force_n : commanded force
    controller : that decided
    """

    axis: str
    position_m: float
    velocity_m_s: float
    position_error: float
    velocity_error: float
    position_saturated: bool
    velocity_saturated: bool
    rules: tuple[FiredRule, ...]
    strengths: inference.Five
    output: float
    force_n: float
    controller: FuzzyController

    @cached_property
    def parts(self) -> dict[str, blend.Part]:
        """Word -> what it contributes to the force, for all words that contribute."""
        parts = blend.parts(self.strengths, self.controller.system.tables)
        named = zip(WORDS, parts, strict=True)
        return {word: part for word, part in named if part.share > 0.0}

    def deciding(self, word: str) -> list[FiredRule]:
        """Return the rules that decide the part of a word: the strongest, or those that tie."""
        return [rule for rule in self.rules if rule.force == word and rule.decides]

    @property
    def reasons(self) -> blend.Reasons:
        """The force in words, and the rules that make it with their shares."""
        scale_n = self.controller.force_scale_n
        if not self.parts:
            none = 'the force words that fire hold no sample' if self.rules else 'no rule fires'
            return blend.Reasons(f'0 N: {none}')
        causes = [
            blend.Cause(
                part.share,
                f'{SPOKEN[word]} ({blend.newtons(scale_n * part.centroid)})',
                ', or '.join(rule.condition for rule in self.deciding(word)),
            )
            for word, part in self.parts.items()
        ]
        words = place(self.output, self.controller.system.force.sp_centre)
        share = f'{100.0 * abs(self.output):.0f} % of {scale_n:g} N'
        return blend.Reasons(f'{blend.newtons(self.force_n)}, {words} ({share})', causes)


def place(output: float, small: float) -> str:
    """Return the words for a normalised force; `small` is the peak of SP."""
    peaks = (-1.0, -small, 0.0, small, 1.0)
    if output in peaks:
        return SPOKEN[WORDS[peaks.index(output)]]
    above = bisect(peaks, output)
    low, high = (SPOKEN[word] for word in WORDS[above - 1 : above + 1])
    way = (output - peaks[above - 1]) / (peaks[above] - peaks[above - 1])
    if _ABOUT < way < 1.0 - _ABOUT:
        return f'between {low} and {high}'
    return f'about {low if way <= _ABOUT else high}'


def decide(
    controller: FuzzyController, position_m: float, velocity_m_s: float, axis: str = ''
) -> Decision:
    """Return the decision on one axis of a finite position [m] and velocity [m/s], target LVLH."""
    system, tables = controller.system, controller.system.tables
    errors = (
        -position_m / controller.position_scale_m,
        -velocity_m_s / controller.velocity_scale_m_s,
    )
    e, v = (arithmetic.saturate(error, 1.0) for error in errors)
    position = inference.memberships(e, tables.position)
    velocity = inference.memberships(v, tables.velocity)
    strengths = inference.fire_rules(position, velocity, tables.rules)
    return Decision(
        axis=axis,
        position_m=position_m,
        velocity_m_s=velocity_m_s,
        position_error=e,
        velocity_error=v,
        position_saturated=abs(errors[0]) > 1.0,
        velocity_saturated=abs(errors[1]) > 1.0,
        rules=_fired(system, position, velocity, strengths),
        strengths=strengths,
        output=float(inference.centroid(strengths, tables)),
        force_n=float(inference.axis_force(position_m, velocity_m_s, *controller.scales, tables)),
        controller=controller,
    )


def _fired(
    system: FuzzySystem,
    position: inference.Five,
    velocity: inference.Five,
    strengths: inference.Five,
) -> tuple[FiredRule, ...]:
    fired = []
    for words, velocity_word, v in zip(system.rules.words, WORDS, velocity, strict=True):
        for force, position_word, p in zip(words, WORDS, position, strict=True):
            if (strength := min(p, v)) > 0.0:
                decides = strength == strengths[WORDS.index(force)]
                fired.append(
                    FiredRule(position_word, p, velocity_word, v, force, strength, decides)
                )
    return tuple(sorted(fired, key=attrgetter('strength'), reverse=True))


def decisions(controller: FuzzyController, state: Sequence[float]) -> tuple[Decision, ...]:
    """Return the decisions of the three axes in a state (6,): x, y, z [m], vx, vy, vz [m/s].

    Raises
    ------
    InputError
        If a number is not finite, or outside the domain of the scenarios.
    """
    decided = []
    for axis, r, v in zip('xyz', state[:3], state[3:], strict=True):
        position = real(axis, float(r), 'm', least=-MAX_POSITION_M, most=MAX_POSITION_M)
        velocity = real(f'v{axis}', float(v), 'm/s', least=-MAX_VELOCITY_M_S, most=MAX_VELOCITY_M_S)
        decided.append(decide(controller, position, velocity, axis))
    return tuple(decided)


def reasons(
    controller: AnyController, state: Sequence[float], tick: int = 0
) -> Sequence[blend.Reasons]:
    """Return why x, y, z get their force; empty: the controller has no more to say.

    state : (6,) m, m/s, that the controller read, from the goal
    """
    x, y, z, vx, vy, vz = state
    if isinstance(controller, FuzzyController):
        return [decide(controller, *pair).reasons for pair in ((x, vx), (y, vy), (z, vz))]
    return controller.reasons((x, y, z, vx, vy, vz), tick)
