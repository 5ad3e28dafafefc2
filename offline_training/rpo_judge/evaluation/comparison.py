# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Controllers beside each other: training starts, the paper's test, a dispersed campaign.

The folder keeps the results of a controller under a digest of all that they depend on (controller,
scenarios, campaign, versions). An interrupted comparison goes on from there; a changed controller
is computed anew. The campaigns are ordinary campaign folders.
"""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Callable, Sequence
from functools import cached_property, partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from rpo_core import files
from rpo_core.chain.flight import Flight, fly
from rpo_core.control import controller as controllers
from rpo_core.control.controller import AnyController, FuzzyController
from rpo_core.files import codec
from rpo_core.files.scenario import Scenario, load_scenario, load_set
from rpo_core.files.validation import InputError
from rpo_core.judge import metrics
from rpo_core.judge.metrics import ARRIVAL_DISTANCE, ARRIVAL_TIME, ENERGY, SLEW
from rpo_core.judge.verdicts import verdicts
from rpo_ctrl.family import Family
from rpo_judge.analysis.certificate import PROVEN
from rpo_judge.evaluation import proven, robustness
from rpo_judge.evaluation.optimal import least_constrained
from rpo_judge.scoring import fitness
from rpo_judge.scoring.conditions import LABELS
from rpo_kernels.arrays import Floats
from rpo_montecarlo.campaign import config, execution, run_batch, statistics
from rpo_montecarlo.campaign.config import Campaign
from rpo_montecarlo.campaign.judging import MOTION, motion
from rpo_montecarlo.campaign.single import fly_run
from rpo_montecarlo.campaign.store import Store
from rpo_montecarlo.engine.cases import Case, case_of_set
from rpo_montecarlo.engine.flights import flights_of
from rpo_montecarlo.engine.simulator import Simulator
from rpo_montecarlo.engine.support import why_not
from rpo_montecarlo.outputs import digest_of, identifier, make_folder, write_text

Report = Callable[[str, int, int], None]
"""Called with the present work, how much of it is done, and how much it is in all."""

RANDOM = ('random_starts', 'random_moving_starts')
"""Campaigns of random starts in the box of the training: at rest, and moving."""

OPEN_N = 0.005
"""A thruster counts as open at more than this force, 1 % of the largest."""

OPENED_RUNS = 10
"""Dispersed runs in which openings are counted."""

CONTACT_M = 1.0


Row = dict[str, Any]
"""A controller: name of a figure -> its value.

mean_energy_n2s : of the starts; ratio : to the mean of the constrained optima
starts, met : training starts, and those that meet all three conditions
distance_m, worst_distance_m : mean and largest, over the starts, of the mean distance in the last
    30 s; slew_per_axis_n_s : the largest; settled_s : mean time after which it stays within 0.5 m
tests : by scenario, the largest |r| and |v| of an axis in the last 200 s, and J
kept, runs, low, high : runs of the campaign that keep every limit of it, of how many, Wilson's 95 %
    interval of their share; moving : the same, of its limits on position and speed alone, or None
saw : what of the campaign the training saw
command_us : processor time of one command on this machine
valve_openings, propellant_kg : means of runs of the campaign `WORLD`
random_runs, random_missed : runs of each of `RANDOM`, and those that miss a condition, by campaign
margin, margin_of : smallest distance to a limit as a share of it, over all starts and the paper's
    tests, and the condition
openings : starts of thrust of an axis in a dispersed run, the mean
contact_m_s, contact_median_m_s : speed at the first state within 1 m, the largest and the median
    over the starts that come there; None of both if none does
