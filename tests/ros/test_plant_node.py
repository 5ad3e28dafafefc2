# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The plant as a node: both modes, the hand on the simulator; all nodes in the test's process."""

import os
import re
import subprocess
import sys
import time

import pytest
import yaml
from diagnostic_msgs.msg import DiagnosticStatus
from flights import lasting
from inside import Hand, values_of

from rpo_core import files
from rpo_core.wire import interfaces
from rpo_core.wire.statuses import Manifest
from rpo_core.world.zones import Zone
from rpo_ctrl.assurance_node import AssuranceNode
from rpo_ctrl.fuzzy_controller_node import ControllerNode
from rpo_ctrl.guidance_node import GuidanceNode
from rpo_log.read.run_log import read_run
from rpo_log.recorder_node import RecorderNode
from rpo_log.verify import verify
from rpo_ros import plant_scenario, qos
from rpo_ros.plant_scenario import PlantScenario
from rpo_ros.running import FlightNode
from rpo_ros.signals import Outlet, listen, message_class
from rpo_sim.disturbance_injector_node import DisturbanceInjectorNode
from rpo_sim.plant_node import EXIT_ABORTED, EXIT_MISSED, PlantNode


class Bench(Hand):
    """A hand on a flight of 20 s of `approach`."""

    def __init__(self, inner, folder):
        super().__init__(inner)
        self.folder = folder
        self.scenario = lasting(20.0, folder)

    def start(self, output='', **parameters):
        """Start controller, plant and perhaps a recorder."""
        self.controller = self.inner.start(ControllerNode({'controller': 'handmade'}))
        parameters |= {'scenario': self.scenario, 'wait_for_recorder': bool(output)}
        self.plant = self.inner.start(PlantNode(parameters))
        if output:
            self.record(output)

    def record(self, output):
        """Start a recorder."""
        self.recorder = self.inner.start(RecorderNode({'output': str(self.folder / output)}))

    def ends(self):
        """Wait until plant and recorder are done; return their exit codes."""
        self.until(lambda: self.plant.done and self.recorder.done)
        return self.plant.exit_code, self.recorder.exit_code

    def gone(self, node):
        """Let a node hear and say nothing more."""
        self.inner.executor.remove_node(node)

    def back(self, node):
        """Let it take part again, without what it has not heard: else it may stay one behind."""
        for heard in node.subscriptions:
            while heard.handle.take_message(heard.msg_type, True) is not None:
                pass
        self.inner.executor.add_node(node)


@pytest.fixture
def bench(inner, tmp_path):
    return Bench(inner, tmp_path)


def test_paused_stepped_and_sped_up_it_leaves_the_same_bytes(straight, bench):
    bench.scenario = lasting(20.0, bench.folder, 'paper_test')
    bench.inner.start(DisturbanceInjectorNode())
    bench.start('steered', real_time_factor=10.0, peer_timeout_s=1.0)
    bench.says('flying')
    assert bench.trigger('step').message == 'not paused: pause first'
    bench.gone(bench.controller)
    bench.passes(0.2)  # the plant waits for an answer
    assert bench.pause().success
    tick = bench.plant.tick
    bench.passes(1.2)  # longer than it waits for a peer
    assert bench.inner.set('plant', step_ticks=3)[0]
    assert bench.trigger('step').success
    bench.passes(0.1)  # a pause times out no peer
    bench.back(bench.controller)
    bench.until(lambda: bench.plant.tick == tick + 3 and not bench.plant.steps)
    assert not bench.inner.set('plant', real_time_factor=-1.0)[0]
    assert bench.inner.set('plant', real_time_factor=0)[0]
    assert bench.plant.tick == tick + 3
    assert bench.pause(False).success
    assert bench.ends() == (0, 0)
    steered = (bench.folder / 'steered/run.mcap').read_bytes()
    assert steered == (straight / 'run.mcap').read_bytes()


