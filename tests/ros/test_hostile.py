# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What somebody else publishes in the middle of a flight: it changes no byte, and ends no node."""

import errno
import math
from functools import partial

import pytest
import yaml
from diagnostic_msgs.msg import DiagnosticStatus
from flights import lasting, told
from geometry_msgs.msg import WrenchStamped
from nav_msgs.msg import Odometry

from rpo_bringup import final_approach
from rpo_core import files
from rpo_core.wire import interfaces
from rpo_core.wire.statuses import RecorderStatus
from rpo_ctrl.fuzzy_controller_node import ControllerNode
from rpo_log import provenance
from rpo_log.errors import ExitCode, LogError
from rpo_log.read.run_log import read_run
from rpo_log.recorder_node import RecorderNode
from rpo_log.verify import verify
from rpo_log.write import mcap_file
from rpo_ros import qos, signals
from rpo_ros.signals import hear
from rpo_sim.disturbance_injector_node import DisturbanceInjectorNode
from rpo_sim.plant_node import PlantNode

LASTING_S = 20.0


def flying(inner, folder, output='run', **options):
    """Start plant, controller, injector and recorder."""
    scenario = lasting(LASTING_S, folder, 'paper_test')
    inner.fly(folder / output, scenario, DisturbanceInjectorNode, **options)


def message(plant, name, tick, values):
    """Return the bytes of a signal."""
    return interfaces.row_of(name).layout.encode(plant.scenario.stamp_ns(tick), values)


def status(**values):
    return signals.to_status(b'\x00', 'run', 'of somebody else', values.items())


def talk(inner):
    """Publish what a flight must not care about."""
    force = inner.publisher(WrenchStamped, interfaces.CONTROL_FORCE).publish
    state = inner.publisher(Odometry, interfaces.RELATIVE_STATE).publish
    said, manifest, refusal = (
        inner.publisher(DiagnosticStatus, name, qos.LATCHED).publish
        for name in (interfaces.RUN_STATUS, interfaces.NODE_MANIFEST, interfaces.STAGE_STATUS)
    )
    plant = inner.plant
    wrench = partial(message, plant, interfaces.CONTROL_FORCE)
    for turn in range(8):
        inner.reaches(plant.tick + 2)
        for ahead in (30, 31, 170 - plant.tick):
            force(wrench(plant.tick + ahead, (0.1, 0.2, 0.3)))
            force(wrench(plant.tick + ahead, (0.3, turn * 0.1, 0.3)))
            state(message(plant, interfaces.RELATIVE_STATE, plant.tick + ahead, [1.0] * 6))
        force(wrench(plant.tick, (math.nan, 0.0, 0.0)))
        force(wrench(plant.tick, (9.0, 9.0, 9.0)).replace(b'target_lvlh', b'chaser_lvlh'))
        force(wrench(plant.tick - 10, (9.0, 9.0, 9.0)))
        said(status(phase='finished', tick='30', distance_m='1.0', speed_m_s='0.0'))
        refusal(status(stage='fuzzy_controller', state='refused', tick='0', reason='no'))
        text = files.read_text(files.find('scenario', 'quick'))
        manifest(status(role='plant', run='another', **{'file.scenario.yaml': text}))
        manifest(status(role='odd', **{'file.controller.yaml': 'x', 'parameter.a': '!!int ""'}))


def test_what_others_say_in_flight_changes_no_byte(straight, inner, tmp_path, capfd):
    """Also where a second plant begins; and a second recorder in sight is awaited."""
    flying(inner, tmp_path, real_time_factor=20.0)
    other = inner.start(RecorderNode({'output': str(tmp_path / 'other')}))
    inner.reaches(10)
    talk(inner)
    second = inner.start(PlantNode({'scenario': 'quick'}))
    inner.reaches(60)
    assert second.phase == 'waiting', 'the recorder is not for it'
    inner.set('plant', real_time_factor=0.0)
    assert inner.ends() == 0
    inner.until(lambda: other.done)
    for recorder in (inner.recorder, other):
        clean = (straight / 'run.mcap').read_bytes()
        assert (recorder.folder / 'run.mcap').read_bytes() == clean
        info = yaml.safe_load((recorder.folder / 'run_info.yaml').read_text())
        assert info['run']['end'] == 'finished' and info['faults'] is None
        counted = info['ignored']
        assert {'not_finite', 'wrong_frame', 'run_status', 'node_manifest'} <= set(counted)
        assert 60 < sum(counted.values()) <= recorder._health()[2]['ignored']
    assert capfd.readouterr().err.count('is a second plant') == 2


