# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Logs of flights in which a stage was switched off, a peer was lost, an abort table decided."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from log_runs import DISTURBANCE, FORCE, STATE, STATUS, TOPICS, Run, chain_run, make_run

from rpo.training.config import load_start
from rpo_core.assurance.abort_table import AbortTable, Row
from rpo_core.assurance.assurance import AssuranceStage
from rpo_core.assurance.settings import Assurance
from rpo_core.assurance.shaping import Shaping, ShapingStage
from rpo_core.attitude.target import TargetStage
from rpo_core.chain.chain import Chain
from rpo_core.chain.flight import fly
from rpo_core.control.controller import load_controller
from rpo_core.guidance.guidance import GuidanceStage
from rpo_core.navigation.attitude_estimator import AttitudeEstimatorStage
from rpo_core.navigation.attitude_sensors import AttitudeSensors
from rpo_core.navigation.estimator import EstimatorStage
from rpo_core.navigation.sensors import Navigation, NavigationStage, SensorsStage
from rpo_core.scenario.scenario import load_scenario
from rpo_core.thrusters.thrusters import TableStage
from rpo_core.wire import cdr
from rpo_core.wire.interfaces import ASSURED_FORCE, RELATIVE_STATE
from rpo_core.world.disturbance import NONE, DisturbanceStage
from rpo_core.world.dynamics import DynamicsStage
from rpo_log.errors import ExitCode
from rpo_log.read.run_log import flight_of, read_run
from rpo_log.verify import verify

# Where nobody has compiled the kernels of the attitude yet, one test does: 22 s of CPU time, which
# are more than 300 s on a machine that does ten other things.
pytestmark = pytest.mark.timeout(900)

STAGE_STATUS = '/stage_status'
OFF = range(20, 30)
LOST_AT = 25


CONTROLLER = type(load_controller('handmade').stage(0.1))


def said(state, tick, stage='controller'):
    """Return what the controller says when it is switched off or on, and of which tick."""
    values = {'stage': stage, 'state': state, 'tick': str(tick), 'reason': 'test'}
    return STAGE_STATUS, tick, cdr.encode_status(1, stage, state, 'none', values)


def switched_off(stage='controller'):
    """Return what it says when a stage is switched off, and on again."""
    return said('inactive', OFF.start, stage), said('active', OFF.stop, stage)


SWITCHED = switched_off()


@pytest.fixture(scope='module')
def switched():
    """Five seconds, the controller switched off for one."""
    run = make_run(5.0)
    flight = flown_without(CONTROLLER, run.flight.scenario, OFF).flight
    return Run(flight, run.attachments, (*TOPICS, STAGE_STATUS))


def with_events(run, events, late=0):
    """Return the messages of a run, each event before those of its tick, or so many ticks late."""
    sent = list(run.messages)
    for event in events:
        at = next(i for i, m in enumerate(sent) if m[1] == event[1] + late)
        sent.insert(at, event)
    return sent


@pytest.mark.parametrize('late', [0, 3])
def test_a_controller_that_was_switched_off_verifies(blocks, switched, late, tmp_path):
    summary = switched.write(tmp_path, with_events(switched, SWITCHED, late))
    assert summary.whole and summary.messages[STAGE_STATUS] == 2
    found = verify(tmp_path)
    assert found.exit_code == ExitCode.OK, found.sentence()
    assert found.stages == ('controller', 'disturbance', 'thrusters', 'dynamics')
    assert 'recomputed: controller, disturbance' in found.sentence()
    assert 'by events of the log: controller off at ticks 20 to 29; ' in found.sentence()
    log = read_run(tmp_path)
    assert [e.values['state'] for e in log.events if e.signal == 'stage_status'] == [
        'inactive', 'active',
    ]  # fmt: skip
    assert [tick for tick, _ in log.statuses] == [0, 50]


@pytest.mark.parametrize(
    'events',
    [SWITCHED[1:], switched_off('guidance')],
    ids=['not said', 'said of another stage'],
)
def test_zero_without_the_event_is_a_difference(small_blocks, switched, events, tmp_path):
    switched.write(tmp_path, with_events(switched, events))
    found = verify(tmp_path).difference
    assert (found.tick, found.topic, found.check) == (OFF.start, FORCE, 'controller')


