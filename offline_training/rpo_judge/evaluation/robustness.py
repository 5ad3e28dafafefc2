# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""How far the loop may be off: margins by flights, and crossings by describing functions.

A margin is about a claim: all training starts meet their conditions, and so many drawn flights of
the dispersed test, of a seed that no training uses, keep the limits that they keep when nothing is
off. Each quantity is changed alone, on top of what is drawn. Bisection finds where the claim fails;
points between and beyond are checked too, because nothing says that it fails only once.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, astuple, dataclass, replace
from functools import partial
from os import sched_getaffinity
from threading import Event
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import brentq

from rpo_core.control.controller import AnyController, FuzzyController
from rpo_core.files.scenario import ScenarioSet, load_set
from rpo_core.files.validation import InputError
from rpo_judge.scoring.conditions import LABELS, PAPER
from rpo_kernels.arrays import Floats
from rpo_montecarlo.campaign import config
from rpo_montecarlo.campaign.config import Campaign, CampaignConfig
from rpo_montecarlo.campaign.judging import NOT_JUDGED, words
from rpo_montecarlo.campaign.run_batch import side_by_side
from rpo_montecarlo.campaign.sampling import DrawnRuns, draw
from rpo_montecarlo.engine.lanes import PAIRED_LANES
from rpo_montecarlo.engine.parts.control import control_of, gain_part
from rpo_montecarlo.engine.support import why_not
from rpo_montecarlo.engine.tick import Part

Check = Callable[[float], tuple[float, str]]
"""From a point to the largest value as a share of its limit, and which limit that is."""

SET, DRAWN = 'paper_training', 'paper_test_measured'
RUNS, SEED = 200, 90210
"""Drawn flights of the campaign `DRAWN`, and their seed."""

BETWEEN = 8
"""Points between nothing and the bound that are checked after the bisection."""

BEYOND = (1.25, 1.5)
"""Points beyond the first failure, in its distance from nominal, that are checked too."""

SHARE = 0.01
"""The bisection ends when its interval is this share of the distance from nominal."""

_AXES, _BIASES = ('x', 'y', 'z'), ('bias_', 'bias_v')


@dataclass(frozen=True)
class Off:
    """How far flights are off, on top of what was drawn of each.

    gain : factor of the command, before it is saturated; slew and force are those after it
    thrust, mass : factors of the applied force, and of the mass, which the controller is not told
    delay_ticks : from a state to the force that answers it
    position_m, velocity_m_s : error of the sensor, or of navigation, on each of the three axes
    """

    gain: float = 1.0
    thrust: float = 1.0
    mass: float = 1.0
    delay_ticks: float = 0.0
    position_m: float = 0.0
    velocity_m_s: float = 0.0

    def of(self, drawn: DrawnRuns) -> DrawnRuns:
        """Return drawn runs that are off so far."""
        found = drawn.parameters.copy()

        def column(name: str) -> Floats:
            return found[:, drawn.names.index(name)]

        column('mass_kg')[:] *= self.mass
        column('delay_ticks')[:] += self.delay_ticks
        for axis in _AXES:
            share = column(f'thrust_share_{axis}')
            share[:] = (1.0 + share) * self.thrust - 1.0
            measured = f'sensor_bias_{axis}_m' in drawn.names  # else navigation errs by itself
            position, velocity = ('sensor_bias_', 'sensor_velocity_bias_') if measured else _BIASES
            column(f'{position}{axis}_m')[:] += self.position_m
            column(f'{velocity}{axis}_m_s')[:] += self.velocity_m_s
        return drawn._replace(parameters=found)


class Quantity(NamedTuple):
    """What is made larger, or smaller, until the claim fails.

    field, zero, slope : of `Off`: a point x makes it zero + slope x; of `both` signs, the worse
    nominal, most : where the search begins, and where it ends
    first : its first step; it doubles; digits : decimals of the points that are checked
    form, unit, factor : a point in a table: form and unit, of the point over the factor
    """

    name: str
    field: str
    zero: float
    slope: float
    nominal: float
    most: float
    first: float
    digits: int
    form: str
    unit: str
    factor: float = 1.0
    both: bool = False

    def offs(self, x: float) -> list[Off]:
        """Return what is flown at a point."""
        signs = (1.0, -1.0) if self.both else (1.0,)
        return [Off(**{self.field: self.zero + sign * self.slope * x}) for sign in signs]

    def number(self, x: float) -> str:
        """Return a point as a number of the unit that tables show."""
        return self.form.format(x / self.factor)

    def shown(self, x: float) -> str:
        """Return a point as tables show it."""
        number = self.number(x)
        return f'× {number}' if self.unit == '×' else f'{number} {self.unit}'


