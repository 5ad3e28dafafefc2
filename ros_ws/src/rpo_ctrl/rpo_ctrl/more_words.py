# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A static fuzzy controller of the paper's two inputs with more words, and a number for each rule.

The paper's controller has five words for the position and five for the velocity of an axis, and
the words of the force are shared by all rules. Here the distance has seven words (so a position,
which has two sides, has thirteen) and the closing speed eight; each rule has a force of its own: a
zero-order Takagi-Sugeno system (`baseline_kernels.pace_force` with a lead of 0).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import pairwise
from typing import Annotated, ClassVar

from rpo_core.control.blend import Reasons
from rpo_core.control.controller_file import Reason, register
from rpo_core.files.validation import InputError, real, shown
from rpo_core.kernels import State
from rpo_ctrl.baseline_kernels import BaselineLaw, baseline_force, law_of, pace_inputs
from rpo_ctrl.family import Claim, Family, Gene, Mission, Table
from rpo_ctrl.pace import (
    Numbers,
    ascending,
    blended,
    fired_rules,
    force_table,
    key,
    numbers,
    table_claims,
)

DISTANCES = ('at', 'close', 'very near', 'near', 'middle', 'far', 'remote')
SPEEDS = ('receding', 'drifting away', 'resting', 'creeping', 'slow', 'steady', 'brisk', 'fast')
"""The words, ascending. `at` has its peak at 0 m, `resting` at 0 m/s; `drifting away` and
`receding` mirror `creeping` and `fast`."""

_RESTING = SPEEDS.index('resting')


def _rows(name: str, value: object) -> tuple[Numbers, ...]:
    rows = value if isinstance(value, (list, tuple)) else ()
    found = tuple(numbers(f'{name}[{i}]', row) for i, row in enumerate(rows))
    count = len(DISTANCES) - 1
    if len(found) != count or any(len(row) != len(SPEEDS) for row in found):
        size = f'{count} rows of {len(SPEEDS)} numbers'
        raise InputError(f'`{name}` must be {size}; got {shown(value)}')
    return found


