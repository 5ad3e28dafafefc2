# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Live views: what they make of a run's messages, without a run."""

from __future__ import annotations

import itertools
import json
import math
import socket
import struct
import time
import urllib.error
import urllib.request
from email.message import Message
from pathlib import Path

import numpy as np
import pytest
import yaml
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped, Quaternion, WrenchStamped
from hypothesis import given
from hypothesis import strategies as st
from inside import inside
from nav_msgs.msg import Odometry
from rclpy.executors import SingleThreadedExecutor
from visualization_msgs.msg import Marker, MarkerArray

from rpo_attitude.target import motion_of
from rpo_attitude.turns import docking_axis
from rpo_core import files
from rpo_core.control.controller import load_fuzzy
from rpo_core.files import scenario as scenarios
from rpo_core.files.scenario import Scenario, load_scenario
from rpo_core.files.validation import InputError
from rpo_core.judge.zones import zones_of
from rpo_core.wire import interfaces
from rpo_core.wire.cdr import Status
from rpo_core.wire.statuses import Manifest, RunStatus
from rpo_ctrl import explain
from rpo_ros import conversions, names, qos
from rpo_view import scene, web_server
from rpo_view.live import Effort, LiveRun, Trail
from rpo_view.visualizer_node import VisualizerNode, transform_of
from rpo_view.web_node import WebNode
from rpo_view.web_server import LivePage, refusal

START_NS = 1_767_225_600_000_000_000
STATE = (10.0, 60.0, -40.0, 0.1, -0.2, 0.3)
FORCE = (-0.1, -0.5, 0.0)
BRINGUP = Path(__file__).resolve().parents[2] / 'ros_ws' / 'src' / 'rpo_bringup'


@given(st.lists(st.tuples(*[st.floats(-1e3, 1e3)] * 3), min_size=1, max_size=300))
def test_a_trail_is_bounded_and_keeps_its_beginning(points):
    trail = Trail(most=20, spacing_m=1.0)
    for point in points:
        trail.add(point)
    assert len(trail.points) <= 20
    assert trail.points[0] == points[0]
    assert set(trail.points) <= set(points)


def test_a_long_straight_trail_stays_even():
    trail = Trail(most=50, spacing_m=0.1)
    for i in range(10_000):
        trail.add((0.1 * i, 0.0, 0.0))
    gaps = [b[0] - a[0] for a, b in zip(trail.points, trail.points[1:], strict=False)]
    assert trail.points[-1][0] > 950.0
    assert max(gaps) < 2.5 * min(gaps)


def scene_of(position=STATE[:3], force=FORCE, look=None, **more) -> dict[tuple[str, int], Marker]:
    trail = [STATE[:3], position]
    found = scene.markers(Time(sec=5), position, force, trail, look or scene.Look(), **more).markers
    by_name = {(m.ns, m.id): m for m in found}
    assert len(by_name) == len(found)
    assert all(m.header.frame_id == interfaces.LVLH_FRAME and m.color.a > 0.0 for m in found)
    return by_name


def test_markers_keep_their_identity_and_can_be_seen():
    first, later = scene_of(), scene_of((0.5, -0.2, 0.1), (0.0, 0.0, 0.0))
    assert set(first) == set(later)
    for marker in first.values():
        assert marker.scale.x > 0.0 or marker.type == Marker.TEXT_VIEW_FACING
        assert marker.pose.orientation.w == 1.0
    assert first['thrust', 0].action == Marker.ADD
    assert later['thrust', 0].action == Marker.DELETE
    bare = scene.Look(keep_out_radius_m=0.0, corridor_half_angle_deg=0.0)
    assert set(first) - set(scene_of(look=bare)) == {('keep_out', 0), ('corridor', 0)}


def test_the_thrust_arrow_is_the_force_to_scale():
    tail, tip = scene_of(look=scene.Look(arrow_m_per_n=10.0))['thrust', 0].points
    assert (tail.x, tail.y, tail.z) == STATE[:3]
    shown = (tip.x - tail.x, tip.y - tail.y, tip.z - tail.z)
    assert shown == pytest.approx([10.0 * f for f in FORCE])


