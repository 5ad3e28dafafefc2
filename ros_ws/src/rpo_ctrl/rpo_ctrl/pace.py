# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A static fuzzy controller in other coordinates: how far the target is, and the pace towards it.

The least-energy approach from rest has the same form from every distance: f = |r| g(-v T / r) (a
homogeneous law of degree one). So distance and pace, the closing speed beside the distance, say
more than position and velocity. A zero-order Takagi-Sugeno system of these (`baseline_kernels.
pace_force`): if the target is near and the pace is steady, then the force is so many newtons.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import pairwise
from typing import Annotated, Any, ClassVar

from rpo_core.control import blend
from rpo_core.control.blend import Reasons
from rpo_core.control.controller_file import Reason, register
from rpo_core.files.validation import InputError, real, shown
from rpo_core.kernels import State
from rpo_ctrl.baseline_kernels import (
    BaselineLaw,
    baseline_force,
    interval,
    law_of,
    pace_inputs,
)
from rpo_ctrl.family import Claim, Family, Gene, Mission, Table

DISTANCES = ('at', 'close', 'very near', 'near', 'middle', 'far', 'very far', 'remote')
PACES = (
    'away',
    'drifting away',
    'resting',
    'very slow',
    'slow',
    'steady',
    'brisk',
    'fast',
    'passing',
)
"""The words, ascending. `at` has its peak at 0 m; `away` at -1, `resting` at 0, `passing` at 1."""

HELD_M = 0.5
"""Error within which a disturbance is held, the paper's."""

Numbers = tuple[float, ...]


def numbers(name: str, value: Any) -> Numbers:
    """Return a list as numbers; raises InputError."""
    if not isinstance(value, (list, tuple)):
        raise InputError(f'`{name}` must be a list of numbers; got {shown(value)}')
    return tuple(
        real(f'{name}[{i}]', number, least=-1e6, most=1e6) for i, number in enumerate(value)
    )


def ascending(name: str, peaks: Numbers, count: int) -> None:
    """Refuse peaks that are not `count` ascending numbers with an InputError."""
    ascends = all(a < b for a, b in pairwise(peaks))
    if len(peaks) != count or not ascends:
        raise InputError(f'`{name}` must be {count} ascending numbers; got {list(peaks)}')


def _table(name: str, value: Any) -> tuple[Numbers, ...]:
    rows = value if isinstance(value, (list, tuple)) else ()
    found = tuple(numbers(f'{name}[{i}]', row) for i, row in enumerate(rows))
    count = len(DISTANCES) - 1
    if len(found) != count or any(len(row) != len(PACES) for row in found):
        size = f'{count} rows of {len(PACES)} numbers'
        raise InputError(f'`{name}` must be {size}; got {shown(value)}')
    for i, row in enumerate(found):
        if row[0] != -row[-1]:
            raise InputError(
                f'`{name}[{i}]` must end with minus its first number, {-row[0]!r}, so that the '
                f'force has no jump at the target; got {row[-1]!r}'
            )
    return found


