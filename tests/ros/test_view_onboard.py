# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What live views show of guidance, navigation, assurance and thrusters, without a run."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Mapping
from contextlib import suppress

import numpy as np
import pytest
import rclpy
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from hypothesis import given
from hypothesis import strategies as st
from nav_msgs.msg import Odometry
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rich.console import Console
from test_view import FORCE, HOSTILE, START_NS, STATE, heard
from test_view import manifest as manifest_of
from visualization_msgs.msg import Marker, MarkerArray

from rpo_core import files
from rpo_core.files.scenario import load_scenario
from rpo_core.files.validation import InputError
from rpo_core.judge.zones import zones_of
from rpo_core.wire import interfaces
from rpo_core.wire.cdr import Status
from rpo_core.wire.statuses import AssuranceStatus, GuidanceStatus
from rpo_ros import conversions, names, qos
from rpo_view import scene, terminal, web_server
from rpo_view.listening import ListeningNode
from rpo_view.live import LiveRun
from rpo_view.onboard import Onboard
from rpo_view.visualizer_node import VisualizerNode

COVARIANCE = (0.04, 0.01, 0.0, 0.01, 0.09, 0.0, 0.0, 0.0, 0.01)
ESTIMATE = (10.3, 60.0, -40.4, 0.1, -0.2, 0.3)
REFERENCE = (10.0, 60.0, -39.0, 0.1, -0.2, 0.26)
PHASE = {'phase': 'hold_60', 'tick': '3', 'reason': 'fly_around is flown'}
ACTS = {'tick': '5', 'mode': 'open', 'constraint': 'keep_out', 'margin_m': '-0.25',
        'margin_m_s': '0.125', **dict.fromkeys(
            [f'{moment}_n.{axis}' for moment in ('before', 'after') for axis in 'xyz'], '0.0')
        }  # fmt: skip
PASSES = {**ACTS, 'tick': '9', 'constraint': '', 'margin_m': '1.5'}


def phase(values: Mapping[str, str] = PHASE) -> GuidanceStatus:
    return GuidanceStatus.of(Status(0, 'guidance', 'so', 'none', tuple(values.items())))


def acts(values: Mapping[str, str] = ACTS) -> AssuranceStatus:
    return AssuranceStatus.of(Status(0, 'assurance', 'so', 'none', tuple(values.items())))


def guided(tick: int = 10) -> LiveRun:
    """Return a run of `hold_points` that was heard to the end of a second."""
    run = LiveRun()
    text = files.read_text(files.find('scenario', 'hold_points'))
    run.on_manifest(manifest_of('plant', text))
    run.onboard.on_guidance(phase())
    run.onboard.on_assurance(acts())
    for i in range(tick + 1):
        run.on_state(START_NS + i * 100_000_000, STATE)
    stamp_ns = START_NS + tick * 100_000_000
    run.onboard.on_estimate(stamp_ns, ESTIMATE, COVARIANCE)
    run.onboard.on_reference(stamp_ns, REFERENCE)
    run.onboard.on_health({'openings': '1234', 'tick': str(tick)})
    run.onboard.on_health({**ACTS, 'tick': str(tick), 'interventions': '2'})
    return run


def shown(run: LiveRun) -> dict:
    return json.loads(json.dumps(run.snapshot('/s'), allow_nan=False))


def printed(run: LiveRun, width: int = 80) -> str:
    console = Console(width=width, record=True, file=open('/dev/null', 'w'))  # noqa: SIM115
    console.print(terminal.view(run, '/s'))
    return console.export_text()


def test_a_flight_without_these_stages_looks_as_before():
    found, text = shown(heard()), printed(heard())
    assert found['zones'] == []
    keys = ('guidance', 'assurance', 'estimate_m', 'sigmas_m', 'reference_m', 'openings', 'miss_m')
    assert [found[key] for key in keys] == [None] * len(keys)
    for word in ('guidance', 'estimate', 'assurance', 'openings'):
        assert word not in text


def test_what_the_stages_say_is_shown():
    found = shown(guided())
    assert found['estimate_error_m'] == pytest.approx(0.5)
    assert found['sigmas_m'] == pytest.approx([0.2, 0.3, 0.1])
    assert found['miss_m'] == pytest.approx(1.0) and found['miss_m_s'] == pytest.approx(0.04)
    assert found['guidance'] == {'phase': 'hold_60', 'reason': PHASE['reason'], 'since_s': 3 * 0.1}
    assert found['assurance'] == {
        'constraint': 'keep_out', 'mode': 'open', 'since_s': 0.5, 'margin_m': -0.25,
        'margin_m_s': 0.125, 'interventions': 2, 'table': '',
    }  # fmt: skip
    (zones,) = found['zones']
    assert zones['keep_out_m'] == 10.0 and zones['port_m'] == [0.0, 1.0, 0.0]
    assert set(zones['points_m']) == {'hold_60', 'hold_20', 'retreat'}
    (near, far), _ = zones['edges_m']['0']
    assert near == [1.0, 0.0] and far == pytest.approx([20.0, 19.0 * math.tan(math.radians(10.0))])
    text = printed(guided())
    for words in ('hold_60 since 0.3 s, 1.000 m from reference', 'sigma x y z 0.200 0.300 0.100 m',
                  '0.500 m off the truth', 'acts: keep_out since 0.5 s, margin -0.25 m, 0.125 m/s',
                  ):  # fmt: skip
        assert words in text
    assert 'phase hold_60  assurance acts: keep_out' in terminal.line(guided(), '/s')
    run = guided()
    run.onboard.on_health({'table': 'armed', 'phase': 'aborting'})
    assert shown(run)['assurance']['table'] == 'armed, aborting'
    run.onboard.on_assurance(acts({**PASSES, 'tick': '10'}))
    assert 'the command passes, margin 1.50 m' in printed(run)