@given(st.tuples(*[st.floats(-100.0, 100.0)] * 3).filter(any), st.floats(1.0, 60.0))
def test_the_cone_has_its_half_angle_about_the_longest_axis(start, half_angle_deg):
    axis = max(range(3), key=lambda i: abs(start[i]))
    look = scene.Look(corridor_half_angle_deg=half_angle_deg)
    drawn = scene.markers(Time(), start, None, [start], look).markers
    (cone,) = (marker for marker in drawn if marker.ns == 'corridor')
    for point in ((p.x, p.y, p.z) for p in cone.points):
        length = math.hypot(*point)
        if length > 1e-9 * abs(start[axis]):
            cosine = point[axis] / length * math.copysign(1.0, start[axis])
            assert math.degrees(math.acos(min(1.0, cosine))) == pytest.approx(half_angle_deg)
    assert max(abs((p.x, p.y, p.z)[axis]) for p in cone.points) == pytest.approx(abs(start[axis]))


def test_the_transform_places_the_chaser():
    transform = transform_of(conversions.to_odometry(START_NS, STATE))
    assert (transform.header.frame_id, transform.child_frame_id) == ('target_lvlh', 'chaser')
    shift = transform.transform.translation
    assert (shift.x, shift.y, shift.z) == STATE[:3]
    assert transform.transform.rotation.w == 1.0


NAMES = {'plant': 'scenario', 'controller': 'controller'}


def manifest(role: str, value: str) -> Manifest:
    """Return the manifest of a plant with a scenario, of a controller with a name or its file."""
    named = role == 'controller' and not value.startswith('schema:')
    key = 'parameter.controller' if named else f'file.{NAMES[role]}.yaml'
    return Manifest.of(Status(0, role, 'manifest', 'none', (('role', role), (key, value))))


def status(phase: str = 'running', reason: str = 'flying') -> RunStatus:
    return RunStatus.of(Status(0, 'run', reason, 'none', (('phase', phase), ('tick', '0'))))


def watching(name: str) -> LiveRun:
    """Return a run whose plant flies a shipped scenario."""
    run = LiveRun()
    run.on_manifest(manifest('plant', files.read_text(files.find('scenario', name))))
    return run


def heard() -> LiveRun:
    """Return a run of `quick` that was heard for a second."""
    run = watching('quick')
    run.on_manifest(manifest('controller', 'trained'))
    run.on_status(status())
    for i in range(11):
        run.on_state(START_NS + i * 100_000_000, STATE)
    run.force_n = FORCE
    rules = {'rule.SN.Z.SN': '0.25', 'rule.Z.Z.Z': '0.75', 'rule.bad': '1', 'force_n': '0.1'}
    run.on_decision('y', 'position error is zero', rules)
    return run


def shown(run: LiveRun) -> dict:
    return json.loads(json.dumps(run.snapshot('/s'), allow_nan=False))


def test_what_is_heard_is_what_is_shown():
    found = shown(heard())
    assert found['scenario'] == 'quick'
    assert (found['time_s'], found['duration_s'], found['max_force_n']) == (1.0, 5.0, 0.5)
    assert found['range_m'] == pytest.approx(math.hypot(*STATE[:3]))
    assert found['sentence'] == 'running: flying'
    assert found['decisions']['y']['rules'] == [['Z', 'Z', 'Z', 0.75], ['SN', 'Z', 'SN', 0.25]]


def test_another_run_begins_anew():
    run = heard()
    run.on_state(START_NS, STATE)
    assert (run.flights, run.force_n, run.decisions) == (2, None, {})
    assert run.trail.points == [STATE[:3]]


