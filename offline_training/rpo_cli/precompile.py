# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Compile the kernels ahead of their first use: `python -m rpo_cli.precompile`.

What is compiled is kept in the user's cache (`rpo_kernels.compile_cache`). Several processes
that start at once after an edit would each compile the same kernels; one before them spares them
that.
"""

from __future__ import annotations

import gc
from dataclasses import replace

from rpo_core.chain.flight import fly
from rpo_core.control.controller import FuzzyController, load_controller, load_fuzzy
from rpo_core.files import DEFAULT_CONTROLLER
from rpo_core.files.scenario import Scenario, load_scenario, load_set
from rpo_judge.evaluation.assessment import assess
from rpo_judge.evaluation.comparison import metrics_of
from rpo_montecarlo.campaign import config
from rpo_montecarlo.campaign.run_batch import fly_runs
from rpo_montecarlo.engine.cases import case_of_set
from rpo_montecarlo.engine.flights import flights_of
from rpo_proof import cells, flights
from rpo_proof.cells import Prover
from rpo_proof.claims import empty_set
from rpo_proof.problem import Problem, Settings
from rpo_proof.safety.attack import attack
from rpo_proof.safety.counts import quiet
from rpo_safety.assurance import AssuranceStage
from rpo_safety.settings import Assurance

_CAMPAIGNS = (
    'paper_test', 'world_leo', 'docking', 'tumbling_port', 'tumbling_docking', 'least_energy',
)  # fmt: skip


def main() -> None:
    """Fly once through everything that is compiled."""
    gc.disable()  # a tenth of the time; the compiler leaves little behind
    controller = load_fuzzy(DEFAULT_CONTROLLER)
    fly(load_scenario('quick'), controller)
    fly(replace(load_scenario('world_leo'), duration_s=1.0), controller)
    fly(load_scenario('tumbling_port'), controller)
    fly(load_scenario('tumbling_docking'), controller)
    assess(controller, workers=1)
    fly_runs(config.load(config.find('paper_test'), controller='lqr'), 0, 1)
    for name in _CAMPAIGNS:
        fly_runs(config.load(config.find(name)), 0, 1)
    next(flights_of(controller, load_set('least_energy_starts')))
    next(flights_of(controller, load_set('paper_training')))
    attack(load_scenario('assured'), 1, 1, 1)
    quiet(load_scenario('quick'), controller, Assurance())
    guarded = load_scenario('guarded')
    settings = guarded.section(Assurance)
    machine = AssuranceStage(settings, guarded).abort if settings else None
    if machine:
        machine.ready()
    for name in ('lqr', 'more_words'):
        metrics_of(load_controller(name), case_of_set(load_set('paper_training')), workers=1)
    _prove(load_set('paper_training').base, controller)


def _prove(base: Scenario, controller: FuzzyController) -> None:
    """Move one set through a proof on a coarse table, and fly beside it."""
    metre = (1.0, 1.0, 1.0, 0.0, 0.0, 0.0)
    settings = Settings(centre=(0.0,) * 6, half=metre, coarseness=16.0)
    problem = Problem.of(controller, base, settings)
    Prover(problem, 'planar', empty_set(problem)).values(cells.roots(problem, 'planar')[0])
    flights.fly(problem, base)


if __name__ == '__main__':
    main()
