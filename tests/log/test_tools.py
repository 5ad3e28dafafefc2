# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Info, diff, export, table and picture of logs; what is beside a log, and logs without ROS."""

from __future__ import annotations

import csv
import itertools
import os
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import messages
import numpy as np
import pytest
import yaml
from invoking import invoke
from log_runs import DISTURBANCE, FORCE, STATE, STATUS, changed, forge, make_run

import rpo
from rpo.display import print_table
from rpo.training.config import load_start
from rpo_core.chain.flight import fly
from rpo_core.control.controller import load_controller
from rpo_core.judge.verdicts import number, verdicts
from rpo_core.scenario import overrides
from rpo_core.scenario.scenario import load_scenario
from rpo_core.wire import cdr
from rpo_log import commands
from rpo_log.errors import ExitCode, LogError
from rpo_log.provenance import machine_facts, write_run_info
from rpo_log.read.run_log import read_run
from rpo_log.show import report, style
from rpo_log.tools.diff import diff, inspect
from rpo_log.tools.export import export
from rpo_log.verify import verify


def test_numbers_along_a_logarithmic_axis_are_plain():
    figure, axes = style.new_panels(3.0)
    axes.plot([0.001, 1000.0], [2.0, 6.0])
    style.log_scale(axes, x=True)
    figure.draw_without_rendering()
    along = {label.get_text() for label in axes.get_xticklabels()}
    assert {'0.001', '1000'} <= along
    assert '3' in {label.get_text() for label in axes.get_yticklabels(minor=True)}


# info


def test_info_of_a_whole_log(run, log):
    found = inspect(log)
    assert found.exit_code == ExitCode.OK
    assert found.gaps == ()
    assert found.ticks == (0, 400)
    assert found.outcome == 'finished'
    counts = {topic.name: count for topic, count in found.messages.items()}
    assert counts == {n: sum(1 for m in run.messages if m[0] == n) for n in run.topics}
    assert found.attachments.keys() == run.attachments.keys()
    assert any('401 messages' in line for line in found.lines())


def test_foreign_names_go_escaped_to_the_terminal(monkeypatch):
    lines = ['attached: a\x1b[2J\n/fake  3 bytes', 'x' * 200_000]
    found = SimpleNamespace(lines=lambda: lines, exit_code=0)
    monkeypatch.setattr('rpo_log.tools.diff.inspect', lambda path: found)
    shown = invoke('log', 'info', 'run').output.splitlines()
    assert shown[0] == r'attached: a\x1b[2J\n/fake  3 bytes'
    assert len(shown) == 2 and len(shown[1]) == 2000


@pytest.mark.parametrize('damaged', [False, True])
@pytest.mark.parametrize('command', ['verify', 'info'])
def test_the_commands_of_the_ros_package_are_those_of_rpo(
    run, tmp_path, monkeypatch, capsys, command, damaged
):
    run.write(tmp_path / 'run')
    log = tmp_path / 'run' / 'run.mcap'
    log.write_bytes(log.read_bytes()[: 60_000 if damaged else None])
    words = ['log', 'info'] if command == 'info' else [command]
    expected = invoke(*words, tmp_path / 'run')
    monkeypatch.setattr('sys.argv', [command, str(tmp_path / 'run')])
    assert getattr(commands, command)() == expected.exit_code
    assert capsys.readouterr().out == expected.output != ''
    if command == 'verify':
        detailed = invoke('verify', tmp_path / 'run', '--details').output
        assert len(expected.output.splitlines()) == 1 and detailed.startswith(expected.output)
        assert 'rests on (SHA-256)' in detailed
    if damaged and command == 'info':
        assert expected.exit_code == ExitCode.INCOMPLETE
        assert 'cut short' in expected.output and 'rpo repair' in expected.output


@pytest.mark.every_landing
def test_nobody_reads_on(log):
    """`ros2 run rpo_log info runs/demo | head` ends with one sentence, without a traceback."""
    read, write = os.pipe()
    os.close(read)
    start = 'import sys; from rpo_log import commands; sys.exit(commands.info())'
    command = [sys.executable, '-c', start, str(log)]
    done = subprocess.run(command, stdout=write, stderr=subprocess.PIPE, text=True, timeout=50)
    os.close(write)
    assert done.returncode == ExitCode.BAD_INPUT
    assert done.stderr.endswith(': standard output cannot be written: Broken pipe\n')
    assert done.stderr.count('\n') == 1


