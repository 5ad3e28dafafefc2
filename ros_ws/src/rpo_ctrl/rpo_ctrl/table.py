# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Static fuzzy controllers as a table of forces: by the distance, and by a second input.

Each axis is a zero-order Takagi-Sugeno system (`baseline_kernels.pace_force`): if the target is
near and the second input is steady, then the force is so many newtons. Two kinds of file differ in
the second input.

pace        The least-energy approach from rest has the same form from every distance:
            f = |r| g(-v T / r), a homogeneous law of degree one. So the pace, the closing speed
            beside the distance, says more than the velocity.
more_words  The closing speed itself, as the paper has it, but with more words: seven for the
            distance (so a position, which has two sides, has thirteen) and eight for the speed.
            Each rule has a force of its own.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import pairwise
from typing import Annotated, Any, ClassVar

import numpy as np

from rpo_core.control import blend
from rpo_core.control.blend import Reasons
from rpo_core.control.controller_file import Reason, Units, register
from rpo_core.files.validation import InputError, matrix, real, shown
from rpo_core.judge.metrics import MAX_ARRIVAL_DISTANCE_M
from rpo_ctrl import textbook
from rpo_ctrl.baseline_kernels import (
    BaselineLaw,
    baseline_force,
    interval,
    law_of,
    pace_inputs,
)
from rpo_ctrl.baselines import MAX_GAIN
from rpo_ctrl.family import Claim, Family, Gene, Mission, Table
from rpo_ctrl.textbook import pull_n
from rpo_kernels.kernels import State

HELD_M = 0.5
"""Error within which a disturbance is held, the paper's."""

RESTING, SEARCHED = 2, 8
"""In the words of either second input: the place of `resting`; how many have forces of their own.
The peaks of those after `resting` are searched."""

_LEAD_S, _DAMPING = textbook.LEAD_S, textbook.gains(textbook.LEAST_S)[1]

Numbers = tuple[float, ...]


def numbers(name: str, value: Any) -> Numbers:
    """Return a list as numbers; raises InputError."""
    if not isinstance(value, (list, tuple)):
        raise InputError(f'`{name}` must be a list of numbers; got {shown(value)}')
    return tuple(
        real(f'{name}[{i}]', number, least=-MAX_GAIN, most=MAX_GAIN)
        for i, number in enumerate(value)
    )


def ascending(name: str, peaks: Numbers, count: int, positive: bool = False) -> None:
    """Refuse peaks that are not `count` ascending numbers with an InputError."""
    least = (0.0,) if positive else ()
    if len(peaks) != count or not all(a < b for a, b in pairwise((*least, *peaks))):
        above = ' above 0' if positive else ''
        raise InputError(f'`{name}` must be {count} ascending numbers{above}; got {list(peaks)}')


def peak_genes(words: Sequence[str], peaks: Numbers, unit: str, seconds: int) -> tuple[Gene, ...]:
    """Return genes of ascending peaks, of whose ranges no two touch."""
    around = (peaks[0] / 4.0, *peaks, peaks[-1] * 4.0)
    found = []
    for i, (word, peak) in enumerate(zip(words, peaks, strict=True)):
        least, most = (peak * (other / peak) ** 0.45 for other in (around[i], around[i + 2]))
        found.append(Gene(f'{word}: peak{unit}', least, most, peak, 1, seconds, logarithmic=True))
    return tuple(found)


