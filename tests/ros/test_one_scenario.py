# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""One scenario in a run: the plant says it, the others take it, a node of another one refuses."""

import re

import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from flights import assert_flown, lasting, one_process
from inside import inside
from typer.testing import CliRunner

from rpo_cli.cli import app
from rpo_core import files
from rpo_core.chain.flight import fly
from rpo_core.control.controller import load_controller
from rpo_core.files import scenario
from rpo_core.files.scenario import ScenarioSet, load_scenario
from rpo_core.wire import interfaces
from rpo_log.tools.diff import diff
from rpo_log.verify import verify
from rpo_mcap.read.run_log import read_run
from rpo_ros import conversions, qos
from tools.node_processes import node_processes


@pytest.mark.every_landing
def test_only_the_plant_is_told_what_to_fly(ros):
    """Navigation, controller and injector start first and know nothing of the scenario."""
    output = ros.folder / 'run'
    peers = [
        ros.node('rpo_sim', 'disturbance_injector'),
        ros.node('rpo_ctrl', 'rival_controller', controller='mpc'),
        ros.node('rpo_log', 'recorder', output=str(output)),
    ]
    plant = ros.node('rpo_sim', 'plant', scenario='quick', wait_for_recorder='true')
    assert plant.wait() == 0, plant.output
    assert peers[-1].wait() == 0, peers[-1].output
    assert 'disturbing as in quick' in peers[0].output
    assert_flown(output, fly(load_scenario('quick'), load_controller('mpc')), 'controller')
    assert read_run(output).outcome == 'finished'


@pytest.mark.parametrize(
    'node', ['fuzzy_controller', pytest.param('disturbance_injector', marks=pytest.mark.slow)]
)
def test_a_node_of_another_scenario_refuses_and_nothing_flies(ros, node):
    package = 'rpo_ctrl' if node == 'fuzzy_controller' else 'rpo_sim'
    plant = ros.node('rpo_sim', 'plant', scenario='approach')
    started = ros.node(package, node, scenario='paper_test')
    assert started.wait() == 2
    said = '`scenario` must be the one of the plant, approach; got paper_test'
    assert started.output.count(said) == 1 and 'Traceback' not in started.output
    assert plant.wait() == 3, plant.output
    assert said in plant.output and 'flying' not in plant.output


@pytest.mark.every_landing
def test_the_same_name_with_another_content_is_told_apart(ros):
    changed = ros.folder / 'approach.yaml'
    text = files.find('scenario', 'approach').read_text()
    changed.write_text(text.replace('mass_kg: 10.0', 'mass_kg: 11.0'))
    plant = ros.node('rpo_sim', 'plant', scenario='approach')
    controller = ros.node('rpo_ctrl', 'fuzzy_controller', scenario=str(changed))
    assert controller.wait() == 2
    assert 'got approach with other content' in controller.output
    assert plant.wait() == 3


def refusal(node):
    """Return the status of a node that takes no part."""
    values = {'stage': node, 'state': 'refused', 'tick': '0', 'reason': 'so'}
    return conversions.to_status(b'\x01', node, 'so', values.items())


@pytest.mark.slow
def test_in_flight_a_refusal_is_a_warning(ros, tmp_path):
    """A controller of another scenario that came late ended the flight of the others."""
    path = lasting(30.0, tmp_path, 'paper_test')
    ros.node('rpo_ctrl', 'fuzzy_controller', controller='handmade')
    ros.node('rpo_sim', 'disturbance_injector')
    recorder = ros.node('rpo_log', 'recorder', output=str(tmp_path / 'run'))
    plant = ros.node(
        'rpo_sim', 'plant', scenario=path, wait_for_recorder='true', real_time_factor=4.0
    )
    plant.says('flying')
    late = ros.node(
        'rpo_ctrl', 'fuzzy_controller', remap={'__node': 'late'}, controller='lqr',
        scenario='approach',
    )  # fmt: skip
    with inside() as inner:
        out = inner.user.create_publisher(DiagnosticStatus, interfaces.STAGE_STATUS, qos.LATCHED)
        inner.until(lambda: out.get_subscription_count() > 1)
        for name in ('nobody', 'user', 'recorder'):
            out.publish(refusal(name))
        assert late.wait() == 2, late.output
        inner.set('plant', real_time_factor=0.0)
        assert plant.wait() == 0, plant.output
    assert 'late takes no part: `scenario` must be the one of the plant' in plant.output
    assert 'the flight goes on' in plant.output and 'nobody' not in plant.output
    assert 'user takes no part' not in plant.output, 'it neither publishes nor hears a signal'
    assert recorder.wait() == 0, recorder.output
    assert_flown(tmp_path / 'run', fly(load_scenario(path), load_controller('handmade')))


@pytest.mark.slow
def test_a_node_of_another_flight_does_not_keep_this_one_from_beginning(ros):
    shared = {f'/other/{name}': f'/{name}' for name in ('stage_status', 'node_manifest')}
    ros.node('rpo_ctrl', 'fuzzy_controller', controller='handmade')
    ros.node('rpo_sim', 'disturbance_injector')
    other = ros.node(
        'rpo_ctrl', 'rival_controller', scenario='approach', remap={'__ns': '/other', **shared}
    )
    other.says('controlling with')
    plant = ros.node('rpo_sim', 'plant', scenario='quick')
    assert other.wait() == 2, other.output
    assert plant.wait() == 0, plant.output


# Every shipped scenario: flown by its nodes, verified, reported.


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize('name', sorted(files.shipped('scenario')))
def test_a_shipped_scenario_is_flown_verified_and_reported(name, ros_env, tmp_path, monkeypatch):
    found, flown = scenario.load(name), name
    if isinstance(found, ScenarioSet):  # one start of a set is flown at a time
        path = tmp_path / f'{name}.yaml'
        path.write_text(scenario.dumps(found.farthest))
        flown = str(path)
    monkeypatch.delenv('RPO_JIT')
    env = {key: value for key, value in ros_env.items() if key != 'RPO_JIT'}
    controller = 'allround'
    if name == 'apollo':  # thirty tons, as their scenario says
        controller = str(tmp_path / 'scaled.yaml')
        scaled = CliRunner().invoke(app, ['scale', 'pd', '--scenario', name, '-o', controller])
        assert scaled.exit_code == 0, scaled.output
    with node_processes(env, tmp_path) as ros:
        folder = one_process(ros, flown, '--controller', controller, deadline_s=600.0)
    verified = verify(folder)
    assert verified.exit_code == 0, verified.sentence()
    alone = ['simulate', flown, '--controller', controller, '-o', str(tmp_path / 'alone')]
    alone.append('--no-fail')
    assert CliRunner().invoke(app, alone).exit_code == 0
    _, *differ = diff(folder, tmp_path / 'alone').lines()
    assert differ == ['parameters.yaml differs']
    reported = CliRunner().invoke(app, ['report', str(folder)], env={'COLUMNS': '200'})
    assert reported.exit_code == 0, reported.output
    page = (folder / 'report/report.html').read_text(encoding='utf-8')
    assert found.name in page and not re.search(r'>[^<]*\bnan\b', page)
