# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""P1, fuzzy inference compared with other libraries: same system, same inputs, outputs compared.

Times are CPU seconds of this process, the best of a few repetitions.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rpo_core.control.controller import FuzzyController, load_fuzzy
from rpo_core.control.fuzzy import WORDS, MembershipFunctions
from rpo_core.files.validation import InputError
from rpo_export import formats
from rpo_montecarlo.engine import lanes
from rpo_montecarlo.engine.population import population_of

Floats = NDArray[np.float64]

AGREEMENT = 1e-9
"""Largest difference of normalised outputs that counts as the same result."""

POLYGON_AGREEMENT = 0.02
"""The same for scikit-fuzzy: instead of the centroid of the samples it takes the centroid of the
polygon through the samples and the points where sets are cut."""


class Rate(NamedTuple):
    """Inferences per CPU second of an implementation."""

    name: str
    per_second: float


def _measure(work: Callable[[], Any], count: int, repetitions: int = 3) -> float:
    """Return items per CPU second, the best of some repetitions."""
    best = np.inf
    for _ in range(repetitions):
        began = time.process_time()
        work()
        best = min(best, time.process_time() - began)
    return count / best


def inference(controller: str = 'handmade', seed: int = 1) -> list[Rate]:
    """Return the rates of the engine and of the other libraries."""
    loaded = load_fuzzy(controller)
    errors = np.random.default_rng(seed).uniform(-1.0, 1.0, (2, 100_000))
    expected = np.array([loaded.system.output(r, v) for r, v in errors[:, :4000].T])
    return [
        _rate(name, make(loaded, errors[:, :count]), expected, count, agreement)
        for name, make, count, agreement in (
            ('rpo, batch in lanes', _lanes, 100_000, AGREEMENT),
            ('pyfuzzylite, vectorised', _fuzzylite, 20_000, AGREEMENT),
            ('scikit-fuzzy', _skfuzzy, 40, POLYGON_AGREEMENT),
        )
    ]


def _rate(
    name: str, run: Callable[[], Any], expected: Floats, count: int, agreement: float
) -> Rate:
    outputs = np.asarray(run())[: len(expected)]
    difference = float(np.abs(outputs - expected[: len(outputs)]).max())
    if difference > agreement:
        raise InputError(
            f'the outputs of {name} must equal those of the core; they differ by {difference}'
        )
    return Rate(name, _measure(run, count, 1 if count < 1000 else 5))


def _lanes(controller: FuzzyController, errors: Floats) -> Callable[[], Floats]:
    """Return the inference of the engine over any number of inputs."""
    law, rows = lanes.make_law(controller.system.samples), lanes.make_scratch()
    lanes.set_law(law, *(field[0] for field in population_of(controller)))
    outputs = np.empty(errors.shape[1])

    def run() -> Floats:
        lanes.infer_many(errors, law, rows, outputs)
        return outputs

    return run


def _fuzzylite(controller: FuzzyController, errors: Floats) -> Callable[[], Floats]:
    """Return the inference of pyfuzzylite, of the file that `rpo export --to fll` writes."""
    import fuzzylite as fl

    engine = fl.FllImporter().from_string(formats.fll(controller))

    def run() -> Floats:
        engine.input_variable('position_error').value = errors[0]
        engine.input_variable('velocity_error').value = errors[1]
        engine.process()
        return np.asarray(engine.output_variable('force').value)

    return run


def _skfuzzy(controller: FuzzyController, errors: Floats) -> Callable[[], Floats]:
    import skfuzzy
    from skfuzzy import control

    system = controller.system
    universe = np.linspace(-1.0, 1.0, system.samples)
    exact = np.unique(np.concatenate([universe, *errors]))  # it interpolates between points

    def fill(variable: Any, functions: MembershipFunctions) -> Any:
        for word, feet in formats.triangles(functions):
            variable[word] = skfuzzy.trimf(variable.universe, feet)
        return variable

    position = fill(control.Antecedent(exact, 'position'), system.position)
    velocity = fill(control.Antecedent(exact, 'velocity'), system.velocity)
    force = fill(control.Consequent(universe, 'force', defuzzify_method='centroid'), system.force)
    rules = [
        control.Rule(position[p] & velocity[v], force[word])
        for v, row in zip(WORDS, system.rules.words, strict=True)
        for p, word in zip(WORDS, row, strict=True)
    ]
    simulation = control.ControlSystemSimulation(control.ControlSystem(rules), cache=False)

    def run() -> Floats:
        outputs = []
        for r, v in errors.T:
            simulation.input['position'], simulation.input['velocity'] = r, v
            simulation.compute()
            outputs.append(simulation.output['force'])
        return np.array(outputs)

    return run
