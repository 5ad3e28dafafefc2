# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What a run shows: the table in words, and the lines of its picture."""

from __future__ import annotations

import importlib.util
from dataclasses import replace

import numpy as np
import pytest

from rpo.training.config import load_start
from rpo_core.chain.flight import fly
from rpo_core.judge.verdicts import verdicts
from rpo_core.scenario.scenario import load_scenario
from rpo_log.show import report, style


@pytest.fixture(scope='module')
def flight():
    return fly(load_scenario('paper_test'), load_start('trained'))


def test_values_have_units_and_are_words_where_there_is_no_number():
    assert report.shown(0.123456, 'm') == '0.123 m'
    assert report.shown(7.0, '') == '7'
    assert (report.shown(np.inf, 's'), report.shown(np.nan, 's')) == ('never', '–')


@pytest.mark.parametrize('rich', [True, False])
def test_the_table_has_each_requirement_with_limit_and_verdict(flight, rich, monkeypatch, capsys):
    plain = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, 'find_spec', lambda name: plain(name) if rich or name != 'rich' else None
    )
    monkeypatch.setenv('COLUMNS', '200')
    report.print_table(flight, 'a title')
    said = capsys.readouterr().out
    required = verdicts(flight)
    lines = said.splitlines()
    assert 'a title' in lines[0] and any('requirements of paper_test' in line for line in lines)
    for verdict in required:
        (line,) = (line for line in lines if verdict.statement in line)
        for text in (report.shown(verdict.value, verdict.unit), f'≤ {verdict.limit:.3g}'):
            assert text in line
        assert verdict.word in line
    assert len(report.rows(flight)[report.METRICS]) > 5
    judged = {verdict.statement for verdict in required}
    assert not {row[0] for row in report.rows(flight)[report.METRICS]} & judged
    alone = replace(flight, scenario=replace(flight.scenario, requirements=None))
    assert next(iter(report.rows(alone).items())) == (report.NO_REQUIREMENTS, [])


def test_a_name_in_the_table_is_as_it_is(flight, monkeypatch, capsys):
    monkeypatch.setenv('COLUMNS', '200')
    name = '[/] [bold]x[/bold] :bomb: #123456'
    report.print_table(replace(flight, scenario=replace(flight.scenario, name=name)), name)
    title, *rest = capsys.readouterr().out.splitlines()
    assert name in title and any(f'requirements of {name}' in line for line in rest)


def test_the_picture_has_the_flight_and_its_limits(flight):
    with style.applied():
        figure = report.time_histories(flight)
    begin, limits = 200.0, {verdict.key: verdict.limit for verdict in verdicts(flight)}
    assert report.close_up_s(flight.scenario) == flight.scenario.requirements.hold_from_s == begin
    panels = np.array(figure.axes).reshape(3, 2)
    drawn = (flight.errors[:, :3], flight.velocities_m_s, flight.saturated_forces_n)
    for (wide, close), values in zip(panels, drawn, strict=True):
        for axis in range(3):
            times, found = wide.lines[axis].get_data()
            assert (found == values[:, axis]).all()
            assert times[-1] == pytest.approx((len(values) - 1) * 0.1)
            times, found = close.lines[axis].get_data()
            assert (found == values[-len(found) :, axis]).all()
            assert begin - 0.11 <= times[0] <= begin + 0.11
    levels = {line.get_ydata()[0] for line in panels[0][1].lines[3:]}
    assert levels == {-limits['hold_error_per_axis_m'], limits['hold_error_per_axis_m']}
    assert len(panels[0][0].lines) == 3, 'too small to see from the start'
    assert panels[0][0].get_ylabel() == 'relative position [m]'
    assert panels[0][1].get_title() == 'last 200 s'
    assert panels[2][0].get_ylabel() == report.force_label(flight.scenario) == 'control force [N]'
    turning = flight.scenario.equipped(load_scenario('tumbling_docking').attitude)
    assert report.force_label(turning) == "force in the\nchaser's axes [N]"
    short = replace(flight.scenario, requirements=None, duration_s=150.0)
    assert report.close_up_s(short) == 0.0
    assert report.close_up_s(replace(short, duration_s=500.0)) == 300.0
