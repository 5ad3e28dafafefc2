# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Tables of thrusters: the allocation against SciPy and its own optimality conditions."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog
from typer.testing import CliRunner

from rpo.cli.cli import app
from rpo_core.assurance.guard import guard_of
from rpo_core.assurance.settings import Assurance
from rpo_core.files.validation import InputError
from rpo_core.kernels.jit import as_table
from rpo_core.scenario.scenario import load_scenario
from rpo_core.thrusters import allocation_kernels as kernels
from rpo_core.thrusters.allocation_kernels import (
    DUAL,
    FULL,
    LIMIT,
    ROWS,
    SCRATCH,
    THRUST,
)
from rpo_core.thrusters.table import (
    PRESETS,
    Failure,
    Thruster,
    ThrusterTable,
    authority,
    known_authority,
    table_of,
)
from rpo_core.thrusters.thrusters import Propellant, Thrusters, stage_of

BASE = load_scenario('paper_test')
EYE = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def preset(name='pairs_12', force_n=0.5, **more):
    return ThrusterTable(preset=name, force_n=force_n, **more)


class Programme:
    """The linear programme of a table, for us and for SciPy."""

    def __init__(self, table):
        self.table = table_of(table, 0.1, 0.5, None, EYE)
        self.columns = np.array(self.table.columns).reshape(-1, ROWS).T
        torque = np.vstack([np.zeros((3, 6)), np.kron(np.eye(3), [[1.0, -1.0]])])
        self.all_columns = np.hstack([self.columns, torque])
        self.most = np.array(self.table.most)
        self.work = as_table(np.zeros(SCRATCH))

    def solve(self, wanted, most=None):
        """Return the thrusts, the share of the demand; leaves its prices in the scratch."""
        for i, value in enumerate((self.most if most is None else most).tolist()):
            self.work[LIMIT + i] = value
        share, _ = kernels.allocate(as_table(wanted), self.table, self.work)
        return np.array(self.work[THRUST : THRUST + len(self.most)]), share

    def scipy(self, wanted, most=None, share=False):
        """Return the least cost, or the largest share of the demand, as HiGHS finds it."""
        most = self.most if most is None else most
        bounds = [(0.0, value) for value in most] + [(0.0, None)] * 6
        burns = [*self.table.burns, *[self.table.penalty] * 6]
        if share:
            a = np.hstack([self.all_columns, -np.array(wanted)[:, None]])
            found = linprog([*[0.0] * len(burns), -1.0], A_eq=a, b_eq=np.zeros(6),
                            bounds=[*bounds, (0.0, 1.0)], method='highs')  # fmt: skip
            return -found.fun
        return linprog(burns, A_eq=self.all_columns, b_eq=wanted, bounds=bounds,
                       method='highs').fun  # fmt: skip

    def assert_agrees(self, wanted, most=None):
        """Assert that our answer is that of SciPy, to 1e-12 N."""
        most = self.most if most is None else most
        wanted = np.array(wanted, dtype=float)
        thrusts, share = self.solve(wanted, most)
        given = self.columns @ thrusts
        assert (thrusts >= 0.0).all() and (thrusts <= most).all()
        assert_between(given[:3], share * wanted[:3], wanted[:3], 1e-12)
        if share < 1.0:
            assert share == pytest.approx(self.scipy(wanted, most, share=True), abs=1e-12)
        else:
            left = np.abs(given[3:] - wanted[3:]).sum()
            cost = np.array(self.table.burns) @ thrusts + self.table.penalty * left
            assert cost == pytest.approx(self.scipy(wanted, most), abs=1e-12 * max(1.0, cost))

    def assert_optimal(self, wanted):
        """Assert the conditions of Karush, Kuhn and Tucker: prices prove that no answer is cheaper.

        A thruster that costs more than its column is worth is off, one that costs less is full;
        torque that is left over has the price of the penalty.
        """
        thrusts, share = self.solve(wanted)
        prices = np.array(self.work[DUAL : DUAL + ROWS])
        reduced = np.array(self.table.cost) - prices @ self.columns
        close = 1e-9 * self.table.penalty
        assert (thrusts[reduced > close] <= 1e-12).all()
        assert (thrusts[reduced < -close] >= self.most[reduced < -close] - 1e-12).all()
        assert (np.abs(prices[3:]) <= self.table.penalty + close).all()
        left = share * np.array(wanted)[3:] - (self.columns @ thrusts)[3:]
        for price, torque in zip(prices[3:], left, strict=True):
            if abs(torque) > 1e-9:
                assert price == pytest.approx(np.sign(torque) * self.table.penalty, rel=1e-9)
        full = np.array(self.work[FULL : FULL + len(self.most)]) > 0.0
        assert (thrusts[full] == self.most[full]).all()


