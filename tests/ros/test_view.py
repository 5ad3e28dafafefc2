# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Live views: what they make of a run's messages, without a run."""

from __future__ import annotations

import base64
import itertools
import json
import math
import re
import socket
import struct
import time
import urllib.error
import urllib.request
from collections.abc import Iterable
from dataclasses import replace
from email.message import Message
from pathlib import Path

import numpy as np
import pytest
import yaml
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from inside import inside
from rclpy.executors import SingleThreadedExecutor
from scipy.spatial.transform import Rotation
from visualization_msgs.msg import Marker, MarkerArray

from rpo.analysis.turned import turned_of
from rpo.reports import replay
from rpo.reports.replay import Replayed, page_of
from rpo_bringup import visualizer_node
from rpo_bringup.views.live import LiveFlight
from rpo_bringup.views.samples import Samples
from rpo_bringup.views.web_server import Feed, LivePage, refusal
from rpo_bringup.visualizer_node import VisualizerNode, transform_of
from rpo_bringup.web_node import WebNode
from rpo_core import files
from rpo_core.attitude.pointing import docking_axis
from rpo_core.attitude.target import motion_of
from rpo_core.chain.flight import Flight, fly
from rpo_core.control.controller import load_controller
from rpo_core.files.validation import InputError
from rpo_core.scenario import scenario as scenarios
from rpo_core.scenario.scenario import Scenario, load_scenario
from rpo_core.wire import interfaces
from rpo_core.wire.cdr import Status
from rpo_core.wire.statuses import GuidanceStatus, Manifest, RunStatus
from rpo_core.world.zones import zones_of
from rpo_ros import qos, signals
from rpo_ros.signals import Outlet

START_NS = 1_767_225_600_000_000_000
STATE = (10.0, 60.0, -40.0, 0.1, -0.2, 0.3)
FORCE = (-0.1, -0.5, 0.0)
BRINGUP = Path(__file__).resolve().parents[2] / 'ros_ws' / 'src' / 'rpo_bringup'


def scene_of(name: str, force: tuple[float, ...] = FORCE) -> dict[tuple[str, int], Marker]:
    """Return the markers of a flight at its first state."""
    live = watching(name)
    assert live.on_signals(START_NS, {'relative_state': STATE, 'control_force': force})
    first, *found = visualizer_node.markers(Time(sec=5), live).markers
    assert first.action == Marker.DELETEALL, 'what the scene before had and this one has not'
    by_name = {(m.ns, m.id): m for m in found}
    assert len(by_name) == len(found)
    for marker in found:
        assert marker.header.frame_id == interfaces.LVLH_FRAME and marker.color.a > 0.0
        assert marker.scale.x > 0.0 or marker.type == Marker.TEXT_VIEW_FACING
        assert marker.pose.orientation.w == 1.0
    return by_name


def test_the_thrust_arrow_is_the_force_to_scale():
    tail, tip = scene_of('quick')['thrust', 0].points
    assert (tail.x, tail.y, tail.z) == STATE[:3]
    shown = (tip.x - tail.x, tip.y - tail.y, tip.z - tail.z)
    assert shown == pytest.approx([20.0 * f for f in FORCE])
    assert ('thrust', 0) not in scene_of('quick', (0.0, 0.0, 1e-4))


def test_the_scene_has_the_zones_of_the_scenario():
    found = scene_of('hold_points')
    assert found['keep_out', 0].scale.x == 20.0
    tip = found['port', 0].pose.position
    assert (tip.x, tip.y, tip.z) == (0.0, 1.0, 0.0)
    corridor = zones_of(load_scenario('hold_points'))[0].corridor
    walls = found['corridor', 0].points
    assert len(walls) % 2 == 0
    assert max(abs(corridor.outside_m((p.x, p.y, p.z))) for p in walls) < 1e-9
    named = {m.text: m.pose.position.y for (ns, _), m in found.items() if ns == 'hold_names'}
    assert named == {'hold_60': 60.0, 'hold_20': 20.0, 'retreat': 60.0}
    assert ('keep_out', 1) in scene_of('assured')
    assert {ns for ns, _ in scene_of('quick')} == {'target', 'chaser', 'trail', 'thrust'}


def manifest(role: str, text: str) -> Manifest:
    """Return the manifest of a plant with a scenario, or of a controller with its file."""
    key = {'plant': 'file.scenario.yaml', 'controller': 'file.controller.yaml'}[role]
    pairs = (('role', role), (key, text), ('parameter.controller', 'mine'))
    return Manifest.of(Status(0, role, 'manifest', 'none', pairs))


def said(reader, **values):
    return reader.of(Status(0, 'run', 'so', 'none', tuple(values.items())))


