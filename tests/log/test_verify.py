# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Verify passes on true logs and names the right tick of every forgery."""

from __future__ import annotations

import struct
import sys
from dataclasses import fields, replace
from pathlib import Path
from types import SimpleNamespace

import messages
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from log_runs import (
    CLOCK,
    DISTURBANCE,
    FORCE,
    STATE,
    STATUS,
    FreeRun,
    Run,
    chain_run,
    changed,
    flipped,
    forge,
    make_run,
)
from mcap.reader import make_reader
from mcap.records import Schema
from nav_scenarios import LIDAR, make

from rpo_core.attitude.chaser import Chaser, Wheels
from rpo_core.attitude.target import Target
from rpo_core.control.attitude import AttitudeControl
from rpo_core.control.controller import load_controller
from rpo_core.files.validation import InputError
from rpo_core.navigation.sensors import Navigation, NavigationStage
from rpo_core.scenario import scenario
from rpo_core.scenario.scenario import Scenario
from rpo_core.thrusters.table import ThrusterTable
from rpo_core.thrusters.thrusters import Propellant, Thrusters
from rpo_core.wire import cdr, interfaces
from rpo_core.world.disturbance import Disturbance
from rpo_log import log_commands
from rpo_log.errors import ExitCode, LogError
from rpo_log.read.run_log import flight_of, read_run
from rpo_log.tools.record import record
from rpo_log.verify import Verification, evidence, verification, verify
from rpo_log.verify.run_status import Statuses
from rpo_log.write.writer import RunLogWriter

QUICK = settings(max_examples=16, deadline=None, derandomize=True, database=None)