def assert_between(values, some, all_of_it, tolerance):
    """Assert that forces lie between a share of the demand and the whole, axis by axis."""
    assert (values >= np.minimum(some, all_of_it) - tolerance).all()
    assert (values <= np.maximum(some, all_of_it) + tolerance).all()


def demands(rng, count, size):
    """Return forces of all sizes, some along axes or between two, and no torque."""
    found = np.zeros((count, ROWS))
    found[:, :3] = rng.normal(size=(count, 3)) * size * rng.choice([0.1, 0.5, 1.0, 3.0], (count, 1))
    found[::5, 0] = 0.0
    found[::10, 1] = 0.0
    return found


@pytest.mark.parametrize('name', PRESETS)
@pytest.mark.parametrize('centre', [(0.0, 0.0, 0.0), (0.11, -0.03, 0.07)])
def test_presets_agree_with_scipy_whole_and_with_each_single_failure(name, centre):
    programme, rng = Programme(preset(name, centre_of_mass_m=centre)), np.random.default_rng(5)
    starts = np.array(programme.table.bases).reshape(-1, kernels.START)
    assert len(np.unique(starts, axis=0)) == len(starts) > 8, 'of no force, and of each octant'
    for at, wanted in enumerate(demands(rng, 60, 0.6)):
        most = programme.most.copy()
        if at % 3:
            most[at % len(most)] = 0.0
        programme.assert_agrees(wanted, most)


@st.composite
def tables(draw):
    """Draw some thrusters anywhere, that push anywhere."""
    number = st.floats(-1.0, 1.0).map(lambda value: round(value, 2))
    vectors = st.tuples(number, number, number)
    rows = draw(st.lists(st.tuples(vectors, vectors.filter(any)), min_size=1, max_size=14))
    each = tuple(
        Thruster(name=f't{i}', position_m=place, direction=towards, force_n=0.3 + 0.1 * (i % 3),
                 specific_impulse_s=200.0 + 10.0 * (i % 2))
        for i, (place, towards) in enumerate(rows)
    )  # fmt: skip
    return ThrusterTable(thrusters=each)


@settings(max_examples=40, deadline=None)
@given(tables(), st.tuples(*[st.floats(-1.0, 1.0)] * 3))
def test_any_table_gives_the_optimum(table, force):
    """Its prices prove that it is one; no force is against the demand, or more than that."""
    programme = Programme(table)
    wanted = [*(round(value, 3) for value in force), 0.0, 0.0, 0.0]
    thrusts, share = programme.solve(wanted)
    given = programme.columns @ thrusts
    force = np.array(wanted[:3])
    assert_between(given[:3], share * force, force, 1e-9)
    assert share == pytest.approx(programme.scipy(wanted, share=True), abs=1e-6)
    if share == 1.0:
        programme.assert_optimal(wanted)


def exerted(table, commands, **more):
    """Return mean forces and torques of commands, and the stage."""
    scenario = BASE.equipped(Thrusters(table=table, **more))
    stage = stage_of(scenario.thrusters, scenario)
    stage.reset()
    made = [stage.step(tick, tuple(map(float, c))) for tick, c in enumerate(commands)]
    return np.array([m[2] for m in made]), np.array([m[3] for m in made]), stage


