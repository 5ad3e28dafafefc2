# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The abort table in flight: rows, reactions, commands, a lost command, a stuck thruster."""

from __future__ import annotations

import copy
import math
from dataclasses import dataclass, replace

import numpy as np
import pytest
from core_oracles import exact_step
from hypothesis import given
from hypothesis import strategies as st
from landing import rest_at_landing

from rpo_core.assurance import manoeuvre
from rpo_core.assurance.abort import BURN_S, Counter, Limit, counted, quantity_of
from rpo_core.assurance.abort_table import QUANTITIES, Row
from rpo_core.assurance.kernels import speed_limit
from rpo_core.assurance.manoeuvre import APPROACH_1_S, PASSING_M, around
from rpo_core.assurance.settings import Assurance
from rpo_core.chain.chain import Chain
from rpo_core.chain.flight import fly
from rpo_core.control.controller import load_controller
from rpo_core.kernels import calls
from rpo_core.kernels.jit import as_table, step_kernel
from rpo_core.kernels.records import prepared
from rpo_core.scenario import scenario
from rpo_core.stage import WITHOUT_COMMAND, Place
from rpo_core.thrusters.thrusters import Failure, Pulses, Thrusters
from rpo_core.wire.interfaces import ASSURED_FORCE, COMMAND, RELATIVE_STATE

AROUND, GUARDED = scenario.load_scenario('around'), scenario.load_scenario('guarded')
SETTINGS = GUARDED.section(Assurance)
SHIPPED = SETTINGS.abort
TABLE = replace(  # `around` passes beside the corridor
    SHIPPED, table=tuple(row for row in SHIPPED.table if row.quantity != 'off_corridor_m')
)
AT = 3000
"""Tick at which `around` is beside the target, behind it, 23 m away."""


def with_table(base=AROUND, **changes):
    """Return a scenario with the shipped assurance, its abort table changed."""
    return base.equipped(replace(SETTINGS, abort=replace(TABLE, **changes)))


class Flight:
    """A flight tick by tick; events as nodes tell of them."""

    def __init__(self, chosen):
        self.chain = Chain.of(chosen, load_controller('allround'))
        self.stage = next(x.stage for x in self.chain.links if x.place is Place.ASSURANCE)
        self.signals, self.tick = {RELATIVE_STATE: chosen.start}, 0
        self.states, self.forces = [], []

    def take(self, *events):
        for tick, state in events:
            self.stage.take_event(tick, state)
        return self

    def until(self, tick):
        for now in range(self.tick, tick):
            self.states.append(self.signals[RELATIVE_STATE])
            self.chain.step(now, self.signals)
            self.forces.append(self.signals[ASSURED_FORCE])
        self.tick = tick
        return self

    @property
    def said(self):
        return [(change.tick, change.state) for change in self.stage.abort.changes]

    def ranges(self, since=0):
        return np.linalg.norm(np.array(self.states)[since:, :3], axis=1)


@pytest.fixture(scope='module')
def flown():
    """A flight beside the target, at `AT`; nobody changes it."""
    return Flight(with_table()).until(AT)


@pytest.fixture
def beside(flown):
    """Return a function that goes on from there, with a table changed and some events."""

    def going_on(*events, **changes):
        flight = copy.deepcopy(flown)
        machine = flight.stage.abort
        machine.table = replace(TABLE, **changes)
        flight.stage.p.table.hold_s = machine.table.hold_s
        return flight.take(*events)

    return going_on


@pytest.mark.every_landing
def test_a_table_that_finds_nothing_changes_no_bit():
    """Nor does assurance: the plan keeps the sets."""
    plain, watched = fly(AROUND, load_controller('allround')), Flight(with_table())
    watched.until(AROUND.ticks)
    assert (np.array(watched.states) == plain.states[:-1]).all()
    assert watched.said == []


def test_a_hold_stops_and_stays(beside):
    flight = beside((AT, 'hold')).until(AT + 1500)
    end = np.array(flight.states)
    assert np.linalg.norm(end[-1, 3:]) < 1e-4
    assert np.linalg.norm(end[-1, :3] - end[AT, :3]) < 5.0
    slow = AT + int(np.argmax(np.linalg.norm(end[AT:, 3:], axis=1) <= 0.02))
    assert np.linalg.norm(end[[-500, -1], :3] - end[slow, :3], axis=1).max() < 0.01
    assert flight.said == [(AT, 'holding')]


def test_a_retreat_goes_around_the_sphere():
    """From behind the target to a point ahead of it."""
    flight = Flight(with_table()).take((1000, 'retreat')).until(7000)
    end = np.array(flight.states)
    assert end[-1, :3] == pytest.approx(TABLE.retreat_m, abs=0.05)
    fastest = np.linalg.norm(end[1100:, 3:], axis=1).max()
    assert 0.25 < fastest < 0.31, 'a retreat is no race'
    assert flight.ranges().min() > 12.0