def test_errors_are_of_one_stamp():
    """An estimate beside a state of another tick is off by the way between them."""
    run = guided()
    run.onboard.on_estimate(START_NS - 1, (99.0,) * 6, COVARIANCE)
    run.onboard.on_reference(START_NS - 1, (99.0,) * 6)
    assert shown(run)['estimate_error_m'] == pytest.approx(0.5)
    assert shown(run)['miss_m'] == pytest.approx(1.0)


def test_another_run_takes_nothing_of_the_one_before():
    run = guided()
    run.on_state(START_NS, STATE)
    found = shown(run)
    assert found['guidance'] is found['assurance'] is found['estimate_m'] is None
    run.onboard.on_guidance(phase({**PHASE, 'tick': '0', 'phase': 'fly_around'}))
    assert shown(run)['guidance']['phase'] == 'fly_around'
    known = guided()
    known.on_manifest(manifest_of('plant', 'kind: other'))
    assert known.scenario is None and known.zones == []


KEYS = ('tick', 'phase', 'constraint', 'margin_m', 'openings', 'interventions', 'reason')


@given(st.dictionaries(st.sampled_from(KEYS), st.text(max_size=40)))
def test_no_status_breaks_a_view(values):
    run = guided()
    for reader, taker in ((phase, run.onboard.on_guidance), (acts, run.onboard.on_assurance)):
        with suppress(InputError):
            taker(reader({**(PHASE if reader is phase else ACTS), **values}))
    run.onboard.on_health({'margin_m': HOSTILE, **values})
    shown(run), printed(run)
    assert terminal.line(run, '/s').isprintable()


def test_numbers_beyond_all_floats_are_not_shown():
    run = guided()
    huge = (1.7e308, -1.7e308, 1.7e308, 0.0, 0.0, 0.0)
    for covariance in ((math.nan,) * 9, (math.inf,) * 9, (-1.0,) * 9, (1.7e308,) * 9):
        run.onboard.on_estimate(START_NS, STATE, covariance)
        assert shown(run)['sigmas_m'] is None
    run.onboard.on_estimate(START_NS, huge, COVARIANCE)
    run.onboard.on_reference(START_NS, huge)
    run.onboard.on_health({'openings': '1e308', 'interventions': 'nan'})
    assert (shown(run)['openings'], shown(run)['reference_m']) == (1234, list(REFERENCE[:3]))
    run.onboard.on_estimate(START_NS, STATE, (0.0,) * 9)  # navigation has errors, no estimator
    assert 'off the truth' in printed(run) and 'sigma' not in printed(run)


def test_a_small_terminal_shows_all_of_it():
    run = guided()
    run.exerted_n, run.force_n = (0.1, 0.0, -0.1), FORCE
    for axis in 'xyz':
        run.on_decision(axis, 'position error is large negative ' * 3, {'rule.Z.Z.Z': '0.5'})
    lines = printed(run).splitlines()
    assert len(lines) <= 24 and max(map(len, lines)) <= 80
    assert not any('…' in line for line in lines)


def test_the_page_has_a_place_for_each():
    text = web_server.page().decode()
    for name in ('said-guidance', 'said-estimate', 'said-assurance', 'openings', 'zone-legend'):
        assert f'id="{name}"' in text


# --- the scene of RViz and Foxglove ----------------------------------------------------------


def scene_of(zones=(), onboard=None) -> dict[tuple[str, int], Marker]:
    found = scene.markers(
        Time(sec=5), STATE[:3], FORCE, [STATE[:3]], scene.Look(), zones, onboard
    ).markers
    assert len({(m.ns, m.id) for m in found}) == len(found)
    assert all(m.header.frame_id == names.LVLH_FRAME and m.color.a > 0.0 for m in found)
    return {(m.ns, m.id): m for m in found}


def test_zones_of_the_scenario_replace_the_aids():
    found = scene_of(zones_of(load_scenario('hold_points')))
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
    assert ('keep_out', 1) in scene_of(both)


def matrix_of(q) -> np.ndarray:
    """Return the rotation (3, 3) of a quaternion, as its definition has it."""
    w, v = q.w, np.array([q.x, q.y, q.z])
    cross = np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
    return (w * w - v @ v) * np.eye(3) + 2.0 * np.outer(v, v) + 2.0 * w * cross


