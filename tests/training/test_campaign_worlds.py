# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Campaigns in true worlds: the engine flies the bits of the core; dispersions act."""

from dataclasses import replace

import numpy as np
import pytest
from campaign_documents import EVERYTHING, write_campaign

from rpo_core.files import scenario
from rpo_core.files.validation import InputError
from rpo_core.judge.requirements import Requirements
from rpo_core.judge.verdicts import verdicts
from rpo_core.world.thrusters import Propellant, Pulses, Thrusters
from rpo_montecarlo.campaign import config, run_batch, sampling, single
from rpo_montecarlo.engine import support
from rpo_nav.estimator import Estimator
from rpo_safety.shaping import Shaping

pytestmark = pytest.mark.timeout(240)  # compiling on a busy machine

WORLD = {
    **{
        name: spread
        for name, spread in EVERYTHING.items()
        if 'disturbance' not in name and 'navigation' not in name
    },
    'density_share': {'uniform': 0.5},
    'ballistic_coefficient_share': {'normal': 0.1},
    'true_anomaly_deg': {'uniform': 180.0},
    'stuck_off_thruster': {'whole': 11},
    'sensor_noise_share': {'uniform': 0.3},
    'sensor_scale_error': {'normal': 0.002},
    'sensor_bias_x_m': {'normal': 0.02},
}
LEO = replace(scenario.load_scenario('world_leo'), duration_s=12.0)
ELLIPTIC = replace(scenario.load_scenario('world_elliptic'), duration_s=12.0)
PLAIN = replace(scenario.load_scenario('approach'), duration_s=12.0)
FIRING = Thrusters(
    pulses=Pulses(count=6, modulation='pulse_width', minimum_on_time_s=0.01),
    propellant=Propellant(specific_impulse_s=2.0, mass_kg=1.0),
)
LEAK = Propellant(specific_impulse_s=2.0, mass_kg=0.3)
SOME = {'initial_position_m': {'uniform': 5.0}, 'mass_share': {'normal': 0.03}}
MEASURED = replace(scenario.load_scenario('paper_test_measured'), duration_s=12.0)
AS_FLOWN = config.load(config.find('paper_test_measured'), controller='handmade').config.dispersions
COMPENSATED = LEO.equipped(replace(LEO.section(Estimator), compensate=True))
CASES = {
    'leo': (LEO, WORLD),
    'leo, compensated': (COMPENSATED, SOME),
    'measured and shaped': (
        MEASURED.equipped(Shaping(0.01, 0.001)),
        {name: {d.distribution: list(d.spread) if len(d.spread) > 1 else d.spread[0]}
         for name, d in AS_FLOWN.items()},
    ),
    'elliptic': (ELLIPTIC, SOME),
    'linear': (replace(PLAIN, sections=(replace(ELLIPTIC.dynamics, kind='linear_elliptic', j2=False,
                                                eccentricity=0.01),)), SOME),
    'propellant alone': (
        PLAIN.equipped(Thrusters(propellant=LEAK)),
        {**SOME, 'thrust_share': {'normal': 0.02}, 'misalignment_deg': {'normal': 1.0},
         'delay_ticks': {'whole': 2}},
    ),
    'pulses about a circle': (PLAIN.equipped(FIRING), {**SOME, 'stuck_off_thruster': {'whole': 5}}),
}  # fmt: skip


@pytest.fixture
def write(tmp_path):
    """Return a function that writes a campaign and returns it."""

    def written(flown, **changes):
        path = tmp_path / 'world.yaml'
        path.write_text(scenario.dumps(flown))
        changes = {'scenario': str(path), 'runs': 45, **changes}
        return config.load(write_campaign(tmp_path, **changes))

    return written


@pytest.mark.parametrize(
    ('case', 'controller'), [*((case, 'handmade') for case in CASES), ('leo', 'pd')]
)
def test_the_engine_flies_the_bits_of_the_core(write, case, controller, monkeypatch):
    flown, dispersions = CASES[case]
    campaign = write(flown, dispersions=dispersions, controller=controller)
    assert support.why_not(campaign.scenario, campaign.controller) == ''
    found = run_batch.fly_runs(campaign, 0, 45)
    monkeypatch.setattr('rpo_montecarlo.campaign.run_batch.why_not', lambda *_: 'test')
    for number in (0, 39, 44):
        single_run = run_batch.fly_runs(campaign, number, 1)
        assert list(single_run) == list(found)
        for name, (value,) in single_run.items():
            assert found[name][number] == value, name


