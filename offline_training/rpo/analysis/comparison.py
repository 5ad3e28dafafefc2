# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Controllers beside each other: training starts, the paper's test, a dispersed campaign.

The folder keeps each part of the results of a controller under a digest of all that it depends on
(controller, scenarios or campaign, versions). An interrupted comparison goes on from there; a
changed controller is computed anew.
"""

from __future__ import annotations

import json
import time
import timeit
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from rpo.analysis import robustness
from rpo.analysis.optimal import least_constrained
from rpo.analysis.robustness import COLUMNS, CROSSED, DRAWN, RUNS, SEED, cells
from rpo.montecarlo import config, execution, in_python, run_batch
from rpo.montecarlo.config import Campaign
from rpo.montecarlo.judging import NOT_JUDGED, motion, sentence, words
from rpo.montecarlo.outputs import digest_of, identifier, make_folder, markdown_table, write_text
from rpo.montecarlo.run_batch import fly_run
from rpo.montecarlo.statistics import rate
from rpo.proof import proven
from rpo.scoring import fitness
from rpo.scoring.conditions import LABELS
from rpo_core import files
from rpo_core.chain.flight import Flight, flights_of, fly
from rpo_core.control.controller import AnyController, FuzzyController, load_controller
from rpo_core.files.validation import InputError
from rpo_core.judge import metrics
from rpo_core.judge.metrics import ARRIVAL_DISTANCE, ARRIVAL_TIME, CLAIM_WINDOW_S, ENERGY, SLEW
from rpo_core.judge.verdicts import verdicts
from rpo_core.kernels.arrays import Floats
from rpo_core.scenario.scenario import Scenario, load_scenario, load_set
from rpo_log.provenance import machine_facts

CONTROLLERS = (
    'allround', 'paper_ga', 'handmade', 'more_words', 'time_to_go',
    'mpc', 'apf_smc', 'lqr', 'pd', 'drift',
)  # fmt: skip
STARTS, TESTS = 'paper_training', tuple(fitness.TESTS)

RANDOM = ('random_starts', 'random_moving_starts')
"""Campaigns of random starts in the box of the training: at rest, and moving."""

WORLD, WORLD_RUNS = 'world_leo', 40
"""The campaign that counts valve openings, and its runs."""

OPEN_N = 0.005
"""A thruster counts as open at more than this force, 1 % of the largest."""

OPENED_RUNS = 10
"""Dispersed runs in which openings are counted."""

CONTACT_M = 1.0

_CALLS, _REPETITIONS = 2000, 5

Row = dict[str, Any]
"""A controller: name of a figure -> its value.

mean_energy_n2s : of the starts; ratio : to the mean of the constrained optima
starts, met : training starts, and those that meet all three conditions
distance_m, worst_distance_m : mean and largest, over the starts, of the mean distance in the last
    30 s; slew_per_axis_n_s : the largest; settled_s : mean time after which it stays within 0.5 m
tests : by scenario, the largest |r| and |v| of an axis in the last 200 s, and J
margin, margin_of : smallest distance to a limit as a share of it, over all starts and the paper's
    tests, and the condition
contact_m_s, contact_median_m_s : speed at the first state within 1 m, the largest and the median
    over the starts that come there; None of both if none does
kept, runs, low, high : runs of the campaign that keep every limit of it, of how many, Wilson's 95 %
    interval of their share; moving : the same, of its limits on position and speed alone, or None