def test_a_bad_log_is_one_sentence(monkeypatch, capsys):
    monkeypatch.setattr('sys.argv', ['verify', '/nowhere'])
    assert commands.verify() == ExitCode.BAD_INPUT
    assert capsys.readouterr().err == 'verify: /nowhere: does not exist\n'


# diff


def test_the_same_run_twice_is_equal(run, log, tmp_path):
    run.write(tmp_path, run.shuffled(5), split_s=7.0)
    found = diff(log, tmp_path)
    assert found.exit_code == ExitCode.OK
    assert found.compared == 401
    assert next(found.lines()).endswith('equal')


def test_the_first_difference_of_each_topic(log, tmp_path):
    def more(by):
        def change(data):
            wrench = list(cdr.decode_stamped(cdr.ODOMETRY, data).floats)
            state = wrench[:3] + wrench[43:46]
            state[4] += by
            return messages.odometry(cdr.stamp_ns(data), 'target_lvlh', 'chaser', state)

        return change

    changes = changed(STATE, 70, more(0.25)), changed(STATE, 90, more(0.5))
    found = diff(log, forge(log, tmp_path, *changes, changed(DISTURBANCE, 300, None)))
    assert found.exit_code == ExitCode.DIFFERENT
    tick, field, a, b = found.first['relative_state']
    assert (tick, field) == (70, 'twist.twist.linear.y')
    assert b - a == pytest.approx(0.25)
    assert found.ticks == {'relative_state': 2, 'disturbance_force': 1}
    assert found.largest == {'relative_state twist.twist.linear.y': pytest.approx(0.5)}
    tick, _, a, b = found.first['disturbance_force']
    assert tick == 300 and a is not None and b is None
    assert any('is missing' in line or 'and missing' in line for line in found.lines())


def test_minus_zero_is_not_zero(run, log, tmp_path):
    stamp_ns = run.base.stamp_ns(50)
    forces = (messages.wrench(stamp_ns, 'target_lvlh', [x, 1.0, 1.0]) for x in (0.0, -0.0))
    plus, minus = (
        forge(log, tmp_path / str(i), changed(FORCE, 50, force)) for i, force in enumerate(forces)
    )
    found = diff(plus, minus)
    assert found.first == {'control_force': (50, 'wrench.force.x', 0.0, -0.0)}
    assert found.largest == {}


def test_what_differs_beside_the_ticks(run, short_run, log, tmp_path):
    short_run.write(tmp_path / 'short')
    found = diff(log, tmp_path / 'short')
    said = '\n'.join(found.lines())
    assert 'scenario.yaml differs' in said
    assert 'they end at ticks 400 and 50' in said
    assert not found.first  # the flight is the same as far as both go

    odd = changed(STATE, 3, lambda d: d.replace(b'chaser', b'chased'))
    said = '\n'.join(diff(log, forge(log, tmp_path, odd)).lines())
    assert 'more than a stamp' in said

    figures = {**run.figures(400, 'finished'), 'energy_n2s': '0.0'}
    lie = cdr.encode_status(0, 'run', 'finished', 'none', figures)
    found = diff(log, forge(log, tmp_path, changed(STATUS, 400, lie)))
    assert 'run_status differs' in '\n'.join(found.lines())


# export


def columns(run) -> dict[str, np.ndarray]:
    flight = run.flight
    named = zip(('x_m', 'y_m', 'z_m', 'vx_m_s', 'vy_m_s', 'vz_m_s'), flight.states.T, strict=True)
    forces = zip(('fx_n', 'fy_n', 'fz_n'), flight.forces_n.T, strict=True)
    disturbances = zip(('dx_n', 'dy_n', 'dz_n'), flight.disturbances_n.T, strict=True)
    return dict([*named, *forces, *disturbances])


def read_csv(path: Path) -> dict[str, list[int | float]]:
    with path.open(newline='') as file:
        rows = list(csv.DictReader(file))
    return {n: [int(r[n]) if r[n].isdecimal() else float(r[n]) for r in rows] for n in rows[0]}