QUANTITIES = (
    Quantity('gain up', 'gain', 0.0, 1.0, 1.0, 32.0, 0.25, 3, '{:.4g}', '×'),
    Quantity('gain down', 'gain', 0.0, 1.0, 1.0, 0.01, 0.1, 3, '{:.4g}', '×'),
    Quantity('thrust loss', 'thrust', 1.0, -1.0, 0.0, 0.99, 0.1, 3, '{:.1f}', '%', 0.01),
    Quantity('delay', 'delay_ticks', 0.0, 1.0, 0.0, 200.0, 1.0, 0, '{:g}', 'ticks'),
    Quantity('mass up', 'mass', 1.0, 1.0, 0.0, 31.0, 0.1, 3, '+{:.1f}', '%', 0.01),
    Quantity('mass down', 'mass', 1.0, -1.0, 0.0, 0.99, 0.1, 3, '−{:.1f}', '%', 0.01),
    Quantity(
        'position bias', 'position_m', 0.0, 1.0, 0.0, 10.0, 0.05, 3, '{:.4g}', 'mm', 1e-3, True
    ),
    Quantity(
        'velocity bias', 'velocity_m_s', 0.0, 1.0, 0.0, 1.0, 0.001, 5, '{:.4g}', 'mm/s', 1e-3, True
    ),
)  # fmt: skip
"""What margins are found of. Bias: the same on all three axes."""


@dataclass(frozen=True)
class Point:
    """A point that was checked; share, limit : see `Check`."""

    at: float
    share: float
    limit: str

    @property
    def holds(self) -> bool:
        """Whether the claim holds."""
        return self.share <= 1.0


@dataclass(frozen=True)
class Margin:
    """What was checked of a quantity, from nominal outward."""

    name: str
    points: tuple[Point, ...]

    @property
    def holds(self) -> float:
        """The largest point checked up to which, and at which, the claim holds."""
        fails = self.fails
        held = self.points if fails is None else self.points[: self.points.index(fails)]
        return held[-1].at

    @property
    def fails(self) -> Point | None:
        """The smallest point checked at which it fails; None: at no point."""
        return next((point for point in self.points if not point.holds), None)

    @property
    def again(self) -> float | None:
        """A point beyond the first failure at which the claim holds again; None: none seen."""
        fails = self.fails
        later = self.points[self.points.index(fails) :] if fails else ()
        return next((point.at for point in later if point.holds), None)


@dataclass(frozen=True)
class Crossing:
    """Where the loop gain of a describing function falls through 1.

    amplitude_m : of the error of position; rate_rad_s : of the crossing
    phase_margin_deg : of the loop with the hold of a tick
    delay_margin_s, delay_margin_ticks : beside that hold
    """

    amplitude_m: float
    rate_rad_s: float
    phase_margin_deg: float
    delay_margin_s: float
    delay_margin_ticks: float


def _delay_s(crossing: Crossing) -> float:
    return crossing.delay_margin_s


@dataclass(frozen=True)
class Margins:
    """Margins of a controller.

    judged : limits of the drawn flights that margins are judged by: all of them keep these
    not_judged : the other limits; missed : by how many of the drawn flights each
    starts_missed : starts that miss a condition when nothing is off; more than 0: no margins
    margins : of `QUANTITIES`; crossings : of `AMPLITUDES_M` that have one
    """

    judged: tuple[str, ...]
    not_judged: tuple[str, ...]
    missed: tuple[int, ...]
    starts_missed: int
    margins: tuple[Margin, ...]
    crossings: tuple[Crossing, ...]

    @property
    def least(self) -> Crossing | None:
        """The crossing with the least delay margin."""
        return min(self.crossings, key=_delay_s, default=None)

    def headline(self) -> str:
        """Return what margins are judged by, and what not."""
        if self.starts_missed:
            return (
                f'no margins: {self.starts_missed} of the starts of {SET} miss a condition already '
                'when nothing is off'
            )
        pairs = zip(self.not_judged, self.missed, strict=True)
        rest = ', '.join(f'{words(n, unit=False)} (by {k})' for n, k in pairs)
        rest = f'; {NOT_JUDGED}, because missed when nothing is off: {rest}' if rest else ''
        names = ', '.join(words(name, unit=False) for name in self.judged) or 'nothing'
        return (
            f'judged: all starts of {SET} by {", ".join(LABELS.values())}; {RUNS} flights of '
            f'{DRAWN}, seed {SEED}, by {names}{rest}'
        )