saw : what of the campaign the training saw
openings : starts of thrust of an axis in a dispersed run, the mean
valve_openings, propellant_kg : means of runs of the campaign `WORLD`
random_runs, random_missed : runs of each of `RANDOM`, and those that miss a condition, by campaign
margins : `Margins.numbers`; empty: the engine cannot fly the controller
proof : what is shown of the conditions from every start of the box
command_us : processor time of one command on this machine
"""


def contact_speed(flight: Flight) -> float | None:
    """Return the speed [m/s] at the first state within `CONTACT_M` of the target, if any."""
    inside = np.flatnonzero(np.linalg.norm(flight.states[:, :3], axis=1) < CONTACT_M)
    return float(np.linalg.norm(flight.states[inside[0], 3:])) if len(inside) else None


def openings(forces_n: Floats) -> float:
    """Return how often thrust (n, 3) begins on an axis, the mean of the axes.

    A new side is a new start.
    """
    side = np.sign(forces_n) * (np.abs(forces_n) > OPEN_N)
    begins = (side[1:] != side[:-1]) & (side[1:] != 0.0)
    return float((begins.sum(axis=0) + (side[0] != 0.0)).mean())


def kept(
    folder: Path, name: str, texts: Sequence[str], make: Callable[[], dict[str, Any]]
) -> dict[str, Any]:
    """Return the result kept under a name for these texts; make and keep it if missing."""
    libraries = {name: version(name) for name in ('numpy', 'scipy', 'numba', 'clarabel', 'cvxpy')}
    key = digest_of(name, *texts, json.dumps(libraries, sort_keys=True))[:16]
    path = folder / f'{identifier(name)}-{key}.json'
    try:
        document = json.loads(files.read_text(path))
        result: dict[str, Any] = document['result']
        if document['sha256'] == digest_of(json.dumps(result)):
            return result
    except (ValueError, KeyError, TypeError, RecursionError):
        pass  # missing, or damaged
    make_folder(folder)
    result = make()
    document = {'sha256': digest_of(json.dumps(result)), 'result': result}
    write_text(path, json.dumps(document, indent=1))
    return result


class Comparison:
    """The controllers of a comparison, and the folder that keeps their results.

    saw : returns what the training of a controller saw of a campaign, by the campaign's name
    report : called with the present work, how much of it is done, and how much it is in all
    random_runs : random starts at rest, and as many moving
    """

    def __init__(
        self,
        names: Sequence[str],
        folder: Path,
        campaign: str | Path,
        saw: Callable[[AnyController, str], str],
        runs: int | None = None,
        workers: int = 0,
        report: Callable[[str, int, int], None] = lambda what, done, total: None,
        random_runs: int = 2000,
    ) -> None:
        self.folder, self.workers, self.report, self._saw = folder, workers, report, saw
        self.names, self.random_runs = names, random_runs
        if len(set(names)) < len(names):
            raise InputError('each controller can be compared once; one is named twice')
        for name in names:  # so that a wrong one is not blamed on the campaign file
            load_controller(name)
        changes: dict[str, Any] = {} if runs is None else {'runs': runs}
        self.campaigns = [config.load(campaign, controller=name, **changes) for name in names]
        self._shared = [files.read_text(files.find('scenario', name)) for name in (STARTS, *TESTS)]

    @property
    def labels(self) -> list[str]:
        """Names of the controllers; where two have the same, the files that were given."""
        names = [campaign.controller.name for campaign in self.campaigns]
        return [
            f'{name} ({given})' if names.count(name) > 1 and name != given else name
            for name, given in zip(names, self.names, strict=True)
        ]

    def least(self) -> float:
        """Return the mean J [N²s] of the optima under training's conditions."""

        def make() -> dict[str, Any]:
            show = partial(self.report, 'optima by convex programming')
            training = load_set(STARTS)
            starts = np.array([scenario.start for scenario in training.scenarios()])
            energies = least_constrained(training.base, starts, show)
            return {'mean': float(fitness.mean(energies))}

        return float(kept(self.folder, 'optimum', [self._shared[0]], make)['mean'])

    def rows(self) -> list[Row]:
        """Return all controllers; compute the results that are not kept."""
        least = self.least()
        return [
            {'name': label, **self._row(campaign, name, least)}
            for campaign, label, name in zip(self.campaigns, self.labels, self.names, strict=True)
        ]

    def _row(self, campaign: Campaign, name: str, least: float) -> Row:
        """Return the figures of a controller, a shipped name or file as it was given."""
        controller, text = campaign.controller, campaign.texts[2]

        def part(what: str, texts: Sequence[str], make: Callable[[], Row]) -> Row:
            self.report(f'{controller.name}: {what}', 0, 1)
            return kept(self.folder, f'{controller.name}_{what}', texts, make)

        def shipped(campaign: str, **changes: Any) -> Campaign:
            return config.load(campaign, controller=name, **changes)

        flights = part('starts', [text, *self._shared], partial(self._starts, controller))
        dispersed = part('dispersed', campaign.texts, partial(self._dispersed, campaign))
        world = shipped(WORLD, runs=WORLD_RUNS)
        thrusters = part('thrusters', world.texts, partial(_thrusters, world))
        missed: Row = {}
        for random in RANDOM if self.random_runs else ():
            flown = shipped(random, runs=self.random_runs)
            missed |= part(random, flown.texts, partial(self._missed, flown))
        drawn = shipped(robustness.DRAWN, runs=robustness.RUNS, seed=robustness.SEED)
        margins = part('margins', [*self._shared, *drawn.texts], partial(self._margins, drawn))
        return {
            'kind': 'fuzzy' if isinstance(controller, FuzzyController) else controller.kind,
            'ratio': flights['mean_energy_n2s'] / least,
            **flights,
            **dispersed,
            'saw': self._saw(controller, campaign.config.name),
            **thrusters,
            'random_runs': self.random_runs,
            'random_missed': missed,
            'proof': proven.proof_of(controller),
            'command_us': command_us(controller, load_scenario(TESTS[0])),
            'margins': margins,
        }

    def _starts(self, controller: AnyController) -> Row:
        """Return the figures of the training starts and of the paper's tests."""
        flown = list(flights_of(controller, load_set(STARTS)))
        rows = np.array([metrics.row_of(flight) for flight in flown])
        tests = {name: fly(load_scenario(name), controller) for name in TESTS}
        late = {}
        for name, flight in tests.items():
            end = metrics.window(flight, metrics.CLAIM_WINDOW_S)
            late[name] = {
                'position_m': end.position_m,
                'velocity_m_s': end.velocity_m_s,
                'energy_n2s': metrics.of_flight(flight).energy_n2s,
            }
        shares = fitness.shares(rows)
        conditions = list(zip(shares.max(axis=0).tolist(), fitness.CONDITIONS, strict=True))
        for flight in tests.values():
            judged = verdicts(flight)
            conditions += [(v.value / v.limit, v.key) for v in judged if v.holds is not None]
        share, condition = max(conditions)
        speeds = map(contact_speed, flown)
        contacts = [speed for speed in speeds if speed is not None]
        return {
            'mean_energy_n2s': float(fitness.mean(rows[:, ENERGY])),
            'starts': len(rows),
            'met': int((shares <= 1.0).all(axis=1).sum()),
            'distance_m': float(fitness.mean(rows[:, ARRIVAL_DISTANCE])),
            'worst_distance_m': float(rows[:, ARRIVAL_DISTANCE].max()),
            'slew_per_axis_n_s': float(rows[:, SLEW].max()),
            'settled_s': float(fitness.mean(rows[:, ARRIVAL_TIME])),
            'tests': late,
            'margin': 1.0 - share,
            'margin_of': condition,
            'contact_m_s': max(contacts, default=None),
            'contact_median_m_s': float(np.median(contacts)) if contacts else None,
        }

    def _dispersed(self, campaign: Campaign) -> Row:
        """Return the runs of a campaign that keep its limits, and the openings in the first."""
        success, runs = list(campaign.config.success), campaign.config.runs
        groups = [names for names in (success, motion(success)) if names]
        shares = [rate('', count, runs)._asdict() for count in self._kept(campaign, groups)]
        shares = [{n: share[n] for n in ('kept', 'runs', 'low', 'high')} for share in shares]
        flown = [fly_run(campaign, i) for i in range(min(OPENED_RUNS, runs))]
        return {
            **shares[0],
            'moving': shares[1] if len(shares) > 1 else None,
            'openings': float(np.mean([openings(flight.forces_n) for flight in flown])),
        }

    def _missed(self, campaign: Campaign) -> Row:
        """Return how many runs of a campaign miss a limit, by its name."""
        (count,) = self._kept(campaign, [list(campaign.config.success)])
        return {campaign.config.name: campaign.config.runs - count}

    def _kept(self, campaign: Campaign, groups: Sequence[Sequence[str]]) -> list[int]:
        """Return how many runs of a campaign keep all limits of each group."""
        show = partial(self.report, f'{campaign.controller.name}: {campaign.config.name}')
        return execution.kept_of(campaign, groups, self.workers, show)

    def _margins(self, drawn: Campaign) -> Row:
        """Return the numbers of the margins; none of a controller in Python, which takes hours."""
        if in_python.stages(drawn):
            return {}
        return robustness.margins_of(drawn.controller, self.workers, self.report).numbers()


