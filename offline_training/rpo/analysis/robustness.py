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
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cache, partial
from operator import attrgetter
from os import sched_getaffinity
from threading import Event
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import brentq

from rpo.montecarlo import config
from rpo.montecarlo.config import Campaign, CampaignConfig
from rpo.montecarlo.judging import NOT_JUDGED, words
from rpo.montecarlo.quantities import Dispersion
from rpo.montecarlo.run_batch import fly_drawn
from rpo.montecarlo.sampling import DrawnRuns, draw
from rpo.scoring.conditions import LABELS, PAPER
from rpo_core.control.baselines import Baseline, BaselineStage
from rpo_core.control.controller import AnyController, Controller
from rpo_core.files.validation import InputError
from rpo_core.kernels.arithmetic import saturate
from rpo_core.kernels.arrays import Floats
from rpo_core.kernels.jit import step_kernel
from rpo_core.scenario.scenario import load_set
from rpo_core.stage import KernelStage, Place, Stage
from rpo_core.wire.interfaces import COMMAND, CONTROL_FORCE

SET, DRAWN = 'paper_training', 'paper_test_measured'
RUNS, SEED = 200, 90210
"""Drawn flights of the campaign `DRAWN`, and their seed."""

BETWEEN = 8
"""Points between nothing and the bound that are checked after the bisection."""

BEYOND = (1.25, 1.5)
"""Points beyond the first failure, in its distance from nominal, that are checked too."""

SHARE = 0.01
"""The bisection ends when its interval is this share of the distance from nominal."""


NOT_OFF = Dispersion('uniform', (0.0,) * 3)
"""Of what starts have a section for, because it may be off."""


class Off(NamedTuple):
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
        runs = drawn._replace(parameters=drawn.parameters.copy())
        measured = 'sensor_bias_x_m' in drawn.names  # else navigation errs by itself
        biases = ('sensor_bias_', 'sensor_velocity_bias_') if measured else ('bias_', 'bias_v')
        runs.column('mass_kg')[:] *= self.mass
        runs.column('delay_ticks')[:] += self.delay_ticks
        for axis in 'xyz':
            share = runs.column(f'thrust_share_{axis}')
            share[:] = (1.0 + share) * self.thrust - 1.0
            runs.column(f'{biases[0]}{axis}_m')[:] += self.position_m
            runs.column(f'{biases[1]}{axis}_m_s')[:] += self.velocity_m_s
        return runs


NOMINAL = Off()


class Quantity(NamedTuple):
    """What is made larger, or smaller, until the claim fails.

    offs : from a point to what is flown there, of which the worst counts
    nominal, bound : where the search begins, and where it ends; first : its first step; it doubles
    form, unit, factor : a point in a table: format and unit, of the point over the factor
    digits : decimals of the points that are checked
    """

    name: str
    offs: Callable[[float], Sequence[Off]]
    nominal: float
    bound: float
    first: float
    form: str
    unit: str
    factor: float = 1.0
    digits: int = 3

    def number(self, x: float) -> str:
        """Return a point as a number of the unit that tables show."""
        return self.form.format(x / self.factor)

    def shown(self, x: float) -> str:
        """Return a point as tables show it."""
        return f'{self.number(x)} {self.unit}'


QUANTITIES = (
    Quantity('gain up', lambda x: [Off(gain=x)], 1.0, 32.0, 0.25, '{:.4g}', '×'),
    Quantity('gain down', lambda x: [Off(gain=x)], 1.0, 0.01, 0.1, '{:.4g}', '×'),
    Quantity('thrust loss', lambda x: [Off(thrust=1.0 - x)], 0.0, 0.99, 0.1, '{:.1f}', '%', 0.01),
    Quantity(
        'delay', lambda x: [Off(delay_ticks=x)], 0.0, 200.0, 1.0, '{:g}', 'ticks', digits=0
    ),
    Quantity('mass up', lambda x: [Off(mass=1.0 + x)], 0.0, 31.0, 0.1, '+{:.1f}', '%', 0.01),
    Quantity('mass down', lambda x: [Off(mass=1.0 - x)], 0.0, 0.99, 0.1, '−{:.1f}', '%', 0.01),
    Quantity(
        'position bias', lambda x: [Off(position_m=x), Off(position_m=-x)],
        0.0, 10.0, 0.05, '{:.4g}', 'mm', 1e-3,
    ),
    Quantity(
        'velocity bias', lambda x: [Off(velocity_m_s=x), Off(velocity_m_s=-x)],
        0.0, 1.0, 0.001, '{:.4g}', 'mm/s', 1e-3, digits=5,
    ),
)  # fmt: skip
"""What margins are found of. Bias: the same on all three axes, of the worse sign."""


