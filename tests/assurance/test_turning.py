# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A corridor that turns: lemma 5 of docs/safety.md by machine, and the filter under attack.

The world is SciPy's: exact matrices of the orbit, closed form of a spin, DOP853 for a tumble.
"""

from __future__ import annotations

import re
from dataclasses import replace
from math import radians

import numpy as np
import pytest
from core_oracles import exact_step
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from rpo.analysis import attack
from rpo_core.assurance import filters
from rpo_core.assurance.abort_table import AbortTable, Row
from rpo_core.assurance.assurance import AssuranceStage
from rpo_core.assurance.guard import _leaning, _Taken, guard_of, proof_of, swing_of
from rpo_core.assurance.kernels import APPROACH, CONTACT, OPEN, approach_margins, open_margins
from rpo_core.assurance.settings import Assurance, Passage
from rpo_core.attitude.attitude_kernels import Frame, moving_with, seen_from, to_lvlh
from rpo_core.attitude.target import Motion, Target, motion_of
from rpo_core.files.validation import InputError
from rpo_core.scenario import scenario
from rpo_core.thrusters.thrusters import Thrusters
from rpo_core.world.cw import cw_step
from rpo_core.world.disturbance import NONE

PAPER = replace(scenario.load_scenario('paper_test'), disturbance=NONE)
INERTIA = ((120.0, 0.0, 0.0), (0.0, 150.0, 0.0), (0.0, 0.0, 200.0))
SPIN = Target(kind='spin', attitude=(0.3, -0.1, 0.2, 0.9), axis=(0.3, -0.2, 1.0), rate_deg_s=0.7)
TUMBLE = Target(
    kind='tumble',
    attitude=(0.1, 0.2, -0.3, 0.9),
    rates_deg_s=(0.2, 0.3, 0.9),
    inertia_kg_m2=INERTIA,
)
LEANING = replace(
    TUMBLE, rates_deg_s=(0.1, 0.15, 0.45), known_error_deg=(0.5, -0.3, 0.8)
)  # a degree
WAY = Passage('+y', 10.0, 1.0, 20.0, width_m=0.2, lateral_m_s=0.034)
SETTINGS = Assurance(
    keep_out_m=10.0,
    corridor=WAY,
    domain_m=250.0,
    disturbance_n=0.01,
    thrust_error=0.05,
    position_error_m=0.05,
    velocity_error_m_s=0.003,
)


def turned(target, settings=SETTINGS, delay=1):
    return PAPER.equipped(target, settings, Thrusters(delay_ticks=delay))


class Spinning:
    """The axes of `SPIN` at any time, in closed form."""

    def __init__(self, target):
        self._begin = Rotation.from_quat(target.attitude)
        axis = np.array(target.axis)
        self._rate = radians(target.rate_deg_s) * axis / np.linalg.norm(axis)

    def sees(self, state, time_s):
        """Return a state (6,) of LVLH in these axes, velocities against them."""
        n = PAPER.mean_motion_rad_s
        orbit = Rotation.from_rotvec([0.0, 0.0, -n * time_s])
        axes = orbit * self._begin * Rotation.from_rotvec(self._rate * time_s)
        rate = self._rate - axes.inv().apply([0.0, 0.0, n])
        r = axes.inv().apply(state[:3])
        return np.concatenate([r, axes.inv().apply(state[3:]) - np.cross(rate, r)])


MOMENTS = [
    (part / 8, *exact_step(PAPER.mean_motion_rad_s, PAPER.mass_kg, PAPER.dt_s * part / 8))
    for part in range(1, 9)
]


def at_the_walls(walls, count, seed):
    """Return states (count, 6) in the axes of the corridor, most of them at an edge of the set."""
    random = np.random.default_rng(seed)
    found = []
    while len(found) < count:
        d = 9.5 * random.uniform() ** 2 + 0.01
        half = walls.width_m + walls.slope * d
        p, q = half * random.uniform(-1, 1, 2)
        v = walls.top_m_s * random.uniform(-0.7, 0.7, 3)
        low, high = 0.0, 1.0
        for _ in range(30):  # as fast as the set allows in this direction
            k = 0.5 * (low + high)
            state = (q, walls.port_m + d, p, *(k * v).tolist())
            inside = min(approach_margins(state, 0.0, 0.0, walls)) >= 0
            low, high = (k, high) if inside else (low, k)
        if low > 0.0:
            found.append([q, walls.port_m + d, p, *(low * random.choice([1.0, 0.5]) * v)])
    return np.array(found)


def unit(random):
    v = random.normal(size=3)
    return v / np.linalg.norm(v)


@pytest.mark.parametrize('name', ['least_change', 'simplex'])
def test_no_step_leaves_the_walls_that_turn(name):
    """Lemma 5 at its corners: states at the edge, errors and forces at their bounds."""
    settings = replace(SETTINGS, filter=name)
    found = turned(SPIN, settings, delay=0)
    proof, motion = proof_of(settings, found), motion_of(SPIN, found)
    walls, guard, errors = proof.walls, proof.guard, proof.errors
    axes, random = Spinning(SPIN), np.random.default_rng(5)
    acted = stayed = 0
    for seen in at_the_walls(walls, 300, 4):
        tick = int(random.integers(0, 1990))
        now, following = motion.frame(tick), motion.frame(tick + 1)
        state = np.array(moving_with(tuple(seen), now))
        wrong = np.concatenate([
            errors.position_m * unit(random), errors.velocity_m_s * unit(random)
        ])  # fmt: skip
        command = tuple(random.choice([-0.5, 0.5], 3).tolist())
        *force, mode, constraint, _, _ = filters.assure(
            tuple((state + wrong).tolist()), command, command, APPROACH, 1, now, following,
            found.step, guard, walls,
        )  # fmt: skip
        if mode == CONTACT:
            continue
        acted, stayed = acted + (constraint > 0), stayed + (mode == APPROACH)
        assert max(map(abs, force)) <= PAPER.max_force_n
        exerted = np.array(force) + errors.thrust * np.linalg.norm(force) * unit(random)
        exerted += errors.disturbance_n * unit(random)
        for part, a, b in MOMENTS:
            after = a @ state + b @ exerted
            x, y, z, *_ = there = axes.sees(after, (tick + part) * PAPER.dt_s)
            half = WAY.width_m + WAY.slope * max(y - WAY.port_m, 0.0)
            assert max(abs(x), abs(z)) <= half or np.linalg.norm(after[:3]) >= SETTINGS.keep_out_m
        inside = approach_margins(tuple(there), 0.0, 0.0, walls)[0]
        assert inside >= 0.0 or open_margins(tuple(after), 0.0, 0.0, guard)[0] >= 0.0
        assert np.abs(there[3:]).max() <= walls.top_m_s or mode == OPEN
    assert acted > 100 and stayed > 100


@pytest.mark.parametrize('target', [SPIN, TUMBLE, LEANING], ids=['spin', 'tumble', 'leaning'])
def test_no_hostile_command_leads_out_of_the_corridor(target):
    """A5 in small: every kind of command, from any time of the motion."""
    results = attack.attack(turned(target), 400, 3, 500)
    for result in results:
        for column in (attack.VIOLATED, attack.INFEASIBLE, attack.TOO_FAST, attack.HARD):
            assert result.total(column) == 0, result.kind
        assert result.total(attack.OUTSIDE) == 0
        assert result.total(attack.ACTED) > 0
        assert result.least(attack.LEAST_FREE) > 0.0
    assert sum(result.total(attack.CONTACTS) for result in results) > 20


vectors = st.tuples(*[st.floats(-1.0, 1.0)] * 3)


@given(vectors, vectors, st.floats(0.1, 1.2), vectors, vectors, st.floats(0.0, 1.0))
def test_the_turning_takes_no_more_than_its_bound(axis, tilt, rate, place, speed, moment):
    """What a chaser without thrust sees happen, across with the walls' slope, and along."""
    rates = rate * np.array(axis) / max(np.linalg.norm(axis), 1e-3)
    target = replace(
        TUMBLE, rates_deg_s=tuple(rates.tolist()), attitude=(*(0.4 * np.array(tilt)).tolist(), 1.0)
    )
    found = replace(PAPER, duration_s=60.0).equipped(target)
    swing, fine = swing_of(found), Motion(
        target.body(found.mean_motion_rad_s), target.start(found.mean_motion_rad_s), 0.03
    )  # fmt: skip
    f = np.array(fine.frame(int(moment * 1999)))
    matrix, w, change = f[:9].reshape(3, 3), f[9:12], f[12:]
    assert (abs(w) <= swing.rate_rad_s).all() and (abs(change) <= swing.change_rad_s2).all()
    assert abs(matrix).sum(axis=1).max() <= swing.spread * (1 + 1e-3)
    guard = guard_of(replace(SETTINGS, corridor=None), found)
    n, walls = found.mean_motion_rad_s, _leaning(WAY, 0.0, 0.0)
    taken = _Taken(guard, WAY, walls, swing.about(1), 0.03, 0.0, 3.0 * n * n, 2.0 * n)
    most = np.array([taken.across_m_s(0.2), 0.2, taken.across_m_s(0.2)])
    v, y = most * np.array(speed), 1.0 + 0.5 * (place[1] + 1.0) * 9.3
    half = walls.width_m + walls.slope * (y - 1.0)
    r = np.array([half * place[0], y, half * place[2]])
    x, y, z, vx, vy, _ = moving_with((*r.tolist(), *v.tolist()), Frame(*f.tolist()))
    pull = np.array([3 * n * n * x + 2 * n * vy, -2 * n * vx, -n * n * z])
    a = matrix.T @ pull - np.cross(change, r) - 2 * np.cross(w, v) - np.cross(w, np.cross(w, r))
    doubt = taken.doubt(0.2)
    across = max(abs(a[0]), abs(a[2])) + walls.slope * max(-a[1], 0.0)
    assert across <= (1.0 - walls.slope) * doubt
    assert a[1] <= doubt