def test_numbers_beyond_all_floats_are_not_shown():
    """JSON has no infinity: the page showed nothing from then on."""
    run = heard()
    run.on_state(START_NS, (1.7e308, 1.7e308, 0.0, 0.0, 0.0, 0.0))
    run.on_state(START_NS, (0.0, 0.0, 0.0, 1.7e308, 1.7e308, 0.0))
    run.on_decision('x', 'so', {'rule.Z.Z.Z': 'inf', 'rule.SN.Z.Z': '1e999'})
    assert run.position_m == STATE[:3]
    run.force_n = (1.7e308, 1.7e308, 0.0)
    run.on_state(START_NS + 10**10, STATE)
    shown(run)


HOSTILE = '[/bold]\x1b[2J\x1b]0;owned\x07\n\u202e' + 'x' * 200_000


def test_foreign_texts_are_shown_as_texts():
    """Escape sequences and endless names stay texts."""
    run = heard()
    run.on_manifest(manifest('controller', HOSTILE))
    with pytest.raises(InputError):
        status(phase=HOSTILE)
    with pytest.raises(InputError):
        status(reason=HOSTILE)
    run.on_status(status(reason=HOSTILE[:3000]))
    run.on_decision('x', HOSTILE, {f'rule.{HOSTILE}.{i}.Z': '0.5' for i in range(1000)})
    run.on_decision(HOSTILE, 'an axis that is none', {})
    assert r'[/bold]\x1b[2J' in run.controller and run.controller.isprintable()
    assert len(json.dumps(run.snapshot('/relative_state'))) < 20_000


def test_silence_is_said():
    now = [0.0]
    run = LiveRun(clock=lambda: now[0])
    assert 'is a plant running' in run.sentence('/one/relative_state')
    run.on_state(START_NS, STATE)
    assert run.sentence('/s') == 'running'
    now[0] = 7.4
    assert run.sentence('/s') == 'no message on /s for 7 s'
    run.on_status(status(phase='finished', reason='reached the last tick'))
    assert run.sentence('/s') == 'finished: reached the last tick'


def test_effort_and_rates_of_a_run_are_shown():
    """Δv, duty, range rate and arrival: of what was seen, each force held until the next."""
    run = watching('quick')
    assert run.snapshot('/s')['range_rate_m_s'] is None
    for tick, x in ((0, 4.0), (10, 3.0), (20, 0.4), (30, 0.3)):
        run.on_state(START_NS + tick * 100_000_000, (x, 3.0 if x > 1 else 0.0, 0.0, -0.5, 0.0, 0.0))
        run.force_n = (-0.25, 0.25, 0.0)
    shown = run.snapshot('/s')
    assert shown['delta_v_m_s'] == pytest.approx(0.5 * 3.0 / run.scenario.mass_kg)
    assert shown['duty'] == pytest.approx(0.5 / 3.0 / run.scenario.max_force_n)
    assert (shown['inside_s'], shown['range_rate_m_s']) == (2.0, -0.5)
    run.on_state(START_NS, (4.0, 3.0, 0.0, -0.5, 0.0, 0.0))
    assert run.range_rate_m_s == pytest.approx(-0.4) and run.delta_v_m_s is None


def test_valves_and_propellant_of_a_world_are_shown():
    run = watching('world_leo')
    assert run.snapshot('/s')['propellant_kg'] is None
    for tick in range(0, 40, 10):
        run.on_state(START_NS + tick * 100_000_000, (4.0, 3.0, 0.0, -0.5, 0.0, 0.0))
        run.force_n, run.exerted_n = (-0.25, 0.25, 0.0), (-0.3, 0.2, 0.0)
    shown = run.snapshot('/s')
    impulse, exhaust = 0.5 * 3.0, 70.0 * 9.80665
    assert shown['propellant_kg'] == pytest.approx(impulse / exhaust, rel=1e-3)
    assert shown['exerted_n'] == (-0.3, 0.2, 0.0)
    run.on_state(START_NS, (4.0, 3.0, 0.0, -0.5, 0.0, 0.0))
    assert run.snapshot('/s')['exerted_n'] is None


def controller_text(name: str) -> str:
    """Return the file of a shipped controller."""
    return files.read_text(files.find('controller', name))


