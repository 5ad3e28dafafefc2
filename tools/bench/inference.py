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

from rpo_core.control.controller import load_fuzzy
from rpo_core.control.fuzzy import WORDS, FuzzySystem, MembershipFunctions
from rpo_core.files.validation import InputError
from rpo_montecarlo.engine import lanes
from rpo_montecarlo.engine.population import population_of

Floats = NDArray[np.float64]

AGREEMENT = 1e-9
"""Largest difference of normalised outputs that counts as the same result."""

POLYGON_AGREEMENT = 0.02
"""The same for scikit-fuzzy: instead of the centroid of the samples it takes the centroid of the
polygon through the samples and the points where sets are cut."""


class Rate(NamedTuple):
    """Inferences per CPU second of an implementation, and the largest difference from the core."""

    name: str
    per_second: float
    difference: float


def _measure(work: Callable[[], Any], count: int, repetitions: int = 3) -> float:
    """Return items per CPU second, the best of some repetitions."""
    best = np.inf
    for _ in range(repetitions):
        began = time.process_time()
        work()
        best = min(best, time.process_time() - began)
    return count / best


def inference(controller: str = 'handmade', seed: int = 1) -> list[Rate]:
    """Return the rates of the engine, of the scalar kernel and of the other libraries."""
    system = load_fuzzy(controller).system
    errors = np.random.default_rng(seed).uniform(-1.0, 1.0, (2, 100_000))
    expected = np.array([system.output(r, v) for r, v in errors[:, :4000].T])
    rates = [
        _rate('rpo, batch in lanes', _lanes(controller, errors), expected, 100_000),
        _rate(
            'rpo, one at a time',
            lambda: [system.output(r, v) for r, v in errors[:, :4000].T],
            expected,
            4000,
        ),
    ]
    for name, make, count, agreement in (
        ('pyfuzzylite, vectorised', _fuzzylite, 20_000, AGREEMENT),
        ('scikit-fuzzy', _skfuzzy, 40, POLYGON_AGREEMENT),
    ):
        run = make(system, errors[:, :count])
        rates.append(_rate(name, run, expected, count, agreement))
    return rates


def _rate(
    name: str, run: Callable[[], Any], expected: Floats, count: int, agreement: float = AGREEMENT
) -> Rate:
    outputs = np.asarray(run())[: len(expected)]
    difference = float(np.abs(outputs - expected[: len(outputs)]).max())
    if difference > agreement:
        raise InputError(
            f'the outputs of {name} must equal those of the core; they differ by {difference}'
        )
    return Rate(name, _measure(run, count, 1 if count < 1000 else 5), difference)


def _lanes(controller: str, errors: Floats) -> Callable[[], Floats]:
    """Return the inference of the engine over any number of inputs."""
    loaded = load_fuzzy(controller)
    law, rows = lanes.make_law(loaded.system.samples), lanes.make_scratch()
    lanes.set_law(law, *(field[0] for field in population_of(loaded)))
    outputs = np.empty(errors.shape[1])

    def run() -> Floats:
        lanes.infer_many(errors, law, rows, outputs)
        return outputs

    return run


def _triangle_feet(functions: MembershipFunctions) -> dict[str, tuple[float, float, float]]:
    f = functions
    small, large = (f.sp_left, f.sp_centre, f.sp_right), (f.lp_left, 1.0, 2.0)
    mirrored = [(-c, -b, -a) for a, b, c in (small, large)]
    return dict(
        zip(
            WORDS,
            (mirrored[1], mirrored[0], (-f.z_half_width, 0.0, f.z_half_width), small, large),
            strict=True,
        )
    )


def _fuzzylite(system: FuzzySystem, errors: Floats) -> Callable[[], Floats]:
    engine = _fuzzylite_engine(system)

    def run() -> Floats:
        engine.input_variable('position').value = errors[0]
        engine.input_variable('velocity').value = errors[1]
        engine.process()
        return np.asarray(engine.output_variable('force').value)

    return run


def _fuzzylite_engine(system: FuzzySystem) -> Any:
    import fuzzylite as fl

    def variable(kind: Any, name: str, functions: MembershipFunctions, **options: Any) -> Any:
        terms = [fl.Triangle(word, *feet) for word, feet in _triangle_feet(functions).items()]
        return kind(name=name, minimum=-1.0, maximum=1.0, terms=terms, **options)

    # Its centroid uses the middles of equal intervals: 101 on this range are our 101 samples.
    edge = 1.0 / (system.samples - 1)
    output = variable(
        fl.OutputVariable,
        'force',
        system.force,
        aggregation=fl.Maximum(),
        defuzzifier=fl.Centroid(resolution=system.samples),
        default_value=0.0,
    )
    output.minimum, output.maximum = -1.0 - edge, 1.0 + edge
    rules = [
        f'if position is {position} and velocity is {velocity} then force is {word}'
        for velocity, row in zip(WORDS, system.rules.words, strict=True)
        for position, word in zip(WORDS, row, strict=True)
    ]
    block = fl.RuleBlock(
        conjunction=fl.Minimum(),
        implication=fl.Minimum(),
        activation=fl.General(),
        rules=[fl.Rule.create(rule) for rule in rules],
    )
    return fl.Engine(
        input_variables=[
            variable(fl.InputVariable, 'position', system.position),
            variable(fl.InputVariable, 'velocity', system.velocity),
        ],
        output_variables=[output],
        rule_blocks=[block],
    )


def _skfuzzy(system: FuzzySystem, errors: Floats) -> Callable[[], Floats]:
    import skfuzzy
    from skfuzzy import control

    universe = np.linspace(-1.0, 1.0, system.samples)
    exact = np.unique(np.concatenate([universe, *errors]))  # it interpolates between points

    def fill(variable: Any, functions: MembershipFunctions) -> Any:
        for word, feet in _triangle_feet(functions).items():
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