def _thrusters(world: Campaign) -> Row:
    columns = run_batch.fly_runs(world, 0, world.config.runs)
    return {n: float(fitness.mean(columns[n])) for n in ('valve_openings', 'propellant_kg')}


def command_us(controller: AnyController, scenario: Scenario) -> float:
    """Return the processor time [us] of one step of the controller: the best of some runs."""
    flight = fly(scenario, controller)
    ticks = np.linspace(0, len(flight.states) - 1, _CALLS).astype(int).tolist()
    asked = [(k, tuple(s)) for s, k in zip(flight.states[ticks].tolist(), ticks, strict=True)]
    stage = controller.stage(scenario.dt_s)

    def call() -> None:
        for tick, state in asked:
            stage.step(tick, state)

    times_s = timeit.repeat(call, timer=time.process_time, repeat=_REPETITIONS, number=1)
    return 1e6 * min(times_s) / _CALLS


Table = list[tuple[str, ...]]
"""Headings, then a line for each controller; all texts."""

Column = str | Callable[[Row], str]
"""A cell: format of the figures of a controller, or a function of them."""

_ENERGY: dict[str, Column] = {
    'controller': '{name}',
    'mean J [N²s]': '{mean_energy_n2s:.3f}',
    '× least': lambda row: f'{row["ratio"]:.3f}' if row['met'] else '–',
    'starts that meet all': '{met} of {starts}',
    'arrival error, mean (worst) [m]': '{distance_m:.3g} ({worst_distance_m:.3g})',
    'slew [N/s]': '{slew_per_axis_n_s:.3g}',
    'smallest margin [%]': lambda row: _smallest_margin(row),
    'proof': '{proof}',
}
_DISPERSED: dict[str, Column] = {
    'controller': '{name}',
    'dispersed: position and speed [%]': lambda row: _share(row['moving']),
    'all limits [%]': lambda row: _share(row),
    'its training saw these': '{saw}',
    'random starts missed: at rest [%]': lambda row: _missed(row, RANDOM[0]),
    'moving [%]': lambda row: _missed(row, RANDOM[1]),
}
_THRUSTERS: dict[str, Column] = {
    'controller': '{name}',
    'thrust starts per axis': '{openings:.1f}',
    'valve openings': '{valve_openings:.0f}',
    'propellant [g]': lambda row: f'{1e3 * row["propellant_kg"]:.1f}',
    'speed at 1 m, largest (median) [m/s]': lambda row: (
        '–'
        if row['contact_m_s'] is None
        else '{contact_m_s:.3f} ({contact_median_m_s:.3f})'.format_map(row)
    ),
    'command [µs]': '{command_us:.1f}',
}
_TESTS: dict[str, Column] = {
    f"the paper's test, largest of an axis in the last {CLAIM_WINDOW_S:g} s; J over 400 s": (
        '{name}'
    ),
    'offset: ∣r∣ [m]': '{tests[paper_test][position_m]:.3g}',
    'offset: ∣v∣ [mm/s]': lambda row: _speed(row, 'paper_test'),
    'offset: J [N²s]': '{tests[paper_test][energy_n2s]:.3f}',
    'phase: ∣r∣ [m]': '{tests[paper_test_phase][position_m]:.3g}',
    'phase: ∣v∣ [mm/s]': lambda row: _speed(row, 'paper_test_phase'),
    'phase: J [N²s]': '{tests[paper_test_phase][energy_n2s]:.3f}',
}