def test_a_corridor_that_turns_too_fast_is_refused_with_the_rate_that_is_not():
    def at(rate):
        return turned(replace(SPIN, rate_deg_s=rate))

    with pytest.raises(InputError, match=r'may turn at ([\d.]+) deg/s at most; got') as error:
        at(3.0)
    allowed, got = (float(x) for x in re.findall(r'([\d.]+) deg/s at most; got ([\d.]+)',
                                                 str(error.value))[0])  # fmt: skip
    share = allowed / got
    assert proof_of(SETTINGS, at(3.0 * share * 0.98)).walls.top_m_s > WAY.closing_m_s
    with pytest.raises(InputError, match='deg/s at most'):
        at(3.0 * share * 1.02)


@given(vectors, st.floats(0.0, 1.0), st.tuples(*[st.floats(0.0, 1.0)] * 3))
def test_a_leaning_corridor_is_within_all_that_are_turned_so_far(axis, share, place):
    angle = radians(1.5)
    lean = _leaning(WAY, angle, 0.0)
    d = 19.0 * place[1]
    half = lean.width_m + lean.slope * d
    point = np.array([half * (2 * place[0] - 1), lean.port_m + d, half * (2 * place[2] - 1)])
    size = max(np.linalg.norm(axis), 1e-6)
    x, y, z = Rotation.from_rotvec(angle * share * np.array(axis) / size).apply(point)
    assert max(abs(x), abs(z)) <= WAY.width_m + WAY.slope * max(y - WAY.port_m, 0.0)
    assert y >= WAY.port_m


