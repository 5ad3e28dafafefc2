# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""`import rpo`: its examples run, it loads little, and what a user does takes a few lines."""

from __future__ import annotations

import ast
import doctest
import importlib
import json
import pydoc
import subprocess
import sys
from functools import cached_property
from pathlib import Path

import numpy as np
import pytest

import rpo
from rpo_core.chain import flight as core
from rpo_core.control.controller import load_controller
from rpo_core.judge.metrics import METRICS
from rpo_log.verify import verify

MODULES = (
    *sorted(set(rpo._MODULES.values())),
    'rpo_core.control.controller_file',
    'rpo_core.files.validation',
)


@pytest.mark.parametrize('name', MODULES)
def test_examples_run(name, monkeypatch):
    monkeypatch.setenv('MPLBACKEND', 'Agg')
    module = importlib.import_module(name)
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS | doctest.IGNORE_EXCEPTION_DETAIL)
    for test in examples(module):
        runner.run(test)
    assert runner.tries and not runner.failures


def examples(module):
    """Yield the examples of a module; doctest alone passes over those of cached properties."""
    finder = doctest.DocTestFinder(exclude_empty=True)
    yield from finder.find(module)
    for owner in vars(module).values():
        if isinstance(owner, type) and owner.__module__ == module.__name__:
            for value in vars(owner).values():
                if isinstance(value, cached_property):
                    yield from finder.find(value.func, module=module)


def test_the_door_names_what_it_has_and_loads_it_late():
    code = 'import sys, rpo; print(*(m for m in ("numpy", "numba", "typer") if m in sys.modules))'
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True)
    assert done.stdout == '\n'
    assert all(getattr(rpo, name).__doc__ for name in rpo.__all__) and dir(rpo) == sorted(
        rpo.__all__
    )
    with pytest.raises(AttributeError, match='has no attribute `fli`; it has InputError, '):
        rpo.fli  # noqa: B018


def test_types_are_imported_from_where_the_names_are():
    tree = ast.walk(ast.parse(Path(rpo.__file__).read_text()))
    rows = (node for node in tree if isinstance(node, ast.ImportFrom) and node.module)
    typed = {alias.asname: node.module for node in rows for alias in node.names if alias.asname}
    assert typed == {**rpo._MODULES, 'InputError': 'rpo_core.files.validation'}


def test_fly_a_named_scenario_with_another_mass():
    flight = rpo.fly('paper_test', 'allround', mass_kg=12.0)
    assert flight.ok and all(each.holds for each in flight.requirements)
    assert flight.t.shape == (4001,) and flight.x.shape == (4001, 6) and flight.u.shape == (4001, 3)
    assert repr(flight).startswith('<Flight paper_test (changed): 400 s, J = ')
    same = core.fly(rpo.scenario('paper_test', mass_kg=12.0), load_controller('allround'))
    assert (flight.x == same.states).all() and (flight['control_force'] == flight.u).all()


def test_metrics_are_a_dictionary_that_says_what_it_has():
    values = rpo.fly('quick').metrics
    assert json.loads(json.dumps(values)) == values and 'J' not in values
    assert values.get('J') is None and '\narrival_time_s           5' in repr(values)
    for error in (rpo.InputError, KeyError):
        with pytest.raises(error, match=r'^`name` must be one of .*; did you mean `energy_n2s`'):
            values['energy_n2']
    text = pydoc.render_doc(rpo.Flight, renderer=pydoc.plaintext)
    for name, (unit, meaning) in METRICS.items():
        assert f'{meaning} [{unit}]' in text and name in text
    with pytest.raises(rpo.InputError, match=r'`controler` is neither .* mean `controller`'):
        rpo.fly('quick', controler='pd')