@pytest.mark.parametrize(('suffix', 'read'), [('csv', read_csv), ('npz', np.load)])
def test_a_table_comes_back_bit_for_bit(run, log, tmp_path, suffix, read):
    target = tmp_path / f'run.{suffix}'
    assert export(log, target) == 401
    found = read(target)
    np.testing.assert_array_equal(found['tick'], range(401))
    np.testing.assert_array_equal(found['stamp_ns'], [run.base.stamp_ns(k) for k in range(401)])
    np.testing.assert_array_equal(found['time_s'], run.flight.scenario.times_s)
    for name, values in columns(run).items():
        np.testing.assert_array_equal(found[name], values)


@pytest.mark.parametrize('suffix', ['csv', 'npz'])
def test_a_table_that_could_not_be_written_whole_is_not_left(log, tmp_path, monkeypatch, suffix):
    def full(*_, **__):
        raise OSError(28, 'No space left on device')

    monkeypatch.setattr(np, 'savez_compressed', full)
    monkeypatch.setattr(csv, 'writer', full)
    with pytest.raises(LogError, match='cannot hold a log: No space left on device'):
        export(log, tmp_path / f'run.{suffix}')
    assert not list(tmp_path.iterdir())


@pytest.mark.every_landing
def test_another_library_reads_the_oem(run, log, tmp_path):
    """Written by ccsds-ndm-py, read by oem."""
    assert export(log, tmp_path / 'run.oem') == 401
    from oem import OrbitEphemerisMessage  # it brings astropy

    found = OrbitEphemerisMessage.open(tmp_path / 'run.oem').segments[0]
    metadata = {name: found.metadata[name] for name in ('CENTER_NAME', 'REF_FRAME', 'TIME_SYSTEM')}
    assert metadata == {
        'CENTER_NAME': 'TARGET', 'REF_FRAME': 'RSW_ROTATING', 'TIME_SYSTEM': 'UTC'
    }  # fmt: skip
    read = list(found.states)
    states = np.array([[*state.position, *state.velocity] for state in read])
    assert (states == run.flight.states / 1000.0).all()
    ticks = [round((state.epoch - read[0].epoch).to_value('s') / 0.1, 6) for state in read]
    assert ticks == list(range(401))
    assert read[0].epoch.unix == run.base.epoch_ns / 1e9


def test_the_other_names_of_the_frame():
    """The rows of the table in theory.md against the definitions, on a circular orbit."""
    r, v = np.array([0.6, 0.0, 0.8]), np.array([0.48, 0.8, -0.36])
    v -= r * (r @ v)
    v, h = v / np.linalg.norm(v), np.cross(r, v) / np.linalg.norm(v)
    ours = np.array([r, v, h])
    defined = {
        'RTN': (r, None, h), 'LVLH_ROTATING': (None, -h, -r), 'NTW_ROTATING': (None, v, h),
        'TNW_ROTATING': (v, None, h),
    }  # fmt: skip
    page = (Path(__file__).parents[2] / 'docs' / 'theory.md').read_text()
    for name, axes in defined.items():
        row = re.search(rf'\|[^|\n]*{name}[^|\n]*\|(.*)\|', page)
        signs = [cell.strip() for cell in row.group(1).split('|')]
        rotation = np.array([[(f'-{a}' in s) * -1 + (f'+{a}' in s) for a in 'xyz'] for s in signs])
        assert round(np.linalg.det(rotation)) == 1
        for found, axis in zip(rotation @ ours, axes, strict=True):
            assert axis is None or np.allclose(found, axis), name


def test_without_disturbance(tmp_path):
    make_run(5.0, 'approach', (STATE, FORCE)).write(tmp_path / 'log')
    export(tmp_path / 'log', tmp_path / 'run.csv')
    assert 'dx_n' not in (tmp_path / 'run.csv').read_text().splitlines()[0]