proof : what is shown of the conditions from every start of the box
margins : how far the loop may be off; None: the engine cannot fly the controller
"""


def contact_speed(flight: Flight) -> float | None:
    """Return the speed [m/s] at the first state within `CONTACT_M` of the target, if any."""
    inside = np.flatnonzero(np.linalg.norm(flight.states[:, :3], axis=1) < CONTACT_M)
    return float(np.linalg.norm(flight.states[inside[0], 3:])) if len(inside) else None


def openings(forces_n: Floats | Sequence[Sequence[float]]) -> float:
    """Return how often thrust begins on an axis, the mean of the axes; a new side is a new start.

    forces_n : (n, 3) [N]
    """
    side = np.sign(forces_n) * (np.abs(forces_n) > OPEN_N)
    begins = (side[1:] != side[:-1]) & (side[1:] != 0.0)
    return float((begins.sum(axis=0) + (side[0] != 0.0)).mean())


def proof_of(controller: AnyController) -> str:
    """Return what is shown of the conditions of the training from every start of its box."""
    if isinstance(controller, FuzzyController):
        return proven.proof_of(controller)
    if not isinstance(controller, Family):
        return proven.NO_PROOF
    claims = {claim.name: claim.holds for claim in controller.claims()}
    proof = all(claims.get(name, False) for name in LABELS.values())
    return PROVEN if proof else 'not proven'


FUZZY = (
    'allround', 'paper_ga', 'handmade',
    'more_words', 'time_to_go',
)  # fmt: skip
CONTROLLERS = (*FUZZY, 'mpc', 'apf_smc', 'lqr', 'pd', 'drift')
STARTS = 'paper_training'
TESTS = tuple(fitness.TESTS)

WORLD, WORLD_RUNS = 'world_leo', 40  # the campaign that counts valve openings, and its runs
RANDOM_RUNS = 2000  # random starts, at rest and as many moving
_CALLS, _REPETITIONS = 2000, 5


def key_of(*texts: str) -> str:
    """Return a digest of texts and of the versions that results depend on."""
    libraries = {name: version(name) for name in ('numpy', 'scipy', 'numba', 'clarabel', 'cvxpy')}
    joined = '\0'.join([*texts, json.dumps(libraries, sort_keys=True)])
    return hashlib.sha256(joined.encode()).hexdigest()[:16]


class Comparison:
    """The controllers of a comparison, and the folder that keeps their results.

    saw : returns what the training of a controller saw of a campaign, by the campaign's name
    """

    def __init__(
        self,
        names: Sequence[str],
        folder: Path,
        campaign: Path,
        saw: Callable[[AnyController, str], str],
        runs: int | None = None,
        workers: int = 0,
        report: Report = lambda what, done, total: None,
        random_runs: int = RANDOM_RUNS,
    ) -> None:
        self.folder, self.workers, self.report, self._saw = folder, workers, report, saw
        self.names, self.random_runs = list(names), random_runs
        for name in names:  # so that a wrong one is not blamed on the campaign file
            controllers.load_controller(name)
        changes: dict[str, Any] = {} if runs is None else {'runs': runs}
        if len(set(names)) < len(names):
            raise InputError('each controller can be compared once; one is named twice')
        self.campaigns = [config.load(campaign, controller=name, **changes) for name in names]
        self.labels = _labels([c.controller.name for c in self.campaigns], names)
        self._shared = [files.read_text(files.find('scenario', name)) for name in (STARTS, *TESTS)]

    @cached_property
    def case(self) -> Case:
        """The training starts."""
        return case_of_set(load_set(STARTS))

    def rows(self) -> list[Row]:
        """Return all controllers; compute the results that are not kept."""
        least = self.least()
        return [
            self._row(campaign, label, name, least)
            for campaign, label, name in zip(self.campaigns, self.labels, self.names, strict=True)
        ]

    def least(self) -> float:
        """Return the mean J [N^2 s] of the optima under training's conditions."""

        def make() -> dict[str, Any]:
            show = partial(self.report, 'optima by convex programming')
            energies = least_constrained(self.case.base, self.case.starts, show)
            return {'mean': float(fitness.mean(energies))}

        return float(self._kept('optimum', [self._shared[0]], make)['mean'])

    def _kept(
        self, name: str, texts: Sequence[str], make: Callable[[], dict[str, Any]]
    ) -> dict[str, Any]:
        """Return the result kept under a name for these texts; make and keep it if missing."""
        path = self.folder / f'{identifier(name)}-{key_of(name, *texts)}.json'
        try:
            kept = json.loads(files.read_text(path))
            found: dict[str, Any] = kept['result']
            if kept['sha256'] == digest_of(json.dumps(found)):
                return found
        except (ValueError, KeyError, TypeError, RecursionError):
            pass  # missing, or damaged
        make_folder(self.folder)
        found = make()
        kept = {'sha256': digest_of(json.dumps(found)), 'result': found}
        write_text(path, json.dumps(kept, indent=1))
        return found

    def _row(self, campaign: Campaign, label: str, given: str, least: float) -> Row:
        """Return a controller, a shipped name or file as it was given."""
        controller = campaign.controller
        others = [
            _load(WORLD, given, runs=WORLD_RUNS),
            _load(robustness.DRAWN, given, runs=robustness.RUNS, seed=robustness.SEED),
            *(_load(name, given, runs=max(1, self.random_runs)) for name in RANDOM),
        ]
        texts = [
            controllers.dumps(controller), *self._shared, *campaign.texts,
            *(text for other in others for text in other.texts),
            str(self.random_runs), files.read_text(proven.PATH),
        ]  # fmt: skip
        found = self._kept(controller.name, texts, lambda: self._computed(campaign, *others))
        margins = found.pop('margins')
        success, moving = self._campaign(campaign)
        return {
            'name': label,
            'kind': 'fuzzy' if isinstance(controller, FuzzyController) else controller.kind,
            'ratio': found['mean_energy_n2s'] / least,
            **found,
            **success,
            'moving': moving,
            'saw': self._saw(controller, campaign.config.name),
            'command_us': command_us(controller, load_scenario(TESTS[0])),
            'margins': margins and codec.from_mapping(robustness.Margins, 'margins', margins),
        }

    def _computed(
        self, campaign: Campaign, world: Campaign, drawn: Campaign, *random: Campaign
    ) -> Row:
        """Return the figures that are kept; the first runs of the campaign count the openings."""
        controller = campaign.controller
        self.report(f'{controller.name}: training starts and tests', 0, 1)
        rows = metrics_of(controller, self.case, self.workers)
        tests = {name: fly(load_scenario(name), controller) for name in TESTS}
        conditions = list(
            zip(fitness.shares(rows).max(axis=0).tolist(), fitness.CONDITIONS, strict=True)
        )
        for flight in tests.values():
            judged = verdicts(flight)
            conditions += [(v.value / v.limit, v.key) for v in judged if v.holds is not None]
        share, condition = max(conditions)
        self.report(f'{controller.name}: contact and thrusters', 0, 1)
        speeds = map(contact_speed, flights_of(controller, load_set(STARTS)))
        contacts = [speed for speed in speeds if speed is not None]
        flown = [fly_run(campaign, i) for i in range(min(OPENED_RUNS, campaign.config.runs))]
        columns = run_batch.fly_runs(world, 0, world.config.runs)
        margins = None
        if not why_not(drawn.scenario, controller):
            margins = robustness.margins_of(controller, self.workers, self.report)
        return {
            'mean_energy_n2s': float(fitness.mean(rows[:, ENERGY])),
            'starts': len(rows),
            'met': int((fitness.failures(rows[:, None, :]).sum(axis=1) == 0).sum()),
            'distance_m': float(fitness.mean(rows[:, ARRIVAL_DISTANCE])),
            'worst_distance_m': float(rows[:, ARRIVAL_DISTANCE].max()),
            'slew_per_axis_n_s': float(rows[:, SLEW].max()),
            'settled_s': float(fitness.mean(rows[:, ARRIVAL_TIME])),
            'tests': {name: _test(flight) for name, flight in tests.items()},
            **{n: float(fitness.mean(columns[n])) for n in ('valve_openings', 'propellant_kg')},
            'random_runs': self.random_runs,
            'random_missed': {c.config.name: self._missed(c) for c in random if self.random_runs},
            'margin': 1.0 - share,
            'margin_of': condition,
            'openings': float(np.mean([openings(flight.forces_n) for flight in flown])),
            'contact_m_s': max(contacts, default=None),
            'contact_median_m_s': float(np.median(contacts)) if contacts else None,
            'proof': proof_of(controller),
            'margins': margins and codec.to_mapping(margins),
        }

    def _missed(self, campaign: Campaign) -> int:
        """Return how many runs of a campaign of random starts miss a condition."""
        show = partial(self.report, f'{campaign.controller.name}: {campaign.config.name}')
        (kept,) = execution.kept_of(campaign, [campaign.config.success], self.workers, show)
        return campaign.config.runs - kept

    def _campaign(self, campaign: Campaign) -> tuple[Row, Row | None]:
        """Return success, and that of position and speed; finish the campaign first."""
        name = campaign.controller.name
        folder = self.folder / f'{identifier(name)}-campaign-{key_of(*campaign.texts)}'
        store = Store.open(folder) if folder.is_dir() else Store.create(folder, campaign)
        done = store.done_runs

        def progress(runs: int, _successful: int) -> None:
            nonlocal done
            done += runs
            self.report(f'{name}: campaign', done, campaign.config.runs)

        execution.fly(store, self.workers, progress=progress)
        success = campaign.config.success
        groups = {'success': list(success), MOTION: motion(success)}
        found = statistics.rates_of(
            store, {name: limits for name, limits in groups.items() if limits}
        )
        shares = [{n: getattr(rate, n) for n in ('kept', 'runs', 'low', 'high')} for rate in found]
        return shares[0], shares[1] if len(shares) > 1 else None