def _speed(row: Row, test: str) -> str:
    return f'{1e3 * row["tests"][test]["velocity_m_s"]:.3g}'


def _smallest_margin(row: Row) -> str:
    condition = LABELS.get(row['margin_of']) or words(row['margin_of'], unit=False)
    return f'{100 * row["margin"]:.1f}, {condition}' if row['margin'] >= 0.0 else condition


def _share(rates: Row | None) -> str:
    """Return a share of the dispersed runs with its interval; a dash where no limit is such."""
    if rates is None:
        return '–'
    shares = (100 * x for x in (rates['kept'] / rates['runs'], rates['low'], rates['high']))
    return '{:.2f} ({:.2f}…{:.2f})'.format(*shares)


def _missed(row: Row, name: str) -> str:
    """Return a share of the random starts with its interval; a dash where none flew."""
    if name not in row['random_missed']:
        return '–'
    missed = rate('missed', row['random_missed'][name], row['random_runs'])
    return f'{missed.percent} ({missed.interval.replace(" to ", "…")})'


def _table(columns: Mapping[str, Column], rows: Sequence[Row]) -> Table:
    def cell(column: Column, row: Row) -> str:
        return column.format_map(row) if isinstance(column, str) else column(row)

    return [tuple(columns), *(tuple(cell(c, row) for c in columns.values()) for row in rows)]