def test_a_command_of_a_controller_that_is_switched_off_is_a_difference(small_blocks, tmp_path):
    run = replace(make_run(5.0), topics=(*TOPICS, STAGE_STATUS))
    run.write(tmp_path, with_events(run, SWITCHED))
    found = verify(tmp_path).difference
    assert (found.tick, found.topic, found.check) == (OFF.start, FORCE, 'controller')
    assert found.computed == 0.0


def test_events_of_stages_that_are_not_there_are_named(tmp_path):
    run = replace(make_run(5.0), topics=(*TOPICS, STAGE_STATUS))
    stages = ('b', 'a', 'nobody\n', 'dynamics', 'guidance')  # the last is written first
    events = [said('inactive', 20, stage) for stage in stages] + [said('active', 21, 'guidance')]
    run.write(tmp_path, with_events(run, events))
    found = verify(tmp_path)
    assert (found.exit_code, found.by_events) == (ExitCode.OK, ())
    named = [text for text in found.unknown if text.startswith('events of')]
    assert [text.partition(',')[0] for text in named[:3]] == [
        "events of 'guidance' (2", "events of 'dynamics' (1", "events of 'nobody\\n' (1",
    ]  # fmt: skip
    assert named[3:] == ['events of 2 other such stages']


def test_an_event_that_has_two_readings_is_a_difference(switched, tmp_path):
    """One reader takes the first of two values of a name, another one the last."""
    for name in 'stage', 'state', 'tick':
        values = {'stage': 'controller', 'state': 'inactive', 'tick': '20', 'reason': 'test'}
        pairs = [*values.items(), (name, values[name])]
        event = STAGE_STATUS, 20, cdr.encode_status(1, 'controller', '', 'none', pairs)
        switched.write(tmp_path / name, with_events(switched, [event, SWITCHED[1]]))
        found = verify(tmp_path / name).difference
        assert (found.tick, found.topic, found.field) == (20, 'stage_status', 'values')


@pytest.mark.parametrize(
    ('states', 'text'),
    [
        (('inactive', 'inactive'), 'controller off at ticks 20 to 29'),
        (('active', 'inactive'), 'controller off at ticks 20 to 29'),
        (('inactive', 'active'), ''),
    ],
)
def test_of_two_events_at_one_tick_the_last_counts(switched, tmp_path, states, text):
    run = switched if text else replace(make_run(5.0), topics=(*TOPICS, STAGE_STATUS))
    first = [said(states[0], 20)] * (states[0] != states[1])
    run.write(tmp_path, with_events(run, [said(states[1], 20), *first, *SWITCHED[1:]]))
    assert [e.values['state'] for e in read_run(tmp_path).events if e.tick == 20] == [
        *states[1 - len(first) :]
    ]
    found = verify(tmp_path)
    assert found.difference is None, found.sentence()
    assert found.by_events == ((text,) if text else ())


ASSURED = replace(load_scenario('assured'), duration_s=4.0)


@pytest.mark.parametrize(
    ('off', 'text'),
    [
        (range(1000), 'off at ticks 0 to 40'),
        (range(20, 30), 'off at ticks 20 to 29'),
        (range(40, 41), 'off at tick 40'),
    ],
)
def test_the_first_line_names_a_stage_that_was_off(small_blocks, off, text, tmp_path):
    """A flight without assurance was verified: recomputed, it said, was assurance too."""
    events = [said('inactive', off.start, 'assurance')]
    events += [said('active', off.stop, 'assurance')] * (off.stop < 40)
    run = flown_without(AssuranceStage, ASSURED, off, tuple(events))
    run.write(tmp_path)
    found = verify(tmp_path)
    assert found.difference is None and not found.gaps, found.sentence()
    assert f'by events of the log: assurance {text}; recomputed: navigation' in found.sentence()
    assert ('assurance' in found.stages) == (off != range(1000))


