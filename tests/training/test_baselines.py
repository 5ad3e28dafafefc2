# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Baselines and families in bulk: the bits of the core; plans, tuning, the comparison."""

import json
from dataclasses import replace

import numpy as np
import pytest
from campaign_documents import write_campaign
from invoking import invoke
from landing import rest_at_landing

from rpo.analysis import comparison, optimal
from rpo.engine.cases import case_of_set
from rpo.engine.search import Simulator
from rpo.montecarlo import config, run_batch
from rpo.montecarlo.outputs import put
from rpo.training.tuning import BUDGET
from rpo_core import files
from rpo_core.chain.flight import fly
from rpo_core.control.baselines import PAPER_MODEL, Mpc
from rpo_core.control.controller import load_controller
from rpo_core.files.validation import InputError
from rpo_core.judge import metrics
from rpo_core.scenario.requirements import MAX_SLEW_N_S
from rpo_core.scenario.scenario import load_scenario, load_set

TRAINING = load_set('paper_training')
NAMES = ('pd', 'lqr', 'mpc', 'apf_smc', 'drift')
FAMILIES = ('more_words', 'time_to_go')


# Bits.


# The predictive controller.


def test_it_flies_the_optimum_to_rest():
    mpc = load_controller('mpc')
    base = replace(TRAINING.base, initial_position_m=(100.0, -50.0, 5.0))
    best = optimal.to_rest(base, coast_s=base.duration_s - mpc.horizon_s)
    change = round((mpc.horizon_s - mpc.least_time_to_go_s) / base.dt_s)
    flown = fly(base, mpc).forces_n[:change]
    np.testing.assert_allclose(flown, best.forces_n[:change], rtol=0, atol=1e-11)


def by_solver(mpc, state, ticks):
    """Return the plan (ticks, 3) under the limits of force and slew, by Clarabel."""
    import cvxpy as cp

    a, b = mpc.model.matrices()
    x, f = cp.Variable((ticks + 1, 6)), cp.Variable((ticks, 3))
    steps = [x[0] == state, x[1:] == x[:-1] @ a.T + f @ b.T, x[ticks] == 0]
    limits = [cp.abs(f) <= mpc.max_force_n]
    limits.append(cp.abs(cp.diff(f, axis=0)) <= MAX_SLEW_N_S * mpc.model.dt_s)
    problem = cp.Problem(cp.Minimize(cp.sum_squares(f)), [*steps, *limits])
    problem.solve(solver=cp.CLARABEL)
    assert problem.status == cp.OPTIMAL
    return f.value


SLOW = Mpc(name='m', horizon_s=60.0, least_time_to_go_s=10.0, model=replace(PAPER_MODEL, dt_s=1.0))


def test_where_no_limit_binds_the_quadratic_program_says_the_same():
    state = np.array([5.0, -3.0, 2.0, 0.02, -0.03, 0.01])
    for tick in (0, 30):
        solved = by_solver(SLOW, state, 60 - tick)
        assert np.abs(solved).max() < SLOW.max_force_n
        force = SLOW.force_n(state[:3], state[3:], tick)
        np.testing.assert_allclose(force, solved[0], rtol=0, atol=1e-6)


# Tuning.


def test_shipped_baselines_and_families_are_as_good_as_they_say():
    """Families with 3 % free of every condition."""
    tuned = [load_controller(n) for n in (*NAMES, *FAMILIES) if n != 'drift']
    with Simulator([case_of_set(TRAINING)]) as simulator:
        (figures,) = simulator.fly(tuned)
    for baseline, rows in zip(tuned, figures, strict=True):
        made = baseline.provenance
        assert made['method'] == 'rpo train'
        family = baseline.name in FAMILIES
        assert family or made['evaluations'] <= BUDGET
        assert made['mean_energy_n2s'] == comparison.fitness.mean(rows[:, 0])
        assert made['starts_that_miss'] == {'speed': 0, 'slew': 0, 'arrival': 0}
        assert comparison.fitness.shares(rows).max() <= (0.97 if family else 1.0)


# The comparison.