def said_of(name: str, position_m: float, velocity_m_s: float) -> tuple[str, dict[str, str]]:
    """Return what a shipped controller publishes of an axis."""
    decision = explain.decide(load_fuzzy(name), position_m, velocity_m_s)
    return decision.strongest, {key: repr(value) for key, value in decision.pairs()}


def test_all_rules_that_make_a_force_are_shown():
    """The controller is in its manifest; of an unknown one, the rule is said to be one of them."""
    said, values = said_of('allround', -11.0, 0.5)
    assert 'force zero' in said and float(values['force_n']) < -0.12
    run = heard()

    def shown(text: str, sentence: str, published: dict[str, str]) -> str:
        run.on_manifest(manifest('controller', text))
        run.on_decision('y', sentence, published)
        return str(run.snapshot('/s')['decisions']['y']['sentence'])

    all_of_it = '-0.12 N, between small negative and zero (24 % of 0.5 N): 67 % from small negative'
    assert shown(controller_text('allround'), said, values).startswith(all_of_it)
    for other in (controller_text('robust'), 'schema: other', ''):
        assert shown(other, said, values) == f'strongest rule: {said}'
    assert shown(controller_text('pd'), 'commands 0.1 N', {'force_n': '0.1'}) == 'commands 0.1 N'
    for wrong in ('nan', '1e308', '-1e308', 'much', ''):
        published = {**values, 'position_error': wrong}
        found = shown(controller_text('allround'), said, published)
        assert found == f'strongest rule: {said}'


def test_the_page_fits_a_phone_and_shows_rules_as_the_surface_does():
    """The live test looks at it in a browser, where there is one."""
    text = web_server.page().decode()
    assert '@media (max-width: 480px)' in text
    assert '[...WORDS].reverse().map(v =>' in text  # LP of the velocity error is at the top
    for words in ('range rate', 'Δv', 'thruster duty', 'Closing speed against range'):
        assert words in text
    assert 'id="zone-legend"' in text


def get(url: str, host: str = '', origin: str = '') -> tuple[int, str]:
    named = {'Host': host, 'Origin': origin}
    request = urllib.request.Request(url, headers={k: v for k, v in named.items() if v})
    try:
        with urllib.request.urlopen(request, timeout=10.0) as answer:
            return answer.status, answer.read().decode()
    except urllib.error.HTTPError as error:
        return error.code, ''


@pytest.fixture
def page():
    served = LivePage(0)
    yield served
    served.close()


def test_the_page_is_whole_and_for_this_machine_alone(page):
    assert page.server_address[0] == '127.0.0.1'
    status, text = get(page.url)
    assert status == 200
    assert '--paper:#ffffff' in text
    assert 'http://' not in text and 'https://' not in text
    assert get(page.url + 'other')[0] == 404
    assert get(page.url, 'evil.example')[0] == 403
    assert get(page.url, f'evil.example:{page.server_port}')[0] == 403
    assert get(page.url, origin='https://evil.example')[0] == 403
    assert get(page.url, origin=page.url.rstrip('/'))[0] == 200
    with pytest.raises(InputError, match=r'`port` must be free; got \d+: it is in use'):
        LivePage(page.server_port)


def headers(**lines: str) -> Message:
    made = Message()
    for name, value in lines.items():
        made[name] = value
    return made


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
    told = headers(Host=host) if origin is None else headers(Host=host, Origin=origin)
    assert (refusal(told, 8765) == '') is welcome
    told['Host'] = host
    assert refusal(told, 8765)  # two of them


def reset(port: int, data: bytes) -> None:
    """Send data to a server, then end the connection by RST."""
    with socket.create_connection(('127.0.0.1', port)) as client:
        client.sendall(data)
        client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack('ii', 1, 0))


def test_a_lost_connection_is_not_worth_a_word(page, capfd):
    for data in (
        b'',
        b'GET /',
        f'GET /events HTTP/1.1\r\nHost: 127.0.0.1:{page.server_port}\r\n\r\n'.encode(),
    ):
        reset(page.server_port, data)
    assert get(page.url)[0] == 200
    time.sleep(0.1)
    assert capfd.readouterr() == ('', '')