class Point(NamedTuple):
    """A point that was checked: the largest value as a share of its limit, and which limit."""

    at: float
    share: float
    limit: str

    @property
    def holds(self) -> bool:
        """Whether the claim holds."""
        return self.share <= 1.0


class Margin(NamedTuple):
    """What was checked of a quantity.

    points : from nominal outward
    holds : the largest up to which, and at which, the claim holds
    fails, limit : the smallest at which it fails, and what fails there; None: it fails at none
    holds_again : one beyond at which it holds again; None: none seen
    """

    quantity: Quantity
    points: tuple[Point, ...]
    holds: float
    fails: float | None
    limit: str
    holds_again: float | None


def margin_of(quantity: Quantity, points: Iterable[Point]) -> Margin:
    """Return the margin that points show; the claim holds at nominal."""
    outward = tuple(sorted(points, key=lambda point: abs(point.at - quantity.nominal)))
    count = next((i for i, point in enumerate(outward) if not point.holds), len(outward))
    beyond = outward[count:]
    fails, limit = (beyond[0].at, beyond[0].limit) if beyond else (None, '')
    again = next((point.at for point in beyond if point.holds), None)
    return Margin(quantity, outward, outward[count - 1].at, fails, limit, again)


class Crossing(NamedTuple):
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


@dataclass(frozen=True)
class Margins:
    """Margins of a controller.

    missed : limit of the drawn flights -> how many miss it when nothing is off; margins are judged
        by those that none misses
    starts_missed : starts that miss a condition when nothing is off; more than 0: no margins
    margins : of `QUANTITIES`; crossings : of `AMPLITUDES_M` that have one
    """

    missed: dict[str, int]
    starts_missed: int
    margins: tuple[Margin, ...]
    crossings: tuple[Crossing, ...]

    @property
    def not_judged(self) -> list[str]:
        """Limits of the drawn flights that margins are not judged by."""
        return [name for name, count in self.missed.items() if count]

    def headline(self) -> str:
        """Return what margins are judged by, and what not."""
        if self.starts_missed:
            return (
                f'no margins: {self.starts_missed} of the starts of {SET} miss a condition already '
                'when nothing is off'
            )
        rest = ', '.join(f'{name} (by {self.missed[name]})' for name in self.not_judged)
        rest = f'; {NOT_JUDGED}, because missed when nothing is off: {rest}' if rest else ''
        judged = ', '.join(name for name, count in self.missed.items() if not count)
        return (
            f'judged: all starts of {SET} by {", ".join(LABELS.values())}; {RUNS} flights of '
            f'{DRAWN}, seed {SEED}, by {judged or "nothing"}{rest}'
        )

    def numbers(self) -> dict[str, Any]:
        """Return the numbers, unrounded, as nested mappings."""
        margins = {
            margin.quantity.name.replace(' ', '_'): dict(
                zip(Margin._fields[2:], margin[2:], strict=True)
            )
            for margin in self.margins
        }
        tightest = min(self.crossings, key=attrgetter('delay_margin_s'), default=None)
        return {
            'judged': self.headline(),
            'not_judged': '' if self.starts_missed else ', '.join(self.not_judged),
            **margins,
            'crossing': tightest._asdict() if tightest else {},
        }


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


def rows_of(margins: Margins) -> list[tuple[str, ...]]:
    """Return the margins as the rows of a table; a point that holds again is named."""
    rows: list[tuple[str, ...]] = []
    for margin in margins.margins:
        q, _, holds, fails, limit, again = margin
        beyond = 'none' if fails is None else q.shown(fails)
        note = '' if again is None else f'NOT monotone: holds again at {q.shown(again)}'
        rows.append((q.name, q.shown(holds), beyond, limit, note))
    return rows


