# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Why the controller fires: one axis's decision in tables and words."""

from __future__ import annotations

from bisect import bisect
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from operator import attrgetter
from typing import NamedTuple

from rpo_core.control import blend
from rpo_core.control.controller import AnyController, FuzzyController
from rpo_core.control.controller_file import ControllerFile, Reason
from rpo_core.control.fuzzy import WORDS, FuzzySystem
from rpo_core.files.scenario import MAX_VELOCITY_M_S
from rpo_core.files.starts import MAX_POSITION_M
from rpo_core.files.validation import InputError, real
from rpo_kernels import kernels

AXES = ('x', 'y', 'z')

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

STATE = ('x', 'y', 'z', 'vx', 'vy', 'vz')


class FiredRule(NamedTuple):
    """If the velocity error is `velocity` and the position error is `position`, force is `force`.

    strength : the lesser of the two grades, in (0, 1]
    decides : whether no rule with the same consequent is stronger
    """

    position: str
    velocity: str
    force: str
    strength: float
    decides: bool

    @property
    def condition(self) -> str:
        """When the rule fires, in words."""
        position, velocity = SPOKEN[self.position], SPOKEN[self.velocity]
        return f'position error is {position} and velocity error is {velocity}'

    @property
    def sentence(self) -> str:
        """The rule in words, with its strength."""
        return f'{self.condition} → force {SPOKEN[self.force]}, {self.strength:.2f}'


@dataclass(frozen=True)
class Decision:
    """What the controller decided on one axis.

    position_m, velocity_m_s : of the chaser, target LVLH
    position_error, velocity_error : normalised, saturated to [-1, 1]
    position_saturated, velocity_saturated : whether the error was beyond its scale
    position_grades, velocity_grades : (5,) memberships, in the order of `WORDS`
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
    position_grades: kernels.Five
    velocity_grades: kernels.Five
    rules: tuple[FiredRule, ...]
    strengths: kernels.Five
    output: float
    force_n: float
    controller: FuzzyController

    @property
    def strongest(self) -> str:
        """The strongest rule in words, not what is commanded."""
        return self.rules[0].sentence if self.rules else 'no rule fires → no force, 0.00'

    @cached_property
    def parts(self) -> dict[str, blend.Part]:
        """Word -> what it contributes to the force, for all words that contribute."""
        found = blend.parts(self.strengths, self.controller.system.tables)
        named = zip(WORDS, found, strict=True)
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

    def pairs(self) -> list[tuple[str, float]]:
        """Return the numbers of the decision; grades and strengths that are 0 are left out.

        Keys: force_n, output, position_error, velocity_error; position.<word>, velocity.<word> the
        grades; rule.<position word>.<velocity word>.<force word> the strengths of the rules that
        fire; force.<word> those of the output words.
        """
        five = (('position', self.position_grades), ('velocity', self.velocity_grades))
        return [
            ('force_n', self.force_n),
            ('output', self.output),
            ('position_error', self.position_error),
            ('velocity_error', self.velocity_error),
            *_grades(five),
            *((f'rule.{r.position}.{r.velocity}.{r.force}', r.strength) for r in self.rules),
            *_grades([('force', self.strengths)]),
        ]


def _grades(named: Iterable[tuple[str, kernels.Five]]) -> list[tuple[str, float]]:
    return [
        (f'{name}.{word}', grade)
        for name, grades in named
        for word, grade in zip(WORDS, grades, strict=True)
        if grade > 0.0
    ]


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
    e, v = (kernels.saturate(error, 1.0) for error in errors)
    position = kernels.memberships(e, tables.position)
    velocity = kernels.memberships(v, tables.velocity)
    strengths = kernels.fire_rules(position, velocity, tables.rules)
    return Decision(
        axis=axis,
        position_m=position_m,
        velocity_m_s=velocity_m_s,
        position_error=e,
        velocity_error=v,
        position_saturated=abs(errors[0]) > 1.0,
        velocity_saturated=abs(errors[1]) > 1.0,
        position_grades=_floats(position),
        velocity_grades=_floats(velocity),
        rules=_fired(system, position, velocity, strengths),
        strengths=_floats(strengths),
        output=float(kernels.centroid(strengths, tables)),
        force_n=float(kernels.axis_force(position_m, velocity_m_s, *controller.scales, tables)),
        controller=controller,
    )


def _floats(five: kernels.Five) -> kernels.Five:
    ln, sn, z, sp, lp = map(float, five)
    return ln, sn, z, sp, lp


def _fired(
    system: FuzzySystem, position: kernels.Five, velocity: kernels.Five, strengths: kernels.Five
) -> tuple[FiredRule, ...]:
    fired = []
    columns = [column for column, grade in enumerate(position) if grade > 0.0]
    for row in (row for row, grade in enumerate(velocity) if grade > 0.0):
        for column in columns:
            strength = float(min(position[column], velocity[row]))
            word = system.rules.words[row][column]
            decides = strength == strengths[WORDS.index(word)]
            fired.append(FiredRule(WORDS[column], WORDS[row], word, strength, decides))
    return tuple(sorted(fired, key=attrgetter('strength'), reverse=True))


def decisions(controller: FuzzyController, state: Sequence[float]) -> tuple[Decision, ...]:
    """Return the decisions of the three axes in a state (6,): x, y, z [m], vx, vy, vz [m/s].

    Raises
    ------
    InputError
        If the state is not six finite numbers in the domain of the scenarios.
    """
    if len(state) != 6:
        raise InputError(f'`state` must be 6 numbers {",".join(STATE)}; got {len(state)}')
    bounds = [('m', MAX_POSITION_M)] * 3 + [('m/s', MAX_VELOCITY_M_S)] * 3
    values = [
        real(name, float(value), unit, least=-bound, most=bound)
        for name, value, (unit, bound) in zip(STATE, state, bounds, strict=True)
    ]
    return tuple(decide(controller, values[i], values[3 + i], axis) for i, axis in enumerate(AXES))


def reasons(
    controller: AnyController, state: Sequence[float], force_n: Sequence[float], tick: int = 0
) -> Sequence[Reason]:
    """Return the reasons of x, y, z.

    state : (6,) m, m/s, that the controller read, from the goal; force_n : (3,) N, its answer
    """
    if isinstance(controller, FuzzyController):
        found = [decide(controller, state[i], state[3 + i], axis) for i, axis in enumerate(AXES)]
        return [(decision.strongest, decision.pairs()) for decision in found]
    x, y, z, vx, vy, vz = state
    own = controller.reasons((x, y, z, vx, vy, vz), tick)
    return own or [(f'commands {f:.3g} N', [('force_n', f)]) for f in force_n]


def in_words(
    controller: AnyController | None, said: str, published: Mapping[str, float]
) -> blend.Reasons:
    """Return the reasons of a force: all that makes it, not the strongest rule alone.

    controller : that commanded; None if it is not known
    said, published : sentence and finite numbers of an axis, as `reasons` returns them
    """
    found = None
    if isinstance(controller, ControllerFile):
        found = controller.in_words(published)
    elif isinstance(controller, FuzzyController):
        e, v = published.get('position_error'), published.get('velocity_error')
        if e is not None and v is not None:
            scales = controller.position_scale_m, controller.velocity_scale_m_s
            again = decide(controller, -e * scales[0], -v * scales[1])
            if blend.is_same(again.force_n, published.get('force_n')):
                found = again.reasons
    alone = any(name.startswith('rule.') for name in published)
    return found or blend.Reasons(f'strongest rule: {said}' if alone else said)