@pytest.mark.parametrize(
    ('name', 'said'),
    [
        ('taken.csv', 'exists already'),
        ('run.xlsx', r'must end in one of \.csv'),
        ('run.parquet', 'gone in 0.2; use `.csv`'),
        ('nowhere/run.csv', 'No such file'),
    ],
)
def test_outputs_that_cannot_be(log, tmp_path, name, said):
    (tmp_path / 'taken.csv').write_text('mine')
    with pytest.raises(LogError, match=said):
        export(log, tmp_path / name)
    assert (tmp_path / 'taken.csv').read_text() == 'mine'


# beside the log


def test_run_info(tmp_path):
    write_run_info(tmp_path, {'begun': '2026-01-01T00:00:00Z', 'wall_s': 2.5})
    found = yaml.safe_load((tmp_path / 'run_info.yaml').read_text())
    assert found['wall_s'] == 2.5
    assert found['machine'] == machine_facts()
    assert re.match(r'3\.\d+', found['machine']['python'])
    assert found['machine']['libraries']['mcap']
    with pytest.raises(LogError, match='cannot hold a log'):
        write_run_info(tmp_path / 'nowhere', {})


# `rpo simulate --output`: a run folder that every command takes, without ROS


@pytest.mark.parametrize(
    'words',
    [
        ('quick', '--controller', 'more_words'),
        ('paper_test_measured', '--set', 'duration_s=40.0'),
        ('world_leo', '--set', 'duration_s=20.0', '--set', 'max_force_n=0.05'),
    ],
    ids=lambda words: words[0],
)
def test_a_flight_without_ros_leaves_a_log_that_verifies(words, tmp_path):
    run = tmp_path / 'run'
    said = invoke('simulate', *words, '--output', run, '--no-fail')
    assert said.exit_code == 0 and f'{run}: ' in said.output, said.output
    verified = verify(run)
    assert verified.exit_code == 0, verified.sentence()
    log = read_run(run)
    assert log.complete and log.outcome == 'finished'
    name = words[words.index('--controller') + 1] if '--controller' in words else 'allround'
    changes = [change for flag, change in itertools.pairwise(words) if flag == '--set']
    flown = fly(overrides.load(words[0], changes), load_controller(name))
    assert (log.states == flown.states).all() and (log.forces_n == flown.forces_n).all()


@pytest.fixture(scope='module')
def flight():
    return fly(load_scenario('paper_test'), load_start('trained'))


def test_values_have_units_and_are_words_where_there_is_no_number():
    assert number(0.123456, 'm') == '0.123 m'
    assert number(7.0, '') == '7'
    assert (number(np.inf, 's'), number(np.nan, 's')) == ('never', '–')


def test_the_table_has_each_requirement_with_limit_and_verdict(flight):
    required = verdicts(flight)
    lines = report.table(flight)
    assert lines[0] == ('requirements of paper_test', '', '', '')
    for verdict in required:
        (line,) = (line[1:] for line in lines if line[0] == f'  {verdict.statement}')
        assert line[0] == number(verdict.value, verdict.unit)
        assert line[1].startswith(f'≤ {verdict.limit:.3g}') and line[2] == verdict.word
    assert len(report.rows(flight)[report.METRICS]) > 5
    judged = {verdict.statement for verdict in required}
    assert not {row[0] for row in report.rows(flight)[report.METRICS]} & judged
    alone = replace(flight, scenario=replace(flight.scenario, requirements=None))
    assert next(iter(report.rows(alone).items())) == (report.NO_REQUIREMENTS, [])


def test_a_name_in_the_table_is_as_it_is(flight, monkeypatch, capsys):
    monkeypatch.setenv('COLUMNS', '200')
    name = '[/] [bold]x[/bold] :bomb: #123456'
    named = replace(flight, scenario=replace(flight.scenario, name=name))
    print_table(report.COLUMNS, report.table(named), name)
    title, *rest = capsys.readouterr().out.splitlines()
    assert name in title and any(f'requirements of {name}' in line for line in rest)


def test_a_run_is_shown_in_plain_text(tmp_path, capsys):
    rpo.fly('quick').save(tmp_path / 'run')
    picture, missed = report.show(tmp_path / 'run')
    said = capsys.readouterr().out
    assert 'quick, controller allround' in said and report.NO_REQUIREMENTS in said
    assert re.search(r'energy J +\S+ N²s', said) and picture.is_file() and not missed


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