class ForceTable(Family):
    """Forces by distance and a second input: a table of rules in words, each axis alike.

    A kind of file is a dataclass of this, with the fields of the file.

    distances : words, ascending; `at` has its peak at 0 m
    seconds : words of the second input, ascending; `resting` has its peak at 0
    second, quantity : what the second input is in words; its name where it is published
    in_unit : its format in a sentence
    heading : of its peaks
    braking : the columns in which the force shall fall, and how a sentence says it
    odd : why the force is odd and has no jump
    first, second_genes : what is searched beside distances and forces: a field of that name; peaks
    second_start : where a search begins, of the words whose forces are searched
    distance_peaks_m : of `distances` without `at`
    forces_n : towards the target; a row for each distance without `at`
    """

    alike: ClassVar[bool] = True
    effort = (1000, 65, 3)
    masses_kg = (9.3, 10.3)  # without a clock, a heavier chaser comes late
    tests = 200.0  # with less, a search saves more energy than its force in the test costs
    distances: ClassVar[tuple[str, ...]]
    seconds: ClassVar[tuple[str, ...]]
    second: ClassVar[str]
    quantity: ClassVar[str]
    in_unit: ClassVar[str]
    heading: ClassVar[str]
    braking: ClassVar[tuple[slice, str]]
    odd: ClassVar[str]
    first: ClassVar[Gene]
    second_genes: ClassVar[tuple[Gene, ...]]
    second_start: ClassVar[Numbers]

    distance_peaks_m: Numbers
    forces_n: tuple[Numbers, ...]

    def __post_init__(self) -> None:
        super().__post_init__()
        ascending('distance_peaks_m', self.distance_peaks_m, len(self.distances) - 1, positive=True)

    @property
    @abstractmethod
    def second_peaks(self) -> Numbers:
        """Peaks of all words of the second input."""

    @property
    def forces_at_n(self) -> Numbers:
        """The row of forces at the target itself: at rest there, none."""
        return (0.0,) * len(self.seconds)

    @property
    def lead_or_0_s(self) -> float:
        """What makes the second input a pace (`baseline_kernels.pace_inputs`); 0: a speed."""
        return getattr(self, 'lead_s', 0.0)

    @property
    def peaks_m(self) -> Numbers:
        """Peaks of all distances."""
        return (0.0, *self.distance_peaks_m)

    @property
    def table_n(self) -> tuple[Numbers, ...]:
        """Forces towards the target; a row for each distance."""
        return (self.forces_at_n, *self.forces_n)

    @cached_property
    def law(self) -> BaselineLaw:
        """What the kernels read."""
        table = self.peaks_m, self.second_peaks, self.table_n, self.lead_or_0_s
        return law_of(self.max_force_n, pace=table)

    @classmethod
    def genes(cls) -> tuple[Gene, ...]:
        """Return what a search varies, in the order of `values`; it begins at `textbook`.

        Each force is free by its own size and that at rest there.
        """
        words = cls.distances[1:]
        peaks_m = textbook.geometric(MAX_ARRIVAL_DISTANCE_M, textbook.RANGE_M, len(words))
        found = [cls.first, *peak_genes(words, peaks_m, '_m', 0), *cls.second_genes]
        for word, peak_m in zip(words, peaks_m, strict=True):
            starts = [cls.start_n(peak_m, peak) for peak in cls.second_start]
            for second, start in zip(cls.seconds, starts, strict=False):
                off = abs(start) + abs(starts[RESTING])
                found.append(Gene(f'{word}, {second}', start - off, start + off, start, newtons=1))
        return tuple(found)

    @classmethod
    def of_values(cls, name: str, values: Sequence[float], mission: Mission) -> ForceTable:
        """Return the controller of the values of all genes."""
        n, m = len(cls.distances), len(cls.distances) + len(cls.second_genes)
        rows = np.reshape(values[m:], (n - 1, SEARCHED)).tolist()
        fields = cls.searched(tuple(values[n:m]), tuple(map(tuple, rows)))
        fields |= {cls.first.name: values[0], 'distance_peaks_m': tuple(values[1:n])}
        return cls(name=name, max_force_n=mission.max_force_n, **fields)

    @staticmethod
    def start_n(distance_m: float, second: float) -> float:
        """Return the force where a search begins, at a distance and a closing speed."""
        return pull_n(distance_m, second)

    @staticmethod
    @abstractmethod
    def searched(peaks: Numbers, forces_n: tuple[Numbers, ...]) -> dict[str, Any]:
        """Return the fields of searched peaks of the second input, and rows of searched forces."""

    def values(self) -> tuple[float, ...]:
        """Return the values of all genes."""
        second = self.second_peaks[RESTING + 1 : SEARCHED]
        forces = (force for row in self.forces_n for force in row[:SEARCHED])
        return (getattr(self, self.first.name), *self.distance_peaks_m, *second, *forces)

    def tables(self) -> list[Table]:
        """Return its rules as a table, and the peaks of its words."""
        lead = f'; lead {self.lead_or_0_s:g} s' if self.lead_or_0_s else ''
        peaks = (self.heading, '', *(f'{peak:.3g}' for peak in self.second_peaks))
        forces = [
            (word, f'{peak:g}', *(f'{force:.3g}' for force in row))
            for word, peak, row in zip(self.distances, self.peaks_m, self.table_n, strict=True)
        ]
        title = f'Force towards the target [N] of each axis{lead}'
        return [Table(title, ('distance', 'peak [m]', *self.seconds), [peaks, *forces])]

    def claims(self) -> list[Claim]:
        """Return what is proven of it: the table bounds and signs an interpolated force."""
        bound_n = min(self.max_force_n, max(abs(force) for row in self.table_n for force in row))
        rest, peaks_m = [row[RESTING] for row in self.forces_n], self.distance_peaks_m
        rests = self.second_peaks[RESTING] == 0.0
        slope = min(force / peak for force, peak in zip(rest, peaks_m, strict=True))
        held = min(rest[0] / peaks_m[0] * HELD_M, *rest)
        columns, way = self.braking
        return [
            Claim(
                'output',
                f'|force| of an axis <= {bound_n:.4g} N, because grades add up to 1',
                True,
            ),
            Claim(
                'odd and continuous',
                f'force(-r, -v) = -force(r, v), without a jump at r = 0: {self.odd}',
                True,
            ),
            Claim(
                'only rest at the target',
                f'from rest at any distance the force is towards the target: at least {slope:.3g} '
                'N/m up to the last peak',
                rests and min(rest) > 0.0,
            ),
            Claim(
                'held disturbance',
                f'at rest {HELD_M:g} m or farther from the target, the force outweighs a constant '
                f'disturbance of {held:.3g} N',
                rests and held > 0.0,
            ),
            Claim(
                'brakes',
                f'at each distance, the force towards the target falls as the {way}',
                all(a >= b for row in self.table_n for a, b in pairwise(row[columns])),
                needed=False,
            ),
        ]

    def fired(self, distance_m: float, second: float) -> list[tuple[str, str, float, float]]:
        """Return word, word, strength and force [N] of the rules that fire, the strongest first."""
        i, far = interval(distance_m, self.law.distances)
        j, fast = interval(second, self.law.paces)
        found = [
            (self.distances[i + m], self.seconds[j + n], grade * other, self.table_n[i + m][j + n])
            for m, grade in enumerate((1.0 - far, far))
            for n, other in enumerate((1.0 - fast, fast))
            if grade * other > 0.0
        ]
        return sorted(found, key=lambda rule: -rule[2])

    def reasons(self, state: State, tick: int) -> Sequence[Reason]:
        """Return the reasons of x, y, z."""
        forces = baseline_force(state, tick, self.law)
        return [self._reason(state[i], state[3 + i], forces[i]) for i in range(3)]

    def _reason(self, r: float, v: float, force: float) -> Reason:
        distance, second = pace_inputs(r, v, self.lead_or_0_s)
        fired = self.fired(distance, second)
        a, b, strength, pull = fired[0]
        sentence = (
            f'the target is {a} ({distance:.3g} m) and the {self.second} is {b} '
            f'({self.in_unit.format(second)}) → {pull:.3g} N towards it, {strength:.2f}'
        )
        rules = [(f'rule.{a}.{b}'.replace(' ', '_'), strength) for a, b, strength, _ in fired]
        return sentence, [
            ('force_n', force), ('distance_m', distance), (self.quantity, second), *rules
        ]  # fmt: skip

    def in_words(self, published: Mapping[str, float]) -> Reasons | None:
        """Return all rules that make a force, with their shares; None if it is not of this one."""
        force_n = published.get('force_n')
        fired = self.fired(published.get('distance_m', 0.0), published.get(self.quantity, 0.0))
        pull = sum(strength * each for *_, strength, each in fired)
        limit_n = self.max_force_n
        limited = min(max(pull, -limit_n), limit_n)
        if force_n is None or not blend.is_same(abs(limited), abs(force_n)):
            return None
        causes = [
            blend.Cause(
                strength,
                _towards(each),
                f'{a}, {b}',
                f'the target is {a} and the {self.second} is {b}',
            )
            for a, b, strength, each in fired
        ]
        whole = f', limited from {_towards(pull)}' if limited != pull else ''
        share = f'{100.0 * abs(limited) / limit_n:.0f} % of {limit_n:g} N'
        return Reasons(f'{blend.newtons(force_n)}, {_towards(limited)} ({share}{whole})', causes)