class Tumbling:
    """The axes of `TUMBLE`, integrated in inertial space by DOP853."""

    def __init__(self, end_s):
        self._inertia = np.array(INERTIA)
        begin = [*TUMBLE.attitude / np.linalg.norm(TUMBLE.attitude), *TUMBLE.rates_rad_s]
        self._path = solve_ivp(
            self._change, (0.0, end_s), begin, 'DOP853', rtol=1e-10, atol=1e-12, dense_output=True
        ).sol

    def _change(self, _t, y):
        x, y_, z, w = y[:4]
        a, b, c = rate = y[4:]
        turn = [w * a + y_ * c - z * b, w * b + z * a - x * c, w * c + x * b - y_ * a,
                -x * a - y_ * b - z * c]  # fmt: skip
        pushed = np.linalg.solve(self._inertia, np.cross(self._inertia @ rate, rate))
        return [*(0.5 * np.array(turn)), *pushed]

    def sees(self, state, time_s):
        """Return the position (3,) of a state of LVLH in these axes."""
        orbit = Rotation.from_rotvec([0.0, 0.0, -PAPER.mean_motion_rad_s * time_s])
        axes = orbit * Rotation.from_quat(self._path(time_s)[:4])
        return axes.inv().apply(state[:3])


@pytest.mark.parametrize('push', [(1.0, 0.0, 0.0), (0.0, -1.0, -1.0), (0.0, 1.0, 0.0)], ids=str)
def test_a_flight_pushed_at_the_walls_of_a_tumbling_target_stays_within(push):
    """The stage, two ticks ahead of its thrusters; a command towards a wall, the port, outward."""
    found = turned(TUMBLE, delay=2)
    stage, motion, axes = AssuranceStage(SETTINGS, found), motion_of(TUMBLE, found), Tumbling(90.0)
    assert stage.counts_ticks
    state = np.array(moving_with((0.0, 9.0, 0.0, 0.0, -0.05, 0.0), motion.frame(0)))
    random = np.random.default_rng(6)
    errors, line, acted = stage.errors, [np.zeros(3)] * 2, 0
    for tick in range(600):
        wrong = [errors.position_m * unit(random), errors.velocity_m_s * unit(random)]
        command = to_lvlh(push, motion.frame(tick))
        (force,) = stage.step(tick, tuple((state + np.concatenate(wrong)).tolist()), command)
        if stage.decision.mode == 'contact':
            break
        acted += stage.decision.constraint in ('corridor', 'speed', 'keep_out')
        line.append(np.array(force))
        exerted = line.pop(0) * (1.0 + errors.thrust) + errors.disturbance_n * unit(random)
        for part, a, b in MOMENTS:
            after = a @ state + b @ exerted
            if np.linalg.norm(after[:3]) < SETTINGS.keep_out_m:
                x, y, z = axes.sees(after, (tick + part) * PAPER.dt_s)
                assert max(abs(x), abs(z)) <= WAY.width_m + WAY.slope * max(y - WAY.port_m, 0.0)
        state = after
    assert acted > 20


