# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Families of controllers: laws against SciPy, the Gramian and flights; words, files."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import RegularGridInterpolator

from rpo_core.chain.flight import fly
from rpo_core.control import controller, textbook
from rpo_core.control.baselines import Model, Mpc, baseline_force
from rpo_core.control.explain import reasons
from rpo_core.control.family import Gene, Mission, family_of
from rpo_core.control.time_to_go import WORDS, Rule, TimeToGo
from rpo_core.files.validation import InputError
from rpo_core.judge import metrics
from rpo_core.scenario.requirements import ARRIVAL_WINDOW_S
from rpo_core.scenario.scenario import load_scenario
from rpo_core.world import cw

PAPER = Mission((1.0, 1.0, 1.0), 0.5, 0.1)
FAMILIES = ('time_to_go', 'more_words')
APPROACH = load_scenario('approach')

states = st.tuples(*[st.floats(-300, 300)] * 3, *[st.floats(-5, 5)] * 3)


def start_of(name, mission=PAPER):
    """Return the controller where a search of the family begins."""
    family = family_of(name)
    genes = (gene.fitted(mission.units) for gene in family.genes())
    return family.of_values(name, [gene.value(gene.share(gene.start)) for gene in genes], mission)


TO_GO, MORE = map(start_of, FAMILIES)


@pytest.mark.parametrize('law', [TO_GO, MORE], ids=FAMILIES)
@settings(max_examples=20)
@given(state=states, tick=st.integers(0, 4000))
def test_forces_are_odd_bit_for_bit_within_the_limit_and_the_same_axis_by_axis(law, state, tick):
    force = law.force_n(state[:3], state[3:], tick)
    mirrored = tuple(-x for x in state)
    assert law.force_n(mirrored[:3], mirrored[3:], tick) == tuple(-f for f in force)
    assert max(map(abs, force)) <= law.max_force_n
    assert all(type(f) is float and math.isfinite(f) for f in force)
    assert force == baseline_force(state, tick, law.law)


CREEPING, *_, FAST = MORE.speed_peaks_m_s


def test_a_law_is_the_bilinear_interpolation_of_its_table():
    speeds = [-FAST, -CREEPING, 0.0, *MORE.speed_peaks_m_s]
    forces = np.vstack([-MORE.damping_n_s_m * np.array(speeds), MORE.forces_n])
    table = RegularGridInterpolator(([0.0, *MORE.distance_peaks_m], speeds), forces)
    for r, v in np.random.default_rng(4).uniform(-1, 1, (300, 2)) * np.array([150.0, 2.0]):
        closing = np.clip(-np.sign(r) * v, -FAST, FAST)
        pull = float(table((min(abs(r), MORE.distance_peaks_m[-1]), closing)))
        expected = np.clip(-np.sign(r) * pull, -0.5, 0.5)
        assert MORE.force_n((r, 0, 0), (v, 0, 0))[0] == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize('v', [-0.8, -0.01, 0.01, 0.8])
def test_a_table_has_no_jump_at_the_target(v):
    before, at, after = (MORE.force_n((r, 0, 0), (v, 0, 0))[0] for r in (-1e-9, 0.0, 1e-9))
    assert before == pytest.approx(at, abs=1e-9) and after == pytest.approx(at, abs=1e-9)
    assert MORE.force_n((0.0, 0, 0), (0.0, 0, 0))[0] == 0.0
    assert at * v < 0.0  # it brakes


def test_time_to_go_with_gains_6m_t2_and_4m_t_is_the_least_energy_law_of_a_free_mass():
    """The Gramian of the predictive controller, far from any planet, has the same first force."""
    mass, peaks = 10.0, (160.0, 100.0, 60.0, 30.0, 10.0)
    rules = [Rule(w, t, 6 * mass / t**2, 4 * mass / t) for w, t in zip(WORDS, peaks, strict=True)]
    law = TimeToGo(name='free', max_force_n=1e3, arrival_s=180.0, tick_s=0.1, rules=tuple(rules))
    model = Model(orbit_radius_m=1e9, mass_kg=mass, dt_s=0.1)
    mpc = Mpc(name='free', max_force_n=1e3, horizon_s=180.0, least_time_to_go_s=5.0, model=model)
    for t in peaks:
        tick = round((180.0 - t) / 0.1)
        state = (40.0, -70.0, 5.0), (-0.3, 0.1, 0.05)
        np.testing.assert_allclose(law.force_n(*state, tick), mpc.force_n(*state, tick), rtol=0.02)


