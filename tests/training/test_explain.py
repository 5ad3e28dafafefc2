# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""`rpo explain`: from a controller, a state, a log; its verdicts as exit codes."""

from __future__ import annotations

import re
from dataclasses import replace

import messages
import pytest
from invoking import invoke, refused
from log_runs import FORCE, chain_run, make_run, rewrite

from rpo_core import files
from rpo_core.control.controller import dumps, load_controller
from rpo_core.control.explain import decisions
from rpo_core.control.fuzzy import RuleTable
from rpo_core.navigation.estimator import Estimator
from rpo_core.scenario.scenario import load_scenario
from rpo_log.format.run import TimeBase


def run(*arguments):
    return invoke('explain', *arguments)


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    """The log of the first five seconds of the paper's test."""
    path = tmp_path_factory.mktemp('flown')
    made = make_run(5.0)
    assert made.write(path).whole
    return path, made.flight


def test_a_controller_is_a_table(tmp_path):
    done = run('handmade')
    assert done.exit_code == 0
    rows = [re.findall(r'\b(LN|SN|Z|SP|LP) +\d+%', line) for line in done.stdout.splitlines()]
    assert (
        tuple(tuple(row) for row in rows[::-1] if row)  # large positive errors are at the top
        == load_controller('handmade').system.rules.words
    )
    assert '-70, 0' in done.stdout and 'No warnings' in done.stdout
    assert 'position error = −position, where 1 is 70 m' in done.stdout
    said = run('handmade', '--state', '35,0,0,0,0,0').stdout
    assert 'position error = −position = -35 m, -0.5000 of 70 m; velocity error = −v' in said


HOSTILE = '[/bold] [red]$\\frac$ :smile:'


def test_names_are_printed_as_they_are(tmp_path, monkeypatch):
    """A name like `[/bold]` was markup: a traceback."""
    monkeypatch.chdir(tmp_path)
    path = tmp_path / '[' / 'bold].yaml'
    path.parent.mkdir()
    shipped = load_controller('handmade')
    path.write_text(dumps(replace(shipped, name=HOSTILE, description=f'{HOSTILE}\n\tmore')))
    done = run('[/bold].yaml')
    assert done.exit_code == 0 and HOSTILE in done.output
    scenario = tmp_path / 'mine.yaml'
    text = files.find('scenario', 'quick').read_text()
    scenario.write_text(text.replace('name: quick', f"name: '{HOSTILE}'"))
    for words in (['simulate', '[/bold].yaml'], ['report', '[/bold]'], ['report', 'a\x1b[2J']):
        assert refused(*words).rstrip().isprintable()
    arguments = ['simulate', 'mine.yaml', '--controller', '[/bold].yaml']
    assert '[/bold].yaml' in invoke(*arguments).output


def broken(tmp_path):
    """Return a file whose rules push away from the target at rest."""
    shipped = load_controller('handmade')
    codes = shipped.system.rules.codes.copy()
    codes[2, 1], codes[2, 3] = 3, 1
    system = replace(shipped.system, rules=RuleTable.from_codes(codes))
    path = tmp_path / 'broken.yaml'
    path.write_text(dumps(replace(shipped, name='broken', system=system)))
    return path


def test_an_instant_of_a_run_is_explained_with_the_bits_of_the_log(folder):
    path, flight = folder
    done = run(path, '--at', 3.7)
    assert done.exit_code == 0
    assert 'tick 37, 3.7 s' in done.stdout and 'the same, bit for bit' in done.stdout
    for decision in decisions(load_controller('handmade'), flight.states[37]):
        assert decision.reasons.sentence in done.stdout
    assert 'tick 37, 3.7 s' in run(path / 'run.mcap', '--at', 3.79).stdout


def test_one_command_explains_the_default_a_run_and_its_controller_at_any_state(folder):
    assert run().stdout == run('allround').stdout
    assert 'tick 0, 0 s' in run(folder[0]).stdout
    state = ('--state', '10,60,-40,0,0,0')
    assert run(folder[0], *state).stdout == run('handmade', *state).stdout != run(*state).stdout


def test_a_force_that_the_controller_does_not_give_is_told(folder, tmp_path):
    scenario = folder[1].scenario
    base = TimeBase(scenario.epoch_ns, scenario.dt_ns, scenario.ticks)

    def change(topic, tick, data):
        if topic != FORCE or tick != 20:
            return data
        other = folder[1].forces_n[20] + [0.0, 0.001, 0.0]
        return messages.wrench(base.stamp_ns(20), 'target_lvlh', other.tolist())

    rewrite(folder[0] / 'run.mcap', tmp_path / 'run.mcap', change)
    assert run(tmp_path / 'run.mcap', '--at', 1.9).exit_code == 0
    done = run(tmp_path / 'run.mcap', '--at', 2.0)
    assert done.exit_code == 1 and 'The logged force differs' in done.stdout


@pytest.mark.parametrize(
    ('arguments', 'message'),
    [
        (['--certify'], '`--certify` takes one controller'),
        (['--at', '5.5'], '`--at` must be within the log, 0 to 5 s; got 5.5'),
        (['--at', '-1'], '`--at` must be within the log'),
    ],
)
def test_what_does_not_go_with_a_log_is_a_sentence(arguments, message, folder):
    assert message in refused('explain', folder[0], *arguments)


@pytest.mark.parametrize('topic', ['body_force', 'reference_attitude', 'estimated_disturbance'])
def test_a_message_that_is_lost_is_named(topic, tmp_path):
    """A command that was lost was printed as `nan`, and the force of the log as another one."""
    flown = load_scenario('tumbling_docking')
    opposed = replace(flown.section(Estimator), compensate=True, disturbance_sigma_n=0.01)
    made = chain_run(replace(flown.equipped(opposed), duration_s=1.0), load_controller('handmade'))
    made.write(tmp_path, [m for m in made.messages if m[:2] != (f'/{topic}', 4)])
    done = run(tmp_path, '--at', 0.4)
    assert 'nan' not in done.output, done.output
    if topic == 'estimated_disturbance':
        assert done.exit_code == 2 and 'does not hold what the controller read' in done.stderr
    else:
        assert done.exit_code == 0 and f'The log holds no {topic} for this tick.' in done.stdout


@pytest.mark.parametrize('more', [[], ['--state', '0.1,0,0,0,0,0']])
def test_a_controller_of_attitude_is_explained_in_its_words(more):
    done = invoke('explain', 'attitude_fuzzy', *more)
    assert done.exit_code == 0, done.output
    assert {'attitude', 'rate', 'torque', 'rad'} <= set(re.findall(r'[a-z]+', done.output))
    rest = done.output.replace('N m', '')
    assert not re.search(r'position|velocity|force|\b(m|m/s|N)\b', rest), rest