def test_a_velocity_into_the_sphere_becomes_one_along_its_tangents():
    """Of the same size, in the same plane and to the same side; any other velocity stands."""
    rng, radius = np.random.default_rng(11), 10.0 + PASSING_M
    for _ in range(300):
        place, wanted = rng.normal(size=(2, 3))
        place *= rng.uniform(0.5, 3.0) * radius / np.linalg.norm(place)
        wanted *= 0.3 / np.linalg.norm(wanted)
        rho = np.linalg.norm(place)
        got = np.array(around((*place, 0.0, 0.0, 0.0), tuple(wanted), 10.0))
        up, along = (v @ place / rho for v in (got, wanted))
        sine = np.linalg.norm(np.cross(place, wanted)) / rho / 0.3
        if along >= 0.0 or sine * rho >= radius:
            assert (got == wanted).all()
            continue
        assert np.linalg.norm(got) == pytest.approx(0.3)
        assert abs(np.linalg.det([place, wanted, got])) < 1e-9 * rho
        assert np.cross(place, got) @ np.cross(place, wanted) > -1e-12
        cosine = math.sqrt(max(1.0 - (radius / rho) ** 2, 0.0))
        out = min(APPROACH_1_S * (radius - rho), 0.3) if rho < radius else -0.3 * cosine
        assert up == pytest.approx(out, abs=1e-12)
    assert around((20.0, 0.0, 0.0, 0.0, 0.0, 0.0), (-0.3, 0.0, 0.0), 10.0)[2] > 0.1, 'beside it'
    assert around((0.0, 20.0, 0.0, 0.0, 0.0, 0.0), (0.0, -0.3, 0.0), 10.0)[0] < -0.1, 'below it'


def test_a_held_chaser_needs_no_command_but_where_it_resumes():
    flight = Flight(with_table()).take((0, 'hold'), (5, 'resume'))
    assert not flight.stage.goes_without(0), 'before the hold'
    for tick in range(7):
        flight.until(tick)
        assert flight.stage.goes_without(tick) == (0 < tick < 5), tick


def drift(state, n, along):
    """Return the least distance of a drift for two orbits, by the matrix exponential."""
    (a, b), x, nearest = exact_step(n, 1.0, 4.0), np.array(state), np.inf
    for _ in range(math.ceil(4.0 * math.pi / n / 4.0)):
        nearest = min(nearest, np.linalg.norm(x[:3]))
        x = a @ x + b[:, 1] * along
    return nearest


@pytest.mark.parametrize(
    'when', rest_at_landing([AT, 500, 4500, 4900, 5850], quick=2), ids='{}'.format
)
def test_after_an_abort_the_drift_is_clear_for_two_orbits(when):
    """From the plan, and from inside the corridor, 3 m from the port."""
    flight = Flight(with_table()).take((when, 'abort')).until(when + 2500)
    assert flight.said[0] == (when, 'aborting') and flight.said[-1][1] == 'drifting'
    burnt_s = (flight.stage.abort.changes[1].tick - when) * AROUND.dt_s
    assert TABLE.stuck_s <= burnt_s <= TABLE.stuck_s + BURN_S
    assert not np.any(flight.forces[-1])
    radius = 10.0 if flight.ranges()[when] > 10.0 else SETTINGS.corridor.port_m
    assert f' of {radius:g} m at the worst' in flight.stage.abort.changes[0].reason
    n = AROUND.mean_motion_rad_s
    for along in (-1.2e-6, 1.2e-6):
        assert drift(flight.states[-1], n, along) > 10.0
    if when < 5000:
        assert flight.ranges(when).min() > 10.0


def test_a_way_out_stays_clear_of_the_sphere_and_inside_it_of_the_port(monkeypatch):
    stage, radii = Flight(with_table()).stage, []
    monkeypatch.setattr(manoeuvre, 'choose', lambda state, radius, *rest: radii.append(radius))
    for range_m in (10.5, 9.5):
        stage.abort.way_out((0.0, range_m, 0.0, 0.0, 0.0, 0.0), stage.guard, None)
    expected = [10.0 + stage.guard.here_m, SETTINGS.corridor.port_m + stage.guard.here_m]
    assert radii == pytest.approx(expected)


@pytest.mark.parametrize(
    ('range_m', 'enclosed'), [(15.0, True), (15.0, False), (9.0, True), (9.0, False)]
)
def test_only_inside_the_sphere_and_in_the_corridor_the_way_out_is_outward(
    range_m, enclosed, monkeypatch
):
    machine, ways = Flight(with_table()).until(1).stage.abort, []
    plain = machine.way_out
    monkeypatch.setattr(machine, 'way_out', lambda *given: ways.append(given[2]) or plain(*given))
    machine.m.ahead, machine.m.outward = [0.0, range_m, 0.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0]
    machine.m.enclosed = int(enclosed)
    said = machine._plan(5)
    assert ways == [(0.0, 1.0, 0.0) if range_m < 10.0 and enclosed else None]
    assert f' of {SETTINGS.corridor.port_m if range_m < 10.0 else 10.0:g} m at the worst' in said