def test_the_time_to_start_begins_when_the_nodes_run(bench):
    """The nodes of a process are made after its plant, which takes long on a busy machine."""
    bench.plant = bench.inner.start(PlantNode({'scenario': bench.scenario, 'start_timeout_s': 3.0}))
    time.sleep(3.5)
    bench.passes(0.5)
    assert bench.plant.phase == 'waiting'
    bench.until(lambda: bench.plant.phase == 'aborted')


def test_a_flight_that_takes_long_says_how_far_it_is(bench, monkeypatch, capfd):
    monkeypatch.setattr('rpo_sim.plant_node._LOG_S', 0.2)
    bench.start(real_time_factor=10.0)
    bench.until(lambda: bench.plant.done)
    lines = re.findall(r'\[plant\]: at ([\d.]+) s of 20 s', capfd.readouterr().err)
    assert lines and lines == sorted(lines, key=float)


@pytest.mark.parametrize('mode', ['lockstep', 'free_running'])
def test_no_state_is_in_the_future_of_a_node_with_simulated_time(bench, mode):
    viewer, ahead_ns = bench.inner.start(FlightNode('viewer', {'use_sim_time': True})), []

    def take(stamp_ns, _):
        now_ns = viewer.get_clock().now().nanoseconds
        if now_ns:  # it hears /clock
            ahead_ns.append(stamp_ns - now_ns)

    listen(viewer, interfaces.RELATIVE_STATE, take, pytest.fail)
    bench.start(mode=mode, real_time_factor=20.0)
    bench.until(lambda: bench.plant.done)
    assert len(ahead_ns) > 100 and max(ahead_ns) <= 0


@pytest.mark.parametrize('simulated', [True, False])
def test_health_has_the_time_of_the_node_that_says_it(bench, simulated):
    """As with diagnostic_updater: of /clock with `use_sim_time`, else of the wall."""
    bench.start(real_time_factor=10.0, use_sim_time=simulated)
    bench.says('flying')
    bench.health.clear()
    said_s, _ = bench.until(lambda: bench.health.get('plant'))[-1]
    flown_s = said_s - 1e-9 * bench.plant.scenario.epoch_ns
    assert (0.0 <= flown_s <= 20.0) == simulated
    assert (abs(said_s - time.time()) < 60.0) != simulated


def test_a_zone_that_is_entered_is_said_at_once_and_at_the_end(bench, monkeypatch, capfd):
    """Once when it is entered, and with the depth when the flight is over; the log verifies."""
    monkeypatch.setattr('rpo_sim.plant.zones_of', lambda _: [Zone(1000.0, name='assurance')])
    bench.start('entered')
    entered = bench.says('inside the keep-out sphere of 1000 m of `assurance`')
    assert entered.level == DiagnosticStatus.WARN
    assert bench.ends() == (EXIT_MISSED, 0)
    assert re.match(r'reached the last tick; \d+ m inside the keep-out', bench.statuses[-1].message)
    assert len([status for status in bench.statuses if 'inside' in status.message]) == 2
    assert re.search(r'MISSED: \d+ m inside the keep-out sphere', capfd.readouterr().err)
    assert verify(bench.folder / 'entered').exit_code == 0


@pytest.mark.parametrize('topic', ['control_force', 'relative_state'])
@pytest.mark.parametrize('name', ['intruder', 'fuzzy_controller'])
def test_a_second_publisher_of_a_topic_of_the_flight_is_named(bench, topic, name, capfd):
    intruder = bench.inner.start(FlightNode(name))
    rightful = '/fuzzy_controller' if topic == 'control_force' else '/plant'
    bench.start(real_time_factor=10.0)
    bench.says('flying')
    row = interfaces.row_of(topic)
    out = intruder.create_publisher(message_class(row.type), topic, qos.LOCKSTEP)
    bench.health.clear()
    error = bench.until(lambda: [s for _, s in bench.health.get('plant', ()) if s.level == b'\2'])
    nodes = values_of(error[-1])[f'publishers_of_{topic}']
    if f'/{name}' == rightful:
        assert nodes.startswith(f'{rightful} 2 times (')
    else:
        assert nodes == ' and '.join(sorted((rightful, f'/{name}')))
    assert f'[plant]: /{topic} is published by {nodes}; it must have one' in capfd.readouterr().err
    intruder.destroy_publisher(out)
    bench.health.clear()
    bench.until(lambda: [s for _, s in bench.health.get('plant', ()) if s.level == b'\0'])
    bench.until(lambda: bench.plant.done)
    assert bench.plant.exit_code == 0 and 'is published by' not in capfd.readouterr().err