def test_an_impulse_below_the_bit_is_carried_or_lost():
    commands = np.tile([0.004, -0.013, 0.0], (400, 1))
    table = preset(minimum_impulse_bit_n_s=0.004)  # of a pair 0.008 N s, 0.08 N for a tick
    given, torque, _ = exerted(table, commands)
    owed = np.cumsum(commands - given, axis=0) * BASE.dt_s
    assert np.abs(owed).max() <= 0.008 + 1e-12
    fired = given[given != 0.0]
    assert fired.size and np.abs(fired).min() >= 0.08 - 1e-12
    assert not torque.any()
    lost, _, _ = exerted(replace(table, modulation='pulse_width'), commands)
    assert not lost.any()


def test_no_angular_momentum_is_gathered():
    """Torque that thrusters below their bit leave over is carried: a bit times the arm remains."""
    rng = np.random.default_rng(8)
    commands = np.cumsum(rng.normal(size=(500, 3)) * 0.005, axis=0)
    table = preset('quads_16', 0.25, minimum_impulse_bit_n_s=0.004)
    given, torque, _ = exerted(table, commands)
    owed = np.cumsum(commands - given, axis=0) * BASE.dt_s
    gathered = np.cumsum(torque, axis=0) * BASE.dt_s
    assert 0.0 < np.abs(gathered).max() <= 0.012
    assert np.abs(owed).max() <= 0.012
    lost = exerted(replace(table, modulation='pulse_width'), commands)[1]
    assert np.abs(np.cumsum(lost, axis=0) * BASE.dt_s).max() > 0.05


def test_without_thrust_to_one_side_the_other_axes_have_all_of_theirs():
    off = Failure(thruster='z+', stuck='off', known=True)
    given, _, _ = exerted(preset('faces_6', failures=(off,)), [(0.2, -0.3, 0.4)] * 5)
    np.testing.assert_array_equal(given, [(0.2, -0.3, 0.0)] * 5)


def test_propellant_is_that_of_each_thruster():
    """Impulse over specific impulse and standard gravity; x+ has one of its own."""
    own = [replace(t, specific_impulse_s=100.0 if t.name == 'x+' else None)
           for t in preset('faces_6').each]  # fmt: skip
    table = ThrusterTable(thrusters=tuple(own))
    tank = Propellant(specific_impulse_s=200.0, mass_kg=1.0)
    given, _, stage = exerted(table, [(0.3, 0.2, 0.0)] * 50, propellant=tank)
    np.testing.assert_allclose(given, np.tile([0.3, 0.2, 0.0], (50, 1)), rtol=1e-14)
    delta_v, spent, openings = stage.spent()
    assert spent == pytest.approx(5.0 * (0.3 / 100.0 + 0.2 / 200.0) / 9.80665, rel=1e-12)
    assert delta_v == pytest.approx(5.0 * 0.5 / (BASE.mass_kg - spent / 2.0), rel=1e-6)
    assert openings == 100


def test_what_an_empty_tank_lacks_is_lacking_in_force_and_torque_alike():
    on = Failure(thruster='y-b', stuck='on')
    table, commands = preset('corners_24', 0.2, failures=(on,)), [(0.1, 0.2, -0.3)] * 8
    force, torque, _ = exerted(table, commands)
    given, turned, stage = exerted(
        table, commands, propellant=Propellant(specific_impulse_s=200.0, mass_kg=1e-4)
    )
    shares = given[:, 2] / force[:, 2]
    assert stage.spent()[1] == pytest.approx(1e-4) and np.abs(torque).min(axis=0).all()
    assert shares[0] == 1.0 and 0.0 < shares[shares > 0.0][-1] < 1.0 and shares[-1] == 0.0
    np.testing.assert_allclose(given, force * shares[:, None], rtol=1e-14)
    np.testing.assert_allclose(turned, torque * shares[:, None], rtol=1e-14)