def margins(rows: Sequence[Row]) -> Table:
    """Return how far the loop of each controller may be off."""
    headings = ('controller', *COLUMNS, CROSSED[4])
    return [headings, *((row['name'], *cells(row['margins'])) for row in rows)]


TABLES = (
    partial(_table, _ENERGY),
    partial(_table, _DISPERSED),
    margins,
    partial(_table, _THRUSTERS),
    partial(_table, _TESTS),
)
ON_PAGE = 2
"""Tables that a page gets; the others are printed, and in the folder."""


def notes(rows: Sequence[Row], least: float, campaign: Campaign) -> list[str]:
    """Return what the columns of each table mean, with the numbers behind them."""
    moving = ', '.join(words(name, unit=False) for name in motion(campaign.config.success))
    facts = machine_facts()
    runs, first = sorted({row['runs'] for row in rows}), rows[0]
    return [
        f'Energy: {first["starts"]} training starts, 200 s. Least: {least:.4f} N²s, the mean of '
        'the optima under all conditions. Arrival error: mean distance over the last 30 s. Slew: '
        "the largest. Smallest margin: over these starts and the paper's tests; without a number: "
        'the missed condition. Proof: of the three conditions, from every start at rest in the '
        'box.',
        f'Dispersed: campaign `{campaign.config.name}`, {" or ".join(map(str, runs))} runs, with '
        f"Wilson's 95 % interval. All limits: {sentence(campaign)}. Position and speed: "
        f'{moving or "none"}. Drawn flights: with other seeds. Random starts: '
        f'{first["random_runs"]} in the box of the training at rest, and as many with up to '
        '±0.05 m/s, judged by the three conditions.',
        'Margins: the largest error, each alone, up to which all training starts meet their '
        f'conditions, and {RUNS} flights of `{DRAWN}` (seed {SEED}) keep the limits that they keep '
        'without it. Gain: of the command, before it is saturated. Mass: the controller is not '
        'told. Bias: on all axes, both signs. !: holds again beyond. –: a start misses already. '
        f'{_not_judged(rows)} Delay margin: of the describing function of an axis.',
        f'Thrust starts: how often an axis goes beyond {1e3 * OPEN_N:g} mN or changes sides, mean '
        f'of {OPENED_RUNS} dispersed runs. Valve openings, propellant: of 400 s with sensors, '
        f'filter and pulses, mean of {WORLD_RUNS} runs of the campaign `{WORLD}`. Speed at 1 m: at '
        'the first state within 1 m of the target, over the training starts. Command: processor '
        f'time of one call from Python on {facts["processor"]}, Python {facts["python"]}.',
    ]


def _not_judged(rows: Sequence[Row]) -> str:
    """Return which limits the drawn flights of which controllers are not judged by."""
    groups: dict[str, list[str]] = {}
    for row in rows:
        if limits := row['margins'].get('not_judged'):
            groups.setdefault(limits, []).append(row['name'])
    texts = [f'{limits} ({", ".join(names)})' for limits, names in groups.items()]
    return f'{NOT_JUDGED} in these flights: {"; ".join(texts) or "nothing"}.'


def markdown(
    rows: Sequence[Row], least: float, campaign: Campaign, count: int = len(TABLES)
) -> str:
    """Return the first tables and their notes as Markdown."""
    tables = (table(rows) for table in TABLES[:count])
    parts = [markdown_table(head, lines) for head, *lines in tables]
    parts.append([f'- {note}' for note in notes(rows, least, campaign)[:count]])
    return '\n\n'.join('\n'.join(part) for part in parts) + '\n'


def write(rows: Sequence[Row], least: float, campaign: Campaign, folder: Path) -> list[Path]:
    """Write compare.md and compare.json; return their paths."""
    document = {
        'least_mean_energy_n2s': least,
        'campaign': campaign.config.name,
        'success': sentence(campaign),
        'machine': machine_facts(),
        'controllers': list(rows),
    }
    texts = {
        'compare.md': markdown(rows, least, campaign),
        'compare.json': json.dumps(document, indent=1) + '\n',
    }
    for name, text in texts.items():
        write_text(folder / name, text)
    return [folder / name for name in texts]