def test_reset_closes_the_log_and_begins_another_run_at_tick_0(bench):
    bench.start('first', real_time_factor=10.0)
    bench.until(lambda: bench.plant.tick > 5)
    assert bench.trigger('reset').success
    assert bench.says('reset').level == DiagnosticStatus.WARN
    bench.until(lambda: bench.recorder.done)
    first = read_run(bench.folder / 'first')
    assert (bench.recorder.exit_code, first.outcome) == (0, 'aborted') and 0 < first.ticks[-1] < 200
    assert verify(bench.folder / 'first').difference is None
    bench.record('second')
    bench.until(lambda: bench.plant.phase == 'running' and bench.plant.tick < 5)
    bench.inner.set('plant', real_time_factor=0.0)
    assert bench.ends() == (0, 0)
    assert bench.plant.phase == 'finished'
    assert verify(bench.folder / 'second').exit_code == 0


@pytest.mark.parametrize('mode', ['lockstep', 'free_running'])
def test_abort_says_so_in_the_exit_code_and_in_the_log(bench, mode):
    bench.start('run', real_time_factor=10.0, mode=mode)
    bench.says('flying')
    assert bench.trigger('abort').success
    assert bench.says('abort requested').level == DiagnosticStatus.ERROR
    assert bench.ends() == (EXIT_ABORTED, 0)
    assert read_run(bench.folder / 'run').outcome == 'aborted'
    assert bench.trigger('step').message == 'no run in progress: aborted'


def test_before_the_flight_there_is_nothing_to_steer(bench):
    bench.plant = bench.inner.start(PlantNode({'scenario': bench.scenario}))
    for answer in (bench.pause(), bench.trigger('step'), bench.trigger('reset')):
        assert (answer.success, answer.message) == (False, 'no run in progress: waiting')


def test_a_pause_in_free_running_makes_no_force_stale(bench):
    bench.start('run', mode='free_running', real_time_factor=4.0, stale_after_ticks=5)
    bench.until(lambda: bench.plant.tick > 5)
    bench.pause()
    tick = bench.plant.tick
    bench.passes(0.6)  # 24 ticks
    assert bench.plant.tick == tick
    assert bench.inner.set('plant', step_ticks=5)[0] and bench.trigger('step').success
    bench.until(lambda: bench.plant.tick == tick + 5 and not bench.plant.steps)
    bench.pause(False)
    bench.until(lambda: bench.plant.tick > tick + 10)
    assert bench.plant.plant.stale_ticks == 0
    bench.trigger('abort')
    bench.ends()
    assert verify(bench.folder / 'run').difference is None


@pytest.mark.parametrize('mode', ['lockstep', 'free_running'])
def test_a_state_that_would_not_be_finite_ends_the_run_with_its_cause(bench, mode):
    bench.scenario = lasting(20.0, bench.folder, 'paper_test')
    out = Outlet(bench.inner.user, interfaces.DISTURBANCE_FORCE)

    def disturb(stamp_ns, state):
        out.publish(stamp_ns, (0.0, 1e308 if bench.plant.tick >= 5 else 0.0, 0.0))

    listen(bench.inner.user, interfaces.RELATIVE_STATE, disturb, print)
    bench.start(mode=mode, real_time_factor=10.0)
    status = bench.says('would not be finite')
    values = values_of(status)
    assert values['phase'] == 'aborted' and int(values['tick']) >= 5
    cause = f'because of disturbance_force (0, 1e+308, 0) at tick {values["tick"]}'
    assert cause in status.message
    bench.until(lambda: bench.plant.done)
    assert bench.plant.exit_code == EXIT_ABORTED


# The scenario of a plant does not change while it is there, nor within its run.

QUICK, DOCKING = (files.read_text(files.find('scenario', n)) for n in ('quick', 'docking'))