def test_a_known_failure_keeps_the_torque_away_and_an_unknown_one_does_not():
    commands = np.tile([0.0, 0.0, 0.4], (10, 1))
    off = Failure(thruster='z+a', stuck='off', from_s=0.5)
    given, torque, _ = exerted(preset('quads_16', failures=(off,)), commands)
    np.testing.assert_allclose(given[:5], commands[:5], atol=1e-14)
    assert not torque[:5].any()
    np.testing.assert_allclose(given[5:, 2], 0.2, atol=1e-14)
    np.testing.assert_allclose(np.abs(torque[5:]).max(axis=1), 0.2, atol=1e-14)
    known = preset('quads_16', failures=(replace(off, known=True),))
    given, torque, _ = exerted(known, commands)
    np.testing.assert_allclose(given, commands, atol=1e-13)
    np.testing.assert_allclose(torque, 0.0, atol=1e-13)


def test_the_others_make_up_for_a_thruster_that_is_known_to_be_on():
    on = Failure(thruster='y-b', stuck='on', from_s=0.3, until_s=0.6, known=True)
    commands = np.tile([0.1, 0.2, 0.0], (10, 1))
    given, torque, _ = exerted(preset('corners_24', 0.2, failures=(on,)), commands)
    np.testing.assert_allclose(given, commands, atol=1e-13)
    np.testing.assert_allclose(torque, 0.0, atol=1e-13)
    _, torque, _ = exerted(
        preset('corners_24', 0.2, failures=(replace(on, known=False),)), commands
    )
    assert np.abs(torque[3:6]).max() > 0.1 and not torque[6:].any()


def test_a_switch_in_flight_is_a_failure_from_its_tick_on():
    table, commands = preset('corners_24', 0.2), [(0.3, -0.2, 0.1)] * 12
    failure = Failure(thruster='x+d', stuck='off', from_s=0.4, until_s=0.9, known=True)
    other = Failure(thruster='x+b', stuck='off', from_s=0.5, known=True)
    expected = exerted(replace(table, failures=(failure, other)), commands)
    _, _, stage = exerted(table, [])
    stage.take_event(4, 'x+d off')
    stage.take_event(5, 'x+b off')
    stage.take_event(9, 'x+d ready')
    stage.take_event(9, 'x+q off')  # there is no such thruster
    made = [stage.step(tick, command) for tick, command in enumerate(commands)]
    np.testing.assert_array_equal([m[2] for m in made], expected[0])
    assert 'must be one of x+a' in stage.refusal('x+q off')
    stage.reset()
    assert stage.step(5, commands[0])[2] == exerted(table, [])[2].step(5, commands[0])[2]


def reach(table, direction, stuck=(), torque_nm=(0.0, 0.0, 0.0)):
    """Return the largest force along a direction with a torque, as HiGHS finds it."""
    programme = Programme(table)
    columns, most = programme.columns, programme.most.copy()
    held = -np.array([0.0, 0.0, 0.0, *torque_nm]) / programme.table.lever
    for name, how in dict(stuck).items():
        at = table.names.index(name)
        held += columns[:, at] * most[at] if how == 'on' else 0.0
        most[at] = 0.0
    a = np.hstack([columns, -np.array([*direction, 0.0, 0.0, 0.0])[:, None]])
    found = linprog([*[0.0] * len(most), -1.0], A_eq=a, b_eq=-held,
                    bounds=[*((0.0, m) for m in most), (0.0, None)], method='highs')  # fmt: skip
    return -found.fun if found.status == 0 else 0.0


def test_forces_beside_a_torque_are_those_of_scipy():
    """Of the shipped mission: no torque of the unloading takes any of its ball of forces."""
    table = preset('corners_24', 0.255, arm_m=0.15)
    table = replace(table, failures=(Failure(thruster='y+a', stuck='off', known=True),))
    assert known_authority(table, 0.04).least_n == pytest.approx(known_authority(table).least_n)
    most = 0.1  # beyond that it does
    found, draw = known_authority(table, most), np.random.default_rng(3).normal(size=(30, 3))
    draw /= np.linalg.norm(draw, axis=1)[:, None]
    far = min(
        reach(table, side, {'y+a': 'off'}, torque)
        for torque in product((most, -most), repeat=3)
        for side in draw
    )
    assert found.least_n < known_authority(table).least_n - 0.05
    assert 0.0 < found.least_n <= far + 1e-9
    assert far < 1.3 * found.least_n