@pytest.mark.every_landing
def test_two_controllers_at_a_time_are_named(inner, tmp_path, capfd):
    """By the plant, the last status of the recorder, and verify."""
    said = []
    hear(inner.user, RecorderStatus, said.append)
    flying(inner, tmp_path, real_time_factor=40.0)
    inner.reaches(20)
    second = inner.start(ControllerNode({'controller': 'paper_ga'}))
    assert inner.ends() == 1 and second.answered and inner.plant.exit_code == 0
    twice = 'control_force is published by /fuzzy_controller 2 times'
    assert twice in capfd.readouterr().err
    found = verify(tmp_path / 'run')
    assert found.exit_code == ExitCode.INCOMPLETE and found.difference is None
    assert 'messages of /control_force differ from the first of their tick' in found.gaps[-1]
    inner.until(lambda: said[-1].says == 'closed')
    assert said[-1].reason == found.gaps[-1]
    log = read_run(tmp_path / 'run')
    assert {'controller.yaml', 'controller-2.yaml'} <= set(log.attachments)
    assert len(log.ticks) == 201 and not log.gaps


@pytest.fixture
def full(monkeypatch):
    """Return a function that makes the disk full for files of a name."""

    def fill(name):
        flush = mcap_file._Sink.flush

        def fails(sink):
            if sink.file.name.endswith(name):
                raise OSError(errno.ENOSPC, 'No space left on device')
            flush(sink)

        monkeypatch.setattr(mcap_file._Sink, 'flush', fails)

    return fill


def test_a_disk_that_is_full_as_the_log_begins(inner, tmp_path, full, capfd):
    full('run.mcap')
    flying(inner, tmp_path)
    assert inner.ends() == 1
    assert inner.plant.exit_code == 3
    said = capfd.readouterr().err
    assert 'the recorder failed: ' in said and 'No space left on device' in said
    assert 'Traceback' not in said


def test_without_a_need_for_a_log_the_plant_flies_on(inner, tmp_path, full):
    full('run.mcap')
    flying(inner, tmp_path, wait_for_recorder=False)
    assert inner.ends() == 1
    assert inner.plant.exit_code == 0 and inner.plant.phase == 'finished'


def test_a_run_info_that_cannot_be_written_is_no_success(inner, tmp_path, monkeypatch, capfd):
    def fails(folder, facts):
        raise LogError(folder, 'cannot hold a log: No space left on device')

    monkeypatch.setattr(provenance, 'write_run_info', fails)
    flying(inner, tmp_path)
    assert inner.ends() == 1
    assert 'cannot hold a log: No space left on device' in capfd.readouterr().err


@pytest.mark.every_landing
def test_final_approach_without_a_place_for_its_log(command, tmp_path, full):
    full('')
    words = ('--scenario', 'quick', '--output', tmp_path / 'run')
    code, said = command(final_approach.main, *words)
    assert code == 1, said
    assert 'No space left on device' in said and 'simulated' not in said
    assert 'Traceback' not in said


def test_another_controller_in_flight_is_recorded_and_verified(inner, tmp_path):
    flying(inner, tmp_path, real_time_factor=20.0)
    inner.reaches(20)
    assert inner.transition('/fuzzy_controller', 'deactivate')
    assert inner.set('/fuzzy_controller', controller='paper_ga')[0]
    inner.reaches(40)
    assert inner.transition('/fuzzy_controller', 'activate')
    inner.set('plant', real_time_factor=0.0)
    assert inner.ends() == 0
    found = verify(tmp_path / 'run')
    assert found.exit_code == 0, found.sentence()
    first, second = found.controllers
    assert first.startswith('handmade (controller.yaml) at ')
    assert second.startswith('paper_ga (controller-2.yaml) at ')
    parameters = {'controller.yaml', 'controller-2.yaml', 'parameters.yaml', 'scenario.yaml'}
    log = read_run(tmp_path / 'run')
    assert set(log.attachments) == parameters
    (_, off, since), (_, on, _) = told(log)
    assert (off, on) == ('inactive', 'active') and since > 20