def _towards(pull_n: float) -> str:
    """Return a force towards the target in words."""
    way = ' towards the target' if pull_n > 0.0 else ' away from the target' if pull_n else ''
    return f'{abs(pull_n):.3g} N{way}'


@register
@dataclass(frozen=True, kw_only=True)
class Pace(ForceTable):
    """Forces by distance and pace.

    lead_s : with h = lead_s * closing speed, distance is |r| + |h|, and pace h / (|r| + |h|)
    pace_peaks : of the words of the pace; the first is -1, the last 1
    forces_n : each row ends with minus its first number; at the target the force is 0
    """

    kind: ClassVar[str] = 'pace'
    distances = ('at', 'close', 'very near', 'near', 'middle', 'far', 'very far', 'remote')
    seconds = (
        'away', 'drifting away', 'resting', 'very slow', 'slow', 'steady', 'brisk', 'fast',
        'passing',
    )  # fmt: skip
    second = quantity = 'pace'
    in_unit, heading = '{:.2f}', 'peak of the pace'
    braking = slice(RESTING, -1), 'pace grows from resting to fast'
    odd = 'each row ends with minus its first number'
    first = Gene('lead_s', _LEAD_S / 3.0, _LEAD_S * 3.0, _LEAD_S, seconds=1, logarithmic=True)
    second_start = (-1.0, -0.4, 0.0, *((i + 1) / 6.0 for i in range(5)))
    second_genes = tuple(
        Gene(f'{word}: peak', peak - 0.075, peak + 0.075, peak)
        for word, peak in zip(seconds[3:-1], second_start[3:], strict=True)
    )
    units: ClassVar[Units] = {
        'lead_s': (0, 1, 0),
        'distance_peaks_m': (1, 0, 0),
        'forces_n': (0, 0, 1),
    }

    lead_s: Annotated[float, partial(real, unit='s', above=0.0, most=1e6)]
    distance_peaks_m: Annotated[Numbers, numbers]
    pace_peaks: Annotated[Numbers, numbers]
    forces_n: Annotated[tuple[Numbers, ...], partial(matrix, rows=7, columns=9, bound=MAX_GAIN)]

    def __post_init__(self) -> None:
        super().__post_init__()
        ascending('pace_peaks', self.pace_peaks, len(self.seconds))
        if (self.pace_peaks[0], self.pace_peaks[-1]) != (-1.0, 1.0):
            raise InputError(f'`pace_peaks` must be from -1 to 1; got {list(self.pace_peaks)}')
        for i, row in enumerate(self.forces_n):
            if row[0] != -row[-1]:
                raise InputError(
                    f'`forces_n[{i}]` must end with minus its first number, {-row[0]!r}, so that '
                    f'the force has no jump at the target; got {row[-1]!r}'
                )

    @property
    def second_peaks(self) -> Numbers:
        """Peaks of the words of the pace."""
        return self.pace_peaks

    @staticmethod
    def start_n(distance_m: float, second: float) -> float:
        """Return the force where a search begins, at a distance and a pace."""
        return pull_n(distance_m * (1.0 - abs(second)), distance_m * second / _LEAD_S)

    @staticmethod
    def searched(peaks: Numbers, forces_n: tuple[Numbers, ...]) -> dict[str, Any]:
        """Return paces from -1 to 1, and rows that end with minus their first number."""
        return {
            'description': 'Forces by distance and pace, in words.',
            'pace_peaks': (-1.0, -0.4, 0.0, *peaks, 1.0),
            'forces_n': tuple((*row, -row[0]) for row in forces_n),
        }


