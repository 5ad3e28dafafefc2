# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""One scenario in a run: the plant says it, the others take it, a node of another one refuses."""

import re

import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from flights import assert_flown, lasting, one_process
from invoking import invoke
from node_processes import node_processes

from rpo_core import files
from rpo_core.chain.flight import fly
from rpo_core.control.controller import load_controller
from rpo_core.scenario import scenario
from rpo_core.scenario.scenario import ScenarioSet, load_scenario
from rpo_core.wire import interfaces
from rpo_ctrl.fuzzy_controller_node import ControllerNode
from rpo_ctrl.rival_controller_node import ControllerNode as RivalNode
from rpo_log.tools.diff import diff
from rpo_log.verify import verify
from rpo_ros import qos, signals
from rpo_sim.disturbance_injector_node import DisturbanceInjectorNode
from rpo_sim.plant_node import PlantNode


@pytest.mark.parametrize(
    ('kind', 'other', 'named'),
    [
        (ControllerNode, 'paper_test', 'paper_test'),
        (DisturbanceInjectorNode, 'paper_test', 'paper_test'),
        (ControllerNode, '', 'approach with other content'),
    ],
)
def test_a_node_of_another_scenario_refuses_and_nothing_flies(
    inner, tmp_path, capfd, kind, other, named
):
    plant = inner.start(PlantNode({'scenario': 'approach'}))
    other = other or lasting(400.0, tmp_path, mass_kg=11.0)
    node = inner.start(kind({'scenario': other}))
    inner.until(lambda: plant.done and node.done)
    assert (plant.exit_code, node.exit_code) == (3, 2)
    said = f'`scenario` must be the one of the plant, approach; got {named}'
    by_node, by_plant = [line for line in capfd.readouterr().err.splitlines() if said in line]
    assert f'[{node.get_name()}]: ' in by_node and 'aborted at tick 0' in by_plant


def refusal(node):
    """Return the status of a node that takes no part."""
    values = {'stage': node, 'state': 'refused', 'tick': '0', 'reason': 'so'}
    return signals.to_status(b'\x01', node, 'so', values.items())


@pytest.mark.every_landing
def test_in_flight_a_refusal_is_a_warning(inner, tmp_path, capfd):
    """A controller of another scenario that came late ended the flight of the others."""
    path, run = lasting(30.0, tmp_path, 'paper_test'), tmp_path / 'run'
    inner.fly(run, path, DisturbanceInjectorNode, real_time_factor=4.0)
    inner.reaches(1)
    late = inner.start(RivalNode({'controller': 'lqr', 'scenario': 'approach'}))
    out = inner.publisher(DiagnosticStatus, interfaces.STAGE_STATUS, qos.LATCHED)
    inner.until(lambda: out.get_subscription_count() > 1)
    for name in ('nobody', 'user', 'recorder'):
        out.publish(refusal(name))
    inner.until(lambda: late.done)
    assert late.exit_code == 2
    inner.set('plant', real_time_factor=0.0)
    assert inner.ends() == 0
    said = capfd.readouterr().err
    assert 'rival_controller takes no part: `scenario` must be the one of the plant' in said
    assert 'the flight goes on' in said and 'nobody' not in said
    assert 'user takes no part' not in said, 'it neither publishes nor hears a signal'
    assert_flown(run, fly(load_scenario(path), load_controller('handmade')))


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
        scaled = invoke('scale', 'pd', '--scenario', name, '-o', controller)
        assert scaled.exit_code == 0, scaled.output
    with node_processes(env, tmp_path) as ros:
        folder = one_process(ros, flown, '--controller', controller)
    verified = verify(folder)
    assert verified.exit_code == 0, verified.sentence()
    alone = tmp_path / 'alone'
    words = ('simulate', flown, '--controller', controller, '-o', alone, '--no-fail')
    assert invoke(*words).exit_code == 0
    _, *differ = diff(folder, alone).lines()
    assert differ == ['parameters.yaml differs']
    reported = invoke('report', folder)
    assert reported.exit_code == 0, reported.output
    page = (folder / 'report/report.html').read_text(encoding='utf-8')
    assert found.name in page and not re.search(r'>[^<]*\bnan\b', page)