def events(url: str, most: int) -> list[str]:
    """Return the first lines of data of a stream of events."""
    found: list[str] = []
    with urllib.request.urlopen(url + 'events', timeout=10.0) as stream:
        while len(found) < most:
            line = stream.readline().decode()
            if line.startswith('data: '):
                found.append(line.removeprefix('data: '))
    return found


def test_a_reader_gets_the_trail_and_then_the_newest(page):
    page.feed.publish({'time_s': 1.0}, [[1, 2, 3]])
    page.feed.publish({'time_s': 2.0}, [[1, 2, 3], [4, 5, 6]])
    trail, now = events(page.url, 2)
    assert (json.loads(trail), json.loads(now)) == ([[1, 2, 3], [4, 5, 6]], {'time_s': 2.0})


@pytest.fixture
def inner(ros_env):
    with inside(executor=SingleThreadedExecutor) as found:  # as viewers are run
        yield found


def test_rviz_and_foxglove_look_at_topics_that_are_there():
    topics = {names.MARKERS, names.CHASER_POSE, interfaces.RELATIVE_STATE, interfaces.CONTROL_FORCE,
              interfaces.RUN_STATUS, interfaces.DECISION, interfaces.NAVIGATION_STATE,
              interfaces.REFERENCE_STATE}  # fmt: skip
    document = yaml.safe_load((BRINGUP / 'rviz' / 'final_approach.rviz').read_text())
    displays = document['Visualization Manager']['Displays']
    shown = {d['Topic']['Value'] for d in displays if 'Topic' in d}
    assert shown and shown <= topics
    assert (
        document['Visualization Manager']['Global Options']['Fixed Frame'] == interfaces.LVLH_FRAME
    )
    layout = json.loads((BRINGUP / 'foxglove' / 'final_approach.json').read_text())
    panels = layout['configById']
    paths = [p['value'] for panel in panels.values() for p in panel.get('paths', [])]
    assert {path.split('.')[0].lstrip('/') for path in paths} <= topics
    placed: list[str] = []

    def walk(part: object) -> None:
        if isinstance(part, str):
            placed.append(part)
        else:
            walk(part['first']), walk(part['second'])

    walk(layout['layout'])
    assert sorted(placed) == sorted(panels)


def test_a_time_that_goes_back_takes_no_impulse_away():
    effort = Effort()
    for time_s in (0.0, 1.0, -1e300, -1e300 + 1.0, 2.0):
        effort.add(time_s, (1.0, 0.0, 0.0), (0.5, 0.0, 0.0))
    assert effort.known and effort.impulse_n_s >= 0.5


def test_zones_of_the_scenario_replace_the_aids():
    found = scene_of(zones=zones_of(load_scenario('hold_points')))
    assert found['keep_out', 0].scale.x == 20.0  # the aid has 10
    tip = found['port', 0].pose.position
    assert (tip.x, tip.y, tip.z) == (0.0, 1.0, 0.0)
    corridor = zones_of(load_scenario('hold_points'))[0].corridor
    walls = found['corridor', 0].points
    assert len(walls) % 2 == 0
    assert max(abs(corridor.outside_m((p.x, p.y, p.z))) for p in walls) < 1e-9
    named = {m.text: m.pose.position.y for (ns, _), m in found.items() if ns == 'hold_names'}
    assert named == {'hold_60': 60.0, 'hold_20': 20.0, 'retreat': 60.0}
    both = zones_of(load_scenario('hold_points')) + zones_of(load_scenario('assured'))
    assert ('keep_out', 1) in scene_of(zones=both)


