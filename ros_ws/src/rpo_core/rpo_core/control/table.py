# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The kind `more_words`: a static fuzzy controller as a table of forces.

Each axis is a zero-order Takagi-Sugeno system (`baselines.table_force`): if the target is
near and the closing speed is steady, then the force is so many newtons. The inputs are those of the
paper, with more words: seven for the distance (so a position, which has two sides, has thirteen)
and eight for the speed. Each rule has a force of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import pairwise
from typing import Annotated, Any, ClassVar

import numpy as np

from rpo_core.control import blend, textbook
from rpo_core.control.baselines import (
    MAX_GAIN,
    BaselineLaw,
    baseline_force,
    interval,
    law_of,
    table_inputs,
)
from rpo_core.control.blend import Reasons
from rpo_core.control.controller_file import Units, register
from rpo_core.control.family import Claim, Family, Gene, Mission, Table
from rpo_core.control.textbook import pull_n
from rpo_core.files.validation import InputError, matrix, real, shown
from rpo_core.kernels.arithmetic import State
from rpo_core.scenario.requirements import MAX_ARRIVAL_DISTANCE_M

HELD_M = 0.5
"""Error within which a disturbance is held, the paper's."""

RESTING = 2
"""Place of `resting` in the words of the speed. The peaks of those after it are searched."""

_DAMPING = textbook.gains(textbook.LEAST_S)[1]

Numbers = tuple[float, ...]


def numbers(name: str, value: Any) -> Numbers:
    """Return a list as numbers; raises InputError."""
    if not isinstance(value, (list, tuple)):
        raise InputError(f'`{name}` must be a list of numbers; got {shown(value)}')
    return tuple(
        real(f'{name}[{i}]', number, least=-MAX_GAIN, most=MAX_GAIN)
        for i, number in enumerate(value)
    )


def ascending(name: str, peaks: Numbers, count: int) -> None:
    """Refuse peaks that are not `count` ascending numbers above 0 with an InputError."""
    if len(peaks) != count or not all(a < b for a, b in pairwise((0.0, *peaks))):
        raise InputError(f'`{name}` must be {count} ascending numbers above 0; got {list(peaks)}')


def peak_genes(words: Sequence[str], peaks: Numbers, unit: str, seconds: int) -> tuple[Gene, ...]:
    """Return genes of ascending peaks, of whose ranges no two touch."""
    around = (peaks[0] / 4.0, *peaks, peaks[-1] * 4.0)
    genes = []
    for i, (word, peak) in enumerate(zip(words, peaks, strict=True)):
        least, most = (peak * (other / peak) ** 0.45 for other in (around[i], around[i + 2]))
        genes.append(Gene(f'{word}: peak{unit}', least, most, peak, 1, seconds, logarithmic=True))
    return tuple(genes)


def _mirrored(speeds: Sequence[float]) -> Numbers:
    """Return the peaks of closing speeds, with those of moving away."""
    return (-speeds[-1], -speeds[0], 0.0, *speeds)