def test_what_else_events_alone_say_of_a_stage_is_named(small_blocks, tmp_path):
    """A filter that forgets, a command to the abort table: nothing computes that it was so."""
    events = [said('active', tick, 'estimator') for tick in (10, 20)]
    plain = EstimatorStage.step

    def forgets(self, tick, *inputs):
        if tick in (10, 20):
            self.reset()
        return plain(self, tick, *inputs)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(EstimatorStage, 'step', forgets)
        run = chain_run(WHOLE, load_controller('handmade'), events=tuple(events))
    run.write(tmp_path)
    found = verify(tmp_path)
    assert found.difference is None and 'estimator' in found.stages, found.sentence()
    assert 'log: estimator without memory from ticks 10, 20 on;' in found.sentence()


def lost(folder, topic=FORCE, since=LOST_AT, says=((LOST_AT, LOST_AT),), until=LOST_AT):
    """Write the log of a flight whose plant went on without a peer; return summary and flight.

    says : of which tick run_status says so, and at which; until : the first tick without a message
    """
    run = make_run(5.0)
    kind = CONTROLLER if topic == FORCE else DisturbanceStage
    flight = flown_without(kind, run.flight.scenario, range(since, 100)).flight
    flown = Run(flight, run.attachments)
    sent = [m for m in flown.messages if m[0] != topic or m[1] < until]
    for tick, at in says:
        values = {**flown.figures(tick, 'running'), 'dropped': topic[1:]}
        status = cdr.encode_status(1, 'run', f'coasting from {tick} on', 'none', values)
        place = next(i for i, m in enumerate(sent) if m[1] == at) + 1
        sent.insert(place, (STATUS, at, status))
    return run.write(folder, sent), flight


@pytest.mark.parametrize('topic', [FORCE, DISTURBANCE])
def test_a_plant_that_went_on_without_a_peer_verifies(small_blocks, topic, tmp_path):
    assert lost(tmp_path, topic)[0].whole
    found = verify(tmp_path)
    assert found.exit_code == ExitCode.OK, found.sentence()
    assert f'log: flown without {topic[1:]} from tick {LOST_AT} on; rec' in found.sentence()
    assert read_run(tmp_path).complete


@pytest.mark.parametrize('again', [LOST_AT - 5, LOST_AT + 5])
def test_of_a_peer_that_was_lost_twice_the_first_word_counts(small_blocks, again, tmp_path):
    """As in the nodes; a command after it counted as one that acted."""
    summary, flight = lost(tmp_path, says=((LOST_AT, LOST_AT), (again, LOST_AT + 5)))
    found = verify(tmp_path)
    assert summary.whole and found.exit_code == ExitCode.OK, found.sentence()
    assert f'flown without control_force from tick {LOST_AT} on;' in found.sentence()
    assert read_run(tmp_path).complete
    assert flight_of(read_run(tmp_path)).forces_n.tolist() == flight.forces_n.tolist()


def test_a_controller_that_was_lost_from_the_start_was_not_recomputed(tmp_path):
    lost(tmp_path, since=0, says=((0, 0),), until=0)
    found = verify(tmp_path)
    assert found.difference is None, found.sentence()
    assert found.stages == ('disturbance', 'thrusters', 'dynamics')
    assert 'flown without control_force from tick 0 on' in found.sentence()


@pytest.mark.parametrize('topic', [FORCE, DISTURBANCE])
def test_a_peer_that_is_missing_before_it_was_lost_is_missing(small_blocks, topic, tmp_path):
    summary, _ = lost(tmp_path, topic, until=LOST_AT - 1)
    assert summary.missing == {topic: (1, LOST_AT - 1)}
    assert read_run(tmp_path).gaps == (f'1 messages of {topic} are missing',)


def test_without_the_word_of_the_plant_its_messages_are_missing(tmp_path):
    assert not lost(tmp_path, says=())[0].whole
    assert verify(tmp_path).exit_code == ExitCode.INCOMPLETE