HEADINGS = ('', 'largest at which all holds', 'smallest at which not', 'what fails there', '')
CROSSED = (
    'error [m]', 'crossing [rad/s]', 'phase margin [deg]', 'delay margin [s]',
    'delay margin [ticks]',
)  # fmt: skip

COLUMNS = {
    'gain [×]': ('gain down', 'gain up'),
    'thrust loss [%]': ('thrust loss',),
    'delay [ticks]': ('delay',),
    'mass [%]': ('mass down', 'mass up'),
    'position bias [mm]': ('position bias',),
    'velocity bias [mm/s]': ('velocity bias',),
}
"""Column of a table of controllers -> its margins."""


def _named(found: Margins) -> list[tuple[Quantity, Margin]]:
    known = {quantity.name: quantity for quantity in QUANTITIES}
    return [(known[margin.name], margin) for margin in found.margins]


def rows_of(found: Margins) -> list[tuple[str, ...]]:
    """Return the margins as the rows of a table; a point that holds again is named."""
    rows: list[tuple[str, ...]] = []
    for q, margin in _named(found):
        fails, again = margin.fails, margin.again
        beyond = ('none', '') if fails is None else (q.shown(fails.at), fails.limit)
        note = '' if again is None else f'NOT monotone: holds again at {q.shown(again)}'
        rows.append((q.name, q.shown(margin.holds), *beyond, note))
    return rows


def crossing_row(c: Crossing) -> tuple[str, ...]:
    """Return a crossing as a row of a table."""
    formats = ('g', '.4f', '.1f', '.2f', '.1f')
    return tuple(f'{value:{form}}' for value, form in zip(astuple(c), formats, strict=True))


def cells(found: Margins | None) -> dict[str, str]:
    """Return heading -> cell of a line; None: the engine cannot fly the controller."""
    line = dict.fromkeys((*COLUMNS, CROSSED[1], CROSSED[4]), '–')
    known = {margin.name: (q, margin) for q, margin in _named(found)} if found else {}
    for heading, names in COLUMNS.items():
        ends = [
            '≥' * (margin.fails is None) + q.number(margin.holds) + '!' * (margin.again is not None)
            for q, margin in (known[name] for name in names if name in known)
        ]
        line[heading] = '…'.join(ends) or '–'
    least = found.least if found else None
    crossed = zip(CROSSED, crossing_row(least), strict=True) if least else ()
    return line | {heading: cell for heading, cell in crossed if heading in line}


def numbers(found: Margins | None) -> dict[str, Any]:
    """Return the numbers behind `cells`, unrounded, as nested mappings."""
    if found is None:
        return {}
    margins = {
        margin.name.replace(' ', '_'): {
            'holds': margin.holds,
            'fails': margin.fails.at if margin.fails else None,
            'limit': margin.fails.limit if margin.fails else '',
            'holds_again': margin.again,
        }
        for margin in found.margins
    }
    return {
        'judged': found.headline(),
        **margins,
        'crossing': asdict(found.least) if found.least else {},
    }


