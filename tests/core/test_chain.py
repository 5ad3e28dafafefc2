# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The chain of shipped scenarios: cut in parts, in blocks of ticks, and what a log says of it."""

from __future__ import annotations

import sys
from contextlib import nullcontext
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from rpo_core import plugins, stage
from rpo_core.chain.chain import Chain, signals_of, start_of
from rpo_core.chain.driver import Driver
from rpo_core.chain.flight import Flight, fly
from rpo_core.control import controller_file
from rpo_core.control.baselines import Pd
from rpo_core.control.controller import load_controller
from rpo_core.control.controller_file import received
from rpo_core.files.validation import InputError
from rpo_core.judge import metrics
from rpo_core.scenario import overrides
from rpo_core.scenario.scenario import dumps, load_scenario, text_for_logs
from rpo_core.stage import Place, Stage
from rpo_core.wire import interfaces
from rpo_core.wire.interfaces import CONTROL_FORCE, NEXT, RELATIVE_STATE

NAMES = ['apollo', 'assured', 'docking_leo', 'on_command', 'paper_test_measured', 'paper_test']
NAMES += ['tumbling_docking', 'world_leo']
TICKS = 60


@cache
def flown(name):
    """Return scenario, controller and flight of some seconds."""
    scenario = load_scenario(name)
    scenario = replace(scenario, duration_s=TICKS * scenario.dt_s)
    controller = load_controller('allround')
    return scenario, controller, fly(scenario, controller)


def rows_of(flight):
    """Return all signals of a flight by name."""
    truth = {RELATIVE_STATE: flight.states, CONTROL_FORCE: flight.forces_n}
    return {**truth, interfaces.DISTURBANCE_FORCE: flight.disturbances_n, **flight.signals}


@pytest.mark.parametrize('name', NAMES)
def test_parts_of_a_chain_fly_the_bits_of_the_whole(name):
    """As nodes do: each hands its signals on."""
    scenario, controller, flight = flown(name)
    whole = Chain.of(scenario, controller)
    parts = [
        whole.before(Place.CONTROLLER),
        whole.part(Place.CONTROLLER),
        whole.after(Place.CONTROLLER),
    ]
    assert [link for part in parts for link in part.links] == list(whole.links)
    assert [name for part in parts for name in part.outputs] == list(whole.outputs)
    assert set(signals_of(scenario)) == {RELATIVE_STATE, CONTROL_FORCE, *whole.outputs}
    whole.reset()
    signals = start_of(scenario)
    for tick in range(TICKS):
        for part in parts:
            assert all(name in signals or interfaces.current(name) != name for name in part.inputs)
            part.step(tick, signals)
        for key, rows in flight.signals.items():
            assert tuple(rows[tick + (key in NEXT)]) == tuple(signals[key]), (tick, key)
    assert tuple(flight.states[TICKS]) == signals[RELATIVE_STATE]


@pytest.mark.parametrize('name', NAMES)
def test_blocks_of_ticks_have_the_bits_of_single_ones(name):
    """What a log is recomputed with: stages that depend on earlier ticks have all of them."""
    scenario, controller, flight = flown(name)
    chain, known = Chain.of(scenario, controller), rows_of(flight)
    chain.reset()
    ticks = np.arange(TICKS)
    checked = 0
    for link in chain.links:
        if not all(read in known for read in link.reads):
            continue
        made = link.stage.steps(ticks, *(known[read][:TICKS] for read in link.reads))
        for key, rows in zip(link.stage.outputs, made, strict=True):
            later = int(key in NEXT)
            np.testing.assert_array_equal(rows, known[key][later : TICKS + later], key)
            checked += 1
    assert checked >= 2
    memories = [link.stage.memory_ticks for link in chain.links]
    assert chain.memory_ticks == (None if None in memories else sum(memories))
    assert chain.counts_ticks == any(link.stage.counts_ticks for link in chain.links)