WHOLE = replace(load_scenario('docking_leo'), duration_s=4.0)
UNGUIDED = tuple(s for s in WHOLE.sections if s is not WHOLE.named('guidance'))
PUSHED = replace(make_run(4.0).flight.scenario, sections=(Navigation(position_noise_m=0.01),))
SHAPED = replace(PUSHED, sections=(Shaping(slew_n_s=1.0, dead_zone_n=0.3),))
DOCKED = replace(load_scenario('tumbling_docking'), duration_s=4.0)
STARS = DOCKED.section(AttitudeSensors)
SELDOM = DOCKED.equipped(replace(STARS, star_tracker=replace(STARS.star_tracker, period_ticks=7)))
STAGES = {
    AttitudeEstimatorStage: SELDOM,
    SensorsStage: WHOLE, EstimatorStage: WHOLE, GuidanceStage: WHOLE, ShapingStage: SHAPED,
    NavigationStage: PUSHED, DisturbanceStage: PUSHED,
}  # fmt: skip


def flown_without(kind, scenario, off, events=()):
    """Return the run of a scenario one of whose stages is switched off at some ticks."""
    step = kind.step

    def switched(self, tick, *inputs):
        if tick == off.stop:
            self.reset()
        return self.off(*inputs) if tick in off else step(self, tick, *inputs)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(kind, 'step', switched)
        return chain_run(scenario, load_controller('handmade'), events=events)


@pytest.mark.parametrize('kind', STAGES, ids=lambda kind: kind.name)
def test_a_stage_that_is_switched_off_passes_on_what_it_gets(kind, tmp_path):
    words = switched_off(kind.name)
    run = flown_without(kind, STAGES[kind], OFF, words)
    run.write(tmp_path / 'told')
    found = verify(tmp_path / 'told')
    assert found.difference is None and kind.name in found.stages, found.sentence()
    assert not found.gaps, found.gaps
    assert f'log: {kind.name} off at ticks 20 to 29; recomputed:' in found.sentence()
    run.write(tmp_path / 'untold', [m for m in run.messages if m not in words])
    found = verify(tmp_path / 'untold').difference
    assert (found.tick, found.check) == (OFF.start, kind.name)


@pytest.mark.parametrize(
    ('kind', 'tick'),
    [(DynamicsStage, OFF.start + 1), (TableStage, OFF.start), (TargetStage, OFF.start)],
)
def test_no_event_switches_a_stage_of_the_plant_off(kind, tick, tmp_path):
    """A flight whose chaser stood still for a second was verified: an event said so."""
    flown_without(kind, DOCKED, OFF, switched_off(kind.name)).write(tmp_path)
    found = verify(tmp_path).difference
    assert (found.tick, found.check) == (tick, kind.name)


def test_a_thruster_that_was_switched_off_verifies_by_its_event(monkeypatch, tmp_path):
    event, reset = said('y-b off', OFF.start, 'thrusters'), TableStage.reset

    def told(self):
        reset(self)
        self.take_event(OFF.start, 'y-b off')

    with monkeypatch.context() as patch:
        patch.setattr(TableStage, 'reset', told)
        run = chain_run(DOCKED, load_controller('handmade'), events=(event,))
    run.write(tmp_path / 'told')
    told = verify(tmp_path / 'told')
    assert told.exit_code == ExitCode.OK
    assert told.by_events == ('thrusters y-b off at tick 20',)
    run.write(tmp_path / 'untold', [m for m in run.messages if m != event])
    found = verify(tmp_path / 'untold').difference
    assert found.tick >= OFF.start and found.check in ('thrusters', 'attitude')


@pytest.mark.parametrize('signal', ['relative_state', 'clock'])
def test_a_plant_goes_on_without_peers_only(signal, tmp_path):
    """Without its own state, a forged log said, the chaser was at the origin, at rest."""
    run = make_run(0.1 * LOST_AT, 'approach', (STATE, FORCE, STATUS))
    if signal == 'relative_state':
        run.flight.forces_n[LOST_AT] = 0.0
    values = {**run.figures(LOST_AT, 'finished'), 'dropped': signal}
    status = cdr.encode_status(0, 'run', 'coasting', 'none', values)
    sent = [m for m in run.messages if m[:2] != (STATUS, LOST_AT)]
    run.write(tmp_path, [*sent, (STATUS, LOST_AT, status)])
    found = verify(tmp_path).difference
    assert (found.tick, found.field, found.logged) == (LOST_AT, 'dropped', signal)