def test_the_run_of_a_campaign_is_a_scenario_of_its_own(write):
    campaign = write(LEO, dispersions=WORLD)
    drawn = sampling.draw(campaign, 7, 1)
    flown = single.scenario_of(campaign, 7)
    own = dict(zip(drawn.names, drawn.parameters[0].tolist(), strict=True))
    drag, nominal = flown.dynamics.drag, LEO.dynamics.drag
    assert drag.density_kg_m3 == nominal.density_kg_m3 * (1.0 + own['density_share'])
    assert drag.density_radius_m == LEO.orbit_radius_m != flown.orbit_radius_m
    assert flown.dynamics.true_anomaly_deg == 30.0 + own['true_anomaly_deg']
    (failure,) = flown.thrusters.pulses.failures
    assert failure.stuck == 'off' and not failure.known
    assert flown.thrusters.matrix != Thrusters().matrix
    assert flown.thrusters.pulses == replace(LEO.thrusters.pulses, failures=(failure,))
    assert flown.thrusters.propellant == LEO.thrusters.propellant


def test_new_dispersions_leave_the_draws_of_the_others_alone(write):
    few = {name: WORLD[name] for name in ('initial_position_m', 'mass_share', 'true_anomaly_deg')}
    draws = [
        sampling.draw(write(LEO, dispersions=d, sampling=way), 0, 45)
        for d in (few, {**few, 'density_share': {'uniform': 0.5}})
        for way in ('latin_hypercube', 'random')
    ]
    for one, other in (draws[0::2], draws[1::2]):
        np.testing.assert_array_equal(one.parameters[:, :24], other.parameters[:, :24])
        np.testing.assert_array_equal(
            one.column('true_anomaly_deg'), other.column('true_anomaly_deg')
        )
    strata = np.sort(np.floor((draws[0].column('true_anomaly_deg') / 180.0 + 1.0) / 2.0 * 45))
    np.testing.assert_array_equal(strata, np.arange(45))


def test_every_thruster_sticks(write):
    campaign = write(LEO, dispersions={'stuck_off_thruster': {'whole': 11}}, runs=200)
    stuck = sampling.draw(campaign, 0, 200).column('stuck_off_thruster')
    assert set(stuck) == set(range(12))


def test_what_the_thrusters_spent_can_be_required(write):
    limits = {'propellant_kg': 0.01, 'valve_openings': 400.0, 'mean_error_norm_m': 100.0}
    campaign = write(LEO, dispersions=SOME, success=limits)
    columns = run_batch.fly_runs(campaign, 0, 5)
    assert (columns['propellant_kg'] > 0.0).all()
    assert list(columns)[-3:] == ['thruster_delta_v_m_s', 'propellant_kg', 'valve_openings']
    with pytest.raises(InputError, match='needs thrusters with'):
        write(PLAIN, dispersions=SOME, success=limits)


@pytest.mark.parametrize(
    ('flown', 'dispersions', 'said'),
    [
        (PLAIN, {'density_share': {'uniform': 0.5}}, '`density_share` has no effect: scenario app'),
        (PLAIN, {'true_anomaly_deg': {'uniform': 5.0}}, 'has no orbit but a circle'),
        (PLAIN, {'stuck_off_thruster': {'whole': 5}}, 'has no `pulses` of thrusters'),
        (PLAIN.equipped(FIRING), {'stuck_off_thruster': {'whole': 6}}, 'must be below 6'),
        (LEO, {'density_share': {'uniform': 1.5}}, '`dispersions.density_share.uniform` must be'),
        (LEO.equipped(replace(FIRING, delay_ticks=1)), SOME, 'no `matrix` and `delay_ticks`'),
    ],
)
def test_dispersions_that_cannot_act_are_one_sentence(write, flown, dispersions, said):
    with pytest.raises(InputError) as caught:
        write(flown, dispersions=dispersions)
    assert said in str(caught.value) and '\n' not in str(caught.value)


@pytest.mark.parametrize('singly', [False, True])
def test_a_scenario_may_require_what_thrusters_spend(write, monkeypatch, singly):
    """Success of a campaign is the verdict of each flight, of the engine and of the core."""
    limits = {'propellant_kg': 0.012, 'thruster_delta_v_m_s': 5.0, 'valve_openings': 300.0}
    required = replace(LEO, requirements=Requirements(**limits))
    campaign = write(required, dispersions=SOME, success=None)
    assert campaign.config.success == limits
    if singly:
        monkeypatch.setattr('rpo_montecarlo.campaign.run_batch.why_not', lambda *_: 'test')
    columns = run_batch.fly_runs(campaign, 0, 3)
    for number in range(3):
        found = {v.key: v.value for v in verdicts(single.fly_run(campaign, number))}
        assert found == {name: columns[name][number] for name in limits}
        assert found['propellant_kg'] > 0.0 and found['valve_openings'] > 10.0


def test_an_empty_tank_ends_the_thrust(write):
    campaign = write(PLAIN.equipped(Thrusters(propellant=LEAK)), dispersions=SOME, runs=3)
    columns = run_batch.fly_runs(campaign, 0, 3)
    assert (columns['propellant_kg'] == LEAK.mass_kg).all()
    assert 'valve_openings' not in columns