def test_a_turning_target_is_drawn_as_it_is_now():
    """A chaser at rest on the axis of the port, 4 m before it."""
    run, port = LiveRun(), load_scenario('tumbling_port')
    run.on_manifest(manifest('plant', scenarios.dumps(port)))
    x, y, z, w, *_ = motion_of(port.target, port).attitude(2500)
    turned = matrix_of(Quaternion(x=x, y=y, z=z, w=w))
    run.on_state(port.stamp_ns(2500), (*(turned @ (0.0, 5.0, 0.0)).tolist(), 0.0, 0.0, 0.0))
    assert run.errors[:3] == pytest.approx((0.0, 4.0, 0.0), abs=1e-9)
    assert math.hypot(*run.errors[3:]) > 0.02 and run.errors[4] == pytest.approx(0.0, abs=1e-9)
    drawn = run.snapshot('/s')['zones'][0]
    assert drawn['port_m'] == pytest.approx(tuple(turned @ (0.0, 1.0, 0.0)), abs=1e-9)
    drawn = scene_of(run.position_m, zones=run.zones_now, attitude=run.attitude)
    body = drawn['target', 0].pose.orientation
    np.testing.assert_allclose(matrix_of(body), turned, atol=1e-12)


def turning(**sections: object) -> Scenario:
    """Return the paper's test with a chaser that turns."""
    document = yaml.safe_load(scenarios.dumps(load_scenario('paper_test')))
    body = {'inertia_kg_m2': np.eye(3).tolist()}
    return scenarios.parse({**document, 'attitude': body, **sections})


def test_the_attitude_of_a_chaser_is_drawn():
    """An hour hand: turned by 90 degrees about z, the axis along -y looks along x."""
    run, still, turns = LiveRun(), load_scenario('paper_test'), turning()
    half = math.sqrt(0.5)
    attitude = (0.0, 0.0, half, half, 0.0, 0.0, 0.02)
    for scenario, known in ((still, False), (turns, True)):
        run.on_manifest(manifest('plant', scenarios.dumps(scenario)))
        run.on_state(START_NS, STATE, attitude)
        assert (run.docking_axis is not None) is known is bool(shown(run)['docking_axis'])
    x, y, z = docking_axis(turns)
    assert run.docking_axis == pytest.approx((-y, x, z), abs=1e-12)
    found = scene_of(chaser_attitude=attitude, docking_axis=run.docking_axis)
    q = found['chaser', 0].pose.orientation
    assert (q.x, q.y, q.z, q.w) == attitude[:4]
    tail, tip = found['docking_axis', 0].points
    away = (tip.x - tail.x, tip.y - tail.y, tip.z - tail.z)
    assert away == pytest.approx([3.0 * a for a in run.docking_axis])
    tail, tip = found['thrust', 0].points  # a force in LVLH: it does not turn with the body
    assert (tip.x - tail.x, tip.y - tail.y) == pytest.approx((20.0 * FORCE[0], 20.0 * FORCE[1]))
    run.force_n = FORCE  # nothing turns this command: it is in the chaser's axes, and drawn in LVLH
    ahead = (-FORCE[1], FORCE[0], FORCE[2])
    assert run.command_n == pytest.approx(ahead, abs=1e-12)
    assert shown(run)['force_n'] == pytest.approx(ahead, abs=1e-12)
    steered = turning(attitude_control={'controller': 'attitude_pd', 'limit_nm': 0.1})
    run.on_manifest(manifest('plant', scenarios.dumps(steered)))
    assert run.command_n == FORCE
    run.on_state(START_NS, STATE, (*attitude[:6], 1.7e308))  # foreign: beyond all floats
    assert run.chaser_attitude == attitude


@pytest.mark.parametrize(
    'orientation', [(0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 2.0), (0.0, 0.0, 0.0, math.nan)]
)
def test_an_orientation_that_is_none_is_not_drawn(orientation):
    message = conversions.to_odometry(START_NS, STATE)
    assert conversions.attitude_of(message) == interfaces.ALIGNED
    scene.turn(message.pose.pose.orientation, orientation)
    assert conversions.attitude_of(message) is None


def matrix_of(q) -> np.ndarray:
    """Return the rotation (3, 3) of a quaternion, as its definition has it."""
    w, v = q.w, np.array([q.x, q.y, q.z])
    cross = np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
    return (w * w - v @ v) * np.eye(3) + 2.0 * np.outer(v, v) + 2.0 * w * cross