@pytest.mark.parametrize('name', PRESETS)
@pytest.mark.parametrize(
    'stuck', [{}, {'y+a': 'off'}, {'z-a': 'on'}, {'x+a': 'off', 'z+b': 'on', 'y-a': 'off'}]
)
def test_authority_is_that_of_scipy(name, stuck):
    table = preset(
        name, 0.5, centre_of_mass_m=(0.1, 0.0, 0.05) if '16' in name else (0.0, 0.0, 0.0)
    )
    stuck = {n if name != 'faces_6' else n[:2]: how for n, how in stuck.items()}
    found = authority(table, stuck)
    sides = [sign * unit for unit in np.eye(3) for sign in (1.0, -1.0)]
    expected = [reach(table, side, stuck) for side in sides]
    np.testing.assert_allclose(found.axes_n, expected, atol=1e-9)
    corners = product((1.0, -1.0), repeat=3)
    assert found.box_n == pytest.approx(min(reach(table, c, stuck) for c in corners), abs=1e-9)
    draw = np.random.default_rng(3).normal(size=(20, 3))
    draw /= np.linalg.norm(draw, axis=1)[:, None]
    least = min(*expected, *(reach(table, side, stuck) for side in draw))
    assert found.box_n - 1e-9 <= found.least_n <= least + 1e-9


def test_a_thruster_that_is_on_takes_all_of_a_table_that_makes_up_for_a_part_of_it():
    weak = (replace(t, force_n=0.3 if t.name == 'x-' else 0.5) for t in preset('faces_6').each)
    table = ThrusterTable(thrusters=tuple(weak))
    assert authority(table, {'x+': 'on'}).axes_n == (0.0,) * 6
    left = authority(table, {'x-': 'on'})
    assert left.axes_n == pytest.approx((0.2, 0.3, 0.5, 0.5, 0.5, 0.5))


def assured(*failures, preset_name='quads_16', force_n=0.25):
    table = preset(preset_name, force_n, failures=failures)
    found = load_scenario('assured').equipped(Thrusters(table=table))
    return found, replace(found.section(Assurance), thrust_error=0.05)


def test_assurance_takes_the_force_that_known_failures_leave():
    off = Failure(thruster='y+a', stuck='off', from_s=100.0, known=True)
    whole = guard_of(*reversed(assured()))
    assert whole.limit_n == 0.5
    assert guard_of(*reversed(assured(replace(off, known=False)))).limit_n == 0.5
    with pytest.raises(InputError, match='exclude each other'):
        guard_of(*reversed(assured(off)))  # half of it is too little for this speed limit
    less = guard_of(*reversed(assured(off, force_n=0.4)))
    assert less.limit_n == pytest.approx(0.4)
    assert less.brake_n < whole.brake_n
    with pytest.raises(InputError, match='needs a force to all sides without torque'):
        guard_of(*reversed(assured(off, preset_name='pairs_12')))


def test_the_command_prints_what_is_left():
    done = CliRunner().invoke(app, ['safety', 'thrusters', 'quads_16'])
    assert done.exit_code == 0, done.output
    assert 'of 32 failures: 16 full, 16 partial, 0 none' in done.output
    pairs = CliRunner().invoke(app, ['safety', 'thrusters', 'faces_6', '--pairs'])
    assert 'of 60 pairs of failures: 0 full, 0 partial, 60 none' in pairs.output
    changes = ['--set', 'thrusters.table={preset: corners_24, force_n: 0.15}']
    done = CliRunner().invoke(app, ['safety', 'thrusters', 'approach', *changes])
    assert 'of 48 failures: 0 full, 48 partial, 0 none' in done.output
    assert CliRunner().invoke(app, ['safety', 'thrusters', 'approach']).exit_code != 0