def test_change_a_rule():
    law = rpo.controller('allround')
    other = law.with_rule(position='SP', velocity='Z', force='LP')
    grid = np.linspace(-100.0, 100.0, 201)
    plain, changed = (each(position=grid, velocity=0.0) for each in (law, other))
    assert plain.shape == (201,) and (plain != changed).any()
    assert plain[30] == law.force_n((grid[30], 0.0, 0.0), (0.0, 0.0, 0.0))[0]
    assert law(position=grid[:, None], velocity=np.zeros(3)).shape == (201, 3)
    assert law.with_rule('SP', 'Z', 'LP') == other and str(other) == f'{other!r}\n{other.rules}'
    assert repr(other.rules).splitlines()[3] == 'velocity error Z    SN  SN   Z  LP  SP'
    wider = other.with_membership('force', sp_right=0.9)
    assert wider.system.force.sp_right == 0.9 and wider.name == 'allround (changed)'
    with pytest.raises(rpo.InputError, match='`position` must be one of LN, SN, Z, SP, LP; got'):
        law.with_rule(position='BIG', velocity='Z', force='Z')
    with pytest.raises(rpo.InputError, match='did you mean `sp_right`'):
        law.with_membership('force', sp_rigth=0.9)
    with pytest.raises(rpo.InputError, match='controller pd is of kind pd, without a table of'):
        rpo.controller('pd').with_rule(position='Z', velocity='Z', force='Z')


def test_a_law_answers_states_as_it_flies():
    for name in rpo.controllers():
        law = rpo.controller(name)
        flight = rpo.fly('quick', law)
        ticks = (0, 20, 49)
        forces = [law(flight.t[tick], flight.x[tick]) for tick in ticks]
        assert np.array_equal(forces, flight.u[list(ticks)]), name


def test_own_controller():
    gains = np.hstack([0.02 * np.eye(3), 0.7 * np.eye(3)])
    flight = rpo.fly('approach', lambda t, x: -gains @ x)
    assert np.abs(flight.x[-1, :3]).max() < 1.0
    assert flight.explain(10.0).axes == {}
    with pytest.raises(
        rpo.InputError, match=r'law\(t, x\) must return 3 finite forces .*shape \(3,'
    ):
        rpo.fly('quick', lambda t, x: -x)


@pytest.mark.parametrize(
    ('arguments', 'sentence'),
    [
        ((3,), 'scenario: name, path or object expected; got 3'),
        (('quick', 3), r'controller: name, path, object or function law\(t, x\) expected; got 3'),
        (('paper_training',), '`scenario` must be a single flight; paper_training is a set of 216'),
        (('quick', lambda t: t), r'function law\(t, x\) expected; got one of \(t\)'),
        (('qick',), '`scenario` must be one of .*; got .qick.; did you mean `quick`'),
    ],
)
def test_the_door_says_what_it_takes(arguments, sentence):
    with pytest.raises(rpo.InputError, match=sentence):
        rpo.fly(*arguments)


def test_plot_two_flights_over_each_other(monkeypatch):
    monkeypatch.setenv('MPLBACKEND', 'Agg')
    axes = rpo.fly('quick', 'allround').plot(label='fuzzy')
    assert rpo.fly('quick', 'pd').plot(axes, label='PD') is axes
    assert len(axes[0].lines) == 6
    names = [text.get_text() for text in axes[0].get_legend().get_texts()]
    assert names[-2:] == ['fuzzy', 'PD']
    alone = rpo.fly('quick').plot(axes[0].figure.subplots())
    assert alone.get_ylabel() == 'distance from the goal [m]'
    with pytest.raises(rpo.InputError, match='`ax` must be one Axes, or three of them; got 3'):
        rpo.fly('quick').plot(3)