def crossing_row(crossing: Sequence[float]) -> tuple[str, ...]:
    """Return a crossing as a row of a table."""
    formats = ('g', '.4f', '.1f', '.2f', '.1f')
    return tuple(f'{value:{form}}' for value, form in zip(crossing, formats, strict=True))


def cells(numbers: Mapping[str, Any]) -> list[str]:
    """Return a line under `COLUMNS`, of `Margins.numbers`: then the delay margin.

    ! : the claim holds again beyond; ≥ : nothing fails; – : there is no margin
    """
    quantities = {quantity.name: quantity for quantity in QUANTITIES}
    line = []
    for names in COLUMNS.values():
        ends = []
        for name in names:
            if margin := numbers.get(name.replace(' ', '_')):
                holds = quantities[name].number(margin['holds'])
                beyond = '≥' if margin['fails'] is None else ''
                ends.append(f'{beyond}{holds}{"" if margin["holds_again"] is None else "!"}')
        line.append('…'.join(ends) or '–')
    crossing = numbers.get('crossing')
    return [*line, crossing_row(crossing.values())[4] if crossing else '–']


def search(quantity: Quantity, check: Callable[[float], tuple[float, str]]) -> Margin:
    """Return the points checked; the claim holds at nominal.

    Doubling steps, bisection, points between and beyond. Where one of these fails below the bound,
    the bisection goes on there, and the points between are those of the smaller interval.

    check : from a point to the largest value as a share of its limit, and which limit that is
    """
    start, far = quantity.nominal, abs(quantity.bound - quantity.nominal)
    points: dict[float, Point] = {}

    def at(distance: float) -> Point:
        """Check a distance from nominal, rounded to the digits that are shown."""
        x = start + math.copysign(min(distance, far), quantity.bound - start)
        x = round(x, quantity.digits)
        if x not in points:
            points[x] = Point(x, *check(x))
        return points[x]

    def bracket() -> tuple[float, float]:
        """Return the distances of the largest point that holds and the smallest that fails."""
        margin = margin_of(quantity, points.values())
        return abs(margin.holds - start), math.inf if margin.fails is None else abs(
            margin.fails - start
        )

    if not at(0.0).holds:
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
    return margin_of(quantity, points.values())


@dataclass(slots=True)
class Gain:
    """Settings of the kernel `amplify`: a factor, and the largest force of an axis."""

    factor: float
    limit_n: float


@step_kernel
def amplify(tick: int, u: Any, p: Any, m: Any, y: Any) -> None:
    """F = sat(k F), per axis, of a command u (3,) [N]."""
    for i in range(3):
        y[i] = saturate(p.factor * u[i], p.limit_n)


class GainStage(KernelStage):
    """Multiplies the command of a controller, and keeps the limit of its law."""

    name = 'gain'
    inputs = (COMMAND,)
    outputs = (CONTROL_FORCE,)
    kernel = amplify

    def __init__(self, factor: float, limit_n: float) -> None:
        super().__init__(Gain(factor, limit_n))


@dataclass(frozen=True)
class Unlimited:
    """A baseline whose force no limit cuts off."""

    baseline: Baseline
    name: str
    provenance: Mapping[str, Any]

    def stage(self, dt_s: float) -> Stage:
        """Return it as a stage of the chain."""
        self.baseline.refuse_other_ticks(dt_s)
        law = self.baseline.law._replace(limit=math.inf)
        return BaselineStage(law, self.baseline.clock_s is not None)