def watching(scenario: Scenario | str, controller: str = 'allround') -> LiveFlight:
    """Return what a viewer knows before the first state."""
    live = LiveFlight()
    found = load_scenario(scenario) if isinstance(scenario, str) else scenario
    live.on_manifest(manifest('plant', scenarios.dumps(found)))
    path = files.find('controller', controller)
    live.on_manifest(manifest('controller', files.read_text(path)))
    live.on_status(said(RunStatus, phase='running', tick='0'))
    return live


def flown(live: LiveFlight, flight: Flight, ticks: Iterable[int]) -> Samples:
    """Let a viewer hear ticks of a flight; return what its page holds."""
    samples = Samples(live, flight.scenario)
    return flown_on(samples, live, flight, ticks)


def flown_on(samples: Samples, live: LiveFlight, flight: Flight, ticks: Iterable[int]) -> Samples:
    for tick in ticks:
        signals = {name: tuple(v[tick].tolist()) for name, v in flight.signals.items()}
        signals[interfaces.RELATIVE_STATE] = tuple(flight.states[tick].tolist())
        signals[interfaces.CONTROL_FORCE] = tuple(flight.forces_n[tick].tolist())
        if live.on_signals(flight.scenario.stamp_ns(tick), signals):
            samples.add(live)
    return samples


def replayed(text: str) -> list[dict]:
    """Return the flights of a page."""
    (data,) = re.findall(r'id="data">(.*?)</script>', text, re.DOTALL)
    return json.loads(data)['flights']


def numbers(text: str) -> np.ndarray:
    return np.frombuffer(base64.b64decode(text), '<f4')


@pytest.fixture(scope='module')
def guided() -> Flight:
    """A flight with guidance, estimate and zones, of 60 s."""
    document = yaml.safe_load(scenarios.dumps(load_scenario('docking_leo')))
    return fly(scenarios.parse({**document, 'duration_s': 60.0}), load_controller('allround'))


def test_the_page_holds_what_the_replay_of_the_log_holds(guided):
    """Limits of moments, forces in reasons, reference and estimate; slew alone is not known."""
    ticks = range(0, 400, 40)
    live = watching(guided.scenario)
    live.on_guidance(said(GuidanceStatus, phase='go', tick='0', reason='so'))
    samples = flown(live, guided, ticks)
    shown = samples.flight(live, 'running: so')
    (whole,) = replayed(page_of('', [Replayed('', guided, '', None, load_controller('allround'))]))
    take = slice(0, 400, 40)
    for name, width in (('times', 1), ('states', 6), ('reference', 3)):
        expected = numbers(whole[name]).reshape(-1, width)[take]
        np.testing.assert_allclose(numbers(shown[name]).reshape(-1, width), expected, rtol=1e-6)
    mine = {limit['name']: limit for limit in shown['limits']}
    for limit in replay.limits_of(guided):
        if 'slew' in limit.name or 'force' in limit.name:
            continue
        found = numbers(mine[limit.name]['values'])
        np.testing.assert_allclose(found, limit.values[take], rtol=1e-5, atol=1e-6)
        assert mine[limit.name]['from_s'] == limit.from_s
    assert [row[0] for row in shown['phases']] == ['go'] and len(shown['reasons']['samples']) == 10
    words = [words for words, _ in map(tuple, shown['reasons']['samples'][0])]
    assert all(shown['reasons']['words'][n] for n in words)
    json.dumps(samples.document(live, 'so'), allow_nan=False)


def test_what_a_page_gets_bit_by_bit_is_the_whole(guided):
    live = watching(guided.scenario)
    samples = flown(live, guided, range(0, 100, 10))
    first = samples.flight(live, 'so')
    flown_on(samples, live, guided, range(100, 200, 10))
    rest, whole = samples.flight(live, 'so', 10), samples.flight(live, 'so')
    for name in ('times', 'states', 'forces', 'reference', 'estimate'):
        joined = np.concatenate([numbers(first[name]), numbers(rest[name])])
        np.testing.assert_array_equal(joined, numbers(whole[name]))
    for part in ('words', 'samples'):
        joined = first['reasons'][part] + rest['reasons'][part]
        assert joined == whole['reasons'][part]


def test_a_controller_that_comes_to_be_known_later_explains_from_then_on(guided):
    live, known = watching(guided.scenario), watching(guided.scenario)
    live.controller = None
    samples = flown(live, guided, range(0, 30, 10))
    assert samples.name == '0.0' and samples.flight(live, '')['reasons'] is None
    live.controller = known.controller
    flown_on(samples, live, guided, [30])
    explained = samples.flight(live, '')['reasons']['samples']
    assert samples.name == '0.1' and explained[:3] == [None] * 3 and explained[3]