def test_how_near_a_drift_inside_the_sphere_comes_is_looked_for_to_its_end():
    flight = Flight(with_table()).take((5, 'abort')).until(6)
    begin = 5 + round((TABLE.stuck_s + BURN_S) / AROUND.dt_s)
    flight.tick, flight.signals[RELATIVE_STATE] = begin, (0.0, 3.0, 0.0, 0.001, -0.02, 0.0)
    flight.until(begin + 1)
    change, n = flight.stage.abort.changes[-1], AROUND.mean_motion_rad_s
    assert (change.tick, change.state) == (begin, 'drifting')
    said = float(change.reason.removeprefix('at least ').split()[0])
    assert 0.0 < said < min(drift(flight.states[-1], n, along) for along in (-1.2e-6, 1.2e-6)) < 0.5


@pytest.mark.parametrize('thruster', rest_at_landing(['x+', 'y-', 'z+', 'x-', 'y+', 'z-'], quick=2))
def test_a_stuck_thruster_is_found_and_the_path_stays_clear(thruster):
    """Stuck on for 30 s, known to nobody: the table finds a force that no command explains."""
    begin = AROUND.time_s(AT)
    failure = Failure(thruster=thruster, stuck='on', from_s=begin, until_s=begin + 30.0)
    pulses = Pulses(count=6, modulation='sigma_delta', minimum_on_time_s=0.0, failures=(failure,))
    sure = replace(SETTINGS, thrust_error=0.05, abort=TABLE)
    chosen = AROUND.equipped(Thrusters(pulses=pulses), sure)
    flight = Flight(chosen).until(AT + 1500)
    changes = flight.stage.abort.changes
    assert changes[0].state == 'aborting' and changes[0].reason.startswith('unexplained_n above')
    assert AT < changes[0].tick <= AT + 20
    assert changes[-1].state == 'drifting'
    assert flight.ranges(AT).min() > 10.0
    for along in (-1.2e-6, 1.2e-6):
        assert drift(flight.states[-1], AROUND.mean_motion_rad_s, along) > 10.0


def lose_the_command(flight, ticks):
    """Tell the stage that no command came, and hand it zeros, as a node does."""
    link = next(x for x in flight.chain.links if x.stage is flight.stage)
    plain = flight.stage.step

    def step(tick, *inputs):
        if tick in ticks:
            if not flight.stage.goes_without(tick):
                flight.stage.take_event(tick, WITHOUT_COMMAND)
            wide = zip(link.stage.inputs, inputs, strict=True)
            inputs = [(0.0,) * len(v) if n in flight.stage.may_miss else v for n, v in wide]
        return plain(tick, *inputs)

    flight.stage.step = step


def test_a_lost_command_is_a_hold_and_then_an_abort(beside):
    flight = beside(hold_s=20.0)
    assert COMMAND in flight.stage.may_miss
    lose_the_command(flight, range(AT, 10_000))
    flight.until(AT + 1000)
    assert flight.said[:2] == [(AT + 2, 'holding'), (AT + 202, 'aborting')]
    assert [state for _, state in flight.said[2:]] == ['drifting']
    assert flight.ranges(AT).min() > 10.0


def test_two_lost_commands_are_no_fault(beside):
    flight = beside()
    lose_the_command(flight, (AT, AT + 1))
    assert flight.until(AT + 100).said == []


FAST = Row(quantity='speed_m_s', most=0.05, count=5, window=5, reaction='hold')
FAR = Row(quantity='range_m', most=50.0, reaction='hold')


def test_inhibited_the_table_warns_only_and_armed_it_acts():
    flight = Flight(with_table(table=(FAST,), armed=False)).take((900, 'arm'), (920, 'inhibit'))
    said = [state for _, state in flight.until(2000).said]
    assert said == ['warned', 'armed', 'holding', 'inhibited', 'warned']
    # a hold of an inhibited table does not become an abort
    assert flight.until(4000).said[-1][1] == 'warned'


def test_resume_gives_the_command_back_when_no_fault_holds(beside):
    flight = beside((AT, 'hold'), (AT + 5, 'resume')).until(AT + 100)
    assert flight.said == [(AT, 'holding'), (AT + 5, 'resumed')]
    assert flight.stage.abort.refusal('resume').startswith('`resume` ends a hold')
    held = Flight(with_table(table=(FAR,))).until(100)
    assert held.stage.abort.command('resume') == 'a fault holds: range_m hold'
    assert held.stage.abort.command('drift') == ''