def test_an_attitude_filter_that_is_switched_off_holds_the_attitude_between_star_trackers():
    run = flown_without(AttitudeEstimatorStage, SELDOM, OFF)
    seen, given = (
        run.flight.signals[name] for name in ('attitude_measurement', 'navigation_attitude')
    )
    last = given[OFF.start - 1, :4]
    for tick in OFF:
        last = seen[tick, :4] if seen[tick, :4].any() else last
        assert np.array_equal(given[tick], [*last, *seen[tick, 4:]])
    assert 0 < seen[OFF.start : OFF.stop, :4].any(axis=1).sum() < len(OFF)
    assert np.linalg.norm(given[:, :4], axis=1) == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize(
    ('kind', 'without'),
    [
        (GuidanceStage, replace(WHOLE, sections=UNGUIDED)),
        (NavigationStage, replace(PUSHED, sections=())),
        (DisturbanceStage, replace(PUSHED, disturbance=NONE)),
    ],
)  # fmt: skip
def test_off_from_the_start_it_flies_as_if_the_scenario_had_no_such_stage(kind, without):
    off = flown_without(kind, STAGES[kind], range(1000)).flight
    assert off.states.tolist() == fly(without, load_controller('handmade')).states.tolist()


# What an abort table says: decided again, and compared.


@pytest.fixture(scope='module')
def flown():
    """Twenty seconds; the table holds the chaser after a few."""
    rows = (Row(quantity='speed_m_s', most=0.1, count=3, window=5, reaction='hold'),)
    table = Assurance(abort=AbortTable(table=rows))
    base = replace(load_scenario('paper_test'), disturbance=NONE, duration_s=20.0)
    return base.equipped(table)


@pytest.fixture(scope='module')
def held(flown):
    """Return the tick at which assurance holds."""
    chain, signals = Chain.of(flown, load_start('trained')), {RELATIVE_STATE: flown.start}
    for tick in range(flown.ticks + 1):
        chain.step(tick, signals)
    stage = next(link.stage for link in chain.links if link.stage.name == 'assurance')
    ((tick, state),) = stage.decided()
    assert state == 'holding' and 5 < tick < 150
    return tick


def written(flown, folder, *events):
    """Write the log of the flight with some events, and verify it."""
    run = chain_run(flown, load_start('trained'), events=events)
    run.write(folder)
    return verify(folder)


def test_a_hold_that_the_table_decides_verifies(small_blocks, flown, held, tmp_path):
    found = written(flown, tmp_path, said('holding', held, 'assurance'))
    assert found.exit_code == ExitCode.OK, found.sentence()
    assert 'assurance' in found.stages
    assert flight_of(read_run(tmp_path)).events == {'assurance': [(held, 'holding')]}


@pytest.mark.parametrize(
    ('state', 'after'), [('aborting', 7), ('resumed', 7), ('warned', 7), ('holding', -1)]
)
def test_a_decision_that_the_table_does_not_make_is_a_difference(
    flown, held, tmp_path, state, after
):
    events = said('holding', held, 'assurance'), said(state, held + after, 'assurance')
    found = written(flown, tmp_path, *events).difference
    assert (found.tick, found.field) == (held + after, 'state')
    assert (found.logged, found.check) == (state, 'assurance')


def test_a_decision_that_is_not_told_is_a_gap(flown, held, tmp_path):
    found = written(flown, tmp_path, said('armed', 199, 'nobody'))
    assert found.exit_code == ExitCode.INCOMPLETE
    assert f'does not say that assurance is holding from tick {held}' in found.sentence()


@pytest.mark.parametrize('command', ['inhibit', 'abort', 'without_command'])
def test_a_command_that_was_not_given_is_a_difference(flown, held, tmp_path, command):
    """The table that gets it decides otherwise than the log."""
    events = said(command, held - 2, 'assurance'), said('holding', held, 'assurance')
    found = written(flown, tmp_path, *events).difference
    assert found.topic == f'/{ASSURED_FORCE}' and found.check == 'assurance'
    assert found.tick >= held - 2
