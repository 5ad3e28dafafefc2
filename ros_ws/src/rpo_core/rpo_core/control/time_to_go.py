# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A fuzzy controller of three inputs: position, velocity, and the time to go until arrival.

A first-order Takagi-Sugeno system: if the time to go is long, then f = -k r - d v with the gains of
`long`; and so on for five words. Triangles partition the time to go, so the gains are interpolated
between the words' peaks. With the mass m, the least-energy transfer of a free mass to rest in the
time T is the law k = 6 m / T^2, d = 4 m / T (Bryson and Ho, Applied Optimal Control, 1975).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple, dataclass, replace
from functools import cached_property, partial
from itertools import pairwise, product
from typing import Annotated, Any, ClassVar, NamedTuple

import numpy as np

from rpo_core.control import textbook
from rpo_core.control.baselines import (
    MAX_GAIN,
    MAX_HORIZON_TICKS,
    PAPER_MODEL,
    BaselineLaw,
    baseline_force,
    interval,
    law_of,
)
from rpo_core.control.blend import Reasons, newtons
from rpo_core.control.controller_file import Scaling, Units, register
from rpo_core.control.family import Claim, Family, Gene, Mission, Table
from rpo_core.files.validation import Checked, InputError, choice, real, store
from rpo_core.kernels.arithmetic import State
from rpo_core.kernels.jit import as_table
from rpo_core.scenario.requirements import (
    ARRIVAL_WINDOW_S,
    MAX_ARRIVAL_DISTANCE_M,
    MAX_ARRIVAL_SPEED_M_S,
    MAX_SLEW_N_S,
)
from rpo_core.world.cw import TickLength

WORDS = ('long', 'medium', 'short', 'very short', 'due')
"""The words of the time to go; `due` is also the word after arrival."""

_BOX_M, _BOX_M_S = textbook.RANGE_M, 0.05  # starts for which claims are made

_gain = partial(real, least=0.0, most=MAX_GAIN)


@dataclass(frozen=True)
class Rule(Checked):
    """If the time to go is `time_to_go`, then f = -position_gain r - velocity_gain v.

    peak_s : time to go at which only this rule fires
    """

    time_to_go: str
    peak_s: Annotated[float, partial(real, unit='s', least=0.0, most=1e6)]
    position_gain_n_m: Annotated[float, partial(_gain, unit='N/m')]
    velocity_gain_n_s_m: Annotated[float, partial(_gain, unit='N s/m')]

    def __post_init__(self) -> None:
        super().__post_init__()
        choice('time_to_go', self.time_to_go, WORDS)


class _Worst(NamedTuple):
    """Largest values over a box of starts."""

    force_n: float
    slew_n_s: float
    distance_m: float
    speed_m_s: float