def test_a_long_flight_is_thinned_and_its_page_begins_anew(guided, monkeypatch):
    monkeypatch.setattr('rpo_bringup.views.samples.MOST_SAMPLES', 20)
    live = watching(guided.scenario)
    samples = flown(live, guided, range(30))
    assert len(samples.rows) <= 20 and samples.name == '0.1'
    assert numbers(samples.flight(live, '')['times'])[0] == 0.0


def test_a_chaser_that_turns_has_its_attitude_and_angles():
    flight = fly(
        replace(load_scenario('tumbling_docking'), duration_s=20.0), load_controller('allround')
    )
    live = watching(flight.scenario)
    shown = flown(live, flight, range(0, 200, 50)).flight(live, '')
    expected = flight.signals[interfaces.CHASER_ATTITUDE][0:200:50, :4]
    np.testing.assert_allclose(numbers(shown['chaser']).reshape(-1, 4), expected, atol=1e-6)
    motion = motion_of(flight.scenario.target, flight.scenario)
    np.testing.assert_allclose(
        numbers(shown['attitudes'])[-4:], motion.attitude(150)[:4], atol=1e-6
    )
    off, rate = (numbers(values) for _, _, values in shown['turns'])
    whole = turned_of(flight)
    np.testing.assert_allclose(off, whole.off_reference_deg[0:200:50], atol=1e-4)
    rates = np.linalg.norm(whole.rates_deg_s, axis=1)[0:200:50]
    np.testing.assert_allclose(rate, rates, atol=1e-5)
    x, y, z = docking_axis(flight.scenario)
    attitude = flight.signals[interfaces.CHASER_ATTITUDE][150]
    expected = Rotation.from_quat(attitude[:4]).apply((x, y, z))
    np.testing.assert_allclose(live.docking_axis, expected, atol=1e-12)


def test_another_flight_begins_anew_and_a_state_sent_again_is_none():
    live = watching('quick')
    assert live.on_signals(START_NS + 1, {'relative_state': STATE, 'control_force': FORCE})
    assert not live.on_signals(START_NS + 1, {'relative_state': STATE})
    assert live.force_n == FORCE
    assert live.on_signals(START_NS, {'relative_state': STATE})
    assert (live.flights, live.force_n, live.trail.points) == (2, None, [STATE[:3]])


def test_numbers_beyond_all_floats_are_not_shown():
    live = watching('quick')
    for value in (1.7e308, -1.7e308, 1e101):
        assert not live.on_signals(START_NS, {'relative_state': (value, *STATE[1:])})
        force = (value, 0.0, 0.0)
        assert not live.on_signals(START_NS, {'relative_state': STATE, 'control_force': force})
    assert live.flights == 0


HOSTILE = '[/bold]\x1b[2J\x1b]0;owned\x07\n\u202e' + 'x' * 2000


def test_foreign_texts_are_shown_as_texts():
    live = watching('quick')
    pairs = (('role', 'controller'), ('parameter.controller', HOSTILE))
    live.on_manifest(Manifest.of(Status(0, 'c', 'manifest', 'none', pairs)))
    assert live.controller_name.isprintable() and len(live.controller_name) < 300
    status = Status(0, 'run', HOSTILE, 'none', (('phase', 'aborted'), ('tick', '1')))
    live.on_status(RunStatus.of(status._replace(level=2)))
    assert live.card('/s').isprintable()


def test_each_state_of_a_flight_has_its_card():
    now = [0.0]
    live = LiveFlight(clock=lambda: now[0])
    assert 'is a plant running' in live.card('/s')
    live.on_status(said(RunStatus, phase='waiting', tick='0'))
    assert live.card('/s') == 'Waiting: so'
    live.on_status(said(RunStatus, phase='running', tick='0'))
    live.on_signals(START_NS, {'relative_state': STATE})
    assert 'another kind of plant, 72.8 m from the target' in live.card('/s')
    live.on_manifest(manifest('plant', files.read_text(files.find('scenario', 'quick'))))
    assert live.card('/s') == ''
    now[0] = 7.4
    assert live.card('/s') == 'No message on /s for 7 s'
    live.on_status(said(RunStatus, phase='paused', tick='0'))
    assert live.card('/s') == 'Paused: so'
    live.on_status(said(RunStatus, phase='finished', tick='0'))
    assert (live.sentence('/s'), live.card('/s')) == ('finished: so', '')