@register
@dataclass(frozen=True, kw_only=True, repr=False)
class MoreWords(Family):
    """Forces by distance and closing speed: a table of rules in words, each axis alike.

    distances : words, ascending; `at` has its peak at 0 m
    speeds : words of the closing speed, ascending; `resting` has its peak at 0
    distance_peaks_m : of `distances` without `at`
    speed_peaks_m_s : of the words after `resting`; `drifting away` and `receding` mirror
        `creeping` and `fast`
    damping_n_s_m : at the target, the force is -damping_n_s_m * velocity at each peak
    forces_n : towards the target; a row for each distance without `at`
    """

    kind: ClassVar[str] = 'more_words'
    alike: ClassVar[bool] = True
    effort = (1000, 65, 3)
    masses_kg = (9.3, 10.3)  # without a clock, a heavier chaser comes late
    tests = 200.0  # with less, a search saves more energy than its force in the test costs
    distances: ClassVar[tuple[str, ...]] = (
        'at', 'close', 'very near', 'near', 'middle', 'far', 'remote'
    )  # fmt: skip
    speeds: ClassVar[tuple[str, ...]] = (
        'receding', 'drifting away', 'resting', 'creeping', 'slow', 'steady', 'brisk', 'fast'
    )  # fmt: skip
    units: ClassVar[Units] = {
        'distance_peaks_m': (1, 0, 0),
        'speed_peaks_m_s': (1, -1, 0),
        'damping_n_s_m': (-1, 1, 1),
        'forces_n': (0, 0, 1),
    }

    distance_peaks_m: Annotated[Numbers, numbers]
    speed_peaks_m_s: Annotated[Numbers, numbers]
    damping_n_s_m: Annotated[float, partial(real, unit='N s/m', above=0.0, most=1e6)]
    forces_n: Annotated[tuple[Numbers, ...], partial(matrix, rows=6, columns=8, bound=MAX_GAIN)]

    def __post_init__(self) -> None:
        super().__post_init__()
        ascending('distance_peaks_m', self.distance_peaks_m, len(self.distances) - 1)
        ascending('speed_peaks_m_s', self.speed_peaks_m_s, len(self.speeds) - 1 - RESTING)

    @property
    def peaks_m(self) -> Numbers:
        """Peaks of all distances."""
        return (0.0, *self.distance_peaks_m)

    @property
    def speeds_m_s(self) -> Numbers:
        """Peaks of all words of the closing speed."""
        return _mirrored(self.speed_peaks_m_s)

    @property
    def table_n(self) -> tuple[Numbers, ...]:
        """Forces towards the target; a row for each distance, at the target damping alone."""
        damping = tuple(0.0 - self.damping_n_s_m * speed for speed in self.speeds_m_s)
        return (damping, *self.forces_n)

    @cached_property
    def law(self) -> BaselineLaw:
        """What the kernels read."""
        return law_of(self.max_force_n, table=(self.peaks_m, self.speeds_m_s, self.table_n))

    @classmethod
    def genes(cls) -> tuple[Gene, ...]:
        """Return what a search varies, in the order of `values`; it begins at `textbook`.

        Each force is free by its own size and that at rest there.
        """
        words = cls.distances[1:]
        peaks_m = textbook.geometric(MAX_ARRIVAL_DISTANCE_M, textbook.RANGE_M, len(words))
        speeds = _mirrored([textbook.SPEED_M_S * ((i + 1) / 5.0) ** 1.5 for i in range(5)])
        genes = [
            Gene('damping_n_s_m', _DAMPING / 3.0, _DAMPING * 3.0, _DAMPING, -1, 1, 1, True),
            *peak_genes(words, peaks_m, '_m', 0),
            *peak_genes(cls.speeds[RESTING + 1 :], speeds[RESTING + 1 :], '_m_s', -1),
        ]
        for word, peak_m in zip(words, peaks_m, strict=True):
            starts = [pull_n(peak_m, speed) for speed in speeds]
            for speed, start in zip(cls.speeds, starts, strict=True):
                off = abs(start) + abs(starts[RESTING])
                genes.append(Gene(f'{word}, {speed}', start - off, start + off, start, newtons=1))
        return tuple(genes)

    @classmethod
    def of_values(cls, name: str, values: Sequence[float], mission: Mission) -> MoreWords:
        """Return the controller of the values of all genes."""
        n, m = len(cls.distances), len(cls.distances) + len(cls.speeds) - 1 - RESTING
        rows = np.reshape(values[m:], (n - 1, len(cls.speeds))).tolist()
        return cls(
            name=name,
            description='Forces by distance and closing speed, in seven and eight words.',
            max_force_n=mission.max_force_n,
            damping_n_s_m=values[0],
            distance_peaks_m=tuple(values[1:n]),
            speed_peaks_m_s=tuple(values[n:m]),
            forces_n=tuple(map(tuple, rows)),
        )

    def values(self) -> tuple[float, ...]:
        """Return the values of all genes."""
        forces = (force for row in self.forces_n for force in row)
        return (self.damping_n_s_m, *self.distance_peaks_m, *self.speed_peaks_m_s, *forces)

    def tables(self) -> list[Table]:
        """Return its rules as a table, and the peaks of its words."""
        peaks = ('peak of the speed [m/s]', '', *(f'{peak:.3g}' for peak in self.speeds_m_s))
        forces = [
            (word, f'{peak:g}', *(f'{force:.3g}' for force in row))
            for word, peak, row in zip(self.distances, self.peaks_m, self.table_n, strict=True)
        ]
        title = 'Force towards the target [N] of each axis'
        return [Table(title, ('distance', 'peak [m]', *self.speeds), [peaks, *forces])]

    def claims(self) -> list[Claim]:
        """Return what is proven of it: the table bounds and signs an interpolated force."""
        bound_n = min(self.max_force_n, max(abs(force) for row in self.table_n for force in row))
        rest, peaks_m = [row[RESTING] for row in self.forces_n], self.distance_peaks_m
        slope = min(force / peak for force, peak in zip(rest, peaks_m, strict=True))
        held = min(rest[0] / peaks_m[0] * HELD_M, *rest)
        return [
            Claim(
                'output',
                f'|force| of an axis <= {bound_n:.4g} N, because grades add up to 1',
                True,
            ),
            Claim(
                'odd and continuous',
                'force(-r, -v) = -force(r, v), without a jump at r = 0: there the force is odd in '
                'the speed, because its peaks mirror each other',
                True,
            ),
            Claim(
                'only rest at the target',
                f'from rest at any distance the force is towards the target: at least {slope:.3g} '
                'N/m up to the last peak',
                min(rest) > 0.0,
            ),
            Claim(
                'held disturbance',
                f'at rest {HELD_M:g} m or farther from the target, the force outweighs a constant '
                f'disturbance of {held:.3g} N',
                held > 0.0,
            ),
            Claim(
                'brakes',
                'at each distance, the force towards the target falls as the closing speed grows',
                all(a >= b for row in self.table_n for a, b in pairwise(row)),
                needed=False,
            ),
        ]

    def fired(self, distance_m: float, speed_m_s: float) -> list[tuple[str, str, float, float]]:
        """Return word, word, strength and force [N] of the rules that fire, the strongest first."""
        i, far = interval(distance_m, self.law.distances)
        j, fast = interval(speed_m_s, self.law.speeds)
        rules = [
            (self.distances[i + m], self.speeds[j + n], grade * other, self.table_n[i + m][j + n])
            for m, grade in enumerate((1.0 - far, far))
            for n, other in enumerate((1.0 - fast, fast))
            if grade * other > 0.0
        ]
        return sorted(rules, key=lambda rule: -rule[2])

    def reasons(self, state: State, tick: int) -> Sequence[Reasons]:
        """Return why x, y, z get their force: all rules that make it, with their shares."""
        forces, limit_n, reasons = baseline_force(state, tick, self.law), self.max_force_n, []
        for r, v, force_n in zip(state[:3], state[3:], forces, strict=True):
            distance_m, speed_m_s = table_inputs(r, v)
            fired = self.fired(distance_m, speed_m_s)
            pull = sum(strength * each for *_, strength, each in fired)
            limited = min(max(pull, -limit_n), limit_n)
            causes = [
                blend.Cause(
                    strength,
                    _towards(each),
                    f'the target is {a} and the closing speed is {b}',
                )
                for a, b, strength, each in fired
            ]
            whole = f', limited from {_towards(pull)}' if limited != pull else ''
            share = f'{100.0 * abs(limited) / limit_n:.0f} % of {limit_n:g} N'
            said = f'{blend.newtons(force_n)}, {_towards(limited)} ({share}{whole})'
            rules = [(f'rule.{a}.{b}'.replace(' ', '_'), strength) for a, b, strength, _ in fired]
            inputs = ('distance_m', distance_m), ('closing_speed_m_s', speed_m_s)
            reasons.append(Reasons(said, causes, [('force_n', force_n), *inputs, *rules]))
        return reasons


def _towards(pull_n: float) -> str:
    """Return a force towards the target in words."""
    way = ' towards the target' if pull_n > 0.0 else ' away from the target' if pull_n else ''
    return f'{abs(pull_n):.3g} N{way}'