def manifest(run: str, text: str, mode: str = 'lockstep') -> Manifest:
    values = {plant_scenario.SCENARIO_FILE: text, 'parameter.mode': mode}
    return Manifest('plant', 'plant', run, values)


BARE = """
import sys
from rpo_ros import plant_scenario
plant_scenario.hear = lambda *_: None
heard = plant_scenario.PlantScenario(None, '', id, print, bare=True)
heard._on_manifest(plant_scenario.Manifest('plant', 'plant', '', {
    plant_scenario.SCENARIO_FILE: sys.stdin.read(), 'parameter.mode': 'lockstep'}))
assert heard.scenario.name == 'tumbling_docking' and not heard.scenario.sections
import rpo_sim.disturbance_injector_node, rpo_sim.fault_injector_node
print(*sys.modules)
"""


def test_a_node_that_needs_no_section_imports_none_nor_numba(ros_env):
    """It took 4 s of CPU time until its first answer, on paper_test too."""
    text = files.read_text(files.find('scenario', 'tumbling_docking'))
    said = subprocess.run(
        [sys.executable, '-c', BARE], input=text, capture_output=True, text=True, timeout=60,
        env={**os.environ, **ros_env}, check=True,
    ).stdout.split()  # fmt: skip
    parts = ('assurance', 'guidance', 'navigation', 'attitude')
    assert not {'numba', *(f'rpo_core.{part}' for part in parts)} & set(said)


def test_with_a_plug_in_the_injector_reads_all_sections(monkeypatch, inner):
    assert inner.start(DisturbanceInjectorNode())._run.bare
    monkeypatch.setenv('RPO_PLUGINS', 'json')
    assert not inner.start(DisturbanceInjectorNode())._run.bare


def test_of_a_plan_that_cannot_be_flown_guidance_alone_says_so(inner):
    """The plant of somebody else may not have tried it; other nodes leave that to it."""
    document = files.parse_yaml(DOCKING)
    document['guidance']['force_share'] = 0.05
    hasty = manifest('one', yaml.safe_dump(document))
    nodes = [inner.start(kind()) for kind in (GuidanceNode, AssuranceNode, ControllerNode)]
    for node in nodes:
        node._run._on_manifest(hasty)
    assert [node.exit_code for node in nodes] == [2, 0, 0]


@pytest.mark.parametrize('silent_s', [0.0, 10.0])
@pytest.mark.parametrize(
    'forged',
    [manifest('one', QUICK, 'free_running'), manifest('one', DOCKING), manifest('one', QUICK, '')],
)
def test_within_a_run_nothing_changes(forged, silent_s, monkeypatch):
    now, taken, refused = [100.0], [], []
    monkeypatch.setattr(plant_scenario, 'hear', lambda *_: None)
    monkeypatch.setattr(plant_scenario.time, 'monotonic', lambda: now[0])
    heard = PlantScenario(None, '', taken.append, refused.append)
    heard._on_manifest(manifest('one', QUICK))
    assert [found.name for found in taken] == ['quick'] and not heard.free_running
    now[0] += silent_s
    heard._on_manifest(forged)
    heard._on_manifest(manifest('one', QUICK))
    assert len(taken) == 1 and not heard.free_running and not refused


def test_another_plant_is_followed_once_the_first_is_silent(monkeypatch):
    now, taken = [100.0], []
    monkeypatch.setattr(plant_scenario, 'hear', lambda *_: None)
    monkeypatch.setattr(plant_scenario.time, 'monotonic', lambda: now[0])
    heard = PlantScenario(None, '', taken.append, print)
    for silent_s, found in ((0.0, manifest('one', QUICK)), (1.0, manifest('two', DOCKING)),
                            (1.0, manifest('two', QUICK, 'free_running'))):  # fmt: skip
        now[0] += silent_s
        heard._on_manifest(found)
    assert [found.name for found in taken] == ['quick'] and not heard.free_running
    now[0] += 10.0
    heard._on_manifest(manifest('two', DOCKING))
    assert [found.name for found in taken] == ['quick', 'docking']