def search(quantity: Quantity, check: Check) -> Margin:
    """Return the points checked; the claim holds at nominal.

    Doubling steps, bisection, points between and beyond. Where one of these fails below the bound,
    the bisection goes on there, and the points between are those of the smaller interval.
    """
    start, sign = quantity.nominal, 1.0 if quantity.most > quantity.nominal else -1.0
    far = abs(quantity.most - start)
    seen: dict[float, Point] = {}

    def at(distance: float) -> Point:
        """Check a distance from nominal, rounded to the digits that are shown."""
        x = round(start + sign * min(distance, far), quantity.digits)
        if x not in seen:
            seen[x] = Point(x, *check(x))
        return seen[x]

    def bracket() -> tuple[float, float]:
        """Return the distances of the largest point that holds and the smallest that fails."""
        found = Margin('', tuple(seen[x] for x in sorted(seen, key=lambda x: abs(x - start))))
        fails = found.fails
        return abs(found.holds - start), abs(fails.at - start) if fails else math.inf

    seen[start] = Point(start, *check(start))
    if not seen[start].holds:
        raise InputError(f'{quantity.name}: the claim must hold at nominal; it fails')
    step = quantity.first
    while at(step).holds and step < far:
        step *= 2.0
    while True:
        low, high = bracket()
        while low < high < math.inf and high - low > max(SHARE * high, 1.5 * 10**-quantity.digits):
            at((low + high) / 2.0)
            low, high = bracket()
        for i in range(1, BETWEEN + 1):
            at(low * i / (BETWEEN + 1))
        if bracket() == (low, high):
            break
    for share in BEYOND if high < math.inf else ():
        at(high * share)
    ordered = sorted(seen.values(), key=lambda point: abs(point.at - start))
    return Margin(quantity.name, tuple(ordered))


class Flights:
    """The flights of the claim for one controller; raises InputError if the engine cannot fly it.

    stop : set, to end a search that waits for more of them
    """

    def __init__(self, controller: AnyController) -> None:
        self.controller, self.stop = controller, Event()
        loaded = config.load(config.find(DRAWN), controller='handmade', runs=RUNS, seed=SEED)
        self.drawn, scenarios = replace(loaded, controller=controller), load_set(SET)
        self.starts = _campaign_of(scenarios, controller)
        for campaign in (self.starts, self.drawn):
            if reason := why_not(campaign.scenario, controller):
                raise InputError(f'margins need thousands of flights, side by side: {reason}')
        count = self.starts.config.runs
        nominal = draw(self.starts, 0, count)
        nominal.starts[:, :3] = scenarios.initial_positions_m
        self._runs = {DRAWN: draw(self.drawn, 0, RUNS), SET: nominal}
        self._limit_n: float = getattr(controller, 'max_force_n', math.inf)
        self._known: dict[Off, tuple[float, str]] = {}

    def shares(self, campaign: Campaign, off: Off = Off()) -> dict[str, Floats]:
        """Return the values (n,) of each limit, as shares of it."""
        more: list[Part] = []
        control = control_of(self.controller, limited=off.gain == 1.0)
        if off.gain != 1.0:
            more = [gain_part(PAIRED_LANES, off.gain, self._limit_n)]
        drawn = off.of(self._runs[campaign.config.name])
        columns = side_by_side(campaign, drawn, control, more)
        limits = campaign.config.limits(columns)
        return {name: values / limit for name, (values, limit) in limits.items()}

    def check(self, off: Off, judged: Sequence[str]) -> tuple[float, str]:
        """Return the largest share of a limit, and which; drawn flights fly if all starts hold."""
        if self.stop.is_set():
            raise InputError('stopped')
        if off not in self._known:
            found = self.shares(self.starts, off)
            worst = max((float(found[name].max()), f'starts: {LABELS[name]}') for name in found)
            if judged and worst[0] <= 1.0:
                found = self.shares(self.drawn, off)
                named = ((name, f'drawn: {words(name, unit=False)}') for name in judged)
                worst = max(worst, *((float(found[name].max()), label) for name, label in named))
            self._known[off] = worst
        return self._known[off]


def _campaign_of(scenarios: ScenarioSet, controller: AnyController) -> Campaign:
    """Return the starts of the training as a campaign without dispersions."""
    runs, success = len(scenarios.initial_positions_m), PAPER.limits
    own = CampaignConfig(
        name=SET, scenario=SET, controller=controller.name, runs=runs, sampling='random',
        dispersions={}, success={name: success[name] for name in LABELS},
    )  # fmt: skip
    return Campaign(own, scenarios.base, controller, ('', '', ''))