@pytest.fixture(scope='module')
def short_log(short_run, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp('verify_short')
    short_run.write(folder)
    return folder / 'run.mcap'


def test_of_a_definition_all_but_comments_counts():
    wanted = Schema(1, b'float64 x  # of the point\nfloat64 y\n', 'ros2msg', 'a/msg/B')
    for data, same in (
        (b'float64 x\nfloat64 y # ours\n', True),
        (b'float64 y\nfloat64 x\n', False),
    ):
        schemas = (Schema(7, data, 'ros2msg', 'a/msg/B'), wanted)
        one, other = (evidence._comparable([schema]) for schema in schemas)
        assert (one == other) == same


FLOATS = {STATE: cdr.ODOMETRY_FIELDS, FORCE: cdr.WRENCH_FIELDS, DISTURBANCE: cdr.WRENCH_FIELDS}


@QUICK
@given(
    topic=st.sampled_from(sorted(FLOATS)),
    tick=st.one_of(st.sampled_from([0, 1, 49, 50]), st.integers(0, 50)),
    place=st.floats(0.0, 1.0, exclude_max=True),
    bit=st.integers(0, 63),
)
def test_one_flipped_bit_of_any_stored_float(short_log, tmp_path_factory, topic, tick, place, bit):
    fields = FLOATS[topic]
    index = int(place * len(fields))

    def change(name, at, data):
        if (name, at) != (topic, tick):
            return data
        first = len(data) - 8 * (len(fields) - index)
        number = int.from_bytes(data[first : first + 8], 'little') ^ (1 << bit)
        return data[:first] + number.to_bytes(8, 'little') + data[first + 8 :]

    found = verify(forge(short_log, tmp_path_factory.mktemp('flip'), change))
    assert found.exit_code == ExitCode.DIFFERENT
    difference = found.difference
    assert (difference.tick, difference.topic, difference.field) == (tick, topic, fields[index])
    logged, computed = (struct.pack('<d', v) for v in (difference.logged, difference.computed))
    flipped = int.from_bytes(logged, 'little') ^ int.from_bytes(computed, 'little')
    assert flipped == 1 << bit
    assert f'tick {tick}, {topic}, {fields[index]}' in found.sentence()


def test_the_first_of_two_is_named(log, tmp_path):
    difference = verify(forge(log, tmp_path, flipped(FORCE, 60), flipped(STATE, 200))).difference
    assert (difference.tick, difference.topic) == (60, FORCE)


def test_a_consistent_lie_is_found_from_the_start(run, log, tmp_path):
    # Everything after tick 100 follows from a state that was nudged there: each law holds, but for
    # the one step; and with that step's state forged too, the flight no longer starts where it did.
    from rpo_core.world import cw

    control, flown = CONTROLLER, run.flight.scenario
    state = tuple(run.flight.states[100].tolist())
    state = (state[0] + 1e-9, *state[1:])
    lies = {}
    for tick in range(100, 401):
        force = control.force_n(state[:3], state[3:])
        stamp = run.base.stamp_ns(tick)
        lies[STATE, tick] = messages.odometry(stamp, 'target_lvlh', 'chaser', state)
        lies[FORCE, tick] = messages.wrench(stamp, 'target_lvlh', force)
        disturbance = tuple(flown.disturbances_n[tick].tolist())
        pushed = np.clip(force, -flown.max_force_n, flown.max_force_n) + disturbance
        state = cw.cw_step(state, tuple(pushed.tolist()), flown.step)
    found = verify(forge(log, tmp_path, lambda n, t, d: lies.get((n, t), d)))
    assert found.difference.tick == 100
    assert found.difference.field == 'pose.pose.position.x'


def test_what_a_camera_measures_has_the_frame_of_the_chaser_and_once_had_another(tmp_path):
    flown = replace(scenario.load_scenario('tumbling_docking'), duration_s=1.0)
    run, row = chain_run(flown, load_controller('handmade')), interfaces.row_of('measurement')
    record(run.flight, run.attachments, tmp_path / 'new')
    with (tmp_path / 'new/run.mcap').open('rb') as stream:
        found = [m.data for _, _, m in make_reader(stream).iter_messages(['/measurement'])]
    assert {cdr.decode_stamped(row.type, data).texts for data in found} == {('chaser', 'chaser')}
    once = [data for name, _, data in run.messages if name == '/measurement']
    assert cdr.decode_stamped(row.type, once[0]).texts[0] == 'target_lvlh'
    assert [row.layout.decode(d) for d in once] == [row.layout.decode(d) for d in found]
    run.write(tmp_path / 'once')
    unknown = []
    for folder in ('new', 'once'):
        verified = verify(tmp_path / folder)
        assert verified.exit_code == ExitCode.OK
        assert np.isfinite(read_run(tmp_path / folder).values['measurement']).all()
        unknown.append({text for text in verified.unknown if 'the axes of' in text})
    assert unknown == [set(), {'the axes of measurement: its frame is that of older versions'}]
    rename = changed('/measurement', 4, lambda d: d.replace(b'chaser', b'chasex', 1))
    difference = verify(forge(tmp_path / 'new/run.mcap', tmp_path / 'forged', rename)).difference
    assert (difference.tick, difference.field) == (4, 'header.frame_id')


def test_all_measurements_in_other_axes_than_the_scenario_has_are_named(tmp_path):
    """Each message by itself was well formed: a log relabelled from end to end was verified."""
    flown = replace(scenario.load_scenario('paper_test_measured'), duration_s=1.0)
    run, row = chain_run(flown, load_controller('handmade')), interfaces.row_of('measurement')
    record(run.flight, run.attachments, tmp_path / 'run')

    def relabel(name, tick, data):
        if name != '/measurement':
            return data
        stamp_ns, values, _ = row.layout.decode(data)
        return row.layout.also.encode(stamp_ns, values)

    difference = verify(forge(tmp_path / 'run/run.mcap', tmp_path / 'forged', relabel)).difference
    assert (difference.tick, difference.field) == (0, 'header.frame_id')
    assert (difference.logged, difference.computed) == ('chaser', 'target_lvlh')


def test_what_nothing_computes_is_named(short_run, tmp_path):
    """Anybody can put a topic into a log, or leave run_status out."""
    found, names = [], [n for n in short_run.topics if n != STATUS]
    for topic in ('/reference_state', '/applied_disturbance'):
        layout, base = interfaces.row_of(topic[1:]).layout, short_run.base
        sevens = [7.0] * len(layout.columns)
        more = [(topic, t, layout.encode(base.stamp_ns(t), sevens)) for t in range(51)]
        run = replace(short_run, topics=(*names, topic))
        run.write(tmp_path / topic[1:], sorted([*run.messages, *more], key=lambda m: m[1]))
        found.append(verify(tmp_path / topic[1:]))
    assert 'reference_state, which no stage of its scenario makes' in found[0].unknown
    assert 'how the flight began and ended: no run_status says it' in found[0].unknown
    assert not [text for text in found[0].recomputed if 'run_status' in text]
    assert (found[1].difference.tick, found[1].difference.topic) == (0, '/applied_disturbance')


def test_a_given_number_from_which_nothing_follows_is_a_difference(log, tmp_path):
    """The commands of such a tick were not recomputed, and nothing said so."""
    row = interfaces.row_of('relative_state')

    wrong = changed(STATE, 7, lambda d: row.layout.encode(cdr.stamp_ns(d), [np.nan] * 6))
    found = verify(forge(log, tmp_path, wrong), given=['relative_state']).difference
    assert (found.tick, found.check) == (7, 'given')


def test_a_log_of_free_running_must_say_what_acted(short_run, tmp_path):
    run = replace(short_run, topics=(*short_run.topics, '/applied_force'))
    row = interfaces.row_of('applied_force')
    more = [('/applied_force', tick, row.layout.encode(cdr.stamp_ns(data), [0.0] * 3))
            for name, tick, data in run.messages if name == STATE]  # fmt: skip
    run.write(tmp_path, sorted([*run.messages, *more], key=lambda m: m[1]))
    with pytest.raises(LogError, match='has no topic applied_disturbance'):
        verify(tmp_path)


@pytest.mark.parametrize(
    ('topic', 'change', 'field'),
    [
        (FORCE, lambda d: d.replace(b'target_lvlh', b'target_lvlx'), 'header.frame_id'),
        (STATE, lambda d: d[:40] + b'\x01' + d[41:], 'bytes between its fields'),
    ],
)
def test_the_frame_and_what_lies_between_fields(log, tmp_path, topic, change, field):
    difference = verify(forge(log, tmp_path, changed(topic, 9, change))).difference
    assert (difference.tick, difference.field) == (9, field)


def test_a_lie_beyond_a_hole_is_found(log, tmp_path):
    found = verify(forge(log, tmp_path, changed(FORCE, 120, None), flipped(FORCE, 300)))
    assert found.exit_code == ExitCode.DIFFERENT
    assert found.difference.tick == 300


def test_a_run_that_was_aborted(run, tmp_path):
    # state 200 was sent and not answered any more
    sent = [m for m in run.messages if m[1] < 200 or m[:2] in ((CLOCK, 200), (STATE, 200))]
    figures = run.figures(200, 'aborted')
    sent.append((STATUS, 200, cdr.encode_status(2, 'run', 'no answer', 'none', figures)))
    assert run.write(tmp_path, sent).whole
    found = verify(tmp_path)
    assert found.exit_code == ExitCode.INCOMPLETE
    assert 'ends at tick 200 of 400 (aborted)' in found.sentence()


def test_a_log_without_its_controller_verifies_all_else(short_run, tmp_path, monkeypatch):
    """A controller of somebody else's has no file of ours: what it commands is a premise."""
    carried = {k: v for k, v in short_run.attachments.items() if k != 'controller.yaml'}
    replace(short_run, attachments=carried).write(tmp_path)
    found = verify(tmp_path)
    assert found.exit_code == ExitCode.INCOMPLETE and found.difference is None
    assert len(found.gaps) == 1 and 'no controller.yaml' in found.gaps[0]
    given = verify(tmp_path, given=['control_force'])
    assert (given.exit_code, given.gaps) == (ExitCode.GIVEN, ())
    assert given.given == ('control_force (controller)',)
    assert found.stages == given.stages == ('disturbance', 'thrusters', 'dynamics')
    monkeypatch.setattr(sys, 'argv', ['verify', str(tmp_path), '--given', 'control_force'])
    assert log_commands.main('verify') == ExitCode.GIVEN == 4

    stamp_ns = short_run.base.stamp_ns(20)
    push = changed(FORCE, 20, messages.wrench(stamp_ns, 'target_lvlh', [0.1, 0.1, 0.1]))
    forged = verify(forge(tmp_path / 'run.mcap', tmp_path / 'forged', push))
    assert forged.exit_code == ExitCode.DIFFERENT and forged.difference.tick == 21


# Logs of every kind of stage: proved across blocks, with gaps, forged.

EXERTED, MEASURED, ESTIMATE = '/exerted_force', '/measurement', '/navigation_state'
PUSH, ATTITUDE, BODY = '/estimated_disturbance', '/target_attitude', '/body_force'
CONTROLLER = load_controller('handmade')
LEO = scenario.load_scenario('world_leo')
WORLD = replace(LEO, duration_s=2.0, sections=(LEO.dynamics, LEO.thrusters))
MATRIX = ((0.97, 0.02, 0.0), (-0.02, 1.04, 0.01), (0.0, -0.01, 0.99))
LATE = Thrusters(MATRIX, 3)
ERRORS = Navigation((0.02, 0.0, -0.01), (0.0, 0.001, 0.0), 0.01, 0.0005, (7, 8))
HARDWARE = replace(scenario.load_scenario('paper_test'), duration_s=2.0).equipped(LATE, ERRORS)
SENSORS = make([{**LIDAR, 'latency_ticks': 2}], ticks=30, estimator={'disturbance_sigma_n': 0.01})
SPIN = Target(kind='spin', axis=(1.0, 2.0, 3.0), rate_deg_s=9.0)
TURNING = replace(scenario.load_scenario('approach'), duration_s=2.0).equipped(SPIN)
STEERED = replace(scenario.load_scenario('approach'), duration_s=2.0).equipped(
    Chaser(
        inertia_kg_m2=((0.6, 0.02, 0.0), (0.02, 0.7, 0.01), (0.0, 0.01, 0.5)),
        rates_deg_s=(1.0, -0.5, 0.5),
        wheels=Wheels(torque_nm=0.02, momentum_nms=0.5),
    ),
    AttitudeControl(controller='attitude_pd'),
    Thrusters(table=ThrusterTable(preset='corners_24', force_n=0.17, arm_m=0.3)),
)
SCENARIOS = {
    'world': WORLD,
    'hardware': HARDWARE,
    'sensors': SENSORS,
    'turning': TURNING,
    'steered': STEERED,
}


def run_of(attached: Scenario, flown: Scenario | None = None) -> Run:
    """Return the run of a scenario, or of another one than the log carries."""
    run = chain_run(flown or attached, CONTROLLER)
    attachments = run.attachments | {'scenario.yaml': scenario.dumps(attached).encode()}
    return replace(run, flight=replace(run.flight, scenario=attached), attachments=attachments)


@pytest.fixture(scope='module')
def runs():
    """Return the runs of all scenarios, by name."""
    return {name: run_of(flown) for name, flown in SCENARIOS.items()}


RECOMPUTED = {
    'world': 'recomputed: controller, thrusters, dynamics',
    'hardware': 'recomputed: navigation, controller, disturbance, thrusters, dynamics',
    'sensors': 'recomputed: sensors, estimator, controller',
    'turning': 'recomputed: controller, thrusters, target, dynamics',
    'steered': 'recomputed: controller, attitude_control, thrusters, attitude, dynamics',
}


@pytest.mark.parametrize('name', SCENARIOS)
def test_it_is_verified(blocks, runs, name, tmp_path):
    runs[name].write(tmp_path)
    verified = verify(tmp_path)
    assert verified.exit_code == 0, verified.sentence()
    assert RECOMPUTED[name] in verified.sentence()
    assert f'{SCENARIOS[name].ticks + 1} ticks bit for bit' in verified.sentence()


@pytest.mark.parametrize(
    ('name', 'topic', 'place', 'check'),
    [
        ('world', EXERTED, 0, 'thrusters'), ('world', STATE, 0, 'dynamics'),
        ('world', FORCE, 0, 'controller'), ('hardware', ESTIMATE, 0, 'navigation'),
        ('hardware', FORCE, 0, 'controller'), ('hardware', DISTURBANCE, 0, 'disturbance'),
        ('sensors', MEASURED, 0, 'sensors'), ('sensors', MEASURED, 2, 'sensors'),
        ('sensors', ESTIMATE, 0, 'estimator'), ('sensors', ESTIMATE, 7, 'estimator'),
        ('sensors', PUSH, 0, 'estimator'), ('sensors', FORCE, 0, 'controller'),
        ('sensors', STATE, 0, 'dynamics'),
        ('turning', ATTITUDE, 0, 'target'), ('turning', ATTITUDE, 1, 'target'),
        ('steered', STATE, 0, 'dynamics'), ('steered', STATE, 2, 'attitude'),
        ('steered', STATE, 3, 'attitude'), ('steered', BODY, 0, 'attitude_control'),
        ('steered', BODY, 1, 'attitude_control'), ('steered', EXERTED, 0, 'attitude'),
        ('steered', EXERTED, 1, 'thrusters'), ('world', STATE, 2, 'rest'),
    ],
)  # fmt: skip
def test_one_bit_of_a_message_is_found(small_blocks, runs, name, topic, place, check, tmp_path):
    runs[name].write(tmp_path / 'a')
    change = flipped(topic, 15, place)
    found = verify(forge(tmp_path / 'a/run.mcap', tmp_path / 'b', change)).difference
    assert (found.check, found.tick, found.topic) == (check, 15, topic)


PUSH_X = Disturbance((0.01, 0.0, 0.0))
AIR = replace(LEO.dynamics, drag=replace(LEO.dynamics.drag, density_kg_m3=2.1e-11))
TANK = Propellant(specific_impulse_s=71.0, mass_kg=0.5)
VALVES = replace(LEO.thrusters.pulses, dead_time_s=0.0)


@pytest.mark.parametrize(
    ('attached', 'flown', 'check'),
    [
        (HARDWARE, {'mass_kg': 10.5}, 'dynamics'),
        (HARDWARE, {'initial_position_m': (10.0, 60.5, -40.0)}, 'start'),
        (WORLD, (LEO.dynamics, replace(LEO.thrusters, propellant=TANK)), 'dynamics'),
        (TURNING, (replace(SPIN, rate_deg_s=9.0000001),), 'target'),
    ],
)  # fmt: skip
def test_another_world_than_the_scenarios_is_found(small_blocks, attached, flown, check, tmp_path):
    """The test of what was given has more of them."""
    changes = flown if isinstance(flown, dict) else {'sections': flown}
    run_of(attached, replace(attached, **changes)).write(tmp_path)
    assert verify(tmp_path).difference.check == check


BIASED = {**LIDAR, 'latency_ticks': 2, 'bias_m': [0.0, 0.1, 0.0]}
SENSOR = make([BIASED], ticks=30, estimator={'disturbance_sigma_n': 0.01})
FILTER = make([{**LIDAR, 'latency_ticks': 2}], ticks=30, estimator={'disturbance_sigma_n': 0.02})
DRAG, SHUT = (AIR, LEO.thrusters), (LEO.dynamics, replace(LEO.thrusters, pulses=VALVES))
NOISE = (LATE, replace(ERRORS, noise_key=(7, 9)))
ESTIMATED = {ESTIMATE: 'estimator', PUSH: 'estimator'}
# The scenario attached and the one flown; what is given; what is recomputed all the same.
GIVEN = {
    'plant': (WORLD, replace(WORLD, sections=DRAG), {STATE: 'dynamics'}, 'controller, thrusters'),
    'valves': (  # of thrusters the dynamics read the mass too
        WORLD, replace(WORLD, sections=SHUT), {EXERTED: 'thrusters'},
        'controller, thrusters, dynamics',
    ),
    'ideal thrusters': (
        HARDWARE, replace(HARDWARE, sections=(ERRORS,)), {STATE: 'dynamics'},
        'navigation, controller, disturbance',
    ),
    'navigation': (
        HARDWARE, replace(HARDWARE, sections=NOISE), {ESTIMATE: 'navigation'},
        'controller, disturbance, thrusters, dynamics',
    ),
    'injector': (
        HARDWARE, replace(HARDWARE, disturbance=PUSH_X), {DISTURBANCE: 'disturbance'},
        'navigation, controller, thrusters, dynamics',
    ),
    'sensor': (SENSORS, SENSOR, {MEASURED: 'sensors'}, 'estimator, controller'),
    'estimator': (SENSORS, FILTER, ESTIMATED, 'sensors, controller'),
}  # fmt: skip


@pytest.mark.parametrize('case', GIVEN.values(), ids=GIVEN)
def test_what_was_given_is_named_and_all_else_is_recomputed(case, tmp_path):
    attached, flown, made_by, recomputed = case
    run_of(attached, flown).write(tmp_path)
    assert verify(tmp_path).difference.check in made_by.values()
    found = verify(tmp_path, given=[topic[1:] for topic in made_by])
    assert found.exit_code == ExitCode.GIVEN, found.sentence()
    said = ', '.join(f'{topic[1:]} ({stage})' for topic, stage in made_by.items())
    said += ', figures of run_status' * (STATE in made_by)
    assert f'given, not judged: {said}; recomputed: {recomputed}' in found.sentence()
    # One bit of anything else is found as before.
    other = flipped(FORCE if FORCE not in made_by else STATE, 15)
    forged = forge(tmp_path / 'run.mcap', tmp_path / 'b', other)
    found = verify(forged, given=[topic[1:] for topic in made_by])
    assert (found.exit_code, found.difference.check) == (ExitCode.DIFFERENT, 'controller')


def test_a_plant_that_flew_on_without_the_attitude_controller_had_no_torque_either(
    turning, tmp_path
):
    """Else nothing that follows was computed again, and the log was verified all the same."""
    log = read_run(turning)
    writer = RunLogWriter(tmp_path, log.base, [t.name for t in log.topics], log.attachments)
    said = {'phase': 'running', 'tick': '30', 'dropped': 'body_force'}
    with (Path(turning) / 'run.mcap').open('rb') as file:
        for _, channel, message in make_reader(file).iter_messages():
            tick = (message.log_time - log.base.epoch_ns) // log.base.dt_ns
            if (channel.topic, tick) == ('/body_force', 30):
                writer.write('/run_status', 30, cdr.encode_status(1, 'run', '', 'none', said))
            if channel.topic != '/body_force' or tick < 30:
                writer.write(channel.topic, tick, message.data)
    assert writer.close().whole
    found = verify(tmp_path).difference
    assert (found.tick, found.check) == (30, 'thrusters')
    assert found.topic == '/exerted_force', 'it exerted what nobody commanded'
    flight = flight_of(read_run(tmp_path))
    for name in ('body_force', 'body_torque'):
        assert flight.signals[name][:30].any() and not flight.signals[name][30:].any()


@pytest.mark.parametrize(
    ('name', 'said'),
    [
        ('body_torque', 'body_torque (attitude_control)'),
        ('body_force', 'body_force (attitude_control)'),
        ('chaser_attitude', 'chaser_attitude (attitude)'),
        ('relative_state', 'relative_state (dynamics, attitude)'),
    ],
)
def test_what_rides_in_a_message_is_named_where_it_was_given(name, said, turning):
    """Else a torque that nobody judged would be said to be verified."""
    found = verify(turning, given=[name])
    assert found.exit_code == 4 and found.given[0] == said


def test_only_a_topic_of_the_log_can_be_given(runs, tmp_path):
    runs['world'].write(tmp_path)
    with pytest.raises(InputError, match='`--given` must be one of relative_state, control_force'):
        verify(tmp_path, given=['navigation_state'])


def test_a_controller_that_saw_another_state_than_that_of_navigation_is_found(
    small_blocks, tmp_path
):
    """The messages of navigation are right; the commands answer the true state."""
    blind = run_of(HARDWARE, replace(HARDWARE, sections=(LATE,)))
    stage, states = NavigationStage(HARDWARE.named('navigation')), blind.flight.states
    (seen,) = stage.steps(np.arange(len(states)), states)
    signals = blind.flight.signals | {ESTIMATE[1:]: seen}
    run = replace(
        blind, flight=replace(blind.flight, signals=signals), topics=(*blind.topics, ESTIMATE)
    )
    run.write(tmp_path)
    assert verify(tmp_path).difference.check == 'controller'


def without(run: Run, topic: str, tick: int):
    """Return the messages of a run but for one."""
    return [message for message in run.messages if message[:2] != (topic, tick)]


@pytest.mark.parametrize('topic', [STATE, FORCE, ESTIMATE, DISTURBANCE, CLOCK])
def test_a_missing_message_is_a_gap_and_no_difference(small_blocks, runs, topic, tmp_path):
    run = runs['hardware']
    run.write(tmp_path, without(run, topic, 10))
    verified = verify(tmp_path)
    assert verified.difference is None, verified.sentence()
    assert verified.exit_code == ExitCode.INCOMPLETE
    assert f'1 messages of {topic} are missing' in verified.sentence()


@pytest.mark.parametrize(('name', 'ticks'), [('world', 10), ('hardware', 3)])
def test_thrusters_with_memory_are_a_named_gap_after_a_missing_command(
    small_blocks, runs, name, ticks, tmp_path
):
    """Valves remember all commands, a delay those of its ticks."""
    runs[name].write(tmp_path, without(runs[name], FORCE, 10))
    verified = verify(tmp_path)
    assert verified.exit_code == ExitCode.INCOMPLETE and verified.difference is None
    gap = f'thrusters could not be recomputed at {ticks} ticks, the first is 11'
    assert gap in verified.sentence()


@pytest.mark.parametrize(
    ('name', 'topic', 'stage'),
    [
        ('world', EXERTED, 'thrusters'),
        ('hardware', ESTIMATE, 'navigation'),
        ('hardware', DISTURBANCE, 'disturbance'),
    ],
)
def test_without_its_topic_a_stage_cannot_be_verified(runs, name, topic, stage, tmp_path):
    run = runs[name]
    replace(run, topics=tuple(t for t in run.topics if t != topic)).write(tmp_path)
    said = f'no topic {topic[1:]}, but its scenario has the stage {stage}'
    with pytest.raises(LogError, match=said):
        verify(tmp_path)


def test_a_tick_that_navigation_missed_is_recomputed_as_missed(small_blocks, tmp_path):
    missed = dict.fromkeys(('sensors', 'estimator', 'controller'), (10, 19, 20))
    run = FreeRun(SENSORS, missed=missed)
    run.write(tmp_path / 'run')
    verified = verify(tmp_path / 'run')
    assert verified.difference is None, verified.sentence()
    assert 'estimator could not' not in verified.sentence()
    run.write(tmp_path / 'forged', flipped('/navigation_state', 25))
    found = verify(tmp_path / 'forged').difference
    assert (found.check, found.tick) == ('estimator', 25)


def test_a_message_that_the_recorder_missed_is_a_gap_that_is_said(small_blocks, tmp_path):
    names = 'measurement', 'navigation_state', 'estimated_disturbance'
    FreeRun(SENSORS, unlogged=[(name, 10) for name in names]).write(tmp_path)
    verified = verify(tmp_path)
    assert verified.difference is None, verified.sentence()
    assert 'estimator could not be recomputed at 20 ticks, the first is 11' in verified.sentence()


def test_a_part_of_a_flight_is_no_forgery(small_blocks, short_run, tmp_path):
    """What was spent before it is not known; the last part was `NOT as computed`."""
    short_run.write(tmp_path, split_s=2.0)
    for number, gap in enumerate(('ends at tick 19', 'begins at tick 20', 'begins at tick 40')):
        found = verify(tmp_path / f'run_{number}.mcap')
        assert found.exit_code == ExitCode.INCOMPLETE and gap in found.sentence()
    sent = [m for m in short_run.messages if m[1] != 30]
    short_run.write(tmp_path / 'hole', sent)
    assert verify(tmp_path / 'hole').exit_code == ExitCode.INCOMPLETE


@pytest.mark.parametrize('free', [False, True])
def test_what_free_running_does_not_log_is_not_compared(free):
    """And of the energy there are two sums: older plants added up in another order."""
    flown = make_run(1.0).flight
    compared = Statuses(flown.scenario, SimpleNamespace(name='/status'), free, ())
    for ticks in (slice(0, 6), slice(6, 11)):
        values = {interfaces.RELATIVE_STATE: flown.states[ticks]}
        block = SimpleNamespace(ticks=np.arange(11)[ticks], values=values)
        compared.account(block, flown.forces_n[ticks], flown.forces_n[ticks] + 1.0)
    squares = flown.forces_n[:7] ** 2
    by_axis = repr(float(sum(map(float, np.cumsum(squares, axis=0)[-1]))) * flown.scenario.dt_s)
    in_turn = 0.0
    for x, y, z in squares.tolist():
        in_turn += (x + y + z) * flown.scenario.dt_s
    for energy in (by_axis, repr(in_turn)):
        found = {name: pair for name, *pair in compared._figures(7, {'energy_n2s': energy})}
        assert found['energy_n2s'] == [energy, energy]
        assert found['distance_m'][0] == 'nothing'
        assert found.get('saturated_ticks') == (None if free else ['nothing', '7'])


def test_all_that_was_found_is_said_and_nothing_else():
    """Each list of a verification, alone and with all others, is in what people read of it."""
    empty = verification.Verification(Path('a'), 3)
    assert empty.sentence() == 'a: verified, 3 ticks bit for bit; recomputed: nothing'
    lists = [row.name for row in fields(empty) if row.type == 'tuple[str, ...]']
    words = {name: (f'one of {name}', f'{name} too') for name in lists}
    for found in [*({name: words[name]} for name in lists), words, words | {'faults': ()}]:
        told = '\n'.join(replace(empty, **found).lines())
        least = ('faults', 'gaps') if found.get('faults') else lists  # then nothing is proven
        said = [name for name in lists if all(text in told for text in words[name])]
        assert said == [name for name in lists if name in least and found.get(name)]


def run_status(folder: Path, change) -> Verification:
    """Verify a log whose run_status was changed."""
    run = make_run(3.0)
    sent = [(n, t, change(t, d) if n == STATUS else d) for n, t, d in run.messages]
    run.write(folder, [message for message in sent if message[2]])
    return verify(folder)


@pytest.mark.parametrize(
    ('name', 'value', 'field'),
    [
        ('phase', 'aborted', 'level'), ('phase', 'landed', 'phase'),
        ('energy_n2s', '-0.0', 'energy_n2s'), ('tick', '29', 'tick'),
        ('distance_m', None, 'distance_m'), ('distance_m', 'near', 'distance_m'),
        ('saturated_ticks', '1', 'saturated_ticks'), ('time_s', '3.00', 'time_s'),
        ('speed_m_s', 'nan', 'speed_m_s'), ('more', '1', 'values'),
        ('energy_n2s', 'its last digit', 'energy_n2s'),
    ],
)  # fmt: skip
def test_run_status_says_nothing_that_was_not_so(tmp_path, name, value, field):
    def change(tick, data):
        if tick == 0:
            return data
        status = cdr.decode_status(data)
        values = dict(status.values)
        last = '1' if values['energy_n2s'][-1] != '1' else '2'
        values[name] = values['energy_n2s'][:-1] + last if value == 'its last digit' else value
        kept = {key: text for key, text in values.items() if text is not None}
        return cdr.encode_status(*status[:4], kept)

    found = run_status(tmp_path, change).difference
    assert (found.tick, found.topic, found.field) == (30, STATUS, field)


@pytest.mark.parametrize('tick', [0, 30])
def test_a_flight_that_says_neither_begin_nor_end_is_not_whole(tmp_path, tick):
    found = run_status(tmp_path, lambda t, d: None if t == tick else d)
    assert found.exit_code == ExitCode.INCOMPLETE