def _load(name: str, controller: str, **changes: Any) -> Campaign:
    """Return a shipped campaign with fields changed."""
    return config.load(config.find(name), controller=controller, **changes)


def _labels(own: Sequence[str], given: Sequence[str]) -> list[str]:
    """Return the names of controllers; where two have the same, the files that were given."""
    return [
        f'{name} ({source})' if own.count(name) > 1 and name != source else name
        for name, source in zip(own, given, strict=True)
    ]


def metrics_of(controller: AnyController, case: Case, workers: int = 0) -> Floats:
    """Return the metrics (starts, columns) of a controller, see `rpo_core.judge.metrics.UNITS`."""
    with Simulator([case], workers) as simulator:
        return np.asarray(simulator.fly([controller])[0][0])


def _test(flight: Flight) -> Row:
    late = metrics.window(flight, metrics.CLAIM_WINDOW_S)
    return {
        'position_m': late.position_m,
        'velocity_m_s': late.velocity_m_s,
        'energy_n2s': metrics.of_flight(flight).energy_n2s,
    }


def command_us(controller: AnyController, scenario: Scenario) -> float:
    """Return the processor time [us] of one step of the controller: the best of some runs."""
    flight = fly(scenario, controller)
    ticks = np.linspace(0, len(flight.states) - 1, _CALLS).astype(int).tolist()
    asked = [(k, tuple(s)) for s, k in zip(flight.states[ticks].tolist(), ticks, strict=True)]
    stage = controller.stage(scenario.dt_s)
    best = np.inf
    for _ in range(_REPETITIONS):
        began = time.process_time()
        for tick, state in asked:
            stage.step(tick, state)
        best = min(best, time.process_time() - began)
    return 1e6 * best / _CALLS
