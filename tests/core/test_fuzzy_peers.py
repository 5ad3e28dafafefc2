# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The same fuzzy system in scikit-fuzzy and pyfuzzylite; the difference is the sampling's, no more.

All three form the same aggregated set and differ in how they integrate it: ours sums 101 samples,
ends included; scikit-fuzzy integrates the polygon through its universe and the points of clipping;
pyfuzzylite sums midpoints of cells.
"""

from __future__ import annotations

import fuzzylite as fl
import numpy as np
import pytest
import skfuzzy
from core_oracles import aggregate, rule_cells, steepest, triangles
from core_strategies import functions, systems, unit
from hypothesis import assume, given

from rpo_core.control.fuzzy import FuzzySystem

POINTS = np.random.default_rng(7).uniform(-1, 1, (60, 2))


def sampled(system, samples):
    """Return the same system with another number of output samples."""
    return FuzzySystem(system.position, system.velocity, system.force, system.rules, samples)


def fuzzylite_outputs(system, points, cells):
    """Return the outputs (len(points),) of pyfuzzylite, its centroid over `cells` midpoints."""

    def variable(kind, name, part, **settings):
        terms = [fl.Triangle(word, *feet) for word, feet in triangles(part).items()]
        return kind(name=name, minimum=-1, maximum=1, terms=terms, **settings)

    rules = [
        fl.Rule.create(f'if velocity is {row} and position is {column} then force is {word}')
        for row, column, word in rule_cells(system)
    ]
    engine = fl.Engine(
        name='rpo',
        input_variables=[
            variable(fl.InputVariable, 'position', system.position),
            variable(fl.InputVariable, 'velocity', system.velocity),
        ],
        output_variables=[
            variable(
                fl.OutputVariable,
                'force',
                system.force,
                aggregation=fl.Maximum(),
                defuzzifier=fl.Centroid(cells),
            )
        ],
        rule_blocks=[
            fl.RuleBlock(
                conjunction=fl.Minimum(),
                implication=fl.Minimum(),
                activation=fl.General(),
                rules=rules,
            )
        ],
    )
    for rule in rules:
        rule.load(engine)
    engine.input_variable('position').value = points[:, 0]
    engine.input_variable('velocity').value = points[:, 1]
    engine.process()
    return np.nan_to_num(np.asarray(engine.output_variable('force').value))


def skfuzzy_outputs(system, points, cells):
    """Return the outputs (len(points),) of scikit-fuzzy's control system on a universe of cells."""
    universe = np.linspace(-1, 1, cells + 1)
    from skfuzzy import control  # imports matplotlib: no need to, where these tests are not run

    position = control.Antecedent(universe, 'position')
    velocity = control.Antecedent(universe, 'velocity')
    force = control.Consequent(universe, 'force', 'centroid')
    for variable, part in (
        (position, system.position),
        (velocity, system.velocity),
        (force, system.force),
    ):
        for word, feet in triangles(part).items():
            variable[word] = skfuzzy.trimf(universe, feet)
    rules = [
        control.Rule(velocity[row] & position[column], force[word])
        for row, column, word in rule_cells(system)
    ]
    simulation = control.ControlSystemSimulation(control.ControlSystem(rules), cache=False)
    outputs = []
    for e, v in points:
        simulation.input['position'], simulation.input['velocity'] = e, v
        simulation.compute()
        outputs.append(simulation.output['force'])
    return np.array(outputs)


def sampling_bounds(system, points, step):
    """Return how far (samples, midpoints) of a spacing may be from the exact centroid.

    The aggregated set is Lipschitz with the steepest output slope L and at most 1, its moment
    density with L + 1. On [-1, 1] midpoints, and trapezia, err by at most L h / 2; samples that
    count both ends in full by h more.
    """
    slope = steepest(system.force)
    area = np.array([sum(aggregate(sampled(system, 401), e, v)[1]) / 200 for e, v in points])
    area = np.maximum(area - (1 + slope / 2) / 200, 1e-12)  # less what 401 samples may err
    midpoints = step * (2 * slope + 1) / 2 / area
    return midpoints + 2 * step / area, midpoints