def test_a_status_that_is_ahead_of_the_first_state_is_of_this_flight():
    live = watching('quick')
    live.on_guidance(said(GuidanceStatus, phase='old', tick='40', reason='so'))
    live.on_guidance(said(GuidanceStatus, phase='new', tick='0', reason='so'))
    live.on_signals(START_NS, {'relative_state': STATE})
    assert [status.phase for status in live.phases] == ['new']


def get(url: str, **headers: str) -> tuple[int, str]:
    try:
        request = urllib.request.Request(url, headers=headers)
        with urllib.request.urlopen(request, timeout=10.0) as answer:
            return answer.status, answer.read().decode()
    except urllib.error.HTTPError as error:
        return error.code, ''


@pytest.fixture
def page():
    served = LivePage(0, Feed(LiveFlight(), '/s'))
    yield served
    served.close()


def test_the_page_is_whole_and_for_this_machine_alone(page):
    assert page.server_address[0] == '127.0.0.1'
    status, text = get(page.url)
    assert status == 200
    assert '--paper:#ffffff' in text
    assert 'http://' not in text and 'https://' not in text
    assert get(page.url + 'other')[0] == get(page.url + 'events?flight=../&from=0')[0] == 404
    assert get(page.url, Host=f'evil.example:{page.server_port}')[0] == 403
    assert get(page.url, Origin=page.url.rstrip('/'))[0] == 200
    with pytest.raises(InputError, match=r'`port` must be free; got \d+: it is in use'):
        LivePage(page.server_port, page.feed)


def events(url: str, most: int) -> list[dict]:
    """Return the first data of a stream of events."""
    found: list[dict] = []
    with urllib.request.urlopen(url, timeout=10.0) as stream:
        while len(found) < most:
            line = stream.readline().decode()
            if line.startswith('data: '):
                found.append(json.loads(line.removeprefix('data: ')))
    return found


def test_a_reader_gets_what_is_new_since_its_moment(page, guided):
    live = page.feed.live
    live.on_manifest(manifest('plant', scenarios.dumps(guided.scenario)))

    def update(tick):
        signals = {interfaces.RELATIVE_STATE: tuple(guided.states[tick].tolist())}
        page.feed.update(lambda: live.on_signals(guided.scenario.stamp_ns(tick), signals))

    update(0)
    assert 'id="data"' not in get(page.url)[1], 'one moment is no picture: a card'
    (card,) = events(page.url + 'events?flight=&from=0', 1)
    assert (card['flight'], card['more']) == ('', None)
    update(1), update(2)
    (document,) = re.findall(r'<script type="application/json" id="data">(.*?)</script>',
                             get(page.url)[1], re.DOTALL)  # fmt: skip
    document = json.loads(document)
    assert document['live'] == {'flight': '1.0', 'samples': 3, 'end': 60.0}
    update(3), update(4)
    (more,) = events(page.url + 'events?flight=1.0&from=3', 1)
    assert (more['from'], len(numbers(more['more']['times']))) == (3, 2)
    (other,) = events(page.url + 'events?flight=7.0&from=3', 1)
    assert (other['flight'], other['more']) == ('1.0', None)


@pytest.mark.parametrize(
    ('host', 'origin', 'welcome'),
    [
        ('127.0.0.1:8765', None, True),
        ('localhost:8765', 'http://localhost:3000', True),
        ('localhost:8765', 'https://app.example.org', False),
        ('localhost:8765', 'http://localhost.evil.example', False),
        ('localhost:8765', 'null', False),
        ('localhost:8765', '', False),
        ('localhost:8765', 'http://[', False),
        ('localhost:8766', None, False),
        ('evil.example:8765', None, False),
        ('', None, False),
    ],
)
def test_who_may_connect(host, origin, welcome):
    told = Message()
    told['Host'] = host
    if origin is not None:
        told['Origin'] = origin
    assert (refusal(told, 8765) == '') is welcome
    told['Host'] = host
    assert refusal(told, 8765)  # two of them


def reset(port: int, data: bytes) -> None:
    """Send data to a server, then end the connection by RST."""
    with socket.create_connection(('127.0.0.1', port)) as client:
        client.sendall(data)
        client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack('ii', 1, 0))


def test_a_lost_connection_is_not_worth_a_word(page, capfd):
    asks = f'GET /events?flight=&from=0 HTTP/1.1\r\nHost: 127.0.0.1:{page.server_port}\r\n\r\n'
    for data in (b'', b'GET /', asks.encode()):
        reset(page.server_port, data)
    assert get(page.url)[0] == 200
    time.sleep(0.1)
    assert capfd.readouterr() == ('', '')


@pytest.fixture
def inner(ros_env):
    with inside(executor=SingleThreadedExecutor) as found:  # as viewers are run
        yield found