@register
@dataclass(frozen=True, kw_only=True)
class Pace(Family):
    """Forces by distance and pace: a table of rules in words, each axis alike.

    lead_s : with h = lead_s * closing speed, distance is |r| + |h|, and pace h / (|r| + |h|)
    distance_peaks_m : of `DISTANCES` without `at`
    pace_peaks : of `PACES`; the first is -1, the last 1
    forces_n : towards the target; a row for each distance without `at`, whose force is 0
    """

    kind: ClassVar[str] = 'pace'
    alike: ClassVar[bool] = True
    effort: ClassVar[tuple[int, int]] = (6, 3)

    lead_s: Annotated[float, partial(real, unit='s', above=0.0, most=1e6)]
    distance_peaks_m: Annotated[Numbers, numbers]
    pace_peaks: Annotated[Numbers, numbers]
    forces_n: Annotated[tuple[Numbers, ...], _table]

    def __post_init__(self) -> None:
        super().__post_init__()
        ascending('distance_peaks_m', self.distance_peaks_m, len(DISTANCES) - 1)
        ascending('pace_peaks', self.pace_peaks, len(PACES))
        if self.distance_peaks_m[0] <= 0.0:
            raise InputError(f'`distance_peaks_m` must be above 0; got {self.distance_peaks_m[0]}')
        if (self.pace_peaks[0], self.pace_peaks[-1]) != (-1.0, 1.0):
            raise InputError(f'`pace_peaks` must be from -1 to 1; got {list(self.pace_peaks)}')

    @property
    def _peaks(self) -> Numbers:
        return (0.0, *self.distance_peaks_m)

    @property
    def _rows(self) -> tuple[Numbers, ...]:
        return ((0.0,) * len(PACES), *self.forces_n)

    @cached_property
    def law(self) -> BaselineLaw:
        """What the kernels read."""
        table = (self._peaks, self.pace_peaks, self._rows, self.lead_s)
        return law_of(self.max_force_n, pace=table)

    def values(self) -> dict[str, float]:
        """Return the values of all genes."""
        found = {'lead_s': self.lead_s}
        for word, peak in zip(DISTANCES[1:], self.distance_peaks_m, strict=True):
            found[f'{word}: peak_m'] = peak
        for word, peak in zip(PACES[3:-1], self.pace_peaks[3:-1], strict=True):
            found[f'{word}: peak'] = peak
        for word, row in zip(DISTANCES[1:], self.forces_n, strict=True):
            for pace, force in zip(PACES[:-1], row, strict=False):
                found[f'{word}, {pace}'] = force
        return found

    def tables(self) -> list[Table]:
        """Return its rules as a table, and the peaks of its words."""
        title = f'Force towards the target [N] of each axis; lead {self.lead_s:g} s'
        words = dict(zip(PACES, self.pace_peaks, strict=True))
        rows = dict(zip(zip(DISTANCES, self._peaks, strict=True), self._rows, strict=True))
        return [force_table(title, 'peak of the pace', words, rows)]

    def claims(self) -> list[Claim]:
        """Return what is proven of it: the table bounds and signs an interpolated force."""
        rows, resting = self.forces_n, PACES.index('resting')
        braking = [row[resting:] for row in rows]
        falls = all(a >= b for row in braking for a, b in pairwise(row[:-1]))
        bound = min(self.max_force_n, max(abs(force) for row in rows for force in row))
        output, rest, held = table_claims(
            bound, rows, self.distance_peaks_m, resting, self.pace_peaks[resting] == 0.0
        )
        return [
            output,
            Claim(
                'odd and continuous',
                'force(-r, -v) = -force(r, v), without a jump at r = 0: each row ends with minus '
                'its first number',
                all(row[0] == -row[-1] for row in rows),
            ),
            rest,
            held,
            Claim(
                'brakes',
                'at each distance, the force towards the target falls as the pace grows from '
                'resting to fast',
                falls,
                needed=False,
            ),
        ]

    def reasons(self, state: State, tick: int) -> Sequence[Reason]:
        """Return the reasons of x, y, z."""
        forces = baseline_force(state, tick, self.law)
        return [self._reason(state[i], state[3 + i], forces[i]) for i in range(3)]

    def _reason(self, r: float, v: float, force: float) -> Reason:
        distance, pace = pace_inputs(r, v, self.lead_s)
        fired = fired_rules(distance, pace, self.law, DISTANCES, PACES)
        a, b, strength, pull = fired[0]
        sentence = (
            f'the target is {a} ({distance:.3g} m) and the pace is {b} ({pace:.2f}) → '
            f'{pull:.3g} N towards it, {strength:.2f}'
        )
        pairs = [
            ('force_n', force),
            ('distance_m', distance),
            ('pace', pace),
            *((f'rule.{key(a)}.{key(b)}', strength) for a, b, strength, _ in fired),
        ]
        return sentence, pairs

    def in_words(self, published: Mapping[str, float]) -> Reasons | None:
        """Return all rules that make a force, with their shares; None if it is not of this one."""
        fired = fired_rules(
            published.get('distance_m', 0.0), published.get('pace', 0.0), self.law, DISTANCES, PACES
        )
        return blended(published.get('force_n'), fired, self.max_force_n, 'pace')

    @classmethod
    def genes(cls) -> tuple[Gene, ...]:
        """Return what a search varies; it begins at `_FORCES_N`."""
        found = [Gene('lead_s', 10.0, 120.0, _LEAD_S, seconds=1, logarithmic=True)]
        for word, peak in zip(DISTANCES[1:], _DISTANCES_M, strict=True):
            found.append(Gene(f'{word}: peak_m', peak / 2.0, peak * 2.0, peak, 1, logarithmic=True))
        for word, peak in zip(PACES[3:-1], _PACES[3:-1], strict=True):
            found.append(Gene(f'{word}: peak', peak - 0.07, peak + 0.07, peak))
        for word, row in zip(DISTANCES[1:], _FORCES_N, strict=True):
            for pace, start in zip(PACES[:-1], row, strict=True):
                off = 0.5 * abs(start) + 0.3 * row[PACES.index('resting')]
                found.append(Gene(f'{word}, {pace}', start - off, start + off, start, newtons=1))
        return tuple(found)

    @classmethod
    def of_values(cls, name: str, values: Mapping[str, float], mission: Mission) -> Pace:
        """Return the controller of the values of all genes."""
        rows = [[values[f'{word}, {pace}'] for pace in PACES[:-1]] for word in DISTANCES[1:]]
        return cls(
            name=name,
            description='Forces by distance and pace, in words.',
            max_force_n=mission.max_force_n,
            lead_s=values['lead_s'],
            distance_peaks_m=tuple(values[f'{word}: peak_m'] for word in DISTANCES[1:]),
            pace_peaks=(*_PACES[:3], *(values[f'{word}: peak'] for word in PACES[3:-1]), 1.0),
            forces_n=tuple((*row, -row[0]) for row in rows),
        )