@register
@dataclass(frozen=True, kw_only=True)
class MoreWords(Family):
    """Forces by distance and closing speed: a table of rules in words, each axis alike.

    distance_peaks_m : of `DISTANCES` without `at`
    speed_peaks_m_s : of `SPEEDS` after `resting`
    damping_n_s_m : at the target, the force is -damping_n_s_m * velocity at each peak
    forces_n : towards the target; a row for each distance without `at`
    """

    kind: ClassVar[str] = 'more_words'
    alike: ClassVar[bool] = True
    effort: ClassVar[tuple[int, int]] = (6, 3)

    distance_peaks_m: Annotated[Numbers, numbers]
    speed_peaks_m_s: Annotated[Numbers, numbers]
    damping_n_s_m: Annotated[float, partial(real, unit='N s/m', above=0.0, most=1e6)]
    forces_n: Annotated[tuple[Numbers, ...], _rows]

    def __post_init__(self) -> None:
        super().__post_init__()
        ascending('distance_peaks_m', (0.0, *self.distance_peaks_m), len(DISTANCES))
        ascending('speed_peaks_m_s', (0.0, *self.speed_peaks_m_s), len(SPEEDS) - _RESTING)

    @property
    def _distances(self) -> Numbers:
        return (0.0, *self.distance_peaks_m)

    @property
    def _speeds(self) -> Numbers:
        creeping, *_, fast = self.speed_peaks_m_s
        return (-fast, -creeping, 0.0, *self.speed_peaks_m_s)

    @property
    def _table(self) -> tuple[Numbers, ...]:
        at = tuple(0.0 - self.damping_n_s_m * speed for speed in self._speeds)
        return (at, *self.forces_n)

    @cached_property
    def law(self) -> BaselineLaw:
        """What the kernels read."""
        return law_of(self.max_force_n, pace=(self._distances, self._speeds, self._table, 0.0))

    def values(self) -> dict[str, float]:
        """Return the values of all genes."""
        found = {'damping_n_s_m': self.damping_n_s_m}
        for word, peak in zip(DISTANCES[1:], self.distance_peaks_m, strict=True):
            found[f'{word}: peak_m'] = peak
        for word, peak in zip(SPEEDS[_RESTING + 1 :], self.speed_peaks_m_s, strict=True):
            found[f'{word}: peak_m_s'] = peak
        for word, row in zip(DISTANCES[1:], self.forces_n, strict=True):
            for speed, force in zip(SPEEDS, row, strict=True):
                found[f'{word}, {speed}'] = force
        return found

    def tables(self) -> list[Table]:
        """Return its rules as a table, and the peaks of its words."""
        title = 'Force towards the target [N] of each axis'
        words = dict(zip(SPEEDS, self._speeds, strict=True))
        rows = dict(zip(zip(DISTANCES, self._distances, strict=True), self._table, strict=True))
        return [force_table(title, 'peak of the speed [m/s]', words, rows)]

    def claims(self) -> list[Claim]:
        """Return what is proven of it: the table bounds and signs an interpolated force."""
        bound = min(self.max_force_n, max(abs(force) for row in self._table for force in row))
        output, rest, held = table_claims(
            bound, self.forces_n, self.distance_peaks_m, _RESTING, True
        )
        return [
            output,
            Claim(
                'odd and continuous',
                'force(-r, -v) = -force(r, v), without a jump at r = 0: there the force is odd in '
                'the speed, because its peaks mirror each other',
                True,
            ),
            rest,
            held,
            Claim(
                'brakes',
                'at each distance, the force towards the target falls as the closing speed grows',
                all(a >= b for row in self._table for a, b in pairwise(row)),
                needed=False,
            ),
        ]

    def reasons(self, state: State, tick: int) -> Sequence[Reason]:
        """Return the reasons of x, y, z."""
        forces = baseline_force(state, tick, self.law)
        return [self._reason(state[i], state[3 + i], forces[i]) for i in range(3)]

    def _reason(self, r: float, v: float, force: float) -> Reason:
        distance, speed = pace_inputs(r, v, 0.0)
        fired = fired_rules(distance, speed, self.law, DISTANCES, SPEEDS)
        a, b, strength, pull = fired[0]
        sentence = (
            f'the target is {a} ({distance:.3g} m) and the closing speed is {b} ({speed:.3g} m/s) '
            f'→ {pull:.3g} N towards it, {strength:.2f}'
        )
        pairs = [
            ('force_n', force),
            ('distance_m', distance),
            ('closing_speed_m_s', speed),
            *((f'rule.{key(a)}.{key(b)}', strength) for a, b, strength, _ in fired),
        ]
        return sentence, pairs

    def in_words(self, published: Mapping[str, float]) -> Reasons | None:
        """Return all rules that make a force, with their shares; None if it is not of this one."""
        first, second = (published.get(k, 0.0) for k in ('distance_m', 'closing_speed_m_s'))
        fired = fired_rules(first, second, self.law, DISTANCES, SPEEDS)
        return blended(published.get('force_n'), fired, self.max_force_n, 'closing speed')

    @classmethod
    def genes(cls) -> tuple[Gene, ...]:
        """Return what a search varies; it begins at `_FORCES_N`."""
        found = [Gene('damping_n_s_m', _DAMPING / 3, _DAMPING * 3, _DAMPING, -1, 1, 1, True)]
        for word, peak, (least, most) in _between(DISTANCES[1:], _DISTANCES_M):
            found.append(Gene(f'{word}: peak_m', least, most, peak, 1, logarithmic=True))
        for word, peak, (least, most) in _between(SPEEDS[_RESTING + 1 :], _SPEEDS_M_S):
            found.append(Gene(f'{word}: peak_m_s', least, most, peak, 1, -1, logarithmic=True))
        for word, row in zip(DISTANCES[1:], _FORCES_N, strict=True):
            for speed, start in zip(SPEEDS, row, strict=True):
                off = 0.5 * abs(start) + 0.05
                found.append(Gene(f'{word}, {speed}', start - off, start + off, start, newtons=1))
        return tuple(found)

    @classmethod
    def of_values(cls, name: str, values: Mapping[str, float], mission: Mission) -> MoreWords:
        """Return the controller of the values of all genes."""
        speeds = SPEEDS[_RESTING + 1 :]
        return cls(
            name=name,
            description='Forces by distance and closing speed, in seven and eight words.',
            max_force_n=mission.max_force_n,
            distance_peaks_m=tuple(values[f'{word}: peak_m'] for word in DISTANCES[1:]),
            speed_peaks_m_s=tuple(values[f'{word}: peak_m_s'] for word in speeds),
            damping_n_s_m=values['damping_n_s_m'],
            forces_n=tuple(
                tuple(values[f'{word}, {speed}'] for speed in SPEEDS) for word in DISTANCES[1:]
            ),
        )


def _between(words: Sequence[str], peaks: Numbers) -> list[tuple[str, float, tuple[float, float]]]:
    """Return word, peak and the range of the peak, which no neighbour's range touches."""
    around = (peaks[0] / 4.0, *peaks, peaks[-1] * 4.0)
    ranges = [
        (peak * (before / peak) ** 0.45, peak * (after / peak) ** 0.45)
        for before, peak, after in zip(around, peaks, around[2:], strict=False)
    ]
    return list(zip(words, peaks, ranges, strict=True))


_DAMPING = 2.423
_DISTANCES_M = (0.7485, 4.553, 10.49, 26.08, 45.05, 58.24)
_SPEEDS_M_S = (0.05493, 0.2927, 0.4176, 0.6978, 0.8962)
_FORCES_N = (
    (0.4515, 0.1611, 0.09305, -0.01589, -0.3204, -0.3602, -0.4507, -0.4789),
    (0.5154, 0.1665, 0.0447, 0.007882, -0.0001342, -0.2872, -0.4352, -0.3505),
    (0.4583, 0.3879, 0.3037, 0.255, 0.1267, 0.003998, -0.1928, -0.3001),
    (0.4321, 0.2406, 0.2395, 0.1895, 0.1176, 0.04226, -0.02424, -0.1736),
    (0.4198, 0.09237, 0.0383, 0.04616, 0.07408, 0.07026, 0.07421, 0.003745),
    (0.3728, 0.2029, 0.1962, 0.1809, 0.169, 0.1573, 0.09969, 0.04508),
)
"""Where a search begins: found by a longer search from the surface of `pace`."""