@pytest.mark.parametrize('controller', ['allround', rpo.controller('pd')])
def test_a_saved_flight_is_verified(controller, tmp_path):
    flight = rpo.fly('quick', controller, mass_kg=12.0)
    flight.save(tmp_path / 'run')
    assert verify(tmp_path / 'run').exit_code == 0
    logged = rpo.load(tmp_path / 'run')
    assert (logged.u == flight.u).all() and logged.metrics == flight.metrics
    assert repr(logged.explain(3.0)) == repr(flight.explain(3.0))
    with pytest.raises(rpo.InputError, match='this one is from a log'):
        logged.save(tmp_path / 'again')
    with pytest.raises(rpo.InputError, match='the function law has none'):
        rpo.fly('quick', lambda t, x: -x[:3]).save(tmp_path / 'other')


@pytest.mark.parametrize('name', ['handmade', 'pd'])
def test_a_surface_of_any_controller_is_drawn(name):
    assert all(axes.has_data() for axes in rpo.plot(name).axes)
    with pytest.raises(rpo.InputError, match='`what` must be one of surface, rules, words'):
        rpo.plot(name, 'rule')


def test_a_notebook_shows_tables_and_the_replay():
    flight = rpo.fly('quick')
    assert '<td>quick</td>' in rpo.scenarios()._repr_html_()
    assert 'energy J' in flight._repr_html_() and 'J = ' in flight._repr_html_()
    assert flight.replay()._repr_html_().startswith('<iframe srcdoc=')


def test_a_table_has_units():
    import pandas

    flight = rpo.fly('paper_test_measured')
    frame, data = flight.to_dataframe(), flight.to_xarray()
    assert isinstance(frame, pandas.DataFrame) and frame.index.name == 'time_s'
    assert frame.attrs['units']['navigation_vx_m_s'] == 'm/s' and data['fx_n'].attrs['units'] == 'N'
    assert (frame[['x_m', 'y_m', 'z_m']].to_numpy() == flight.x[:, :3]).all()


def test_a_changed_controller_is_exported_and_drawn(tmp_path):
    law = rpo.controller('allround').with_rule(position='SP', velocity='Z', force='LP')
    names = ('law.c', 'law.h', 'law_test.c', 'law_test.txt')
    assert rpo.export(law, tmp_path / 'law.c') == [tmp_path / name for name in names]
    rpo.export(law, tmp_path / 'law.yaml')
    assert rpo.controller(tmp_path / 'law.yaml') == law
    text = rpo.export('apollo', 'c', law, stages='attitude_control', duration_s=9.0)
    assert 'apollo__changed__attitude_control_step' in text
    flights = [rpo.fly('quick', each) for each in ('allround', law)]
    page = rpo.report(flights, tmp_path / 'page')
    assert page == tmp_path / 'page' / 'report.html' and (page.parent / 'replay.html').is_file()
    assert repr(rpo.verify(flights[1])).startswith('<Verification quick: verified, 51 ticks')
    runs = rpo.campaign('paper_test', runs=20, folder=tmp_path / 'runs')
    assert rpo.report(runs) == tmp_path / 'runs' / 'report' / 'report.html'
    with pytest.raises(rpo.InputError, match='is in memory alone; fly it with a folder'):
        rpo.report(rpo.campaign('paper_test', runs=20))


@pytest.mark.parametrize(
    ('call', 'sentence'),
    [
        (lambda: rpo.verify(3), 'run: folder, .mcap file or Flight expected; got 3'),
        (lambda: rpo.report([]), 'report: at least one run, campaign, proof or controller'),
        (lambda: rpo.report(['quick', 'pd']), 'several targets must be runs; quick is a'),
        (lambda: rpo.export(lambda t, x: x[:3], 'c'), 'name, path or object of a controller file'),
        (lambda: rpo.export('pd', 'law.exe'), "path of a file with such a suffix .*got 'law.exe'"),
        (lambda: rpo.scale(3, 'quick'), 'controller: name, path, object or function .*; got 3'),
        (lambda: rpo.prove('paper_test'), 'paper_test is a single flight: give the half-width'),
    ],
)
def test_proofs_and_pages_say_what_they_take(call, sentence):
    with pytest.raises(rpo.InputError, match=sentence):
        call()