def test_a_command_acts_at_the_tick_that_comes_and_an_abort_is_not_taken_back():
    flight = Flight(with_table())
    machine = flight.stage.abort
    assert machine.command('hold') == '' and flight.until(4).said == [(0, 'holding')]
    assert machine.command('abort') == '' and flight.until(6).said[1] == (4, 'aborting')
    for name in ('resume', 'hold', 'retreat', 'drift', 'abort'):
        assert 'the phase is aborting' in machine.refusal(name)
    assert machine.refusal('inhibit') == ''


def test_the_worst_reaction_acts():
    rows = [replace(FAR, reaction=reaction) for reaction in ('warn', 'abort', 'hold')]
    rows.append(Row(quantity='speed_m_s', most=0.0, reaction='abort'))
    moving = replace(AROUND, initial_velocity_m_s=(0.01, 0.0, 0.0))
    flight = Flight(with_table(moving, table=tuple(rows))).until(5)
    assert flight.said == [(0, 'warned'), (0, 'aborting')]
    assert flight.stage.abort.changes[-1].reason.startswith('range_m above 50 in 1 of 1 ticks; ')


def test_each_quantity_is_looked_at():
    """Each number beside its own computation."""
    flight = Flight(with_table(table=())).until(3)
    machine = flight.stage.abort
    # the corridor at 14 m from the port is 0.07 m + 14 m x tan 10 deg / sqrt 2 wide
    width = 0.07 + 14.0 * math.tan(math.radians(10.0)) / math.sqrt(2.0)
    range_m, g = math.hypot(3.0, 15.0), machine.guard
    expected = {
        'range_m': range_m,
        'speed_m_s': 0.1,
        'closing_excess_m_s': 1.5 / range_m - speed_limit(range_m, g),
        'off_corridor_m': 3.0 - width,
        'tracking_error_m': 5.0,
        'tracking_error_m_s': 0.1,
        'pointing_error_deg': 0.0,
        'intervention': 1.0,
        'sigma_m': 0.5,
        'sigma_m_s': 0.01,
        'missed': 0.0,
        'impulse_n_s': np.abs(flight.forces).sum() * AROUND.dt_s,
    }
    memory, y = flight.stage.m, as_table([0.0] * len(QUANTITIES))
    memory.acted, memory.spread_m, memory.spread_m_s = 1, 0.5, 0.01
    state, reference = (3.0, 15.0, 0.0, 0.0, -0.1, 0.0), (0.0, 11.0, 0.0, 0.0, 0.0, 0.0)
    u = as_table([*state, 0.0, 0.0, 0.0, *reference])
    assert calls.call_once(*calls.row_of(quantities, flight.stage.p, memory), 2, u, y) == 0
    found = dict(zip(QUANTITIES, y, strict=True))
    assert found.pop('unexplained_n') > 0.0
    assert found == pytest.approx(expected, abs=1e-3)
    assert machine._world.drift_s == pytest.approx(4.0 * math.pi / AROUND.mean_motion_rad_s)


@step_kernel
def quantities(tick, u, p, m, y):
    for i in range(len(y)):
        y[i] = quantity_of(tick, i, u, p, m)
    return 0


# Its counters of persistence, against a plain count.


@dataclass(slots=True)
class Counted:
    counter: Counter
    samples: list[int]


@step_kernel
def count(tick, u, p, m, y):
    """From whether a sample shows a fault to whether it begins, and whether it holds."""
    y[0] = 1.0 if counted(u[0] != 0.0, p, m.counter, m.samples) else 0.0
    y[1] = m.counter.holds
    return 0


class Watched:
    """A row of the table, sample by sample; its samples lie behind those of another one."""

    def __init__(self, count, window):
        self.p = prepared(Limit(0, 1.0, count, window, 0, 2))
        self.m = prepared(Counted(Counter(), [1, 1] + [0] * window))

    def sample(self, shows):
        y = as_table([0.0, 0.0])
        calls.call_once(*calls.row_of(count, self.p, self.m), 0, as_table([float(shows)]), y)
        assert list(self.m.samples)[:2] == [1, 1]
        return bool(y[0]), bool(y[1])


@given(st.lists(st.booleans(), max_size=60), st.integers(1, 8), st.integers(0, 8))
def test_a_fault_begins_at_n_of_the_last_m_and_again_after_a_whole_window_without(
    samples, count, more
):
    window = count + more
    watched, holds = Watched(count, window), False
    for end in range(1, len(samples) + 1):
        seen = sum(samples[max(0, end - window) : end])
        begins = not holds and seen >= count
        holds = (holds and seen > 0) or begins
        assert watched.sample(samples[end - 1]) == (begins, holds)