@pytest.mark.parametrize('command', ['abort', 'hold'])
def test_who_leaves_or_holds_in_the_corridor_stays_clear_of_its_walls(command):
    """An abort goes out where the corridor points; a hold is carried along by the walls."""
    table = AbortTable(table=(Row(quantity='off_corridor_m', most=0.0, reaction='warn'),))
    settings = replace(SETTINGS, abort=table)
    found = turned(TUMBLE, settings, delay=2)
    stage, motion = AssuranceStage(settings, found), motion_of(TUMBLE, found)
    state = np.array(moving_with((0.0, 6.0, 0.0, 0.0, 0.0, 0.0), motion.frame(0)))
    stage.take_event(20, command)
    line = [(0.0, 0.0, 0.0)] * 2
    for tick in range(1200):
        (force,) = stage.step(tick, tuple(state.tolist()), (0.0, 0.0, 0.0))
        line.append(force)
        if tick == 20 and command == 'abort':
            axis = to_lvlh((0.0, 1.0, 0.0), motion.frame(22))
            wanted = np.array(stage.m.watch.wanted_m_s)
            assert np.dot(axis, wanted) >= 0.999 * np.linalg.norm(wanted)
        state = np.array(cw_step(tuple(state.tolist()), line.pop(0), found.step))
        x, y, z, *_ = seen_from(tuple(state.tolist()), motion.frame(tick + 1))
        half = WAY.width_m + WAY.slope * max(y - WAY.port_m, 0.0)
        assert max(abs(x), abs(z)) <= half or np.linalg.norm(state[:3]) >= SETTINGS.keep_out_m
    said = [change.state for change in stage.abort.changes]
    assert said == {'abort': ['aborting', 'drifting', 'warned'], 'hold': ['holding']}[command]
    assert (np.linalg.norm(state[:3]) > SETTINGS.keep_out_m) == (command == 'abort')