@register
@dataclass(frozen=True, kw_only=True, repr=False)
class TimeToGo(Family):
    """Gains by the time to go: five rules in words, each axis alike.

    arrival_s : since the start of the run, when the time to go becomes 0 and stays so
    tick_s : length of the ticks that it counts
    rules : one for each of `WORDS`, in this order, their peaks descending
    """

    kind: ClassVar[str] = 'time_to_go'
    effort = (400, 40, 1)
    drawn = ('paper_test', 'paper_test_measured', 'random_starts', 'random_moving_starts')
    alike: ClassVar[bool] = True
    units: ClassVar[Units] = {'arrival_s': (0, 1, 0)}

    arrival_s: float
    tick_s: TickLength
    rules: tuple[Rule, ...]

    def __post_init__(self) -> None:
        super().__post_init__()
        longest_s = MAX_HORIZON_TICKS * self.tick_s
        store(self, arrival_s=real('arrival_s', self.arrival_s, 's', above=0.0, most=longest_s))
        words = tuple(rule.time_to_go for rule in self.rules)
        if words != WORDS:
            raise InputError(f'`rules` must be one for each of {", ".join(WORDS)}; got {words}')
        peaks = [rule.peak_s for rule in self.rules]
        if any(late >= early for early, late in pairwise(peaks)):
            raise InputError(f'`rules` must have descending `peak_s`; got {peaks}')

    @property
    def clock_s(self) -> float | None:
        """Length of the ticks that it counts."""
        return self.tick_s

    def scaled(self, scaling: Scaling, **also: Any) -> TimeToGo:
        """Return the controller of the similar loop; it counts the ticks of the vehicle."""
        rules = tuple(
            Rule(
                rule.time_to_go,
                scaling.of(rule.peak_s, (0, 1, 0)),
                scaling.of(rule.position_gain_n_m, (-1, 0, 1)),
                scaling.of(rule.velocity_gain_n_s_m, (-1, 1, 1)),
            )
            for rule in self.rules
        )
        return super().scaled(scaling, tick_s=scaling.vehicle.dt_s, rules=rules, **also)

    def time_to_go_s(self, tick: int) -> float:
        """Return the time to go at a tick."""
        return max(self.arrival_s - tick * self.tick_s, 0.0)

    @cached_property
    def _peaks_s(self) -> Any:
        return as_table([rule.peak_s for rule in reversed(self.rules)])

    def grades(self, tick: int) -> tuple[float, ...]:
        """Return the memberships of `WORDS` at a tick; they add up to 1."""
        i, share = interval(self.time_to_go_s(tick), self._peaks_s)
        grades = [0.0] * len(WORDS)
        grades[len(WORDS) - 1 - i] = 1.0 - share
        grades[len(WORDS) - 2 - i] = share
        return tuple(grades)

    def gains(self, tick: int) -> tuple[float, float]:
        """Return the gains of position [N/m] and velocity [N s/m] at a tick."""
        k = d = 0.0
        for grade, rule in zip(self.grades(tick), self.rules, strict=True):
            k += grade * rule.position_gain_n_m
            d += grade * rule.velocity_gain_n_s_m
        return k, d

    @cached_property
    def law(self) -> BaselineLaw:
        """What the kernels read: gains for each tick, until only `due` fires."""
        last = max(self.arrival_s - self.rules[-1].peak_s, 0.0)
        ticks = np.arange(int(last / self.tick_s) + 2)
        to_go = np.maximum(self.arrival_s - ticks * self.tick_s, 0.0)
        rules = self.rules[::-1]
        peaks = np.array([rule.peak_s for rule in rules])
        i = np.clip(np.searchsorted(peaks, to_go, side='right') - 1, 0, len(rules) - 2)
        share = np.clip((to_go - peaks[i]) / (peaks[i + 1] - peaks[i]), 0.0, 1.0)
        k, d = (
            share * gains[i + 1] + (1.0 - share) * gains[i]
            for gains in (
                np.array([rule.position_gain_n_m for rule in rules]),
                np.array([rule.velocity_gain_n_s_m for rule in rules]),
            )
        )
        rows = np.zeros((len(ticks), 3, 6))
        for axis in range(3):
            rows[:, axis, axis], rows[:, axis, 3 + axis] = k, d
        return law_of(self.max_force_n, gains=rows)

    @classmethod
    def genes(cls) -> tuple[Gene, ...]:
        """Return what a search varies; it begins at `textbook`, each word at half the time."""
        arrival = textbook.ARRIVAL_S
        genes = [Gene('arrival_s', 0.8 * arrival, 1.5 * arrival, arrival, seconds=1)]
        for i, word in enumerate(WORDS):
            t = arrival / 2.0**i
            k, d = textbook.gains(max(t, textbook.LEAST_S))
            free = 1.1 if word == WORDS[-1] else 4.0  # stiffer, it would follow noise for ever
            genes += [
                Gene(f'{word}: peak_s', 0.75 * t, 1.35 * t, t, seconds=1, logarithmic=True),
                Gene(f'{word}: k', k / free, k * free, k, -1, 0, 1, logarithmic=True),
                Gene(f'{word}: d', d / free, d * free, d, -1, 1, 1, logarithmic=True),
            ]
        return tuple(genes)

    @classmethod
    def of_values(cls, name: str, values: Sequence[float], mission: Mission) -> TimeToGo:
        """Return the controller of the values of all genes."""
        rules = (Rule(word, *values[3 * i + 1 : 3 * i + 4]) for i, word in enumerate(WORDS))
        return cls(
            name=name,
            description='Gains by the time to go, in five words.',
            max_force_n=mission.max_force_n,
            arrival_s=values[0],
            tick_s=mission.dt_s,
            rules=tuple(rules),
        )

    def values(self) -> tuple[float, ...]:
        """Return the values of all genes."""
        return (self.arrival_s, *(number for rule in self.rules for number in astuple(rule)[1:]))

    def tables(self) -> list[Table]:
        """Return its rules as a table."""
        rows: list[tuple[str, ...]] = [
            (
                rule.time_to_go,
                f'{rule.peak_s:g}',
                f'f = −{rule.position_gain_n_m:.4g} r − {rule.velocity_gain_n_s_m:.4g} v',
            )
            for rule in self.rules
        ]
        title = f'Rules of each axis [N, m, m/s]; arrival at {self.arrival_s:g} s'
        return [Table(title, ('time to go', 'peak [s]', 'then'), rows)]

    def claims(self) -> list[Claim]:
        """Return what is proven for every start in the box of the paper's training.

        The closed loop is linear in the start, as long as no force saturates. So each value here is
        a convex function of the start, and is largest at a corner of the box: all are flown. For
        the paper's chaser, without disturbance; floating point is not rounded outwards.
        """
        worst = self._worst_of_box(ARRIVAL_WINDOW_S)
        far, fast = MAX_ARRIVAL_DISTANCE_M, MAX_ARRIVAL_SPEED_M_S
        conditions = (
            ('force', 'of an axis, without saturation', worst.force_n, self.max_force_n, 'N'),
            ('slew', 'of an axis', worst.slew_n_s, MAX_SLEW_N_S, 'N/s'),
            ('arrival', 'mean of |r| over the last 30 s', worst.distance_m, far, 'm'),
            ('speed', 'mean of |v| over the last 30 s', worst.speed_m_s, fast, 'm/s'),
        )
        claims = [
            Claim(
                name,
                f'{what}: at most {value:.4g} {unit}, limit {limit:g}, from any start in the box '
                f'of {_BOX_M:g} m, at {_BOX_M_S:g} m/s',
                value <= limit,
            )
            for name, what, value, limit, unit in conditions
        ]
        due = np.asarray(self.law.gains[-1]).reshape(3, 6)
        radius = np.abs(np.linalg.eigvals(self._closed_loop(due))).max()
        hold = f'stable after arrival: spectral radius {radius:.6f}'
        return [*claims, Claim('hold', hold, bool(radius < 1.0))]

    def _closed_loop(self, gains: Any) -> Any:
        a, b = replace(PAPER_MODEL, dt_s=self.tick_s).matrices()
        return a - b @ gains

    def _worst_of_box(self, mean_s: float) -> _Worst:
        """Return the largest values over all starts in the box; means over the last `mean_s`."""
        ticks, tail = round(textbook.FLIGHT_S / self.tick_s), round(mean_s / self.tick_s)
        corners = np.array(list(product((1.0, -1.0), repeat=6))).T
        state, forces = corners * np.repeat([_BOX_M, _BOX_M_S], 3)[:, None], []
        distance, speed = np.zeros(64), np.zeros(64)
        for tick in range(ticks):
            k = np.asarray(self.law.gains[min(tick, len(self.law.gains) - 1)]).reshape(3, 6)
            forces.append(-k @ state)
            state = self._closed_loop(k) @ state
            if tick >= ticks - tail:
                distance = distance + np.linalg.norm(state[:3], axis=0) / tail
                speed = speed + np.linalg.norm(state[3:], axis=0) / tail
        forces_n = np.array(forces)
        steps = np.abs(np.diff(forces_n, axis=0)).max() / self.tick_s
        largest = (np.abs(forces_n).max(), steps, np.max(distance), np.max(speed))
        return _Worst(*map(float, largest))

    def reasons(self, state: State, tick: int) -> Sequence[Reasons]:
        """Return why x, y, z get their force."""
        to_go, grades, (k, d) = self.time_to_go_s(tick), self.grades(tick), self.gains(tick)
        fired = [(w, g) for w, g in zip(WORDS, grades, strict=True) if g > 0.0]
        fired.sort(key=lambda word: -word[1])
        words = ', '.join(f'{word} {grade:.2f}' for word, grade in fired)
        reasons, law = [], f'−{k:.3g} r − {d:.3g} v'
        for r, v, force in zip(
            state[:3], state[3:], baseline_force(state, tick, self.law), strict=True
        ):
            said = f'time to go is {words} ({to_go:.1f} s) → force {law} = {force:.3g} N'
            wanted = -(k * r + d * v)
            if abs(wanted) > self.max_force_n:
                said = f'{newtons(force)}, limited from {law} = {newtons(wanted)}, because '
                said += f'time to go is {words}'
            numbers = [
                ('force_n', force),
                ('time_to_go_s', to_go),
                *((f'time_to_go.{word.replace(" ", "_")}', grade) for word, grade in fired),
                ('position_gain_n_m', k),
                ('velocity_gain_n_s_m', d),
                ('position_m', r),
                ('velocity_m_s', v),
            ]
            reasons.append(Reasons(said, (), numbers))
        return reasons