@pytest.mark.parametrize('name', NAMES)
def test_a_controller_answers_what_it_received(name):
    scenario, controller, flight = flown(name)
    known = rows_of(flight)
    for tick in range(0, TICKS, 7):
        signals = {key: tuple(rows[tick]) for key, rows in known.items()}
        seen, on_top = received(scenario, signals)
        force = np.add(controller.force_n(seen[:3], seen[3:], tick), on_top)
        if scenario.compensated:
            force -= signals[interfaces.ESTIMATED_DISTURBANCE]
        assert tuple(force) == signals[CONTROL_FORCE]
        if interfaces.REFERENCE_STATE in signals:
            state = signals.get(interfaces.NAVIGATION_STATE, signals[RELATIVE_STATE])
            relative = np.subtract(state, signals[interfaces.REFERENCE_STATE])
            assert tuple(relative) == seen


@pytest.mark.parametrize('name', ['apollo', 'docking_leo', 'paper_test', 'world_leo'])
def test_what_thrusters_made_is_computed_again(name):
    scenario, _, flight = flown(name)
    again = Flight(scenario, flight.states, flight.forces_n, flight.disturbances_n, {
        key: rows for key, rows in flight.signals.items() if not key.startswith('saturated')
    })  # fmt: skip
    np.testing.assert_array_equal(again.saturated_forces_n, flight.saturated_forces_n)
    spent, exerted = again.thrust, flight.signals.get(interfaces.EXERTED_FORCE)
    exerted = flight.signals['thrust_force'] if exerted is None else exerted
    np.testing.assert_array_equal(spent.forces_n, exerted[:-1])
    falls = scenario.thrusters is not None and scenario.thrusters.propellant is not None
    assert (np.diff(spent.masses_kg) < 0.0).any() == falls == (spent.propellant_kg > 0.0)
    if falls:
        np.testing.assert_array_equal(spent.masses_kg, flight.signals['chaser_mass'][:-1, 0])
    impulse = np.abs(flight.saturated_forces_n).sum() * scenario.dt_s / scenario.mass_kg
    fires = scenario.thrusters is not None and scenario.thrusters.fires
    assert (spent.openings > 0) == fires
    assert spent.delta_v_m_s == pytest.approx(impulse, rel=0.5 if fires else 1e-12)
    found = {figure.statement: figure.value for figure in metrics.others_of(flight)}
    assert found.get('propellant', 0.0) == spent.propellant_kg
    assert found.get('openings of the valves', 0.0) == spent.openings
    if fires or falls:
        assert found['Δv of the thrusters, waste included'] == spent.delta_v_m_s


@pytest.mark.parametrize('name', NAMES)
def test_a_stage_that_is_off_hands_on_what_carries_the_same(name):
    scenario, controller, flight = flown(name)
    known = rows_of(flight)
    for link in Chain.of(scenario, controller).links:
        reads = [tuple(known[read][5]) for read in link.reads if read in known]
        if len(reads) < len(link.reads) or type(link.stage).off is not Stage.off:
            continue
        found = dict(zip(link.stage.outputs, link.stage.off(*reads), strict=True))
        sources = link.stage.passes_on()
        for (key, values), source in zip(found.items(), sources, strict=True):
            row = interfaces.row_of(key)
            width = len(row.columns) or row.numbers
            given = reads[source] if isinstance(source, int) else source
            assert values == (*given, *(0.0,) * width)[:width]
            carried = [interfaces.row_of(read).carries for read in link.reads]
            if (
                row.carries
                and row.carries in carried
                and type(link.stage).passes_on is Stage.passes_on
            ):
                assert given == reads[carried.index(row.carries)]


def test_the_driver_has_a_place_for_what_a_part_reads_of_the_tick_before():
    """A part without the stage that makes that command raised a KeyError."""
    scenario = load_scenario('paper_test_measured')
    part = Chain.of(scenario, load_controller('allround')).part(Place.ESTIMATOR)
    places = Driver(part).places
    assert (
        places[interfaces.previous('shaped_force')].stop == max(p.stop for p in places.values()) - 3
    )


def test_a_stage_that_reads_what_nobody_makes_is_refused():
    class Hungry(Stage):
        name, inputs, outputs = 'hungry', ('measurement',), ()

    scenario, controller, _ = flown('paper_test')
    with pytest.raises(InputError, match=r'stage `hungry` must read .*relative_state.*measurement'):
        Chain.of(scenario, controller, [(Place.SENSOR, Hungry())])