@given(st.lists(st.floats(-1.0, 1.0), min_size=9, max_size=9))
def test_the_ellipsoid_is_three_sigma(numbers):
    root = np.array(numbers).reshape(3, 3)
    covariance = root @ root.T + 1e-4 * np.eye(3)
    marker = scene.ellipsoid((1.0, 2.0, 3.0), tuple(covariance.ravel()))
    turned = matrix_of(marker.pose.orientation)
    radii = np.array([marker.scale.x, marker.scale.y, marker.scale.z]) / 2.0
    np.testing.assert_allclose(turned @ turned.T, np.eye(3), atol=1e-9)
    np.testing.assert_allclose(
        turned @ np.diag(radii**2) @ turned.T, 9.0 * covariance, atol=1e-6 * covariance.max()
    )


def test_estimate_and_reference_are_in_the_scene():
    found = scene_of(onboard=guided().onboard)
    for name, place in (('estimate', ESTIMATE), ('reference', REFERENCE), ('sigma', ESTIMATE)):
        at = found[name, 0].pose.position
        assert (at.x, at.y, at.z) == place[:3]
    assert not {'estimate', 'reference', 'sigma'} & {ns for ns, _ in scene_of(onboard=Onboard())}


@pytest.fixture
def bench(ros_env):
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    executor, nodes = SingleThreadedExecutor(), []

    def add(node: Node) -> Node:
        nodes.append(node)
        executor.add_node(node)
        return node

    yield add, executor
    for node in nodes:
        executor.remove_node(node)
        node.destroy_node()
    executor.shutdown(timeout_sec=1.0)
    rclpy.try_shutdown()


def test_nodes_show_what_the_stages_say(bench):
    """Messages as the nodes send them; zones go when a plant has another scenario."""
    add, executor = bench
    view, listener = add(VisualizerNode({'rate_hz': 50.0})), add(ListeningNode('listener'))
    user = add(Node('user'))
    states, estimates, references = (
        user.create_publisher(Odometry, name, qos.LOCKSTEP)
        for name in (names.RELATIVE_STATE, names.NAVIGATION_STATE, interfaces.REFERENCE_STATE)
    )
    said = {
        name: user.create_publisher(DiagnosticStatus, name, qos.LATCHED)
        for name in (interfaces.GUIDANCE_STATUS, 'assurance_status', names.NODE_MANIFEST)
    }
    health = user.create_publisher(DiagnosticArray, names.DIAGNOSTICS, qos.DIAGNOSTICS)
    scenes: list[MarkerArray] = []
    user.create_subscription(MarkerArray, names.MARKERS, scenes.append, qos.LATCHED)

    def status(name, values):
        return conversions.to_status(b'\0', name, 'so', values.items())

    def manifest(name):
        text = files.read_text(files.find('scenario', name))
        values = {'role': 'plant', 'file.scenario.yaml': text}
        said[names.NODE_MANIFEST].publish(status('plant', values))

    def until(condition):
        nonlocal tick
        end = time.monotonic() + 45.0
        while not condition():
            assert time.monotonic() < end
            stamp_ns = START_NS + 100_000_000 * tick
            states.publish(conversions.to_odometry(stamp_ns, STATE))
            references.publish(conversions.to_odometry(stamp_ns, REFERENCE))
            estimate = conversions.to_odometry(stamp_ns, ESTIMATE)
            for row in range(3):
                for column in range(3):
                    estimate.pose.covariance[6 * row + column] = COVARIANCE[3 * row + column]
            estimates.publish(estimate)
            array = DiagnosticArray()
            array.status = [
                status('plant: health', {'openings': '7'}),
                status('elsewhere/plant: health', {'openings': '99'}),
            ]
            health.publish(array)
            tick += 1
            executor.spin_once(timeout_sec=0.01)
            listener.look()

    def shown_ns():
        last = scenes[-1].markers if scenes else ()
        return {m.ns for m in last if m.action == Marker.ADD}

    tick, live = 0, listener.live
    manifest('hold_points')
    said[interfaces.GUIDANCE_STATUS].publish(status('guidance', {**PHASE, 'tick': '0'}))
    said['assurance_status'].publish(status('assurance', {**ACTS, 'tick': '0'}))
    until(lambda: {'port', 'holds', 'sigma', 'reference'} <= shown_ns())
    until(lambda: live.onboard.openings and live.onboard.error and live.onboard.miss)
    assert live.onboard.openings == 7
    assert live.onboard.covariance == COVARIANCE
    assert live.onboard.phase(live.tick).phase == 'hold_60'
    assert live.onboard.acting(live.tick).constraint == 'keep_out'
    assert live.onboard.error == pytest.approx(
        [e - s for e, s in zip(ESTIMATE, STATE, strict=True)]
    )
    manifest('assured')
    until(lambda: 'port' in shown_ns() and 'holds' not in shown_ns())
    assert len(view.live.zones) == 2