@pytest.fixture
def compare(tmp_path, monkeypatch):
    """Return a function that runs `rpo compare`, with the optimum as if it had been computed."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(comparison, 'WORLD_RUNS', 8)
    some = [q for q in comparison.robustness.QUANTITIES if q.name == 'delay']
    monkeypatch.setattr(comparison.robustness, 'QUANTITIES', some)
    path = write_campaign(tmp_path, runs=50)

    def run(*arguments):
        return invoke('compare', *arguments, '--campaign', path, '--random', '200', '-o', 'out')

    text = files.read_text(files.find('scenario', comparison.STARTS))
    comparison.kept(tmp_path / 'out', 'optimum', [text], lambda: {'mean': 2.5})
    return run


@pytest.mark.parametrize('name', rest_at_landing(['lqr', 'mpc'], quick=0, landing=1))
def test_a_comparison_is_printed_written_and_kept(name, compare, tmp_path, monkeypatch):
    done = compare(name, 'drift', '--write', 'doc.md', '--picture', 'front.svg')
    assert done.exit_code == 0, done.output
    document = json.loads((tmp_path / 'out' / 'compare.json').read_text())
    baseline, drift = document['controllers']
    assert baseline['mean_energy_n2s'] == load_controller(name).provenance['mean_energy_n2s']
    assert baseline['ratio'] == baseline['mean_energy_n2s'] / 2.5
    assert (baseline['met'], baseline['starts'], drift['met']) == (216, 216, 0)
    columns = run_batch.fly_runs(config.load(tmp_path / 'c.yaml', controller='drift'), 0, 50)
    # `world_leo` opposes what its estimator finds, and nothing else fires without a command.
    assert drift['valve_openings'] < baseline['valve_openings'] / 3.0
    assert drift['propellant_kg'] < baseline['propellant_kg'] / 3.0
    world = config.load('world_leo', controller=name, runs=comparison.WORLD_RUNS)
    opened = run_batch.fly_runs(world, 0, comparison.WORLD_RUNS)['valve_openings']
    assert baseline['valve_openings'] == pytest.approx(opened.mean(), rel=1e-12)
    assert opened.mean() > 1000.0
    assert drift['kept'] == (columns['hold_error_per_axis_m'] <= 60.0).sum()
    late = metrics.window(fly(load_scenario('paper_test'), load_controller(name)), 200.0)
    assert baseline['tests']['paper_test']['position_m'] == late.position_m
    picture = (tmp_path / 'front.svg').read_text()
    assert f'1 {name}' in picture and 'drift' not in picture, 'it never arrives'
    table = (tmp_path / 'doc.md').read_text()
    shown = f'{baseline["mean_energy_n2s"]:.3f} | {baseline["ratio"]:.3f} | 216 of 216'
    assert f'| {name} | {shown} |' in table and table.count('| drift |') == 2
    delay = baseline['margins']['delay']
    assert delay['fails'] == delay['holds'] + 1.0 and 'no margins' in drift['margins']['judged']

    def fly_again(*_):
        raise AssertionError('what is kept is not flown again')

    monkeypatch.setattr(comparison, 'flights_of', fly_again)
    monkeypatch.setattr(comparison.execution, 'fly_unit', fly_again)
    monkeypatch.setattr(comparison.run_batch, 'fly_runs', fly_again)
    monkeypatch.setattr(comparison.robustness, 'margins_of', fly_again)
    again = compare('drift', name)
    assert again.exit_code == 0, again.output
    rows = json.loads((tmp_path / 'out' / 'compare.json').read_text())['controllers']
    assert {**rows[1], 'command_us': 0} == {**baseline, 'command_us': 0}


@pytest.mark.parametrize('text', ['', '[', '[' * 100_000, '3', '{"result": {"mean": 1.0}}', None])
def test_a_kept_result_that_was_changed_is_computed_anew(text, tmp_path):
    def kept(mean):
        return comparison.kept(tmp_path, '../[/x]', ['text'], lambda: {'mean': mean})['mean']

    assert kept(1.0) == 1.0
    (path,) = tmp_path.iterdir()  # a name is no way out of the folder
    path.write_text(path.read_text().replace('1.0', '9.0') if text is None else text)
    assert (kept(2.0), kept(3.0)) == (2.0, 2.0)


def test_a_table_goes_between_its_marks_only(tmp_path):
    path, begin, end = tmp_path / 'doc.md', '<!-- x: begin -->', '<!-- x: end -->'
    path.write_text(f'before\n{begin}\nold\n{end}\nafter\n')
    put(path, 'x', 'new\n')
    assert path.read_text() == f'before\n{begin}\n\nnew\n\n{end}\nafter\n'
    path.write_text('no marks\n')
    put(path, 'x', 'new')
    assert path.read_text() == f'no marks\n\n{begin}\n\nnew\n\n{end}\n'
    for bad in (begin, f'{end}{begin}', f'{begin}{begin}{end}', f'{begin}{end}{end}'):
        path.write_text(bad)
        with pytest.raises(InputError, match='must have one line'):
            put(path, 'x', 'new')
        assert path.read_text() == bad