def _mirrored(speeds: Sequence[float]) -> Numbers:
    """Return the peaks of closing speeds, with those of moving away."""
    return (-speeds[-1], -speeds[0], 0.0, *speeds)


@register
@dataclass(frozen=True, kw_only=True)
class MoreWords(ForceTable):
    """Forces by distance and closing speed.

    speed_peaks_m_s : of the words after `resting`; `drifting away` and `receding` mirror
        `creeping` and `fast`
    damping_n_s_m : at the target, the force is -damping_n_s_m * velocity at each peak
    """

    kind: ClassVar[str] = 'more_words'
    distances = ('at', 'close', 'very near', 'near', 'middle', 'far', 'remote')
    seconds = (
        'receding', 'drifting away', 'resting', 'creeping', 'slow', 'steady', 'brisk', 'fast'
    )  # fmt: skip
    second, quantity = 'closing speed', 'closing_speed_m_s'
    in_unit, heading = '{:.3g} m/s', 'peak of the speed [m/s]'
    braking = slice(None), 'closing speed grows'
    odd = 'there the force is odd in the speed, because its peaks mirror each other'
    first = Gene('damping_n_s_m', _DAMPING / 3.0, _DAMPING * 3.0, _DAMPING, -1, 1, 1, True)
    second_start = _mirrored([textbook.SPEED_M_S * ((i + 1) / 5.0) ** 1.5 for i in range(5)])
    second_genes = peak_genes(seconds[3:], second_start[3:], '_m_s', -1)
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
        count = len(self.seconds) - 1 - RESTING
        ascending('speed_peaks_m_s', self.speed_peaks_m_s, count, positive=True)

    @property
    def second_peaks(self) -> Numbers:
        """Peaks of the words of the closing speed."""
        return _mirrored(self.speed_peaks_m_s)

    @property
    def forces_at_n(self) -> Numbers:
        """Damping."""
        return tuple(0.0 - self.damping_n_s_m * speed for speed in self.second_peaks)

    @staticmethod
    def searched(peaks: Numbers, forces_n: tuple[Numbers, ...]) -> dict[str, Any]:
        """Return speeds and rows as they are."""
        said = 'Forces by distance and closing speed, in seven and eight words.'
        return {'description': said, 'speed_peaks_m_s': peaks, 'forces_n': forces_n}