@pytest.mark.parametrize('law', [TO_GO, MORE], ids=FAMILIES)
def test_a_search_begins_at_the_frequency_and_damping_of_the_textbook(law):
    """With gains of one time to go T: sqrt(6) / T rad/s, damping 2 / sqrt(6)."""
    r = v = 1e-6
    stiffness = -law.force_n((r, 0, 0), (0, 0, 0), 10**6)[0] / r
    friction = -law.force_n((0, 0, 0), (v, 0, 0), 10**6)[0] / v
    roots = np.roots([10.0, friction, stiffness])
    frequency = math.sqrt(np.prod(roots).real)
    assert frequency == pytest.approx(math.sqrt(6.0) / textbook.LEAST_S, rel=1e-3)
    assert -roots.sum().real / 2.0 / frequency == pytest.approx(2.0 / math.sqrt(6.0), rel=2e-3)


def test_the_textbook_infers_the_time_to_go_of_an_approach_of_least_energy(monkeypatch):
    assert textbook.time_from_rest_s(0.1) == textbook.time_from_rest_s(0.5) == 15.0
    assert textbook.time_from_rest_s(100.0) == pytest.approx(170.0)
    monkeypatch.setattr(textbook, 'time_from_rest_s', lambda distance_m: 120.0)
    for s in np.linspace(0.01, 0.85, 15):
        distance, closing = 40.0 * (1 - s) ** 2 * (1 + 2 * s), 6.0 * 40.0 / 120.0 * s * (1 - s)
        assert textbook.time_to_go_s(distance, closing) == pytest.approx(120.0 * (1 - s))
        force = 6.0 * 10.0 * 40.0 / 120.0**2 * (1 - 2 * s)
        assert textbook.pull_n(distance, closing) == pytest.approx(force)


def test_grades_of_the_time_to_go_add_up_to_1_and_hold_after_arrival():
    for tick in range(0, 3000, 7):
        assert sum(TO_GO.grades(tick)) == pytest.approx(1.0, abs=1e-15)
    assert TO_GO.grades(3000) == (0, 0, 0, 0, 1)
    due = TO_GO.rules[-1]
    assert TO_GO.gains(10**6) == (due.position_gain_n_m, due.velocity_gain_n_s_m)
    last = TO_GO.force_n((0.5, 0, 0), (0, 0, 0), 10**6)[0]
    assert last == -0.5 * due.position_gain_n_m


def test_claims_bound_all_flights_and_a_corner_comes_near():
    worst = TO_GO._worst_of_box(ARRIVAL_WINDOW_S)
    largest = np.zeros(4)
    rng = np.random.default_rng(3)
    signs = rng.choice([-1.0, 1.0], (20, 6))
    for sign in [*signs, (1, 1, 1, 1, 1, 1), (1, -1, 1, 1, -1, 1)]:
        position, velocity = 100.0 * np.array(sign[:3]), 0.05 * np.array(sign[3:])
        start = replace(
            APPROACH,
            duration_s=200.0,
            initial_position_m=tuple(position.tolist()),
            initial_velocity_m_s=tuple(velocity.tolist()),
        )
        flight = fly(start, TO_GO)
        found, force = metrics.of_flight(flight), np.abs(flight.forces_n).max()
        row = (force, found.slew_per_axis_n_s, found.mean_error_norm_m, found.mean_speed_norm_m_s)
        assert (np.array(row) <= np.array(worst) * (1 + 1e-9)).all()
        largest = np.maximum(largest, row)
    assert (largest > 0.7 * np.array(worst)).all()


def test_a_time_to_go_law_that_cannot_hold_is_not_proven():
    weak = [replace(rule, velocity_gain_n_s_m=0.0) for rule in TO_GO.rules]
    claims = {c.name: c.holds for c in replace(TO_GO, rules=tuple(weak)).claims()}
    assert not claims['arrival'] and not claims['speed']
    assert {c.name for c in TO_GO.claims() if c.holds} >= {'force', 'slew', 'hold'}


def test_a_table_holds_the_disturbance_that_it_claims():
    law = MORE
    statement = next(c.statement for c in law.claims() if c.name == 'held disturbance')
    held = float(statement.split()[-2])
    for distance_m in np.geomspace(0.5, 300.0, 40):
        assert -law.force_n((distance_m, 0.0, 0.0), (0.0, 0.0, 0.0), 0)[0] >= 0.99 * held
    a_d, b_d = cw.matrices(cw.discretise(0.0, 10.0, 0.1))
    state = np.zeros(6)
    for tick in range(6000):
        force = np.array(law.force_n(state[:3], state[3:], tick))
        state = a_d @ state + b_d @ (force + np.array([0.8 * held, 0.0, 0.0]))
    assert abs(state[0]) <= 0.5 and abs(state[3]) < 1e-6
    assert not [c for c in law.claims() if c.needed and not c.holds]


@pytest.mark.parametrize('law', [TO_GO, MORE], ids=FAMILIES)
def test_a_file_holds_all_of_it_and_its_values_make_it_again(law):
    again = controller.parse(yaml.safe_load(controller.dumps(law)))
    assert again == law and controller.dumps(again) == controller.dumps(law)
    assert type(law).of_values(law.name, law.values(), PAPER) == law
    assert len(law.values()) == len({gene.name for gene in type(law).genes()})