def force_table(
    title: str, second: str, words: Mapping[str, float], forces: Mapping[tuple[str, float], Numbers]
) -> Table:
    """Return the forces by distance and a second input, and the peaks of the words of both.

    second : what the peaks of the second input are
    words : of the second input -> peak
    forces : word and peak [m] of a distance -> forces towards the target [N]
    """
    peaks = (second, '', *(f'{peak:.3g}' for peak in words.values()))
    rows = [
        (word, f'{peak:g}', *(f'{force:.3g}' for force in row))
        for (word, peak), row in forces.items()
    ]
    return Table(title, ('distance', 'peak [m]', *words), [peaks, *rows])


def table_claims(
    bound_n: float, forces_n: Sequence[Numbers], peaks_m: Numbers, resting: int, rests: bool
) -> tuple[Claim, Claim, Claim]:
    """Return what a table bounds: the output, rest at the target alone, a held disturbance.

    bound_n : of the output; forces_n : towards the target; a row for each of `peaks_m`, the
        distances beyond 0
    resting : column of no speed; rests : whether its peak is 0
    """
    rest = [row[resting] for row in forces_n]
    slope = min(force / peak for force, peak in zip(rest, peaks_m, strict=True))
    held = min(rest[0] / peaks_m[0] * HELD_M, *rest)
    return (
        Claim(
            'output',
            f'|force| of an axis <= {bound_n:.4g} N, because grades add up to 1',
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
    )


def fired_rules(
    first: float,
    second: float,
    law: BaselineLaw,
    rows: Sequence[str],
    columns: Sequence[str],
) -> list[tuple[str, str, float, float]]:
    """Return word, word, strength and force [N] of the rules that fire, the strongest first.

    first, second : inputs of the table of a law; rows, columns : their words
    """
    i, far = interval(first, law.distances)
    j, fast = interval(second, law.paces)
    fired = [
        (
            rows[i + m],
            columns[j + n],
            grade * other,
            float(law.forces[len(columns) * (i + m) + j + n]),
        )
        for m, grade in enumerate((1.0 - far, far))
        for n, other in enumerate((1.0 - fast, fast))
        if grade * other > 0.0
    ]
    return sorted(fired, key=lambda rule: -rule[2])


def blended(
    force_n: float | None,
    fired: Sequence[tuple[str, str, float, float]],
    limit_n: float,
    second: str,
) -> Reasons | None:
    """Return a force and the rules that make it, in words; None if they do not make it.

    force_n : on the axis; fired : see `fired_rules`; second : what the second input is
    """
    pull = sum(strength * each for *_, strength, each in fired)
    limited = min(max(pull, -limit_n), limit_n)
    if force_n is None or not blend.is_same(abs(limited), abs(force_n)):
        return None
    causes = [
        blend.Cause(
            strength, _towards(each), f'{a}, {b}', f'the target is {a} and the {second} is {b}'
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


def key(word: str) -> str:
    """Return a word as a part of a name."""
    return word.replace(' ', '_')


_LEAD_S = 21.81
_DISTANCES_M = (0.58, 4.734, 13.27, 23.33, 46.77, 64.84, 314.2)
_PACES = (-1.0, -0.4, 0.0, 0.2417, 0.4151, 0.5621, 0.7303, 0.8678, 1.0)
_FORCES_N = (
    (0.05539, 0.08159, 0.07704, 0.03245, -0.0125, -0.01382, -0.03193, -0.05246),
    (0.3127, 0.3303, 0.04916, -0.01857, -0.07314, 0.04146, -0.1041, -0.2874),
    (0.4273, 0.4337, 0.3104, 0.1432, 0.01851, -0.03623, -0.4025, -0.4576),
    (0.5336, 0.4124, 0.2097, 0.1538, -0.01054, -0.222, -0.3257, -0.3702),
    (0.4868, 0.4936, 0.04728, 0.03624, -0.121, -0.3966, -0.443, -0.6705),
    (0.5453, 0.556, 0.2067, 0.06734, -0.2056, -0.4105, -0.6053, -0.711),
    (0.7771, 0.4416, 0.4187, -0.2439, -0.4027, -0.7826, -0.7523, -0.2501),
)
"""Where a search begins: found by a search from the least-energy approach, which took longer."""