class Flights:
    """The flights of the claim for one controller; raises InputError if it does not fit them.

    starts, drawn : campaigns of the starts of the training, and of the dispersed test
    """

    def __init__(self, controller: AnyController) -> None:
        self.controller = controller
        loaded = config.load(DRAWN, controller='handmade', runs=RUNS, seed=SEED)
        self.drawn, scenarios = replace(loaded, controller=controller), load_set(SET)
        settings = CampaignConfig(
            name=SET, scenario=SET, controller=controller.name, sampling='random',
            dispersions={name: NOT_OFF for name in ('thrust_share', 'navigation_position_bias_m')},
            runs=len(scenarios.initial_positions_m),
            success={name: PAPER.limits[name] for name in LABELS},
        )  # fmt: skip
        self.starts = Campaign(settings, scenarios.base, controller, ('', '', ''))
        nominal = draw(self.starts, 0, settings.runs)
        nominal.starts[:, :3] = scenarios.initial_positions_m
        self._runs = {DRAWN: draw(self.drawn, 0, RUNS), SET: nominal}

    def shares(self, campaign: Campaign, off: Off = NOMINAL) -> dict[str, Floats]:
        """Return the values (n,) of each limit, as shares of it."""
        flying: Controller = self.controller
        gain = GainStage(off.gain, getattr(flying, 'max_force_n', math.inf))
        if off.gain != 1.0 and isinstance(flying, Baseline):
            flying = Unlimited(flying, flying.name, flying.provenance)
        more = [(Place.SHAPING, gain)] if off.gain != 1.0 else []
        drawn = off.of(self._runs[campaign.config.name])
        columns = fly_drawn(campaign, drawn, flying, lambda _: more)
        limits = campaign.config.limits(columns)
        return {name: values / limit for name, (values, limit) in limits.items()}

    def check(self, off: Off, judged: Sequence[str]) -> tuple[float, str]:
        """Return the largest share of a limit, and which; drawn flights fly if all starts hold."""
        starts = self.shares(self.starts, off)
        worst = max((float(starts[name].max()), f'starts: {LABELS[name]}') for name in starts)
        if judged and worst[0] <= 1.0:
            drawn = self.shares(self.drawn, off)
            named = ((name, f'drawn: {words(name, unit=False)}') for name in judged)
            worst = max(worst, *((float(drawn[name].max()), label) for name, label in named))
        return worst


def margins_of(
    controller: AnyController,
    workers: int = 0,
    report: Callable[[str, int, int], None] = lambda *_: None,
) -> Margins:
    """Return the margins of a controller, and its crossings; `report` gets what is done.

    Raises InputError if the controller does not fit the flights.
    """
    flights, stop = Flights(controller), Event()
    starts, drawn = flights.shares(flights.starts), flights.shares(flights.drawn)
    starts_missed = int(np.any([share > 1.0 for share in starts.values()], axis=0).sum())
    missed = {name: int((share > 1.0).sum()) for name, share in drawn.items()}
    judged = [name for name, count in missed.items() if not count]

    @cache
    def check(off: Off) -> tuple[float, str]:
        if stop.is_set():
            raise InputError('stopped')
        return flights.check(off, judged)

    def margin(quantity: Quantity) -> Margin:
        return search(quantity, lambda x: max(map(check, quantity.offs(x))))

    margins: list[Margin] = []
    with ThreadPoolExecutor(workers or len(sched_getaffinity(0)), 'rpo-margins') as pool:
        try:
            for one in pool.map(margin, () if starts_missed else QUANTITIES):
                report(f'{controller.name}: margins', len(margins), len(QUANTITIES))
                margins.append(one)
        except BaseException:
            stop.set()  # a search waits for many flights
            raise
    base = flights.starts.scenario
    crossed = tuple(crossings(controller, base.mass_kg, base.dt_s))
    missed = {words(name, unit=False): count for name, count in missed.items()}
    return Margins(missed, starts_missed, tuple(margins), crossed)


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
    tightest = []
    for amplitude in AMPLITUDES_M:
        responses = [partial(describing, controller, axis, amplitude, dt_s) for axis in range(3)]
        crossed = (c for r in responses for c in _crossings(r, amplitude, mass_kg, dt_s))
        tightest += sorted(crossed, key=attrgetter('delay_margin_s'))[:1]
    return tightest


def _crossings(
    response: Callable[[Floats], Floats], amplitude: float, mass_kg: float, dt_s: float
) -> Iterator[Crossing]:
    """Yield all crossings of an amplitude; response : from rates (n,) to -N (n,)."""
    rates = np.geomspace(1e-4, math.pi / dt_s, _RATES)

    def excess(rates: Floats) -> Floats:
        """Loop gain less 1."""
        return np.abs(response(rates)) / (mass_kg * rates**2) - 1.0

    above = excess(rates) > 0.0
    for i in np.flatnonzero(above[:-1] != above[1:]):
        rate = brentq(lambda x: float(excess(np.array([x]))[0]), rates[i], rates[i + 1], rtol=1e-9)
        phase = float(np.angle(response(np.array([rate]))[0])) - rate * dt_s / 2.0
        delay_s = phase / rate
        yield Crossing(amplitude, rate, math.degrees(phase), delay_s, delay_s / dt_s)