@pytest.mark.parametrize('name', FAMILIES)
def test_a_controller_of_another_mission_flies_the_same_flight_in_its_units(name):
    """Twice as far, in half the time, five times the mass: similar flights."""
    units = (2.0, 0.5, 5.0 * 2.0 / 0.25)
    own, far = start_of(name), start_of(name, Mission(units, 0.5 * units[2], 0.05))
    state = np.array([50.0, -20.0, 3.0, -0.4, 0.1, 0.02])
    scaled = state * np.repeat([2.0, 4.0], 3)
    for tick in (0, 900, 1700):
        force = np.array(own.force_n(state[:3], state[3:], tick))
        np.testing.assert_allclose(
            far.force_n(scaled[:3], scaled[3:], tick), units[2] * force, rtol=2e-3
        )


def test_reasons_say_the_words_and_the_force_of_the_flight():
    state = (12.0, -40.0, 0.0, -0.3, 0.0, 0.0)
    for law, tick in ((TO_GO, 1200), (MORE, 0)):
        found = [dict(reason.numbers) for reason in reasons(law, state, tick)]
        forces = [numbers['force_n'] for numbers in found]
        assert tuple(forces) == law.force_n(state[:3], state[3:], tick)
    x, y, _ = reasons(MORE, state)
    strengths = [number for name, number in x.numbers if name.startswith('rule.')]
    assert sum(strengths) == pytest.approx(1.0)
    assert 'the closing speed is resting' in y.sentence
    assert 'time to go is short' in reasons(TO_GO, state, 1250)[0].sentence


@given(st.floats(-150.0, 150.0), st.floats(-1.5, 1.5))
def test_all_rules_of_a_force_are_said_with_their_shares(position, velocity):
    """Shares add up to 1, and share times force to the force, which may be limited."""
    found = reasons(MORE, (position, 0.0, 0.0, velocity, 0.0, 0.0))[0]
    force = dict(found.numbers)['force_n']
    assert sum(cause.share for cause in found.causes) == pytest.approx(1.0, abs=1e-12)
    pulls = [float(cause.what.split(' N')[0]) for cause in found.causes]
    ways = [-1.0 if 'away' in cause.what else 1.0 for cause in found.causes]
    pull = sum(c.share * p * way for c, p, way in zip(found.causes, pulls, ways, strict=True))
    limited = min(max(pull, -MORE.max_force_n), MORE.max_force_n)
    assert limited == pytest.approx(-force if position >= 0.0 else force, abs=2e-3)
    assert ('limited from' in found.force) == (abs(force) == MORE.max_force_n and abs(pull) > 0.5)
    assert found.force.startswith(f'{force:+.3g} N' if force else '0 N')


def test_peaks_that_do_not_descend_and_other_ticks_are_refused():
    rules = [replace(rule, peak_s=50.0) for rule in TO_GO.rules]
    with pytest.raises(InputError, match='`rules` must have descending `peak_s`'):
        replace(TO_GO, rules=tuple(rules))
    with pytest.raises(InputError, match=r'counts ticks of 0\.1 s; the scenario has 0\.05 s'):
        TO_GO.stage(0.05)
    with pytest.raises(InputError, match='`family` must be one of more_words, time_to_go'):
        family_of('mpc')


def test_genes_are_shares_of_their_range():
    gene = Gene('k', 1.0, 100.0, 10.0, metres=-1, newtons=1, logarithmic=True)
    assert [gene.value(share) for share in (0.0, 0.5, 1.0)] == [1.0, 10.0, 100.0]
    assert gene.share(10.0) == pytest.approx(0.5)
    assert (gene.share(0.1), gene.share(1e4)) == (0.0, 1.0)
    assert gene.fitted((2.0, 1.0, 6.0)).start == 30.0


@pytest.mark.parametrize('name', FAMILIES)
def test_the_values_of_a_family_are_those_of_its_genes(name):
    shipped = controller.load_controller(name)
    genes = type(shipped).genes()
    for seed in range(20):
        shares = np.random.default_rng(seed).random(len(genes))
        values = [gene.value(x) for gene, x in zip(genes, shares, strict=True)]
        try:
            made = type(shipped).of_values('drawn', values, PAPER)
        except InputError:
            continue  # peaks that do not ascend
        again = type(shipped).of_values('drawn', made.values(), PAPER)
        assert again == made
        for claim in made.claims() if name != 'time_to_go' else ():
            if claim.name == 'only rest at the target' and claim.holds:
                for distance in np.geomspace(0.01, 500.0, 40):
                    assert made.force_n((distance, 0.0, 0.0), (0.0, 0.0, 0.0), 0)[0] < 0.0