def test_what_rides_in_a_message_is_said_where_it_says_something():
    for row in interfaces.table().values():
        own = len(row.columns)
        values = tuple(np.arange(1.0, 1.0 + own).tolist())
        signals = {row.name: values}
        assert row.whole(signals) == values == row.spoken(values)
        if row.rider:
            rider = interfaces.row_of(row.rider)
            riding = tuple(np.arange(50.0, 50.0 + len(rider.columns)).tolist())
            assert row.whole({**signals, row.rider: riding}) == row.spoken((*values, *riding))
            assert row.spoken((*values, *riding)) == (*values, *riding)
            assert row.spoken((*values, *rider.rest)) == values


def test_a_set_is_no_flight_and_a_field_is_told_its_section():
    with pytest.raises(InputError, match='must be a single flight; paper_training is a set'):
        overrides.load('paper_training', ['mass_kg=9.0'])
    with pytest.raises(InputError, match=r'did you mean `zones\.keep_out_m`'):
        overrides.load('assured', ['keep_out_m=9.0'])


def test_what_is_registered_is_registered_once():
    with pytest.raises(InputError, match='section `thrusters` must be registered once'):
        stage.register(stage.sections()['thrusters'])
    with pytest.raises(InputError, match='section must be registered; got settings of int'):
        stage.section_of(3)
    with pytest.raises(InputError, match='controller kind `pd` must be registered once'):
        controller_file.register(Pd)
    row, before = interfaces.row_of(RELATIVE_STATE), list(interfaces.table())
    with pytest.raises(InputError, match='`relative_state` must be added once'):
        interfaces.add(row)
    for changes, place, said in (
        ({'name': 'mine', 'type': 'std_msgs/msg/Bool'}, '', '`mine` must be .* to be logged; got'),
        ({'name': 'mine'}, 'nowhere', "`before` must be one of clock, .*; got 'nowhere'"),
    ):
        with pytest.raises(InputError, match=said):
            interfaces.add(replace(row, **changes), before=place)
    with pytest.raises(InputError, match=r"interface must be one of clock, .*; got 'mine'"):
        interfaces.row_of('mine')
    assert list(interfaces.table()) == before


def test_settings_of_a_kind_are_there_once():
    scenario, _, _ = flown('docking_leo')
    with pytest.raises(InputError, match='`sections` must hold settings of each kind once'):
        replace(scenario, sections=(*scenario.sections, scenario.thrusters))


def test_the_table_knows_topics_and_axes():
    state = interfaces.row_of(RELATIVE_STATE)
    assert interfaces.find('/mine/relative_state') is state is interfaces.find(RELATIVE_STATE)
    assert interfaces.find('/mine/nothing') is None
    assert (state.topic, interfaces.row_of('clock').topic) == ('relative_state', '/clock')
    row = interfaces.row_of('measurement')
    for name, frame in (('approach', row.layout.texts[0]), ('tumbling_docking', row.also)):
        assert row.layout_in(load_scenario(name)).texts[0] == frame
    assert row.also != row.layout.texts[0] != ''


def test_a_log_has_the_text_of_its_file_unless_that_names_others():
    assert text_for_logs('as it is', load_scenario('approach')) == 'as it is'
    docking = load_scenario('tumbling_docking')
    assert text_for_logs('as it is', docking) == dumps(docking)


def test_plugins_are_loaded_once_and_named_where_they_are_missing(tmp_path, monkeypatch):
    (tmp_path / 'my_stage_of_this_test.py').write_text('')
    monkeypatch.syspath_prepend(tmp_path)
    for named, said in (('my_stage_of_this_test,', ''), ('my_stage_of_nobody', '`RPO_PLUGINS`: ')):
        monkeypatch.setenv(plugins.VARIABLE, named)
        monkeypatch.setattr(plugins, '_loaded', False)
        with pytest.raises(InputError, match=said) if said else nullcontext():
            plugins.load()
        plugins.load()
    assert 'my_stage_of_this_test' in sys.modules