def test_nodes_show_what_a_run_says(inner):
    """A sender at full speed; zones go when a plant has another scenario."""
    user, said = inner.user, conversions.to_status
    view = inner.start(VisualizerNode({'rate_hz': 50.0}))
    web = inner.start(WebNode({'port': 0, 'rate_hz': 50.0}))
    states = user.create_publisher(Odometry, interfaces.RELATIVE_STATE, qos.LOCKSTEP)
    forces = user.create_publisher(WrenchStamped, interfaces.CONTROL_FORCE, qos.LOCKSTEP)
    why = user.create_publisher(DiagnosticArray, interfaces.DECISION, qos.DIAGNOSTICS)
    latched = {
        name: user.create_publisher(DiagnosticStatus, name, qos.LATCHED)
        for name in ('run_status', 'node_manifest')
    }
    scenes: list[MarkerArray] = []
    poses: list[PoseStamped] = []
    user.create_subscription(MarkerArray, names.MARKERS, scenes.append, qos.LATCHED)
    user.create_subscription(PoseStamped, names.CHASER_POSE, poses.append, qos.LATCHED)

    def say(name, values):
        latched[name].publish(said(b'\0', name.partition('_')[0], 'flying', values.items()))

    def flies(name):
        text = files.read_text(files.find('scenario', name))
        say('node_manifest', {'role': 'plant', 'file.scenario.yaml': text})

    ticks = itertools.count()

    def said_until(condition):
        """Let the nodes speak, tick by tick, until a condition holds."""

        def said_once():
            stamp_ns = START_NS + 100_000_000 * next(ticks)
            states.publish(conversions.to_odometry(stamp_ns, STATE))
            forces.publish(conversions.to_wrench(conversions.to_stamp(stamp_ns), FORCE))
            why.publish(
                DiagnosticArray(status=[said(b'\0', 'decision: x', 'so', [('rule.Z.Z.Z', 1.0)])])
            )
            return condition()

        inner.until(said_once)

    def shown_ns():
        last = scenes[-1].markers if scenes else ()
        return {m.ns for m in last if m.action == Marker.ADD}

    live = web.live
    say('run_status', {'phase': 'running', 'tick': '0'})
    flies('hold_points')
    said_until(lambda: {'port', 'holds'} <= shown_ns() and live.phase and poses)
    assert {'target', 'chaser', 'thrust', 'trail', 'keep_out'} <= shown_ns()
    assert poses[-1].header.frame_id == interfaces.LVLH_FRAME
    assert poses[-1].pose.position.y == STATE[1]
    said_until(lambda: live.force_n and live.decisions)
    assert live.force_n == FORCE and live.decisions['x'].rules == (('Z', 'Z', 'Z', 1.0),)
    inner.passes(0.2)  # the page gets a picture each 20 ms, while the executor spins
    assert json.loads(events(web.page.url, 2)[1])['sentence'] == 'running: flying'
    flies('assured')
    said_until(lambda: 'port' in shown_ns() and 'holds' not in shown_ns())
    assert len(view.live.zones) == 2


def test_pose_and_transform_turn_with_the_chaser(inner):
    node = inner.start(VisualizerNode({'rate_hz': 50.0}))
    node.live.on_manifest(manifest('plant', scenarios.dumps(turning())))
    states = inner.user.create_publisher(Odometry, interfaces.RELATIVE_STATE, qos.LOCKSTEP)
    poses = []
    inner.user.create_subscription(PoseStamped, names.CHASER_POSE, poses.append, qos.LATCHED)
    message = conversions.to_odometry(START_NS, STATE)
    scene.turn(message.pose.pose.orientation, (0.5, 0.5, -0.5, 0.5))
    inner.until(lambda: states.publish(message) or poses)
    q = poses[-1].pose.orientation
    assert (q.x, q.y, q.z, q.w) == (0.5, 0.5, -0.5, 0.5)
    assert transform_of(message).transform.rotation == q