def test_pyfuzzylite_differs_by_sampling_alone(handmade):
    system, gaps = handmade.system, []
    for scale in (1, 4, 16):
        ours = np.array([sampled(system, 100 * scale + 1).output(*p) for p in POINTS])
        theirs = fuzzylite_outputs(system, POINTS, 100 * scale)
        bounds = sampling_bounds(system, POINTS, 0.02 / scale)
        assert (np.abs(ours - theirs) <= sum(bounds)).all()
        gaps.append(np.abs(ours - theirs).max())
    assert 0 < gaps[0] < 0.02
    assert gaps[1] < gaps[0] / 3 and gaps[2] < gaps[1] / 3  # first order: four times finer


def test_pyfuzzylite_agrees_for_random_systems():
    rng = np.random.default_rng(8)
    for _ in range(15):
        p = []
        for _ in range(3):
            left, rise, fall = rng.uniform(0, 0.4), *rng.uniform(0.1, 0.3, 2)
            p += [rng.uniform(0.1, 1), left, left + rise, left + rise + fall, rng.uniform(0, 0.8)]
        system = FuzzySystem.from_vector([*p, *rng.integers(1, 6, 15)], samples=4001)
        ours = np.array([system.output(*point) for point in POINTS])
        theirs = fuzzylite_outputs(system, POINTS, 4000)
        assert (np.abs(ours - theirs) <= sum(sampling_bounds(system, POINTS, 5e-4))).all()
        assert np.median(np.abs(ours - theirs)) < 2e-3


@given(systems(parts=functions), unit, unit)
def test_scikit_fuzzy_forms_the_same_set(system, e, v):
    """Its membership functions and norms on the same 101 samples; our sum over them: to 1e-12."""
    universe = np.linspace(-1, 1, 101)

    def at(x, part):  # evaluated at the very point, not looked up on a universe
        return {
            word: skfuzzy.trimf(np.array([x]), feet)[0] for word, feet in triangles(part).items()
        }

    forces = {w: skfuzzy.trimf(universe, feet) for w, feet in triangles(system.force).items()}
    positions, velocities = at(e, system.position), at(v, system.velocity)
    output = np.zeros(101)
    for row, column, word in rule_cells(system):
        weight = np.fmin(velocities[row], positions[column])
        output = np.fmax(output, np.fmin(weight, forces[word]))
    area = output.sum()
    assume(area == 0 or area > 1e-6)  # a set of rounding errors has no shape to compare
    expected = (universe * output).sum() / area if area else 0.0
    assert system.output(e, v) == pytest.approx(expected, abs=1e-12)


@pytest.mark.every_landing
@pytest.mark.filterwarnings('ignore:Passing more than 2 positional:DeprecationWarning:skfuzzy')
def test_scikit_fuzzy_control_system_differs_by_sampling_alone():
    """Feet on the universe's points, where it interpolates its functions without loss."""
    rules = [1, 1, 1, 2, 3, 2, 2, 3, 4, 3, 4, 5, 4, 5, 5]
    feet = [0.2, 0.0, 0.2, 0.76, 0.0, 0.46, 0.0, 0.56, 0.9, 0.4, 0.1, 0.36, 0.56, 0.9, 0.2]
    system = FuzzySystem.from_vector([*feet, *rules])
    points, gaps = POINTS[:5], []
    for scale in (1, 4, 16):
        ours = np.array([sampled(system, 100 * scale + 1).output(*point) for point in points])
        theirs = skfuzzy_outputs(system, points, 100 * scale)
        bounds = sampling_bounds(system, points, 0.02 / scale)
        assert (np.abs(ours - theirs) <= sum(bounds)).all()
        gaps.append(np.abs(ours - theirs).max())
    assert 0 < gaps[0] < 0.02
    assert gaps[1] < gaps[0] / 3 and gaps[2] < gaps[1] / 3  # first order: four times finer