def test_rviz_and_foxglove_look_at_topics_that_are_there():
    topics = {'markers', 'chaser_pose', *(row.name for row in interfaces.rows())}
    document = yaml.safe_load((BRINGUP / 'rviz' / 'final_approach.rviz').read_text())
    manager = document['Visualization Manager']
    shown = {d['Topic']['Value'] for d in manager['Displays'] if 'Topic' in d}
    assert shown and shown <= topics
    assert manager['Global Options']['Fixed Frame'] == interfaces.LVLH_FRAME
    text = (BRINGUP / 'foxglove' / 'final_approach.json').read_text()
    panels = json.loads(text)['configById']
    paths = [p['value'] for panel in panels.values() for p in panel.get('paths', [])]
    paths += [panel['topicPath'] for panel in panels.values() if 'topicPath' in panel]
    assert {path.split('.')[0].lstrip('/') for path in paths} <= topics
    _, _, layout = text.partition('"layout"')
    assert all(f'"{panel}"' in layout for panel in panels)


def test_nodes_show_what_a_run_says(inner):
    """A sender at full speed; zones go when a plant has another scenario."""
    user = inner.user
    view = inner.start(VisualizerNode({'rate_hz': 50.0}))
    web = inner.start(WebNode({'port': 0, 'rate_hz': 50.0}))
    states, forces = (Outlet(user, name) for name in ('relative_state', 'control_force'))
    latched = {
        name: user.create_publisher(DiagnosticStatus, name, qos.LATCHED)
        for name in ('run_status', 'node_manifest')
    }
    scenes: list[MarkerArray] = []
    poses: list[PoseStamped] = []
    user.create_subscription(MarkerArray, 'markers', scenes.append, qos.LATCHED)
    user.create_subscription(PoseStamped, 'chaser_pose', poses.append, qos.LATCHED)

    def say(name, values):
        sender = name.partition('_')[0]
        message = signals.to_status(b'\0', sender, 'flying', values.items())
        latched[name].publish(message)

    def flies(name):
        text = files.read_text(files.find('scenario', name))
        say('node_manifest', {'role': 'plant', 'file.scenario.yaml': text})

    ticks = itertools.count()

    def until(condition):
        """Let the nodes speak, tick by tick, until a condition holds."""

        def once():
            stamp_ns = START_NS + 100_000_000 * next(ticks)
            states.publish(stamp_ns, STATE)
            forces.publish(stamp_ns, FORCE)
            states.publish(stamp_ns + 1, (math.nan, *STATE[1:]))
            return condition()

        inner.until(once)

    def shown_ns():
        last = scenes[-1].markers if scenes else ()
        return {m.ns for m in last if m.action == Marker.ADD}

    live = web.live
    say('run_status', {'phase': 'running', 'tick': '0'})
    flies('hold_points')
    until(lambda: {'port', 'holds'} <= shown_ns() and live.phase and poses)
    assert {'target', 'chaser', 'thrust', 'trail', 'keep_out'} <= shown_ns()
    assert poses[-1].header.frame_id == interfaces.LVLH_FRAME
    assert poses[-1].pose.position.y == STATE[1]
    until(lambda: live.force_n == FORCE)
    inner.passes(0.2)  # the page gets a moment each 20 ms, while the executor spins
    assert events(web.page.url + 'events?flight=&from=0', 1)[0]['sentence'] == 'running: flying'
    flies('assured')
    until(lambda: 'port' in shown_ns() and 'holds' not in shown_ns())
    assert len(view.live.zones) == 2


def test_pose_and_transform_turn_with_the_chaser(inner):
    node = inner.start(VisualizerNode({'rate_hz': 50.0}))
    node.live.on_manifest(manifest('plant', scenarios.dumps(load_scenario('tumbling_docking'))))
    states = Outlet(inner.user, interfaces.RELATIVE_STATE)
    poses = []
    inner.user.create_subscription(PoseStamped, 'chaser_pose', poses.append, qos.LATCHED)
    stamps, attitude = itertools.count(START_NS, 100_000_000), (0.5, 0.5, -0.5, 0.5)

    def publish():
        states.publish(next(stamps), (*STATE, *attitude, 0.0, 0.0, 0.0))
        return poses

    inner.until(publish)
    transform = transform_of(poses[-1])
    for q in (poses[-1].pose.orientation, transform.transform.rotation):
        assert (q.x, q.y, q.z, q.w) == attitude
    assert (transform.header.frame_id, transform.child_frame_id) == ('target_lvlh', 'chaser')
    shift = transform.transform.translation
    assert (shift.x, shift.y, shift.z) == STATE[:3]