def margins_of(
    controller: AnyController,
    workers: int = 0,
    report: Callable[[str, int, int], None] = lambda *_: None,
) -> Margins:
    """Return the margins of a controller, and its crossings; `report` gets what is done.

    Raises InputError if the engine cannot fly it.
    """
    flights = Flights(controller)
    starts, drawn = flights.shares(flights.starts), flights.shares(flights.drawn)
    starts_missed = int(np.any([share > 1.0 for share in starts.values()], axis=0).sum())
    missed = {name: int((share > 1.0).sum()) for name, share in drawn.items()}
    judged = tuple(name for name, count in missed.items() if not count)
    others = tuple(name for name, count in missed.items() if count)
    margins: list[Margin] = []
    if not starts_missed:
        threads = workers or len(sched_getaffinity(0))
        with ThreadPoolExecutor(threads, 'rpo-margins') as pool:
            try:
                for margin in pool.map(partial(_margin, flights, judged), QUANTITIES):
                    report(f'{controller.name}: margins', len(margins), len(QUANTITIES))
                    margins.append(margin)
            except BaseException:
                flights.stop.set()
                raise
    base = flights.starts.scenario
    crossed = tuple(crossings(controller, base.mass_kg, base.dt_s))
    counts = tuple(missed[name] for name in others)
    return Margins(judged, others, counts, starts_missed, tuple(margins), crossed)


def _margin(flights: Flights, judged: Sequence[str], quantity: Quantity) -> Margin:
    return search(quantity, lambda x: max(flights.check(o, judged) for o in quantity.offs(x)))


AMPLITUDES_M = (0.05, 0.5, 5.0, 50.0)
"""Of the sinusoidal error of position that describing functions answer."""

AT_S = 400.0
"""When: a controller that counts time acts as at the end of the paper's test."""

_PHASES, _RATES = 256, 60


def describing(
    controller: AnyController, axis: int, amplitude_m: float, dt_s: float, rates: Floats
) -> Floats:
    """Return -N (n,) complex [N/m]: the fundamental of the force over that of the position.

    N belongs to r = A sin(w t), v = A w cos(w t) on one axis, the other axes at rest at the target.
    A spring and a damper have kp + j w kd.
    """
    angles = (np.arange(_PHASES) + 0.5) * (2.0 * math.pi / _PHASES)
    states = np.zeros((len(rates), _PHASES, 6))
    states[:, :, axis] = amplitude_m * np.sin(angles)
    states[:, :, axis + 3] = amplitude_m * rates[:, None] * np.cos(angles)
    ticks = np.full(len(rates) * _PHASES, round(AT_S / dt_s))
    (forces,) = controller.stage(dt_s).steps(ticks, states.reshape(-1, 6))
    waves = np.asarray(forces)[:, axis].reshape(len(rates), _PHASES)
    fundamental = waves @ (np.sin(angles) + 1j * np.cos(angles))
    return np.asarray(-2.0 / (_PHASES * amplitude_m) * fundamental)


def crossings(controller: AnyController, mass_kg: float, dt_s: float) -> list[Crossing]:
    """Return, of each amplitude, the crossing with the least delay margin on any axis.

    The loop is L(jw) = N(A, w) / (m (jw)^2) exp(-jw dt / 2): a double integrator, and the hold of a
    tick. Rates are searched from 1e-4 rad/s to those of half a sample per tick.
    """
    found = []
    alike = isinstance(controller, FuzzyController) or getattr(controller, 'alike', False)
    for amplitude in AMPLITUDES_M:
        answers = (
            partial(describing, controller, axis, amplitude, dt_s)
            for axis in range(1 if alike else 3)
        )
        crossed = (c for answer in answers for c in _crossings(answer, amplitude, mass_kg, dt_s))
        found += sorted(crossed, key=_delay_s)[:1]
    return found


def _crossings(
    answer: Callable[[Floats], Floats], amplitude: float, mass_kg: float, dt_s: float
) -> Iterator[Crossing]:
    """Yield all crossings of an amplitude; answer : from rates (n,) to -N (n,)."""
    rates = np.geomspace(1e-4, math.pi / dt_s, _RATES)

    def excess(rates: Floats) -> Floats:
        """Loop gain less 1."""
        return np.abs(answer(rates)) / (mass_kg * rates**2) - 1.0

    above = excess(rates) > 0.0
    for i in np.flatnonzero(above[:-1] != above[1:]):
        rate = brentq(lambda x: float(excess(np.array([x]))[0]), rates[i], rates[i + 1], rtol=1e-9)
        phase = float(np.angle(answer(np.array([rate]))[0])) - rate * dt_s / 2.0
        delay_s = phase / rate
        yield Crossing(amplitude, rate, math.degrees(phase), delay_s, delay_s / dt_s)
